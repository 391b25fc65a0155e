"""Bounds of V∘σ and ∂g/∂q over certified boxes: exact at the centre, never violated, of the order they claim."""

from typing import NamedTuple

import numpy as np
import pytest

import ccpin
from ccpin.control.stability.set_point.potential import (
    GravityBounds,
    Potential,
    gravity_bounds,
    potential_of,
    potential_values,
)
from ccpin.control.stability.set_point.set_point_reading import masses_of
from ccpin.covering.proposals.krawczyk import certify_boxes
from ccpin.description import Inertia, Joint, Link
from ccpin.domain.closures.seeds import seed_at_coordinates
from ccpin.domain.closures.system import Reading
from tests.oracles import rpdr as oracle
from tests.oracles.finite_differences import derivative
from tests.support.carriages import at

# Half-widths (rad or m) at which a box around the reference is certified with room to spare.
SIZES = {
    "rpdr": 0.06,
    "four_bar": 0.1,
    "slider_crank": 0.1,
    "planar_3rrr": 0.04,
    "delta": 0.02,
    "hexa": 0.002,
    "stewart": 0.0015,
    "sprung_four_bar": 0.1,
}
SPRINGS = {"rocker": {"stiffness": 0.7, "spring_reference": 2.0}, "coupler": {"stiffness": 0.4}}


class Subject(NamedTuple):
    mechanism: ccpin.Mechanism
    model: ccpin.ReducedModel
    reading: Reading
    potential: Potential
    theta: np.ndarray

    @property
    def problem(self):
        return self.reading.problem

    @property
    def q(self):
        return self.theta[self.problem.system.independent]

    def bounds(self, half):
        half = np.broadcast_to(half, self.q.shape)
        attempt = certify_boxes(self.problem, self.theta[None], half[None], np.eye(len(half)))
        assert attempt.proved[0]
        return gravity_bounds(self.problem, self.potential, attempt.boxes)

    def configuration(self):
        return self.reading.configuration(self.theta)


def _subject(name, q=None, near=None):
    sprung = name.startswith("sprung_")
    mechanism = ccpin.load(name.removeprefix("sprung_"), joints=SPRINGS if sprung else None)
    model = ccpin.ReducedModel(mechanism)
    start = mechanism.q_reference if near is None else near
    seed = seed_at_coordinates(mechanism, model.alpha(start) if q is None else q, start)
    return Subject(mechanism, model, seed.reading, potential_of(masses_of(mechanism, seed.reading)), seed.theta)


@pytest.fixture(scope="module")
def subjects():
    """A subject by name, made once."""
    return {name: _subject(name) for name in SIZES}


def _points(rng, half, count, n):
    """Offsets inside a box, half of them at corners or on edges."""
    offsets = rng.uniform(-1.0, 1.0, (count, n))
    offsets[::2] = np.sign(offsets[::2])
    return half * offsets


def _worst(subject, bounds: GravityBounds, offsets):
    """The largest |error|/bound of V and of the entries of ∂g/∂q."""
    ratios = []
    near = subject.configuration()
    for delta in offsets:
        q = subject.q + delta
        value = subject.model.energy(q, np.zeros(len(q)), near).potential
        model = bounds.value[0] + bounds.gradient[0] @ delta + 0.5 * delta @ bounds.hessian[0] @ delta
        slope = np.abs(subject.model.gravity_derivative(q, near) - bounds.hessian[0])
        ratios.append((abs(value - model) / bounds.remainder[0], np.max(slope / bounds.variation[0])))
    return np.max(ratios, axis=0)


@pytest.mark.parametrize("name", SIZES)
def test_potential_is_pinocchios(subjects, name):
    """V′, g′ and ∂g′/∂q′ of the chains are Pinocchio's, at configurations closed or not."""
    subject, rng = subjects[name], np.random.default_rng(3)
    theta = subject.theta + rng.uniform(-0.7, 0.7, (6, len(subject.theta)))
    found, free = potential_values(subject.potential, theta), subject.model.free_system
    for k, q_free in enumerate(subject.reading.configuration(theta)):
        scale = 1e-13 * subject.potential.magnitude(theta)[k]
        still = np.zeros(len(theta[k]))
        assert found.value[k] == pytest.approx(free.energy(q_free, still).potential, abs=scale)
        np.testing.assert_allclose(found.gradient[k], free.gravity(q_free), atol=scale)
        np.testing.assert_allclose(found.hessian[k], free.gravity_derivative(q_free), atol=scale)


@pytest.mark.parametrize("name", SIZES)
def test_centre_is_exact(subjects, name):
    """At the centre the expansion's value, slope and curvature are V, g and ∂g/∂q."""
    subject = subjects[name]
    bounds, model, near = subject.bounds(0.1 * SIZES[name]), subject.model, subject.configuration()
    scale = 1.0 + np.abs(bounds.hessian).max()
    assert bounds.value[0] == pytest.approx(
        model.energy(subject.q, np.zeros(model.n), near).potential, abs=1e-12 * scale
    )
    np.testing.assert_allclose(bounds.gradient[0], model.gravity(subject.q, near), atol=1e-11 * scale)
    np.testing.assert_allclose(bounds.hessian[0], model.gravity_derivative(subject.q, near), atol=1e-10 * scale)


@pytest.mark.parametrize("name", SIZES)
@pytest.mark.parametrize("share", [1.0, 0.3])
def test_samples_never_violate_the_bounds(subjects, name, share):
    """V and ∂g/∂q at random points and corners of a box stay within the remainder and the variation."""
    subject, half = subjects[name], share * SIZES[name]
    offsets = _points(np.random.default_rng(5), half, 40, len(subject.q))
    assert np.all(_worst(subject, subject.bounds(half), offsets) < 1.0)


@pytest.mark.parametrize("name", SIZES)
def test_bounds_are_of_their_order(subjects, name):
    """Halving a small box divides the remainder by nearly 8 and the variation by nearly 2: neither is padded."""
    subject, half = subjects[name], 0.05 * SIZES[name]
    large, small = subject.bounds(half), subject.bounds(0.5 * half)
    assert large.remainder[0] / small.remainder[0] > 7.0
    assert large.spread[0] / small.spread[0] > 1.8


def _closed_form_slope(q):
    """∂g/∂q of the RPDR from the paper's closed forms."""

    def gravity(p):
        paper = oracle.sigma(p, 1)
        return oracle.rho(paper).T @ oracle.gravity(paper)

    return np.column_stack([derivative(lambda s, e=e: gravity(q + s * e), 5e-4) for e in np.eye(2)])


def test_rpdr_against_the_closed_form():
    """Off the reference and close to the isolated singular point, the closed form's ∂g/∂q is within the bounds."""
    corner = -oracle.coincident_elbows()
    rng = np.random.default_rng(8)
    for distance in (0.6, 0.15, 0.04):
        q = corner + distance * np.array([-0.6, 0.8])
        paper = oracle.sigma(q, 1)
        subject = _subject("rpdr", q, paper[[0, 2, 1, 3]])
        half = 0.08 * distance
        bounds = subject.bounds(half)
        for delta in _points(rng, half, 20, 2):
            slope = _closed_form_slope(q + delta)
            assert np.all(np.abs(slope - bounds.hessian[0]) <= bounds.variation[0] + 1e-6 * np.abs(slope).max())
            assert np.linalg.norm(slope, 2) <= bounds.norm[0] * (1 + 1e-6)


@pytest.mark.parametrize("half", [0.02, 0.05])
def test_the_bounds_are_attained_by_a_lone_arm(half):
    """V = m g l sin q of one heavy arm, level: V − Taylor is −m g l (q − sin q), ∂g/∂q = −m g l sin q, both sharp."""
    mass, length, fall, hinge = 2.0, 0.7, 9.81, np.array([0.0, 0.0, 1.0])
    heavy, light = Inertia(mass, np.array([length, 0.0, 0.0]), np.zeros((3, 3))), Inertia(0.0, np.zeros(3), np.eye(3))
    joints = (
        Joint("q1", "revolute", "base", "arm", at(), axis=hinge),
        Joint("q2", "revolute", "base", "other", at(1.5), axis=hinge),
        Joint("e1", "revolute", "arm", "rod1", at(1.0), axis=hinge),
        Joint("e2", "revolute", "other", "rod2", at(1.0), axis=hinge),
    )
    links = (Link("base"), *(Link(joint.child, heavy if joint.name == "q1" else light) for joint in joints))
    tip = ccpin.LoopClosure("tip", "revolute", "rod1", "rod2", at(1.2), at(1.2))
    described = ccpin.MechanismDescription("lone arm", "base", links, joints, (tip,))
    mechanism = ccpin.load(described, independent=["q1", "q2"])
    seed = seed_at_coordinates(mechanism, np.array([0.0, 0.9]))
    problem = seed.reading.problem
    potential = potential_of(masses_of(mechanism, seed.reading, np.array([0.0, -fall, 0.0])))
    attempt = certify_boxes(problem, seed.theta[None], np.array([[half, 1e-3]]), np.eye(2))
    assert attempt.proved[0]
    bounds, moment = gravity_bounds(problem, potential, attempt.boxes), mass * fall * length
    for found, true in (
        (bounds.remainder[0], moment * (half - np.sin(half))),
        (bounds.variation[0, 0, 0], moment * np.sin(half)),
    ):
        assert true <= found <= 1.02 * true


def test_norm_bounds_the_variation(subjects):
    """Norm and spread bound the spectral norms of every symmetric matrix within the variation."""
    bounds, rng = subjects["planar_3rrr"].bounds(0.03), np.random.default_rng(1)
    for _ in range(50):
        signs = rng.choice([-1.0, 1.0], (3, 3))
        change = np.triu(signs) * bounds.variation[0]
        change = change + np.triu(change, 1).T - np.tril(change, -1)
        assert np.linalg.norm(change, 2) <= bounds.spread[0]
        assert np.linalg.norm(bounds.hessian[0] + change, 2) <= bounds.norm[0]


def test_boxes_side_by_side(subjects):
    """Many boxes at once give what each gives alone."""
    subject = subjects["delta"]
    halves = np.array([[0.01] * 3, [0.02] * 3, [0.005, 0.01, 0.015]])
    together = certify_boxes(subject.problem, np.tile(subject.theta, (3, 1)), halves, np.eye(3))
    assert together.proved.all()
    found = gravity_bounds(subject.problem, subject.potential, together.boxes)
    for k, half in enumerate(halves):
        alone = subject.bounds(half)
        for one, many in zip(alone, found, strict=True):
            np.testing.assert_allclose(many[k], one[0], rtol=1e-9, atol=1e-12)
