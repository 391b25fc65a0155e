"""Balls as doubles and back, exactly: a middle is a sum of a few doubles, a radius one.

So claims and facts about balls are arrays of numbers like any others. What a sum of doubles leaves of a middle goes
into the radius; radii of balls are doubles already, of 30 bits, unless they are out of the range of doubles.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.validated.arithmetic.balls import Ball, ball, flint, with_radius

_BITS = 53  # of a double
_WIDE = 2200  # bits: every sum of doubles is exact


class ExactBox(NamedTuple):
    """A box |x − Σ_k parts_k| ≤ radius.

    Attributes:
        parts: Doubles, of shape (N, k).
        radius: Of shape (N,).
    """

    parts: Array
    radius: Array

    def balls(self) -> list[Ball]:
        """Its intervals: a little wider where a radius is none of a ball, with more than 30 bits."""
        return [with_radius(*pair) for pair in zip(centres(self.parts), map(ball, self.radius.tolist()), strict=True)]

    def rows(self, places: Sequence[int]) -> ExactBox:
        """The box of some of its numbers."""
        return ExactBox(self.parts[list(places)], self.radius[list(places)])

    def holds(self, other: ExactBox) -> bool:
        """Whether another box lies in it, exactly."""
        pairs = zip(*(map(_sum_of, box.parts.tolist()) for box in (self, other)), strict=True)
        radii = zip(self.radius.tolist(), other.radius.tolist(), strict=True)
        return all(abs(a - b) + Fraction(s) <= Fraction(r) for (a, b), (r, s) in zip(pairs, radii, strict=True))


def boxed(box: Sequence[Ball], bits: int) -> ExactBox:
    """Balls as a box of doubles: themselves where they were rounded to so many bits, else one that holds them."""
    return exact_box([x.mid() for x in box], [x.rad() for x in box], bits)


def exact_box(centre: Iterable[Ball], radius: Iterable[Ball], bits: int) -> ExactBox:
    """The same of centres and radii."""
    rows, radii, count = list[list[float]](), list[float](), bits // _BITS + 1
    with flint().ctx.workprec(_WIDE):
        for x, r in zip(centre, radius, strict=True):
            rest, row = x, list[float]()
            for _ in range(count):
                row.append(float(rest.mid()))
                rest = rest - flint().arb(row[-1])
            rows.append(row)
            radii.append(_above(r + rest.abs_upper()))
    return ExactBox(np.array(rows, dtype=np.float64).reshape(-1, count), np.array(radii, dtype=np.float64))


def centres(parts: Array) -> list[Ball]:
    """The sums of rows of doubles, exactly."""
    with flint().ctx.workprec(_WIDE):
        return [sum(map(flint().arb, row), flint().arb(0)) for row in parts.tolist()]


def _sum_of(row: Sequence[float]) -> Fraction:
    return sum(map(Fraction, row), Fraction(0))


def _above(bound: Ball) -> float:
    """The double itself, or the next one above."""
    nearest = float(bound.upper())
    return nearest if bound <= flint().arb(nearest) else math.nextafter(nearest, math.inf)
