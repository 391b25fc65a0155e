"""Bounds of the reduced model off the closed configurations: against States there, and members of the sets."""

import numpy as np
import pytest

import ccpin
from ccpin.control.stability.tracking.mass_reading import bodies_on_joints_of
from ccpin.control.stability.tracking.motion_bounds import Motion, Reduced
from ccpin.errors import UnsupportedMechanismError
from ccpin.proof.balls import Affine
from tests.support.ball_joint import ball_joint
from tests.support.open_configurations import Case, assert_bounds_are_the_model

NAMES = ("rpdr", "delta", "slider_crank", "four_bar", "hexa", "sprung")


def _model(name):
    """A model of the zoo; the four-bar again with springs, dampers and rotors, on the moon."""
    if name != "sprung":
        return ccpin.ReducedModel(ccpin.load(name))
    stated = {"stiffness": 0.7, "spring_reference": 2.0, "damping": 0.3, "armature": 0.01}
    joints = {"crank": stated, "rocker": stated, "coupler": stated}
    return ccpin.ReducedModel(ccpin.load("four_bar", joints=joints), gravity=(0.3, 0.1, -1.62))


@pytest.mark.parametrize("name", NAMES)
def test_at_one_configuration_they_are_the_model(name):
    """As `assert_bounds_are_the_model` says."""
    assert_bounds_are_the_model(_model(name))


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name == "hexa")) for name in NAMES])
def test_over_sets_they_hold_their_members(name):
    """Random members of θ and of the motion, corners among them, that share their parameters."""
    case, rng, size = Case(_model(name)), np.random.default_rng(3), 2e-3
    n, n_free = case.model.n, case.system.n_free
    names = ("v", "w", "a")
    forms = {"theta": Affine(case.theta[None], size * rng.normal(size=(3, 1, n_free)), np.full((1, n_free), 1e-4), 1)}
    for key in names:
        forms[key] = Affine(getattr(case, key)[None], 0.05 * rng.normal(size=(3, 1, n)), np.full((1, n), 0.01), 1)
    at = Reduced(case.system, case.masses, forms["theta"])
    slope, C = at.force_slope(Motion(*(forms[key] for key in names))), at.coriolis(forms["v"])
    assert np.isfinite(slope.rad).all()
    for _ in range(12):
        point = np.append(rng.choice([-1.0, 1.0]), np.array([0.6, -0.8]) * rng.choice([-1.0, 1.0], 2))
        some = {
            key: form.mid[0] + point @ form.lin[:, 0] + rng.choice([-1.0, 1.0], form.rad[0].shape) * form.rad[0]
            for key, form in forms.items()
        }
        state = case.state(some["theta"])
        expected = case.slope(some["theta"], some["v"], some["w"], some["a"])
        for found, value, noise in (
            (at.inertia, state.D, 1e-12),
            (C, state.C(some["v"]), 1e-12),
            (slope, expected, 1e-6 * np.abs(expected).max()),
        ):
            left = np.abs(value - found.mid[0] - np.tensordot(point, found.lin[:, 0], axes=1))
            assert np.all(left <= found.rad[0] + noise)


def test_a_set_with_a_singular_configuration_is_not_bounded():
    """The RPDR's set of all elbow angles has singular ones: NaN, never a number."""
    case = Case(_model("rpdr"))
    wide = Affine(case.theta[None], np.zeros((0, 1, 4)), np.full((1, 4), 2.0))
    assert not Reduced(case.system, case.masses, wide).grip.regular.any()
    assert np.isnan(Reduced(case.system, case.masses, wide).inertia.rad).all()


def test_joints_of_several_freedoms_are_refused():
    """A ball joint's error has no size without a chart."""
    model = ball_joint()
    case = Case(_model("rpdr"))
    with pytest.raises(UnsupportedMechanismError, match="several freedoms"):
        bodies_on_joints_of(model.mechanism, case.reading, model.gravity_vector)
