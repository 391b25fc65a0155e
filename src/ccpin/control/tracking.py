"""Tracking laws for a smooth reference: computed torque, PD+ (Paden–Panja) and PD with on-line gravity.

All of them need σ(q) and ρ on line. `torque` reads them from the State it is given, or finds them with the library's σ
where q is only measured; `torque_with` takes a measured q beside a State that may be another's, which is how on-line
solvers (`ccpin.control.online`) and injected errors come in. Laws are pure functions of their arguments.
"""

from __future__ import annotations

import abc

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, instance, vector
from ccpin.control.control_law import ControlLaw, Measurement
from ccpin.control.laws import ModelLaw
from ccpin.control.references import Reference, ReferenceState, require_commuting
from ccpin.control.statements import LawKind, Statement, polynomial_of
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.dynamics.state import Near, State
from ccpin.kinematics.points import moved
from ccpin.mechanism.mechanism import Mechanism


class TrackingLaw(ModelLaw):
    """A law that follows a reference, with e = q_d − q and ė = q̇_d − q̇.

    Args:
        model: The reduced model, or a mechanism.
        reference: q_d(t).
        K_p: Gains on e: (n,) for a diagonal matrix, or symmetric positive definite (n, n). Units: see each law.
        K_v: Gains on ė, alike.
        near: Chooses the assembly mode of σ(q_d(0)), which is where σ starts when `torque` gets nothing nearer.

    Raises:
        InvalidInputError: Gains of the wrong shape or not symmetric positive definite.
        UnsupportedMechanismError: Fewer motors than independent coordinates, or a spherical, planar or floating
            joint independent as a whole (its error has no rate that is ė).
        UnreachableError, SingularConfigurationError: σ(q_d(0)) does not exist on the branch of `near`.
    """

    K_p: Array
    K_v: Array

    def __init__(
        self, model: ReducedModel | Mechanism, reference: Reference, K_p: ArrayLike, K_v: ArrayLike, near: Near = None
    ) -> None:
        model, reference = model_of(model), instance(reference, "reference", Reference)
        require_commuting(model.coordinates, "a tracking law")
        super().__init__(model, reference.at(0.0).q, near, K_p=K_p, K_v=K_v)
        self.reference = reference

    def error(self, t: float, q: Array) -> Array:
        """e = q_d(t) − q, of shape (n,)."""
        return self.model.coordinates.difference(q, self.reference.at(t).q)

    def next_switch(self, t: float) -> float | None:
        """Where the reference passes from one piece to the next."""
        return self.reference.next_switch(t)

    def torque(self, t: float, state: State | Measurement, v: Array) -> Array:
        """The motors' efforts at (q, q̇), of shape (motors,)."""
        own = self.own(state)
        return self.torque_with(t, own.q, v, own)

    def torque_with(self, t: float, q: Array, v: Array, state: State) -> Array:
        """The motors' efforts at a measured (q, q̇), with σ, ρ and the model of a State that may lie elsewhere.

        The State is of the law's own model.
        """
        wanted, v = self.reference.at(t), vector(v, "v", self.model.n)
        e = self.model.coordinates.difference(q, wanted.q)
        return state.efforts(self._force(wanted, e, wanted.v - v, v, state))

    def brake(self, v: Array, state: State) -> Array:
        """The efforts that stop the robot where it is, needing no trustworthy σ: damping, and gravity at `state`."""
        return state.efforts(state.g - self._damping(v, state))

    def _stated(self, kind: LawKind) -> Statement:
        path, nothing = polynomial_of(self.reference), np.zeros(self.model.n)
        return Statement(kind, self.model, self.near, path, self.K_p, self.K_v, nothing)

    @abc.abstractmethod
    def _force(self, wanted: ReferenceState, e: Array, e_dot: Array, v: Array, state: State) -> Array:
        """The generalized force, of shape (n,)."""

    def _damping(self, v: Array, state: State) -> Array:
        return np.asarray(self.K_v @ v)


class ComputedTorque(TrackingLaw):
    """Computed torque: u = D(q)(q̈_d + K_v ė + K_p e) + C q̇ + damping q̇ + g, which leaves ë + K_v ė + K_p e = 0.

    K_p in 1/s² and K_v in 1/s, whatever the coordinates: K_p = ω², K_v = 2ω is critically damped with time constant
    1/ω.
    """

    def _force(self, wanted: ReferenceState, e: Array, e_dot: Array, v: Array, state: State) -> Array:
        return state.tau(v, wanted.a + self.K_v @ e_dot + self.K_p @ e)

    def statement(self) -> Statement:
        """Computed torque."""
        return self._stated("computed_torque")

    def _damping(self, v: Array, state: State) -> Array:
        return np.asarray(state.D @ (self.K_v @ v))


class PDPlus(TrackingLaw):
    """PD+ (Paden and Panja, 1988): u = D(q) q̈_d + C(q, q̇) q̇_d + damping q̇_d + g(q) + K_p e + K_v ė.

    Since Ḋ − 2C is skew symmetric (Lemma III.1), D ë + C ė + (K_v + damping) ė + K_p e = 0 is passive and
    asymptotically stable for any positive definite gains, as long as q stays in Ω. Gains in N m/rad (N/m) and
    N m s/rad (N s/m). With a constant reference it is PD with full gravity compensation (30).
    """

    def _force(self, wanted: ReferenceState, e: Array, e_dot: Array, v: Array, state: State) -> Array:
        dynamics = state.D @ wanted.a + (state.C(v) + state.damping) @ wanted.v + state.g
        return np.asarray(dynamics + self.K_p @ e + self.K_v @ e_dot)

    def statement(self) -> Statement:
        """PD+."""
        return self._stated("pd_plus")

    def lyapunov(self, t: float, q: Array | State, v: Array, near: Near = None) -> float:
        """𝒱 = ½ėᵀD ė + ½eᵀK_p e, in joules; along solutions 𝒱̇ = −ėᵀ(K_v + damping)ė ≤ 0. q may be a State."""
        state, wanted = self.state(q, near), self.reference.at(t)
        e = self.model.coordinates.difference(state.q, wanted.q)
        kinetic = state.energy(wanted.v - v).kinetic
        return float(kinetic + 0.5 * e @ self.K_p @ e)


class PDOnlineGravity(TrackingLaw):
    """PD with on-line gravity compensation: u = K_p e + K_v ė + g(q), without feedforward of the motion.

    Its tracking error is of the size of the inertial torque over K_p. Gains as for `PDPlus`.
    """

    def _force(self, wanted: ReferenceState, e: Array, e_dot: Array, v: Array, state: State) -> Array:
        return np.asarray(self.K_p @ e + self.K_v @ e_dot + state.g)

    def statement(self) -> Statement:
        """PD with g(q)."""
        return self._stated("pd_gravity")


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
        self.law = instance(law, "law", TrackingLaw)
        self.offset = vector(offset, "offset", law.model.mechanism.n_free)

    def torque(self, t: float, state: State | Measurement, v: Array) -> Array:
        """The law's efforts at (q, q̇), its model terms at σ(q) ⊕ δ.

        Raises:
            SingularConfigurationError: σ(q) ⊕ δ is singular.
        """
        model, own = self.law.model, self.law.own(state)
        wrong = model.parametrization.at(moved(model.free_system.model, own.q_free, self.offset))
        return self.law.torque_with(t, own.q, v, State.of(model, own.q, wrong))

    def next_switch(self, t: float) -> float | None:
        """The law's."""
        return self.law.next_switch(t)
