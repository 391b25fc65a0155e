"""The PD laws (28) and (30) and what they refuse."""

import numpy as np
import pytest

import ccpin
from ccpin.control import Measurement, PDFullGravity, PDSimpleGravity
from ccpin.control.control_law import NoTorque
from ccpin.description import Part, combine
from ccpin.errors import InvalidInputError, UnreachableError, UnsupportedMechanismError
from tests.support.paper import GOAL, K_P, K_V


def test_simple_gravity_is_equation_28(model):
    """u = K_p q̃ − K_v q̇ + g(q_d)."""
    law = PDSimpleGravity(model, GOAL, [11.0, 9.0], K_V)
    q, v = GOAL + [0.1, -0.2], np.array([0.3, 0.4])
    expected = [11.0 * -0.1 - 0.65 * 0.3, 9.0 * 0.2 - 0.6 * 0.4] + model.terms(GOAL, v).g
    assert np.allclose(law.torque(0.0, Measurement(q), v), expected, rtol=0, atol=1e-13)


def test_full_gravity_is_equation_30(model):
    """u = K_p q̃ − K_v q̇ + g(q)."""
    law = PDFullGravity(model, GOAL, np.diag([11.0, 9.0]), K_V)
    q, v = GOAL + [0.1, -0.2], np.array([0.3, 0.4])
    expected = [11.0 * -0.1 - 0.65 * 0.3, 9.0 * 0.2 - 0.6 * 0.4] + model.terms(q, v).g
    assert np.allclose(law.torque(0.0, Measurement(q), v), expected, rtol=0, atol=1e-12)


def test_gravity_of_the_set_point_is_computed_once(model, monkeypatch):
    """The law with simple compensation calls no σ on line."""
    law = PDSimpleGravity(model, GOAL, K_P, K_V)
    monkeypatch.setattr(model.parametrization, "sigma", None)
    assert np.isfinite(law.torque(0.0, Measurement(GOAL), np.zeros(2))).all()


@pytest.mark.parametrize("law_class", [PDSimpleGravity, PDFullGravity])
def test_the_goal_is_an_equilibrium(model, law_class):
    """At rest at q_d the acceleration under either law is zero, and 𝒱 is zero."""
    law = law_class(model, GOAL, K_P, K_V)
    at_rest = np.zeros(2)
    assert np.abs(model.forward_dynamics(GOAL, at_rest, law.torque(0.0, model.at(GOAL), at_rest))).max() < 1e-10
    assert abs(law.lyapunov(GOAL, at_rest)) < 1e-13


@pytest.mark.parametrize("law_class", [PDSimpleGravity, PDFullGravity])
def test_lyapunov_rate_is_the_damping(model, law_class):
    """d𝒱/dt = −q̇ᵀK_v q̇ along the closed loop, by central differences along the flow."""
    law = law_class(model, GOAL, K_P, K_V)
    generator = np.random.default_rng(3)
    for _ in range(10):
        q, v = GOAL + 0.2 * generator.standard_normal(2), generator.standard_normal(2)
        a, h = model.forward_dynamics(q, v, law.torque(0.0, model.at(q), v)), 1e-4

        def value(s, q=q, v=v, a=a):
            return law.lyapunov(q + s * v + 0.5 * s * s * a, v + s * a)

        slope = (8 * (value(h) - value(-h)) - (value(2 * h) - value(-2 * h))) / (12 * h)
        assert slope == pytest.approx(-v @ law.K_v @ v, rel=1e-7)


def test_motors_elsewhere_get_the_same_motion():
    """With the motors on dependent joints the law's generalized force is the same, ρᵀSᵀu = (28)."""
    direct = ccpin.ReducedModel(ccpin.load("rpdr"))
    elsewhere = ccpin.ReducedModel(ccpin.load("rpdr", actuated=["joint3", "joint4"]))
    q, v = GOAL + [0.05, -0.1], np.array([0.2, -0.1])
    arguments = (GOAL, K_P, K_V)
    first = direct.forward_dynamics(q, v, PDSimpleGravity(direct, *arguments).torque(0.0, direct.at(q), v))
    second = elsewhere.forward_dynamics(q, v, PDSimpleGravity(elsewhere, *arguments).torque(0.0, Measurement(q), v))
    assert np.allclose(first, second, rtol=1e-10)


@pytest.mark.parametrize(
    ("gains", "words"),
    [
        (([1.0], [1.0, 1.0]), "K_p"),
        (([1.0, -1.0], [1.0, 1.0]), "positive definite"),
        (([1.0, 1.0], [[1.0, 0.5], [0.0, 1.0]]), "symmetric"),
        (([[1.0, 1e-9], [-1e-9, 1.0]], [1.0, 1.0]), "K_p .* skew part of 2e-09"),
        (([1.0, 1.0], [[1.0, 1e-9], [-1e-9, 1.0]]), "K_v .* skew part of 2e-09"),
        (([[1.0, 1.0], [1.0, 1.0]], [1.0, 1.0]), "K_p must be .* positive definite"),
        (([np.nan, 1.0], [1.0, 1.0]), "finite"),
    ],
)
def test_bad_gains_are_refused(model, gains, words):
    """Gains must be symmetric positive definite of the right size."""
    with pytest.raises(InvalidInputError, match=words):
        PDSimpleGravity(model, GOAL, *gains)


def test_a_skew_part_of_rounding_is_taken_out_of_gains(model):
    """The gains a law computes with are symmetric to the last bit, and nobody can write to them."""
    rounded = np.array([[2.0, 0.3], [0.1 + 0.2, 1.0]])
    assert rounded[0, 1] != rounded[1, 0]
    law = PDSimpleGravity(model, GOAL, rounded, 2.0 * rounded)
    for gains in (law.K_p, law.K_v):
        assert np.array_equal(gains, gains.T)
        with pytest.raises(ValueError, match="read-only"):
            gains[0, 1] = 5.0


def test_one_number_stands_for_all_where_units_agree(model):
    """K_p = k I among angles; where an angle and a length are independent one number has no unit, and is refused."""
    law = PDSimpleGravity(model, GOAL, 11.0, 0.5)
    assert np.array_equal(law.K_p, 11.0 * np.eye(2))
    assert np.array_equal(law.K_v, 0.5 * np.eye(2))
    parts = {f"{name}_": Part(ccpin.load(name).description) for name in ("slider_crank", "four_bar")}
    names = ["slider_crank_slider", "four_bar_crank"]
    mixed = ccpin.load(combine("both", parts), independent=names, actuated=names)
    q = ccpin.ReducedModel(mixed).alpha(mixed.q_reference)
    with pytest.raises(InvalidInputError, match=r"K_p = 11.0 has no unit .* give 2 \(N/m, N m/rad\)"):
        PDSimpleGravity(mixed, q, 11.0, [1.0, 1.0])
    assert np.array_equal(PDSimpleGravity(mixed, q, [9.0, 11.0], [1.0, 1.0]).K_p, np.diag([9.0, 11.0]))


def test_goals_out_of_reach_are_refused(model):
    """A set point beyond the workspace raises when the law is made."""
    with pytest.raises(UnreachableError):
        PDSimpleGravity(model, [1.5, -1.5], [1.0, 1.0], [1.0, 1.0])


def test_fewer_motors_than_coordinates_are_refused():
    """A PD law on every coordinate needs as many motors; no torque needs none."""
    model = ccpin.ReducedModel(ccpin.load("rpdr", actuated=["joint1"]))
    with pytest.raises(UnsupportedMechanismError, match="motors"):
        PDSimpleGravity(model, GOAL, [1.0, 1.0], [1.0, 1.0])
    assert NoTorque(model).torque(0.0, model.at(GOAL), np.zeros(2)).shape == (1,)


@pytest.mark.parametrize("law_class", [PDSimpleGravity, PDFullGravity])
def test_a_law_is_asked_at_a_state_or_a_measurement(model, law_class):
    """Anything else is told what would be right: a bare q, a q of another size, another robot's State, a short v."""
    law, v = law_class(model, GOAL, K_P, K_V), np.zeros(2)
    with pytest.raises(InvalidInputError, match=r"Measurement\(q, near\)"):
        law.torque(0.0, GOAL, v)
    one = ccpin.ReducedModel(ccpin.load("four_bar"))
    for state in (Measurement(np.zeros(3)), one.at(one.alpha(one.mechanism.q_reference))):
        with pytest.raises(InvalidInputError, match=r"\(2,\)"):
            law.torque(0.0, state, v)
    with pytest.raises(InvalidInputError, match=r"v has shape \(3,\)"):
        law.torque(0.0, Measurement(GOAL), np.zeros(3))


def test_a_floating_base_is_no_set_point():
    """On a floating joint d/dt q̃ is not −q̇, so 𝒱 rises: both laws refuse it by name, driven or not."""
    names = ["root_joint", "joint1", "joint2"]
    model = ccpin.ReducedModel(ccpin.load("rpdr", floating_base=True, actuated=names))
    q = model.alpha(model.mechanism.q_reference)
    for law in (PDSimpleGravity, PDFullGravity):
        with pytest.raises(UnsupportedMechanismError, match="floating joint 'root_joint'"):
            law(model, q, np.ones(8), np.ones(8))


def test_motors_that_cannot_exert_the_law_are_refused():
    """As many motors as coordinates are not enough where none moves one of them."""
    four_bar = ccpin.load("four_bar").description
    two = combine("two", {"a_": Part(four_bar), "b_": Part(four_bar)})
    model = ccpin.ReducedModel(ccpin.load(two, independent=["a_crank", "b_crank"], actuated=["a_crank", "a_rocker"]))
    with pytest.raises(UnsupportedMechanismError, match="no motor moves 'b_crank'"):
        PDSimpleGravity(model, model.alpha(model.mechanism.q_reference), np.ones(2), np.ones(2))
