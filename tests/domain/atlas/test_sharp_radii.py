"""How large a square an atlas certifies, about a seed and any point, and what one box certifies: by brute force."""

from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.covering.cells import CellStatus, CellTree, Growing
from ccpin.covering.region import Region
from ccpin.domain.atlas import radius_map, square
from ccpin.domain.atlas.cover import AtlasBuilder, SquareNorm
from ccpin.domain.atlas.radius_map import certified_radius, without_sigma
from ccpin.errors import InvalidInputError
from ccpin.proof.cell_tree import WHOLE
from ccpin.proof.newton import Boxes
from ccpin.proof.rounding import SLACK

CERTIFIED, UNDECIDED, UNREACHED = CellStatus.CERTIFIED, CellStatus.UNDECIDED, CellStatus.UNREACHED


def some_tree(rng, n, splits, share=0.8, held=()):
    """A tree whose leaves are certified or not, each of those in its own box."""
    tree = CellTree.whole(n)
    for _ in range(splits):
        leaves = tree.leaves()
        tree.split(rng.choice(leaves, 1), np.array([int(rng.choice(np.setdiff1d(np.arange(n), held)))]))
    leaves = tree.leaves()
    good = rng.random(len(leaves)) < share
    tree.status[leaves] = np.where(good, CERTIFIED, rng.choice([UNDECIDED, UNREACHED], len(leaves)))
    tree.box[leaves[good]] = rng.permutation(np.count_nonzero(good))
    return tree


def corners(tree, region, cells):
    lower, size = tree.lower[cells] / WHOLE, tree.size[cells] / WHOLE
    return region.lower + lower * region.width, region.lower + (lower + size) * region.width


def gaps(region, q, lower, upper):
    """By how much q is outside of [lower, upper] in each coordinate, the short way round."""
    found = np.full(len(q), np.inf)
    for turn in (-1.0, 0.0, 1.0):
        moved = q + turn * region.width * region.wrapped
        found = np.minimum(found, np.maximum(np.maximum(lower - moved, moved - upper), 0.0))
    return found


def edge(region, q):
    """To the nearest end of the region, of those coordinates that are not held; half a turn where it closes."""
    ends = np.where(region.wrapped, 0.5 * region.width, np.minimum(q - region.lower, region.upper - q))
    return np.where(region.held, np.inf, ends)


REGIONS = (
    Region(np.array([1.0, -2.0]), np.array([3.0, 4.0]), np.array([False, False])),
    Region(np.array([1.0, -2.0]), np.array([1.0 + 2 * np.pi, 4.0]), np.array([True, False])),
    Region(np.array([1.0, -2.0]), np.array([1.0 + 2 * np.pi, -2.0]), np.array([True, False])),
    Region(np.array([1.0, -2.0, 0.5]), np.array([3.0, -2.0 + 2 * np.pi, 0.5]), np.array([False, True, False])),
)


def atlas_of(rng, region, share=0.8, one_function=1.0):
    """What `certified_radius` asks of an atlas."""
    tree = some_tree(rng, len(region.lower), 30, share, np.flatnonzero(region.held))
    one = rng.random(np.count_nonzero(tree.box >= 0)) < one_function

    def contains(points):
        cells = tree.locate(region.cell_coordinates(points))
        box = np.where(cells >= 0, tree.box[cells], -1)
        return (box >= 0) & np.where(box >= 0, one[box], False)

    return SimpleNamespace(
        tree=tree, region=region, names=tuple("abc"[: len(region.lower)]), contains=contains, one_function=one
    )


@pytest.mark.parametrize("region", REGIONS, ids=["plain", "seam", "slice", "space"])
@pytest.mark.parametrize("one_function", [1.0, 0.9])
@pytest.mark.parametrize("chunk", [7, 1_000_000])
def test_radii_at_points(monkeypatch, region, one_function, chunk):
    """To the nearest cell without σ, or the region's end; 0 where there is none; short of it by 1e-12."""
    monkeypatch.setattr(radius_map, "instance", lambda atlas, *_: atlas)
    monkeypatch.setattr(radius_map, "_CHUNK", chunk)
    rng = np.random.default_rng(2)
    for share in (0.8, 1.0):
        atlas = atlas_of(rng, region, share, one_function)
        tree, points = atlas.tree, rng.uniform(region.lower, region.upper, (60, len(region.lower)))
        leaves, inside = tree.leaves(), atlas.contains(points)
        good = (tree.box[leaves] >= 0) & np.append(atlas.one_function, False)[tree.box[leaves]]
        assert sorted(without_sigma(atlas)) == sorted(leaves[~good])
        ends = [corners(tree, region, np.array([cell])) for cell in leaves[~good]]
        found = certified_radius(atlas, points + 2 * np.pi * region.wrapped)
        for q, radius, certified in zip(points, found, inside, strict=True):
            reach = min([edge(region, q).min(), *(gaps(region, q, a[0], b[0]).max() for a, b in ends)])
            assert radius == pytest.approx(reach if certified else 0.0, rel=1e-9, abs=1e-13)
        assert np.any(found > 0.0)
    plain = SimpleNamespace(**vars(atlas))
    whole = certified_radius(
        SimpleNamespace(**{**vars(plain), **lone(region)}), region.lower[None] + 0.25 * region.width
    )
    known = edge(region, region.lower + 0.25 * region.width).min()
    assert known * (1 - 1.04e-12) < whole[0] < known * (1 - 0.96e-12)


def lone(region):
    """A tree of one certified cell."""
    tree = CellTree.whole(len(region.lower))
    tree.status[0], tree.box[0] = CERTIFIED, 0
    return {"tree": tree, "one_function": np.array([True]), "contains": lambda points: np.ones(len(points), dtype=bool)}


@pytest.mark.parametrize("q", [np.zeros((1, 2, 1)), np.zeros((1, 3)), np.zeros((1, 1)), np.zeros((2, 2, 2))])
def test_points_that_are_none_have_no_radius(monkeypatch, q):
    monkeypatch.setattr(radius_map, "instance", lambda atlas, *_: atlas)
    with pytest.raises(InvalidInputError, match="2 finite columns"):
        certified_radius(atlas_of(np.random.default_rng(0), REGIONS[0]), q)


def test_cells_within_are_not_looked_at():
    """But all that touch one with σ, by a corner too, and all at the region's end."""
    tree = CellTree.whole(2)
    for _ in range(4):
        for axis in (0, 1):
            tree.split(tree.leaves(), np.full(len(tree.leaves()), axis))
    leaves = tree.leaves()
    places = tree.lower[leaves] * 16 // WHOLE
    known = np.all((places >= 5) & (places < 7), axis=1)
    tree.status[leaves], tree.box[leaves[known]] = np.where(known, CERTIFIED, UNDECIDED), np.arange(4)
    atlas = SimpleNamespace(tree=tree, one_function=np.ones(4, dtype=bool))
    bordering = {tuple(place) for place in (tree.lower[radius_map._bordering(atlas)] * 16 // WHOLE).tolist()}
    wall = {(a, b) for a in range(16) for b in range(16) if not (0 < a < 15 and 0 < b < 15)}
    ring = {(a, b) for a in range(4, 8) for b in range(4, 8)} - {tuple(p) for p in places[known].tolist()}
    assert bordering == wall | ring


# About the seed


def builder_of(rng, region, shape, q0, share=0.9):
    made = object.__new__(AtlasBuilder)
    made.region, made.shape, made.q0 = region, shape, q0
    made.tree = some_tree(rng, len(region.lower), 30, share, np.flatnonzero(region.held))
    count = np.count_nonzero(made.tree.box >= 0)
    one = np.ones((count, 1, 1))
    made.proved = Growing(Boxes(one[:, 0], one[:, 0], one, one, one, one[:, 0], one[:, 0], np.arange(float(count))))
    return made


SHAPES = (
    SquareNorm(np.ones(2)),
    SquareNorm(np.array([2.0, 0.5])),
    SquareNorm(np.array([2.0, 0.5]), True),
    SquareNorm(np.array([0.0, 3.0])),
)


@pytest.mark.parametrize("shape", SHAPES, ids=["square", "oblong", "ellipse", "strip"])
@pytest.mark.parametrize("region", REGIONS[:2], ids=["plain", "seam"])
def test_the_radius_about_the_seed(shape, region):
    """To the nearest cell that is not certified, to the farther cell of the nearest unglued face, or to the end."""
    rng = np.random.default_rng(3)

    def size(gap):
        return np.linalg.norm(gap * shape.weights) if shape.round else np.max(gap * shape.weights)

    for _ in range(12):
        q0 = rng.uniform(region.lower, region.upper)
        builder = builder_of(rng, region, shape, q0, rng.choice([0.97, 1.0]))
        tree, leaves = builder.tree, builder.tree.leaves()
        lower, upper = corners(tree, region, leaves)
        np.testing.assert_allclose(builder.edges(leaves), (lower, upper), rtol=1e-14)
        away = np.array([size(gaps(region, q0, a, b)) for a, b in zip(lower, upper, strict=True)])
        np.testing.assert_allclose(builder.distance(leaves), away, rtol=1e-12, atol=1e-13)
        ends = edge(region, q0) * shape.weights
        end = ends[shape.weights > 0.0].min()
        assert builder._edge() == pytest.approx(end, rel=1e-14)
        other = away[tree.status[leaves] != CERTIFIED].min(initial=np.inf)
        by_box = {int(tree.box[cell]): away[k] for k, cell in enumerate(leaves) if tree.box[cell] >= 0}
        for count in (0, 1, 3):
            unglued = rng.choice(len(by_box), (count, 2))
            torn = min((max(by_box[a], by_box[b]) for a, b in unglued.tolist()), default=np.inf)
            expected = min(end, other, torn)
            found = builder.radius(unglued)
            assert found == pytest.approx(expected, rel=1e-11, abs=1e-13)
            assert found <= expected * (1 - 0.9e-12) + 1e-15 or expected == 0.0


def test_a_radius_is_short_by_a_little():
    region = REGIONS[0]
    builder = builder_of(np.random.default_rng(0), region, SHAPES[0], region.lower + 0.5, 1.0)
    found = builder.radius(np.zeros((0, 2), dtype=int))
    assert 0.5 * (1 - 1.04e-12) < found < 0.5 * (1 - 0.96e-12)
    outside = builder_of(np.random.default_rng(0), region, SHAPES[0], region.lower - 0.5, 1.0)
    assert outside.radius(np.zeros((0, 2), dtype=int)) == 0.0


def test_held_coordinates_have_no_edge():
    builder = builder_of(np.random.default_rng(0), REGIONS[3], SquareNorm(np.ones(3)), np.array([1.5, 0.0, 0.5]), 1.0)
    assert builder._edge() == 0.5


def test_half_a_turn_is_the_edge_of_what_closes_on_itself():
    region = Region(np.array([1.0, -200.0]), np.array([1.0 + 2 * np.pi, 200.0]), np.array([True, False]))
    builder = builder_of(np.random.default_rng(0), region, SHAPES[0], np.array([1.5, 0.0]), 1.0)
    assert builder._edge() == pytest.approx(np.pi, rel=1e-14)


@pytest.mark.parametrize("first", [0, 1, 2])
def test_boxes_that_the_kernel_refuses_are_forgotten(first):
    """Their cells are undecided; the others keep theirs, numbered anew."""
    builder = builder_of(np.random.default_rng(1), REGIONS[0], SHAPES[0], np.zeros(2), 0.8)
    tree, before, status = builder.tree, builder.tree.box.copy(), builder.tree.status.copy()
    count = int(before.max()) + 1
    proved = np.arange(count) % 3 != first
    builder.keep(proved)
    assert builder.boxes.kappa.tolist() == np.flatnonzero(proved).tolist()
    for cell in tree.leaves():
        if before[cell] >= 0 and proved[before[cell]]:
            assert builder.boxes.kappa[tree.box[cell]] == before[cell]
            assert tree.status[cell] == CERTIFIED
        else:
            assert tree.box[cell] == -1
            assert tree.status[cell] == (UNDECIDED if before[cell] >= 0 else status[cell])


# In one box


class Known:
    """Bounds whose contraction and curvature are known, row by row."""

    def __init__(self, kappa, omega):
        self.kappa, self.omega, self.asked = np.array(kappa), np.array(omega), []

    def contraction(self, reach):
        self.asked.append(reach)
        return SimpleNamespace(of=lambda w: self.kappa * w)

    def curvature(self, reach, weight):
        self.asked.append(reach)
        return self.omega * weight


def newton_bound(monkeypatch, kappa, omega, radius, weight, accuracy, modes=((1.0, 0.0), (0.0, 1.0))):
    bounds = Known([kappa], [omega])
    monkeypatch.setattr(square, "bounds_of", lambda problem, boxes: bounds)
    boxes = SimpleNamespace(radius=np.array([radius]), weight=np.array([weight]), modes=np.array([modes]))
    return square.newton_bound(None, boxes, accuracy)[0], bounds.asked


def by_hand(kappa, omega, start, target):
    """Steps of e ← c e² from the largest error until it is small enough."""
    c, e, steps = max(omega) * SLACK / (2.0 * (1.0 - max(kappa) * SLACK)), start, 0
    while e > target:
        e, steps = c * e * e, steps + 1
    return steps


@pytest.mark.parametrize("kappa", [(0.5, 0.25), (0.25, 0.75), (0.0, 0.0), (0.9, 0.1)])
@pytest.mark.parametrize("omega", [(0.5, 1.0), (0.25, 0.03125), (1.9, 0.1)])
@pytest.mark.parametrize("accuracy", [1e-12, 1e-3, 0.3, 5.0])
def test_steps_of_newtons_method(monkeypatch, kappa, omega, accuracy):
    """From e₀ = max R/w, on a tube wider by that; the error is counted in the dependent coordinates."""
    for radius, weight in (((0.25, 0.125), (1.0, 1.0)), ((0.25, 0.5), (0.5, 2.0)), ((0.03125, 0.25), (1.0, 0.5))):
        start = max(r / w for r, w in zip(radius, weight, strict=True))
        for modes in (((1.0, 0.0), (0.0, 1.0)), ((1.0, -3.0), (0.5, 0.0))):
            unit = max(abs(row[0]) * weight[0] + abs(row[1]) * weight[1] for row in modes)
            found, asked = newton_bound(monkeypatch, kappa, omega, radius, weight, accuracy, modes)
            c = max(omega) / (2.0 * (1.0 - max(kappa)))
            if c * start < 1.0:
                assert found == by_hand(kappa, omega, start, min(accuracy / unit, start))
            else:
                assert found == np.inf
            np.testing.assert_allclose(asked, [[np.array(radius) + start * np.array(weight)]] * 2, rtol=1e-15)


def test_where_newtons_method_is_not_sure(monkeypatch):
    """κ₂ < 1 and c e₀ < 1, with their rounding; where nothing bends one step is enough."""
    one = (0.25, 0.25), (1.0, 1.0)
    for kappa, sure in ((1.0 - 2e-10, True), (1.0 - 0.5e-10, False), (1.0, False), (1.5, False), (np.nan, False)):
        assert (newton_bound(monkeypatch, (kappa, 0.0), (1e-12, 1e-12), *one, 0.125)[0] < np.inf) == sure
    for omega, sure in ((4.0 * (1 - 1e-6), True), (4.0 * (1 + 1e-6), False), (7.0, False)):
        assert (newton_bound(monkeypatch, (0.5, 0.0), (omega, 0.0), *one, 1e-3)[0] < np.inf) == sure
    assert newton_bound(monkeypatch, (0.5, 0.0), (0.0, 0.0), *one, 1e-3)[0] == 1.0


@pytest.mark.parametrize("limit", [0.0, 1e-8, 0.0123, 1.0, 7.7, 99.0])
def test_the_largest_square_was_proved(monkeypatch, limit):
    """It is one of those tried, and as near to the limit as they are."""
    tried = set()

    def squares(problem, theta, widths):
        tried.update(widths.tolist())
        return SimpleNamespace(proved=widths <= limit)

    monkeypatch.setattr(square, "_squares", squares)
    found = square.largest_square(None, None)
    if limit < 1e-9:
        assert found == 0.0
    else:
        assert found in tried
        assert limit * (1 - 1e-3) < found <= limit or (found > 9.0 and limit > 10.0)


def test_a_square_that_is_proved_beyond_one_that_is_not_counts(monkeypatch):
    monkeypatch.setattr(
        square,
        "_squares",
        lambda problem, theta, widths: SimpleNamespace(proved=(widths <= 0.1) | (abs(widths - 0.5) < 0.2)),
    )
    found = square.largest_square(None, None)
    assert 0.6 < found <= 0.7


def test_squares_are_those_that_the_kernel_proves(monkeypatch):
    """Of those that were found one by one, in their order; each is about θ, with its own half width each way."""
    asked = []

    def certify(problem, centre, half, across):
        asked.append((centre.tolist(), half.tolist(), across.tolist()))
        return square.Tried(np.array([10, 11, 12, 13, 14]), np.array([True, False, True, True, False]))

    monkeypatch.setattr(square, "certify_boxes", certify)
    monkeypatch.setattr(square, "proved_boxes", lambda problem, boxes: (None, boxes != 12))
    problem = SimpleNamespace(system=SimpleNamespace(n=2))
    widths = np.array([0.1, 0.2, 0.3, 0.4, 0.5])
    found = square._squares(problem, np.array([1.0, 2.0, 3.0]), widths)
    assert found.proved.tolist() == [True, False, False, True, False]
    assert asked == [(5 * [[1.0, 2.0, 3.0]], [[w, w] for w in widths.tolist()], [[1.0, 0.0], [0.0, 1.0]])]
