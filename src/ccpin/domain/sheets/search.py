"""Finding the sheets of a mechanism over a region: search, count, certify, glue."""

from __future__ import annotations

import numpy as np

from ccpin.arrays import Indices, whole
from ccpin.domain.atlas.cells import LEVELS, CellStatus, CellTree, Corners, Region, corners_of, region_of
from ccpin.domain.atlas.singular import mark_in_cells
from ccpin.domain.boxes import BoundsName, Problem, problem_of
from ccpin.domain.chains import ClosureSystem, Seed, closure_system
from ccpin.domain.sheets.front import Front, Part, glued_pairs, parts_of
from ccpin.domain.sheets.paving import MOST_DEPENDENT, Ranges, all_solutions, cover_singular, place
from ccpin.domain.sheets.sheets import SheetAtlas
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of

_DEPTHS = {1: 10, 2: 7, 3: 4}
_DEEPER = 3
_COUNTED = 64


def certify_sheets(
    mechanism: Mechanism | HasMechanism,
    region: Corners | None = None,
    *,
    max_depth: int | None = None,
    budget: int = 3_000_000,
    bounds: BoundsName = "auto",
) -> SheetAtlas:
    """Find and certify every sheet of σ over a region.

    All closed configurations are counted, those of every assembly mode: all angles of the dependent joints, and all
    lengths of dependent slides within the joints' limits (without limits, within the sum of all lengths).

    Args:
        mechanism: A mechanism (or its model) with up to three scalar independent coordinates and revolute, prismatic,
            universal, cylindrical or planar joints.
        region: (lower, upper), the bounds of the coordinates, each of shape (n,); default as for `certify`.
        max_depth: How often an edge of the region may be halved in the search for singular configurations;
            default 10, 7, 4 for n = 1, 2, 3. Boxes about sheets may be halved three times more.
        budget: How many boxes of all coordinates may be tried in that search; cells that it did not come to are
            undecided. Each dependent coordinate more multiplies what is needed.
        bounds: ``"auto"`` (planar where the mechanism is), ``"planar"`` or ``"reach"``.

    Raises:
        UnsupportedMechanismError: More than three coordinates or eight dependent ones, ball joints, distance closures,
            couplings of continuous joints, redundant rows, or closures that cannot be bounded.
        InvalidInputError: The region or max_depth is malformed.
    """
    mechanism = mechanism_of(mechanism)
    system = closure_system(mechanism, mechanism.q_reference)
    _refuse(mechanism, system)
    depth = _DEPTHS[mechanism.n] if max_depth is None else whole(max_depth, "max_depth", 1)
    if not depth + _DEEPER < LEVELS:
        raise InvalidInputError(f"max_depth must be from 1 to {LEVELS - _DEEPER - 1}; it is {depth}")
    problem, area = problem_of(system, bounds), _region(mechanism, system, region)
    ranges = _ranges(mechanism, system)
    cover = cover_singular(problem, area, ranges, depth, whole(budget, "budget"))
    tree, leaves = cover.tree, cover.tree.leaves()
    open_cells = np.unique(cover.left.cell)
    parts = _counted(problem, tree, area, ranges, np.setdiff1d(leaves, open_cells))
    tree.status[leaves] = CellStatus.UNDECIDED
    front = Front(problem, area, tree, parts, depth + _DEEPER)
    front.run()
    count = np.full(len(tree.child), -1, dtype=np.int64)
    known = front.part >= 0
    count[known] = np.array([len(part.theta) for part in parts] or [0], dtype=np.int64)[front.part[known]]
    first = np.unique(cover.left.cell, return_index=True)[1]
    mark_in_cells(problem, tree, area, open_cells, cover.left.centre[first])
    return SheetAtlas(
        names=tuple(mechanism.independent),
        region=area,
        problem=problem,
        tree=tree,
        boxes=front.boxes,
        members=front.members,
        glued=glued_pairs(problem, area, tree, front.members, front.boxes),
        count=count,
        left=cover.left,
        ranges=ranges,
    )


def _refuse(mechanism: Mechanism, system: ClosureSystem) -> None:
    """What cannot be searched exhaustively."""
    why = None
    if not 1 <= mechanism.n <= max(_DEPTHS):
        why = f"it has {mechanism.n} independent coordinates, and sheets are for one to three"
    elif system.m > MOST_DEPENDENT:
        why = f"{system.m} of its coordinates depend, and all values of more than {MOST_DEPENDENT} take too long"
    elif any(joint.kind.unit == 4 for joint in system.chart.joints):
        why = "it has ball joints, whose turns have no range to be searched; universal joints have"
    elif system.rods:
        why = "distance closures stand for rods with two angles, which say the same twice"
    elif np.any(system.moduli):
        why = "it has couplings of continuous joints"
    if why is not None:
        raise UnsupportedMechanismError(f"{mechanism.name}: its sheets cannot be counted: {why}")


def _region(mechanism: Mechanism, system: ClosureSystem, region: Corners | None) -> Region:
    theta = system.theta(mechanism.q_reference)
    if region is not None:
        theta[system.independent] = np.mean(corners_of(region, mechanism.independent), axis=0)
    return region_of(mechanism, Seed(system, theta), region)


def _ranges(mechanism: Mechanism, system: ClosureSystem) -> Ranges:
    """Full turns, the limits of slides, and where those have none the sum of all lengths."""
    model, middle = mechanism.tree.model, system.theta(mechanism.q_reference)
    low, high = middle - np.pi, middle + np.pi
    slides = np.flatnonzero(~system.periodic)
    low[slides], high[slides] = -system.scale, system.scale
    for joint in system.chart.joints:
        index = joint.v.start
        if joint.kind.nq == 1 and not system.periodic[index]:
            limits = model.lowerPositionLimit[joint.q.start], model.upperPositionLimit[joint.q.start]
            low[index], high[index] = max(low[index], limits[0]), min(high[index], limits[1])
    return Ranges(low[system.dependent], high[system.dependent])


def _counted(problem: Problem, tree: CellTree, region: Region, ranges: Ranges, regular: Indices) -> list[Part]:
    """The largest parts of the regular cells, with all solutions over one q of each where that was proved."""
    parts = []
    for cells in parts_of(tree, region, regular)[:_COUNTED]:
        largest = int(cells[int(np.argmax(tree.shares(cells)))])
        q = place(tree, region, np.array([largest]))[0][0]
        found = all_solutions(problem, ranges, q)
        if found.complete:
            parts.append(Part(cells, largest, found.theta))
    return parts
