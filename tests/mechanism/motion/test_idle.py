"""Which motions are idle: rods on balls however they are written, legs of two bodies, and what only looks like it."""

import numpy as np
import pytest

import ccpin
from ccpin.description import Inertia, Joint, Link
from ccpin.description.model import frame, rotation_to
from ccpin.kinematics.points import joint_poses
from tests.support.backends import same_on_both

X, Y, Z = np.eye(3)


def platform():
    """Gough's platform with balls at both ends of its six legs: each leg's cylinder and piston spin together."""
    height = 0.45 * Z
    base = [0.40 * np.array([np.cos(a), np.sin(a), 0.0]) for a in np.radians((-15, 15, 105, 135, 225, 255))]
    top = [0.25 * np.array([np.cos(a), np.sin(a), 0.0]) for a in np.radians((-45, 45, 75, 165, 195, 285))]
    links = [Link("base"), Link("plate", Inertia(5.0, np.zeros(3), np.diag([0.05, 0.05, 0.1])))]
    joints, closures = [Joint("root", "floating", "base", "plate", frame(height))], []
    for k, (foot, head) in enumerate(zip(base, top, strict=True)):
        leg = height + head - foot
        length = float(np.linalg.norm(leg))
        links.append(Link(f"cylinder{k}", Inertia(1.0, 0.1 * Z, np.diag([0.01, 0.01, 0.0005]))))
        links.append(Link(f"piston{k}", Inertia(0.5, -0.1 * Z, np.diag([0.005, 0.005, 0.0001]))))
        turned = frame(foot, rotation_to(leg / length))
        joints.append(Joint(f"ball{k}", "spherical", "base", f"cylinder{k}", turned))
        joints.append(Joint(f"leg{k}", "prismatic", f"cylinder{k}", f"piston{k}", frame(length * Z), Z))
        closures.append(ccpin.LoopClosure(f"top{k}", "spherical", f"piston{k}", "plate", np.eye(4), frame(head)))
    legs = tuple(f"leg{k}" for k in range(6))
    return ccpin.MechanismDescription("sps", "base", tuple(links), tuple(joints), tuple(closures), actuated=legs)


@same_on_both
def test_bodies_that_a_slide_joins_spin_together():
    """6-SPS: twelve mobilities, six of them spins of a whole leg; locked, it is Gough's platform with n = 6."""
    mechanism = ccpin.load(platform())
    assert mechanism.locked == tuple(f"ball{k}:rz" for k in range(6))
    assert mechanism.independent == mechanism.actuated == tuple(f"leg{k}" for k in range(6))
    free = ccpin.load(platform(), free=["all"])
    assert (mechanism.n, free.n, len(free.mobility.idle)) == (6, 12, 6)
    assert free.mobility.idle[0].startswith("'cylinder0' with 'piston0' can spin about its axis")
    assert ccpin.domain.kantorovich_radius(mechanism, mechanism.q_reference) > 1e-3


def test_the_plate_stands_the_same_with_legs_locked_or_free():
    """σ of the legs' lengths: the plate's pose does not know of the spins."""
    lengths = 0.02 * np.array([1.0, -0.5, 0.3, 0.8, -1.0, 0.2])
    plates = []
    for arguments in (
        {},
        {"free": ["all"], "independent": [*(f"leg{k}" for k in range(6)), *(f"ball{k}:rz" for k in range(6))]},
    ):
        mechanism = ccpin.load(platform(), **arguments)
        model = ccpin.ReducedModel(mechanism)
        q = model.alpha(mechanism.q_reference)
        q[:6] += lengths
        poses = joint_poses(model.free_system.scratch, model.sigma(q))
        plates.append(poses[mechanism.tree.joint("root").number])
    np.testing.assert_allclose(plates[0], plates[1], rtol=0, atol=1e-11)


def rssr(order):
    """A linkage whose ball on the crank is three revolute joints, as URDF has it, about axes in an order."""
    rod = Inertia(0.3, 0.25 * Z, np.diag([0.006, 0.006, 5e-6]))
    crank_end, rocker_end = np.array([0.1, 0.0, 0.0]), np.array([0.4, 0.25, 0.3])
    leg = rocker_end - crank_end
    length = float(np.linalg.norm(leg))
    body = Inertia(0.5, np.array([0.02, 0.0, 0.02]), 1e-3 * np.eye(3))
    links = (Link("base"), Link("crank", body), Link("first"), Link("second"), Link("rod", rod), Link("rocker", body))
    axes = {"x": X, "y": Y, "z": Z}
    chain = ("crank", "first", "second", "rod")
    place = frame(crank_end, rotation_to(leg / length))
    joints = (
        Joint("motor", "revolute", "base", "crank", axis=Z),
        *(
            Joint(f"ball_{axis}", "revolute", chain[k], chain[k + 1], place if k == 0 else np.eye(4), axes[axis])
            for k, axis in enumerate(order)
        ),
        Joint("pivot", "revolute", "base", "rocker", frame([0.4, 0.25, 0.0]), Y),
    )
    tip = ccpin.LoopClosure("tip", "spherical", "rod", "rocker", frame(length * Z), frame(0.3 * Z))
    return ccpin.MechanismDescription("rssr", "base", links, joints, (tip,), actuated=("motor",))


@pytest.mark.parametrize("order", ["xyz", "zyx", "yzx"])
def test_a_ball_of_three_hinges_is_locked_at_the_one_along_the_rod(order):
    """That joint is fixed and leaves a universal joint; the motion of crank and rocker is that of the free linkage."""
    mechanism = ccpin.load(rssr(order))
    assert (mechanism.n, mechanism.locked, mechanism.independent) == (1, ("ball_z",), ("motor",))
    free = ccpin.ReducedModel(ccpin.load(rssr(order), independent=["motor", "ball_z"]))
    model = ccpin.ReducedModel(mechanism)
    for theta in (-0.4, 0.0, 0.7):
        mine, theirs = model.at([theta]), free.at([theta, 0.0])
        eliminated = theirs.D[0, 0] - theirs.D[0, 1] ** 2 / theirs.D[1, 1]
        assert mine.D[0, 0] == pytest.approx(eliminated, rel=1e-9)
        pivot = [m.mechanism.tree.joint("pivot").q for m in (model, free)]
        assert mine.q_free[pivot[0]] == pytest.approx(theirs.q_free[pivot[1]], abs=1e-11)


def test_a_coupler_that_swings_a_rocker_is_not_idle():
    """Nothing of the five-bar or the four-bar is."""
    for name in ("rpdr", "four_bar", "stewart", "hexa"):
        assert ccpin.load(name).locked == ()
