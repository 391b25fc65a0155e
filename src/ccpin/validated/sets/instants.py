"""The motion in the middle of a tube at the middles of slices of time, and over them, in doubles rounded outwards."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.validated.arithmetic.ball_arrays import BallArray, of_balls
from ccpin.validated.arithmetic.balls import Ball, around, ball
from ccpin.validated.flow.step import ProvenStep


class Instants(NamedTuple):
    """The enclosed motion at the middles of B slices of time, and over them.

    Attributes:
        time: t_m since the step began, exact, of shape (B,).
        half: h/2, exact, of shape (B,).
        middle: (q′, q̇) at t_m, of shape (B, n′ + n).
        during: (q′, q̇) over the slice, alike.
    """

    time: Array
    half: Array
    middle: BallArray
    during: BallArray

    def part(self, index: slice) -> Instants:
        """Some of the slices."""
        return Instants(self.time[index], self.half[index], self.middle.at(index), self.during.at(index))


def instants_over(step: ProvenStep, marks: Array) -> Instants:
    """A step between marks of shape (B + 1,), in seconds since it began, of which middles and halves are doubles."""
    middle, during = list[list[Ball]](), list[list[Ball]]()
    times, halves = list[float](), list[float]()
    for first, last in pairwise(marks.tolist()):
        centre, half = 0.5 * (first + last), 0.5 * (last - first)
        middle.append(step.box(ball(centre)))
        during.append(step.box(around(ball(centre), ball(half))))
        times.append(centre)
        halves.append(half)
    return Instants(np.array(times), np.array(halves), of_balls(middle), of_balls(during))


def beginning(step: ProvenStep) -> Instants:
    """A step's first moment."""
    at = of_balls([step.box(ball(0))])
    return Instants(np.zeros(1), np.zeros(1), at, at)
