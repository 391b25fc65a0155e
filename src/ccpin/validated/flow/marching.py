"""The march from step to step: how long each may be is searched for here, and what it encloses is Theorem V's."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple, Protocol

from ccpin.programs.instructions import Code
from ccpin.validated.arithmetic.balls import Ball, magnitude, upper
from ccpin.validated.arithmetic.series import NotInvertibleError
from ccpin.validated.flow.step import SINGULAR, ProvenStep, Start, start_of

QUANTUM = 2.0**-40  # steps are multiples, so that times are exact doubles
SHORTEST_STEP = 2.0**-20  # s: where no longer step is proved, the march ends
_GROWTH = 1e3  # of the enclosure's width, in one step: more is refused


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


class SteppedField(Protocol):
    """What is integrated, and who proves its steps: of a closed loop `ProvedSteps`."""

    @property
    def program(self) -> Code:
        """f."""

    def series(self, start: Start, order: int) -> Sequence[Any]:
        """Every value's Taylor coefficients from a start's centre.

        Raises:
            NotInvertibleError: A matrix that f inverts may be singular there.
        """

    def attempt(self, start: Start, series: Sequence[Any], length: float, pieces: int) -> ProvenStep | str:
        """A step of this length, or what is not proven."""


def rounded_up(time: float) -> float:
    """A time in seconds as a multiple of 2⁻⁴⁰ s."""
    return math.ceil(time / QUANTUM) * QUANTUM


def march(
    field: SteppedField, box: Sequence[Ball], duration: float, options: StepOptions
) -> Iterator[ProvenStep | Stuck]:
    """Steps from a box over a time, as long as their remainders allow; a `Stuck` ends it early."""
    start, time, boldness = start_of(box), 0.0, 0.6
    end = rounded_up(duration)
    while time < end:
        try:
            series = field.series(start, options.order)
        except NotInvertibleError:
            yield Stuck(SINGULAR + " at the state reached")
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
    field: SteppedField, start: Start, series: Sequence[Any], length: float, options: StepOptions
) -> ProvenStep | str:
    """The first step proven of lengths that shrink, or what failed last."""
    failed = "the Taylor coefficients grow too fast for the shortest step"
    length = min(length, options.longest)
    while True:
        length = math.floor(length / QUANTUM) * QUANTUM
        if length < options.shortest:
            return failed
        step = field.attempt(start, series, length, options.pieces)
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
