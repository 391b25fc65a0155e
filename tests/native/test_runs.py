"""Runs in the compiled core are the reference's runs."""

from types import SimpleNamespace

import numpy as np
import pytest

import ccpin
from ccpin.control import PDFullGravity, PDSimpleGravity, TorqueFunction
from ccpin.control.control_law import NoTorque
from ccpin.control.references import PointToPoint, Waypoints
from ccpin.control.sampling import SampledCommands, Sampling
from ccpin.control.tracking import ComputedTorque, PDOnlineGravity, PDPlus
from ccpin.dynamics import Wrench
from ccpin.dynamics.wrenches import wrench_rows
from ccpin.simulation import Settling
from ccpin.simulation.events.samples import Stop
from ccpin.simulation.events.watches import Instant
from ccpin.simulation.integration import simulator
from ccpin.simulation.integration.core_runs import run_in_core
from tests.support.agreement import reference_model
from tests.support.long_cases import later

pytestmark = pytest.mark.skipif(ccpin.backend().name != "native", reason="the compiled core is not in use")


def in_core(
    model, law, q0, duration, method="RK45", settling=None, rtol=1e-9, wrenches=None, sampling=None, most=np.inf
):
    """A run of the core from rest, sampled every 10 ms; ``None`` where it declines."""
    numbers = {"times": np.arange(round(100 * duration) + 1) * 0.01, "rtol": rtol, "atol": rtol * 1e-2}
    numbers |= {"max_step": np.inf, "singular_rcond": 1e-7}
    numbers |= {"wrenches": wrench_rows(model.mechanism.tree, wrenches)}
    numbers |= {"lower": [-most] * model.n_actuated, "upper": [most] * model.n_actuated}
    loop = sampling and SampledCommands(model, law, sampling, q0, np.zeros(model.n))
    numbers |= {"sampling": loop and loop.numbers()}
    found = run_in_core(model, law, method, Instant(0.0, model.at(q0), np.zeros(model.n)), numbers, settling)
    if found is None:
        return None
    stop = found.stop or Stop("finished", f"simulated {duration:.6g} s")
    return SimpleNamespace(**found.columns, **stop._asdict(), evaluations=found.evaluations)


def reference(model, *arguments, **options):
    """A run of the NumPy path."""
    return ccpin.simulate(reference_model(model.mechanism, model.gravity_vector), *arguments, **options)


def ends(model):
    q0 = model.alpha(model.mechanism.q_reference)
    return q0, q0 + np.array([0.3, -0.2])


@pytest.mark.parametrize("duration", later(0.15, 0.4))
def test_the_papers_law_step_for_step(rpdr_model, duration):
    """PD with simple gravity compensation: the same samples to 1e-12 of the state, the same evaluations."""
    q0, q_d = ends(rpdr_model)
    law = PDSimpleGravity(rpdr_model, q_d, [50.0, 50.0], [5.0, 5.0])
    ours = in_core(rpdr_model, law, q0, duration)
    theirs = reference(rpdr_model, law, q0, duration=duration, sample_period=0.01)
    assert (ours.status, ours.message, ours.evaluations) == (theirs.status, theirs.message, theirs.evaluations)
    for name, allowed in (("t", 0.0), ("q", 1e-12), ("v", 1e-12), ("q_free", 1e-12), ("u", 1e-10), ("a", 1e-9)):
        np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), rtol=0, atol=allowed)
    assert ours.closure_error.max() <= 1e-10


SPRUNG = {
    "joint1": {"damping": 0.02, "stiffness": 0.3},
    "passive": {"damping": 0.01, "stiffness": 0.2, "spring_reference": 1.0},
}


@pytest.fixture(scope="module")
def sprung_model():
    """The RPDR with springs and dampers on its first and its last joint."""
    last = ccpin.load("rpdr").tree.names[-1]
    return ccpin.ReducedModel(ccpin.load("rpdr", joints={"joint1": SPRUNG["joint1"], last: SPRUNG["passive"]}))


@pytest.mark.parametrize("kind", ["free", *later("full", "simple"), "computed torque", "PD+", "gravity"])
@pytest.mark.parametrize(
    ("subject", "method"),
    [
        pytest.param("rpdr_model", "RK45", marks=pytest.mark.slow),  # beside `test_the_papers_law_step_for_step`
        pytest.param("rpdr_model", "DOP853", marks=pytest.mark.slow),  # the same without springs and dampers
        ("sprung_model", "DOP853"),
    ],
)
@pytest.mark.parametrize("duration", later(0.12, 0.2))
def test_laws(subject, kind, method, duration, request):
    """Every law of the core against the reference's, to the integrator's tolerance."""
    model = request.getfixturevalue(subject)
    q0, q_d = ends(model)
    move, way = PointToPoint(model, q0, q_d, 0.15), Waypoints(model, [0.0, 0.1, 0.25], [q0, q_d, q0])
    law = {
        "free": lambda: NoTorque(model),
        "simple": lambda: PDSimpleGravity(model, q_d, [40.0, 30.0], [5.0, 4.0]),
        "full": lambda: PDFullGravity(model, q_d, [40.0, 30.0], [5.0, 4.0]),
        "computed torque": lambda: ComputedTorque(model, move, [100.0, 90.0], [20.0, 19.0]),
        "PD+": lambda: PDPlus(model, way, [40.0, 30.0], [5.0, 4.0]),
        "gravity": lambda: PDOnlineGravity(model, way, [40.0, 30.0], [5.0, 4.0]),
    }[kind]()
    ours = in_core(model, law, q0, duration, method)
    theirs = reference(model, law, q0, duration=duration, sample_period=0.01, method=method)
    np.testing.assert_allclose(ours.q, theirs.q, rtol=0, atol=1e-9)
    np.testing.assert_allclose(ours.v, theirs.v, rtol=0, atol=2e-7)
    np.testing.assert_allclose(ours.u[0], theirs.u[0], rtol=0, atol=1e-11)


def test_circles_and_quaternions():
    """A floating base: quaternions stay of unit length, and the motion is the reference's."""
    mechanism = ccpin.load("rpdr", floating_base=True)
    model = ccpin.ReducedModel(mechanism)
    q0 = model.alpha(mechanism.q_reference)
    ours = in_core(model, NoTorque(model), q0, 0.1)
    theirs = reference(model, None, q0, duration=0.1, sample_period=0.01)
    np.testing.assert_allclose(ours.q, theirs.q, rtol=0, atol=1e-10)


def test_settling_ends_a_run(rpdr_model):
    """It stops at the sample the reference stops at, and says so in its words."""
    q0, q_d = ends(rpdr_model)
    law = PDFullGravity(rpdr_model, q_d, [50.0, 50.0], [5.0, 5.0])
    settling = Settling(q_d, band=0.02, speed=0.2, hold=0.05)
    ours = in_core(rpdr_model, law, q0, 3.0, settling=settling)
    theirs = reference(rpdr_model, law, q0, duration=3.0, sample_period=0.01, settling=settling)
    assert (ours.status, ours.message, len(ours.t)) == (theirs.status, theirs.message, len(theirs.t))


def test_gravity_is_the_models(rpdr):
    """A model with a gravity of its own moves under that one."""
    model = ccpin.ReducedModel(rpdr, gravity=(0.0, 0.0, -1.6))
    q0, _ = ends(model)
    ours = ccpin.simulate(model, None, q0, duration=0.1, sample_period=0.01)
    theirs = reference(model, None, q0, duration=0.1, sample_period=0.01)
    np.testing.assert_allclose(ours.q, theirs.q, rtol=0, atol=1e-11)


def test_what_the_core_leaves_to_the_reference(rpdr_model):
    """A Python law, another method, and a motion into a singularity get no answer."""
    q0, _ = ends(rpdr_model)
    assert in_core(rpdr_model, TorqueFunction(lambda t, q, v: np.zeros(2)), q0, 0.1) is None
    assert in_core(rpdr_model, NoTorque(rpdr_model), q0, 0.1, method="Radau") is None
    still = {"torque": lambda self, t, state, v: np.zeros(2)}
    own = type("Own", (PDFullGravity,), still)(rpdr_model, q0, [50.0, 50.0], [5.0, 5.0])
    assert in_core(rpdr_model, own, q0, 0.1) is None
    delta = ccpin.ReducedModel(ccpin.load("delta"))  # falls until its arms are stretched
    assert in_core(delta, NoTorque(delta), delta.alpha(delta.mechanism.q_reference), 0.6) is None


class Backwards(PointToPoint):
    """A reference whose `at` is not that of the polynomial it inherits."""

    def at(self, t):
        """The motion from its end to its start."""
        return super().at(self.duration - t)


def test_a_law_of_other_gravity_computes_with_its_own(rpdr, rpdr_model):
    """Where there is none, what it gives is its feedback."""
    start, goal = np.array([-2.6, -2.8]), np.array([-2.4, -2.6])
    floating = ccpin.ReducedModel(rpdr, gravity=np.zeros(3))
    found = in_core(rpdr_model, PDFullGravity(floating, goal, [11, 11], [0.6, 0.6]), start, 0.1)
    np.testing.assert_allclose(found.u, 11.0 * (goal - found.q) - 0.6 * found.v, rtol=0, atol=1e-12)


def test_what_the_core_would_misread_is_the_references(rpdr_model):
    """A reference with an `at` of its own is declined."""
    start, goal = np.array([-2.6, -2.8]), np.array([-2.4, -2.6])
    law = ComputedTorque(rpdr_model, Backwards(rpdr_model, goal, start, 0.3), [100, 100], [20, 20])
    assert in_core(rpdr_model, law, start, 0.1) is None
    plain = ComputedTorque(rpdr_model, PointToPoint(rpdr_model, start, goal, 0.3), [100, 100], [20, 20])
    assert in_core(rpdr_model, plain, start, 0.1) is not None


def a_law(model, kind):
    q0, q_d = ends(model)
    if kind == "simple":
        return PDSimpleGravity(model, q_d, [40.0, 30.0], [2.0, 1.5])
    return ComputedTorque(model, PointToPoint(model, q0, q_d, 0.15), [100.0, 90.0], [20.0, 19.0])


LOOPS = {
    "hold alone": Sampling(2e-3),
    "slower than the samples": Sampling(0.013),
    "delay": Sampling(1e-3, delay=2, effort_before=(0.3, -0.2)),
    "filter": Sampling(1e-3, velocity_cutoff=40.0),
    "encoders": Sampling(1e-3, encoder_counts=(4096.0, 8192.0)),
    "everything": Sampling(1.7e-3, 10000.0, 60.0, (2.0, 1.0), 1, 0.1),
}


@pytest.mark.parametrize("kind", ["simple", "computed torque"])
@pytest.mark.parametrize("name", later("everything", *(name for name in LOOPS if name != "everything")))
def test_sampled_loops(rpdr_model, name, kind):
    """A digital controller's run, command for command: samples to 1e-11, the u held, and the same evaluations.

    Computed torque begins at an acceleration of zero, from whose rounding SciPy chooses the first step: no such count.
    """
    q0, _ = ends(rpdr_model)
    law = a_law(rpdr_model, kind)
    ours = in_core(rpdr_model, law, q0, 0.1, sampling=LOOPS[name])
    theirs = reference(rpdr_model, law, q0, duration=0.1, sample_period=0.01, sampling=LOOPS[name])
    assert (ours.status, ours.message) == (theirs.status, theirs.message)
    assert kind != "simple" or ours.evaluations == theirs.evaluations
    for field, allowed in (("t", 0.0), ("q", 1e-11), ("v", 1e-11), ("q_free", 1e-11), ("u", 1e-9)):
        np.testing.assert_allclose(getattr(ours, field), getattr(theirs, field), rtol=0, atol=allowed)


@pytest.mark.parametrize(
    ("kind", "sampling"),
    [
        ("computed torque", None),
        ("simple", Sampling(2e-3, velocity_cutoff=100.0)),
        pytest.param("simple", None, marks=pytest.mark.slow),
        pytest.param("computed torque", Sampling(2e-3, velocity_cutoff=100.0), marks=pytest.mark.slow),
    ],
)
def test_pushed_runs(rpdr_model, kind, sampling):
    """Constant wrenches on links move the mechanism as in the reference; the law knows nothing of them."""
    q0, _ = ends(rpdr_model)
    links = sorted(rpdr_model.mechanism.tree.attachments)
    pushed = {
        links[1]: Wrench((1.0, -2.0, 0.5), (0.1, 0.0, 0.2), (0.05, 0.02, 0.0)),
        links[-1]: [0.3, 0, -1.0, 0, 0, 0.1],
    }
    law = a_law(rpdr_model, kind)
    ours = in_core(rpdr_model, law, q0, 0.1, sampling=sampling, wrenches=pushed)
    theirs = reference(rpdr_model, law, q0, duration=0.1, sample_period=0.01, sampling=sampling, wrenches=pushed)
    free = in_core(rpdr_model, law, q0, 0.1, sampling=sampling)
    assert np.abs(ours.q - free.q).max() > 1e-3
    for field, allowed in (("q", 1e-11), ("v", 1e-11), ("u", 1e-9)):
        np.testing.assert_allclose(getattr(ours, field), getattr(theirs, field), rtol=0, atol=allowed)


def test_simulate_asks_the_core_for_them(rpdr_model, monkeypatch):
    """Sampled runs and constant wrenches go to the core; wrenches that are a function stay with the reference."""
    asked = []

    def spy(*arguments):
        asked.append(run_in_core(*arguments))
        return asked[-1]

    monkeypatch.setattr(simulator, "run_in_core", spy)
    q0, _ = ends(rpdr_model)
    law, link = a_law(rpdr_model, "simple"), sorted(rpdr_model.mechanism.tree.attachments)[1]
    still = {link: [0.0, 1.0, 0.0, 0.0, 0.0, 0.0]}
    ccpin.simulate(rpdr_model, law, q0, duration=0.02, sampling=Sampling(1e-3), wrenches=still)
    assert len(asked) == 1
    assert asked[0].stop is None
    ccpin.simulate(rpdr_model, law, q0, duration=0.02, wrenches=lambda t, state, v: still)
    assert len(asked) == 1


@pytest.mark.parametrize("sampling", [None, Sampling(1e-3)], ids=["continuous", "sampled"])
def test_runs_beyond_the_motors_bounds_are_the_references(rpdr_model, sampling):
    """Where the law asks for more than motors can give the core has no answer, and the run saturates as in NumPy."""
    q0, q_d = ends(rpdr_model)
    law = PDSimpleGravity(rpdr_model, q_d, [150.0, 150.0], [5.0, 5.0])
    assert in_core(rpdr_model, law, q0, 0.1, sampling=sampling) is not None
    assert in_core(rpdr_model, law, q0, 0.1, sampling=sampling, most=30.0) is None
    found = ccpin.simulate(rpdr_model, law, q0, duration=0.05, sampling=sampling, sample_period=0.01)
    expected = reference(rpdr_model, law, q0, duration=0.05, sampling=sampling, sample_period=0.01)
    assert np.abs(found.u).max() == 30.0
    np.testing.assert_allclose(found.q, expected.q, rtol=0, atol=1e-10)


@pytest.mark.parametrize("duration", later(0.15, 0.5))
def test_what_trial_steps_ask_for_is_nobodys(rpdr_model, duration):
    """A move that needs 2 of 30 N m stays in the core, though the first trial step from rest asks for a thousand."""
    start, goal = np.radians([-150.0, -160.0]), np.radians([-90.0, -100.0])
    law = ComputedTorque(rpdr_model, PointToPoint(rpdr_model, start, goal, 0.4), [1600.0, 1600.0], [80.0, 80.0])
    ours = in_core(rpdr_model, law, start, duration, most=30.0)
    theirs = reference(rpdr_model, law, start, duration=duration, sample_period=0.01)
    assert np.abs(ours.u).max() < 2.0
    np.testing.assert_allclose(ours.q, theirs.q, rtol=0, atol=1e-9)
    np.testing.assert_allclose(ours.u, theirs.u, rtol=0, atol=1e-6)


@pytest.mark.parametrize("sampling", [None, Sampling(1e-3)], ids=["continuous", "sampled"])
def test_motors_that_do_not_measure(sampling):
    """Laws for them are the reference's; without torque the core runs unless it is sampled."""
    model = ccpin.ReducedModel(ccpin.load("rpdr", independent=["joint1", "joint3"], actuated=["joint1", "joint2"]))
    q0 = model.alpha(model.mechanism.q_reference)
    law = PDPlus(model, Waypoints(model, [0.0, 0.1], [q0, q0]), [1.0, 1.0], [0.1, 0.1])
    assert in_core(model, law, q0, 0.05, sampling=sampling) is None
    ours = in_core(model, NoTorque(model), q0, 0.05, sampling=sampling)
    assert (ours is None) == (sampling is not None)
    found = ccpin.simulate(model, None, q0, duration=0.05, sampling=sampling, sample_period=0.01)
    theirs = reference(model, None, q0, duration=0.05, sampling=sampling, sample_period=0.01)
    for motion in (found, found if ours is None else ours):
        np.testing.assert_allclose(motion.q, theirs.q, rtol=0, atol=1e-10)
        assert motion.u.shape == (6, 2)


def test_noisy_loops_are_the_references(rpdr_model):
    """Noise of encoders is drawn in Python alone: the run is the reference's, not one without noise."""
    q0, q_d = ends(rpdr_model)
    law, noisy = PDSimpleGravity(rpdr_model, q_d, [50.0, 50.0], [5.0, 5.0]), Sampling(1e-3, encoder_noise=1e-3, seed=2)
    found = ccpin.simulate(rpdr_model, law, q0, duration=0.03, sampling=noisy, sample_period=0.01)
    expected = reference(rpdr_model, law, q0, duration=0.03, sampling=noisy, sample_period=0.01)
    quiet = ccpin.simulate(rpdr_model, law, q0, duration=0.03, sampling=Sampling(1e-3), sample_period=0.01)
    np.testing.assert_allclose(found.u, expected.u, rtol=0, atol=1e-8)
    assert np.abs(found.u - quiet.u).max() > 1e-2


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # of SciPy, which is asked where the core has no answer
@pytest.mark.parametrize("method", ["RK45", "DOP853"])
@pytest.mark.parametrize("speed", [1e160, 1e308])
def test_speeds_whose_squares_are_no_numbers_end_a_run(rpdr_model, method, speed):
    """Steps that are NaN end the search for one that is short enough, in runs and where torques are held."""
    q0, v0 = rpdr_model.alpha(rpdr_model.mechanism.q_reference), np.array([speed, 0.0])
    ran = ccpin.simulate(rpdr_model, None, q0, v0, duration=0.01, method=method)
    assert (ran.status, len(ran.t)) == ("singular", 1)
    simulator = ccpin.Simulator(rpdr_model, method=method)
    simulator.reset(q0, v0)
    assert simulator.step(np.zeros(2), 0.01).t == 0.0
    assert simulator.stop.status == "singular"
