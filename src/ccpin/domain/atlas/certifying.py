"""Making an atlas: the largest square about a seed, then the region, as far as the effort asked for goes."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Executor
from pathlib import Path
from typing import NamedTuple

from numpy.typing import ArrayLike

from ccpin.arrays import Array, joined, number, positive, whole
from ccpin.covering.cells import CellStatus
from ccpin.covering.claims import proved_boxes, proved_glue
from ccpin.covering.proposals.tasks import compiled
from ccpin.covering.region import Corners, Region
from ccpin.covering.runner import Progress, Runner, Work, reporter
from ccpin.domain.atlas.atlas import Atlas
from ccpin.domain.atlas.cover import BUDGET, AtlasBuilder, SquareNorm
from ccpin.domain.atlas.cover_claims import proved_cover, seams_of
from ccpin.domain.atlas.emptying import empty_facts, prove_empty, search_empty
from ccpin.domain.closures.searchable import region_of
from ccpin.domain.closures.seeds import seed_at_coordinates
from ccpin.domain.closures.system import Reading
from ccpin.domain.singular.marking import mark_singular
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of
from ccpin.proof.cell_tree import LEVELS
from ccpin.proof.equations import BoundsName
from ccpin.work import Stopped, executor_for, stoppable

_DEPTHS = {1: 14, 2: 12, 3: 6}  # halvings of an edge: some ten seconds a mechanism
_TOLERANCES = {1: 1e-5, 2: 2e-5, 3: 2e-3}  # of the largest square, a share of it
_MANY_DEPTH, _MANY_TOLERANCE = 3, 0.5  # beyond three coordinates
_FIRST_DEPTH, _DEEPEST, _MANY_DEEPEST = 4, 20, 10  # for a share of the region: first, last, last where n > 2


def certify(
    mechanism: Mechanism | HasMechanism,
    q0: ArrayLike,
    region: Corners | None = None,
    near: Array | None = None,
    *,
    max_depth: int | None = None,
    exhaustive: bool = False,
    resolution: float | None = None,
    fraction: float | None = None,
    budget: int = BUDGET,
    seconds: float | None = None,
    bounds: BoundsName = "auto",
    workers: int | None = None,
    executor: Executor | None = None,
    checkpoint: str | Path | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Atlas:
    """Prove σ on as much of a region as can be reached from q₀.

    First the largest square about q₀ is certified (to 0.1 % or better for n ≤ 2, roughly for n > 3), then the rest
    of the region.

    Args:
        mechanism: A mechanism (or its model) with scalar independent coordinates; beyond three a region must be given.
        q0: The seed, of shape (n,) (rad, m).
        region: (lower, upper), the bounds of the coordinates, each of shape (n,); default a full turn for a joint whose
            limits allow it, the limits otherwise. A full turn closes on itself.
        near: A closed configuration on the branch wanted, of shape (nq,); default the reference.
        max_depth: How often an edge of the region may be halved (0: the square only); default 14, 12, 6 for n = 1,
            2, 3, and 3 beyond.
        exhaustive: Prove cells empty of which the triangle inequality says nothing, by Theorem E of `atlas.platform`
            (legs of known lengths that meet in a platform) and by a search of all values of the dependent coordinates,
            up to eight; that takes several times as long as the boxes.
        resolution: How fine the largest square is sought: cells at its edge are halved to this share of their distance
            from q₀; default 1e-5, 2e-5, 2e-3 for n = 1, 2, 3, and 0.5 beyond. What the radius falls short by is a few
            times as much where the branch ends in a fold.
        fraction: The share of the region (0 to 1) to be decided, certified or proved empty: edges are halved once more
            until it is reached, or `max_depth`, whose default then is 20 for n ≤ 2 and 10 beyond.
        budget: How many boxes may be proved; cells that it did not come to are left as they are.
        seconds: When to stop, measured by the clock; what is proved by then is kept, as after Ctrl-C.
        bounds: ``"auto"`` (planar where the mechanism is), ``"planar"`` or ``"reach"``.
        workers: How many to share the work among; default none: this thread does all. They are threads, whom the
            compiled core lets go on side by side; where NumPy does its work (`ccpin.backend`) they are processes, and
            a script that asks for more than one needs the guard ``if __name__ == "__main__":``.
        executor: In place of `workers` anything with ``submit``: a process pool, Dask's ``client.get_executor()``.
            The result depends on neither.
        checkpoint: A folder in which finished chunks are kept; the same call finds them again after a crash.
        progress: Called after every wave.

    Returns:
        The atlas; after Ctrl-C, or when the budget or the time is over, what was certified so far, with ``complete``
        False.

    Raises:
        UnsupportedMechanismError: More than three coordinates and no region, redundant rows, or closures that cannot
            be bounded.
        InvalidInputError: q₀, region, max_depth, resolution, fraction, budget, seconds or workers is malformed.
        UnreachableError, SingularConfigurationError: σ(q₀) does not exist on the branch, or is singular.
    """
    mechanism = mechanism_of(mechanism)
    if mechanism.n > max(_DEPTHS) and region is None:
        raise UnsupportedMechanismError(
            f"{mechanism.name} has {mechanism.n} independent coordinates; beyond {max(_DEPTHS)} a map is of a region= "
            "that is given, some times kantorovich_radius wide (its cells double with every halving of every edge). "
            "certify_path is for moves"
        )
    seed = seed_at_coordinates(mechanism, q0, near)
    usual = _DEPTHS.get(mechanism.n, _MANY_DEPTH)
    effort = effort_of(usual, max_depth, fraction, budget, seconds, mechanism.n)
    effort = effort._replace(exhaustive=exhaustive)
    if resolution is None:
        effort = effort._replace(tolerance=_TOLERANCES.get(mechanism.n, _MANY_TOLERANCE))
    else:
        effort = effort._replace(tolerance=positive(resolution, "resolution"))
    reading = seed.reading.bounded(bounds)
    area = region_of(mechanism, seed, region)
    return certify_region(
        reading, seed.theta, tuple(mechanism.independent), area, effort, Work(workers, executor, checkpoint, progress)
    )


class Effort(NamedTuple):
    """How far a survey goes.

    Attributes:
        depth: How often an edge of the region may be halved; 0: only the largest square is sought.
        tolerance: Edges of the largest square's cells are halved to this share of their distance from the seed;
            ``None``: no square comes first.
        fraction: The share of the region to be decided, ``None``: all that can be at `depth`.
        budget: How many boxes may be proved.
        seconds: When to stop.
        exhaustive: Whether cells are proved empty by search of all dependent coordinates too.
    """

    depth: int
    tolerance: float | None = None
    fraction: float | None = None
    budget: int = BUDGET
    seconds: float | None = None
    exhaustive: bool = False


def effort_of(
    usual: int, max_depth: int | None, fraction: float | None, budget: int, seconds: float | None, n: int
) -> Effort:
    """The effort asked for, over n coordinates that are not held.

    Raises:
        InvalidInputError: An argument is malformed.
    """
    if fraction is not None:
        usual = _DEEPEST if n <= 2 else _MANY_DEEPEST
        if not 0.0 < number(fraction, "fraction") <= 1.0:
            raise InvalidInputError(f"fraction is a share of the region, above 0 and at most 1; it is {fraction!r}")
    depth = usual if max_depth is None else whole(max_depth, "max_depth", 0)
    if not depth < LEVELS:
        raise InvalidInputError(f"max_depth must be from 0 to {LEVELS - 1}; it is {depth}")
    time = None if seconds is None else positive(seconds, "seconds")
    return Effort(depth, None, fraction, whole(budget, "budget"), time)


def certify_region(
    reading: Reading,
    seed: Array,
    names: tuple[str, ...],
    region: Region,
    effort: Effort,
    work: Work,
    shape: SquareNorm | None = None,
) -> Atlas:
    """The atlas of what can be proved of a region from a seed θ (n′,), the largest square about it first.

    Raises:
        SingularConfigurationError: The seed is singular.
    """
    problem, complete = reading.problem, True
    threads = math.inf if compiled(problem) else 0
    with stoppable(effort.seconds) as flag, executor_for(work.executor, work.workers, threads) as chosen:
        runner = Runner(problem, chosen, work.checkpoint, flag)
        builder = AtlasBuilder(problem, seed, region, runner, reporter(work.progress), shape, effort.budget)
        try:
            if effort.tolerance is not None:
                builder.certify_square(effort.tolerance)
            if effort.depth:
                _cover(builder, effort)
                if effort.exhaustive:
                    search_empty(runner, reading, builder.tree, region, effort.depth)
                for found in mark_singular(runner, builder.tree, region, builder.boxes):
                    builder.singular.append(found)
        except Stopped:
            complete = False
        solutions, kept = proved_boxes(problem, builder.boxes)
        if not kept.all():
            builder.keep(kept)
        seams = seams_of(problem, region, builder.tree, builder.boxes)
        glue = proved_glue(problem, seams, (solutions,))
        proved = proved_cover(problem, region, builder.tree, seed, (solutions,), glue)
        proved = proved._replace(empty=empty_facts(reading, region, builder.tree))
    return Atlas(
        names=names,
        q0=builder.q0,
        radius=builder.radius(proved.cover.found["unglued"]) if proved.cover.claim.start[0] >= 0 else 0.0,
        solutions=(solutions,),
        proved=proved,
        complete=complete,
        region=region,
        reading=reading,
        tree=builder.tree,
        seed=seed,
        singular=joined(builder.singular),
    )


def _cover(builder: AtlasBuilder, effort: Effort) -> None:
    """Certify and prove empty what can be, halving edges once more until the share asked for is decided."""
    first = effort.depth if effort.fraction is None else min(_FIRST_DEPTH, effort.depth)
    for depth in range(first, effort.depth + 1):
        builder.certify_region(depth)
        prove_empty(builder.runner, builder.tree, builder.region, depth, effort.exhaustive)
        decided = builder.tree.leaves(CellStatus.CERTIFIED, CellStatus.EMPTY)
        if effort.fraction is not None and builder.tree.share(decided) >= effort.fraction:
            return
