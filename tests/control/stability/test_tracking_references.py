"""What certificates of tracking suppose of a reference: that it moves on without a jump, from t = 0, as `at` tells."""

import numpy as np
import pytest
from scipy.interpolate import PPoly

import ccpin
from ccpin.control import ComputedTorque, PDPlus, PointToPoint, Reference, certify_tracking
from ccpin.control.references import PiecewisePolynomial, ReferenceState
from ccpin.errors import InvalidInputError
from tests.support.paper import START
from tests.support.sigma_attacks import WithWrongSigma, pushing
from tests.support.tracked import LAWS, RUN, assert_within, errors_of, law_for

EPSILON = 1e-6


class Polynomials(Reference):
    """Any polynomials as a reference, at rest before and after them, as simulations and certificates read it."""

    def __init__(self, start, breaks, coefficients):
        self.start, self.breaks = np.asarray(start), np.asarray(breaks, dtype=float)
        self.coefficients = np.asarray(coefficients, dtype=float)
        self.duration = float(self.breaks[-1])
        path = PPoly(np.moveaxis(self.coefficients, 1, 0), self.breaks)
        self.parts = [path, path.derivative(1), path.derivative(2)]

    def at(self, t):
        inside = np.clip(t, self.breaks[0], self.breaks[-1])
        rests = not self.breaks[0] <= t < self.breaks[-1]
        q, v, a = (part(inside) for part in self.parts)
        return ReferenceState(self.start + q, 0.0 * v if rests else v, 0.0 * a if rests else a)

    def as_polynomial(self):
        return PiecewisePolynomial(self.start, self.breaks, self.coefficients)

    def next_switch(self, t):
        later = self.breaks[self.breaks > t]
        return float(later[0]) if len(later) else np.inf


def corner(speed=0.05, begin=0.0):
    """Straight to and fro at a speed: q̇_d jumps where it begins, turns and ends."""
    way = 0.1 * speed * np.array([1.0, -0.5])
    lines = [[way / 0.1, 0.0 * way], [-way / 0.1, way]]
    return Polynomials(START, begin + np.array([0.0, 0.1, 0.2]), lines)


def smooth(begin):
    """A move from one configuration to another by the quintic time law that begins late."""
    model = law_for(ComputedTorque).model
    told = PointToPoint(model, START, START + [0.1, -0.05], 0.2).as_polynomial()
    return Polynomials(START, begin + told.breaks, told.coefficients)


@pytest.mark.parametrize("law_class", LAWS)
@pytest.mark.parametrize("begin", [0.0, 0.15])
def test_a_reference_whose_speed_jumps(law_class, begin):
    """The bound takes in what the jumps do to ė, from a start at rest, and is not far above it."""
    law = law_for(law_class, reference=corner(begin=begin))
    proof = certify_tracking(law, EPSILON, cells=64)
    assert proof.verdict == "proven"
    seen = assert_within(proof, law, ccpin.simulate(law.model, law, START, **RUN | {"duration": begin + 0.3}))
    assert seen.max() > 1e-4
    assert np.all(proof.error < 30.0 * seen)
    assert proof.ultimate.max() < 1e-5


def test_what_a_jump_adds_is_what_it_adds_at_most():
    """After one jump at t = 0 computed torque's closed form is within the bound, and not far below it."""
    law = law_for(ComputedTorque, reference=corner(begin=0.0))
    proof = certify_tracking(law, 1e-9)
    rate, speed = 20.0, np.array([0.05, 0.025])
    highest = speed / (rate * np.e)  # ë + 2ωė + ω²e = 0 from ė(0): |ė(0)| t e^{−ωt} at t = 1/ω
    reached = proof.errors[proof.times[:-1] <= 0.09].max(axis=0)
    assert np.all(reached >= highest)
    assert np.all(reached < 12.0 * highest)


def test_a_start_that_moves_with_the_reference_is_within_the_bound():
    """A speed at t = 0 is a jump from rest or none: the bound holds for both."""
    law = law_for(ComputedTorque, reference=corner())
    proof = certify_tracking(law, EPSILON)
    motion = ccpin.simulate(law.model, law, START, law.reference.at(0.0).v, **RUN | {"duration": 0.3})
    assert_within(proof, law, motion)


@pytest.mark.parametrize("law_class", LAWS)
def test_a_reference_that_begins_late(law_class):
    """The rest before it has a cell, and the bound holds from t = 0 on, against the worst σ."""
    law = law_for(law_class, reference=smooth(0.1))
    proof = certify_tracking(law, 1e-3, cells=48, initial_error=1e-3)
    assert proof.verdict == "proven"
    assert proof.times[0] == 0.0
    assert proof.times[1] == 0.1
    attack = WithWrongSigma(law, pushing(law, 1e-3, np.eye(2)[0]))
    motion = ccpin.simulate(law.model, attack, START - 1e-3, **RUN | {"duration": 0.3})
    assert_within(proof, law, motion)
    t, e = errors_of(law, motion)
    assert np.abs(e[t < 0.02]).max() >= 0.9e-3


def test_references_that_are_refused():
    """Breaks before t = 0 or too few, a jump of q_d, and polynomials that are not what `at` tells."""
    told = smooth(0.0)
    early = Polynomials(START, told.breaks - 0.1, told.coefficients)
    with pytest.raises(InvalidInputError, match="increase from t ≥ 0"):
        certify_tracking(law_for(ComputedTorque, reference=early), EPSILON)
    leap = corner()
    leap.coefficients[1, 1, 0] += 1e-6
    with pytest.raises(InvalidInputError, match="jumps by 1e-06"):
        certify_tracking(law_for(ComputedTorque, reference=leap), EPSILON)

    class Other(Polynomials):
        def at(self, t):
            state = super().at(t)
            return state._replace(a=1.001 * state.a)

    other = Other(START, told.breaks, told.coefficients)
    with pytest.raises(InvalidInputError, match=r"two motions.*q̈_d"):
        certify_tracking(law_for(PDPlus, reference=other), EPSILON)
