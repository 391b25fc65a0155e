"""A certificate's file as a JSON header and named arrays, read in time and memory that its own size bounds.

An npz file is a zip archive of .npy members that are stored, not compressed, as `numpy.savez` writes them: what it
holds is no more than what it is. Of each member the header is read before any number is, and its shape must take up
exactly the bytes that follow. A JSON file lists for each array its dtype, its shape and its numbers. Numbers are
finite; no other dtypes than those of `DTYPES` are read, and nothing is unpickled.
"""

from __future__ import annotations

import io
import json
import math
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ccpin.errors import InvalidInputError

Arrays = dict[str, NDArray[Any]]
DTYPES = ("float64", "int64", "int8", "bool", "uint8")
_HEADER = "header"
_READ: dict[str, tuple[type, ...]] = {"f": (float, int), "i": (int,), "u": (int,), "b": (bool,)}


def contents(path: Path) -> tuple[dict[str, Any], Arrays]:
    """The header and the arrays of a file: JSON where its name ends in ``.json``, npz otherwise.

    Raises:
        InvalidInputError: It cannot be read, or holds something else; the file and the array are named.
    """
    if path.exists() and not path.is_file():
        raise InvalidInputError(f"{path}: no regular file (a folder, a device or a pipe, perhaps)")
    try:
        header, arrays = _of_json(path) if path.suffix == ".json" else _of_npz(path)
    except InvalidInputError:
        raise
    except (OSError, ValueError, KeyError, TypeError, EOFError, RuntimeError, MemoryError) as error:
        raise InvalidInputError(f"{path}: not a readable certificate ({error or type(error).__name__})") from error
    except (zipfile.BadZipFile, SyntaxError, OverflowError) as error:
        raise InvalidInputError(f"{path}: not a readable certificate ({error})") from error
    for name, array in arrays.items():
        if not np.all(np.isfinite(array)):
            raise InvalidInputError(f"{path}: {name} holds numbers that are not finite")
    return header, arrays


def _of_json(path: Path) -> tuple[dict[str, Any], Arrays]:
    header = _parsed(path.read_bytes(), path)
    listed = header.pop("arrays", None)
    if not isinstance(listed, dict):
        raise InvalidInputError(f"{path}: 'arrays' is no table of arrays")
    return header, {name: _listed(entry, f"{path}: {name}") for name, entry in listed.items()}


def _parsed(text: bytes, path: Path) -> dict[str, Any]:
    """A JSON object; infinite numbers and NaN are none.

    Raises:
        InvalidInputError: It is none.
    """

    def refuse(constant: str) -> None:
        raise InvalidInputError(f"{path}: the header holds {constant}, which is no number")

    try:
        header = json.loads(text.decode("utf-8"), parse_constant=refuse)
    except RecursionError:
        raise InvalidInputError(f"{path}: the header is nested too deeply") from None
    if not isinstance(header, dict):
        raise InvalidInputError(f"{path}: the header is no JSON object")
    return header


def _listed(entry: Any, where: str) -> NDArray[Any]:
    """An array as JSON lists it."""
    if not isinstance(entry, dict) or {*entry} != {"dtype", "shape", "data"}:
        raise InvalidInputError(f"{where} is no array: it needs a dtype, a shape and data, and nothing else")
    dtype, shape, data = entry["dtype"], entry["shape"], entry["data"]
    if dtype not in DTYPES:
        raise InvalidInputError(f"{where}: the dtype is {dtype!r:.40}, none of {', '.join(DTYPES)}")
    if not isinstance(shape, list) or not all(type(size) is int and size >= 0 for size in shape):
        raise InvalidInputError(f"{where}: the shape is no list of sizes")
    if not isinstance(data, list) or math.prod(shape) != len(data):
        raise InvalidInputError(f"{where}: the data are not as many numbers as the shape {shape!s:.40} says")
    kind = np.dtype(dtype).kind
    if not {*map(type, data)} <= {*_READ[kind]}:
        raise InvalidInputError(f"{where}: the data are no numbers of dtype {dtype}")
    try:
        return np.array(data, dtype=dtype).reshape(shape)
    except (OverflowError, ValueError) as error:
        raise InvalidInputError(f"{where}: {error}") from error


def _of_npz(path: Path) -> tuple[dict[str, Any], Arrays]:
    arrays = Arrays()
    with zipfile.ZipFile(path) as archive:
        members, size = archive.infolist(), path.stat().st_size
        for member in members:
            name = member.filename.removesuffix(".npy")
            where = f"{path}: {name!r:.60}"
            if member.flag_bits & 0x1 or member.compress_type != zipfile.ZIP_STORED:
                raise InvalidInputError(f"{where} is encrypted or compressed; certificates are written as plain arrays")
            if name in arrays or name == member.filename:
                raise InvalidInputError(f"{where} stands in the file twice, or is no .npy member")
            size -= member.file_size
            if size < 0:
                raise InvalidInputError(f"{where} and those before say that they hold more than the file does")
            arrays[name] = _of_npy(archive.read(member), where)
    if _HEADER not in arrays or arrays[_HEADER].dtype != np.uint8:
        raise InvalidInputError(f"{path}: there is no header of bytes")
    return _parsed(arrays.pop(_HEADER).tobytes(), path), arrays


def _of_npy(data: bytes, where: str) -> NDArray[Any]:
    """An array as .npy bytes hold it: the header first, then exactly as many bytes as that says."""
    stream = io.BytesIO(data)
    try:
        version = np.lib.format.read_magic(stream)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, fortran, dtype = read(stream)
    except (ValueError, SyntaxError, TypeError, RecursionError, MemoryError, OverflowError) as error:
        raise InvalidInputError(
            f"{where}: no array that can be read ({error or type(error).__name__!s:.200})"
        ) from error
    if dtype.name not in DTYPES or not dtype.isnative:
        raise InvalidInputError(f"{where}: the dtype is {dtype!s:.40}, none of {', '.join(DTYPES)}")
    rest = data[stream.tell() :]
    if any(size < 0 for size in shape) or math.prod(shape) * dtype.itemsize != len(rest):
        raise InvalidInputError(f"{where}: the shape {shape!s:.60} does not take up the {len(rest)} bytes there are")
    found = np.frombuffer(rest, dtype=dtype).reshape(shape, order="F" if fortran else "C")
    if dtype == np.bool_ and np.any(found.view(np.uint8) > 1):
        raise InvalidInputError(f"{where}: truth values are 0 or 1")
    return np.ascontiguousarray(found).reshape(shape)
