"""What searches hand to the kernel: boxes, common points at which they carry the same σ, zeros of prolonged systems."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, Mask, rows_of
from ccpin.covering.cells import CellTree
from ccpin.covering.proposals.krawczyk import certify_points
from ccpin.covering.proposals.solving import newton, solved
from ccpin.covering.region import Region
from ccpin.proof.equations import Problem, closures_of
from ccpin.proof.facts import Fact, prove_some
from ccpin.proof.newton import Boxes, predict
from ccpin.proof.prolongations import Prolongation
from ccpin.proof.solutions import GluedBoxes, Met, SolutionsInBoxes, boxes_of
from ccpin.proof.zeros import Cusps, SingularPoints

_NEWTON = 12  # steps
_WIDER = 1.05  # R of points: for another order of roundings


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


def cells_of(region: Region, tree: CellTree) -> dict[str, Any]:
    """A region and the tree of its cells, as claims have them."""
    return {
        "lower": region.lower,
        "upper": region.upper,
        "wrapped": region.wrapped,
        "cut": np.asarray(tree.cut, dtype=np.int64),
        "child": np.asarray(tree.child, dtype=np.int64),
    }


def proved_boxes(problem: Problem, boxes: Boxes) -> tuple[Fact, Mask]:
    """The fact about those boxes that the kernel finds proved, and which they are."""
    return prove_some(SolutionsInBoxes(closures_of(problem), *boxes))


def proved_glue(problem: Problem, seams: Seams, solutions: tuple[Fact, ...]) -> tuple[Fact, ...]:
    """The facts that boxes carry the same σ at common points; where a ball is too large a fresh point is enclosed."""
    equations = closures_of(problem)
    fact, same = prove_some(GluedBoxes(equations, *seams), *solutions)
    left = np.flatnonzero(~same)
    if not left.size:
        return (fact,)
    seams, boxes = rows_of(seams, left), boxes_of(solutions)
    theta = newton(problem, predict(problem, boxes.take(seams.first), seams.at_first), _NEWTON).theta
    points, rows = proved_points(problem, theta)
    met = prove_some(Met(equations, *rows_of(seams, rows), point=np.arange(len(rows))), points, *solutions)[0]
    return fact, met


def proved_points(problem: Problem, theta: Array) -> tuple[Fact, Indices]:
    """The fact about closed configurations near some of θ (B, n′), in boxes without parameters, and near which.

    Their radii are of rounding: a little more leaves room for another order of operations.
    """
    found = certify_points(problem, theta)
    rows = np.flatnonzero(found.proved)
    boxes = found.boxes.take(rows)
    wider = boxes._replace(radius=_WIDER * boxes.radius, kappa=0.5 * (1.0 + boxes.kappa))
    fact, enclosed = prove_some(SolutionsInBoxes(closures_of(problem), *wider))
    return fact, rows[enclosed]


def proved_zeros(
    problem: Problem, kind: type[SingularPoints | Cusps], lines: Prolongation, x: Array, steps: int
) -> tuple[Array, Array, Fact]:
    """Where Newton's method leads from x (B, unknowns), how near zeros are proved to be, and the fact about these.

    Returns:
        x, of shape (B, unknowns), the errors, NaN where nothing is proved, of shape (B,), and the fact.
    """
    with np.errstate(all="ignore"):
        x = solved(problem, lines, x, steps)
    fact, proved = prove_some(kind(lines.equations, x, lines.origin, lines.directions, lines.pairing))
    error = np.full(len(x), np.nan)
    error[proved] = fact.found["error"]
    return x, error, fact
