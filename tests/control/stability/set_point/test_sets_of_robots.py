"""One law and a set of robots: levels, slopes and points of rest, against a thousand of them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.control import PDSimpleGravity, certify_set_point, suggest_gains
from ccpin.control.stability.set_point import potential as module
from ccpin.control.stability.set_point.potential import GravityBounds, gravity_bounds
from ccpin.control.stability.set_point.set_point_reading import equations_of
from ccpin.control.stability.set_point.theorem3 import certify_law
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.proof.facts import NotProvedError
from ccpin.proof.rounding import SLACK, widened
from tests.support.paper import GOAL, K_P, K_V

OFF = 0.08


def bounds_about(model, off=OFF, kind="inertia"):
    told = model.parameters
    radii = np.zeros(len(told))
    inertial = told.of(kind)
    radii[inertial] = off * np.maximum(np.abs(told.values[inertial]), 1e-3)
    return told.values - radii, told.values + radii


@pytest.fixture(scope="module")
def law(rpdr_model):
    return PDSimpleGravity(rpdr_model, GOAL, K_P, K_V)


@pytest.fixture(scope="module")
def found(law):
    """Of a few cells."""
    certificate = certify_law(law, constants=bounds_about(law.model), max_depth=6, budget=60)
    assert certificate.verdict == "proven"
    return certificate


@pytest.fixture(scope="module")
def robots(law):
    """Constants of a thousand robots: at random, half of them as far off as there may be."""
    lower, upper = bounds_about(law.model)
    draw = np.random.default_rng(3)
    share = np.vstack([draw.integers(0, 2, (500, len(lower))), draw.random((500, len(lower)))])
    return lower + share * (upper - lower)


def energies(model, q, near=None):
    """Of every unit of a constant, at rest, less that at the goal."""
    still = np.zeros(model.n)
    return model.at(q, near).energy_regressor(still) - model.at(GOAL).energy_regressor(still)


def test_every_robots_well_is_as_high_on_the_boundary_and_no_steeper_within(law, found, robots):
    """U_π = U₀ + (π − π₀)·(E(q) − E(q_d)); ∂g/∂q by differences of the regressor at rest."""
    model, draw, still, step = law.model, np.random.default_rng(4), np.zeros((4, 2)), 1e-5
    off = robots - model.parameters.values
    lower, upper = found.cells
    ends, rises = (lower.min(axis=0), upper.max(axis=0)), []
    for k in draw.choice(len(lower), 15, replace=False):
        q = draw.uniform(lower[k], upper[k])
        steps = np.vstack([q + step * np.eye(2), q - step * np.eye(2)])
        g = model.regressor_many(steps, still, still) @ robots.T
        slope = np.stack([g[0] - g[2], g[1] - g[3]], axis=1) / (2.0 * step)
        assert np.linalg.norm(np.moveaxis(slope, 2, 0), 2, axis=(1, 2)).max() <= found.beta + 1e-6
        q[k % 2] = ends[draw.integers(2)][k % 2]
        near = found._region.near(q)
        if near is not None:
            rises.append(law.lyapunov(q, np.zeros(2), near) + off @ energies(model, q, near))
    assert len(rises) > 0
    assert np.min(rises) >= found.level


def test_every_robot_comes_to_rest_where_it_is_said_to(law, found, robots):
    """q = q_d + K_p⁻¹(g₀(q_d) − g_π(q)), a contraction; some come near the bound."""
    q, still = np.tile(law.q_d, (len(robots), 1)), np.zeros((len(robots), 2))
    for _ in range(12):
        g = np.einsum("sip,sp->si", law.model.regressor_many(q, still, still), robots)
        q = law.q_d + (law.gravity_d - g) / np.diag(law.K_p)
    far = np.linalg.norm(q - law.q_d, axis=1).max()
    assert 0.3 * found.rest < far <= found.rest
    assert f"at most {found.rest:.3g} from q_d" in found.reason


def test_a_state_is_in_the_set_where_it_is_in_every_robots(law, found, robots):
    draw, model, off = np.random.default_rng(5), law.model, robots - law.model.parameters.values
    lower, upper = (corner[0] for corner in found.cells)
    seen = set()
    for _ in range(40):
        q = draw.uniform(0.5 * (lower + GOAL), 0.5 * (upper + GOAL))
        v = draw.normal(size=2) * draw.uniform(0.0, 10.0)
        near = found._region.near(q)
        if near is None:
            continue
        energy = model.at(q, near).energy_regressor(v) - model.at(GOAL).energy_regressor(0.0 * v)
        most = law.lyapunov(q, v, near) + (off @ energy).max()
        if found.contains(q, v):
            assert most < found.level
        seen.add(found.contains(q, v))
        bound = law.lyapunov(q, v, near) + np.abs(energy) @ found.radii
        assert found.contains(q, v) == (bound < found.level)
    assert seen == {True, False}


def test_it_is_a_fact_about_its_set(law, found):
    """Of a larger set, of one robot and of another law it is none; a larger set has a lower level."""
    one = certify_law(law, max_depth=6, budget=60)
    assert (one.rest, one.radii) == (0.0, None)
    assert one.level > found.level
    for wrong in (2.0 * found.radii, 0.0 * found.radii, None):
        assert replace(found, radii=wrong).verdict == "undecided"
    assert replace(one, radii=found.radii).verdict == "undecided"
    assert found.replay().verdict == "proven"


def test_a_set_too_wide_is_not_proved(law):
    """Robots whose levers are nine times as long: no level."""
    wide = certify_law(law, constants=bounds_about(law.model, 8.0, "mx"), max_depth=1, budget=4)
    assert (wide.verdict, wide.level, wide.rest) == ("undecided", 0.0, np.inf)


def test_what_is_spread_are_weights_and_levers(law, found):
    """A chain for a mass, two for a first moment, whose potentials are the constants' own; forged ones are refused."""
    reading = found._region.reading
    own = equations_of(law, reading, found.radii)
    named = [name for name, radius in zip(law.model.parameters.names, found.radii, strict=True) if radius]
    weights = [name.partition(":")[0] for name in named if name[:4] == "mass" or name[:2] in ("mx", "my", "mz")]
    assert [len(chains) for chains in own.masses.spread] == [1 if kind == "mass" else 2 for kind in weights]
    pull = law.model.at(GOAL).regressor(np.zeros(2), np.zeros(2))
    expected = sum(
        np.linalg.norm(pull[:, k]) * r for k, r in enumerate(found.radii) if law.model.parameters.kinds[k] in weights
    )
    assert own.misjudged == pytest.approx(expected, rel=1e-6)
    chain = own.masses.spread[0][0]
    for wrong in (chain._replace(direction=True), chain._replace(weights=np.nan * chain.weights)):
        with pytest.raises(NotProvedError):
            replace(own, masses=own.masses._replace(spread=((wrong,),)))
    with pytest.raises(NotProvedError):
        replace(own, masses=own.masses._replace(spread=((),)))


@pytest.mark.slow
def test_gains_for_a_set(law):
    """β of the worst robot, of which the law's own is one."""
    model = law.model
    few, one = suggest_gains(model, GOAL, constants=bounds_about(model)), suggest_gains(model, GOAL)
    assert few.verdict == "proven"
    assert few.beta > one.beta
    assert few.proved.claim.equations.masses.spread


def test_what_a_set_adds_to_bounds(monkeypatch):
    """Of each potential how far it is from its level, its slope and curvature over the box, and its own bounds."""
    draw = np.random.default_rng(2)
    told = {
        name: GravityBounds(
            1e3 * draw.normal(size=3), draw.normal(size=(3, 2)), draw.normal(size=(3, 2, 2)), draw.random(3),
            draw.random((3, 2, 2)), draw.random((3, 4, 2)),
        )
        for name in ("own", "first", "second")
    }  # fmt: skip
    asked, half = [], draw.random((3, 2))
    monkeypatch.setattr(module, "_bounds_of_one", lambda problem, one, boxes: asked.append(problem) or told[one])
    boxes = SimpleNamespace(centre=draw.normal(size=(3, 4)), half=half)
    problem = SimpleNamespace(system=SimpleNamespace(independent=[1, 3]))

    class Spread(str):
        spread, levels = ("first", "second"), (0.25, -1e3)

    own = Spread("own")
    found, wide = gravity_bounds(problem, own, boxes), widened(boxes.centre[:, [1, 3]], half)
    remainder, variation = told["own"].remainder, told["own"].variation
    for name, level in zip(own.spread, own.levels, strict=True):
        part = told[name]
        bent = 0.5 * np.einsum("bi,bij,bj->b", wide, np.abs(part.hessian), wide)
        rounding = 1e-12 * (np.abs(part.value) + abs(level))
        rise = (
            np.abs(part.value - level) + rounding + part.remainder + (np.abs(part.gradient) * wide).sum(axis=1) + bent
        )
        remainder, variation = (remainder + rise) * SLACK, (variation + np.abs(part.hessian) + part.variation) * SLACK
    np.testing.assert_allclose(found.remainder, remainder, rtol=2e-15)
    np.testing.assert_allclose(found.variation, variation, rtol=2e-15)
    for name in ("value", "gradient", "hessian", "turning"):
        assert getattr(found, name) is getattr(told["own"], name)
    assert asked == [problem] * 3


def test_bounds_that_are_none_are_told(law):
    lower, upper = bounds_about(law.model)
    for wrong in ((upper, lower), (lower,), (lower[1:], upper[1:]), lower, (lower, upper * np.nan)):
        with pytest.raises(InvalidInputError):
            certify_law(law, constants=wrong)
    for sampled in (certify_law, lambda law, *given, **more: suggest_gains(law.model, GOAL, *given, **more)):
        with pytest.raises(InvalidInputError, match="sampled"):
            sampled(law, (GOAL - 0.1, GOAL + 0.1), constants=(lower, upper))
    spring = law.model.parameters.of("stiffness")[0]
    upper = upper + (np.arange(len(upper)) == spring)
    with pytest.raises(UnsupportedMechanismError, match="stiffness"):
        certify_law(law, constants=(lower, upper))


def test_gains_alone_say_it_too(law):
    """As a law does, of the same set."""
    bounds = bounds_about(law.model, kind="mx")
    found = certify_set_point(law.model, GOAL, K_P, K_V, constants=bounds, max_depth=1, budget=2)
    np.testing.assert_allclose(found.radii, bounds[1] - law.model.parameters.values, atol=1e-15)
