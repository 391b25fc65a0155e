"""The claim that tubes hold all motions from a box of starts: each start is in a tube's own box, to the last bit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Annotated

import numpy as np

from ccpin.arrays import Array, Indices
from ccpin.proof.facts import Examined, Fact, Form, ProvableClaim, provable, require
from ccpin.validated.loop_equations import ClosedLoopEquations
from ccpin.validated.sets.motion_tube_claim import TubeHeld

Sides = tuple[list[Fraction], list[Fraction]]


@provable
@dataclass(frozen=True, eq=False)
class SetEnclosed(ProvableClaim):
    """All motions from a box of starts exist over a time, closed and nonsingular, each in one of some tubes.

    Starts are closed states on the branches of σ on which the tubes' middles are. Premises: the facts about the tubes.

    Attributes:
        q, v: The middle, of shape (n,) each.
        spread: Half-widths in q and q̇, of shape (2n,).
        duration: The time, s.
        cut: The box is cut across a coordinate (of (q, q̇), by number) and so are its parts, the lower first; −1: this
            part is in the next tube's box. Of shape (2K − 1,) with K tubes.
        place: Where it is cut.
    """

    equations: ClosedLoopEquations
    q: Annotated[Array, Form("V")]
    v: Annotated[Array, Form("V")]
    spread: Annotated[Array, Form("s", least=0.0)]
    duration: Annotated[Array, Form("1", above=0.0)]
    cut: Annotated[Indices, Form("c", "i", least=-1)]
    place: Annotated[Array, Form("c")]
    theorem = "motion_tube"

    def examined(self, *premises: Fact) -> Examined:
        """That the parts lie in the tubes' boxes, and that the tubes are as long."""
        size = 2 * self.equations.n
        require([type(tube.claim) is TubeHeld for tube in premises], "premises that are no tubes")
        require(len(self.spread) == size and np.all(self.cut < size), "starts in other coordinates")
        require([tube.found["times"][-1] >= self.duration[0] for tube in premises], "a tube that ends earlier")
        middle = [Fraction(x) for x in (*self.q.tolist(), *self.v.tolist())]
        waiting, tubes = [_sides(middle, self.spread)], list(premises)
        for axis, place in zip(self.cut.tolist(), self.place.tolist(), strict=True):
            require(len(waiting) > 0, "parts of nothing")
            low, high = waiting.pop()
            if axis >= 0:
                waiting += [(_with(low, axis, place), high), (low, _with(high, axis, place))]
                continue
            require(len(tubes) > 0, "fewer tubes than parts")
            below, above = _starts_of(tubes.pop(0))
            inside = [a <= b and c <= d for a, b, c, d in zip(below, low, high, above, strict=True)]
            require(inside, "a part of the starts that is not in its tube's")
        require(not waiting and not tubes, "parts without a tube, or more tubes than parts")
        return Examined(np.ones(1, dtype=np.bool_), {})


def _sides(middle: Sequence[Fraction], spread: Array) -> Sides:
    """Lower and upper sides of a box, exactly."""
    widths = [Fraction(s) for s in spread.tolist()]
    return [x - s for x, s in zip(middle, widths, strict=True)], [x + s for x, s in zip(middle, widths, strict=True)]


def _with(side: list[Fraction], axis: int, place: float) -> list[Fraction]:
    """A side moved to where it is cut."""
    return [Fraction(place) if k == axis else x for k, x in enumerate(side)]


def _starts_of(tube: Fact) -> Sides:
    """The box of starts of a tube.

    Raises:
        NotProvedError: The start in its middle is none of exact numbers.
    """
    start = tube.premises[0].premises[0].claim
    require(start.q_radius == 0.0, "a tube whose middle is not exact")
    q = [sum(map(Fraction, row), Fraction(0)) for row in start.q.tolist()]
    return _sides([*q, *map(Fraction, start.v.tolist())], tube.claim.spread)
