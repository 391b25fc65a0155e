"""The tube's bounds as its theorem writes them, tubes of linear flows to their corners, and parts that cover."""

from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm

pytest.importorskip("flint")

from ccpin.programs.tape import Tape
from ccpin.proof.facts import NotProvedError, prove
from ccpin.validated.arithmetic.ball_arrays import BallArray, exactly
from ccpin.validated.arithmetic.balls import ball
from ccpin.validated.arithmetic.exact_numbers import boxed
from ccpin.validated.arithmetic.programs import in_balls
from ccpin.validated.flow.marching import StepOptions, Stuck
from ccpin.validated.flow.motion_claim import MotionEnclosed
from ccpin.validated.flow.motion_task import MotionAsked
from ccpin.validated.flow.start_search import proved_start
from ccpin.validated.flow.step import ProvenStep, start_of
from ccpin.validated.flow.step_claim import step_of
from ccpin.validated.sets import propagation, subdivision
from ccpin.validated.sets import tube_theorem as tube
from ccpin.validated.sets.curvature import Curvature, UnboundedError, at_middles
from ccpin.validated.sets.instants import instants_over
from ccpin.validated.sets.motion_tube_claim import slices_of
from ccpin.validated.sets.propagation import Cut, first_section, grow, marks_over, sampled_section, whole_of
from ccpin.validated.sets.slices_claim import marks_held
from ccpin.validated.sets.subdivision import Starts, Tube, _grown, _motion, _widest, cover
from ccpin.validated.sets.tube_theorem import CrossSection, SliceFrames, _fitting, _stretch, _terms, advance
from tests.support.parabola import equations, linear, loop, parabola
from tests.support.tubes import BITS, motion_of, resting, tube_about

pytestmark = pytest.mark.usefixtures("precise")


def drawn(seed, *shape):
    return np.random.default_rng(seed).normal(size=shape)


def test_g_is_what_the_theorem_says():
    """|P⁻¹|(|X − L| + (h/2)|XL − M + Y| + (h²/4)|½XM + YL| + (h³/16)|YM| + ½η(u)|P|) by the printed form."""
    half, N = np.array([0.05, 0.02]), 3
    A, L, M, F, Y, H = (drawn(k, 2, *[N] * (3 if k == 5 else 2)) for k in range(6))
    A, H = A + 3.0 * np.eye(N), H + H.swapaxes(2, 3)
    known = Curvature(exactly(F), BallArray(Y, np.full_like(Y, 0.01)), BallArray(H, np.full_like(H, 0.02)))
    moving = SliceFrames(A, L, M)
    stretch = _stretch(half, moving)
    found = _terms(half, moving, known, stretch)
    for b, t in enumerate(half):
        E = t * np.abs(L[b]) + 0.5 * t**2 * np.abs(M[b])
        np.testing.assert_allclose(stretch[b], np.eye(N) + E, rtol=1e-10)
        assert np.all(stretch[b] >= np.eye(N) + E)
        delta = E.sum(axis=1).max()
        unstretch = np.eye(N) + E + delta**2 / (1.0 - delta)
        back = np.linalg.inv(A[b])
        X, y = back @ F[b] @ A[b], back @ Y[b] @ A[b]
        wide = np.abs(back) @ np.full((N, N), 0.01) @ np.abs(A[b])  # of Y
        first = np.abs(X @ L[b] - M[b] + y) + wide
        second = np.abs(0.5 * X @ M[b] + y @ L[b]) + wide @ np.abs(L[b])
        third = np.abs(y @ M[b]) + wide @ np.abs(M[b])
        constant = unstretch @ (np.abs(X - L[b]) + t * first + t**2 * second + 0.5 * t**3 * third)
        np.testing.assert_allclose(found.constant[b], constant, rtol=1e-6)
        bilinear = np.einsum("ia,acd,cj,dk->ijk", back, H[b], A[b], A[b])
        spread = np.einsum("ia,acd,cj,dk->ijk", np.abs(back), np.full((N, N, N), 0.02), *[np.abs(A[b])] * 2)
        expected = 0.5 * np.einsum(
            "ia,acd,cj,dk->ijk", unstretch, np.abs(bilinear) + spread, np.eye(N) + E, np.eye(N) + E
        )
        np.testing.assert_allclose(found.quadratic[b], expected, rtol=1e-6)
        np.testing.assert_allclose(found.begin.mid[b], A[b] @ (np.eye(N) - t * L[b] + 0.5 * t**2 * M[b]), atol=1e-12)
        np.testing.assert_allclose(found.end.mid[b], A[b] @ (np.eye(N) + t * L[b] + 0.5 * t**2 * M[b]), atol=1e-12)


@pytest.mark.parametrize(("row", "held"), [(0.89, True), (0.91, False), (1.7, False)])
def test_slices_too_long_for_their_frames_are_refused(row, held):
    """A row sum of E of 0.9 and more; of any row, of any slice."""
    A = np.tile(np.eye(2), (2, 1, 1))
    L = np.zeros((2, 2, 2))
    L[1, 1] = [0.25 * row, 0.75 * row]
    moving = SliceFrames(A, L, np.zeros_like(L))
    known = Curvature(exactly(L), exactly(L), exactly(np.zeros((2, 2, 2, 2))))
    half = np.ones(2)
    try:
        found = _terms(half, moving, known, _stretch(half, moving))
        assert np.all(np.isfinite(found.constant))
        assert held
    except UnboundedError:
        assert not held
    singular = SliceFrames(np.zeros((2, 2, 2)), L, np.zeros_like(L))
    with pytest.raises(UnboundedError, match="thin"):
        _terms(0.1 * half, singular, known, _stretch(0.1 * half, singular))


def test_what_fits_is_inside():
    """Z₀ + hGu < u ≤ room by entry, with G's part in u; what does not in one entry is refused."""
    constant, quadratic = np.array([[1.0, 0.5], [0.0, 1.0]]), np.zeros((2, 2, 2))
    quadratic[0, 1, 1] = 0.25
    start, room, h = np.array([1.0, 0.5]), np.array([4.0, 4.0]), 0.25
    inside, kept = _fitting(constant, quadratic, h, start, room)
    exact = start + h * (constant + quadratic @ inside) @ inside
    np.testing.assert_allclose(kept, exact, rtol=1e-9)
    assert np.all(exact < inside)
    assert np.all(inside <= room)
    np.testing.assert_allclose(inside, kept, rtol=1e-3)
    assert _fitting(constant, quadratic, h, start, np.array([4.0, 0.6])) is None
    assert _fitting(constant, quadratic, h, start, np.array([1.2, 4.0])) is None
    same = _fitting(constant, quadratic, h, start, inside * 1.001)
    assert same is not None
    assert _fitting(constant, quadratic, h, start, kept * 0.999) is None


# A linear flow: q̈ = −Kq − Cv about the motion that rests at 0.

STIFF, DAMP = np.array([[3.0, -1.0], [-1.0, 2.0]]), np.array([[0.4, 0.1], [0.0, 0.3]])
FLOW = np.block([[np.zeros((2, 2)), np.eye(2)], [-STIFF, -DAMP]])


def flowing():
    return equations(linear(STIFF, DAMP))


def still(length, *state):
    """A step of a motion that does not move, with no fact."""
    centre = [ball(x) for x in state]
    return ProvenStep(
        length, [[x, ball(0)] for x in centre], 0.0, [ball(0)] * len(state), [centre], 1.0, start_of(centre)
    )


def alone(one, step, spread):
    """The tube over one step of the motion that rests at 0, as a fact."""
    at_rest = np.zeros(one.n)
    start = proved_start(one, boxed([ball(0)] * one.n, 64), np.zeros(one.n_x), at_rest, 64)
    motion = prove(MotionEnclosed(one, np.zeros(1, dtype=bool), BITS), start, step.fact)
    return tube_about(motion, spread)


def test_tubes_of_linear_flows_reach_their_corners():
    """From |ξ| ≤ s the corners stay inside |z| ≤ u at all ends of slices, and nearly reach them."""
    one, spread = flowing(), np.array([1e-2, 2e-2, 3e-2, 1e-2])
    step = resting(one, 0.25)
    held = alone(one, step, spread)
    pieces, times = slices_of(held), held.found["times"]
    corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * 4)).reshape(4, -1) * spread[:, None]
    begin = 0.0
    for piece, until in zip(pieces, times[1:], strict=True):
        end = piece.time + piece.half
        assert piece.time - piece.half == begin
        assert end == until
        z = np.linalg.solve(piece.end.mid, expm(FLOW * end) @ corners)
        assert np.all(np.abs(z).max(axis=1) <= piece.kept * (1 + 1e-12))
        assert np.all(np.abs(z).max(axis=1) >= 0.97 * piece.kept)
        for part in (-1.0, 0.0, 0.7):
            there = expm(FLOW * (piece.time + part * piece.half)) @ corners
            assert np.all(np.abs(there) <= piece.reach[:, None] * (1 + 1e-12))
            tau = part * piece.half
            A = piece.frame @ (np.eye(4) + tau * piece.rate + 0.5 * tau**2 * piece.curve)
            assert np.all(np.abs(np.linalg.solve(A, there)) <= piece.bound[:, None])
        begin = end
    assert begin == step.length
    last = pieces[-1]
    assert np.all(last.reach <= 1.5 * np.abs(last.frame) @ last.bound)


def test_slices_hand_on_what_they_end_with(monkeypatch):
    """Z at the next slice's beginning is |A⁺⁻¹A| times what the one before kept, slice by slice."""
    one = flowing()
    at = instants_over(resting(one, 0.125), marks_over(0.125, 2))
    middle = at_middles(one, at)
    begin = np.eye(4) + 0.1 * drawn(9, 4, 4)
    moving = propagation.frames(at, middle, begin)
    asked = []
    real = tube._fitting

    def told(constant, quadratic, h, start, room):
        asked.append((h, start, room))
        return real(constant, quadratic, h, start, room)

    monkeypatch.setattr(tube, "_fitting", told)
    turned = begin @ np.diag([2.0, 1.0, 0.5, 1.0])
    bound = np.array([0.01, 0.02, 0.01, 0.02])
    room = np.tile([0.1, 0.1, 0.1, 0.1], (2, 1))
    first, second = advance(one, at, middle.slope, moving, CrossSection(exactly(turned), bound), room, 1)
    half = at.half[0]

    def frame(k, tau):
        return moving.frame[k] @ (np.eye(4) + tau * moving.rate[k] + 0.5 * tau**2 * moving.curve[k])

    np.testing.assert_allclose(asked[0][1], np.abs(np.linalg.solve(frame(0, -half), turned)) @ bound, rtol=1e-9)
    np.testing.assert_allclose(
        asked[1][1], np.abs(np.linalg.solve(frame(1, -half), frame(0, half))) @ first.kept, rtol=1e-9
    )
    assert [h for h, *_ in asked] == [2 * half, 2 * half]
    np.testing.assert_allclose(first.end.mid, frame(0, half), atol=1e-12)
    stretch = np.eye(4) + half * np.abs(moving.rate[1]) + 0.5 * half**2 * np.abs(moving.curve[1])
    np.testing.assert_allclose(second.reach, np.abs(moving.frame[1]) @ stretch @ second.bound, rtol=1e-9)
    less = np.stack([room[0], 1e-9 * room[1]])
    (only,) = advance(one, at, middle.slope, moving, CrossSection(exactly(turned), bound), less, 1)
    np.testing.assert_array_equal(only.kept, first.kept)


def test_the_room_of_a_tube_is_what_its_boxes_are_for(monkeypatch):
    """|A_m||P| room is the half-width for which σ and F″ are asked."""
    one = flowing()
    at = whole_of(resting(one, 0.125))
    middle = at_middles(one, at)
    moving = propagation.frames(at, middle, np.eye(4))
    asked = []
    real = tube.boxes
    monkeypatch.setattr(tube, "boxes", lambda *given: asked.append(given[2]) or real(*given))
    room = np.array([[0.1, 0.2, 0.3, 0.4]])
    advance(one, at, middle.slope, moving, CrossSection(exactly(np.eye(4)), np.full(4, 0.01)), room, 1)
    half = at.half[0]
    stretch = np.eye(4) + half * np.abs(moving.rate[0]) + 0.5 * half**2 * np.abs(moving.curve[0])
    np.testing.assert_allclose(asked[0][0], np.abs(moving.frame[0]) @ stretch @ room[0], rtol=1e-9)


def test_curved_flows_stay_in_their_tubes():
    """F(q, v) = (v, √q v) about its own motion: starts at the corners, integrated finely."""
    one, spread = equations(parabola()), np.array([0.02, 0.05])
    motion = motion_of(one, [4.0], [2.0], [1.0], 0.0625)
    length = motion.found["times"][-1]
    assert length == 0.0625
    last = slices_of(tube_about(motion, spread, Cut(2, np.inf)))[-1]

    def rate(x):
        return np.array([x[1], np.sqrt(x[0]) * x[1]])

    def moved(x, t, count=64):
        h = t / count
        for _ in range(count):
            a = rate(x)
            b = rate(x + 0.5 * h * a)
            c = rate(x + 0.5 * h * b)
            x = x + h / 6 * (a + 2 * b + 2 * c + rate(x + h * c))
        return x

    largest = np.zeros(2)
    for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        off = moved(np.array([4.0, 1.0]) + spread * signs, length) - moved(np.array([4.0, 1.0]), length)
        largest = np.maximum(largest, np.abs(np.linalg.solve(last.end.mid, off)))
    assert np.all(largest <= last.kept)
    assert np.all(largest >= 0.9 * last.kept)


def test_first_sections_hold_the_starts():
    """|A z| over |z| ≤ bound covers the spread, thin edges made thicker; hardly more."""
    one = flowing()
    step = resting(one, 0.125)
    for spread in (np.array([1e-2, 2e-2, 3e-2, 1e-2]), np.array([1e-2, 0.0, 1e-9, 0.5])):
        section = first_section(one, step, spread)
        held = np.abs(section.frame.mid) @ section.bound
        assert np.all(held >= spread)
        np.testing.assert_allclose(held, spread, rtol=1e-12, atol=1e-30)
        assert np.linalg.cond(section.frame.mid / np.array([1.0, 1.0, 2.0, 2.0])[:, None]) < 120.0
    assert propagation.fastest_rate(one, whole_of(step)) == pytest.approx(
        np.abs(np.linalg.eigvals(FLOW)).max(), rel=1e-9
    )
    for seed in range(40):
        spread = np.abs(drawn(seed, 4))
        section = first_section(one, step, spread)
        edges = np.diag(section.frame.mid)
        assert all(
            Fraction(e) * Fraction(b) >= Fraction(s) for e, b, s in zip(edges, section.bound, spread, strict=True)
        )


@pytest.mark.parametrize("fails", [None, 1, 3])
def test_slices_follow_one_another_however_many_are_proved_at_once(monkeypatch, fails):
    """Each batch begins where the last one ended, with its cross-section; finer slices where one fails."""
    one = flowing()
    step = resting(one, 0.25)
    asked, count = [], 0

    def told(loop, fact, marks, section, *_):
        nonlocal count
        assert (loop, fact) == (one, step.fact)
        asked.append((marks, section))
        count += 1
        if fails is not None and fails <= count < fails + 4 and len(marks) < 10:
            raise NotProvedError("not so")
        held = min(2, len(marks) - 1)
        ends = np.array([(10.0 * count + k) * np.eye(4) for k in range(held)])
        found = {"bound": np.ones((held, 4)), "kept": np.full((held, 4), float(count))}
        return SimpleNamespace(
            found=found | {"end": ends, "end_radius": 0.0 * ends}, claim=SimpleNamespace(marks=marks)
        )

    monkeypatch.setattr(propagation, "_proved", told)
    monkeypatch.setattr(propagation, "growth", lambda _: 1.0)
    monkeypatch.setattr(propagation, "_AT_ONCE", 4)
    first = CrossSection(exactly(np.eye(4)), np.ones(4))
    at, last, bound, number = 0.0, first.frame, first.bound, 0
    for part in grow(one, step, first, Cut(1, np.inf), 64):
        marks, before = asked[-1]
        assert marks[0] == at
        np.testing.assert_array_equal(before.frame.mid, last.mid)
        np.testing.assert_array_equal(before.bound, bound)
        at = marks_held(part)[-1]
        number += len(part.found["bound"])
        last, bound = exactly(part.found["end"][-1]), part.found["kept"][-1]
    assert at == step.length
    assert number > 8


def test_tubes_that_are_not_proved_however_finely_they_are_cut(monkeypatch):
    """Nothing is told of what follows."""
    one = flowing()

    def refused(*_):
        raise NotProvedError("the tube grows too fast")

    monkeypatch.setattr(propagation, "_proved", refused)
    with pytest.raises(UnboundedError, match="too fast"):
        list(grow(one, resting(one, 0.25), CrossSection(exactly(np.eye(4)), np.ones(4)), Cut(1, np.inf), 64))


def sampled():
    """Q̈ = u with u = −2q − 3v held."""
    tape = Tape(3)
    q, v, u = tape.inputs
    one = loop(tape, 1, 1, [], [v, u, 0])
    one.efforts = in_balls(tape, [q * -2 - v * 3])
    return one


def test_sections_just_after_a_sample():
    """The efforts are those of the law: every state of the section that (q, v) allows is in the new one."""
    one = equations(sampled())
    step = still(0.125, 0.0, 0.0, 0.0)
    section = CrossSection(
        exactly(np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])), np.array([0.1, 0.2, 9.0])
    )
    found = sampled_section(one, step, section, Cut(1, np.inf))
    assert propagation.fastest_rate(one, whole_of(step)) == pytest.approx(2.0, rel=1e-9)  # of s² + 3s + 2
    largest = np.zeros(3)
    for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        q, v = np.array([[1.0, 0.5], [0.0, 1.0]]) @ (np.array([0.1, 0.2]) * signs)
        z = np.linalg.solve(found.frame.mid, [q, v, -2 * q - 3 * v])
        largest = np.maximum(largest, np.abs(z))
    assert np.all(largest <= found.bound * (1 + 1e-12))
    np.testing.assert_allclose(largest[:2], found.bound[:2], rtol=1e-9)
    assert found.bound[2] < 1e-9
    curved = equations(sampled_of_root())
    at = still(0.125, 4.0, 2.0, 3.0, 6.0)
    section = CrossSection(exactly(np.eye(3)), np.array([0.1, 0.2, 9.0]))
    found = sampled_section(curved, at, section, Cut(2, np.inf))
    largest = np.zeros(3)
    for dq in (-0.1, 0.0, 0.1):
        for dv in (-0.2, 0.0, 0.2):
            du = np.sqrt(4.0 + dq) * (3.0 + dv) - 6.0
            largest = np.maximum(largest, np.abs(np.linalg.solve(found.frame.mid, [dq, dv, du])))
    assert np.all(largest <= found.bound * (1 + 1e-12))
    assert found.bound[2] < 1.0 + 1e-9


def sampled_of_root():
    """U = y v of y² = q, held; q̈ = u."""
    tape = Tape(4)
    q, y, v, u = tape.inputs
    one = loop(tape, 2, 1, [y * y - q], [v, tape.solve([[2 * y]], [[v]])[0, 0], u, 0])
    one.efforts = in_balls(tape, [y * v])
    return one


# Parts of a box of starts.


def starts(*spread):
    n = len(spread) // 2
    return Starts(np.arange(1.0, 1.0 + n), np.zeros(n), np.array(spread))


def test_halves_cover_and_no_more():
    whole = starts(0.5, 0.25, 1.0, 2.0)
    for k, centre in ((0, 1.0), (1, 2.0), (2, 0.0), (3, 0.0)):
        low, high = whole.halves(k)
        middle = [np.append(half.q, half.v) for half in (low, high)]
        s = whole.spread[k]
        assert [m[k] for m in middle] == [centre - 0.5 * s, centre + 0.5 * s]
        others = np.arange(4) != k
        for half, m in zip((low, high), middle, strict=True):
            np.testing.assert_array_equal(m[others], np.append(whole.q, whole.v)[others])
            np.testing.assert_array_equal(half.spread[others], whole.spread[others])
            assert half.spread[k] == pytest.approx(0.5 * s, rel=2e-12)
            assert half.spread[k] >= 0.5 * s * (1 + 0.9e-12) + 4e-16 * (1.0 + centre)
        assert middle[0][k] - low.spread[k] < centre - s
        assert middle[1][k] + high.spread[k] > centre + s
    tiny = Starts(np.array([1e3 + 0.1]), np.zeros(1), np.array([1e-14, 0.0]))
    low, high = tiny.halves(0)
    assert low.spread[0] >= 0.5e-14 + 4e-16 * 1e3


def proven_or_not(monkeypatch, rule):
    """`cover` of boxes that are proven where a rule says so; the boxes tried."""
    tried = []

    def told(job, box):
        tried.append(box)
        verdict, across = rule(box)
        return SimpleNamespace(verdict=verdict, reason="why", starts=box), across

    monkeypatch.setattr(subdivision, "_grown", told)
    return tried


def test_parts_are_halved_until_they_are_proven(monkeypatch):
    """In order; with as many as are allowed, no more."""
    proven_or_not(monkeypatch, lambda box: ("proven" if box.spread[0] < 0.3 else "undecided", 0))
    done, cut, place, missing = cover(None, starts(1.0, 0.0), 4)
    assert missing == ""
    assert cut == [0, 0, -1, -1, 0, -1, -1]
    assert place[:2] == [1.0, 0.5]
    assert place[4] == 1.5
    np.testing.assert_allclose([tube.starts.q[0] for tube in done], [0.25, 0.75, 1.25, 1.75], rtol=1e-11)
    done, *_, missing = cover(None, starts(1.0, 0.0), 3)
    assert missing == "why"
    assert len(done) <= 3
    assert cover(None, starts(0.5, 0.0), 2).missing == ""
    assert cover(None, starts(0.5, 0.0), 1).missing == "why"
    tried = proven_or_not(monkeypatch, lambda box: ("undecided", None))
    assert cover(None, starts(0.5, 0.0), 9).missing == "why"
    assert len(tried) == 1
    tried = proven_or_not(monkeypatch, lambda box: ("proven" if box.spread[0] < 1e-3 else "undecided", 0))
    assert cover(None, starts(1.0, 0.0), 3).missing == "why"
    assert len(tried) == 3
    done, *_, missing = cover(None, starts(0.1, 0.0), 0 + 1)
    assert len(done) == 1
    assert missing == "why"


def job(one, duration, arrived=None, period=np.inf):
    options = StepOptions(order=8, tolerance=1e-12, pieces=2, shortest=2.0**-12, longest=1.0)
    known = equations(one)

    def asked(near, q, v):
        assert near.tolist() == [float(x) for x in q]
        return MotionAsked(boxed(q, 120), v, np.zeros(one.n_x), duration)

    model = SimpleNamespace(coordinates=SimpleNamespace(parts=[SimpleNamespace(v=slice(0, 1), whole=None)]))
    motion = SimpleNamespace(
        model=model,
        loop=SimpleNamespace(equations=known),
        asked=asked,
        start=lambda told: proved_start(known, told.q, told.x, told.v, 120),
        duration=duration,
        options=options,
        precision=120,
    )
    return subdivision.TubeTask(motion, Cut(1, np.inf), arrived, period)


@pytest.fixture
def regular(monkeypatch):
    """Enclosures are what they are made of."""

    def told(loop, asked, motion, stopped):
        assert asked.is_of(motion)
        assert asked.duration == motion.found["times"][-1]
        steps = [step_of(step) for step in motion.premises[1:]]
        return SimpleNamespace(verdict="proven", motion=motion, steps=steps, loop=loop)

    monkeypatch.setattr(subdivision, "told_of", told)


def spring():
    return linear(np.array([[4.0]]), np.array([[0.5]]))


def test_a_tube_of_one_box(regular):
    """All of the time asked for: slices from 0 to its end, around the motion from the middle of the starts."""
    box = Starts(np.array([0.5]), np.array([-0.25]), np.array([0.01, 0.02]))
    found, _ = _grown(job(spring(), 0.25), box)
    assert found.verdict == "proven"
    assert found.duration == 0.25
    assert sum(step.length for step in found.enclosure.steps) == 0.25
    flow = np.array([[0.0, 1.0], [-4.0, -0.5]])
    last = found.slices[-1]
    for signs in ((1, 1), (1, -1)):
        off = expm(flow * 0.25) @ (box.spread * signs)
        assert np.all(np.abs(np.linalg.solve(last.end.mid, off)) <= last.kept)
    np.testing.assert_allclose(np.abs(last.end.mid) @ last.kept, np.abs(expm(flow * 0.25)) @ box.spread, rtol=0.1)


def test_where_a_tube_stops(regular, monkeypatch):
    """When the motions have arrived; where nothing is proved; and which coordinate is halved then."""
    box = Starts(np.array([0.5]), np.array([-0.25]), np.array([0.01, 0.02]))
    asked = []

    def arrived(slices):
        asked.append(marks_held(slices)[-1])
        return "" if asked[-1] > 0.01 else "not yet"

    found, across = _grown(job(spring(), 0.25, arrived), box)
    assert found.verdict == "proven"
    assert across is None
    assert found.duration == found.asked == asked[-1] < 0.25
    found, across = _grown(job(spring(), 0.01, lambda piece: "not yet"), box)
    assert (found.verdict, across) == ("undecided", _widest(box, found.held.premises[-1]))
    assert (found.asked, found.duration) == (np.inf, 0.01 // 2.0**-40 * 2.0**-40 + 2.0**-40)
    assert "not yet" in found.reason
    found, across = _grown(job(spring(), 0.01, lambda piece: subdivision.TOO_EARLY), box)
    assert (found.verdict, across) == ("undecided", None)
    honest = subdivision.proved_motion
    with monkeypatch.context() as context:
        context.setattr(subdivision, "proved_motion", lambda *given: (honest(*given)[0], "refused"))
        found, _ = _grown(job(spring(), 0.01), box)
        assert (found.verdict, "refused" in found.reason) == ("undecided", True)
    monkeypatch.setattr(subdivision, "march", lambda *_: iter([Stuck("stuck")]))
    found, across = _grown(job(spring(), 0.25), Starts(box.q, box.v, np.array([0.03, 0.02])))
    assert (found.verdict, across, found.duration) == ("undecided", 0, 0.0)
    assert "stuck" in found.reason


def test_motions_under_sampled_laws(regular):
    """Each sample reads the law; the period's last piece is no longer than what is left."""
    one = sampled()
    start = [ball(1.0), ball(-0.5), ball(0)]
    assert [float(x) for x in one.at_a_sample(start)] == [1.0, -0.5, -0.5]
    plain = spring()
    assert plain.at_a_sample(start[:2]) == start[:2]
    found = list(_motion(job(one, 0.3125, period=0.125), start))
    lengths = [step.length for step, _ in found]
    assert sum(lengths) == 0.3125
    times = np.concatenate([[0.0], np.cumsum(lengths)[:-1]])
    for time, (_, is_sample) in zip(times, found, strict=True):
        assert is_sample is (time in (0.0, 0.125, 0.25))
    x, since = np.array([1.0, -0.5]), 0.0
    for held in (0.125, 0.125, 0.0625):
        u = -2 * x[0] - 3 * x[1]
        x = np.array([x[0] + held * x[1] + 0.5 * held**2 * u, x[1] + held * u])
        since += held
    np.testing.assert_allclose([float(c) for c in found[-1][0].end.centre[:2]], x, atol=1e-9)
    assert next(s for _, s in _motion(job(spring(), 0.125), start[:2])) is False


@pytest.mark.usefixtures("regular")
def test_a_tube_of_a_sampled_loop_is_round_one_motion():
    """Its steps go on from one another where the law is read as well."""
    box = Starts(np.array([0.5]), np.array([-0.25]), np.array([0.01, 0.02]))
    found, _ = _grown(job(sampled(), 2.0**-5, period=2.0**-6), box)
    assert (found.verdict, found.duration) == ("proven", 2.0**-5)
    assert len(found.enclosure.steps) >= 2


def test_the_widest_coordinate_of_the_starts():
    """By the shares of the last cross-section's rows; none of a width of 0."""

    def slices(frame, bound):
        claim = SimpleNamespace(frame=np.array([np.eye(2), frame, np.eye(2)]))
        return SimpleNamespace(claim=claim, found={"bound": np.array([[9.0, 1.0], bound])})

    last = slices([[1.0, 0.2], [0.1, 3.0]], [1.0, 2.0])
    assert _widest(starts(1.0, 1.0), last) == 1
    assert _widest(starts(1.0, 0.0), last) == 0
    assert _widest(starts(0.0, 0.0), last) is None
    tilted = slices([[5.0, 1.0], [1.0, 1.0]], [1.0, 1.0])
    assert _widest(starts(1.0, 1.0), tilted) == 0


def test_places_in_a_tube():
    """Z/u of states at times: of the slice that the time is in, with its frame at that time."""
    one, box = equations(spring()), Starts(np.array([0.5]), np.array([-0.25]), np.array([0.01, 0.02]))
    motion = motion_of(one, box.q, [], box.v, 2.0**-4)
    held = tube_about(motion, box.spread)
    own = SimpleNamespace(equations=one)
    enclosure = SimpleNamespace(loop=own, inputs=lambda t: [ball(3.0), ball(t)], motion=motion, verdict="proven")
    found = Tube(box, 2.0**-4, enclosure, held)
    assert (found.verdict, found.duration) == ("proven", 2.0**-4)
    assert len(found.slices) > 2
    ends = held.found["times"][1:]
    for t in (0.0, 0.011, ends[0], ends[1], 2.0**-4):
        here = found.slices[min(sum(end <= t for end in ends), len(ends) - 1)]
        tau = t - here.time
        assert abs(tau) <= here.half
        A = here.frame @ (np.eye(2) + tau * here.rate + 0.5 * tau**2 * here.curve)
        z = np.array([0.3, -0.7])
        q, v = np.array([3.0, t]) + A @ (z * here.bound)
        np.testing.assert_allclose(found.coordinates(t, [q], [v]), z, rtol=1e-10)
        centre, reach = found.box(t)
        np.testing.assert_array_equal(centre, [3.0, t])
        np.testing.assert_array_equal(reach, here.reach)
    for t in (-1e-9, 2.0**-4 + 1e-9):
        with pytest.raises(subdivision.InvalidInputError, match="covered"):
            found.box(t)
    empty = Tube(box, 2.0**-4, enclosure, None)
    assert (empty.verdict, empty.duration, empty.slices) == ("undecided", 0.0, ())
    with pytest.raises(subdivision.InvalidInputError, match="covered"):
        empty.box(0.0)
