"""Coordinates that follow a motion: passive runs go on through singularities of the coordinates they began in."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import simpson, solve_ivp
from scipy.optimize import brentq

import ccpin
from ccpin.control import PDSimpleGravity
from ccpin.control.sampling import Sampling
from tests.oracles import descriptor
from tests.support import linkages
from tests.support.agreement import reference_model
from tests.support.backends import same_on_both
from tests.support.long_cases import later
from tests.support.passive import CASES, STRETCHING, TIGHT, assert_it_goes_on, case, released
from tests.support.places import SHARED

OTHERS = pytest.mark.skipif(not SHARED.is_dir(), reason=f"no {SHARED}: these files belong to others")
BOTH = ("five-bar",)  # NumPy follows the RSSR, the hung bar and the Stewart platform in other tests


def theirs(name):
    """The mark of a file that belongs to others."""
    return [OTHERS] * (name in ("cassie_like", "5bar_linkage_iso3d"))


every_case = pytest.mark.parametrize("name", [pytest.param(name, marks=theirs(name)) for name in CASES])


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(
            name,
            marks=[*theirs(name), *[same_on_both] * (name not in BOTH), *[pytest.mark.slow] * (name == "cassie_like")],
        )
        for name in CASES
    ],
)
def test_a_passive_motion_goes_on(name):
    """Two seconds: closed to 1e-10, energy kept to 1e-6 of the largest kinetic energy."""
    model, run = released(name, 2.0)
    assert_it_goes_on(model, run, 2.0)


@pytest.mark.slow
@every_case
def test_a_passive_motion_goes_on_for_a_minute(name):
    """Sixty seconds likewise."""
    model, run = released(name, 60.0)
    assert_it_goes_on(model, run, 60.0)


def apart(name, duration):
    """How far a run ends from (19) integrated in all coordinates: q′, and q̇′ relative to its size."""
    model, run = released(name, duration)
    free = model.mechanism.pin_model
    free.gravity = pin.Motion(np.array(model.gravity_vector), np.zeros(3))
    found = descriptor.integrate(model.mechanism.description, free, run.q_free[0], run.v_free[0], duration)
    far = np.abs(pin.difference(free, found.q_free, run.q_free[-1])).max()
    return (
        run.changes,
        far,
        np.abs(found.v_free - run.v_free[-1]).max() / max(1.0, np.abs(found.v_free).max()),
    )


@pytest.mark.parametrize(("name", "duration"), [("RSSR", 0.2)])
def test_the_motion_is_that_of_the_descriptor_form(name, duration):
    """Through a change of coordinates: q′ and q̇′ of (19) integrated in all coordinates, to 1e-6."""
    changes, far, faster = apart(name, duration)
    assert changes >= 1
    assert max(far, faster) < 1e-6


def test_a_pendulum_closed_by_a_pin_is_the_double_pendulum():
    """Three seconds of the hung bar, through a change of coordinates, against Lagrange's equations of two angles."""
    model, run = released("hung bar", 3.0)
    (m1, l1, i1), (m2, l2, i2) = linkages.UPPER, linkages.LOWER
    coupling, g = 0.5 * m2 * l1 * l2, 9.81

    def derivative(t, x):
        a, b, da, db = x
        c, s = coupling * np.cos(a - b), coupling * np.sin(a - b)
        mass = [[i1 + 0.25 * m1 * l1**2 + m2 * l1**2, c], [c, i2 + 0.25 * m2 * l2**2]]
        pull = (0.5 * m1 + m2) * l1 * g * np.cos(a) - s * db**2, 0.5 * m2 * l2 * g * np.cos(b) + s * da**2
        return np.concatenate([x[2:], np.linalg.solve(mass, pull)])

    places = [model.mechanism.tree.joint(name).q.start for name in ("swing", "turn")]
    angles = run.q_free[:, places]
    start = np.concatenate([angles[0], np.zeros(2)])
    found = solve_ivp(derivative, (0.0, 3.0), start, method="DOP853", rtol=1e-12, atol=1e-13, t_eval=run.t)
    assert run.changes >= 1
    np.testing.assert_allclose(angles, found.y[:2].T, rtol=0, atol=1e-6)


@pytest.mark.slow
@every_case
def test_the_motion_is_that_of_the_descriptor_form_at_one_second(name):
    """After a second likewise."""
    _, far, faster = apart(name, 1.0)
    assert max(far, faster) < 1e-6


@pytest.mark.parametrize("name", later("RSSR", "five-bar", "Stewart"))
def test_both_backends_follow_alike(name):
    """The core's run, piece by piece, is that of NumPy: as many changes and the same samples to the tolerance."""
    if ccpin.backend().name != "native":
        pytest.skip("the compiled core is not in use")
    model, ours = released(name, 0.5)
    v = case(name)[1]
    slow = reference_model(model.mechanism, model.gravity_vector)
    theirs = ccpin.simulate(slow, None, ours.q[0], v, duration=0.5, **TIGHT)
    assert ours.changes == theirs.changes
    np.testing.assert_allclose(ours.q_free, theirs.q_free, rtol=0, atol=1e-8)
    np.testing.assert_allclose(ours.v, theirs.v, rtol=1e-6, atol=1e-6)


def test_what_is_reported_is_in_the_runs_own_coordinates():
    """q = α(q′) of the model the run was started with; q̇ and q̈ are q's rates, before and after a change."""
    model, run = released("RSSR", 0.5, sample_period=1e-3)
    assert run.changes > 0
    for q, q_free in zip(run.q, run.q_free, strict=True):
        np.testing.assert_allclose(q, model.alpha(q_free), rtol=0, atol=1e-13)
    for values, rates in ((run.q, run.v), (run.v, run.a)):
        slope = (8 * (values[3:-1] - values[1:-3]) - (values[4:] - values[:-4])) / (12 * 1e-3)
        np.testing.assert_allclose(rates[2:-2, 0], slope[:, 0], rtol=0, atol=1e-5 * np.abs(rates[:, 0]).max())


@same_on_both
def test_a_spinning_rod_goes_round():
    """The rod's spin, a component of a ball joint whose chart ends at half a turn, goes on for many turns."""
    model, run = released("RSSR", 4.0)
    turned = np.diff(run.q[:, 1])
    assert np.abs(turned).max() > np.pi  # the chart's angle jumps, as it must
    assert_it_goes_on(model, run, 4.0)


@same_on_both
def test_coordinates_are_not_changed_to_and_fro():
    """A four-bar measured by its rocker changes once, to its crank, for as long as it goes round."""
    mechanism = ccpin.load("four_bar", independent=["rocker"], actuated=["crank"])
    model = ccpin.ReducedModel(mechanism, gravity=(0.0, 0.0, 0.0))
    run = ccpin.simulate(model, None, model.alpha(mechanism.q_reference), [3.0], duration=10.0, **TIGHT)
    crank = run.q_free[:, mechanism.tree.joint("crank").q.start]
    assert np.ptp(crank) > 4 * np.pi
    assert run.changes == 1


@pytest.mark.parametrize("method", later("RK45", "DOP853"))
def test_coordinates_are_left_late_in_a_motion_too(method):
    """At 1e7 s no step is shorter than 2e-8 s; the coordinates are left all the same, here by NumPy's integrators."""
    model, v = case("five-bar")
    slow = reference_model(model.mechanism, model.gravity_vector)
    moving = ccpin.Simulator(slow, None, method=method)
    moving.reset(model.alpha(model.mechanism.q_reference), v, t=1e7)
    run = moving.run(1e7 + 0.5, sample_period=0.05)
    assert (run.status, run.changes) == ("finished", 1)
    assert run.closure_error.max() <= 1e-10


# What is stated in the coordinates, and what is not.


@same_on_both
def test_a_sample_where_the_coordinates_are_singular_has_its_velocity():
    """Where the RSSR's rocker turns back, q̇ says nothing of the crank; q̇′, and so the energy, is known all the same."""
    model, run = released("RSSR", 2.0)
    speed = np.abs(run.v[:, 0]) / np.abs(run.v_free).max(axis=1)
    k = 1 + int(np.argmin(speed[1:]))

    moving = ccpin.Simulator(model, None, **{name: TIGHT[name] for name in ("method", "rtol", "atol")})
    moving.reset(run.q[0], run.v[0], near=run.q_free[0])
    moving.advance(run.t[k - 1])
    before = moving.memory()

    def there(t):
        moving.recall(before)
        return moving.advance(t)

    turned = there(brentq(lambda t: there(t).v[0], run.t[k - 1] + 1e-6, run.t[k + 1], xtol=1e-12))
    assert np.abs(turned.v).min() < 1e-6
    assert np.abs(turned.v_free).max() > 0.1
    energy = sum(model.free_system.energy(turned.q_free, turned.v_free))
    total, kinetic = sum(run.energy(model)), run.energy(model).kinetic
    assert abs(energy - total[0]) <= 1e-9 * kinetic.max()


def test_a_torque_function_goes_on_and_its_work_is_the_energy(rpdr_model):
    """Motors that stretch the five-bar and throw it over: T + V grows by ∫ uᵀq̇ dt of the motors' own rates."""

    def torque(t, q, v):
        return np.array([-0.5, 0.4 * np.sin(20 * t)])

    run = ccpin.simulate(rpdr_model, torque, *STRETCHING, duration=0.4, **(TIGHT | {"sample_period": 5e-4}))
    total = sum(run.energy(rpdr_model))
    work = simpson(np.einsum("ti,ti->t", run.u, run.v), x=run.t)
    assert (run.status, run.changes > 0) == ("finished", True)
    assert total[-1] - total[0] == pytest.approx(work, rel=1e-6)


@pytest.mark.parametrize("sampled", [False, True])
def test_a_law_stated_in_the_coordinates_ends_by_name(rpdr_model, sampled):
    """A feedback law ends where the loop stretches, and the message names law and coordinates."""
    law = PDSimpleGravity(rpdr_model, STRETCHING[0], [0.1, 0.1], [0.01, 0.01])
    sampling = Sampling(1e-3, encoder_counts=4096.0) if sampled else None
    run = ccpin.simulate(rpdr_model, law, *STRETCHING, duration=0.5, sampling=sampling)
    assert (run.status, run.changes) == ("singular", 0)
    assert "coordinates joint1, joint2 end, in which PDSimpleGravity is stated" in run.message
    q1, q2, q3, q4 = (run.q_free[-1, rpdr_model.mechanism.tree.joint(f"joint{k}").q.start] for k in (1, 2, 3, 4))
    assert abs(np.sin(q1 + q3 - q2 - q4)) < 0.3  # the loop is all but stretched


def test_a_sampled_function_goes_on(rpdr_model):
    """A digital controller that computes u from t, q and q̇ reads its own q and q̇ in other coordinates too."""
    seen = []

    def torque(t, q, v):
        seen.append((t, q.copy()))
        return np.zeros(2)

    run = ccpin.simulate(rpdr_model, torque, *STRETCHING, duration=0.2, sampling=Sampling(0.01), **TIGHT)
    free = ccpin.simulate(rpdr_model, None, *STRETCHING, duration=0.2, **TIGHT)
    assert (run.status, run.changes > 0) == ("finished", True)
    np.testing.assert_allclose(run.q, free.q, rtol=0, atol=1e-8)
    np.testing.assert_allclose([q for _, q in seen[:20]], run.q[:20], rtol=0, atol=1e-12)


def test_wrenches_that_read_a_state_end_by_name_and_constant_ones_go_on(rpdr_model):
    """A function of a State may read q of its model; a constant wrench reads nothing."""
    link = rpdr_model.mechanism.tree.joints[0].stated.child
    wrench = {link: [0.0, 0.0, 0.1, 0, 0, 0]}
    run = ccpin.simulate(rpdr_model, None, *STRETCHING, duration=0.2, wrenches=lambda t, state, v: wrench)
    assert run.status == "singular"
    assert "the wrenches, a function of a State, are stated" in run.message
    assert ccpin.simulate(rpdr_model, None, *STRETCHING, duration=0.2, wrenches=wrench).status == "finished"


def test_friction_goes_on_alike_in_any_coordinates():
    """Coulomb friction in every joint, through the stretched loop: the motion does not depend on who measures it."""
    levels, runs = {f"joint{k}": (0.02, 0.001) for k in range(1, 5)}, []
    home = ccpin.ReducedModel(ccpin.load("rpdr"))
    start = home.at(STRETCHING[0])
    for independent in (("joint1", "joint2"), ("joint1", "joint3")):
        model = ccpin.ReducedModel(ccpin.load("rpdr", independent=independent, actuated=("joint1", "joint2")))
        v = model.reading(start, STRETCHING[1]).v
        at = model.alpha(start.q_free), v
        runs.append(ccpin.simulate(model, None, *at, duration=0.3, near=start.q_free, friction=levels, **TIGHT))
    assert [run.status for run in runs] == ["finished"] * 2
    assert runs[0].changes > 0
    np.testing.assert_allclose(runs[0].q_free, runs[1].q_free, rtol=0, atol=1e-7)


# Where a motion ends.


@same_on_both  # NumPy's steps do so in `test_stepping_into_a_singularity_says_so`
@pytest.mark.parametrize("options", later({"rtol": 1e-7, "atol": 1e-9}, TIGHT), ids=["loose", "tight"])
def test_a_singular_mechanism_ends_a_passive_motion(options):
    """Delta's parallelograms fall flat: φ_q′ itself loses rank, and the message says so with the configuration."""
    model = ccpin.ReducedModel(ccpin.load("delta"))
    run = ccpin.simulate(model, None, model.alpha(model.mechanism.q_reference), duration=2.0, **TIGHT | options)
    assert run.status == "singular"
    assert "the mechanism itself is singular at q′ = [" in run.message
    assert run.evaluations < 20_000


@same_on_both
def test_joints_that_move_no_mass_end_a_passive_motion():
    """Three revolutes with a wrench on a link between are no ball: in gimbal lock two move nothing, and are named."""
    model = ccpin.ReducedModel(ccpin.load("stewart"))
    start, nothing = model.alpha(model.mechanism.q_reference), {"platform_roll_frame": np.zeros(6)}
    run = ccpin.simulate(model, None, start, duration=0.6, wrenches=nothing, **TIGHT)
    assert run.status == "singular"
    assert "platform_pitch, platform_yaw can turn or slide without moving any mass" in run.message
    assert run.evaluations < 20_000


def test_trajectories_one_after_the_other_add_their_changes(tmp_path):
    """`then` and files keep the changes, which are events that name the coordinates taken up."""
    _, run = released("RSSR", 1.0)
    run.save(tmp_path / "run.npz")
    assert run.then(run).changes == 2 * run.changes > 0
    assert ccpin.Trajectory.load(tmp_path / "run.npz").changes == run.changes
    assert all(event.name.startswith("measured by ") for event in run.events)
