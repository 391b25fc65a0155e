"""Runs with stops, contacts, saturated and lagging motors and disturbances, against closed forms."""

import numpy as np
import pytest
from scipy.optimize import brentq

import ccpin
from ccpin import Simulator
from ccpin.control import Measurement, PDSimpleGravity, Sampling
from ccpin.errors import InvalidInputError
from ccpin.simulation import Contact, Disturbance, Limits, MotorModel, Push
from ccpin.simulation.integration.run import Run
from tests.support.agreement import reference_model
from tests.support.backends import same_on_both
from tests.support.carriage import carriage

TIGHT = {"rtol": 1e-11, "atol": 1e-13}
STOP = {"position": "stop", "stiffness": 1e4}


def names(motion):
    return [event.name for event in motion.events]


# Stops.


def test_a_mass_bounces_off_a_lossless_stop():
    """It meets the stop at d/v, sinks v√(m/k) deep, leaves π√(m/k) later at the speed it came with."""
    model = carriage(upper=0.1, lower=-1.0)
    motion = ccpin.simulate(model, None, [0.0], [2.0], duration=0.12, limits=Limits(**STOP, dissipation=0.0), **TIGHT)
    assert names(motion) == ["x at its upper limit: met", "x at its upper limit: left"]
    assert motion.events[0].t == pytest.approx(0.05, abs=1e-10)
    assert motion.events[1].t - motion.events[0].t == pytest.approx(np.pi / 100, abs=1e-10)
    assert motion.v[-1] == pytest.approx(-2.0, abs=1e-9)
    inside = (motion.t > 0.05) & (motion.t < 0.05 + np.pi / 100)
    sunk = 0.1 + 0.02 * np.sin(100 * (motion.t[inside] - 0.05))
    np.testing.assert_allclose(motion.q[inside, 0], sunk, rtol=0, atol=1e-10)


def test_a_stop_takes_what_its_dissipation_says():
    """The speed after is that of c w + ln(1 − c w) = ln(1 + c v) − c v, whatever k."""
    c, v = 0.4, 1.5
    w = brentq(lambda w: c * w + np.log(1 - c * w) - np.log(1 + c * v) + c * v, 0.0, v)
    for k in (1e3, 1e5):
        limits = Limits(position="stop", stiffness=k, dissipation=c)
        options = {"duration": 0.3, "sample_period": 0.3, "limits": limits}
        motion = ccpin.simulate(carriage(upper=0.1, lower=-1.0), None, [0.0], [v], **options, **TIGHT)
        assert motion.v[-1] == pytest.approx(-w, rel=1e-8)


def test_the_default_stop_needs_no_numbers():
    """Half a period of 50 Hz, and it gives back less than it took."""
    motion = ccpin.simulate(
        carriage(upper=0.1, lower=-1.0), None, [0.0], [1.0], duration=0.2, limits=Limits(position="stop")
    )
    met, left = (event.t for event in motion.events)
    assert left - met == pytest.approx(0.01, rel=0.1)
    assert -1.0 < motion.v[-1] < -0.5


@same_on_both
def test_energy_in_a_loop_with_stops():
    """The crank swings, its slider (a dependent joint) hits the stop again and again: energy stays to the tolerance."""
    bounds = {"slider": {"lower": 0.09, "upper": 0.15}}
    model = ccpin.ReducedModel(ccpin.load("slider_crank", joints=bounds))
    limits = Limits(position="stop", stiffness=2e3, dissipation=0.0)
    motion = ccpin.simulate(model, None, [0.6], duration=1.0, sample_period=3e-3, limits=limits, friction={}, **TIGHT)
    slider = model.mechanism.tree.joint("slider")
    place = motion.q_free[:, slider.q.start]
    beyond = np.maximum(0.0, 0.09 - place) - np.maximum(0.0, place - 0.15)
    stored = 0.5 * 2e3 * beyond**2
    energies = [sum(state.energy(v)) for state, v, _ in motion.states(model)]
    assert names(motion).count("slider at its upper limit: met") >= 3
    assert stored.max() > 1e-3
    np.testing.assert_allclose(energies + stored, energies[0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(motion.limits[:, slider.v.start], 2e3 * beyond, rtol=0, atol=1e-9)


def test_the_motion_may_end_at_a_limit():
    """With position = "end" it stops where a limit is reached, to the integrator's tolerance."""
    limits = Limits(position="end")
    motion = ccpin.simulate(carriage(upper=0.1, lower=-1.0), None, [0.0], [2.0], duration=1.0, limits=limits)
    assert (motion.status, names(motion)) == ("event", ["x at its upper limit"])
    assert motion.t[-1] == pytest.approx(0.05, abs=1e-10)
    beyond = ccpin.simulate(carriage(upper=0.1, lower=-1.0), None, [0.2], [1.0], duration=1.0, limits=limits)
    assert (beyond.status, beyond.t[-1]) == ("event", 0.0)


@pytest.mark.slow
@same_on_both
def test_sampling_does_not_change_when_a_stop_is_met():
    """Events and the end are the same with another sample period."""
    runs = [
        ccpin.simulate(
            carriage(upper=0.1, lower=-0.1), None, [0.0], [3.0], duration=1.0, limits=Limits(**STOP), sample_period=p
        )
        for p in (1e-3, 0.5)
    ]
    assert [event.t for event in runs[0].events] == [event.t for event in runs[1].events]
    assert runs[0].q[-1] == runs[1].q[-1]


# Contacts.


@same_on_both
def test_a_dropped_mass_comes_to_rest_at_its_weight():
    """k δ = m g in the end, and the contact carries the weight."""
    model = carriage("z", (0.0, 0.0, -9.81))
    floor = Contact("carriage", stiffness=1e4, dissipation=20.0)
    motion = ccpin.simulate(model, None, [0.05], duration=0.6, sample_period=0.05, contacts=[floor])
    assert names(motion)[0] == "'carriage' on the plane: met"
    assert motion.events[0].t == pytest.approx(np.sqrt(2 * 0.05 / 9.81), abs=1e-9)
    assert motion.q[-1] == pytest.approx(-9.81 / 1e4, rel=1e-3)
    z = model.mechanism.tree.joint("z").v.start
    assert motion.limits[-1, z] == pytest.approx(9.81, rel=1e-2)


@same_on_both
def test_a_sliding_mass_stops_by_friction():
    """Thrown at v₀ along the floor it loses μ g t, and stays after v₀²/(2 μ g) but for a creep of v_s."""
    model = carriage("xz", (0.0, 0.0, -9.81))
    floor = Contact("carriage", stiffness=1e5, dissipation=5.0, friction=0.5, slip=1e-4)
    rest = -9.81 / 1e5
    options = {"duration": 0.5, "sample_period": 0.01, "method": "Radau"}
    motion = ccpin.simulate(model, None, [0.0, rest], [1.0, 0.0], contacts=[floor], **options)
    sliding = motion.t < 0.9 / (0.5 * 9.81)
    np.testing.assert_allclose(motion.v[sliding, 0], 1 - 0.5 * 9.81 * motion.t[sliding], rtol=0, atol=1e-6)
    assert motion.q[-1, 0] == pytest.approx(1 / (2 * 0.5 * 9.81), abs=1e-4)
    assert motion.q[-1, 1] == pytest.approx(rest, abs=1e-9)


def test_contacts_carry_what_closures_feel():
    """λ and the joints' forces along a motion in contact are those of the same motion pushed by wrenches."""
    model = ccpin.ReducedModel(ccpin.load("four_bar"))
    tool = ccpin.EndEffector(model, "rocker")
    height = float(tool.pose(model.at(model.alpha(model.mechanism.q_reference)))[2, 3])
    floor = Contact("coupler", height=height + 0.02, stiffness=2e3)
    motion = ccpin.simulate(model, None, model.alpha(model.mechanism.q_reference), duration=0.3, contacts=[floor])
    assert motion.limits.any()
    for state, v, u, a, loads in zip(*zip(*motion.states(model), strict=True), motion.a, motion.limits, strict=True):
        expected = state.forward_dynamics(v, u) + np.linalg.solve(state.D, state.rho.T @ loads)
        np.testing.assert_allclose(a, expected, rtol=1e-10, atol=1e-10)


# Efforts and speeds.


@same_on_both
def test_motors_saturate_by_default():
    """Stewart's platform asked for ten times what its legs can give moves as under the law cut off by hand."""
    model = ccpin.ReducedModel(ccpin.load("stewart"))
    q0 = model.alpha(model.mechanism.q_reference)
    law = PDSimpleGravity(model, q0 + 0.05, np.full(6, 4e5), np.full(6, 4e3))
    motion = ccpin.simulate(model, law, q0, duration=0.05, rtol=1e-8)
    assert np.abs(law.torque(0.0, Measurement(q0), np.zeros(6))).max() > 2e4
    assert np.abs(motion.u).max() == 2000.0
    assert any("saturated" in event.name or "within" in event.name for event in motion.events)

    def cut(t, q, v):
        return np.clip(law.torque(t, Measurement(q), v), -2000.0, 2000.0)

    by_hand = ccpin.simulate(model, cut, q0, duration=0.05, rtol=1e-8, limits=Limits(effort="ignore"))
    np.testing.assert_allclose(motion.q, by_hand.q, rtol=0, atol=1e-7)
    free = ccpin.simulate(model, law, q0, duration=0.05, rtol=1e-8, limits=Limits(effort="ignore"))
    assert np.abs(free.u).max() > 2e4
    ended = ccpin.simulate(model, law, q0, duration=0.05, rtol=1e-8, limits=Limits(effort="end"))
    assert (ended.status, ended.t[-1]) == ("event", 0.0)
    assert "asked for more than it can give" in ended.message


def test_saturation_is_found_to_the_integrators_tolerance():
    """u = 20 − 200 x on 1 kg within ±5 N: it leaves its bound at x = 0.075, reached at √(2x/5)."""
    model = carriage(effort=5.0)
    motion = ccpin.simulate(model, lambda t, q, v: 20 - 200 * q, [0.0], duration=0.2, **TIGHT)
    assert names(motion)[0] == "motor of 'x': within its limits"
    assert motion.events[0].t == pytest.approx(np.sqrt(2 * 0.075 / 5), abs=1e-9)


@pytest.mark.parametrize("backend", ["core", "numpy"])
def test_steps_beyond_the_limits_are_steps_at_them(backend, monkeypatch):
    """Commands of 3, 8, −9, −7 and 1 N to a motor of 5 N: 1 kg by the closed forms; u and events say what was cut off.

    None of it needs the reference where there is a core.
    """
    model = carriage(effort=5.0)
    if backend == "numpy":
        model = reference_model(model.mechanism, model.gravity_vector)
    elif ccpin.backend().name == "native":
        monkeypatch.setattr(Run, "advance", lambda *arguments, **options: pytest.fail("the core gave up"))
    simulator = Simulator(model)
    simulator.reset([0.0])
    x = v = 0.0
    for command, given in ((3.0, 3.0), (8.0, 5.0), (-9.0, -5.0), (-7.0, -5.0), (1.0, 1.0)):
        sample = simulator.step([command], 0.01)
        x, v = x + 0.01 * v + 0.5 * given * 1e-4, v + given * 0.01
        assert (sample.q[0], sample.v[0], sample.a[0]) == pytest.approx((x, v, given), abs=1e-12)
        assert sample.u[0] == given
    assert [(event.name, round(event.t, 9)) for event in simulator.events] == [
        ("motor of 'x': saturated", 0.01),
        ("motor of 'x': within its limits", 0.04),
    ]
    assert simulator.events[1].q[0] == pytest.approx(x - 0.01 * v + 0.5e-4, abs=1e-12)
    monkeypatch.undo()
    for wrong in ([np.nan], [np.inf], [1.0, 2.0], 1.0, "1"):
        with pytest.raises(InvalidInputError):
            simulator.step(wrong, 0.01)
    assert simulator.t == pytest.approx(0.05, abs=1e-15)


def test_an_effort_of_zero_is_no_limit():
    """Exporters write effort="0" where they know none."""
    model = carriage(effort=0.0)
    assert np.isinf(model.mechanism.motors.limits).all()
    motion = ccpin.simulate(model, lambda t, q, v: [3.0], [0.0], duration=0.1)
    assert motion.v[-1] == pytest.approx(0.3)


def test_a_motor_at_its_speed_pushes_no_further():
    """Over the last 5 % of 2 m/s the effort of 5 N fades out: v = 2 − 0.1 e^{−50 (t − t₁)} from t₁ = 0.38 s on."""
    model = carriage(effort=5.0, velocity=2.0)
    limits = Limits(velocity="saturate")
    motion = ccpin.simulate(
        model, lambda t, q, v: [50.0], [0.0], duration=0.6, sample_period=0.01, limits=limits, **TIGHT
    )
    late = motion.t > 0.38
    expected = np.where(late, 2 - 0.1 * np.exp(-50 * (motion.t - 0.38)), 5 * motion.t)
    np.testing.assert_allclose(motion.v[:, 0], expected, rtol=0, atol=1e-9)
    assert [event.t for event in motion.events if "speed" in event.name] == [pytest.approx(0.38, abs=1e-9)]
    ended = ccpin.simulate(model, lambda t, q, v: [50.0], [0.0], duration=0.6, limits=Limits(velocity="end"))
    assert (ended.status, ended.t[-1]) == ("event", pytest.approx(0.4, abs=1e-10))


# Motors.


@same_on_both
def test_a_dc_motor_runs_up():
    """5 (1 − v/20) N on 1 kg: v = 20 (1 − e^{−t/4})."""
    motors = MotorModel(speeds=(0.0, 20.0), efforts=(5.0, 0.0))
    motion = ccpin.simulate(
        carriage(), lambda t, q, v: [1e3], [0.0], duration=2.0, sample_period=0.02, motors=motors, **TIGHT
    )
    np.testing.assert_allclose(motion.v[:, 0], 20 * (1 - np.exp(-motion.t / 4)), rtol=0, atol=1e-9)
    np.testing.assert_allclose(motion.u, 5 * (1 - motion.v / 20), rtol=0, atol=1e-9)


def test_a_held_command_through_a_lag():
    """u = 2 (1 − e^{−t/τ}) on 1 kg: v = 2 (t − τ + τ e^{−t/τ})."""
    motion = ccpin.simulate(
        *(carriage(), lambda t, q, v: [2.0], [0.0]),
        duration=0.1,
        motors=MotorModel(lag=0.02),
        sampling=Sampling(5e-3),
        **TIGHT,
    )
    t = motion.t
    np.testing.assert_allclose(motion.u[:, 0], 2 * (1 - np.exp(-t / 0.02)), rtol=0, atol=1e-12)
    np.testing.assert_allclose(motion.v[:, 0], 2 * (t - 0.02 + 0.02 * np.exp(-t / 0.02)), rtol=0, atol=1e-10)


def test_a_held_command_through_a_rate():
    """u = 10 t up to 2, then 2: v = 5 t², then 0.2 + 2 (t − 0.2); step by step as in one."""
    simulator = Simulator(carriage(), motors=MotorModel(rate=10.0), **TIGHT)
    simulator.reset([0.0])
    for k in range(1, 41):
        sample = simulator.step([2.0], 0.01)
        t = 0.01 * k
        assert sample.v[0] == pytest.approx(5 * t**2 if t < 0.2 else 0.2 + 2 * (t - 0.2), abs=1e-10)


def test_a_lag_needs_held_commands():
    """A continuous law and a lag are refused together."""
    with pytest.raises(InvalidInputError, match="sampling="):
        ccpin.simulate(carriage(), lambda t, q, v: [1.0], [0.0], duration=0.1, motors=MotorModel(lag=0.01))


def test_memory_holds_the_current_loops():
    """A simulator taken up from another's memory goes on to the last bit."""
    options = {"motors": MotorModel(lag=0.02, rate=50.0), "sampling": Sampling(4e-3, delay=1)}
    one, two = (Simulator(carriage(), lambda t, q, v: 3 - 5 * q - v, **options) for _ in range(2))
    one.reset([0.0])
    one.advance(0.031)
    two.recall(one.memory())
    assert [a.tolist() for a in one.advance(0.1)[1:5]] == [b.tolist() for b in two.advance(0.1)[1:5]]


# Disturbances.


def test_a_push_gives_its_impulse():
    """10 N for 50 ms on 1 kg at rest: 0.5 m/s, however long the integrator's steps would like to be."""
    shove = Disturbance([Push({"carriage": [10.0, 0, 0, 0, 0, 0]}, 0.3, 0.35)])
    motion = ccpin.simulate(carriage(), None, [0.0], duration=1.0, wrenches=shove, sample_period=0.5)
    assert motion.v[-1] == pytest.approx(0.5, abs=1e-13)
    assert motion.q[-1] == pytest.approx(0.5 * 0.025 + 0.5 * 0.65, abs=1e-13)
    assert motion.evaluations < 200  # no step feels the push before it comes or after it has gone


def test_a_mass_rebounds_from_a_plane_as_from_a_stop():
    """Thrown at a plane it leaves at the speed of c w + ln(1 − c w) = ln(1 + c v) − c v."""
    c, v = 0.3, 1.2
    w = brentq(lambda w: c * w + np.log(1 - c * w) - np.log(1 + c * v) + c * v, 0.0, v)
    floor = Contact("carriage", stiffness=2e4, dissipation=c)
    motion = ccpin.simulate(carriage("z"), None, [0.02], [-v], duration=0.1, contacts=[floor], **TIGHT)
    assert names(motion) == ["'carriage' on the plane: met", "'carriage' on the plane: left"]
    assert motion.events[0].t == pytest.approx(0.02 / v, abs=1e-10)
    assert motion.v[-1] == pytest.approx(w, rel=1e-8)


def test_a_joint_that_rests_at_a_stop():
    """Pushed into a stop against 3 N of Coulomb friction a mass halts, and the stop carries what friction does not."""
    model = carriage(upper=0.1, lower=-1.0)
    limits = Limits(position="stop", stiffness=1e4, dissipation=20.0)
    motion = ccpin.simulate(
        *(model, lambda t, q, v: [10.0], [0.09]),
        **{"duration": 0.5, "sample_period": 0.1, "limits": limits, "friction": {"x": (3.0, 0.0)}},
    )
    assert motion.v[-1] == 0.0
    x = model.mechanism.tree.joint("x").v.start
    pushed = 1e4 * (motion.q[-1, 0] - 0.1)
    assert 7.0 <= pushed <= 13.0 * (1 + 1e-8)  # friction balances up to its level, to 1e-8 of it
    assert motion.limits[-1, x] == pytest.approx(-pushed, rel=1e-12)
    assert motion.friction[-1, x] == pytest.approx(pushed - 10.0, rel=1e-9)
