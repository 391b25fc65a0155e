"""The tube's bounds as its theorem writes them, tubes of linear flows to their corners, and parts that cover."""

from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm

pytest.importorskip("flint")

from ccpin.validated.arithmetic.ball_arrays import BallArray, exactly
from ccpin.validated.arithmetic.balls import ball
from ccpin.validated.arithmetic.exact_numbers import boxed
from ccpin.validated.arithmetic.series import all_series
from ccpin.validated.arithmetic.tape import Tape
from ccpin.validated.flow.marching import StepOptions, Stuck
from ccpin.validated.flow.motion_task import MotionAsked
from ccpin.validated.flow.start_search import proved_start
from ccpin.validated.flow.step import ProvenStep, WatchedField, attempt, start_of
from ccpin.validated.flow.step_claim import step_of
from ccpin.validated.sets import propagation, subdivision
from ccpin.validated.sets import tube_theorem as tube
from ccpin.validated.sets.curvature import Curvature, Instants, UnboundedError
from ccpin.validated.sets.propagation import CrossSection, Cut, first_section, grow, instants_of, sampled_section
from ccpin.validated.sets.subdivision import Starts, Tube, _grown, _motion, _widest, cover
from ccpin.validated.sets.tube_theorem import SliceFrames, TimeSlice, _fitting, _stretch, _terms, advance
from tests.support.parabola import equations, linear, loop, parabola

pytestmark = pytest.mark.usefixtures("precise")


def drawn(seed, *shape):
    return np.random.default_rng(seed).normal(size=shape)


def test_g_is_what_the_theorem_says():
    """|P⁻¹|(|X − L| + (h/2)|XL − M + Y| + (h²/4)|½XM + YL| + (h³/16)|YM| + ½η(u)|P|) by the printed form."""
    half, N = np.array([0.05, 0.02]), 3
    A, L, M, F, Y, H = (drawn(k, 2, *[N] * (3 if k == 5 else 2)) for k in range(6))
    A, H = A + 3.0 * np.eye(N), H + H.swapaxes(2, 3)
    known = Curvature(exactly(F), BallArray(Y, np.full_like(Y, 0.01)), BallArray(H, np.full_like(H, 0.02)))
    moving = SliceFrames(A, L, M, exactly(F))
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
    moving = SliceFrames(A, L, np.zeros_like(L), exactly(L))
    known = Curvature(exactly(L), exactly(L), exactly(np.zeros((2, 2, 2, 2))))
    half = np.ones(2)
    try:
        found = _terms(half, moving, known, _stretch(half, moving))
        assert np.all(np.isfinite(found.constant))
        assert held
    except UnboundedError:
        assert not held
    singular = SliceFrames(np.zeros((2, 2, 2)), L, np.zeros_like(L), exactly(L))
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


def resting(size, length, error=0.0):
    """A step of the motion that rests at 0."""
    zero = [ball(0)] * size
    return ProvenStep(
        length, [[ball(0), ball(0)] for _ in range(size)], 0.0, [ball(error)] * size, [zero], 1.0, start_of(zero)
    )


def test_tubes_of_linear_flows_reach_their_corners():
    """From |ξ| ≤ s the corners stay inside |z| ≤ u at all ends of slices, and nearly reach them."""
    one, spread = linear(STIFF, DAMP), np.array([1e-2, 2e-2, 3e-2, 1e-2])
    step = resting(4, 0.25)
    section = first_section(one, instants_of(step, 0.0, 1), spread)
    batches = list(grow(one, step, 0.0, section, Cut(1, np.inf)))
    pieces = [piece for batch in batches for piece in batch]
    corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * 4)).reshape(4, -1) * spread[:, None]
    begin = 0.0
    for piece in pieces:
        end = piece.time + piece.instant.half[0]
        assert piece.time - piece.instant.half[0] == begin
        z = np.linalg.solve(piece.end.mid, expm(FLOW * end) @ corners)
        assert np.all(np.abs(z).max(axis=1) <= piece.kept * (1 + 1e-12))
        assert np.all(np.abs(z).max(axis=1) >= 0.97 * piece.kept)
        for part in (-1.0, 0.0, 0.7):
            there = expm(FLOW * (piece.time + part * piece.instant.half[0])) @ corners
            assert np.all(np.abs(there) <= piece.reach[:, None] * (1 + 1e-12))
            tau = part * piece.instant.half[0]
            A = piece.frame @ (np.eye(4) + tau * piece.rate + 0.5 * tau**2 * piece.curve)
            assert np.all(np.abs(np.linalg.solve(A, there)) <= piece.bound[:, None])
        begin = end
    assert begin == step.length
    last = pieces[-1]
    assert np.all(last.reach <= 1.5 * np.abs(last.frame) @ last.bound)


def test_slices_hand_on_what_they_end_with(monkeypatch):
    """Z at the next slice's beginning is |A⁺⁻¹A| times what the one before kept, slice by slice."""
    one = linear(STIFF, DAMP)
    step = resting(4, 0.125)
    at = instants_of(step, 0.0, 2)
    begin = np.eye(4) + 0.1 * drawn(9, 4, 4)
    moving = tube.frames(one, at, begin)
    asked = []
    real = tube._fitting

    def told(constant, quadratic, h, start, room):
        asked.append((h, start, room))
        return real(constant, quadratic, h, start, room)

    monkeypatch.setattr(tube, "_fitting", told)
    turned = begin @ np.diag([2.0, 1.0, 0.5, 1.0])
    bound = np.array([0.01, 0.02, 0.01, 0.02])
    room = np.tile([0.1, 0.1, 0.1, 0.1], (2, 1))
    first, second = advance(one, at, moving, (exactly(turned), bound), room, 1)
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
    (only,) = advance(one, at, moving, (exactly(turned), bound), np.stack([room[0], 1e-9 * room[1]]), 1)
    np.testing.assert_array_equal(only.kept, first.kept)
    assert only.time == at.time[0]


def test_the_room_of_a_tube_is_what_its_boxes_are_for(monkeypatch):
    """|A_m||P| room is the half-width for which σ and F″ are asked."""
    one, step = linear(STIFF, DAMP), resting(4, 0.125)
    at = instants_of(step, 0.0, 1)
    moving = tube.frames(one, at, np.eye(4))
    asked = []
    real = tube.boxes
    monkeypatch.setattr(tube, "boxes", lambda *given: asked.append(given[2]) or real(*given))
    room = np.array([[0.1, 0.2, 0.3, 0.4]])
    advance(one, at, moving, (exactly(np.eye(4)), np.full(4, 0.01)), room, 1)
    half = at.half[0]
    stretch = np.eye(4) + half * np.abs(moving.rate[0]) + 0.5 * half**2 * np.abs(moving.curve[0])
    np.testing.assert_allclose(asked[0][0], np.abs(moving.frame[0]) @ stretch @ room[0], rtol=1e-9)


def test_curved_flows_stay_in_their_tubes():
    """F(q, v) = (v, √q v) about its own motion: starts at the corners, integrated finely."""
    one = parabola()
    start = start_of([ball(4.0), ball(2.0), ball(1.0)])
    series = all_series(one.field, start.centre, 12)
    step = attempt(WatchedField(one.field, lambda box: 1.0), start, series, 0.0625, 4)
    assert isinstance(step, ProvenStep), step
    spread = np.array([0.02, 0.05])
    section = first_section(one, instants_of(step, 0.0, 1), spread)
    pieces = [p for batch in grow(one, step, 0.0, section, Cut(2, np.inf)) for p in batch]
    last = pieces[-1]

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
        off = moved(np.array([4.0, 1.0]) + spread * signs, step.length) - moved(np.array([4.0, 1.0]), step.length)
        largest = np.maximum(largest, np.abs(np.linalg.solve(last.end.mid, off)))
    assert np.all(largest <= last.kept)
    assert np.all(largest >= 0.9 * last.kept)


def test_first_sections_hold_the_starts():
    """|A z| over |z| ≤ bound covers the spread, thin edges made thicker; hardly more."""
    one, at = linear(STIFF, DAMP), instants_of(resting(4, 0.125), 0.0, 1)
    for spread in (np.array([1e-2, 2e-2, 3e-2, 1e-2]), np.array([1e-2, 0.0, 1e-9, 0.5])):
        section = first_section(one, at, spread)
        held = np.abs(section.frame.mid) @ section.bound
        assert np.all(held >= spread)
        np.testing.assert_allclose(held, spread, rtol=1e-12)
        assert np.linalg.cond(section.frame.mid / np.array([1.0, 1.0, 2.0, 2.0])[:, None]) < 120.0
    assert propagation.fastest_rate(one, at) == pytest.approx(np.abs(np.linalg.eigvals(FLOW)).max(), rel=1e-9)
    for seed in range(40):
        spread = np.abs(drawn(seed, 4))
        section = first_section(one, at, spread)
        edges = np.diag(section.frame.mid)
        assert all(
            Fraction(e) * Fraction(b) >= Fraction(s) for e, b, s in zip(edges, section.bound, spread, strict=True)
        )


@pytest.mark.parametrize("fails", [None, 1, 3])
def test_slices_follow_one_another_however_many_are_proved_at_once(monkeypatch, fails):
    """Each batch begins where the last one ended, with its cross-section; finer slices where one fails."""
    one, step = linear(STIFF, DAMP), resting(4, 0.25)
    asked, count = [], 0

    def told(loop, part, moving, before, room, pieces):
        nonlocal count
        asked.append((part.time - part.half, part.time + part.half, before))
        count += 1
        if fails is not None and fails <= count < fails + 4 and len(part.time) < 9:
            return []
        found = []
        for k in range(min(2, len(part.time))):
            end, kept = exactly((10.0 * count + k) * np.eye(4)), np.full(4, float(count))
            found.append(SimpleNamespace(end=end, kept=kept, instant=part.part(np.s_[k : k + 1])))
        return found

    monkeypatch.setattr(propagation, "advance", told)
    monkeypatch.setattr(propagation, "frames", lambda *_: None)
    monkeypatch.setattr(propagation, "_turned", lambda frame, *_: frame)
    monkeypatch.setattr(propagation, "growth", lambda _: 1.0)
    monkeypatch.setattr(propagation, "_AT_ONCE", 4)
    first = CrossSection(exactly(np.eye(4)), np.ones(4))
    at, last, bound, number = 0.0, first.frame, first.bound, 0
    for batch in grow(one, step, 0.0, first, Cut(1, np.inf)):
        (begins, _, before) = asked[-1]
        assert begins[0] == at
        np.testing.assert_array_equal(before[0].mid, last.mid)
        np.testing.assert_array_equal(before[1], bound)
        for piece in batch:
            assert piece.instant.time[0] - piece.instant.half[0] == at
            at = piece.instant.time[0] + piece.instant.half[0]
            number += 1
        last, bound = batch[-1].end, batch[-1].kept
    assert at == step.length
    assert number > 8


def test_tubes_that_are_not_proved_however_finely_they_are_cut(monkeypatch):
    """Nothing is told of what follows."""
    one, step = linear(STIFF, DAMP), resting(4, 0.25)
    monkeypatch.setattr(propagation, "advance", lambda *_: [])
    with pytest.raises(UnboundedError, match="too fast"):
        list(grow(one, step, 0.0, CrossSection(exactly(np.eye(4)), np.ones(4)), Cut(1, np.inf)))


def sampled():
    """Q̈ = u with u = −2q − 3v held."""
    tape = Tape(3)
    q, v, u = tape.inputs
    one = loop(tape, 1, 1, [], [v, u, 0])
    one.efforts = tape.program([q * -2 - v * 3])
    return one


def test_sections_just_after_a_sample():
    """The efforts are those of the law: every state of the section that (q, v) allows is in the new one."""
    one = sampled()
    step = resting(3, 0.125)
    section = CrossSection(
        exactly(np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])), np.array([0.1, 0.2, 9.0])
    )
    found = sampled_section(one, step, section, Cut(1, np.inf))
    assert propagation.fastest_rate(one, instants_of(step, 0.0, 1)) == pytest.approx(2.0, rel=1e-9)  # of s² + 3s + 2
    largest = np.zeros(3)
    for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        q, v = np.array([[1.0, 0.5], [0.0, 1.0]]) @ (np.array([0.1, 0.2]) * signs)
        z = np.linalg.solve(found.frame.mid, [q, v, -2 * q - 3 * v])
        largest = np.maximum(largest, np.abs(z))
    assert np.all(largest <= found.bound * (1 + 1e-12))
    np.testing.assert_allclose(largest[:2], found.bound[:2], rtol=1e-9)
    assert found.bound[2] < 1e-9
    curved = sampled_of_root()
    at = resting(4, 0.125)._replace(polynomial=[[ball(c), ball(0)] for c in (4.0, 2.0, 3.0, 6.0)])
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
    one.efforts = tape.program([y * v])
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
    done, missing = cover(None, starts(1.0, 0.0), 4)
    assert missing == ""
    np.testing.assert_allclose([tube.starts.q[0] for tube in done], [0.25, 0.75, 1.25, 1.75], rtol=1e-11)
    done, missing = cover(None, starts(1.0, 0.0), 3)
    assert missing == "why"
    assert len(done) <= 3
    assert cover(None, starts(0.5, 0.0), 2)[1] == ""
    assert cover(None, starts(0.5, 0.0), 1)[1] == "why"
    tried = proven_or_not(monkeypatch, lambda box: ("undecided", None))
    assert cover(None, starts(0.5, 0.0), 9)[1] == "why"
    assert len(tried) == 1
    tried = proven_or_not(monkeypatch, lambda box: ("proven" if box.spread[0] < 1e-3 else "undecided", 0))
    assert cover(None, starts(1.0, 0.0), 3)[1] == "why"
    assert len(tried) == 3
    done, missing = cover(None, starts(0.1, 0.0), 0 + 1)
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
        return [step_of(step) for step in motion.premises[1:]]

    monkeypatch.setattr(subdivision, "told_of", told)


def spring():
    return linear(np.array([[4.0]]), np.array([[0.5]]))


def test_a_tube_of_one_box(regular):
    """All of the time asked for: slices from 0 to its end, around the motion from the middle of the starts."""
    box = Starts(np.array([0.5]), np.array([-0.25]), np.array([0.01, 0.02]))
    found, _ = _grown(job(spring(), 0.25), box)
    assert found.verdict == "proven"
    assert found.duration == 0.25
    assert sum(step.length for step in found.enclosure) == 0.25
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

    def arrived(piece):
        asked.append(piece.time)
        return "" if piece.time > 0.01 else "not yet"

    found, across = _grown(job(spring(), 0.25, arrived), box)
    assert found.verdict == "proven"
    assert across is None
    assert found.duration < 0.25
    found, across = _grown(job(spring(), 0.01, lambda piece: "not yet"), box)
    assert (found.verdict, across) == ("undecided", _widest(box, found.slices))
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
    assert len(found.enclosure) >= 2


def piece(time, half, frame, bound, rate=None, curve=None):
    at = Instants(np.array([time]), np.array([half]), None, None)
    n = len(bound)
    zero = np.zeros((n, n))
    return TimeSlice(
        at,
        np.asarray(frame),
        zero if rate is None else rate,
        zero if curve is None else curve,
        None,
        np.asarray(bound),
        None,
        np.asarray(bound),
    )


def test_the_widest_coordinate_of_the_starts():
    """By the shares of the last cross-section's rows; none of a width of 0."""
    last = piece(0.0, 1.0, [[1.0, 0.2], [0.1, 3.0]], [1.0, 2.0])
    assert _widest(starts(1.0, 1.0), [last]) == 1
    assert _widest(starts(1.0, 0.0), [last]) == 0
    assert _widest(starts(0.0, 0.0), [last]) is None
    tilted = piece(0.0, 1.0, [[5.0, 1.0], [1.0, 1.0]], [1.0, 1.0])
    assert _widest(starts(1.0, 1.0), [tilted]) == 0


def test_places_in_a_tube():
    """Z/u of states at times: of the slice that the time is in, with its frame at that time."""
    rate, curve = np.array([[0.1, 0.2], [0.3, 0.4]]), np.array([[1.0, 0.0], [0.5, 2.0]])
    slices = tuple(
        piece(t, 0.5, np.array([[2.0, 0.5], [0.0, 1.0]]) * (1 + t), [0.5, 0.25], rate, curve) for t in (0.5, 1.5)
    )
    own = SimpleNamespace(equations=SimpleNamespace(independent=(0,), n_x=1))
    enclosure = SimpleNamespace(loop=own, inputs=lambda t: [ball(3.0), ball(t)])
    tube_found = Tube(starts(1.0, 1.0), "proven", "", enclosure, slices)
    assert tube_found.duration == 2.0
    for t, k in ((0.0, 0), (0.75, 0), (1.0, 1), (1.75, 1), (2.0, 1)):
        here = slices[k]
        tau = t - here.time
        A = here.frame @ (np.eye(2) + tau * rate + 0.5 * tau**2 * curve)
        z = np.array([0.3, -0.7])
        q, v = np.array([3.0, t]) + A @ (z * here.bound)
        np.testing.assert_allclose(tube_found.coordinates(t, [q], [v]), z, rtol=1e-12)
        centre, reach = tube_found.box(t)
        np.testing.assert_array_equal(centre, [3.0, t])
        np.testing.assert_array_equal(reach, here.reach)
    for t in (-1e-9, 2.0 + 1e-9):
        with pytest.raises(subdivision.InvalidInputError, match="covered"):
            tube_found.box(t)
    empty = Tube(starts(1.0, 1.0), "undecided", "", enclosure, ())
    assert empty.duration == 0.0
    with pytest.raises(subdivision.InvalidInputError, match="covered"):
        empty.box(0.0)
