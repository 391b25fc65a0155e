"""What shortcuts miss: nothing where there is nothing to miss, else what linkage and rotors take."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import ccpin
from ccpin.description import scaled
from ccpin.description.drafts import drafted
from ccpin.errors import InvalidInputError
from ccpin.transmission import Swing, Transmission, compare, plot_limits, plot_shortcuts, survey
from tests.support.linkage_models import ROTORS, transmission_of


def test_without_a_linkage_nothing_is_missing():
    """The ankle with cranks, rods and rotors of no mass: the static map is exact, and so is the motion."""
    light = scaled(
        drafted("ankle"),
        masses={"left_crank": 0.0, "right_crank": 0.0, "left_rod": 0.0, "right_rod": 0.0},
    )
    found = Transmission(ccpin.load(light))
    made = compare(found, Swing(found, [0.2, 0.1], 2.0), "static_map", bandwidth=5.0)
    assert made.torque_error < 1e-12
    assert made.motion_errors.max() < 1e-5  # the feed-forward is a spline through its samples


@pytest.mark.parametrize("name", ["ankle", "knee", "neck"])
def test_what_is_missing_is_what_linkage_and_rotors_take(name):
    """static_map: all of it; constant_armature: all but constant rotors; serial: as static_map where J is constant."""
    found = transmission_of(name)
    swing = Swing(found, np.full(found.n, 0.15), 3.0)
    static, armature, serial = (
        compare(found, swing, s, samples=31) for s in ("static_map", "constant_armature", "serial")
    )
    home = ROTORS[name] * np.diag(found.reference.jacobian.T @ found.reference.jacobian)
    for k, t in enumerate(static.t):
        state, posture = swing.at(t), found.at(swing.at(t).q)
        takes = posture.linkage_effort(state.v, state.a)
        np.testing.assert_allclose(static.missing[k], takes, rtol=0, atol=1e-10)
        np.testing.assert_allclose(armature.missing[k], takes - home * state.a, rtol=0, atol=1e-10)
        sent = found.reference.motor_effort(posture.serial_effort(state.v, state.a))
        np.testing.assert_allclose(serial.used[k], sent, rtol=0, atol=1e-10)
        np.testing.assert_allclose(static.wanted[k], posture.state.tau(state.v, state.a), rtol=0, atol=1e-10)
    if name == "neck":
        np.testing.assert_allclose(serial.missing, static.missing, rtol=0, atol=1e-10)
        assert armature.torque_error < 0.01 < static.torque_error
    assert np.isnan(static.motion_errors).all()


def test_deviations_are_those_of_the_motion():
    """SciPy's own integration of the same law and model."""
    found = transmission_of("knee")
    swing = Swing(found, [0.2], 2.0)
    made = compare(found, swing, "static_map", samples=101, bandwidth=8.0)
    model, w = found.joint_model, 2 * np.pi * 8.0
    inertia = found.reference.state.D[0, 0]

    def rate(t, x):
        state = swing.at(t)
        posture = found.at(state.q)
        feedback = inertia * (w * w * (state.q - x[:1]) + 2 * w * (state.v - x[1:]))
        u = posture.motor_effort(posture.serial_effort(state.v, state.a) + feedback)
        return [x[1], model.forward_dynamics(x[:1], x[1:], u)[0]]

    start = swing.at(0.0)
    run = solve_ivp(rate, (0.0, swing.duration), [*start.q, *start.v], t_eval=made.t, rtol=1e-8, atol=1e-10)
    expected = np.array([swing.at(t).q for t in made.t]) - run.y[:1].T
    np.testing.assert_allclose(made.deviation, expected, rtol=0, atol=2e-4 * np.abs(expected).max() + 1e-7)
    assert made.as_json()["motion_errors"] == pytest.approx(np.abs(expected).max(axis=0), rel=1e-2)


def test_figures_show_polygons_and_curves():
    """As many lines as postures, and what each shortcut misses."""
    figure = plot_limits(transmission_of("ankle"))
    polygons = [line for line in figure.axes[0].lines if len(line.get_xdata()) == 5]
    assert len(polygons) == 1 + len(survey(transmission_of("ankle"), count=3).postures)
    assert len(plot_limits(transmission_of("knee"), speed=10.0).axes) == 2
    found = transmission_of("ankle")
    made = [compare(found, Swing(found, [0.2, 0.1], 1.0), s, samples=11) for s in ("static_map", "serial")]
    panels = plot_shortcuts(made).axes
    assert [len(axes.lines) for axes in panels] == [3, 3]
    np.testing.assert_array_equal(panels[1].lines[2].get_ydata(), made[1].missing[:, 1])


def test_what_is_no_shortcut_or_motion_is_refused():
    found = transmission_of("ankle")
    with pytest.raises(InvalidInputError, match="static_map, constant_armature, serial"):
        compare(found, Swing(found, [0.1, 0.1], 1.0), "none")
    with pytest.raises(InvalidInputError, match="Reference"):
        compare(found, None)
    with pytest.raises(InvalidInputError):
        Swing(found, [0.1], 1.0)
