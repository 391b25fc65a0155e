"""Finding the sheets of a mechanism over a region: search, count, certify, glue."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import instance, joined, positive, whole
from ccpin.covering.cells import CellStatus, SingularCells
from ccpin.covering.region import Corners, Region
from ccpin.covering.runner import Progress, Runner, Work, reporter
from ccpin.domain.closures.packing import require_about
from ccpin.domain.closures.searchable import check_searchable, region_about, searched_ranges
from ccpin.domain.closures.system import Reading, reading_of
from ccpin.domain.sheets.counting import Cover, cover_singular
from ccpin.domain.sheets.cover import Front, glued_pairs
from ccpin.domain.sheets.sheet_claims import counted_parts, mark, proved_sheets
from ccpin.domain.sheets.sheets import SheetAtlas
from ccpin.domain.singular.marking import mark_in_cells
from ccpin.errors import InvalidInputError
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of
from ccpin.proof.cell_tree import LEVELS
from ccpin.proof.equations import BoundsName
from ccpin.proof.ranges import Ranges
from ccpin.work import FEW, Stopped, executor_for, stoppable

_DEPTHS = {1: 10, 2: 7, 3: 4}  # halvings of an edge
_DEEPER = 3  # halvings more for boxes


def certify_sheets(
    mechanism: Mechanism | HasMechanism,
    region: Corners | None = None,
    *,
    max_depth: int | None = None,
    budget: int = 3_000_000,
    seconds: float | None = None,
    bounds: BoundsName = "auto",
    workers: int | None = None,
    executor: Executor | None = None,
    checkpoint: str | Path | None = None,
    begun: SheetAtlas | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> SheetAtlas:
    """Find and certify every sheet of σ over a region.

    All closed configurations are counted, those of every assembly mode: all angles of the dependent joints, and of
    slides and of joints bound by couplings all there is within their limits. What is searched of those, and why that is
    all, is in `SheetAtlas.ranges`.

    Args:
        mechanism: A mechanism (or its model) with up to three scalar independent coordinates and revolute, prismatic,
            universal, cylindrical or planar joints.
        region: (lower, upper), the bounds of the coordinates, each of shape (n,); default as for `certify`.
        max_depth: How often an edge of the region may be halved in the search for singular configurations;
            default 10, 7, 4 for n = 1, 2, 3. Boxes about sheets may be halved three times more.
        budget: How many boxes of all coordinates may be tried in that search; cells that it did not come to are
            undecided. Each dependent coordinate more multiplies what is needed.
        seconds: When to stop, measured by the clock: the search takes half of it at most, counting and boxes the rest.
            What is proved by then is kept, as after Ctrl-C.
        bounds: ``"auto"`` (planar where the mechanism is), ``"planar"`` or ``"reach"``.
        workers: How many to share the work among, as for `certify`: up to four are threads, more of them processes,
            for which a script needs the guard ``if __name__ == "__main__":``. The result is the same.
        executor: In place of `workers` anything with ``submit``, as for `certify`.
        checkpoint: A folder in which finished chunks are kept; the same call finds them again after a crash.
        begun: Sheets of the same mechanism and region, interrupted or cut short: the search goes on from theirs.
        progress: Called after every wave: of the search (cells waiting are those that may hold singular
            configurations), then of boxes.

    Returns:
        The sheets; after Ctrl-C, or when the time is over, what was proved so far, with ``complete`` False.

    Raises:
        UnsupportedMechanismError: More than three coordinates or eight dependent ones, ball joints, distance closures,
            couplings of continuous joints, redundant rows, closures that cannot be bounded or whose rows vanish with
            their ends turned over too, or a slide or a coupled joint that limits, lengths and couplings do not bound.
        InvalidInputError: The region, max_depth, seconds or workers is malformed, or `begun` is of another region.
        DifferentSubjectsError: `begun` is of other closures.
    """
    mechanism = mechanism_of(mechanism)
    reading = reading_of(mechanism, mechanism.q_reference)
    check_searchable(mechanism, reading)
    depth = _DEPTHS[mechanism.n] if max_depth is None else whole(max_depth, "max_depth", 1)
    if not depth + _DEEPER < LEVELS:
        raise InvalidInputError(f"max_depth must be from 1 to {LEVELS - _DEEPER - 1}; it is {depth}")
    time = None if seconds is None else positive(seconds, "seconds")
    reading = reading.bounded(bounds)
    area = region_about(mechanism, reading, region)
    effort, work = Effort(depth, whole(budget, "budget"), time), Work(workers, executor, checkpoint, progress)
    ranges = searched_ranges(mechanism, reading, area)
    cover = None if begun is None else _begun(mechanism, area, ranges, instance(begun, "begun", SheetAtlas))
    found = _survey(reading, tuple(mechanism.independent), area, ranges, effort, work, cover)
    return found if begun is None else replace(found, source=begun.source)


def _begun(mechanism: Mechanism, region: Region, ranges: Ranges, begun: SheetAtlas) -> Cover:
    """What a search has come to, if it is one of the same closures, region and ranges."""
    require_about("a search for sheets that goes on", begun, mechanism)
    here: tuple[ArrayLike, ...] = (region.lower, region.upper, region.wrapped, *ranges)
    there: tuple[ArrayLike, ...] = (begun.region.lower, begun.region.upper, begun.region.wrapped, *begun.ranges)
    if not all(np.array_equal(one, other) for one, other in zip(here, there, strict=True)):
        raise InvalidInputError("begun is of another region or of other limits: give those that it was begun with")
    return Cover(deepcopy(begun.tree), begun.left, begun.complete)


class Effort(NamedTuple):
    """How far a search for sheets goes: halvings of an edge, candidates tried, and seconds (``None``: no end)."""

    depth: int
    budget: int
    seconds: float | None


def _survey(
    reading: Reading,
    names: tuple[str, ...],
    region: Region,
    ranges: Ranges,
    effort: Effort,
    work: Work,
    begun: Cover | None,
) -> SheetAtlas:
    """Search, count, certify, glue, and have all of it proved."""
    report, problem = reporter(work.progress), reading.problem
    with stoppable(effort.seconds) as flag, executor_for(work.executor, work.workers, FEW) as chosen:
        runner = Runner(problem, chosen, work.checkpoint, flag)
        first = runner.within(None if effort.seconds is None else 0.5 * effort.seconds)
        cover = cover_singular(first, region, ranges, effort.depth, effort.budget, report, begun)
        tree, leaves, open_cells = cover.tree, cover.tree.leaves(), np.unique(cover.left.cell)
        tree.status[leaves] = CellStatus.UNDECIDED
        parts, counted = counted_parts(runner, tree, region, ranges, np.setdiff1d(leaves, open_cells))
        front = Front(runner, region, tree, parts, effort.depth + _DEEPER, report)
        complete, joined_by = cover.complete and not flag.is_set(), None
        singular = [SingularCells.none(reading.system.n_free)]
        try:
            front.run()
            joined_by = glued_pairs(runner, region, tree, front.members, front.boxes)
            start = np.unique(cover.left.cell, return_index=True)[1]
            for found in mark_in_cells(runner, tree, region, open_cells, cover.left.centre[start]):
                singular.append(found)
        except Stopped:
            complete = False
        glued = front.glued if joined_by is None else joined_by
        proved = proved_sheets(problem, tree, front.boxes, front.members, glued, counted)
        mark(tree, proved)
    return SheetAtlas(
        names=names,
        region=region,
        reading=reading,
        tree=tree,
        boxes=proved.boxes,
        members=proved.members,
        glued=proved.glued,
        count=proved.count,
        left=cover.left,
        ranges=ranges,
        complete=complete,
        singular=joined(singular),
        proved=proved,
    )
