"""One validated step of x′ = f(x) from a box of starts, and the march from step to step.

A step is Theorem V of `ccpin/proof/theorems/step.md`, whose names c, r, p, d, B_k, M_k and e_k are used here. Every
quantity is computed in balls; f is analytic on B_k if each matrix that f inverts is proven invertible on B_k.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

from ccpin.validated.arithmetic.balls import Ball, around, ball, finite, flint, magnitude, upper
from ccpin.validated.arithmetic.series import NotInvertibleError, all_series, gradients
from ccpin.validated.arithmetic.tape import Program
from ccpin.validated.flow.defect import defect_along

QUANTUM = 2.0**-40  # steps are multiples, so that times are exact doubles
SHORTEST_STEP = 2.0**-20  # s: where no longer step is proved, the march ends
_BOX_PRECISION = 64  # bits; enough for boxes as wide as a step
_GROWTH = 1e3  # of the enclosure's width, in one step: more is refused
_SINGULAR = "ψ_q′, D or (of motors elsewhere than on the independent joints) ρᵀSᵀ is not proven nonsingular"

Quantity = Callable[[list[Ball]], float]


class Start(NamedTuple):
    """A box of states: exact centre and radii, balls of radius 0."""

    centre: list[Ball]
    radius: list[Ball]


class ProvenStep(NamedTuple):
    """A step proven.

    Attributes:
        length: h in seconds.
        polynomial: Coefficients of p, one list a component.
        remainder: The largest component of h d.
        error: Bound of |x(t) − p(t)| on [0, h], exact balls.
        boxes: A box around all solutions for each piece of [0, h].
        quantity: The smallest lower bound of the quantity watched on those boxes.
        end: The box of states at h.
    """

    length: float
    polynomial: list[list[Ball]]
    remainder: float
    error: list[Ball]
    boxes: list[list[Ball]]
    quantity: float
    end: Start

    def box(self, t: Ball) -> list[Ball]:
        """A box around the solutions at times (balls) since the step began."""
        return [around(x, e) for x, e in zip(evaluate(self.polynomial, t), self.error, strict=True)]


class StepOptions(NamedTuple):
    """How to step.

    Attributes:
        order: N.
        tolerance: Bound of h d asked of a step, in rad, m and per second.
        pieces: K; more pieces are slower and let errors and spreads grow less.
        shortest, longest: Bounds of h in seconds (the last step may be shorter).
    """

    order: int
    tolerance: float
    pieces: int
    shortest: float = SHORTEST_STEP
    longest: float = math.inf


class Stuck(NamedTuple):
    """No step of the shortest length could be proven; `reason` says what failed in the last attempt."""

    reason: str


class WatchedField(NamedTuple):
    """What is integrated: f, a quantity that must be positive on every box (as a lower bound), what else is asked.

    Attributes:
        program: f.
        quantity: The quantity.
        missing: What else is not proven on a box, in words.
    """

    program: Program
    quantity: Quantity
    missing: Callable[[Sequence[Ball]], str] = lambda _: ""


class _RefusedError(Exception):
    """A hypothesis of Theorem V that failed, in words."""


def start_of(box: Sequence[Ball]) -> Start:
    """A box as exact centre and radii."""
    return Start([x.mid() for x in box], [x.rad() for x in box])


def start_box(start: Start) -> list[Ball]:
    """Centre and radii as a box."""
    return [around(c, r) for c, r in zip(start.centre, start.radius, strict=True)]


def evaluate(polynomial: Sequence[Sequence[Ball]], t: Ball) -> list[Ball]:
    """p(t) by Horner's rule."""
    results = []
    for coefficients in polynomial:
        total = coefficients[-1]
        for coefficient in reversed(coefficients[:-1]):
            total = total * t + coefficient
        results.append(total)
    return results


def attempt(field: WatchedField, start: Start, series: Sequence[Any], length: float, pieces: int) -> ProvenStep | str:
    """Theorem V with the step length given: a proven step, or the hypothesis that failed.

    Args:
        field: f and the quantity watched.
        start: c and r.
        series: Every value's Taylor coefficients from c: `ccpin.validated.arithmetic.series.all_series`.
        length: h, a multiple of 2⁻⁴⁰ s.
        pieces: K, of equal length.
    """
    polynomial = list(series[: field.program.inputs])
    try:
        with flint().ctx.workprec(_BOX_PRECISION):
            gap = defect_along(field.program, series, ball(length))
        if not finite(gap):
            return "the Taylor series does not converge over the step"
        share = ball(length) / pieces
        error, largest = list(start.radius), list(start.radius)
        boxes, quantity = [], math.inf
        for k in range(pieces):
            path = evaluate(polynomial, around(share * k + share / 2, share / 2))
            tube, during, error = _piece(field.program, path, error, [d * share for d in gap], share)
            watched = field.quantity(tube)
            if not watched > 0:  # NaN too
                return "ψ_q′ is not proven nonsingular on the box that a step needs"
            if missing := field.missing(tube):
                return missing
            largest = [a.max(b) for a, b in zip(largest, during, strict=True)]
            boxes.append(tube)
            quantity = min(quantity, watched)
    except NotInvertibleError:
        return _SINGULAR + " on the box that a step needs"
    except _RefusedError as refusal:
        return str(refusal)
    remainder = max(upper(d * length) for d in gap)
    final = [around(x, e) for x, e in zip(evaluate(polynomial, ball(length)), error, strict=True)]
    return ProvenStep(length, polynomial, remainder, largest, boxes, quantity, start_of(final))


def _piece(
    program: Program, path: list[Ball], error: list[Ball], added: list[Ball], share: Ball
) -> tuple[list[Ball], list[Ball], list[Ball]]:
    """One piece: the box p ± ē, ē, and e at its end (the theorem's 3 and 4).

    Raises:
        _RefusedError: 4 fails: the box does not contain its own image.
        NotInvertibleError: 3 fails: f may not be analytic on it.
    """
    total = [(a + b).upper() for a, b in zip(error, added, strict=True)]
    box = [around(x, x.rad() * 1e-4 + 1.3 * e + ball(2.0**-200)) for x, e in zip(path, total, strict=True)]
    for _ in range(3):
        with flint().ctx.workprec(_BOX_PRECISION):
            slopes = gradients(program, box)
        if not all(finite(row) for row in slopes):
            raise _RefusedError("the slopes of the equation are not bounded on the box that a step needs")
        rising = _exponential(slopes, share, keep_negative=False)
        during = _grown(rising, total)
        tube = [around(x, e) for x, e in zip(path, during, strict=True)]
        if all(b.contains_interior(x) for b, x in zip(box, tube, strict=True)):
            kept, new = _grown(_exponential(slopes, share, keep_negative=True), error), _grown(rising, added)
            return tube, during, [(a + b).upper() for a, b in zip(kept, new, strict=True)]
        box = [around(x, x.rad() * 1e-4 + 1.3 * e) for x, e in zip(path, during, strict=True)]
    raise _RefusedError("the a-priori box does not contain its own image (Picard–Lindelöf)")


def _exponential(slopes: list[list[Ball]], time: Ball, keep_negative: bool) -> Any:
    """exp(M t), or exp(M⁺t), M from the slopes on a box as 3 asks."""
    size, zero = len(slopes), ball(0)
    table = [[zero] * size for _ in range(size)]
    for i in range(size):
        for j in range(size):
            bound = slopes[i][j].upper() if i == j else ball(slopes[i][j].abs_upper())
            table[i][j] = bound * time if keep_negative or bound > 0 else zero
    return flint().arb_mat(table).exp()


def _grown(matrix: Any, vector: list[Ball]) -> list[Ball]:
    return [magnitude(x) for x in (matrix * flint().arb_mat([[x] for x in vector])).entries()]


def march(
    field: WatchedField, box: Sequence[Ball], duration: float, options: StepOptions
) -> Iterator[ProvenStep | Stuck]:
    """Steps from a box over a time, as long as their remainders allow; a `Stuck` ends it early."""
    start, time, boldness = start_of(box), 0.0, 0.6
    end = math.ceil(duration / QUANTUM) * QUANTUM
    while time < end:
        try:
            series = all_series(field.program, start.centre, options.order)
        except NotInvertibleError:
            yield Stuck(_SINGULAR + " at the state reached")
            return
        affordable = _affordable(series[: field.program.inputs], options)
        here = options._replace(shortest=min(options.shortest, end - time), longest=min(options.longest, end - time))
        step = _longest(field, start, series, boldness * affordable, here)
        if isinstance(step, str):
            yield Stuck(step)
            return
        ratio = step.length / affordable
        boldness = min(1.0, 1.3 * ratio, 0.95 * ratio * _correction(step.remainder, options))
        time += step.length
        start = step.end
        yield step


def _longest(
    field: WatchedField, start: Start, series: Sequence[Any], length: float, options: StepOptions
) -> ProvenStep | str:
    """The first step proven of lengths that shrink, or what failed last."""
    failed = "the Taylor coefficients grow too fast for the shortest step"
    length = min(length, options.longest)
    while True:
        length = math.floor(length / QUANTUM) * QUANTUM
        if length < options.shortest:
            return failed
        step = attempt(field, start, series, length, options.pieces)
        if isinstance(step, str):
            failed, length = step, 0.5 * length
        elif step.remainder > 2 * options.tolerance:
            failed, length = "the remainder is above the tolerance", 0.9 * length * _correction(step.remainder, options)
        elif _blown_up(start, step, options):
            failed, length = "the enclosure grows too fast", 0.5 * length
        else:
            return step


def _blown_up(start: Start, step: ProvenStep, options: StepOptions) -> bool:
    """Whether a step widens the enclosure by more than wide boxes' slopes should be allowed to."""
    before, after = max(map(upper, start.radius)), max(map(upper, step.end.radius))
    return after > _GROWTH * (before + 2 * options.tolerance)


def _correction(remainder: float, options: StepOptions) -> float:
    """By how much the length may change for a remainder of order N to become the tolerance."""
    return float((options.tolerance / max(remainder, 1e-300)) ** (1 / options.order))


def _affordable(polynomial: Sequence[Sequence[Ball]], options: StepOptions) -> float:
    """The step whose last term is the tolerance."""
    largest = max(upper(magnitude(coefficients[options.order])) for coefficients in polynomial)
    return _correction(largest, options) if math.isfinite(largest) else 0.0
