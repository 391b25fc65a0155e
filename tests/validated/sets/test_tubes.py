"""Tubes: all motions from a box of starts, against motions integrated one by one."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import ccpin
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from tests.oracles import rpdr as oracle
from tests.support.paper import GOAL, K_P, K_V, START

flint = pytest.importorskip("flint")

from ccpin.control.stability.set_point.theorem3 import certify_law  # noqa: E402
from ccpin.validated import certify_move, enclose_set  # noqa: E402
from ccpin.validated.sets.subdivision import Starts  # noqa: E402
from ccpin.validated.sets.tube_theorem import _fitting  # noqa: E402
from tests.support.long_cases import later  # noqa: E402

HALF_A_DEGREE = np.radians(0.5)
QUICK = {"order": 16, "tolerance": 1e-14, "pieces": 4}


def paper_law(model):
    return ccpin.control.PDSimpleGravity(model, GOAL, K_P, K_V)


def corners_and_more(rng, spread, count):
    """Starts within a spread: corners first, then random ones; offsets of shape (count, 2n)."""
    signs = rng.choice([-1.0, 1.0], (count // 2, len(spread)))
    return np.concatenate([signs, rng.uniform(-1, 1, (count - count // 2, len(spread)))]) * spread


GOAL_GRAVITY = oracle.reduced_terms(oracle.sigma(GOAL, 1.0), np.zeros(2))[2]


def acceleration(place, speed, u):
    """q̈ from the printed forms."""
    mass, coriolis, gravity = oracle.reduced_terms(oracle.sigma(place, 1.0), speed)[:3]
    return np.linalg.solve(mass, u - coriolis @ speed - gravity)


def by_closed_forms(q, v, duration, damping=0.0):
    """The paper's closed loop from its printed forms alone, by SciPy: samples (t, q, q̇)."""

    def rate(_, state):
        place, speed = state[:2], state[2:]
        u = K_P * (GOAL - place) - (K_V + damping) * speed + GOAL_GRAVITY
        return np.append(speed, acceleration(place, speed, u))

    return solve_ivp(rate, (0.0, duration), np.append(q, v), method="DOP853", rtol=1e-9, atol=1e-11, max_step=0.002)


def sampled_by_closed_forms(q, v, samples, period):
    """The same loop with efforts held from sample to sample: (t, q, q̇, u) in the middle and at the end of each."""
    state, found = np.append(q, v), []
    for k in range(samples):
        u = K_P * (GOAL - state[:2]) - K_V * state[2:] + GOAL_GRAVITY
        motion = solve_ivp(
            lambda _, x, u=u: np.append(x[2:], acceleration(x[:2], x[2:], u)),
            (0.0, period),
            state,
            method="DOP853",
            rtol=1e-11,
            atol=1e-13,
            t_eval=[0.5 * period, period],
        )
        found += [((k + part) * period, *np.split(x, 2), u) for part, x in zip((0.5, 1.0), motion.y.T, strict=True)]
        state = motion.y[:, -1]
    return found


@pytest.fixture(scope="module", params=later(0.008, 0.02))
def duration(request):
    """How much of the paper's move is looked at [s]."""
    return request.param


@pytest.fixture(scope="module")
def short(rpdr_model, duration):
    """It from ±2e-3 rad and ±0.01 rad/s."""
    return enclose_set(rpdr_model, paper_law(rpdr_model), START, None, duration, spread=(2e-3, 0.01), cells=2, **QUICK)


@pytest.mark.parametrize("starts", later(4, 12))
def test_motions_by_closed_forms_stay_in_the_tube(short, starts, duration):
    """Corners and random starts, integrated from the printed forms; the tube is not much wider than they need."""
    assert short.verdict == "proven"
    (tube,) = short.tubes
    largest = 0.0
    for offset in corners_and_more(np.random.default_rng(0), tube.starts.spread, starts):
        motion = by_closed_forms(START + offset[:2], offset[2:], duration)
        for t, state in zip(motion.t, motion.y.T, strict=True):
            assert short.contains(t, state[:2], state[2:], 1e-6)
            centre, reach = tube.box(t)
            assert np.all(np.abs(state - centre) <= reach + 1e-9)
        largest = max(largest, np.abs(tube.coordinates(duration, state[:2], state[2:])).max())
    assert largest > 0.7


def test_what_is_not_a_motion_from_the_set_is_outside(short, rpdr_model, duration):
    """A start beyond the spread, a heavier link and a weaker gain lead out of the tube."""
    outside = by_closed_forms(START + [2.2e-3, 0.0], [0.0, 0.0], duration).y[:, -1]
    assert not short.contains(duration, outside[:2], outside[2:])
    weaker = ccpin.control.PDSimpleGravity(rpdr_model, GOAL, 0.97 * K_P, K_V)
    corner = short.tubes[0].starts.spread
    sample = ccpin.simulate(
        rpdr_model, weaker, START - corner[:2], -corner[2:], duration=duration, rtol=1e-9, atol=1e-11
    )
    assert not short.contains(duration, sample.q[-1], sample.v[-1])


@pytest.mark.parametrize("name", later("slider_crank", "four_bar"))
def test_stiff_loops_in_lohners_frames(name):
    """A light mechanism under strong damping: rates a hundred times the motion's own, turned to Lohner's frames."""
    model = ccpin.ReducedModel(ccpin.load(name))
    q, spread = model.alpha(model.mechanism.q_reference), np.array([5e-3, 1e-2])
    law = ccpin.control.PDSimpleGravity(model, q + 0.05, np.full(1, 5.0), np.full(1, 0.5))
    found = enclose_set(model, law, q, None, 0.004, spread=(5e-3, 1e-2), cells=4, **QUICK)
    assert found.verdict == "proven"
    for offset in corners_and_more(np.random.default_rng(1), spread, 6):
        sample = ccpin.simulate(
            model, law, q + offset[:1], offset[1:], duration=0.004, method="DOP853", rtol=1e-11, atol=1e-12
        )
        assert all(found.contains(t, *state, 1e-6) for t, *state in zip(sample.t, sample.q, sample.v, strict=True))


@pytest.mark.slow
def test_dampers_in_the_joints_are_in_the_tube(short, duration):
    """A plant with viscous joints has its own tube, which holds its motions and not the frictionless ones'."""
    damping = {name: {"damping": 0.3} for name in ("joint1", "joint2")}
    model = ccpin.ReducedModel(ccpin.load("rpdr", joints=damping))
    found = enclose_set(model, paper_law(model), START, None, duration, spread=(2e-3, 0.01), cells=2, **QUICK)
    assert found.verdict == "proven"
    for offset in corners_and_more(np.random.default_rng(2), found.tubes[0].starts.spread, 6):
        motion = by_closed_forms(START + offset[:2], offset[2:], duration, damping=0.3)
        assert all(found.contains(t, x[:2], x[2:], 1e-6) for t, x in zip(motion.t, motion.y.T, strict=True))
        assert not short.contains(duration, motion.y[:2, -1], motion.y[2:, -1])


@pytest.mark.slow
def test_the_sampled_loop_is_in_its_tube(rpdr_model):
    """At 100 Hz the efforts held make a motion of their own: in its tube, and not in that of the continuous law."""
    law, period, box = paper_law(rpdr_model), 2.0**-7, {"spread": (1e-3, 0.01), "cells": 2, **QUICK}
    held = enclose_set(rpdr_model, law, START, None, 2 * period, period=period, **box)
    continuous = enclose_set(rpdr_model, law, START, None, 2 * period, **box)
    assert held.verdict == continuous.verdict == "proven"
    (tube,) = held.tubes
    for offset in corners_and_more(np.random.default_rng(6), tube.starts.spread, 10):
        motion = sampled_by_closed_forms(START + offset[:2], offset[2:], 2, period)
        for t, q, v, u in motion:
            centre, reach = tube.box(min(t, tube.duration) - 1e-12)
            assert np.all(np.abs(np.concatenate([q, v, u]) - centre) <= reach + 1e-9)
        for t, q, v, u in motion[::2]:
            assert held.contains(t, q, v, 1e-3, effort=u)
            assert not held.contains(t, q, v, 1e-3, effort=u + 0.1)
        t, q, v, _ = motion[-2]
        assert not continuous.contains(t, q, v)


def test_sampled_loops_that_are_not_covered_are_refused(rpdr_model):
    """Another law than (28), a period that is none, and motors elsewhere than on the independent joints."""
    full = ccpin.control.PDFullGravity(rpdr_model, GOAL, K_P, K_V)
    with pytest.raises(UnsupportedMechanismError, match="PDSimpleGravity only"):
        enclose_set(rpdr_model, full, START, None, 0.01, spread=1e-3, period=1e-3)
    with pytest.raises(InvalidInputError, match="period"):
        enclose_set(rpdr_model, paper_law(rpdr_model), START, None, 0.01, spread=1e-3, period=-1e-3)


def test_no_spread_is_no_set(rpdr_model):
    """One motion is `enclose`'s."""
    with pytest.raises(InvalidInputError, match="enclose"):
        enclose_set(rpdr_model, paper_law(rpdr_model), START, None, 0.01, spread=0.0)


def test_parts_cover_the_starts():
    """Halving and halving again leaves no start of the box out, to the last bit."""
    rng = np.random.default_rng(3)
    whole = Starts(np.array([-2.6, 0.3]), np.array([0.0, 1e-3]), np.array([0.1, 1e-3, 0.0, 0.3]))
    parts = [whole]
    for k in (0, 1, 3, 0, 3):
        parts = [half for part in parts for half in part.halves(k)]
    middle = np.append(whole.q, whole.v)
    for _ in range(2000):
        start = middle + whole.spread * rng.choice([-1.0, -0.5, 0.0, 0.25, 1.0, rng.uniform(-1, 1)], 4)
        assert any(np.all(np.abs(start - np.append(p.q, p.v)) <= p.spread) for p in parts)


@pytest.mark.slow
def test_a_set_too_large_is_cut_and_one_that_stays_too_large_is_undecided(rpdr_model):
    """What one tube does not hold is cut; with no parts left the answer is undecided and says where and why."""
    law = paper_law(rpdr_model)
    wide = {"spread": (0.2, 0.0), "cells": 2, **QUICK}
    stuck = enclose_set(rpdr_model, law, START, None, 0.01, parts=2, **wide)
    assert stuck.verdict == "undecided"
    assert "parts=" in stuck.reason
    assert "followed up to" in stuck.reason
    assert stuck.tubes[-1].starts.spread.max() <= 0.2


def test_a_growth_too_large_for_its_bound_is_refused():
    """Z₀ + hGu < u: proven where h times the growth is small, refused beyond the room."""
    constant, quadratic, room = np.array([[1.0]]), np.array([[[0.0]]]), np.array([3.0])
    inside, kept = _fitting(constant, quadratic, 0.5, np.ones(1), room)
    assert 2.0 <= kept[0] < inside[0] <= 3.0  # u = 1 + 0.5 u
    assert np.exp(0.5) <= kept[0]  # and the solution of z′ = z is below
    assert _fitting(constant, quadratic, 0.7, np.ones(1), room) is None
    assert _fitting(np.array([[np.nan]]), quadratic, 0.1, np.ones(1), room) is None


@pytest.mark.slow
def test_a_set_that_arrives_and_one_that_has_no_time(rpdr_model):
    """From near the set point every start is proven to be in B₂ at once; in no time nothing is said of far ones."""
    law = paper_law(rpdr_model)
    near = certify_move(rpdr_model, law, GOAL - 0.02, arrival=1.0, duration=0.01, spread=(2e-3, 0.01), cells=2, **QUICK)
    assert near.verdict == "proven"
    (tube,) = near.tubes
    worst = 0.0
    for offset in corners_and_more(np.random.default_rng(4), tube.starts.spread, 12):
        motion = by_closed_forms(GOAL - 0.02 + offset[:2], offset[2:], near.time)
        worst = max(worst, law.lyapunov(motion.y[:2, -1], motion.y[2:, -1]))
    assert 0.3 * near.lyapunov < worst <= near.lyapunov < 1.0
    far = certify_move(rpdr_model, law, START, arrival=1.0, duration=0.002, spread=1e-3, cells=2, **QUICK)
    assert far.verdict == "undecided"
    assert "has not arrived itself" in far.reason
    assert len(far.tubes) == 1  # more of them would not help
    assert far.lyapunov == np.inf


@pytest.mark.parametrize("spread", [-1e-3, (1e-3, -1e-3), (np.ones(3), 0.0), np.nan])
def test_bad_spreads(rpdr_model, spread):
    """Negative ones and wrong shapes are named."""
    with pytest.raises(InvalidInputError, match="spread"):
        enclose_set(rpdr_model, paper_law(rpdr_model), START, None, 0.01, spread=spread)


@pytest.mark.parametrize("bad", [{"parts": 0}, {"cells": 0}, {"cells": 1000}, {"longest_slice": -1.0}])
def test_bad_cuts(rpdr_model, bad):
    """Arguments out of range are named."""
    with pytest.raises(InvalidInputError, match=next(iter(bad))):
        enclose_set(rpdr_model, paper_law(rpdr_model), START, None, 0.01, spread=1e-3, **bad)


def test_times_not_covered_are_refused(short):
    """Before the start and after the end."""
    for t in (-1e-9, 1.0):
        with pytest.raises(InvalidInputError, match="not covered"):
            short.tubes[0].box(t)


@pytest.mark.slow
@pytest.mark.parametrize("damping", [0.0, 0.1])
def test_the_papers_move_from_half_a_degree(damping):
    """All starts within ±0.5° and ±0.02 rad/s are proven to come to rest at q_d, and random ones stay in the tube."""
    joints = {name: {"damping": damping} for name in ("joint1", "joint2")} if damping else None
    model = ccpin.ReducedModel(ccpin.load("rpdr", joints=joints))
    law = paper_law(model)
    certificate = certify_law(law)
    move = certify_move(model, law, START, arrival=certificate, spread=(HALF_A_DEGREE, 0.02))
    assert move.verdict == "proven"
    assert move.rigorous
    assert move.lyapunov < certificate.level
    spread = np.repeat([HALF_A_DEGREE, 0.02], 2)
    for offset in corners_and_more(np.random.default_rng(5), spread, 200):
        motion = by_closed_forms(START + offset[:2], offset[2:], move.time, damping)
        inside = [tube for tube in move.tubes if np.abs(tube.coordinates(0.0, *np.split(motion.y[:, 0], 2))).max() <= 1]
        assert inside
        tube = inside[0]
        for t, x in zip(motion.t, motion.y.T, strict=True):
            if t <= tube.duration:
                assert np.abs(tube.coordinates(t, x[:2], x[2:])).max() <= 1.0 + 1e-6
        assert law.lyapunov(motion.y[:2, -1], motion.y[2:, -1]) <= move.lyapunov
