"""All singular curves over a region as a document: what is claimed of them, saved, loaded and continued."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, Indices, Mask, instance, joined, listener, matrix_rows, positive, whole
from ccpin.covering.cells import CellStatus, CellTree, leaves_holding
from ccpin.covering.documents import pack_region, packed, unpack_region, unpacked
from ccpin.covering.region import Region
from ccpin.covering.runner import Runner, Work
from ccpin.domain.closures.packing import fingerprint_of, pack_reading, same_closures, unpack_reading
from ccpin.domain.closures.system import Reading
from ccpin.domain.documents import store
from ccpin.domain.documents.kinds import CURVES
from ccpin.domain.singular.cover import CurveSearch, Found, SearchDomain
from ccpin.domain.singular.curve import CertifiedCurve, as_curve, holds
from ccpin.domain.singular.curve_claims import ProvedCurves, SearchEffort, proved_chains, proved_cover, proved_tubes
from ccpin.domain.singular.following import TubeChain
from ccpin.errors import InvalidInputError
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of
from ccpin.proof.curves.settled_boxes import Nearby, extents
from ccpin.proof.curves.singular_covers import covers
from ccpin.proof.curves.tube_claims import tubes_of
from ccpin.proof.curves.tubes import Points, Stated, Tubes, no_tubes, stated, zeros_in
from ccpin.proof.digests import Digests, require_same
from ccpin.proof.equations import BoundsName, Problem, closure_values, closures_of
from ccpin.proof.facts import Fact, NotProvedError
from ccpin.proof.narrowing import Candidates
from ccpin.proof.newton import without_turns
from ccpin.proof.ranges import Ranges
from ccpin.proof.verdict import Verdict, of_file
from ccpin.work import FEW, executor_for, stoppable

_SAMPLES = 33  # of a tube
_TOUCHING = 1e-12  # rad, m: how far roundings may have moved a configuration that is asked about


class UncoveredBoxes(NamedTuple):
    """Boxes of all scalar coordinates θ that may hold singular configurations on no curve found.

    Attributes:
        lower, upper: Corners, of shape (K, n′); angles modulo 2π.
    """

    lower: Array
    upper: Array


_RECORDS: dict[str, Any] = {"tube": Stated, "range": Ranges, "uncovered": UncoveredBoxes}


@runtime_checkable
class HasCells(Protocol):
    """What tells of cells of a region, about closures of a fingerprint: an atlas, or an atlas of sheets."""

    @property
    def region(self) -> Region:
        """What was asked for."""

    @property
    def tree(self) -> CellTree:
        """Its cells."""

    @property
    def fingerprint(self) -> str:
        """SHA-256 of the closures."""


class CrossedCells(NamedTuple):
    """Cells of an atlas over which a singular configuration is proved to lie.

    Attributes:
        cells: Their numbers in the atlas's tree, of shape (K,).
        share: Of the atlas's region.
    """

    cells: Indices
    share: float


@dataclass(frozen=True, eq=False)
class SingularCover:
    """All singular curves over a region, and what is not covered by them.

    What is claimed, and proved by the kernel (`SingularCovered`): every singular closed configuration over the region
    that keeps the limits of slides and coupled joints (φ_y singular; the ranges searched hold them all, by Lemma R of
    `ccpin.proof.ranges`) lies on one of the curves, inside its tubes, or in one of the boxes that are uncovered. Beyond
    the region nothing is. Of work that was interrupted the curves are proved, and the boxes are the search's word.

    Attributes:
        names: The independent coordinates, in the order of q.
        region: What was asked for.
        reading: The closures, and how their coordinates and configurations correspond.
        curves: The curves, folds first.
        uncovered: Boxes that may hold others: about bifurcations, where curves cross or configurations are singular
            twice; and wherever the work ended early.
        tried: How many boxes were looked at.
        limit: What ended the work early: ``"interrupted"`` (Ctrl-C, or the time was over) or ``"budget"``; else
            ``None``.
        resolution: Boxes with all edges below twice this were not halved.
        ranges: What was searched of the dependent coordinates, and why that is all.
        source: The file it was loaded from, if it was: what it says rests on that file, but for tubes, which `load`
            proved again, and with `replay=True` for all the rest. `ccpin.auditing.verify` proves it with its own code.
        proved: The facts about its tubes and about all of it.
    """

    names: tuple[str, ...]
    region: Region
    reading: Reading
    curves: tuple[CertifiedCurve, ...]
    uncovered: UncoveredBoxes
    tried: int
    limit: str | None
    resolution: float
    ranges: Ranges
    source: str | None = None
    proved: ProvedCurves | None = None

    def __repr__(self) -> str:
        kinds = ", ".join(curve.kind for curve in self.curves) or "none"
        left = f"{len(self.uncovered.lower)} boxes uncovered" + ("" if self.source is None else ", loaded")
        return f"SingularCover({', '.join(self.names)}: curves {kinds}; {left})"

    @property
    def problem(self) -> Problem:
        """The closures."""
        return self.reading.problem

    @property
    def complete(self) -> bool:
        """Whether no interrupt ended the work; what is there is proved nevertheless."""
        return self.limit != "interrupted"

    @property
    def verdict(self) -> Verdict:
        """Of the claim that the curves are all there are over the region; no box can refute it."""
        return "proven" if self._whole else "undecided"

    @property
    def _whole(self) -> bool:
        """Whether the kernel says, or else a file, that the curves are all there are."""
        covered = self._covered
        if covered is None:
            return self.source is not None and self.limit is None and not len(self.uncovered.lower)
        region = self.region.lower, self.region.upper
        known = covered.digest == closures_of(self.problem).digest and not len(covered.found["lower"])
        return known and covers(covered, region, self.ranges.limits, stated(self._tubes))

    @property
    def _covered(self) -> Fact | None:
        """The fact about the region, if there is one."""
        covered = None if self.proved is None else self.proved.covered
        return covered if isinstance(covered, Fact) else None  # from another process it is none until it is replayed

    @property
    def _tubes(self) -> Tubes:
        """Those of all curves."""
        return joined([no_tubes(self.problem), *(curve.tubes for curve in self.curves)])

    @property
    def reason(self) -> str:
        """The verdict in a sentence; where it is not computed from facts, what of it rests on the file (`source`)."""
        return self._reason + of_file(None if self._covered is not None and self._whole else self.source)

    @property
    def _reason(self) -> str:
        tubes = sum(len(curve.radius) for curve in self.curves)
        spent = f"{len(self.curves)} curves in {tubes} tubes; {self.tried} boxes of all coordinates were tried"
        if self.verdict == "proven":
            return f"every singular configuration over the region lies on a curve found: {spent}"
        more = {
            "interrupted": "the work was interrupted, and continued(seconds=…) decides more",
            "budget": "continued(budget=…) decides more",
            None: f"they are smaller than resolution = {self.resolution:g}, about places where curves may cross",
        }[self.limit]
        return f"{spent}, and {len(self.uncovered.lower)} are left that may hold others: {more}"

    def curve_of(self, q_free: ArrayLike) -> Indices:
        """On which of the curves each of some configurations may be, of shape (K,); −1: on none of them.

        A configuration counts as on a curve if it lies, with the weakest direction of φ_y as kernel, where the curve is
        known to be in a tube: within its enclosure, not only near it.

        Args:
            q_free: Configurations, of shape (K, nq).

        Raises:
            InvalidInputError: They are not that.
        """
        theta = self._thetas(q_free)
        found = np.full(len(theta), -1, dtype=np.intp)
        if not self.curves or not len(theta):
            return found
        inner = closure_values(self.problem, theta)[1][:, :, self.problem.system.dependent]
        x = np.concatenate([theta, np.linalg.svd(inner)[2][:, -1]], axis=1)
        points = Points(x, np.full_like(x, _TOUCHING))
        for number, curve in reversed(list(enumerate(self.curves))):
            arcs = curve.tubes._replace(radius=curve.tubes.hull + 1e-9)
            found[Nearby(self.problem, arcs).hold(points)] = number
        return found

    def is_uncovered(self, q_free: ArrayLike) -> Mask:
        """Whether configurations (K, nq) lie in boxes that are uncovered, of shape (K,).

        Raises:
            InvalidInputError: They are not that.
        """
        theta, (lower, upper) = self._thetas(q_free), self.uncovered
        found = np.zeros(len(theta), dtype=np.bool_)
        middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower) + _TOUCHING
        for k in range(len(theta)):
            gap = without_turns(theta[k] - middle, self.problem.system.periodic)
            found[k] = bool(np.any(np.all(np.abs(gap) <= half, axis=1)))
        return found

    def crossed(self, atlas: HasCells) -> CrossedCells:
        """The undecided cells of an atlas that the curves cross.

        Each holds the q of a configuration proved to be singular, which may be of another assembly mode than the
        atlas's, as for cells that the atlas calls singular.

        Args:
            atlas: An `Atlas` or a `SheetAtlas` of the same mechanism.

        Raises:
            InvalidInputError: It is none.
            DifferentSubjectsError: It is of other closures or coordinates.
        """
        ours, theirs = self.fingerprint, instance(atlas, "atlas", HasCells, "an Atlas or a SheetAtlas").fingerprint
        both = Digests("the cover of singular curves", ours), Digests("the atlas", theirs)
        require_same("cells that curves cross", *both, "closures")
        found = [np.zeros(0, dtype=np.intp)]
        for curve in self.curves:
            for share in np.linspace(-1.0, 1.0, _SAMPLES):
                at = zeros_in(self.problem, curve.tubes, share * curve.tubes.half)
                found.append(_cells(atlas, at, self.problem.system.independent))
        cells = np.unique(np.concatenate(found))
        cells = cells[atlas.tree.status[cells] == CellStatus.UNDECIDED]
        return CrossedCells(cells, atlas.tree.share(cells))

    def verify(self) -> bool:
        """Check every tube and all gluing anew, from their data alone; not that the boxes tried were settled."""
        return all(holds(self.problem, curve) for curve in self.curves)

    @property
    def fingerprint(self) -> str:
        """SHA-256 of the closures it is about, as its file has it."""
        return fingerprint_of(self.problem)

    def is_about(self, mechanism: Mechanism | HasMechanism) -> bool:
        """Whether the closures are those that a mechanism's file gives today, bit for bit."""
        return same_closures(self.reading, self.names, mechanism_of(mechanism))

    def continued(
        self,
        *,
        resolution: float | None = None,
        budget: int = 1_000_000,
        seconds: float | None = None,
        bounds: BoundsName = "auto",
        workers: int | None = None,
        executor: Executor | None = None,
        checkpoint: str | Path | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> SingularCover:
        """The same cover after more work on the boxes that are uncovered; curves that were cut short are followed on.

        Args:
            resolution: As for `certify_singularities`; default as it was.
            budget: How many more boxes may be tried.
            seconds: As for `certify_singularities`.
            bounds: As for `certify_singularities`.
            workers: As for `certify_singularities`.
            executor: As for `certify_singularities`.
            checkpoint: As for `certify_singularities`.
            progress: As for `certify_singularities`.

        Raises:
            UnsupportedMechanismError: As for `certify_singularities`.
            InvalidInputError: The resolution, budget, seconds or workers is malformed.
        """
        effort = effort_of(self.resolution if resolution is None else resolution, budget, seconds, progress)
        reading, work = self.reading.bounded(bounds), Work(workers, executor, checkpoint)
        return searched(reading, self.names, SearchDomain(self.region, self.ranges), effort, work, self)

    def save(self, path: str | Path) -> None:
        """Write the cover to a file (``.json``, else npz), whole or not at all; `ccpin.auditing.verify` checks it.

        The boxes that were settled are not in it: the auditor has a search of its own.
        """
        header, arrays = pack_reading(self.reading)
        header |= {"names": list(self.names), "tried": self.tried, "limit": self.limit, "resolution": self.resolution}
        records: dict[str, Any] = dict(zip(_RECORDS, (stated(self._tubes), self.ranges, self.uncovered), strict=True))
        for part, record in records.items():
            arrays |= packed(part, record)
        arrays |= pack_region(self.region)
        arrays["curve_tubes"] = np.array([len(curve.radius) for curve in self.curves], dtype=np.int64)
        arrays["curve_closed"] = np.array([curve.closed for curve in self.curves], dtype=np.bool_)
        store.write(path, CURVES, header, arrays)

    @classmethod
    def load(cls, path: str | Path, *, replay: bool = False) -> SingularCover:
        """Read a cover that `save` wrote. If the file may have been altered, call `verify` or `auditing.verify`.

        Args:
            path: The file.
            replay: Whether to prove once more that curves run on from tube to tube, and that there are no others but
                in boxes that are listed; that takes about as long as finding them. Tubes are proved in any case.

        Raises:
            InvalidInputError: The file cannot be read or is none, or what was proved of it is not found to hold.
        """
        with store.reading(path, CURVES) as (header, arrays):
            given, ranges, uncovered = (unpacked(part, kind, arrays) for part, kind in _RECORDS.items())
            reading = unpack_reading(header, arrays)
            fact, proved = _again(reading.problem, given)
            if len(proved) != len(given.half):
                missing = np.setdiff1d(np.arange(len(given.half)), proved)
                raise InvalidInputError(f"tube {missing[0]} is not proved: the file was altered")
            tubes = tubes_of(fact.claim.equations, [fact])
            sizes = arrays["curve_tubes"].astype(np.int64)
            if sizes.sum() != len(proved):
                raise InvalidInputError("curve_tubes are not as many as there are tubes")
            curve = np.repeat(np.arange(len(sizes)), sizes)
            chains = [TubeChain(tubes.take(curve == k), bool(end)) for k, end in enumerate(arrays["curve_closed"])]
            cover = cls(
                names=tuple(header["names"]),
                region=unpack_region(arrays),
                reading=reading,
                curves=tuple(as_curve(reading, chain) for chain in chains),
                uncovered=uncovered,
                tried=header["tried"],
                limit=header["limit"],
                resolution=header["resolution"],
                ranges=ranges,
                source=str(path),
                proved=ProvedCurves(fact, None, None),
            )
            return cover.replayed() if replay else cover

    def replayed(self) -> SingularCover:
        """The same with all that is said of it proved once more; boxes that then are left are those uncovered.

        Raises:
            InvalidInputError: A tube is not, or not glued to the next as curves are: the file was altered.
        """
        try:
            found = concluded(self)
        except NotProvedError as error:
            raise InvalidInputError(f"{error}: the file was altered") from error
        if [(len(c.radius), c.closed) for c in found.curves] != [(len(c.radius), c.closed) for c in self.curves]:
            raise InvalidInputError("curves are not glued from tube to tube: the file was altered")
        return found

    def _thetas(self, q_free: ArrayLike) -> Array:
        chart = self.reading.chart
        given = matrix_rows(np.atleast_2d(np.asarray(q_free)), "q_free", chart.nq)
        return np.array([chart.theta(row) for row in given]).reshape(-1, chart.n_free)


class Effort(NamedTuple):
    """How far a search goes: halvings, boxes tried, seconds (``None``: no end), and whom to tell."""

    resolution: float
    budget: int
    seconds: float | None
    report: Callable[[int, int], object]


def effort_of(
    resolution: float, budget: int, seconds: float | None, progress: Callable[[int, int], None] | None
) -> Effort:
    """The same, checked."""
    time = None if seconds is None else positive(seconds, "seconds")
    return Effort(positive(resolution, "resolution"), whole(budget, "budget"), time, listener(progress))


def searched(
    reading: Reading,
    names: tuple[str, ...],
    place: SearchDomain,
    effort: Effort,
    work: Work,
    before: SingularCover | None = None,
) -> SingularCover:
    """The cover of a place, or what more work makes of one; who does the work is all that `work` says."""
    problem, chains, waiting, tried = reading.problem, list[TubeChain](), None, 0
    if before is not None:
        chains = [TubeChain(curve.tubes, curve.closed) for curve in before.curves]
        waiting, tried = _waiting(problem, before.uncovered), before.tried
    with stoppable(effort.seconds) as flag, executor_for(work.executor, work.workers, FEW) as chosen:
        search = CurveSearch(Runner(problem, chosen, work.checkpoint, flag), place, chains)
        found = search.run(effort.resolution, effort.budget, effort.report, waiting)
        plain = reading._replace(problem=search.plain)
        curves = sorted((as_curve(plain, chain) for chain in found.chains), key=lambda curve: curve.kind)
        proposed = SingularCover(
            names=names,
            region=place.region,
            reading=plain,
            curves=tuple(curves),
            uncovered=_uncovered(problem, found),
            tried=tried + found.tried,
            limit=found.limit,
            resolution=effort.resolution,
            ranges=place.ranges,
            source=None if before is None else before.source,
        )
        return concluded(proposed, problem)


def concluded(cover: SingularCover, problem: Problem | None = None, believed: bool = False) -> SingularCover:
    """A cover that is proposed, as the kernel has it: curves in tubes that are proved, and all that may be on none.

    Args:
        cover: What is proposed.
        problem: The closures with bounds for boxes, if these are others.
        believed: Whether boxes that may hold others are taken for what they are said to be, as they are where the work
            was interrupted: then no fact says that there are no more.
    """
    given = [TubeChain(curve.tubes, curve.closed) for curve in cover.curves]
    proved, chains = proved_chains(cover.problem, given)
    cover = replace(cover, curves=tuple(as_curve(cover.reading, chain) for chain in chains), proved=proved)
    if believed or not cover.complete:
        return cover
    effort = SearchEffort(cover.resolution, cover.tried, cover.limit is None)
    fact = proved_cover(problem or cover.problem, cover.region, cover.ranges, effort, proved.tubes)
    left, limit = UncoveredBoxes(fact.found["lower"], fact.found["upper"]), None
    if fact.found["early"][0]:
        limit = "budget" if fact.found["tried"][0] > fact.claim.most[0] else "interrupted"
    return replace(cover, uncovered=left, limit=limit, proved=proved._replace(covered=fact))


def _again(problem: Problem, given: Stated) -> tuple[Fact, Indices]:
    """The fact about tubes of a file, and which are proved."""
    try:
        return proved_tubes(problem, given)
    except NotProvedError as error:
        raise InvalidInputError(f"{error}: the file was altered") from error


def _uncovered(problem: Problem, found: Found) -> UncoveredBoxes:
    reach = extents(problem, found.left)
    return UncoveredBoxes(found.left.centre - reach, found.left.centre + reach)


def _waiting(problem: Problem, boxes: UncoveredBoxes) -> Candidates:
    """Boxes that were left, to be looked at again; a difference is off by a rounding of itself."""
    system, centre = problem.system, 0.5 * (boxes.lower + boxes.upper)
    half = np.maximum(boxes.upper - centre, centre - boxes.lower) * (1.0 + 1e-15)
    none = np.zeros((len(centre), system.m, system.n))
    return Candidates(np.zeros(len(centre), dtype=np.intp), centre, half, none)


def _cells(atlas: HasCells, at: Points, independent: Indices) -> Indices:
    """The leaves that hold the q of points with all of their error."""
    leaf = leaves_holding(atlas.tree, atlas.region, atlas.region.reduce(at.x[:, independent]), at.error[:, independent])
    return leaf[leaf >= 0]
