"""V′ of bodies and springs: what its roundings are stated to be, term by term, and which bodies it is of."""

from dataclasses import replace

import numpy as np
import pytest

import ccpin
from ccpin.control.stability.set_point import potential as module
from ccpin.control.stability.set_point.potential import _expand, potential_of, potential_values
from ccpin.control.stability.set_point.set_point_reading import masses_of
from ccpin.domain.closures.system import reading_of
from ccpin.proof.equations import derivatives
from ccpin.proof.newton import Boxes
from ccpin.proof.rounding import UNIT_ROUNDOFF, widened
from tests.support.flat_cells import heavy_based

SPRINGS = {"stiffness": 0.7, "spring_reference": 2.0}


@pytest.fixture(params=["slider_crank", "rpdr"])
def known(request):
    joint = {"slider_crank": "slider", "rpdr": "joint3"}[request.param]
    mechanism = ccpin.load(request.param, joints={joint: SPRINGS})
    reading = reading_of(mechanism, mechanism.q_reference)
    return mechanism, reading, potential_of(masses_of(mechanism, reading))


def test_sizes_of_the_potential(known):
    """Σ |mγ|(lengths + |slides|) + Σ k(1 + |θ| + |θ₀|)²."""
    _, reading, potential = known
    theta = np.random.default_rng(0).normal(size=(3, reading.system.n_free))
    stack = potential.stack
    for row, found in zip(theta, potential.magnitude(theta), strict=True):
        total = 0.0
        for c, force in enumerate(potential.forces):
            slid = sum(abs(row[j]) * s for j, s in zip(stack.joints[c], stack.sliding[c], strict=True) if s)
            total += force * (potential.lengths[c] + slid)
        springs = zip(potential.stiffness, row, potential.rest, strict=True)
        total += sum(k * (1 + abs(x) + abs(r)) ** 2 for k, x, r in springs)
        assert found == pytest.approx(total, rel=1e-12)
    assert potential.stiffness.any()


def test_bodies_with_mass_are_chains(known):
    """Each with its translations and its lever; the rounding of the longest."""
    mechanism, reading, potential = known
    tree, joints = mechanism.tree.model, mechanism.tree.joints
    heavy = [k for k, inertia in enumerate(tree.inertias) if k and inertia.mass]
    assert len(potential.forces) == len(heavy)
    gravity = np.asarray(tree.gravity.linear)
    np.testing.assert_allclose(potential.forces, [tree.inertias[k].mass * np.linalg.norm(gravity) for k in heavy])
    for k, length in zip(heavy, potential.lengths, strict=True):
        way = sum(np.linalg.norm(tree.jointPlacements[j].translation) for j in list(tree.supports[k])[1:])
        assert length == pytest.approx(way + np.linalg.norm(tree.inertias[k].lever), rel=1e-12)
    depth = max(len(list(tree.supports[k])) - 1 for k in heavy)
    assert potential.rounding == (128 * (depth + 2) + 4 * reading.system.n_free) * UNIT_ROUNDOFF
    assert len(joints) == len(list(tree.inertias)) - 1


def test_the_base_weighs_nothing():
    mechanisms = ccpin.load("rpdr"), heavy_based()
    first, second = (len(potential_of(masses_of(m, reading_of(m, m.q_reference))).forces) for m in mechanisms)
    assert first == second


def test_circles_without_springs_are_bounded():
    described = ccpin.load("rpdr").description
    free = {"kind": "continuous", "lower": -np.inf, "upper": np.inf}
    joints = tuple(replace(j, **free) if j.name == "joint3" else j for j in described.joints)
    mechanism = ccpin.load(replace(described, joints=joints))
    assert len(potential_of(masses_of(mechanism, reading_of(mechanism, mechanism.q_reference))).forces)


def test_expansions_about_centres_that_are_open(known):
    """L_c = V′ + μÃφ; moves |D|h + |E|R; roundings of φ by |Ã|, of V′ by its own size over the tube and by |μ|."""
    mechanism, reading, potential = known
    system, problem = reading.system, reading.problem
    rng = np.random.default_rng(1)
    theta = reading.theta(mechanism.q_reference)[None] + 0.01 * rng.normal(size=(1, system.n_free))
    n, m = system.n, system.m
    directions = rng.normal(size=(1, system.n_free, n))
    directions[:, system.independent] = np.eye(n)
    boxes = Boxes(
        theta, np.full((1, n), 0.1), directions, rng.normal(size=(1, m, m)), rng.normal(size=(1, m, m)),
        rng.uniform(0.1, 0.2, (1, m)), np.ones((1, m)), np.array([0.5]),
    )  # fmt: skip
    seen = []
    real = module._drift
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_drift", lambda *given: seen.append(given) or real(*given))
        found = _expand(problem, potential, boxes)
    modes = np.zeros((system.n_free, m))
    modes[system.dependent] = boxes.modes[0]
    half = widened(theta[:, system.independent], boxes.half)
    moves = np.abs(directions[0]) @ half[0] + np.abs(modes) @ boxes.radius[0]
    np.testing.assert_allclose(found.moves[0], moves, rtol=1e-12)
    at, phi = potential_values(potential, theta), derivatives(problem, theta).phi[0]
    mu = -modes.T @ at.gradient[0]
    assert found.value[0] == pytest.approx(at.value[0] + mu @ boxes.preconditioner[0] @ phi, rel=1e-12)
    assert abs(mu @ boxes.preconditioner[0] @ phi) > 1e-6
    reach = np.abs(theta) + moves
    rounding = system.rounding * system.magnitude(reach)[0]
    margin = np.abs(boxes.preconditioner[0]).sum(axis=1) * rounding
    own = potential.rounding * potential.magnitude(reach)[0] + np.abs(mu) @ margin
    np.testing.assert_allclose(found.margin[0], [*margin, own], rtol=1e-12)
    arms = potential.rounding * (1.0 + potential.lengths.max() + reach.sum())
    np.testing.assert_allclose(seen[1][4], [arms], rtol=1e-12)
    np.testing.assert_allclose(seen[0][4], [rounding], rtol=1e-12)
