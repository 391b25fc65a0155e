"""Where two sheets touch: a fold proved to lie between them.

**Proposition T.** Along a straight line of q let boxes glued one behind the other carry a curve of closed
configurations with one dependent coordinate as the parameter (`proof/theorems/branch.md` joins the line's rows to φ).
Let its first point lie in a box of sheet A and its last in one of sheet B, and let a singular configuration proved by
Theorem S lie on it. Then this one is a simple fold of the line: beyond its q on the line two solutions near it have
vanished, and on this side they lead to A and to B, on the curve.

*Proof.* Theorem S says that the kernel of φ_y has one dimension and that s has a nonzero second derivative along the
curve. By uniqueness in the box that holds it the configuration is a point of the curve. ∎
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.interpolate import PPoly

from ccpin.arrays import Array, Indices
from ccpin.domain.paths.refutation import line_problem
from ccpin.domain.paths.walker import Walker
from ccpin.domain.singular.folds import Folds, SearchedLines, singular_points
from ccpin.errors import SingularConfigurationError
from ccpin.proof.equations import Problem
from ccpin.proof.lines import holds, lies_in
from ccpin.proof.newton import Boxes
from ccpin.proof.solutions import boxes_of

_REACH = 3.0  # cells: folds farther from where they were looked for are other ones
_STRIDE = 0.02  # of the way


class Fold(NamedTuple):
    """A singular configuration at which two sheets touch.

    Attributes:
        q: Its independent coordinates, of shape (n,).
        q_free: The configuration, of shape (nq,).
        error: The exact one is this near in every coordinate (rad, m).
        sheets: The numbers of the two sheets, the lower first; twice the same where a sheet is folded upon itself
            beyond the region or through cells that are not certified.
    """

    q: Array
    q_free: Array
    error: float
    sheets: tuple[int, int]


def near_folds(problem: Problem, theta: Array, width: Array) -> tuple[SearchedLines, Array, Indices]:
    """Folds proved near configurations θ (B, n′), along the fold's normal, and the directions; those within reach."""
    directions = Folds.near(problem, theta).directions()[0]
    found = singular_points(problem, theta, directions)
    independent = problem.system.independent
    away = np.abs(found.theta[:, independent] - theta[:, independent])
    with np.errstate(invalid="ignore"):
        near = found.proved & np.all(away <= _REACH * width, axis=1)
    return found, directions, np.flatnonzero(near)


def cross(
    problem: Problem, start: tuple[Array, Boxes], direction: Array, fold: tuple[Array, Array, float], others: Boxes
) -> int | None:
    """Follow the curve from a configuration in a box over a fold, to as far beyond; which other box holds its end.

    Args:
        problem: The closures.
        start: θ (n′,), and the box that carries it.
        direction: d of the line, of shape (n,).
        fold: The singular θ, its kernel and its error.
        others: Boxes that may hold the end.
    """
    theta, box = start
    singular, kernel, error = fold
    j = int(problem.system.dependent[int(np.argmax(np.abs(kernel)))])
    line = line_problem(problem, theta, direction, j)
    first, rise = float(theta[j]), 2.0 * float(singular[j] - theta[j])
    if abs(rise) < 100.0 * error:
        return None
    pieces = PPoly(np.array([[[rise]], [[first]]]), np.array([0.0, 1.0]))
    try:
        walker = Walker(line, pieces, np.zeros(1), theta)
    except SingularConfigurationError:
        return None
    curve = walker.proved() if walker.walk(_STRIDE) is None else None
    if curve is None:
        return None
    boxes = boxes_of(curve.premises[:1])
    if not lies_in(problem, box, line, boxes.take(np.array([0])), -1.0):
        return None
    k = int(np.clip(np.searchsorted(walker.times, 0.5) - 1, 0, len(walker.times) - 2))
    if not any(
        holds(line, boxes.take(np.array([i])), singular, error)
        for i in (k, k - 1, k + 1)
        if 0 <= i < len(walker.times) - 1
    ):
        return None
    last = boxes.take(np.array([len(walker.times) - 2]))
    for number in range(len(others.kappa)):
        if lies_in(problem, others.take(np.array([number])), line, last, 1.0):
            return number
    return None
