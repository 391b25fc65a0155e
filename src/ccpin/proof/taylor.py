"""Taylor bounds, of any equations with two derivatives at a centre and a bound of the third over boxes.

Notation is that of Theorem N (`theorems/theorem_n.md`): x = c + Dδ + Eζ, L = |D|h, X = L + |E|R, C = AG″(c), e_k the
columns of [D, E]; T(x, y, z) ≥ |A G‴[x, y, z]| over a box is `DriftBound`. Then

    Y  = |AG| + |AG′D|h + ½ Σ |d_kᵀ C d_l| h_k h_l + ⅙ T_L(L, L, L),
    Z  = |I − AG′E| + Σ_k |Eᵀ C e_k| (h, R)_k + ½ T_X(X, X, |E|),
    Z̄  = the same with R/2 for R, and ½ (T_X(L, L, ·) + T_X(L, r, ·) + ⅓ T_X(r, r, ·)), r = |E|R,

as ∫ (1 − t)²/2 dt = ⅙ and ∫ (L + tr)² dt = L² + Lr + ⅓r². Signs are kept until a product with D or E is formed. Only
products of the third-order terms with vectors are formed: Z̄R and Zw are what (N1) and (N2) ask for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from ccpin.arrays import Array, Indices, apply, rows_of
from ccpin.proof.bounds import Contraction, Frame, Image, LinearPart, Rows, linear_part
from ccpin.proof.tips import layers

Form = Callable[[Array, Array, Array], Array]


class Pattern:
    """Which entries of a second derivative are not always zero, and how they are multiplied with vectors.

    Attributes:
        row, pair: Which row of G an entry is of, and of which pair of unknowns, of shape (L,) each.
        first, other: The unknowns of a pair, of shape (Q,) each; an entry stands for its mirror image too.
    """

    def __init__(self, row: Indices, pair: Indices, first: Indices, other: Indices, unknowns: int) -> None:
        self.row, self.pair, self.first, self.other = row, pair, first, other
        a, b, entry = first[pair], other[pair], np.arange(len(pair))
        off = np.flatnonzero(a != b)
        to = np.concatenate([row, row[off]]) * unknowns + np.concatenate([a, b[off]])
        order = np.argsort(to, kind="stable")
        self._entry, self._times = np.concatenate([entry, off])[order], np.concatenate([b, a[off]])[order]
        self._to, count = np.unique(to, return_counts=True)
        self._layers = layers(count)

    def dense(self, values: Array, size: int) -> Array:
        """Entries (L, B) by row and pair, of shape (B, M, Q)."""
        result = np.zeros((values.shape[1], size, len(self.first)))
        result[:, self.row, self.pair] = values.T
        return result

    def along(self, values: Array, vectors: Array, size: int) -> Array:
        """G″v for the columns v of a matrix (B, N, k), of shape (B, M, N, k)."""
        count, unknowns, k = vectors.shape
        product = values[self._entry][:, None] * np.ascontiguousarray(np.transpose(vectors, (1, 2, 0)))[self._times]
        total = product[self._layers[0][1]]
        for to, layer in self._layers[1:]:
            total[to] += product[layer]
        result = np.zeros((count, size * unknowns, k))
        result[:, self._to] = np.transpose(total, (2, 0, 1))
        return result.reshape(count, size, unknowns, k)


class Point(NamedTuple):
    """Equations at B centres, every entry within `rounding` of the exact one.

    Attributes:
        value: G, of shape (B, M).
        slope: G′, of shape (B, M, N).
        second: The entries of G″, of shape (L, B), by `pattern`.
        rounding: Of shape (B,).
    """

    value: Array
    slope: Array
    second: Array
    pattern: Pattern
    rounding: Array


class DriftBound(Protocol):
    """A bound of the third derivatives of AG over boxes about B centres."""

    def over(self, box: Array) -> Form:
        """T ≥ |A G‴[x, y, z]| (B, M) of nonnegative x, y, z (B, N) wherever |x − c| ≤ box (B, N)."""

    def take(self, rows: Rows) -> DriftBound:
        """That of some of the centres."""


class _Selected(NamedTuple):
    """|N| in the modes where E selects coordinates: entries (B, M, Q′) and which modes they belong to, (Q′,) each."""

    entries: Array
    first: Indices
    second: Indices

    def times(self, radius: Array) -> Array:
        """Σ_k |N|_ek R_k, of shape (B, M, M)."""
        count, places = len(radius), np.arange(len(self.first))
        widths = np.zeros((count, len(places), radius.shape[1]))
        widths[:, places, self.first] = radius[:, self.second]
        widths[:, places, self.second] = radius[:, self.first]
        return np.asarray(self.entries @ widths)

    def take(self, rows: Rows) -> _Selected:
        return self._replace(entries=self.entries[rows])


class _Mixed(NamedTuple):
    """|N| in the modes, of shape (B, M, M, M), for any E."""

    entries: Array

    def times(self, radius: Array) -> Array:
        return np.asarray((self.entries @ radius[:, None, :, None])[..., 0])

    def take(self, rows: Rows) -> _Mixed:
        return _Mixed(self.entries[rows])


@dataclass(frozen=True, eq=False)
class TaylorBounds:
    """Taylor bounds of B boxes (`Bounds`).

    Attributes:
        linear: The shared part.
        y: Y, of shape (B, M).
        across: Σ_k |Eᵀ C d_k| h_k, of shape (B, M, M).
        mixed: |Eᵀ C e_k| for the columns of E.
        drift: T.
    """

    linear: LinearPart
    y: Array
    across: Array
    mixed: _Selected | _Mixed
    drift: DriftBound

    def take(self, rows: Rows) -> TaylorBounds:
        """See `Bounds`."""
        linear, mixed, drift = rows_of(self.linear, rows), self.mixed.take(rows), self.drift.take(rows)
        return TaylorBounds(linear, self.y[rows], self.across[rows], mixed, drift)

    def mean(self, radius: Array) -> Image:
        """See `Bounds`."""
        moves, widths = self.linear.moves, self.linear.widths(radius)
        third = self.drift.over(moves + widths)
        rest = third(moves, moves, widths) + third(moves, widths, widths) + third(widths, widths, widths) / 3.0
        return Image(self._matrix(widths, 0.5 * radius), 0.5 * rest)

    def contraction(self, radius: Array) -> Contraction:
        """See `Bounds`."""
        widths = self.linear.widths(radius)
        box = self.linear.moves + widths
        third = self.drift.over(box)
        return Contraction(
            self._matrix(widths, radius), lambda weight: 0.5 * third(box, box, self.linear.widths(weight))
        )

    def curvature(self, radius: Array, weight: Array) -> Array:
        """See `Bounds`."""
        box, turn = self.linear.moves + self.linear.widths(radius), self.linear.widths(weight)
        second = apply(self.mixed.times(weight), weight) + self.drift.over(box)(box, turn, turn)
        return np.asarray(second + self.linear.curvature_margin(weight))

    def _matrix(self, widths: Array, radius: Array) -> Array:
        return np.asarray(self.linear.affine(widths) + self.across + self.mixed.times(radius))


def taylor_bounds(point: Point, frame: Frame, drift: DriftBound) -> TaylorBounds:
    """Taylor bounds of boxes centred at a point."""
    rows, (count, size, p) = point.value.shape[1], frame.directions.shape
    linear, lines = linear_part(frame, point.value, point.slope), frame.directions * frame.half[:, None]
    bent = point.pattern.along(point.second, lines, rows).reshape(count, rows, size * p)
    along = (frame.preconditioner @ bent).reshape(count, rows, size, p)
    square = np.abs(np.swapaxes(lines, 1, 2)[:, None] @ along).reshape(count, rows, p * p) @ np.ones(p * p)
    chosen = selected(frame.modes)
    if chosen is None:
        mixed: _Selected | _Mixed = _mixed(point, frame)
        across = np.abs(np.swapaxes(frame.modes, 1, 2)[:, None] @ along) @ np.ones(p)
    else:
        mixed = _selected(point, frame, chosen)
        across = (np.abs(along) @ np.ones(p))[:, :, chosen]
    y = linear.constant + 0.5 * square + drift.over(linear.moves)(linear.moves, linear.moves, linear.moves) / 6.0
    return TaylorBounds(linear, y, across, mixed, drift)


def _mixed(point: Point, frame: Frame) -> _Mixed:
    rows, (count, size, modes) = point.value.shape[1], frame.modes.shape
    bent = point.pattern.along(point.second, frame.modes, rows).reshape(count, rows, size * modes)
    along = (frame.preconditioner @ bent).reshape(count, rows, size, modes)
    return _Mixed(np.abs(np.swapaxes(frame.modes, 1, 2)[:, None] @ along))


def _selected(point: Point, frame: Frame, chosen: Indices) -> _Selected:
    pattern, place = point.pattern, np.full(frame.modes.shape[1], -1)
    place[chosen] = np.arange(len(chosen))
    first, other = place[pattern.first], place[pattern.other]
    both = np.flatnonzero((first >= 0) & (other >= 0))
    entries = frame.preconditioner @ pattern.dense(point.second, point.value.shape[1])[:, :, both]
    return _Selected(np.abs(entries), first[both], other[both])


def selected(modes: Array) -> Indices | None:
    """The coordinates that the columns of E (B, N, M) are, if these are the same unit vectors in all boxes."""
    if not len(modes):
        return None
    rows = np.argmax(modes[0], axis=0)
    unit = np.zeros(modes.shape[1:])
    unit[rows, np.arange(len(rows))] = 1.0
    alike = len(set(rows.tolist())) == len(rows) and np.array_equal(modes, np.broadcast_to(unit, modes.shape))
    return rows if alike else None
