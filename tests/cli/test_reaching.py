"""A refused goal is told to be out of reach, or behind a singularity; who is right is the five-bar's closed form."""

import json
import shlex

import numpy as np
import pytest

import ccpin
from ccpin.cli import main
from ccpin.errors import UnreachableError
from tests.oracles import rpdr
from tests.support.places import MODELS

GOALS = {"behind": (0.0, -180.0), "outside": (86.0, -86.0)}  # degrees
SET_POINT = ("--kp", "1", "--kv", "1")


def closes(degrees):
    """Whether the elbows are no further apart than the forearms are long."""
    return np.hypot(*rpdr.elbow_offset(np.radians(degrees))) < rpdr.A3 + rpdr.A4


def refused(capsys, *words):
    """The sentence with which a command ends, and the command that it names."""
    assert main([*words, "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["error"] == "UnreachableError"
    return told["message"], shlex.split(told["message"].split("`")[1])


def test_a_goal_behind_a_singularity_is_not_out_of_reach(capsys):
    """It closes in both modes, is told in degrees, and the command named finds them."""
    assert closes(GOALS["behind"])
    told, named = refused(capsys, "simulate", "rpdr", "--goal-deg", "0", "-180", *SET_POINT)
    assert "close over q in at least 2 ways" in told
    assert "q = 0 -180 (degrees)" in told
    assert "it is not out of reach. Go round" in told
    assert "near=" not in told
    assert named == ["ccpin", "modes", "rpdr", "--q-deg", "0", "-180"]
    assert main(named[1:]) == 0
    assert capsys.readouterr().out.startswith("2 assembly modes found")


def test_where_nothing_closes_it_is_probably_out_of_reach(capsys):
    """Nor does the command named find anything; the reached place is that of the library's error."""
    assert not closes(GOALS["outside"])
    told, named = refused(capsys, "simulate", "rpdr", "--goal-deg", "86", "-86", *SET_POINT)
    assert "No closed configuration was found over q" in told
    assert "probably out of reach" in told
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    with pytest.raises(UnreachableError) as library:
        model.sigma(np.radians(GOALS["outside"]))
    assert " ".join(f"{value:.6g}" for value in np.degrees(library.value.q_reached)) in told
    assert f"{100 * library.value.fraction:.2f} %" in told
    assert main([*named[1:], "--limit", "30"]) == 0
    assert capsys.readouterr().out.startswith("no closed configuration found: ")


def test_radians_and_the_mechanisms_options_are_kept(capsys, tmp_path):
    """The unit is that of the options, and the command named has what makes the mechanism this one."""
    path = tmp_path / "my robot.urdf"
    path.write_bytes((MODELS / "rpdr.urdf").read_bytes())
    options = ["--independent", "joint2", "joint1", "--format", "urdf"]
    told, named = refused(capsys, "simulate", str(path), "--goal", "-1.5", "1.5", *SET_POINT, *options)
    assert "q = -1.5 1.5 (rad or m)" in told
    assert named == ["ccpin", "modes", str(path), *options, "--q", "-1.5", "1.5"]
    assert main([*named[1:], "--limit", "5"]) == 0


def test_a_centre_that_is_not_reached_is_explained(capsys):
    """`ccpin domain` says the same."""
    told, _ = refused(capsys, "domain", "rpdr", "--centre-deg", "0", "-180")
    assert "close over q in at least 2 ways" in told


def test_a_goal_that_is_singular_itself_is_told(capsys):
    """Mirrored arms with the forearms in line, C − 2 A₁ cos q₁ = A₃ + A₄, and a whole turn away."""
    stretched = np.degrees(np.arccos((rpdr.C - rpdr.A3 - rpdr.A4) / (2.0 * rpdr.A1)))
    goal = [str(stretched), str(180.0 - stretched - 360.0)]
    told, _ = refused(capsys, "simulate", "rpdr", "--goal-deg", *goal, *SET_POINT)
    assert "Only singular configurations were found over q" in told
