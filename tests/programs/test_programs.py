"""Recorded programs are the reduced model's: every quantity, of closed configurations and of σ's steps."""

import subprocess
import sys
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

import ccpin
from ccpin import programs
from ccpin.dynamics.end_effector import EndEffector
from ccpin.errors import CcpinError, InvalidInputError, UnsupportedMechanismError
from ccpin.programs.evaluation import gain
from tests.support.closed import closed_near
from tests.support.long_cases import later
from tests.support.paper import GOAL, K_P, K_V
from tests.support.recorded import MECHANISMS

MODELS = later("rpdr", "planar_3rrr", "slider_crank", "four_bar", "sarrus", "delta", "hexa", "stewart", "bennett")


def states(model, count=6, seed=0, spread=0.1):
    """Closed states near the reference with velocities, and the numbers q and y of each."""
    rng, found = np.random.default_rng(seed), []
    for state in islice(closed_near(model, rng, spread), count):
        v, u = rng.normal(size=model.n), rng.normal(size=model.n_actuated)
        found.append((state, programs.configuration(state), v, u))
    return found


def close(found, expected, tolerance=1e-12):
    scale = max(1.0, float(np.abs(expected).max(initial=0.0)))
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=tolerance * scale)


@pytest.mark.parametrize("name", MODELS)
def test_quantities_are_the_model_s(loaded, name):
    model = loaded(name)
    tree = model.mechanism.tree
    link = next(name for name, at in tree.attachments.items() if at.joint == len(tree.joints))
    tool = EndEffector(model, link, (0.1, 0.2, 0.3))
    what = (
        "closure", "sigma", "rho", "v_free", "bias", "mass", "mass_inverse", "coriolis", "velocity_force", "gravity",
        "forward_dynamics", "generalized_force", "energy", "tool",
    )  # fmt: skip
    program = programs.record(model, what, points={"tool": tool})
    rng = np.random.default_rng(5)
    for state, numbers, v, u in states(model):
        a = rng.normal(size=model.n)
        found = program(**numbers, v=v, u=u, a=a)
        assert found.status == 0
        close(found["closure"], 0.0 * found["closure"])
        close(found["sigma"], numbers["y"])
        close(found["rho"], state.rho)
        close(found["v_free"], state.rho @ v)
        close(found["bias"], state.bias(v), 1e-10)
        close(found["mass"], state.D)
        close(found["mass_inverse"] @ state.D, np.eye(model.n), 1e-9)
        close(found["coriolis"], state.C(v), 1e-10)
        close(found["velocity_force"], state.C(v) @ v + state.damping @ v, 1e-10)
        close(found["gravity"], state.g)
        close(found["forward_dynamics"], state.forward_dynamics(v, u), 1e-10)
        close(found["generalized_force"], state.tau(v, a), 1e-10)
        close(found["energy"], np.array(state.energy(v)), 1e-11)
        pose = tool.pose(state)
        close(found["tool"], pose[:3, 3])
        close(found["tool_rotation"], pose[:3, :3])
        close(found["tool_jacobian"], tool.jacobian(state))


@pytest.mark.parametrize("name", MODELS)
def test_derivatives_are_exact(loaded, name):
    """By q along tangent steps, with y moving along."""
    model = loaded(name)
    program = programs.record(model, ("forward_dynamics", "gravity"), derivatives=("q", "v", "u"))
    for state, numbers, v, u in states(model, 3):
        found = program(**numbers, v=v, u=u)
        by_q, by_v, by_u = state.forward_dynamics_derivatives(v, u)
        close(found["forward_dynamics_by_q"], by_q, 1e-9)
        close(found["forward_dynamics_by_v"], by_v, 1e-9)
        close(found["forward_dynamics_by_u"], by_u, 1e-9)
        close(found["gravity_by_q"], state.gravity_derivative, 1e-10)
        assert "gravity_by_v" not in found


@pytest.mark.parametrize("name", MODELS)
def test_sigma_is_found_from_near_by(loaded, name):
    model = loaded(name)
    program = programs.record(model, ("sigma", "forward_dynamics"), given="near")
    rng = np.random.default_rng(3)
    for state, numbers, v, u in states(model):
        start = numbers["y"] + 2e-3 * rng.uniform(-1.0, 1.0, len(numbers["y"]))
        found = program(q=numbers["q"], y=start, v=v, u=u)
        assert found.status == 0
        close(found["sigma"], numbers["y"], 1e-11)
        close(found["forward_dynamics"], state.forward_dynamics(v, u), 1e-9)


def test_what_is_far_from_closed_is_told(rpdr_model):
    """From a start that Newton's steps do not bring home, or where the pivots vanish, the status is not 0."""
    program = programs.record(rpdr_model, "sigma", given="near")
    ((_, numbers, *_),) = states(rpdr_model, 1)
    assert program(q=numbers["q"], y=numbers["y"] + 0.4).status == 2
    distal = numbers["q"].sum() + numbers["y"]
    rho = programs.record(rpdr_model, "rho")
    assert rho(q=numbers["q"], y=distal.mean() - numbers["q"]).status == 1  # both distal links are parallel


def test_laws_and_lyapunov_functions(rpdr_model):
    law = ccpin.control.PDSimpleGravity(rpdr_model, GOAL, K_P, K_V)
    full = ccpin.control.PDFullGravity(rpdr_model, GOAL, K_P, K_V)
    first = programs.record(rpdr_model, ("torque", "lyapunov"), law=law)
    second = programs.record(rpdr_model, "torque", law=full)
    potential = rpdr_model.energy(law.q_d, np.zeros(2), law.q_free_d).potential
    for state, numbers, v, _ in states(rpdr_model, 3):
        found = first(**numbers, v=v)
        close(found["torque"], law.torque(0.0, state, v))
        close(found["lyapunov"][0], law.lyapunov(state.q, v, state.q_free) + potential)
        close(second(**numbers, v=v)["torque"], full.torque(0.0, state, v))
    with pytest.raises(UnsupportedMechanismError, match="recorded of PDSimpleGravity"):
        programs.record(rpdr_model, "lyapunov", law=full)
    with pytest.raises(InvalidInputError, match="give law="):
        programs.record(rpdr_model, "torque")


def test_many_rows_at_once(rpdr_model):
    program = programs.record(rpdr_model, ("forward_dynamics", "mass"))
    rows = states(rpdr_model, 5)
    stacked = {name: np.array([numbers[name] for _, numbers, *_ in rows]) for name in ("q", "y")}
    v, u = np.array([row[2] for row in rows]), np.array([row[3] for row in rows])
    found = program(**stacked, v=v, u=u)
    assert (found["forward_dynamics"].shape, found["mass"].shape, found.status.shape) == ((5, 2), (5, 2, 2), (5,))
    for k, (_, numbers, v_k, u_k) in enumerate(rows):
        np.testing.assert_array_equal(
            found["forward_dynamics"][k], program(**numbers, v=v_k, u=u_k)["forward_dynamics"]
        )
    one = program(**stacked, v=v, u=u[0])
    np.testing.assert_array_equal(one["forward_dynamics"][0], found["forward_dynamics"][0])


def test_a_saved_program_is_the_same_and_needs_numpy_alone(rpdr_model, tmp_path):
    program = programs.record(rpdr_model, ("sigma", "forward_dynamics"), given="near")
    path = tmp_path / "rpdr.json"
    program.save(path)
    again = programs.Program.load(path)
    assert again.digest == program.digest
    assert repr(again) == repr(program)
    ((_, numbers, v, u),) = states(rpdr_model, 1)
    np.testing.assert_array_equal(
        again(**numbers, v=v, u=u)["forward_dynamics"], program(**numbers, v=v, u=u)["forward_dynamics"]
    )
    script = (
        "import sys; from ccpin import programs; p = programs.Program.load(sys.argv[1]); "
        "print(p.name, [m for m in ('pinocchio', 'scipy', 'ccpin.kinematics.tree') if m in sys.modules])"
    )
    told = subprocess.run([sys.executable, "-c", script, path], capture_output=True, text=True, check=True).stdout
    assert told.strip() == "rpdr: sigma, forward_dynamics []"


def test_damaged_programs_are_refused(rpdr_model, tmp_path):
    path = tmp_path / "p.json"
    programs.record(rpdr_model, "gravity").save(path)
    text = path.read_text()
    for change in (
        lambda t: t[:-20],
        lambda t: t.replace('"multiply"', '"devide"', 1),
        lambda t: t.replace('"add"', '"subtract"', 1),
        lambda t: t.replace('"version": 1', '"version": 2'),
        lambda t: t.replace('"ccpin.program"', '"other"'),
        lambda t: "[]",
        lambda t: "{}",
        lambda t: "nothing",
    ):
        path.write_text(change(text))
        with pytest.raises(CcpinError, match=r"program|changed"):
            programs.Program.load(path)
    with pytest.raises(CcpinError):
        programs.Program.load(tmp_path / "no such file.json")


def test_it_prints_as_mathematics(rpdr_model):
    program = programs.record(rpdr_model, "gravity")
    text = str(program)
    assert "q, y ↦ gravity" in text
    assert "sin(q[joint1])" in text
    assert text.splitlines()[-1].startswith("gravity[1] = t")
    assert f"{sum(program.operations.values())} operations" in repr(program)
    assert "reciprocal" in program.operations


def test_what_cannot_be_recorded_is_told(rpdr_model):
    for what, words in (("sines", "what"), ((), "nothing to record"), (("mass", "tool"), "what")):
        with pytest.raises(InvalidInputError, match=words):
            programs.record(rpdr_model, what)
    with pytest.raises(InvalidInputError, match="given"):
        programs.record(rpdr_model, "mass", given="guessed")
    with pytest.raises(InvalidInputError, match="derivatives"):
        programs.record(rpdr_model, "mass", derivatives=("t",))
    program = programs.record(rpdr_model, "mass")
    with pytest.raises(InvalidInputError, match="are q, y, not q"):
        program(q=np.zeros(2))
    with pytest.raises(InvalidInputError, match="shape"):
        program(q=np.zeros(3), y=np.zeros(2))
    with pytest.raises(InvalidInputError, match="rows"):
        program(q=np.zeros((3, 2)), y=np.zeros((4, 2)))


def test_programs_cannot_be_written_to(rpdr_model):
    program = programs.record(rpdr_model, "mass")
    with pytest.raises(AttributeError):
        program.name = "other"
    other = replace(program, name="other")
    assert other.digest != program.digest


def test_a_balls_spring_has_its_function_and_derivatives():
    """g(w) = 2 arccos(w)/√(1 − w²) and its derivatives beside Gauss's series, where ours takes over and elsewhere."""
    flint = pytest.importorskip("flint")
    from tests.support.programs import exact_gain

    for w in (-0.9, -0.2, 0.3, 0.499, 0.5, 0.7, 0.999, 1.0):
        for order in range(4):
            true = float(exact_gain(flint.arb(w), order).mid())
            assert float(gain(np.array(w), order, np)) == pytest.approx(true, rel=3e-13)


def test_nothing_may_depend():
    """Where closures hold by themselves σ has nothing to find: from near by it is the program of closed ones."""
    described = ccpin.load("four_bar").description
    closures = tuple(replace(closure, kind="planar") for closure in described.closures)  # in the plane all move in
    joints = ["crank", "coupler", "rocker"]
    model = ccpin.ReducedModel(ccpin.load(replace(described, closures=closures), independent=joints))
    assert model.n == model.mechanism.n_free
    near, closed = (programs.record(model, ("sigma", "mass"), given=given) for given in ("near", "closed"))
    for state, numbers, _, _ in states(model, 2):
        found = near(**numbers)
        assert (found.status, found["sigma"].shape) == (0, (0,))
        np.testing.assert_array_equal(found["mass"], closed(**numbers)["mass"])
        close(found["mass"], state.D)


# Every kind of joint.

WHOLE = {"ball, independent", "floating", "planar"}  # q̇ is not the rate of q's numbers


@pytest.mark.parametrize("name", later(*MECHANISMS))
def test_every_kind_of_joint(name):
    model = ccpin.ReducedModel(MECHANISMS[name]())
    program = programs.record(
        model, ("sigma", "rho", "forward_dynamics", "energy"), given="near", derivatives=("q", "v")
    )
    for state, numbers, v, u in states(model, 2, spread=0.03):
        found = program(**numbers, v=v, u=u)
        assert found.status == 0
        close(found["rho"], state.rho, 1e-10)
        close(found["forward_dynamics"], state.forward_dynamics(v, u), 1e-9)
        close(found["energy"], np.array(state.energy(v)), 1e-10)
        by_q, by_v, _ = state.forward_dynamics_derivatives(v, u)
        close(found["forward_dynamics_by_q"], by_q, 1e-8)
        close(found["forward_dynamics_by_v"], by_v, 1e-8)
