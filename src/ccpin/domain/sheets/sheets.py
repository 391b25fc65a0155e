"""All sheets of σ over a region: how many closed configurations every q has, and how they hang together.

What is claimed. The region is in cells. Over the *counted* ones it is proved how many closed configurations every q has
within the limits of slides and coupled joints (Proposition C of `counting`), in ranges that hold all of these (Lemma R
of `ccpin.proof.ranges`); where there are none, the cell is empty. Over the *certified* ones each of them is a smooth
function of q in a box of Theorem N, and boxes of neighbours are glued where they carry the same one. A *sheet* is a
connected part of the nonsingular closed configurations, as far as boxes are glued (an aspect, in the literature on
parallel robots). Most sheets have one configuration over each q. On one that has several (`Sheet.layers`) they change
places along some way in q, round a cusp as a rule: the mechanism goes from one assembly mode to another and meets no
singularity (`SheetAtlas.way`). This is what an `Atlas` with `single_valued` false stands before.

What is not claimed. All singular closed configurations over the region lie over the cells that are neither counted nor
empty. *Singular* ones of them hold one that is proved (Theorem S); of the *undecided* ones nothing
is known. Two sheets told apart here may be one that is connected through undecided cells or outside of the region.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from threading import Event
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from ccpin.arrays import Array, Indices, Mask, numbers, whole
from ccpin.covering.cells import CellStatus, CellTree, SingularCells, place
from ccpin.covering.documents import packed, unpacked
from ccpin.covering.faces import contacts_of
from ccpin.covering.proposals.solving import newton
from ccpin.covering.region import Region, points_of
from ccpin.covering.runner import Runner
from ccpin.domain.closures.packing import fingerprint_of, same_closures
from ccpin.domain.closures.system import Reading
from ccpin.domain.documents import store
from ccpin.domain.documents.kinds import SHEETS
from ccpin.domain.sheets.cover import Glued, Members
from ccpin.domain.sheets.seams import Fold, cross, near_folds
from ccpin.domain.sheets.sheet_claims import ProvedSheets, mark, proved_again
from ccpin.domain.singular.cusp_points import Cusp, distinct, proved_cusps
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of
from ccpin.proof.cell_tree import WHOLE
from ccpin.proof.equations import Problem, closure_values, closures_of
from ccpin.proof.narrowing import Candidates
from ccpin.proof.newton import Boxes, check, solve_in_boxes, without_turns
from ccpin.proof.ranges import Ranges

_PART = 500  # starts at a time: bounds the memory of their third derivatives
_RECORDS: dict[str, Any] = {"members": Members, "glued": Glued, "left": Candidates, "ranges": Ranges}


class Sheet(NamedTuple):
    """One sheet.

    Attributes:
        number: Its place among `SheetAtlas.sheets`, the largest first.
        boxes: Its boxes, indices in `SheetAtlas.boxes`.
        layers: The most configurations that it has over one certified cell; above 1 they change
            places along some way in q, round a cusp as a rule.
        area: Of its boxes, in radⁿ (metres for sliding coordinates), each layer counted.
        sign: The sign of det φ_y on it.
    """

    number: int
    boxes: Indices
    layers: int
    area: float
    sign: int


class ModeChange(NamedTuple):
    """A path in q that ends where it begins, in another assembly mode, and stays in certified boxes of one sheet.

    Attributes:
        path: Waypoints, of shape (K, n); the last q is the first (turns of 2π of a periodic coordinate not counted).
        start, end: The closed configurations at its ends, of shape (nq,) each.
        sheet: The sheet's number.
    """

    path: Array
    start: Array
    end: Array
    sheet: int


@dataclass(frozen=True, eq=False)
class SheetAtlas:
    """All sheets over a region; angles in radians.

    Attributes:
        names: The independent coordinates, in the order of q.
        region: What was asked for.
        reading: The closures, and how their coordinates and configurations correspond.
        tree: The cells.
        boxes: The certified boxes, as Theorem N has them.
        members: Which boxes lie over which cells.
        glued: Which boxes carry the same σ at a common face.
        count: How many closed configurations the q of a cell have; −1 where that is not proved. Of shape (cells,).
        left: Boxes of all coordinates that enclose all singular closed configurations over the region.
        ranges: What was searched of the dependent coordinates, and why that is all.
        complete: False where an interrupt ended the work; what is there is proved nevertheless.
        singular: A singular configuration over each cell called so.
        proved: The facts about its boxes and cells; ``None`` of sheets from a file that were not replayed.
        source: The file it was loaded from, if it was: what it says rests on that file, but for its boxes, which `load`
            proved again. `ccpin.auditing.verify` proves the rest.
    """

    names: tuple[str, ...]
    region: Region
    reading: Reading
    tree: CellTree
    boxes: Boxes
    members: Members
    glued: Glued
    count: NDArray[np.int64]
    left: Candidates
    ranges: Ranges
    complete: bool
    singular: SingularCells
    proved: ProvedSheets | None = None
    source: str | None = None

    def __post_init__(self) -> None:
        if self.proved is not None and not self.proved.says(self):
            raise InvalidInputError("sheets that are not those that were proved")

    def __repr__(self) -> str:
        done = ("" if self.complete else ", interrupted") + ("" if self.source is None else ", loaded")
        return (
            f"SheetAtlas({', '.join(self.names)}: {len(self.sheets)} sheets in {len(self.boxes.kappa)} boxes, "
            f"{100 * self.counted_fraction:.4g} % of the region counted{done})"
        )

    @property
    def problem(self) -> Problem:
        """The closures."""
        return self.reading.problem

    @cached_property
    def sheet_of(self) -> Indices:
        """The sheet of each box, of shape (B,)."""
        size = len(self.boxes.kappa)
        labels = connected_components(self._graph, directed=False)[1] if size else np.zeros(0, dtype=np.intp)
        area = np.bincount(labels, weights=self._areas, minlength=1)
        rank = np.empty(len(area), dtype=np.intp)
        rank[np.argsort(-area, kind="stable")] = np.arange(len(area))
        return np.asarray(rank[labels])

    @property
    def _graph(self) -> coo_array:
        size = len(self.boxes.kappa)
        return coo_array((np.ones(len(self.glued.first)), (self.glued.first, self.glued.second)), shape=(size, size))

    @property
    def _areas(self) -> Array:
        return np.asarray(np.prod(2.0 * self.boxes.half, axis=1))

    @cached_property
    def sheets(self) -> tuple[Sheet, ...]:
        """The sheets, the largest first."""
        system = self.problem.system
        signs = np.sign(np.linalg.det(closure_values(self.problem, self.boxes.centre)[1][:, :, system.dependent]))
        found = []
        for k in range(int(self.sheet_of.max(initial=-1)) + 1):
            boxes = np.flatnonzero(self.sheet_of == k)
            cells = self.members.cell[np.isin(self.members.box, boxes)]
            whole_cells = cells[self.tree.status[cells] == CellStatus.CERTIFIED]
            layers = int(np.bincount(whole_cells).max(initial=1))
            found.append(Sheet(k, boxes, layers, float(self._areas[boxes].sum()), int(signs[boxes[0]])))
        return tuple(found)

    def fraction(self, *statuses: CellStatus) -> float:
        """The share of the region in cells of the given statuses."""
        return self.tree.share(self.tree.leaves(*statuses))

    @property
    def counted_fraction(self) -> float:
        """The share of the region over which the number of closed configurations is proved, empty cells with it."""
        leaves = self.tree.leaves()
        return self.tree.share(leaves[self.count[leaves] >= 0])

    @property
    def certified_fraction(self) -> float:
        """The share of the region over which every closed configuration is in a certified box."""
        return self.fraction(CellStatus.CERTIFIED)

    @property
    def empty_fraction(self) -> float:
        """The share of the region proved to hold no closed configuration."""
        return self.fraction(CellStatus.EMPTY)

    @property
    def singular_fraction(self) -> float:
        """The share of the region in cells that are not counted and hold the q of a proved singular configuration."""
        singular = self.tree.leaves(CellStatus.SINGULAR)
        return self.tree.share(singular[self.count[singular] < 0])

    @property
    def undecided_fraction(self) -> float:
        """The share of the region that is neither counted nor singular."""
        return 1.0 - self.counted_fraction - self.singular_fraction

    def verify(self) -> Mask:
        """Check Theorem N for every box again, from its data alone, of shape (B,)."""
        return check(closures_of(self.problem), self.boxes).proved

    @property
    def fingerprint(self) -> str:
        """SHA-256 of the closures it is about, as its file has it."""
        return fingerprint_of(self.problem)

    def is_about(self, mechanism: Mechanism | HasMechanism) -> bool:
        """Whether the closures are those that a mechanism's file gives today, bit for bit."""
        return same_closures(self.reading, self.names, mechanism_of(mechanism))

    def save(self, path: str | Path) -> None:
        """Write the sheets to a file (``.json``, else npz), whole or not at all; `ccpin.auditing.verify` checks it."""
        header, arrays = store.pack(self)
        header |= {"names": list(self.names), "complete": self.complete}
        for part in _RECORDS:
            arrays |= packed(part, getattr(self, part))
        store.write(path, SHEETS, header, arrays | {"count": self.count})

    @classmethod
    def load(cls, path: str | Path, *, replay: bool = False) -> SheetAtlas:
        """Read sheets that `save` wrote. If the file may have been altered, call `verify` or `auditing.verify`.

        Args:
            path: The file.
            replay: Whether to prove once more how many configurations its cells have and which boxes are glued; its
                boxes are proved in any case.

        Raises:
            InvalidInputError: The file cannot be read or is none, or what was proved of it is not found to hold.
        """
        with store.reading(path, SHEETS) as (header, arrays):
            records = {part: unpacked(part, kind, arrays) for part, kind in _RECORDS.items()}
            held = store.unpack(header, arrays)
            sheets = cls(
                names=tuple(header["names"]),
                count=arrays["count"].astype(np.int64),
                complete=header["complete"],
                reading=held.reading,
                region=held.region,
                tree=held.tree,
                boxes=held.solutions.claim.boxes,
                singular=held.singular,
                **records,
                source=str(path),
            )
            return sheets.replayed() if replay else sheets

    def replayed(self) -> SheetAtlas:
        """The same with all that is said of its cells and boxes proved once more.

        Raises:
            InvalidInputError: It is not found to hold: the file was altered.
        """
        runner = Runner(self.problem, None, None, Event())
        proved = proved_again(runner, self)
        if not proved.says(self) or mark(self.tree, proved):
            raise InvalidInputError("what it says of its cells is not found to hold: the file was altered")
        return replace(self, glued=proved.glued, proved=proved)

    def number_of_solutions(self, q: ArrayLike) -> int | NDArray[np.int64]:
        """How many closed configurations q (n,) has, −1 where that is not proved; an array (K,) for points (K, n)."""
        cells = self._cells(points_of(q, self.names))
        found = np.where(cells >= 0, self.count[cells], -1)
        return int(found[0]) if np.ndim(q) == 1 else found

    def solutions(self, q: ArrayLike) -> tuple[Array, Indices]:
        """All closed configurations over a certified q (n,): (k, nq), and the sheet of each, (k,).

        Raises:
            InvalidInputError: q is not certified.
        """
        theta, box = self._over(q)
        return self.reading.configuration(theta), self.sheet_of[box]

    def sigma(self, q: ArrayLike, near: ArrayLike) -> Array:
        """q′ over q (n,), of the closed configurations there the one nearest to a configuration, of shape (nq,).

        Raises:
            InvalidInputError: q is not certified, or nothing closes there.
        """
        found = self.solutions(q)[0]
        if not len(found):
            raise InvalidInputError(f"nothing closes at q = {np.asarray(q).tolist()}: the region is empty there")
        chart = self.reading.chart
        wanted = chart.theta(numbers(near, "near"))
        gap = np.array([chart.theta(q_free) for q_free in found]) - wanted
        periodic = self.problem.system.periodic[: gap.shape[1]]
        gap = without_turns(gap, periodic)
        return np.asarray(found[int(np.argmin(np.linalg.norm(gap, axis=1)))])

    def way(self, q: ArrayLike, start: int, end: int) -> Array:
        """Waypoints (K, n) of a path from q to q that leads from one closed configuration over it to another.

        The path stays within certified boxes of one sheet: `certify_path` of it, from the first one, proves the change
        of assembly mode without a singularity.

        Args:
            q: A certified point, of shape (n,).
            start: The first configuration, by its place among `solutions(q)`.
            end: The other one.

        Raises:
            InvalidInputError: q is not certified, or the two are on different sheets.
        """
        box = self._over(q)[1]
        first, last = int(box[start]), int(box[end])
        order, before = breadth_first_order(self._graph.tocsr(), first, directed=False)
        if last not in order:
            raise InvalidInputError(
                f"configurations {start} and {end} at q = {np.asarray(q).tolist()} are on different sheets"
            )
        chain = [last]
        while chain[-1] != first:
            chain.append(int(before[chain[-1]]))
        points, turned = self._between(chain[::-1])
        return np.vstack([np.asarray(q) - self._turns(q), *points, np.asarray(q) - self._turns(q) + turned])

    def _turns(self, q: ArrayLike) -> Array:
        """By how much q is turned out of the region."""
        point = points_of(q, self.names)
        return np.asarray((point - self.region.reduce(point))[0])

    def cusps(self) -> tuple[Cusp, ...]:
        """Cusps over the region, looked for from every cell that may hold one and proved (Theorem C).

        All there are lie over cells that are not counted; that none of those holds another is not claimed.

        Raises:
            UnsupportedMechanismError: The atlas has not two coordinates.
        """
        if len(self.names) != 2:
            raise UnsupportedMechanismError(f"cusps are points for two coordinates; the atlas has {len(self.names)}")
        starts = self.left.centre[np.unique(self.left.cell, return_index=True)[1]]
        reading = self.reading._replace(problem=self.problem._replace(phasors=None))
        found = [cusp for k in range(0, len(starts), _PART) for cusp in proved_cusps(reading, starts[k : k + _PART])]
        inside = self._cells(np.array([cusp.q for cusp in found]).reshape(-1, 2)) >= 0
        return distinct(reading, [cusp for cusp, within in zip(found, inside, strict=True) if within])

    def folds(self, most: int = 200) -> tuple[Fold, ...]:
        """Folds at which two sheets are proved to touch (Proposition T of `seams`), each pair of sheets in turn.

        Looked for from σ in the boxes beside cells where a sheet ends; which of them touch nowhere is not claimed.

        Args:
            most: How many places are tried.
        """
        cell, box = self._ends(whole(most, "most"))
        boxes, width = self.boxes.take(box), self.region.width * (self.tree.size[cell] / WHOLE)
        theta = newton(self.problem, boxes.centre, 1).theta
        near, directions, rows = near_folds(self.problem, theta, width)
        found = []
        over = np.empty(len(self.boxes.kappa), dtype=np.intp)
        over[self.members.box] = self.members.cell
        for k in rows:
            beside = self.members.box[self.members.cell == over[box[k]]]
            fold = near.theta[k], near.kernel[k], float(near.error[k])
            other = cross(
                self.problem, (theta[k], self.boxes.take(box[[k]])), directions[k], fold, self.boxes.take(beside)
            )
            if other is not None:
                pair = sorted((int(self.sheet_of[box[k]]), int(self.sheet_of[beside[other]])))
                q = fold[0][self.problem.system.independent]
                found.append(Fold(q, self.reading.configuration(fold[0]), fold[2], (pair[0], pair[1])))
        return tuple(found)

    def _ends(self, most: int) -> tuple[Indices, Indices]:
        """Boxes with a neighbouring cell to which their sheet was not carried on, and that cell, evenly chosen."""
        leaves = self.tree.leaves()
        still = leaves[
            (self.tree.status[leaves] != CellStatus.CERTIFIED) & (self.tree.status[leaves] != CellStatus.EMPTY)
        ]
        contacts = contacts_of(self.tree, self.region, still)
        joined_to = set(zip(self.glued.first.tolist(), self.glued.second.tolist(), strict=True))
        joined_to |= {(second, first) for first, second in joined_to}
        over: dict[int, list[int]] = {}
        for cell, box in zip(self.members.cell.tolist(), self.members.box.tolist(), strict=True):
            over.setdefault(cell, []).append(box)
        ends = dict[int, int]()
        for cell, leaf in zip(contacts.cell.tolist(), contacts.leaf.tolist(), strict=True):
            for box in over.get(leaf, ()):
                if not any((box, other) in joined_to for other in over.get(cell, ())):
                    ends.setdefault(box, cell)
        box = np.array(sorted(ends), dtype=np.intp)
        box = box[:: max(1, -(-len(box) // most))]
        return np.array([ends[int(b)] for b in box], dtype=np.intp), box

    def mode_change(self) -> ModeChange:
        """A change of assembly mode without a singularity, on the largest sheet that goes round a cusp.

        Raises:
            InvalidInputError: No sheet has two configurations over one certified q.
        """
        for sheet in self.sheets:
            pairs = self.members.cell[np.isin(self.members.box, sheet.boxes)]
            cells, layers = np.unique(pairs, return_counts=True)
            cells = cells[(layers > 1) & (self.tree.status[cells] == CellStatus.CERTIFIED)]
            if cells.size:
                largest = cells[int(np.argmax(self.tree.shares(cells)))]
                q = place(self.tree, self.region, np.array([largest]))[0][0]
                found, numbers_of = self.solutions(q)
                first, last = np.flatnonzero(numbers_of == sheet.number)[:2]
                return ModeChange(self.way(q, int(first), int(last)), found[first], found[last], sheet.number)
        raise InvalidInputError("no sheet has two configurations over one certified q of the region")

    def _between(self, chain: list[int]) -> tuple[list[Array], Array]:
        """The middles of boxes and of the faces between them, angles unwound, and how far that went round."""
        centre, faces = self.boxes.centre[:, self.problem.system.independent], {}
        for one, other, at_one, at_other in zip(*self.glued, strict=True):
            faces[int(one), int(other)] = at_one, at_other
            faces[int(other), int(one)] = at_other, at_one
        points, shift = [centre[chain[0]]], np.zeros(len(self.names))
        for one, other in pairwise(chain):
            here, there = faces[one, other]
            points.append(here + shift)
            shift = shift + here - there
            points.append(centre[other] + shift)
        return points, shift

    def _over(self, q: ArrayLike) -> tuple[Array, Indices]:
        """θ of the closed configurations over a certified q, and their boxes."""
        point = points_of(q, self.names)
        cell = self._cells(point)
        if len(point) != 1 or cell[0] < 0 or self.tree.status[cell[0]] not in (CellStatus.CERTIFIED, CellStatus.EMPTY):
            raise InvalidInputError(f"q = {np.asarray(q).tolist()} is not one certified point of the region")
        box = self.members.box[self.members.cell == cell[0]]
        boxes = self.boxes.take(box)
        delta = self.region.reduce(point) - boxes.centre[:, self.problem.system.independent]
        theta = newton(self.problem, solve_in_boxes(self.problem, boxes, delta).theta, 1).theta
        theta[:, self.problem.system.independent] = point
        return theta, box

    def _cells(self, points: Array) -> Indices:
        return self.tree.locate(self.region.cell_coordinates(points))
