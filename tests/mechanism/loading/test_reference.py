"""The assembly mode is the user's choice: a stated pose, in part or by name, and what the notes say of it."""

import numpy as np
import pytest

import ccpin
from ccpin.cli import main
from ccpin.errors import InvalidInputError
from tests.oracles import rpdr as oracle
from tests.support.places import MODELS

BODY = '<inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01"/></inertial>'


def mode(mechanism):
    """The sign of sin(q1 + q3 − q2 − q4) at the reference: which of the RPDR's two modes."""
    q = [float(mechanism.q_reference[mechanism.tree.joint(name).q][0]) for name in oracle.FREE]
    return np.sign(np.sin(oracle.fold(q)))


def test_a_partial_pose_chooses_the_mode():
    """With the elbows bent the other way the loops close in the other mode; q stays where it was asked for."""
    before = ccpin.load("rpdr")
    q = before.parametrization().coordinates.alpha(before.q_reference)
    (other,) = (
        x for x in (oracle.sigma(q, sign) for sign in (1, -1)) if np.sign(np.sin(oracle.fold(x))) != mode(before)
    )
    after = ccpin.load("rpdr", reference={"joint3": other[2], "joint4": other[3]})
    assert mode(after) == -mode(before)
    np.testing.assert_allclose(after.parametrization().coordinates.alpha(after.q_reference), q, atol=1e-6)
    assert not [note for note in after.notes if "moved" in note]


def test_the_command_line_takes_it_too(capsys):
    """As joint=value, or as a name; what is neither is told."""
    assert main(["info", "rpdr", "--reference", "joint3=1.0", "joint4=-1.0"]) == 0
    capsys.readouterr()
    assert main(["info", "rpdr", "--reference", "joint3"]) == 1
    assert "'joint3' is no pose of the file" in capsys.readouterr().err
    assert main(["info", "rpdr", "--reference", "joint3=1", "joint4=x"]) == 1
    assert "'joint4=x' is not joint=value" in capsys.readouterr().err


def with_states(*states):
    """The four-bar's file with group_states instead of its own."""
    text = (MODELS / "four_bar.urdf").read_text(encoding="utf-8")
    start, end = text.index("<group_state"), text.index("</group_state>") + len("</group_state>")
    return text[:start] + "".join(states) + text[end:]


def test_poses_of_the_file_by_name(tmp_path):
    """Each group_state is a pose to start from; joints the file has not are left out of it."""
    before = ccpin.load("four_bar")
    crank = before.tree.joint("crank")
    pose = {joint.name: float(before.q_reference[joint.q][0]) for joint in before.tree.joints}
    joints = "".join(f'<joint name="{name}" value="{value}"/>' for name, value in pose.items())
    file = tmp_path / "posed.urdf"
    file.write_text(with_states(f'<group_state name="home">{joints}<joint name="other" value="1"/></group_state>'))
    assert set(ccpin.load(file).description.poses) == {"home"}
    home = ccpin.load(file, reference="home")
    np.testing.assert_allclose(home.q_reference, before.q_reference, atol=1e-9)
    assert crank.name in home.description.reference
    with pytest.raises(InvalidInputError, match="'hoem' is no pose of the file"):
        ccpin.load(file, reference="hoem")


def test_a_pose_that_has_to_move_says_by_how_much():
    """The joint that moved most comes first, in degrees."""
    before = ccpin.load("four_bar")
    pose = {joint.name: float(before.q_reference[joint.q][0]) for joint in before.tree.joints}
    last = list(pose)[-1]
    after = ccpin.load("four_bar", reference=pose | {last: pose[last] + 0.2})
    (note,) = (note for note in after.notes if "was moved to close" in note)
    moved = after.q_reference - np.array([pose[joint.name] + 0.2 * (joint.name == last) for joint in after.tree.joints])
    assert f"{np.degrees(np.abs(moved).max()):.3g}°" in note
    assert np.abs(moved).max() < 0.21


@pytest.mark.parametrize(
    ("reference", "message"),
    [
        ({"krank": 0.1}, "'krank' is no movable joint; .*crank"),
        ({"crank": "up"}, "must be finite numbers"),
        ({"crank": np.nan}, "must be finite numbers"),
        (0.3, "the name of a pose or a mapping"),
    ],
)
def test_wrong_poses(reference, message):
    """Each is told by name."""
    with pytest.raises(InvalidInputError, match=message):
        ccpin.load("four_bar", reference=reference)
