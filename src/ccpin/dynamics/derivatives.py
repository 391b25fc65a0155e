"""Derivatives of the reduced dynamics, exact: no finite differences.

With τ′(q′, q̇′, q̈′) the free system's inverse dynamics (2), dampers and springs included, less the loads Jᵀw of wrenches
on links, q̇′ = ρ q̇ and q̈′ = ρ q̈ + ρ̇ q̇, the generalized force is
τ = ρᵀτ′, so that

    ∂τ/∂q_k = (∂ρ/∂q_k)ᵀ τ′ + ρᵀ [∂τ′/∂q′ ρ_k + ∂τ′/∂q̇′ ∂(ρ q̇)/∂q_k + D′ (∂(ρ q̈)/∂q_k + ∂(ρ̇ q̇)/∂q_k)],
    ∂τ/∂q̇  = ρᵀ [∂τ′/∂q̇′ ρ + D′ ∂(ρ̇ q̇)/∂q̇],        ∂τ/∂q̈ = ρᵀD′ρ = D,

and forward dynamics follows by differentiating τ(q, q̇, q̈) = ρᵀSᵀu, its right side included. Columns of ∂/∂q are
derivatives along tangent steps of q (`IndependentCoordinates.integrate`): plain partial derivatives for angles and
lengths, right increments for circles and quaternions, the components of q̇ and q̈ held.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.dynamics.free_system import FreeSystem
from ccpin.dynamics.wrenches import Applied, joint_loads, joint_loads_derivative
from ccpin.errors import UnderactuatedError
from ccpin.kinematics.parametrization import ClosedPoint, Parametrization
from ccpin.kinematics.sigma_derivatives import SigmaDerivatives

_FULL_RANK = 1e-10  # of the largest singular value of ρᵀSᵀ: motors produce nothing in a direction below


class ForwardDynamicsDerivatives(NamedTuple):
    """Derivatives of q̈(q, q̇, u) (22).

    Attributes:
        da_dq: Along tangent steps of q, of shape (n, n).
        da_dv: Of shape (n, n).
        da_du: D⁻¹ρᵀSᵀ, of shape (n, motors).
    """

    da_dq: Array
    da_dv: Array
    da_du: Array


class GeneralizedForceDerivatives(NamedTuple):
    """Derivatives of τ(q, q̇, q̈) = D q̈ + C q̇ + damping q̇ + g, one entry an independent coordinate (N m or N).

    Attributes:
        dtau_dq: Along tangent steps of q, of shape (n, n).
        dtau_dv: Of shape (n, n).
        dtau_da: D, of shape (n, n).
    """

    dtau_dq: Array
    dtau_dv: Array
    dtau_da: Array


class InverseDynamicsDerivatives(NamedTuple):
    """Derivatives of the actuated joints' efforts u(q, q̇, q̈), ρᵀSᵀu = τ (least norm where motors are redundant).

    Attributes:
        du_dq: Along tangent steps of q, of shape (motors, n); equal to dtau_dq where actuated = independent.
        du_dv: Of shape (motors, n).
        du_da: Of shape (motors, n).
    """

    du_dq: Array
    du_dv: Array
    du_da: Array


class DynamicsDerivatives:
    """The derivatives of a reduced model's dynamics at one configuration; ∂ρ/∂q is computed once.

    Args:
        free_system: D′, τ′ and their derivatives.
        parametrization: σ, ρ, ρ̇.
        point: The closed configuration.
        actuation: S, of shape (motors, n′); ``None`` where the efforts are the generalized forces, ρᵀSᵀu = u.
    """

    def __init__(
        self, free_system: FreeSystem, parametrization: Parametrization, point: ClosedPoint, actuation: Array | None
    ) -> None:
        self._free_system = free_system
        self._point = point
        self._actuation = actuation
        self._sigma = SigmaDerivatives(parametrization, point)

    def gravity(self) -> Array:
        """∂g/∂q = (∂ρ/∂q)ᵀg′ + ρᵀ ∂g′/∂q′ ρ, of shape (n, n); symmetric for plain coordinates: V's Hessian."""
        q_free, rho = self._point.q_free, self._point.rho
        stiffness = rho.T @ self._free_system.gravity_derivative(q_free) @ rho
        return np.asarray(stiffness + self._sigma.of_force(self._free_system.gravity(q_free)))

    def generalized_force(self, v: Array, a: Array, applied: Sequence[Applied] = ()) -> GeneralizedForceDerivatives:
        """∂τ/∂q, ∂τ/∂q̇ and ∂τ/∂q̈ of τ = D q̈ + C q̇ + damping q̇ + g − ρᵀJᵀw at q̇ = v and q̈ = a."""
        q_free, rho = self._point.q_free, self._point.rho
        spread = self._sigma.of_velocity(v)
        bias = self._sigma.of_bias(v, spread)
        free = self._free_system.inverse_dynamics_derivatives(q_free, rho @ v, rho @ a + bias.gamma)
        if applied:
            scratch = self._free_system.scratch
            loads, slope = (f(scratch, q_free, applied) for f in (joint_loads, joint_loads_derivative))
            free = free._replace(tau=free.tau - loads, dtau_dq=free.dtau_dq - slope)
        acceleration = self._sigma.of_velocity(a) + bias.dq
        change = free.dtau_dq @ rho + free.dtau_dv @ spread + free.dtau_da @ acceleration
        return GeneralizedForceDerivatives(
            dtau_dq=rho.T @ change + self._sigma.of_force(free.tau),
            dtau_dv=rho.T @ (free.dtau_dv @ rho + free.dtau_da @ bias.dv),
            dtau_da=rho.T @ free.dtau_da @ rho,
        )

    def forward(self, v: Array, u: Array, a: Array, applied: Sequence[Applied] = ()) -> ForwardDynamicsDerivatives:
        """∂q̈/∂q, ∂q̈/∂q̇, ∂q̈/∂u, given a = q̈(q, v, u): D ∂q̈ = ∂(ρᵀSᵀu) − ∂τ|_q̈."""
        force = self.generalized_force(v, a, applied)
        transmission = np.eye(len(v)) if self._actuation is None else self._point.rho.T @ self._actuation.T
        right = np.hstack([self._effort_change(u) - force.dtau_dq, -force.dtau_dv, transmission])
        solved, n = np.asarray(np.linalg.solve(force.dtau_da, right), dtype=np.float64), len(v)
        return ForwardDynamicsDerivatives(solved[:, :n], solved[:, n : 2 * n], solved[:, 2 * n :])

    def inverse(self, v: Array, u: Array, a: Array, applied: Sequence[Applied] = ()) -> InverseDynamicsDerivatives:
        """∂u/∂q, ∂u/∂q̇, ∂u/∂q̈, given u = u(q, v, a).

        With T = ρᵀSᵀ and u = Tᵀλ the effort of least norm, T u = τ gives T du = dτ − dT u and du = dTᵀλ + Tᵀdλ.

        Raises:
            UnderactuatedError: The motors cannot produce every generalized force (T lacks rank n).
        """
        force = self.generalized_force(v, a, applied)
        if self._actuation is None:
            return InverseDynamicsDerivatives(*force)
        transmission = self._point.rho.T @ self._actuation.T
        singular_values = np.linalg.svd(transmission, compute_uv=False)
        if len(singular_values) < len(transmission) or singular_values[-1] <= _FULL_RANK * singular_values[0]:
            raise UnderactuatedError(
                f"{len(self._actuation)} motors do not produce every one of {len(v)} generalized forces, so u(q, q̇, q̈) "
                "has no derivative; those of τ = D q̈ + C q̇ + damping q̇ + g exist (generalized_force_derivatives)"
            )
        inverse = np.linalg.pinv(transmission)
        multipliers = inverse.T @ u
        turned = self._actuation @ self._sigma.of_velocity(multipliers)
        return InverseDynamicsDerivatives(
            du_dq=turned + inverse @ (force.dtau_dq - self._effort_change(u) - transmission @ turned),
            du_dv=inverse @ force.dtau_dv,
            du_da=inverse @ force.dtau_da,
        )

    def _effort_change(self, u: Array) -> Array:
        """∂(ρᵀSᵀu)/∂q at fixed u, of shape (n, n): zero where the actuated joints are the independent ones."""
        return np.zeros((len(u), len(u))) if self._actuation is None else self._sigma.of_force(self._actuation.T @ u)
