"""Trees that tile and trees that do not, boxes that just do and just do not cover their cells, and whole documents."""

from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("flint")

from ccpin.auditing import reading, tiling
from ccpin.auditing.structure import ContradictionError
from ccpin.auditing.tiling import CERTIFIED, EMPTY, SINGULAR, SPLIT, Over

WHOLE = 2**32
QUARTER = WHOLE // 4


def tree():
    """The region [0, 4] × [0, 1] in leaves 1 (left half), 3 and 4 (the right half's left and right quarters)."""
    return {
        "lower": np.array([0.0, 0.0]),
        "upper": np.array([4.0, 1.0]),
        "wrapped": np.zeros(2, dtype=bool),
        "tree_lower": np.array([[0, 0], [0, 0], [2 * QUARTER, 0], [2 * QUARTER, 0], [3 * QUARTER, 0]]),
        "tree_size": np.array([[WHOLE, WHOLE], *2 * [[2 * QUARTER, WHOLE]], *2 * [[QUARTER, WHOLE]]]),
        "tree_cut": np.array([0, 0, 0, 1, 1]),
        "tree_child": np.array([1, -1, 3, -1, -1]),
        "tree_status": np.array([SPLIT, CERTIFIED, SPLIT, SINGULAR, EMPTY]),
        "tree_box": np.array([-1, 0, -1, -1, -1]),
        "singular_cell": np.array([3]),
        "singular_theta": np.zeros((1, 3)),
    }


def put(**changes):
    """Arrays with numbers put in places: name=(place, value)."""

    def change(arrays):
        for name, (place, value) in changes.items():
            arrays[name][place] = value

    return change


def to(**changes):
    return lambda arrays: arrays.update(changes)


def both(*changes):
    return lambda arrays: [change(arrays) for change in changes]


def judge(check, arrays, change, fault):
    change(arrays)
    if fault is None:
        check(arrays)
    else:
        with pytest.raises(ContradictionError, match=fault):
            check(arrays)


def bare(arrays):
    for name in arrays:
        if name.startswith("tree_"):
            arrays[name] = arrays[name][:0]


def more(arrays):
    """A sixth row, that nothing leads to."""
    for name in arrays:
        if name.startswith("tree_"):
            arrays[name] = np.concatenate([arrays[name], arrays[name][-1:]])


def beyond(arrays):
    """The last row's children would be behind the last."""
    arrays["tree_child"][4] = 4
    arrays["tree_status"][4] = SPLIT


def deeper(share):
    """Edges of one unit, cut again."""

    def change(arrays):
        arrays["tree_size"][0] = [WHOLE, share]

    return change


TREES = [
    (lambda arrays: None, None),
    (bare, "first cell is not the region"),
    (put(tree_lower=((0, 1), 1)), "first cell is not the region"),
    (put(tree_size=((0, 1), WHOLE - 1)), "first cell is not the region"),
    (put(tree_size=((0, 0), WHOLE // 2)), "first cell is not the region"),
    (more, "in no other"),
    (put(tree_child=(2, 0)), "two cells' child|not the halves"),
    (put(tree_child=(2, 2)), "two cells' child|not the halves"),
    (put(tree_child=(2, 1)), "two cells' child|not the halves"),
    (put(tree_child=(1, 3)), "two cells' child|not the halves"),
    (put(tree_child=(3, -2)), "below −1"),
    (beyond, "a cell that is none"),
    (put(tree_child=(2, 10**9)), "a cell that is none"),
    (put(tree_cut=(0, 2)), "cut along what is no edge"),
    (put(tree_cut=(0, -1)), "cut along what is no edge"),
    (put(tree_cut=(4, 2)), "an edge that is none"),
    (put(tree_cut=(4, -1)), "an edge that is none"),
    (put(tree_cut=(2, 1)), "not the halves"),
    (to(lower=np.array([0.0, 1.0])), None),  # held, and not cut
    (both(to(upper=np.array([0.0, 1.0]))), "cut along what is no edge"),
    (both(to(lower=np.array([0.0, 1.0])), put(tree_cut=(2, 1))), "cut along what is no edge"),
    (put(tree_size=((1, 0), QUARTER)), "not the halves"),
    (put(tree_size=((2, 0), QUARTER)), "not the halves"),
    (put(tree_size=((3, 1), QUARTER)), "not the halves"),
    (put(tree_size=((4, 1), QUARTER)), "not the halves"),
    (put(tree_lower=((1, 0), 1)), "not the halves"),
    (put(tree_lower=((3, 1), 1)), "not the halves"),
    (put(tree_lower=((2, 0), 0)), "not the halves"),
    (put(tree_lower=((4, 0), 2 * QUARTER)), "not the halves"),
    (put(tree_lower=((4, 0), QUARTER)), "not the halves"),
    (put(tree_status=(0, CERTIFIED)), "not called split"),
    (put(tree_status=(2, EMPTY)), "not called split"),
    (put(tree_status=(1, SPLIT)), "a status that there is not"),
    (put(tree_status=(4, 7)), "a status that there is not"),
    (put(tree_status=(4, 1)), None),
    (to(singular_cell=np.array([3, 3])), "twice"),
    (to(singular_cell=np.zeros(0, dtype=int)), "without a singular"),
    (put(tree_status=(1, SINGULAR)), "without a singular"),
    (to(singular_cell=np.array([3, 4])), "not called singular"),
    (to(singular_cell=np.array([3, 2])), "not called singular"),
]


@pytest.mark.parametrize(("change", "fault"), TREES)
def test_trees(change, fault):
    judge(tiling.check_tree, tree(), change, fault)


def test_edges_are_halved_down_to_one():
    """After 32 cuts a cell is 1 wide, which has no halves; and cells that are no leaves but called singular."""
    count = 33
    arrays = {
        "lower": np.zeros(1),
        "upper": np.ones(1),
        "tree_lower": np.zeros((2 * count + 1, 1), dtype=int),
        "tree_size": np.zeros((2 * count + 1, 1), dtype=int),
        "tree_cut": np.zeros(2 * count + 1, dtype=int),
        "tree_child": np.full(2 * count + 1, -1),
        "tree_status": np.zeros(2 * count + 1, dtype=int),
        "singular_cell": np.zeros(0, dtype=int),
    }
    size, row = WHOLE, 0
    arrays["tree_size"][0] = WHOLE
    for k in range(count):
        first, size = 2 * k + 1, size // 2
        arrays["tree_child"][row], arrays["tree_status"][row] = first, SPLIT
        arrays["tree_size"][[first, first + 1]] = size
        arrays["tree_lower"][first + 1] = size
        row = first
    with pytest.raises(ContradictionError, match="cannot be halved"):
        tiling.check_tree(arrays)


def atlas():
    """One certified cell, [0, 2] × [0, 1], with its box; q₀ in it."""
    return tree() | {
        "box_centre": np.array([[7.0, 1.0, 0.5]]),
        "box_half": np.array([[1.0, 0.5]]),
        "box_directions": np.array([[[0.5, 0.25], [1.0, 0.0], [0.0, 1.0]]]),
        "box_radius": np.array([[0.1]]),
        "box_kappa": np.array([0.5]),
        "box_weight": np.array([[1.0]]),
        "system_independent": np.array([1, 2]),
        "unglued": np.zeros((0, 2), dtype=int),
        "seed": np.array([7.0, 0.75, 0.625]),
        "q0": np.array([0.75, 0.625]),
    }


def of_radius(radius):
    return lambda arrays: tiling.check_atlas({"radius": radius}, arrays)


ATLASES = [
    (lambda arrays: None, None),
    (put(tree_box=(3, 0)), "not certified"),
    (put(tree_box=(0, 0)), "not certified"),
    (put(tree_box=(1, -1)), "not one box each"),
    (put(tree_box=(1, 1)), "not one box each"),
    (to(box_centre=np.zeros((2, 3))), "not one box each"),
    (to(unglued=np.array([[0, 0]])), "'radius'"),
    (to(unglued=np.array([[0, 1]])), "unglued names boxes"),
    (to(unglued=np.array([[-1, 0]])), "unglued names boxes"),
    (put(q0=(0, 0.76)), "q0 is not"),
    (put(q0=(1, 0.7)), "q0 is not"),
    (put(seed=(0, 3.0)), None),
]


@pytest.mark.parametrize(("change", "fault"), ATLASES)
def test_atlases(change, fault):
    judge(of_radius(0.375), atlas(), change, fault)


def radius_of(**changes):
    arrays = atlas()
    arrays.update(changes)
    return tiling._radius(arrays)


def placed(*q):
    return {"q0": np.array(q), "seed": np.array([7.0, *q])}


def test_a_radius_ends_at_what_is_not_certified():
    """The region's ends, cells that are not certified, on either side, and faces that are unglued."""
    assert radius_of(**placed(0.75, 0.625)) == 0.375
    assert radius_of(**placed(0.25, 0.5)) == 0.25
    assert radius_of(**placed(0.75, 0.125)) == 0.125
    assert radius_of(**placed(1.75, 0.5)) == 0.25
    split = np.array([SPLIT, EMPTY, SPLIT, CERTIFIED, CERTIFIED])
    box = np.array([-1, -1, -1, 1, 0])
    right = {"tree_status": split, "tree_box": box}
    assert radius_of(**right, **placed(2.25, 0.5)) == 0.25
    assert radius_of(**right, **placed(2.75, 0.5)) == 0.5
    assert radius_of(**right, **placed(2.75, 0.5), unglued=np.array([[0, 1]])) == 0.25
    assert radius_of(**right, **placed(3.25, 0.5), unglued=np.array([[1, 0]])) == 0.25
    # boxes are numbered as they are: box 1 is over cell 3
    third = {"tree_status": np.array([SPLIT, CERTIFIED, SPLIT, CERTIFIED, CERTIFIED])}
    third["tree_box"] = np.array([-1, 2, -1, 1, 0])
    assert radius_of(**third, **placed(1.875, 0.5), unglued=np.array([[0, 1]])) == 0.5
    assert radius_of(**third, **placed(1.875, 0.5), unglued=np.array([[2, 1]])) == 0.125
    # a split cell, whatever it is called over, is no leaf
    assert radius_of(**third, **placed(1.875, 0.5)) == 0.5


def test_a_radius_goes_around_what_closes_on_itself():
    """Half of the turn at most; nearest cells by the shorter way, from whichever turn q₀ is on."""
    width = {"lower": np.array([1.0, -9.0]), "upper": np.array([5.0, 9.0]), "wrapped": np.array([True, False])}
    for turns in (-2, 0, 1):
        assert radius_of(**width, **placed(1.25 + 4.0 * turns, 0.5)) == 0.25  # cell 4 is behind the seam
        assert radius_of(**width, **placed(2.5 + 4.0 * turns, 0.5)) == 0.5
    whole = {"tree_status": np.array([SPLIT, CERTIFIED, SPLIT, CERTIFIED, CERTIFIED])}
    whole["tree_box"] = np.array([-1, 0, -1, 1, 2])
    assert radius_of(**width, **whole, **placed(1.25, 0.5)) == 2.0
    last = {"tree_status": np.array([SPLIT, EMPTY, SPLIT, CERTIFIED, CERTIFIED]), "tree_box": whole["tree_box"]}
    assert radius_of(**width, **last, **placed(4.75, 0.5)) == 0.25


def test_a_radius_does_not_ask_of_what_is_held():
    held = {"lower": np.array([0.0, 0.5]), "upper": np.array([4.0, 0.5])}
    assert radius_of(**held, **placed(0.75, 0.5)) == 0.75
    assert radius_of(**held, **placed(1.5, 0.5)) == 0.5


@pytest.mark.parametrize(
    ("radius", "good"), [(0.0, True), (0.375, True), (0.375 * (1 + 2e-12), False), (-1e-300, False), (0.4, False)]
)
def test_a_radius_is_no_longer_than_that(radius, good):
    judge(of_radius(radius), atlas(), lambda arrays: None, None if good else "'radius'")
    judge(of_radius(0.375 * (1.0 + 0.97e-12)), atlas(), lambda arrays: None, None)
    judge(of_radius(0.375 * (1.0 + 1.03e-12)), atlas(), lambda arrays: None, "'radius'")


def checked(arrays, half=None):
    half = arrays["box_half"] * (1.0 + 1e-12) if half is None else half
    tiling.check_boxes(arrays, Over(np.array([1]), np.array([0])), half)


BOXES = [
    (lambda arrays: None, None),
    (put(box_directions=((0, 1, 1), 1e-300)), "D is not I"),
    (put(box_directions=((0, 2, 1), 0.5)), "D is not I"),
    (put(box_directions=((0, 0), 3.0)), None),
    (put(box_half=((0, 1), -0.5)), "no sizes"),
    (put(box_radius=((0, 0), 0.0)), "no sizes"),
    (to(box_radius=np.array([[0.1, 0.0]])), "no sizes"),
    (both(to(lower=np.array([0.0, 0.5]), upper=np.array([4.0, 0.5])), put(box_half=((0, 1), 0.0))), None),  # held
    (put(box_kappa=(0, 1.0)), "box_kappa"),
    (put(box_kappa=(0, 0.99)), None),
    (put(box_kappa=(0, 0.0)), None),
    (put(box_kappa=(0, -1e-300)), "box_kappa"),
    (to(box_kappa=np.array([0.5, 1.0])), "box_kappa"),
    (to(box_kappa=np.array([0.5, -1.0])), "box_kappa"),
    (put(box_weight=((0, 0), 0.0)), "box_weight"),
    (to(box_weight=np.array([[0.1, -1.0]])), "box_weight"),
]


@pytest.mark.parametrize(("change", "fault"), BOXES)
def test_boxes(change, fault):
    judge(checked, atlas(), change, fault)


def test_boxes_lie_over_their_own_cells():
    arrays = atlas()
    arrays["box_centre"][0, 1:], arrays["box_half"][0] = [2.5, 0.5], [0.5, 0.5]
    for cell, good in ((3, True), (4, False), (1, False)):
        try:
            tiling.check_boxes(arrays, Over(np.array([cell]), np.array([0])), arrays["box_half"])
            assert good
        except ContradictionError:
            assert not good


def two(arrays):
    """Two boxes, of which the first is none."""
    arrays["box_directions"] = np.concatenate([arrays["box_directions"], arrays["box_directions"]])
    arrays["box_directions"][0, 1, 0] = 2.0


def test_all_boxes_are_asked():
    arrays = atlas()
    two(arrays)
    with pytest.raises(ContradictionError, match="D is not I"):
        checked(arrays, np.ones((2, 2)))


@pytest.mark.parametrize("start", [0.0, 100.0, -100.0])
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_boxes_cover_their_cells_and_little_more(start, axis, side):
    """With the h of Theorem N they cover; as stated they are off by a billionth of an edge at most, and that room."""
    edge = (2.0, 1.0)[axis]

    def off(by, longer=0.0, wide=1e-3):
        arrays = atlas()
        arrays["lower"] = arrays["lower"] + start
        arrays["upper"] = arrays["upper"] + start
        arrays["box_centre"][:, 1:] += start
        arrays["box_centre"][0, 1 + axis] += side * by
        arrays["box_half"][0, axis] += longer
        half = arrays["box_half"].copy()
        half[0, axis] += wide
        return arrays, half

    def good(arrays, half):
        try:
            checked(arrays, half)
        except ContradictionError:
            return False
        return True

    tiny = 1e-12 * (1.0 + abs(start))
    assert good(*off(0.0, wide=0.0))
    assert good(*off(0.9e-3))  # covered; within the room of h
    assert not good(*off(1.1e-3))
    assert not good(*off(1.1e-9 * edge, longer=1.1e-9 * edge, wide=0.0) if not start else off(1.1e-3))
    if not start:
        assert good(*off(0.0, longer=0.99e-9 * edge, wide=0.0))
        assert not good(*off(0.0, longer=1.01e-9 * edge, wide=0.0))
        assert good(*off(0.0, longer=0.99e-9 * edge + 1e-6, wide=1e-6))
        assert not good(*off(0.0, longer=1.01e-9 * edge + 1e-6, wide=1e-6))
        assert not good(*off(0.0, longer=-1e-6, wide=0.99e-6))
        assert good(*off(0.0, longer=-1e-6, wide=1.01e-6))
    assert not good(*off(tiny + 1e-9, wide=0.0))


def sheets():
    """Cells 1 (two certified boxes), 3 (singular, not counted) and 4 (empty), and one face."""
    arrays = tree()
    arrays["tree_box"][:] = -1
    return arrays | {
        "members_cell": np.array([1, 1]),
        "members_box": np.array([1, 0]),
        "box_centre": np.zeros((2, 3)),
        "count": np.array([-1, 2, -1, -1, 0]),
        "glued_first": np.array([0]),
        "glued_second": np.array([1]),
        "glued_at_first": np.array([[1.0, 0.5]]),
        "glued_at_second": np.array([[1.0, 0.5]]),
        "left_cell": np.array([3]),
        "left_half": np.zeros((1, 3)),
    }


SHEETS = [
    (lambda arrays: None, None),
    (put(tree_box=(1, 0)), "sheets list their boxes"),
    (put(tree_box=(4, 0)), "sheets list their boxes"),
    (to(members_cell=np.array([1, 5])), "are no leaves"),
    (to(members_cell=np.array([-1, 1])), "are no leaves"),
    (to(members_cell=np.array([1, 2])), "are no leaves"),
    (to(members_cell=np.array([0, 1])), "are no leaves"),
    (to(members_cell=np.array([3, 1])), "not in the order"),
    (to(members_cell=np.array([1, 3, 1]), members_box=np.arange(3), box_centre=np.zeros((3, 3))), "not in the order"),
    (to(members_box=np.array([0, 0])), "members_box"),
    (to(members_box=np.array([0, 2])), "members_box"),
    (to(count=np.array([-1, 2, -1, -2, 0])), "count: a number below"),
    (to(count=np.array([0, 2, -1, -1, 0])), "or of a cell that is split"),
    (to(count=np.array([-1, 2, 5, -1, 0])), "or of a cell that is split"),
    (to(count=np.array([-1, 1, -1, -1, 0])), "count: not as many"),
    (to(count=np.array([-1, 3, -1, -1, 0])), "count: not as many"),
    (to(count=np.array([-1, -1, -1, -1, 0])), "count: not as many"),
    (to(count=np.array([-1, 2, -1, -1, 1])), "an empty cell has"),
    (to(count=np.array([-1, 2, -1, -1, -1])), "an empty cell has"),
    (both(put(tree_status=(1, 1)), to(count=np.array([-1, 2, -1, -1, 0]))), None),
    (both(put(tree_status=(1, 1)), to(count=np.array([-1, -1, -1, -1, 0]))), None),
    (both(put(tree_status=(1, 1)), to(count=np.array([-1, 4, -1, -1, 0]))), None),
    (both(put(tree_status=(1, 1)), to(count=np.array([-1, 1, -1, -1, 0]))), "fewer than a cell has"),
    (both(put(tree_status=(1, EMPTY)), to(count=np.array([-1, 0, -1, -1, 0]))), "an empty cell has"),
    (both(put(tree_status=(1, 1)), to(count=np.array([-1, 0, -1, -1, 0]))), "fewer than a cell has"),
    (put(glued_first=(0, 2)), "boxes that are none"),
    (put(glued_first=(0, -1)), "boxes that are none"),
    (put(glued_second=(0, 2)), "boxes that are none"),
    (put(glued_second=(0, -1)), "boxes that are none"),
    (put(glued_second=(0, 0)), "glued to itself"),
    (to(glued_first=np.array([0, 1]), glued_second=np.array([1, 1])), "glued to itself"),
    (to(left_cell=np.array([5])), "left_cell"),
    (to(left_cell=np.array([-1])), "left_cell"),
    (put(left_half=((0, 1), -1e-300)), "left_half"),
]


@pytest.mark.parametrize(("change", "fault"), SHEETS)
def test_sheets(change, fault):
    judge(tiling.check_sheets, sheets(), change, fault)


def face(gap, wrapped=(False, False), width=(4.0, 1.0), axis=0):
    arrays = sheets() | {"wrapped": np.array(wrapped)}
    arrays["lower"] = np.array([10.0, 20.0])
    arrays["upper"] = arrays["lower"] + width
    arrays["glued_at_first"][0, axis] += gap
    try:
        tiling._check_faces(arrays)
    except ContradictionError:
        return False
    return True


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_faces_are_one_place_but_for_one_full_turn(sign):
    for width, room in (((4.0, 1.0), 4e-9), ((0.25, 1.0), 1e-9)):
        for gap, good in ((0.0, True), (0.95 * room, True), (1.05 * room, False)):
            assert face(sign * gap, width=width) == good
            assert face(sign * (width[0] + gap), (True, False), width) == good
        assert not face(sign * width[0], (False, True), width)
        assert not face(sign * 2.0 * width[0], (True, False), width)
        assert not face(sign * 0.5, (True, False), (4.0, 1.0))
    assert not face(sign * 1e-6, axis=1)
    assert face(0.0, width=(4.0, 0.0), wrapped=(True, True), axis=1)
    assert not face(sign, width=(4.0, 0.0), wrapped=(True, True), axis=1)  # what is held has no turn


# Documents


def test_shares_and_cells_are_those_of_leaves():
    arrays = tree() | {"count": np.array([-1, 2, -1, 0, -1])}
    assert reading._shares(arrays) == {"certified": 0.5, "empty": 0.25, "singular": 0.25, "counted": 0.75}
    assert "counted" not in reading._shares(tree())
    arrays["tree_status"][[0, 2]] = EMPTY  # which are no leaves
    said = reading._claimed(arrays)
    assert said["shares"]["empty"] == 0.25
    assert said["empty"].number.tolist() == [4]
    assert said["singular"].number.tolist() == [3]
    np.testing.assert_array_equal(said["empty"].lower, [[0.75, 0.0]])
    np.testing.assert_array_equal(said["empty"].upper, [[1.0, 1.0]])
    assert said["witnesses"] is arrays["singular_theta"]


def test_counts_are_of_leaves_that_are_not_empty():
    arrays = sheets()
    arrays["count"] = np.array([5, 2, 5, 0, 0])
    found = reading._counts(arrays)
    assert found.cells.number.tolist() == [1, 3]
    assert found.said.tolist() == [2, 0]
    assert found.certified.tolist() == [True, False]
    arrays["count"][3] = -1
    assert reading._counts(arrays).cells.number.tolist() == [1]


def test_corners_are_outward_where_a_cell_has_a_width():
    """1e-15 of one more than both ends."""
    region = SimpleNamespace(lower=np.array([-300.0, 5.0]), upper=np.array([200.0, 5.0]))
    some = reading.ClaimedCells(
        np.array([0, 1]), np.array([[0.0, 0.0], [0.25, 0.0]]), np.array([[0.5, 1.0], [0.75, 1.0]])
    )
    for k, (low, high) in enumerate(((-300.0, -50.0), (-175.0, 75.0))):
        found = reading.corners(region, some, k)
        np.testing.assert_allclose([low - found[0][0], found[1][0] - high], 501e-15, rtol=0.12)
        assert (found[0][1], found[1][1]) == (5.0, 5.0)
    for lower, upper, size in ((0.0, 2.0**-4, 1.0625e-15), (-(2.0**-4), 0.0, 1.0625e-15), (0.0, 0.0, 0.0)):
        region = SimpleNamespace(lower=np.array([lower]), upper=np.array([upper]))
        whole = reading.ClaimedCells(np.array([0]), np.zeros((1, 1)), np.ones((1, 1)))
        low, high = reading.corners(region, whole, 0)
        np.testing.assert_allclose([lower - low[0], high[0] - upper], size, rtol=0.02, atol=0)
    region = SimpleNamespace(lower=np.array([-1.0]), upper=np.array([2.0**-6]))
    room = reading.corners(region, reading.ClaimedCells(np.zeros(1), np.ones((1, 1)), np.ones((1, 1))), 0)
    np.testing.assert_allclose(2.0**-6 - room[0][0], (2.0 + 2.0**-6) * 1e-15, rtol=0.002)


def test_stated_ranges_are_intervals():
    arrays = {
        "r_lower": np.array([0.0, 1.0]),
        "r_upper": np.array([0.0, 2.0]),
        "r_reasons": np.zeros((2, 2)),
        "r_limits": np.array([[0.5, 0.5], [3.0, 4.0]]),
    }
    assert reading._stated(arrays, "r").lower is arrays["r_lower"]
    for name, place, value in (("r_lower", 0, 1e-300), ("r_lower", 1, 2.5), ("r_limits", (1, 0), 5.0)):
        other = {key: array.copy() for key, array in arrays.items()}
        other[name][place] = value
        with pytest.raises(ContradictionError, match="a lower end is above"):
            reading._stated(other, "r")


def curves():
    return {
        "tube_theta": np.zeros((3, 2)),
        "tube_kernel": np.zeros((3, 1)),
        "tube_pairing": np.zeros((3, 1)),
        "tube_along": np.array([0, 2, 1]),
        "tube_tangent": np.zeros((3, 3)),
        "tube_half": np.array([0.1, 0.2, 0.3]),
        "tube_radius": np.zeros((3, 3)),
        "curve_tubes": np.array([1, 2]),
        "curve_closed": np.array([False, True]),
        "uncovered_lower": np.array([[0.0, 1.0]]),
        "uncovered_upper": np.array([[0.0, 2.0]]),
        "range_lower": np.zeros(1),
        "range_upper": np.ones(1),
        "range_reasons": np.zeros((1, 2)),
        "range_limits": np.array([[0.0, 1.0]]),
        "lower": np.zeros(1),
        "upper": np.ones(1),
        **{f"system_{name}": np.zeros(1) for name in reading._SYSTEM},
    }


CURVES = [
    (lambda arrays: None, None),
    (to(curve_tubes=np.array([0, 3])), "curve_tubes"),
    (to(curve_tubes=np.array([1, 1])), "curve_tubes"),
    (to(curve_tubes=np.array([2, 2])), "curve_tubes"),
    (put(tube_along=(1, 3)), "tube_along"),
    (put(tube_along=(1, -1)), "tube_along"),
    (put(tube_half=(1, 0.0)), "no sizes"),
    (put(tube_half=(2, -1.0)), "no sizes"),
    (put(tube_radius=((1, 2), -1e-300)), "no sizes"),
    (put(uncovered_lower=((0, 1), 2.1)), "uncovered_lower is above"),
    (put(uncovered_lower=((0, 0), 1e-300)), "uncovered_lower is above"),
    (put(uncovered_upper=((0, 0), -1.0)), "uncovered_lower is above"),
    (put(range_lower=(0, 2.0)), "range: a lower end"),
]


@pytest.mark.parametrize(("change", "fault"), CURVES)
def test_curves(change, fault):
    judge(lambda arrays: reading._curves({"chains": 0}, arrays), curves(), change, fault)


def test_curves_have_what_arrays_say():
    found = reading._curves({"chains": 0}, curves())
    assert [(tube.along, tube.half) for tube in found.tubes] == [(0, 0.1), (2, 0.2), (1, 0.3)]
    assert found.ranges.upper.tolist() == [1.0]


def test_free_angles():
    """Periodic, no slide of any chain, in no coupling."""

    def of(**changed):
        chain = SimpleNamespace(joints=np.array([0, 1]), prismatic=np.array([False, False]))
        other = SimpleNamespace(joints=np.array([1, 2]), prismatic=np.array([changed.get("slides", False), False]))
        couplings = np.zeros((2, 3))
        couplings[1, 1] = changed.get("ratio", 0.0)
        periodic = np.array([False, changed.get("periodic", True), True])
        return SimpleNamespace(chains=(chain, other), couplings=couplings, periodic=periodic)

    assert reading.free_angles(of()) == [False, True, True]
    for changed in ({"slides": True}, {"ratio": 2.0}, {"periodic": False}):
        assert reading.free_angles(of(**changed)) == [False, False, True]


def test_chains_are_points_or_directions():
    fields = {f"chain0_{name}": np.zeros(1) for name in reading._CHAIN}
    arrays = {"lower": 0, "upper": 1, **{f"system_{name}": name for name in reading._SYSTEM}}
    for direction in (False, True):
        found = reading._closures({"chains": 1}, arrays | fields | {"chain0_direction": np.array(direction)})
        assert found["chains"][0].direction is direction
        assert found["couplings"] == "couplings"


def test_demands_and_sheets_are_what_arrays_say():
    said = {f"demand_{name}": np.full(2, k) for k, name in enumerate(reading.ClaimedRequirements._fields)}
    assert reading._demands({}) is None
    found = reading._demands(said | {"demand_dexterity": np.array(0.25)})
    assert type(found.dexterity) is float
    assert found.upper is said["demand_upper"]
    stated = {f"ranges_{name}": np.zeros((1, 2)) for name in reading.StatedRanges._fields}
    found = reading._of_sheets(sheets() | stated)
    assert found["ranges"].lower is stated["ranges_lower"]
    assert found["counts"].said.tolist() == [2]
    assert found["faces"].second.tolist() == [1]
