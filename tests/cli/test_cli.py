"""The command line: words and JSON, files written, errors with exit codes."""

import itertools
import json
import subprocess
import sys

import numpy as np
import pytest

import ccpin
from ccpin import plotting
from ccpin.cli import main
from ccpin.dynamics.assembly import _ModeFinder
from tests.support.paper import MOVE_OPTIONS
from tests.support.places import MODELS

STROKES = ("--start", *["0"] * 6, "--goal", *["0.01"] * 6)


def test_info_in_words(capsys):
    """What was loaded is told with its numbers."""
    assert main(["info", "rpdr"]) == 0
    text = capsys.readouterr().out
    for words in ("n′ = 4", "2 rows of rank 2", "mobility        n = n′ − rank = 2", "joint1, joint2", "end_effector"):
        assert words in text


def test_info_tells_forces(tmp_path, capsys):
    """Gears, springs, dampers and dry friction stand in the summary, joint by joint."""
    joints = {"rocker": {"stiffness": 2.5, "damping": 0.125, "friction": 0.5}}
    ccpin.load("four_bar", joints=joints, motors={"crank": {"gear": 20}}).save(tmp_path / "sprung.urdf")
    assert main(["info", str(tmp_path / "sprung.urdf")]) == 0
    said = capsys.readouterr().out
    for line in ("gears           crank 20", "springs         rocker 2.5", "dampers         rocker 0.125"):
        assert line in said
    assert "dry friction    rocker 0.5" in said


def test_info_as_json(capsys):
    """The same for machines, and consistent with the package."""
    assert main(["info", "rpdr", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    mechanism = ccpin.load("rpdr")
    assert (facts["n_free"], facts["constraint_rank"], facts["mobility"]) == (4, 2, 2)
    assert facts["independent"] == facts["actuated"] == ["joint1", "joint2"]
    assert facts["closure_error"] <= 1e-10
    assert facts["rcond"] == pytest.approx(mechanism.parametrization().rcond(mechanism.q_reference))
    assert abs(facts["assembly_mode"]["sign_det_psi"]) == 1


def test_modes(capsys):
    """Two modes over a given q, in words and as JSON."""
    assert main(["modes", "rpdr", "--q-deg", "-100", "-80"]) == 0
    said = capsys.readouterr().out
    assert "2 assembly modes" in said
    assert "q′ in rad and m, of joint1, joint3, joint2, joint4" in said
    assert main(["modes", "rpdr", "--q-deg", "-100", "-80", "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["modes"]) == 2


def test_a_pose_out_of_reach_is_told(capsys):
    """The elbows are |(0.3048, 0) + 0.2794 (u(−30°) − u(−150°))| = 0.79 m apart, the rods 0.61 m together."""
    assert main(["modes", "rpdr", "--q-deg", "-150", "-30", "--limit", "20"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("no closed configuration found: stopped at the limit of 20 starts")
    assert "assembly mode" not in said


def test_degrees_of_a_length_are_refused(capsys):
    """A prismatic coordinate is never read as degrees."""
    assert main(["modes", "stewart", "--q-deg", *["5"] * 6]) == 1
    assert "all angles" in capsys.readouterr().err


@pytest.mark.parametrize(("name", "count"), [("rpdr", 2), pytest.param("stewart", 8, marks=pytest.mark.slow)])
def test_modes_are_drawn(name, count, capsys, monkeypatch, tmp_path):
    """A panel a mode, planar or in space, each with its number above; no heading covers another; a file and a line."""
    kept, save = [], plotting.save
    monkeypatch.setattr(plotting, "save", lambda figure, path: (kept.append(figure), save(figure, path)))
    assert main(["modes", name, "--out", str(tmp_path / "modes.pdf")]) == 0
    said = capsys.readouterr().out
    assert said.endswith(f"wrote {tmp_path / 'modes.pdf'}\n")
    assert (tmp_path / "modes.pdf").read_bytes().startswith(b"%PDF")
    headings = [axes.title for axes in kept[0].axes]
    told = [line.partition(":")[0] for line in said.splitlines() if line.startswith("mode ")]
    assert [heading.get_text() for heading in headings] == told
    assert len(told) >= count
    boxes = [heading.get_window_extent() for heading in headings]
    assert not any(a.overlaps(b) for a, b in itertools.combinations(boxes, 2))


def test_drawn_modes_are_mirror_images(monkeypatch, tmp_path):
    """Over arms of one height the RPDR's two modes mirror each other in the line through the elbows."""
    kept = []
    monkeypatch.setattr(plotting, "save", lambda figure, path: kept.append(figure))
    assert main(["modes", "rpdr", "--q-deg", "-100", "-80", "--out", str(tmp_path / "modes.png")]) == 0
    marked = [{line.get_marker(): line.get_xydata() for line in axes.lines} for axes in kept[0].axes]
    (first, second), elbows = [each["D"][0] for each in marked], marked[0]["o"]
    elbows = elbows[elbows[:, 1] < -0.1]
    assert elbows[0, 1] == pytest.approx(elbows[1, 1])
    assert first[0] == pytest.approx(second[0])
    assert 0.5 * (first[1] + second[1]) == pytest.approx(elbows[0, 1])
    assert abs(first[1] - second[1]) > 0.1


def test_no_mode_is_not_drawn(capsys, tmp_path):
    """Where none was found there is no file, and no word of one."""
    path = tmp_path / "modes.png"
    assert main(["modes", "rpdr", "--q-deg", "-150", "-30", "--limit", "20", "--out", str(path)]) == 0
    assert "wrote" not in capsys.readouterr().out
    assert not path.exists()


def test_modes_shows_progress_and_keeps_to_its_budget(capsys, monkeypatch):
    """A bar on a terminal, none with --json; a budget or a limit ends the search with what was found, which is said."""
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    assert main(["modes", "rpdr", "--patience", "10"]) == 0
    shown = capsys.readouterr()
    assert "2 modes from" in shown.err
    assert "starts without news" in shown.err
    assert main(["modes", "rpdr", "--json", "--limit", "3"]) == 0
    shown = capsys.readouterr()
    assert shown.err == ""
    found = json.loads(shown.out)
    assert (found["complete"], found["starts"]) == (False, 3)
    assert found["reason"].startswith("stopped at the limit of 3 starts")


def test_modes_interrupted_prints_what_it_found(capsys, monkeypatch):
    """Ctrl-C: the modes so far, and the exit code of an interrupt."""
    step = _ModeFinder.step

    def stop(search):
        step(search)
        if search.starts == 4:
            raise KeyboardInterrupt

    monkeypatch.setattr(_ModeFinder, "step", stop)
    assert main(["modes", "rpdr"]) == 130
    assert "interrupted, so modes may be missing" in capsys.readouterr().out


def test_modes_at_a_singular_configuration(capsys):
    """Where every start ends singular, no mode is found, and the words say why."""
    assert main(["modes", "four_bar", "--independent", "rocker", "--q", repr(_rocker_dead_centre())]) == 0
    text = capsys.readouterr().out
    assert "0 assembly modes" in text
    assert "singular configurations" in text


def _rocker_dead_centre():
    """The rocker's angle with crank 40 and coupler 120 in line, over ground 100 and rocker 80: law of cosines."""
    return float(np.pi - np.arccos((100.0**2 + 80.0**2 - 160.0**2) / (2 * 100.0 * 80.0)))


def test_simulate_point_to_point(capsys, tmp_path):
    """The paper's motion with all its files."""
    assert main(["simulate", "rpdr", *MOVE_OPTIONS, "--out", str(tmp_path), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["status"] == "finished"
    assert result["moves"][0]["settling_time"] == pytest.approx(0.3, abs=0.05)
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"motion.csv", "motion.npz", "metrics.json", "motion.png", "configurations.png", "animation.html"}
    assert ccpin.Trajectory.load(tmp_path / "motion.npz").closure_error.max() <= 1e-10


@pytest.mark.parametrize(
    ("arguments", "goal", "scale", "unit", "band"),
    [
        (["rpdr", *MOVE_OPTIONS, "--duration", "0.4"], np.radians([-90.0, -100.0]), np.degrees(1.0), "°", 2.0),
        pytest.param(
            ["rpdr", *MOVE_OPTIONS, "--duration", "0.1"],
            np.radians([-90.0, -100.0]),
            np.degrees(1.0),
            "°",
            2.0,
            marks=pytest.mark.slow,
        ),
        pytest.param(
            ["stewart", *STROKES, "--duration", "0.05", "--band-deg", "0.1"],
            np.full(6, 0.01),
            1e3,
            " mm",
            1.75,
            marks=pytest.mark.slow,
        ),
    ],
)
def test_simulate_tells_how_far_off_it_ends(arguments, goal, scale, unit, band, capsys, tmp_path):
    """|q_d − q| of the last sample in degrees or millimetres beside the band, and in SI units in the JSON."""
    assert main(["simulate", *arguments, "--out", str(tmp_path)]) == 0
    text = capsys.readouterr().out
    off = np.abs(goal - ccpin.Trajectory.load(tmp_path / "motion.npz").q[-1])
    numbers = [f"{scale * value:.2f}{unit}" for value in off]
    assert f", {', '.join(numbers[:-1])} and {numbers[-1]} off at the end" in text
    assert f"within ±{band:g}{unit}" in text
    assert ("not within" in text) == bool(scale * off.max() > band)
    move = json.loads((tmp_path / "metrics.json").read_text())["moves"][0]
    np.testing.assert_allclose(move["steady_state_error"], off, atol=1e-15)
    assert scale * move["band"] == pytest.approx(band, abs=0.005)


def test_simulate_cycles(capsys):
    """Back and forth under the supervisor."""
    assert main(["simulate", "rpdr", *MOVE_OPTIONS, "--cycles", "1", "--wait", "0.2", "--rtol", "1e-7"]) == 0
    text = capsys.readouterr().out
    assert "move 1" in text
    assert "move 2" in text


def test_simulate_without_torque(capsys):
    """A free swing needs no gains."""
    assert main(["simulate", "rpdr", "--law", "none", "--duration", "0.05", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["status"] == "finished"


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (["info", "nosuch"], "DescriptionNotFoundError"),
        (["info", "rpdr", "--independent", "joint1"], "IndependentSetError"),
        (["simulate", "rpdr", "--start", "0", "1", "2"], "InvalidInputError"),
        (["simulate", "rpdr", "--goal-deg", "86", "-86", "--kp", "1", "--kv", "1"], "UnreachableError"),
        (["modes", "rpdr", "--q", "1"], "InvalidInputError"),
    ],
)
def test_errors_are_sentences_with_exit_code_1(arguments, error, capsys):
    """An error names its class and says what is wrong; with --json it is an object."""
    assert main(arguments) == 1
    assert error in capsys.readouterr().err
    assert main([*arguments, "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["error"] == error


def test_view_writes_a_page(tmp_path, capsys):
    """`ccpin view --out` writes the reference pose, or a trajectory."""
    assert main(["view", "rpdr", "--out", str(tmp_path / "pose.html")]) == 0
    assert (tmp_path / "pose.html").stat().st_size > 100_000
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    motion = ccpin.simulate(model, None, np.radians([-90.0, -95.0]), duration=0.1, sample_period=0.01)
    motion.save(tmp_path / "motion.npz")
    page = tmp_path / "motion.html"
    command = ["view", "rpdr", "--trajectory", str(tmp_path / "motion.npz"), "--out", str(page)]
    assert main([*command, "--trace", "end_effector", "--forces"]) == 0
    assert page.stat().st_size > 100_000
    assert main(["view", "rpdr", "--forces", "--out", str(page)]) == 1
    assert "go with --trajectory" in capsys.readouterr().err


def test_module_runs_as_a_program():
    """`python -m ccpin` is the command line, with usage errors as exit code 2."""
    done = subprocess.run([sys.executable, "-m", "ccpin", "--version"], capture_output=True, text=True, check=True)
    assert ccpin.__version__ in done.stdout
    assert subprocess.run([sys.executable, "-m", "ccpin", "dance"], capture_output=True, check=False).returncode == 2


def test_doctor_tells_what_is_installed_and_what_computes(capsys):
    """Versions as the packages say them, the backend in use, and missing extras by name."""
    assert main(["doctor", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["packages"][""]["numpy"] == np.__version__
    assert facts["backend"]["name"] == ccpin.backend().name
    assert facts["cores"] >= 1
    assert main(["doctor"]) == 0
    assert f"computed by  {ccpin.backend().name}" in capsys.readouterr().out


def test_doctor_survives_a_wrong_backend_and_no_compiler(capsys, monkeypatch):
    """What is wrong is told, not raised: that is what it is asked for."""
    monkeypatch.setenv("CCPIN_BACKEND", "fortran")
    monkeypatch.setenv("CXX", "/nowhere/c++")
    assert main(["doctor"]) == 0
    text = capsys.readouterr().out
    assert "must be numpy or native" in text
    assert "compiler     none found" in text


def test_doctor_lists_missing_meshes(capsys, tmp_path):
    """By the name they have in the file."""
    text = (MODELS / "four_bar.urdf").read_text(encoding="utf-8")
    visual = '<visual><geometry><mesh filename="gone.stl"/></geometry></visual></link>'
    path = tmp_path / "meshless.urdf"
    path.write_text(text.replace("</link>", visual, 1), encoding="utf-8")
    assert main(["doctor", str(path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["meshes"]
    assert found["named"] == 1
    assert "gone.stl" in found["missing"][0]


def test_convert(tmp_path, capsys):
    """A model written as MJCF is a file that loads; what cannot be written is said, and no file is left."""
    assert main(["convert", "rpdr", "--out", str(tmp_path / "rpdr.xml")]) == 0
    assert "n = 2" in capsys.readouterr().out
    assert ccpin.load(tmp_path / "rpdr.xml").n == 2
    assert main(["convert", "rpdr", "--out", str(tmp_path / "rpdr.step")]) == 1
    assert "names none of" in capsys.readouterr().err
    assert not (tmp_path / "rpdr.step").exists()


def test_a_yaml_brings_its_urdf_and_spares_the_source(tmp_path, capsys):
    """robot.urdf beside it is told, and never written over what was read."""
    source = tmp_path / "robot.urdf"
    source.write_bytes((MODELS / "rpdr.urdf").read_bytes())
    assert main(["convert", str(source), "--out", str(tmp_path / "robot.yaml")]) == 1
    assert "use another folder" in capsys.readouterr().err
    assert source.read_bytes() == (MODELS / "rpdr.urdf").read_bytes()
    (tmp_path / "other").mkdir()
    assert main(["convert", str(source), "--out", str(tmp_path / "other" / "robot.yaml")]) == 0
    assert "robot.urdf is written beside it" in capsys.readouterr().out
    pair = tmp_path / "other" / "robot.yaml"
    before = pair.with_name("robot.urdf").read_bytes()
    assert main(["convert", str(pair), "--out", str(pair.with_name("second.yaml")), "--locked", "joint1"]) == 1
    assert pair.with_name("robot.urdf").read_bytes() == before
    assert main(["convert", str(pair), "--out", str(pair)]) == 0


def test_simulate_keeps_to_limits(capsys):
    """Efforts are cut off by default, or told where they may go beyond; a lag needs a sampled loop."""
    asked = ("simulate", "rpdr", *MOVE_OPTIONS[:6], "--kp", "60", "--kv", "1", "--duration", "0.05", "--json")
    assert main([*asked]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["moves"][0]["peak_torque"] == [30.0, 30.0]
    assert {(one["quantity"], one["limit"]) for one in result["exceeded"]} == {("velocity", 30.0)}  # it is told
    assert main([*asked, "--effort-limits", "ignore"]) == 0
    exceeded = json.loads(capsys.readouterr().out)["exceeded"]
    beyond = [(one["joint"], one["limit"]) for one in exceeded if one["quantity"] == "effort"]
    assert beyond == [("joint1", 30.0), ("joint2", 30.0)]
    for options, told in (([], True), (["--effort-limits", "ignore"], False)):
        assert main([*asked[:-1], *options]) == 0
        assert ("efforts at their limits: joint1 for" in capsys.readouterr().out) is told
    assert main([*asked, "--motor-lag", "0.002"]) == 1
    assert "--motor-lag: needs a sampled loop" in json.loads(capsys.readouterr().out)["message"]
