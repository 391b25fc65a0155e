"""An adaptive law's runs in the compiled core are the reference's, estimate by estimate."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

import ccpin
from ccpin.control import Sampling, Waypoints
from ccpin.control.control_law import Delayed
from ccpin.identification import AdaptiveTracking, with_constants
from ccpin.identification.adaptive.estimate_history import _in_python
from tests.support.agreement import reference_model
from tests.support.alarms import alarm
from tests.support.long_cases import later
from tests.support.places import ROOT

pytestmark = pytest.mark.skipif(ccpin.backend().name != "native", reason="the compiled core is not in use")
ANKLE = str(ROOT / "docs" / "howto" / "ankle.urdf")
HALF = {"rpdr": 0.3, "delta": 0.1, ANKLE: 0.15}
LOOSE = {"rtol": 1e-6, "atol": 1e-8}


def driven(name):
    """A model whose motors sit on its coordinates, of joints with rotors, dampers and springs."""
    plain = ccpin.load(name)
    physics = {"armature": 1e-3, "damping": 0.02, "stiffness": 0.2, "spring_reference": 0.1}
    description = plain.description
    turning = {"revolute", "prismatic"}
    joints = tuple(replace(joint, **physics) if joint.kind in turning else joint for joint in description.joints)
    return ccpin.ReducedModel(ccpin.load(replace(description, joints=joints), independent=plain.actuated))


def law_of(model, half, kind=AdaptiveTracking, **changed):
    """A law that learns all that bodies and joints have, along a way there and back."""
    start = model.alpha(model.mechanism.q_reference)
    way = half * np.resize([1.0, -0.7], model.n)
    reference = Waypoints(model, [0.0, 0.3, 0.7], [start, start + way, start])
    numbers = {"slope": 20.0, "K": np.linspace(1.0, 2.0, model.n), "gain": 500.0, "period": 1e-3}
    return kind(model, reference, **numbers | {"adapted": ["body", "damping", "stiffness"], "bounds": 0.5} | changed)


def plant_of(law):
    """A robot with other constants than the law thinks at first."""
    theta = law.lower + (law.upper - law.lower) * np.resize([0.9, 0.2, 0.7], len(law.adapted))
    return ccpin.ReducedModel(ccpin.load(with_constants(law.model, law.constants(theta))))


@pytest.fixture(scope="module")
def rpdr():
    return law_of(driven("rpdr"), 0.3)


@pytest.fixture(scope="module")
def plant(rpdr):
    return plant_of(rpdr)


def in_core(motion):
    return any("stepped by the compiled core" in note for note in motion.notes)


def assert_same(motion, theirs, apart):
    """The same instants, states, efforts."""
    assert in_core(motion)
    assert not in_core(theirs)
    assert (motion.status, motion.message) == (theirs.status, theirs.message)
    for field in ("t", "q", "v", "q_free", "u"):
        np.testing.assert_allclose(getattr(motion, field), getattr(theirs, field), rtol=0, atol=apart, err_msg=field)


LOOPS = {
    "plain": None,
    "delay": Sampling(1e-3, delay=2, effort_before=0.1),
    "encoders": Sampling(1e-3, encoder_counts=400_000, velocity_cutoff=200.0),
    "everything": Sampling(1e-3, 400_000, 200.0, 20.0, 1),
}


@pytest.mark.parametrize("name", HALF)
@pytest.mark.parametrize("loop", later("everything", *(name for name in LOOPS if name != "everything")))
def test_a_run_is_the_reference_s(name, loop):
    """Of robots that are not as the law thinks, from off its reference, sample by sample; and what is learnt."""
    law = law_of(driven(name), HALF[name])
    plant, sampling = plant_of(law), LOOPS[loop]
    options = {"duration": 0.02, "sampling": sampling, "sample_period": 1e-3, **LOOSE}
    start, v0 = law.near.q + 0.01, np.full(plant.n, 0.1)
    motion = ccpin.simulate(plant, law, start, v0, **options)
    theirs = ccpin.simulate(reference_model(plant.mechanism), law, start, v0, **options)
    assert_same(motion, theirs, 1e-9)
    assert motion.evaluations == theirs.evaluations
    learnt = law.estimates(motion, sampling=sampling).values
    alone, _ = _in_python(law, sampling or Sampling(law.period), motion.t, motion, np.arange(len(motion.t)))
    np.testing.assert_allclose(learnt, alone, rtol=0, atol=1e-11)
    assert np.abs(learnt[-1] - law.initial).max() > 1e-6


class Asked(AdaptiveTracking):
    """The law, which the reference steps as it has a step of its own."""

    def step(self, t, state, v, estimate):
        return super().step(t, state, v, estimate)


@pytest.mark.filterwarnings("ignore::ccpin.errors.SlowRunWarning")
@pytest.mark.parametrize("name", HALF)
@pytest.mark.parametrize("duration", later(0.03, 5.0))
def test_seconds_are_the_reference_s(name, duration):
    """To 1e-10, with the same evaluations, and so is what is learnt."""
    law, alone = (law_of(driven(name), HALF[name], kind) for kind in (AdaptiveTracking, Asked))
    plant, options = plant_of(law), {"duration": duration, "sample_period": 1e-3, **LOOSE}
    motion, theirs = (ccpin.simulate(plant, each, law.near.q + 0.01, **options) for each in (law, alone))
    assert_same(motion, theirs, 1e-10)
    assert motion.evaluations == theirs.evaluations
    learnt, known = law.estimates(motion).values, alone.estimates(theirs).values
    np.testing.assert_allclose(learnt, known, rtol=0, atol=1e-10)


def test_it_goes_on_with_what_it_has_learnt(rpdr, plant):
    """In pieces, in the core and out of it, it is the run in one; begun again it knows nothing."""
    whole = ccpin.simulate(plant, rpdr, rpdr.near.q, duration=0.03, **LOOSE)
    simulator = ccpin.Simulator(plant, rpdr, **LOOSE)
    simulator.reset(rpdr.near.q)
    pieces = [simulator.run(0.01), simulator.run(0.0203)]
    assert all(map(in_core, pieces))
    simulator.advance(0.03)
    np.testing.assert_allclose(simulator.sample().q, whole.q[-1], rtol=0, atol=1e-12)
    np.testing.assert_allclose(simulator.sample().u, whole.u[-1], rtol=0, atol=1e-9)
    simulator.reset(rpdr.near.q)
    assert simulator.run(0.03).q.tobytes() == whole.q.tobytes()


def test_on_a_clock_that_starts_later(rpdr, plant):
    """The same motion, later."""
    whole = ccpin.simulate(plant, rpdr, rpdr.near.q, duration=0.01, **LOOSE)
    simulator = ccpin.Simulator(plant, Delayed(rpdr, 2.0), **LOOSE)
    simulator.reset(rpdr.near.q, t=2.0)
    motion = simulator.run(2.01)
    assert in_core(motion)
    np.testing.assert_allclose(motion.q, whole.q, rtol=0, atol=1e-12)


def test_threads_share_the_law(rpdr, plant):
    """Eight runs at once are what each is alone, bit for bit."""
    starts = [rpdr.near.q + 0.002 * k for k in range(8)]

    def run(start):
        return ccpin.simulate(plant, rpdr, start, duration=0.02, **LOOSE).q.tobytes()

    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(run, starts))
    assert together == list(map(run, starts))


def test_ctrl_c_ends_a_run_where_it_is(rpdr, plant):
    """What was computed is kept, and the law goes on with what it had learnt."""
    simulator = ccpin.Simulator(plant, rpdr, **LOOSE)
    simulator.reset(rpdr.near.q)
    with alarm(0.2):
        motion = simulator.run(1e4, sample_period=0.1)
    assert motion.status == "interrupted"
    assert in_core(motion)
    whole = ccpin.simulate(plant, rpdr, rpdr.near.q, duration=motion.t[-1] + 0.01, sample_period=0.1, **LOOSE)
    np.testing.assert_allclose(simulator.run(motion.t[-1] + 0.01).q[-1], whole.q[-1], rtol=0, atol=1e-12)


def test_friction_and_wrenches_are_the_plant_s(rpdr, plant):
    """Joints that rub and a pushed link, of which the law knows nothing, as in the reference."""
    link = sorted(plant.mechanism.tree.attachments)[1]
    options = {"duration": 0.01, "friction": {"joint1": (0.02, 0.01)}, "wrenches": {link: [0.0, 1.0, 0, 0, 0, 0]}}
    motion = ccpin.simulate(plant, rpdr, rpdr.near.q, **options, **LOOSE)
    theirs = ccpin.simulate(reference_model(plant.mechanism), rpdr, rpdr.near.q, **options, **LOOSE)
    assert_same(motion, theirs, 1e-9)


@pytest.mark.filterwarnings("ignore:overflow encountered")
def test_what_overflows_is_the_reference_s(rpdr, plant):
    """Slopes of 1e200, whose squares no double holds: motors stay at their limits, and estimates numbers."""
    wild = law_of(rpdr.model, 0.3, slope=1e200)
    motion = ccpin.simulate(plant, wild, rpdr.near.q + 0.01, duration=2e-3, **LOOSE)
    assert not in_core(motion)
    alone, _ = _in_python(wild, Sampling(wild.period), motion.t, motion, np.arange(len(motion.t)))
    assert np.isfinite(alone).all()
    np.testing.assert_array_equal(wild.estimates(motion).values, alone)


class Other(AdaptiveTracking):
    """A law whose step is another."""

    def step(self, t, state, v, estimate):
        found = super().step(t, state, v, estimate)
        return found._replace(effort=0.5 * found.effort)


def test_what_the_core_leaves_to_the_reference(rpdr, plant):
    """Noise, steps of one's own, motors at their limits."""
    noisy = Sampling(1e-3, encoder_noise=1e-5)
    for law, options in ((rpdr, {"sampling": noisy}), (law_of(rpdr.model, 0.3, Other), {})):
        motion = ccpin.simulate(plant, law, rpdr.near.q, duration=2e-3, **options, **LOOSE)
        assert not in_core(motion)
        assert law.estimates(motion, sampling=options.get("sampling")).values.shape == (3, len(law.adapted))
    strong = law_of(rpdr.model, 0.3, K=[400.0, 400.0])
    off = rpdr.near.q + 0.1
    motion = ccpin.simulate(plant, strong, off, duration=3e-3, **LOOSE)
    theirs = ccpin.simulate(reference_model(plant.mechanism), strong, off, duration=3e-3, **LOOSE)
    assert not in_core(motion)
    np.testing.assert_allclose(motion.q, theirs.q, rtol=0, atol=1e-10)
    assert np.abs(motion.u).max() == plant.mechanism.motors.limits.max()
