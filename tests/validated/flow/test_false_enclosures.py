"""Searches for enclosures that go wrong: what they propose is refused, and costs a verdict, never makes a false one."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("flint")

from ccpin.errors import ConvergenceError
from ccpin.proof.facts import prove
from ccpin.validated import enclose
from ccpin.validated.flow import crossing, enclosing, proved_steps, start_search
from ccpin.validated.flow.motion_task import MotionTask
from ccpin.validated.flow.step_claim import step_of
from tests.oracles import rpdr as oracle
from tests.support.enclosures import FREE, accurately, paper_law
from tests.support.paper import START

QUICK = {"order": 12, "tolerance": 1e-12, "pieces": 2, "precision": 64, "longest_step": 2.0**-9}
DURATION = 0.008
FLUNG = np.radians([-108.0, -72.0]), [-8.0, 8.0]


def enclosed(model, law, **more):
    return enclose(model, law, START, None, DURATION, **QUICK | more)


@pytest.fixture(scope="module")
def honest(rpdr_model, law):
    found = enclosed(rpdr_model, law)
    assert found.verdict == "proven"
    assert len(found.steps) == 5
    return found


@pytest.fixture(scope="module")
def motion(rpdr_model, law):
    return accurately(rpdr_model, law, START, None, DURATION)


@pytest.fixture
def true(motion):
    """That what is told of a motion, as far as it is told, holds what an integrator computes."""

    def told(found):
        known = motion.t <= found.times[-1]
        states = zip(motion.t[known], motion.q_free[known], motion.v[known], strict=True)
        return all(found.contains(*state, tolerance=1e-9) for state in states)

    return told


def changed(monkeypatch, change):
    """`ProvedSteps` whose proposals from the second step on are changed."""
    made, calls = proved_steps.StepEnclosed, []

    def claim(*given):
        calls.append(given)
        own = made(*given)
        return own if len({each[1].tobytes() for each in calls}) < 2 else replace(own, **change(own))

    monkeypatch.setattr(proved_steps, "StepEnclosed", claim)


CHANGES = {
    "starts moved": lambda own: {"centre": own.centre + 1e-6},
    "starts without their errors": lambda own: {"radius": 0.0 * own.radius},
    "smaller boxes": lambda own: {"radius": 0.999 * own.radius},
    "no velocity": lambda own: {"centre": own.centre * (np.arange(len(own.centre)) < 4)[:, None]},
    "centres of one double": lambda own: {"centre": own.centre[:, :1]},
}


@pytest.mark.parametrize("name", CHANGES)
def test_steps_from_other_boxes(rpdr_model, law, monkeypatch, true, name):
    """Each is proved, and they do not make the motion."""
    changed(monkeypatch, CHANGES[name])
    found = enclosed(rpdr_model, law)
    assert found.verdict == "undecided"
    assert "elsewhere" in found.reason
    assert true(found)


def test_steps_that_are_too_long(rpdr_model, law, monkeypatch, true):
    """Not proved, or proved as long as they are."""
    for factor in (1.5, 40.0):
        with monkeypatch.context() as context:
            changed(context, lambda own, k=factor: {"length": k * own.length})
            found = enclosed(rpdr_model, law)
        assert true(found)
        assert found.verdict == "undecided" or found.times[-1] >= DURATION


def test_fewer_pieces_orders_and_bits_than_asked_for(rpdr_model, law, monkeypatch, true):
    """What is proved with them is wider, and holds the motion all the same."""
    for change in ({"pieces": np.array([1])}, {"order": np.array([8])}, {"precision": np.array([53])}):
        with monkeypatch.context() as context:
            changed(context, lambda own, c=change: c)
            assert true(enclosed(rpdr_model, law))


def steps_changed(monkeypatch, change):
    """`proved_motion` of other steps than those that were taken."""
    told = enclosing.proved_motion
    monkeypatch.setattr(
        enclosing, "proved_motion", lambda loop, start, steps, *rest: told(loop, start, change(steps), *rest)
    )


LEFT_OUT = {
    "a step in the middle": lambda steps: [*steps[:2], *steps[3:]],
    "the first step": lambda steps: steps[1:],
    "steps in another order": lambda steps: [steps[1], steps[0], *steps[2:]],
    "a step twice": lambda steps: [*steps, steps[-1]],
}


@pytest.mark.parametrize("name", LEFT_OUT)
def test_chains_with_a_gap(rpdr_model, law, monkeypatch, name):
    steps_changed(monkeypatch, LEFT_OUT[name])
    found = enclosed(rpdr_model, law)
    assert (found.verdict, len(found.steps)) == ("undecided", 0)
    assert "elsewhere" in found.reason


def test_a_motion_that_ends_early_is_not_the_whole(rpdr_model, law, monkeypatch, true):
    steps_changed(monkeypatch, lambda steps: steps[:-1])
    found = enclosed(rpdr_model, law)
    assert (found.verdict, len(found.steps)) == ("undecided", 4)
    assert true(found)


def test_steps_of_another_loop(rpdr_model, law, monkeypatch, honest):
    """Of another gain, and of none at all."""
    other = enclosed(rpdr_model, paper_law(rpdr_model, [11.0 * (1 + 1e-9), 11.0]))
    for steps in (other.steps, [step._replace(fact=None) for step in honest.steps], honest.steps[:2] + other.steps[2:]):
        with monkeypatch.context() as context:
            steps_changed(context, lambda _, own=steps: own)
            found = enclosed(rpdr_model, law)
        assert (found.verdict, len(found.steps)) == ("undecided", 0)


def test_starts_on_another_branch(rpdr_model, law, monkeypatch):
    """Newton's method goes to the other assembly mode; or the whole start is that mode's, or another q's."""
    mode = oracle.sigma(START, -1.0)[FREE]
    honest_near, honest_start = start_search.closed_near, MotionTask.start
    monkeypatch.setattr(start_search, "closed_near", lambda loop, q, x: honest_near(loop, q, mode))
    with pytest.raises(ConvergenceError, match="near the computed"):
        enclosed(rpdr_model, law)
    monkeypatch.setattr(start_search, "closed_near", honest_near)
    for change in ({"x": mode}, {"v": np.array([1e-9, 0.0])}):
        with monkeypatch.context() as context:
            context.setattr(MotionTask, "start", lambda self, asked, c=change: honest_start(self, asked._replace(**c)))
            assert enclosed(rpdr_model, law).verdict == "undecided"

    def moved(self, asked):
        return honest_start(self, asked._replace(q=asked.q._replace(parts=asked.q.parts + 1e-12)))

    monkeypatch.setattr(MotionTask, "start", moved)
    assert enclosed(rpdr_model, law).verdict == "undecided"


def test_starts_in_too_small_a_box(rpdr_model, law, monkeypatch):
    """The box that is to hold y does not, or it is alone in none as large."""
    found = start_search.closed_near
    for change, told in (
        (lambda near: near._replace(sharp=[r * 1e-60 for r in near.radius]), "smaller box"),
        (lambda near: near._replace(radius=[1.5] * 2), "single"),
    ):
        with monkeypatch.context() as context:
            context.setattr(start_search, "closed_near", lambda *given, c=change: c(found(*given)))
            with pytest.raises(ConvergenceError, match=told):
                enclosed(rpdr_model, law)


def test_enclosures_are_about_what_was_asked(rpdr_model, law, honest):
    """Other starts, longer times, other loops, no facts, and columns that are no fact's: none is proven."""
    other = enclosed(rpdr_model, paper_law(rpdr_model, [11.5, 11.0]))
    asked = honest.asked
    assert replace(honest).verdict == "proven"
    for change in (
        {"motion": None},
        {"motion": honest.motion.premises[0]},
        {"motion": honest.motion.claim},
        {"asked": None},
        {"asked": asked._replace(duration=honest.times[-1] * (1 + 1e-15))},
        {"asked": asked._replace(v=asked.v + 1e-12)},
        {"asked": asked._replace(x=asked.x * (1 + 1e-12))},
        {"asked": asked._replace(q=asked.q._replace(parts=asked.q.parts * (1 + 1e-12)))},
        {"asked": asked._replace(q=asked.q._replace(radius=asked.q.radius + 1e-12))},
        {"motion": other.motion},
        {"loop": other.loop},
        {"times": honest.times * 1.5},
        {"determinant": honest.determinant * 1.5},
        {"steps": honest.steps[::-1]},
        {"steps": other.steps},
        {"left_open": honest.left_open - 1.0},
    ):
        assert replace(honest, **change).verdict == "undecided"
    assert replace(honest, asked=asked._replace(duration=honest.times[-1])).verdict == "proven"
    assert replace(honest, motion=None).replay().verdict == "undecided"
    assert "replayed" in replace(honest, motion=None).reason
    assert replace(honest, assumes=", but").reason == honest.reason + ", but"
    again = honest.replay()
    assert (again.verdict, again.reason) == ("proven", honest.reason)
    assert again.motion is not honest.motion
    np.testing.assert_array_equal(again.q_free_lower, honest.q_free_lower)


@pytest.fixture(scope="module")
def flung(rpdr_model):
    """A motion into a singularity."""
    quick = {"order": 10, "tolerance": 1e-7, "pieces": 4, "precision": 64, "shortest_step": 2.0**-9}
    found = enclose(rpdr_model, None, *FLUNG, 0.1, **quick)
    assert found.verdict == "refuted"
    return found


@pytest.mark.slow
def test_singularities_are_met_by_this_motion(flung, honest):
    """Not by another, nor the claim of it; a fact of another kind is none."""
    assert flung.witness.kind == "singular"
    for change in (
        {"met": None},
        {"met": flung.motion},
        {"met": flung.met.claim},
        {"motion": flung.motion.replay()},
        {"asked": honest.asked},
        {"loop": honest.loop},
    ):
        other = replace(flung, **change)
        assert (other.verdict, other.witness) == ("undecided", None)
    again = flung.replay()
    assert (again.verdict, again.reason) == ("refuted", flung.reason)
    assert again.witness.q_free == pytest.approx(flung.witness.q_free, abs=1e-12)


def test_false_crossings(flung, rpdr_model, monkeypatch):
    """Times that are told too late or early, another mechanism's steps, steps that are left out: none is met."""
    motion, *steps = flung.met.premises
    claim = flung.met.claim
    for change in (
        {"first": claim.last, "after": claim.before + 2.0**-40},
        {"last": claim.first * 0, "before": claim.before * 0 + 2.0**-40},
    ):
        with pytest.raises(crossing.NotProvedError):
            prove(replace(claim, **change), motion, *steps)
    with pytest.raises(crossing.NotProvedError):
        prove(claim, motion, *steps[:-1])
    with pytest.raises(crossing.NotProvedError):
        prove(claim, motion, *steps[1:])
    for late in (lambda loop, taken, unknown: (unknown - 1, 0.0, 0.0), lambda *_: (-1, 0.0, 1.0)):
        monkeypatch.setattr(crossing, "_located", late)
        told = list(map(step_of, steps))
        assert crossing._met(flung.loop.equations, motion, told, len(told), 64) is None
