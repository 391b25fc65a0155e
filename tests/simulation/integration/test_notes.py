"""What a trajectory says without being asked: who stepped it, why not the core, and which limits it passed."""

import json
from dataclasses import replace

import numpy as np
import pytest

import ccpin
from ccpin import control, native
from ccpin.cli import main
from ccpin.control.control_law import HeldEffort
from ccpin.errors import SlowRunWarning
from ccpin.identification import AdaptiveTracking
from ccpin.native import core_of
from ccpin.simulation import Event
from ccpin.simulation.integration.notes import KNOWN
from tests.support.places import MODELS

START, GOAL = np.radians((-118.0, -62.0)), np.radians((-108.0, -72.0))
built = pytest.mark.skipif(ccpin.backend().name != "native", reason="the compiled core is not in use")


@pytest.fixture(scope="module")
def law(rpdr_model):
    return control.PDSimpleGravity(rpdr_model, GOAL, 11.0, 0.6)


@pytest.fixture
def limited(tmp_path):
    """The RPDR with an end of joint1's range on the way."""
    text = (MODELS / "rpdr.urdf").read_text(encoding="utf-8")
    full = 'lower="-6.283185307179586" upper="6.283185307179586"'
    file = tmp_path / "limited.urdf"
    file.write_text(text.replace(full, 'lower="-2.2" upper="-1.95"', 1), encoding="utf-8")
    return ccpin.ReducedModel(ccpin.load(file, reference={"joint1": -2.0, "joint2": -1.2}))


@built
def test_who_stepped_it(rpdr_model, law):
    """The core where it can; else what it does not step is named."""
    named = type("Named", (control.PDSimpleGravity,), {})(rpdr_model, GOAL, 11.0, 0.6)
    half = {"torque": lambda self, t, state, v: 0.5 * control.PDSimpleGravity.torque(self, t, state, v)}
    own = type("MyLaw", (control.PDSimpleGravity,), half)(rpdr_model, GOAL, 11.0, 0.6)
    watch = Event(lambda t, state, v: state.q[0], "there")
    for controller, options, said in (
        (law, {}, "stepped by the compiled core"),
        (None, {}, "stepped by the compiled core"),
        (lambda t, q, v: np.zeros(2), {}, "the core does not know TorqueFunction: it steps PDSimpleGravity, "),
        (named, {}, "stepped by the compiled core"),  # it does what its class above says
        (own, {}, "the core does not know MyLaw"),
        (law, {"method": "Radau"}, "the core steps RK45 and DOP853, not Radau"),
        (law, {"events": [watch]}, "without any of them the core steps"),
        (law, {"friction": {"joint1": (0.1, 0.0)}}, "stepped by the compiled core"),
    ):
        notes = ccpin.simulate(rpdr_model, controller, START, duration=0.02, **options).notes
        assert said in notes[0], notes
    assert rpdr_model.backend.name == "native"


@built
def test_why_a_model_is_not_in_the_core(rpdr, monkeypatch):
    """What the core declines is told by the model and by its motions."""

    def refuse(*_):
        raise ValueError("a joint that the core has not")

    monkeypatch.setattr(native, "specification", refuse)
    monkeypatch.setattr(native, "_MADE", {})
    model = ccpin.ReducedModel(rpdr)
    assert model.backend == ("numpy", "the compiled core has no such mechanism: a joint that the core has not")
    monkeypatch.setattr("ccpin.simulation.integration.notes._LONG", 0.0)
    with pytest.warns(SlowRunWarning, match="a joint that the core has not"):
        motion = ccpin.simulate(model, None, START, duration=0.01)
    assert "a joint that the core has not" in motion.notes[0]


@built
def test_kernels_of_many_gravities_are_not_all_kept(rpdr):
    """Each was kept for as long as its mechanism."""
    first = core_of(rpdr)
    for k in range(50):
        core_of(rpdr, np.array([0.0, 0.0, float(k)]))
    assert len(native._MADE[rpdr]) < 10
    assert type(core_of(rpdr)) is type(first)


def test_limits_passed_are_noted(limited, tmp_path):
    """By default; the note is kept in files and in motions that go on."""
    motion = ccpin.simulate(limited, control.PDSimpleGravity(limited, GOAL, 11.0, 0.6), START, duration=0.3)
    told = [note for note in motion.notes if "beyond its limit" in note]
    assert told == ["joint1 is beyond its limit of position, -1.95; `simulation.exceeded` tells more"]
    assert motion.q[:, 0].max() > -1.95
    motion.save(tmp_path / "a.npz")
    assert ccpin.Trajectory.load(tmp_path / "a.npz").notes == motion.notes
    assert motion.then(motion).notes == motion.notes
    within = ccpin.simulate(limited, None, START, duration=1e-3)
    assert not [note for note in within.notes if "limit" in note]


def test_the_command_line_says_them(tmp_path, capsys):
    """In words and in JSON."""
    arguments = ["simulate", "rpdr", "--goal-deg", "-108", "-72", "--start-deg", "-118", "-62", "--duration", "0.02"]
    main([*arguments, "--method", "Radau"])
    assert "note: stepped in Python" in capsys.readouterr().out
    main([*arguments, "--json"])
    assert "stepped" in json.loads(capsys.readouterr().out)["notes"][0]


@built
def test_motors_elsewhere_are_why():
    """A law that the core knows, of motors whose u is not on q: it is that, not the law, which keeps it out."""
    motors = ccpin.load("rpdr").description.motors
    geared = tuple(replace(motor, gear=k) for motor, k in zip(motors, (50.0, -20.0), strict=True))
    for mechanism, sit in (
        (ccpin.load("rpdr", actuated=["joint3", "joint4"]), "joint3, joint4 with gears 1, 1"),
        (ccpin.load(replace(ccpin.load("rpdr").description, motors=geared)), "joint1, joint2 with gears 50, -20"),
    ):
        model = ccpin.ReducedModel(mechanism)
        moved = model.alpha(model.mechanism.q_reference)
        law = control.PDSimpleGravity(model, moved, 11.0, 0.6)
        note = ccpin.simulate(model, law, moved + 0.01, duration=0.01).notes[0]
        assert "the core steps PDSimpleGravity of motors on joint1, joint2, in this order and of gear 1" in note
        assert f"they are on {sit}" in note


@built
def test_the_laws_that_are_named_are_stepped(rpdr_model):
    """Every one of them."""
    here = rpdr_model.alpha(rpdr_model.mechanism.q_reference)
    hold = control.Hold(rpdr_model, here)
    names = KNOWN.replace(" and ", ", ").split(", ")
    for name in names:
        if name == "HeldEffort":
            law = HeldEffort(np.zeros(2))
        elif name == "AdaptiveTracking":
            law = AdaptiveTracking(rpdr_model, hold, 20.0, 2.0, gain=1.0, period=1e-3, adapted="body")
        else:
            leads = here if name in ("PDSimpleGravity", "PDFullGravity") else hold
            law = getattr(control, name)(rpdr_model, leads, 20.0, 2.0)
        assert ccpin.simulate(rpdr_model, law, here, duration=0.01).notes[0] == "stepped by the compiled core", name
