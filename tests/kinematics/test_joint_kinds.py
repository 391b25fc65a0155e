"""The joint table: one new entry makes a new joint kind, from the description to the certificate."""

import numpy as np
import pinocchio as pin
import pytest

import ccpin
from ccpin import LoopClosure, MechanismDescription
from ccpin.description import JOINT_KINDS, Inertia, Joint, Link
from ccpin.description.joint_kinds import JointKind
from ccpin.domain import kantorovich_radius
from ccpin.errors import DescriptionError
from ccpin.kinematics.coordinates import component_names
from ccpin.kinematics.tree import build_tree
from tests.oracles.finite_differences import assert_close
from tests.support.strategies import rigid, turn

AXIS = np.array([0.36, 0.48, 0.8])
CLOSED = {"slide": (0.15, 1.3), "elbow": (1.7,), "crank": (0.4,), "knee": (0.9,)}


@pytest.fixture
def cylindrical(monkeypatch):
    """The table with one entry more."""
    monkeypatch.setitem(JOINT_KINDS, "cylindrical", JointKind("cylindrical", ("tz", "rz"), turned=True))


def arms(whole):
    """Two arms from the base whose tips a ball joint ties; the first hangs on a cylindrical joint or on its parts."""
    rng = np.random.default_rng(31)
    foot, upper, lower = turn([0.0, 1.0, 0.0], 0.3), turn([1.0, 0.0, 0.0], 0.5), turn([0.0, 1.0, 0.0], -0.4)
    foot[:3, 3], upper[:3, 3], lower[:3, 3] = (0.1, 0.0, 0.2), (0.5, 0.1, 0.0), (0.6, 0.0, 0.1)
    base = rigid(np.eye(3), [0.8, 0.3, 0.0])
    slide = [Joint("slide", "cylindrical", "base", "thigh", foot, AXIS, armature=0.02)]
    parts = [
        Joint("slide_t", "prismatic", "base", "sleeve", foot, AXIS, armature=0.02),
        Joint("slide_r", "revolute", "sleeve", "thigh", axis=AXIS, armature=0.02),
    ]
    joints = [
        *(slide if whole else parts),
        Joint("elbow", "revolute", "thigh", "shin", upper, np.array([0.0, 0.6, 0.8])),
        Joint("crank", "revolute", "base", "rocker", base, np.array([0.0, 0.0, 1.0])),
        Joint("knee", "revolute", "rocker", "rod", lower, np.array([0.0, 1.0, 0.0])),
    ]
    masses = {
        name: Inertia(float(rng.uniform(0.5, 2.0)), rng.uniform(-0.2, 0.2, 3), 0.1 * np.eye(3))
        for name in ("thigh", "shin", "rocker", "rod")
    }
    links = [Link("base"), *(Link(joint.child, masses.get(joint.child)) for joint in joints)]
    split = {"slide_t": CLOSED["slide"][:1], "slide_r": CLOSED["slide"][1:]}
    reference = {name: CLOSED.get(name, split.get(name)) for name in (joint.name for joint in joints)}
    independent = ("slide:tz" if whole else "slide_t", "crank")
    return MechanismDescription(
        "arms", "base", tuple(links), tuple(joints), independent=independent, reference=reference
    )


def closed(whole):
    """The arms, tied where their reference puts them."""
    description = arms(whole)
    tree = build_tree(description)
    data = tree.model.createData()
    pin.forwardKinematics(tree.model, data, np.concatenate([np.array(value) for value in CLOSED.values()]))
    shin, rod = (data.oMi[tree.attachments[link].joint].homogeneous for link in ("shin", "rod"))
    tip = rigid(np.eye(3), [0.4, 0.0, 0.1])
    closure = LoopClosure("tie", "spherical", "shin", "rod", tip, np.linalg.inv(rod) @ shin @ tip)
    return ccpin.load(description, closures=[closure])


def test_a_new_kind_is_one_entry(cylindrical):
    """σ, ρ̇, forward dynamics with its derivatives and the certificate are those of a slide and a turn in series."""
    one, two = closed(whole=True), closed(whole=False)
    assert component_names(one.tree)[:2] == ["slide:tz", "slide:rz"]
    assert one.independent == ("slide:tz", "crank")
    assert_close(one.q_reference, two.q_reference, 1e-10)
    model, oracle = ccpin.ReducedModel(one), ccpin.ReducedModel(two)
    q = model.alpha(one.q_reference) + np.array([0.03, -0.05])
    v, u = np.array([0.4, -0.7]), np.array([1.5, 0.6])
    q_free = model.sigma(q)
    v_free = model.rho(q_free) @ v
    assert_close(q_free, oracle.sigma(q), 1e-10)
    assert_close(model.rho_dot(q_free, v_free), oracle.rho_dot(q_free, v_free), 1e-9)
    assert_close(model.forward_dynamics(q, v, u), oracle.forward_dynamics(q, v, u), 1e-8)
    slopes, expected = (m.forward_dynamics_derivatives(q, v, u) for m in (model, oracle))
    for name in ("da_dq", "da_dv", "da_du"):
        assert_close(getattr(slopes, name), getattr(expected, name), 1e-7)
    radius = kantorovich_radius(one, one.q_reference)
    assert radius > 0.05
    assert radius == pytest.approx(kantorovich_radius(two, two.q_reference), rel=1e-6)


def test_a_kind_outside_of_the_table_is_refused():
    """The check knows the table's kinds and "fixed"."""
    with pytest.raises(DescriptionError, match=r"type 'cylindrical' is not one of revolute, .*floating, fixed"):
        ccpin.load(arms(whole=True), closures=[LoopClosure("tie", "spherical", "shin", "rod")])


def test_steps_that_do_not_commute_are_refused(monkeypatch):
    """Pinocchio's rates are wrong where a joint's axes move in its own frame, so no such joint is composed."""
    monkeypatch.setitem(JOINT_KINDS, "cylindrical", JointKind("cylindrical", ("rx", "ry")))
    with pytest.raises(DescriptionError, match="joint 'slide': the steps of a cylindrical joint do not commute"):
        build_tree(arms(whole=True))


@pytest.mark.parametrize("kind", JOINT_KINDS.values(), ids=JOINT_KINDS)
def test_chart_and_manifold(kind):
    """θ ↔ q is one to one, a rate is the difference quotient, and Pinocchio agrees on the sizes."""
    rng = np.random.default_rng(32)
    joint = Joint("joint", kind.name, "base", "body", axis=AXIS)
    tree = build_tree(MechanismDescription("one", "base", (Link("base"), Link("body")), (joint,)))
    assert (tree.model.nq, tree.model.nv) == (kind.nq, kind.nv)
    for _ in range(5):
        centre = pin.integrate(tree.model, pin.neutral(tree.model), rng.normal(size=kind.nv))
        theta, v = rng.uniform(-1.2, 1.2, kind.nv), rng.normal(size=kind.nv)
        q = kind.configuration(theta, kind.reference(centre))
        assert_close(kind.theta(q, kind.reference(centre)), theta, 1e-12)
        assert_close(kind.difference(q, pin.integrate(tree.model, q, 0.3 * v)), 0.3 * v, 1e-12)
        step = 1e-6
        there, back = (pin.integrate(tree.model, q, sign * step * v) for sign in (1.0, -1.0))
        assert_close(kind.rate(q, v), (there - back) / (2 * step), 1e-8)
