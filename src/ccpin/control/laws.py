"""Set-point laws: PD with simple (28) and with full (30) gravity compensation, and their Lyapunov function.

"Gravity" is all of g = ∂V/∂q, the joints' springs included; their dampers add to K_v in 𝒱̇.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, frozen, instance, least_eigenvalue, numbers, one_each, positive, vector
from ccpin.control.control_law import ControlLaw, Measurement, of_own, q_of
from ccpin.control.references import Hold, require_commuting
from ccpin.control.statements import LawKind, Statement
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.dynamics.state import Near, State
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.kinematics.coordinates import IndependentCoordinates, checked_q
from ccpin.mechanism.mechanism import Mechanism

_NO_EFFORT = 1e-9  # of the transmission's largest singular value: no motor drives what is below
_SKEW = 1e-13  # of a matrix's largest entry: a skew part below is rounding


class ModelLaw(ControlLaw):
    """A law with gains on all independent coordinates that reads the reduced model at a State.

    Args:
        model: The reduced model, or a mechanism.
        q: Where the law begins or ends, of shape (model.nq,): its σ starts there when it gets none nearer.
        near: Chooses the assembly mode of σ(q).
        gains: Each: (n,) for a diagonal matrix or symmetric positive definite (n, n); one number k for k I, where all
            coordinates are angles or all are lengths.

    Attributes:
        near: The State at that q.

    Raises:
        InvalidInputError: Gains of the wrong shape or not symmetric positive definite.
        UnsupportedMechanismError: Fewer motors than independent coordinates, or a coordinate that no motor moves.
        UnreachableError, SingularConfigurationError: σ(q) does not exist on the branch of `near`.
    """

    def __init__(self, model: ReducedModel | Mechanism, q: ArrayLike | State, near: Near, **gains: ArrayLike) -> None:
        self.model = model_of(model)
        coordinates, n, motors = self.model.coordinates, self.model.n, self.model.n_actuated
        if motors < n:
            raise UnsupportedMechanismError(
                f"a law on all {n} independent coordinates needs as many motors; there are {motors}"
            )
        for name, gain in gains.items():
            setattr(self, name, gain_matrix(gain, name, coordinates))
        self.near = self.model.at(q, near)
        self._check_reach()

    def _check_reach(self) -> None:
        """Every generalized force must be one that motors can exert, ρᵀSᵀu = τ, or the law's is not what acts."""
        transmission = self.near.reference.transmission
        if transmission is None or not self.model.n:
            return
        left, singular, _ = np.linalg.svd(transmission)
        idle = left[:, singular <= _NO_EFFORT * singular[0]]
        if idle.size:
            worst = int(np.abs(idle).max(axis=1).argmax())
            name = next(part.name for part in self.model.coordinates.parts if worst < part.v.stop)
            raise UnsupportedMechanismError(
                f"no motor moves '{name}' as the law would: those of {self.model.mechanism.name} sit on "
                f"{', '.join(self.model.mechanism.actuated)}"
            )

    def state(self, q: Array | State, near: Near = None) -> State:
        """The State at q, on the branch of `near`, the law's own by default."""
        return self.model.at(q, self.near if near is None else near)

    def own(self, state: State | Measurement) -> State:
        """The State of the law's model at the q of a State, which may be of another model (a plant's), or measured."""
        return of_own(self.model, state, self.near)


class SetPointLaw(ModelLaw):
    """What the two PD laws share: gains, the set point, the error and the Lyapunov function.

    Args and errors as for `ModelLaw`; q is the set point q_d, constant, gains are in N m/rad or N/m (K_p) and N m s/rad
    or N s/m (K_v), and `near` chooses the assembly mode of σ(q_d).

    A ball, planar or floating joint that is independent as a whole is refused: there d/dt q̃ is not −q̇, so 𝒱 may rise.
    """

    K_p: Array
    K_v: Array

    def __init__(
        self, model: ReducedModel | Mechanism, q_d: ArrayLike | State, K_p: ArrayLike, K_v: ArrayLike, near: Near = None
    ) -> None:
        model = model_of(model)
        require_commuting(model.coordinates, type(self).__name__)
        super().__init__(model, q_d, near, K_p=K_p, K_v=K_v)
        self.q_d, self.q_free_d, self.gravity_d = self.near.q, self.near.q_free, self.near.g
        self._potential_d = self.near.energy(np.zeros(self.model.n)).potential

    def next_switch(self, t: float) -> float:
        """Never: time does not enter."""
        return np.inf

    def error(self, q: Array) -> Array:
        """q̃ = q_d − q, the tangent vector from q to q_d, of shape (n,)."""
        return self.model.coordinates.difference(q, self.q_d)

    def lyapunov(self, q: Array | State, v: Array, near: Near = None) -> float:
        """𝒱 = ½q̇ᵀDq̇ + V(q) − V(q_d) + q̃ᵀg(q_d) + ½q̃ᵀK_p q̃, in joules; along solutions 𝒱̇ = −q̇ᵀ(K_v + damping)q̇.

        The function of Theorem 3, for the law with simple gravity compensation. q may be a State.
        """
        state = self.state(q, near)
        energy, error = state.energy(v), self.error(state.q)
        potential = energy.potential - self._potential_d + error @ self.gravity_d
        return float(energy.kinetic + potential + 0.5 * error @ self.K_p @ error)

    def _stated(self, kind: LawKind, constant: Array) -> Statement:
        path = Hold(self.model, self.q_d).as_polynomial()
        return Statement(kind, self.model, self.near, path, self.K_p, self.K_v, constant)

    def _feedback(self, q: Array, v: Array) -> Array:
        """K_p q̃ − K_v q̇, of shape (n,)."""
        return np.asarray(self.K_p @ self.error(q) - self.K_v @ vector(v, "v", self.model.n))


class PDSimpleGravity(SetPointLaw):
    """PD with simple gravity compensation (28): u = K_p q̃ − K_v q̇ + g(q_d).

    g(q_d) is computed once, when the law is made, so the law needs no σ on line (where the motors sit on the
    independent joints).
    """

    def torque(self, t: float, state: State | Measurement, v: Array) -> Array:
        """u = K_p q̃ − K_v q̇ + g(q_d) (28)."""
        force = self._feedback(checked_q(self.model.coordinates, q_of(state)), v) + self.gravity_d
        return force if self.model.actuation is None else self.own(state).efforts(force)

    def statement(self) -> Statement:
        """(28)."""
        return self._stated("pd", self.gravity_d)


class PDFullGravity(SetPointLaw):
    """PD with full gravity compensation (30): u = K_p q̃ − K_v q̇ + g(q); needs σ(q)."""

    def torque(self, t: float, state: State | Measurement, v: Array) -> Array:
        """u = K_p q̃ − K_v q̇ + g(q) (30)."""
        own = self.own(state)
        return own.efforts(self._feedback(own.q, v) + own.g)

    def statement(self) -> Statement:
        """(30)."""
        return self._stated("pd_gravity", np.zeros(self.model.n))

    def lyapunov(self, q: Array | State, v: Array, near: Near = None) -> float:
        """𝒱 = ½q̇ᵀDq̇ + ½q̃ᵀK_p q̃, in joules; g is cancelled, and along solutions 𝒱̇ = −q̇ᵀ(K_v + damping)q̇."""
        state = self.state(q, near)
        error = self.error(state.q)
        return float(state.energy(v).kinetic + 0.5 * error @ self.K_p @ error)


def gain_matrix(gain: ArrayLike, name: str, coordinates: IndependentCoordinates) -> Array:
    """Return gains as a symmetric positive definite (n, n) matrix, read-only.

    It is symmetric exactly, K = Kᵀ, as Theorem 3 and the storage functions suppose: a skew part however small feeds
    energy into an undamped mode. One of rounding, as products leave it, is taken out; a larger one is refused. So is a
    matrix whose `least_eigenvalue` is not positive.

    Raises:
        InvalidInputError: They are not, or one number is given for coordinates of different units.
    """
    matrix, n = numbers(gain, name), coordinates.n
    if not matrix.ndim:
        slides = [slides for part in coordinates.parts for slides in part.slides]
        if len(set(slides)) > 1:
            units = ", ".join("N/m" if slides else "N m/rad" for slides in slides)
            raise InvalidInputError(f"{name} = {matrix} has no unit that fits all coordinates; give {n} ({units})")
        matrix = matrix * np.eye(n)
    if matrix.shape == (n,):
        matrix = np.diag(matrix)
    if matrix.shape != (n, n) or not np.isfinite(matrix).all():
        message = f"{name} must be one finite number, or of shape ({n},) or ({n}, {n}); it has shape {matrix.shape}"
        raise InvalidInputError(message)
    largest, skew = np.abs(matrix).max(initial=0.0), np.abs(matrix - matrix.T).max(initial=0.0)
    if skew > _SKEW * largest:
        raise InvalidInputError(
            f"{name} must be symmetric positive definite; it has a skew part of {skew / largest:.1g} of its size: pass "
            f"0.5 * ({name} + {name}.T)"
        )
    matrix = 0.5 * matrix + 0.5 * matrix.T
    if least_eigenvalue(matrix) <= 0.0:
        raise InvalidInputError(f"{name} must be symmetric positive definite")
    return frozen(matrix)


# Compensation of Coulomb friction, on top of a set-point law.


class CoulombCompensation(ControlLaw):
    """A PD law plus ĉ times a direction: sign(q_d − q_start), or sat(q̃/width).

    Args:
        law: The PD law; its motors must be on the independent joints.
        coulomb: ĉ, the estimated Coulomb levels, N m or N: a number or (n,).
        q_start: Where the move starts, of shape (model.nq,), for the first reading.
        width: Where the second reading fades out, rad or m.

    Raises:
        InvalidInputError: Levels that are negative, not finite or too many; a width that is not positive.
        UnsupportedMechanismError: The motors are not on the independent joints.
    """

    def __init__(
        self,
        law: PDSimpleGravity | PDFullGravity,
        coulomb: ArrayLike,
        q_start: ArrayLike | None = None,
        width: float = 0.01,
    ) -> None:
        model = instance(law, "law", SetPointLaw, "a PD law").model
        if not model.mechanism.direct:
            raise UnsupportedMechanismError(
                "friction compensation needs the motors on the independent joints, in order and without gears"
            )
        self._law, self._width = law, positive(width, "width", "positive")
        self._level = one_each(coulomb, "coulomb", model.n)
        self._direction = None if q_start is None else np.sign(law.error(checked_q(model.coordinates, q_start)))

    def torque(self, t: float, state: State | Measurement, v: Array) -> Array:
        """The PD law's efforts plus the compensation, of shape (motors,)."""
        return self._law.torque(t, state, v) + self._compensation(q_of(state))

    def next_switch(self, t: float) -> float:
        """Never: time does not enter."""
        return self._law.next_switch(t)

    def _compensation(self, q: Array) -> Array:
        direction = self._direction
        if direction is None:
            direction = np.clip(self._law.error(q) / self._width, -1.0, 1.0)
        return np.asarray(self._level * direction)
