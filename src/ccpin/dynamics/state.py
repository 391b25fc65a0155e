"""A closed, nonsingular configuration, and what the reduced model says there, each thing computed once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import lapack

from ccpin.arrays import Array, vector
from ccpin.dynamics.derivatives import (
    DynamicsDerivatives,
    ForwardDynamicsDerivatives,
    GeneralizedForceDerivatives,
    InverseDynamicsDerivatives,
)
from ccpin.dynamics.free_system import Energy, FreeSystem
from ccpin.errors import SingularConfigurationError, UnderactuatedError, UnsupportedMechanismError
from ccpin.kinematics.coordinates import IndependentCoordinates
from ccpin.kinematics.parametrization import ClosedPoint, Parametrization
from ccpin.mechanism.mechanism import Mechanism

_MISSING = 1e-9
_NEARLY_SINGULAR = 1e-6


class Model(Protocol):
    """What a State reads of its reduced model; `ccpin.ReducedModel` says what each is."""

    mechanism: Mechanism
    free_system: FreeSystem
    parametrization: Parametrization
    coordinates: IndependentCoordinates
    actuation: Array | None
    n: int
    nq: int
    n_actuated: int

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


def _locked(array: Array) -> Array:
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False, repr=False)
class State:
    """A configuration that is closed and nonsingular, q′ = σ(q) (12), with everything that depends on it alone.

    From `ReducedModel.at`. Immutable, its arrays read-only; what is asked of it is computed once and kept. Any number
    of threads may share one. v is q̇ (n,), a is q̈ (n,), u the actuated joints' efforts (motors,); SI units, radians.

    Raises:
        InvalidInputError: v, a or u has the wrong shape or is not finite (every method).

    Attributes:
        model: The reduced model.
        q: Independent coordinates, of shape (model.nq,).
    """

    model: Model
    q: Array
    _point: ClosedPoint

    def __post_init__(self) -> None:
        for array in (self.q, self._point.q_free, self._point.rho):
            _locked(array)

    def __reduce__(self) -> tuple[type[State], tuple[Model, Array, ClosedPoint]]:
        return State, (self.model, self.q, self._point)

    def __repr__(self) -> str:
        q = np.array2string(self.q, precision=6, separator=", ")
        return f"State({self.model.mechanism.name}, q={q}, rcond={self.rcond:.1e})"

    # Where it is and how it moves.

    @property
    def q_free(self) -> Array:
        """The configuration q′ = σ(q) (12), of shape (nq,)."""
        return self._point.q_free

    @property
    def rho(self) -> Array:
        """ρ = ψ_q′⁻¹ [0; I] (14), of shape (n′, n), with q̇′ = ρ q̇ (13)."""
        return self._point.rho

    @property
    def rcond(self) -> float:
        """Reciprocal condition number of ψ_q′ in the 1-norm: towards 0 near a singularity."""
        return self._point.factor.rcond

    def v_free(self, v: ArrayLike) -> Array:
        """The free system's velocity q̇′ = ρ q̇ (13), of shape (n′,)."""
        return self._point.rho @ self._velocity(v)

    def a_free(self, v: ArrayLike, a: ArrayLike) -> Array:
        """The free system's acceleration q̈′ = ρ q̈ + ρ̇ q̇, of shape (n′,)."""
        return self._point.rho @ vector(a, "a", self.model.n) + self.bias(v)

    def rho_dot(self, v: ArrayLike) -> Array:
        """ρ̇ = −ψ_q′⁻¹ ψ̇_q′ ρ (35) along q̇′ = ρ q̇, of shape (n′, n)."""
        return self.model.parametrization.rho_dot(self._point, self.v_free(v))

    def bias(self, v: ArrayLike) -> Array:
        """ρ̇ q̇, of shape (n′,): the free system's acceleration where q̈ = 0."""
        return self.model.parametrization.bias(self._point, self.v_free(v))

    # The reduced equations of motion.

    @cached_property
    def D(self) -> Array:
        """The mass matrix ρᵀD′ρ (23), symmetric positive definite, of shape (n, n), kg m² (kg, kg m)."""
        return _locked(self.rho.T @ self._mass_rho)

    @cached_property
    def damping(self) -> Array:
        """ρᵀB′ρ, of shape (n, n): the joints' dampers (B′ = diag b), symmetric, ≥ 0; zeros where there is none."""
        return _locked(self.rho.T @ (self.model.free_system.damping[:, None] * self.rho))

    @cached_property
    def g(self) -> Array:
        """The potential's gradient ρᵀg′ (25), of shape (n,), N m or N: gravity and the joints' springs."""
        return _locked(self.rho.T @ self._gravity_free)

    @cached_property
    def gravity_derivative(self) -> Array:
        """∂g/∂q, of shape (n, n), along tangent steps of q: the potential's Hessian for plain coordinates."""
        return _locked(self._derivatives.gravity())

    def C(self, v: ArrayLike) -> Array:
        """ρᵀC′ρ + ρᵀD′ρ̇ (24), of shape (n, n); Ḋ − 2C is skew symmetric (Lemma III.1)."""
        return self._coriolis(self.v_free(v), self.rho_dot(v))

    def terms(self, v: ArrayLike) -> ReducedTerms:
        """D, C, g (23)–(25) and what they come from."""
        v_free, rho_dot = self.v_free(v), self.rho_dot(v)
        return ReducedTerms(self.q_free, v_free, self.rho, rho_dot, self.D, self._coriolis(v_free, rho_dot), self.g)

    def energy(self, v: ArrayLike) -> Energy:
        """Kinetic energy ½ q̇ᵀD q̇ and potential energy V with ∂V/∂q = g, in joules."""
        return self.model.free_system.energy(self.q_free, self.v_free(v))

    def tau(self, v: ArrayLike, a: ArrayLike) -> Array:
        """The generalized force τ = D q̈ + C q̇ + damping q̇ + g (22), of shape (n,), N m or N."""
        return self.rho.T @ self._tau_free(self.v_free(v), self.a_free(v, a))

    def forward_dynamics(self, v: ArrayLike, u: ArrayLike) -> Array:
        """q̈ = D⁻¹(ρᵀSᵀu − C q̇ − damping q̇ − g) (22), of shape (n,).

        Raises:
            SingularConfigurationError: D is not positive definite so near a singularity.
            UnsupportedMechanismError: D is not positive definite (bodies without mass or inertia).
        """
        v_free = self.v_free(v)
        return self._accelerated(v_free, self.model.parametrization.bias(self._point, v_free), u)

    def inverse_dynamics(self, v: ArrayLike, a: ArrayLike) -> Array:
        """The actuated joints' efforts u with ρᵀSᵀu = D q̈ + C q̇ + damping q̇ + g (22), of shape (motors,).

        With more motors than independent coordinates u is the solution of least norm.

        Raises:
            UnderactuatedError: No u produces that acceleration (fewer motors than coordinates).
        """
        force = self.tau(v, a)
        u = self.efforts(force)
        missing = float(np.abs(self.generalized_force(u) - force).max(initial=0.0))
        if missing > _MISSING * max(1.0, float(np.abs(force).max(initial=0.0))):
            raise UnderactuatedError(
                f"{self.model.n_actuated} motors cannot produce this acceleration: "
                f"a generalized force of {missing:.3g} is left"
            )
        return u

    def constraint_forces(self, v: ArrayLike, u: ArrayLike) -> Array:
        """λ of the descriptor form (17): D′q̈′ + C′q̇′ + B′q̇′ + g′ = Sᵀu + φ_q′ᵀλ, of shape (m,).

        λ has one entry a row of φ, in φ's order and axes (`ccpin.kinematics.constraints`): the force (N) that end A of
        a loop receives along a point row, B the opposite; the moment (N m) along a direction row. With redundant rows
        λ is the solution of least norm. Errors as for `forward_dynamics`.
        """
        v_free = self.v_free(v)
        bias = self.model.parametrization.bias(self._point, v_free)
        a_free = self.rho @ self._accelerated(v_free, bias, u) + bias
        force = self._tau_free(v_free, a_free) - self.joint_efforts(u)
        return self._point.factor.solve_transposed(force)[: self.model.parametrization.constraints.size]

    # Motors.

    def generalized_force(self, u: ArrayLike) -> Array:
        """ρᵀSᵀu, of shape (n,): the actuated joints' efforts seen by the independent coordinates."""
        effort = self._effort(u)
        return effort if self._transmission is None else self._transmission @ effort

    def joint_efforts(self, u: ArrayLike) -> Array:
        """Sᵀu, of shape (n′,): what the motors do to the free system's joints (α_q′ᵀu where u acts on q itself)."""
        S = self.model.actuation
        return np.asarray((self.model.coordinates.jacobian(self.q_free) if S is None else S).T @ self._effort(u))

    def efforts(self, force: ArrayLike) -> Array:
        """The actuated joints' efforts u of least norm with ρᵀSᵀu nearest to a generalized force, of shape (motors,).

        Args:
            force: Of shape (n,), N m or N.
        """
        wanted = vector(force, "force", self.model.n)
        if self._transmission is None:
            return wanted
        return np.asarray(np.linalg.lstsq(self._transmission, wanted, rcond=None)[0])

    # Derivatives, exact; those by q are along tangent steps of q.

    def forward_dynamics_derivatives(self, v: ArrayLike, u: ArrayLike) -> ForwardDynamicsDerivatives:
        """∂q̈/∂q, ∂q̈/∂q̇ and ∂q̈/∂u of `forward_dynamics`; errors as there."""
        return self._derivatives.forward(self._velocity(v), self._effort(u), self.forward_dynamics(v, u))

    def inverse_dynamics_derivatives(self, v: ArrayLike, a: ArrayLike) -> InverseDynamicsDerivatives:
        """∂u/∂q, ∂u/∂q̇ and ∂u/∂q̈ of `inverse_dynamics`; errors as there.

        Raises:
            UnderactuatedError: Also where fewer motors than coordinates happen to produce that acceleration.
        """
        acceleration = vector(a, "a", self.model.n)
        return self._derivatives.inverse(self._velocity(v), self.inverse_dynamics(v, a), acceleration)

    def generalized_force_derivatives(self, v: ArrayLike, a: ArrayLike) -> GeneralizedForceDerivatives:
        """∂τ/∂q, ∂τ/∂q̇ and ∂τ/∂q̈ of τ = D q̈ + C q̇ + damping q̇ + g, whatever the motors."""
        return self._derivatives.generalized_force(self._velocity(v), vector(a, "a", self.model.n))

    # What the above share.

    @cached_property
    def _mass_rho(self) -> Array:
        """D′ρ, of shape (n′, n)."""
        return _locked(self.model.free_system.mass_matrix(self.q_free) @ self.rho)

    @cached_property
    def _gravity_free(self) -> Array:
        """g′, of shape (n′,)."""
        return _locked(self.model.free_system.gravity(self.q_free))

    @cached_property
    def _transmission(self) -> Array | None:
        """ρᵀSᵀ, of shape (n, motors); ``None`` where u acts on q itself."""
        return None if self.model.actuation is None else _locked(self.rho.T @ self.model.actuation.T)

    @cached_property
    def _derivatives(self) -> DynamicsDerivatives:
        model = self.model
        return DynamicsDerivatives(model.free_system, model.parametrization, self._point, model.actuation)

    def _velocity(self, v: ArrayLike) -> Array:
        return vector(v, "v", self.model.n)

    def _effort(self, u: ArrayLike) -> Array:
        return vector(u, "u", self.model.n_actuated)

    def _coriolis(self, v_free: Array, rho_dot: Array) -> Array:
        coriolis = self.model.free_system.coriolis_matrix(self.q_free, v_free)
        return np.asarray(self.rho.T @ (coriolis @ self.rho) + self._mass_rho.T @ rho_dot)

    def _tau_free(self, v_free: Array, a_free: Array) -> Array:
        return self.model.free_system.inverse_dynamics(self.q_free, v_free, a_free)

    def _accelerated(self, v_free: Array, bias: Array, u: ArrayLike) -> Array:
        """q̈ from q̇′ and ρ̇ q̇: D q̈ = ρᵀSᵀu − ρᵀτ′(q′, q̇′, ρ̇ q̇), with τ′ the free system's inverse dynamics."""
        force = self.generalized_force(u) - self.rho.T @ self._tau_free(v_free, bias)
        if not self.model.n:
            return np.zeros(0)
        _, a, info = lapack.dposv(self.D, force)
        if info != 0 and self.rcond < _NEARLY_SINGULAR:
            raise SingularConfigurationError(
                f"the reduced dynamics break down near a singularity (reciprocal condition number of ψ_q′ "
                f"{self.rcond:.1e})",
                q_free=self.q_free,
                rcond=self.rcond,
            )
        if info != 0:
            raise UnsupportedMechanismError(
                "the reduced mass matrix D is not positive definite: some independent motion moves no mass; give the "
                "links inertias, or lock that motion"
            )
        return np.asarray(a)


Near = ArrayLike | State | None
"""Where on a branch of σ: a State, a configuration q′ closed or nearly so, or ``None`` for the reference."""
