"""Claims about motions that are forged: misshapen, altered, with borrowed premises, about other loops."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("flint")

from ccpin.programs.tape import Tape
from ccpin.proof.facts import Fact, NotProvedError, Unproved, prove
from ccpin.validated.arithmetic.balls import ball, flint
from ccpin.validated.arithmetic.exact_numbers import ExactBox, boxed, centres
from ccpin.validated.arithmetic.programs import in_balls
from ccpin.validated.arithmetic.series import all_series, values
from ccpin.validated.flow.crossing_claim import SingularMet
from ccpin.validated.flow.marching import StepOptions, march
from ccpin.validated.flow.motion_claim import MotionEnclosed, end_of, times_of
from ccpin.validated.flow.proved_steps import ProvedSteps
from ccpin.validated.flow.regularity import regular
from ccpin.validated.flow.start_claim import ClosedStart, state_of
from ccpin.validated.flow.step import SINGULAR, Start, attempt
from ccpin.validated.flow.step_claim import StepEnclosed, end_of_step, step_of
from tests.support.parabola import circle, equations, linear, loop, parabola

BITS = np.array([64])
ROOT = 2.0**0.5
OPTIONS = StepOptions(order=10, tolerance=1e-10, pieces=2, longest=2.0**-4)


def refused(claim, *premises, match=None):
    with pytest.raises(NotProvedError, match=match):
        prove(claim, *premises)


def column(*numbers):
    return np.array(numbers)[:, None]


def start_of(one, q, y, v, radius=0.25, sharp=None, near=None, q_radius=0.0):
    """The claim that y near q's is the one."""
    m, sharp = len(y), radius if sharp is None else sharp
    near = y if near is None else near
    widths = (np.full(m, radius), np.full(m, sharp))
    return ClosedStart(
        one, column(*q), np.full(len(q), q_radius), column(*y).reshape(m, 1), *widths, np.array(near), np.array(v), BITS
    )


@pytest.fixture(scope="module")
def turning():
    """A motion on a circle, measured by q, away from y = 0: its start, three steps and the fact about it."""
    one = circle(0)
    start = prove(start_of(one, [0.6], [0.8], [0.5], radius=0.1, sharp=1e-9))
    with flint().ctx.workprec(64):
        steps = [step.fact for step in march(ProvedSteps(one, 64), state_of(start).balls(), 3 * 2.0**-4, OPTIONS)]
    return start, steps, prove(MotionEnclosed(one, np.zeros(3, dtype=bool), BITS), start, *steps)


# Starts.


def test_a_start_holds_the_state():
    """(q, y, q̇) with y = √q, as sharp as the smaller box gives."""
    fact = prove(start_of(equations(parabola()), [2.0], [1.4142], [3.0], sharp=1e-4))
    with flint().ctx.workprec(64):
        q, y, v = state_of(fact).balls()
    assert (float(q), float(v)) == (2.0, 3.0)
    assert y.contains(ball(2).sqrt())
    assert float(y.rad()) < 1e-8
    wide = state_of(prove(start_of(equations(parabola()), [2.0], [1.4142], [3.0], q_radius=1e-3, sharp=1e-2)))
    assert wide.radius[0] == pytest.approx(1e-3)
    assert wide.radius[1] > 1e-3 / (2 * ROOT)


def two():
    """Y² = q and z² = 3q."""
    tape = Tape(4)
    q, y, z, v = tape.inputs
    return equations(loop(tape, 3, 1, [y * y - q, z * z - 3 * q], [v, v, v, v]))


def test_a_start_is_the_one_near_what_was_computed():
    """All of y, by less than the radius in which it is alone."""
    for off, holds in ((0.24, True), (-0.24, True), (0.26, False), (-0.26, False), (0.25, False)):
        claim = start_of(equations(parabola()), [4.0], [2.0], [3.0], sharp=1e-3, near=[2.0 + off])
        if holds:
            prove(claim)
        else:
            refused(claim, match="near the computed")
    prove(start_of(two(), [3.0], [3.0**0.5, 3.0], [1.0], sharp=1e-3, near=[1.8, 3.1]))
    refused(start_of(two(), [3.0], [3.0**0.5, 3.0], [1.0], sharp=1e-3, near=[1.8, 3.3]), match="near the computed")


def test_a_start_is_alone_and_in_the_smaller_box():
    """Both boxes are asked for, and the smaller one is in the other."""
    one = equations(parabola())
    prove(start_of(one, [4.0], [2.0], [1.0], radius=0.25, sharp=0.25))
    refused(start_of(one, [4.0], [2.0], [1.0], radius=0.2, sharp=0.25), match="larger")
    both = start_of(two(), [3.0], [3.0**0.5, 3.0], [1.0])
    refused(replace(both, sharp=np.array([0.1, 0.3])), match="larger")
    refused(start_of(one, [4.0], [2.0], [1.0], radius=2.5, sharp=0.1), match="single")
    refused(start_of(one, [4.0], [2.01], [1.0], radius=0.25, sharp=1e-3), match="smaller box")
    refused(start_of(one, [4.0], [-2.0], [1.0], near=[2.0]), match="near the computed")


def test_a_start_has_the_efforts_that_its_law_reads():
    tape = Tape(4)
    q, y, v, u = tape.inputs
    fake = loop(tape, 2, 1, [y * y - q], [v, v, u, 0])
    fake.efforts = in_balls(tape, [y * v + u])
    state = state_of(prove(start_of(equations(fake), [4.0], [2.0], [3.0], sharp=1e-9)))
    np.testing.assert_allclose(state.parts.sum(axis=1), [4.0, 2.0, 3.0, 6.0], rtol=1e-12)
    fake.efforts = in_balls(tape, [tape.solve([[v]], [[y]])[0, 0]])
    refused(start_of(equations(fake), [4.0], [2.0], [0.0], sharp=1e-9), match="efforts")


MISSHAPEN_START = {
    "no q": {"q": lambda x: x[:0]},
    "a radius too many": {"q_radius": lambda x: np.append(x, x)},
    "a negative radius of q": {"q_radius": lambda x: x - 1.0},
    "y of another size": {"y": lambda x: np.concatenate([x, x])},
    "other sums": {"y": lambda x: np.concatenate([x, x], axis=1)},
    "no number": {"y": lambda x: x * np.nan},
    "a radius of zero": {"radius": lambda x: 0.0 * x},
    "an endless radius": {"radius": lambda x: x * np.inf},
    "a negative smaller radius": {"sharp": lambda x: -x},
    "a smaller radius of zero": {"sharp": lambda x: 0.0 * x},
    "nothing computed": {"near": lambda x: None},
    "a velocity too many": {"v": lambda x: np.append(x, x)},
    "an endless velocity": {"v": lambda x: x * np.inf},
    "fewer bits than doubles": {"precision": lambda x: x - 12},
    "too many bits": {"precision": lambda x: x + 99_937},
    "bits that are no whole number": {"precision": lambda x: x * 1.0},
    "bits twice": {"precision": lambda x: np.append(x, x)},
}


@pytest.mark.parametrize("name", MISSHAPEN_START)
def test_no_start_comes_of_other_numbers(name):
    claim = start_of(equations(parabola()), [4.0], [2.0], [1.0], sharp=1e-3)
    prove(claim)
    refused(replace(claim, **{key: alter(getattr(claim, key).copy()) for key, alter in MISSHAPEN_START[name].items()}))


# Steps.


def test_a_step_is_what_the_theorem_computes(turning):
    """In balls the same as `attempt`'s, bit for bit."""
    one, (_, steps, _) = circle(0), turning
    for fact in steps:
        told, claim = step_of(fact), fact.claim
        with flint().ctx.workprec(64):
            start = Start(centres(claim.centre), [ball(r) for r in claim.radius.tolist()])
            series = all_series(one.field, start.centre, 10)
            made = attempt(regular(one), start, series, float(claim.length[0]), 2)
        assert (told.length, told.quantity, told.remainder) == (made.length, made.quantity, made.remainder)
        for got, due in (
            *zip(told.polynomial, made.polynomial, strict=True),
            *zip(told.boxes, made.boxes, strict=True),
            (told.end.centre, made.end.centre),
            (told.end.radius, made.end.radius),
        ):
            assert [(x.mid().man_exp(), x.rad().man_exp()) for x in got] == [
                (x.mid().man_exp(), x.rad().man_exp()) for x in due
            ]
        assert all(a >= b and a < b * (1 + 1e-15) + 1e-300 for a, b in zip(told.error, made.error, strict=True))
        assert told.fact is fact


MISSHAPEN_STEP = {
    "a number too few": {"centre": lambda x: x[:-1]},
    "no doubles": {"centre": lambda x: x[:, 0]},
    "no number": {"centre": lambda x: x * np.nan},
    "an endless centre": {"centre": lambda x: x + np.inf},
    "a radius too few": {"radius": lambda x: x[:-1]},
    "a negative radius": {"radius": lambda x: x - 1.0},
    "an endless radius": {"radius": lambda x: x + np.inf},
    "a step back": {"length": lambda x: -x},
    "no step": {"length": lambda x: 0.0 * x},
    "an endless step": {"length": lambda x: x * np.inf},
    "two steps": {"length": lambda x: np.append(x, x)},
    "no order": {"order": lambda x: 0 * x},
    "an order that is no whole number": {"order": lambda x: x + 0.5},
    "no pieces": {"pieces": lambda x: 0 * x},
    "fewer bits than doubles": {"precision": lambda x: x - 12},
    "too long": {"length": lambda x: 40.0 * x},
    "too wide": {"radius": lambda x: x + 0.7},
}


@pytest.mark.parametrize("name", MISSHAPEN_STEP)
def test_no_step_comes_of_other_numbers(turning, name):
    claim = turning[1][0].claim
    refused(replace(claim, **{key: alter(getattr(claim, key).copy()) for key, alter in MISSHAPEN_STEP[name].items()}))


def test_steps_that_are_refused_say_why():
    """At a start where the field is not defined; through a singularity; of numbers that are out of range."""
    one, numbers = circle(0), (np.array([0.01]), np.array([4]), np.array([1]), BITS)
    refused(StepEnclosed(one, column(1.0, 0.0, 1.0), np.zeros(3), *numbers), match="at the start")
    start = Start([ball(1), ball(0), ball(1)], [ball(0)] * 3)
    assert SINGULAR in ProvedSteps(one, 64).attempt(start, [[0] * 5], 0.01, 1)
    tape = Tape(2)
    q, _ = tape.inputs
    singular = equations(linear(np.array([[0.0]]), np.array([[0.0]])), jacobian=in_balls(tape, [q]))
    own = StepEnclosed(singular, column(0.5, 1.0), np.zeros(2), np.array([0.25]), *numbers[1:])
    assert prove(own).found["quantity"][0] == pytest.approx(0.5, abs=1e-8)
    refused(replace(own, centre=column(-0.125, 1.0)), match="nonsingular")
    fast = equations(linear(np.array([[0.0]]), np.array([[-1e40]])))
    quick = (np.array([1e-42]), np.array([10]), np.array([1]), BITS)
    refused(StepEnclosed(fast, column(0.0, 1.0), np.zeros(2), *quick), match="not bounded")
    prove(StepEnclosed(fast, column(0.0, 1.0), np.zeros(2), quick[0], np.array([4]), *quick[2:]))


def test_more_bits_make_sharper_steps(turning):
    claim = turning[1][0].claim
    exact = replace(claim, radius=0.0 * claim.radius, order=np.array([30]))
    wide, sharp = prove(exact), prove(replace(exact, precision=np.array([160])))
    assert wide.found["end_radius"].max() > 1e-20 > 1e-30 > sharp.found["end_radius"].max()
    with flint().ctx.workprec(53):
        again = prove(replace(exact, precision=np.array([160])))
    assert np.array_equal(again.found["end"], sharp.found["end"])


# Motions.


def test_a_motion_is_its_steps_end_to_end(turning):
    """Times, determinants and the end."""
    _, steps, motion = turning
    assert motion.found["times"].tolist() == [0.0, 2.0**-4, 2.0**-3, 3 * 2.0**-4]
    assert motion.found["determinant"].tolist() == [float(step.found["quantity"][0]) for step in steps]
    assert motion.found["left_open"].tolist() == [0.0, 0.0, 0.0]
    assert np.array_equal(end_of(motion).parts, end_of_step(steps[-1]).parts)
    a = np.arctan2(0.8, 0.6) - 3 * 2.0**-4 * 0.5 / 0.8
    np.testing.assert_allclose(end_of(motion).parts.sum(axis=1)[:2], [np.cos(a), np.sin(a)], atol=1e-8)
    alone = prove(MotionEnclosed(circle(0), np.zeros(0, dtype=bool), BITS), turning[0])
    assert alone.found["times"].tolist() == [0.0]
    assert np.array_equal(end_of(alone).parts, turning[0].found["state"])


def test_premises_that_do_not_make_a_motion(turning):
    """None, others, in another order, one left out, one of another start, of another loop; claims and what was sent."""
    start, steps, motion = turning
    one, two_, three = steps
    claim = motion.claim
    faster = prove(start_of(circle(0), [0.6], [0.8], [0.51], radius=0.1, sharp=1e-9))
    other = prove(replace(start.claim, equations=circle(1), q=start.claim.y, y=start.claim.q, near=np.array([0.6])))
    sent = pickle.loads(pickle.dumps(two_))
    assert type(sent) is Unproved
    for premises in (
        (),
        (one, two_, three),
        (start, one, three, two_),
        (start, two_, one, three),
        (start, one, one, three),
        (faster, one, two_, three),
        (other, one, two_, three),
        (start, one, two_),
        (start, one, two_, three, three),
        (start, start, two_, three),
        (motion, one, two_, three),
        (start, one, sent, three),
        (start.claim, one, two_, three),
        (start, one, two_.claim, three),
    ):
        refused(claim, *premises)
    assert type(sent.replay()) is Fact
    prove(claim, start, one, sent.replay(), three)
    shorter = MotionEnclosed(circle(0), np.zeros(2, dtype=bool), BITS)
    prove(shorter, start, one, two_)
    refused(shorter, start, one, three)
    refused(shorter, start, two_, three)


def test_a_step_begins_with_all_of_the_last_end(turning):
    """A box that is smaller in one number, or moved by the last bit, is another."""
    start, (one, two_, _), _ = turning
    claim = MotionEnclosed(circle(0), np.zeros(2, dtype=bool), BITS)
    wider = replace(two_.claim, radius=two_.claim.radius * 1.5)
    prove(claim, start, one, prove(wider))
    for k in range(3):
        radius, centre = two_.claim.radius.copy(), two_.claim.centre.copy()
        radius[k] = np.nextafter(radius[k], 0.0)
        centre[k, 0] = np.nextafter(centre[k, 0], 9.0)
        for changed in ({"radius": radius}, {"centre": centre}):
            refused(claim, start, one, prove(replace(two_.claim, **changed)), match="elsewhere")


def test_samples_are_those_of_a_sampled_law(turning):
    """At a sample u is read anew: a step that goes on with the old one is another."""
    motion = turning[2]
    refused(replace(motion.claim, sampled=np.array([True, False, False])), *motion.premises, match="not sampled")
    refused(replace(motion.claim, sampled=np.zeros(2, dtype=bool)), *motion.premises, match="not said")
    refused(replace(motion.claim, sampled=np.zeros(3)), *motion.premises)
    tape = Tape(3)
    q, v, u = tape.inputs
    fake = loop(tape, 1, 1, [], [v, u, 0])
    fake.efforts = in_balls(tape, [q * -2 + v * -3 + u])
    own = equations(fake)
    start = prove(start_of(own, [1.0], [], [0.5]))
    numbers = np.array([0.25]), np.array([4]), np.array([2]), BITS
    one = prove(StepEnclosed(own, *state_of(start), *numbers))
    with flint().ctx.workprec(64):
        read = boxed(own.at_a_sample(end_of_step(one).balls()), 64)
    held, anew = (prove(StepEnclosed(own, *box, *numbers)) for box in (end_of_step(one), read))
    for sampled, step, holds in ((False, held, True), (True, anew, True), (True, held, False), (False, anew, False)):
        claim = MotionEnclosed(own, np.array([False, sampled]), BITS)
        if holds:
            prove(claim, start, one, step)
        else:
            refused(claim, start, one, step, match="elsewhere")
    prove(MotionEnclosed(own, np.array([True, True]), BITS), start, one, anew)


def test_efforts_that_may_not_exist_end_a_motion():
    """A law that divides by v, and v that comes to 0."""
    tape = Tape(3)
    _, v, u = tape.inputs
    fake = loop(tape, 1, 1, [], [v, u, 0])
    fake.efforts = in_balls(tape, [tape.solve([[v]], [[v * -2]])[0, 0]])
    own = equations(fake)
    start = prove(start_of(own, [1.0], [], [0.5]))
    one = prove(StepEnclosed(own, *state_of(start), np.array([0.25]), np.array([4]), np.array([2]), BITS))
    prove(MotionEnclosed(own, np.array([True]), BITS), start, one)
    refused(MotionEnclosed(own, np.array([True, True]), BITS), start, one, one, match="exist")


def test_times_are_exact():
    """Three steps of 0.1 s end at no double."""
    own = equations(linear(np.array([[0.0]]), np.array([[0.0]])))
    box, steps = boxed([ball(1), ball(1)], 64), []
    for _ in range(3):
        steps.append(prove(StepEnclosed(own, *box, np.array([0.1]), np.array([2]), np.array([1]), BITS)))
        box = end_of_step(steps[-1])
    assert times_of(steps[:2]).tolist() == [0.0, 0.1, 0.2]
    with pytest.raises(NotProvedError, match="no double"):
        times_of(steps)


def test_rows_that_are_left_out_are_bounded():
    """Along each step by itself; rows that are not defined there prove nothing."""
    tape = Tape(2)
    q, v = tape.inputs
    fake = linear(np.array([[0.0]]), np.array([[0.0]]))
    for outputs, due in (([q - 1], [0.25, 0.5]), ([q * 2 - 2], [0.5, 1.0])):
        fake.left_out = in_balls(tape, outputs)
        own = equations(fake)
        start = prove(start_of(own, [1.0], [], [1.0]))
        with flint().ctx.workprec(64):
            options = OPTIONS._replace(longest=0.25)
            steps = [step.fact for step in march(ProvedSteps(own, 64), state_of(start).balls(), 0.5, options)]
        found = prove(MotionEnclosed(own, np.zeros(2, dtype=bool), BITS), start, *steps).found["left_open"]
        np.testing.assert_allclose(found, due, rtol=0.01)
    fake.left_out = in_balls(tape, [tape.solve([[q - 1]], [[v]])[0, 0]])
    own = equations(fake)
    start = prove(start_of(own, [1.0], [], [1.0]))
    step = prove(replace(steps[0].claim, equations=own))
    refused(MotionEnclosed(own, np.zeros(1, dtype=bool), BITS), start, step, match="left out")


# Crossings.


def gone_on(duration, longest):
    """A point that goes on past y = 0, measured by y, which it reaches at a/ω: the motion so far, and more steps."""
    one, other = circle(0), circle(1)
    start = prove(start_of(one, [0.6], [0.8], [0.8], radius=0.1, sharp=1e-9))
    with flint().ctx.workprec(64):
        steps = [step.fact for step in march(ProvedSteps(one, 64), state_of(start).balls(), duration, OPTIONS)]
        motion = prove(MotionEnclosed(one, np.zeros(len(steps), dtype=bool), BITS), start, *steps)
        q, y, v = end_of(motion).balls()
        rates, options = values(one.drift, [q, y, v]), OPTIONS._replace(longest=longest)
        more = [step.fact for step in march(ProvedSteps(other, 64), [q, y, rates[1]], 0.5, options)]
    return motion, more


@pytest.fixture(scope="module")
def crossing():
    """In small steps."""
    return gone_on(0.5, 2.0**-4)


def met(first=-1, after=0.0, last=7, before=2.0**-4):
    return SingularMet(circle(0), np.array([first]), np.array([after]), np.array([last]), np.array([before]), BITS)


WHEN = np.arctan2(0.8, 0.6) - 0.5  # after the motion's end


def test_a_singularity_is_met_between_two_times(crossing):
    """Since the motion's start, rounded outwards; the box holds the circle's point where y = 0, and hardly more."""
    motion, more = crossing
    assert len(more) == 8
    assert 0.4 < WHEN < 0.5
    for first, after in ((-1, 0.0), (0, 0.02), (3, 0.03), (5, 2.0**-4), (6, 0.0)):
        fact = prove(met(first, after), motion, *more)
        begin = 0.5 + max(first, 0) / 16 + after
        low, high = fact.found["time"]
        assert low < begin < low * (1 + 1e-15)
        assert high * (1 - 1e-15) < 1.0 < high
        box = ExactBox(fact.found["state"], fact.found["state_radius"]).balls()
        assert box[0].contains(1)
        assert box[1].contains(0)
        speed = np.sin(WHEN + 0.5 - begin)
        assert box[1].contains(ball(float(speed) - 1e-8))
        assert not box[1].contains(ball(float(speed) + 2e-2))
        assert box[1].contains(ball(float(np.sin(WHEN - 0.5)) + 1e-8))
        assert not box[1].contains(ball(float(np.sin(WHEN - 0.5)) - 2e-2))
    assert prove(met(6, 0.01, 6, 2.0**-4), motion, *more).found["time"] == pytest.approx([0.885, 0.9375], rel=1e-14)
    late = prove(met(6, 0.07 - 2.0**-4, 7, 0.005), motion, *more).found["time"]
    assert late == pytest.approx([0.5 + 6 / 16 + 0.07 - 2.0**-4, 0.5 + 7 / 16 + 0.005], rel=1e-14)


def test_signs_that_do_not_differ(crossing):
    """Before, or after, or at times that are not in order, or of no step."""
    motion, more = crossing
    for claim in (
        met(-1, 0.0, 6, 0.0),
        met(7, 0.05, 7, 2.0**-4),
        met(7, 2.0**-4, 7, 0.0),
        met(7, 0.0, 6, 0.0),
        met(6, 2.0**-4, 6, 0.04),
        met(-1, 0.0, 8, 0.0),
        met(-1, 0.0, 7, 0.07),
        met(3, 0.07, 7, 2.0**-4),
        met(-1, 0.0, 7, WHEN - 7 / 16),
        met(-2, 0.0),
        met(-1, -0.01),
        met(-1, 0.0, 7, -0.01),
        met(8, 0.0, 8, 0.01),
    ):
        refused(claim, motion, *more)
    early, steps = gone_on(0.75, 0.25)
    prove(met(0, 0.1, 1, 0.1), early, *steps)
    refused(met(0, 0.2, 1, 0.1), early, *steps, match="signs")
    refused(replace(met(), precision=np.array([52])), motion, *more)
    refused(replace(met(), before=np.array([np.nan])), motion, *more)
    refused(replace(met(), after=np.array([np.inf])), motion, *more)


def test_what_goes_on_is_the_motion_and_free(crossing, turning):
    """Another motion's steps, of another mechanism, with torque, in coordinates whose rates are others, with a gap."""
    motion, more = crossing
    prove(met(), motion, *more)
    own = circle(1)
    for premises in (
        (),
        (motion,),
        tuple(more),
        (turning[2], *more),
        (motion, *more[1:]),
        (motion, *more[:3], *more[4:], more[-1]),
        (motion, *motion.premises[1:]),
        (motion, *more[:-1], motion),
        (motion, *more[:-1], motion.premises[0]),
        (motion.premises[0], *more),
        (motion, more[0].claim, *more[1:]),
        (motion, *more[:-1], prove(replace(more[-1].claim, equations=replace(own, free="")))),
    ):
        refused(met(), *premises)
    for other in (
        replace(own, free="another"),
        replace(own, free=""),
        replace(own, drift=own.field),
        replace(own, drift=own.drift._replace(outputs=(own.drift.outputs[0],) * 3)),
    ):
        holds = other.scalar and other.free == "circle"
        facts = [prove(replace(fact.claim, equations=other)) for fact in more]
        if holds:
            prove(met(), motion, *facts)
        else:
            refused(met(), motion, *facts, match="free motion")
    driven = replace(circle(0), free="")
    begun, *steps = motion.premises
    facts = [prove(replace(fact.claim, equations=driven)) for fact in (begun, *steps)]
    forced = prove(replace(motion.claim, equations=driven), *facts)
    refused(replace(met(), equations=driven), forced, *more, match="free motion")
    nothing = [prove(replace(fact.claim, equations=replace(own, free=""))) for fact in more]
    refused(replace(met(), equations=driven), forced, *nothing, match="free motion")
