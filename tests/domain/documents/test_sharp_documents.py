"""What a file may say of closures, a region, its cells and boxes, at each condition's end; files hold all there is."""

from copy import deepcopy
from dataclasses import fields
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

import ccpin
from ccpin.covering.cells import CellStatus, CellTree
from ccpin.domain import Atlas, SheetAtlas, SingularCover, certify, certify_sheets, certify_singularities, merging
from ccpin.domain.documents import store
from ccpin.domain.documents.checked import checked_boxes, checked_cells, checked_closures, checked_region
from ccpin.errors import InvalidInputError
from ccpin.proof.cell_tree import WHOLE, tree_of

TURN = 2.0 * np.pi


def closures():
    """A turn, a planar joint and a rod of two angles, in one chain and five rows."""
    header = {
        "names": ["q"],
        "chains": 1,
        "joints": [["a", "revolute", 0, 1, 0, 1], ["b", "planar", 1, 5, 1, 4]],
        "nq": 5,
        "n_free": 4,
        "rods": [{"place": [4, 6], "length": 0.5, "steps_a": [[False, 0]], "steps_b": [[True, 3], [False, 5]]}],
    }
    arrays = {
        "system_couplings": np.zeros((5, 6)),
        "system_offset": np.zeros(5),
        "system_moduli": np.zeros(5),
        "system_independent": np.array([2]),
        "system_dependent": np.array([0, 1, 3, 4, 5]),
        "lower": np.zeros(2),
        "upper": np.ones(2),
        "chain0_joints": np.array([0, 1]),
        "chain0_rotations": np.tile(np.eye(3), (2, 1, 1)),
        "chain0_translations": np.zeros((2, 3)),
        "chain0_axes": np.tile([0.0, 0.0, 1.0], (2, 1)),
        "chain0_tip": np.zeros(3),
        "chain0_weights": np.zeros((5, 3)),
        "rod0_axes_a": np.zeros((1, 3)),
        "rod0_axes_b": np.zeros((2, 3)),
    }
    return header, arrays


def refused(change, told):
    """That closures are refused after a change to their header and arrays (where anything is told)."""
    header, arrays = closures()
    change(header, arrays)
    if told is None:
        checked_closures(header, arrays)
        return
    with pytest.raises(InvalidInputError, match=told):
        checked_closures(header, arrays)


def put(name, index, value):
    """A change of one number of an array."""

    def change(header, arrays):
        arrays[name] = np.array(arrays[name], dtype=float)
        arrays[name][index] = value

    return change


@pytest.mark.parametrize(
    ("share", "good"), [(1 - 1e-3, True), (1 + 1e-3, False), (1.9, False), (-1 + 1e-3, True), (-1.1, False)]
)
@pytest.mark.parametrize(
    ("name", "index"),
    [
        ("chain0_tip", 2), ("chain0_translations", (1, 0)), ("chain0_weights", (4, 1)), ("system_couplings", (0, 5)),
        ("system_offset", 0), ("system_moduli", 4), ("lower", 1), ("upper", 0),
    ],
)  # fmt: skip
def test_numbers_are_moderate(name, index, share, good):
    """Up to 1e9 each."""
    refused(put(name, index, share * 1e9), None if good else f"{name} holds numbers beyond 1e.09")


@pytest.mark.parametrize(("share", "good"), [(0.97, True), (1.03, False), (1.9, False), (-0.97, True), (-1.03, False)])
@pytest.mark.parametrize("row", [0, 1])
def test_axes_are_of_unit_length_and_rotations_are_rotations(row, share, good):
    """To 1e-9, of RᵀR in every entry."""
    refused(put("chain0_axes", (row, 2), 1.0 + share * 1e-9), None if good else "not of unit length")
    refused(put("chain0_rotations", (row, 0, 0), np.sqrt(1.0 + share * 1e-9)), None if good else "no rotations")
    refused(put("chain0_rotations", (row, 0, 1), share * 1e-9), None if good else "no rotations")


def joint(k, place, value):
    return lambda header, arrays: header["joints"][k].__setitem__(place, value)


def rod(name, value):
    return lambda header, arrays: header["rods"][0].__setitem__(name, value)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda header, arrays: None, None),
        (joint(0, 2, 1), "does not follow"), (joint(0, 3, 2), "does not follow"), (joint(0, 4, 1), "does not follow"),
        (joint(0, 5, 2), "does not follow"), (joint(1, 2, 2), "does not follow"), (joint(1, 3, 4), "does not follow"),
        (joint(1, 4, 0), "does not follow"), (joint(1, 5, 5), "does not follow"), (joint(1, 1, "no"), "no kind"),
        (lambda header, arrays: header.update(nq=4), "'nq'"), (lambda header, arrays: header.update(n_free=5), "'nq'"),
        (rod("place", [3, 5]), "follow one another"), (rod("place", [4, 4]), "follow one another"),
        (rod("place", [4, 7]), "follow one another"), (rod("place", [5, 6]), "follow one another"),
        (rod("length", 0.0), "length"), (rod("length", 1.1e9), "length"), (rod("place", [4, 5]), None),
        (rod("steps_b", [[True, 3], [False, 6]]), "that are none"),
        (rod("steps_b", [[True, 9], [False, 5]]), "that are none"),
        (rod("steps_a", [[True, 6]]), "that are none"), (rod("steps_a", []), "steps_a"),
        (lambda header, arrays: header["rods"].append({**header["rods"][0], "place": [6, 8]}), "more coordinates"),
        (lambda header, arrays: header.update(names=["q", "p"]), "'names'"),
        (put("chain0_joints", 1, 0), "twice"), (put("system_dependent", 0, 2), "overlap"),
    ],
)  # fmt: skip
def test_joints_and_rods_have_the_coordinates_in_their_order(change, told):
    refused(change, told)


@pytest.mark.parametrize(
    ("lower", "upper", "periodic", "wrapped", "told"),
    [
        ((0.0, 1.0), (1.0, 2.0), (True, True), (False, False), None),
        ((0.0, 1.0), (0.0, 2.0), (True, True), (False, False), None),
        ((0.0, 1.0), (0.0, 1.0), (True, True), (False, False), "no region"),
        ((2.0, 1.0), (1.0, 2.0), (True, True), (False, False), "no region"),
        ((1.5, 1.0), (1.0, 2.0), (True, True), (False, False), "no region"),
        ((2.0, 3.0), (1.5, 2.5), (True, True), (False, False), "no region"),
        ((-1.0, 1.0), (-1.5, 2.0), (True, True), (False, False), "no region"),
        ((1.0, 1.0), (1.0 + TURN, 2.0), (True, True), (True, False), None),
        ((1.0, 1.0), (1.0 + TURN, 2.0), (True, True), (False, False), None),
        ((1.0, 1.0), (1.0 + TURN, 2.0), (True, True), (True, True), "closes on itself"),
        ((1.0, 1.0), (1.0 + TURN, 2.0), (False, True), (True, False), "closes on itself"),
        ((1.0, 1.0), (1.0 + TURN, 2.0), (True, False), (False, True), "closes on itself"),
        ((1.0, 1.0), (TURN, 2.0), (True, True), (True, False), "closes on itself"),
    ],
)
def test_regions_are_boxes_and_close_where_they_are_full_turns(lower, upper, periodic, wrapped, told):
    arrays = {
        "lower": np.array(lower), "upper": np.array(upper), "wrapped": np.array(wrapped),
        "system_periodic": np.array([False, *periodic]), "system_independent": np.array([1, 2]),
    }  # fmt: skip
    if told is None:
        checked_region(arrays)
    else:
        with pytest.raises(InvalidInputError, match=told):
            checked_region(arrays)


def cells():
    """Three halvings of a square."""
    tree = CellTree.whole(2)
    tree.split(np.array([0]), np.array([0]))
    tree.split(np.array([2]), np.array([1]))
    tree.split(np.array([1]), np.array([0]))
    arrays = {f"tree_{name}": np.array(value) for name, value in tree.cells._asdict().items()}
    return arrays | {"lower": np.array([1.0, -1.0]), "upper": np.array([3.0, 7.0])}


@pytest.mark.parametrize(
    ("name", "index", "value", "told"),
    [
        ("tree_lower", (3, 1), 1, "no halves"), ("tree_size", (6, 0), 1, "no halves"),
        ("tree_lower", (0, 0), 1, "no halves"),
        ("tree_size", (0, 1), WHOLE // 2, "no halves"), ("tree_status", 0, 0, "has children"),
        ("tree_status", 4, CellStatus.SPLIT, "has children"), ("tree_child", 2, 1, "no tree"),
        ("tree_child", 1, -1, "no tree"),
        ("tree_child", 2, -1, "no tree"), ("tree_cut", 1, 1, "no halves"),
    ],
)  # fmt: skip
def test_cells_are_halves_of_their_cells(name, index, value, told):
    checked_cells(cells())
    arrays = cells()
    arrays[name][index] = value
    with pytest.raises(InvalidInputError, match=told):
        checked_cells(arrays)


def test_cells_come_behind_the_cells_they_are_in():
    """One that is split into cells before it is refused, though each is a half of it; the region alone is a tree."""
    arrays = cells()
    order = np.array([0, 1, 2, 5, 6, 3, 4])  # the halves of 1 before those of 2
    moved = {name: np.array(arrays[name]) for name in arrays}
    for name in ("lower", "size", "cut", "child", "status", "box"):
        moved[f"tree_{name}"][:] = arrays[f"tree_{name}"][order]
    moved["tree_child"][[1, 2]] = 3, 5
    checked_cells(moved)
    exchanged = np.array([0, 5, 6, 3, 4, 1, 2])
    for name in ("lower", "size", "cut", "child", "status", "box"):
        moved[f"tree_{name}"] = arrays[f"tree_{name}"][exchanged].copy()
    moved["tree_child"][[0, 5, 6]] = 5, 1, 3
    with pytest.raises(InvalidInputError, match="no tree"):
        checked_cells(moved)
    cut, child = np.zeros(7, dtype=np.int64), np.array([1, 5, -1, -1, -1, 3, -1])
    tree = tree_of(cut, child, 2)
    status = np.where(child >= 0, CellStatus.SPLIT, 0)
    with pytest.raises(InvalidInputError, match="no tree"):
        checked_cells(
            {
                "tree_lower": tree.lower,
                "tree_size": tree.size,
                "tree_cut": cut,
                "tree_child": child,
                "tree_status": status,
            }
        )
    lone = {name: value[:1].copy() if name.startswith("tree") else value for name, value in cells().items()}
    lone["tree_child"][0], lone["tree_status"][0] = -1, 0
    checked_cells(lone)
    lone["tree_status"][0] = CellStatus.SPLIT
    with pytest.raises(InvalidInputError, match="has children"):
        checked_cells(lone)
    unsplit = cells()
    unsplit["tree_status"][0] = 0
    with pytest.raises(InvalidInputError, match="has children"):
        checked_cells(unsplit)


def boxes(short=(0.0, 0.0), aside=(0.0, 0.0), members=False):
    """Boxes about three certified cells of `cells`, the second shorter than it should be, or moved."""
    arrays = cells()
    leaves = np.array([4, 5, 6])
    lower = arrays["tree_lower"] / WHOLE * [2.0, 8.0] + [1.0, -1.0]
    size = arrays["tree_size"] / WHOLE * [2.0, 8.0]
    order = np.array([2, 0, 1])  # of the boxes among the leaves
    centre, half = (lower + 0.5 * size)[leaves][order], 0.5 * size[leaves][order]
    half[1] -= short
    centre[1] += aside
    arrays["tree_status"][leaves], arrays["tree_box"][leaves[order]] = CellStatus.CERTIFIED, np.arange(3)
    arrays |= {
        "box_centre": np.column_stack([np.zeros(3), centre]), "box_half": half, "system_independent": np.array([1, 2]),
        "box_directions": np.tile([[5.0, 5.0], [1.0, 0.0], [0.0, 1.0]], (3, 1, 1)),
    }  # fmt: skip
    if members:
        arrays |= {"members_cell": leaves[order], "members_box": np.arange(3)}
        arrays["tree_box"][:] = 7
    return arrays


@pytest.mark.parametrize("members", [True, False])
@pytest.mark.parametrize(
    ("short", "aside", "good"),
    [
        ((0.0, 0.0), (0.0, 0.0), True), ((1e-12, 0.0), (0.0, 0.0), False), ((0.0, 1e-12), (0.0, 0.0), False),
        ((0.0, 0.0), (1e-12, 0.0), False), ((0.0, 0.0), (-1e-12, 0.0), False), ((0.0, 0.0), (0.0, 1e-12), False),
        ((0.0, 0.0), (0.0, -1e-12), False), ((-0.1, -0.1), (0.05, -0.05), True), ((0.0, 0.0), (5e-15, 0.0), True),
        ((0.04, 0.0), (0.0, 0.0), False), ((0.25, 0.0), (0.0, 0.0), False),
    ],
)  # fmt: skip
def test_boxes_cover_their_cells(members, short, aside, good):
    """In each coordinate and to both sides, but for rounding."""
    arrays = boxes(short, aside, members)
    if good:
        checked_boxes(arrays)
    else:
        with pytest.raises(InvalidInputError, match="does not cover"):
            checked_boxes(arrays)


@pytest.mark.parametrize(
    ("name", "index", "value", "told"),
    [
        ("box_directions", (1, 1, 1), 0.5, "D is not I"), ("box_directions", (0, 2, 1), 1.0 + 1e-15, "D is not I"),
        ("tree_box", 3, 0, "that is not certified"), ("tree_box", 0, 1, "that is not certified"),
        ("tree_box", 4, 0, "one box each"),
    ],
)  # fmt: skip
def test_certified_cells_have_a_box_each_and_others_none(name, index, value, told):
    arrays = boxes()
    arrays[name][index] = value
    with pytest.raises(InvalidInputError, match=told):
        checked_boxes(arrays)


# Files


@cache
def made():
    """An atlas, sheets and a cover of singular curves."""
    crank, bars = ccpin.load("slider_crank"), ccpin.load("rpdr")
    region = np.array([[0.99, 1.0], [1.0, 1.01]])
    return (
        certify(crank, [0.5], ([0.0], [1.0]), max_depth=3),
        certify_sheets(crank, ([0.0], [1.0]), max_depth=3),
        certify_singularities(bars, region, budget=200),
    )


@pytest.mark.parametrize(("k", "kind"), [(0, Atlas), (1, SheetAtlas), (2, SingularCover)])
@pytest.mark.parametrize("suffix", ["npz", "json"])
def test_files_hold_all_there_is(tmp_path, k, kind, suffix):
    """What is loaded says the same, number by number, and names its file."""
    one = made()[k]
    one.save(tmp_path / f"one.{suffix}")
    again = kind.load(tmp_path / f"one.{suffix}")
    again.save(tmp_path / f"two.{suffix}")
    assert (tmp_path / f"one.{suffix}").read_bytes() == (tmp_path / f"two.{suffix}").read_bytes() or suffix == "npz"
    assert again.source == str(tmp_path / f"one.{suffix}")
    for field in fields(one):
        if field.name in ("names", "complete", "radius", "limit", "resolution", "tried"):
            assert getattr(again, field.name) == getattr(one, field.name)
    if k < 2:
        for name in ("lower", "size", "cut", "child", "status", "box"):
            np.testing.assert_array_equal(getattr(again.tree, name), getattr(one.tree, name))
        for mine, theirs in zip(again.boxes, one.boxes, strict=True):
            np.testing.assert_array_equal(mine, theirs)
        np.testing.assert_array_equal(again.singular.cell, one.singular.cell)
    np.testing.assert_array_equal(again.region.lower, one.region.lower)


def test_every_box_of_a_file_is_proved_again(monkeypatch):
    header, arrays = store.pack(made()[1])
    count = len(made()[1].boxes.kappa)
    assert count > 1
    for bad in (0, count - 1):
        proved = np.arange(count) != bad
        monkeypatch.setattr(store, "proved_boxes", lambda problem, boxes, proved=proved: (None, proved))
        with pytest.raises(InvalidInputError, match=f"box {bad} is not proved"):
            store.unpack(header, deepcopy(arrays))


def test_a_whole_rests_on_the_files_of_its_parts():
    """Each named once; on none where none was loaded."""
    parts = [SimpleNamespace(source=source) for source in ("a", None, "b", "a")]
    assert merging._sources(parts) == "a, b"
    assert merging._sources(parts[1:2]) is None
