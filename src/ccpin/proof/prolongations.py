"""Prolonged systems F(x) = 0, whose zeros are singular configurations and cusps, and the lemma that proves them.

F, how far F′ drifts from x₀, and what rounds are stated in `ccpin/proof/theorems/extended.md`. Claims about zeros are
in `zeros`; Newton's method, which proposes them, uses the same F.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, apply, inverses, rows_of
from ccpin.proof.equations import Closures, Derivatives, third_along, third_bound
from ccpin.proof.rounding import SLACK, UNIT_ROUNDOFF

_RADII = (2.0, 8.0, 64.0)  # of the last Newton step's length: tried in turn, the least that is proved is the error


class ProlongedPoint(NamedTuple):
    """x and what F needs there, of B points.

    Attributes:
        theta: θ, of shape (B, n′).
        size: What bounds |θ| and the terms that it was added up from, of shape (B, n′).
        kernel: v, or v and w, of shape (B, p, m).
        values: φ and its derivatives.
    """

    theta: Array
    size: Array
    kernel: Array
    values: Derivatives


class Prolongation(NamedTuple):
    """F about B lines or planes q = q₀ + D s, of the order p that s has: x = (s, y, v) for p = 1, (s, y, v, w) for 2.

    Attributes:
        equations: φ.
        origin: q₀, of shape (B, n).
        directions: D, of shape (B, n, p).
        pairing: l, entries in [−1, 1], of shape (B, m).
    """

    equations: Closures
    origin: Array
    directions: Array
    pairing: Array

    @property
    def order(self) -> int:
        """p, which is 1 or 2."""
        return int(self.directions.shape[2])

    @property
    def unknowns(self) -> int:
        """The size of x."""
        return self.order + self.equations.system.m * (1 + self.order)

    def take(self, rows: Indices) -> Prolongation:
        """F about some of the planes."""
        return self._replace(origin=self.origin[rows], directions=self.directions[rows], pairing=self.pairing[rows])

    def theta(self, x: Array) -> Array:
        """θ at x (B, unknowns), of shape (B, n′)."""
        system, p = self.equations.system, self.order
        theta = np.empty((len(x), system.n_free))
        theta[:, system.independent] = self.origin + apply(self.directions, x[:, :p])
        theta[:, system.dependent] = x[:, p : p + system.m]
        return theta

    def at(self, x: Array, derive: Callable[[Array], Derivatives]) -> ProlongedPoint:
        """What F needs at x (B, unknowns), φ's derivatives by a function of θ."""
        system, theta = self.equations.system, self.theta(x)
        size = np.abs(theta)
        size[:, system.independent] = np.abs(self.origin) + apply(np.abs(self.directions), np.abs(x[:, : self.order]))
        kernel = x[:, self.order + system.m :].reshape(len(x), self.order, system.m)
        return ProlongedPoint(theta, size, kernel, derive(theta))

    def value(self, point: ProlongedPoint) -> Array:
        """F, of shape (B, unknowns)."""
        inner = point.values.jacobian[:, :, self.equations.system.dependent]
        along = np.sum(self.pairing[:, None] * point.kernel, axis=2, keepdims=True)
        parts = [point.values.phi, apply(inner, point.kernel[:, 0]), along[:, 0] - 1.0]
        if self.order == 2:
            v, w = point.kernel[:, 0], point.kernel[:, 1]
            curved = apply(self._along(point.values.hessian, v)[:, :, self.equations.system.dependent], v)
            parts += [curved + apply(inner, w), along[:, 1]]
        return np.concatenate(parts, axis=1)

    def slope(self, point: ProlongedPoint) -> Array:
        """F′, of shape (B, unknowns, unknowns)."""
        system, hessian = self.equations.system, point.values.hessian
        blocks = [point.values.jacobian, self._along(hessian, point.kernel[:, 0])]
        if self.order == 2:
            v = np.zeros_like(point.theta)
            v[:, system.dependent] = point.kernel[:, 0]
            third = apply(third_along(self.equations, point.theta, v), v[:, None])
            blocks.append(third + self._along(hessian, point.kernel[:, 1]))
        return self._assembled(blocks, self.directions, self.pairing)

    def drift(self, point: ProlongedPoint, radius: Array) -> Array:
        """Δ for radii (B,), of the shape of F′."""
        m, dependent = self.equations.system.m, self.equations.system.dependent
        r, hessian = radius[:, None, None], np.abs(point.values.hessian)
        box = np.repeat(radius[:, None], point.theta.shape[1], axis=1)
        box[:, self.equations.system.independent] *= np.abs(self.directions).sum(axis=2)
        third = third_bound(self.equations, point.theta, point.values.arms, box)[:, :, None]
        moved, sizes = third * box.sum(axis=1)[:, None, None], np.abs(point.kernel).sum(axis=2)
        v, *more = (sizes[:, k, None, None] + m * r for k in range(self.order))
        partial = hessian[..., dependent].sum(axis=3) * r
        blocks = [apply(hessian + moved[..., None], box[:, None]), partial + moved * v]
        blocks += [moved * v**2 + third * (2.0 * m * r * v) + partial + moved * w for w in more]
        return self._assembled(blocks, np.abs(self.directions), np.zeros_like(self.pairing))

    def rounding(self, point: ProlongedPoint) -> Array:
        """What the entries of F′ may be off by, of their shape."""
        unit = np.broadcast_to(self.equations.rounding(point.size)[:, None, None], point.values.jacobian.shape)
        v, *more = (1.0 + np.abs(k).sum(axis=1)[:, None, None] for k in np.swapaxes(point.kernel, 0, 1))
        blocks = [unit, unit * v, *(unit * (2.0 * v**2 + w) for w in more)]
        return self._assembled(blocks, np.abs(self.directions), np.zeros_like(self.pairing))

    def proved_within(self, point: ProlongedPoint) -> Array:
        """The r of the lemma, of shape (B,); NaN where none of those tried will do."""
        weight = 1.0 + np.abs(point.kernel).sum(axis=(1, 2))

        def drift(rows: Indices, radius: Array) -> Array:
            return self.take(rows).drift(rows_of(point, rows), radius)

        return proved_within(self.value(point), self.slope(point), weight, self.rounding(point), drift)

    def _along(self, hessian: Array, v: Array) -> Array:
        """φ_θy v for v (B, m), of shape (B, m, n′)."""
        return np.asarray((hessian[..., self.equations.system.dependent] @ v[:, None, :, None])[..., 0])

    def _assembled(self, blocks: Sequence[Array], directions: Array, pairing: Array) -> Array:
        """F′ of φ_θ, φ_θθ v and φ_θθθ v v + φ_θθ w (B, m, n′)."""
        system, m = self.equations.system, self.equations.system.m
        inner = [block[:, :, system.dependent] for block in blocks]
        columns = [
            np.concatenate([block[:, :, system.independent] @ directions, own], axis=2)
            for block, own in zip(blocks, inner, strict=True)
        ]
        size = columns[0].shape[2]
        result = np.zeros((len(pairing), size + self.order * m, size + self.order * m))
        result[:, :m, :size] = columns[0]
        for k in range(1, self.order + 1):
            rows, own = slice(k * (m + 1) - 1, k * (m + 1) - 1 + m), slice(size + (k - 1) * m, size + k * m)
            result[:, rows, :size], result[:, rows, own] = columns[k], inner[0]
            result[:, rows.stop, own] = pairing
        if self.order == 2:
            result[:, -1 - m : -1, size : size + m] = 2.0 * inner[1]
        return result


def proved_within(
    value: Array, slope: Array, weight: Array, rounding: Array, drift: Callable[[Indices, Array], Array]
) -> Array:
    """The r of the lemma at B points, of shape (B,); NaN where none of those tried will do.

    Args:
        value: F(x₀), of shape (B, unknowns).
        slope: F′(x₀), of shape (B, unknowns, unknowns).
        weight: By how much the rounding of φ counts in F, of shape (B,).
        rounding: The rounding error of the entries of F′, of the shape of `slope`.
        drift: Δ of some of the points for radii, (K, unknowns, unknowns) for (K,) and (K,).
    """
    inverse, count = inverses(slope), slope.shape[1]
    size = np.abs(inverse)
    wrong = np.broadcast_to((weight * (rounding.max(axis=(1, 2)) + 4.0 * UNIT_ROUNDOFF))[:, None], value.shape)
    wrong = wrong + 8.0 * count * UNIT_ROUNDOFF * np.abs(value)
    left = np.max(np.abs(apply(inverse, value)) + apply(size, wrong), axis=1)
    defect = np.abs(np.eye(count) - inverse @ slope) + size @ (rounding + 8.0 * count * UNIT_ROUNDOFF * np.abs(slope))
    found, rows = np.full(len(slope), np.nan), np.flatnonzero(np.isfinite(left))
    for factor in _RADII:
        radius = factor * left[rows]
        kappa = (defect[rows] + size[rows] @ drift(rows, radius)).sum(axis=2).max(axis=1)
        proved = (left[rows] * SLACK + kappa * SLACK * radius < radius) & (kappa * SLACK < 1.0)
        found[rows[proved]] = radius[proved]
        rows = rows[~proved]
        if not rows.size:
            break
    return found
