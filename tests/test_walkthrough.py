"""From the file to the animation with nothing but the file: rods that spin, mimic joints, a gas spring."""

import json
from functools import cache

import numpy as np
import pytest

import ccpin
from ccpin import domain
from ccpin.cli import main
from ccpin.control import PDFullGravity, PDSimpleGravity, certify_set_point
from ccpin.domain import theorem2
from ccpin.dynamics import assembly_modes
from ccpin.visualization import animate
from tests.support.long_cases import later
from tests.support.walkthrough import NAMES, file

MODES = {"rssr": 2, "ankle": 4, "gripper": 1, "gas_spring_leg": 2}
MOTORS = {
    "rssr": ("crank_joint",),
    "ankle": ("left_motor", "right_motor"),
    "gripper": ("drive",),
    "gas_spring_leg": ("hip", "knee"),
}
every_one = pytest.mark.parametrize("name", NAMES)


@cache
def model_of(name):
    return ccpin.ReducedModel(ccpin.load(file(name)))


def start_and_goal(name):
    model = model_of(name)
    start = model.alpha(model.mechanism.q_reference)
    return start, start + 0.12


def gains(model, q):
    """K_p well above the slope of gravity, K_v critical."""
    state = model.at(q)
    D = np.diag(state.D)
    stiff = 400.0 * D + 50.0 * (np.abs(state.g) + 0.02)
    return stiff, 2.0 * np.sqrt(stiff * D)


@every_one
def test_it_loads_with_its_motors_for_coordinates(name):
    """q and u are the motors in the file's order; nothing idle is among them or left over."""
    mechanism = model_of(name).mechanism
    assert mechanism.independent == mechanism.actuated == MOTORS[name]
    assert mechanism.mobility.idle == ()
    assert mechanism.direct


@every_one
@pytest.mark.parametrize("law", [PDSimpleGravity, PDFullGravity])
def test_pd_reaches_the_goal(name, law):
    """The paper's laws bring it to a set point, closed all the way."""
    model, (start, goal) = model_of(name), start_and_goal(name)
    trajectory = ccpin.simulate(model, law(model, goal, *gains(model, goal)), start, duration=1.0)
    assert trajectory.status == "finished"
    assert np.abs(trajectory.q[-1] - goal).max() < 1e-3
    assert trajectory.closure_error.max() <= 1e-10


@every_one
def test_both_backends_agree(name, monkeypatch):
    """D, C, g and q̈ from NumPy and from the compiled core."""
    start, goal = start_and_goal(name)
    v, answers = np.linspace(0.4, -0.7, len(start)), []
    for backend in ("native", "numpy"):
        monkeypatch.setenv("CCPIN_BACKEND", backend)
        model = ccpin.ReducedModel(ccpin.load(file(name)))
        state = model.at(goal)
        answers.append([state.D, state.C(v), state.g, state.forward_dynamics(v, np.ones(model.n_actuated))])
    for mine, theirs in zip(*answers, strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-11 * max(1.0, np.abs(theirs).max()))


@every_one
@pytest.mark.parametrize("backend", later("native", "numpy"))
def test_sigma_is_certified(name, backend, monkeypatch):
    """A square about the reference by Theorem 2, by one box and by the atlas, and the way to the goal."""
    monkeypatch.setenv("CCPIN_BACKEND", backend)
    mechanism, (start, goal) = ccpin.load(file(name)), start_and_goal(name)
    assert theorem2(mechanism, mechanism.q_reference).radius > 0.05
    assert domain.kantorovich_radius(mechanism, mechanism.q_reference) > 0.05
    atlas = domain.certify(mechanism, start, (start - 0.1, start + 0.1))
    assert (atlas.certified_fraction, atlas.single_valued) == (1.0, True)
    path = domain.certify_path(mechanism, [start, goal])
    assert path.verdict == "proven", path.reason
    sigma = ccpin.ReducedModel(mechanism).sigma(goal)
    np.testing.assert_allclose(path.sigma(1.0), sigma, rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", later(*NAMES))
def test_a_set_point_is_certified(name):
    """Theorem 3 about the reference: a basin of positive size."""
    model = model_of(name)
    _, goal = start_and_goal(name)
    proof = certify_set_point(model, goal, *gains(model, goal), max_depth=6, budget=200)
    assert proof.verdict == "proven"
    assert proof.level > 0.0


@pytest.mark.parametrize("name", later(*NAMES))
def test_the_modes_are_what_a_person_counts(name):
    """Elbow up or down, and no flips or spins of rods."""
    found = assembly_modes(model_of(name), start_and_goal(name)[0])
    assert (len(found.modes), found.complete) == (MODES[name], True)
    assert found.modes[0].is_reference


@every_one
def test_it_is_drawn(name, tmp_path):
    """An offline page of a motion."""
    model, (start, goal) = model_of(name), start_and_goal(name)
    t = np.linspace(0.0, 1.0, 5)
    q_free = model.sigma_many(start + t[:, None] * (goal - start))
    animate(model.mechanism, t, q_free, tmp_path / "motion.html")
    assert (tmp_path / "motion.html").stat().st_size > 1e5


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name != "rssr")) for name in NAMES])
def test_the_command_line_does_it_all(name, tmp_path, capsys):
    """info, modes, domain, simulate with gains of its own, and convert, with the file alone."""
    path, (_, goal) = str(file(name)), start_and_goal(name)
    assert main(["info", path, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["locked"] == list(model_of(name).mechanism.locked)
    assert main(["modes", path, "--json", "--budget", "60"]) == 0
    assert len(json.loads(capsys.readouterr().out)["modes"]) == MODES[name]
    assert main(["domain", path, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["kantorovich_radius"] > 0.05
    options = ["--json", "--goal", *(str(x) for x in goal), "--duration", "1.5", "--band-deg", "0.5"]
    assert main(["simulate", path, "--out", str(tmp_path), *options]) == 0
    (move,) = json.loads(capsys.readouterr().out)["moves"]
    assert move["settling_time"] is not None
    assert (tmp_path / "animation.html").exists()
    assert main(["convert", path, "--out", str(tmp_path / "again.urdf")]) == 0
    assert ccpin.load(tmp_path / "again.urdf").n == model_of(name).mechanism.n


def test_locked_and_free_are_options(capsys):
    """--free leaves a spin free, --locked fixes a joint."""
    assert main(["info", str(file("rssr")), "--json", "--free", "all"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["mobility"], facts["locked"], len(facts["idle_mobilities"])) == (2, [], 1)
    assert main(["info", str(file("ankle")), "--json", "--locked", "roll"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["mobility"], facts["locked"]) == (1, ["roll", "left_ball:rz"])
    assert main(["info", str(file("ankle")), "--locked", "roll"]) == 0
    assert "locked          roll, left_ball:rz" in capsys.readouterr().out
