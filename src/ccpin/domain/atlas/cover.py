"""Building an atlas: an advancing front of cells from the seed, proved in waves.

A cell becomes a candidate when a face neighbour is certified; σ is followed from the middle of the common face. A wave
proves all candidates (or, looking for the largest square, those nearest the seed), glues each new box to the
neighbour it came from (without which it is not accepted), and splits what was not proved; at all shared faces boxes are
glued at the end, by the kernel. What a wave contains depends on earlier waves only, never on who computed them, so
every executor gives the same atlas, bit for bit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, Mask, rows_of
from ccpin.covering.cells import CellStatus, CellTree, Growing, SingularCells, place
from ccpin.covering.faces import contacts_of
from ccpin.covering.proposals.krawczyk import certify_points
from ccpin.covering.proposals.tasks import CellsToProve, Proved, compiled, glue_boxes, prove_cells
from ccpin.covering.region import Region
from ccpin.covering.runner import Report, Runner
from ccpin.errors import SingularConfigurationError
from ccpin.proof.cell_tree import LEVELS, WHOLE
from ccpin.proof.equations import Problem
from ccpin.proof.newton import Boxes, encloses, predict
from ccpin.work import Stopped

BUDGET = 400_000
"""Boxes of an atlas: of a mechanism with six coordinates that depend they take half a gigabyte."""
_COMPILED = 150_000, 16  # second derivatives of a chunk, and its least boxes
_IN_NUMPY = 500_000, 32  # which is slow on few
_NEAREST = 96  # cells of a wave that looks for the largest square: more would refine in vain


class _Origins(NamedTuple):
    """Where N cells were reached from, once they are candidates.

    Attributes:
        box: The number of the box, −1 for the seed, of shape (N,).
        at_box, at_cell: The common point in each one's coordinates, whole-number units, of shape (N, n).
    """

    box: Indices
    at_box: Array
    at_cell: Array

    @classmethod
    def unknown(cls, count: int, n: int) -> _Origins:
        """To be filled in."""
        return cls(np.full(count, -1, dtype=np.intp), np.zeros((count, n)), np.zeros((count, n)))


class SquareNorm(NamedTuple):
    """What is meant by the largest square about the seed.

    Attributes:
        weights: What distances along each coordinate count, of shape (n,); along one of weight 0 the square is as wide
            as the region.
        round: Whether it is a ball rather than a cube.
    """

    weights: Array
    round: bool = False

    def of(self, gaps: Array) -> Array:
        """The distances of points with nonnegative coordinate differences (B, n), of shape (B,)."""
        weighted = gaps * self.weights
        return np.asarray(np.linalg.norm(weighted, axis=1) if self.round else np.max(weighted, axis=1, initial=0.0))


class AtlasBuilder:
    """The state of an atlas under construction.

    Attributes:
        tree: The cells.
        proved: The certified boxes.
        singular: Cells found to hold singular configurations.
    """

    def __init__(
        self,
        problem: Problem,
        seed: Array,
        region: Region,
        runner: Runner,
        report: Report,
        shape: SquareNorm | None = None,
        budget: int = BUDGET,
    ) -> None:
        self._budget = budget
        self.shape = SquareNorm(np.ones(problem.system.n)) if shape is None else shape
        self.problem, self.seed, self.region, self.runner, self._report = problem, seed, region, runner, report
        self.q0 = seed[problem.system.independent]
        self.tree = CellTree.whole(problem.system.n)
        point = certify_points(problem, seed[None])
        if not point.proved[0]:
            raise SingularConfigurationError(
                "q0 is too close to a singular configuration for a certificate", q_free=seed, rcond=0.0
            )
        self._point = point.boxes
        self.proved = Growing(self._point.without_rows(problem.system.n))
        self.singular = [SingularCells.none(problem.system.n_free)]
        self._origins = Growing(_Origins.unknown(1, problem.system.n))
        self._at_seed = (region.reduce(self.q0[None])[0] - region.lower) / region.span * WHOLE
        self._reach_seed()
        size = problem.system.m * problem.system.n_free**2
        numbers, least = _COMPILED if compiled(problem) else _IN_NUMPY
        self._chunk = int(np.clip(numbers // size, least, 512))

    @property
    def boxes(self) -> Boxes:
        """The certified boxes."""
        return self.proved.rows

    def _reach_seed(self) -> None:
        """Make the leaf that holds the seed a candidate."""
        leaf = self.tree.locate(np.floor(self._at_seed)[None].astype(np.int64).clip(0, WHOLE - 1))
        origins = self._origins.rows
        origins.box[leaf], origins.at_box[leaf], origins.at_cell[leaf] = -1, self._at_seed, self._at_seed
        if self.tree.status[leaf] == CellStatus.UNREACHED:
            self.tree.status[leaf] = CellStatus.CANDIDATE

    def candidates(self) -> Indices:
        """Cells that may be tried."""
        return np.flatnonzero(self.tree.status == CellStatus.CANDIDATE)

    def certify_square(self, tolerance: float) -> None:
        """Certify around the seed, nearest cells first, until the nearest undecided cell is nearer than all others.

        Cells are halved while an edge is longer than `tolerance` times their distance from the seed. Cells beyond the
        nearest edge of the region are left alone.
        """
        limit = self._edge()
        while True:
            cells = self.candidates()
            distance = self.distance(cells)
            if not cells.size or np.min(distance) >= limit:
                return
            order = np.lexsort((cells, distance))[:_NEAREST]
            chosen = np.sort(cells[order][distance[order] < limit])
            self.wave(chosen, self._shortest(chosen, tolerance))
            blocked = chosen[self.tree.status[chosen] == CellStatus.UNDECIDED]
            limit = np.min(self.distance(blocked), initial=limit)

    def certify_region(self, depth: int) -> None:
        """Certify all that can be reached, each edge halved `depth` times at most, undecided cells first."""
        smallest = self._never_held(np.full(len(self.q0), float(1 << (LEVELS - depth))))
        self._halve_undecided(smallest)
        while (cells := self.candidates()).size:
            self.wave(cells, np.tile(smallest, (len(cells), 1)))

    def _halve_undecided(self, smallest: Array) -> None:
        """Halve the leaves that were tried in vain where they may be, and go on with the halves."""
        added = len(self.tree.child) - len(self._origins.rows.box)  # where cells were proved empty in between
        self._origins.add(_Origins.unknown(added, len(self.q0)))
        leaves = self.tree.leaves()
        cells = leaves[self.tree.status[leaves] == CellStatus.UNDECIDED]
        if cells.size:
            stretch = self._stretch(rows_of(self._origins.rows, cells))
            children = self._split(cells, stretch, np.tile(smallest, (len(cells), 1)))
            self._origins.add(_Origins.unknown(len(children), len(self.q0)))
            self._spread(cells[:0], children)

    def _shortest(self, cells: Indices, tolerance: float) -> Array:
        """Edges below which cells are not halved, looking for the largest square, whole-number units, (K, n)."""
        weights = self.shape.weights
        across = self.distance(cells)[:, None] / np.where(weights > 0.0, weights * self.region.span, 1.0)
        return self._never_held(np.maximum(tolerance * WHOLE * np.where(weights > 0.0, across, 1.0), 1.0))

    def _never_held(self, smallest: Array) -> Array:
        """Shortest edges (…, n), those of coordinates that are held at their whole."""
        return np.where(self.region.held, float(WHOLE), smallest)

    def keep(self, proved: Mask) -> None:
        """Forget boxes that the kernel refuses; their cells are undecided."""
        number, boxes = np.where(proved, np.cumsum(proved) - 1, -1), self.proved.trimmed().take(proved)
        named = np.flatnonzero(self.tree.box >= 0)
        self.tree.box[named] = number[self.tree.box[named]]
        self.tree.status[named[self.tree.box[named] < 0]] = CellStatus.UNDECIDED
        self.proved = Growing(boxes)

    def radius(self, unglued: Indices) -> float:
        """Half width of the largest square about the seed that is certified, with one σ.

        The distance of the nearest other cell, and of the nearest unglued face: of the farther of its two cells.
        """
        leaves = self.tree.leaves()
        other = self.distance(leaves[self.tree.status[leaves] != CellStatus.CERTIFIED])
        cells = np.zeros(len(self.boxes.kappa), dtype=np.int64)
        certified = leaves[self.tree.status[leaves] == CellStatus.CERTIFIED]
        cells[self.tree.box[certified]] = certified
        torn = [self.distance(cells[side]) for side in unglued.T]
        nearest = np.min(np.maximum(*torn), initial=self._edge())
        return float(max(0.0, np.min(other, initial=nearest) * (1.0 - 1e-12)))

    def _edge(self) -> float:
        """Half width of the largest square about the seed inside the region."""
        region = self.region
        edges = np.where(region.wrapped, 0.5 * region.width, np.minimum(self.q0 - region.lower, region.upper - self.q0))
        return float((edges * self.shape.weights)[~region.held & (self.shape.weights > 0.0)].min())

    def distance(self, cells: Indices) -> Array:
        """Distance of cells from the seed, by default in the maximum norm; periodic coordinates the short way round."""
        low, high = self.edges(cells)
        turn = np.where(self.region.wrapped, self.region.width, 0.0)
        gaps = [np.maximum(np.maximum(low - q, q - high), 0.0) for q in (self.q0 - turn, self.q0, self.q0 + turn)]
        return self.shape.of(np.min(gaps, axis=0))

    def edges(self, cells: Indices) -> tuple[Array, Array]:
        """Lower and upper corners of cells in q-space."""
        lower = self.tree.lower[cells]
        return self.region.position(lower), self.region.position(lower + self.tree.size[cells])

    def wave(self, cells: Indices, smallest: Array) -> None:
        """Prove cells; split those that fail where an edge is longer than `smallest` (whole-number units, (K, n))."""
        if not cells.size:
            return
        if len(self.boxes.kappa) >= self._budget:
            raise Stopped
        origins = rows_of(self._origins.rows, cells)
        hopeless = self._hopeless(cells, origins, smallest)
        stretch, tried = self._stretch(origins), np.flatnonzero(~hopeless)
        accepted = np.zeros(len(cells), dtype=np.bool_)
        if tried.size:
            found = self._prove(cells[tried], rows_of(origins, tried))
            stretch[tried] = found.stretch
            boxes, proved = found.boxes.take(found.proved), tried[found.proved]
            glued = self._glued_to_origin(rows_of(origins, proved), boxes)
            accepted[proved[glued]] = True
            self.tree.box[cells[accepted]] = len(self.boxes.kappa) + np.arange(np.count_nonzero(glued))
            self.proved.add(boxes.take(glued))
        self.tree.status[cells[accepted]] = CellStatus.CERTIFIED
        children = self._split(cells[~accepted], stretch[~accepted], smallest[~accepted])
        self._origins.add(_Origins.unknown(len(children), len(self.q0)))
        if not len(self.boxes.kappa) and children.size:
            self._reach_seed()
        self._spread(cells[accepted], children)
        self._report(self.tree, len(self.boxes.kappa), len(self.candidates()))

    def _hopeless(self, cells: Indices, origins: _Origins, smallest: Array) -> Mask:
        """Cells that are too large beside the box they were reached from to be worth a try before they are halved.

        κ grows with a cell's edges: if it is about even in them, by 1 + 1/n where one of n is doubled. So a cell whose
        volume is 2ᵈ times that of a box with κ is tried only if κ(1 + 1/n)ᵈ < 1, or if it may not be halved.
        """
        if not len(self.boxes.kappa):
            return np.zeros(len(cells), dtype=np.bool_)
        size, n = self.tree.size[cells], len(self.q0)
        boxes = np.maximum(origins.box, 0)
        edges = np.where(self.region.held, WHOLE, 2.0 * self.boxes.half[boxes] / self.region.span * WHOLE)
        doublings = np.round(np.log2(size / edges).sum(axis=1))
        grown = self.boxes.kappa[boxes] * (1.0 + 1.0 / n) ** doublings
        divisible = np.any((size > smallest) & (size > 1), axis=1)
        return np.asarray((origins.box >= 0) & (doublings > 0) & (grown >= 1.0) & divisible)

    def _stretch(self, origins: _Origins) -> Array:
        """How far σ stretches each coordinate in the boxes that cells were reached from, of shape (B, n)."""
        if not len(self.boxes.kappa):
            return np.ones((len(origins.box), len(self.q0)))
        slopes = self.boxes.directions[np.maximum(origins.box, 0)][:, self.problem.system.dependent]
        return np.asarray(np.linalg.norm(slopes, axis=1))

    def _prove(self, cells: Indices, origins: _Origins) -> Proved:
        start = np.tile(self.seed, (len(cells), 1))
        rows = np.flatnonzero(origins.box >= 0)
        if rows.size:
            parents = self.boxes.take(origins.box[rows])
            start[rows] = predict(self.problem, parents, self._delta(parents, origins.at_box[rows]))
        start[:, self.problem.system.independent] = self.region.position(origins.at_cell)
        data = CellsToProve(*place(self.tree, self.region, cells), start, np.tile(self.seed, (len(cells), 1)))
        return prove_cells(self.runner, data, self._chunk)

    def _delta(self, boxes: Boxes, at: Array) -> Array:
        """Points in whole-number units as parameters of boxes."""
        return self.region.position(at) - boxes.centre[:, self.problem.system.independent]

    def _glued_to_origin(self, origins: _Origins, boxes: Boxes) -> Mask:
        """Whether new boxes carry the solution of the box (or the seed) they were reached from."""
        result, delta = np.zeros(len(boxes.kappa), dtype=np.bool_), self._delta(boxes, origins.at_cell)
        rows = np.flatnonzero(origins.box >= 0)
        if rows.size:
            parents = self.boxes.take(origins.box[rows])
            at_parent = self._delta(parents, origins.at_box[rows])
            children = boxes.take(origins.box >= 0)
            result[rows] = glue_boxes(self.runner, parents, at_parent, children, delta[rows], self._chunk)
        for k in np.flatnonzero(origins.box < 0):
            one, ball = slice(k, k + 1), (self._point.centre, self._point.radius, self._point.modes)
            result[one] = encloses(self.problem, rows_of(boxes, one), delta[one], *ball)
        return result

    def _split(self, cells: Indices, stretch: Array, smallest: Array) -> Indices:
        """Halve cells along the edge σ stretches most; those that may not be halved are undecided. The new leaves."""
        size = self.tree.size[cells]
        allowed = (size > smallest) & (size > 1)
        lengths = self.region.width * (size / WHOLE)
        stretched = np.where(np.isfinite(stretch), stretch, 0.0) * lengths
        fair = stretched + 1e-3 * np.max(stretched, axis=1, keepdims=True, initial=1e-300) * (size / WHOLE)
        fair = np.where(allowed, fair, -1.0)
        cut = np.argmax(fair >= np.max(fair, axis=1, keepdims=True, initial=-1.0) * (1.0 - 1e-9), axis=1)
        splittable = np.any(allowed, axis=1)
        self.tree.status[cells[~splittable]] = CellStatus.UNDECIDED
        return self.tree.split(cells[splittable], cut[splittable])

    def _spread(self, done: Indices, children: Indices) -> None:
        """Make neighbours of new boxes, and new leaves beside old boxes, candidates."""
        contacts = contacts_of(self.tree, self.region, np.concatenate([done, children]))
        status = self.tree.status
        outward = (status[contacts.cell] == CellStatus.CERTIFIED) & (status[contacts.leaf] == CellStatus.UNREACHED)
        inward = (status[contacts.cell] == CellStatus.UNREACHED) & (status[contacts.leaf] == CellStatus.CERTIFIED)
        self._propose(
            np.concatenate([contacts.leaf[outward], contacts.cell[inward]]),
            self.tree.box[np.concatenate([contacts.cell[outward], contacts.leaf[inward]])],
            np.concatenate([contacts.at_cell[outward], contacts.at_leaf[inward]]),
            np.concatenate([contacts.at_leaf[outward], contacts.at_cell[inward]]),
            np.concatenate([contacts.area[outward], contacts.area[inward]]),
        )

    def _propose(self, cells: Indices, boxes: Indices, at_box: Array, at_cell: Array, area: Array) -> None:
        """Make cells candidates, each reached from the box with the largest common face (the oldest of equals)."""
        order = np.lexsort((boxes, -area, cells))
        first = order[np.flatnonzero(np.diff(cells[order], prepend=-1))]
        chosen, origins = cells[first], self._origins.rows
        origins.box[chosen], origins.at_box[chosen], origins.at_cell[chosen] = (
            boxes[first],
            at_box[first],
            at_cell[first],
        )
        self.tree.status[chosen] = CellStatus.CANDIDATE
