"""The second derivatives of σ, exact: ∂ρ/∂q, and the derivatives of the bias γ = ρ̇ q̇ (35).

ψ_q′ ρ = [0; I] holds all along the closed configurations q′ = σ(q). Differentiating it along column ρ_k of ρ,

    ψ_q′ ∂ρ/∂q_k = −(D_k ψ_q′) ρ,        D_k: the derivative along q̇′ = ρ_k,

and once more ψ_q′ γ = −Γ, Γ(q′, q̇′) = ψ̇_q′ q̇′ with q̇′ = ρ q̇,

    ψ_q′ ∂γ/∂q_k = −D(ψ_q′ γ + Γ)·(ρ_k, ∂ρ/∂q_k q̇),        ψ_q′ ∂γ/∂q̇_k = −D(ψ_q′ γ + Γ)·(0, ρ_k),

the components of γ held on the right. These systems are consistent where redundant rows make ψ_q′ tall, so its
pseudo-inverse solves them exactly. Derivatives with respect to q are along tangent steps of
`IndependentCoordinates.integrate`, components of velocities held.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.kinematics.parametrization import ClosedPoint, Parametrization
from ccpin.kinematics.rows import Directions


class BiasDerivatives(NamedTuple):
    """γ = ρ̇ q̇, of shape (n′,), with ∂γ/∂q and ∂γ/∂q̇, of shape (n′, n)."""

    gamma: Array
    dq: Array
    dv: Array


class SigmaDerivatives:
    """∂ρ/∂q at a closed configuration, applied to velocities and to forces.

    Args:
        parametrization: ψ and its rates.
        point: Where to differentiate.
    """

    def __init__(self, parametrization: Parametrization, point: ClosedPoint) -> None:
        self._parametrization = parametrization
        self._point = point
        self._second = self._psi_second()

    def of_velocity(self, v: Array) -> Array:
        """∂(ρ v)/∂q at fixed v (n,), of shape (n′, n)."""
        return -self._point.factor.solve(np.einsum("mjk,j->mk", self._second, v))

    def of_force(self, force: Array) -> Array:
        """∂(ρᵀ f)/∂q at fixed f (n′,), of shape (n, n): entry (j, k) is f · ∂ρ_j/∂q_k."""
        multipliers = self._point.factor.solve_transposed(force)
        return -np.tensordot(multipliers, self._second, 1)

    def of_bias(self, v: Array, spread: Array) -> BiasDerivatives:
        """γ = ρ̇ q̇ and its derivatives at q̇ = v (n,); `spread` is ∂(ρ v)/∂q, from `of_velocity`."""
        parametrization, point, n = self._parametrization, self._point, len(v)
        v_free = point.rho @ v
        gamma = parametrization.bias(point, v_free)
        directions = Directions(np.hstack([point.rho, np.zeros_like(point.rho)]), np.hstack([spread, point.rho]))
        rows = parametrization.constraints.acceleration_derivative(point.constraints, v_free, gamma, directions)
        alpha = parametrization.coordinates.bias_derivative(point.q_free, v_free, directions.dq, directions.dv)
        alpha[:, :n] += self._alpha_second(gamma[:, None])[:, 0]
        change = -point.factor.solve(np.vstack([rows, alpha]))
        return BiasDerivatives(gamma, change[:, :n], change[:, n:])

    def _psi_second(self) -> Array:
        """D_k (ψ_q′ ρ_j), of shape (m + n, n, n): axes (row, j, k)."""
        rho = self._point.rho
        rows = self._parametrization.constraints.second_derivative(self._point.constraints, rho, rho)
        return np.concatenate([rows, self._alpha_second(rho)])

    def _alpha_second(self, w: Array) -> Array:
        """D_k (α_q′ w_j), of shape (n, j, n), for velocity components w (n′, j) held."""
        coordinates, rho = self._parametrization.coordinates, self._point.rho
        second = np.zeros((coordinates.n, w.shape[1], rho.shape[1]))
        for k, step in enumerate(rho.T):
            rate = coordinates.jacobian_rate(self._point.q_free, step)
            if rate is not None:
                second[:, :, k] = rate @ w
        return second
