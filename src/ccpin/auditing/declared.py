"""What the arrays and the header of each kind of document are called, hold and are shaped like.

An array is declared by the kind of its numbers (``f`` float64, ``i`` integers, ``b`` truth values) and its shape, in
numbers or letters; a letter stands for one size throughout a document. m is how many coordinates depend, n how many are
independent, p all of them. Whatever is not declared is refused: nothing is in a document that nobody looked at.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ccpin.auditing.container import Arrays
from ccpin.errors import InvalidInputError

ATLAS, SHEETS, CURVES = "ccpin-atlas-5", "ccpin-sheets-2", "ccpin-curves-2"
_INTEGERS = 2**62  # no count is as large; int64 holds it

_SYSTEM = {
    "system_couplings": "f m p",
    "system_offset": "f m",
    "system_moduli": "f m",
    "system_independent": "i n",
    "system_dependent": "i m",
    "system_periodic": "b p",
    "lower": "f n",
    "upper": "f n",
    "wrapped": "b n",
}
_CHAIN = {
    "joints": "i k",
    "rotations": "f k 3 3",
    "translations": "f k 3",
    "axes": "f k 3",
    "prismatic": "b k",
    "tip": "f 3",
    "direction": "b",
    "weights": "f m 3",
}
_JOINT = {"reference": "f 3 3"}
_ROD = {
    "reference": "f 3 3",
    "frame_a": "f 4 4",
    "frame_b": "f 4 4",
    "placements_a": "f a 4 4",
    "axes_a": "f a 3",
    "placements_b": "f b 4 4",
    "axes_b": "f b 3",
}
_DEMANDS = {
    "demand_lower": "f p",
    "demand_upper": "f p",
    "demand_driven": "i d",
    "demand_units": "f n",
    "demand_dexterity": "f",
}
_CELLS = {
    "box_centre": "f B p",
    "box_half": "f B n",
    "box_directions": "f B p n",
    "box_modes": "f B m m",
    "box_preconditioner": "f B m m",
    "box_radius": "f B m",
    "box_weight": "f B m",
    "box_kappa": "f B",
    "tree_lower": "i N n",
    "tree_size": "i N n",
    "tree_cut": "i N",
    "tree_child": "i N",
    "tree_status": "i N",
    "tree_box": "i N",
    "singular_cell": "i S",
    "singular_theta": "f S p",
}
_OF = {
    ATLAS: _CELLS | {"q0": "f n", "seed": "f p", "unglued": "i U 2"},
    SHEETS: _CELLS
    | {
        "members_cell": "i M",
        "members_box": "i M",
        "glued_first": "i G",
        "glued_second": "i G",
        "glued_at_first": "f G n",
        "glued_at_second": "f G n",
        "left_cell": "i L",
        "left_centre": "f L p",
        "left_half": "f L p",
        "left_slopes": "f L m n",
        "ranges_lower": "f m",
        "ranges_upper": "f m",
        "ranges_reasons": "i m 2",
        "ranges_limits": "f m 2",
        "count": "i N",
    },
    CURVES: {
        "tube_theta": "f T p",
        "tube_kernel": "f T m",
        "tube_pairing": "f T m",
        "tube_along": "i T",
        "tube_tangent": "f T x",
        "tube_half": "f T",
        "tube_radius": "f T x",
        "range_lower": "f m",
        "range_upper": "f m",
        "range_reasons": "i m 2",
        "range_limits": "f m 2",
        "uncovered_lower": "f V p",
        "uncovered_upper": "f V p",
        "curve_tubes": "i C",
        "curve_closed": "b C",
    },
}

Check = Callable[[Any], bool]


def _number(value: Any) -> bool:
    return type(value) in (int, float) and abs(value) < np.inf


def _count(value: Any) -> bool:
    return type(value) is int and 0 <= value < _INTEGERS


def _text(value: Any) -> bool:
    return isinstance(value, str)


def _flag(value: Any) -> bool:
    return isinstance(value, bool)


def _names(value: Any) -> bool:
    return isinstance(value, list) and all(map(_text, value)) and len({*value}) == len(value)


def _steps(value: Any) -> bool:
    return isinstance(value, list) and all(
        isinstance(step, list) and len(step) == 2 and _flag(step[0]) and _count(step[1]) for step in value
    )


def _rods(value: Any) -> bool:
    return isinstance(value, list) and all(
        isinstance(rod, dict)
        and {*rod} == {"place", "length", "steps_a", "steps_b"}
        and isinstance(rod["place"], list)
        and len(rod["place"]) == 2
        and all(map(_count, rod["place"]))
        and _number(rod["length"])
        and _steps(rod["steps_a"])
        and _steps(rod["steps_b"])
        for rod in value
    )


def _joints(value: Any) -> bool:
    return isinstance(value, list) and all(
        isinstance(joint, list) and len(joint) == 6 and all(map(_text, joint[:2])) and all(map(_count, joint[2:]))
        for joint in value
    )


_HEADER: dict[str, Check] = {
    "format": _text,
    "theorem": _text,
    "fingerprint": _text,
    "checksum": _text,  # tells damage, which no proof rests on
    "rods": _rods,
    "chains": _count,
    "nq": _count,
    "n_free": _count,
    "joints": _joints,
    "planar": _flag,
    "names": _names,
}
_HEADER_OF: dict[str, dict[str, Check]] = {
    ATLAS: {"radius": _number, "complete": _flag},
    SHEETS: {"complete": _flag},
    CURVES: {
        "tried": _count,
        "limit": lambda value: value is None or value in ("interrupted", "budget"),
        "resolution": lambda value: _number(value) and value > 0,
    },
}


def refuse_others(header: dict[str, Any], arrays: Arrays, path: object) -> None:
    """Refuse a header or arrays that are not those declared for their format.

    Raises:
        InvalidInputError: They are not; the file and the field are named.
    """
    kind = header.get("format")
    if not _text(kind) or kind not in _OF:
        raise InvalidInputError(f"{path}: the format is {kind!r:.60}, not {ATLAS!r}, {SHEETS!r} or {CURVES!r}")
    checks = _HEADER | _HEADER_OF[kind]
    _refuse_names({*header}, {*checks}, f"{path}: the header")
    for name, check in checks.items():
        if not check(header[name]):
            raise InvalidInputError(f"{path}: '{name}' in the header is {header[name]!r:.60}, which it cannot be")
    parts = [("chain", header["chains"], _CHAIN), ("joint", len(header["joints"]), _JOINT)]
    parts.append(("rod", len(header["rods"]), _ROD))
    if sum(count for _, count, _ in parts) > len(arrays):
        raise InvalidInputError(f"{path}: there are not as many chains, joints and rods as the header says")
    declared = dict(_arrays(str(kind), parts, arrays))
    _refuse_names({*arrays}, {*declared}, f"{path}: the document")
    sizes: dict[str, int] = {}
    for name, (form, scope) in declared.items():
        _refuse_array(arrays[name], form, sizes, scope, f"{path}: {name}")
    _refuse_sizes(str(kind), sizes, path)


def _arrays(
    kind: str, parts: list[tuple[str, int, dict[str, str]]], arrays: Arrays
) -> Iterator[tuple[str, tuple[str, str]]]:
    """The names declared, each with its form and with what its own letters belong to."""
    demands = _DEMANDS if kind == ATLAS and any(name.startswith("demand_") for name in arrays) else {}
    for name, form in (_SYSTEM | _OF[kind] | demands).items():
        yield name, (form, "")
    for part, count, fields in parts:
        for k in range(count):
            for name, form in fields.items():
                yield f"{part}{k}_{name}", (form, f"{part}{k}")


def _refuse_names(found: set[str], declared: set[str], what: str) -> None:
    for name in sorted(declared - found):
        raise InvalidInputError(f"{what} lacks '{name}'")
    for name in sorted(found - declared):
        raise InvalidInputError(f"{what} holds {name!r:.60}, which is nothing that is known of this format")


def _refuse_array(array: np.ndarray[Any, Any], form: str, sizes: dict[str, int], scope: str, where: str) -> None:
    kind, *wanted = form.split()
    if array.dtype.kind != kind:
        raise InvalidInputError(f"{where}: the dtype is {array.dtype}, which its numbers cannot have")
    if array.ndim != len(wanted):
        raise InvalidInputError(f"{where}: the shape is {array.shape}, not ({', '.join(wanted)})")
    for size, letter in zip(array.shape, wanted, strict=True):
        known = letter if letter.isdigit() or letter in "mnp" else scope + letter
        expected = int(letter) if letter.isdigit() else sizes.setdefault(known, size)
        if size != expected:
            raise InvalidInputError(f"{where}: the shape is {array.shape}, with {size} for {expected}")


def _refuse_sizes(kind: str, sizes: dict[str, int], path: object) -> None:
    m, n, p = sizes["m"], sizes["n"], sizes["p"]
    if not (m >= 1 and n >= 1 and p == m + n):
        raise InvalidInputError(f"{path}: of {p} coordinates {n} are independent and {m} dependent")
    if kind == CURVES and sizes["x"] != p + m:
        raise InvalidInputError(f"{path}: tubes are not of the {p + m} numbers (θ, w)")
