"""Tracking laws for a smooth reference: computed torque, PD+ (Paden–Panja) and PD with on-line gravity.

All of them need σ(q) and ρ on line. `torque` finds them with the library's σ, from the guess it is given;
`torque_at` takes them from the caller, which is how on-line solvers (`ccpin.control.online`) and injected errors
come in. Laws are pure functions of their arguments.
"""

from __future__ import annotations

import abc

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array
from ccpin.control.laws import ControlLaw, gain_matrix
from ccpin.control.references import Reference, ReferenceState, require_commuting
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import UnsupportedMechanismError
from ccpin.kinematics.parametrization import ClosedPoint
from ccpin.kinematics.points import moved


class TrackingLaw(ControlLaw):
    """A law that follows a reference, with e = q_d − q and ė = q̇_d − q̇.

    Args:
        model: The reduced model.
        reference: q_d(t).
        K_p: Gains on e: (n,) for a diagonal matrix, or symmetric positive definite (n, n). Units: see each law.
        K_v: Gains on ė, alike.
        guess: Chooses the assembly mode of σ(q_d(0)), which is where σ starts when `torque` gets no guess.

    Raises:
        InvalidInputError: Gains of the wrong shape or not symmetric positive definite.
        UnsupportedMechanismError: Fewer motors than independent coordinates, or a spherical, planar or floating
            joint independent as a whole (its error has no rate that is ė).
        UnreachableError, SingularConfigurationError: σ(q_d(0)) does not exist on the guess's branch.
    """

    def __init__(
        self,
        model: ReducedModel,
        reference: Reference,
        K_p: ArrayLike,
        K_v: ArrayLike,
        guess: ArrayLike | None = None,
    ) -> None:
        if model.n_actuated < model.n:
            raise UnsupportedMechanismError(
                f"tracking in all {model.n} independent coordinates needs as many motors; there are {model.n_actuated}"
            )
        require_commuting(model.coordinates, "a tracking law")
        self.model = model
        self.reference = reference
        self.K_p = gain_matrix(K_p, "K_p", model.n)
        self.K_v = gain_matrix(K_v, "K_v", model.n)
        self.q_free_start = model.sigma(reference.at(0.0).q, guess)
        self._direct = model.mechanism.actuated == model.mechanism.independent

    def error(self, t: float, q: Array) -> Array:
        """e = q_d(t) − q, of shape (n,)."""
        return self.model.coordinates.difference(q, self.reference.at(t).q)

    def torque(self, t: float, q: Array, v: Array, guess: Array | None = None) -> Array:
        """The motors' efforts, with σ(q) found from the guess; errors as for `ReducedModel.sigma`."""
        near = self.q_free_start if guess is None else guess
        return self.torque_at(t, q, v, self.model.parametrization.sigma(q, near))

    def torque_at(self, t: float, q: Array, v: Array, point: ClosedPoint) -> Array:
        """The motors' efforts at a measured (q, q̇), with σ and ρ as given; of shape (motors,)."""
        wanted = self.reference.at(t)
        e = self.model.coordinates.difference(q, wanted.q)
        return self._efforts(self._force(wanted, e, wanted.v - v, v, point), point)

    def brake(self, v: Array, point: ClosedPoint) -> Array:
        """The efforts that stop the robot where it is, needing no trustworthy σ: damping, and gravity at `point`."""
        return self._efforts(self._gravity(point) - self._damping(v, point), point)

    @abc.abstractmethod
    def _force(self, wanted: ReferenceState, e: Array, e_dot: Array, v: Array, point: ClosedPoint) -> Array:
        """The generalized force, of shape (n,)."""

    def _damping(self, v: Array, point: ClosedPoint) -> Array:
        return np.asarray(self.K_v @ v)

    def _gravity(self, point: ClosedPoint) -> Array:
        return np.asarray(point.rho.T @ self.model.free_system.gravity(point.q_free))

    def _efforts(self, force: Array, point: ClosedPoint) -> Array:
        """The motors' efforts u of least norm with ρᵀSᵀu = force."""
        if self._direct:
            return force
        transmission = point.rho.T @ self.model.mechanism.actuation.T
        return np.asarray(np.linalg.lstsq(transmission, force, rcond=None)[0])


class ComputedTorque(TrackingLaw):
    """Computed torque: u = D(q)(q̈_d + K_v ė + K_p e) + C q̇ + g, which leaves ë + K_v ė + K_p e = 0.

    K_p in 1/s² and K_v in 1/s, whatever the coordinates: K_p = ω², K_v = 2ω is critically damped with time constant
    1/ω.
    """

    def _force(self, wanted: ReferenceState, e: Array, e_dot: Array, v: Array, point: ClosedPoint) -> Array:
        acceleration = wanted.a + self.K_v @ e_dot + self.K_p @ e
        v_free = point.rho @ v
        a_free = point.rho @ acceleration + self.model.parametrization.bias(point, v_free)
        return np.asarray(point.rho.T @ self.model.free_system.inverse_dynamics(point.q_free, v_free, a_free))

    def _damping(self, v: Array, point: ClosedPoint) -> Array:
        mass = self.model.free_system.mass_matrix(point.q_free)
        return np.asarray(point.rho.T @ (mass @ (point.rho @ (self.K_v @ v))))


class PDPlus(TrackingLaw):
    """PD+ (Paden and Panja, 1988): u = D(q) q̈_d + C(q, q̇) q̇_d + g(q) + K_p e + K_v ė.

    Since Ḋ − 2C is skew symmetric (Lemma III.1), the closed loop D ë + C ė + K_v ė + K_p e = 0 is passive and
    asymptotically stable for any positive definite gains, as long as q stays in Ω. Gains in N m/rad (N/m) and
    N m s/rad (N s/m). With a constant reference it is PD with full gravity compensation (30).
    """

    def _force(self, wanted: ReferenceState, e: Array, e_dot: Array, v: Array, point: ClosedPoint) -> Array:
        free, rho = self.model.free_system, point.rho
        v_free = rho @ v
        a_free = rho @ wanted.a + self.model.parametrization.rho_dot(point, v_free) @ wanted.v
        dynamics = free.mass_matrix(point.q_free) @ a_free
        dynamics += free.coriolis_matrix(point.q_free, v_free) @ (rho @ wanted.v)
        dynamics += free.gravity(point.q_free)
        return np.asarray(rho.T @ dynamics + self.K_p @ e + self.K_v @ e_dot)

    def lyapunov(self, t: float, q: Array, v: Array, guess: Array | None = None) -> float:
        """𝒱 = ½ėᵀD ė + ½eᵀK_p e, in joules; along solutions 𝒱̇ = −ėᵀK_v ė ≤ 0."""
        wanted = self.reference.at(t)
        e = self.model.coordinates.difference(q, wanted.q)
        kinetic = self.model.energy(q, wanted.v - v, self.q_free_start if guess is None else guess).kinetic
        return float(kinetic + 0.5 * e @ self.K_p @ e)


class PDOnlineGravity(TrackingLaw):
    """PD with on-line gravity compensation: u = K_p e + K_v ė + g(q), without feedforward of the motion.

    Its tracking error is of the size of the inertial torque over K_p. Gains as for `PDPlus`.
    """

    def _force(self, wanted: ReferenceState, e: Array, e_dot: Array, v: Array, point: ClosedPoint) -> Array:
        return np.asarray(self.K_p @ e + self.K_v @ e_dot + self._gravity(point))


class WithSigmaError(ControlLaw):
    """A tracking law that computes with σ(q) ⊕ δ in place of σ(q): what a numerical error of known size does.

    ρ and the free system's terms are taken at the wrong configuration too; e and ė stay those measured.

    Args:
        law: The law.
        offset: δ, a tangent vector of q′, rad and m, of shape (n′,).

    Raises:
        InvalidInputError: δ has the wrong shape or is not finite.
    """

    def __init__(self, law: TrackingLaw, offset: ArrayLike) -> None:
        self.law = law
        self.offset = law.model.checked(offset, "offset", law.model.mechanism.n_free)

    def torque(self, t: float, q: Array, v: Array, guess: Array | None = None) -> Array:
        """The law's efforts at (q, q̇), its model terms at σ(q) ⊕ δ.

        Raises:
            SingularConfigurationError: σ(q) ⊕ δ is singular; otherwise as for `ReducedModel.sigma`.
        """
        parametrization = self.law.model.parametrization
        near = self.law.q_free_start if guess is None else guess
        wrong = moved(parametrization.model, parametrization.sigma(q, near).q_free, self.offset)
        return self.law.torque_at(t, q, v, parametrization.at(wrong))
