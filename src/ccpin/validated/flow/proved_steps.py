"""Steps of a closed loop as a march asks for them: each that is taken is a fact."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ccpin.programs.instructions import Code
from ccpin.proof.facts import NotProvedError, prove
from ccpin.validated.arithmetic.exact_numbers import ExactBox, exact_box
from ccpin.validated.flow.step import ProvenStep, Start
from ccpin.validated.flow.step_claim import StepEnclosed, series_from, step_of
from ccpin.validated.loop_equations import ClosedLoopEquations


class ProvedSteps(NamedTuple):
    """Steps of a closed loop, proved in so many bits (a `SteppedField`).

    Attributes:
        loop: The loop.
        precision: In bits.
        missing: What else is not proven of a step, in words.
    """

    loop: ClosedLoopEquations
    precision: int
    missing: Callable[[ProvenStep], str] = lambda _: ""

    @property
    def program(self) -> Code:
        """f."""
        return self.loop.field

    def series(self, start: Start, order: int) -> Sequence[Any]:
        """Every value's Taylor coefficients from a start's centre.

        Raises:
            NotInvertibleError: A matrix that f inverts may be singular there.
        """
        return series_from(self.loop, self._box(start).parts, order, self.precision)

    def attempt(self, start: Start, series: Sequence[Any], length: float, pieces: int) -> ProvenStep | str:
        """A step of this length, or what is not proven."""
        numbers = (np.array([number]) for number in (len(series[0]) - 1, pieces, self.precision))
        claim = StepEnclosed(self.loop, *self._box(start), np.array([length]), *numbers)
        try:
            step = step_of(prove(claim))
        except NotProvedError as refused:
            return str(refused)
        return self.missing(step) or step

    def _box(self, start: Start) -> ExactBox:
        return exact_box(*start, self.precision)
