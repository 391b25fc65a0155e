"""A point of a link as the tool of a closed chain: pose, twist, forces and what its motors can accelerate.

Everything is expressed in the independent coordinates through ρ: twist = J ρ q̇, with twists (linear, angular) at
the point and in world axes, m/s and rad/s, and wrenches (force, moment about the point) in world axes, N and N m.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array
from ccpin.dynamics.inverse_kinematics import Solution, solve
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import InvalidInputError
from ccpin.kinematics.parametrization import ClosedPoint
from ccpin.kinematics.points import LinkPoint

Part = Literal["linear", "angular"]
_ROWS = {"linear": slice(0, 3), "angular": slice(3, 6)}


class Ellipsoid(NamedTuple):
    """{map · x : |x| ≤ 1} in world axes.

    Attributes:
        map: Of shape (3, k).
        axes: Unit vectors along the principal axes, one a column, of shape (3, r) with r = min(3, k), longest first.
        lengths: The semi-axes, of shape (r,).
    """

    map: Array
    axes: Array
    lengths: Array

    @property
    def volume(self) -> float:
        """The product of the semi-axes: Yoshikawa's measure; 0 where some direction is lost."""
        return float(np.prod(self.lengths))


class EndEffector:
    """A point of a link, moved by the independent coordinates.

    `guess` chooses the assembly mode of σ(q) everywhere, as for `ReducedModel.sigma`, and errors are those of
    `ReducedModel.sigma`. Holds scratch memory: one instance a thread.

    Args:
        model: The reduced model.
        link: The link's name.
        point: The point in the link's frame, metres.

    Raises:
        InvalidInputError: No such link, a link that never moves, or a point that is not three finite numbers.
    """

    def __init__(self, model: ReducedModel, link: str, point: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        self.model = model
        self.link = link
        self.point = LinkPoint(model.mechanism.tree, link, point)

    def pose(self, q: ArrayLike, guess: ArrayLike | None = None) -> Array:
        """The link's axes at the point, 4×4, in the world."""
        return self.point.pose(self.model.sigma(q, guess))

    def jacobian(self, q: ArrayLike, guess: ArrayLike | None = None) -> Array:
        """J ρ with twist = J ρ q̇, of shape (6, n)."""
        return self.jacobian_at(self.model.closed_point(q, guess))

    def jacobian_at(self, point: ClosedPoint) -> Array:
        """J ρ at a configuration already closed, of shape (6, n)."""
        return self.point.jacobian(point.q_free) @ point.rho

    def jacobian_rate(self, q: ArrayLike, v: ArrayLike, guess: ArrayLike | None = None) -> Array:
        """d/dt (J ρ) = J̇ ρ + J ρ̇ along q̇, of shape (6, n)."""
        closed = self.model.closed_point(q, guess)
        v_free = closed.rho @ self.model.checked(v, "v", self.model.n)
        motion = self.point.motion(closed.q_free, v_free)
        rho_dot = self.model.parametrization.rho_dot(closed, v_free)
        return motion.jacobian_rate @ closed.rho + motion.jacobian @ rho_dot

    def velocity(self, q: ArrayLike, v: ArrayLike, guess: ArrayLike | None = None) -> Array:
        """The twist J ρ q̇, of shape (6,)."""
        return self.jacobian(q, guess) @ self.model.checked(v, "v", self.model.n)

    def acceleration(self, q: ArrayLike, v: ArrayLike, a: ArrayLike, guess: ArrayLike | None = None) -> Array:
        """The twist's rate J ρ q̈ + (J̇ ρ + J ρ̇) q̇, of shape (6,), in m/s² and rad/s²."""
        closed = self.model.closed_point(q, guess)
        v_free = closed.rho @ self.model.checked(v, "v", self.model.n)
        motion = self.point.motion(closed.q_free, v_free)
        a_free = closed.rho @ self.model.checked(a, "a", self.model.n) + self.model.parametrization.bias(closed, v_free)
        return motion.jacobian @ a_free + motion.jacobian_rate @ v_free

    def generalized_force(self, q: ArrayLike, wrench: ArrayLike, guess: ArrayLike | None = None) -> Array:
        """τ = (J ρ)ᵀ wrench, of shape (n,), with q̇ᵀτ = twistᵀ wrench.

        τ is what a wrench applied to the end effector from outside adds to the right side of (22); to press on the
        surroundings with that wrench, the motors add the same τ.
        """
        return self.jacobian(q, guess).T @ self.model.checked(wrench, "wrench", 6)

    def dynamic_manipulability(
        self,
        q: ArrayLike,
        efforts: ArrayLike | None = None,
        *,
        part: Part = "linear",
        guess: ArrayLike | None = None,
    ) -> Ellipsoid:
        """Accelerations of the end effector from rest that motor efforts add to gravity's: J ρ D⁻¹ ρᵀSᵀu.

        Args:
            q: Independent coordinates.
            efforts: The motors' efforts Δu_i > 0, N m or N: the ellipsoid is that of Σ (u_i/Δu_i)² ≤ 1. Default 1.
            part: Linear (m/s²) or angular (rad/s²) acceleration.
            guess: Chooses the assembly mode.

        Raises:
            InvalidInputError: Efforts of the wrong shape or not positive, or an unknown part.
        """
        model = self.model
        limits = np.ones(model.n_actuated) if efforts is None else model.checked(efforts, "efforts", model.n_actuated)
        if np.any(limits <= 0):
            raise InvalidInputError("efforts must be positive: the largest |u| of each motor")
        if part not in _ROWS:
            raise InvalidInputError(f"part '{part}' is not one of {', '.join(_ROWS)}")
        closed = model.closed_point(q, guess)
        mass = closed.rho.T @ (model.free_system.mass_matrix(closed.q_free) @ closed.rho)
        transmission = np.array([model.generalized_force(closed, column) for column in np.diag(limits)]).T
        response = np.column_stack([np.linalg.solve(mass, column) for column in transmission.T])
        mapped = self.jacobian_at(closed)[_ROWS[part]] @ response
        axes, lengths, _ = np.linalg.svd(mapped, full_matrices=False)
        return Ellipsoid(mapped, axes, lengths)

    def solve(self, target: ArrayLike, guess: ArrayLike | None = None) -> Solution:
        """q with the point at a target, on the branch of `guess`: inverse kinematics through the closed chain.

        Args:
            target: A position (3,), metres, or a pose (4, 4), both in the world.
            guess: A closed configuration q′ to start from; default the mechanism's reference.

        Returns:
            Solution: q, q′ = σ(q) and how far from the target the point is (at most 1e-11 m or rad).

        Raises:
            InvalidInputError: A target that is neither, or a guess that cannot be closed.
            UnreachableTargetError: No q on the branch was found that reaches the target.
        """
        return solve(self.model, self.point, target, guess)
