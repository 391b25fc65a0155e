"""Sets of robots, number by number: how far constants reach, what g(q_d) may be off, and the highest 𝒱 of a robot."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import ccpin
from ccpin.control import PDSimpleGravity
from ccpin.control.stability.set_point import set_point_equations as module
from ccpin.control.stability.set_point.potential import potential_values
from ccpin.control.stability.set_point.set_point_certificate import SetPointCertificate
from ccpin.control.stability.set_point.set_point_reading import equations_of, radii_of
from ccpin.domain.closures.system import reading_of
from ccpin.dynamics.changed_constants import with_constants
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.proof.facts import NotProvedError
from ccpin.proof.rounding import SLACK
from tests.support.paper import GOAL, K_P, K_V

OFF = {"mx:link1": 0.005, "mx:link2": 0.004, "mx:link3": 0.002}


@pytest.fixture(scope="module")
def law(rpdr_model):
    return PDSimpleGravity(rpdr_model, GOAL, K_P, K_V)


@pytest.fixture(scope="module")
def radii(rpdr_model):
    return np.array([OFF.get(name, 0.0) for name in rpdr_model.parameters.names])


@pytest.fixture(scope="module")
def own(law, radii):
    """What is claimed of them."""
    return equations_of(law, reading_of(law.model.mechanism, law.q_free_d), radii)


def test_constants_are_as_far_off_as_the_farther_bound(law):
    told, draw = law.model.parameters, np.random.default_rng(1)
    below, above = draw.random((2, len(told))) * np.isin(np.arange(len(told)), told.of("inertia", "damping"))
    found = radii_of(law.model, (told.values - below, told.values + above))
    np.testing.assert_allclose(found, np.maximum(below, above), atol=1e-15)
    assert radii_of(law.model, None) is None
    assert not radii_of(law.model, (told.values, told.values)).any()


def test_bounds_are_a_pair_whose_entries_are_in_order(law):
    """One entry that crosses is one too many; one spring of which nothing but one bound is given, alike."""
    told = law.model.parameters
    unit = np.eye(len(told))
    lower, upper = told.values - unit[0], told.values + unit[0]
    for wrong in ([lower, upper], (lower, upper, upper), (lower,), (lower + 3.0 * unit[1], upper)):
        with pytest.raises(InvalidInputError, match="constants"):
            radii_of(law.model, wrong)
    for kind in ("stiffness", "offset"):
        place = told.of(kind)[1]
        with pytest.raises(UnsupportedMechanismError, match=f"'{told.names[place]}'"):
            radii_of(law.model, (lower, upper + unit[place]))


def test_the_highest_of_eight_robots(law, radii):
    """𝒱 is linear in constants: the most over a box of three is at one of its corners, each a mechanism of its own."""
    model, q, v = law.model, GOAL + [0.1, -0.07], np.array([1.5, -2.0])
    near, rises = model.at(q, law.near).q_free, []
    for signs in itertools.product((-1.0, 1.0), repeat=len(OFF)):
        off = radii.copy()
        off[np.flatnonzero(radii)] *= signs
        constants = replace(model.parameters, values=model.parameters.values + off)
        robot = PDSimpleGravity(ccpin.load(with_constants(model, constants)), GOAL, K_P, K_V)
        rises.append(robot.lyapunov(q, v, near) + (GOAL - q) @ (law.gravity_d - robot.gravity_d))
    found = SetPointCertificate._highest(SimpleNamespace(law=law, radii=radii), q, v, near)
    assert found == pytest.approx(max(rises), rel=1e-10)
    assert len(set(np.round(rises, 6))) == 8
    alone = SimpleNamespace(law=law, radii=None)
    assert SetPointCertificate._highest(alone, q, v, near) == law.lyapunov(q, v, near)


def test_what_gravity_may_be_misjudged_by(law, radii, own, monkeypatch):
    """Of each constant its column of Y at rest, and a margin, here a half of |V_q| + |ρ|ᵀ|V_y| + the size of V."""
    theta, system, rho = own.theta[None], own.closures.system, law.near.rho
    pulls = (law.near.regressor(np.zeros(2), np.zeros(2)) * radii)[:, radii > 0.0].T
    monkeypatch.setattr(module, "_OWN", 0.5)
    total = 0.0
    for part, pull in zip(own.potential.spread, pulls, strict=True):
        slope = potential_values(part, theta).gradient[0]
        size = np.abs(slope[system.independent]) + np.abs(slope[system.dependent]) @ np.abs(rho[system.dependent])
        total += np.linalg.norm(np.abs(pull) + 0.5 * (size + part.magnitude(theta)[0]))
    assert own.misjudged == pytest.approx(total * SLACK, rel=1e-12)
    assert own.misjudged > total


def test_bodies_that_are_spread_have_weights(own):
    """One entry of one chain that is no number is one too many."""
    chain = own.masses.spread[1][0]
    weights = chain.weights.copy()
    weights[0, 1] = np.nan
    with pytest.raises(NotProvedError, match="weights"):
        replace(own, masses=own.masses._replace(spread=((chain, chain._replace(weights=weights)),)))
    assert replace(own).digest == own.digest
