"""Inputs over which something was proved of a program, which then refuses all others: by status 3."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.errors import InvalidInputError
from ccpin.programs.sine_cosine import PRECISIONS, Precision

OUTSIDE = 3  # the status


class CertifiedRegion(NamedTuple):
    """A box of a program's inputs, y among them, and what was proved there. No number (NaN) is in none.

    Attributes:
        lower, upper: Of every input, in the order of the numbers.
        formats: Those in which it was proved.
        statement: What was proved, in words; whoever has it believes it, or has its certificate replayed.
    """

    lower: tuple[float, ...]
    upper: tuple[float, ...]
    formats: tuple[str, ...]
    statement: str

    def ends(self, precision: Precision) -> tuple[Any, Any]:
        """The least and the largest numbers of a format that are in it, of shape (inputs,)."""
        ends = []
        for wide, outside, inwards in ((self.lower, np.less, np.inf), (self.upper, np.greater, -np.inf)):
            exact = np.array(wide)
            with np.errstate(over="ignore"):
                near = exact.astype(precision.type)
            ends.append(np.where(outside(near, exact), np.nextafter(near, precision.type(inwards)), near))
        return ends[0], ends[1]

    def holds(self, columns: Any, precision: Precision) -> Any:
        """Which rows of inputs, of shape (inputs, N), are in it."""
        lower, upper = self.ends(precision)
        table = np.asarray(columns)
        return np.all((table >= lower[:, None]) & (table <= upper[:, None]), axis=0)

    def require(self, format: str) -> None:
        """Nothing, if it was proved in a format.

        Raises:
            InvalidInputError: It was not.
        """
        if format not in self.formats:
            raise InvalidInputError(
                f"what was proved of the program is of {' and '.join(self.formats)}, not of {format}"
            )

    def document(self) -> dict[str, Any]:
        """It as JSON has it."""
        ends = {name: [value.hex() for value in getattr(self, name)] for name in ("lower", "upper")}
        return ends | {"formats": list(self.formats), "statement": self.statement}


def region_of(document: Any, count: int) -> CertifiedRegion:
    """The region of a document, of so many inputs.

    Raises:
        ValueError: It is none.
    """
    lower, upper = (tuple(map(float.fromhex, document[name])) for name in ("lower", "upper"))
    formats, statement = tuple(document["formats"]), document["statement"]
    if not _is_region(lower, upper, formats, count) or not isinstance(statement, str):
        raise ValueError("its region is none of its inputs")
    return CertifiedRegion(lower, upper, formats, statement)


def _is_region(lower: Collection[float], upper: Collection[float], formats: Collection[Any], count: int) -> bool:
    ends: list[Array] = [np.array(tuple(each)) for each in (lower, upper)]
    told = bool(formats) and all(name in PRECISIONS for name in formats)
    return (
        told
        and all(end.shape == (count,) and np.isfinite(end).all() for end in ends)
        and bool((ends[0] <= ends[1]).all())
    )
