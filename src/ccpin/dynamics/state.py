"""A closed, nonsingular configuration, and what the reduced model says there, each thing computed once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, vector
from ccpin.dynamics.derivatives import (
    ForwardDynamicsDerivatives,
    GeneralizedForceDerivatives,
    InverseDynamicsDerivatives,
)
from ccpin.dynamics.free_system import Energy
from ccpin.dynamics.linear_forces import energy_regressor, regressor
from ccpin.dynamics.reference_backend import ModelLike as ReferenceModel
from ccpin.dynamics.reference_backend import ReferenceBackend, locked
from ccpin.dynamics.wrenches import Applied, Wrenches, applied_wrenches, wrench_rows
from ccpin.errors import UnderactuatedError
from ccpin.kinematics.parametrization import ClosedPoint

_MISSING = 1e-9  # of the largest generalized force (1 at least): what rounding leaves of τ − ρᵀSᵀu


class StateModel(ReferenceModel, Protocol):
    """What a State reads of its reduced model; `ccpin.ReducedModel` says what each is."""

    nq: int
    n_actuated: int

    @property
    def core(self) -> Any:
        """What answers first: a `ccpin.native.Kernel`, or what declines everything."""

    def at(self, q: ArrayLike | State, near: Near = None) -> State:
        """The State at q."""


class ReducedTerms(NamedTuple):
    """The reduced model at one state (q, q̇).

    Attributes:
        q_free: q′ = σ(q), of shape (nq,).
        v_free: q̇′ = ρ q̇ (13), of shape (n′,).
        rho: ρ (14), of shape (n′, n).
        rho_dot: ρ̇ (35), of shape (n′, n).
        D: ρᵀD′ρ (23), symmetric positive definite, of shape (n, n).
        C: ρᵀC′ρ + ρᵀD′ρ̇ (24), of shape (n, n); Ḋ − 2C is skew symmetric (Lemma III.1).
        g: ρᵀg′ (25), of shape (n,).
    """

    q_free: Array
    v_free: Array
    rho: Array
    rho_dot: Array
    D: Array
    C: Array
    g: Array


@dataclass(frozen=True, eq=False, repr=False)
class State:
    """A configuration that is closed and nonsingular, q′ = σ(q) (12), with everything that depends on it alone.

    From `ReducedModel.at`. Immutable, its arrays read-only; what is asked of it is computed once and kept. Any number
    of threads may share one. v is q̇ (n,), a is q̈ (n,), u the actuated joints' efforts (motors,); SI units, radians.
    The compiled core answers where there is one and it can, `ccpin.dynamics.reference_backend` all else.

    Raises:
        InvalidInputError: v, a or u has the wrong shape or is not finite (every method).

    Attributes:
        model: The reduced model.
        q: Independent coordinates, of shape (model.nq,).
        reference: What answers where the core does not.
    """

    model: StateModel
    q: Array
    reference: ReferenceBackend

    def __post_init__(self) -> None:
        locked(self.q)

    @classmethod
    def of(cls, model: StateModel, q: Array, point: ClosedPoint) -> State:
        """The State at a point that is known already."""
        return cls(model, q, ReferenceBackend.of(model, point))

    def __reduce__(self) -> tuple[type[State], tuple[StateModel, Array, ReferenceBackend]]:
        return State, (self.model, self.q, self.reference)

    def __repr__(self) -> str:
        q = np.array2string(self.q, precision=6, separator=", ")
        return f"State({self.model.mechanism.name}, q={q}, rcond={self.rcond:.1e})"

    # Where it is and how it moves.

    @property
    def q_free(self) -> Array:
        """The configuration q′ = σ(q) (12), of shape (nq,)."""
        return self.reference.q_free

    @property
    def rho(self) -> Array:
        """ρ = ψ_q′⁻¹ [0; I] (14), of shape (n′, n), with q̇′ = ρ q̇ (13)."""
        return self.reference.rho

    @property
    def point(self) -> ClosedPoint:
        """The closed point, with ψ_q′ factorised and φ_q′."""
        return self.reference.point

    @cached_property
    def rcond(self) -> float:
        """Reciprocal condition number of ψ_q′ in the 1-norm: towards 0 near a singularity."""
        answer = self.model.core.rcond(self.q_free)
        return self.point.factor.rcond if answer is None else float(answer)

    def v_free(self, v: ArrayLike) -> Array:
        """The free system's velocity q̇′ = ρ q̇ (13), of shape (n′,)."""
        return self.rho @ self._velocity(v)

    def a_free(self, v: ArrayLike, a: ArrayLike) -> Array:
        """The free system's acceleration q̈′ = ρ q̈ + ρ̇ q̇, of shape (n′,)."""
        return self.rho @ self._acceleration(a) + self.bias(v)

    def rho_dot(self, v: ArrayLike) -> Array:
        """ρ̇ = −ψ_q′⁻¹ ψ̇_q′ ρ (35) along q̇′ = ρ q̇, of shape (n′, n)."""
        answer = self.model.core.terms(self.q_free, v)
        return self.reference.rho_dot(self._velocity(v)) if answer is None else np.asarray(answer[3])

    def bias(self, v: ArrayLike) -> Array:
        """ρ̇ q̇, of shape (n′,): the free system's acceleration where q̈ = 0."""
        answer = self.model.core.terms(self.q_free, v)
        velocity = self._velocity(v)
        return self.reference.bias(velocity) if answer is None else np.asarray(answer[3] @ velocity)

    # The reduced equations of motion.

    @cached_property
    def D(self) -> Array:
        """The mass matrix ρᵀD′ρ (23), symmetric positive definite, of shape (n, n), kg m² (kg, kg m)."""
        answer = self.model.core.terms(self.q_free, np.zeros(self.model.n))
        return locked(self.reference.D if answer is None else answer[4])

    @cached_property
    def damping(self) -> Array:
        """ρᵀB′ρ, of shape (n, n): the joints' dampers (B′ = diag b), symmetric, ≥ 0; zeros where there is none."""
        return locked(self.rho.T @ (self.model.free_system.damping[:, None] * self.rho))

    @cached_property
    def g(self) -> Array:
        """The potential's gradient ρᵀg′ (25), of shape (n,), N m or N: gravity and the joints' springs."""
        answer = self.model.core.gravity(self.q_free)
        return locked(self.reference.g if answer is None else answer)

    @cached_property
    def gravity_derivative(self) -> Array:
        """∂g/∂q, of shape (n, n), along tangent steps of q: the potential's Hessian for plain coordinates."""
        rest = np.zeros(self.model.n)
        answer = self.model.core.generalized_force_derivatives(self.q_free, rest, rest)
        return locked(self.reference.derivatives.gravity() if answer is None else answer[0])

    def C(self, v: ArrayLike) -> Array:
        """ρᵀC′ρ + ρᵀD′ρ̇ (24), of shape (n, n); Ḋ − 2C is skew symmetric (Lemma III.1)."""
        return self.terms(v).C

    def terms(self, v: ArrayLike) -> ReducedTerms:
        """D, C, g (23)–(25) and what they come from."""
        answer = self.model.core.terms(self.q_free, v)
        if answer is not None:
            return ReducedTerms(self.q_free, answer[1], self.rho, answer[3], self.D, answer[5], self.g)
        velocity = self._velocity(v)
        rho_dot = self.reference.rho_dot(velocity)
        C = self.reference.C(velocity, rho_dot)
        return ReducedTerms(self.q_free, self.rho @ velocity, self.rho, rho_dot, self.D, C, self.g)

    def energy(self, v: ArrayLike) -> Energy:
        """Kinetic energy ½ q̇ᵀD q̇ and potential energy V with ∂V/∂q = g, in joules."""
        answer = self.model.core.energy(self.q_free, v)
        return self.reference.energy(self._velocity(v)) if answer is None else Energy(*answer)

    def tau(self, v: ArrayLike, a: ArrayLike, wrenches: Wrenches | None = None) -> Array:
        """The generalized force τ = D q̈ + C q̇ + damping q̇ + g − ρᵀJᵀw (22), of shape (n,), N m or N."""
        answer = self.model.core.generalized_force(self.q_free, v, a, None, self._rows(wrenches))
        if answer is not None:
            return np.asarray(answer)
        return self.reference.tau(self._velocity(v), self._acceleration(a), wrenches)

    def forward_dynamics(
        self, v: ArrayLike, u: ArrayLike, wrenches: Wrenches | None = None, loads: ArrayLike | None = None
    ) -> Array:
        """q̈ = D⁻¹(ρᵀ(Sᵀu + Jᵀw + f) − C q̇ − damping q̇ − g) (22), of shape (n,).

        Args:
            v: Velocity, of shape (n,).
            u: The actuated joints' efforts, of shape (motors,).
            wrenches: w, what acts on links from outside, by link name: (force, moment) in world axes at the link's
                origin, six numbers, or a `ccpin.dynamics.Wrench` at a point of it. Here and in every call that has it.
            loads: f, what else acts on the free system's joints (friction, stops), N m or N, of shape (n′,).

        Raises:
            SingularConfigurationError: D is not positive definite so near a singularity.
            UnsupportedMechanismError: D is not positive definite (bodies without mass or inertia).
        """
        answer: Array | None = None
        if loads is None:
            rows = None if wrenches is None else self._rows(wrenches)
            answer = self.model.core.forward_dynamics(self.reference.q_free, v, u, None, rows)
        if answer is None:
            return self.reference.forward_dynamics(self._velocity(v), self._effort(u), wrenches, self._loads(loads))
        return answer

    def inverse_dynamics(self, v: ArrayLike, a: ArrayLike, wrenches: Wrenches | None = None) -> Array:
        """The actuated joints' efforts u with ρᵀSᵀu = D q̈ + C q̇ + damping q̇ + g − ρᵀJᵀw (22), of shape (motors,).

        With more motors than independent coordinates u is the solution of least norm.

        Raises:
            UnderactuatedError: No u produces that acceleration (fewer motors than coordinates).
        """
        answer = self.model.core.inverse_dynamics(self.q_free, v, a, None, self._rows(wrenches))
        if answer is not None:
            return np.asarray(answer)
        force = self.tau(v, a, wrenches)
        if self.model.actuation is None:
            return force
        u = self.efforts(force)
        missing = float(np.abs(self.generalized_force(u) - force).max(initial=0.0))
        if missing > _MISSING * max(1.0, float(np.abs(force).max(initial=0.0))):
            raise UnderactuatedError(
                f"{self.model.n_actuated} motors cannot produce this acceleration: "
                f"a generalized force of {missing:.3g} is left"
            )
        return u

    def constraint_forces(
        self, v: ArrayLike, u: ArrayLike, wrenches: Wrenches | None = None, loads: ArrayLike | None = None
    ) -> Array:
        """λ of the descriptor form (17): D′q̈′ + C′q̇′ + B′q̇′ + g′ = Sᵀu + Jᵀw + f + φ_q′ᵀλ, of shape (m,).

        λ has one entry a row of φ, in φ's order and axes (`ccpin.kinematics.constraints`): the force (N) that end A of
        a loop receives along a point row, B the opposite; the moment (N m) along a direction row. With redundant rows
        λ is the solution of least norm. Arguments and errors as for `forward_dynamics`.
        """
        answer = None
        if loads is None:
            answer = self.model.core.constraint_forces(self.q_free, v, u, None, self._rows(wrenches))
        if answer is None:
            return self.reference.constraint_forces(self._velocity(v), self._effort(u), wrenches, self._loads(loads))
        return np.asarray(answer)

    # Linear in the constants π of the model (`ReducedModel.parameters`).

    def regressor(self, v: ArrayLike, a: ArrayLike, v_r: ArrayLike | None = None) -> Array:
        """Y with Y π = D q̈ + C q̇ + damping q̇ + g + ρᵀf (22), of shape (n, p): `tau`, and f: dry friction, sliding.

        Args:
            v: q̇, of shape (n,).
            a: q̈, or q̈_r, of shape (n,).
            v_r: q̇_r of Slotine and Li's law, which C(q̇) and the dampers multiply, of shape (n,); default q̇.
        """
        answer = self.model.core.regressor(self.q_free, v, a, v if v_r is None else v_r)
        if answer is not None:
            return np.asarray(answer)
        velocity = self._velocity(v)
        along = velocity if v_r is None else vector(v_r, "v_r", self.model.n)
        given = self.q_free, self.rho, self.rho_dot(velocity), velocity, self._acceleration(a), along
        return regressor(self.model.mechanism.tree, self.model.free_system, *given)

    def energy_regressor(self, v: ArrayLike) -> Array:
        """Y_E, of shape (p,): Y_E π is the energy, kinetic and potential, but for the constant ½ Σ k θ₀² of springs.

        Its rate is u's power less what dampers and friction take.
        """
        return energy_regressor(self.model.mechanism.tree, self.model.free_system, self.q_free, self.v_free(v))

    # Motors.

    def generalized_force(self, u: ArrayLike) -> Array:
        """ρᵀSᵀu, of shape (n,): the actuated joints' efforts seen by the independent coordinates."""
        return self.reference.generalized_force(self._effort(u))

    def joint_efforts(self, u: ArrayLike) -> Array:
        """Sᵀu, of shape (n′,): what the motors do to the free system's joints (α_q′ᵀu where u acts on q itself)."""
        return self.reference.joint_efforts(self._effort(u))

    def joint_loads(self, wrenches: Wrenches | None) -> Array:
        """Jᵀw, of shape (n′,): what wrenches on links do to the free system's joints.

        Raises:
            InvalidInputError: An unknown link, or a wrench of the wrong shape or not finite.
        """
        return self.reference.joint_loads(wrenches)

    def efforts(self, force: ArrayLike) -> Array:
        """The actuated joints' efforts u of least norm with ρᵀSᵀu nearest to a generalized force, of shape (motors,).

        Args:
            force: Of shape (n,), N m or N.
        """
        wanted = vector(force, "force", self.model.n)
        transmission = self.reference.transmission
        return wanted if transmission is None else np.asarray(np.linalg.lstsq(transmission, wanted, rcond=None)[0])

    # Derivatives, exact; those by q are along tangent steps of q.

    def forward_dynamics_derivatives(
        self, v: ArrayLike, u: ArrayLike, wrenches: Wrenches | None = None
    ) -> ForwardDynamicsDerivatives:
        """∂q̈/∂q, ∂q̈/∂q̇ and ∂q̈/∂u of `forward_dynamics`, wrenches constant in world axes; errors as there."""
        rows = self._rows(wrenches)
        answer = self.model.core.forward_dynamics_derivatives(self.q_free, v, u, None, rows)
        if answer is not None:
            return ForwardDynamicsDerivatives(*answer)
        velocity, effort = self._velocity(v), self._effort(u)
        a = self.reference.forward_dynamics(velocity, effort, wrenches)
        return self.reference.derivatives.forward(velocity, effort, a, self._applied(wrenches))

    def inverse_dynamics_derivatives(
        self, v: ArrayLike, a: ArrayLike, wrenches: Wrenches | None = None
    ) -> InverseDynamicsDerivatives:
        """∂u/∂q, ∂u/∂q̇ and ∂u/∂q̈ of `inverse_dynamics`, wrenches constant in world axes; errors as there.

        Raises:
            UnderactuatedError: Also where fewer motors than coordinates happen to produce that acceleration.
        """
        if self.model.actuation is None:
            return InverseDynamicsDerivatives(*self.generalized_force_derivatives(v, a, wrenches))
        u = self.inverse_dynamics(v, a, wrenches)
        return self.reference.derivatives.inverse(self._velocity(v), u, self._acceleration(a), self._applied(wrenches))

    def generalized_force_derivatives(
        self, v: ArrayLike, a: ArrayLike, wrenches: Wrenches | None = None
    ) -> GeneralizedForceDerivatives:
        """∂τ/∂q, ∂τ/∂q̇ and ∂τ/∂q̈ of `tau`, whatever the motors, wrenches constant in world axes."""
        rows = self._rows(wrenches)
        answer = self.model.core.generalized_force_derivatives(self.q_free, v, a, None, rows)
        if answer is not None:
            return GeneralizedForceDerivatives(*answer)
        velocity, acceleration = self._velocity(v), self._acceleration(a)
        return self.reference.derivatives.generalized_force(velocity, acceleration, self._applied(wrenches))

    # What the above share.

    def _applied(self, wrenches: Wrenches | None) -> tuple[Applied, ...]:
        return applied_wrenches(self.model.mechanism.tree, wrenches)

    def _rows(self, wrenches: Wrenches | None) -> Array | None:
        return None if wrenches is None else wrench_rows(self.model.mechanism.tree, wrenches)

    def _velocity(self, v: ArrayLike) -> Array:
        return vector(v, "v", self.model.n)

    def _acceleration(self, a: ArrayLike) -> Array:
        return vector(a, "a", self.model.n)

    def _loads(self, loads: ArrayLike | None) -> Array | None:
        return None if loads is None else vector(loads, "loads", self.model.mechanism.n_free)

    def _effort(self, u: ArrayLike) -> Array:
        return vector(u, "u", self.model.n_actuated)


Near = ArrayLike | State | None
"""Where on a branch of σ: a State, a configuration q′ closed or nearly so, or ``None`` for the reference."""
