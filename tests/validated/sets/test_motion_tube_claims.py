"""Claims about tubes that are forged: misshapen, altered, with borrowed premises, of parts that leave starts out."""

import pickle
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm

pytest.importorskip("flint")

from ccpin.programs.tape import Tape
from ccpin.proof.facts import NotProvedError, Unproved, prove
from ccpin.validated.arithmetic.ball_arrays import BallArray, exactly
from ccpin.validated.arithmetic.balls import flint
from ccpin.validated.arithmetic.programs import in_balls
from ccpin.validated.flow.motion_claim import MotionEnclosed
from ccpin.validated.flow.step_claim import StepEnclosed, step_of
from ccpin.validated.sets.curvature import UnboundedError
from ccpin.validated.sets.motion_tube_claim import TubeHeld
from ccpin.validated.sets.propagation import grow
from ccpin.validated.sets.set_claim import SetEnclosed
from ccpin.validated.sets.slices_claim import SlicesHeld, last_instant, last_section, marks_held
from ccpin.validated.sets.subdivision import Starts, Tube
from ccpin.validated.sets.tube_theorem import CrossSection, gains_about, handed_on
from tests.support.parabola import equations, linear, loop, parabola
from tests.support.tubes import BITS, ONE_CELL, motion_of, slices_about, tube_about

SPREAD = np.array([0.01, 0.02])
LENGTH = 3 * 2.0**-5
FLOW = np.array([[0.0, 1.0], [-4.0, -0.5]])


def refused(claim, *premises, match=None):
    with pytest.raises(NotProvedError, match=match):
        prove(claim, *premises)


def spring():
    """Q̈ = −4q − 0.5q̇."""
    return equations(linear(np.array([[4.0]]), np.array([[0.5]])))


@pytest.fixture(scope="module")
def held():
    """A tube over three steps: its motion, its slices and the fact about it."""
    motion = motion_of(spring(), [0.5], [], [-0.25], LENGTH)
    assert len(motion.premises) == 4
    fact = tube_about(motion, SPREAD)
    _, *slices = fact.premises
    assert len(slices) == 3
    return motion, slices, fact


# Slices.


def test_slices_are_what_the_theorem_computes(held):
    """Every start of the first cross-section is in them, nearly up to their bounds."""
    _, slices, _ = held
    first = slices[0]
    marks, claim, found = marks_held(first), first.claim, first.found
    assert len(found["bound"]) == len(marks) - 1 == len(claim.frame) > 1
    assert marks.tolist() == claim.marks.tolist()
    corners = claim.begin @ (claim.bound[:, None] * np.array([[1.0, 1.0], [1.0, -1.0]]).T)
    for k, (first_mark, mark) in enumerate(pairwise(marks)):
        end = np.linalg.solve(found["end"][k], expm(FLOW * mark) @ corners)
        assert np.all(np.abs(end).max(axis=1) <= found["kept"][k])
        assert np.all(found["kept"][k] < found["bound"][k])
        assert np.all(np.abs(end).max(axis=1) >= 0.97 * found["kept"][k])
        middle = expm(FLOW * 0.5 * (first_mark + mark)) @ corners
        assert np.all(np.abs(middle).max(axis=1) <= found["reach"][k])
    section, instant = last_section(first), last_instant(first)
    np.testing.assert_array_equal(section.frame.mid, found["end"][-1])
    np.testing.assert_array_equal(section.frame.rad, found["end_radius"][-1])
    np.testing.assert_array_equal(section.bound, found["kept"][-1])
    assert instant.time.tolist() == [0.5 * (marks[-1] + marks[-2])]
    assert instant.half.tolist() == [0.5 * (marks[-1] - marks[-2])]


def test_as_many_slices_are_told_as_are_held(held):
    """Where the room of one is too small those before it are; of none nothing is."""
    claim, step = held[1][0].claim, held[0].premises[1]
    room = claim.room.copy()
    room[1] = 0.5 * claim.bound
    less = prove(replace(claim, room=room), step)
    assert len(less.found["bound"]) == 1
    assert marks_held(less).tolist() == claim.marks[:2].tolist()
    assert last_instant(less).time.tolist() == [0.5 * claim.marks[1]]
    refused(replace(claim, room=0.5 * room), step, match="too fast")
    whole = prove(claim, step)
    np.testing.assert_array_equal(less.found["kept"], whole.found["kept"][:1])


MISSHAPEN = {
    "marks too few": {"marks": lambda x: x[:-1]},
    "marks too many": {"marks": lambda x: np.append(x, x[-1] + 2.0**-20)},
    "marks that fall back": {"marks": lambda x: x[::-1].copy()},
    "a mark twice": {"marks": lambda x: x * (np.arange(len(x)) > 1)},
    "a later mark twice": {"marks": lambda x: np.concatenate([x[:2], x[1:2], x[3:]])},
    "marks beyond the step": {"marks": lambda x: 2.0 * x},
    "marks before it": {"marks": lambda x: x - 2.0**-10},
    "marks without middles": {"marks": lambda x: np.nextafter(x, 1.0) * (x > 0)},
    "a mark whose middle is none": {"marks": lambda x: np.append(x[:-1], np.nextafter(x[-1], 0.0))},
    "no slices": {name: lambda x: x[:0] for name in ("frame", "rate", "curve", "room")} | {"marks": lambda x: x[:1]},
    "frames of another size": {"frame": lambda x: x[:, :1]},
    "frames too few": {"frame": lambda x: x[1:]},
    "frames that are singular": {"frame": lambda x: 0.0 * x},
    "frames that are no numbers": {"frame": lambda x: x * np.nan},
    "rates that are no numbers": {"rate": lambda x: x * np.nan},
    "rates too fast": {"rate": lambda x: x + 1e4},
    "endless bends": {"curve": lambda x: x + np.inf},
    "no room": {"room": lambda x: 0.0 * x},
    "endless room": {"room": lambda x: x * np.inf},
    "negative room": {"room": lambda x: -x},
    "a section in a singular frame of no numbers": {"begin": lambda x: x * np.nan},
    "a section too wide": {"bound": lambda x: 3.0 * x},
    "a section of negative width": {"bound": lambda x: -x},
    "a width too many": {"bound": lambda x: np.append(x, x)},
    "no cells": {"cells": lambda x: 0 * x},
    "cells that are no whole number": {"cells": lambda x: 1.0 * x},
    "fewer bits than doubles": {"precision": lambda x: x - 12},
}


@pytest.mark.parametrize("name", MISSHAPEN)
def test_no_slices_come_of_other_numbers(held, name):
    claim, step = held[1][0].claim, held[0].premises[1]
    prove(claim, step)
    changed = {key: alter(getattr(claim, key).copy()) for key, alter in MISSHAPEN[name].items()}
    refused(replace(claim, **changed), step)


def test_slices_are_of_one_step(held):
    motion, slices, fact = held
    claim, step = slices[0].claim, motion.premises[1]
    for premises in ((), (step, step), (motion,), (motion.premises[0],), (fact,), (step.claim,)):
        refused(claim, *premises)
    other = equations(linear(np.array([[4.0]]), np.array([[0.25]])))
    refused(claim, prove(replace(step.claim, equations=other)))
    refused(replace(claim, equations=other), step)


def test_slices_are_in_coordinates_whose_rates_are_velocities(held):
    """What the closed loop's own program has for q's rates is looked at."""
    motion, slices, _ = held
    tape = Tape(2)
    q, v = tape.inputs
    twice = equations(loop(tape, 1, 1, [], [v * 2, q * -4 - v]))
    step = prove(replace(motion.premises[1].claim, equations=twice))
    refused(replace(slices[0].claim, equations=twice), step, match="rates")


def test_a_box_that_meets_a_singularity_holds_no_slices():
    """Of √q: room up to q = 0 and beyond."""
    motion = motion_of(equations(parabola()), [1.0], [1.0], [0.5], 2.0**-6)
    (part,) = slices_about(motion, SPREAD)
    step, claim = motion.premises[1], part.claim
    prove(claim, step)
    wide = np.broadcast_to(1.5 / np.abs(claim.frame).sum(axis=2), claim.room.shape)
    refused(replace(claim, room=wide), step, match="σ is not proven|nonsingular")


# Handing on.


def test_what_is_handed_on_is_all_of_a_section():
    """|A⁺⁻¹A||z|, rounded up; at a sample of (q, q̇) and what the law makes of them; a singular frame holds nothing."""
    A, other = np.array([[2.0, 1.0], [0.0, 1.0]]), np.array([[1.0, 0.5], [-0.5, 1.0]])
    section = CrossSection(BallArray(A, np.full((2, 2), 0.01)), np.array([0.1, 0.3]))
    found = handed_on(other, section)
    due = (np.abs(np.linalg.solve(other, A)) + np.abs(np.linalg.inv(other)) @ np.full((2, 2), 0.01)) @ section.bound
    assert np.all(found >= due)
    np.testing.assert_allclose(found, due, rtol=1e-12)
    gains = BallArray(np.array([[-2.0, -3.0]]), np.full((1, 2), 0.1))
    frame = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-2.0, -3.0, 0.5]])
    old = CrossSection(exactly(np.vstack([A, [[7.0, 7.0]]])), section.bound)
    told = handed_on(frame, old, gains)
    np.testing.assert_allclose(told[:2], np.abs(A) @ section.bound, rtol=1e-12)
    np.testing.assert_allclose(told[2], 2.0 * np.full(2, 0.1) @ np.abs(A) @ section.bound, rtol=1e-12)
    with pytest.raises(UnboundedError, match="thin"):
        handed_on(np.ones((2, 2)), section)


# Tubes.


def test_a_tube_is_its_slices_one_after_the_other(held):
    """Times since the start, exactly; the box of starts, and no larger one."""
    motion, slices, fact = held
    times = fact.found["times"]
    assert times[0] == 0.0
    assert times[-1] == motion.found["times"][-1] == LENGTH
    begins = motion.found["times"][:-1]
    told = [Fraction(b) + Fraction(m) for b, s in zip(begins, slices, strict=True) for m in marks_held(s)[1:]]
    assert [Fraction(t) for t in times[1:]] == told
    prove(replace(fact.claim, spread=0.5 * SPREAD), *fact.premises)
    for k in range(2):
        wider = SPREAD * (1.0 + 1e-9 * (np.arange(2) == k))
        refused(replace(fact.claim, spread=wider), *fact.premises, match="end with")
    shorter = prove(fact.claim, motion, *slices[:2])
    assert shorter.found["times"].tolist() == [t for t in times if t <= 2.0**-4]
    refused(replace(fact.claim, spread=-SPREAD), *fact.premises)
    refused(replace(fact.claim, spread=np.append(SPREAD, SPREAD)), *fact.premises, match="other coordinates")
    refused(replace(fact.claim, spread=SPREAD * np.inf), *fact.premises)
    refused(replace(fact.claim, cells=np.array([0])), *fact.premises)
    refused(replace(fact.claim, precision=np.array([52])), *fact.premises)


def test_premises_that_do_not_make_a_tube(held):
    """None, of another motion, of other steps, in another order, one left out, one twice, claims and what was sent."""
    motion, slices, fact = held
    one, two, three = slices
    again = motion.replay()
    other = motion_of(spring(), [0.5], [], [-0.25], 2.0**-5)
    sent = pickle.loads(pickle.dumps(two))
    assert type(sent) is Unproved
    alone = prove(MotionEnclosed(spring(), np.zeros(0, dtype=bool), BITS), motion.premises[0])
    for premises in (
        (),
        (motion,),
        (alone, one),
        (one, two, three),
        (motion, two, three),
        (motion, one, three),
        (motion, one, three, two),
        (motion, one, one, two, three),
        (motion, one, two, three, three),
        (again, one, two, three),
        (other, one, two),
        (motion.premises[1], one, two, three),
        (motion, motion, one, two, three),
        (motion, one, motion.premises[2], three),
        (motion, fact),
        (motion, one, sent, three),
        (motion, one.claim, two, three),
    ):
        refused(fact.claim, *premises)


def test_slices_begin_with_all_that_the_last_ones_end_with(held):
    """A cross-section that is smaller in one number, or later, is another."""
    motion, (one, two, three), fact = held
    step, claim = motion.premises[2], two.claim
    prove(fact.claim, motion, one, prove(replace(claim, bound=1.0001 * claim.bound), step))
    for k in range(2):
        less = claim.bound * (1.0 - 1e-9 * (np.arange(2) == k))
        refused(fact.claim, motion, one, prove(replace(claim, bound=less), step), three, match="end with")
    turned = prove(replace(claim, begin=claim.begin @ np.array([[1.0, 0.1], [0.0, 1.0]])), step)
    refused(fact.claim, motion, one, turned, match="end with")
    singular = prove(replace(claim, begin=np.ones((2, 2)) * 1e-3), step)
    refused(fact.claim, motion, one, singular, match="thin")
    names = ("frame", "rate", "curve", "room")
    late = prove(replace(claim, marks=claim.marks[1:], **{name: getattr(claim, name)[1:] for name in names}), step)
    refused(fact.claim, motion, one, late, match="follow")
    early = prove(replace(claim, marks=claim.marks[:-1], **{name: getattr(claim, name)[:-1] for name in names}), step)
    ended = prove(fact.claim, motion, one, early)
    assert ended.found["times"][-1] < 2.0**-4
    refused(fact.claim, motion, one, early, three, match="other steps")


def sampled():
    """Q̈ = u with u = −2q − 3v − q² − v² held."""
    tape = Tape(3)
    q, v, u = tape.inputs
    one = loop(tape, 1, 1, [], [v, u, 0])
    one.efforts = in_balls(tape, [q * -2 - v * 3 - q * q - v * v])
    return equations(one)


def test_at_a_sample_the_law_is_read():
    """Slices that go on with the efforts held before are others; so are starts whose efforts were not read."""
    motion = motion_of(sampled(), [0.5], [], [-0.25], 2.0**-4, period=2.0**-5)
    assert motion.claim.sampled.tolist() == [True, True]
    fact = tube_about(motion, SPREAD)
    later = [part for part in fact.premises[1:] if part.premises[0] is motion.premises[2]]
    before, two = fact.premises[1 : -len(later)], later[0]
    assert fact.found["times"][-1] == 2.0**-4
    with flint().ctx.workprec(64):
        on = next(grow(sampled(), step_of(motion.premises[2]), last_section(before[-1]), ONE_CELL, 64))
    refused(fact.claim, motion, *before, prove(on.claim, motion.premises[2]), match="end with")
    for k, part in enumerate((1e-3, 1e-3, 1.0)):  # that of the efforts is what rounding makes of 0
        less = two.claim.bound * (1.0 - part * (np.arange(3) == k))
        refused(
            fact.claim, motion, *before, prove(replace(two.claim, bound=less), motion.premises[2]), match="end with"
        )
    unread = prove(replace(motion.claim, sampled=np.array([False, True])), *motion.premises)
    refused(fact.claim, unread, *fact.premises[1:], match="no law")


def test_the_gains_of_a_sample_are_those_of_its_states():
    """Of (q, q̇) at the step's beginning, as wide as the cross-section: ∂u/∂q = −2 − 2q, ∂u/∂v = −3 − 2v."""
    motion = motion_of(sampled(), [0.5], [], [-0.25], 2.0**-5, period=2.0**-5)
    section = CrossSection(exactly(np.array([[1.0, 0.5], [0.0, 2.0]])), SPREAD)
    with flint().ctx.workprec(64):
        found = gains_about(sampled(), step_of(motion.premises[1]), section, 1)
    np.testing.assert_allclose(found.mid, [[-3.0, -2.5]], rtol=1e-9)
    np.testing.assert_allclose(found.rad, [[0.04, 0.08]], rtol=1e-3)
    assert np.all(found.rad >= [[0.04, 0.08]])


def test_a_sample_of_no_bounded_efforts():
    """U = 1/q: over starts up to q = 0 they are not."""
    tape = Tape(3)
    q, v, u = tape.inputs
    one = loop(tape, 1, 1, [], [v, u, 0])
    one.efforts = in_balls(tape, [tape.solve([[q]], [[v]])[0, 0]])
    motion = motion_of(equations(one), [0.5], [], [0.25], 2.0**-5, period=2.0**-5)
    fact = tube_about(motion, SPREAD)
    refused(replace(fact.claim, spread=np.array([0.6, 0.02])), *fact.premises, match="nonsingular")


# Sets.


@pytest.fixture(scope="module")
def halves():
    """Tubes of two halves of ±(0.02, 0.02) about (0.5, −0.25), cut across q, which overlap by a little."""
    own, wide = spring(), np.array([0.01 * (1 + 1e-9), 0.02])
    return [tube_about(motion_of(own, [q], [], [-0.25], 2.0**-5), wide) for q in (0.49, 0.51)]


def both(**change):
    numbers = {
        "q": np.array([0.5]),
        "v": np.array([-0.25]),
        "spread": np.array([0.02, 0.02]),
        "duration": np.array([2.0**-5]),
        "cut": np.array([0, -1, -1]),
        "place": np.array([0.5, 0.0, 0.0]),
    }
    return SetEnclosed(spring(), **numbers | change)


def test_tubes_hold_a_set_that_they_tile(halves):
    """To the last bit, wherever in the overlap it is cut; for as long as they are."""
    prove(both(), *halves)
    prove(both(place=np.array([0.5 + 1e-12, 0.0, 0.0])), *halves)
    four = {"cut": np.array([1, 0, -1, -1, 0, -1, -1]), "place": np.array([-0.25, 0.5, 0.0, 0.0, 0.5, 0.0, 0.0])}
    prove(both(**four), *halves, *halves)
    prove(both(duration=np.array([2.0**-6])), *halves)
    low = halves[0].claim.spread
    exact = both(q=np.array([0.49]), spread=low, cut=np.array([-1]), place=np.zeros(1))
    prove(exact, halves[0])
    for k in range(2):
        for change in (
            {"spread": np.where(np.arange(2) == k, np.nextafter(low, 1.0), low)},
            {"q": np.nextafter(exact.q, 1.0)} if k == 0 else {"v": np.nextafter(exact.v, 1.0)},
            {"q": np.nextafter(exact.q, 0.0)} if k == 0 else {"v": np.nextafter(exact.v, -1.0)},
        ):
            refused(replace(exact, **change), halves[0], match="not in its")


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"place": np.array([0.5 + 1e-8, 0.0, 0.0])}, "not in its"),
        ({"place": np.array([0.5 - 1e-8, 0.0, 0.0])}, "not in its"),
        ({"place": np.array([0.9, 0.0, 0.0])}, "not in its"),
        ({"cut": np.array([1, -1, -1])}, "not in its"),
        ({"cut": np.array([2, -1, -1])}, "other coordinates"),
        ({"cut": np.array([-2, -1, -1])}, "range"),
        ({"cut": np.array([0, -1])}, None),
        ({"cut": np.array([0, -1]), "place": np.array([0.5, 0.0])}, "without a tube"),
        ({"cut": np.array([0, -1, -1, -1]), "place": np.array([0.5, 0.0, 0.0, 0.0])}, "nothing"),
        ({"cut": np.array([0, -1, 0, -1, -1]), "place": np.array([0.5, 0.0, 0.505, 0.0, 0.0])}, "fewer"),
        ({"cut": np.array([], dtype=np.int64), "place": np.array([])}, "without a tube"),
        ({"spread": np.array([0.02, 0.02 + 1e-15])}, "not in its"),
        ({"spread": np.array([0.03, 0.02])}, "not in its"),
        ({"spread": np.array([0.02])}, "other coordinates"),
        ({"spread": np.array([-0.02, 0.02])}, None),
        ({"q": np.array([0.51])}, "not in its"),
        ({"v": np.array([-0.2])}, "not in its"),
        ({"duration": np.array([np.nextafter(2.0**-5, 1.0)])}, "ends earlier"),
        ({"duration": np.array([0.0])}, None),
    ],
)
def test_tubes_that_leave_starts_out(halves, change, match):
    refused(both(**change), *halves, match=match)


def test_premises_that_are_not_the_tubes_of_a_set(halves, held):
    low, high = halves
    motion, slices, _ = held
    for premises in (
        (),
        (low,),
        (high, low),
        (low, low),
        (low, high, high),
        (low, motion),
        (low, slices[0]),
        (low, high.claim),
        (low, pickle.loads(pickle.dumps(high))),
    ):
        refused(both(), *premises)
    refused(both(cut=np.array([0, -1]), place=np.array([0.5, 0.0])), low, match="without a tube")
    start = high.premises[0].premises[0]
    assert type(high.premises[0].premises[1].claim) is StepEnclosed
    vague = prove(replace(start.claim, q_radius=start.claim.q_radius + 1e-18))
    step, part = high.premises[0].premises[1], high.premises[1]
    wide = prove(replace(step.claim, radius=step.claim.radius + 1e-17))
    again = prove(replace(high.premises[0].claim), vague, wide)
    around = prove(high.claim, again, prove(part.claim, wide))
    refused(both(), low, around, match="not exact")


def test_tubes_of_starts_that_are_no_doubles(halves):
    """What is told of a box is of the doubles in its middle, exactly."""
    fact = halves[1]
    motion, part = fact.premises
    start, step = motion.premises
    wide = prove(replace(step.claim, radius=step.claim.radius + 1e-15))

    def told(**change):
        again = prove(motion.claim, prove(replace(start.claim, **change)), wide)
        around = prove(fact.claim, again, prove(part.claim, wide))
        enclosure = SimpleNamespace(verdict="proven", motion=again)
        return Tube(Starts(np.array([0.51]), np.array([-0.25]), fact.claim.spread), 2.0**-5, enclosure, around).verdict

    assert told() == "proven"
    assert told(q_radius=np.array([1e-18])) == "undecided"
    for rest in (1e-20, -1e-20):
        sums = {"q": np.array([[0.51, rest, 0.0]]), "y": np.zeros((0, 3))}
        assert told(**sums) == "undecided"


def test_a_set_that_was_sent_is_proved_again(halves):
    """Pickled and replayed it is the same, its motions still those of its tubes; altered it is none."""
    fact = prove(both(), *halves)
    sent = pickle.loads(pickle.dumps(fact))
    again = sent.replay()
    assert again.claim.cut.tolist() == fact.claim.cut.tolist()
    for before, after in zip(fact.premises, again.premises, strict=True):
        assert np.array_equal(before.found["times"], after.found["times"])
        np.testing.assert_allclose(after.premises[1].found["kept"], before.premises[1].found["kept"], rtol=1e-12)
    tube = sent.premises[0]
    wider = tube._replace(claim=replace(tube.claim, spread=2.0 * tube.claim.spread))
    with pytest.raises(NotProvedError):
        sent._replace(premises=(wider, sent.premises[1])).replay()
    assert TubeHeld is type(tube.claim)
    assert SlicesHeld is type(tube.premises[1].claim)
    assert BITS[0] == tube.claim.precision[0]
