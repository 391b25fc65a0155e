"""The claim that a step encloses a closed loop's motions from a box of states: Theorem V of `step`, 3 of Theorem M.

What was computed to prove it is what is found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Any

import numpy as np

from ccpin.arrays import Array, Indices
from ccpin.proof.facts import Examined, Fact, Form, NotProvedError, ProvableClaim, provable, require
from ccpin.validated.arithmetic.balls import Ball, ball, flint
from ccpin.validated.arithmetic.exact_numbers import ExactBox, boxed, centres, exact_box
from ccpin.validated.arithmetic.series import NotInvertibleError, all_series
from ccpin.validated.flow.regularity import regular
from ccpin.validated.flow.start_claim import PRECISION
from ccpin.validated.flow.step import SINGULAR, ProvenStep, Start, attempt
from ccpin.validated.loop_equations import ClosedLoopEquations


@provable
@dataclass(frozen=True, eq=False)
class StepEnclosed(ProvableClaim):
    """The motions from a box of states exist over a step, in boxes on which ψ_q′ is nonsingular and turns are small.

    Attributes:
        centre, radius: c as sums of k doubles, and r.
        length: h in seconds.
        order: N.
        pieces: K.
        precision: In bits, of the arithmetic.

    Found: `polynomial` (X, N + 1, k) and `polynomial_radius`, balls around the coefficients of p; `error` (X,), of p on
    [0, h]; `boxes` (K, X, k) and `box_radius`, around the motions during each piece; `quantity` (1,), a lower bound of
    |det ψ_q′| on them; `remainder` (1,), the largest of h d; `end` (X, k) and `end_radius`, the box of states at h.
    """

    equations: ClosedLoopEquations
    centre: Annotated[Array, Form("Xk")]
    radius: Annotated[Array, Form("X", least=0.0)]
    length: Annotated[Array, Form("1", above=0.0)]
    order: Annotated[Indices, Form("1", "i", least=1)]
    pieces: Annotated[Indices, Form("1", "i", least=1)]
    precision: Annotated[Indices, PRECISION]
    theorem = "step"

    def examined(self, *premises: Fact) -> Examined:
        """The step, computed."""
        require(not premises, "a step rests on nothing else")
        order, pieces, bits = (int(number[0]) for number in (self.order, self.pieces, self.precision))
        with flint().ctx.workprec(bits):
            start = Start(centres(self.centre), [ball(r) for r in self.radius.tolist()])
            try:
                series = series_from(self.equations, self.centre, order, bits)
            except NotInvertibleError:
                raise NotProvedError(SINGULAR + " at the start") from None
            step = attempt(regular(self.equations), start, series, float(self.length[0]), pieces)
            if isinstance(step, str):
                raise NotProvedError(step)
            found = _numbers_of(step, bits)
        require([np.isfinite(numbers).all() for numbers in found.values()], "a step that is not bounded")
        return Examined(np.ones(1, dtype=np.bool_), found)


def series_from(loop: ClosedLoopEquations, centre: Array, order: int, bits: int) -> Sequence[Any]:
    """Taylor coefficients of every value along the motion from a point, `all_series`; of the last few they are kept.

    Raises:
        NotInvertibleError: A matrix to be inverted may be singular there.
    """
    return _series(loop, centre.tobytes(), centre.shape, order, bits)


@lru_cache(maxsize=4)
def _series(loop: ClosedLoopEquations, centre: bytes, shape: tuple[int, int], order: int, bits: int) -> tuple[Any, ...]:
    with flint().ctx.workprec(bits):
        parts = np.frombuffer(centre, dtype=np.float64).reshape(shape)
        return tuple(map(_held, all_series(loop.field, centres(parts), order)))


def _held(coefficients: list[Any]) -> tuple[Any, ...]:
    """Lists as tuples: what is kept cannot be written to."""
    return tuple(tuple(entry) if isinstance(entry, list) else entry for entry in coefficients)


def _numbers_of(step: ProvenStep, bits: int) -> dict[str, Array]:
    """A step as arrays."""
    size, pieces = len(step.polynomial), len(step.boxes)
    polynomial = boxed([x for row in step.polynomial for x in row], bits)
    boxes = boxed([x for box in step.boxes for x in box], bits)
    end, error = exact_box(*step.end, bits), exact_box([ball(0)] * size, step.error, bits)
    return {
        "polynomial": polynomial.parts.reshape(size, -1, polynomial.parts.shape[1]),
        "polynomial_radius": polynomial.radius.reshape(size, -1),
        "error": error.radius,
        "boxes": boxes.parts.reshape(pieces, size, -1),
        "box_radius": boxes.radius.reshape(pieces, size),
        "quantity": np.array([step.quantity]),
        "remainder": np.array([step.remainder]),
        "end": end.parts,
        "end_radius": end.radius,
    }


def step_of(fact: Fact) -> ProvenStep:
    """What a fact about a step says, in balls."""
    found = fact.found
    with flint().ctx.workprec(int(fact.claim.precision[0])):
        radii = found["polynomial_radius"]
        polynomial = [ExactBox(parts, r).balls() for parts, r in zip(found["polynomial"], radii, strict=True)]
        boxes = [ExactBox(*box).balls() for box in zip(found["boxes"], found["box_radius"], strict=True)]
        end = Start(centres(found["end"]), _balls(found["end_radius"]))
        remainder, quantity = (float(found[name][0]) for name in ("remainder", "quantity"))
        length = float(fact.claim.length[0])
        return ProvenStep(length, polynomial, remainder, _balls(found["error"]), boxes, quantity, end, fact)


def start_of_step(fact: Fact) -> ExactBox:
    """The box of states that a step is from."""
    return ExactBox(fact.claim.centre, fact.claim.radius)


def end_of_step(fact: Fact) -> ExactBox:
    """The box of states at its end."""
    return ExactBox(fact.found["end"], fact.found["end_radius"])


def _balls(numbers: Array) -> list[Ball]:
    return [ball(x) for x in numbers.tolist()]
