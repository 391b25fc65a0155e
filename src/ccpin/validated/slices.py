"""An enclosed motion cut into slices of time, in doubles."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ccpin.validated.balls import Ball, around, ball
from ccpin.validated.curvature import Instants
from ccpin.validated.step import QUANTUM, Step, evaluate
from ccpin.validated.wide import of_balls


def beginning(step: Step) -> Instants:
    """A step's first moment."""
    path = [around(x, e) for x, e in zip(evaluate(step.polynomial, ball(0)), step.error, strict=True)]
    at = of_balls([path])
    return Instants(np.zeros(1), np.zeros(1), at, at)


def instants_of(step: Step, since: float, count: int) -> Instants:
    """A step as so many slices, all times multiples of 2⁻⁴¹ s and so exact; twice as many keep the cuts.

    Args:
        step: The step.
        since: When it begins, s.
        count: How many.
    """
    units = round(step.length / QUANTUM)
    marks = [units * k // count * QUANTUM for k in range(count + 1)]
    middle, during = list[list[Ball]](), list[list[Ball]]()
    times, halves = list[float](), list[float]()
    for first, last in pairwise(marks):
        centre, half = 0.5 * (first + last), 0.5 * (last - first)
        for kept, time in ((middle, ball(centre)), (during, around(ball(centre), ball(half)))):
            path = evaluate(step.polynomial, time)
            kept.append([around(x, e) for x, e in zip(path, step.error, strict=True)])
        times.append(since + centre)
        halves.append(half)
    return Instants(np.array(times), np.array(halves), of_balls(middle), of_balls(during))
