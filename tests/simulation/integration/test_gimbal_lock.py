"""Three revolutes that are a ball joint: a motion goes on through their gimbal lock, told in their columns."""

import numpy as np
import pytest
from scipy.integrate import simpson

import ccpin
from ccpin import Simulator
from ccpin.control import PDSimpleGravity
from ccpin.control.sampling import Sampling
from ccpin.errors import DifferentSubjectsError
from tests.support.agreement import reference_model
from tests.support.backends import same_on_both
from tests.support.gimbal import TRIPLE, link_pose, stewart, stewart_on_balls
from tests.support.long_cases import later
from tests.support.passive import TIGHT, assert_it_goes_on

INTEGRATOR = {name: TIGHT[name] for name in ("method", "rtol", "atol")}
LOCKED_AT = 0.4734  # s: where the triple's axes come together


def released(model, duration=0.6, law=None, **options):
    """From rest, at the platform's own reference."""
    start = stewart().alpha(stewart().mechanism.q_reference)
    return ccpin.simulate(model, law, start, duration=duration, **(TIGHT | options))


def simulator(law=None, **options):
    found = Simulator(stewart(), law, **INTEGRATOR, **options)
    found.reset(stewart().alpha(stewart().mechanism.q_reference))
    return found


@same_on_both
def test_a_stewart_platform_from_rest_goes_on():
    """Two seconds through the lock: closed in its own φ to 1e-10, energy kept, and q is that of the one on balls."""
    model, run = stewart(), released(stewart(), 2.0)
    assert_it_goes_on(model, run, 2.0)
    assert run.changes > 0
    constraints = model.parametrization.constraints
    assert max(np.linalg.norm(constraints.residual(q_free)) for q_free in run.q_free) < 1e-10
    other = released(stewart_on_balls(), 2.0)
    np.testing.assert_allclose(run.q, other.q, rtol=0, atol=1e-7)
    np.testing.assert_allclose(run.v, other.v, rtol=0, atol=1e-6)
    assert f"a ball joint, as its axes meet with no mass between them: {' '.join(TRIPLE)}" in " ".join(run.notes)


@same_on_both
def test_the_triples_columns_are_its_angles():
    """Every link is where it is on balls, the columns are those before, go on smoothly and have their own rates."""
    model, run, other = stewart(), released(stewart(), sample_period=1e-3), released(stewart_on_balls())
    assert run.q_free.shape[1] == model.mechanism.nq
    for k, q_free in enumerate(other.q_free):
        for link in ("platform", "piston1", "cylinder4"):
            ours = link_pose(model.mechanism, run.q_free[10 * k], link)
            theirs = link_pose(stewart_on_balls().mechanism, q_free, link)
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-8)
    away = np.abs(run.t - LOCKED_AT) > 0.01
    middle = away[1:-1] & away[2:] & away[:-2]
    slopes = (run.q_free[2:] - run.q_free[:-2]) / 2e-3
    np.testing.assert_allclose(slopes[middle], run.v_free[1:-1][middle], rtol=1e-2, atol=1e-2)
    assert np.abs(np.diff(run.q_free, axis=0))[away[1:]].max() < 0.05  # no leap from one triple of angles to another


@same_on_both
def test_sampling_changes_nothing():
    """Coarse samples are among the fine ones (NumPy's Newton begins at the last sample), the triple's columns too."""
    fine, coarse = released(stewart(), sample_period=1e-3), released(stewart(), sample_period=0.02)
    np.testing.assert_allclose(fine.q[::20], coarse.q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(fine.q_free[::20], coarse.q_free, rtol=0, atol=1e-12)


def test_both_backends_go_on_alike():
    """The core's run is that of NumPy, and so is the run by steps with u held."""
    model, ours = stewart(), released(stewart())
    slow = reference_model(model.mechanism, model.gravity_vector)
    theirs = released(slow)
    assert (ours.changes, ours.notes[0]) == (theirs.changes, "stepped by the compiled core")
    np.testing.assert_allclose(ours.q_free, theirs.q_free, rtol=0, atol=1e-7)
    np.testing.assert_allclose(ours.v_free, theirs.v_free, rtol=1e-6, atol=1e-5)


test_both_backends_go_on_alike = same_on_both(test_both_backends_go_on_alike)


@same_on_both
def test_steps_with_u_held_go_on():
    """`step` in the core, where the run is on balls: the sample, the State and q̇ are the platform's own."""
    run, steps = released(stewart()), simulator()
    for row in range(1, len(run.t)):
        sample = steps.step(np.zeros(6), 0.01)
        assert steps.stop is None
        np.testing.assert_allclose(sample.q_free, run.q_free[row], rtol=0, atol=1e-8)
        np.testing.assert_allclose(steps.v, run.v[row], rtol=0, atol=1e-7)
    np.testing.assert_array_equal(steps.sample().q_free, sample.q_free)


def test_the_state_is_on_the_platforms_own_joints():
    """`Simulator.state` is a State of the model's own tree, closed, with q′ as sampled."""
    moving = simulator()
    moving.advance(0.55)
    state, sample = moving.state, moving.sample()
    assert state.model.mechanism.tree is stewart().mechanism.tree
    np.testing.assert_array_equal(state.q_free, sample.q_free)
    reading = stewart().reading(state, state.model.coordinates.jacobian(state.q_free) @ sample.v_free)
    np.testing.assert_allclose(reading.q, sample.q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(reading.v, sample.v, rtol=0, atol=1e-9)


def test_memory_goes_on_to_the_last_bit():
    """Brought back in the midst, in another simulator, at any moment."""
    through = simulator()
    for moment in (0.46, 0.48, 0.53, 0.58):
        through.advance(moment)
        other = Simulator(stewart(), None, **INTEGRATOR)
        memory = through.memory()
        other.recall(memory)
        through.recall(memory)
        for one in (through, other):
            one.advance(moment + 0.01)
        for ours, theirs in zip(through.sample(), other.sample(), strict=True):
            np.testing.assert_array_equal(ours, theirs)


def test_a_memory_is_not_taken_where_something_acts_between():
    """A simulator with friction on one of the three has no ball there, and takes no memory of one that has."""
    moving = simulator()
    moving.advance(0.5)
    other = Simulator(stewart(), None, friction={TRIPLE[1]: (0.1, 0.0)})
    with pytest.raises(DifferentSubjectsError):
        other.recall(moving.memory())


@pytest.mark.slow
@same_on_both
def test_a_torque_function_goes_on_and_its_work_is_the_energy():
    """Motors on the legs: T + V grows by ∫ uᵀq̇ dt, and the function reads q and q̇ of the legs."""
    seen = []

    def torque(t, q, v):
        seen.append(q.shape + v.shape)
        return 2.0 * np.sin(20 * t + np.arange(6))

    run = released(stewart(), law=torque, sample_period=5e-4)
    total = sum(run.energy(stewart()))
    work = simpson(np.einsum("ti,ti->t", run.u, run.v), x=run.t)
    assert (run.status, set(seen)) == ("finished", {(6, 6)})
    assert any("ball joint" in note for note in run.notes)
    assert total[-1] - total[0] == pytest.approx(work, rel=1e-6)


@same_on_both
def test_a_sampled_function_goes_on():
    """A digital controller reads the legs' q."""
    seen = []

    def torque(t, q, v):
        seen.append(np.concatenate([q, v]))
        return np.zeros(6)

    run, free = released(stewart(), law=torque, sampling=Sampling(0.01)), released(stewart())
    assert run.status == "finished"
    np.testing.assert_allclose(seen[: len(free.t)], np.hstack([free.q, free.v])[: len(seen)], rtol=0, atol=1e-6)


LOADS = {
    "friction": {"friction": {"leg1_extension": (2.0, 1.0), "leg4_pitch": (0.1, 0.0)}},
    "wrench": {"wrenches": {"platform": [3.0, -2.0, 1.0, 0.1, 0.2, -0.1]}},
}


@pytest.mark.parametrize("options", [LOADS["friction"], pytest.param(LOADS["wrench"], marks=same_on_both)], ids=LOADS)
def test_what_acts_elsewhere_acts_alike(options):
    """Friction of legs and a wrench on the platform: the motion and the forces told are those of the one on balls."""
    ours, theirs = (released(model, **options) for model in (stewart(), stewart_on_balls()))
    assert (ours.status, ours.changes > 0) == ("finished", True)
    np.testing.assert_allclose(ours.q, theirs.q, rtol=0, atol=1e-6)
    columns = [
        [mechanism.tree.joint(name).v.start for name in ("leg1_extension", "leg4_pitch")]
        for mechanism in (stewart().mechanism, stewart_on_balls().mechanism)
    ]
    np.testing.assert_allclose(ours.friction[:, columns[0]], theirs.friction[:, columns[1]], rtol=0, atol=1e-4)
    rest = np.delete(ours.friction, columns[0], axis=1)
    assert not rest.any()


INBETWEEN = {
    "friction": {"friction": {"platform_roll": (1e-9, 0.0)}},
    "wrench": {"wrenches": {"platform_pitch_frame": [0, 0, 0, 0, 0, 0]}},
}


@same_on_both  # NumPy's lock ends a motion in `test_joints_that_move_no_mass_end_a_passive_motion`
@pytest.mark.parametrize("options", later(*INBETWEEN.values()), ids=INBETWEEN)
def test_a_triple_on_which_something_acts_is_no_ball(options):
    """What acts on one of the three turns about its axis: the lock ends that motion, and says so."""
    run = released(stewart(), **options)
    assert run.status != "finished"
    assert not any("ball joint" in note for note in run.notes)
    assert run.t[-1] == pytest.approx(LOCKED_AT, abs=5e-3)


def test_a_law_stated_in_its_coordinates_takes_the_motion_back():
    """A law put in after the lock goes on in the legs' lengths and the triple's own angles, where these are defined."""
    moving = simulator()
    moving.advance(0.55)
    before = moving.sample()
    moving.law = PDSimpleGravity(stewart(), before.q, 50.0 * np.ones(6), 5.0 * np.ones(6))
    moving.advance(0.5501)
    after = moving.sample()
    np.testing.assert_allclose(after.q_free, before.q_free, rtol=0, atol=0.02)
    assert moving.state.model is stewart()
    moving.law = None
    moving.advance(0.6)
    assert moving.stop is None


def test_an_interrupt_keeps_what_was_told():
    """A law that is interrupted in the midst: the samples up to there are whole, on the platform's own joints."""

    def torque(t, q, v):
        if t > 0.52:
            raise KeyboardInterrupt
        return np.zeros(6)

    run = released(stewart(), law=torque)
    assert (run.status, run.q_free.shape[1]) == ("interrupted", stewart().mechanism.nq)
    assert 0.5 < run.t[-1] <= 0.52 + 1e-6


@pytest.mark.parametrize(("name", "duration"), [pytest.param("hexa", 1.0, marks=same_on_both), ("delta", 0.4)])
def test_a_hexa_and_a_delta_go_on_too(name, duration):
    """Their triples are of joints in another order: the Hexa falls on for a second, the Delta until it is flat."""
    model = ccpin.ReducedModel(ccpin.load(name))
    run = ccpin.simulate(model, None, model.alpha(model.mechanism.q_reference), duration=duration, **TIGHT)
    assert_it_goes_on(model, run, duration)
