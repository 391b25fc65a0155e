"""Curves followed from tube to tube, by prediction and Newton's method; each tube proved, and glued to the next."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Mask, apply, joined, rows_of, solve_many
from ccpin.proof.curves.curve_equations import Values, first_order, values_at
from ccpin.proof.curves.tubes import Points, Tubes, bounds_of, certify_tubes, frames_at, glued, places_in
from ccpin.proof.equations import Problem

_FIRST = np.geomspace(0.4, 1e-4, 40)  # half lengths tried for a first tube: nothing is known of the curve
_NEXT = np.array([1.5, 1.25, 1.1, 1.0, 0.9, 0.8, 0.65, 0.5, 0.35, 0.2, 0.1])  # for a next one, of the last one's
_LEAST = 1e-5  # of half lengths: `MOST_TUBES` as short follow a curve for 0.4 rad
_STEPS = 6  # of Newton's method back onto the curve, from its tangent less than a tube's length on
_ON = (0.95, 0.6, 0.3)  # of a tube's half length: where the next one is centred
_SAME = 1e-9  # half width of the box about the first middle that a tube must hold if the curve is to have returned
_SHAPED = 2  # passes that bring the radii into the proportions of what Z leaves of them
_SETTLED, _FAR = 1e-7, 1.0  # rad, m: a step's length after which its square is left; longer ones are not taken
MOST_TUBES = 20_000
"""Of one curve."""


class TubeChain(NamedTuple):
    """Tubes glued one behind the other, s growing along them, and whether the last is glued to the first."""

    tubes: Tubes
    closed: bool


def follow(problem: Problem, theta: Array, kernel: Array, going: Callable[[Tubes], bool]) -> TubeChain | None:
    """The curve through a singular configuration, both ways; ``None`` where no tube is proved about that.

    Args:
        problem: The closures.
        theta: The configuration, of shape (n′,).
        kernel: Its kernel, of unit length, of shape (m,).
        going: Asked of each tube (T = 1) whether the curve is wanted beyond it.
    """
    first = _tube_at(problem, theta, kernel, _FIRST, None)
    if first is None:
        return None
    return _both_ways(problem, [first], going)


def prolonged(problem: Problem, chain: TubeChain, going: Callable[[Tubes], bool]) -> TubeChain:
    """A chain that was cut short, followed on as by `follow`."""
    if chain.closed:
        return chain
    return _both_ways(problem, [rows_of(chain.tubes, slice(k, k + 1)) for k in range(len(chain.tubes.half))], going)


def _both_ways(problem: Problem, tubes: list[Tubes], going: Callable[[Tubes], bool]) -> TubeChain:
    """The chain that begins with some tubes, each glued to the next."""
    ahead, closed = _one_way(problem, tubes, going)
    if closed:
        return TubeChain(joined(ahead), True)
    behind, closed = _one_way(problem, [tube.turned() for tube in reversed(ahead)], going)
    return TubeChain(joined([tube.turned() for tube in reversed(behind)]), closed)


def _tube_at(problem: Problem, theta: Array, kernel: Array, sizes: Array, forward: Array | None) -> Tubes | None:
    return longest(problem, values_at(problem, theta[None], kernel[None], kernel[None]), sizes, forward)


def _one_way(problem: Problem, tubes: list[Tubes], going: Callable[[Tubes], bool]) -> tuple[list[Tubes], bool]:
    """Tubes and those that follow as s grows, and whether they return to the first."""
    first, tubes = tubes[0], list(tubes)
    start = Points(first.x, np.full_like(first.x, _SAME))
    while len(tubes) < MOST_TUBES and going(tubes[-1]):
        following = _next(problem, tubes[-1])
        if following is None:
            break
        tubes.append(following)
        back = places_in(problem, start, following)
        if back.inside[0] and back.s[0] > 0.0 and bool(glued(problem, following, first)[0]):
            return tubes, True
    return tubes, False


def _next(problem: Problem, tube: Tubes) -> Tubes | None:
    """The next tube, centred on the curve near the end of one and glued to it; ``None`` where none is proved."""
    size = problem.system.n_free
    for part in _ON:
        ahead = tube.x + part * tube.half[:, None] * tube.tangent
        theta, kernel, settled = onto_curves(problem, ahead[:, :size], ahead[:, size:], _STEPS)
        if not settled[0]:
            continue
        sizes = np.maximum(tube.half[0] * _NEXT, _LEAST)
        found = _tube_at(problem, theta[0], kernel[0], sizes, tube.tangent[0])
        if found is not None and bool(glued(problem, tube, found)[0]):
            return found
    return None


def longest(problem: Problem, values: Values, sizes: Array, forward: Array | None = None) -> Tubes | None:
    """About one point of a curve the tube of greatest length of those tried (K,); ``None`` where none is proved.

    Its s grows along `forward` (N,), if given. The radii are at most δ, and in proportion to what Z leaves of them.
    """
    frames = frames_at(values.slope, forward)
    if not np.isfinite(frames.gain).all():
        return None
    rows = np.zeros(len(sizes), dtype=np.intp)
    values, frames = rows_of(values, rows), rows_of(frames, rows)
    inner = np.arange(values.slope.shape[2])[None] != frames.along[:, None]
    shape = np.where(inner, 1.0, 0.0)
    with np.errstate(all="ignore"):
        for _ in range(_SHAPED):
            bounds = bounds_of(problem, values, frames, sizes, shape * sizes[:, None])
            image = bounds.y + apply(bounds.z, shape * sizes[:, None])
            shape = shape + image / image.max(axis=1, keepdims=True)
            shape = shape / shape.max(axis=1, keepdims=True)
    found = certify_tubes(problem, values, frames, sizes, shape * sizes[:, None])
    best = np.flatnonzero(found.proved)
    return found.tubes.take(best[[int(np.argmax(sizes[best]))]]) if best.size else None


def onto_curves(problem: Problem, theta: Array, kernel: Array, steps: int) -> tuple[Array, Array, Mask]:
    """θ and unit w after Newton steps of least norm from θ (B, n′) and w (B, m), and which have settled (B,)."""
    size, settled = problem.system.n_free, np.zeros(len(theta), dtype=np.bool_)
    for _ in range(steps):
        kernel = kernel / np.maximum(np.linalg.norm(kernel, axis=1, keepdims=True), 1e-300)
        value, slope, _ = first_order(problem, theta, kernel, kernel)
        flat = np.swapaxes(slope, 1, 2)
        move = -apply(flat, solve_many(slope @ flat, value))
        length = np.abs(move).max(axis=1)
        usable = np.isfinite(length) & (length < _FAR)
        theta = theta + np.where(usable[:, None], move[:, :size], 0.0)
        kernel = kernel + np.where(usable[:, None], move[:, size:], 0.0)
        settled = usable & (length < _SETTLED)
        if settled.all():
            break
    return theta, kernel / np.linalg.norm(kernel, axis=1, keepdims=True), settled
