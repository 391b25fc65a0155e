"""Documents: records of arrays in one file, by a declared schema, with the theorems that their claims rest on."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ccpin.containers import NamedArrays
from ccpin.covering.region import Region
from ccpin.proof.theorems import theorems
from ccpin.schemas import Schema

Record = TypeVar("Record")


class Document(NamedTuple):
    """A kind of document.

    Attributes:
        schema: What it holds.
        theorems: The theorems that its claims rest on.
        besides: Further theorems, and the arrays of which the claims that need them are made.
    """

    schema: Schema
    theorems: tuple[str, ...]
    besides: tuple[tuple[str, frozenset[str]], ...] = ()

    def write(self, path: str | Path, header: Mapping[str, Any], arrays: NamedArrays) -> None:
        """Write one, with the text of its theorems.

        Raises:
            InvalidInputError: It cannot be written.
        """
        named = (*self.theorems, *(name for name, needed in self.besides if needed <= {*arrays}))
        self.schema.write(path, {"theorem": theorems(*named), **header}, arrays)


def pack_region(region: Region) -> NamedArrays:
    """A region as arrays."""
    return {"lower": region.lower, "upper": region.upper, "wrapped": region.wrapped}


def unpack_region(arrays: NamedArrays) -> Region:
    """What `pack_region` packed."""
    corners: dict[str, Any] = {name: arrays[name] for name in ("lower", "upper")}
    return Region(**corners, wrapped=arrays["wrapped"].astype(np.bool_))


def packed(part: str, record: Any) -> NamedArrays:
    """The fields of a record of arrays, under names that begin with its own."""
    return {f"{part}_{name}": array for name, array in record._asdict().items()}


def unpacked(part: str, kind: type[Record], arrays: NamedArrays) -> Record:
    """What `packed` packed."""
    fields: tuple[str, ...] = kind._fields  # type: ignore[attr-defined]
    return kind(**{name: arrays[f"{part}_{name}"] for name in fields})
