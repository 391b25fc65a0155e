"""Refutations of claims about σ: a singular configuration proved to lie on the branch, or a q proved to have none.

**Proposition.** Let σ be continued from a closed configuration (q_r, y_r) along the straight line q_r + s d. Suppose

1. a box of Theorem N that holds q_r + s d for |s| ≤ δ carries that branch (it is glued to it at q_r),
2. with one dependent coordinate θ_j as the parameter instead of s, boxes glued one behind the other (`walker`) carry a
   curve of closed configurations over the line; its first point lies over the box of 1 and in its tube, and s is
   between −δ and 1 on all of them,
3. a singular configuration over the line, proved by Theorem S of `singular.folds`, lies on that curve.

Then σ is not smooth and nonsingular on all of the segment 0 ≤ s ≤ 1.

*Proof.* Suppose it were; by 1 it is so for −δ ≤ s ≤ 1 then. The parameters at which the curve is a point of σ's graph
over the line are a closed set, an open one by the implicit function theorem, and include the first by uniqueness in 1.
The curve is connected, so all of it is σ's graph, on which φ_y is nonsingular; but by 3 it is singular somewhere on
the curve. ∎

The line's rows are linear: with N an orthonormal basis of the directions perpendicular to d, Nᵀ(q − q_r) = 0 joins φ as
couplings, and {θ_j} takes the place of q. N is meant exactly; the numbers that stand for it and for Nᵀq_r are off by a
few roundings, far within the margin γ that the bounds allow every row.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from scipy.interpolate import PPoly

from ccpin.arrays import Array, Indices, apply
from ccpin.covering.proposals.krawczyk import certify_boxes
from ccpin.covering.proposals.solving import extrapolate
from ccpin.domain.closures.system import Reading
from ccpin.domain.paths.walker import Walker
from ccpin.domain.singular.folds import singular_points
from ccpin.errors import SingularConfigurationError
from ccpin.proof.emptiness import empty_cells, groups_of
from ccpin.proof.equations import Problem, closures_of, problem_of
from ccpin.proof.newton import Boxes, check, encloses, solve_in_boxes
from ccpin.proof.rounding import SLACK, blur
from ccpin.proof.verdict import Witness

_JOINS = np.geomspace(1e-3, 1e-11, 9)  # half widths of boxes that join two curves
_BEYOND = 0.05  # of the way to a fold: how far past it
_ROOM = 4.0  # times what the singular configuration is uncertain by: how much wider a box's tube may be made


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
    problem, theta = walker.problem, walker.theta
    system = problem.system
    join = _join(walker)
    directions = np.array([target - theta[system.independent] for target in targets]).reshape(-1, system.n)
    directions = directions[np.any(directions != 0.0, axis=1)]
    if join is None or not len(directions):
        return None
    found = singular_points(problem, np.tile(theta, (len(directions), 1)), directions)
    inside = found.proved & (found.along >= found.error) & (found.along <= 1.0 - found.error)
    for k in np.flatnonzero(inside)[np.argsort(found.along[inside])]:
        direction, singular, kernel = directions[k], found.theta[k], found.kernel[k]
        error = found.error[k] * np.maximum(1.0, np.abs(direction).max())
        if _on_branch(problem, theta, join, direction, singular, kernel, float(error)):
            q_free = reading.configuration(singular)
            return Witness("singular", singular[system.independent].copy(), q_free, float(error))
    return None


def _join(walker: Walker) -> Boxes | None:
    """A box of q-space about the walker's place that carries its branch."""
    n = walker.problem.system.n
    for half in _JOINS:
        tried = certify_boxes(walker.problem, walker.theta[None], np.full((1, n), half), np.eye(n))
        if tried.proved[0] and walker.carries(tried.boxes, np.zeros((1, n))):
            return tried.boxes
    return None


def _on_branch(
    problem: Problem, theta: Array, join: Boxes, direction: Array, singular: Array, kernel: Array, error: float
) -> bool:
    """2. and 3. of the proposition."""
    system = problem.system
    j = int(system.dependent[int(np.argmax(np.abs(kernel)))])
    delta = float(join.half.min() / np.abs(direction).max())
    line = line_problem(problem, theta, direction, j)
    start, end = float(theta[j]), float(singular[j])
    end += _BEYOND * (end - start) + np.copysign(10.0 * error, end - start)
    pieces = PPoly(np.array([[[end - start]], [[start]]]), np.array([0.0, 1.0]))
    moved = extrapolate(problem, theta, 0.1 * delta * direction[None])[0, j] - start
    try:
        walker = Walker(line, pieces, np.zeros(1), theta)
    except SingularConfigurationError:
        return False
    if walker.walk(abs(moved / (end - start))) is not None:
        return False
    at = (singular[j] - start) / (end - start)
    k = int(np.clip(np.searchsorted(walker.times, at) - 1, 0, len(walker.times) - 2))
    boxes = walker.boxes.take(np.arange(k + 1))
    if not lies_in(problem, join, line, boxes.take(np.array([0])), -1.0):
        return False
    low, high = _range_along(line, boxes, system.independent, theta, direction)
    return low >= -delta and high <= 1.0 and holds(line, boxes.take(np.array([k])), singular, error)


def holds(line: Problem, box: Boxes, singular: Array, error: float) -> bool:
    """Whether the exact singular configuration, within `error` of the computed one, lies in a box's tube."""
    independent = line.system.independent
    along = float(box.directions[0, independent[0], 0])
    s = (singular[independent] - box.centre[0, independent]) / along
    spread = error / abs(along)
    if not abs(s[0]) + spread <= 1.0:
        return False
    reach = error + np.abs(box.directions[0, :, 0][line.system.dependent]) * spread
    room = _ROOM * np.abs(np.linalg.inv(box.modes[0])) @ reach
    wide = box._replace(radius=box.radius + room, kappa=np.full(1, 0.999))
    box = wide if check(closures_of(line), wide).proved[0] else box
    return bool(encloses(line, box, np.array([[s[0], 0.0]]), singular[None], reach[None])[0])


def lies_in(problem: Problem, join: Boxes, line: Problem, box: Boxes, side: float) -> bool:
    """Whether the end of a box of the curve (−1: its first point, 1: its last) lies over the join and in its tube."""
    found = solve_in_boxes(line, box, np.array([[side, 0.0]]))
    error = np.zeros(problem.system.n_free)
    error[line.system.dependent] = (np.abs(box.modes[0]) @ found.error[0]) + 1e-15 * (
        1.0 + np.abs(found.theta[0][line.system.dependent])
    )
    theta, independent, dependent = found.theta[0], problem.system.independent, problem.system.dependent
    offset = theta[independent] - join.centre[0, independent]
    if not np.all(np.abs(offset) + error[independent] <= join.half[0]):
        return False
    reach = error[dependent] + np.abs(join.directions[0][dependent]) @ error[independent]
    return bool(encloses(problem, join, offset[None], theta[None], reach[None])[0])


def _range_along(line: Problem, boxes: Boxes, rows: Indices, theta: Array, direction: Array) -> tuple[float, float]:
    """Bounds of s on the boxes' tubes, rounding with them; `rows` are the places of q in θ."""
    modes = np.zeros((len(boxes.kappa), line.system.n_free, line.system.m))
    modes[:, line.system.dependent] = boxes.modes
    along = direction / (direction @ direction)
    middle = (boxes.centre[:, rows] - theta[rows]) @ along
    spread = (
        apply(np.abs(along @ boxes.directions[:, rows])[:, None], boxes.half)[:, 0]
        + apply(np.abs(along @ modes[:, rows])[:, None], boxes.radius)[:, 0]
        + blur(np.abs(boxes.centre[:, rows]) + np.abs(theta[rows])) @ np.abs(along)
    ) * SLACK
    return float((middle - spread).min()), float((middle + spread).max())


def line_problem(problem: Problem, theta: Array, direction: Array, parameter: int) -> Problem:
    """The closures and the rows Nᵀ(q − q_r) = 0, with one entry of θ as the only independent coordinate."""
    system = problem.system
    n = system.n
    across = np.linalg.svd(direction[None])[2][1:]
    rows = np.zeros((n - 1, system.n_free))
    rows[:, system.independent] = across
    offset = -across @ theta[system.independent]
    others = np.setdiff1d(np.arange(system.n_free), [parameter])
    chains = tuple(
        chain._replace(weights=np.concatenate([chain.weights, np.zeros((n - 1, 3))])) for chain in system.chains
    )
    extended = replace(
        system,
        chains=chains,
        couplings=np.concatenate([system.couplings, rows]),
        offset=np.concatenate([system.offset, offset]),
        moduli=np.concatenate([system.moduli, np.zeros(n - 1)]),
        independent=np.array([parameter]),
        dependent=others,
        periodic=system.periodic
        & ~np.any(rows != 0.0, axis=0),  # of these coordinates the rows know more than an angle
    )
    return problem_of(extended, "reach" if problem.phasors is None else "planar")
