"""Simulation: the paper's motion, energy, tolerances, stop conditions, and the supervisor."""

import numpy as np
import pinocchio as pin
import pytest

import ccpin
from ccpin import Trajectory
from ccpin.control.control_law import NoTorque
from ccpin.errors import CcpinError, InvalidInputError, UnreachableError
from ccpin.simulation import Settling, supervise
from tests.support.backends import same_on_both
from tests.support.paper import GOAL, K_P, K_V, START

HANGING = np.radians([-82.180, -97.823])


@pytest.fixture(scope="module")
def law(model) -> ccpin.control.PDSimpleGravity:
    return ccpin.control.PDSimpleGravity(model, GOAL, K_P, K_V)


@pytest.fixture(scope="module")
def motion(model, law) -> Trajectory:
    return ccpin.simulate(model, law, START, duration=1.0)


def test_point_to_point_reaches_its_goal(motion):
    """Both joints stay within ±2° of the goal from about 0.3 s on, as in Fig. 9."""
    late = motion.t >= 0.31
    assert motion.status == "finished"
    assert np.degrees(np.abs(motion.q[late] - GOAL)).max() < 2.0
    assert np.abs(motion.q[-1] - GOAL).max() < 1e-3


def test_loops_stay_closed(motion, model):
    """‖φ(q′)‖ ≤ 1e-10 at every sample, in the downward assembly mode throughout."""
    assert motion.closure_error.max() <= 1e-10
    order = [model.mechanism.pin_model.idx_qs[model.mechanism.pin_model.getJointId(f"joint{i}")] for i in (1, 2, 3, 4)]
    q1, q2, q3, q4 = motion.q_free[:, order].T
    assert np.all(np.sin(q1 + q3 - q2 - q4) > 0)


@pytest.mark.parametrize("name", ["rpdr", "stewart"])
def test_velocities_of_all_joints_are_those_q_free_moves_with(name):
    """q̇′ of a sample is the central difference of its neighbours' q′, to second order, on both backends."""
    mechanism, h = ccpin.load(name), 1e-4
    model = ccpin.ReducedModel(mechanism)
    q, v = model.alpha(mechanism.q_reference), np.linspace(-0.4, 0.4, model.n)
    run = ccpin.simulate(model, None, q, v, duration=20 * h, sample_period=h, rtol=1e-11, atol=1e-13)
    free = mechanism.pin_model
    for k in range(1, 20):
        slope = pin.difference(free, run.q_free[k - 1], run.q_free[k + 1]) / (2 * h)
        np.testing.assert_allclose(run.v_free[k], slope, rtol=1e-6, atol=1e-7)
        np.testing.assert_allclose(run.v_free[k], model.at(run.q[k], run.q_free[k]).v_free(run.v[k]), atol=1e-12)


def test_halving_the_tolerance_changes_nothing(model, law, motion):
    """No sample moves by more than 1e-6 rad."""
    finer = ccpin.simulate(model, law, START, duration=1.0, rtol=5e-10, atol=5e-12)
    assert np.abs(finer.q - motion.q).max() <= 1e-6


@pytest.mark.parametrize("method", ["DOP853", "RK23", "Radau", "BDF", "LSODA"])
def test_integrators_agree(method, model, law, motion):
    """Every integrator gives the same motion to its tolerance."""
    other = ccpin.simulate(model, law, START, duration=0.2, method=method, rtol=1e-6, atol=1e-8, sample_period=0.01)
    assert other.status == "finished"
    assert np.abs(other.q - motion.q[:201:10]).max() < 2e-4


def test_lyapunov_function_decreases_at_the_rate_of_damping(model, law, motion):
    """𝒱 never increases, and 𝒱(0) − 𝒱(t) = ∫ q̇ᵀK_v q̇ dt."""
    values = np.array([law.lyapunov(*state) for state in zip(motion.q, motion.v, motion.q_free, strict=True)])
    assert np.diff(values).max() <= 1e-9
    power = np.einsum("ti,ij,tj->t", motion.v, law.K_v, motion.v)
    dissipated = np.sum(0.5 * (power[1:] + power[:-1]) * np.diff(motion.t))
    assert values[0] - values[-1] == pytest.approx(dissipated, rel=2e-4)


def test_power_balance_along_a_trajectory(model, motion):
    """d(T + V)/dt = q̇ᵀu along the motion to 1e-8, the derivative taken along the solution's own flow."""
    for k in range(0, len(motion.t), 97):
        q, v, u, near = motion.q[k], motion.v[k], motion.u[k], motion.q_free[k]
        a, h = model.forward_dynamics(q, v, u, near), 2e-4

        def energy(s, q=q, v=v, a=a, near=near):
            return sum(model.energy(q + s * v + 0.5 * s * s * a, v + s * a, near))

        slope = (8 * (energy(h) - energy(-h)) - (energy(2 * h) - energy(-2 * h))) / (12 * h)
        assert slope == pytest.approx(v @ u, abs=1e-8 * max(1.0, abs(v @ u)))


def test_unforced_swinging_conserves_energy(model):
    """6 s of undamped swinging from 5° off the hanging equilibrium (the 60 s run is marked slow)."""
    _assert_energy_is_kept(model, 6.0)


@pytest.mark.slow
def test_a_minute_of_swinging_conserves_energy(model):
    """60 s of undamped swinging: relative energy drift ≤ 1e-6, closure ≤ 1e-10."""
    _assert_energy_is_kept(model, 60.0)


def _assert_energy_is_kept(model, duration):
    swing = ccpin.simulate(
        model, None, HANGING + np.radians([5.0, 0.0]), duration=duration, method="DOP853", sample_period=0.02
    )
    energy = np.array([sum(model.energy(*state)) for state in zip(swing.q, swing.v, swing.q_free, strict=True)])
    rest = sum(model.energy(HANGING, np.zeros(2)))
    assert swing.status == "finished"
    assert np.ptp(swing.q[:, 0]) > np.radians(5.0)
    assert np.abs(energy - energy[0]).max() <= 1e-6 * (energy[0] - rest)
    assert swing.closure_error.max() <= 1e-10


def test_hanging_equilibrium_is_one(model):
    """At (−82.180°, −97.823°) gravity asks for no torque (to the digits given)."""
    assert np.abs(model.gravity(HANGING)).max() < 1e-4


def test_settling_stops_the_motion(model, law):
    """The motion ends once it has stayed within the band for the hold time, and says since when."""
    stop = Settling(GOAL, band=np.radians(0.5), speed=0.02, hold=0.1)
    motion = ccpin.simulate(model, law, START, duration=5.0, settling=stop)
    inside = np.abs(motion.q - GOAL).max(axis=1) <= stop.band
    assert motion.status == "settled"
    assert "settled since" in motion.message
    assert inside[motion.t >= motion.t[-1] - 0.1].all()
    assert motion.t[-1] < 5.0


def test_a_region_that_is_left_stops_the_motion(model, law):
    """Status outside, with everything up to there kept."""
    motion = ccpin.simulate(model, law, START, duration=1.0, region=lambda q: q[0] < np.radians(-120.0))
    assert motion.status == "outside"
    assert motion.q[-1, 0] >= np.radians(-120.0)
    assert (motion.q[:-1, 0] < np.radians(-120.0)).all()


def test_driving_into_a_singularity_keeps_the_data(model):
    """A law that stretches the loop ends as singular, not as an exception; the samples stay closed."""

    class Stretching(ccpin.control.ControlLaw):
        def torque(self, t, state, v):
            return np.array([-4.0, 4.0])

    motion = ccpin.simulate(model, Stretching(), np.radians([-90.0, -90.0]), duration=1.0)
    assert motion.status == "singular"
    assert motion.closure_error.max() <= 1e-10
    assert 10 < len(motion.t) < 1001
    assert motion.q.shape == (len(motion.t), 2)


@pytest.mark.parametrize("options", [{}, {"rtol": 1e-8}, {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}])
def test_a_thrown_loop_flies_through_its_stretch(model, options):
    """Thrown at the stretched loop the motion goes on into the other assembly mode, by other coordinates, as soon."""
    motion = ccpin.simulate(model, None, np.radians([-108.0, -72.0]), [-8.0, 8.0], duration=0.5, **options)
    q1, q2, q3, q4 = (motion.q_free[:, model.mechanism.tree.joint(f"joint{k}").q.start] for k in (1, 2, 3, 4))
    stretched = motion.t[np.argmax(np.sin(q1 + q3 - q2 - q4) < 0)]
    assert (motion.status, motion.changes > 0) == ("finished", True)
    assert stretched == pytest.approx(0.057, abs=1.5e-3)
    assert motion.evaluations < 20_000
    assert motion.closure_error.max() <= 1e-10


def test_short_steps_far_from_a_singularity_are_no_approach_to_one(model):
    """Steps of nanoseconds because the caller asks for them go to the end."""
    motion = ccpin.simulate(model, None, HANGING, duration=2e-5, sample_period=1e-6, max_step=4e-8)
    assert motion.status == "finished"
    assert motion.t[-1] == pytest.approx(2e-5)


def test_bad_settling_goal_and_longest_step(model):
    """A goal with one number for two coordinates, or a longest step of zero, is refused before the motion."""
    with pytest.raises(InvalidInputError, match=r"must be \(2,\)"):
        ccpin.simulate(model, None, HANGING, duration=0.1, settling=Settling(np.zeros(1)))
    with pytest.raises(InvalidInputError, match="max_step"):
        ccpin.simulate(model, None, HANGING, duration=0.1, max_step=0.0)


def test_a_failing_controller_keeps_the_data(model):
    """A CcpinError inside the law ends the motion as failed with its message."""

    class Broken(ccpin.control.ControlLaw):
        def torque(self, t, state, v):
            if t > 0.05:
                raise CcpinError("the sensor fell off")
            return np.zeros(2)

    motion = ccpin.simulate(model, Broken(), START, duration=1.0)
    assert motion.status == "failed"
    assert "the sensor fell off" in motion.message
    assert 0 < motion.t[-1] <= 0.06


def test_an_interrupted_motion_keeps_the_data(model):
    """Ctrl-C inside the run returns what was computed."""

    class Interrupted(ccpin.control.ControlLaw):
        def torque(self, t, state, v):
            if t > 0.05:
                raise KeyboardInterrupt
            return np.zeros(2)

    motion = ccpin.simulate(model, Interrupted(), START, duration=1.0)
    assert motion.status == "interrupted"
    assert len(motion.t) > 1


def test_simulation_does_not_depend_on_history(model, law, motion):
    """The same arguments give the same samples, bit for bit."""
    again = ccpin.simulate(model, law, START, duration=1.0)
    assert np.array_equal(again.q, motion.q)
    assert np.array_equal(again.q_free, motion.q_free)


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ({"duration": 0.0}, InvalidInputError, "duration"),
        ({"duration": np.nan}, InvalidInputError, "duration"),
        ({"method": "Euler"}, InvalidInputError, "RK45"),
        ({"sample_period": -1.0}, InvalidInputError, "sample_period"),
        ({"q0": [0.0]}, InvalidInputError, "shape"),
        ({"v0": [np.inf, 0.0]}, InvalidInputError, "finite"),
        ({"controller": 3}, InvalidInputError, "controller"),
        ({"q0": [1.5, -1.5]}, UnreachableError, "blocked"),
    ],
)
def test_bad_arguments_are_named(model, change, error, words):
    """Before the motion begins every bad argument raises its own error."""
    arguments = {"controller": None, "q0": START, "duration": 1.0} | change
    controller, q0 = arguments.pop("controller"), arguments.pop("q0")
    with pytest.raises(error, match=words):
        ccpin.simulate(model, controller, q0, **arguments)


@same_on_both
def test_supervised_cycles(model):
    """Back and forth with waits: each move settles, waits 2.5 s after settling, and begins where the last ended."""
    motion = supervise(
        model,
        lambda goal, near: ccpin.control.PDSimpleGravity(model, goal, K_P, K_V, near),
        START,
        [GOAL, START],
        wait=2.5,
        sample_period=0.01,
    )
    assert [move.settled is not None for move in motion.moves] == [True, True]
    assert np.all(np.diff(motion.trajectory.t) > 0)
    for move in motion.moves:
        assert move.end - move.settled == pytest.approx(2.5, abs=0.011)
        assert np.abs(move.trajectory.q[-1] - move.goal).max() < 1e-4
    assert motion.moves[1].start == motion.moves[0].end
    assert motion.trajectory.message.startswith("2 moves")
    assert motion.trajectory.closure_error.max() <= 1e-10


def test_a_move_that_never_settles_ends_the_supervision(model):
    """The motion so far is returned and says why it ended."""
    motion = supervise(
        model,
        lambda goal, near: NoTorque(model),
        START,
        [GOAL, START],
        wait=0.1,
        timeout=0.2,
        sample_period=0.01,
    )
    assert len(motion.moves) == 1
    assert motion.moves[0].settled is None
    assert motion.trajectory.status == "finished"


def test_files_round_trip(motion, model, tmp_path):
    """npz and CSV hold the samples exactly, with a header that names every column."""
    motion.save(tmp_path / "m.npz")
    motion.save(tmp_path / "m.csv")
    again = ccpin.Trajectory.load(tmp_path / "m.npz")
    assert np.array_equal(again.q_free, motion.q_free)
    assert again.status == motion.status
    table = np.genfromtxt(tmp_path / "m.csv", delimiter=",", names=True)
    assert np.array_equal(table["q_joint2"], motion.q[:, 1])
    assert np.array_equal(table["u_joint1"], motion.u[:, 0])
    assert sorted(p.name for p in tmp_path.iterdir()) == ["m.csv", "m.npz"]


def test_a_file_that_cannot_be_written_leaves_nothing(motion, model, tmp_path):
    """A failed write raises our error, or leaves no partial file."""
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    with pytest.raises(InvalidInputError, match="cannot write"):
        motion.save(blocked / "m.csv")
    with pytest.raises(InvalidInputError, match="cannot be read"):
        ccpin.Trajectory.load(blocked)


def test_a_trajectory_prints_as_one_line(rpdr_model):
    """`repr` tells how the motion ended and its sizes, not its arrays."""
    assert repr(ccpin.simulate(rpdr_model, None, START, duration=0.01)) == (
        "Trajectory(finished at 0.01 s, 11 samples, n = 2)"
    )
