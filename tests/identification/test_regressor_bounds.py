"""Bounds of Y_r and of its rate: against States, differences along motions, and members of sets."""

import numpy as np
import pytest

import ccpin
from ccpin.control.stability.tracking.masses import BodiesOnJoints, masses_of
from ccpin.control.stability.tracking.motion_bounds import Motion
from ccpin.domain.closures.system import reading_of
from ccpin.identification.adaptive.adaptive_reading import constants_of, frames_on
from ccpin.identification.adaptive.regressor_bounds import RegressorBounds, Shares, frames_of
from ccpin.proof.balls import Affine, affine

SPRUNG = {"stiffness": 0.7, "spring_reference": 2.0, "damping": 0.3, "armature": 0.01}


def model_of(name):
    """One of the zoo; the four-bar again with springs, dampers and rotors, under another gravity."""
    if name != "sprung":
        return ccpin.ReducedModel(ccpin.load(name))
    joints = dict.fromkeys(("crank", "rocker", "coupler"), SPRUNG)
    return ccpin.ReducedModel(ccpin.load("four_bar", joints=joints), gravity=(0.3, 0.1, -1.62))


class Case:
    """A model, a closed state of it, and the numbers that bounds are of."""

    def __init__(self, name):
        self.model = model_of(name)
        mechanism, rng, n = self.model.mechanism, np.random.default_rng(5), self.model.n
        self.reading = reading_of(mechanism, mechanism.q_reference)
        self.system = self.reading.problem.system
        nothing = np.zeros(self.system.n_free)
        self.masses = masses_of(self.system, BodiesOnJoints((), nothing, nothing, nothing, nothing))
        self.frames = frames_of(self.system, frames_on(mechanism, self.reading))
        self.rows = constants_of(self.model.parameters)
        self.state = self.model.at(self.model.alpha(mechanism.q_reference) + 0.05)
        self.motion = rng.normal(size=(3, n))
        self.rate = rng.normal(size=(3, n))
        self.shares = Shares.of(np.eye(len(self.rows)), self.system.n_free)

    def at(self, state, motion):
        """Bounds at a state, and the motion (v, w, a)."""
        theta = affine(self.reading.theta(state.q_free)[None])
        forms = Motion(*(affine(x[None]) for x in motion))
        gravity = self.model.gravity_vector
        return RegressorBounds(self.system, self.masses, self.frames, gravity, theta, forms.v), forms

    def regressor(self, state, motion):
        """Y_r by Pinocchio's bodies, its columns as the bounds have them."""
        v, w, a = motion
        return state.regressor(v, a, w)[:, self.rows].T


@pytest.mark.parametrize("name", ["rpdr", "four_bar", "sprung", "slider_crank", "hexa"])
def test_at_one_state_they_are_the_regressor(name):
    """Values to rounding; rates to what central differences along the motion tell."""
    case = Case(name)
    bounds, motion = case.at(case.state, case.motion)
    found = bounds.columns(motion, case.shares)
    exact = case.regressor(case.state, case.motion)
    np.testing.assert_allclose(found.mid[0], exact, atol=1e-11 * np.abs(exact).max())
    assert np.all(np.abs(found.mid[0] - exact) <= found.spread[0] + 1e-12 * np.abs(exact).max())
    coupled = bounds.columns(Motion(motion.v, motion.w, 0.0 * motion.a), case.shares, still=False)
    C = case.state.C(case.motion[0]) + case.state.damping
    parameters = case.model.parameters.values[case.rows]
    np.testing.assert_allclose(parameters @ coupled.mid[0], C @ case.motion[1], atol=1e-10)
    whole = Shares.of(parameters[:, None], case.system.n_free)
    np.testing.assert_allclose(bounds.inertia(whole).mid[0, 0], case.state.D, rtol=1e-10)
    slopes = []
    for h in (1e-4, 2e-4):
        ends = []
        for sign in (1.0, -1.0):
            q = case.state.q + sign * h * case.motion[0] + 0.5 * h**2 * case.rate[0]
            there = case.motion + sign * h * case.rate
            ends.append(case.regressor(case.model.at(q, case.state), there))
        slopes.append((ends[0] - ends[1]) / (2.0 * h))
    slope = (4.0 * slopes[0] - slopes[1]) / 3.0
    rate = bounds.rates(motion, Motion(*(affine(x[None]) for x in case.rate)), case.shares)
    np.testing.assert_allclose(rate.mid[0], slope, atol=1e-6 * np.abs(slope).max())
    assert np.abs(slope).max() > 0.1


@pytest.mark.parametrize("name", ["rpdr", "sprung"])
def test_over_sets_they_hold_their_members(name):
    """Closed members of a set of θ given to first order, with what that is off by; corners of the motion's."""
    case, rng = Case(name), np.random.default_rng(3)
    n, size = case.model.n, 1e-2
    middle = case.reading.theta(case.state.q_free)
    theta = Affine(middle[None], np.zeros((4 * n, 1, len(middle))), np.full((1, len(middle)), 2e-4), 4 * n)
    theta.lin[:n, 0] = size * case.state.rho.T
    forms = []
    for k, x in enumerate(case.motion):
        lin = np.zeros((4 * n, 1, n))
        lin[n * (1 + k) + np.arange(n), 0, np.arange(n)] = 0.1
        forms.append(Affine(x[None], lin, np.zeros((1, n)), 4 * n))
    motion, rate = Motion(*forms), Motion(*(affine(x[None]) for x in case.rate))
    bounds = RegressorBounds(case.system, case.masses, case.frames, case.model.gravity_vector, theta, motion.v)
    values, rates = bounds.columns(motion, case.shares), bounds.rates(motion, rate, case.shares)
    for _ in range(12):
        corner = rng.choice([-1.0, 1.0], 4 * n)
        state = case.model.at(case.state.q + size * corner[:n], case.state)
        there = case.motion + 0.1 * corner[n:].reshape(3, n)
        left = case.reading.theta(state.q_free) - middle - corner @ theta.lin[:, 0]
        assert np.all(np.abs(left) <= theta.rad[0])
        own, moved = case.at(state, there)
        for found, exact in ((values, own.columns(moved, case.shares)), (rates, own.rates(moved, rate, case.shares))):
            apart = np.abs(exact.mid[0] - found.mid[0] - np.tensordot(corner, found.lin[:, 0], axes=1))
            assert np.all(apart <= found.rad[0] + 1e-9)
            assert np.all(found.spread < 1e3)
