"""Three revolutes as the ball joint that they are: the same mechanism, and its configurations told in their angles."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import ccpin
from ccpin.description.model import Inertia
from ccpin.mechanism.other_coordinates.concurrent_revolutes import balls_of
from tests.support.backends import same_on_both
from tests.support.gimbal import TRIPLE, link_pose, stewart
from tests.support.places import MODELS

DESCRIBED = ccpin.load("stewart").description


def changed(name, **values):
    """The platform with a joint stated otherwise."""
    joints = tuple(replace(one, **values) if one.name == name else one for one in DESCRIBED.joints)
    return replace(DESCRIBED, joints=joints)


def turned(angle, axis):
    """A 4×4 frame."""
    frame = np.eye(4)
    frame[:3, :3] = pin.exp3(angle * np.asarray(axis, dtype=float))
    return frame


def shifted(*offset):
    """A 4×4 frame."""
    frame = np.eye(4)
    frame[:3, 3] = offset
    return frame


def between(change, name="platform_roll"):
    """The platform with the frame of one of the three changed; loops close as load finds them."""
    joints = {joint.name: joint for joint in DESCRIBED.joints}
    described = changed(name, placement=joints[name].placement @ change)
    return ccpin.load(described)


def random_places(count, seed=0):
    """Configurations of the open tree."""
    rng, model = np.random.default_rng(seed), stewart().mechanism.pin_model
    for _ in range(count):
        yield pin.integrate(model, stewart().mechanism.q_reference, rng.uniform(-3, 3, model.nv)), rng


def test_the_platform_has_one_ball():
    """Leg 1's three revolutes at the platform; the same freedom, loops, motors and independent joints."""
    home = stewart().mechanism
    balls = balls_of(home)
    assert balls.names == (" ".join(TRIPLE),)
    assert (balls.mechanism.n, balls.mechanism.n_free) == (home.n, home.n_free)
    assert (balls.mechanism.independent, balls.mechanism.actuated) == (home.independent, home.actuated)
    found = ccpin.load(balls.mechanism.description, independent=home.independent).mobility
    assert balls.mechanism.mobility == found


@same_on_both
def test_every_link_is_where_it_was():
    """At 60 configurations of the open tree, by Pinocchio's kinematics of both trees: poses and velocities."""
    home, balls = stewart().mechanism, balls_of(stewart().mechanism)
    base = balls.mechanism
    for q_free, rng in random_places(60):
        rates = rng.normal(size=(home.n_free, 2))
        gathered = balls.gathered(q_free)
        for link in set(base.tree.attachments) & set(home.tree.attachments):
            np.testing.assert_allclose(
                link_pose(base, gathered, link), link_pose(home, q_free, link), rtol=0, atol=1e-12
            )
        moved = balls.gathered_rate(q_free, rates)
        np.testing.assert_allclose(moved[:, 0], balls.gathered_rate(q_free, rates[:, 0]), rtol=0, atol=1e-12)
        step = 1e-6
        ahead, behind = (balls.gathered(pin.integrate(home.pin_model, q_free, h * rates[:, 1])) for h in (step, -step))
        slope = pin.difference(base.pin_model, behind, ahead) / (2 * step)
        np.testing.assert_allclose(moved[:, 1], slope, rtol=0, atol=1e-7)
        np.testing.assert_allclose(balls.told_rate(q_free, moved), rates, rtol=0, atol=1e-6)


@same_on_both
def test_angles_are_told_nearest_to_those_before():
    """Told near itself a configuration is itself, whole turns and the other triple of angles (β → −β) included."""
    home, balls = stewart().mechanism, balls_of(stewart().mechanism)
    windows = [home.tree.joint(name).q for name in TRIPLE]
    for q_free, rng in random_places(60):
        for turns in (0, 1, -3):
            own = q_free.copy()
            for window in windows:
                own[window] += 2 * np.pi * turns
            near = own + 1e-3 * rng.normal(size=len(own)) * (home.pin_model.nq == home.pin_model.nv)
            np.testing.assert_allclose(balls.told(balls.gathered(own), near), own, rtol=0, atol=1e-9)
        far = q_free.copy()
        for window in windows:
            far[window] += rng.uniform(-9, 9)
        told = balls.told(balls.gathered(q_free), far)
        np.testing.assert_allclose(
            link_pose(home, told, "platform"), link_pose(home, q_free, "platform"), rtol=0, atol=1e-9
        )


def test_in_gimbal_lock_the_first_angle_stays():
    """Where the outer axes come together their sum counts alone: θa is as it was, and rates are the least."""
    home, balls = stewart().mechanism, balls_of(stewart().mechanism)
    q_free = np.array(home.q_reference)
    pitch, roll, yaw = (home.tree.joint(name).q.start for name in TRIPLE)
    q_free[[pitch, yaw]] = 0.4, -0.7
    poses = []
    for middle in np.linspace(0, np.pi, 181):
        q_free[roll] = middle
        triple = [link_pose(home, q_free, "platform")[:3, :3]]
        q_free[[pitch, yaw]] += 0.2, 0.2
        triple.append(link_pose(home, q_free, "platform")[:3, :3])
        q_free[[pitch, yaw]] += 0.0, -0.4
        triple.append(link_pose(home, q_free, "platform")[:3, :3])
        q_free[[pitch, yaw]] = 0.4, -0.7
        poses.append(min(np.abs(triple[0] - triple[1]).max(), np.abs(triple[0] - triple[2]).max()))
    at = int(np.argmin(poses))
    assert poses[at] < 1e-9  # the lock is at a whole degree
    q_free[roll] = np.radians(at)
    before = q_free.copy()
    before[pitch] = 0.3
    told = balls.told(balls.gathered(q_free), before)
    assert told[pitch] == 0.3
    np.testing.assert_allclose(
        link_pose(home, told, "platform"), link_pose(home, q_free, "platform"), rtol=0, atol=1e-8
    )
    rates = balls.told_rate(q_free, np.eye(home.n_free))
    assert np.isfinite(rates).all()
    assert np.abs(rates).max() <= 1 + 1e-9


@pytest.mark.parametrize("name", TRIPLE)
@pytest.mark.parametrize("acting", [{"damping": 0.1}, {"friction": 0.1}, {"armature": 1e-4}])
def test_a_triple_on_which_something_acts_is_none(name, acting):
    """Its axis means something: damping, friction, a rotor's inertia."""
    assert balls_of(ccpin.load("stewart", joints={name: acting})) is None


@pytest.mark.parametrize("name", TRIPLE)
def test_a_triple_that_is_used_is_none(name):
    """As an independent or actuated joint, sprung, or where somebody names it or a link of it."""
    assert balls_of(ccpin.load("stewart", joints={name: {"stiffness": 1.0, "spring_reference": 0.0}})) is None
    assert balls_of(stewart().mechanism, used=[name]) is None
    assert balls_of(stewart().mechanism, used=["platform_roll_frame"]) is None
    assert balls_of(stewart().mechanism, used=["platform", "base"]) is not None
    names = tuple(stewart().mechanism.independent)
    assert balls_of(ccpin.load("stewart", actuated=(*names[1:], name))) is None
    assert balls_of(ccpin.load("stewart", independent=(*names[1:], name))) is None


def test_a_triple_with_mass_between_is_none():
    """A cross between the axes keeps the lock: there is something that turns."""
    cross = Inertia(1e-9, np.zeros(3), 1e-12 * np.eye(3))
    for link in ("platform_pitch_frame", "platform_roll_frame"):
        links = tuple(replace(one, inertia=cross) if one.name == link else one for one in DESCRIBED.links)
        assert balls_of(ccpin.load(replace(DESCRIBED, links=links))) is None


def test_axes_that_are_no_ball():
    """Not square, or not through one point: three joints, and not one; along one's own axis a frame may be anywhere."""
    assert balls_of(between(turned(0.02, [0, 0, 1]))) is None
    assert balls_of(between(turned(1e-9, [0, 0, 1]))) is None
    assert balls_of(between(shifted(0, 0, 1e-3))) is None
    assert balls_of(between(shifted(1e-3, 0, 0))) is None
    assert balls_of(between(shifted(0, 0, 1e-9))) is None
    assert balls_of(between(shifted(0, 0, 1e-3), "platform_yaw")) is not None


def test_models_without_triples_have_none():
    """Of the shipped models those have one whose spatial loops end in three revolutes."""
    found = {path.stem for path in MODELS.glob("*.urdf") if balls_of(ccpin.load(path)) is not None}
    assert found == {"delta", "hexa", "stewart"}
