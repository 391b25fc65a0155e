"""The second derivatives of σ, exact: ∂ρ/∂q, and the derivatives of the bias γ = ρ̇ q̇ (35).

ψ_q′ ρ = [0; I] holds all along the closed configurations q′ = σ(q). Differentiating it along column ρ_k of ρ,

    ψ_q′ ∂ρ/∂q_k = −(D_k ψ_q′) ρ,        D_k: the derivative along q̇′ = ρ_k,

and once more ψ_q′ γ = −Γ, Γ(q′, q̇′) = ψ̇_q′ q̇′ with q̇′ = ρ q̇,

    ψ_q′ ∂γ/∂q_k = −(D_k ψ_q′) γ − DΓ·(ρ_k, ∂ρ/∂q_k q̇),        ψ_q′ ∂γ/∂q̇_k = −DΓ·(0, ρ_k).

These systems are consistent where redundant rows make ψ_q′ tall, so its pseudo-inverse solves them exactly. Derivatives
with respect to q are along tangent steps of `IndependentCoordinates.integrate`, components of velocities held.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccpin.bias_derivatives import Directions
from ccpin.coordinate_derivatives import alpha_bias_derivative
from ccpin.parametrization import ClosedPoint, Parametrization

Array = NDArray[np.float64]


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
        self._rates = [self._psi_rate(column) for column in point.rho.T]

    def of_velocity(self, v: Array) -> Array:
        """∂(ρ v)/∂q at fixed v (n,), of shape (n′, n)."""
        return self._solved(self._point.rho @ v)

    def of_force(self, force: Array) -> Array:
        """∂(ρᵀ f)/∂q at fixed f (n′,), of shape (n, n): entry (j, k) is f · ∂ρ_j/∂q_k."""
        multipliers = self._point.factor.solve_transposed(force)
        rows = np.array([multipliers @ rate for rate in self._rates]).reshape(len(self._rates), len(force))
        return np.asarray(-(rows @ self._point.rho).T)

    def of_bias(self, v: Array, spread: Array) -> BiasDerivatives:
        """γ = ρ̇ q̇ and its derivatives at q̇ = v (n,); `spread` is ∂(ρ v)/∂q, from `of_velocity`."""
        parametrization, point, n = self._parametrization, self._point, len(v)
        v_free = point.rho @ v
        gamma = parametrization.bias(point, v_free)
        directions = Directions(np.hstack([point.rho, np.zeros_like(point.rho)]), np.hstack([spread, point.rho]))
        constraints = parametrization.constraints.bias_derivative(point.q_free, v_free, directions)
        alpha = alpha_bias_derivative(parametrization.coordinates, point.q_free, v_free, directions)
        change = -point.factor.solve(np.vstack([constraints, alpha]))
        return BiasDerivatives(gamma, self._solved(gamma) + change[:, :n], change[:, n:])

    def _solved(self, w: Array) -> Array:
        """−ψ_q′⁻¹ (D_k ψ_q′) w for each k, of shape (n′, n)."""
        right = np.array([rate @ w for rate in self._rates]).reshape(len(self._rates), -1).T
        return -self._point.factor.solve(right)

    def _psi_rate(self, v_free: Array) -> Array:
        """ψ̇_q′ along q̇′, of shape (m + n, n′)."""
        constraints, coordinates = self._parametrization.constraints, self._parametrization.coordinates
        rate = constraints.rate(self._point.q_free, v_free).jacobian_rate
        alpha_rate = coordinates.jacobian_rate(self._point.q_free, v_free)
        return np.vstack([rate, np.zeros((coordinates.n, len(v_free))) if alpha_rate is None else alpha_rate])
