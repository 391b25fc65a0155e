"""The equations G(x) = 0 of singular configurations with their first two derivatives, and their drift over a box.

`ccpin/proof/theorems/singular_system.md` states G, the bounds of its drift and the rounding.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, apply
from ccpin.proof.equations import Derivatives, Problem, derivatives, third_along, third_bound


class Values(NamedTuple):
    """G and its derivatives at B points x.

    Attributes:
        theta, kernel, pairing: θ (B, n′), w (B, m) and l (B, m).
        value: G, of shape (B, M).
        slope: G′, of shape (B, M, N).
        bend: G″, of shape (B, M, N, N).
        arms: |∂x_c/∂θ_j| of the chains, for bounds, of shape (B, C, k).
        rounding: What each entry of these may be off by, of shape (B,).
    """

    theta: Array
    kernel: Array
    pairing: Array
    value: Array
    slope: Array
    bend: Array
    arms: Array
    rounding: Array

    @property
    def x(self) -> Array:
        """(θ, w), of shape (B, N)."""
        return np.concatenate([self.theta, self.kernel], axis=1)


def values_at(problem: Problem, theta: Array, kernel: Array, pairing: Array) -> Values:
    """G, G′ and G″ at θ (B, n′), w (B, m) with l (B, m)."""
    system = problem.system
    m, size = system.m, system.n_free
    value, slope, found = first_order(problem, theta, kernel, pairing)
    whole, mixed = np.zeros_like(theta), found.hessian[..., system.dependent]
    whole[:, system.dependent] = kernel
    bend = np.zeros((len(theta), 2 * m + 1, size + m, size + m))
    bend[:, :m, :size, :size], bend[:, m:-1, :size, size:] = found.hessian, mixed
    bend[:, m:-1, size:, :size] = np.swapaxes(mixed, 2, 3)
    bend[:, m:-1, :size, :size] = third_along(problem, theta, whole)
    rounding = rounding_at(problem, theta, kernel, pairing)
    return Values(theta, kernel, pairing, value, slope, bend, found.arms, rounding)


def rounding_at(problem: Problem, theta: Array, kernel: Array, pairing: Array) -> Array:
    """What each entry of G, G′ and G″ may be off by, of shape (B,)."""
    weight = 1.0 + np.abs(kernel).sum(axis=1) + np.abs(pairing).sum(axis=1)
    return np.asarray(4.0 * problem.system.rounding * problem.system.magnitude(theta) * weight)


def first_order(problem: Problem, theta: Array, kernel: Array, pairing: Array) -> tuple[Array, Array, Derivatives]:
    """G (B, M), G′ (B, M, N), and the derivatives of φ they are made of."""
    system, found = problem.system, derivatives(problem, theta)
    m, size, dependent = system.m, system.n_free, system.dependent
    inner = found.jacobian[:, :, dependent]
    paired = np.sum(pairing * kernel, axis=1, keepdims=True) - 1.0
    slope = np.zeros((len(theta), 2 * m + 1, size + m))
    slope[:, :m, :size], slope[:, m:-1, size:], slope[:, -1, size:] = found.jacobian, inner, pairing
    slope[:, m:-1, :size] = (found.hessian[..., dependent] @ kernel[:, None, :, None])[..., 0]
    return np.concatenate([found.phi, apply(inner, kernel), paired], axis=1), slope, found


class Drift(NamedTuple):
    """How far the entries of G″ may be off anywhere in B boxes: those of θ and θ, and those of θ and w, (B, M) each."""

    turned: Array
    mixed: Array

    def along(self, gain: Array, theta: Array, kernel: Array) -> tuple[Array, Array]:
        """gain · (G″ − G″(x₀)) along moves with |θ|₁ and |w|₁ (B,), by each θ and by each w, gain (B, K, M): (B, K)."""
        by_theta = self.turned * theta[:, None] + self.mixed * kernel[:, None]
        return apply(gain, by_theta), apply(gain, self.mixed * theta[:, None])


def drift(problem: Problem, values: Values, box: Array) -> Drift:
    """Over boxes |x − x₀| ≤ box (B, N)."""
    system = problem.system
    turn, spread = box[:, : system.n_free], box[:, system.n_free :].sum(axis=1)[:, None]
    third = third_bound(problem, values.theta, values.arms, turn)
    bent = third * turn.sum(axis=1)[:, None]
    weight = np.abs(values.kernel).sum(axis=1)[:, None] + spread
    none = np.zeros((len(box), 1))
    return Drift(
        np.concatenate([bent, bent * weight + third * spread, none], axis=1),
        np.concatenate([np.zeros_like(bent), bent, none], axis=1),
    )
