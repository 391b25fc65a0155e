"""Boxes of all coordinates, each shown to hold no singular configuration, or none but those of the tubes beside it.

Lemma W and Proposition B are stated and proved in `ccpin/proof/theorems/covering.md`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ccpin.arrays import Array, Indices, Mask, apply, rows_of, solve_many
from ccpin.proof.curves.curve_equations import first_order, values_at
from ccpin.proof.curves.tubes import Frames, Points, Tubes, bounds_of, inverse_without, places_in, tangents_at
from ccpin.proof.equations import Problem, derivatives, third_bound
from ccpin.proof.narrowing import Candidates, directions
from ccpin.proof.newton import without_turns
from ccpin.proof.rounding import SLACK, TURN, blur

_BESIDE, _ABOUT = 3, 8  # tubes by distance that are tried for a box, and, at less cost, for a point
_WORTH = 2.5  # half lengths: wider boxes are in no tube, and seldom shown to be empty
_ROOM, _LEAST = 1.0 + 1e-6, 1e-9  # of u: components of w may be 0, as those of rotors that bend nothing are
_PASSES, _GAIN = 2, 0.7  # and what radius a second pass is worth after


class Nearby:
    """Tubes, and which of them are the nearest to configurations."""

    def __init__(self, problem: Problem, tubes: Tubes) -> None:
        self.problem, self.tubes = problem, tubes
        self._size = np.where(problem.system.periodic, TURN, 0.0)
        self._tree = cKDTree(self._folded(tubes.theta), boxsize=self._size)

    def of(self, theta: Array, most: int) -> Indices:
        """The nearest tubes to θ (B, n′), the nearest first, of shape (B, up to `most`)."""
        count = min(most, len(self.tubes.half))
        found = self._tree.query(self._folded(theta), k=np.arange(1, count + 1))[1]
        return np.asarray(found, dtype=np.intp)

    def _folded(self, theta: Array) -> Array:
        turned = np.where(self._size > 0.0, np.remainder(theta, TURN), theta)
        return np.where((self._size > 0.0) & (turned >= TURN), 0.0, turned)

    def hold(self, points: Points) -> Mask:
        """Whether points x lie in one of the tubes nearest to them, of shape (B,)."""
        held = np.zeros(len(points.x), dtype=np.bool_)
        for nearest in self.of(points.x[:, : self.problem.system.n_free], _ABOUT).T:
            held |= places_in(self.problem, points, self.tubes.take(nearest)).inside
        return held

    def beside(self, boxes: Candidates) -> Beside:
        """The tubes nearest to boxes, and which of the boxes are so narrow that one of them may settle each."""
        nearest, wide = self.of(boxes.centre, _BESIDE), extents(self.problem, boxes).max(axis=1, initial=0.0)
        return Beside(nearest, np.any(wide[:, None] <= _WORTH * self.tubes.half[nearest], axis=1))


class Beside(NamedTuple):
    """Of K boxes the tubes nearest to each, the nearest first (K, k), and whether they are worth a try (K,)."""

    nearest: Indices
    worth: Mask


def settled_beside(problem: Problem, boxes: Candidates, tubes: Tubes, nearest: Indices) -> Mask:
    """Which boxes are proved to hold no singular configurations but those of one of the tubes nearest to each, (K,).

    Args:
        problem: The closures.
        boxes: The boxes.
        tubes: Tubes.
        nearest: Which of them are nearest to each box, the nearest first, of shape (K, k).
    """
    done, extent = np.zeros(len(boxes.cell), dtype=np.bool_), extents(problem, boxes)
    wide = extent.max(axis=1, initial=0.0)
    for number, beside in enumerate(nearest.T):
        worth = ~done & (wide <= _WORTH * tubes.half[beside])
        if number:  # that a box is empty was tried
            worth &= _may_hold(problem, boxes.centre, extent, tubes, beside)
        rows = np.flatnonzero(worth)
        if rows.size:
            done[rows] = settled(problem, rows_of(boxes, rows), tubes.take(beside[rows]))
    return done


def _may_hold(problem: Problem, theta: Array, extent: Array, tubes: Tubes, beside: Indices) -> Mask:
    """Whether boxes |θ − θ_c| ≤ extent are short enough, and so placed, that the tube beside each may hold it, (B,)."""
    rows, along = np.arange(len(theta)), np.minimum(tubes.along[beside], theta.shape[1] - 1)
    gap = without_turns(theta - tubes.theta[beside], problem.system.periodic)
    reach = np.abs(gap[rows, along]) + extent[rows, along]
    return np.asarray((reach <= tubes.half[beside]) | (along != tubes.along[beside]))


def settled(problem: Problem, boxes: Candidates, tubes: Tubes) -> Mask:
    """Which boxes are proved to hold no singular configurations but those of the tube beside each, (K,)."""
    with np.errstate(all="ignore"):
        kernel, spread = kernels(problem, boxes, tubes.pairing)
        known = np.flatnonzero(np.isfinite(spread).all(axis=1))
        done = np.zeros(len(spread), dtype=np.bool_)
        if known.size:
            extent = np.concatenate([extents(problem, boxes)[known], spread[known]], axis=1)
            theta = boxes.centre[known]
            done[known] = _drawn(problem, theta, kernel[known], extent, tubes.take(known))
    return done


def extents(problem: Problem, boxes: Candidates) -> Array:
    """How far θ is from the boxes' centres at most, of shape (K, n′)."""
    system, found = problem.system, boxes.half.copy()
    found[:, system.dependent] += apply(np.abs(boxes.slopes), boxes.half[:, system.independent])
    return found * SLACK + 1e-15 * (1.0 + np.abs(boxes.centre))


def kernels(problem: Problem, boxes: Candidates, pairing: Array) -> tuple[Array, Array]:
    """w₀ and v of Lemma W with l (K, m), of shape (K, m) each; v is not finite where the lemma says nothing."""
    system, found = problem.system, derivatives(problem, boxes.centre)
    m, extent, margin = system.m, extents(problem, boxes), system.rounding * system.magnitude(boxes.centre)
    inner = found.jacobian[:, :, system.dependent]
    bordered = np.concatenate([inner, pairing[:, None]], axis=1)
    left = np.linalg.pinv(np.where(np.isfinite(bordered), bordered, 0.0))
    turned = found.hessian[:, :, system.dependent] @ directions(problem, boxes)[:, None]
    change = np.abs(turned) @ boxes.half[:, None, :, None]
    reach, third = extent.sum(axis=1)[:, None], third_bound(problem, boxes.centre, found.arms, extent)
    change = change[..., 0] * SLACK + (0.5 * third * reach**2 + margin[:, None] * (1.0 + reach) ** 2)[..., None]
    size = np.abs(left)
    defect = np.abs(np.eye(m) - left @ bordered) + size[:, :, :m] @ change
    defect += 4.0 * margin[:, None, None] * size.sum(axis=2)[:, :, None] * np.abs(pairing).sum(axis=1)[:, None, None]
    kernel = left[:, :, -1]
    most = solve_many(np.eye(m) - defect, np.abs(kernel) + _LEAST) * _ROOM
    spread = apply(defect, most)
    sound = np.all((most > 0.0) & (np.abs(kernel) + spread * SLACK <= most) & (spread * SLACK < most), axis=1)
    return kernel, np.where(sound[:, None], spread * SLACK, np.inf)


class _Slanted(NamedTuple):
    """Boxes x + s t + e, |s| ≤ half, |e| ≤ radius (0 in row j), of shapes (K, N), (K,), (K, N), (K,) and (K, N)."""

    x: Array
    along: Indices
    tangent: Array
    half: Array
    radius: Array


def _drawn(problem: Problem, theta: Array, kernel: Array, extent: Array, tubes: Tubes) -> Mask:
    """Proposition B, again and again, for boxes |x − (θ₀, w₀)| ≤ extent (K, N) and the tube beside each."""
    rows = np.arange(len(theta))
    along, tangent = tangents_at(first_order(problem, theta, kernel, tubes.pairing)[1])
    half = extent[rows, along]
    radius = (extent + np.abs(tangent) * half[:, None]) * SLACK
    radius[rows, along] = 0.0
    boxes = _Slanted(np.concatenate([theta, kernel], axis=1), along, tangent, half, radius)
    done = np.zeros(len(theta), dtype=np.bool_)
    for _ in range(_PASSES):
        empty, smaller = _narrowed(problem, boxes, tubes.take(rows))
        settled_now = empty | _inside(problem, smaller, tubes.take(rows))
        done[rows[settled_now]] = True
        going = ~settled_now & np.any(smaller.radius < _GAIN * boxes.radius, axis=1)
        rows, boxes = rows[going], rows_of(smaller, going)
        if not rows.size:
            break
    return done


def _narrowed(problem: Problem, boxes: _Slanted, tubes: Tubes) -> tuple[Mask, _Slanted]:
    """Which boxes are empty, and where in the others singular configurations are (Proposition B), l as the tubes."""
    rows, size = np.arange(len(boxes.x)), problem.system.n_free
    values = values_at(problem, boxes.x[:, :size], boxes.x[:, size:], tubes.pairing)
    frames = Frames(boxes.along, boxes.tangent, inverse_without(values.slope, boxes.along))
    bounds = bounds_of(problem, values, frames, boxes.half, boxes.radius)
    shift = -apply(frames.gain, values.value)
    left = (bounds.y - np.abs(shift) + apply(bounds.z, boxes.radius)) * SLACK + 1e-12 * bounds.y
    known = np.isfinite(left)
    low = np.where(known, np.maximum(shift - left, -boxes.radius), -boxes.radius)
    high = np.where(known, np.minimum(shift + left, boxes.radius), boxes.radius)
    low[rows, boxes.along], high[rows, boxes.along] = 0.0, 0.0
    x = boxes.x + 0.5 * (low + high)
    radius = 0.5 * (high - low) * SLACK + 1e-14 + blur(x)
    radius[rows, boxes.along] = 0.0
    return np.any(low > high, axis=1), boxes._replace(x=x, radius=radius)


def _inside(problem: Problem, boxes: _Slanted, tubes: Tubes) -> Mask:
    """Whether all of each box lies in the tube beside it, with the same l."""
    size, rows = problem.system.n_free, np.arange(len(boxes.x))
    gap = boxes.x - tubes.x
    gap[:, :size] = without_turns(gap[:, :size], problem.system.periodic)
    way = tubes.tangent[rows, tubes.along]
    s, run, wide = (array[rows, tubes.along] for array in (gap, boxes.tangent, boxes.radius))
    leaning = np.abs(boxes.tangent - tubes.tangent * (run * way)[:, None]) * boxes.half[:, None]
    off = np.abs(gap - tubes.tangent * (s * way)[:, None]) + leaning + boxes.radius
    off += np.abs(tubes.tangent) * wide[:, None] + 1e-13
    off[rows, tubes.along] = 0.0
    reach = np.abs(s) + np.abs(run) * boxes.half + wide + 1e-13
    return np.asarray((reach * SLACK <= tubes.half) & np.all(off * SLACK <= tubes.radius, axis=1))
