"""Whether what a file says of closures, a region and its cells can be said of any: before anything is formed of it.

A tree of cells that passes halves the region again and again, so that its leaves tile it and every walk down ends.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ccpin.containers import NamedArrays
from ccpin.covering.cells import CellStatus
from ccpin.description.joint_kinds import JOINT_KINDS
from ccpin.errors import InvalidInputError
from ccpin.proof.cell_tree import WHOLE, tree_of
from ccpin.proof.facts import NotProvedError
from ccpin.proof.rounding import TURN, widened

_LARGEST = 1e9  # m or rad: of no mechanism; squares of it are far from overflowing
_MODERATE = ("tip", "translations", "weights", "rotations", "axes")
_UNIT = 1e-9  # how far axes may be from unit length, rotations from orthogonal


def checked_closures(header: Mapping[str, Any], arrays: NamedArrays) -> None:
    """Coordinates are divided into q and y, joints and rods share them in their order, chains are chains.

    Raises:
        InvalidInputError: Not so; the field is named.
    """
    size = arrays["system_couplings"].shape[1]
    both = np.concatenate([arrays["system_independent"], arrays["system_dependent"]])
    _require(np.array_equal(np.sort(both), np.arange(size)), "system_independent and system_dependent overlap")
    _require(len(header["names"]) == len(arrays["system_independent"]), "'names' are not as many as coordinates")
    for k in range(header["chains"]):
        joints = arrays[f"chain{k}_joints"]
        _require(len(np.unique(joints)) == len(joints) > 0, f"chain{k}_joints names a joint twice, or none")
        for name in _MODERATE:
            _require_moderate(arrays, f"chain{k}_{name}")
        turned = arrays[f"chain{k}_rotations"]
        off = np.abs(turned.transpose(0, 2, 1) @ turned - np.eye(3)).max()
        _require(off <= _UNIT, f"chain{k}_rotations are no rotations")
        lengths = np.linalg.norm(arrays[f"chain{k}_axes"], axis=1)
        _require(np.all(np.abs(lengths - 1.0) <= _UNIT), f"chain{k}_axes are not of unit length")
    for name in ("system_couplings", "system_offset", "system_moduli", "lower", "upper"):
        _require_moderate(arrays, name)
    _checked_joints(header, size)
    for k, rod in enumerate(header["rods"]):
        for end in "ab":
            steps = rod[f"steps_{end}"]
            _require(len(steps) == len(arrays[f"rod{k}_axes_{end}"]), f"'rods': steps_{end} are not those of rod{k}")
            _require(all(place < size for _, place in steps), "'rods' name coordinates that are none")


def _checked_joints(header: Mapping[str, Any], size: int) -> None:
    """Joints, then rods, have the coordinates one after the other."""
    places = [0, 0]
    for name, kind, q_start, q_stop, v_start, v_stop in header["joints"]:
        _require(kind in JOINT_KINDS, f"'joints': '{name:.40}' is of no kind there is")
        wanted = [places[0] + JOINT_KINDS[kind].nq, places[1] + len(JOINT_KINDS[kind].slides)]
        follows = [q_start, v_start] == places and [q_stop, v_stop] == wanted
        _require(follows, f"'joints': '{name:.40}' does not follow the joint before it")
        places = wanted
    _require(places == [header["nq"], header["n_free"]], "'nq' and 'n_free' are not those of the joints")
    place = header["n_free"]
    for rod in header["rods"]:
        _require(rod["place"][0] == place and rod["place"][1] - place in (1, 2), "'rods' do not follow one another")
        _require(0.0 < rod["length"] <= _LARGEST, "'rods' hold a length that is none")
        place = rod["place"][1]
    _require(place <= size, "'joints' and 'rods' have more coordinates than there are")


def checked_region(arrays: NamedArrays) -> None:
    """The region is a box, and what closes on itself is a full turn of a periodic coordinate.

    Raises:
        InvalidInputError: Not so; the field is named.
    """
    lower, upper = arrays["lower"], arrays["upper"]
    _require(bool(np.all(lower <= upper)) and bool(np.any(lower < upper)), "lower and upper are no region")
    turns = arrays["system_periodic"][arrays["system_independent"]] & (upper == lower + TURN)
    _require(not np.any(arrays["wrapped"] & ~turns), "wrapped: a coordinate closes on itself that has no full turn")


def checked_cells(arrays: NamedArrays) -> None:
    """The cells are the region, halved again and again: children behind their parents, each of one, half of it.

    Raises:
        InvalidInputError: Not so; the field is named.
    """
    lower, size, cut, child, status = (arrays[f"tree_{name}"] for name in ("lower", "size", "cut", "child", "status"))
    split = np.flatnonzero(child >= 0)
    try:
        tree = tree_of(cut, child, lower.shape[1])
    except NotProvedError as error:
        raise InvalidInputError(f"tree_child: no tree of cells: {error}") from error
    _require(np.all(child[split] > split) and np.all(tree.reached), "tree_child: no tree of cells")
    same = np.array_equal(tree.lower, lower) and np.array_equal(tree.size, size)
    _require(same, "tree_lower, tree_size: cells are no halves of the cells they are in")
    _require(np.array_equal(status == CellStatus.SPLIT, child >= 0), "tree_status: what is split has children")


def checked_boxes(arrays: NamedArrays) -> None:
    """D moves q as δ does, and the box of each certified cell, as wide as Theorem N has it, covers the cell.

    Raises:
        InvalidInputError: Not so; the field is named.
    """
    centre, half = (arrays[f"box_{name}"] for name in ("centre", "half"))
    independent = arrays["system_independent"]
    same = np.all(arrays["box_directions"][:, independent] == np.eye(half.shape[1]))
    _require(bool(same), "box_directions: D is not I for the independent coordinates")
    if "members_cell" in arrays:
        cell, box = arrays["members_cell"], arrays["members_box"]
    else:
        cell = np.flatnonzero(arrays["tree_status"] == CellStatus.CERTIFIED)
        box = arrays["tree_box"][cell]
        _require(np.all(np.delete(arrays["tree_box"], cell) == -1), "tree_box: a cell that is not certified has a box")
    _require(np.array_equal(np.sort(box), np.arange(len(half))), "boxes: certified cells have not one box each")
    start = arrays["lower"]
    width = arrays["upper"] - start
    low = start + width * (arrays["tree_lower"][cell] / WHOLE)
    high = low + width * (arrays["tree_size"][cell] / WHOLE)
    middle, reach = centre[box][:, independent], half[box]
    reach = 2.0 * widened(middle, reach) - reach  # room for the roundings of corners here; the auditor has none
    covered = np.all((middle - reach <= low) & (high <= middle + reach))
    _require(bool(covered), "box_centre, box_half: a box does not cover its cell")


def _require(holds: bool | np.bool_, fault: str) -> None:
    if not holds:
        raise InvalidInputError(fault)


def _require_moderate(arrays: NamedArrays, name: str) -> None:
    _require(np.all(np.abs(arrays[name]) <= _LARGEST), f"{name} holds numbers beyond {_LARGEST:g}")
