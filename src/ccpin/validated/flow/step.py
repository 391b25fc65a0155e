"""One validated step of x′ = f(x) from a box of starts.

A step is Theorem V of `ccpin/proof/theorems/step.md`, whose names c, r, p, d, B_k, M_k and e_k are used here. Every
quantity is computed in balls; f is analytic on B_k if each matrix that f inverts is proven invertible on B_k.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from ccpin.programs.instructions import Code
from ccpin.proof.facts import Fact
from ccpin.validated.arithmetic.balls import Ball, around, ball, finite, flint, magnitude, upper
from ccpin.validated.arithmetic.series import NotInvertibleError, gradients
from ccpin.validated.flow.defect import defect_along

_BOX_PRECISION = 64  # bits; enough for boxes as wide as a step
SINGULAR = "ψ_q′, D or (of motors elsewhere than on the independent joints) ρᵀSᵀ is not proven nonsingular"

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
        fact: That all this is proved of a closed loop (`ccpin.validated.flow.step_claim`), where that was asked.
    """

    length: float
    polynomial: list[list[Ball]]
    remainder: float
    error: list[Ball]
    boxes: list[list[Ball]]
    quantity: float
    end: Start
    fact: Fact | None = None

    def box(self, t: Ball) -> list[Ball]:
        """A box around the solutions at times (balls) since the step began."""
        return [around(x, e) for x, e in zip(evaluate(self.polynomial, t), self.error, strict=True)]


class WatchedField(NamedTuple):
    """What is integrated: f, a quantity that must be positive on every box (as a lower bound), what else is asked.

    Attributes:
        program: f.
        quantity: The quantity.
        missing: What else is not proven on a box, in words.
    """

    program: Code
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
        return SINGULAR + " on the box that a step needs"
    except _RefusedError as refusal:
        return str(refusal)
    remainder = max(upper(d * length) for d in gap)
    final = [around(x, e) for x, e in zip(evaluate(polynomial, ball(length)), error, strict=True)]
    return ProvenStep(length, polynomial, remainder, largest, boxes, quantity, start_of(final))


def _piece(
    program: Code, path: list[Ball], error: list[Ball], added: list[Ball], share: Ball
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
