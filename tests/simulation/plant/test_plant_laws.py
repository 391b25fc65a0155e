"""Stops, contacts, motors and disturbances by themselves: forces, potentials, responses in closed form."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import ccpin
from ccpin.dynamics import Wrench
from ccpin.errors import InvalidInputError
from ccpin.simulation.plant.contact import Contact, ContactForces
from ccpin.simulation.plant.disturbances import Disturbance, Push
from ccpin.simulation.plant.limits import Limits, Saturation, Stops
from ccpin.simulation.plant.motors import CurrentLoops, MotorModel, TorqueSpeed
from tests.oracles.finite_differences import derivative


@pytest.fixture(scope="module")
def model():
    """The slider-crank, its slider allowed −1 cm to 13 cm."""
    bounds = {"slider": {"lower": -0.01, "upper": 0.13}, "crank": {"effort": 5.0, "velocity": 60.0}}
    return ccpin.ReducedModel(ccpin.load("slider_crank", joints=bounds))


def somewhere(model, angle):
    """The State at a crank angle."""
    return model.at([angle], model.mechanism.q_reference)


# Stops.


def test_a_stop_pushes_back_by_its_law(model):
    """f = −kδ(1 + cδ̇) on the slider beyond its limit, nothing within."""
    stops = Stops(model, Limits(position="stop", stiffness={"slider": 2e4}, dissipation=0.3))
    slider = model.mechanism.tree.joint("slider")
    inside, beyond, v = somewhere(model, 1.2), somewhere(model, 0.5), np.array([-2.0])
    assert not stops.loads(0.0, inside, v).any()
    depth = beyond.q_free[slider.q.start] - 0.13
    rate = beyond.v_free(v)[slider.v.start]
    assert depth > 0
    assert rate > 0
    loads = stops.loads(0.0, beyond, v)
    assert loads[slider.v.start] == pytest.approx(-2e4 * depth * (1 + 0.3 * rate), rel=1e-12)
    assert np.count_nonzero(loads) == 1
    assert stops.potential(beyond) == pytest.approx(0.5 * 2e4 * depth**2, rel=1e-12)


def test_stops_have_the_potential_they_state(model):
    """At rest ρᵀf = −∂V/∂q, by finite differences."""
    stops = Stops(model, Limits(position="stop", stiffness=1e4))
    here = somewhere(model, 0.5)
    force = here.rho.T @ stops.loads(0.0, here, np.zeros(1))
    slope = derivative(lambda s: stops.potential(somewhere(model, 0.5 + s)))
    assert force[0] == pytest.approx(-slope, rel=1e-8)


def test_stops_never_pull(model):
    """A joint that leaves its stop fast is let go, not held."""
    stops = Stops(model, Limits(position="stop", dissipation=5.0))
    slider = model.mechanism.tree.joint("slider")
    for speed in np.linspace(-100, 100, 9):
        assert stops.loads(0.0, somewhere(model, 0.5), np.array([speed]))[slider.v.start] <= 0


def test_the_default_stop_takes_ten_milliseconds(model):
    """k = (2π 50 Hz)² times the inertia the joint feels: 1/(ρ D⁻¹ ρᵀ) at the reference."""
    here = model.at(model.alpha(model.mechanism.q_reference))
    slider = model.mechanism.tree.joint("slider")
    felt = here.D[0, 0] / here.rho[slider.v.start, 0] ** 2
    stops, beyond = Stops(model, Limits(position="stop")), somewhere(model, 0.5)
    depth = beyond.q_free[slider.q.start] - 0.13
    assert stops.potential(beyond) == pytest.approx(0.5 * (100 * np.pi) ** 2 * felt * depth**2, rel=1e-9)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"position": "bounce"}, "position 'bounce'"),
        ({"effort": None}, "effort None"),
        ({"stiffness": -1.0}, "stiffness = -1.0"),
        ({"stiffness": {"slider": "hard"}}, "slider = 'hard'"),
        ({"dissipation": np.nan}, "dissipation = nan"),
    ],
)
def test_bad_limits(options, words):
    """Unknown words and impossible numbers are named."""
    with pytest.raises(InvalidInputError, match=words):
        Limits(**options)


def test_stiffness_of_no_stop(model):
    """A stiffness for a joint without limits is a mistake."""
    with pytest.raises(InvalidInputError, match="'sledge' has no stop"):
        Stops(model, Limits(stiffness={"sledge": 1.0}))


# Saturation.


def test_bounds_of_efforts(model):
    """u within the motors' limits; with `velocity` they fade out over the last 5 % of the speed."""
    here = somewhere(model, 1.2)
    assert Saturation(model, Limits()).bounds(here, np.array([59.9])) == (-5.0, 5.0)
    fading = Saturation(model, Limits(velocity="saturate"))
    for speed, upper, lower in ((0.0, 5.0, -5.0), (57.0, 5.0, -5.0), (58.5, 2.5, -5.0), (61.0, 0.0, -5.0)):
        assert np.ravel(fading.bounds(here, np.array([speed]))) == pytest.approx([lower, upper])
        assert np.ravel(fading.bounds(here, np.array([-speed]))) == pytest.approx([-upper, -lower])
    assert not Saturation(model, Limits(effort="ignore")).acts


def test_a_speed_limit_needs_an_effort_to_fade():
    """Without a limit of effort there is nothing that could fade out."""
    free = ccpin.ReducedModel(ccpin.load("slider_crank", joints={"crank": {"effort": np.inf}}))
    with pytest.raises(InvalidInputError, match="motor of 'crank'"):
        Saturation(free, Limits(velocity="saturate"))


# Contacts.


def test_a_contact_by_its_law(model):
    """F = kδ(1 + cδ̇)(n − μ v_t/√(v_t² + v_s²)) on the rod's end below a plane, and Jᵀ F on the joints."""
    floor = Contact("rod", (0.12, 0.0, 0.0), 3e4, 0.2, 0.6, 1e-3, normal=(0.0, 0.0, 2.0), height=0.0)
    contacts, here, v = ContactForces(model, [floor]), somewhere(model, 1.2), np.array([-3.0])
    tool = ccpin.EndEffector(model, "rod", (0.12, 0.0, 0.0))
    depth, velocity = -tool.pose(here)[2, 3], tool.velocity(here, v)[:3]
    assert depth > 0
    push = 3e4 * depth * (1 - 0.2 * velocity[2])
    sliding = velocity * [1.0, 1.0, 0.0]
    expected = push * (np.array([0, 0, 1.0]) - 0.6 * sliding / np.sqrt(sliding @ sliding + 1e-6))
    np.testing.assert_allclose(contacts.forces(0.0, here, v)[0], expected, rtol=1e-12)
    loads = here.joint_loads({"rod": Wrench(expected, point=(0.12, 0.0, 0.0))})
    np.testing.assert_allclose(contacts.loads(0.0, here, v), loads, rtol=1e-10, atol=1e-12)


def test_contacts_have_the_potential_they_state(model):
    """At rest and without friction ρᵀJᵀF = −∂V/∂q."""
    contacts = ContactForces(model, [Contact("rod", (0.05, 0.0, 0.0), normal=(0.0, 0.3, 1.0), height=0.01)])
    here = somewhere(model, 0.2)
    force = here.rho.T @ contacts.loads(0.0, here, np.zeros(1))
    assert force[0] != 0
    slope = derivative(lambda s: contacts.potential(somewhere(model, 0.2 + s)))
    assert force[0] == pytest.approx(-slope, rel=1e-7)


@pytest.mark.parametrize(
    ("contact", "words"),
    [
        (lambda: Contact("rod", stiffness=0.0), "stiffness = 0.0"),
        (lambda: Contact("rod", friction=-0.1), "friction = -0.1"),
        (lambda: Contact("rod", normal=(0.0, 0.0, 0.0)), "normal has no length"),
    ],
)
def test_bad_contacts(contact, words):
    """Impossible numbers are named."""
    with pytest.raises(InvalidInputError, match=words):
        contact()


def test_contacts_of_no_link(model):
    """An unknown or fixed link has no contact."""
    for link, words in (("foot", "no link 'foot'"), ("base", "fixed to the world")):
        with pytest.raises(InvalidInputError, match=words):
            ContactForces(model, [Contact(link)])


# Motors.


@pytest.mark.parametrize(("lag", "rate"), [(0.01, np.inf), (0.01, 60.0), (0.0, 20.0), (0.004, 300.0)])
def test_current_loops_solve_their_equation(lag, rate):
    """u̇ = clip((c − u)/τ, ±r) under a row of commands, against an integration of just that."""
    loops, u, t = CurrentLoops(MotorModel(lag=lag, rate=rate), 1), 0.0, 0.0
    stiff = lag or 1e-5
    for command in (2.0, -1.0, -0.9, 3.0):
        loops.command(t, np.array([command]))

        def rhs(t, u, command=command):
            return np.clip((command - u) / stiff, -rate, rate)

        times = t + np.linspace(0, 0.03, 7)
        exact = solve_ivp(rhs, (t, t + 0.03), [u], "Radau", times, rtol=1e-10, atol=1e-12)
        found = [loops.effort(time)[0] for time in times]
        np.testing.assert_allclose(found, exact.y[0], rtol=0, atol=1e-8 if lag else 2 * rate * stiff)
        t, u = times[-1], exact.y[0, -1] if lag else found[-1]


def test_a_pulse_through_a_lag():
    """A pulse of length T leaves 1 − e^{−T/τ} of itself behind, which then decays."""
    loops = CurrentLoops(MotorModel(lag=0.02), 2)
    loops.command(1.0, np.array([3.0, 0.0]))
    loops.command(1.05, np.zeros(2))
    top = 3 * (1 - np.exp(-2.5))
    np.testing.assert_allclose(loops.effort(1.05), [top, 0], rtol=0, atol=1e-14)
    np.testing.assert_allclose(loops.effort(1.09), [top * np.exp(-2), 0], rtol=0, atol=1e-14)


def test_ramps_end_at_switching_times():
    """|c − u| = rτ is reached after (|c − u₀| − rτ)/r; there is nothing to switch after that."""
    loops = CurrentLoops(MotorModel(lag=(0.1, 0.1), rate=(10.0, 100.0)), 2)
    loops.command(2.0, np.array([4.0, 4.0]))
    assert loops.next_switch(2.0) == pytest.approx(2.3)
    assert loops.next_switch(2.3 + 1e-9) == np.inf


def test_loops_without_lag_and_rate_do_nothing():
    """u = c from the moment of the command on."""
    loops = CurrentLoops(MotorModel(), 1)
    loops.command(0.5, np.array([7.0]))
    assert loops.effort(0.5) == loops.effort(0.6) == 7.0


def test_loops_go_on_where_they_were():
    """What is remembered is all there is."""
    one, two = (CurrentLoops(MotorModel(lag=0.02, rate=90.0), 1) for _ in range(2))
    one.command(0.0, np.array([5.0]))
    two.recall(one.memory())
    assert two.effort(0.013) == one.effort(0.013)


def test_torque_speed_curve(model):
    """A DC motor drives with 5 (1 − ω/20) and brakes with 5, whichever way its gear turns."""
    curve = TorqueSpeed(model, MotorModel(speeds=(0.0, 20.0), efforts=(5.0, 0.0)))
    here = somewhere(model, 1.2)
    assert np.ravel(curve.bounds(here, np.array([8.0]))) == pytest.approx([-5.0, 3.0])
    assert np.ravel(curve.bounds(here, np.array([-8.0]))) == pytest.approx([-3.0, 5.0])
    assert np.ravel(curve.bounds(here, np.array([50.0]))) == pytest.approx([-5.0, 0.0])
    turned = ccpin.ReducedModel(ccpin.load("slider_crank", motors={"crank": {"gear": -3.0}}))
    curve = TorqueSpeed(turned, MotorModel(speeds=(0.0, 20.0), efforts=(5.0, 0.0)))
    assert np.ravel(curve.bounds(turned.at([1.2]), np.array([8.0]))) == pytest.approx([-3.0, 5.0])


@pytest.mark.parametrize(
    "options", [{"lag": -0.1}, {"rate": 0.0}, {"speeds": (0.0, 1.0)}, {"speeds": (1.0, 2.0), "efforts": (1.0, 1.0)}]
)
def test_bad_motors(options):
    """Impossible numbers are named."""
    with pytest.raises(InvalidInputError, match=f"motors: {next(iter(options))}"):
        MotorModel(**options)


# Disturbances.


def test_pushes_come_and_go(model):
    """Wrenches act between their times, and the times are known in advance."""
    shove = Disturbance([Push({"rod": [1.0, 0, 0, 0, 0, 0]}, 0.1, 0.2), Push({"rod": [0, 0, 2.0, 0, 0, 0]}, 0.15)])
    here, v = somewhere(model, 1.2), np.zeros(1)
    assert shove(0.05, here, v) is None
    np.testing.assert_array_equal(shove(0.1, here, v)["rod"].force, [1, 0, 0])
    np.testing.assert_array_equal(shove(0.17, here, v)["rod"].force, [1, 0, 2])
    np.testing.assert_array_equal(shove(0.2, here, v)["rod"].force, [0, 0, 2])
    assert [shove.next_switch(t) for t in (-1.0, 0.1, 0.17, 0.2)] == [0.1, 0.15, 0.2, np.inf]


def test_pushes_at_different_points_add(model):
    """Several wrenches on one link are one: the same loads on the joints as each by itself."""
    at_end, inside = Wrench([1.0, 2.0, 3.0], [0, 0.1, 0], (0.12, 0, 0)), Wrench([-2.0, 0, 1.0], point=(0.03, 0.01, 0))
    here, v = somewhere(model, 1.2), np.zeros(1)
    both = Disturbance([Push({"rod": at_end}), Push(lambda t, state, v: {"rod": inside})])(0.0, here, v)
    alone = here.joint_loads({"rod": at_end}) + here.joint_loads({"rod": inside})
    np.testing.assert_allclose(here.joint_loads(both), alone, rtol=0, atol=1e-12)


def test_a_push_must_start_before_it_ends():
    """Its times must be in order."""
    with pytest.raises(InvalidInputError, match="before it ends"):
        Push({}, 2.0, 1.0)
