"""Mechanisms' own MJCF files in MuJoCo beside the reduced model: tight loops stay closed and move as ours do."""

import math
import sys
from dataclasses import replace

import numpy as np
import pytest

import ccpin
from benchmarks import round_trips
from ccpin.cli import main
from ccpin.description.model import SolverWords
from ccpin.errors import CcpinError, InvalidInputError
from ccpin.simulation import run_in_mujoco
from tests.support.grown import grown
from tests.support.places import MODELS, SHARED

pytest.importorskip("mujoco")

GAP, OFF = 5e-5, math.radians(0.02)  # m and rad, of tight files in a second


def both(mechanism, folder, **options):
    """The run of a mechanism's file as stated, and tight."""
    runs = []
    for loops in ("as_stated", "tight"):
        mechanism.save(folder / f"{loops}.xml", loops=loops)
        runs.append(run_in_mujoco(mechanism, folder / f"{loops}.xml", **options))
    return runs


@pytest.mark.parametrize("name", ["rpdr", "slider_crank", "bennett"])
def test_tight_files_move_as_the_mechanism(name, tmp_path):
    """Gap and joints' difference within a second, which are larger by far as MuJoCo comes."""
    soft, tight = both(ccpin.load(name), tmp_path)
    assert tight.gap <= GAP
    assert tight.turned <= OFF
    assert tight.slid <= GAP
    assert tight.seconds == soft.seconds == pytest.approx(1.0)
    assert soft.gap > 100.0 * tight.gap
    assert soft.turned > 100.0 * tight.turned


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(path.stem for path in MODELS.glob("*.urdf")))
def test_tight_files_of_every_model(name, tmp_path):
    """Likewise; Sarrus' linkage for as long as it is not folded flat."""
    soft, tight = both(ccpin.load(name), tmp_path)
    assert tight.gap <= GAP < 1.0 > soft.gap
    assert tight.turned <= OFF
    assert tight.seconds >= 0.8


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["four_bar.urdf", "5bar_linkage_iso3d", "cassie_like", "cassie_closed_chain.xml", "neck.xml"]
)
def test_tight_files_of_others(name, tmp_path):
    """Likewise, dry friction, floating bases and rods that spin freely included."""
    if not (SHARED / name).exists():
        pytest.skip(f"no {SHARED / name}: these files belong to others")
    _, tight = both(ccpin.load(SHARED / name), tmp_path)
    assert tight.gap <= GAP
    assert tight.turned <= OFF


@pytest.mark.slow
def test_what_is_left_of_a_motion_near_singular_postures_is_the_step(tmp_path):
    """The two legs come within 4e-6 of a singular posture: of second order, and small where the file's step is."""
    if not (SHARED / "digit_like").exists():
        pytest.skip(f"no {SHARED / 'digit_like'}: these files belong to others")
    plain, off = ccpin.load(SHARED / "digit_like"), []
    for step in (1e-3, 5e-4, 1e-4):
        told = replace(plain.settled(), solver=SolverWords({"timestep": str(step)}))
        found = ccpin.load(told, independent=plain.independent, actuated=plain.actuated)
        _, tight = both(found, tmp_path)
        off.append(tight.turned)
    assert off[0] > 3.0 * off[1] > 9.0 * off[2]
    assert off[2] <= OFF


@pytest.mark.slow
def test_a_locked_spin_of_a_rod_that_is_not_round_is_what_differs(tmp_path):
    """Locked, its rod moves as on a universal joint, which MuJoCo's does not; left free, both move alike."""
    locked, free = (ccpin.load(grown(38), free=names) for names in ((), ("all",)))
    assert locked.locked
    assert any("not symmetric" in note for note in locked.notes)
    assert both(locked, tmp_path)[1].turned > 10.0 * OFF
    assert both(free, tmp_path)[1].turned <= OFF


def test_a_rod_and_a_gear_are_held_too(tmp_path):
    """A distance closure is a tendon, of which the gap is the length's; u is what a motor gets before its gear."""
    plain = ccpin.load("four_bar").settled()
    (loop,) = plain.closures
    apart = replace(loop, kind="distance", length=0.25, placement_b=loop.placement_b @ moved(0.25))
    both_driven = {"actuated": ("crank", "rocker"), "motors": (), "independent": ("crank", "rocker")}
    rod = replace(plain, closures=(apart,), gravity=(0.0, 0.0, 0.0), **both_driven)
    soft, tight = both(ccpin.load(rod, motors={"crank": {"gear": 5.0}}), tmp_path, duration=0.3)
    assert tight.gap <= GAP
    assert tight.turned <= OFF
    assert soft.gap > 10.0 * tight.gap
    _, direct = both(ccpin.load(rod), tmp_path, duration=0.02)
    np.testing.assert_allclose(tight.u * [5.0, 1.0], direct.u, rtol=1e-9)


def test_a_run_that_explodes_says_so(tmp_path):
    """MuJoCo sets itself back then; what is told ends where that was, and no number after it counts."""
    rpdr, file = ccpin.load("rpdr"), tmp_path / "robot.xml"
    rpdr.save(file)
    text = (
        file.read_text()
        .replace("<option ", '<option timestep="0.05" ')
        .replace("<connect ", '<connect solref="-1e9 -1" ')
    )
    file.write_text(text)
    run = run_in_mujoco(rpdr, file, duration=5.0)
    assert run.seconds < 5.0
    assert math.isinf(run.gap)
    assert math.isinf(run.turned)
    assert str(run).startswith("MuJoCo becomes unstable after ")


def moved(distance):
    """A step along x."""
    step = np.eye(4)
    step[0, 3] = distance
    return step


def test_what_does_not_fit_is_refused(tmp_path, monkeypatch):
    """A file of nobody's, of another mechanism, that MuJoCo refuses; u of another size; MuJoCo's absence."""
    rpdr, file = ccpin.load("rpdr"), tmp_path / "robot.xml"
    rpdr.save(file)
    with pytest.raises(InvalidInputError, match="the file's motors are on joint1, joint2, not on crank"):
        run_in_mujoco(ccpin.load("four_bar"), file)
    with pytest.raises(InvalidInputError, match="u has shape"):
        run_in_mujoco(rpdr, file, u=[1.0])
    with pytest.raises(InvalidInputError, match="duration"):
        run_in_mujoco(rpdr, file, duration=0.0)
    text = file.read_text()
    file.write_text(text.replace('<key name="reference"', '<key name="other"'))
    with pytest.raises(InvalidInputError, match="no keyframe 'reference'"):
        run_in_mujoco(rpdr, file)
    file.write_text(text.replace('"joint3"', '"joint_three"'))
    with pytest.raises(InvalidInputError, match="the file has no joint 'joint3'"):
        run_in_mujoco(rpdr, file)
    file.write_text(text.replace("<equality>", "<equal>"))
    with pytest.raises(CcpinError, match="MuJoCo refuses"):
        run_in_mujoco(rpdr, file)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(CcpinError, match=r"pip install 'ccpin\[mujoco\]'"):
        run_in_mujoco(rpdr, file)


def test_the_command_converts_and_runs(tmp_path, capsys):
    """`--loops tight --check` says how far, in words and numbers; other formats have nothing to run."""
    file = str(tmp_path / "rpdr.xml")
    assert main(["convert", "rpdr", "--out", file, "--loops", "tight", "--check"]) == 0
    said = capsys.readouterr().out
    assert "in MuJoCo, u held: loops open by" in said
    assert "softly" not in said
    assert main(["convert", "rpdr", "--out", file]) == 0
    assert "MuJoCo holds loops softly, by its own solref and solimp" in capsys.readouterr().out
    assert main(["convert", "rpdr", "--out", str(tmp_path / "rpdr.sdf"), "--check"]) != 0
    assert "--check runs the file in MuJoCo, which wants MJCF" in capsys.readouterr().err


def test_the_table_of_runs():
    """A row a mechanism, both ways, and how long; what MJCF cannot have is left to the other table."""
    rpdr = ccpin.load("rpdr")
    found = list(round_trips.runs([("rpdr", rpdr)], duration=0.05))
    refused = round_trips.Run("none", "tight", "MJCF has no such thing")
    head, _, row = round_trips.in_mujoco([*found, refused]).splitlines()
    assert head == "|  | as_stated: gap, joints off | tight: gap, joints off | seconds |"
    assert row.startswith("| rpdr | ")
    assert row.endswith(" | 0.05 |")
