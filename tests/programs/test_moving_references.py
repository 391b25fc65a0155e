"""Laws whose reference is an input: the Python laws' efforts along a motion, in NumPy, C and lanes."""

import numpy as np
import pytest

import ccpin
from ccpin import control, programs
from ccpin.control.control_law import NoTorque
from ccpin.errors import CcpinError, InvalidInputError, UnsupportedMechanismError
from ccpin.programs.numbers import NumbersOfRows
from ccpin.programs.recording.recorded_mechanism import numbering
from tests.support.exported import closed_states, exported, self_tested
from tests.support.long_cases import later
from tests.support.places import ROOT

ANKLE = str(ROOT / "docs" / "howto" / "ankle.urdf")
MODELS = later("rpdr", ANKLE, "planar_3rrr", "delta", "stewart", "four_bar", "slider_crank", "bennett", "turning")
TRACKING = control.ComputedTorque, control.PDPlus, control.PDOnlineGravity


def model_of(loaded, name):
    """The rpdr whose motors turn without end and sit on the other joints, or a model of a file."""
    if name != "turning":
        return loaded(name)
    kinds = pytest.importorskip("tests.support.recorded").with_kinds("rpdr", joint1="continuous", joint2="continuous")
    return ccpin.ReducedModel(ccpin.load(kinds, actuated=("joint3", "joint4")))


def spline(model, rng):
    """A motion about the reference."""
    q = model.alpha(model.mechanism.q_reference)
    ends = [model.coordinates.integrate(q, 0.2 * rng.uniform(-1.0, 1.0, model.n)) for _ in range(3)]
    return control.Waypoints(model, [0.0, 0.4, 1.0], [q, *ends[1:]])


def asked(model, count, seed=4):
    """States with velocities and times, and what programs read of each."""
    rng = np.random.default_rng(seed)
    states, numbers = closed_states(model, count, seed, 0.1)
    path, own = spline(model, rng), numbering(model, model.mechanism.q_reference)
    t, v = rng.uniform(-0.1, 1.1, count), rng.normal(size=(count, model.n))
    wanted = [path.at(time) for time in t]
    q_d, _ = NumbersOfRows(model, own).independent(np.array([each.q for each in wanted]), numbers[:, : model.n])
    given = {"q": numbers[:, : model.n], "y": numbers[:, model.n :], "v": v, "q_d": q_d}
    given |= {"v_d": np.array([each.v for each in wanted]), "a_d": np.array([each.a for each in wanted])}
    return path, states, t, given


def read(program, given):
    return {port.name: given[port.name] for port in program.inputs}


def held_against(law, program, states, t, given):
    """Every row is the law's torque, to rounding times what solves may make of it."""
    found = program(**read(program, given))
    assert not found.status.any()
    for k, state in enumerate(states):
        wanted = law.torque(t[k], state, given["v"][k])
        condition = max(1.0 / state.rcond, np.linalg.cond(state.D))
        assert np.abs(found["torque"][k] - wanted).max() <= 2e-14 * condition * max(1.0, np.abs(wanted).max())


@pytest.mark.parametrize("name", MODELS)
def test_torques_are_the_laws_along_a_motion(loaded, name):
    model = model_of(loaded, name)
    path, states, t, given = asked(model, 1000)
    gains = np.full(model.n, 40.0), np.full(model.n, 6.0)
    for kind in TRACKING:
        law = kind(model, path, *gains)
        held_against(law, programs.record(model, "torque", law=law), states, t, given)


@pytest.mark.parametrize("name", later("rpdr", ANKLE, "planar_3rrr", "turning"))
def test_set_points_that_move(loaded, name):
    """(28) with q_d and g(q_d) as inputs and (30) with q_d are the laws of these set points; v_d adds K_v v_d."""
    model = model_of(loaded, name)
    _, states, _, given = asked(model, 12)
    gains = np.full(model.n, 11.0), np.full(model.n, 0.6)
    for kind in (control.PDSimpleGravity, control.PDFullGravity):
        at_rest = kind(model, states[0].q, *gains)
        program = programs.record(model, "torque", law=at_rest, moving=True)
        for state, goal, v in zip(states, states[::-1], given["v"], strict=True):
            numbers, rest = programs.configuration(state), np.zeros(model.n)
            inputs = numbers | {"v": v, "q_d": programs.configuration(goal)["q"], "v_d": rest, "g_d": goal.g}
            law, found = kind(model, goal.q, *gains, goal), program(**read(program, inputs))["torque"]
            np.testing.assert_allclose(found, law.torque(0.0, state, v), rtol=0, atol=1e-12 * np.abs(found).max())
            swift = program(**read(program, inputs | {"v_d": v, "v": rest}))["torque"]
            np.testing.assert_allclose(swift, law.torque(0.0, state, -v), rtol=0, atol=1e-12 * np.abs(swift).max())


def test_a_held_reference_is_constant(loaded):
    """Laws that track and hold one q_d are recorded with it; all are (30) there but computed torque."""
    model = loaded("rpdr")
    _, states, t, given = asked(model, 20)
    for kind in TRACKING:
        law = kind(model, control.Hold(model, states[0].q), [40.0, 30.0], [6.0, 5.0])
        program = programs.record(model, "torque", law=law)
        assert [port.name for port in program.inputs] == ["q", "y", "v"]
        held_against(law, program, states, t, given)


@pytest.mark.parametrize("kind", later(*TRACKING[:2]))
@pytest.mark.parametrize("name", later("rpdr", ANKLE, "planar_3rrr", "delta"))
def test_sigma_is_found_first(loaded, name, kind, tmp_path):
    """From y of a configuration 2e-3 away; the exported file tests itself to the last bit, in both formats."""
    model = loaded(name)
    path, states, t, given = asked(model, 50)
    given["y"] = given["y"] + 2e-3 * np.random.default_rng(1).uniform(-1.0, 1.0, given["y"].shape)
    law = kind(model, path, np.full(model.n, 40.0), np.full(model.n, 6.0))
    program = programs.record(model, ("sigma", "torque"), law=law, given="near", steps=3)
    held_against(law, program, states, t, given)
    for format in ("double", "float"):
        said = self_tested(program, tmp_path, format, f"law_{format}")
        assert said.endswith("0 of 24 states wrong, 24 the same to the last bit\n")


def test_c_gives_the_law_s_torque(loaded, tmp_path):
    model = loaded("rpdr")
    path, states, t, given = asked(model, 200)
    law = control.ComputedTorque(model, path, [100.0, 100.0], [20.0, 20.0])
    program = programs.record(model, "torque", law=law)
    found, status = exported(program, tmp_path)(np.hstack([given[port.name] for port in program.inputs]))
    assert not status.any()
    wanted = [law.torque(time, state, v) for time, state, v in zip(t, states, given["v"], strict=True)]
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-11 * np.abs(wanted).max())
    lanes, status = programs.compiled(program)(*read(program, given).values())
    np.testing.assert_array_equal(lanes, found)


def test_what_is_no_law_of_the_model_is_refused(loaded):
    model = loaded("rpdr")
    law = control.PDFullGravity(model, model.alpha(model.mechanism.q_reference), [11.0, 11.0], [0.6, 0.6])
    other = control.PDFullGravity(
        ccpin.ReducedModel(model.mechanism, gravity=(0.0, 0.0, 0.0)), law.q_d, law.K_p, law.K_v
    )
    with pytest.raises(CcpinError, match="different masses, springs, dampers, gravity"):
        programs.record(model, "torque", law=other)
    with pytest.raises(InvalidInputError, match="no torque at all"):
        programs.record(model, "torque", law=NoTorque(model))
    with pytest.raises(UnsupportedMechanismError, match="not CoulombCompensation"):
        programs.record(model, "torque", law=control.CoulombCompensation(law, 0.1))
    with pytest.raises(InvalidInputError, match="did you mean 'torque'"):
        programs.record(model, "law", law=law)
    with pytest.raises(InvalidInputError, match="neither its torque"):
        programs.record(model, "mass", law=law, moving=True)
    moves = control.PDPlus(model, control.PointToPoint(model, law.q_d, law.q_d + 0.1, 1.0), law.K_p, law.K_v)
    with pytest.raises(UnsupportedMechanismError, match="with a constant q_d"):
        programs.record(model, "lyapunov", law=moves)


def test_limits_are_told_and_kept(loaded, tmp_path):
    """That efforts are not clipped is said of the program, in its header and after it was saved; and of what limits."""
    model = loaded("rpdr")
    law = control.PDFullGravity(model, model.alpha(model.mechanism.q_reference), [11.0, 11.0], [0.6, 0.6])
    program = programs.record(model, "torque", law=law)
    (note,) = program.notes
    assert "not clipped" in note
    for name, (low, high) in zip(model.mechanism.actuated, model.mechanism.motors.limits, strict=True):
        assert f"{name} {low:g} to {high:g}" in note or np.isinf(high)
    program.save(tmp_path / "law.json")
    assert programs.Program.load(tmp_path / "law.json").notes == program.notes
    header, _ = programs.export(program, tmp_path, name="law")
    assert note in header.read_text()
    assert programs.record(model, "mass").notes == ()
