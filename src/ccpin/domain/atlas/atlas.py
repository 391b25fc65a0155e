"""The atlas: a region of q-space in boxes on each of which σ is proved to exist, be unique and be smooth.

What is claimed, and proved by the kernel (`ccpin.proof`): each box satisfies Theorem N; each was glued to an earlier
one at a common face, the first to the closed configuration at q₀. So through every certified q runs a chain of boxes
along which σ(q₀) continues to σ(q) without meeting a singularity, and `Atlas.sigma` returns that continuation. Where,
moreover, `single_valued` is true, the boxes on the two sides of every shared face carry the same σ: it is one
continuous function on the union of the boxes (angles modulo 2π), whatever the way from q₀. Nonsingularity alone would
not say so: a mechanism may change assembly mode without meeting a singularity, and the faces where that shows are
listed in `unglued`; `ccpin.domain.certify_sheets` then tells the layers apart. `contains`, `sigma` and radii are about
a part of the certified set on which σ is one function all the same (`one_function`): no two of its boxes meet at a
face that is unglued, and ways over glued faces join them all to q₀'s.

What is not claimed. Undecided cells are those not proved at the depth allowed; singular ones those of them over which a
closed configuration is proved to be singular (`atlas.singular`), on whatever branch; unreached cells were not tried, as
no neighbour is certified (σ may exist there, on this branch or another). Empty cells are proved to hold no closed
configuration at all (`emptying`). Limits of dependent joints are not looked at.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ccpin.arrays import Array, Mask
from ccpin.covering.cells import CellStatus, CellTree, SingularCells, leaves_about, place
from ccpin.covering.claims import proved_glue
from ccpin.covering.proposals.solving import newton
from ccpin.covering.region import Region, points_of
from ccpin.displays import boxes, table
from ccpin.domain.atlas.cover_claims import ProvedCover, proved_cover, seams_of
from ccpin.domain.atlas.emptying import empty_facts
from ccpin.domain.atlas.refuting import refutation_of
from ccpin.domain.closures.packing import fingerprint_of, same_closures
from ccpin.domain.closures.system import Reading
from ccpin.domain.documents import store
from ccpin.domain.documents.kinds import ATLAS
from ccpin.domain.paths.obstacles import demand_witnesses
from ccpin.errors import InvalidInputError
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of
from ccpin.proof.covers import RegionCover, one_function, over_region
from ccpin.proof.equations import Problem, closures_of
from ccpin.proof.facts import Fact, NotProvedError, is_fact
from ccpin.proof.newton import Boxes, check, solve_in_boxes
from ccpin.proof.requirements import meets
from ccpin.proof.solutions import SolutionsInBoxes, boxes_of
from ccpin.proof.verdict import Verdict, Witness, fields_of, not_known_of, of_file

_WITNESSES = 12  # cells from which one is looked for
_FAILURES = {
    "empty": "no configuration closes the loops",
    "limit": "a joint is beyond its limits",
    "dexterity": "the end effector is less dexterous than was asked for",
}


@dataclass(frozen=True, eq=False)
class Atlas:
    """A certified region of q-space; angles in radians.

    Attributes:
        names: The independent coordinates, in the order of q.
        q0: The seed, of shape (n,).
        radius: Half width of the largest certified square about q₀, short of the nearest cell not certified and of the
            nearest face that is unglued.
        solutions: The facts about its boxes.
        proved: The facts about its cells and their faces; ``None`` of one from a file that was not replayed. Pickled
            they are facts no longer: such an atlas is undecided until it is `replayed`.
        complete: False where an interrupt ended the work; what is there is certified nevertheless.
        region: What was asked for.
        reading: The closures, and how their coordinates and configurations correspond.
        tree: The cells.
        seed: θ of the seed, of shape (n′,).
        singular: A singular configuration over each cell called so.
        source: The file it was loaded from, if it was: what it says rests on that file, but for its boxes, which `load`
            proved again, and with `replay=True` for where σ is one function. `ccpin.auditing.verify` proves the rest.
        told: Of one from a file or a pickle that was not replayed, which pairs of boxes that says are unglued.
    """

    names: tuple[str, ...]
    q0: Array
    radius: float
    solutions: tuple[Fact, ...]
    proved: ProvedCover | None
    complete: bool
    region: Region
    reading: Reading
    tree: CellTree
    seed: Array
    singular: SingularCells
    source: str | None = None
    told: NDArray[np.int64] | None = None

    def __getstate__(self) -> dict[str, Any]:
        """The fields, and what was proved of faces as it is told: facts do not cross a pickle."""
        return fields_of(self) | {"told": self.unglued}

    @property
    def _known(self) -> ProvedCover | None:
        """The facts, if they are some."""
        return self.proved if self.proved is not None and is_fact(self.proved.cover, RegionCover) else None

    @cached_property
    def boxes(self) -> Boxes:
        """The certified boxes, as Theorem N has them; `lower` and `upper` are their corners."""
        return boxes_of(self.solutions)

    @property
    def unglued(self) -> NDArray[np.int64]:
        """Pairs of boxes that share a face at which they could not be shown to carry the same σ, (K, 2)."""
        if self._known is not None:
            return np.asarray(self._known.cover.found["unglued"])
        return np.zeros((0, 2), dtype=np.int64) if self.told is None else self.told

    def glue(self) -> tuple[Fact, ...]:
        """The facts that glue its boxes; those of one from a file are proved now."""
        if self._known is not None:
            return tuple(fact for fact in self._known.cover.premises if fact not in self.solutions)
        seams = seams_of(self.problem, self.region, self.tree, self.boxes)
        return proved_glue(self.problem, seams, self.solutions)

    def __repr__(self) -> str:
        done = "" if self.complete else ", interrupted"
        share = f"{len(self.boxes.centre)} certified boxes, {100 * self.certified_fraction:.4g} % of the region"
        return f"Atlas({', '.join(self.names)}: {share}{done}{'' if self.source is None else ', loaded'})"

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
    def problem(self) -> Problem:
        """The closures."""
        return self.reading.problem

    @property
    def single_valued(self) -> bool:
        """Whether all shared faces are glued, so that σ is one continuous function on the certified set."""
        return not len(self.unglued)

    @cached_property
    def one_function(self) -> Mask:
        """Boxes that together carry one continuous σ, among them that of q₀, of shape (B,).

        All, if `single_valued` and a way over glued faces joins each to that of q₀, as is proved (or a file says).
        """
        count = len(self.boxes.kappa)
        if self._known is not None:
            cover = self._known.cover
            return one_function(cover.found["faces"], self.unglued, int(cover.claim.start[0]), count)
        if self.single_valued or not count:
            return np.ones(count, dtype=np.bool_)
        seams = seams_of(self.problem, self.region, self.tree, self.boxes)
        faces = np.stack([seams.first, seams.second], axis=1)
        return one_function(faces, self.unglued, int(self._cells_of(self.q0[None])[0]), count)

    @cached_property
    def witness(self) -> Witness | None:
        """A place of the region proved to have no σ, or one that is singular."""
        if self._whole or not self._boxes_known:
            return None
        found = refutation_of(self.reading, self.tree, self.region, self.solutions)
        return next(demand_witnesses(self.reading, self.seed, self._undecided()), None) if found is None else found

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
        """Middles of the largest cells undecided or not reached, where more than Theorem N was asked for."""
        if self.problem.requirements is None:
            return []
        cells = self.tree.leaves(CellStatus.UNDECIDED, CellStatus.UNREACHED)
        volume = np.prod(self.tree.size[cells].astype(np.float64), axis=1)
        largest = cells[np.argsort(-volume, kind="stable")[:_WITNESSES]]
        return list(place(self.tree, self.region, largest)[0])

    @property
    def _whole(self) -> bool:
        if self._known is not None:
            return over_region(self._known.cover, self._known.demanded, self.problem.requirements is not None)
        return self.source is not None and self.certified_fraction == 1.0 and self.single_valued

    @property
    def _boxes_known(self) -> bool:
        """Whether its boxes are facts: of one that was pickled they are not."""
        return all(is_fact(fact, SolutionsInBoxes) for fact in self.solutions)

    @property
    def reason(self) -> str:
        """The verdict in a sentence; where it is not computed from facts, what of it rests on the file (`source`)."""
        if not self._boxes_known:
            return not_known_of("this atlas")
        return self._reason + of_file(None if self._known is not None and self._whole else self.source)

    @property
    def _reason(self) -> str:
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
        return self.tree.share(self.tree.leaves(*statuses))

    def contains(self, q: ArrayLike) -> bool | Mask:
        """Whether q (n,) is certified, and σ one function there; for q of shape (K, n) an array (K,).

        Angles count modulo 2π on full turns.
        """
        points = points_of(q, self.names)
        certified = self._box_numbers(points) >= 0
        return bool(certified[0]) if np.ndim(q) == 1 else certified

    def status(self, q: ArrayLike) -> NDArray[np.int8]:
        """The `CellStatus` of the cells that hold points (K, n); −1 outside of the region."""
        cells = self.tree.locate(self.region.cell_coordinates(points_of(q, self.names)))
        return np.where(cells >= 0, self.tree.status[cells], -1).astype(np.int8)

    def sigma(self, q: ArrayLike) -> Array:
        """q′ = σ(q) on this branch, (nq,) for q (n,) and (K, nq) for (K, n), to rounding.

        Starts in the certified box's tube and takes steps that cannot leave it or fail to converge (`solve_in_boxes`),
        then one of Newton's to polish.

        Raises:
            InvalidInputError: A point is not certified.
        """
        points = points_of(q, self.names)
        numbers = self._box_numbers(points)
        if np.any(numbers < 0):
            first = points[int(np.argmax(numbers < 0))]
            where = "the certified set" if self.single_valued else "the part of the certified set with one σ"
            raise InvalidInputError(f"q = {first.tolist()} is not in {where}; ask `contains` first")
        boxes = self.boxes.take(numbers)
        delta = self.region.reduce(points) - boxes.centre[:, self.problem.system.independent]
        theta = newton(self.problem, solve_in_boxes(self.problem, boxes, delta).theta, 1).theta
        theta[:, self.problem.system.independent] = points
        q_free = self.reading.configuration(theta)
        return np.asarray(q_free[0] if np.ndim(q) == 1 else q_free)

    def verify(self) -> Mask:
        """Check Theorem N for every box again, and what else was asked, from its data alone, of shape (B,)."""
        return check(closures_of(self.problem), self.boxes).proved & meets(self.problem, self.boxes)

    @property
    def fingerprint(self) -> str:
        """SHA-256 of the closures it is about, as its file has it."""
        return fingerprint_of(self.problem)

    def is_about(self, mechanism: Mechanism | HasMechanism) -> bool:
        """Whether the closures are those that a mechanism's file gives today, bit for bit.

        Raises:
            InvalidInputError: It is a workspace's, whose closures hold an end effector besides, which no file names.
        """
        return same_closures(self.reading, self.names, mechanism_of(mechanism), self.seed)

    def save(self, path: str | Path) -> None:
        """Write the atlas to a file (``.json``, else npz), whole or not at all; `ccpin.auditing.verify` checks it."""
        header, arrays = store.pack(self)
        header |= {"names": list(self.names), "radius": self.radius, "complete": self.complete}
        arrays |= {"q0": self.q0, "seed": self.seed, "unglued": self.unglued}
        store.write(path, ATLAS, header, arrays)

    @classmethod
    def load(cls, path: str | Path, *, replay: bool = False) -> Atlas:
        """Read an atlas that `save` wrote. If the file may have been altered, call `verify` or `auditing.verify`.

        Args:
            path: The file.
            replay: Whether to prove once more where its cells lie and at which faces its boxes carry the same σ; its
                boxes are proved in any case.

        Raises:
            InvalidInputError: The file cannot be read or is none, or what was proved of it is not found to hold.
        """
        with store.reading(path, ATLAS) as (header, arrays):
            held = store.unpack(header, arrays)
            atlas = cls(
                names=tuple(header["names"]),
                q0=np.asarray(arrays["q0"], dtype=np.float64),
                radius=header["radius"],
                solutions=(held.solutions,),
                proved=None,
                complete=header["complete"],
                region=held.region,
                reading=held.reading,
                tree=held.tree,
                seed=np.asarray(arrays["seed"], dtype=np.float64),
                singular=held.singular,
                source=str(path),
                told=arrays["unglued"].astype(np.int64),
            )
            return atlas.replayed() if replay else atlas

    def replayed(self) -> Atlas:
        """The same with its cells and faces proved once more.

        Raises:
            InvalidInputError: They are not: the file was altered.
        """
        try:
            if not self._boxes_known:
                boxes = tuple(fact.replay() for fact in self.solutions)
                return replace(self, solutions=boxes, proved=None).replayed()
            proved = proved_cover(self.problem, self.region, self.tree, self.seed, self.solutions, self.glue())
        except NotProvedError as error:
            raise InvalidInputError(f"{error}: the file was altered") from error
        said = self.tree.leaves(CellStatus.EMPTY)
        proved = proved._replace(empty=empty_facts(self.reading, self.region, self.tree))
        if not np.array_equal(self.tree.leaves(CellStatus.EMPTY), said):
            raise InvalidInputError("a cell that is called empty is not proved to be: the file was altered")
        return replace(self, proved=proved)

    def _box_numbers(self, points: Array) -> NDArray[np.int64]:
        """The boxes that carry σ over points (K, n); −1 where none does, or several disagree."""
        numbers = self._cells_of(points)
        return np.where(self.one_function[numbers], numbers, -1) if len(self.boxes.kappa) else numbers

    def _cells_of(self, points: Array) -> NDArray[np.int64]:
        """The boxes of the certified cells that points are in, or may be by rounding; else −1."""
        cells = leaves_about(self.tree, self.region, points)
        numbers = np.where(cells >= 0, self.tree.box[cells], -1)
        return np.where(np.all(numbers >= 0, axis=1), numbers[:, 0], -1)
