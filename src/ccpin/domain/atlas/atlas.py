"""The atlas: a region of q-space in boxes on each of which σ is proved to exist, be unique and be smooth.

What is claimed. Each box satisfies Theorem K of `boxes`; each was glued to an earlier one at a common face, the
first to the closed configuration at q₀. So through every certified q runs a chain of boxes along which σ(q₀) continues
to σ(q) without meeting a singularity, and `Atlas.sigma` returns that continuation. Where, moreover, `single_valued` is
true, the boxes on the two sides of every shared face carry the same σ: it is one continuous function on the union of
the boxes (angles modulo 2π), whatever the way from q₀. Nonsingularity alone would not say so: a mechanism may
change assembly mode without meeting a singularity, and the faces where that shows are listed in `unglued`;
`ccpin.domain.certify_sheets` then tells the layers apart.

What is not claimed. Undecided cells are those not proved at the depth allowed; singular ones those of them over which a
closed configuration is proved to be singular (`atlas.singular`), on whatever branch; unreached cells were not tried, as
no neighbour is certified (σ may exist there, on this branch or another). Empty cells are proved to hold no closed
configuration at all (`atlas.empty`, `sheets.emptiness`). Limits of dependent joints are not looked at.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ccpin.arrays import Array, Mask, number, numbers, positive, whole
from ccpin.displays import boxes, table
from ccpin.domain.atlas import store as atlas_store
from ccpin.domain.atlas.build import AtlasBuilder, Shape
from ccpin.domain.atlas.cells import LEVELS, WHOLE, Cells, CellStatus, CellTree, Corners, Region, region_of
from ccpin.domain.atlas.empty import prove_empty
from ccpin.domain.atlas.run import Runner, Stopped, executor_for, stoppable
from ccpin.domain.atlas.singular import mark_singular, refuting
from ccpin.domain.boxes import BoundsName, Boxes, Problem, problem_of, verify
from ccpin.domain.chains import closure_system, seed_at_coordinates
from ccpin.domain.demands import meets
from ccpin.domain.newton import newton, solve_in_boxes
from ccpin.domain.obstacles import demand_witnesses
from ccpin.domain.sheets.emptiness import search_empty
from ccpin.domain.verdict import Verdict, Witness
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of

_DEPTHS = {1: 14, 2: 12, 3: 6}
_TOLERANCES = {1: 1e-5, 2: 2e-5, 3: 2e-3}
_MANY_DEPTH, _MANY_TOLERANCE = 3, 0.5
_WITNESSES = 12
_FAILURES = {
    "empty": "no configuration closes the loops",
    "limit": "a joint is beyond its limits",
    "dexterity": "the end effector is less dexterous than was asked for",
}
_FIRST_DEPTH, _DEEPEST, _MANY_DEEPEST = 4, 20, 10


class Progress(NamedTuple):
    """How far an atlas is: certified boxes, cells waiting, and the certified fraction of the region."""

    boxes: int
    waiting: int
    certified: float


@dataclass(frozen=True, eq=False)
class Atlas:
    """A certified region of q-space; angles in radians.

    Attributes:
        names: The independent coordinates, in the order of q.
        q0: The seed, of shape (n,).
        radius: Half width of the largest certified square about q₀, short of the nearest cell not certified.
        boxes: The certified boxes, as Theorem K has them; `lower` and `upper` are their corners.
        unglued: Pairs of boxes that share a face at which they could not be shown to carry the same σ, (K, 2).
        complete: False where an interrupt ended the work; what is there is certified nevertheless.
        region: What was asked for.
        problem: The closures.
        tree: The cells.
        seed: θ of the seed, of shape (n′,).
    """

    names: tuple[str, ...]
    q0: Array
    radius: float
    boxes: Boxes
    unglued: NDArray[np.int64]
    complete: bool
    region: Region
    problem: Problem
    tree: CellTree
    seed: Array

    def __repr__(self) -> str:
        done = "" if self.complete else ", interrupted"
        share = f"{len(self.boxes.centre)} certified boxes, {100 * self.certified_fraction:.4g} % of the region"
        return f"Atlas({', '.join(self.names)}: {share}{done})"

    def _repr_html_(self) -> str:
        """A small table for notebooks, with a map where there are two coordinates."""
        shown = table(
            [
                ("atlas of", ", ".join(self.names) + ("" if self.complete else " (interrupted)")),
                ("certified", f"{100 * self.certified_fraction:.4g} % of the region in {len(self.boxes.centre)} boxes"),
                ("radius about q₀", f"{self.radius:.6g} (rad or m)"),
                ("q₀", np.array2string(self.q0, precision=6)),
                ("one function σ", "yes" if self.single_valued else f"{len(self.unglued)} shared faces are unglued"),
            ]
        )
        if len(self.names) != 2:
            return shown
        corners = self.region.lower, self.region.upper
        return shown + boxes(self.lower, self.upper, corners, self.region.reduce(self.q0[None])[0])

    @property
    def single_valued(self) -> bool:
        """Whether all shared faces are glued, so that σ is one continuous function on the certified set."""
        return not len(self.unglued)

    @cached_property
    def witness(self) -> Witness | None:
        """A place of the region proved to have no σ, or one that is singular."""
        if self._whole:
            return None
        found = refuting(self.problem, self.tree, self.region, self.boxes)
        return next(demand_witnesses(self.problem, self.seed, self._undecided()), None) if found is None else found

    @property
    def verdict(self) -> Verdict:
        """Of the claim that σ is one smooth, nonsingular function on all of the region.

        ``"refuted"`` where `witness` shows a place at which it is not; ``"undecided"``: no
        such place was proved either.
        """
        if self._whole:
            return "proven"
        return "undecided" if self.witness is None else "refuted"

    def _undecided(self) -> list[Array]:
        """Middles of the largest cells undecided or not reached, where more than Theorem K was asked for."""
        leaves = self.tree.leaves()
        cells = leaves[np.isin(self.tree.status[leaves], (CellStatus.UNDECIDED, CellStatus.UNREACHED))]
        if self.problem.demands is None:
            return []
        volume = np.prod(self.tree.size[cells].astype(np.float64), axis=1)
        largest = cells[np.argsort(-volume, kind="stable")[:_WITNESSES]]
        return list(self.region.position(self.tree.lower[largest] + 0.5 * self.tree.size[largest]))

    @property
    def _whole(self) -> bool:
        return self.certified_fraction == 1.0 and self.single_valued

    @property
    def reason(self) -> str:
        """The verdict in a sentence."""
        spent = f"{len(self.boxes.kappa)} boxes certify {100 * self.certified_fraction:.4g} % of the region"
        if self.verdict == "proven":
            return f"σ is one smooth, nonsingular function on the region: {spent}"
        if self.witness is not None:
            what = _FAILURES.get(self.witness.kind, "σ meets a singular configuration")
            return f"{what} at q = {self.witness.q.tolist()}; {spent}"
        if not self.single_valued:
            return f"{len(self.unglued)} faces are not glued, so σ may have several values; {spent}"
        left = 100 * (self.undecided_fraction + self.singular_fraction)
        told = "the work was interrupted" if not self.complete else "a larger max_depth= decides more of what was tried"
        beyond = 100 * self.unreached_fraction
        return f"{spent}, {left:.4g} % was tried without a proof, {beyond:.4g} % was not reached: {told}"

    @property
    def lower(self) -> Array:
        """Lower corners of the boxes, of shape (B, n)."""
        return np.asarray(self.boxes.centre[:, self.problem.system.independent] - self.boxes.half)

    @property
    def upper(self) -> Array:
        """Upper corners of the boxes, of shape (B, n)."""
        return np.asarray(self.boxes.centre[:, self.problem.system.independent] + self.boxes.half)

    @property
    def area(self) -> float:
        """Length, area or volume of the certified set, in radⁿ (metres for sliding coordinates)."""
        return self.fraction(CellStatus.CERTIFIED) * self.region.volume

    @property
    def certified_fraction(self) -> float:
        """The certified share of the region."""
        return self.fraction(CellStatus.CERTIFIED)

    @property
    def undecided_fraction(self) -> float:
        """The share of the region tried without a proof of anything."""
        return self.fraction(CellStatus.UNDECIDED, CellStatus.CANDIDATE)

    @property
    def singular_fraction(self) -> float:
        """The share of the region in cells that hold the q of a configuration proved to be singular."""
        return self.fraction(CellStatus.SINGULAR)

    @property
    def unreached_fraction(self) -> float:
        """The share of the region with no certified neighbour to start from."""
        return self.fraction(CellStatus.UNREACHED)

    @property
    def empty_fraction(self) -> float:
        """The share of the region proved to hold no closed configuration."""
        return self.fraction(CellStatus.EMPTY)

    def fraction(self, *statuses: CellStatus) -> float:
        """The share of the region in cells of the given statuses."""
        leaves = self.tree.leaves()
        chosen = leaves[np.isin(self.tree.status[leaves], statuses)]
        return float(np.prod(self.tree.size[chosen] / WHOLE, axis=1).sum())

    def contains(self, q: ArrayLike) -> bool | Mask:
        """Whether q (n,) is certified; for q of shape (K, n) an array (K,). Angles count modulo 2π on full turns."""
        points = self._points(q)
        certified = self._box_numbers(points) >= 0
        return bool(certified[0]) if np.ndim(q) == 1 else certified

    def status(self, q: ArrayLike) -> NDArray[np.int8]:
        """The `CellStatus` of the cells that hold points (K, n); −1 outside of the region."""
        cells = self.tree.locate(self.region.cell_coordinates(self._points(q)))
        return np.where(cells >= 0, self.tree.status[cells], -1).astype(np.int8)

    def sigma(self, q: ArrayLike) -> Array:
        """q′ = σ(q) on this branch, (nq,) for q (n,) and (K, nq) for (K, n), to rounding.

        Starts in the certified box's tube and takes steps that cannot leave it or fail to converge (`solve_in_boxes`),
        then one of Newton's to polish.

        Raises:
            InvalidInputError: A point is not certified.
        """
        points = self._points(q)
        numbers = self._box_numbers(points)
        if np.any(numbers < 0):
            first = points[int(np.argmax(numbers < 0))]
            raise InvalidInputError(f"q = {first.tolist()} is not in the certified set; ask `contains` first")
        boxes = self.boxes.take(numbers)
        delta = self.region.reduce(points) - boxes.centre[:, self.problem.system.independent]
        theta = newton(self.problem, solve_in_boxes(self.problem, boxes, delta).theta, 1).theta
        theta[:, self.problem.system.independent] = points
        q_free = self.problem.system.chart.configuration(theta)
        return np.asarray(q_free[0] if np.ndim(q) == 1 else q_free)

    def verify(self) -> Mask:
        """Check Theorem K for every box again, and what else was asked, from its data alone, of shape (B,)."""
        return verify(self.problem, self.boxes) & meets(self.problem, self.boxes)

    @property
    def fingerprint(self) -> str:
        """SHA-256 of the closures it is about, as its file has it."""
        return atlas_store.fingerprint(atlas_store.pack_problem(self.problem)[1])

    def is_about(self, mechanism: Mechanism | HasMechanism) -> bool:
        """Whether the closures are those that a mechanism's file gives today, bit for bit."""
        chart, mechanism = self.problem.system.chart, mechanism_of(mechanism)
        if (chart.nq, chart.n_free) != (mechanism.nq, mechanism.n_free):
            return False
        system = closure_system(mechanism, chart.configuration(self.seed[None, : chart.n_free])[0])
        return atlas_store.fingerprint(atlas_store.pack_problem(problem_of(system))[1]) == self.fingerprint

    def save(self, path: str | Path) -> None:
        """Write the atlas to a file (``.json``, else npz), whole or not at all; `ccpin.auditing.verify` checks it."""
        header, arrays = atlas_store.pack_problem(self.problem)
        header |= {"names": list(self.names), "radius": self.radius, "complete": self.complete}
        arrays |= {f"box_{name}": array for name, array in self.boxes._asdict().items()}
        arrays |= {f"tree_{name}": array for name, array in self.tree.cells._asdict().items()}
        arrays |= {"lower": self.region.lower, "upper": self.region.upper, "wrapped": self.region.wrapped}
        arrays |= {"q0": self.q0, "seed": self.seed, "unglued": self.unglued}
        atlas_store.write(path, header, arrays)

    @classmethod
    def load(cls, path: str | Path) -> Atlas:
        """Read an atlas that `save` wrote. If the file may have been altered, call `verify` or `auditing.verify`.

        Raises:
            InvalidInputError: The file cannot be read or is none.
        """
        header, found = atlas_store.read(path)
        arrays: dict[str, NDArray[np.float64]] = {name: np.asarray(array) for name, array in found.items()}  # type: ignore[misc]
        try:
            return cls(
                names=tuple(header["names"]),
                q0=arrays["q0"],
                radius=header["radius"],
                boxes=Boxes(*(arrays[f"box_{name}"] for name in Boxes._fields)),
                unglued=found["unglued"].astype(np.int64),
                complete=header["complete"],
                region=Region(arrays["lower"], arrays["upper"], found["wrapped"].astype(np.bool_)),
                problem=atlas_store.unpack_problem(header, found),
                tree=CellTree(Cells(**{k[5:]: v for k, v in found.items() if k.startswith("tree_")})),  # type: ignore[arg-type]
                seed=arrays["seed"],
            )
        except KeyError as error:
            raise InvalidInputError(f"{path}: the atlas lacks {error}") from error

    def _points(self, q: ArrayLike) -> Array:
        points = np.atleast_2d(numbers(q, "q"))
        if points.ndim != 2 or points.shape[1] != len(self.names) or not np.all(np.isfinite(points)):
            raise InvalidInputError(f"q must have {len(self.names)} finite columns ({', '.join(self.names)})")
        return points

    def _box_numbers(self, points: Array) -> NDArray[np.int64]:
        cells = self.tree.locate(self.region.cell_coordinates(points))
        return np.where(cells >= 0, self.tree.box[cells], -1)


def certify(
    mechanism: Mechanism | HasMechanism,
    q0: ArrayLike,
    region: Corners | None = None,
    guess: Array | None = None,
    *,
    max_depth: int | None = None,
    exhaustive: bool = False,
    resolution: float | None = None,
    fraction: float | None = None,
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
        guess: A closed configuration on the branch wanted, of shape (nq,); default the reference.
        max_depth: How often an edge of the region may be halved (0: the square only); default 14, 12, 6 for n = 1,
            2, 3, and 3 beyond.
        exhaustive: Search all values of the dependent coordinates, up to eight, to prove cells empty of which the
            triangle inequality says nothing; that takes several times as long as the boxes.
        resolution: How fine the largest square is sought: cells at its edge are halved to this share of their distance
            from q₀; default 1e-5, 2e-5, 2e-3 for n = 1, 2, 3, and 0.5 beyond. What the radius falls short by is a few
            times as much where the branch ends in a fold.
        fraction: The share of the region (0 to 1) to be decided, certified or proved empty: edges are halved once more
            until it is reached, or `max_depth`, whose default then is 20 for n ≤ 2 and 10 beyond.
        seconds: When to stop, measured by the clock; what is proved by then is kept, as after Ctrl-C.
        bounds: ``"auto"`` (planar where the mechanism is), ``"planar"`` or ``"reach"``.
        workers: How many processes to start for the work; default none: all is done in this one. A script that asks
            for more than one needs the guard ``if __name__ == "__main__":``.
        executor: In place of `workers` anything with ``submit``: a process pool, Dask's ``client.get_executor()``.
            The result depends on neither.
        checkpoint: A folder in which finished chunks are kept; the same call finds them again after a crash.
        progress: Called after every wave.

    Returns:
        The atlas; after Ctrl-C, or when the time is over, what was certified so far, with ``complete`` False.

    Raises:
        UnsupportedMechanismError: More than three coordinates and no region, redundant rows, or closures that cannot
            be bounded.
        InvalidInputError: q₀, region, max_depth, resolution, fraction, seconds or workers is malformed.
        UnreachableError, SingularConfigurationError: σ(q₀) does not exist on the branch, or is singular.
    """
    mechanism = mechanism_of(mechanism)
    if mechanism.n > max(_DEPTHS) and region is None:
        raise UnsupportedMechanismError(
            f"{mechanism.name} has {mechanism.n} independent coordinates; beyond {max(_DEPTHS)} a map is of a region= "
            "that is given, some times kantorovich_radius wide (its cells double with every halving of every edge). "
            "certify_path is for moves"
        )
    seed = seed_at_coordinates(mechanism, q0, guess)
    effort = effort_of(_DEPTHS.get(mechanism.n, _MANY_DEPTH), max_depth, fraction, seconds, mechanism.n)
    effort = effort._replace(exhaustive=exhaustive)
    if resolution is None:
        effort = effort._replace(tolerance=_TOLERANCES.get(mechanism.n, _MANY_TOLERANCE))
    else:
        effort = effort._replace(tolerance=positive(resolution, "resolution"))
    problem = problem_of(seed.system, bounds)
    area = region_of(mechanism, seed, region)
    return survey(
        problem, seed.theta, tuple(mechanism.independent), area, effort, Work(workers, executor, checkpoint, progress)
    )


class Effort(NamedTuple):
    """How far a survey goes.

    Attributes:
        depth: How often an edge of the region may be halved; 0: only the largest square is sought.
        tolerance: Edges of the largest square's cells are halved to this share of their distance from the seed;
            ``None``: no square comes first.
        fraction: The share of the region to be decided, ``None``: all that can be at `depth`.
        seconds: When to stop.
        exhaustive: Whether cells are proved empty by search of all dependent coordinates too.
    """

    depth: int
    tolerance: float | None = None
    fraction: float | None = None
    seconds: float | None = None
    exhaustive: bool = False


def effort_of(usual: int, max_depth: int | None, fraction: float | None, seconds: float | None, n: int) -> Effort:
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
    return Effort(depth, None, fraction, None if seconds is None else positive(seconds, "seconds"))


class Work(NamedTuple):
    """Who does the work of an atlas, where it is kept and who hears of it: the arguments of `certify` so named."""

    workers: int | None = None
    executor: Executor | None = None
    checkpoint: str | Path | None = None
    progress: Callable[[Progress], None] | None = None


def survey(
    problem: Problem,
    seed: Array,
    names: tuple[str, ...],
    region: Region,
    effort: Effort,
    work: Work,
    shape: Shape | None = None,
) -> Atlas:
    """The atlas of what can be proved of a region from a seed θ (n′,), the largest square about it first.

    Raises:
        SingularConfigurationError: The seed is singular.
    """
    complete = True
    with stoppable(effort.seconds) as flag, executor_for(work.executor, work.workers) as chosen:
        runner = Runner(problem, chosen, work.checkpoint, flag)
        builder = AtlasBuilder(problem, seed, region, runner, work.progress and _reporter(work.progress), shape)
        try:
            if effort.tolerance is not None:
                builder.certify_square(effort.tolerance)
            if effort.depth:
                _cover(builder, effort)
                if effort.exhaustive:
                    search_empty(problem, builder.tree, region, effort.depth)
                mark_singular(problem, builder.tree, region, builder.boxes)
        except Stopped:
            complete = False
    return Atlas(
        names=names,
        q0=builder.q0,
        radius=builder.radius(),
        boxes=builder.proved.trimmed(),
        unglued=np.concatenate(builder.unglued).astype(np.int64),
        complete=complete,
        region=region,
        problem=problem,
        tree=builder.tree,
        seed=seed,
    )


def _cover(builder: AtlasBuilder, effort: Effort) -> None:
    """Certify and prove empty what can be, halving edges once more until the share asked for is decided."""
    first = effort.depth if effort.fraction is None else min(_FIRST_DEPTH, effort.depth)
    for depth in range(first, effort.depth + 1):
        builder.certify_region(depth)
        prove_empty(builder.problem.system, builder.tree, builder.region, depth)
        tree = builder.tree
        leaves = tree.leaves()
        decided = leaves[np.isin(tree.status[leaves], (CellStatus.CERTIFIED, CellStatus.EMPTY))]
        if effort.fraction is not None and np.prod(tree.size[decided] / WHOLE, axis=1).sum() >= effort.fraction:
            return


def _reporter(progress: Callable[[Progress], None]) -> Callable[[CellTree], None]:
    def report(tree: CellTree) -> None:
        certified = tree.status == CellStatus.CERTIFIED
        share = float(np.prod(tree.size[certified] / WHOLE, axis=1).sum())
        waiting = int(np.count_nonzero(tree.status == CellStatus.CANDIDATE))
        progress(Progress(int(np.count_nonzero(certified)), waiting, share))

    return report
