"""The exact closed configuration near a computed one, searched for: what is found, `ClosedStart` proves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.errors import ConvergenceError
from ccpin.proof.facts import Fact, NotProvedError, prove
from ccpin.validated.arithmetic.balls import Ball, around, ball, upper
from ccpin.validated.arithmetic.exact_numbers import ExactBox, boxed
from ccpin.validated.flow.closing import assembled, krawczyk, residual_of, slopes_of
from ccpin.validated.flow.start_claim import ClosedStart
from ccpin.validated.loop_equations import ClosedLoopEquations

_NEWTON_STEPS = 20  # at most, of Newton's method and of sharpening: they propose, Krawczyk's operator proves
_UNIQUE = (1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 1e-10)  # rad or m: radii within which uniqueness is tried, the largest first
_OPEN = (
    "no closed configuration is proven to exist near the computed start; pass a q and near= on a closed, "
    "nonsingular configuration, or raise the precision"
)


class ClosedNear(NamedTuple):
    """A box of y in which there is one solution, and a smaller one that holds it.

    Attributes:
        y: The centre of both.
        radius, sharp: Their half-widths, doubles (rad or m).
    """

    y: list[Ball]
    radius: list[float]
    sharp: list[float]


def proved_start(loop: ClosedLoopEquations, q: ExactBox, x: Array, v: Array, precision: int) -> Fact:
    """The fact about the one closed state near the computed x at every q of a box, at a velocity.

    Raises:
        ConvergenceError: It is not proven; most likely x is open or nearly singular.
    """
    near = closed_near(loop, q.balls(), x)
    y, computed = boxed(near.y, precision).parts, x[list(loop.dependent)]
    radius, sharp = np.array(near.radius), np.array(near.sharp)
    try:
        return prove(ClosedStart(loop, *q, y, radius, sharp, computed, v, np.array([precision])))
    except NotProvedError as refused:
        raise ConvergenceError(f"{_OPEN} ({refused})") from None


def closed_start(loop: ClosedLoopEquations, q: Sequence[Ball], x: Array) -> list[Ball]:
    """The one closed configuration near the computed x at every q of a box, as a box as small as the precision gives.

    Raises:
        ConvergenceError: As for `proved_start`.
    """
    near = closed_near(loop, q, x)
    box = krawczyk(loop, q, near.y, [ball(r) for r in near.sharp])
    assert box is not None, "it was proven so"
    return assembled(loop, q, box)


def closed_near(loop: ClosedLoopEquations, q: Sequence[Ball], x: Array) -> ClosedNear:
    """Boxes of y near the computed one, at most 1e-2 (rad or m) off: the largest of a few radii that does.

    Raises:
        ConvergenceError: None does.
    """
    near, y = _newton(loop, q, x)
    far = max((abs(a - b).upper() for a, b in zip(y, near, strict=True)), default=ball(0))
    for radius in _UNIQUE:
        proven = krawczyk(loop, q, y, [ball(radius)] * len(y))
        if proven is not None and far < radius:
            whole = [radius] * len(y)
            return ClosedNear(y, whole, _sharpened(loop, q, y, proven, whole))
    raise ConvergenceError(_OPEN)


def unique_there(loop: ClosedLoopEquations, q: Sequence[Ball], box: Sequence[Ball], x: Array) -> bool:
    """Whether a box of closed configurations belongs to the branch of the computed x: q is one box for both."""
    near, y = _newton(loop, q, x)
    for radius in _UNIQUE:
        reach = [ball(radius)] * len(y)
        inside = all(
            around(centre, ball(radius)).contains(box[k]) and abs(centre - start) < radius
            for centre, start, k in zip(y, near, loop.dependent, strict=True)
        )
        if inside and krawczyk(loop, q, y, reach) is not None:
            return True
    return False


def _sharpened(
    loop: ClosedLoopEquations, q: Sequence[Ball], y: Sequence[Ball], proven: list[Ball], known: list[float]
) -> list[float]:
    """Radii for which Krawczyk's operator still maps into itself: of its own image, inflated, while that shrinks it.

    A coordinate whose image is a point, as a coupling makes it, keeps a square of its radius: nothing is inside of 0.
    """
    for _ in range(_NEWTON_STEPS):
        radius = [max(0.5 * upper(abs(b - c)), r * r) for b, c, r in zip(proven, y, known, strict=True)]
        image = krawczyk(loop, q, y, [ball(r) for r in radius])
        if image is None:
            return known
        proven, known = image, radius
    return known


def _newton(loop: ClosedLoopEquations, q: Sequence[Ball], x: Array) -> tuple[list[Ball], list[Ball]]:
    """The computed y, and y after Newton's method at the centre of q: a start for the proof, not a proof."""
    near = [ball(float(x[k])) for k in loop.dependent]
    centre, y = [part.mid() for part in q], near
    for _ in range(_NEWTON_STEPS if y else 0):
        try:
            step = slopes_of(loop, centre, y).mid().inv() * residual_of(loop, centre, y)
        except ZeroDivisionError:
            break
        y = [(a - b).mid() for a, b in zip(y, step.entries(), strict=True)]
    return near, y
