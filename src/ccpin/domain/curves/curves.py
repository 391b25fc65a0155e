"""All singular curves of a mechanism over a region, with a proof that none was missed, or where one may have been."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, Indices, Mask, instance, joined, matrix_rows, positive, rows_of, whole
from ccpin.domain.atlas.atlas import Atlas
from ccpin.domain.atlas.cells import CellStatus, Corners, Region, leaves_holding
from ccpin.domain.atlas.run import stoppable
from ccpin.domain.boxes import BoundsName, Problem, closure_values, problem_of
from ccpin.domain.chains import ClosureSystem, closure_system
from ccpin.domain.curves.covering import Nearby, extents
from ccpin.domain.curves.following import Chain
from ccpin.domain.curves.search import Found, Place, Search
from ccpin.domain.curves.system import values_at
from ccpin.domain.curves.tubes import Frames, Points, Tubes, certify_tubes, glued, zeros_in
from ccpin.domain.newton import without_turns
from ccpin.domain.sheets.search import refuse, region_about, searched_ranges
from ccpin.domain.singularities import CurveKind, SingularCurve
from ccpin.domain.verdict import Verdict
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of

_STILL = 1e-7
_SAMPLES = 33  # of a tube
_TOUCHING = 1e-12
_AGAIN = 1.0 + 1e-6  # how far the same bounds may differ when formed again


class CertifiedCurve(NamedTuple):
    """A connected curve of singular configurations, in tubes that hold it and no other (Theorem R of `curves.tubes`).

    Attributes:
        kind: ``fold`` or ``self-motion``, as for `SingularCurve`; told from where the tubes' middles are, not proved.
        q: Image of the tubes' middles in the independent coordinates, of shape (k, 2); one row for a self-motion.
        q_free: The middles of the tubes, in order, of shape (k, nq).
        closed: Whether it is proved to close on itself (turns of 2π of a joint not counted). What is not closed leaves
            the region, or ends where it could not be followed.
        error: A singular configuration of the curve is this near each middle in every coordinate (rad, m), (k,).
        radius: The whole arc in a tube is this near its middle, (k,).
        tubes: The tubes themselves.
    """

    kind: CurveKind
    q: Array
    q_free: Array
    closed: bool
    error: Array
    radius: Array
    tubes: Tubes

    @property
    def points(self) -> SingularCurve:
        """Its points as `singularities` gives them, for pictures and `cusps`; of a closed one the first comes last."""
        order = np.arange(len(self.q_free) + self.closed) % len(self.q_free)
        q = self.q if self.kind == "self-motion" else self.q[order]
        return SingularCurve(self.kind, q, self.q_free[order], self.closed, self.error[order])


class UncoveredBoxes(NamedTuple):
    """Boxes of all scalar coordinates θ that may hold singular configurations on no curve found.

    Attributes:
        lower, upper: Corners, of shape (K, n′); angles modulo 2π.
    """

    lower: Array
    upper: Array


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

    What is claimed: every singular closed configuration over the region (φ_y singular, y in the ranges searched: full
    turns, the limits of slides) lies on one of the curves, inside its tubes, or in one of the boxes that are uncovered.
    Beyond the region nothing is.

    Attributes:
        names: The independent coordinates, in the order of q.
        region: What was asked for.
        problem: The closures.
        curves: The curves, folds first.
        uncovered: Boxes that may hold others: about bifurcations, where curves cross or configurations are singular
            twice; and wherever the work ended early.
        tried: How many boxes were looked at.
        limit: What ended the work early: ``"interrupted"`` (Ctrl-C, or the time was over) or ``"budget"``; else
            ``None``.
        resolution: Boxes with all edges below twice this were not halved.
    """

    names: tuple[str, ...]
    region: Region
    problem: Problem
    curves: tuple[CertifiedCurve, ...]
    uncovered: UncoveredBoxes
    tried: int
    limit: str | None
    resolution: float

    def __repr__(self) -> str:
        kinds = ", ".join(curve.kind for curve in self.curves) or "none"
        return f"SingularCover({', '.join(self.names)}: curves {kinds}; {len(self.uncovered.lower)} boxes uncovered)"

    @property
    def complete(self) -> bool:
        """Whether no interrupt ended the work; what is there is proved nevertheless."""
        return self.limit != "interrupted"

    @property
    def verdict(self) -> Verdict:
        """Of the claim that the curves are all there are over the region; no box can refute it."""
        return "undecided" if len(self.uncovered.lower) else "proven"

    @property
    def reason(self) -> str:
        """The verdict in a sentence."""
        tubes = sum(len(curve.radius) for curve in self.curves)
        spent = f"{len(self.curves)} curves in {tubes} tubes; {self.tried} boxes of all coordinates were tried"
        if self.verdict == "proven":
            return f"every singular configuration over the region lies on a curve found: {spent}"
        more = {
            "interrupted": "the work was interrupted, and more seconds= decide more",
            "budget": "a larger budget= decides more",
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

    def crossed(self, atlas: Atlas) -> CrossedCells:
        """The undecided cells of an atlas that the curves cross.

        Each holds the q of a configuration proved to be singular, which may be of another assembly mode than the
        atlas's, as for cells that the atlas calls singular.

        Args:
            atlas: Of the same mechanism.

        Raises:
            InvalidInputError: It is none, or of other coordinates.
        """
        if instance(atlas, "atlas", Atlas).names != self.names:
            raise InvalidInputError(f"the atlas is of {', '.join(atlas.names)}, the curves of {', '.join(self.names)}")
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
        return all(_holds(self.problem, curve) for curve in self.curves)

    def _thetas(self, q_free: ArrayLike) -> Array:
        chart = self.problem.system.chart
        given = matrix_rows(np.atleast_2d(np.asarray(q_free)), "q_free", chart.nq)
        return np.array([chart.theta(row) for row in given]).reshape(-1, chart.n_free)


def certify_singularities(
    mechanism: Mechanism | HasMechanism,
    region: Corners | None = None,
    *,
    resolution: float = 1e-4,
    budget: int = 1_000_000,
    seconds: float | None = None,
    bounds: BoundsName = "auto",
    progress: Callable[[int, int], None] | None = None,
) -> SingularCover:
    """Enclose all parallel singular curves over a region, of every assembly mode, so that none is missed.

    The curves are followed in tubes that are proved to hold one each, and the whole region is covered with boxes of
    all coordinates, each proved to hold no singular configuration but those in tubes; what cannot be settled is listed.

    Args:
        mechanism: A mechanism (or its model) with two scalar independent coordinates and revolute, prismatic,
            universal, cylindrical or planar joints; hold joints still with ``load(locked=…)`` for a slice of others.
        region: (lower, upper), the bounds of the coordinates, each of shape (2,); default as for `certify`.
        resolution: Boxes no wider than this either way (rad, m) are listed where they cannot be settled.
        budget: How many boxes of all coordinates may be tried; those that wait then are listed.
        seconds: When to stop, measured by the clock. What is proved by then is kept, as after Ctrl-C.
        bounds: Of φ over boxes: ``"auto"`` (planar where the mechanism is), ``"planar"`` or ``"reach"``.
        progress: Called before every wave of boxes with the number of tubes and of boxes that wait; what it raises
            ends the search.

    Raises:
        UnsupportedMechanismError: n ≠ 2, more than eight dependent coordinates, ball joints, distance closures,
            couplings of continuous joints, redundant rows, or closures that cannot be bounded.
        InvalidInputError: The region, resolution, budget or seconds is malformed.
    """
    mechanism = mechanism_of(mechanism)
    system = _system(mechanism)
    resolution, budget = positive(resolution, "resolution"), whole(budget, "budget")
    time = None if seconds is None else positive(seconds, "seconds")
    problem, place = (
        problem_of(system, bounds),
        Place(region_about(mechanism, system, region), searched_ranges(mechanism, system)),
    )
    with stoppable(time) as flag:
        found = Search(problem, place, flag).run(resolution, budget, progress or _silent)
    return _cover(problem, tuple(mechanism.independent), place.region, found, resolution)


def _silent(tubes: int, waiting: int) -> None:
    """Tell nobody."""


def _system(mechanism: Mechanism) -> ClosureSystem:
    """The closures, if their singular configurations are curves that can be searched for."""
    if mechanism.n != 2:
        raise UnsupportedMechanismError(
            f"singular curves are those of two independent coordinates; '{mechanism.name}' has {mechanism.n}"
            + (": hold joints still with load(locked=…) for a slice" if mechanism.n > 2 else "")
        )
    system = closure_system(mechanism, mechanism.q_reference)
    refuse(mechanism, system, "singular curves cannot all be found")
    return system


def _cover(problem: Problem, names: tuple[str, ...], region: Region, found: Found, resolution: float) -> SingularCover:
    plain = problem._replace(phasors=None)
    curves = sorted((_curve(plain, chain) for chain in found.chains), key=lambda curve: curve.kind)
    reach = extents(problem, found.left)
    boxes = UncoveredBoxes(found.left.centre - reach, found.left.centre + reach)
    return SingularCover(names, region, plain, tuple(curves), boxes, found.tried, found.limit, resolution)


def _curve(problem: Problem, chain: Chain) -> CertifiedCurve:
    system, tubes = problem.system, chain.tubes
    at = zeros_in(problem, tubes, np.zeros(len(tubes.half)))
    error = (np.abs(at.x - tubes.x) + at.error)[:, : system.n_free].max(axis=1)
    reach = (np.abs(tubes.tangent) * tubes.half[:, None] + tubes.hull)[:, : system.n_free].max(axis=1)
    q = tubes.theta[:, system.independent]
    still = bool(np.ptp(q, axis=0).max() < _STILL)
    q = without_turns(q[:1], system.periodic[system.independent]) if still else q
    q_free = system.chart.configuration(tubes.theta)
    return CertifiedCurve("self-motion" if still else "fold", q, q_free, chain.closed, error, reach, tubes)


def _cells(atlas: Atlas, at: Points, independent: Indices) -> Indices:
    """The leaves that hold the q of points with all of their error."""
    leaf = leaves_holding(atlas.tree, atlas.region, atlas.region.reduce(at.x[:, independent]), at.error[:, independent])
    return leaf[leaf >= 0]


def _holds(problem: Problem, curve: CertifiedCurve) -> bool:
    """Whether Theorem R holds for the tubes of a curve, and each is glued to the next."""
    tubes = curve.tubes
    values = values_at(problem, tubes.theta, tubes.kernel, tubes.pairing)
    proved = certify_tubes(problem, values, Frames(tubes.along, tubes.tangent, tubes.gain), tubes.half, tubes.radius)
    known = np.all(proved.tubes.hull <= tubes.hull * _AGAIN) and np.all(proved.tubes.kappa <= tubes.kappa * _AGAIN)
    following = joined([rows_of(tubes, slice(1, None)), rows_of(tubes, slice(0, int(curve.closed)))])
    same = glued(problem, rows_of(tubes, slice(0, len(following.half))), following)
    return bool(proved.proved.all() and known and same.all())
