"""Bounds of the reduced model at one configuration that is not closed, and ccpin's own State there."""

import numpy as np

from ccpin.control.stability.tracking.mass_reading import bodies_on_joints_of
from ccpin.control.stability.tracking.masses import masses_of
from ccpin.control.stability.tracking.motion_bounds import Motion, Reduced
from ccpin.domain.closures.system import reading_of
from ccpin.dynamics.state import State
from ccpin.proof.balls import affine
from tests.oracles.finite_differences import derivative


class Case:
    """A model at an open configuration near its reference, and a random motion."""

    def __init__(self, model, seed=0):
        rng = np.random.default_rng(seed)
        self.model = model
        mechanism = self.model.mechanism
        self.reading = reading_of(mechanism, mechanism.q_reference)
        self.system, self.problem = self.reading.system, self.reading.problem
        self.masses = masses_of(self.system, bodies_on_joints_of(mechanism, self.reading, self.model.gravity_vector))
        self.theta = self.reading.theta(mechanism.q_reference)
        self.theta[self.system.dependent] += 0.02 * rng.normal(size=self.system.m)
        self.v, self.w, self.a = rng.normal(size=(3, self.model.n))

    def state(self, theta):
        """ccpin's own State at a θ that is not closed."""
        q_free = self.reading.configuration(theta)
        return State.of(self.model, self.model.alpha(q_free), self.model.parametrization.at(q_free))

    def tau(self, theta, v, w, a):
        """D a + C(v) w + damping w + g of that State."""
        state = self.state(theta)
        return state.D @ a + (state.C(v) + state.damping) @ w + state.g

    def slope(self, theta, v, w, a):
        """Its derivative by the dependent coordinates, by differences."""
        steps = np.eye(len(theta))[self.system.dependent]
        return np.array([derivative(lambda s, d=d: self.tau(theta + s * d, v, w, a)) for d in steps]).T


def assert_bounds_are_the_model(model):
    """D, C and damping of a State off the closed set, and the differences of its τ: also where v, w and a are apart."""
    case = Case(model)
    state, at = case.state(case.theta), Reduced(case.system, case.masses, affine(case.theta[None]))
    pairs = [
        (at.inertia, state.D),
        (at.coriolis(affine(case.v[None])), state.C(case.v)),
        (at.damping, state.damping),
        (at.rho, case.state(case.theta).rho),
    ]
    for found, expected in pairs:
        scale = np.abs(expected).max()
        np.testing.assert_allclose(found.mid[0], expected, rtol=0, atol=1e-12 * (1.0 + scale))
        assert found.rad.max() < 1e-9 * (1.0 + scale)
    slope = at.force_slope(Motion(*(affine(x[None]) for x in (case.v, case.w, case.a))))
    expected = case.slope(case.theta, case.v, case.w, case.a)
    np.testing.assert_allclose(slope.mid[0], expected, rtol=0, atol=1e-8 * np.abs(expected).max())
