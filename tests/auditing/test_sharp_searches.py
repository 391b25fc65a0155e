"""Searches lose nothing: of cells called empty, of cells counted, and the proofs of singular cells, at their ends."""

from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest

from tests.support.chains import NONE, X, Y, Z, chain, closures, leg_and_anchor, planar, stated

pytest.importorskip("flint")

from flint import arb, fmpq

from ccpin.auditing import counts, empty_cells, singular_points
from ccpin.auditing.closures import BallClosures
from ccpin.auditing.empty_cells import Emptiness
from ccpin.auditing.reach import CornerBox
from ccpin.auditing.reading import ClaimedCells, Counts, StatedRanges
from tests.support.rows import Quadratic, Rows, exact

TURN = np.pi + 1e-9


def search_of(system, **more):
    document = stated(system, **more)
    return Emptiness(BallClosures(document), document)


def bare(closures, dependent, **more):
    """A search without what it makes of a document."""
    search = object.__new__(Emptiness)
    search.closures, search.angles = closures, np.zeros(0, dtype=int)
    others = np.setdiff1d(np.arange(closures.n_free), dependent)
    search.document = SimpleNamespace(dependent=np.array(dependent), independent=others)
    search.reach, search.platform, search.turning = SimpleNamespace(too_far=lambda box: False), None, np.zeros(0)
    vars(search).update(more)
    return search


def box(*ends):
    return CornerBox(*np.array(ends, dtype=float).T)


# What is searched


def test_what_is_searched():
    """Where every coordinate has ends, φ is not known modulo something and no more than six depend."""
    plain = search_of(leg_and_anchor(), lower=(1.0,), upper=(6.0,))
    assert plain.searched
    assert plain.reach.unbounded == frozenset()
    assert plain.angles.tolist() == []
    modulo = leg_and_anchor()
    modulo.moduli[0] = 1.0
    limits = [[-9.0, 9.0]]
    assert not search_of(modulo, lower=(1.0,), upper=(6.0,), limits=limits).searched
    endless = leg_and_anchor()
    endless.couplings[0, 0] = 1.0  # its rows are no lengths
    found = search_of(endless, lower=(1.0,), upper=(6.0,))
    assert not found.searched
    assert found.reach.unbounded == {1}
    for end in (0, 1):
        limits = [[-9.0, 9.0]]
        limits[0][end] = NONE[end]
        assert not search_of(endless, lower=(1.0,), upper=(6.0,), limits=limits).searched
    bounded = search_of(endless, lower=(1.0,), upper=(6.0,), limits=[[-9.0, 9.0]])
    assert bounded.searched
    assert bounded.reach.unbounded == frozenset()
    for count, searched in ((6, True), (7, False)):
        arm = planar([(k, X, Z, False) for k in range(1, count + 1)], X)
        rail = chain([(0, X, Z, False)], -np.array([X, Y]))
        found = search_of(closures([arm, rail], count + 1, [0]), lower=(1.0,), upper=(6.0,))
        assert found.searched == searched
        assert found.angles.tolist() == list(range(1, count + 1))


def test_all_that_coordinates_can_have():
    """A slide's ends, a turn, nothing of slides without ends, a turn of coupled angles without."""
    arm = planar([(1, X, Z, False), (2, X, X, True)], X)
    rail = chain([(0, X, X, True)], -np.array([X, Y]))
    system = closures([arm, rail], 5, [0], [[0.0, 0.0, 0.0, 1.0, 1.0]])
    whole = search_of(system, lower=(1.0,), upper=(6.0,)).whole(np.array([2.0]), np.array([3.0]))
    assert (whole.low[0], whole.high[0]) == (2.0, 3.0)
    np.testing.assert_allclose([whole.low[[1, 3, 4]], whole.high[[1, 3, 4]]], [[-TURN] * 3, [TURN] * 3], rtol=1e-15)
    np.testing.assert_allclose(whole.high[2], 6.0 + 1.0 + 3.0, rtol=1e-6)
    assert whole.low[2] == -whole.high[2]
    third = chain([(2, X, Z, False)], np.array([Z, Z]))
    system.chains[0] = system.chains[0]._replace(direction=True)
    del third
    whole = search_of(system, lower=(1.0,), upper=(6.0,)).whole(np.array([2.0]), np.array([3.0]))
    assert (whole.low[2], whole.high[2]) == (0.0, 0.0)
    for one in ([-3.0, NONE[1]], [NONE[0], 3.0]):
        half = search_of(system, lower=(1.0,), upper=(6.0,), limits=[NONE, one, NONE, NONE])
        whole = half.whole(np.array([2.0]), np.array([3.0]))
        assert (whole.low[2], whole.high[2]) == (0.0, 0.0)


# Cells called empty


@pytest.mark.parametrize(
    ("apart", "searched", "left", "good"),
    [(True, False, None, True), (False, True, [], True), (False, False, [], None), (False, True, None, None),
     (False, True, [1], None)],
)  # fmt: skip
def test_what_proves_a_cell_empty(monkeypatch, apart, searched, left, good):
    search = bare(Quadratic(), [1], searched=searched)
    monkeypatch.setattr(empty_cells, "corners", lambda document, cells, k: (np.array([0.0]), np.array([1.0])))
    search.document.empty, asked = None, []
    search.whole = lambda low, high: box((0, 1), (-1, 1))
    search._all_apart = lambda boxes: apart
    search.remaining = lambda boxes, keep: asked.append((boxes, keep)) or left
    assert search.proved(0) is good
    assert all(not keep for _, keep in asked)


def test_boxes_are_apart_where_all_their_parts_are():
    """Halved along q where the middle is; not apart where a middle is not, or the budget ends."""
    whole, parts = box((0, 4), (-1, 1)), []

    def small(part):
        parts.append((part.low[0], part.high[0]))
        return part.high[0] - part.low[0] <= 1.0

    search = bare(Quadratic(g=1.0), [1])
    search._apart = small
    assert search._all_apart([whole])
    covered = sorted(part for part in parts if part[1] - part[0] == 1.0)
    assert covered == [(0.0, 1.0), (1.0, 2.0), (2.0, 3.0), (3.0, 4.0)]
    assert all((part.low[1], part.high[1]) == (-1.0, 1.0) for part in [whole])
    search._apart = lambda part: part.high[0] - part.low[0] <= 1.0 and not part.low[0] <= 3.0 <= part.high[0]
    assert not search._all_apart([whole])
    search._apart = lambda part: part.low[0] == part.high[0]
    assert not search._all_apart([whole])  # nothing but middles


def test_a_middle_is_of_q_alone():
    middle = bare(Quadratic(), [1])._over_middle(box((1, 4), (-1, 2)))
    assert (middle.low.tolist(), middle.high.tolist()) == ([2.5, -1.0], [2.5, 2.0])


@pytest.mark.parametrize("far", [True, False])
@pytest.mark.parametrize("legs", [None, True, False])
def test_chains_are_apart_by_either_lemma(far, legs):
    search = bare(Quadratic(), [1])
    search.reach.too_far = lambda box: far
    search.platform = None if legs is None else SimpleNamespace(cannot_meet=lambda box: legs)
    assert search._apart(None) == bool(far or legs)


def test_what_remains_holds_every_root(monkeypatch):
    """Of boxes that are dropped only where nothing closes; kept only where φ_y is regular; none within a budget."""
    root = np.array([0.3, -0.4])

    def narrowed(part):
        holds = np.all((part.low <= root) & (root <= part.high))
        return (part if holds else None), part.half.max() < 0.2

    search = bare(Quadratic(), [1])
    search.reach = SimpleNamespace(too_far=lambda part: part.low[0] > 0.5, first=np.array([0, 1]))
    search.narrowed = narrowed
    (kept,) = search.remaining([box((-1, 1), (-1, 1))], keep=True)
    assert np.all((kept.low <= root) & (root <= kept.high))
    assert kept.half.max() < 0.2
    assert search.remaining([box((-1, 0.2), (-1, 1))], keep=True) == []
    monkeypatch.setattr(empty_cells, "_BUDGET", 50)
    assert search.remaining([box((-1, 1), (-1, 1))], keep=False) is None
    assert search.remaining([box((-1, 0.2), (-1, 1))], keep=False) == []
    smaller = box((0.25, 0.35), (-0.45, -0.35))
    search.narrowed = lambda part: (smaller, part is smaller)
    assert search.remaining([box((-1, 1), (-1, 1))], keep=True) == [smaller]
    search.narrowed = lambda part: (part, False)  # what is much smaller is not halved first
    search.reach.too_far = lambda part: True
    assert search.remaining([box((-1, 1), (-1, 1))], keep=True) == []


def test_what_closes_is_left_of_a_box():
    """y = −(c + g q) over q, solved for y by each row; nothing where rows have nothing in common."""
    search = bare(Rows([0.5], [[2.0, 1.0]]), [1])
    left, regular = search.narrowed(box((-0.25, 0.5), (-9, 9)))
    np.testing.assert_allclose([left.low[1], left.high[1]], [-1.5, 0.0], atol=1e-6)
    assert (left.low[0], left.high[0]) == (-0.25, 0.5)
    assert regular
    left, _ = search.narrowed(box((-0.25, 0.5), (-1.0, -0.5)))
    assert (left.low[1], left.high[1]) == (-1.0, -0.5)
    assert search.narrowed(box((-0.25, 0.5), (0.01, 9))) == (None, False)
    for a, b in ((-1.0, -1.5), (-1.5, -1.0), (1.0, 1.5), (1.5, 1.0)):
        rows = bare(Rows([-a, -b], [[0, 1, 0], [0, 1, 0.125]]), [1, 2])
        assert rows._solved(*_about(rows.closures, box((0, 1), (-2, 2), (-1, 1)))) is None
        assert rows.narrowed(box((0, 1), (-2, 2), (-1, 1))) == (None, False)
    rows = bare(Rows([-1.0, -1.0], [[0, 1, 0], [0, 1, 0.5]]), [1, 2])
    left = rows._solved(*_about(rows.closures, box((0, 1), (-2, 2), (-9, 1))))
    np.testing.assert_allclose([left.low[1:], left.high[1:]], [[1, -2], [1, 1]], atol=1e-5)


def _about(closures, part):
    middle = [arb(float(x)) for x in part.middle]
    balls = part.balls()
    return part, middle, closures.value(middle, middle), closures.jacobian(balls)


def test_a_row_that_cannot_vanish_closes_nothing():
    for row in (0, 1):
        c = [0.0, 0.0]
        c[row] = 2.5
        search = bare(Rows(c, [[0, 1, 0], [0, 0, 1]]), [1, 2])
        assert search.narrowed(box((0, 1), (-2, 2), (-2, 2))) == (None, False)


def test_boxes_are_regular_up_to_where_the_slope_vanishes():
    """φ = y + y²/2 − q: φ_y = 1 + y; and of wide turns nothing is said."""
    for low, regular in ((-0.99, True), (-1.01, False)):
        search = bare(Quadratic(g=-1.0, d=1.0), [1])
        assert search.narrowed(box((-0.6, 9), (low, 1.0)))[1] == regular
    search = bare(Rows([0.0], [[1.0, 1.0]]), [1], angles=np.array([1]))
    part = box((-9, 9), (-0.9, 0.9))
    assert search.narrowed(part) == (part, False)
    part = box((-9, 9), (-0.5, 0.5))
    left, regular = search.narrowed(part)
    assert left is not part
    assert regular is False
    assert search.narrowed(box((-9, 9), (-0.3, 0.3)))[1]
    level = bare(Rows([0.0], [[1.0, 0.0]]), [1])  # no Ã
    left, regular = level.narrowed(box((-9, 9), (-0.3, 0.3)))
    assert (left.low.tolist(), regular) == ([-9.0, -0.3], False)


# Counts


@pytest.mark.parametrize(
    ("said", "certified", "kept", "within", "found", "each", "good"),
    [
        (2, False, [1], [2], [3, 4], None, True),
        (2, True, [1], [2], [3, 4], True, True),
        (2, True, [1], [2], [3, 4], False, None),
        (1, False, [1], [2], [3, 4], True, False),
        (3, True, [1], [2], [3, 4], True, False),
        (0, False, [], [], [], None, True),
        (2, False, None, [2], [3, 4], True, None),
        (2, False, [1], None, [3, 4], True, None),
        (2, False, [1], [2], None, True, None),
    ],
)
def test_what_is_counted(monkeypatch, said, certified, kept, within, found, each, good):
    cells = ClaimedCells(np.array([5, 9]), np.array([[0.0], [0.25]]), np.array([[0.25], [0.75]]))
    numbers = Counts(cells, np.array([0, said]), np.array([False, certified]), np.array([9, 5, 9]), np.array([3, 4, 7]))
    document = SimpleNamespace(counts=numbers, ranges="ranges", lower=np.array([1.0]), upper=np.array([3.0]))
    search = SimpleNamespace(document=document, searched=True, whole=lambda low, high: (low, high))
    asked = {}
    search.remaining = lambda boxes, keep: asked.update(boxes=boxes, keep=keep) or kept

    def over(search, boxes, q):
        asked.update(within=boxes, q=q)
        return found

    monkeypatch.setattr(counts, "_within", lambda search, ranges, boxes: within)
    monkeypatch.setattr(counts, "_over", over)
    monkeypatch.setattr(counts, "_one_each", lambda document, boxes, found: asked.update(of=boxes) or each)
    assert counts.counted(search, 1) is good
    assert asked["keep"]
    np.testing.assert_allclose(asked["boxes"], [[[1.5], [2.5]]])
    if kept is not None and within is not None:
        assert asked["q"].tolist() == [2.0]
    if "of" in asked:
        assert asked["of"] == [3, 7]
    for name, missing in (("counts", None), ("ranges", None)):
        fewer = SimpleNamespace(**{**vars(search), "document": SimpleNamespace(**{**vars(document), name: missing})})
        assert counts.counted(fewer, 1) is None
    search.searched = False
    assert counts.counted(search, 1) is None


def test_corners_are_not_rounded():
    document = SimpleNamespace(lower=np.array([0.1, 5.0]), upper=np.array([0.7, 5.0]))
    cells = ClaimedCells(np.array([0]), np.array([[0.25, 0.0]]), np.array([[0.75, 1.0]]))
    low, high = counts._exact_corners(document, Counts(cells, None, None, None, None), 0)
    for balls, shares in ((low, (0.25, 0.0)), (high, (0.75, 1.0))):
        for ball, a, b, share in zip(balls, (0.1, 5.0), (0.7, 5.0), shares, strict=True):
            exactly = arb(a) + (arb(b) - arb(a)) * share
            assert ball.overlaps(exactly)
            assert float(ball.mid()) == pytest.approx(float(exactly.mid()), abs=1e-14)


def limits(*ends):
    return StatedRanges(None, None, None, np.array(ends))


def test_boxes_touch_no_limit(monkeypatch):
    """Strictly within; what touches one is halved until it is within, or empty."""
    search = SimpleNamespace(
        document=SimpleNamespace(dependent=np.array([1, 2])),
        narrowed=lambda part: (part if part.high[1] > 0.6 else None, False),
        steepest=lambda part: 1,
    )
    inside = box((0, 1), (0.0, 1.0), (-2.0, 3.0))
    assert counts._within(search, limits([-0.1, 1.1], [-2.1, 3.1]), [inside]) == [inside]
    above = counts._within(search, limits([0.0, 1.1], [-9, 9]), [inside])
    assert [(part.low[1], part.high[1]) for part in above] == [(0.5, 1.0)]
    monkeypatch.setattr(counts, "_BUDGET", 60)
    for ends in (
        ([-0.1, 1.0], [-9, 9]), ([-9, 9], [-2.0, 9]), ([-9, 9], [-9, 3.0]), ([-9, 0.7], [-9, 9]), ([0.3, 9], [9, 99]),
    ):  # fmt: skip
        assert counts._within(search, limits(*ends), [inside]) is None
    assert counts._within(search, limits([-9, 9], [-9, 3.0]), []) == []
    monkeypatch.setattr(counts, "_BUDGET", 1)
    assert counts._within(search, limits([-0.1, 1.1], [-2.1, 3.1]), [inside, inside]) == [inside, inside]


def test_negative_ends_touch_limits_too(monkeypatch):
    monkeypatch.setattr(counts, "_BUDGET", 5)
    search = SimpleNamespace(
        document=SimpleNamespace(dependent=np.array([0])), narrowed=lambda part: (part, False), steepest=lambda part: 0
    )
    for part, ends, good in (
        ((-3.0, -2.0), (-2.5, 9), False), ((-3.0, -2.0), (-9, -2.5), False), ((2.0, 3.0), (2.5, 9), False),
        ((2.0, 3.0), (-9, 2.5), False), ((2.0, 3.0), (1.5, 3.5), True), ((-3.0, -2.0), (-3.5, -1.5), True),
    ):  # fmt: skip
        assert (counts._within(search, limits(ends), [box(part)]) is not None) == good


def test_every_solution_over_a_place_is_found(monkeypatch):
    """Boxes that hold q, ends and all; each halved until it is empty or holds one alone."""
    roots = [-0.7, 0.1, 0.4]
    search = SimpleNamespace(
        document=SimpleNamespace(independent=np.array([0]), dependent=np.array([1])), closures=None
    )
    asked = []

    def narrowed(part):
        asked.append((part.low[0], part.high[0]))
        return (part if any(part.low[1] <= r <= part.high[1] for r in roots) else None), False

    def near(closures, dependent, theta):
        best = min(roots, key=lambda r: abs(r - theta[1]))
        return (np.array([theta[0], best]), 1e-9) if abs(best - theta[1]) < 0.15 else None

    search.narrowed = narrowed
    monkeypatch.setattr(counts, "near", near)
    monkeypatch.setattr(counts, "_alone", lambda search, part, solution: solution[1] < 1.0 and part.half[1] < 0.2)
    monkeypatch.setattr(
        counts, "_among", lambda search, found, one: any(abs(o[0][1] - one[0][1]) < 1e-6 for o in found)
    )
    for low, high in ((0.0, 1.0), (0.5, 1.0), (0.0, 0.5), (0.5, 0.5)):
        found = counts._over(search, [box((low, high), (-1, 1))], np.array([0.5]))
        assert sorted(theta[1] for theta, _ in found) == roots
        assert {*asked} == {(0.5, 0.5)}
        assert len(counts._over(search, [box((low, high), (-1, 1))] * 2, np.array([0.5]))) == 3
    for low, high in ((0.6, 1.0), (0.0, 0.4), (-1.0, 0.4), (0.51, 9.0)):
        assert counts._over(search, [box((low, high), (-1, 1))], np.array([0.5])) == []
    assert counts._over(search, [box((-1.0, -0.6), (-1, 1))], np.array([-0.5])) == []
    two = SimpleNamespace(
        **{**vars(search), "document": SimpleNamespace(independent=np.array([0, 2]), dependent=np.array([1]))}
    )
    assert counts._over(two, [box((0, 1), (-1, 1), (2, 3))], np.array([0.5, 1.0])) == []
    assert counts._over(two, [box((0, 1), (-1, 1), (2, 3))], np.array([0.5, 4.0])) == []
    assert len(counts._over(two, [box((0, 1), (-1, 1), (2, 3))], np.array([0.5, 2.0]))) == 3
    monkeypatch.setattr(counts, "_among", lambda *_: None)
    assert counts._over(search, [box((0, 1), (-1, 1))], np.array([0.5])) is None
    monkeypatch.setattr(counts, "_alone", lambda *_: False)
    assert counts._over(search, [box((0, 1), (-1, 1))], np.array([0.5])) is None


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("shift", [0.0, 3.0])
def test_one_is_alone_in_what_it_spans_with_a_box(side, shift):
    """φ_y = 1 − side (y − shift), which vanishes one beyond; the box on that side of a ball, or on the other."""
    search = bare(Rows([0.0], [[0.0, 1.0 + side * shift]], [[[0.0, 0.0], [0.0, -side]]]), [1])
    for end, alone in ((0.999, True), (1.001, False)):
        for y, radius, ends in (
            (0.5, end - 0.5, (-0.25, 0.25)), (-0.5, 0.1, (0, end)), (0, 0.1, (-0.5, end)), (end - 0.2, 0.2, (0, 0.1)),
        ):  # fmt: skip
            part = box((0, 0), sorted(shift + side * x for x in ends))
            assert counts._alone(search, part, (np.array([0.0, shift + side * y]), radius)) == alone
    level = bare(Rows([0.0], [[1.0, 0.0]]), [1])
    assert not counts._alone(level, box((0, 0), (-1, 1)), (np.zeros(2), 0.1))


def test_solutions_are_told_apart_by_their_balls(monkeypatch):
    """Farther than both radii in some coordinate, up to whole turns; else the same if alone in what they span."""
    asked = []
    monkeypatch.setattr(counts, "_alone", lambda search, part, solution: asked.append((part, solution)) or True)
    other = np.array([7.0, 0.5, -0.25]), 0.125
    search = SimpleNamespace(document=SimpleNamespace(dependent=np.array([1, 2])), turning=np.array([2]))
    for turns in (-30, 0, 20):
        for gap, radius, same in (((0.3, 0.0), 0.2, True), ((0.33, 0.0), 0.2, False), ((0.0, -0.3), 0.2, True),
                                  ((0.0, -0.33), 0.2, False), ((0.1, 0.1), 0.2, True)):  # fmt: skip
            theta = np.array([7.0, 0.5 + gap[0], -0.25 + gap[1] + 2 * np.pi * turns])
            assert counts._among(search, [other], (theta, radius)) == same
            if same:
                part, (at, reach) = asked[-1]
                again = np.array([7.0, 0.5 + gap[0], -0.25 + gap[1]])
                room = np.array([0.0, 0.4, 0.4])
                np.testing.assert_allclose(part.low, np.minimum(other[0], again) - room, atol=1e-11)
                np.testing.assert_allclose(part.high, np.maximum(other[0], again) + room, atol=1e-11)
                assert at is other[0]
                assert reach == 0.125
    plain = np.array([7.0, 0.5 + 2 * np.pi, -0.25])
    assert counts._among(search, [other], (plain, 0.2)) is False  # no angle that is known modulo a turn
    assert counts._among(search, [other, other], (plain, 0.2)) is False
    assert counts._among(search, [], (plain, 0.2)) is False
    asked.clear()
    zero = np.zeros(3), 0.5
    assert counts._among(search, [zero], (np.zeros(3), 0.0))
    np.testing.assert_allclose(asked[-1][0].low, [0.0, -1e-12, -1e-12], rtol=1e-9)
    np.testing.assert_allclose(asked[-1][0].high, [0.0, 1e-12, 1e-12], rtol=1e-9)
    monkeypatch.setattr(counts, "_alone", lambda *_: False)
    assert counts._among(search, [other], (other[0], 0.1)) is None


# Singular cells


def fold(**changed):
    """φ = ½ + q + y + ½ y²: singular at q = 0, y = −1."""
    at = {"q": 0.0, "y": -1.0, "low": -0.5, "high": 0.5, **changed}
    return SimpleNamespace(
        witnesses=np.array([[at["q"], at["y"]]]),
        singular=ClaimedCells(np.array([0]), np.array([[at["low"] / 4.0 + 0.5]]), np.array([[at["high"] / 4.0 + 0.5]])),
        lower=np.array([-2.0]),
        upper=np.array([2.0]),
        independent=np.array([0]),
        dependent=np.array([1]),
    )


@pytest.mark.parametrize(
    ("changed", "good"),
    [
        ({}, True),
        ({"q": 0.05, "y": -0.9}, True),  # a witness need not be one
        ({"low": 1e-4}, None),
        ({"high": -1e-4}, None),
        ({"low": -1e-4, "high": 1e-4}, True),
    ],
)
def test_cells_hold_the_singular_configurations_they_say(changed, good):
    closures = Quadratic(c=0.5, g=1.0, d=1.0)
    assert singular_points.singular(closures, fold(**changed), 0) is good
    assert singular_points.singular(Quadratic(c=0.5, g=1.0), fold(**changed), 0) is None  # regular everywhere


def test_lines_are_along_what_is_not_held(monkeypatch):
    """The normal of the fold first, then each coordinate; one that is found is enough."""
    lines, answers = [], []
    monkeypatch.setattr(
        singular_points, "_on_line", lambda c, d, theta, way, weak, cell: lines.append(way) or answers.pop()
    )
    rows = Rows([0.0], [[3.0, 4.0, 0.0]], np.zeros((1, 3, 3)))
    document = SimpleNamespace(
        witnesses=np.zeros((1, 3)), singular=ClaimedCells(np.zeros(1), np.zeros((1, 2)), np.ones((1, 2))),
        lower=np.array([-2.0, 1.0]), upper=np.array([-1.0, 4.0]), independent=np.array([0, 1]), dependent=np.array([2]),
    )  # fmt: skip
    answers[:] = [False, False, False]
    assert singular_points.singular(rows, document, 0) is None
    np.testing.assert_allclose(np.abs(lines), [[0.6, 0.8], [1, 0], [0, 1]])
    answers[:] = [False, True, False]
    assert singular_points.singular(rows, document, 0) is True
    document.upper[1] = 1.0
    lines.clear()
    answers[:] = [True]
    assert singular_points.singular(rows, document, 0) is True
    np.testing.assert_allclose(np.abs(lines[0]), [1.0, 0.0])
    document.lower, document.upper = np.array([1.0, 1.0]), np.array([1.0, 1.0])
    lines.clear()
    answers[:] = [False, False]
    assert singular_points.singular(rows, document, 0) is None
    assert len(lines) == 2  # a normal of zeros is no direction


class Krawczyk:
    """F and F′ about a place as they are told: |ÃF| = size, |I − ÃF′| = rest in one row's entries."""

    def __init__(self, value, rest, row=0, column=0):
        self.value, self.rest, self.place, self.asked = value, rest, (row, column), []

    def __call__(self, closures, document, theta, kernel, direction, pairing):
        self.asked.append((theta, kernel))
        slope = np.eye(len(self.value))
        if max(float(x.rad()) for x in kernel):
            slope[self.place] -= self.rest
        return exact(np.array(self.value)[:, None]), exact(slope)


@pytest.mark.parametrize("row", [0, 1, 2, 3, 4])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize(
    ("rest", "factor"), [(0.49, 2.0), (0.51, 16.0), (0.93, 16.0), (0.94, 256.0), (0.995, 256.0), (0.997, None)]
)
def test_a_singular_configuration_is_proved_by_a_contraction(monkeypatch, row, sign, rest, factor):
    """|ÃF| + rest r < r at r = 2, 16 and 256 |ÃF|, in every row; q on the line, as far along as s."""
    value = np.zeros(5)
    value[row] = sign * 2.0**-41
    told = Krawczyk(value, rest, row, (2 * row) % 5)
    inside = []
    monkeypatch.setattr(singular_points, "_extended", told)
    monkeypatch.setattr(singular_points, "_inside", lambda q, cell: inside.append(q) or True)
    document = SimpleNamespace(independent=np.array([0, 3]), dependent=np.array([1, 2]))
    closures = SimpleNamespace(m=2, n_free=4)
    theta, way, weak = np.array([1.0, 2.0, 3.0, 4.0]), np.array([0.5, -0.25]), np.array([6.0, 8.0])
    found = singular_points._on_line(closures, document, theta, way, weak, None)
    assert found is (factor is not None)
    if not found:
        return
    r = factor * 2.0**-41
    s, y, w = -value[0], -value[1:3], -value[3:5]
    around, near = told.asked[-1]
    middles = [1.0 + 0.5 * s, 2.0 + y[0], 3.0 + y[1], 4.0 - 0.25 * s]
    for ball, middle, reach in zip(around, middles, [0.5 * r, r, r, 0.25 * r], strict=True):
        assert abs(float(ball.mid()) - middle) < 1e-15
        assert float(ball.rad()) == pytest.approx(reach, rel=1e-6)
    for ball, middle in zip(near, weak + w, strict=True):
        assert abs(float(ball.mid()) - middle) < 2e-15
        assert float(ball.rad()) == pytest.approx(r, rel=1e-6)
    assert inside == [[around[0], around[3]]]


def test_places_on_a_line_are_not_rounded(monkeypatch):
    """q₀ + s d as a ball that holds it."""
    told = Krawczyk([-(2.0**-41), 0.0, 0.0], 0.0)
    monkeypatch.setattr(singular_points, "_extended", told)
    monkeypatch.setattr(singular_points, "_inside", lambda *_: True)
    document = SimpleNamespace(independent=np.array([0]), dependent=np.array([1]))
    for way in (1.0 / 3.0, 0.7, -0.3):
        told.asked.clear()
        theta = np.array([0.1, 0.0])
        assert singular_points._on_line(
            SimpleNamespace(m=1, n_free=2), document, theta, np.array([way]), np.ones(1), None
        )
        (place, _), _ = told.asked[1]
        exactly = Fraction(0.1) + Fraction(2.0**-41) * Fraction(way)
        assert place.contains(fmpq(exactly.numerator, exactly.denominator))
        assert float(place.rad()) < 1e-16


def test_a_line_that_leads_nowhere_proves_nothing(monkeypatch):
    document = SimpleNamespace(independent=np.array([0]), dependent=np.array([1]))
    closures, one = SimpleNamespace(m=1, n_free=2), np.ones(1)
    for value in ([np.nan, 0.0, 0.0], [0.0, np.nan, 0.0]):
        monkeypatch.setattr(singular_points, "_extended", Krawczyk(value, 0.0))
        assert singular_points._on_line(closures, document, np.zeros(2), one, one, None) is False


def test_f_and_its_derivative():
    """F = (φ, φ_y w, lᵀw − 1) along q₀ + s d, against differences."""
    rng = np.random.default_rng(4)
    bend = rng.normal(size=(2, 4, 4))
    closures = Rows(rng.normal(size=2), rng.normal(size=(2, 4)), bend + bend.transpose(0, 2, 1))
    document = SimpleNamespace(independent=np.array([2, 0]), dependent=np.array([3, 1]))
    way, pairing = rng.normal(size=2), rng.normal(size=2)

    def f(x, slope=False):
        theta = np.empty(4)
        theta[document.independent], theta[document.dependent] = 0.5 + x[0] * way, x[1:3]
        balls = [[arb(float(v)) for v in part] for part in (theta, x[3:])]
        parts = singular_points._extended(closures, document, *balls, way, pairing)
        return np.array([float(v) for v in parts[slope].entries()])

    x = rng.normal(size=5)
    theta = np.empty(4)
    theta[document.independent], theta[document.dependent] = 0.5 + x[0] * way, x[1:3]
    phi, slope = closures.at(theta)
    expected = [*phi, *(slope[:, document.dependent] @ x[3:]), pairing @ x[3:] - 1.0]
    np.testing.assert_allclose(f(x), expected, atol=1e-13)
    differences = [(f(x + 1e-5 * e) - f(x - 1e-5 * e)) / 2e-5 for e in np.eye(5)]
    np.testing.assert_allclose(f(x, True).reshape(5, 5).T, differences, atol=1e-8)
    np.testing.assert_array_equal(singular_points._lifted(document, way, 3.0), [way[1], 3.0, way[0], 3.0])


def test_q_is_in_a_cell_by_all_coordinates_that_are_not_held():
    for low, high, good in (
        (0.9, 1.1, True),
        (1.1, 2.0, False),
        (0.0, 0.9, False),
        (5.0, 5.0, True),
        (0.99, 1.0, False),
    ):
        for other in (arb(-1.0, 0.05), arb(-1.0, 0.2)):
            wide = other.contains(-1.1)
            cell = np.array([low, -1.1]), np.array([high, -0.9])
            assert singular_points._inside([arb(1.0, 0.05), other], cell) == (good and not wide)
    assert singular_points._inside([arb(1.0, 0.05)], (np.array([0.94]), np.array([1.06])))
