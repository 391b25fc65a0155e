"""α and its derivatives for whole joints, circles, quaternions and single components."""

import numpy as np
import pinocchio as pin
import pytest

import ccpin
from ccpin.description import JOINT_KINDS
from ccpin.errors import IndependentSetError, InvalidInputError
from ccpin.kinematics.coordinates import IndependentCoordinates, component_names
from ccpin.kinematics.tree import build_tree
from tests.oracles.finite_differences import along, assert_close, jacobian
from tests.support.backends import same_on_both
from tests.support.strategies import Growth

KINDS = ("revolute", "continuous", "prismatic", "spherical", "planar", "floating")
ALL_COMPONENTS = [f"j{k}:{part}" for k, kind in enumerate(KINDS) for part in JOINT_KINDS[kind].components]


@pytest.fixture(scope="module")
def tree():
    """One joint of each kind in a chain."""
    growth = Growth(np.random.default_rng(21))
    growth.grow("base", KINDS)
    return build_tree(growth.drawn().description)


def near(tree, rng, spread):
    return pin.integrate(tree.model, pin.neutral(tree.model), spread * rng.normal(size=tree.model.nv))


@same_on_both
@pytest.mark.parametrize("spread", [1e-7, 0.03, 0.3, 0.9])
def test_component_derivatives(tree, spread):
    """α_q′ and its rate for every component, from next to the chart's centre to far from it."""
    rng = np.random.default_rng(22)
    reference = near(tree, rng, 1.0)
    for _ in range(5):
        q_free = pin.integrate(tree.model, reference, spread * rng.normal(size=tree.model.nv))
        v_free = rng.normal(size=tree.model.nv)
        for name in ALL_COMPONENTS:
            part = IndependentCoordinates(tree, (name,), reference)
            if name.startswith("j4:r") and abs(part.alpha(q_free)[0]) > 3.0:
                continue  # next to the cut of the circle
            assert_close(part.jacobian(q_free), jacobian(tree.model, q_free, part.alpha), 1e-9)
            rate = along(tree.model, q_free, v_free, part.jacobian)
            assert_close(
                part.jacobian_rate(q_free, v_free), rate, 1e-9, scale=1.0
            )  # of unit vectors turning at 1 rad/s


def test_component_is_the_rotation_vector(tree):
    """ball:rx, ry, rz are the entries of log(R_refᵀ R)."""
    rng = np.random.default_rng(23)
    reference = near(tree, rng, 1.0)
    coordinates = IndependentCoordinates(tree, ("j3:rx", "j3:ry", "j3:rz"), reference)
    joint = tree.model.joints[tree.model.getJointId("j3")]
    for _ in range(20):
        step = np.zeros(tree.model.nv)
        step[joint.idx_v : joint.idx_v + 3] = rng.uniform(-1.7, 1.7, 3)
        q_free = pin.integrate(tree.model, reference, step)
        assert_close(coordinates.alpha(q_free), step[joint.idx_v : joint.idx_v + 3], 1e-12)


def test_whole_joints(tree):
    """With every joint independent α is the configuration, difference and integrate are Pinocchio's."""
    rng = np.random.default_rng(24)
    names = tuple(f"j{k}" for k in range(len(KINDS)))
    coordinates = IndependentCoordinates(tree, names, pin.neutral(tree.model))
    assert (coordinates.nq, coordinates.n) == (tree.model.nq, tree.model.nv)
    np.testing.assert_array_equal(coordinates.jacobian(pin.neutral(tree.model)), np.eye(tree.model.nv))
    for _ in range(10):
        a, b = near(tree, rng, 1.0), near(tree, rng, 1.0)
        np.testing.assert_array_equal(coordinates.alpha(a), a)
        step = coordinates.difference(a, b)
        assert_close(step, pin.difference(tree.model, a, b), 1e-13)
        assert_close(
            pin.difference(tree.model, coordinates.integrate(a, step), b), np.zeros(len(step)), 1e-9, scale=1.0
        )


def test_order_is_the_callers(tree):
    """Coordinates come in the order named, whatever the order of the tree."""
    rng = np.random.default_rng(25)
    q_free = near(tree, rng, 0.5)
    coordinates = IndependentCoordinates(tree, ("j2", "j5:tz", "j1", "j0"), q_free)
    model = tree.model
    index = {name: model.idx_qs[model.getJointId(name)] for name in ("j0", "j1", "j2", "j5")}
    expected = [q_free[index["j2"]], q_free[index["j5"] + 2], *q_free[index["j1"] :][:2], q_free[index["j0"]]]
    np.testing.assert_allclose(coordinates.alpha(q_free), expected, rtol=0, atol=1e-15)
    other = coordinates.integrate(coordinates.alpha(q_free), np.array([0.1, 0.2, 0.3, 0.4]))
    assert_close(coordinates.difference(coordinates.alpha(q_free), other), np.array([0.1, 0.2, 0.3, 0.4]), 1e-13)


def test_component_names_are_the_velocity(tree):
    """One name a velocity component, in order."""
    names = component_names(tree)
    assert len(names) == len(set(names)) == tree.model.nv
    assert names[:3] == ["j0", "j1", "j2"]
    assert names[3:6] == ["j3:rx", "j3:ry", "j3:rz"]


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (("elbow",), "'elbow' is not a movable joint; there are j0, j1"),
        (("j3:tx",), "'j3:tx': components of the spherical joint 'j3' are rx, ry, rz"),
        (("j0:rx",), "name the joint alone"),
        (("j0", "j0"), "'j0' is named twice"),
        (("j3", "j3:rx"), "'j3:rx' is named twice"),
        (("j3:rx", "j3"), "'j3' is named twice"),
    ],
)
def test_wrong_names(tree, names, message):
    """Unknown and repeated names raise, saying which and what there is."""
    with pytest.raises(IndependentSetError, match=message):
        IndependentCoordinates(tree, names, pin.neutral(tree.model))


def ball_and_socket():
    """A spherical and a revolute joint, their tips tied by a distance closure."""
    growth = Growth(np.random.default_rng(26))
    growth.close("distance", growth.grow("base", ["spherical"]), growth.grow("base", ["revolute"]))
    return growth.drawn().description


@pytest.mark.parametrize("independent", [("j0",), ("j0:rx", "j0:ry", "j0:rz"), ("j1", "j0:rx", "j0:rz")])
def test_sigma_with_rotations_as_coordinates(independent):
    """σ, ρ and ρ̇ with a quaternion, with components of it, and with a mixture as independent coordinates."""
    model = ccpin.ReducedModel(ccpin.load(ball_and_socket(), independent=independent))
    tree, rng = model.mechanism.pin_model, np.random.default_rng(27)
    q = model.alpha(model.mechanism.q_reference)
    target = model.coordinates.integrate(q, 0.02 * rng.normal(size=model.n))
    q_free, v = model.sigma(target), rng.normal(size=model.n)
    assert_close(model.coordinates.difference(model.alpha(q_free), target), np.zeros(model.n), 1e-12, scale=1.0)
    v_free = model.rho(q_free) @ v
    rate = along(tree, q_free, v_free, model.alpha)
    if model.coordinates.nq == model.coordinates.n:
        assert_close(rate, v, 1e-8)
    assert_close(model.rho_dot(q_free, v_free), along(tree, q_free, v_free, model.rho), 1e-8)


def test_quaternions_must_be_unit():
    """A q off its manifold raises; one off by round-off is normalised."""
    model = ccpin.ReducedModel(ccpin.load(ball_and_socket(), independent=["j0"]))
    q = model.alpha(model.mechanism.q_reference)
    with pytest.raises(InvalidInputError, match="unit length"):
        model.sigma(1.01 * q)
    assert np.linalg.norm(model.alpha(model.sigma((1.0 + 1e-9) * q))) == pytest.approx(1.0, abs=1e-14)
    with pytest.raises(InvalidInputError, match=r"q_free .*unit length"):
        model.rho(2.0 * model.mechanism.q_reference)
    with pytest.raises(InvalidInputError, match=r"near .*unit length"):
        model.sigma(q, 2.0 * model.mechanism.q_reference)
