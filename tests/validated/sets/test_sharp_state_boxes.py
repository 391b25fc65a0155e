"""σ over boxes, where it is a square root: boxes that just do and just do not hold, jets by closed forms."""

from fractions import Fraction
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("flint")

from ccpin.errors import ConvergenceError
from ccpin.programs.tape import Tape
from ccpin.validated.arithmetic.ball_arrays import BallArray, exactly, joined
from ccpin.validated.arithmetic.balls import ball, flint
from ccpin.validated.arithmetic.programs import in_balls
from ccpin.validated.flow.closing import krawczyk
from ccpin.validated.flow.start_search import closed_start, unique_there
from ccpin.validated.sets import curvature as module
from ccpin.validated.sets.branch import closed_boxes, jets_of, states_of
from ccpin.validated.sets.curvature import UnboundedError, at_middles, boxes, curvature_over, feedback
from ccpin.validated.sets.instants import Instants
from tests.support.parabola import linear, lines, loop, parabola

pytestmark = pytest.mark.usefixtures("precise")


def arb(mid, rad=0.0):
    return flint().arb(mid, rad)


def two():
    """Y² = q and z = 3q."""
    tape = Tape(4)
    q, y, z, v = tape.inputs
    return loop(tape, 3, 1, [y * y - q, z - q * 3], [v, v, v, v])


# Krawczyk's operator in balls: of y² = q about 1 over q = 1 ± w, y = 1 ± R it is 1 ± (½w + R²).


def test_krawczyks_image():
    (found,) = krawczyk(parabola(), [arb(1, 0.25)], [ball(1)], [ball(0.25)])
    assert float(found.mid()) == pytest.approx(1.0, abs=1e-9)
    assert float(found.rad()) == pytest.approx(0.125 + 0.0625, rel=1e-7)
    off = krawczyk(parabola(), [ball(1)], [ball(1.0625)], [ball(0.25)])[0]  # 1.0625 − (1.0625² − 1)/2.125 ± R²/1.0625
    assert float(off.mid()) == pytest.approx(1.0625 - (1.0625**2 - 1) / 2.125, rel=1e-8)
    assert float(off.rad()) == pytest.approx(0.0625 / 1.0625, rel=1e-7)


@pytest.mark.parametrize(
    ("w", "R", "holds"), [(0.37, 0.25, True), (0.376, 0.25, False), (0.49, 0.5, True), (0.51, 0.5, False)]
)
def test_krawczyks_condition(w, R, holds):
    assert (krawczyk(parabola(), [arb(1, w)], [ball(1)], [ball(R)]) is not None) is holds


def test_every_component_is_to_be_inside():
    assert krawczyk(two(), [arb(1, 0.25)], [ball(1), ball(3)], [ball(0.25), ball(1)]) is not None
    assert krawczyk(two(), [arb(1, 0.25)], [ball(1), ball(3)], [ball(0.25), ball(0.7)]) is None
    assert krawczyk(parabola(), [ball(0)], [ball(0)], [ball(1)]) is None
    assert krawczyk(loop(Tape(2), 1, 1, [], []), [ball(1)], [], []) == []


def test_closed_starts_are_near_what_was_computed():
    """Within 1e-2, of all numbers; on that branch."""
    root = np.sqrt(2.0)
    for off in (0.0095, -0.0095):
        q, y = closed_start(parabola(), [ball(2)], np.array([2.0, root + off]))
        assert q == ball(2)
        assert y.overlaps(ball(2).sqrt())
        assert y.rad() < 1e-30
    for off in (0.0105, -0.0105, 0.015):
        with pytest.raises(ConvergenceError):
            closed_start(parabola(), [ball(2)], np.array([2.0, root + off]))
    assert float(closed_start(parabola(), [ball(2)], np.array([2.0, -root]))[1]) == pytest.approx(-root)
    for off in ((0.015, 0.0), (0.0, 0.015)):
        with pytest.raises(ConvergenceError):
            closed_start(two(), [ball(2)], np.array([2.0, root + off[0], 6.0 + off[1]]))
    with pytest.raises(ConvergenceError):
        closed_start(parabola(), [ball(0)], np.array([0.0, 0.0]))
    wide = closed_start(parabola(), [arb(2, 1e-3)], np.array([2.0, root]))
    for end in (1.999, 2.001):
        assert wide[1].contains(ball(end).sqrt())


def test_a_box_belongs_to_a_branch():
    """Its numbers are within the radius for which the branch is single, and so is the computed start."""
    root = np.sqrt(2.0)
    at = np.array([2.0, root])
    told = unique_there
    assert told(parabola(), [ball(2)], [ball(2), arb(root, 5e-3)], at)
    assert told(parabola(), [ball(2)], [ball(2), arb(root + 5e-3, 4e-3)], at)
    assert not told(parabola(), [ball(2)], [ball(2), arb(root + 5e-3, 6e-3)], at)
    assert not told(parabola(), [ball(2)], [ball(2), arb(-root, 5e-3)], at)
    assert not told(parabola(), [ball(2)], [ball(2), arb(root, 1e-3)], at + [0.0, 0.0105])
    assert told(parabola(), [ball(2)], [ball(2), arb(root, 1e-3)], at + [0.0, 0.0095])
    assert not told(parabola(), [arb(2, 1.0)], [ball(2), arb(root, 1e-3)], at)
    inside, there = [ball(2), arb(root, 1e-3), arb(6, 1e-3)], np.array([2.0, root, 6.0])
    assert told(two(), [ball(2)], inside, there)
    assert not told(two(), [ball(2)], [*inside[:2], arb(6, 0.02)], there)
    assert not told(two(), [ball(2)], inside, there + [0.0, 0.0, 0.015])


def test_configurations_at_rest():
    assert parabola().at_rest([ball(1), ball(2), ball(7)]) == [ball(1), ball(2), ball(0)]


# The same in doubles: |C φ| + |C φ_q| w + |1 − C φ_y| R < R.


def test_boxes_just_hold_and_just_do_not():
    """About q = 1, y = 1: ½w + R² < R, which has an R where w < ½."""
    centre = np.array([[1.0, 1.0]])
    for w, holds in ((0.45, True), (0.51, False)):
        box, proven = closed_boxes(parabola(), centre, np.array([[w]]))
        assert proven.tolist() == [holds]
        assert box.rad[0, 0] == w
        if holds:
            R = box.rad[0, 1]
            assert 0.5 * w + R * R < R
    for R, holds in ((0.25, True), (0.6, True)):
        box, proven = closed_boxes(parabola(), centre, np.array([[0.36]]), np.array([[R]]))
        assert proven.tolist() == [holds]
        assert box.rad[0, 1] == R
    box, proven = closed_boxes(parabola(), centre, np.array([[0.36]]), np.array([[0.2]]))
    assert proven.all()
    assert 0.18 + box.rad[0, 1] ** 2 < box.rad[0, 1]


def test_boxes_about_open_configurations():
    """At y = 1.2 for q = 1: 0.44/2.4 + R²/1.2 < R from R = 0.2258 on; at y = 2 for no R."""
    box, proven = closed_boxes(parabola(), np.array([[1.0, 1.2]]), np.zeros((1, 1)))
    assert proven.all()
    assert 0.2258 < box.rad[0, 1] < 0.3
    assert not closed_boxes(parabola(), np.array([[1.0, 2.0]]), np.zeros((1, 1)))[1].any()


def test_boxes_with_more_numbers():
    """Each is to hold: z = 3q needs 3w; several boxes at once, and none where nothing depends."""
    centre = np.array([[1.0, 1.0, 3.0], [4.0, 2.0, 12.0]])
    box, proven = closed_boxes(two(), centre, np.array([[0.3], [2.1]]))
    assert proven.tolist() == [True, False]
    assert box.rad[0, 2] > 0.9
    assert 0.15 + box.rad[0, 1] ** 2 < box.rad[0, 1]
    free = loop(Tape(2), 1, 1, [], [])
    box, proven = closed_boxes(free, np.array([[1.0]]), np.array([[0.5]]))
    assert proven.all()
    assert box.rad.tolist() == [[0.5]]


def root_jets(q):
    """√q and its three derivatives."""
    return q**0.5, 0.5 * q**-0.5, -0.25 * q**-1.5, 0.375 * q**-2.5


def states(q, w, v, rv):
    """Pairs of centres and boxes of the parabola."""
    centre = np.array([[q, q**0.5]])
    points, _ = closed_boxes(parabola(), centre, np.full((1, 1), 1e-15))
    box, proven = closed_boxes(parabola(), centre, np.full((1, 1), w))
    assert proven.all()
    rest = joined(exactly(np.array([[v]])), BallArray(np.array([[v]]), np.array([[rv]])))
    return states_of(parabola(), joined(points, box), rest, np.array([[w + 1e-15, rv]]))


def test_slopes_of_sigma_at_a_point():
    """Q′ with its derivatives along q, at q = 4: of itself 1, 0, and of the root ¼, −1/32."""
    points, _ = closed_boxes(parabola(), np.array([[4.0, 2.0]]), np.full((1, 1), 1e-15))
    found = states_of(parabola(), points, exactly(np.array([[3.0]])))
    np.testing.assert_allclose(found.slopes[0].mid[0, :, 0], [1.0, 0.25], rtol=1e-12)
    np.testing.assert_allclose(found.slopes[1].mid[0, :, 0, 0], [0.0, -1 / 32], atol=1e-12)
    np.testing.assert_allclose(found.slopes[2].mid[0, :, 0, 0, 0], [0.0, 3 / 256], atol=1e-12)


def test_sigma_over_a_box_is_narrowed_about_its_centre():
    """√q over 4 ± 0.25 to its ends, and hardly more; its slope and bend too."""
    w = 0.25
    found = states(4.0, w, 3.0, 0.5)
    whole = found.q_free.at((1, 1)), *(x.at((1, 1, *[0] * k)) for k, x in enumerate(found.slopes[:2], start=1))
    for k, (part, slack) in enumerate(zip(whole, (0.02, 0.06, 0.5), strict=True)):
        ends = [root_jets(q)[k] for q in (4.0 - w, 4.0 + w)]
        assert part.mid - part.rad <= min(ends)
        assert max(ends) <= part.mid + part.rad
        assert 2 * part.rad < (1 + slack) * (max(ends) - min(ends))
    assert found.q_free.rad[0, 1] < 1e-13


def test_jets_along_q_and_speed():
    """Y v at q = 4, v = 3: all first and second derivatives along (q, v); a program of q, of speed and of nothing."""
    tape = Tape(3)
    q, y, v = tape.inputs
    program = in_balls(tape, [y * v, q * q, v * v, tape.node(2)])
    points, _ = closed_boxes(parabola(), np.array([[4.0, 2.0]]), np.full((1, 1), 1e-15))
    thin = jets_of(states_of(parabola(), points, exactly(np.array([[3.0]]))), parabola(), program)
    np.testing.assert_allclose(thin.value.mid[0], [6.0, 16.0, 9.0, 2.0], rtol=1e-12)
    np.testing.assert_allclose(thin.slope.mid[0], [[0.75, 2.0], [8.0, 0.0], [0.0, 6.0], [0.0, 0.0]], atol=1e-11)
    bends = [[[-3 / 32, 0.25], [0.25, 0.0]], [[2.0, 0.0], [0.0, 0.0]], [[0.0, 0.0], [0.0, 2.0]], np.zeros((2, 2))]
    np.testing.assert_allclose(thin.bend.mid[0], bends, atol=1e-11)
    over = jets_of(states(4.0, 0.25, 3.0, 0.5), parabola(), program)
    assert len(over.value.mid) == 1
    for at in ((3.75, 2.5), (3.75, 3.5), (4.25, 2.5), (4.25, 3.5), (4.0, 3.0)):
        root, slope, bend, _ = root_jets(at[0])
        exact = root * at[1], np.array([slope * at[1], root]), np.array([[bend * at[1], slope], [slope, 0.0]])
        for part, value in zip(over, exact, strict=True):
            assert np.all(np.abs(part.mid[0, 0] - value) <= part.rad[0, 0])
    assert over.value.rad[0, 0] < 1.02 * (4.25**0.5 * 3.5 - 6.0)
    assert over.slope.rad[0, 1, 0] == pytest.approx(0.5, rel=1e-6)  # 2q over ± 0.25


# What the tube asks for, of F(q, v) = (v, √q v).


def instants(q=4.0, v=3.0, moved=(0.1, 0.05), half=0.01):
    middle = BallArray(np.array([[q, q**0.5, v]]), np.full((1, 3), 1e-15))
    wide = np.array([[moved[0], moved[0] * 0.3, moved[1]]])
    return Instants(np.array([1.0]), np.array([half]), middle, BallArray(middle.mid, wide))


def flow(q, v):
    """F, F′ and F″."""
    root, slope, bend, _ = root_jets(q)
    second = np.zeros((2, 2, 2))
    second[1] = [[bend * v, slope], [slope, 0.0]]
    return np.array([v, root * v]), np.array([[0.0, 1.0], [slope * v, root]]), second


def test_the_flow_at_middles():
    found = at_middles(parabola(), instants())
    for part, value in zip(found, flow(4.0, 3.0), strict=True):
        np.testing.assert_allclose(part.mid[0], value, atol=1e-12)
        assert part.rad.max() < 1e-11


def test_boxes_hold_the_tube():
    """Moved from the middle, and the reach beyond it; σ over the whole of it."""
    found = boxes(parabola(), instants(), np.array([[0.2, 0.4]]), 2)
    assert found.pieces == 2
    assert found.q_free.rad[0, 0] == pytest.approx(0.3, rel=1e-9)
    assert found.v.mid[0] == 3.0
    assert found.v.rad[0, 0] == pytest.approx(0.45, rel=1e-9)
    mid, rad = found.q_free.mid[0, 1], found.q_free.rad[0, 1]
    assert mid - rad < 3.7**0.5 < 4.3**0.5 < mid + rad
    at = instants()
    off = at._replace(during=BallArray(at.during.mid + [[0.02, 0.0, -0.01]], at.during.rad))
    wider = boxes(parabola(), off, np.array([[0.2, 0.4]]), 1)
    assert (wider.q_free.rad[0, 0], wider.v.rad[0, 0]) == pytest.approx((0.32, 0.46), rel=1e-9)
    assert found.centre.rad[0, 1] < 1e-13
    assert found.centre.mid[0, 1] == 2.0


def test_pieces_cover_the_box():
    """Three a coordinate: edge to edge in q, all of v with each, σ in each."""
    whole = boxes(parabola(), instants(), np.array([[0.2, 0.4]]), 3)
    q, v = whole.states.q_free, whole.states.rest
    assert len(q.mid) == 6
    low, high = q.mid[3:, 0] - q.rad[3:, 0], q.mid[3:, 0] + q.rad[3:, 0]
    assert low.min() <= 3.7
    assert high.max() >= 4.3
    assert np.all(np.sort(low)[1:] <= np.sort(high)[:-1])
    np.testing.assert_allclose(high - low, 0.2, rtol=1e-9)
    assert np.all(high - low > 0.2)
    np.testing.assert_allclose(v.mid[:, 0], 3.0)
    np.testing.assert_allclose(v.rad[:3, 0], 0.0)
    np.testing.assert_allclose(v.rad[3:, 0], 0.45, rtol=1e-9)
    for k in range(3):
        for at in (low[k], high[k]):
            assert abs(at**0.5 - q.mid[3 + k, 1]) <= q.rad[3 + k, 1] * 1.01
    np.testing.assert_allclose(whole.states.reach, np.tile([0.1, 0.45], (3, 1)), rtol=1e-6)
    far = 1e15  # where doubles are an eighth apart
    wide = BallArray(np.array([[far, far]]), np.array([[4.0, 9.0]]))
    pieces = module._in_pieces(lines(1.0), wide, BallArray(np.zeros((1, 1)), np.ones((1, 1))), 3).q_free
    ends = sorted(
        (Fraction(m) - Fraction(r), Fraction(m) + Fraction(r)) for m, r in zip(*(x[3:, 0] for x in pieces), strict=True)
    )
    assert ends[0][0] <= far - 4
    assert ends[-1][1] >= far + 4
    assert all(low[1] >= high[0] for low, high in pairwise(ends))


def test_pieces_are_in_the_box_of_their_branch():
    """Y of each piece is in the interior of the box's, or nothing is told."""
    v = BallArray(np.array([[3.0]]), np.array([[0.1]]))

    def pieces(R):
        return module._in_pieces(parabola(), BallArray(np.array([[4.0, 2.0]]), np.array([[0.5, R]])), v, 2)

    centre = np.array([[q, q**0.5] for q in (3.75, 4.25)])
    box, _ = closed_boxes(parabola(), centre, np.full((2, 1), 0.25 * (1.0 + 1e-12) + 4e-15))
    off = (np.abs(box.mid[:, 1] - 2.0) + box.rad[:, 1]).max()
    assert pieces(off * (1 + 1e-6)) is not None
    with pytest.raises(UnboundedError):
        pieces(off * (1 - 1e-6))
    with np.errstate(all="ignore"), pytest.raises(UnboundedError, match="single"):
        boxes(parabola(), instants(), np.array([[2.5, 0.4]]), 1)


@pytest.mark.parametrize("which", [(True, False), (False, True), (False, False)])
def test_all_boxes_are_to_be_proven(monkeypatch, which):
    """Of the pieces' points and boxes none may be open."""
    real, count = closed_boxes, iter([True, *which])

    def told(*given):
        box, proven = real(*given)
        return box, proven & next(count)

    monkeypatch.setattr(module, "closed_boxes", told)
    v = BallArray(np.array([[3.0]]), np.array([[0.1]]))
    next(count)
    with pytest.raises(UnboundedError):
        module._in_pieces(parabola(), BallArray(np.array([[4.0, 2.0]]), np.array([[0.5, 0.5]])), v, 2)


@pytest.mark.parametrize("fails", [1, 2])
def test_whole_boxes_are_to_be_proven(monkeypatch, fails):
    """And hold σ at the middle: the second and third call."""
    real, calls = closed_boxes, []

    def told(*given):
        box, proven = real(*given)
        calls.append(0)
        if len(calls) == 2 and fails == 1:
            return box, proven & False
        if len(calls) == 3 and fails == 2:
            return BallArray(box.mid, box.rad + 9.0), proven
        return box, proven

    monkeypatch.setattr(module, "closed_boxes", told)
    with pytest.raises(UnboundedError):
        boxes(parabola(), instants(), np.array([[0.2, 0.4]]), 1)


def twice(at):
    """Two slices alike."""
    return Instants(
        *(np.tile(x, 2) for x in at[:2]), *(BallArray(*(np.tile(x, (2, 1)) for x in wide)) for wide in at[2:])
    )


@pytest.mark.parametrize("call", [2, 3, 4, 5])
def test_every_slice_is_to_be_proven(monkeypatch, call):
    """Of two one is open: whole boxes, middles, the pieces' points and the pieces."""
    real, calls = closed_boxes, []

    def told(*given):
        box, proven = real(*given)
        calls.append(0)
        return box, proven & (np.arange(len(proven)) > 0) if len(calls) == call else proven

    monkeypatch.setattr(module, "closed_boxes", told)
    with pytest.raises(UnboundedError, match="single"):
        boxes(parabola(), twice(instants()), np.tile([[0.2, 0.4]], (2, 1)), 2)


@pytest.mark.parametrize(("share", "holds"), [(0.9, True), (1.2, False)])
def test_middles_are_within_the_whole_boxes(monkeypatch, share, holds):
    """Of each slice."""
    real, seen = closed_boxes, []

    def told(*given):
        box, proven = real(*given)
        seen.append(box)
        if len(seen) == 3:
            box.rad[0, 1] = share * seen[1].rad[0, 1]
        return box, proven

    monkeypatch.setattr(module, "closed_boxes", told)
    monkeypatch.setattr(module, "_in_pieces", lambda *_: None)
    try:
        boxes(parabola(), twice(instants()), np.tile([[0.2, 0.4]], (2, 1)), 1)
        assert holds
    except UnboundedError:
        assert not holds


def test_every_dependent_coordinate_of_a_piece_is_in_its_box():
    v = BallArray(np.array([[3.0]]), np.array([[0.1]]))
    for radii, holds in ((([0.5, 1.0, 2.0]), True), (([0.5, 1.0, 0.01]), False), (([0.5, 0.01, 2.0]), False)):
        try:
            module._in_pieces(lines(0.1, 0.2), BallArray(np.array([[4.0, 0.4, 0.8]]), np.array([radii])), v, 2)
            assert holds
        except UnboundedError:
            assert not holds


def test_angles_of_every_slice_are_asked_for():
    one = parabola()
    at = twice(instants())
    at.middle.mid[1], at.during.mid[1] = [9.0, 3.0, 3.0], [9.0, 3.0, 3.0]
    one.wrapped = (SimpleNamespace(place=0, target=ball(4.0)),)
    assert not proves(one, np.tile([[0.2, 0.4]], (2, 1)), at)


def test_angles_on_circles_are_less_than_half_a_turn_away():
    """All over the box."""
    for sign in (1.0, -1.0):
        for more, holds in ((-1.05e-9 * np.pi, True), (-0.95e-9 * np.pi, False)):
            one = parabola()
            one.wrapped = (SimpleNamespace(place=0, target=ball(4.0 + sign * (np.pi - 0.3 + more))),)
            assert proves(one, np.array([[0.2, 0.4]])) is holds


def proves(one, reach, at=None):
    try:
        return boxes(one, at or instants(), reach, 1) is not None
    except UnboundedError as error:
        assert "half a turn" in str(error)  # noqa: PT017
        return False


def test_balls_are_less_than_half_a_turn_away():
    """P · reference > 0 over the box, each entry of p as it may be."""
    slopes = 0.1, 0.2, -0.3, 0.25
    one = lines(*slopes)
    middle = BallArray(np.array([[4.0, *(4.0 * s for s in slopes), 3.0]]), np.zeros((1, 6)))
    at = Instants(np.ones(1), np.full(1, 0.01), middle, middle)
    whole = boxes(one, at, np.array([[0.5, 0.0]]), 1).q_free
    p, rad = whole.mid[0, 1:], whole.rad[0, 1:]
    reference = np.array([0.5, 0.5, 0.5, 0.5])
    short = (p @ reference - rad @ reference) / 0.5
    for more, holds in ((1.05e-9, True), (0.95e-9, False)):
        turned = np.array([0.5, 0.5, 0.5, 0.5])
        turned[3] -= (0.5 * short - more) / (p[3] - rad[3])
        one.upright = (SimpleNamespace(place=1, reference=tuple(ball(x) for x in turned)),)
        assert proves(one, np.array([[0.5, 0.0]]), at) is holds
    other = twice(at)
    other.middle.mid[1, :5] *= -1.0
    other.during.mid[1, :5] = other.middle.mid[1, :5]
    one.upright = (SimpleNamespace(place=1, reference=tuple(ball(0.5) for _ in range(4))),)
    assert proves(one, np.array([[0.5, 0.0]]), at)
    assert not proves(one, np.tile([[0.5, 0.0]], (2, 1)), other)


def test_curvature_of_the_flow():
    """F′ as told, F″[F] along the motion and F″ over the boxes: at their points, and not far beyond."""
    at = instants()
    around = boxes(parabola(), at, np.array([[0.2, 0.4]]), 2)
    slope = at_middles(parabola(), at).slope
    found = curvature_over(parabola(), at, slope, around)
    assert found.slope is slope
    seen = np.zeros((2, 2, 2))
    middle = flow(4.0, 3.0)
    for q in (3.7, 4.0, 4.3):
        for v in (2.55, 3.0, 3.45):
            there = flow(q, v)[2]
            assert np.all(np.abs(there - found.bend.mid[0]) <= found.bend.rad[0] + 1e-15)
            seen = np.maximum(seen, np.abs(there - middle[2]))
    assert np.all(found.bend.rad[0] <= 1.5 * seen + 1e-12)
    for q in (3.9, 4.1):
        for v in (2.95, 3.05):
            value, _, bend = flow(q, v)
            assert np.all(np.abs(bend @ value - found.change.mid[0]) <= found.change.rad[0])
    np.testing.assert_allclose(found.change.mid[0], middle[2] @ middle[0], atol=0.02)
    assert found.change.rad.max() < 0.15


def test_the_flow_of_two_coordinates():
    """F = (q̇, −Kq − Cq̇), each in its place."""
    stiff, damper = np.array([[3.0, -1.0], [0.5, 2.0]]), np.array([[0.4, 0.1], [0.2, 0.3]])
    state = np.array([[1.0, 2.0, 3.0, 5.0]])
    found = module._flow(linear(stiff, damper), exactly(state))
    np.testing.assert_allclose(found.mid[0], [3.0, 5.0, *(-stiff @ state[0, :2] - damper @ state[0, 2:])], rtol=1e-14)


def test_feedback_of_a_sampled_law():
    """∂u/∂(q, v) of u = y v: at middles, and over boxes."""
    tape = Tape(4)
    q, y, v, _ = tape.inputs
    one = loop(tape, 2, 1, [y * y - q], [v, tape.solve([[2 * y]], [[v]])[0, 0], y * v, 0])
    one.efforts = in_balls(tape, [y * v])
    middle = BallArray(np.array([[4.0, 2.0, 3.0, 0.0]]), np.full((1, 4), 1e-15))
    at = Instants(np.ones(1), np.full(1, 0.01), middle, middle)
    np.testing.assert_allclose(feedback(one, at, None, 1).mid, [[[0.75, 2.0]]], atol=1e-12)
    found = feedback(one, at, np.array([0.2, 0.4]), 2)
    assert found.mid.shape == (1, 1, 2)
    for q_there in (3.8, 4.2):
        for v_there in (2.6, 3.4):
            exact = np.array([0.5 * v_there / q_there**0.5, q_there**0.5])
            assert np.all(np.abs(exact - found.mid[0, 0]) <= found.rad[0, 0])
    assert found.rad[0, 0, 1] < 0.06
