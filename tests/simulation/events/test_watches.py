"""The user's events: located to the integrator's tolerance, whatever the output, the method or the backend."""

import numpy as np
import pytest

import ccpin
from ccpin.errors import InvalidInputError
from ccpin.simulation import Event
from tests.support.backends import same_on_both
from tests.support.paper import GOAL, K_P, K_V, START

HANGING = np.radians([-82.180, -97.823])
SWING = HANGING + np.radians([5.0, 0.0])


@pytest.fixture(scope="module")
def fine(rpdr_model):
    """The free swing, at tolerances of 1e-12."""
    return ccpin.simulate(rpdr_model, None, SWING, duration=1.5, method="DOP853", rtol=1e-12, atol=1e-13)


def crossings(motion, direction):
    """Where q₁ passes its resting place, by a cubic through the samples."""
    t, y = motion.t, motion.q[:, 0] - HANGING[0]
    rising = np.flatnonzero((np.sign(y[1:]) != np.sign(y[:-1])) & ((direction == 0) | (np.sign(y[1:]) == direction)))
    found = []
    for k in rising:
        a, b = t[k], t[k + 1]
        from scipy.interpolate import CubicHermiteSpline
        from scipy.optimize import brentq

        found.append(brentq(CubicHermiteSpline(t[k : k + 2], y[k : k + 2], motion.v[k : k + 2, 0]), a, b, xtol=1e-14))
    return np.array(found)


@pytest.mark.parametrize(
    ("direction", "sample_period", "method"),
    [
        pytest.param(-1, 1e-3, "RK45", marks=same_on_both),
        (1, 0.7, "RK45"),
        pytest.param(0, 1e-3, "DOP853", marks=same_on_both),
        pytest.param(0, 0.7, "DOP853", marks=same_on_both),
        pytest.param(1, 1e-3, "LSODA", marks=pytest.mark.slow),
        pytest.param(-1, 0.7, "LSODA", marks=pytest.mark.slow),
    ],
)
def test_zeros_are_where_they_are(rpdr_model, fine, direction, sample_period, method):
    """Every passage through the resting place, in order, to 1e-8 s, with the configuration there."""
    passing = Event(lambda t, state, v: state.q[0] - HANGING[0], "passing", direction)
    motion = ccpin.simulate(
        rpdr_model, None, SWING, duration=1.5, sample_period=sample_period, method=method, events=[passing]
    )
    expected = crossings(fine, direction)
    assert len(expected) >= 2
    assert [event.t for event in motion.events] == pytest.approx(expected, abs=2e-8)
    assert all(event.q[0] == pytest.approx(HANGING[0], abs=1e-10) for event in motion.events)
    assert np.abs(motion.q[-1] - fine.q[-1]).max() < 1e-6


def test_a_terminal_event_ends_the_motion_there(rpdr_model):
    """Its moment is the last sample; the motion can go on behind it."""
    law = ccpin.control.PDSimpleGravity(rpdr_model, GOAL, K_P, K_V)
    gate = Event(lambda t, state, v: state.q[0] + 2.0, "gate", terminal=True)
    motion = ccpin.simulate(rpdr_model, law, START, duration=1.0, sample_period=0.1, events=[gate])
    assert (motion.status, motion.message.endswith("gate")) == ("event", True)
    assert motion.q[-1, 0] == pytest.approx(-2.0, abs=1e-10)
    assert motion.t[-1] == motion.events[-1].t
    simulator = ccpin.Simulator(rpdr_model, law, events=[gate])
    simulator.reset(START)
    stops = [simulator.advance(1.0).t, simulator.advance(1.0).t]
    assert stops == [pytest.approx(motion.t[-1], abs=1e-9), 1.0]
    assert [event.name for event in simulator.events] == ["gate"]


def test_events_and_friction_together(rpdr_model):
    """An event between two stops of a joint is found, at every sample period the same."""
    slow = Event(lambda t, state, v: v[0] - 0.1, "slow")
    friction = {"joint1": (0.01, 0.0), "joint4": (0.005, 0.001)}
    found = [
        ccpin.simulate(
            rpdr_model, None, SWING + [0.3, 0.1], duration=1.0, friction=friction, events=[slow], sample_period=period
        ).events
        for period in (1e-3, 0.3)
    ]
    assert len(found[0]) >= 1
    assert [event.t for event in found[0]] == [event.t for event in found[1]]


def test_what_only_touches_zero_is_none(rpdr_model):
    """A function that is zero throughout, or touches zero, has no change of sign."""
    flat = Event(lambda t, state, v: 0.0, "flat")
    touching = Event(lambda t, state, v: (t - 0.5) ** 2, "touching")
    motion = ccpin.simulate(rpdr_model, None, SWING, duration=1.0, events=[flat, touching])
    assert motion.events == ()


def test_an_event_that_is_no_number_is_told(rpdr_model):
    """The motion up to there is kept, with the cause."""
    wild = Event(lambda t, state, v: np.inf if t > 0.1 else 1.0, "wild")
    motion = ccpin.simulate(rpdr_model, None, SWING, duration=1.0, events=[wild])
    assert motion.status == "failed"
    assert isinstance(motion.cause, InvalidInputError)
    assert "'wild'" in motion.message
    assert motion.t[-1] <= 0.1
