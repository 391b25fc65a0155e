"""Damage to documents: files of named arrays, npz or JSON, spoilt in every way that does not take a forger."""

import io
import json
import zipfile

import numpy as np

VALUES = (np.nan, np.inf, -1, 0, 1, 2**62, 1e300, -1e300, 1e-300, 0.5)
DTYPES = ("float32", "int32", "uint64", "complex128", "bool", "S3", "U2", ">f8", "float64", "int64")
HEADERS = (None, -1, 2**70, 1.5, "", "x" * 99, True, [], {}, [[]], 1e308, ["a", "a"])


def parts_of(data):
    """The arrays of a document's bytes, its header among them."""
    if data[:2] == b"PK":
        with np.load(io.BytesIO(data)) as stored:
            return json.loads(stored["header"].tobytes()), {n: stored[n] for n in stored.files if n != "header"}
    header = json.loads(data)
    listed = header.pop("arrays")
    return header, {n: np.array(a["data"], dtype=a["dtype"]).reshape(a["shape"]) for n, a in listed.items()}


def bytes_of(header, arrays, as_json):
    """A document's bytes of its parts, also where these are none."""
    if as_json:
        listed = {n: {"dtype": str(a.dtype), "shape": list(a.shape), "data": _plain(a)} for n, a in arrays.items()}
        return json.dumps({**header, "arrays": listed}).encode()
    stream = io.BytesIO()
    np.savez(stream, header=np.frombuffer(json.dumps(header).encode(), dtype=np.uint8), **arrays)
    return stream.getvalue()


def damaged(data, rng):
    """The bytes of a document damaged, and how."""
    how = HOW[rng.integers(len(HOW))]
    return how(data, rng), how.__name__.strip("_")


def altered(data, rng, stamp):
    """The bytes of a document with one field changed and stamped as if it had been so, and how."""
    how = CHANGES[rng.integers(len(CHANGES))]
    header, arrays = parts_of(data)
    names = sorted(arrays)
    how(header, arrays, names[rng.integers(len(names))], rng)
    stamp(header, arrays)
    return bytes_of(header, arrays, data[:2] != b"PK"), how.__name__.strip("_")


def _plain(array):
    found = array.ravel()
    return [str(x) for x in found] if array.dtype.kind in "SUcO" else found.tolist()


def _flip(data, rng):
    spoilt = bytearray(data)
    for _ in range(rng.integers(1, 4)):
        spoilt[rng.integers(len(spoilt))] ^= 1 << rng.integers(8)
    return bytes(spoilt)


def _truncate(data, rng):
    return data[: rng.integers(len(data))]


def _tear(data, rng):
    first = rng.integers(len(data))
    return data[:first] + data[first + rng.integers(1, 200) :]


def _overwrite(data, rng):
    first, junk = rng.integers(len(data)), rng.bytes(rng.integers(1, 40))
    return data[:first] + junk + data[first + len(junk) :]


def _with(change):
    def how(data, rng):
        header, arrays = parts_of(data)
        names = sorted(arrays)
        change(header, arrays, names[rng.integers(len(names))], rng)
        return bytes_of(header, arrays, data[:2] != b"PK")

    how.__name__ = change.__name__
    return how


def _drop(header, arrays, name, rng):
    del arrays[name]


def _add(header, arrays, name, rng):
    arrays[f"{name}_too"] = arrays[name]


def _rename(header, arrays, name, rng):
    arrays[f"{name[:-1]}"] = arrays.pop(name)


def _swap(header, arrays, name, rng):
    other = sorted(arrays)[rng.integers(len(arrays))]
    arrays[name], arrays[other] = arrays[other], arrays[name]


def _dtype(header, arrays, name, rng):
    with np.errstate(all="ignore"):
        arrays[name] = arrays[name].astype(DTYPES[rng.integers(len(DTYPES))])


def _shape(header, arrays, name, rng):
    array = arrays[name]
    shapes = (
        array[None],
        array.ravel(),
        np.atleast_1d(array)[:-1],
        array.T,
        np.repeat(np.atleast_1d(array), 2, axis=0),
    )
    arrays[name] = shapes[rng.integers(len(shapes))]


def _value(header, arrays, name, rng):
    array = arrays[name].copy()
    with np.errstate(all="ignore"):
        if array.size:
            array.reshape(-1)[rng.integers(array.size)] = np.array(VALUES[rng.integers(len(VALUES))]).astype(
                array.dtype
            )
    arrays[name] = array


def _header(header, arrays, name, rng):
    keys = sorted(header)
    header[keys[rng.integers(len(keys))]] = HEADERS[rng.integers(len(HEADERS))]


def _unsaid(header, arrays, name, rng):
    keys = sorted(header)
    del header[keys[rng.integers(len(keys))]]


def _deep(header, arrays, name, rng):
    keys = sorted(header)
    value = 1
    for _ in range(500):
        value = [value]
    header[keys[rng.integers(len(keys))]] = value


def _compress(data, rng):
    if data[:2] != b"PK":
        return b"[" * 200_000
    stream = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as new:
        for member in old.infolist():
            new.writestr(member.filename, old.read(member))
    return stream.getvalue()


def _twice(data, rng):
    return data + data if data[:2] != b"PK" else data[: len(data) // 2] + data


CHANGES = (_drop, _add, _rename, _swap, _dtype, _shape, _value, _value, _header, _header, _unsaid, _deep)
HOW = (_flip, _flip, _truncate, _tear, _overwrite, _compress, _twice, *map(_with, CHANGES))
