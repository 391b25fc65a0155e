"""One validated step of x′ = f(x) from a box of starts, and the march from step to step.

Theorem (one step). Let c be a point, r ≥ 0, and |x₀ − c| ≤ r by component. Let p be the Taylor polynomial of degree N
of the solution from c at t = 0, and d ≥ |p′ − f(p)| on [0, h], by component. Cut [0, h] at 0 = t₀ < … < t_K = h. For
each piece let B_k be a box on which f is analytic and M_k a matrix with M_ii ≥ ∂f_i/∂x_i, M_ij ≥ |∂f_i/∂x_j| on B_k,
M⁺ the same without its negative entries. Put e₀ = r and, with δ = t_{k+1} − t_k,

    ē_k = exp(M_k⁺δ)(e_k + δd),    e_{k+1} = exp(M_k δ) e_k + exp(M_k⁺δ) δd.

If p([t_k, t_{k+1}]) ± ē_k lies in the interior of B_k for every k, then the solution from x₀ exists on [0, h],
|x(t) − p(t)| ≤ ē_k on piece k, and |x(t_k) − p(t_k)| ≤ e_k.

Proof. On piece k let τ be the supremum of the times up to which x exists and stays in B_k. Up to τ the difference
e = x − p satisfies e′ = f(x) − f(p) − (p′ − f(p)) = J̄(t)e + (f(p) − p′) with J̄ = ∫₀¹ f′(p + s e) ds taken along a
segment in the convex B_k, so D⁺|e_i| ≤ (M_k|e|)_i + d_i. M_k has no negative entry off its diagonal: comparison with
the linear system z′ = M_k z + d gives |e(t)| ≤ exp(M_k t)e_k + ∫exp(M_k s)d ds, hence both bounds. At τ x lies in a
compact part of the interior of B_k, so it exists longer and stays longer, unless τ = t_{k+1}. ∎

Every quantity is computed in balls. f is analytic on B_k if each matrix that f inverts is proven invertible on B_k.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

from ccpin.validated.balls import Ball, around, ball, finite, flint, magnitude, upper
from ccpin.validated.defect import defect
from ccpin.validated.series import NotInvertibleError, all_series, gradients
from ccpin.validated.tape import Program

QUANTUM = 2.0**-40  # steps are multiples, so that times are exact doubles
_BOX_PRECISION = 64  # bits; enough for boxes as wide as a step
_GROWTH = 1e3
_SINGULAR = "ψ_q′, D or (of motors elsewhere than on the independent joints) ρᵀSᵀ is not proven nonsingular"

Quantity = Callable[[list[Ball]], float]


class Start(NamedTuple):
    """A box of states: exact centre and radii, balls of radius 0."""

    centre: list[Ball]
    radius: list[Ball]


class Step(NamedTuple):
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


class Options(NamedTuple):
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
    shortest: float
    longest: float


class Stuck(NamedTuple):
    """No step of the shortest length could be proven; `reason` says what failed in the last attempt."""

    reason: str


class Field(NamedTuple):
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
    """A hypothesis of the theorem that failed, in words."""


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


def attempt(field: Field, start: Start, series: Sequence[Any], length: float, pieces: int) -> Step | str:
    """The theorem with the step length given: a proven step, or the hypothesis that failed.

    Args:
        field: f and the quantity watched.
        start: c and r.
        series: Every value's Taylor coefficients from c: `ccpin.validated.series.all_series`.
        length: h, a multiple of 2⁻⁴⁰ s.
        pieces: K, of equal length.
    """
    polynomial = list(series[: field.program.inputs])
    try:
        with flint().ctx.workprec(_BOX_PRECISION):
            gap = defect(field.program, series, ball(length))
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
    return Step(length, polynomial, remainder, largest, boxes, quantity, start_of(final))


def _piece(
    program: Program, path: list[Ball], error: list[Ball], added: list[Ball], share: Ball
) -> tuple[list[Ball], list[Ball], list[Ball]]:
    """One piece: the box p ± ē, ē, and e at its end.

    Raises:
        _RefusedError: The box does not contain its own image.
        NotInvertibleError: f may not be analytic on it.
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
    """exp(M t), or exp(M⁺t)."""
    size, zero = len(slopes), ball(0)
    table = [[zero] * size for _ in range(size)]
    for i in range(size):
        for j in range(size):
            bound = slopes[i][j].upper() if i == j else ball(slopes[i][j].abs_upper())
            table[i][j] = bound * time if keep_negative or bound > 0 else zero
    return flint().arb_mat(table).exp()


def _grown(matrix: Any, vector: list[Ball]) -> list[Ball]:
    return [magnitude(x) for x in (matrix * flint().arb_mat([[x] for x in vector])).entries()]


def march(field: Field, box: Sequence[Ball], duration: float, options: Options) -> Iterator[Step | Stuck]:
    """Steps from a box over a time, as long as their remainders allow; a `Stuck` ends it early."""
    start, time, boldness = start_of(box), 0.0, 0.6
    end = math.ceil(duration / QUANTUM) * QUANTUM
    while time < end:
        try:
            series = all_series(field.program, start.centre, options.order)
        except NotInvertibleError:
            yield Stuck(_SINGULAR + " at the state reached")
            return
        guess = _affordable(series[: field.program.inputs], options)
        here = options._replace(shortest=min(options.shortest, end - time), longest=min(options.longest, end - time))
        step = _longest(field, start, series, boldness * guess, here)
        if isinstance(step, str):
            yield Stuck(step)
            return
        ratio = step.length / guess
        boldness = min(1.0, 1.3 * ratio, 0.95 * ratio * _correction(step.remainder, options))
        time += step.length
        start = step.end
        yield step


def _longest(field: Field, start: Start, series: Sequence[Any], length: float, options: Options) -> Step | str:
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


def _blown_up(start: Start, step: Step, options: Options) -> bool:
    """Whether a step widens the enclosure by more than wide boxes' slopes should be allowed to."""
    before, after = max(map(upper, start.radius)), max(map(upper, step.end.radius))
    return after > _GROWTH * (before + 2 * options.tolerance)


def _correction(remainder: float, options: Options) -> float:
    """By how much the length may change for a remainder of order N to become the tolerance."""
    return float((options.tolerance / max(remainder, 1e-300)) ** (1 / options.order))


def _affordable(polynomial: Sequence[Sequence[Ball]], options: Options) -> float:
    """The step whose last term is the tolerance."""
    largest = max(upper(magnitude(coefficients[options.order])) for coefficients in polynomial)
    return _correction(largest, options) if math.isfinite(largest) else 0.0
