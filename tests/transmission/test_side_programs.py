"""The maps to the motors and back, in Python and in C, beside the postures' own and closed forms."""

from functools import cache

import numpy as np
import pytest

from ccpin.programs import Program
from ccpin.programs.program import windows
from ccpin.transmission.side_programs import side_program
from tests.support.exported import exported, self_tested
from tests.support.linkage_models import FORMS, transmission_of

each = pytest.mark.parametrize("name", ["ankle", "knee", "neck"])


@cache
def program(name, to):
    return side_program(transmission_of(name), to)


def states(found, count, rng):
    """Inputs near closed configurations, q a millisecond away from where y was."""
    rows = np.array([found.example, *found.around])
    rows = rows[rng.integers(len(rows), size=count)]
    q, _, v, u = windows(found.inputs)
    rows[:, q] += rng.uniform(-1e-3, 1e-3, rows[:, q].shape)
    rows[:, v] = 3.0 * rng.normal(size=rows[:, v].shape)
    rows[:, u] = 20.0 * rng.normal(size=rows[:, u].shape)
    return rows


def answers(found, rows):
    parts = {port.name: rows[:, window] for port, window in zip(found.inputs, windows(found.inputs), strict=True)}
    return parts, found(**parts)


@each
def test_it_is_the_postures_own_map(name):
    """q_m, J q̇, J⁻ᵀτ of `Transmission.at`, and of closed forms."""
    found, rng = program(name, "motors"), np.random.default_rng(1)
    given, told = answers(found, states(found, 12, rng))
    for k in range(12):
        posture = transmission_of(name).at(given["q"][k])
        v, u = given["v"][k], given["u"][k]
        np.testing.assert_allclose(told["q_motors"][k], posture.q_motor, rtol=0, atol=1e-9)
        np.testing.assert_allclose(told["v_motors"][k], posture.motor_velocity(v), rtol=0, atol=1e-7)
        np.testing.assert_allclose(told["u_motors"][k], posture.motor_effort(u), rtol=0, atol=1e-7)
        np.testing.assert_allclose(told["q_motors"][k], FORMS[name].motors(given["q"][k]), rtol=0, atol=1e-9)


@each
def test_there_and_back(name):
    """Joints → motors → joints; power goes through; from where it was, as a loop at a kilohertz asks."""
    there, back = program(name, "motors"), program(name, "joints")
    n = transmission_of(name).n
    y, y_back = (np.array(found.example[n : n + found.inputs[1].size]) for found in (there, back))
    start, rng = np.array(there.example[:n]), np.random.default_rng(2)
    for part in np.linspace(0.0, 1.0, 60):
        q, v, u = start + 0.2 * part, rng.normal(size=n), rng.normal(size=n)
        out = there(q=q, y=y, v=v, u=u)
        home = back(q=out["q_motors"], y=y_back, v=out["v_motors"], u=out["u_motors"])
        assert (out.status, home.status) == (0, 0)
        assert out["u_motors"] @ out["v_motors"] == pytest.approx(u @ v, abs=1e-12)
        for key, value in (("q", q), ("v", v), ("u", u)):
            np.testing.assert_allclose(home[f"{key}_joints"], value, rtol=0, atol=1e-10)
        y, y_back = out["sigma"], home["sigma"]


@pytest.mark.parametrize(
    ("name", "to"),
    [("ankle", "joints"), ("knee", "motors"), ("neck", "joints")]
    + [
        pytest.param(*case, marks=pytest.mark.slow)
        for case in (("ankle", "motors"), ("knee", "joints"), ("neck", "motors"))
    ],
)
def test_c_is_python(name, to, tmp_path):
    """Compiled with every warning an error, over 10,000 states; the test that goes with it says the same."""
    found = program(name, to)
    rows = states(found, 10_000, np.random.default_rng(3))
    out, status = exported(found, tmp_path)(rows)
    _, told = answers(found, rows)
    assert (status == told.status).all()
    assert (status == 0).mean() > 0.99
    good = status == 0
    for port, window in zip(found.outputs, windows(found.outputs), strict=True):
        scale = max(1.0, np.abs(told[port.name][good]).max())
        np.testing.assert_allclose(out[good][:, window], told[port.name][good], rtol=0, atol=1e-12 * scale)


def test_what_is_written_runs_alone(tmp_path):
    """The exported test in single precision, and the program read again; the header says units and a start."""
    found = program("ankle", "motors")
    assert "0 of " in self_tested(found, tmp_path, "float")
    found.save(tmp_path / "map.json")
    again = Program.load(tmp_path / "map.json")
    assert again.digest == found.digest
    text = (tmp_path / "ankle_to_motors.h").read_text(encoding="utf-8")
    assert "out u_motors[2], N m: left_motor, right_motor" in text
    y = found.example[2:10]
    assert f"a configuration to start from: q = [0.0, 0.0], y = {[float(value) for value in y]}" in text
