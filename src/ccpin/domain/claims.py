"""What searches hand to the kernel: boxes, and common points at which they carry the same σ."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, Mask, rows_of
from ccpin.domain.boxes import Boxes, Problem, certify_points
from ccpin.domain.newton import newton, predict
from ccpin.proof.closures import Closures, closures_of
from ccpin.proof.facts import Fact, prove_some
from ccpin.proof.solutions import Glued, Met, Solutions, boxes_of

_NEWTON = 12


class Seams(NamedTuple):
    """Pairs of boxes by number, and a common point in the parameters of each, (K,) and (K, n)."""

    first: Indices
    second: Indices
    at_first: Array
    at_second: Array

    @classmethod
    def none(cls, n: int) -> Seams:
        """None yet."""
        number, point = np.zeros(0, dtype=np.int64), np.zeros((0, n))
        return cls(number, number, point, point)


def equations_of(problem: Problem) -> Closures:
    """A problem's closures as the kernel has them."""
    return closures_of(problem.system, problem.phasors is not None)


def proved_boxes(problem: Problem, boxes: Boxes) -> tuple[Fact, Mask]:
    """The fact about those boxes that the kernel finds proved, and which they are."""
    return prove_some(Solutions(equations_of(problem), *boxes))


def proved_glue(problem: Problem, seams: Seams, solutions: tuple[Fact, ...]) -> tuple[Fact, ...]:
    """The facts that boxes carry the same σ at common points; where a ball is too large a fresh point is enclosed."""
    equations = equations_of(problem)
    fact, same = prove_some(Glued(equations, *seams), *solutions)
    left = np.flatnonzero(~same)
    if not left.size:
        return (fact,)
    seams, boxes = rows_of(seams, left), boxes_of(solutions)
    theta = newton(problem, predict(problem, boxes.take(seams.first), seams.at_first), _NEWTON).theta
    point = certify_points(problem, theta)
    points, enclosed = prove_some(Solutions(equations, *point.boxes.take(np.flatnonzero(point.proved))))
    rows = np.flatnonzero(point.proved)[enclosed]
    met = prove_some(Met(equations, *rows_of(seams, rows), point=np.arange(len(rows))), points, *solutions)[0]
    return fact, met


def proved_point(problem: Problem, theta: Array) -> Fact | None:
    """The fact that a closed configuration is at θ (n′,), in a box without parameters; ``None`` where it is not proved."""
    point = certify_points(problem, theta[None])
    fact, enclosed = prove_some(Solutions(equations_of(problem), *point.boxes.take(np.flatnonzero(point.proved))))
    return fact if enclosed.any() else None
