"""Closing loops from afar: the rows that have one zero, and welds whose ends start turned end for end."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from ccpin import LoopClosure, MechanismDescription
from ccpin.description import CLOSURE_KINDS, Inertia, Joint, Link
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.tree import build_tree
from ccpin.mechanism.poses.loop_closing import aligning_rows, close, close_from_afar, position_rows
from ccpin.mechanism.poses.pose_search import find_closed

HALF_TURN = np.diag([1.0, -1.0, -1.0, 1.0])


def moved(x, y, z):
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


def mechanism(kind):
    """Two bodies floating in the world, joined by one closure of that kind between tilted frames."""
    tilted = np.eye(4)
    tilted[:3, :3] = Rotation.from_euler("xyz", [0.4, -0.7, 1.1]).as_matrix()
    description = MechanismDescription(
        "pair",
        "base",
        (
            Link("base"),
            Link("a", Inertia(1.0, np.zeros(3), np.eye(3))),
            Link("b", Inertia(1.0, np.zeros(3), np.eye(3))),
        ),
        (Joint("to_a", "floating", "base", "a"), Joint("to_b", "floating", "base", "b")),
        (LoopClosure("pair", kind, "a", "b", tilted @ moved(0.1, 0.2, 0.3), moved(0.3, 0.0, -0.1) @ tilted, 0.5),),
    )
    tree = build_tree(description)
    return tree.model, Constraints(tree, description.closures, ())


def half_turned_rods():
    """A crank and a rocker that carry half a rod each, on three revolute joints, welded end to end half turned."""
    inertia = Inertia(0.5, np.zeros(3), 0.01 * np.eye(3))
    links, joints = [Link("base")], []
    for arm, foot in (("crank", moved(0, 0, 0)), ("rocker", moved(0.5, 0, 0))):
        links.append(Link(arm, inertia))
        joints.append(Joint(f"turn_{arm}", "revolute", "base", arm, foot, np.array([0.0, 0.0, 1.0])))
        parent = arm
        for k, axis in enumerate(np.eye(3)):
            child = f"{arm}_{k}"
            links.append(Link(child, inertia if k == 2 else None))
            joints.append(
                Joint(f"{child}_joint", "revolute", parent, child, moved(0, 0.2, 0) if k == 0 else np.eye(4), axis)
            )
            parent = child
    end = moved(0.0, 0.0, -0.3)
    return MechanismDescription(
        "rods",
        "base",
        tuple(links),
        tuple(joints),
        (LoopClosure("weld", "fixed", "crank_2", "rocker_2", end, end @ HALF_TURN),),
    )


@pytest.mark.parametrize("kind", CLOSURE_KINDS)
@pytest.mark.parametrize("rows", [position_rows, aligning_rows])
def test_the_jacobian_is_the_derivative_of_the_rows(kind, rows):
    """Central differences at random configurations off the manifold."""
    model, constraints = mechanism(kind)
    step = 1e-6
    generator = np.random.default_rng(11)
    for _ in range(5):
        q = pin.integrate(model, pin.neutral(model), generator.standard_normal(model.nv))
        columns = [
            (
                rows(constraints, pin.integrate(model, q, d)).residual
                - rows(constraints, pin.integrate(model, q, -d)).residual
            )
            / (2 * step)
            for d in step * np.eye(model.nv)
        ]
        np.testing.assert_allclose(rows(constraints, q).jacobian, np.array(columns).T, atol=1e-7)


@pytest.mark.parametrize(("kind", "free"), [("fixed", ()), ("revolute", (2,)), ("prismatic", ()), ("planar", (2,))])
def test_the_added_rows_measure_the_angle_between_the_ends(kind, free):
    """Their length is θ, the angle the relative rotation (or the axis) has to go: zero the right way round only."""
    model, constraints = mechanism(kind)
    loop = constraints.loops[0]
    generator = np.random.default_rng(5)
    for _ in range(20):
        q = pin.integrate(model, pin.neutral(model), 3 * generator.standard_normal(model.nv))
        data = model.createData()
        pin.forwardKinematics(model, data, q)
        turn_a = data.oMi[loop.joint_a].rotation @ loop.frame_a[:3, :3]
        turn_b = data.oMi[loop.joint_b].rotation @ loop.frame_b[:3, :3]
        if free:
            angle = np.arccos(np.clip(turn_a[:, 2] @ turn_b[:, 2], -1, 1))
        else:
            angle = Rotation.from_matrix(turn_a.T @ turn_b).magnitude()
        rows = aligning_rows(constraints, q).residual[-3:]
        assert np.linalg.norm(rows) == pytest.approx(angle, abs=1e-7)


def test_a_weld_whose_ends_start_half_turned_closes_the_right_way_round():
    """From the neutral pose φ alone leads to a false zero; the stages do not, and the ends coincide."""
    tree = build_tree(half_turned_rods())
    constraints = Constraints(tree, half_turned_rods().closures, ())
    neutral = pin.neutral(tree.model)
    direct = close(constraints, neutral)
    assert not (direct.closed and constraints.aligned(direct.q_free))
    found = close_from_afar(constraints, neutral)
    assert found.closed
    data, loop = tree.model.createData(), constraints.loops[0]
    pin.forwardKinematics(tree.model, data, found.q_free)
    ends = [
        data.oMi[joint].homogeneous @ frame
        for joint, frame in ((loop.joint_a, loop.frame_a), (loop.joint_b, loop.frame_b))
    ]
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-11)
    assert find_closed(constraints, neutral)[0].start == "the stated pose"
