"""Assembly modes against the RPDR's closed form, which has exactly two."""

import numpy as np
import pytest

import ccpin
from ccpin.dynamics import assembly_modes
from ccpin.errors import InvalidInputError
from ccpin.kinematics.points import joint_poses
from ccpin.mechanism.poses.same_pose import Likeness
from tests.oracles import rpdr
from tests.support.walkthrough import file


def _by_number(model, q_free):
    pin_model = model.mechanism.pin_model
    return np.array([q_free[pin_model.idx_qs[pin_model.getJointId(f"joint{i}")]] for i in (1, 2, 3, 4)])


def test_the_rpdr_has_two_modes(model):
    """Away from singularities exactly the two closed-form configurations are found, one of them the reference's."""
    for q in np.radians([[-100.0, -80.0], [-150.0, -160.0], [-70.0, -110.0], [10.0, 40.0]]):
        found = assembly_modes(model, q)
        assert len(found.modes) == 2
        assert sum(mode.is_reference for mode in found.modes) <= 1
        assert {mode.sign for mode in found.modes} == {-1, 1}
        for mode in found.modes:
            q1, q2, q3, q4 = _by_number(model, mode.q_free)
            assert (q1, q2) == pytest.approx(q)
            assert np.abs(rpdr.phi((q1, q2, q3, q4))).max() < 1e-10
        shapes = [np.sin(np.dot(_by_number(model, mode.q_free), [1, -1, 1, -1])) for mode in found.modes]
        assert min(shapes) < 0 < max(shapes)


def test_no_mode_beyond_the_workspace(model):
    """Where the elbows are too far apart nothing is found."""
    found = assembly_modes(model, np.radians([180.0, 0.0]), patience=5)
    assert found.modes == ()
    assert found.complete
    assert found.reason == "evidence that q is out of reach, no proof; 0 of 25 starts closed"


def test_modes_are_deterministic(model):
    """Two searches give the same configurations, bit for bit."""
    first, second = (assembly_modes(model, [-1.7, -1.4]) for _ in range(2))
    assert all(np.array_equal(a.q_free, b.q_free) for a, b in zip(first.modes, second.modes, strict=True))


def test_flips_of_universal_joints_and_spins_are_one_mode():
    """Each rod of the ankle hangs on a universal joint (one is a locked ball): 16 configurations, 4 poses."""
    ankle = ccpin.ReducedModel(ccpin.load(file("ankle")))
    found = assembly_modes(ankle, ankle.alpha(ankle.mechanism.q_reference))
    assert (len(found.modes), found.complete) == (4, True)
    bodies = [ankle.mechanism.tree.joint(name).number for name in ("pitch", "roll", "left_motor", "right_motor")]
    poses = [joint_poses(ankle.free_system.scratch, mode.q_free)[bodies] for mode in found.modes]
    for k, one in enumerate(poses):
        assert all(np.abs(one - other).max() > 1e-2 for other in poses[:k])


def test_a_flip_is_alike_and_an_elbow_is_not():
    """θ → (θ₁ + π, π − θ₂) turns a universal joint's rod half round its line; the five-bar's two poses differ."""
    mechanism = ccpin.load(file("ankle"))
    swing, lean = (mechanism.tree.joint(name).q.start for name in ("right_swing", "right_lean"))
    q_free, likeness = mechanism.q_reference, Likeness(mechanism.tree, mechanism.constraints())
    flipped = q_free.copy()
    circle = flipped[swing : swing + 2]
    flipped[swing : swing + 2] = -circle
    flipped[lean : lean + 2] = [-q_free[lean], q_free[lean + 1]]
    assert np.abs(mechanism.constraints().residual(flipped)).max() < 1e-10
    assert likeness.alike(likeness.poses(q_free), likeness.poses(flipped))
    five_bar = ccpin.ReducedModel(ccpin.load("rpdr"))
    up, down = (mode.q_free for mode in assembly_modes(five_bar, [-1.7, -1.4]).modes)
    likeness = Likeness(five_bar.mechanism.tree, five_bar.mechanism.constraints())
    assert not likeness.alike(likeness.poses(up), likeness.poses(down))


def test_a_door_that_stands_elsewhere_is_not_alike():
    """A finger on one hinge turned about it is another pose, though the hinge's own point stays."""
    mechanism = ccpin.load(file("gripper"))
    model, likeness = ccpin.ReducedModel(mechanism), Likeness(mechanism.tree, mechanism.constraints())
    poses = [likeness.poses(model.sigma([angle])) for angle in (0.1, 0.1 + 1e-9, 0.4)]
    assert likeness.alike(poses[0], poses[1])
    assert not likeness.alike(poses[0], poses[2])


@pytest.mark.slow
def test_the_stewart_platform_has_few_poses():
    """Its legs' universal joints flip in 2⁶ ways, and none of that counts: at most 40 poses, and not alike pairwise."""
    stewart = ccpin.ReducedModel(ccpin.load("stewart"))
    found = assembly_modes(stewart, stewart.alpha(stewart.mechanism.q_reference), limit=400)
    likeness = Likeness(stewart.mechanism.tree, stewart.mechanism.constraints())
    poses = [likeness.poses(mode.q_free) for mode in found.modes]
    assert 2 <= len(poses) <= 40
    assert not any(likeness.alike(a, b) for k, a in enumerate(poses) for b in poses[:k])


def test_a_search_that_is_cut_short_says_so(model):
    """Starts, seconds and Ctrl-C end it with what was found; `complete` and `reason` tell."""
    q = [-1.7, -1.4]
    few = assembly_modes(model, q, limit=5)
    assert (few.complete, few.starts) == (False, 5)
    assert "limit of 5 starts" in few.reason
    late = assembly_modes(model, q, budget=1e-9)
    assert (late.complete, late.starts) == (False, 1)
    assert "budget" in late.reason

    def stop(search):
        if search.starts == 7:
            raise KeyboardInterrupt

    stopped = assembly_modes(model, q, progress=stop)
    assert (stopped.complete, stopped.starts, len(stopped.modes)) == (False, 7, 2)
    assert stopped.reason.startswith("interrupted, so modes may be missing")


def test_progress_counts_to_the_end(model):
    """Reports come after every start, and the last one's quiet starts are the patience."""
    seen = []
    found = assembly_modes(model, [-1.7, -1.4], patience=10, progress=seen.append)
    assert [search.starts for search in seen] == list(range(1, found.starts + 1))
    assert (seen[-1].quiet, seen[-1].patience, seen[-1].modes) == (10, 10, 2)
    assert "evidence that there are no more, no proof" in found.reason
    assert sum(mode.hits for mode in found.modes) + found.singular <= found.starts


def test_modes_beyond_the_limits_are_told(model):
    """`within_limits` says whether the file's joint limits hold."""
    leg = ccpin.ReducedModel(ccpin.load(file("gas_spring_leg")))
    found = assembly_modes(leg, leg.alpha(leg.mechanism.q_reference))
    assert [mode.within_limits for mode in found.modes] == [True, False]  # the piston out of the cylinder's other end


@pytest.mark.parametrize("wrong", [{"patience": 0}, {"limit": 0}, {"budget": -1.0}])
def test_limits_must_be_positive(model, wrong):
    """A search of no starts is none."""
    with pytest.raises(InvalidInputError, match="must be a"):
        assembly_modes(model, [-1.7, -1.4], **wrong)
