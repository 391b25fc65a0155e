"""What sheets say of points, shares and ways, over cells and boxes written down by hand; and whom they refuse."""

from collections import namedtuple
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

import ccpin
from ccpin.covering.cells import CellStatus, CellTree, SingularCells
from ccpin.covering.region import Region
from ccpin.domain import certify_sheets
from ccpin.domain.sheets import certifying, merged, sheet_claims
from ccpin.domain.sheets import sheets as module
from ccpin.domain.sheets.counting import Cover
from ccpin.domain.sheets.cover import Glued, Members
from ccpin.domain.sheets.sheets import SheetAtlas
from ccpin.errors import InvalidInputError
from ccpin.proof.narrowing import Candidates
from ccpin.proof.newton import Boxes

CERTIFIED, UNDECIDED, EMPTY, SINGULAR = (
    CellStatus.CERTIFIED, CellStatus.UNDECIDED, CellStatus.EMPTY, CellStatus.SINGULAR
)  # fmt: skip
PROBLEM = namedtuple("PROBLEM", "system phasors")
READING = namedtuple("READING", "problem")
SOLUTION = namedtuple("SOLUTION", "theta")


def boxes_at(centre, half):
    """Boxes about (q, 0), told apart by their q, of shape (K, n)."""
    centre, half = (np.atleast_2d(np.asarray(x, dtype=float).T).T for x in (centre, half))
    count, n = centre.shape
    one = np.ones((count, 1, 1))
    directions = np.tile(np.eye(n + 1, n), (count, 1, 1))
    return Boxes(
        np.column_stack([centre, np.zeros(count)]), half, directions, one, one, one[:, 0], one[:, 0], np.ones(count)
    )


def atlas_of(tree, boxes, members=(), pairs=(), count=None, turn=False, left=()):
    """Sheets over [0, 4]ⁿ."""
    n = tree.size.shape[1]
    system = SimpleNamespace(
        independent=np.arange(n), dependent=np.array([n]), periodic=np.zeros(n + 1, bool), n=n, m=1
    )
    cell, box = np.reshape(members, (-1, 2)).T.astype(int)
    first, second, at_first, at_second = np.reshape(pairs, (-1, 4)).T
    cells = np.array(left, dtype=int)
    centres = np.column_stack([np.arange(float(len(cells))), np.zeros((len(cells), n))])
    return SheetAtlas(
        names=tuple("abc"[:n]),
        region=Region(np.zeros(n), np.full(n, 4.0), np.full(n, turn)),
        reading=READING(PROBLEM(system, None)),
        tree=tree,
        boxes=boxes,
        members=Members(cell, box),
        glued=Glued(first.astype(int), second.astype(int), at_first[:, None], at_second[:, None]),
        count=np.full(len(tree.child), -1) if count is None else np.array(count),
        left=Candidates(cells, centres, 0.0 * centres, np.zeros((len(cells), 1, n))),
        ranges=None,
        complete=True,
        singular=SingularCells.none(n + 1),
    )


def quarters(*statuses):
    """[0, 4] in four cells, 3 to 6."""
    tree = CellTree.whole(1)
    tree.split(np.array([0]), np.array([0]))
    tree.split(np.array([1, 2]), np.array([0, 0]))
    tree.status[3:] = statuses
    return tree


NO_BOXES = boxes_at(np.zeros((0, 1)), np.zeros((0, 1)))


# What hangs together, and shares


def test_sheets_are_what_is_glued_the_largest_first(monkeypatch):
    """Layers are counted over certified cells; the sign is that of det φ_y."""
    boxes = boxes_at(np.arange(8.0), [0.5, 0.5, 0.75, 0.5, 1.0, 0.25, 0.25, 0.0625])
    members = [(3, 0), (3, 1), (3, 2), (4, 3), (4, 4), (6, 5), (6, 6), (5, 7)]
    pairs = [(0, 3, 0, 0), (3, 1, 0, 0), (2, 4, 0, 0), (5, 6, 0, 0)]
    atlas = atlas_of(quarters(CERTIFIED, CERTIFIED, CERTIFIED, SINGULAR), boxes, members, pairs)
    det = np.array([1.0, 1, -1, 1, -1, -1, -1, 1])
    slope = np.zeros((8, 1, 2))
    slope[:, 0, 1] = det
    monkeypatch.setattr(module, "closure_values", lambda problem, theta: (None, slope))
    assert atlas.sheet_of.tolist() == [1, 1, 0, 1, 0, 2, 2, 3]
    told = [(s.number, s.boxes.tolist(), s.layers, s.area, s.sign) for s in atlas.sheets]
    assert told == [
        (0, [2, 4], 1, 3.5, -1), (1, [0, 1, 3], 2, 3.0, 1), (2, [5, 6], 1, 1.0, -1), (3, [7], 1, 0.125, 1)
    ]  # fmt: skip


def test_areas_are_those_of_boxes():
    atlas = atlas_of(CellTree.whole(2), boxes_at([[0, 0], [1, 1]], [[0.5, 0.25], [1.0, 3.0]]))
    assert atlas._areas.tolist() == [0.5, 12.0]


def test_shares_of_the_region():
    """Counted where a number is known, 0 too; singular where it is not."""
    atlas = atlas_of(quarters(CERTIFIED, SINGULAR, SINGULAR, UNDECIDED), NO_BOXES, count=[-1, -1, -1, 2, 0, -1, -1])
    shares = atlas.counted_fraction, atlas.singular_fraction, atlas.undecided_fraction
    assert shares == (0.5, 0.25, 0.25)
    more = replace(atlas, count=np.array([-1, -1, -1, 2, 0, 2, -1]))
    assert (more.counted_fraction, more.singular_fraction, more.undecided_fraction) == (0.75, 0.0, 0.25)


# Points


def test_numbers_of_solutions_are_those_of_cells():
    whole = atlas_of(CellTree.whole(1), NO_BOXES, count=[2])
    assert whole.number_of_solutions([1.0]) == 2
    assert whole.number_of_solutions([4.5]) == -1
    parts = atlas_of(quarters(*4 * (CERTIFIED,)), NO_BOXES, count=[-1, -1, -1, 0, 2, -1, 4])
    assert parts.number_of_solutions([[0.5], [1.5], [2.5], [3.5], [4.5], [-0.5]]).tolist() == [0, 2, -1, 4, -1, -1]


@pytest.mark.parametrize("q", [np.zeros((1, 2, 1)), [[0.5, 0.5, 0.5]], [np.inf, 0.5], [0.5, np.nan], [0.5]])
def test_points_that_are_none_are_refused(q):
    atlas = atlas_of(CellTree.whole(2), boxes_at(np.zeros((0, 2)), np.zeros((0, 2))), count=[2])
    with pytest.raises(InvalidInputError, match="2 finite columns"):
        atlas.number_of_solutions(q)


def over(atlas, q, monkeypatch):
    """What is solved over q, with what is added to each box's centre for its solution."""
    asked = []

    def solve(problem, boxes, delta):
        asked.append(boxes.centre[:, :1] + delta)
        return SOLUTION(boxes.centre + [0.0, 0.5])

    monkeypatch.setattr(module, "solve_in_boxes", solve)
    monkeypatch.setattr(module, "newton", lambda problem, theta, steps: SOLUTION(theta + [0.0, 0.25]))
    return *atlas._over(q), asked[0]


def test_solutions_over_a_point_are_those_of_its_cells_boxes(monkeypatch):
    """At the point turned into the region; they are told over the point itself."""
    tree, boxes = quarters(CERTIFIED, UNDECIDED, EMPTY, CERTIFIED), boxes_at([0.25, 0.5, 0.75, 3.25], np.ones(4))
    atlas = atlas_of(tree, boxes, [(3, 0), (3, 2), (4, 1), (6, 3)], turn=True)
    theta, box, asked = over(atlas, [8.125], monkeypatch)
    assert theta.tolist() == [[8.125, 0.75], [8.125, 0.75]]
    assert (box.tolist(), asked.tolist()) == ([0, 2], [[0.125], [0.125]])
    assert over(atlas, [2.5], monkeypatch)[0].shape == (0, 2)
    whole = atlas_of(CellTree.whole(1), boxes, [(0, 3)])
    whole.tree.status[0] = CERTIFIED
    assert over(whole, [3.5], monkeypatch)[1].tolist() == [3]
    flat = replace(atlas, region=Region(np.zeros(1), np.full(1, 4.0), np.array([False])))
    for q in ([1.5], [[0.5], [3.5]], [4.5], [-0.5]):
        with pytest.raises(InvalidInputError, match="not one certified point"):
            over(flat, q, monkeypatch)


@cache
def crank():
    """The slider-crank, whose two assembly modes are mirror images."""
    return ccpin.load("slider_crank")


@cache
def sheets_over(low, high, depth=3):
    return certify_sheets(crank(), ([low], [high]), max_depth=depth)


def test_sigma_is_the_nearest():
    """To either of two configurations, however often it is turned."""
    atlas = sheets_over(0.0, 1.0)
    found = atlas.solutions([0.5])[0]
    assert len(found) == 2
    angle = int(np.flatnonzero(np.abs(found[0] - found[1]) > 1.0)[0])
    for one in found:
        near = one.copy()
        near[angle] += 2 * np.pi + 0.125
        np.testing.assert_allclose(np.exp(1j * (atlas.sigma([0.5], near) - one)), 1.0, rtol=0, atol=1e-12)


@pytest.mark.parametrize("turns", [0, 3])
def test_a_way_goes_through_faces_round_the_circle(monkeypatch, turns):
    """From one box over a cell to another one over it, once round; faces are told from either side."""
    pairs = [(0, 1, 1, 1), (2, 1, 2, 2), (2, 3, 3, 3), (4, 3, 0, 4)]
    boxes = boxes_at([0.5, 1.5, 2.5, 3.5, 0.75], np.ones(5))
    atlas = atlas_of(quarters(*4 * (CERTIFIED,)), boxes, pairs=pairs, turn=True)
    monkeypatch.setattr(SheetAtlas, "_over", lambda self, q: (None, np.array([4, 0])))
    way = atlas.way([4.0 * turns + 0.25], 1, 0)
    assert way[:, 0].tolist() == [0.25, 0.5, 1, 1.5, 2, 2.5, 3, 3.5, 4, 4.75, 4.25]
    back = atlas.way([4.0 * turns + 0.25], 0, 1)
    assert back[:, 0].tolist() == [0.25, 0.75, 0, -0.5, -1, -1.5, -2, -2.5, -3, -3.5, -3.75]


def test_cusps_are_looked_for_from_every_cell(monkeypatch):
    """One start a cell, a part of them at a time; those over the region are told."""
    atlas = atlas_of(CellTree.whole(2), boxes_at(np.zeros((0, 2)), np.zeros((0, 2))), left=[7, 5, 5, 9, 8, 7, 6])
    asked = []

    def proved(reading, starts):
        asked.append(starts[:, 0].tolist())
        return [SimpleNamespace(q=np.array([x, 1.0])) for x in starts[:, 0]]

    monkeypatch.setattr(module, "_PART", 2)
    monkeypatch.setattr(module, "proved_cusps", proved)
    monkeypatch.setattr(module, "distinct", lambda reading, cusps: cusps)
    found = atlas.cusps()
    assert asked == [[1.0, 6.0], [0.0, 4.0], [3.0]]
    assert [cusp.q[0] for cusp in found] == [1.0, 0.0, 4.0, 3.0]


# What a search comes to


def test_a_search_that_would_halve_too_far_is_refused(monkeypatch):
    monkeypatch.setattr(certifying, "_survey", lambda *_: "found")
    assert certify_sheets(crank(), max_depth=28) == "found"
    for depth in (29, 15_000):
        with pytest.raises(InvalidInputError, match=f"from 1 to 28; it is {depth}"):
            certify_sheets(crank(), max_depth=depth)


def test_a_search_goes_on_from_its_own_region_only():
    begun = sheets_over(0.0, 1.0)
    args = crank(), begun.region, begun.ranges
    assert certifying._begun(*args, begun).left is begun.left
    with pytest.raises(InvalidInputError, match="another region"):
        certifying._begun(*args, sheets_over(0.0, 0.5))
    with pytest.raises(InvalidInputError, match="other limits"):
        certifying._begun(*args, replace(begun, ranges=begun.ranges._replace(upper=begun.ranges.upper + 1e-9)))


@pytest.mark.parametrize(
    ("searched", "counted", "complete"), [(True, True, True), (False, True, False), (True, False, False)]
)
def test_a_search_is_complete_where_all_of_it_is(monkeypatch, searched, counted, complete):
    """And of what was not counted, nothing is said, whatever a search said before."""
    tree, begun = quarters(CERTIFIED, EMPTY, SINGULAR, UNDECIDED), sheets_over(0.0, 1.0)
    cover = Cover(tree, begun.left, searched)
    monkeypatch.setattr(certifying, "cover_singular", lambda *_: cover)
    asked = []

    def counted_parts(runner, tree, region, ranges, regular):
        asked.append(regular.tolist())
        if not counted:
            runner.flag.set()
        return sheet_claims.counted_parts(runner, tree, region, ranges, regular[:0])

    monkeypatch.setattr(certifying, "counted_parts", counted_parts)
    monkeypatch.setattr(certifying, "mark_in_cells", lambda *_: [])
    work, effort = certifying.Work(None, None, None, None), certifying.Effort(3, 10, None)
    found = certifying._survey(begun.reading, begun.names, begun.region, begun.ranges, effort, work, None)
    assert found.complete is complete
    assert asked == [np.setdiff1d([3, 4, 5, 6], begun.left.cell).tolist()]
    assert found.count.tolist() == [-1] * 7
    assert tree.status[3:].tolist() == [UNDECIDED] * 4


def test_what_is_counted_is_told_of_its_cells():
    """The crank has two modes at every angle, and none where its rod is too short for its limits."""
    atlas = sheets_over(0.0, 1.0)
    leaves = atlas.tree.leaves()
    assert atlas.count[leaves].tolist() == [2] * len(leaves)
    assert set(atlas.tree.status[leaves]) == {CERTIFIED}


def test_parts_are_counted_a_few_at_a_time(monkeypatch):
    """Each over the middle of its largest cell; those of which not all was proved are left out."""
    tree = CellTree.whole(1)
    for _ in range(5):
        tree.split(tree.leaves(), np.zeros(len(tree.leaves()), dtype=int))
    region, leaves = Region(np.zeros(1), np.full(1, 32.0), np.array([False])), tree.leaves()
    unions = [leaves[[k]] for k in range(0, 32, 2)] + [leaves[[31]]]
    monkeypatch.setattr(sheet_claims, "parts_of", lambda *_: unions)
    asked, excluded = [], SimpleNamespace(found={"empty": tree.child < 0})
    monkeypatch.setattr(sheet_claims, "excluded_over", lambda *_: excluded)

    def mapped(task, chunks):
        asked.append(len(chunks))
        return [boxes_at([[chunk[-1][0]]], [[0.0]]) for chunk in chunks]

    def counted_over(problem, excluded, cell, q, found):
        count = np.full(len(tree.child), -1)
        count[cell[q[:, 0] != 4.5]] = 1
        claim, theta = SimpleNamespace(point=np.arange(17)), np.concatenate([box.centre for box in found])
        premise = SimpleNamespace(claim=SimpleNamespace(centre=theta))
        own = np.arange(17) != 3
        return SimpleNamespace(premises=(excluded, premise), claim=claim, found={"count": count, "own": own})

    monkeypatch.setattr(sheet_claims, "counted_over", counted_over)
    runner = SimpleNamespace(
        map=mapped, check=lambda: None, problem=SimpleNamespace(system=SimpleNamespace(n=1, n_free=2))
    )
    parts, _ = sheet_claims.counted_parts(runner, tree, region, (1, 2, 3, 4), leaves)
    assert asked == [8, 8, 1]
    kept = [union for union in unions if union[0] != leaves[4]]
    assert [part.counted for part in parts] == [union[0] for union in kept]
    middles = [[list(leaves).index(union[0]) + 0.5] for union in kept]
    assert [part.theta[:, 0].tolist() for part in parts] == [middle if middle != [6.5] else [] for middle in middles]


# What is proved


def test_leaves_are_called_no_more_than_is_proved():
    """All in boxes where that is a fact, empty where none is the number; others are undecided, and that is told."""
    for complete, count, after, told in (
        ((1, 1), (0, 0), (CERTIFIED, CERTIFIED, EMPTY, EMPTY), False),
        ((1, 0), (0, 0), (CERTIFIED, UNDECIDED, EMPTY, EMPTY), True),
        ((0, 0), (0, 0), (UNDECIDED, UNDECIDED, EMPTY, EMPTY), True),
        ((1, 1), (2, 0), (CERTIFIED, CERTIFIED, UNDECIDED, EMPTY), True),
        ((1, 1), (0, -1), (CERTIFIED, CERTIFIED, EMPTY, UNDECIDED), True),
        ((0, 1), (1, 0), (UNDECIDED, CERTIFIED, UNDECIDED, EMPTY), True),
    ):
        tree = quarters(CERTIFIED, CERTIFIED, EMPTY, EMPTY)
        found = {"complete": np.array([0, 0, 0, *complete, 0, 0], bool)}
        proved = SimpleNamespace(cells=SimpleNamespace(found=found), count=np.array([-1, -1, -1, 2, 2, *count]))
        assert sheet_claims.mark(tree, proved) is told
        assert tree.status[3:].tolist() == list(after)
    assert sheet_claims.mark(quarters(SINGULAR, UNDECIDED, SINGULAR, UNDECIDED), proved) is False


def proved_of(tree, boxes, members, pairs, count, limits):
    """Facts that say so of boxes over q (K, 1) in [0, 4]; of pairs (first, second, δ, δ′) in two facts."""
    equations = SimpleNamespace(system=SimpleNamespace(independent=np.array([0])))
    over = SimpleNamespace(lower=np.zeros(1), upper=np.full(1, 4.0), wrapped=np.zeros(1, bool), limits=limits)
    counted = SimpleNamespace(premises=[SimpleNamespace(claim=over)])
    claim = SimpleNamespace(cell=members[0], box=members[1], cut=tree.cut, child=tree.child)
    cells = SimpleNamespace(claim=claim, premises=[counted], digest="these", found={"count": count})
    solutions = SimpleNamespace(claim=SimpleNamespace(boxes=boxes, equations=equations))
    parts = (pairs[:1], pairs[1:])
    names = "first", "second", "at_first", "at_second"
    glue = tuple(
        SimpleNamespace(claim=SimpleNamespace(**dict(zip(names, np.array(part).T.reshape(4, -1), strict=True))))
        for part in parts
    )
    for fact in glue:
        for name in names[:2]:
            setattr(fact.claim, name, getattr(fact.claim, name).astype(int))
        for name in names[2:]:
            setattr(fact.claim, name, getattr(fact.claim, name)[:, None])
    return sheet_claims.ProvedSheets(cells, solutions, glue)


def test_facts_speak_of_sheets_whose_numbers_are_theirs(monkeypatch):
    """Of boxes, over which cells of which region they lie, which are glued, within which limits how many there are."""
    told = {"these": SimpleNamespace(digest="these"), "others": SimpleNamespace(digest="others")}
    monkeypatch.setattr(sheet_claims, "closures_of", lambda problem: told[problem.phasors])
    limits = SimpleNamespace(limits=np.array([[-1.0, 1.0]]))
    boxes, members = boxes_at([0.5, 1.5, 2.5], [0.5] * 3), (np.array([3, 4, 5]), np.array([0, 1, 2]))
    count = np.array([-1, -1, -1, 1, 1, 1, 0])
    tree = quarters(*4 * (CERTIFIED,))
    proved = proved_of(tree, boxes, members, [(0, 1, 0.5, -0.5), (1, 2, 0.25, -0.125)], count, limits.limits)
    assert [part.ravel().tolist() for part in proved.glued] == [[0, 1], [1, 2], [1.0, 1.75], [1.0, 2.375]]
    pairs = [(0, 1, 1.0, 1.0), (1, 2, 1.75, 2.375)]
    told_of = atlas_of(tree, boxes, np.array(members).T, pairs, count=count)
    problem = told_of.problem._replace(phasors="these")
    atlas = replace(told_of, ranges=limits, reading=READING(problem), proved=proved)
    other = CellTree.whole(1)
    other.split(np.array([0]), np.array([0]))
    other.split(np.array([2, 1]), np.array([0, 0]))
    for change in (
        {"count": count * 2}, {"boxes": boxes._replace(radius=2.0 * boxes.radius)}, {"boxes": boxes.take(np.arange(2))},
        {"members": Members(members[0][::-1], members[1])}, {"members": Members(members[0], members[1][::-1])},
        {"glued": atlas.glued._replace(first=np.array([0, 0]))},
        {"glued": atlas.glued._replace(second=np.array([1, 1]))},
        {"region": replace(atlas.region, lower=np.full(1, -0.5))},
        {"region": replace(atlas.region, upper=np.full(1, 4.5))},
        {"region": replace(atlas.region, wrapped=np.ones(1, bool))}, {"tree": other},
        {"ranges": SimpleNamespace(limits=np.array([[-1.0, 2.0]]))},
        {"reading": READING(problem._replace(phasors="others"))},
    ):  # fmt: skip
        with pytest.raises(InvalidInputError, match="not those that were proved"):
            replace(atlas, **change)
        assert replace(atlas, proved=None, **change).proved is None
    assert proved.says(atlas)


def test_sheets_replayed_say_what_is_found(monkeypatch):
    """Neither other numbers nor leaves that are called more."""
    atlas = atlas_of(quarters(*4 * (CERTIFIED,)), NO_BOXES, count=[-1] * 7)
    monkeypatch.setattr(SheetAtlas, "problem", SimpleNamespace(system=None))
    monkeypatch.setattr(module, "Runner", lambda *_: None)
    for says, marked in ((True, False), (False, False), (True, True), (False, True)):
        proved = SimpleNamespace(says=lambda sheets, says=says: says, glued=atlas.glued)
        monkeypatch.setattr(module, "proved_again", lambda *_, proved=proved: proved)
        monkeypatch.setattr(module, "mark", lambda tree, proved, marked=marked: marked)
        if says and not marked:
            assert atlas.replayed().proved is proved
        else:
            with pytest.raises(InvalidInputError, match="altered"):
                atlas.replayed()


# Parts put together


def test_parts_keep_what_they_say():
    """Of cells and boxes by their numbers in the whole; complete where all are."""
    parts = [sheets_over(0.0, 0.5), sheets_over(0.5, 1.0)]
    whole = merged.merge_sheets(parts)
    q = np.linspace(0.01, 0.99, 50)[:, None]
    assert whole.number_of_solutions(q).tolist() == [2] * 50
    assert [sheet.layers for sheet in whole.sheets] == [1, 1]
    np.testing.assert_allclose([sheet.area for sheet in whole.sheets], 1.0)
    for point in q[::7]:
        part = parts[int(point[0] > 0.5)]
        np.testing.assert_allclose(
            np.sort(whole.solutions(point)[0], 0), np.sort(part.solutions(point)[0], 0), atol=1e-9
        )
    assert whole.complete
    for k in range(2):
        some = list(parts)
        some[k] = replace(parts[k], complete=False)
        assert not merged.merge_sheets(some).complete


def test_parts_of_other_things_are_refused():
    first, other = sheets_over(0.0, 0.5), sheets_over(0.5, 1.0)
    loose = other.ranges.limits.copy()
    loose[-1, 1] += 1e-3
    for changed, told in (
        (replace(other, names=("another",)), "other closures"),
        (replace(other, reading=other.reading.bounded("reach")), "other bounds="),
        (replace(other, ranges=other.ranges._replace(limits=loose), proved=None), "other limits"),
    ):
        with pytest.raises(InvalidInputError, match=told):
            merged.merge_sheets([first, changed])
