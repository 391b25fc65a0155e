"""The reduced model at one closed point, with NumPy and Pinocchio: the definition the compiled core is tested by."""

from __future__ import annotations

from functools import cached_property
from typing import Protocol

import numpy as np
from scipy.linalg import lapack

from ccpin.arrays import Array
from ccpin.dynamics.derivatives import DynamicsDerivatives
from ccpin.dynamics.free_system import Energy, FreeSystem
from ccpin.dynamics.wrenches import Wrenches, applied_wrenches, joint_loads
from ccpin.errors import SingularConfigurationError, UnsupportedMechanismError
from ccpin.kinematics.coordinates import IndependentCoordinates
from ccpin.kinematics.parametrization import ClosedPoint, Parametrization
from ccpin.mechanism.mechanism import Mechanism

_NEARLY_SINGULAR = 1e-6  # rcond of ψ_q′: below it, a D that is not positive definite is a singularity's doing


def locked(array: Array) -> Array:
    """The array itself, read-only from here on."""
    array.setflags(write=False)
    return array


class ModelLike(Protocol):
    """What is read of a reduced model here; `ccpin.ReducedModel` says what each is."""

    mechanism: Mechanism
    free_system: FreeSystem
    parametrization: Parametrization
    coordinates: IndependentCoordinates
    actuation: Array | None
    n: int


class ReferenceBackend:
    """(22)–(25) at one configuration, each thing computed once; `State` says what each is, and checks arguments.

    Args:
        model: The reduced model.
        q_free: The closed configuration; read-only from here on, as is ρ.
        rho: ρ there.
    """

    def __init__(self, model: ModelLike, q_free: Array, rho: Array) -> None:
        self.model, self.q_free, self.rho = model, locked(q_free), locked(rho)

    @classmethod
    def of(cls, model: ModelLike, point: ClosedPoint) -> ReferenceBackend:
        """At a closed point that is known already."""
        reference = cls(model, point.q_free, point.rho)
        reference.point = point
        return reference

    def __reduce__(self) -> tuple[type[ReferenceBackend], tuple[ModelLike, Array, Array]]:
        return ReferenceBackend, (self.model, self.q_free, self.rho)

    @cached_property
    def point(self) -> ClosedPoint:
        """The closed point, with ψ_q′ factorised."""
        return self.model.parametrization.at(self.q_free)

    def rho_dot(self, v: Array) -> Array:
        """ρ̇ (35)."""
        return self.model.parametrization.rho_dot(self.point, self.rho @ v)

    def bias(self, v: Array) -> Array:
        """ρ̇ q̇, without ρ̇."""
        return self.model.parametrization.bias(self.point, self.rho @ v)

    @cached_property
    def D(self) -> Array:
        """ρᵀD′ρ (23)."""
        return locked(self.rho.T @ self._mass_rho)

    @cached_property
    def g(self) -> Array:
        """ρᵀg′ (25)."""
        return locked(self.rho.T @ self.model.free_system.gravity(self.q_free))

    def C(self, v: Array, rho_dot: Array) -> Array:
        """ρᵀC′ρ + ρᵀD′ρ̇ (24)."""
        coriolis = self.model.free_system.coriolis_matrix(self.q_free, self.rho @ v)
        return np.asarray(self.rho.T @ (coriolis @ self.rho) + self._mass_rho.T @ rho_dot)

    def energy(self, v: Array) -> Energy:
        """½ q̇ᵀD q̇ and V."""
        return self.model.free_system.energy(self.q_free, self.rho @ v)

    def tau(self, v: Array, a: Array, wrenches: Wrenches | None = None) -> Array:
        """D q̈ + C q̇ + damping q̇ + g − ρᵀJᵀw (22), by ρᵀ times the free system's inverse dynamics."""
        force = self._tau_free(v, self.rho @ a + self.bias(v))
        return np.asarray(self.rho.T @ (force if wrenches is None else force - self.joint_loads(wrenches)))

    @cached_property
    def transmission(self) -> Array | None:
        """ρᵀSᵀ; ``None`` where u acts on q itself."""
        return None if self.model.actuation is None else locked(self.rho.T @ self.model.actuation.T)

    def generalized_force(self, u: Array) -> Array:
        """ρᵀSᵀu."""
        return u if self.transmission is None else self.transmission @ u

    def joint_efforts(self, u: Array) -> Array:
        """Sᵀu (α_q′ᵀu where u acts on q itself)."""
        S = self.model.actuation
        return np.asarray((self.model.coordinates.jacobian(self.q_free) if S is None else S).T @ u)

    def joint_loads(self, wrenches: Wrenches | None) -> Array:
        """Jᵀw of wrenches on links."""
        scratch = self.model.free_system.scratch
        return joint_loads(scratch, self.q_free, applied_wrenches(self.model.mechanism.tree, wrenches))

    def forward_dynamics(
        self, v: Array, u: Array, wrenches: Wrenches | None = None, loads: Array | None = None
    ) -> Array:
        """q̈ (22)."""
        return self._accelerated(v, self.bias(v), self._pushed(u, wrenches, loads))

    def constraint_forces(
        self, v: Array, u: Array, wrenches: Wrenches | None = None, loads: Array | None = None
    ) -> Array:
        """λ (17)."""
        bias, outside = self.bias(v), self._outside(wrenches, loads)
        efforts = self.joint_efforts(u) if outside is None else self.joint_efforts(u) + outside
        a_free = self.rho @ self._accelerated(v, bias, self._pushed(u, wrenches, loads)) + bias
        force = self._tau_free(v, a_free) - efforts
        return self.point.factor.solve_transposed(force)[: self.model.parametrization.constraints.size]

    @cached_property
    def derivatives(self) -> DynamicsDerivatives:
        """Of all of these."""
        model = self.model
        return DynamicsDerivatives(model.free_system, model.parametrization, self.point, model.actuation)

    @cached_property
    def _mass_rho(self) -> Array:
        """D′ρ, of shape (n′, n)."""
        return np.asarray(self.model.free_system.mass_matrix(self.q_free) @ self.rho)

    def _tau_free(self, v: Array, a_free: Array) -> Array:
        return self.model.free_system.inverse_dynamics(self.q_free, self.rho @ v, a_free)

    def _pushed(self, u: Array, wrenches: Wrenches | None, loads: Array | None) -> Array:
        """ρᵀ(Sᵀu + Jᵀw + f)."""
        force, outside = self.generalized_force(u), self._outside(wrenches, loads)
        return force if outside is None else force + self.rho.T @ outside

    def _outside(self, wrenches: Wrenches | None, loads: Array | None) -> Array | None:
        """Jᵀw + f, ``None`` where there is neither."""
        if wrenches is None:
            return loads
        carried = self.joint_loads(wrenches)
        return carried if loads is None else carried + loads

    def _accelerated(self, v: Array, bias: Array, pushed: Array) -> Array:
        """q̈ from ρ̇ q̇: D q̈ = ρᵀ(Sᵀu + Jᵀw) − ρᵀτ′(q′, q̇′, ρ̇ q̇), with τ′ the free system's inverse dynamics."""
        force = pushed - self.rho.T @ self._tau_free(v, bias)
        if not self.model.n:
            return np.zeros(0)
        _, a, info = lapack.dposv(self.D, force)
        rcond = self.point.factor.rcond
        if info != 0 and rcond < _NEARLY_SINGULAR:
            raise SingularConfigurationError(
                f"the reduced dynamics break down near a singularity (reciprocal condition number of ψ_q′ {rcond:.1e})",
                q_free=self.q_free,
                rcond=rcond,
            )
        if info != 0:
            raise UnsupportedMechanismError(
                "the reduced mass matrix D is not positive definite: some independent motion moves no mass; give the "
                "links inertias, or lock that motion"
            )
        return np.asarray(a)
