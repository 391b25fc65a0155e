"""Robots of a box under an adaptive law, simulated: none leaves the tube that is proved of all of them."""

import numpy as np
import pytest

import ccpin
from ccpin.control import PointToPoint
from ccpin.identification import AdaptiveTracking, certify_adaptive, with_constants

START = np.array([2e-3, 2e-3]), np.array([0.02, 0.02])


def law_of(**changed):
    """The RPDR's, along a short move, every link a tenth heavier or lighter."""
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    start = model.alpha(model.mechanism.q_reference)
    reference = PointToPoint(model, start, start + np.array([0.04, -0.05]), 0.25)
    numbers = {"slope": 10.0, "K": [4.0, 3.0], "gain": 20.0, "period": 1e-3, "adapted": ["body"], "bounds": 0.1}
    return AdaptiveTracking(model, reference, **numbers | changed)


@pytest.fixture(scope="module")
def known():
    """What is proved of it."""
    e, s = START
    found = certify_adaptive(law_of(), initial_error=e, initial_sliding=s, cells=24)
    assert found.verdict == "proven", found.reason
    return found


class Robot:
    """One of the box, at a corner of what it may start with, its law with an estimate of its own."""

    def __init__(self, known, rng, at_corners):
        box = known.law.lower, known.law.upper
        draw = (lambda: np.where(rng.random(4) < 0.5, *box)) if at_corners else lambda: rng.uniform(*box)
        self.known, self.theta, self.law = known, draw(), law_of(initial=draw())
        self.plant = ccpin.ReducedModel(ccpin.load(with_constants(self.law.model, self.law.constants(self.theta))))
        e, s = (rng.choice([-1.0, 1.0], 2) * most for most in START)
        wanted = self.law.reference.at(0.0)
        self.start = wanted.q + e, wanted.v + s - self.law.slope @ e

    def shares(self, duration, adverse=False):
        """The largest |e|, |s| and |u| of all samples over their bounds, and ∫ sᵀKs over its own."""
        law, known, worst, drained = self.law, self.known, np.zeros(3), 0.0
        times, errors, sliding, efforts = known.times, known.errors, known.sliding, known.efforts
        for t, q, v, u in zip(*(self.pushed if adverse else self.learning)(duration), strict=True):
            e, s = law.error(t, q), law.sliding(t, q, v)
            cell = np.searchsorted(times, t, side="right") - 1
            shares = e / errors[cell], s / sliding[cell], u / efforts
            worst = np.maximum(worst, [np.abs(share).max() for share in shares])
            drained += law.period * s @ law.K @ s
        return worst, drained / (known.mean_square(duration) @ np.diag(law.K) / 2 * duration)

    def learning(self, duration):
        """t, q, q̇ and u of all samples, as the law runs."""
        motion = ccpin.simulate(self.plant, self.law, *self.start, duration=duration, sample_period=self.law.period)
        count = round(duration / self.law.period)
        return (column[:count] for column in (motion.t, motion.q, motion.v, motion.u))

    def pushed(self, duration):
        """The same with nothing learnt: each sample takes the estimate of the box that pushes away most."""
        law, simulator, samples = self.law, ccpin.Simulator(self.plant, None), []
        simulator.reset(*self.start)
        for k in range(round(duration / law.period)):
            t, state, v = k * law.period, simulator.state, simulator.v
            s, wanted = law.sliding(t, state.q, v), law.reference.at(t)
            Y = state.regressor(v, wanted.a - law.slope @ (v - wanted.v), v - s) @ law.basis
            u = law.step(t, state, v, np.where(s @ Y > 0.0, law.upper, law.lower)).effort
            samples.append((t, state.q, v, u))
            simulator.step(u, law.period)
        return zip(*samples, strict=True)


@pytest.mark.parametrize("adverse", [False, True])
def test_no_robot_leaves_the_tube(known, adverse):
    """Learning, and against an estimate that is the worst of the box at every sample."""
    worst, drained = Robot(known, np.random.default_rng(3), True).shares(0.12, adverse)
    assert np.all(worst <= 1.0)
    assert np.all(worst > [0.2, 0.2, 0.2])
    assert adverse or drained <= 1.0


@pytest.mark.slow
def test_none_of_a_thousand_robots_leaves_the_tube(known):
    """Half of them corners of the box, every tenth with the worst estimates."""
    rng, worst, drained = np.random.default_rng(11), np.zeros(3), 0.0
    for k in range(1000):
        shares, share = Robot(known, rng, k % 2 == 0).shares(0.3, k % 10 == 0)
        worst, drained = np.maximum(worst, shares), max(drained, share * (k % 10 != 0))
    assert np.all(worst <= 1.0)
    assert drained <= 1.0
