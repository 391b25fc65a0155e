"""Cells of parts in the place of the whole's: where corners may be off by what boxes have to spare, and no more."""

from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.covering import merging
from ccpin.covering.cells import Cells, CellTree
from ccpin.covering.merging import CellOffset, grafted, whole_region
from ccpin.covering.region import Region
from ccpin.errors import InvalidInputError
from ccpin.proof.cell_tree import WHOLE

U = 2.0**-53
TURN = 2.0 * np.pi


def region_of(lower, upper, wrapped=False):
    lower, upper = np.atleast_1d(np.array(lower, dtype=float)), np.atleast_1d(np.array(upper, dtype=float))
    return Region(lower, upper, np.broadcast_to(np.array(wrapped), lower.shape))


def part_of(region, tree=None, boxes=0, periodic=False):
    n = len(region.lower)
    system = SimpleNamespace(periodic=np.broadcast_to(np.array(periodic), n), independent=np.arange(n))
    return SimpleNamespace(
        region=region,
        problem=SimpleNamespace(system=system),
        tree=CellTree.whole(n) if tree is None else tree,
        boxes=SimpleNamespace(kappa=np.zeros(boxes)),
    )


# Regions.


@pytest.mark.parametrize(("width", "periodic", "wrapped"), [
    (TURN, True, True), (TURN - 0.95e-9, True, True), (TURN - 1.05e-9, True, False), (4.0, True, False),
    (TURN, False, False), (TURN + 1.0, True, True),
])  # fmt: skip
@pytest.mark.parametrize("lower", [0.0, -7.0])
def test_the_whole_is_what_holds_all_parts(lower, width, periodic, wrapped):
    """A turn of what is periodic, to 1e-9, closes on itself."""
    middle = lower + 2.0
    regions = region_of(middle, lower + width), region_of(lower, middle)
    found = whole_region([part_of(region, periodic=periodic) for region in regions])
    assert (found.lower.tolist(), found.wrapped.tolist()) == ([lower], [wrapped])
    assert found.upper.tolist() == [lower + TURN if wrapped else lower + width]


# Corners.


def aligned(region, part, at=0, size=WHOLE):
    return merging._aligned(region_of(*region), region_of(*part), np.array([at]), np.array([size]), 0)


def after(x, steps=1):
    for _ in range(abs(steps)):
        x = np.nextafter(x, np.inf if steps > 0 else -np.inf)
    return float(x)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_about_zero_corners_are_off_by_eight_quadrillionths(sign):
    for off, held in ((8e-15, True), (after(8e-15), False)):
        lower, upper = sorted((sign * off, sign))
        region = sorted((0.0, sign))
        assert aligned(region, (lower, upper)) is held
        lower, upper = sorted((-sign * off, sign))
        assert aligned(region, (lower, upper)) is held


@pytest.mark.parametrize("half", [0, 1])
@pytest.mark.parametrize(("middle", "most"), [(1.99 * 2.0**20, 1), (1.05 * 2.0**20, 0), (1.99 * 2.0**4, 4)])
def test_elsewhere_by_two_roundings_less_a_twentieth_too(middle, most, half):
    """1.9u|x|: 1.89 units in the last place of 1.99 · 2ᵏ, 0.9975 of 1.05 · 2ᵏ; 8e-15 are 2.25 of those of 2⁴."""
    region = (0.0, 2.0 * middle)
    for steps in (-most - 1, -most, most, most + 1):
        off = after(middle, steps)
        part = (off, 2.0 * middle) if half else (0.0, off)
        gap = abs(Fraction(off) - Fraction(middle))
        held = gap <= Fraction(8e-15) + Fraction(19, 10) * Fraction(U) * Fraction(middle)
        assert held == (abs(steps) <= most)
        assert aligned(region, part, half * WHOLE // 2, WHOLE // 2) is held


@pytest.mark.parametrize(("near", "held"), [(64.0, True), (128.0, False)])
@pytest.mark.parametrize("sign", [1, -1])
def test_what_is_off_at_corners_is_off_at_zero_between_them(near, held, sign):
    """A corner at 1024 may be off by 2⁻⁴³, of which 1/17 is left at zero where the other is at −64: 6.7e-15."""
    off = 1024.0 - 2.0**-43
    if sign > 0:
        assert aligned((-near, 1024.0), (-near, off)) is held
        assert aligned((64.0, 1024.0), (64.0, off))
    else:
        assert aligned((-1024.0, near), (-off, near)) is held
        assert aligned((-1024.0, -64.0), (-off, -64.0))


def test_corners_are_where_the_cells_are():
    region = (-3.0, 5.0)
    assert aligned(region, (-1.0, 1.0), WHOLE // 4, WHOLE // 4)
    assert not aligned(region, (-1.0, 3.0), WHOLE // 4, WHOLE // 4)
    assert not aligned(region, (-3.0, 1.0), WHOLE // 4, WHOLE // 4)


def test_held_coordinates_are_the_same_to_the_bit():
    assert aligned((0.3, 0.3), (0.3, 0.3))
    assert not aligned((0.3, 0.3), (after(0.3), 0.3))
    assert not aligned((0.3, 0.3), (0.3, after(0.3)))


# Places.


@pytest.mark.parametrize(("part", "place"), [
    (([1.0, -2.0], [3.0, 0.0]), ([0, 0], [4, 2])),
    (([2.0, -2.0], [2.5, -1.0]), ([2, 0], [1, 1])),
    (([1.5, 1.0], [2.0, 2.0]), ([1, 3], [1, 1])),
    (([1.5, -2.0], [2.5, 2.0]), None),  # of a half's size, but between halves
    (([1.0, -2.0], [2.5, 2.0]), None),  # three quarters
    (([1.0, -2.0], [1.0 + 1e-15, 2.0]), None),  # nothing
    (([1.0, -2.0], [2.0 + 1e-12, 2.0]), None),  # almost a half
    (([1.0, -2.0], [2.0, 1e-12]), None),
    (([1.0, 1.0], [2.0, 2.5]), None),
])  # fmt: skip
def test_parts_are_halves_of_halves(part, place):
    region = region_of([1.0, -2.0], [3.0, 2.0])
    if place is None:
        with pytest.raises(InvalidInputError, match="part 7 from"):
            merging._place(region, region_of(*part), 7)
    else:
        found = merging._place(region, region_of(*part), 7)
        np.testing.assert_array_equal(found, np.array(place) * (WHOLE // 4))


@pytest.mark.parametrize("whole", [False, True])
@pytest.mark.parametrize("part", [False, True])
def test_what_closes_on_itself_is_a_part_of_what_does(whole, part):
    region = region_of([0.0, 0.0], [TURN, 1.0], [whole, False])
    if part and not whole:
        with pytest.raises(InvalidInputError):
            merging._place(region, region_of(region.lower, region.upper, [part, False]), 1)
    else:
        assert merging._place(region, region_of(region.lower, region.upper, [part, False]), 1)[0].tolist() == [0, 0]


def test_parts_of_slices_are_slices():
    region = region_of([0.0, 0.5], [1.0, 0.5])
    lower, size = merging._place(region, region_of([0.5, 0.5], [1.0, 0.5]), 1)
    assert (lower.tolist(), size.tolist()) == ([WHOLE // 2, 0], [WHOLE // 2, WHOLE])


# Trees.


def tree_of(rng, n, cuts, boxes):
    """Cells halved at random, their leaves with numbers of boxes, of which there are so many."""
    tree = CellTree.whole(n)
    for _ in range(cuts):
        tree.split(rng.permutation(tree.leaves())[:1], rng.integers(0, n, 1))
    leaves = tree.leaves()
    tree.status[leaves] = rng.integers(0, 5, len(leaves))
    tree.box[leaves] = rng.integers(-1, boxes, len(leaves))
    return tree


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("seed", range(5))
def test_parts_are_put_where_they_are_parts(n, seed):
    """Each cell of a part is that of the whole which its number leads to, with its status, its halves and its box."""
    rng = np.random.default_rng([n, seed])
    region = region_of(np.arange(n) - 1.0, np.arange(n) + 3.0)
    shape = tree_of(rng, n, seed * 2, 0)
    parts = []
    for leaf in rng.permutation(shape.leaves()):
        corners = region.position(shape.lower[leaf]), region.position(shape.lower[leaf] + shape.size[leaf])
        parts.append(part_of(region_of(*corners), tree_of(rng, n, 4, 3), 3))
    tree, places = grafted(region, parts)
    assert sum(len(part.tree.child) - 1 for part in parts) + len(shape.child) == len(tree.child)
    assert tree.share(tree.leaves()) == 1.0
    for k, (part, place) in enumerate(zip(parts, places, strict=True)):
        theirs, cells = part.tree, np.arange(len(part.tree.child))
        ours = place.of(cells)
        corners = [part.region.position(corner) for corner in (theirs.lower, theirs.lower + theirs.size)]
        np.testing.assert_array_equal(region.position(tree.lower[ours]), corners[0])
        np.testing.assert_array_equal(region.position(tree.lower[ours] + tree.size[ours]), corners[1])
        np.testing.assert_array_equal(tree.status[ours], theirs.status)
        np.testing.assert_array_equal(tree.cut[ours], theirs.cut)
        np.testing.assert_array_equal(tree.box[ours], np.where(theirs.box >= 0, theirs.box + 3 * k, -1))
        split = theirs.child >= 0
        np.testing.assert_array_equal(tree.child[ours][split], place.of(theirs.child[split]))
        assert np.all(tree.child[ours][~split] == -1)


def test_the_first_cell_has_its_own_number():
    assert CellOffset(5, 7).of(np.array([0, 1, 4])).tolist() == [5, 8, 11]


def quarters(*which):
    corners = {(i, j): ([i, 1.0 + j], [i + 1.0, 2.0 + j]) for i in (0, 1) for j in (0, 1)}
    return [part_of(region_of(*corners[at])) for at in which]


def test_gaps_and_overlaps_are_refused():
    """And named."""
    region = region_of([0.0, 1.0], [2.0, 3.0])
    with pytest.raises(InvalidInputError, match=r"no part covers the region from \[1.0, 2.0\] to \[2.0, 3.0\]"):
        grafted(region, quarters((0, 0), (1, 0), (0, 1)))
    for order in ([0, 1], [1, 0]):
        parts = quarters((0, 0), (1, 0), (0, 1), (1, 1), (0, 1))
        parts[0], parts[1] = parts[order[0]], parts[order[1]]
        with pytest.raises(InvalidInputError, match=r"^parts 3 and 5 overlap"):
            grafted(region, parts)
    inner = part_of(region_of([1.5, 2.0], [2.0, 3.0]))
    for parts, told in (
        ([*quarters((0, 0), (1, 0), (0, 1), (1, 1)), inner], "parts 4 and 5"),
        ([inner, *quarters((0, 0), (1, 0), (0, 1), (1, 1))], "parts 1 and 5"),
    ):
        with pytest.raises(InvalidInputError, match=rf"^{told} overlap"):
            grafted(region, parts)


def test_a_pinwheel_is_not_got_by_halving():
    """In space: three bars round a corner, such that each plane through the middle cuts one of them."""
    half = ([0, 0, 1], [2, 1, 2]), ([1, 0, 0], [2, 2, 1]), ([0, 1, 0], [1, 2, 2])
    rest = ([0, 0, 0], [1, 1, 1]), ([1, 1, 1], [2, 2, 2])
    parts = [part_of(region_of(*corners)) for corners in (*half, *rest)]
    with pytest.raises(InvalidInputError, match=r"^parts 1, 2, 3, 4, 5 are not got"):
        grafted(region_of(np.zeros(3), np.full(3, 2.0)), parts)


def test_cells_of_a_part_may_be_too_small_for_the_whole():
    """Of two, one has an edge of one unit, which the whole cannot halve."""
    small = CellTree.whole(1)
    small.put(0, Cells(*(np.repeat(array, 2, axis=0) for array in small.cells)))
    small.size[1] = 1
    regions = region_of(0.0, 1.0), region_of(1.0, 2.0)
    for first in (True, False):
        parts = [part_of(regions[0], small if first else None), part_of(regions[1], None if first else small)]
        with pytest.raises(InvalidInputError, match=f"part {1 if first else 2} has cells too small"):
            grafted(region_of(0.0, 2.0), parts)
    small.size[1] = 2
    assert grafted(region_of(0.0, 2.0), [part_of(regions[0], small), part_of(regions[1])])[0].size.min() == 1
