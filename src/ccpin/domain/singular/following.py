"""Curves followed from tube to tube, by prediction and Newton's method; each tube proved, and glued to the next."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, joined, rows_of
from ccpin.domain.singular.curve_equations import onto_curves, values_at
from ccpin.domain.singular.tubes import Points, Tubes, glued, longest, places_in
from ccpin.proof.equations import Problem

_FIRST = np.geomspace(0.4, 1e-4, 40)
_NEXT = np.array([1.5, 1.25, 1.1, 1.0, 0.9, 0.8, 0.65, 0.5, 0.35, 0.2, 0.1])
_LEAST = 1e-5
_STEPS = 6
_ON = (0.95, 0.6, 0.3)  # of a tube's half length: where the next one is centred
_SAME = 1e-9
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
