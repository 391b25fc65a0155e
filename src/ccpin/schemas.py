"""What documents hold: each kind's fields declared once, a line each, and compared with what a file has.

A document is a JSON header and named arrays (`ccpin.containers`). Of an array its dtype, its shape, its unit and the
range of its numbers are declared, of the header the type of every field. Sizes are letters: a letter stands for one
number throughout a document, so that arrays that belong together fit. Whatever is not declared is refused, and what is
declared must be there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

from ccpin import containers
from ccpin.containers import ArrayOutline, NamedArrays
from ccpin.errors import InvalidInputError

Sizes = dict[str, int]
_COUNTS = 2**53  # whole numbers below it are doubles: a JSON reader of any language has them exactly
_DTYPES = {"f": "float64", "i": "int64", "s": "int8", "b": "bool"}


class Field(NamedTuple):
    """An array.

    Attributes:
        kind: ``f`` float64, ``i`` int64, ``s`` int8, ``b`` truth values.
        shape: Its sizes, letters or numbers, as ``"B p 3"``; empty: a number.
        unit: The unit of its numbers.
        least: The least number allowed.
        below: Numbers are below it; a letter: below that size.
        finite: Whether all numbers are; of measurements some need not be.
    """

    kind: str
    shape: str = ""
    unit: str = ""
    least: float = -np.inf
    below: float | str = np.inf
    finite: bool = True

    def sizes(self, own: str) -> Iterator[str]:
        """Its sizes, small Greek letters as those of one part of many."""
        return (f"{size}{own}" if "α" <= size <= "ω" else size for size in self.shape.split())


class Parts(NamedTuple):
    """Arrays that a document holds several times: ``chain0_tip``, ``chain1_tip`` and so on.

    Attributes:
        number: How many there are, from the header.
        fields: The arrays of each; small Greek letters are sizes of its own.
    """

    number: Callable[[Mapping[str, Any]], int]
    fields: Mapping[str, Field]


class Schema(NamedTuple):
    """A kind of document.

    Attributes:
        name: What it is called.
        format: The name and number of its format.
        header: The type of each field, see `fits`; ``format`` and ``checksum`` are in
            every document.
        fields: Its arrays.
        parts: Arrays that there are several of.
        optional: Groups of arrays that are all there or all absent.
    """

    name: str
    format: str
    header: dict[str, Any]
    fields: dict[str, Field]
    parts: Mapping[str, Parts] = {}
    optional: tuple[Mapping[str, Field], ...] = ()

    def write(self, path: str | Path, header: Mapping[str, Any], arrays: Mapping[str, Any]) -> None:
        """Write a document, whole or not at all (``.json``, else npz).

        Raises:
            InvalidInputError: It cannot be written.
        """
        containers.write(path, *self._whole(header, arrays))

    def write_npz(self, file: IO[bytes], header: Mapping[str, Any], arrays: Mapping[str, Any]) -> None:
        """Write a document to an open file."""
        containers.write_npz(file, *self._whole(header, arrays))

    def read(self, path: str | Path) -> tuple[dict[str, Any], NamedArrays]:
        """The header and the arrays of a file.

        Raises:
            InvalidInputError: It cannot be read, is of another kind or format, or is not as declared; the file and
                the field are named.
        """
        header, arrays = containers.read(path, self.compare)
        with containers.told_of(path):
            self.check_numbers(header, arrays)
        return header, arrays

    def read_npz(self, file: IO[bytes]) -> tuple[dict[str, Any], NamedArrays]:
        """The header and the arrays of an open file.

        Raises:
            InvalidInputError: As for `read`. `ccpin.containers.told_of` names the file, and what else may be wrong.
        """
        header, arrays = containers.read_npz(file, self.compare)
        self.check_numbers(header, arrays)
        return header, arrays

    def _whole(self, header: Mapping[str, Any], arrays: Mapping[str, Any]) -> tuple[dict[str, Any], NamedArrays]:
        """What is written, as declared."""
        whole = {"format": self.format, **header}
        found = {name: np.asarray(array) for name, array in arrays.items()}
        self.compare(
            whole | {containers.CHECKSUM: ""},
            {name: ArrayOutline(array.dtype, array.shape) for name, array in found.items()},
        )
        return whole, found

    def compare(self, header: dict[str, Any], outlines: dict[str, ArrayOutline]) -> None:
        """Compare the header, and dtypes and shapes of all arrays, with what is declared.

        Raises:
            InvalidInputError: They differ; the field is named.
        """
        if header.get("format") != self.format:
            found = repr(header.get("format"))[:60] if "format" in header else "not stated"
            raise InvalidInputError(f"the format is {found}, not {self.format!r}, that of {self.name}")
        declared = {"format": str, containers.CHECKSUM: str, **self.header}
        _refuse_names({*header}, {*declared}, "the header")
        for name, kind in declared.items():
            if not fits(header[name], kind):
                raise InvalidInputError(f"'{name}' in the header is {header[name]!r:.60}, not what it must be")
        self._sizes(header, outlines)

    def check_numbers(self, header: Mapping[str, Any], arrays: NamedArrays) -> None:
        """Check that numbers are finite and in the ranges declared.

        Raises:
            InvalidInputError: They are not; the array is named.
        """
        outlines = {name: ArrayOutline(array.dtype, array.shape) for name, array in arrays.items()}
        sizes = self._sizes(header, outlines)
        for name, (field, _) in self._declared(header, {*arrays}).items():
            below = sizes[field.below] if isinstance(field.below, str) else field.below
            if field.finite and not np.all(np.isfinite(arrays[name])):
                raise InvalidInputError(f"{name} holds numbers that are not finite")
            if field.finite and np.any((arrays[name] < field.least) | (arrays[name] >= below)):
                raise InvalidInputError(f"{name} holds numbers outside {field.least:g} … {below:g}")

    def _sizes(self, header: Mapping[str, Any], outlines: Mapping[str, ArrayOutline]) -> Sizes:
        """The number that each letter stands for."""
        sizes: Sizes = {}
        declared = self._declared(header, {*outlines})
        _refuse_names({*outlines}, {*declared}, "its arrays")
        for name, (field, own) in declared.items():
            dtype, shape = outlines[name]
            wanted = [*field.sizes(own)]
            if dtype != np.dtype(_DTYPES[field.kind]):
                raise InvalidInputError(f"{name} has dtype {dtype}, not {_DTYPES[field.kind]}")
            fitting = len(shape) == len(wanted) and all(
                size == (int(letter) if letter.isdigit() else sizes.setdefault(letter, size))
                for size, letter in zip(shape, wanted, strict=True)
            )
            if not fitting:
                said = ", ".join(f"{s} = {sizes[s]}" for s in dict.fromkeys(wanted) if s in sizes)
                raise InvalidInputError(
                    f"{name} has shape {shape!s:.60}, not ({', '.join(wanted)}) with {said or 'these'}"
                )
        return sizes

    def _declared(self, header: Mapping[str, Any], present: set[str]) -> dict[str, tuple[Field, str]]:
        """Every array there must be, with what its own sizes are marked by."""
        found = {name: (field, "") for name, field in self.fields.items()}
        for group in self.optional:
            if present & {*group}:
                found |= {name: (field, "") for name, field in group.items()}
        for part, (number, fields) in self.parts.items():
            if number(header) > len(present):
                raise InvalidInputError(f"the header tells of {number(header)} of '{part}', more than there are arrays")
            for k in range(number(header)):
                found |= {f"{part}{k}_{name}": (field, f"{part}{k}") for name, field in fields.items()}
        return found


class Choice(NamedTuple):
    """One of some values in a header."""

    of: tuple[Any, ...]


def fits(value: Any, kind: Any) -> bool:
    """Whether a field of a header is of a type.

    ``str``, ``bool``, ``int`` (a count), ``float`` (finite), a `Choice`; ``[kind]`` is a list of such, ``(kind, kind)``
    a list of so many, ``{name: kind}`` an object of these fields.
    """
    if isinstance(kind, Choice):
        return any(type(value) is type(each) and value == each for each in kind.of)
    if isinstance(kind, list):
        return isinstance(value, list) and all(fits(each, kind[0]) for each in value)
    if isinstance(kind, tuple):
        return isinstance(value, list) and len(value) == len(kind) and all(map(fits, value, kind))
    if isinstance(kind, Mapping):
        return isinstance(value, dict) and {*value} == {*kind} and all(fits(value[name], kind[name]) for name in kind)
    if kind is int:
        return type(value) is int and 0 <= value < _COUNTS
    if kind is float:
        return type(value) in (int, float) and abs(value) < np.inf
    return type(value) is kind


def _refuse_names(found: set[str], declared: set[str], where: str) -> None:
    if missing := sorted(declared - found):
        raise InvalidInputError(f"{where} lacks {', '.join(missing)!r:.80}")
    if unknown := sorted(found - declared):
        raise InvalidInputError(f"{where} has {', '.join(unknown)!r:.80}, which nothing reads")
