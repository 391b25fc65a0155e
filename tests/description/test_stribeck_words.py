"""Breakaway levels and Stribeck speeds in descriptions: read, written, scaled, checked, or told as left out."""

import numpy as np
import pytest

import ccpin
from ccpin.description import read_description, scaled
from ccpin.description.formats import write_description
from ccpin.errors import DescriptionError, InvalidInputError

STATED = {"friction": 0.2, "breakaway": 0.3, "stribeck_speed": 0.05}
FIELDS = ("damping", "armature", *STATED)


@pytest.fixture(scope="module")
def rubbing():
    """A mechanism of which two joints have the effect: one driven, with a rotor, one not."""
    return ccpin.load("rpdr", joints={"joint1": STATED | {"armature": 0.01}, "joint3": STATED | {"friction": 0.0}})


@pytest.mark.parametrize("name", ["a.urdf", "robot.yaml"])
def test_urdf_keeps_them(rubbing, tmp_path, name):
    """As attributes of <dynamics>, also beside a robot.yaml; nothing is said to be left out."""
    told = write_description(rubbing.settled(), tmp_path / name)
    assert not [each for each in told if "breakaway" in each]
    again = {joint.name: joint for joint in read_description(tmp_path / name).joints}
    for joint in rubbing.description.joints:
        assert [getattr(again[joint.name], field) for field in FIELDS] == [getattr(joint, field) for field in FIELDS]


@pytest.mark.parametrize("suffix", [".sdf", ".xml"])
def test_formats_without_a_place_say_so(rubbing, tmp_path, suffix):
    told = write_description(rubbing.settled(), tmp_path / f"a{suffix}")
    assert any("no place for breakaway levels and Stribeck speeds: joint1, joint3" in each for each in told)
    plain = ccpin.load("rpdr", joints={"joint1": {"friction": 0.2, "breakaway": 0.2}})
    assert not [each for each in write_description(plain.settled(), tmp_path / f"b{suffix}") if "breakaway" in each]


def test_what_joints_state_is_where_it_is_asked_for(rubbing):
    """Levels of all joints, notes and digests; a joint that has breakaway alone rubs, too."""
    joints = rubbing.joints
    assert joints.breakaway[[joints.names.index(name) for name in ("joint1", "joint3")]].tolist() == [0.3, 0.3]
    assert joints.friction[joints.names.index("joint3")] == 0.0
    assert any("dry friction of joint1, joint3" in note for note in rubbing.notes)
    other = ccpin.load("rpdr", joints={"joint1": STATED | {"armature": 0.01}, "joint3": STATED})
    assert other.digests.plant != rubbing.digests.plant
    assert other.digests.dynamics == rubbing.digests.dynamics
    plain, same = (ccpin.load("rpdr", joints={"joint1": {"friction": 0.2} | more}) for more in ({}, {"breakaway": 0.2}))
    assert plain.digests.plant == same.digests.plant


def test_friction_is_scaled_with_its_breakaway(rubbing):
    twice = {joint.name: joint for joint in scaled(rubbing.settled(), friction=2.0).joints}
    assert [getattr(twice["joint1"], field) for field in STATED] == [0.4, 0.6, 0.05]
    assert twice["joint3"].breakaway == 0.6


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"breakaway": 0.1}, "breakaway 0.1 is below friction 0.2"),
        ({"breakaway": np.inf}, "too large"),
        ({"stribeck_speed": 0.0}, "needs a stribeck_speed"),
        ({"stribeck_speed": -1.0}, "stribeck_speed -1 is negative"),
    ],
)
def test_levels_that_no_joint_has_are_refused(change, words):
    with pytest.raises(DescriptionError, match=words):
        ccpin.load("rpdr", joints={"joint1": STATED | change})


def test_words_nearly_right_are_named(tmp_path):
    text = (tmp_path / "a.urdf", ccpin.load("rpdr", joints={"joint1": STATED}))
    write_description(text[1].settled(), text[0])
    text[0].write_text(text[0].read_text().replace("breakaway=", "breakawy="))
    with pytest.raises(DescriptionError, match="did you mean 'breakaway'"):
        read_description(text[0])
    with pytest.raises(InvalidInputError, match="stribeck_speed"):
        ccpin.load("rpdr", joints={"joint1": {"stribeck_sped": 1.0}})
