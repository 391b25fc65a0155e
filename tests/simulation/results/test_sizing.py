"""What motions ask of motors and bearings, and which limits they exceed, against closed forms."""

import numpy as np
import pytest

import ccpin
from ccpin import control
from ccpin.control import PDSimpleGravity
from ccpin.errors import InvalidInputError
from ccpin.simulation import Limits, closure_forces, demands, exceeded, joint_forces
from tests.support.backends import same_on_both
from tests.support.carriage import carriage
from tests.support.paper import GOAL, K_P, K_V


@same_on_both
def test_demands_of_a_swing():
    """u = sin 2πt on 1 kg from rest: rate (1 − cos 2πt)/2π, no net work in a period, RMS √½."""
    motion = ccpin.simulate(carriage(), lambda t, q, v: [np.sin(2 * np.pi * t)], [0.0], duration=1.0)
    found = demands(carriage(), motion, bearings=False)
    assert found.motors == ("x",)
    assert found.rms_effort[0] == pytest.approx(np.sqrt(0.5), rel=1e-6)
    assert found.peak_effort[0] == pytest.approx(1.0, abs=1e-5)
    assert found.peak_speed[0] == pytest.approx(1 / np.pi, rel=1e-5)
    assert found.work[0] == pytest.approx(0.0, abs=1e-6)
    assert found.drive_work[0] == pytest.approx(0.5 / np.pi**2, rel=1e-4)  # all of ½v² at the half
    assert found.braking_work[0] == pytest.approx(-0.5 / np.pi**2, rel=1e-4)


@same_on_both
def test_demands_of_a_reference_are_those_of_its_tracking():
    """The message's own call, from 0 to 1 m in 2 s with 1 kg: |u| ≤ 10/(√3 T²), speed ≤ 15/8T, drive work ½v²."""
    model = ccpin.ReducedModel(carriage())
    reference, K_p, K_v = control.PointToPoint(model, [0.0], [1.0], 2.0), [100.0], [20.0]
    with pytest.raises(InvalidInputError, match="trajectory is a reference") as told:
        demands(model, reference)
    start, call = reference.at(0.0), str(told.value).partition("reference.at(0.0): ")[2]
    names = {"ccpin": ccpin, "control": control, "model": model, "reference": reference, "start": start}
    found = demands(model, eval(call, names | {"K_p": K_p, "K_v": K_v}), bearings=False)
    assert found.peak_effort[0] == pytest.approx(10.0 / (np.sqrt(3.0) * 4.0), rel=1e-4)
    assert found.peak_speed[0] == pytest.approx(15.0 / 16.0, rel=1e-4)
    assert found.drive_work[0] == pytest.approx(0.5 * (15.0 / 16.0) ** 2, rel=1e-3)


def test_work_is_the_energy_gained():
    """Over a move without friction the motors' work is what energy and dampers have taken up, gears included."""
    model = ccpin.ReducedModel(ccpin.load("rpdr", motors={"joint1": {"gear": 3.0}}))
    law = PDSimpleGravity(model, GOAL, K_P, K_V)
    motion = ccpin.simulate(model, law, np.radians([-150.0, -160.0]), duration=0.2, friction={}, sample_period=1e-4)
    first, last = (sum(model.at(motion.q[k], motion.q_free[k]).energy(motion.v[k])) for k in (0, -1))
    found = demands(model, motion, bearings=False)
    assert found.work.sum() == pytest.approx(last - first, rel=1e-4)
    assert found.bearings == ()


def test_bearings():
    """The peaks are those of closures and joints, and stand by name in the plain numbers."""
    model = ccpin.ReducedModel(ccpin.load("four_bar"))
    motion = ccpin.simulate(model, None, model.alpha(model.mechanism.q_reference), duration=0.05, sample_period=5e-3)
    found = demands(model, motion)
    loads = (*closure_forces(model, motion), *joint_forces(model, motion))
    assert found.bearings == tuple(load.peak() for load in loads)
    numbers = found.as_json()
    assert numbers[f"force_{loads[0].name}"] == loads[0].peak().force
    assert numbers["peak_power"] == [0.0]


def test_limits_exceeded_are_told():
    """2 m/s through a limit at 0.1 m under 7 N of 5, at more than 1.5 m/s: all three, with time and extreme."""
    model = carriage(lower=-1.0, upper=0.1, velocity=1.5, effort=5.0)
    options = {"duration": 0.2, "limits": Limits(effort="ignore"), "sample_period": 0.01}
    motion = ccpin.simulate(model, lambda t, q, v: [-7.0], [0.0], [2.0], **options)
    position, velocity, effort = exceeded(model, motion)
    assert (position.joint, position.quantity, position.limit) == ("x", "position", 0.1)
    assert position.since == pytest.approx(0.06)
    assert (velocity.quantity, velocity.limit, velocity.extreme, velocity.since) == ("velocity", 1.5, 2.0, 0.0)
    assert (effort.quantity, effort.limit, effort.extreme) == ("effort", -5.0, -7.0)
    assert exceeded(model, ccpin.simulate(model, None, [0.0], [0.1], duration=0.1)) == ()
