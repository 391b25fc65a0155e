"""What an atlas says beside what the kernel proved: of points, of boxes, of its whole region, and of parts merged."""

from collections import namedtuple
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

import ccpin
from ccpin.covering.cells import CellStatus, CellTree, SingularCells
from ccpin.covering.region import Region
from ccpin.domain import certify
from ccpin.domain.atlas import atlas as module
from ccpin.domain.atlas import cover_claims, merged
from ccpin.domain.atlas.atlas import Atlas
from ccpin.errors import InvalidInputError
from ccpin.proof.newton import Boxes

CERTIFIED, UNDECIDED, EMPTY = CellStatus.CERTIFIED, CellStatus.UNDECIDED, CellStatus.EMPTY
READING = namedtuple("READING", "problem configuration")
SOLUTION = namedtuple("SOLUTION", "theta")
PROBLEM = SimpleNamespace(
    system=SimpleNamespace(independent=np.array([1]), dependent=np.array([0]), periodic=np.zeros(2, bool), n=1, m=1),
    requirements=None,
)


def boxes_at(centre, half):
    """Boxes about q, the second coordinate."""
    count = len(centre)
    one, row = np.ones((count, 1, 1)), np.ones((count, 1))
    centre = np.column_stack([np.full(count, 9.0), centre])
    return Boxes(
        centre, np.reshape(half, (count, 1)).astype(float), np.ones((count, 2, 1)), one, one, row, row, np.zeros(count)
    )


def atlas_of(monkeypatch, statuses, box, boxes=(), unglued=(), proved=None, source=None, turn=False, whole=False):
    """An atlas over [0, 4] in four cells, or in one."""
    tree = CellTree.whole(1)
    if not whole:
        tree.split(np.array([0]), np.array([0]))
        tree.split(np.array([1, 2]), np.array([0, 0]))
    cells = tree.leaves()
    tree.status[cells], tree.box[cells] = statuses, box
    monkeypatch.setattr(module, "boxes_of", lambda solutions: solutions)
    return Atlas(
        names=("q",),
        q0=np.array([0.5]),
        radius=0.0,
        solutions=boxes_at(*boxes) if boxes else boxes_at([], []),
        proved=proved,
        complete=True,
        region=Region(np.zeros(1), np.full(1, 4.0), np.array([turn])),
        reading=READING(PROBLEM, lambda theta: theta),
        tree=tree,
        seed=np.array([9.0, 0.5]),
        singular=SingularCells.none(2),
        source=source,
        told=np.reshape(unglued, (-1, 2)).astype(int),
    )


FOUR = ([0.5, 1.5, 2.5], [0.5, 0.5, 1.0])


def test_what_is_certified_is_of_cells_whose_box_is_of_one_function(monkeypatch):
    """Outside of the region nothing is."""
    statuses, box = (CERTIFIED, CERTIFIED, UNDECIDED, CERTIFIED), (0, 2, -1, 1)
    atlas = atlas_of(monkeypatch, statuses, box, FOUR)
    points = np.array([[0.5], [1.5], [2.5], [3.5], [4.5], [-0.5]])
    assert atlas.contains(points).tolist() == [True, True, False, True, False, False]
    assert [atlas.contains(q) for q in points] == [True, True, False, True, False, False]
    assert atlas.status(points).tolist() == [CERTIFIED, CERTIFIED, UNDECIDED, CERTIFIED, -1, -1]
    torn = atlas_of(monkeypatch, statuses, box, FOUR, unglued=[(0, 1)])
    monkeypatch.setattr(module, "seams_of", lambda *_: SimpleNamespace(first=np.array([0]), second=np.array([2])))
    assert torn.one_function.tolist() == [True, False, True]
    assert torn.contains(points).tolist() == [True, True, False, False, False, False]
    empty = atlas_of(monkeypatch, (EMPTY,) * 4, (-1,) * 4)
    assert not np.any(empty.contains(points))
    assert empty.one_function.tolist() == []
    whole = atlas_of(monkeypatch, (CERTIFIED,), (0,), ([2.0], [2.0]), whole=True)
    assert whole.contains(points).tolist() == [True, True, True, True, False, False]
    assert whole.status(points).tolist() == [CERTIFIED] * 4 + [-1, -1]


def cover_of(faces, unglued, start):
    """What the kernel found of boxes."""
    found = {"faces": np.reshape(faces, (-1, 2)).astype(int), "unglued": np.reshape(unglued, (-1, 2)).astype(int)}
    return SimpleNamespace(
        cover=SimpleNamespace(found=found, claim=SimpleNamespace(start=np.array([start]))), demanded=None
    )


@pytest.mark.parametrize(
    ("faces", "unglued", "start", "one"),
    [
        ([(0, 1), (1, 2)], [], 0, [True, True, True]), ([(0, 1)], [], 0, [True, True, False]),
        ([(0, 1)], [], 2, [False, False, True]), ([(0, 1), (1, 2)], [], -1, [False] * 3),
        ([(0, 1), (1, 2)], [(1, 2)], 0, [True, True, False]), ([(0, 1), (1, 2)], [(0, 1)], 0, [True, False, False]),
    ],
)  # fmt: skip
def test_one_function_is_what_proved_ways_join_to_the_seed(monkeypatch, faces, unglued, start, one):
    """Where every shared face is glued too: boxes may share none."""
    proved = cover_of(faces, unglued, start)
    monkeypatch.setattr(module, "is_fact", lambda fact, kind: fact is proved.cover and kind is module.RegionCover)
    atlas = atlas_of(monkeypatch, (CERTIFIED, CERTIFIED, UNDECIDED, CERTIFIED), (0, 1, -1, 2), FOUR, proved=proved)
    assert atlas.one_function.tolist() == one
    assert atlas.contains([[0.5], [1.5], [2.5], [3.5]]).tolist() == [one[0], one[1], False, one[2]]


def test_cells_that_are_certified_name_each_box_once(rpdr):
    """As a search leaves them, which begins at the seed."""
    several = certify(rpdr, [-1.57, -1.57], ([-2.0, -2.0], [-1.0, -1.0]), max_depth=4)
    assert len(several.boxes.kappa) > 4
    for atlas in (part(-0.5, 0.5), several):
        box = atlas.tree.box[atlas.tree.leaves(CERTIFIED)]
        assert sorted(box.tolist()) == list(range(len(atlas.boxes.kappa)))
        assert np.all(atlas.tree.box[atlas.tree.leaves(UNDECIDED, EMPTY)] == -1)
        assert atlas.certified_fraction == 1.0
        assert atlas.one_function.all()


def test_an_atlas_whose_seed_is_not_proved_to_be_in_its_box_has_no_radius(monkeypatch):
    assert part(-0.5, 0.5).radius > 0.4
    monkeypatch.setattr(cover_claims, "_started", lambda *_: (-1, ()))
    lost = certify(ccpin.load("slider_crank"), [0.0], ([-0.5], [0.5]), max_depth=3)
    assert (lost.radius, lost.verdict, lost.contains([0.0])) == (0.0, "undecided", False)


def test_a_point_is_certified_where_all_cells_are_that_it_may_be_in(monkeypatch):
    """Turned into the region it may be in either of two by rounding."""
    for box, known in (((0, 1, 2, 0), True), ((0, -1, 2, 0), False), ((-1, 1, 2, 0), False)):
        statuses = [CERTIFIED if number >= 0 else UNDECIDED for number in box]
        atlas = atlas_of(monkeypatch, statuses, box, FOUR, turn=True)
        assert atlas.contains([5.0]) is known
        assert atlas.contains([5.5]) is (box[1] >= 0)


@pytest.mark.parametrize("q", [np.zeros((1, 1, 1)), [[0.5, 0.5]], [np.nan], [[0.5], [np.inf]], []])
def test_points_that_are_none_are_refused(monkeypatch, q):
    atlas = atlas_of(monkeypatch, (CERTIFIED,) * 4, (0, 1, 2, 2), FOUR)
    with pytest.raises(InvalidInputError, match="1 finite columns"):
        atlas.contains(q)


def test_sigma_is_asked_of_the_cells_box(monkeypatch):
    """At the point turned into the region; told over the point itself; of points that are not certified none is."""
    asked = []

    def solve(problem, boxes, delta):
        asked.append((boxes.centre[:, 1] + delta[:, 0]).tolist())
        return SOLUTION(boxes.centre + 0.25)

    monkeypatch.setattr(module, "solve_in_boxes", solve)
    monkeypatch.setattr(module, "newton", lambda problem, theta, steps: SOLUTION(theta + 0.25))
    atlas = atlas_of(monkeypatch, (CERTIFIED, CERTIFIED, UNDECIDED, CERTIFIED), (0, 2, -1, 1), FOUR, turn=True)
    assert atlas.sigma([[8.25], [1.75], [3.5]]).tolist() == [[9.5, 8.25], [9.5, 1.75], [9.5, 3.5]]
    assert asked == [[0.25, 1.75, 3.5]]
    assert atlas.sigma([0.25]).tolist() == [9.5, 0.25]
    for q, first in (([2.5], 2.5), ([[0.5], [2.5]], 2.5), ([[2.75], [2.5]], 2.75)):
        with pytest.raises(InvalidInputError, match=rf"q = \[{first}\] is not"):
            atlas.sigma(q)


def test_corners_of_boxes(monkeypatch):
    atlas = atlas_of(monkeypatch, (CERTIFIED,) * 4, (0, 1, 2, 2), FOUR)
    assert atlas.lower.tolist() == [[0.0], [1.0], [1.5]]
    assert atlas.upper.tolist() == [[1.0], [2.0], [3.5]]


@pytest.mark.parametrize("checked", [(True, True), (True, False), (False, True)])
def test_boxes_are_verified_for_all_that_was_asked(monkeypatch, checked):
    monkeypatch.setattr(module, "closures_of", lambda problem: None)
    monkeypatch.setattr(module, "check", lambda closures, boxes: SimpleNamespace(proved=np.array([checked[0], True])))
    monkeypatch.setattr(module, "meets", lambda problem, boxes: np.array([checked[1], True]))
    atlas = atlas_of(monkeypatch, (CERTIFIED,) * 4, (0, 1, 2, 2), FOUR)
    assert atlas.verify().tolist() == [all(checked), True]


@pytest.mark.parametrize(
    ("statuses", "unglued", "source", "verdict"),
    [
        ((CERTIFIED,) * 4, [], "file", "proven"), ((CERTIFIED,) * 4, [], None, "undecided"),
        ((CERTIFIED,) * 3 + (UNDECIDED,), [], "file", "undecided"), ((CERTIFIED,) * 4, [(0, 1)], "file", "undecided"),
    ],
)  # fmt: skip
def test_a_file_that_was_not_replayed_is_believed_whole_or_not(monkeypatch, statuses, unglued, source, verdict):
    monkeypatch.setattr(module, "refutation_of", lambda *_: None)
    monkeypatch.setattr(module, "demand_witnesses", lambda *_: iter(()))
    atlas = atlas_of(monkeypatch, statuses, (0, 1, 2, 2), FOUR, unglued, source=source)
    assert atlas.verdict == verdict


# Parts put together


@cache
def part(low, high):
    """A part of the slider-crank's turn."""
    mechanism = ccpin.load("slider_crank")
    return certify(mechanism, [0.5 * (low + high)], ([low], [high]), max_depth=3)


def test_parts_are_complete_where_all_are():
    parts = [part(-0.5, 0.5), part(0.5, 1.5)]
    whole = merged.merge_atlases(parts)
    assert (whole.complete, whole.verdict) == (True, "proven")
    assert whole.radius == pytest.approx(0.5, rel=1e-11)
    for k in range(2):
        some = list(parts)
        some[k] = replace(parts[k], complete=False)
        assert not merged.merge_atlases(some).complete


def test_parts_of_other_things_are_refused():
    first, other = part(-0.5, 0.5), part(0.5, 1.5)
    held = replace(other.region, lower=other.region.upper)
    moved = other.reading.system.offset + 1e-9
    system = replace(other.reading.system, offset=moved)
    elsewhere = other.reading._replace(problem=other.reading.problem._replace(system=system))
    for changed, told in (
        (replace(other, names=("another",)), "other closures"),
        (replace(other, reading=elsewhere), "other closures"),
        (replace(other, reading=other.reading.bounded("reach")), "other bounds="),
        (replace(other, region=held), "other coordinates"),
    ):
        with pytest.raises(InvalidInputError, match=told):
            merged._refuse_others(first, changed, 2)
    merged._refuse_others(first, other, 2)


def test_slices_of_other_coordinates_are_refused(monkeypatch):
    """One that is held in one part alone is enough."""
    two = SimpleNamespace(fingerprint=1, names=(), reading=None, region=SimpleNamespace(held=np.array([True, False])))
    other = SimpleNamespace(**{**vars(two), "region": SimpleNamespace(held=np.array([True, True]))})
    monkeypatch.setattr(merged, "same_reading", lambda one, other: True)
    with pytest.raises(InvalidInputError, match="other coordinates"):
        merged._refuse_others(two, other, 2)
