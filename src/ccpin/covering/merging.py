"""Trees of cells of parts of a region, made apart, put together as the one tree of the region."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import NamedTuple, Protocol

import numpy as np

from ccpin.arrays import Indices
from ccpin.covering.cells import CellTree
from ccpin.covering.region import Region
from ccpin.errors import InvalidInputError
from ccpin.proof.cell_tree import WHOLE, Integers
from ccpin.proof.equations import Problem
from ccpin.proof.newton import Boxes
from ccpin.proof.rounding import TURN, UNIT_ROUNDOFF

_TURN = 1e-9  # rad: corners given as decimals miss a turn by less; no gap that was left on purpose is so narrow
_SPARE, _SPARE_ROUNDINGS = 8e-15, Fraction(19, 10)  # of the lemma of `ccpin.proof.rounding`


class PartialCover(Protocol):
    """What has cells over a region, and boxes."""

    @property
    def region(self) -> Region:
        """The region."""

    @property
    def problem(self) -> Problem:
        """The closures."""

    @property
    def tree(self) -> CellTree:
        """The cells."""

    @property
    def boxes(self) -> Boxes:
        """The boxes."""


class CellOffset(NamedTuple):
    """Where a part's cells came: the number of its first one in the whole, and by how much the others' moved."""

    first: int
    others: int

    def of(self, cells: Indices) -> Indices:
        """Cells of the part by their numbers in the whole."""
        return np.where(cells == 0, self.first, cells + self.others)


def whole_region(parts: Sequence[PartialCover]) -> Region:
    """The smallest region that holds all parts."""
    lower = np.min([part.region.lower for part in parts], axis=0)
    upper = np.max([part.region.upper for part in parts], axis=0)
    system = parts[0].problem.system
    wrapped = system.periodic[system.independent] & (upper - lower >= TURN - _TURN)
    return Region(lower, np.where(wrapped, lower + TURN, upper), wrapped)


def grafted(region: Region, parts: Sequence[PartialCover]) -> tuple[CellTree, list[CellOffset]]:
    """The region's cells: halved down to the parts', whose trees are put there; and where each came.

    Raises:
        InvalidInputError: The parts' regions leave a gap, overlap, or are not got by halving the region.
    """
    places = [_place(region, part.region, k) for k, part in enumerate(parts, start=1)]
    first = np.cumsum([0, *(len(part.boxes.kappa) for part in parts)])
    tree = CellTree.whole(len(region.lower))
    waiting, put = [(0, list(range(len(parts))))], [CellOffset(0, 0)] * len(parts)
    while waiting:
        cell, held = waiting.pop()
        lower, size = tree.lower[cell], tree.size[cell]
        if not held:
            at = region.position(lower).tolist(), region.position(lower + size).tolist()
            raise InvalidInputError(f"no part covers the region from {at[0]} to {at[1]}")
        exact = [k for k in held if np.array_equal(places[k][0], lower) and np.array_equal(places[k][1], size)]
        if exact:
            if len(held) > 1:
                k = next(k for k in held if k != exact[0])
                raise InvalidInputError(f"parts {min(k, exact[0]) + 1} and {max(k, exact[0]) + 1} overlap")
            put[exact[0]] = CellOffset(cell, len(tree.child) - 1)  # its first cell takes the place of this one
            _graft(tree, cell, parts[exact[0]], int(first[exact[0]]), exact[0] + 1)
            continue
        axis, above = _cut(lower + size // 2, held, places)
        child = int(tree.split(np.array([cell]), np.array([axis]))[0])
        waiting += [(child + side, [k for k in held if above[k] == bool(side)]) for side in (0, 1)]
    return tree, put


def _cut(middle: Integers, held: list[int], places: list[tuple[Integers, Integers]]) -> tuple[int, dict[int, bool]]:
    """A coordinate along which no part lies on both sides of the middle, and which parts lie above it."""
    for axis, border in enumerate(middle):
        if all(places[k][0][axis] >= border or places[k][0][axis] + places[k][1][axis] <= border for k in held):
            return axis, {k: bool(places[k][0][axis] >= border) for k in held}
    raise InvalidInputError(
        f"parts {', '.join(str(k + 1) for k in held)} are not got by halving a region: cut it with split_region"
    )


def _place(region: Region, part: Region, k: int) -> tuple[Integers, Integers]:
    """A part's lower corner and edges in the region's whole-number units."""
    scale = WHOLE / region.span
    lower = np.round((part.lower - region.lower) * scale).astype(np.int64)
    size = np.where(region.held, WHOLE, np.round(part.width * scale)).astype(np.int64)
    halved = (size > 0) & (size & (size - 1) == 0) & (lower % np.maximum(size, 1) == 0)
    aligned = [_aligned(region, part, lower, size, axis) for axis in range(len(lower))]
    if not np.all(halved & aligned & (region.wrapped | ~part.wrapped)):
        raise InvalidInputError(
            f"part {k} from {part.lower.tolist()} to {part.upper.tolist()} is not got by halving the region from "
            f"{region.lower.tolist()} to {region.upper.tolist()}: cut it with split_region"
        )
    return lower, size


def _aligned(region: Region, part: Region, lower: Integers, size: Integers, axis: int) -> bool:
    """Whether what is proved of a part's cells is proved of those of the whole in their place, along a coordinate.

    A part's real cells differ from the whole's by its corners' errors, linearly between them. The lemma of
    `ccpin.proof.rounding` has 1.9u|x| + 8e-15 to spare: as much is allowed at both corners, and at zero in between.
    """
    if region.held[axis]:
        return bool(part.lower[axis] == region.lower[axis] and part.upper[axis] == region.upper[axis])
    start, width = Fraction(region.lower[axis]), Fraction(region.upper[axis]) - Fraction(region.lower[axis])
    corners = [start + width * int(at) / WHOLE for at in (lower[axis], lower[axis] + size[axis])]
    errors = [abs(corner - Fraction(end[axis])) for corner, end in zip(corners, (part.lower, part.upper), strict=True)]
    points = list(zip(corners, errors, strict=True))
    if corners[0] < 0 < corners[1]:
        points.append((Fraction(0), (corners[1] * errors[0] - corners[0] * errors[1]) / (corners[1] - corners[0])))
    return all(error <= Fraction(_SPARE) + _SPARE_ROUNDINGS * Fraction(UNIT_ROUNDOFF) * abs(x) for x, error in points)


def _graft(tree: CellTree, cell: int, part: PartialCover, first_box: int, k: int) -> None:
    """Put a part's cells in the place of a cell."""
    size, cells = tree.size[cell], part.tree.cells
    ratio = WHOLE // size
    if np.any(cells.size % ratio):
        raise InvalidInputError(f"part {k} has cells too small to be told apart in the whole region: merge fewer parts")
    start = len(tree.child) - 1
    moved = cells._replace(
        lower=tree.lower[cell] + cells.lower // ratio,
        size=cells.size // ratio,
        child=np.where(cells.child >= 0, cells.child + start, -1),
        box=np.where(cells.box >= 0, cells.box + first_box, -1),
    )
    tree.put(cell, moved)
