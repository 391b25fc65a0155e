"""Digests: what an object is about, told by exact numbers, so that no claim combines objects of two mechanisms.

Each object carries `Digests`, one for each thing that theorems speak of. What a claim uses it compares
(`require_same`): an atlas of the same closures and other masses is good where only φ enters, an arrival certificate of
the same closures under another gravity is not. Two loads of one file, and copies and pickles, have the same digests:
nothing enters but numbers, bit for bit, and names.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any, Literal, NamedTuple

import numpy as np

from ccpin.errors import DifferentSubjectsError

Part = Literal["closures", "dynamics", "plant", "law"]
_WORDS: dict[Part, str] = {
    "closures": "closures or independent coordinates",
    "dynamics": "masses, springs, dampers, gravity or motors",
    "plant": "friction, limits or bounds of efforts",
    "law": "control laws",
}


class Digests(NamedTuple):
    """What an object is about; an empty digest: it says nothing of that.

    Attributes:
        name: What it is called in errors.
        closures: Of φ and of which coordinates are independent.
        dynamics: Of what enters D, C, g and ρᵀSᵀu: inertias, springs, dampers, rotors, gears and gravity.
        plant: Of what a simulation besides reads off the mechanism: dry friction, limits, bounds of efforts.
        law: Of the control law: its kind, its constants and the model it computes with.
    """

    name: str
    closures: str = ""
    dynamics: str = ""
    plant: str = ""
    law: str = ""


class UndigestedError(TypeError):
    """A value that has no digest: a function, say, of which no number tells what it does."""


def digest(value: object) -> str:
    """SHA-256 of numbers, arrays, words, and records and lists of them, bit for bit and with the names of fields.

    An object may say by `digests` what it is about, or by `digested` what there is to it.

    Raises:
        UndigestedError: Something in it is none of these.
    """
    found = hashlib.sha256()
    for piece in _pieces(value):
        found.update(len(piece).to_bytes(8, "little") + piece)
    return found.hexdigest()


def digest_or_none(value: object) -> str:
    """`digest`, or an empty one where there is none."""
    try:
        return digest(value)
    except (UndigestedError, RecursionError):
        return ""


def _pieces(value: Any) -> Iterable[bytes]:
    """A value as byte strings, which tell different values apart."""
    if value is None or isinstance(value, bool | int | str | bytes | Enum):
        yield f"{type(value).__name__}:{value!r}".encode()
    elif isinstance(value, float | np.number | np.ndarray):
        array = np.asarray(value)
        if array.dtype.hasobject:
            raise UndigestedError("an array of objects has no digest")
        yield f"{array.dtype.str}{array.shape}".encode()
        yield (np.ascontiguousarray(array) + 0).tobytes() if array.dtype.kind == "f" else array.tobytes()
    elif isinstance(value, Digests):
        yield repr(tuple(value[1:])).encode()
    elif isinstance(getattr(value, "digests", None), Digests):
        yield from _pieces(value.digests)
    elif hasattr(value, "digested"):
        yield type(value).__name__.encode()
        yield from _pieces(value.digested)
    elif isinstance(value, Mapping):
        yield f"mapping:{len(value)}".encode()
        for key in sorted(value, key=str):
            yield from _pieces(key)
            yield from _pieces(value[key])
    elif isinstance(value, slice):
        yield repr(value).encode()
    elif isinstance(value, tuple | list | set | frozenset):
        items = sorted(value, key=repr) if isinstance(value, set | frozenset) else value
        yield f"{type(value).__name__}:{len(value)}".encode()
        for item in items:
            yield from _pieces(item)
    elif is_dataclass(value) and not isinstance(value, type):
        yield type(value).__name__.encode()
        for field in fields(value):
            yield field.name.encode()
            yield from _pieces(getattr(value, field.name))
    elif not callable(value) or hasattr(value, "__dict__"):
        yield from _of_attributes(value)
    else:
        raise UndigestedError(f"{type(value).__name__} has no digest")


def _of_attributes(value: Any) -> Iterable[bytes]:
    """An object by its class and the attributes that it was given; functions have none that tell what they do."""
    held = getattr(value, "__dict__", None)
    if held is None or isinstance(value, type) or type(value).__module__ in ("builtins", "functools"):
        raise UndigestedError(f"{type(value).__name__} has no digest")
    kind = type(value)
    cached = {name for base in kind.__mro__ for name, it in vars(base).items() if hasattr(it, "attrname")}
    yield f"{kind.__module__}.{kind.__qualname__}".encode()
    yield from _pieces({name: item for name, item in held.items() if name not in cached})


def require_same(task: str, one: Digests, other: Digests, *parts: Part) -> None:
    """Nothing, if two objects are about the same thing in all that a task uses.

    Raises:
        DifferentSubjectsError: They differ, or one of them does not say.
    """
    for part in parts:
        ours, theirs = getattr(one, part), getattr(other, part)
        if ours and theirs and ours == theirs:
            continue
        differ = f"they have different {_WORDS[part]}"
        if not ours or not theirs:
            silent = one if not ours else other
            differ = f"{silent.name} does not say of which {_WORDS[part]} it is"
        raise DifferentSubjectsError(f"{task}: {one.name} and {other.name} do not belong together: {differ}")
