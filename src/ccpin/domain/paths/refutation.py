"""Refutations of claims about σ: a singular configuration proved to lie on the branch, or a q proved to have none.

That a singular configuration lies on the branch is Proposition L of `ccpin/proof/theorems/branch.md`: the curve that it
needs is walked here, and the kernel makes a fact of it (`ccpin.proof.lines`).
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress

import numpy as np
from scipy.interpolate import PPoly

from ccpin.arrays import Array
from ccpin.covering.proposals.krawczyk import certify_boxes
from ccpin.covering.proposals.solving import extrapolate
from ccpin.domain.closures.system import Reading
from ccpin.domain.paths.walker import Walker
from ccpin.domain.singular.folds import SearchedLines, singular_points
from ccpin.errors import SingularConfigurationError
from ccpin.proof.emptiness import empty_cells, groups_of
from ccpin.proof.equations import Problem, closures_of, problem_of
from ccpin.proof.facts import Fact, NotProvedError, prove
from ccpin.proof.lines import SingularOnSegment, line_system
from ccpin.proof.solutions import Met, SolutionsInBoxes
from ccpin.proof.verdict import Witness

_JOINS = np.geomspace(1e-3, 1e-11, 9)  # half widths of boxes that join two curves
_BEYOND = 0.05  # of the way to a fold: how far past it


def empty_witness(problem: Problem, q: Array) -> Witness | None:
    """The first of the points (K, n) that is proved to have no closed configuration."""
    system = problem.system
    groups = groups_of(system)
    if not groups:
        return None
    empty = np.flatnonzero(empty_cells(system, groups, q, np.zeros_like(q)))
    return Witness("empty", q[empty[0]].copy(), None, 0.0) if empty.size else None


def singular_witness(walker: Walker, reading: Reading, targets: Iterable[Array]) -> Witness | None:
    """A singular configuration of a walker's branch, over a segment from its place to one of some q (n,)."""
    problem, theta, system = walker.problem, walker.theta, walker.problem.system
    join = _join(walker)
    directions = np.array([target - theta[system.independent] for target in targets]).reshape(-1, system.n)
    directions = directions[np.any(directions != 0.0, axis=1)]
    if join is None or not len(directions):
        return None
    found = singular_points(problem, np.tile(theta, (len(directions), 1)), directions)
    inside = found.proved & (found.along >= found.error) & (found.along <= 1.0 - found.error)
    for k in np.flatnonzero(inside)[np.argsort(found.along[inside])]:
        fact = _on_branch(walker, join, directions[k], found, int(k))
        if fact is not None and walker.leads_to(join.premises[0]):
            singular = fact.found["theta"][0]
            q_free = reading.configuration(singular)
            return Witness("singular", singular[system.independent].copy(), q_free, float(fact.found["error"][0]))
    return None


def _join(walker: Walker) -> Fact | None:
    """That the walker's place is in a box of q-space."""
    equations, n, point = closures_of(walker.problem), walker.problem.system.n, walker.point_here()
    if point is None:
        return None
    none, number = np.zeros((1, n)), np.zeros(1, dtype=np.int64)
    for half in _JOINS:
        tried = certify_boxes(walker.problem, walker.theta[None], np.full((1, n), half), np.eye(n))
        with suppress(NotProvedError):
            box = prove(SolutionsInBoxes(equations, *tried.boxes))
            return prove(Met(equations, number, number, none, none, number), point, box)
    return None


def _on_branch(walker: Walker, join: Fact, direction: Array, found: SearchedLines, row: int) -> Fact | None:
    """The fact that the singular configuration of a line lies on the branch: a curve is walked as far as to it."""
    problem, theta, singular = walker.problem, walker.theta, found.theta[row]
    j = int(problem.system.dependent[int(np.argmax(np.abs(found.kernel[row])))])
    line = line_problem(problem, theta, direction, j)
    start, end = float(theta[j]), float(singular[j])
    end += _BEYOND * (end - start) + np.copysign(10.0 * found.error[row], end - start)
    pieces = PPoly(np.array([[[end - start]], [[start]]]), np.array([0.0, 1.0]))
    delta = float(join.premises[1].claim.half.min() / np.abs(direction).max())
    moved = extrapolate(problem, theta, 0.1 * delta * direction[None])[0, j] - start
    try:
        way = Walker(line, pieces, np.zeros(1), theta)
    except SingularConfigurationError:
        return None
    curve = way.proved() if way.walk(abs(moved / (end - start))) is None else None
    if curve is None:
        return None
    at = (singular[j] - start) / (end - start)
    box = int(np.clip(np.searchsorted(way.times, at) - 1, 0, len(way.times) - 2))
    numbers = np.array([np.count_nonzero(found.proved[:row])]), np.array([box])
    with suppress(NotProvedError):
        return prove(SingularOnSegment(closures_of(problem), *numbers), join, curve, found.fact)
    return None


def line_problem(problem: Problem, theta: Array, direction: Array, parameter: int) -> Problem:
    """The closures with the rows of a line through θ, and one entry of θ as the only independent coordinate."""
    system = line_system(problem.system, theta[problem.system.independent], direction, parameter)
    return problem_of(system, "reach" if problem.phasors is None else "planar")
