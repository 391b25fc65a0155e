"""`ccpin convert --serial`: what it writes and says, and what it refuses, by name."""

import json
from pathlib import Path

import numpy as np
import pytest

from ccpin.cli import main
from ccpin.description import read_description
from ccpin.programs import Program
from tests.support.linkage_models import FORMS
from tests.support.places import ROOT, SHARED

ANKLE = str(ROOT / "docs" / "howto" / "ankle.urdf")


def test_a_knee(capsys, tmp_path):
    """The file loads as one joint without loops; maps lie beside it; JSON says the same as words."""
    knee, out = tmp_path / "knee.urdf", tmp_path / "serial.urdf"
    assert main(["new", "knee", "--out", str(knee)]) == 0
    capsys.readouterr()
    given = ["convert", str(knee), "--serial", "--rotor", "0.1", "--within", "-0.6", "0.6", "--prove", "64"]
    assert main([*given, "--precision", "float", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert said.startswith("knee as a serial robot of knee; driven through motor\n")
    assert said.count("(proved)") == 3
    assert "note: few read a rotor inertia from URDF: state armature to the simulator: knee 0.0" in said
    description = read_description(out)
    assert [joint.name for joint in description.joints if joint.kind != "fixed"] == ["knee"]
    assert not description.closures
    written = {f"knee_to_{side}{end}" for side in ("motors", "joints") for end in (".h", "_test.c", ".json")}
    assert {path.name for path in (tmp_path / "serial_maps").iterdir()} == written
    assert "float q[1]" in (tmp_path / "serial_maps" / "knee_to_motors.h").read_text(encoding="utf-8")
    program = Program.load(tmp_path / "serial_maps" / "knee_to_motors.json")
    q = program.example[:1]
    answer = program(q=q, y=program.example[1:3], v=[1.0], u=[0.0])
    np.testing.assert_allclose(answer["v_motors"], FORMS["knee"].jacobian(np.array(q))[0], rtol=0, atol=1e-9)
    assert main([*given, "--json", "--out", str(out)]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["joints"] == ["knee"]
    assert told["effort_proved"]
    assert told["errors_and_speed_proved"]
    assert f"D by {100 * told['errors']['share']:.3g} %" in said
    assert len(told["maps"]) == 6
    assert all(Path(each).exists() for each in told["maps"])


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["--joints", "pich", "roll"], "did you mean 'pitch'?"),
        (["--motors", "left_motor", "right_moter"], "did you mean 'right_motor'?"),
        (["--joints", "pitch"], "2 motions has 2 joints; evident or named: pitch. name 2 by joints="),
        (
            ["--joints", "pitch", "right_swing"],
            "'right_swing' is carried by 'right_motor', which is none of the serial",
        ),
        (["--floating-base"], "'root_joint' is a motion of 6 freedoms: a transmission stands on a fixed base"),
        (["--within", "1", "2"], "--within takes 4 numbers, of pitch, roll"),
        (["--within", "-0.9", "-0.5", "0.9", "0.5"], "region: 4 of its 169 postures are not reached"),
        (["--at", "0"], "at has shape (1,); it must be (2,)"),
        (["--effort", "1", "2", "3"], "effort"),
        (["--rotor", "1", "2", "3"], "--rotor takes one number, or 2"),
        (["--check"], "--check and --loops are about loops: a serial robot has none"),
        (["--to", "toolbox"], "a serial robot is written as one of urdf, sdf, mjcf"),
    ],
)
def test_what_it_refuses(given, said, capsys, tmp_path):
    """One line that names what is wrong, and nothing is written."""
    out = tmp_path / "out.urdf"
    assert main(["convert", ANKLE, "--serial", *given, "--out", str(out)]) == 1
    assert said in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_joints_that_are_not_the_robots(capsys, tmp_path):
    """A foot that is no longer carried is told among what is left out, and by how much that is amiss."""
    given = ["--joints", "pitch", "left_motor", "--within", "-0.1", "-0.1", "0.1", "0.1"]
    assert main(["convert", ANKLE, "--serial", *given, "--out", str(tmp_path / "out.urdf")]) == 0
    said = capsys.readouterr().out
    assert "left out: foot, right_crank, left_rod, right_knuckle, right_rod\n" in said
    assert " %: constant numbers do not say this linkage: narrow the range, or name other joints\n" in said


def test_its_options_alone(capsys, tmp_path):
    """They say nothing without --serial."""
    assert main(["convert", ANKLE, "--prove", "--rotor", "0.02", "--out", str(tmp_path / "x.urdf")]) == 1
    assert "--rotor, --prove: about a serial robot; give --serial too" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.skipif(not SHARED.is_dir(), reason="other people's files are not here")
@pytest.mark.parametrize(
    ("model", "joints", "carried"),
    [
        ("digit_like", "motor_hip_x motor_hip_y motor_hip_z motor_knee free_foot1 free_foot2", "'free_foot1'"),
        ("cassie_like", "motor_hip1 motor_hip2 motor_tigh motor_knee free_ankle", "'free_ankle'"),
    ],
)
def test_a_passive_joint_in_the_leg_is_named(model, joints, carried, capsys, tmp_path):
    """Of these legs a joint between motors is led by a loop alone: no open chain stands for them."""
    given = ["convert", str(SHARED / model / "robot.yaml"), "--serial", "--joints", *joints.split()]
    assert main([*given, "--out", str(tmp_path / "leg.urdf")]) == 1
    said = capsys.readouterr().err
    assert f"{carried} is carried by 'free_knee'" in said
    assert "without loop closedloop" in said
