"""Documents as files: a JSON header and named arrays, written whole, read in memory that the file's size bounds.

An ``.npz`` file is a zip archive of ``.npy`` members that are stored, not compressed: what it holds is no more than
what it is. A ``.json`` file lists for each array its dtype, its shape and its numbers. Nothing is unpickled. Names,
dtypes and shapes are compared with what is declared of them (`ccpin.schemas`) before numbers are read. The header has a
checksum of all there is: it tells damage, not forgery.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccpin.errors import CcpinError, InvalidInputError
from ccpin.files import write_atomically, write_text

NamedArrays = dict[str, NDArray[Any]]
_DTYPES = ("float64", "int64", "int8", "bool", "uint8")
_HEADER, CHECKSUM = "header", "checksum"
_IN_JSON: dict[str, set[type]] = {"f": {float, int}, "i": {int}, "u": {int}, "b": {bool}}
_UNREADABLE = (
    *(OSError, ValueError, LookupError, TypeError, EOFError, RuntimeError, ArithmeticError),
    *(MemoryError, SyntaxError, zipfile.BadZipFile, zlib.error),
)


class ArrayOutline(NamedTuple):
    """What an array says of itself before its numbers are read."""

    dtype: np.dtype[Any]
    shape: tuple[int, ...]


Check = Callable[[dict[str, Any], dict[str, ArrayOutline]], None]
"""Told the header and the outlines of all arrays before any number is read; raises where they are not as declared."""


def write(path: str | Path, header: Mapping[str, Any], arrays: Mapping[str, Any]) -> None:
    """Write a document, whole or not at all: JSON where its name ends in ``.json``, npz otherwise.

    Raises:
        InvalidInputError: It cannot be written.
    """
    if Path(path).suffix == ".json":
        text = _as_json(_stamped(header, arrays), arrays)
        write_text(path, text)
    else:
        write_atomically(path, "wb", lambda file: write_npz(file, header, arrays))


def write_npz(file: IO[bytes], header: Mapping[str, Any], arrays: Mapping[str, Any]) -> None:
    """Write a document to an open file, as npz."""
    text = json.dumps(_stamped(header, arrays), allow_nan=False).encode()
    np.savez(file, header=np.frombuffer(text, dtype=np.uint8), **arrays)


def read(path: str | Path, check: Check) -> tuple[dict[str, Any], NamedArrays]:
    """The header and the arrays of a file.

    Raises:
        InvalidInputError: It cannot be read, or `check` refuses it; the file and the array are named.
    """
    with told_of(path):
        if not isinstance(path, str | Path):
            raise InvalidInputError("a file to read must be a path")
        if Path(path).suffix == ".json":
            return _undamaged(*_of_json(Path(path).read_bytes(), check))
        with Path(path).open("rb") as file:
            return read_npz(file, check)


def read_npz(file: IO[bytes], check: Check) -> tuple[dict[str, Any], NamedArrays]:
    """The header and the arrays of an open file, as npz."""
    with zipfile.ZipFile(file) as archive:
        members = _members(archive, file.seek(0, io.SEEK_END))
        outlines = {name: _outline(archive, member) for name, member in members.items()}
        if outlines.get(_HEADER, ArrayOutline(np.dtype(float), ())).dtype != np.uint8:
            raise InvalidInputError("it has no header: it is none of ccpin's documents, or older than they are")
        header = _parsed(_numbers(archive, members.pop(_HEADER)).tobytes())
        outlines.pop(_HEADER)
        check(header, outlines)
        numbers = {name: _numbers(archive, members[name]) for name in outlines}  # `check` may want fewer
    return _undamaged(header, numbers)


def plain_arrays(path: str | Path) -> NamedArrays:
    """The arrays of an npz file that ccpin keeps for itself, by name: no document, so nothing of them is declared.

    Raises:
        InvalidInputError: It cannot be read.
    """
    with told_of(path), np.load(path, allow_pickle=False) as stored:
        return {name: stored[name] for name in stored.files}


def format_of(path: str | Path) -> Any:
    """The format that a file's header states; ``None`` where it states none.

    Raises:
        InvalidInputError: It cannot be read.
    """
    found: list[Any] = []

    def look(header: dict[str, Any], outlines: dict[str, ArrayOutline]) -> None:
        found.append(header.get("format"))
        outlines.clear()  # no number is read
        header[CHECKSUM] = checksum(header, {})

    read(path, look)
    return found[0]


def checksum(header: Mapping[str, Any], arrays: Mapping[str, Any]) -> str:
    """SHA-256 of a header, its own checksum apart, and of every bit of all arrays."""
    rest = {name: value for name, value in header.items() if name != CHECKSUM}
    digest = hashlib.sha256(json.dumps(rest, sort_keys=True).encode())
    for name in sorted(arrays):
        array = np.asarray(arrays[name])
        digest.update(f"{name}{array.dtype}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _stamped(header: Mapping[str, Any], arrays: Mapping[str, Any]) -> dict[str, Any]:
    return {**header, CHECKSUM: checksum(header, arrays)}


def _undamaged(header: dict[str, Any], arrays: NamedArrays) -> tuple[dict[str, Any], NamedArrays]:
    """The same, if its checksum is that of what it holds.

    Raises:
        InvalidInputError: It is not.
    """
    if header[CHECKSUM] != checksum(header, arrays):
        raise InvalidInputError(f"its {CHECKSUM} is not that of what it holds: the file was damaged or altered")
    return header, arrays


@contextmanager
def told_of(path: object) -> Iterator[None]:
    """Whatever is wrong within is told of a file, which is a regular one: nobody waits for a pipe.

    Raises:
        InvalidInputError: Something is.
    """
    try:
        if isinstance(path, str | Path) and Path(path).exists() and not Path(path).is_file():
            raise InvalidInputError("it is no regular file (a folder, a device or a pipe, perhaps)")
        yield
    except CcpinError as error:
        raise InvalidInputError(f"{path}: {error}") from error
    except _UNREADABLE as error:
        raise InvalidInputError(f"{path}: cannot be read ({error!s:.200} {type(error).__name__})") from error


def _members(archive: zipfile.ZipFile, size: int) -> dict[str, zipfile.ZipInfo]:
    """The members of an archive by name; together they are no larger than the file."""
    found: dict[str, zipfile.ZipInfo] = {}
    for member in archive.infolist():
        name = member.filename.removesuffix(".npy")
        if name == member.filename or name in found:
            raise InvalidInputError(f"{name!r:.60} stands in the file twice, or is no array")
        if member.flag_bits & 0x1:
            raise InvalidInputError(f"{name!r:.60} is encrypted")
        if member.compress_type != zipfile.ZIP_STORED:
            raise InvalidInputError(f"{name!r:.60} is compressed: an older format, or none of ccpin's")
        size -= member.file_size
        if size < 0:
            raise InvalidInputError(f"{name!r:.60} and those before say that they hold more than the file does")
        found[name] = member
    return found


def _outline(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> ArrayOutline:
    """A member's dtype and shape, which must take up exactly the bytes that follow them."""
    with archive.open(member) as stream:
        dtype, shape = _npy_header(stream, member.filename)[:2]
        if math.prod(shape) * dtype.itemsize != member.file_size - stream.tell():
            raise InvalidInputError(f"{member.filename}: the shape {shape!s:.60} is not that of its bytes")
    return ArrayOutline(dtype, shape)


def _npy_header(stream: IO[bytes], name: str) -> tuple[np.dtype[Any], tuple[int, ...], bool]:
    if np.lib.format.read_magic(stream) != (1, 0):
        raise InvalidInputError(f"{name}: the version of .npy is not 1.0")
    shape, fortran, dtype = np.lib.format.read_array_header_1_0(stream)
    if dtype.name not in _DTYPES or not dtype.isnative:
        raise InvalidInputError(f"{name}: the dtype is {dtype!s:.40}, none of {', '.join(_DTYPES)}")
    if any(size < 0 for size in shape):
        raise InvalidInputError(f"{name}: the shape is {shape!s:.60}")
    return dtype, shape, fortran


def _numbers(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> NDArray[Any]:
    stream = io.BytesIO(archive.read(member))
    dtype, shape, fortran = _npy_header(stream, member.filename)
    found = np.frombuffer(stream.read(), dtype=dtype)
    if dtype == np.bool_ and np.any(found.view(np.uint8) > 1):
        raise InvalidInputError(f"{member.filename}: truth values are 0 or 1")
    return np.array(found.reshape(shape, order="F" if fortran else "C"), order="C")


def _as_json(header: Mapping[str, Any], arrays: Mapping[str, Any]) -> str:
    listed = {
        name: {"dtype": str(array.dtype), "shape": array.shape, "data": array.ravel().tolist()}
        for name, array in ((name, np.asarray(array)) for name, array in arrays.items())
    }
    return json.dumps({**header, "arrays": listed}, allow_nan=False)


def _of_json(text: bytes, check: Check) -> tuple[dict[str, Any], NamedArrays]:
    header = _parsed(text)
    listed = header.pop("arrays", None)
    if not isinstance(listed, dict):
        raise InvalidInputError("'arrays' is no table of arrays")
    outlines = {name: _listed_outline(entry, name) for name, entry in listed.items()}
    check(header, outlines)
    arrays: NamedArrays = {}
    for name, (dtype, shape) in outlines.items():
        data = listed[name]["data"]
        if not {*map(type, data)} <= _IN_JSON[dtype.kind]:
            raise InvalidInputError(f"{name}: the data are no numbers of dtype {dtype}")
        arrays[name] = np.array(data, dtype=dtype).reshape(shape)
    return header, arrays


def _listed_outline(entry: Any, name: str) -> ArrayOutline:
    """The dtype and shape of an array as JSON lists it, with as many numbers as they say."""
    if not isinstance(entry, dict) or {*entry} != {"dtype", "shape", "data"}:
        raise InvalidInputError(f"{name:.60} is no array: it needs a dtype, a shape and data, and nothing else")
    dtype, shape, data = entry["dtype"], entry["shape"], entry["data"]
    if dtype not in _DTYPES:
        raise InvalidInputError(f"{name:.60}: the dtype is {dtype!r:.40}, none of {', '.join(_DTYPES)}")
    if not isinstance(shape, list) or not all(type(size) is int and size >= 0 for size in shape):
        raise InvalidInputError(f"{name:.60}: the shape is no list of sizes")
    if not isinstance(data, list) or math.prod(shape) != len(data):
        raise InvalidInputError(f"{name:.60}: the data are not as many numbers as the shape {shape!s:.40} says")
    return ArrayOutline(np.dtype(dtype), tuple(shape))


def _parsed(text: bytes) -> dict[str, Any]:
    """A JSON object: each name once, numbers that are numbers, no deeper than Python reads."""

    def refuse(constant: str) -> None:
        raise InvalidInputError(f"it holds {constant}, which is no number")

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) != len(pairs):
            raise InvalidInputError("a name stands twice in one object")
        return found

    try:
        header = json.loads(text.decode("utf-8"), parse_constant=refuse, object_pairs_hook=once)
    except RecursionError:
        raise InvalidInputError("the JSON is nested too deeply") from None
    if not isinstance(header, dict):
        raise InvalidInputError("the JSON is no object")
    return header
