"""A point of a link as the tool of a closed chain: pose, twist, forces and what its motors can accelerate.

Everything is expressed in the independent coordinates through ρ: twist = J ρ q̇, with twists (linear, angular) at
the point and in world axes, m/s and rad/s, and wrenches (force, moment about the point) in world axes, N and N m.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, choice, vector
from ccpin.dynamics.inverse_kinematics import Solution, solve
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.dynamics.state import Near, State
from ccpin.errors import InvalidInputError
from ccpin.kinematics.points import LinkPoint
from ccpin.mechanism.mechanism import Mechanism

Half = Literal["linear", "angular"]
_ROWS = {"linear": slice(0, 3), "angular": slice(3, 6)}  # of a twist


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

    `q` is a State, or independent coordinates with a `near` that chooses the assembly mode; errors of the methods
    are those of `ReducedModel.at`. Any number of threads may share an end effector.

    Args:
        model: The reduced model, or a mechanism.
        link: The link's name.
        point: The point in the link's frame, metres.

    Raises:
        InvalidInputError: No such link, a link that never moves, or a point that is not three finite numbers.
    """

    def __init__(self, model: ReducedModel | Mechanism, link: str, point: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        self.model = model_of(model)
        self.link = link
        _refuse_loop(self.model.mechanism, link)
        self.point = LinkPoint(self.model.mechanism.tree, link, point)

    def pose(self, q: ArrayLike | State, near: Near = None) -> Array:
        """The link's axes at the point, 4×4, in the world."""
        return self.point.pose(self.model.at(q, near).q_free)

    def jacobian(self, q: ArrayLike | State, near: Near = None) -> Array:
        """J ρ with twist = J ρ q̇, of shape (6, n)."""
        state = self.model.at(q, near)
        return self.point.jacobian(state.q_free) @ state.rho

    def jacobian_rate(self, q: ArrayLike | State, v: ArrayLike, near: Near = None) -> Array:
        """d/dt (J ρ) = J̇ ρ + J ρ̇ along q̇, of shape (6, n)."""
        state = self.model.at(q, near)
        motion = self.point.motion(state.q_free, state.v_free(v))
        return motion.jacobian_rate @ state.rho + motion.jacobian @ state.rho_dot(v)

    def velocity(self, q: ArrayLike | State, v: ArrayLike, near: Near = None) -> Array:
        """The twist J ρ q̇, of shape (6,)."""
        return self.jacobian(q, near) @ vector(v, "v", self.model.n)

    def acceleration(self, q: ArrayLike | State, v: ArrayLike, a: ArrayLike, near: Near = None) -> Array:
        """The twist's rate J ρ q̈ + (J̇ ρ + J ρ̇) q̇, of shape (6,), in m/s² and rad/s²."""
        state = self.model.at(q, near)
        v_free = state.v_free(v)
        motion = self.point.motion(state.q_free, v_free)
        return motion.jacobian @ state.a_free(v, a) + motion.jacobian_rate @ v_free

    def generalized_force(self, q: ArrayLike | State, wrench: ArrayLike, near: Near = None) -> Array:
        """τ = (J ρ)ᵀ wrench, of shape (n,), with q̇ᵀτ = twistᵀ wrench.

        τ is what a wrench applied to the end effector from outside adds to the right side of (22); to press on the
        surroundings with that wrench, the motors add the same τ.
        """
        return self.jacobian(q, near).T @ vector(wrench, "wrench", 6)

    def dynamic_manipulability(
        self, q: ArrayLike | State, efforts: ArrayLike | None = None, *, part: Half = "linear", near: Near = None
    ) -> Ellipsoid:
        """Accelerations of the end effector from rest that motor efforts add to gravity's: J ρ D⁻¹ ρᵀSᵀu.

        Args:
            q: Independent coordinates, or a State.
            efforts: The motors' efforts Δu_i > 0, N m or N: the ellipsoid is that of Σ (u_i/Δu_i)² ≤ 1. Default 1.
            part: Linear (m/s²) or angular (rad/s²) acceleration.
            near: Chooses the assembly mode.

        Raises:
            InvalidInputError: Efforts of the wrong shape or not positive, or an unknown part.
        """
        model = self.model
        limits = np.ones(model.n_actuated) if efforts is None else vector(efforts, "efforts", model.n_actuated)
        if np.any(limits <= 0):
            raise InvalidInputError("efforts must be positive: the largest |u| of each motor")
        choice(part, "part", tuple(_ROWS))
        state = model.at(q, near)
        response = [np.linalg.solve(state.D, state.generalized_force(effort)) for effort in np.diag(limits)]
        mapped = self.jacobian(state)[_ROWS[part]] @ np.array(response).T
        axes, lengths, _ = np.linalg.svd(mapped, full_matrices=False)
        return Ellipsoid(mapped, axes, lengths)

    def solve(self, target: ArrayLike, near: Near = None) -> Solution:
        """q with the point at a target, on the branch of `near`: inverse kinematics through the closed chain.

        Args:
            target: A position (3,), metres, or a pose (4, 4), both in the world.
            near: A State or closed configuration q′ to start from; default the mechanism's reference.

        Returns:
            Solution: q, q′ = σ(q) and how far from the target the point is (at most 1e-11 m or rad).

        Raises:
            InvalidInputError: A target that is neither, or a configuration that cannot be closed.
            UnreachableTargetError: No q on the branch was found that reaches the target: it is out of reach, beyond a
                singularity, or asks for more directions than the mechanism has.
        """
        return solve(self.model, self.point, target, near)


def _refuse_loop(mechanism: Mechanism, link: str) -> None:
    """Say of a loop's name, where a link's is asked for, which links meet there and where.

    Raises:
        InvalidInputError: It is a loop's, and no link's.
    """
    loops = {closure.name: closure for closure in mechanism.closures}
    if not isinstance(link, str) or link in mechanism.tree.attachments or link not in loops:
        return
    ends = [f"EndEffector(…, '{name}', {np.round(frame[:3, 3], 9).tolist()})" for name, frame in loops[link].ends]
    raise InvalidInputError(f"'{link}' is a loop's name, not a link's; its point is {ends[0]}, or {ends[1]}")
