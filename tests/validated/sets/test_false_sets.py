"""Searches for tubes that go wrong: what they propose is refused, and costs a verdict, never makes a false one."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("flint")

from ccpin.proof.facts import NotProvedError
from ccpin.validated import enclose_set
from ccpin.validated.sets import propagation, set_enclosure, subdivision
from ccpin.validated.sets.subdivision import Starts
from ccpin.validated.sets.tube_theorem import CrossSection
from tests.oracles import rpdr as oracle
from tests.support.enclosures import FREE, accurately, paper_law
from tests.support.long_cases import later
from tests.support.paper import START

QUICK = {"order": 12, "tolerance": 1e-12, "pieces": 2, "precision": 64, "cells": 2, "parts": 1}
DURATION = 2.0**-8
SPREAD = np.array([2e-3, 2e-3, 0.01, 0.01])


def enclosed(model, law, **more):
    return enclose_set(model, law, START, None, DURATION, **{"spread": (2e-3, 0.01)} | QUICK | more)


@pytest.fixture(scope="module")
def honest(rpdr_model, law):
    found = enclosed(rpdr_model, law)
    assert found.verdict == "proven"
    assert len(found.tubes) == 1
    return found


@pytest.fixture(scope="module")
def motions(rpdr_model, law):
    """From the corners of the box."""
    corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * 4)).reshape(4, -1).T[::3] * SPREAD
    return [accurately(rpdr_model, law, START + c[:2], c[2:], DURATION) for c in corners]


@pytest.fixture
def true(motions):
    """That what is told of a set, as far as it is told, holds what an integrator computes of its corners."""

    def told(found):
        reached = found.tubes[0].duration
        return all(
            found.contains(t, q, v, 1e-6)
            for motion in motions
            for t, q, v in zip(motion.t, motion.q, motion.v, strict=True)
            if t <= reached and found.tubes[0].slices
        )

    return told


def slices_changed(monkeypatch, change):
    made = propagation.SlicesHeld
    monkeypatch.setattr(propagation, "SlicesHeld", lambda *given: replace(made(*given), **change(made(*given))))


CHANGES = {
    "smaller cross-sections": lambda own: {"bound": 0.99 * own.bound},
    "cross-sections of nothing": lambda own: {"bound": 0.0 * own.bound},
    "other frames of them": lambda own: {"begin": 0.99 * own.begin},
    "marks too late": lambda own: {"marks": own.marks + 2.0**-30 * (own.marks[-1] < 2.0**-9)},
    "marks left out": lambda own: {
        name: np.delete(getattr(own, name), 0, axis=0) for name in ("marks", "frame", "rate", "curve", "room")
    },
}


@pytest.mark.parametrize("name", later(*CHANGES))
def test_slices_from_other_cross_sections(rpdr_model, law, monkeypatch, true, name):
    """Each is proved, and they do not make the tube."""
    slices_changed(monkeypatch, CHANGES[name])
    found = enclosed(rpdr_model, law)
    assert found.verdict == "undecided"
    assert true(found)


@pytest.mark.slow
def test_frames_and_room_that_are_chosen_badly(rpdr_model, law, monkeypatch, true):
    """What is proved with them is wider, or nothing."""
    for change in ({"rate": 0.0}, {"curve": 30.0}, {"room": 0.5}, {"frame": 1.25}):
        with monkeypatch.context() as context:
            slices_changed(
                context, lambda own, c=change: {name: factor * getattr(own, name) for name, factor in c.items()}
            )
            assert true(enclosed(rpdr_model, law))


def test_first_sections_that_leave_starts_out(rpdr_model, law, monkeypatch):
    honest_section = subdivision.first_section

    def smaller(loop, step, spread):
        frame, bound = honest_section(loop, step, spread)
        return CrossSection(frame, bound * (1.0 - 1e-9))

    monkeypatch.setattr(subdivision, "first_section", smaller)
    found = enclosed(rpdr_model, law)
    assert (found.verdict, found.tubes[0].slices) == ("undecided", ())
    assert "end with" in found.reason


@pytest.mark.slow
def test_samples_that_are_not_read(rpdr_model, law, monkeypatch):
    """The tube goes on with the efforts held before; or with what the law makes of a smaller section."""
    period = {"period": 2.0**-9, "spread": (1e-3, 0.01)}
    assert enclosed(rpdr_model, law, **period).verdict == "proven"
    read = subdivision.sampled_section
    for n, change in (
        (1, lambda *given: given[2]),
        (0, lambda *given: read(*given)._replace(bound=read(*given).bound / 2)),
    ):
        count = [0]

        def told(*given, change=change, count=count, n=n):
            count[0] += 1
            return change(*given) if count[0] > n else read(*given)

        with monkeypatch.context() as context:
            context.setattr(subdivision, "sampled_section", told)
            found = enclosed(rpdr_model, law, **period)
        assert (found.verdict, found.tubes[0].slices) == ("undecided", ())


LEFT_OUT = {
    "slices in the middle": lambda slices: [*slices[:1], *slices[2:]],
    "the first slices": lambda slices: slices[1:],
    "slices in another order": lambda slices: [slices[1], slices[0], *slices[2:]],
    "slices twice": lambda slices: [*slices, slices[-1]],
    "no slices": lambda slices: [],
}


def held_changed(monkeypatch, change):
    told = subdivision._held
    monkeypatch.setattr(
        subdivision, "_held", lambda loop, motion, slices, *rest: told(loop, motion, change(slices), *rest)
    )


@pytest.mark.parametrize("name", later(*LEFT_OUT))
def test_tubes_with_a_gap(rpdr_model, law, monkeypatch, name):
    monkeypatch.setattr(propagation, "_AT_ONCE", 8)
    held_changed(monkeypatch, LEFT_OUT[name])
    found = enclosed(rpdr_model, law, longest_slice=2.0**-10)
    assert (found.verdict, found.tubes[0].slices) == ("undecided", ())


@pytest.mark.slow
def test_a_tube_that_ends_early_is_not_the_whole(rpdr_model, law, monkeypatch, true):
    monkeypatch.setattr(propagation, "_AT_ONCE", 8)
    held_changed(monkeypatch, lambda slices: slices[:-1])
    found = enclosed(rpdr_model, law, longest_slice=2.0**-10)
    assert found.verdict == "undecided"
    assert 0.0 < found.tubes[0].duration < DURATION
    assert true(found)


@pytest.mark.slow
def test_slices_round_another_motion(rpdr_model, law, monkeypatch, honest):
    """Of another gain; of a motion that is not this one."""
    other = enclosed(rpdr_model, paper_law(rpdr_model, [11.0 * (1 + 1e-9), 11.0]))
    for tube in (other.tubes[0], honest.tubes[0]):
        with monkeypatch.context() as context:
            held_changed(context, lambda _, own=tube: list(own.held.premises[1:]))
            found = enclosed(rpdr_model, law)
        assert (found.verdict, found.tubes[0].slices) == ("undecided", ())


def test_tubes_are_about_what_was_asked(rpdr_model, law, honest):
    """Other starts, longer times, other motions, no facts: none is proven."""
    (tube,) = honest.tubes
    own, starts = tube.enclosure, tube.starts
    other = enclosed(rpdr_model, paper_law(rpdr_model, [11.5, 11.0])).tubes[0]
    mode = oracle.sigma(START, -1.0)[FREE]
    assert replace(tube).verdict == "proven"
    for change in (
        {"held": None},
        {"held": tube.held.premises[0]},
        {"held": tube.held.claim},
        {"held": other.held},
        {"held": tube.held.replay()},
        {"held": honest.covered},
        {"enclosure": other.enclosure},
        {"enclosure": replace(own, motion=None)},
        {"enclosure": replace(own, loop=other.enclosure.loop)},
        {"enclosure": replace(own, asked=own.asked._replace(x=mode))},
        {"asked": np.nextafter(tube.duration, 1.0)},
        {"asked": np.inf},
        {"starts": starts._replace(q=starts.q * (1 + 1e-12))},
        {"starts": starts._replace(v=starts.v + 1e-12)},
        *({"starts": starts._replace(spread=SPREAD * (1 + 1e-12 * (np.arange(4) == k)))} for k in range(4)),
    ):
        assert replace(tube, **change).verdict == "undecided"
        assert "not replayed" in replace(tube, **change).reason
        assert replace(honest, tubes=(replace(tube, **change),)).verdict == "undecided" or "asked" in change
    assert replace(tube, starts=starts._replace(spread=0.5 * SPREAD)).verdict == "proven"
    assert replace(tube, held=None, asked=0.0).verdict == "undecided"


@pytest.mark.slow
def test_sets_are_about_what_was_asked(rpdr_model, law, honest):
    starts = honest.starts
    other = enclosed(rpdr_model, paper_law(rpdr_model, [11.5, 11.0]))
    for change in (
        {"covered": None},
        {"covered": honest.tubes[0].held},
        {"covered": honest.covered.claim},
        {"covered": other.covered},
        {"covered": honest.covered.replay()},
        {"tubes": other.tubes},
        {"tubes": ()},
        {"tubes": honest.tubes * 2},
        {"asked": np.nextafter(DURATION, 1.0)},
        {"starts": starts._replace(q=starts.q + 1e-12)},
        {"starts": starts._replace(v=starts.v + 1e-12)},
        {"starts": starts._replace(spread=starts.spread * (1 + 1e-12))},
    ):
        assert replace(honest, **change).verdict == "undecided"
        assert "not replayed" in replace(honest, **change).reason
    assert replace(honest, asked=0.5 * DURATION).verdict == "proven"
    assert replace(honest, assumes=", but").reason == honest.reason + ", but"
    sent = pickle.loads(pickle.dumps(honest))
    assert (sent.verdict, sent.tubes[0].verdict, sent.tubes[0].slices) == ("undecided", "undecided", ())
    again = sent.replay()
    assert (again.verdict, again.reason) == ("proven", honest.reason)
    assert again.contains(DURATION, *(np.split(sum(honest.tubes[0].box(DURATION)[:1]), 2)))
    alone = replace(sent, covered=None).replay()
    assert (alone.verdict, alone.tubes[0].verdict) == ("undecided", "proven")
    assert replace(sent.tubes[0], held=None).replay().verdict == "undecided"


@pytest.mark.slow
def test_parts_that_leave_starts_out(rpdr_model, law, monkeypatch):
    """Halves that are smaller, or apart, by a little; a half that is told to be the whole."""
    grown = subdivision._grown

    def halved(task, starts):
        tube, _ = grown(task, starts)
        return (replace(tube, asked=np.inf) if starts.spread[0] > 1.5e-3 else tube), 0

    monkeypatch.setattr(subdivision, "_grown", halved)
    found = enclosed(rpdr_model, law, parts=4)
    assert found.verdict == "proven"
    assert len(found.tubes) == 2
    halves = Starts.halves

    def smaller(self, k):
        low, high = halves(self, k)
        return low, high._replace(spread=high.spread * (1 - 1e-9))

    def apart(self, k):
        low, high = halves(self, k)
        return low, high._replace(q=high.q + 1e-9)

    def one(self, k):
        low, _ = halves(self, k)
        return low, low

    for change in (smaller, apart, one):
        with monkeypatch.context() as context:
            context.setattr(Starts, "halves", change)
            false = enclosed(rpdr_model, law, parts=4)
        assert false.verdict == "undecided"
        assert "not in its tube" in false.reason


@pytest.mark.slow
def test_a_covering_with_a_tube_left_out(rpdr_model, law, monkeypatch):
    search = set_enclosure.cover
    for change in (
        lambda found: found._replace(tubes=found.tubes[:-1]),
        lambda found: found._replace(tubes=found.tubes * 2),
        lambda found: found._replace(tubes=[replace(found.tubes[0], held=None)]),
        lambda found: found._replace(cut=[]),
    ):
        with monkeypatch.context() as context:
            context.setattr(set_enclosure, "cover", lambda *given, c=change: c(search(*given)))
            assert enclosed(rpdr_model, law).verdict == "undecided"


def test_what_was_sent_and_altered_is_refused(honest):
    sent = pickle.loads(pickle.dumps(honest))
    tube = sent.covered.premises[0]
    wider = tube._replace(claim=replace(tube.claim, spread=2.0 * tube.claim.spread))
    with pytest.raises(NotProvedError):
        replace(sent, covered=sent.covered._replace(premises=(wider,))).replay()
