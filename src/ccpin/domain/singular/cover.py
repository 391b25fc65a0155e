"""Finding all singular curves over a region: boxes that cover it, curves followed from those that stay, what is left.

One box of all coordinates is halved over and over. A box is dropped where φ is shown to have no zero or φ_y to be
regular (`proof.narrowing`), or where what singular configurations it may hold lie in tubes (Proposition B of
`ccpin/proof/theorems/covering.md`). From the middles of boxes that stay Newton's method leads onto curves; those in no
tube yet are followed both ways. What is found is a proposal: that every singular configuration over the region lies on
one of the curves, or in a box that is listed, is proved by the kernel (`SingularCovered`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Mask, joined, rows_of
from ccpin.covering.region import Region
from ccpin.covering.runner import Arrays, Runner
from ccpin.domain.singular.box_tasks import narrow_boxes, settle_boxes
from ccpin.domain.singular.following import TubeChain, follow, onto_curves, prolonged
from ccpin.proof.candidates import over_all
from ccpin.proof.curves.settled_boxes import Nearby, extents
from ccpin.proof.curves.singular_covers import halved_steepest
from ccpin.proof.curves.tubes import Points, Tubes, no_tubes
from ccpin.proof.equations import Problem, closure_values
from ccpin.proof.narrowing import Candidates
from ccpin.proof.ranges import Ranges
from ccpin.work import Stopped

_MANY, _SMALL = 500, 0.15  # boxes, or the largest edge of all: from here on curves are looked for
_MOST_STARTS = 20  # curves followed before the boxes are narrowed again
_NEWTON = 20  # steps from a box's middle, far from the curve as it may be
_FAR = 3.0  # of a box: singular configurations farther from its middle are other boxes'
_ON_CURVE = 1e-9  # rad, m: so wide a box about a point is in a tube that has it; Newton's errors are far below


class SearchDomain(NamedTuple):
    """Where singular configurations are looked for: a region of q, and ranges of the dependent coordinates."""

    region: Region
    ranges: Ranges

    def meets(self, problem: Problem, theta: Array, wide: Array) -> Mask:
        """Whether boxes about θ (B, n′), `wide` each way, meet it; of shape (B,)."""
        system, region, ranges = problem.system, self.region, self.ranges
        q, reach = region.reduce(theta[:, system.independent]), wide[:, system.independent]
        inside = region.wrapped | ((q >= region.lower - reach) & (q <= region.upper + reach))
        y, reach = theta[:, system.dependent], wide[:, system.dependent]
        within = (y >= ranges.lower - reach) & (y <= ranges.upper + reach)
        return np.asarray(inside.all(axis=1) & np.all(ranges.turning | within, axis=1))


class Found(NamedTuple):
    """What a search found.

    Attributes:
        chains: The curves.
        left: Boxes that may hold other singular configurations.
        tried: How many boxes were looked at.
        limit: What ended it before every box was small or settled: ``"interrupted"``, ``"budget"``, or nothing.
    """

    chains: tuple[TubeChain, ...]
    left: Candidates
    tried: int
    limit: str | None


class CurveSearch:
    """A search: the problem with the bounds chosen for boxes, and with those for any tree for tubes; where; the curves.

    Boxes are narrowed and settled in the runner's chunks; curves are followed in this process, and kept as those are.

    Attributes:
        chains: The curves found.
        tried: How many boxes were looked at.
    """

    def __init__(self, runner: Runner, place: SearchDomain, chains: Iterable[TubeChain] = ()) -> None:
        self.problem, self.plain, self.place = runner.problem, runner.problem._replace(phasors=None), place
        self.tried = 0
        self._runner = runner
        self.chains = [prolonged(self.plain, chain, self._wanted) for chain in chains]
        self._nearby: Nearby | None = None
        self._looked = np.inf
        self._gather()

    def run(
        self,
        resolution: float,
        budget: int,
        report: Callable[[int, int], object],
        waiting: Candidates | None = None,
    ) -> Found:
        """Halve, drop, follow and settle until all boxes are settled, or smaller than `resolution`.

        The boxes are those that wait; by default one that holds everything.
        """
        limit, (region, ranges) = None, self.place
        if waiting is None:
            waiting = over_all(self.problem, ranges, region.lower, region.upper)
        small = [rows_of(waiting, slice(0))]
        while waiting.cell.size:
            report(sum(len(chain.tubes.half) for chain in self.chains), len(waiting.cell))
            try:
                waiting = self._settled(self._kept(waiting))
            except Stopped:
                limit = "interrupted"
                break
            done = extents(self.problem, waiting).max(axis=1, initial=0.0) < resolution
            small.append(rows_of(waiting, done))
            waiting = rows_of(waiting, ~done)
            if self.tried > budget and waiting.cell.size:
                limit = "budget"
                break
            waiting = halved_steepest(self.problem, waiting)
        return Found(tuple(self.chains), joined([*small, waiting]), self.tried, limit)

    def _kept(self, waiting: Candidates) -> Candidates:
        """The boxes that may hold singular configurations within the ranges, narrowed."""
        found = narrow_boxes(self._runner, self.place.ranges, waiting)
        self.tried += len(waiting.cell)
        return found

    def _settled(self, waiting: Candidates) -> Candidates:
        """The boxes without those that tubes settle, once curves were looked for from them all."""
        wide = extents(self.problem, waiting).max(axis=1, initial=0.0)
        widest = float(wide.max(initial=0.0))
        if (len(wide) > _MANY or widest < _SMALL) and widest <= 0.5 * self._looked:
            self._looked = widest
            self._look_from(waiting)
        return waiting if self._nearby is None else settle_boxes(self._runner, self._nearby, waiting)

    def _look_from(self, waiting: Candidates) -> None:
        """Follow the curves that Newton's method finds from boxes and that no tube holds."""
        theta, kernel = self._near(waiting)
        size = theta.shape[1]
        x = np.concatenate([theta, kernel], axis=1)
        points = Points(x, np.full_like(x, _ON_CURVE))
        for _ in range(_MOST_STARTS):
            if self._nearby is not None and len(points.x):
                points = rows_of(points, ~self._nearby.hold(points))
            if not len(points.x):
                break
            place = self.place.region
            start = points.x[0, :size], points.x[0, size:]
            about = (*start, place.lower, place.upper, place.wrapped, *self.place.ranges)
            closed, *tubes = self._runner.once(self._followed, about)
            points = rows_of(points, slice(1, None))
            if len(tubes[0]):
                self.chains.append(TubeChain(Tubes(*tubes), bool(closed)))  # type: ignore[arg-type]
                self._gather()
            self._runner.check()

    def _followed(self, problem: Problem, arrays: Arrays) -> Arrays:
        """The curve through a start: (θ, kernel, *place) → (closed, *tubes); no tubes where none is proved."""
        del problem  # with its bounds for boxes
        theta, kernel = (np.asarray(array, dtype=np.float64) for array in arrays[:2])
        chain = follow(self.plain, theta, kernel, self._wanted)
        return (np.array(False), *no_tubes(self.plain)) if chain is None else (np.array(chain.closed), *chain.tubes)

    def _gather(self) -> None:
        """Have the tubes of all curves at hand."""
        if self.chains:
            self._nearby = Nearby(self.plain, joined([chain.tubes for chain in self.chains]))

    def _near(self, waiting: Candidates) -> tuple[Array, Array]:
        """Singular configurations near boxes, to rounding, and their kernels; those at the place looked at."""
        inner = closure_values(self.problem, waiting.centre)[1][:, :, self.problem.system.dependent]
        kernel = np.linalg.svd(inner)[2][:, -1]
        theta, kernel, settled = onto_curves(self.plain, waiting.centre, kernel, _NEWTON)
        reach = _FAR * extents(self.problem, waiting).max(axis=1, keepdims=True)
        settled &= np.all(np.abs(theta - waiting.centre) <= reach, axis=1)
        theta, kernel = theta[settled], kernel[settled]
        inside = self.place.meets(self.problem, theta, np.zeros_like(theta))
        return theta[inside], kernel[inside]

    def _wanted(self, tube: Tubes) -> bool:
        """Whether a curve is to be followed beyond a tube (T = 1): it meets the place looked at, and there is time."""
        if self._runner.flag.is_set():
            return False
        reach = (np.abs(tube.tangent) * tube.half[:, None] + tube.radius)[:, : self.problem.system.n_free]
        return bool(self.place.meets(self.problem, tube.theta, reach)[0])
