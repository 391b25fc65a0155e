"""Atlases of all kinds on disk: one file of plain arrays (no pickles), npz or JSON, written whole or not at all.

Each is a certificate that stands alone: the closures and their fingerprint, the theorem and every number it speaks of.
`ccpin.auditing` checks it with code of its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from ccpin.containers import NamedArrays, told_of
from ccpin.covering.cells import Cells, CellTree, SingularCells
from ccpin.covering.claims import proved_boxes
from ccpin.covering.documents import Document, pack_region, packed, unpack_region, unpacked
from ccpin.covering.region import Region
from ccpin.domain.closures.packing import fingerprint, pack_reading, unpack_reading
from ccpin.domain.closures.system import Reading
from ccpin.domain.documents.checked import checked_boxes, checked_cells, checked_closures, checked_region
from ccpin.errors import InvalidInputError
from ccpin.proof.facts import Fact
from ccpin.proof.newton import Boxes


class Covering(NamedTuple):
    """What every kind holds: the closures, the region, its cells, the fact about its boxes and what is singular."""

    reading: Reading
    region: Region
    tree: CellTree
    solutions: Fact
    singular: SingularCells


def write(path: str | Path, kind: Document, header: Mapping[str, Any], arrays: NamedArrays) -> None:
    """Write arrays and a header to a file (``.json``, else npz), with the closures' fingerprint.

    Raises:
        InvalidInputError: It cannot be written.
    """
    kind.write(path, {"fingerprint": fingerprint(arrays), **header}, arrays)


@contextmanager
def reading(path: str | Path, kind: Document) -> Iterator[tuple[dict[str, Any], NamedArrays]]:
    """The header and the arrays of a file; what is wrong with what is formed of them is told of the file.

    Raises:
        InvalidInputError: The file is not of that kind, cannot be read, or contradicts itself.
    """
    header, arrays = kind.schema.read(path)
    with told_of(path):
        if fingerprint(arrays) != header["fingerprint"]:
            raise InvalidInputError("the closures are not those of which its fingerprint was taken")
        checked_closures(header, arrays)
        checked_region(arrays)
        if "tree_child" in arrays:
            checked_cells(arrays)
            checked_boxes(arrays)
        yield header, arrays


class HasBoxes(Protocol):
    """What every kind is."""

    @property
    def reading(self) -> Reading:
        """The closures."""

    @property
    def region(self) -> Region:
        """The region."""

    @property
    def tree(self) -> CellTree:
        """Its cells."""

    @property
    def boxes(self) -> Boxes:
        """The boxes."""

    @property
    def singular(self) -> SingularCells:
        """What is singular."""


def pack(covering: HasBoxes) -> tuple[dict[str, Any], NamedArrays]:
    """What every kind holds, as a header and arrays."""
    header, arrays = pack_reading(covering.reading)
    arrays |= packed("box", covering.boxes) | packed("tree", covering.tree.cells)
    return header, arrays | packed("singular", covering.singular) | pack_region(covering.region)


def unpack(header: dict[str, Any], arrays: NamedArrays) -> Covering:
    """What `pack` packed, each box proved again: solutions are found with the numbers that the file has.

    Raises:
        InvalidInputError: Theorem N does not hold for a box: the file was altered.
    """
    reading, boxes = unpack_reading(header, arrays), unpacked("box", Boxes, arrays)
    solutions, proved = proved_boxes(reading.problem, boxes)
    if not np.all(proved):
        raise InvalidInputError(f"box {int(np.argmin(proved))} is not proved: the file was altered")
    return Covering(
        reading,
        unpack_region(arrays),
        CellTree(unpacked("tree", Cells, arrays)),
        solutions,
        unpacked("singular", SingularCells, arrays),
    )
