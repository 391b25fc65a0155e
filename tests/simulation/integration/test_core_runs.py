"""Stretches of a motion in the compiled core, from change to change of coordinates."""

import threading

import numpy as np
import pytest

import ccpin
from ccpin.control import Measurement
from ccpin.simulation import Budget, Event
from ccpin.simulation.integration.run import Run
from tests.support.agreement import reference_model
from tests.support.alarms import alarm
from tests.support.backends import same_on_both
from tests.support.long_cases import later
from tests.support.passive import STRETCHING, TIGHT, assert_it_goes_on, case, released

in_core = pytest.mark.skipif(ccpin.backend().name != "native", reason="the compiled core is not in use")


def simulator(name, **options):
    """One of the linkages that leave their coordinates, let go."""
    model, v = case(name)
    tight = {key: TIGHT[key] for key in ("method", "rtol", "atol")}
    found = ccpin.Simulator(model, None, **(tight | options))
    found.reset(model.alpha(model.mechanism.q_reference), v)
    return found


@in_core
@pytest.mark.parametrize("name", ["five-bar", "RSSR", "Stewart", "strandbeest"])
def test_a_motion_goes_on_in_the_core(name, monkeypatch):
    """Through changes of coordinates NumPy integrates no step."""
    monkeypatch.setattr(Run, "_leg", lambda *arguments: pytest.fail("the core gave up"))
    model, run = released(name, 1.0)
    assert run.changes > 0
    assert_it_goes_on(model, run, 1.0)


@in_core
@pytest.mark.parametrize("name", later("RSSR", "Stewart"))
def test_samples_in_changed_coordinates_are_those_of_numpy(name):
    """q, q̇, q̈ of motors' joints that are not measured by, at a rod's spin and at plain joints, after a change."""
    model, ours = released(name, 0.5)
    slow = reference_model(model.mechanism, model.gravity_vector)
    theirs = ccpin.simulate(slow, None, ours.q[0], case(name)[1], duration=0.5, **TIGHT)
    assert ours.changes == theirs.changes > 0
    assert [event.name for event in ours.events] == [event.name for event in theirs.events]
    np.testing.assert_allclose([e.t for e in ours.events], [e.t for e in theirs.events], rtol=0, atol=2e-2)
    for field in ("q", "v", "a"):
        expected = getattr(theirs, field)
        np.testing.assert_allclose(getattr(ours, field), expected, rtol=0, atol=1e-7 * np.abs(expected).max())
    np.testing.assert_array_equal(ours.u, theirs.u)


def test_output_changes_nothing_of_a_motion_that_changes_coordinates():
    """To the last bit, whatever the sample period."""
    _, coarse = released("RSSR", 0.5, sample_period=0.1)
    _, fine = released("RSSR", 0.5, sample_period=0.0173)
    assert coarse.changes == fine.changes > 0
    np.testing.assert_array_equal(coarse.q_free[-1], fine.q_free[-1])
    assert [event.t for event in coarse.events] == [event.t for event in fine.events]


def test_ctrl_c_after_a_change_keeps_the_motion():
    """What there is comes back with its cause, and the simulator goes on from there as if nothing had been."""
    moving = simulator("five-bar")
    moving.advance(0.5)
    assert any(event.name.startswith("measured by") for event in moving.events)
    with alarm(0.3):
        broken = moving.run(1e4, sample_period=1.0)
    assert (broken.status, type(broken.cause)) == ("interrupted", KeyboardInterrupt)
    assert broken.t[-1] == moving.t < 1e4
    began = moving.t
    rest = moving.run(began + 0.1)
    assert rest.status == "finished"
    np.testing.assert_array_equal(rest.q[0], broken.q[-1])
    model = case("five-bar")[0]
    before, after = (state.energy(v) for state, v, _ in list(rest.states(model))[:: len(rest.t) - 1])
    assert sum(after) == pytest.approx(sum(before), abs=1e-9)


def test_ctrl_c_ends_an_advance_where_the_motion_is_certain():
    """It is where the last certain step ended, and the next call raises the interrupt."""
    moving = simulator("five-bar")
    moving.advance(0.4)
    began = moving.t
    with alarm(0.3):
        reached = moving.advance(1e4)
    assert began < reached.t == moving.t < 1e4
    assert moving.stop.status == "interrupted"
    with pytest.raises(KeyboardInterrupt):
        moving.advance(1e4)
    assert moving.advance(moving.t + 0.01).closure_error <= 1e-10


@same_on_both
@pytest.mark.parametrize("budget", [Budget(evaluations=500), Budget(seconds=1e-3)])
def test_a_budget_ends_a_motion_after_a_change(budget):
    """It is the whole run's and not a stretch's; what comes after is the rest of the same motion."""
    moving = simulator("RSSR")
    moving.advance(0.25)
    assert moving.events
    first = moving.run(0.6, sample_period=0.01, budget=budget)
    assert first.status == "exhausted"
    if budget.evaluations:
        assert budget.evaluations <= first.evaluations < budget.evaluations + 100
    rest = moving.run(0.6, sample_period=0.01)
    _, whole = released("RSSR", 0.6)
    np.testing.assert_allclose(rest.q_free[-1], whole.q_free[-1], rtol=0, atol=1e-6)


@same_on_both
def test_a_run_that_has_ended_can_be_stepped_on():
    """`run`, then `step` with u held and `advance`, after the coordinates were changed: the motion of one run."""
    moving = simulator("five-bar")
    assert moving.run(0.5).changes > 0
    for _ in range(20):
        sample = moving.step(np.zeros(2), 0.005)
    assert moving.advance(0.7).t == pytest.approx(0.7)
    _, whole = released("five-bar", 0.7)
    np.testing.assert_allclose(sample.q, whole.q[60], rtol=0, atol=1e-8)
    np.testing.assert_allclose(sample.a, whole.a[60], rtol=0, atol=1e-6 * np.abs(whole.a).max())
    np.testing.assert_allclose(moving.sample().q_free, whole.q_free[-1], rtol=0, atol=1e-8)


@in_core
def test_held_efforts_go_through_a_change(rpdr_model):
    """Steps with u held, 1 ms each, stretch the loop and go on; both backends and a torque function alike."""
    u = np.array([-0.5, 0.4])
    ends, slow = [], reference_model(rpdr_model.mechanism, rpdr_model.gravity_vector)
    for model in (rpdr_model, slow):
        moving = ccpin.Simulator(model, None, rtol=1e-11, atol=1e-13, method="DOP853")
        moving.reset(*STRETCHING)
        samples = [moving.step(u, 1e-3) for _ in range(150 if model is rpdr_model else 60)]
        assert {sample.u.shape for sample in samples} == {(2,)}
        ends.append(samples)
    assert any(event.name.startswith("measured by") for event in moving.events)
    whole = ccpin.simulate(
        rpdr_model, lambda t, q, v: u, *STRETCHING, duration=0.15, **(TIGHT | {"sample_period": 1e-3})
    )
    for samples in ends:
        for sample, q, v in zip(samples, whole.q[1:], whole.v[1:], strict=False):
            np.testing.assert_allclose(sample.q, q, rtol=0, atol=1e-8)
            np.testing.assert_allclose(sample.v, v, rtol=0, atol=1e-6)


@in_core
@pytest.mark.parametrize("name", ["five-bar", "RSSR", "Stewart", "strandbeest"])
def test_steps_after_a_change_stay_in_the_core(name, monkeypatch):
    """They integrate nothing in NumPy, and q, q̇, q̈, u and q′ are those of the run's own coordinates."""
    whole, moving = simulator(name), simulator(name)
    for each in (whole, moving):
        each.advance(0.5)
        assert each.state.model is not each.model
    ends = [whole.advance(0.5 + 2e-3 * (k + 1)) for k in range(5)]
    monkeypatch.setattr(Run, "advance", lambda *arguments, **options: pytest.fail("the core gave up"))
    for end in ends:
        sample = moving.step(np.zeros(moving.model.n_actuated), 2e-3)
        assert sample.t == pytest.approx(end.t, abs=1e-14)
        for ours, theirs in zip(sample[1:6], end[1:6], strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-8 * max(1.0, np.abs(theirs).max(initial=0.0)))
    monkeypatch.undo()
    assert moving.t == pytest.approx(ends[-1].t, abs=1e-14)
    np.testing.assert_allclose(moving.sample().a, ends[-1].a, rtol=0, atol=1e-7 * np.abs(ends[-1].a).max())
    assert moving.evaluations > 0


@pytest.mark.parametrize("name", [pytest.param("RSSR", marks=in_core), "hung bar"])
def test_a_simulator_reset_steps_as_a_new_one(name):
    """Through changes of coordinates and back to the first ones: the same bits and as many evaluations."""
    model, v = case(name)
    moving, found = simulator(name), []
    u = np.full(model.n_actuated, 0.1)
    for _ in range(2):
        moving.reset(model.alpha(model.mechanism.q_reference), v)
        samples = [moving.step(u, 5e-3) for _ in range(100)]
        assert any(event.name.startswith("measured by") for event in moving.events)
        found.append((np.array([sample.q_free for sample in samples]), moving.evaluations))
    np.testing.assert_array_equal(found[0][0], found[1][0])
    assert found[0][1] == found[1][1]


@in_core
@pytest.mark.parametrize("name", ["five-bar", "Stewart"])
def test_a_step_after_a_change_asks_no_more_often(name):
    """As many evaluations of the equations of motion, after the coordinates are changed as before."""
    moving = simulator(name, method="RK45", rtol=1e-9, atol=1e-11)
    u, asked = np.zeros(moving.model.n_actuated), []
    for until in (0.02, 0.5):
        moving.advance(until)
        moving.step(u, 1e-5)
        before = moving.evaluations
        for _ in range(20):
            moving.step(u, 1e-5)
        asked.append(moving.evaluations - before)
    assert moving.state.model is not moving.model
    assert asked[1] <= asked[0]


@same_on_both
@pytest.mark.parametrize("name", ["RSSR", pytest.param("Stewart", marks=in_core)])
def test_memory_taken_after_a_change_is_gone_on_with_to_the_last_bit(name):
    """Another simulator takes up the same coordinates, the centres of their charts included."""
    first, second = simulator(name), simulator(name)
    first.advance(0.5)
    memory = first.memory()
    assert len(memory["measured_by"])
    first.recall(memory)
    second.recall(memory)
    ends = [moving.run(0.7, sample_period=0.01) for moving in (first, second)]
    np.testing.assert_array_equal(ends[0].q_free, ends[1].q_free)
    _, whole = released(name, 0.7)
    np.testing.assert_allclose(ends[0].q_free[-1], whole.q_free[-1], rtol=0, atol=1e-6)


def test_a_memory_that_lacks_something_is_refused(rpdr_model):
    """One of another version, say; the message names what is missing."""
    moving = ccpin.Simulator(rpdr_model)
    moving.reset(STRETCHING[0])
    memory = moving.memory()
    del memory["measured_by"]
    with pytest.raises(ccpin.errors.InvalidInputError, match="has no 'measured_by'"):
        moving.recall(memory)


@in_core
def test_threads_share_a_model_whose_motions_change_coordinates():
    """Two at once are each what one alone is, bit for bit."""
    _, alone = released("RSSR", 0.5)
    found = {}

    def go(k):
        found[k] = released("RSSR", 0.5)[1]

    threads = [threading.Thread(target=go, args=(k,)) for k in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for k in range(2):
        np.testing.assert_array_equal(found[k].q_free, alone.q_free)


def test_a_law_stated_in_the_coordinates_takes_over_where_they_are_good_again():
    """After a passive swing through other coordinates a set-point law acts in the model's own."""
    moving = simulator("five-bar")
    model = case("five-bar")[0]
    moving.advance(0.5)
    law = ccpin.control.PDSimpleGravity(model, moving.sample().q, [5.0, 5.0], [0.5, 0.5])
    moving.law = law
    motion = moving.run(0.52, sample_period=1e-3)
    assert motion.status == "finished"
    for q, v, u, q_free in zip(motion.q, motion.v, motion.u, motion.q_free, strict=True):
        np.testing.assert_allclose(u, law.torque(0.0, Measurement(q, q_free), v), rtol=0, atol=1e-9)


@pytest.mark.parametrize("watched", ["region", "event"])
def test_what_reads_the_models_state_ends_where_its_coordinates_do(watched):
    """Events and regions read a State of the model: such a motion ends by name where others go on."""
    model, v = case("five-bar")
    options = {"region": lambda q: True} if watched == "region" else {"events": [Event(lambda t, state, v: 1.0)]}
    moving = ccpin.Simulator(model, None, **options)
    moving.reset(model.alpha(model.mechanism.q_reference), v)
    motion = moving.run(1.0, sample_period=0.05)
    assert (motion.status, motion.changes) == ("singular", 0)
    assert "events, a region, limits or contacts are looked for" in motion.message
    assert motion.closure_error.max() <= 1e-10


@in_core
def test_a_law_of_a_kind_that_the_core_does_not_know_runs_as_a_function_does(rpdr_model):
    """The motion is that of the same law where it states nothing."""

    class Sliding(ccpin.control.PDSimpleGravity):
        def statement(self):
            return super().statement()._replace(kind="sliding")

    class Silent(ccpin.control.PDSimpleGravity):
        def statement(self):
            return None

    start = rpdr_model.alpha(rpdr_model.mechanism.q_reference)
    of_kind, silent = (
        ccpin.simulate(rpdr_model, law(rpdr_model, start, 6.0, 0.6), start + 0.1, duration=0.1)
        for law in (Sliding, Silent)
    )
    np.testing.assert_array_equal(of_kind.q, silent.q)
