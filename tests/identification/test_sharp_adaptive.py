"""Theorem L's numbers, one by one: levels, bounds over a box, states of cells, and motions that are made C²."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.control.stability.tracking.cell_forms import WIDEN, CellForms, TimeCells
from ccpin.control.stability.tracking.motion_bounds import Motion
from ccpin.control.stability.tracking.tracking_equations import ReferencePieces
from ccpin.identification.adaptive import adaptive_bounds, adaptive_levels, adaptive_states
from ccpin.identification.adaptive.adaptive_bounds import CellBounds, _middle, bounds_of
from ccpin.identification.adaptive.adaptive_equations import AdaptiveGains
from ccpin.identification.adaptive.adaptive_levels import carried, decay_of, delayed, grip_of, levels_of
from ccpin.identification.adaptive.adaptive_states import AdaptiveStates, SmoothCells, _jump, states_of
from ccpin.proof.balls import Affine, affine
from ccpin.proof.chords import Chord
from ccpin.proof.facts import NotProvedError
from ccpin.proof.rounding import SLACK

K, N = 4, 2
GAINS = AdaptiveGains(np.array([8.0, 5.0]), np.array([3.0, 2.0]), np.array([0.5, 2.0, 4.0]), 1e-2)
LOWER, UPPER = np.array([-1.0, 0.5, 2.0]), np.array([0.5, 1.0, 2.25])


def drawn(seed, *shape):
    return np.random.default_rng(seed).uniform(0.2, 1.0, shape)


def forms(seed, *shape):
    """Symmetric positive matrices."""
    mid = drawn(seed, *shape, N, N) * 0.2
    return mid + np.swapaxes(mid, -1, -2) + np.eye(N)


class Case:
    """Cells whose numbers are all different, and those of them that are put in the place of bounds of matrices."""

    def __init__(self, monkeypatch, first=0.3, gain=1.0):
        self.D, self.X = forms(1, K), forms(2, K)
        self.decay, self.R, self.M = 2.0 + drawn(3, K), drawn(4, K, N, N), 0.1 * drawn(5, K, N, N)
        vectors = [drawn(10 + k, K, N) for k in range(5)]
        self.bounds = CellBounds(affine(self.D), "least", "most", *vectors, drawn(16, K))
        self.room, self.rates, self.start = drawn(20, K, 2 * N), 3.0 * drawn(21, K, N), first * drawn(22, 2 * N)
        self.times = np.array([0.0, 0.1, 0.3, 0.35, 1.35])
        gains = GAINS._replace(adaptation=gain * GAINS.adaptation)
        self.own = SimpleNamespace(gains=gains, lower=LOWER, upper=UPPER)
        seen = []
        for name, answer in (
            ("floor", lambda x: (seen.append(x), "floor")[1]),
            ("inverted", lambda x: (seen.append(x), self.X)[1]),
            ("decay_of", lambda x, damping: (seen.append(x), self.decay)[1]),
            ("grip_of", lambda D, X: self.R if D is self.bounds.inertia and X is self.X else None),
            ("delayed", self.delay),
        ):
            monkeypatch.setattr(adaptive_levels, name, answer)
        self.found = levels_of(self.own, self.bounds, self.times, self.room, self.rates, self.start)
        assert seen == ["least", "floor", "most"]

    def delay(self, moved, damping):
        np.testing.assert_array_equal(damping, GAINS.damping)
        np.testing.assert_allclose(moved, GAINS.period * lately(self.R), rtol=1e-15)
        return self.M


def lately(x):
    """The larger of a cell's and the one's before."""
    return np.array([x[k] if k == 0 else np.maximum(x[k], x[k - 1]) for k in range(len(x))])


def exact(case):
    """The theorem's numbers, cell by cell, without room for rounding."""
    b, T, gain, S = case.bounds, GAINS.period, GAINS.damping, lately(case.room[:, N:])
    held = T * lately(b.force_rate)
    z = b.doubt + held + b.coupling
    delta = held + np.array([m @ x for m, x in zip(case.M, lately(z), strict=True)])
    drive = np.array([np.sqrt(0.5 * x @ np.abs(X) @ x) for x, X in zip(b.doubt + delta, case.X, strict=True)])
    swing = lately(case.rates) * lately(b.doubt) + S * lately(b.doubt_rate)
    power = max(0.5 * (S[k] @ delta[k] + T * (swing[k].sum() + lately(b.adapted)[k])) for k in range(K))
    unknown = sum(0.5 * (UPPER - LOWER) ** 2 / case.own.gains.adaptation)
    first = 0.5 * case.start[N:] @ case.D[0] @ case.start[N:]
    jerked = T * drive.max()
    most = np.sqrt(max(first + unknown, (np.sqrt(power / case.decay.min()) + jerked) ** 2 + unknown)) + jerked
    level, e, levels, errors, entries = np.sqrt(first), case.start[:N], [], [], [case.start]
    for k, lasts in enumerate(np.diff(case.times)):
        rest, last = 2.0 * drive[k] / case.decay[k], k == K - 1
        after = rest if last else rest + (level - rest) * np.exp(-0.5 * case.decay[k] * lasts)
        levels.append(min(max(level, after), most))
        level = min(after, most)
        width = np.sqrt(2.0 * np.diag(case.X[k]))
        there = levels[-1] * width / GAINS.slope
        later = there if last else there + (e - there) * np.exp(-GAINS.slope * lasts)
        errors.append(np.maximum(e, later))
        e = later
        entries.append(np.concatenate([e, level * width]))
    return {
        "level": np.array(levels), "errors": np.array(errors), "entries": np.array(entries[:-1]),
        "widths": np.sqrt(2.0 * np.diagonal(case.X, axis1=1, axis2=2)),
        "rates": np.array([R @ x for R, x in zip(case.R, z + gain * S, strict=True)]),
        "efforts": b.force + gain * case.room[:, N:], "power": np.array([power]), "first": np.array([first + unknown]),
        "ultimate": min(rest, most) * width / GAINS.slope,
    }  # fmt: skip


@pytest.mark.parametrize(("first", "gain"), [(0.3, 1e-3), (3.0, 1e-3), (0.3, 1e3), (3.0, 1e3), (6.0, 30.0)])
def test_levels_are_the_theorems(monkeypatch, first, gain):
    """Small and large starts, with adaptation that is slow (V is of no use) and quick (V bounds all)."""
    case = Case(monkeypatch, first, gain)
    for name, numbers in exact(case).items():
        found = getattr(case.found, name)
        np.testing.assert_allclose(found, numbers, rtol=3e-9, err_msg=name)
        held = np.ones(np.shape(numbers), dtype=bool)
        held[0] = name != "entries"  # the start itself
        assert np.all((found > numbers)[held]), name
    assert np.array_equal(case.found.bound[:, :N], case.found.errors)
    np.testing.assert_allclose(case.found.bound[:, N:], case.found.level[:, None] * case.found.widths, rtol=1e-9)
    np.testing.assert_array_equal(case.found.needed, np.maximum(case.found.bound, case.found.entries))


def test_what_comes_out_is_less_than_what_goes_in(monkeypatch):
    """In every entry, by a millionth."""
    found = Case(monkeypatch).found
    room, rates = found.needed * (1.0 + 1.1e-6), found.rates * (1.0 + 1.1e-6)
    assert found.held(room, rates)
    for k, i in itertools.product(range(K), range(2 * N)):
        less = room.copy()
        less[k, i] = found.needed[k, i] * (1.0 + 0.9e-6)
        assert not found.held(less, rates)
        if i < N:
            less = rates.copy()
            less[k, i] = found.rates[k, i] * (1.0 + 0.9e-6)
            assert not found.held(room, less)
    assert not found.held(room * np.nan, rates)


def test_a_number_that_decays_and_one_that_is_cut_off():
    reached, ends = carried(
        np.array([2.0]), np.array([[1.0], [3.0], [0.5]]), np.array([[1.0], [2.0], [4.0]]), np.ones(3)
    )
    one = 1.0 + np.exp(-1.0)
    two = 3.0 + (one - 3.0) * np.exp(-2.0)
    np.testing.assert_allclose(reached[:, 0], [2.0, two, two], rtol=1e-9)
    np.testing.assert_allclose(ends[:, 0], [one, two, 0.5], rtol=1e-9)
    assert np.all(reached[:, 0] > [2.0, two, two])
    assert np.all(ends[:, 0] > [one, two, 0.5])
    cut, ends = carried(np.array([2.0]), np.full((2, 1), 9.0), np.ones((2, 1)), np.ones(2), 2.5)
    np.testing.assert_array_equal(cut, 2.5)
    np.testing.assert_array_equal(ends, 2.5)


def test_the_decay_of_the_worst_inertia():
    """K − ½αD ⪰ 0 is sharp at a middle, and holds for all of a form."""
    gain = np.array([3.0, 2.0])
    D = forms(7, 3)
    found = decay_of(affine(D), gain)
    for alpha, each in zip(found, D, strict=True):
        least = np.linalg.eigvalsh(np.diag(gain) - 0.5 * alpha * each)[0]
        assert 0.0 < least < 1e-8
    diagonal = np.diag([1.0, 0.0])[None]
    for spread in (
        Affine(D[:1], 0.1 * diagonal[None], 0.0 * diagonal, 1),
        Affine(D[:1], np.zeros((0, 1, 2, 2)), 0.1 * diagonal),
    ):
        top = np.linalg.eigvalsh(D[0] / np.sqrt(np.outer(gain, gain)))[-1] + 0.1 / 3.0
        np.testing.assert_allclose(decay_of(spread, gain), 2.0 / top, rtol=2e-9)
    single = decay_of(affine(np.full((1, 1, 1), 3.0)), np.array([1.0]))
    np.testing.assert_allclose(single, 2.0 / (3.0 * (1.0 + 1e-9)), rtol=1e-14)
    assert np.isnan(decay_of(affine(np.full((1, 2, 2), np.nan)), gain)).all()
    half = np.array([[[1.0, 0.0], [0.0, 1.0]], [[np.nan, 0.0], [0.0, 1.0]]])
    found = decay_of(affine(half), gain)
    assert np.isfinite(found[0])
    assert np.isnan(found[1])


def test_the_grip_is_the_lesser_of_two_bounds():
    """An enclosure where there is one, else (X_ii X_jj)^½."""
    D = forms(8, 2)
    X = 4.0 * np.linalg.inv(D)
    np.testing.assert_allclose(grip_of(affine(D), X), np.abs(np.linalg.inv(D)), rtol=1e-9)
    wide = Affine(D, np.zeros((0, 2, 2, 2)), np.full(D.shape, 2.0))
    size = np.sqrt(np.diagonal(X, axis1=1, axis2=2))
    found = grip_of(wide, X)
    np.testing.assert_allclose(found, size[:, :, None] * size[:, None, :], rtol=1e-9)
    assert np.all(found > size[:, :, None] * size[:, None, :])
    tight = np.linalg.inv(D) * np.array([0.5, 4.0])[:, None, None]
    mixed = grip_of(affine(D), tight)
    entries = np.abs(np.linalg.inv(D))
    size = np.sqrt(np.diagonal(tight, axis1=1, axis2=2))
    np.testing.assert_allclose(mixed, np.minimum(entries, size[:, :, None] * size[:, None, :]), rtol=1e-9)


def test_damping_that_is_held():
    """K(1 − AK)⁻¹A, to 1e-7; nothing where ρ(AK) may be 1, in one of the cells."""
    gain, A = np.array([3.0, 2.0]), 0.1 * drawn(9, 3, 2, 2)
    exact = np.array([np.diag(gain) @ np.linalg.inv(np.eye(2) - each * gain) @ each for each in A])
    found = delayed(A, gain)
    np.testing.assert_allclose(found, exact, rtol=1e-6)
    assert np.all(found > exact)
    radius = np.abs(np.linalg.eigvals(A[1] * gain)).max()
    for size, held in ((0.98, True), (1.0 + 1e-6, False), (3.0, False)):
        scaled = A.copy()
        scaled[1] *= size / radius
        some = delayed(scaled, gain)
        assert np.isfinite(some[1]).all() == held
        assert np.isfinite(some[[0, 2]]).all()
    A[1, 0, 0] = np.nan
    assert np.isinf(delayed(A, gain)[1]).all()
    np.testing.assert_array_equal(delayed(A, gain)[2], found[2])
    for size in (1.5, 2.5, 5.0):
        assert np.isinf(delayed(np.array([[[size]]]), np.ones(1))).all()
        assert np.isinf(delayed(np.diag([0.25, size])[None], np.ones(2))).all()
    single = delayed(np.array([[[0.25]]]), np.array([2.0]))
    np.testing.assert_allclose(single, 2.0 / (1.0 - 0.5) * 0.25 * (1.0 + 1e-8) * SLACK, rtol=1e-13)


class FakeBounds:
    """Columns that are told, of known constants and of three more."""

    def __init__(self, *args):
        self.args = args

    def columns(self, motion, shares, *, still=True):
        assert shares == "shares"
        return some(30 if still else 31, N) if still or np.all(motion.a.mid == 0.0) else None

    def rates(self, motion, rate, shares):
        return some(32, N)

    def inertia(self, shares):
        found = some(33, N, N)
        return Affine(found.mid + np.swapaxes(found.mid, -1, -2), found.lin, found.rad, found.boxed)


def some(seed, *shape):
    """A form over K cells, 1 + 3 columns, of either sign."""
    rng = np.random.default_rng(seed)
    lin = 0.1 * rng.normal(size=(2, K, 4, *shape))
    return Affine(rng.normal(size=(K, 4, *shape)), lin, 0.01 * rng.random((K, 4, *shape)), 2)


def test_bounds_are_those_of_the_boxs_corners(monkeypatch):
    """|Y(θ̂ − θ)| and |Yθ̂| over corners of θ, of the two parameters and of what forms are off by, are attained."""
    monkeypatch.setattr(adaptive_bounds, "RegressorBounds", FakeBounds)
    adds = np.array([True, False, True])
    own = SimpleNamespace(
        lower=LOWER, upper=UPPER, gains=GAINS, shares="shares", adds=adds, closures=SimpleNamespace(system=None),
        masses=None, bodies=(SimpleNamespace(stack=SimpleNamespace(joints=np.zeros((1, 1)))),), gravity=None,
    )  # fmt: skip
    form = affine(np.ones((K, N)))
    states = AdaptiveStates(form, Motion(form, form, form), Motion(form, form, form), form)
    room = drawn(40, K, 2 * N)
    found = bounds_of(own, states, room)
    monkeypatch.setattr(adaptive_bounds, "_NUMBERS", 1.0)
    for whole, part in zip(found, bounds_of(own, states._replace(), room), strict=True):
        assert np.shape(getattr(whole, "mid", whole))[0] == K
        assert type(whole) is type(part)
    box = list(itertools.product(*zip(LOWER, UPPER, strict=True)))
    told = {"force": some(30, N), "force_rate": some(32, N), "coupling": some(31, N)}
    for name, x in told.items():
        swing = x.spread
        most = 0.0
        for theta in box:
            weights = np.append(1.0, theta)
            middle = np.einsum("q,kqi->ki", weights, x.mid)
            most = np.maximum(most, np.abs(middle) + np.einsum("q,kqi->ki", np.abs(weights), swing))
        bound = getattr(found, name)
        single = np.abs(np.einsum("q,kqi->ki", np.append(1.0, 0.5 * (LOWER + UPPER)), x.mid))
        assert np.all(bound >= single)
        assert np.all(bound <= most * 1.5 + 1.0)
        centre = np.append(1.0, 0.5 * (LOWER + UPPER))
        half = 0.5 * (UPPER - LOWER)
        lin = np.abs(np.einsum("q,pkqi->pki", centre, x.lin)).sum(axis=0)
        exact = single + lin + np.einsum("q,kqi->ki", np.abs(centre), x.rad)
        exact = exact + np.einsum("q,kqi->ki", half, x.magnitude[:, 1:])
        np.testing.assert_allclose(bound, exact, rtol=1e-9)
        assert np.all(bound > exact)
    span = UPPER - LOWER
    for name, x in (("doubt", some(30, N)), ("doubt_rate", some(32, N))):
        exact = np.einsum("q,kqi->ki", span, x.magnitude[:, 1:])
        np.testing.assert_allclose(getattr(found, name), exact, rtol=1e-9)
        assert np.all(getattr(found, name) > exact)
    along = np.einsum("kqi,ki->kq", some(30, N).magnitude[:, 1:], room[:, N:])
    np.testing.assert_allclose(found.adapted, along**2 @ GAINS.adaptation, rtol=1e-9)
    assert np.all(found.adapted > along**2 @ GAINS.adaptation)
    D = FakeBounds().inertia("shares")
    centre, half = 0.5 * (LOWER + UPPER), 0.5 * span
    for name, place, rest in (
        ("inertia", centre, half),
        ("least", np.where(adds, LOWER, centre), np.where(adds, 0.0, half)),
        ("most", np.where(adds, UPPER, centre), np.where(adds, 0.0, half)),
    ):
        form, weights = getattr(found, name), np.append(1.0, place)
        np.testing.assert_allclose(form.mid, np.einsum("q,kqij->kij", weights, D.mid), atol=1e-14)
        np.testing.assert_allclose(form.lin, np.einsum("q,pkqij->pkij", weights, D.lin), atol=1e-14)
        rad = np.einsum("q,kqij->kij", np.abs(weights), D.rad) + np.einsum("q,kqij->kij", rest, D.magnitude[:, 1:])
        np.testing.assert_allclose(form.rad, rad, rtol=1e-9)
        assert np.all(form.rad > rad)
        assert form.boxed == 2


def test_a_box_is_within_its_half_of_its_middle():
    """Of ends one unit in the last place apart, too, whichever of them the middle is rounded to."""
    for lower in (np.array([1.0]), np.array([np.nextafter(1.0, 2.0)])):
        upper = np.nextafter(lower, 9.0)
        centre, half = _middle(lower, upper)
        np.testing.assert_array_equal(half, upper - lower)
        assert centre in (lower, upper)
    np.testing.assert_array_equal(_middle(LOWER, UPPER), [0.5 * (LOWER + UPPER), 0.5 * (UPPER - LOWER)])


def test_states_are_functions_of_time_errors_and_the_rate(monkeypatch):
    """At corners of the parameters: q̇, v_r and a_r of e and s, and their rates with the cell's own ṡ and jerk."""
    rng, slope, count = np.random.default_rng(50), np.array([8.0, 5.0]), 3
    lin = [rng.normal(size=(1 + 2 * N, count, size)) for size in (5, N, N, N, N, N)]
    mids = [rng.normal(size=(count, size)) for size in (5, N, N, N, N, N)]
    given = CellForms(*(Affine(m, x, 0.0 * m, 1 + 2 * N) for m, x in zip(mids, lin, strict=True)))
    jerk = Chord(rng.normal(size=(count, N)), rng.normal(size=(count, N)), rng.random((count, N)), None)
    rates = rng.random((count, N))
    found = states_of(given, jerk, slope, rates)
    for _ in range(5):
        corner = rng.choice([-1.0, 1.0], 1 + 3 * N)

        def at(form, corner=corner):
            return form.mid + np.tensordot(corner[: len(form.lin)], form.lin, axes=1)

        e, s, v_d, a_d = -at(given.e), -at(given.e_dot), at(given.v_d), at(given.a_d)
        pushed, third = corner[1 + 2 * N :] * rates, jerk.middle + corner[0] * jerk.along
        v, v_r, a_r = v_d + s - slope * e, v_d - slope * e, a_d - slope * (s - slope * e)
        np.testing.assert_allclose(at(found.theta), at(given.theta), atol=1e-13)
        np.testing.assert_allclose(at(found.error), s, atol=1e-13)
        for form, exact in zip(found.asked, (v, v_r, a_r), strict=True):
            np.testing.assert_allclose(at(form), exact, atol=1e-12)
        turned = a_r + pushed
        for form, exact in zip(found.rate, (turned, a_r, third - slope * (turned - a_d)), strict=True):
            np.testing.assert_allclose(at(form), exact, atol=1e-12)
    assert all(form.boxed == 1 + 3 * N for form in (found.theta, *found.asked, *found.rate, found.error))
    np.testing.assert_allclose(found.rate.a.rad, jerk.deviation + WIDEN * (1.0 + np.abs(jerk.middle)), atol=2e-12)
    assert np.all(found.rate.a.rad > jerk.deviation + WIDEN * (1.0 + np.abs(jerk.middle)))
    monkeypatch.setattr(adaptive_states, "WIDEN", 0.25)
    wide = states_of(given, jerk, slope, rates).rate.a.rad
    np.testing.assert_allclose(wide, jerk.deviation + 0.25 * (1.0 + np.abs(jerk.middle)), rtol=1e-9)
    two = found.chunk(slice(1, 3))
    np.testing.assert_array_equal(two.theta.mid, found.theta.mid[1:])
    np.testing.assert_array_equal(two.rate.a.lin, found.rate.a.lin[:, 1:])
    np.testing.assert_array_equal(two.asked.v.mid, found.asked.v.mid[1:])
    np.testing.assert_array_equal(two.error.rad, found.error.rad[1:])


def meeting(jump):
    """½t² + ½ up to 1 s, from where q_d, q̇_d and q̈_d, all of them 1 there, are off by so much."""
    place, speed, pull = np.ones(3) + jump
    c = np.array([[[0.0], [0.0]], [[0.5], [0.5 * pull]], [[0.0], [speed]], [[0.5], [place]]])
    return ReferencePieces(c, np.array([0.0, 1.0, 1.5]))


def smooth(reference, times):
    motion = reference, reference.derivative(), reference.derivative().derivative()
    return SmoothCells.of(motion, motion[2].derivative(), np.array(times))


@pytest.mark.parametrize("order", [0, 1, 2])
def test_jumps_at_knots_are_mended_in_the_cell_after(order):
    """By 60 jlⁱ⁻ᵏ in the k-th derivative of q_d in the cell after, of length l; the third derivative attains it."""
    jump, times, long = np.zeros(3), [0.0, 0.5, 1.0, 1.25, 1.5], 0.25
    jump[order] = 1e-11
    found, plain = smooth(meeting(jump), times), smooth(meeting(0.0), times)
    for k, (own, other) in enumerate(
        zip(
            (found.cells.place, found.cells.speed, found.cells.acceleration, found.jerk),
            (plain.cells.place, plain.cells.speed, plain.cells.acceleration, plain.jerk),
            strict=True,
        )
    ):
        more = own.deviation - other.deviation
        np.testing.assert_allclose(more[2], 60.0 * 1e-11 * long ** (order - k), rtol=0.02)
        np.testing.assert_allclose(more[[0, 1]], 0.0, atol=1e-18)
        assert np.all(more[3] < 1e-2 * more[2])


def test_what_strays_from_chords_is_kept():
    """Without jumps all cells are the reference's own, but for rounding where they meet."""
    reference = meeting(0.0)
    motion = reference, reference.derivative(), reference.derivative().derivative()
    times = np.array([0.0, 0.5, 1.0, 1.25, 1.5])
    found, own = smooth(reference, times), TimeCells.of(motion, times)
    assert own.place.deviation[0, 0] > 0.01
    for name in ("place", "speed", "acceleration"):
        mended, plain = getattr(found.cells, name), getattr(own, name)
        np.testing.assert_allclose(mended.deviation, plain.deviation, atol=1e-9)
        np.testing.assert_array_equal(mended.start, plain.start)
        assert np.all(mended.deviation >= plain.deviation)


def test_jumps_are_of_what_is_known_of_both_sides():
    """From a cell's end to the next one's start, with the rounding of either."""
    start, end, rounding = drawn(60, 3, 2), drawn(61, 3, 2), drawn(63, 3, 2, 2)
    exact = np.abs(start[1:] - end[:-1]) + rounding[1:, 0] + rounding[:-1, 1]
    found = _jump(Chord(start, end, 0.0 * start, rounding))
    np.testing.assert_allclose(found, exact, rtol=1e-12)
    assert np.all(found > exact)


def test_every_coordinate_may_jump_by_rounding_only():
    """One of two that jumps is enough."""
    one, none = meeting(np.array([1e-3, 0.0, 0.0])), meeting(0.0)
    for pair in ((one, none), (none, one)):
        both = ReferencePieces(np.concatenate([each.c for each in pair], axis=2), none.x)
        with pytest.raises(NotProvedError, match="jumps"):
            smooth(both, [0.0, 1.0, 1.5])


def test_what_mends_is_at_most_sixty():
    """The quintic Hermite polynomials of [0, 1] and their derivatives: 60 is H₀‴'s."""
    x = np.linspace(0.0, 1.0, 2001)
    H = ([1, 0, 0, -10, 15, -6], [0, 1, 0, -6, 8, -3], [0, 0, 0.5, -1.5, 1.5, -0.5])
    sizes = [[np.abs(np.polynomial.Polynomial(h).deriv(k)(x)).max() for k in range(4)] for h in H]
    assert np.max(sizes) == 60.0
    for h in H:
        h = np.polynomial.Polynomial(h)
        assert all(abs(h.deriv(k)(1.0)) < 1e-12 for k in range(3))


@pytest.mark.parametrize(("jump", "held"), [(0.98e-9, True), (1.02e-9, False)])
@pytest.mark.parametrize("order", [0, 1, 2])
def test_a_reference_that_jumps_is_refused(order, jump, held):
    jumps = np.zeros(3)
    jumps[order] = jump * (-1.0) ** order
    reference = meeting(jumps)
    if held:
        smooth(reference, [0.0, 1.0, 1.5])
    else:
        with pytest.raises(NotProvedError, match="jumps"):
            smooth(reference, [0.0, 1.0, 1.5])
