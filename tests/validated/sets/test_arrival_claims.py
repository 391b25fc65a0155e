"""Claims about arrivals on a loop of which all is known: each number sharp, forged ones refused."""

import pickle
from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("flint")

from ccpin.programs.tape import Tape
from ccpin.proof.facts import NotProvedError, Unproved, is_fact, prove
from ccpin.validated.arithmetic.ball_arrays import BallArray
from ccpin.validated.arithmetic.balls import ball, flint
from ccpin.validated.arithmetic.exact_numbers import ExactBox
from ccpin.validated.arithmetic.programs import in_balls
from ccpin.validated.arithmetic.series import NotInvertibleError
from ccpin.validated.flow.marching import march
from ccpin.validated.flow.proved_steps import ProvedSteps
from ccpin.validated.flow.start_claim import ClosedStart
from ccpin.validated.loop_equations import Wrapped
from ccpin.validated.sets import lyapunov
from ccpin.validated.sets.arrival_claim import Arrived, NeverArrives, SetArrived
from ccpin.validated.sets.arrival_equations import ArrivalEquations
from ccpin.validated.sets.curvature import UnboundedError
from ccpin.validated.sets.instants import Instants
from ccpin.validated.sets.lyapunov import LyapunovAt, lowered, lyapunov_at
from ccpin.validated.sets.set_claim import SetEnclosed
from tests.support.parabola import equations, linear, loop
from tests.support.tubes import BITS, OPTIONS, motion_of, tube_about

HALF = 0.5
SPREAD = np.array([1e-3, 2e-3])


def refused(claim, *premises, match=None):
    with pytest.raises(NotProvedError, match=match):
        prove(claim, *premises)


def hill(damping=1, **more):
    """Y² = q under q̈ = −cq̇, with U = 10 (q − 3)(4 − q), which is 0 at 3 and 4 and 2.5 between; V = y + 1."""
    tape = Tape(3)
    q, y, v = tape.inputs
    speed = tape.solve([[2 * y]], [[v]])[0, 0]
    half, ten = Fraction(1, 2), Fraction(10)
    well = half * (v * v) + ten * ((q - 3) * (4 - q)) + 3
    return equations(
        loop(tape, 2, 1, [y * y - q], [v, speed, v * Fraction(-damping)]),
        drift=in_balls(tape, [v, speed, 0]),
        jacobian=in_balls(tape, [2 * y]),
        energies=in_balls(tape, [half * (v * v), y + 1]),
        lyapunov=in_balls(tape, [well]),
        **more,
    )


HILL = hill()
OWN = ArrivalEquations(HILL, ExactBox(np.array([[4.0]]), np.zeros(1)), np.array([4.0, 2.0]), 3.0, True)


def closed(q, y, width=0.0, radius=1e-9, sharp=None, near=None, one=HILL):
    """The fact that there is one y near q's."""
    near, sharp = y if near is None else near, radius if sharp is None else sharp
    numbers = ([[q]], [width], [[y]], [radius], [sharp], [near], [0.0])
    return prove(ClosedStart(one, *map(np.array, numbers), BITS))


def line_of(begin, w, time, one=HILL):
    """Facts about steps of the line from a box (centre, radius) of (q, y)."""
    with flint().ctx.workprec(64):
        box = [*(flint().arb(*pair) for pair in zip(*begin, strict=True)), ball(w)]
        return [step.fact for step in march(ProvedSteps(one.steady, 64), box, time, OPTIONS)]


ROOT = 3.0**0.5


@pytest.fixture(scope="module")
def known():
    """A motion at rest at q = 3, the set point, a box about it, and the line over the hill, in 32 steps."""
    motion, goal = motion_of(HILL, [3.0], [ROOT], [0.0], 0.0), closed(4.0, 2.0)
    around = closed(4.0, 2.0, width=1e-3, radius=1e-2, sharp=1e-2)
    line = line_of(([3.0, ROOT], [1e-8, 1e-8]), 1.0, 1.0)
    assert len(line) == 32
    return motion, goal, around, line


def arrived(level=3.0, own=OWN):
    return Arrived(own, np.array([level]), BITS)


def test_a_motion_arrives_over_the_hill(known):
    """Where it ends, how high it is then, and how high the level has to be: above 2.5."""
    motion, goal, around, line = known
    fact = prove(arrived(), motion, goal, around, *line)
    assert fact.found["time"].tolist() == [0.0]
    assert fact.found["lyapunov"][0] == pytest.approx(0.0, abs=1e-7)
    prove(arrived(2.7), motion, goal, around, *line)
    refused(arrived(2.49), motion, goal, around, *line, match="on the line")
    assert is_fact(fact, Arrived)
    assert not is_fact(fact, NeverArrives)
    assert not is_fact(fact.claim, Arrived)
    assert not is_fact(pickle.loads(pickle.dumps(fact)), Arrived)
    assert is_fact(pickle.loads(pickle.dumps(fact)).replay(), Arrived)


def test_the_value_at_the_end_is_below_the_level():
    """With q̇ = 3 𝒱 is 4.5: a level more than a billionth above does, one less does not."""
    motion = motion_of(HILL, [3.0], [ROOT], [3.0], 0.0)
    goal, around = closed(4.0, 2.0), closed(4.0, 2.0, width=1e-3, radius=1e-2, sharp=1e-2)
    line = line_of(([3.0, ROOT], [1e-8, 1e-8]), 1.0, 1.0)
    fact = prove(arrived(4.5 * (1 + 1.1e-9)), motion, goal, around, *line)
    assert 4.5 <= fact.found["lyapunov"][0] < 4.5 + 1e-12
    refused(arrived(4.5 * (1 + 0.9e-9)), motion, goal, around, *line, match="not below the level")
    for off in (0.25, -0.25):
        other = replace(OWN, potential_d=3.0 + off)
        prove(arrived(4.75 * (1 + 1.1e-9), other), motion, goal, around, *line)
        refused(arrived(4.75 * (1 + 0.9e-9), other), motion, goal, around, *line, match="not below the level")


def test_levels_are_lowered(known):
    well = lyapunov_at(OWN, known[1])
    with flint().ctx.workprec(64):
        assert abs(float(well.potential) - 3.0) < 1e-8
        assert float(lowered(replace(OWN, potential_d=3.5), well, 2.0)) == pytest.approx(1.5 - 2e-9, abs=1e-11)


def test_the_time_is_the_motion_s():
    motion = motion_of(HILL, [3.0], [ROOT], [1.0], 2.0**-5)
    end = 3.0 + 1.0 - np.exp(-(2.0**-5))
    line = line_of(([end, end**0.5], [1e-6, 1e-6]), 4.0 - end, 1.0)
    around = closed(4.0, 2.0, width=1e-3, radius=1e-2, sharp=1e-2)
    fact = prove(arrived(), motion, closed(4.0, 2.0), around, *line)
    assert fact.found["time"].tolist() == [2.0**-5]
    assert fact.found["lyapunov"][0] == pytest.approx(0.5 * np.exp(-(2.0**-4)) + 10 * (end - 3) * (4 - end), abs=1e-6)


def test_without_a_line_the_box_about_the_set_point_holds_the_state():
    """Near q_d none is due; far from it the box is over the hill."""
    near = motion_of(HILL, [3.9], [3.9**0.5], [0.0], 0.0)
    goal = closed(4.0, 2.0)
    for width, centre in ((0.06, 3.95), (0.0500001, 3.95)):
        prove(arrived(), near, goal, closed(centre, centre**0.5, width, radius=0.1))
    for centre, match in ((3.9499, "not in the box"), (3.9501, "elsewhere")):
        refused(arrived(), near, goal, closed(centre, centre**0.5, 0.05, radius=0.1), match=match)
    refused(arrived(0.5), near, goal, closed(3.95, 3.95**0.5, 0.06, radius=0.1), match="not below the level")
    whole = closed(3.5, 1.87, 0.5, radius=0.25)
    far = motion_of(HILL, [3.0], [ROOT], [0.0], 0.0)
    prove(arrived(10.001), far, goal, whole)  # its factors are bounded by 1 each
    refused(arrived(9.999), far, goal, whole, match="next to the set point")


def test_the_branch_is_the_set_point_s(known):
    """The line ends on the other branch; the box about q_d is that one's; so is the set point of it."""
    motion, goal, around, line = known
    under = motion_of(HILL, [3.0], [-ROOT], [0.0], 0.0)
    below = line_of(([3.0, -ROOT], [1e-8, 1e-8]), 1.0, 1.0)
    refused(arrived(), under, goal, around, *below, match="another branch")
    other = closed(4.0, -2.0, width=1e-3, radius=1e-2)
    refused(arrived(), under, goal, other, *below, match="the set point is on another branch")
    refused(arrived(), under, closed(4.0, -2.0), other, *below, match="set point on another branch")
    refused(arrived(), under, goal, around, *line, match="from elsewhere")
    own = replace(OWN, x_d=np.array([4.0, -2.0]), potential_d=-1.0)
    prove(arrived(7.0, own), under, closed(4.0, -2.0), other, *below)
    for radius, width, match in (
        (2e-8, 2e-8, ""),
        (6e-9, 2e-8, "line ends on another branch"),
        (2e-8, 9e-9, "ends elsewh"),
    ):
        box = closed(4.0, 2.0, width=width, radius=radius)
        if match:
            refused(arrived(), motion, goal, box, *line, match=match)
        else:
            prove(arrived(), motion, goal, box, *line)


def test_the_set_point_is_that_of_the_law(known):
    motion, goal, around, line = known
    for change, match in (
        ({"q_d": ExactBox(np.array([[4.0 + 1e-12]]), np.zeros(1))}, "another set point"),
        ({"q_d": ExactBox(np.array([[4.0]]), np.full(1, 1e-12))}, "another set point"),
        ({"x_d": np.array([4.0, 2.0 + 1e-12])}, "another branch"),
    ):
        refused(arrived(own=replace(OWN, **change)), motion, goal, around, *line, match=match)
    wide = closed(4.0, 2.0, width=1e-6, radius=1e-5)
    prove(arrived(), motion, wide, around, *line)
    prove(arrived(own=replace(OWN, q_d=ExactBox(np.array([[4.0]]), np.full(1, 1e-7)))), motion, wide, around, *line)


def test_lines_with_a_gap(known):
    motion, goal, around, line = known
    for steps in (line[1:], [*line[:3], *line[4:]], [line[1], line[0], *line[2:]], [*line[:-1], line[-2]]):
        refused(arrived(), motion, goal, around, *steps, match="elsewhere|gap")
    refused(arrived(), motion, goal, around, *line[:-1], match="elsewhere")
    refused(arrived(), motion, goal, around, match="elsewhere")
    elsewhere = line_of(([3.0, ROOT], [0.0, 0.0]), 1.0, 1.0)
    refused(arrived(), motion, goal, around, *elsewhere, match="from elsewhere")


def test_any_line_does_that_ends_there(known):
    """Half as fast and twice as long, and one whose velocity is a box."""
    motion, goal, around, line = known
    prove(arrived(), motion, goal, around, *line_of(([3.0, ROOT], [1e-8, 1e-8]), 0.5, 2.0))
    refused(arrived(), motion, goal, around, *line_of(([3.0, ROOT], [1e-8, 1e-8]), 0.5, 1.0), match="elsewhere")
    first = line[0].claim
    wide = prove(replace(first, radius=first.radius + np.array([0.0, 0.0, 1e-12])))
    refused(arrived(), motion, goal, around, wide, *line[1:], match="gap")


def test_premises_of_other_kinds(known):
    motion, goal, around, line = known
    fact = prove(arrived(), motion, goal, around, *line)
    moved = motion_of(HILL, [3.0], [ROOT], [1.0], 2.0**-5)
    sent = pickle.loads(pickle.dumps(goal))
    assert type(sent) is Unproved
    for premises in (
        (),
        (motion,),
        (motion, goal),
        (goal, goal, around, *line),
        (motion, motion, around, *line),
        (motion, goal, motion, *line),
        (motion, goal, line[0], *line),
        (motion, goal, around, goal, *line),
        (motion, goal, around, *line, fact),
        (motion, goal, around, *line, moved.premises[1]),
        (motion, goal, around, *moved.premises[1:]),
        (motion, sent, around, *line),
        (motion, goal.claim, around, *line),
        (fact, goal, around, *line),
        (line[0], goal, around, *line),
    ):
        refused(arrived(), *premises)


def test_premises_about_other_loops(known):
    """Of another damping: its motion, set point and box; its line is the same lift, of other equations."""
    motion, goal, around, line = known
    other = hill(damping=2)
    assert other.digest != HILL.digest
    theirs = (
        motion_of(other, [3.0], [ROOT], [0.0], 0.0),
        closed(4.0, 2.0, one=other),
        closed(4.0, 2.0, width=1e-3, radius=1e-2, one=other),
    )
    own = [motion, goal, around]
    for k, premise in enumerate(theirs):
        mixed = [*own[:k], premise, *own[k + 1 :]]
        refused(arrived(), *mixed, *line, match="other equations")
    still = hill(wrapped=(Wrapped(0, ball(4)),))
    refused(arrived(), *own, *line_of(([3.0, ROOT], [1e-8, 1e-8]), 1.0, 1.0, still), match="other equations")
    assert HILL.steady.steady.digest == HILL.steady.digest != HILL.digest
    assert not hill(free="mine").steady.free


MISSHAPEN = {
    "no level": {"level": np.array([0.0])},
    "a level below 0": {"level": np.array([-1.0])},
    "no number": {"level": np.array([np.nan])},
    "without end": {"level": np.array([np.inf])},
    "two levels": {"level": np.array([3.0, 3.0])},
    "few bits": {"precision": np.array([52])},
    "a level of whole numbers": {"level": np.array([3])},
}


@pytest.mark.parametrize("name", MISSHAPEN)
def test_misshapen_claims(known, name):
    motion, goal, around, line = known
    refused(replace(arrived(), **MISSHAPEN[name]), motion, goal, around, *line)


def test_equations_that_are_none():
    """Without a Lyapunov function, of other sizes, of what is no number."""
    for change in (
        {"loop": replace(HILL, lyapunov=None)},
        {"loop": HILL.digest},
        {"q_d": ExactBox(np.zeros((2, 1)), np.zeros(2))},
        {"q_d": ExactBox(np.zeros((2, 1)), np.zeros(1))},
        {"q_d": ExactBox(np.zeros(1), np.zeros(1))},
        {"q_d": ExactBox(np.array([[4.0]]), np.zeros(2))},
        {"q_d": ExactBox(np.array([[4.0]]), np.array([-1e-9]))},
        {"q_d": ExactBox(np.array([[np.nan]]), np.zeros(1))},
        {"q_d": ExactBox(np.array([[4.0]]), np.array([np.inf]))},
        {"x_d": np.array([4.0])},
        {"x_d": np.array([4.0, np.nan])},
        {"potential_d": np.inf},
        {"potential_d": 3},
        {"single": 1},
        {"set_point": "one"},
    ):
        with pytest.raises(NotProvedError):
            replace(OWN, **change)


def test_equations_of_a_sampled_law_are_refused():
    """Its Lyapunov function may rise between samples."""
    tape = Tape(4)
    q, y, v, u = tape.inputs
    speed = tape.solve([[2 * y]], [[v]])[0, 0]
    one = loop(tape, 2, 1, [y * y - q], [v, speed, u, 0])
    one.efforts = in_balls(tape, [v * -1])
    held = equations(one, lyapunov=in_balls(tape, [v * v]))
    with pytest.raises(NotProvedError, match="sampled"):
        replace(OWN, loop=held)


def test_equations_are_told_apart_and_sent():
    """By every number; what they are sent as is checked once more, and has no digest of its own making."""
    digests = {
        replace(OWN, **change).digest
        for change in (
            {},
            {"loop": hill(damping=2)},
            {"q_d": ExactBox(np.array([[4.5]]), np.zeros(1))},
            {"q_d": ExactBox(np.array([[4.0]]), np.array([0.5]))},
            {"x_d": np.array([4.0, 2.5])},
            {"potential_d": 3.5},
            {"single": False},
        )
    }
    assert len(digests) == 7
    for one in (OWN, HILL):
        assert pickle.loads(pickle.dumps(one)).digest == one.digest
        forged = pickle.loads(pickle.dumps(one))
        object.__setattr__(forged, "digest", "mine")
        assert pickle.loads(pickle.dumps(forged)).digest == one.digest
    assert OWN.sizes == HILL.sizes
    for array in (OWN.x_d, *OWN.q_d):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0


# Never.


def never(own=OWN):
    return NeverArrives(own, BITS)


def test_a_motion_below_the_set_point_never_arrives():
    """At q = 5 U is −20; with q̇²/2 below that it is refused to come back, with more it is not."""
    goal = closed(4.0, 2.0)
    below = motion_of(HILL, [5.0], [5.0**0.5], [6.0], 0.0)
    fact = prove(never(), below, goal)
    assert fact.found["lyapunov"][0] == pytest.approx(-2.0, abs=1e-6)
    assert fact.found["time"].tolist() == [0.0]
    refused(never(), motion_of(HILL, [5.0], [5.0**0.5], [6.4], 0.0), goal, match="not below 0")
    refused(never(), motion_of(HILL, [4.0], [2.0], [0.0], 0.0), goal, match="not below 0")
    moved = motion_of(HILL, [5.0], [5.0**0.5], [6.0], 2.0**-5)
    assert prove(never(), moved, goal).found["time"].tolist() == [2.0**-5]
    refused(never(replace(OWN, single=False)), below, goal, match="one turn on")
    refused(never(replace(OWN, x_d=np.array([4.0, -2.0]))), below, goal, match="branch")
    other = hill(damping=2)
    for premises in (
        (),
        (below,),
        (goal, goal),
        (below, below),
        (below, goal, goal),
        (goal, below),
        (below, closed(4.0, 2.0, one=other)),
        (motion_of(other, [5.0], [5.0**0.5], [6.0], 0.0), goal),
        (tube_about(moved, SPREAD), goal),
    ):
        refused(never(), *premises)


def test_the_set_point_s_own_value_is_not_below_it():
    """At rest there, to the last bit."""
    tape = Tape(2)
    _, v = tape.inputs
    one = equations(
        linear(np.array([[4.0]]), np.array([[0.5]])),
        energies=in_balls(tape, [v * v, 0]),
        lyapunov=in_balls(tape, [v * v]),
    )
    own = ArrivalEquations(one, ExactBox(np.zeros((1, 1)), np.zeros(1)), np.zeros(1), 0.0, True)
    motion = motion_of(one, [0.0], [], [0.0], 0.0)
    refused(never(own), motion, motion.premises[0], match="not below 0")
    fact = prove(arrived(own=own), motion, motion.premises[0], motion.premises[0])
    assert 0.0 < fact.found["lyapunov"][0] < 1e-300


def test_angles_half_a_turn_off_have_another_value():
    """The box of a state, and that of a line, may be no farther from the target than half a turn."""
    far = hill(wrapped=(Wrapped(0, ball(8)),))
    own = replace(OWN, loop=far)
    goal = closed(4.0, 2.0, one=far)
    refused(never(own), motion_of(far, [4.5], [4.5**0.5], [0.0], 0.0), goal, match="half a turn")
    prove(never(own), motion_of(far, [5.0], [5.0**0.5], [6.0], 0.0), goal)


def test_a_value_that_is_not_proven_to_exist():
    """𝒱 divides by y − 2."""
    tape = Tape(3)
    q, y, v = tape.inputs
    ratio = tape.solve([[y - 2]], [[q]])[0, 0]
    own = replace(OWN, loop=replace(HILL, lyapunov=in_balls(tape, [ratio + v])))
    goal, here = closed(4.0, 2.0, one=own.loop), motion_of(own.loop, [4.0], [2.0], [0.0], 0.0)
    refused(never(own), here, goal, match="exist")
    refused(arrived(own=own), here, goal, closed(4.0, 2.0, 1e-3, 1e-2, one=own.loop), match="exist")


# Tubes and sets.


@pytest.fixture(scope="module")
def tube():
    """All motions about one from q = 3.9, which come close enough to need no line, and the box."""
    fact = tube_about(motion_of(HILL, [3.9], [3.9**0.5], [2.0], 2.0**-5), SPREAD)
    return fact, closed(4.0, 2.0), closed(3.95, 3.95**0.5, 0.06, radius=0.1)


def test_all_motions_of_a_tube_arrive(tube):
    """𝒱 is bounded over the cross-section, by what it is at its corners and little more."""
    held, goal, around = tube
    fact = prove(arrived(), held, goal, around)
    assert fact.found["time"].tolist() == [held.found["times"][-1]]
    since = 0.5 * held.found["times"][-2:].sum()
    decay = np.exp(-since)
    corners = np.array([3.9, 2.0]) + SPREAD * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
    q, v = corners[:, 0] + corners[:, 1] * (1 - decay), corners[:, 1] * decay
    highest = np.max(0.5 * v**2 + 10 * (q - 3) * (4 - q))
    assert highest < fact.found["lyapunov"][0] < highest + 1e-3
    level = fact.found["lyapunov"][0]
    prove(arrived(level * (1 + 1.1e-9)), held, goal, around)
    refused(arrived(level * (1 + 0.9e-9)), held, goal, around, match="not below the level")
    refused(arrived(), held.premises[1], goal, around)


def test_a_line_may_lead_on_from_a_tube(known):
    """From the middle of its last slice; one that begins at its start is another."""
    _, goal, around, _ = known
    held = tube_about(motion_of(HILL, [3.0], [ROOT], [0.25], 2.0**-5), SPREAD)
    with flint().ctx.workprec(64):
        begin = lyapunov.section_of(held.premises[-1])
    centre = begin.parts[:2, 0]
    line = line_of((centre, [1e-6, 1e-6]), 4.0 - centre[0], 1.0)
    prove(arrived(), held, goal, around, *line)
    before = line_of(([3.0, ROOT], [1e-6, 1e-6]), 1.0, 1.0)
    refused(arrived(), held, goal, around, *before, match="from elsewhere")


def cross_section(frame, bound, q=4.0, v=3.0, reach=(0.4, 0.9)):
    middle = BallArray(np.array([[q, q**0.5, v]]), np.full((1, 3), 1e-15))
    at = Instants(np.ones(1), np.full(1, 1e-9), middle, middle)
    found = {"bound": np.array([bound]), "reach": np.array([reach])}
    claim = SimpleNamespace(frame=np.array([frame, 7.0 * np.eye(2)]), cells=np.array([1]))
    return at, SimpleNamespace(claim=claim, found=found)


def test_the_highest_value_on_a_cross_section_is_attained(monkeypatch):
    """Of ½v² + ½q² at the corner where all of q, v and A are positive; of √q's square within its bend."""
    tape = Tape(3)
    q, y, v = tape.inputs
    half = Fraction(1, 2)
    frame, bound = np.array([[0.5, 0.1], [0.2, 1.0]]), np.array([0.25, 0.5])
    corner = np.array([4.0, 3.0]) + frame @ bound

    def highest(program, **more):
        at, slices = cross_section(frame, bound, **more)
        monkeypatch.setattr(lyapunov, "last_instant", lambda _: at)
        with flint().ctx.workprec(64), np.errstate(all="ignore"):
            return float(
                LyapunovAt(replace(HILL, lyapunov=in_balls(tape, [program])), ball(10)).on_section(slices).upper()
            )

    assert highest(half * (v * v) + half * (q * q)) == pytest.approx(0.5 * corner @ corner - 10.0, rel=1e-9)
    found = highest(v * y)
    assert corner[0] ** 0.5 * corner[1] - 10.0 <= found < 1.05 * corner[0] ** 0.5 * corner[1] - 10.0
    with pytest.raises((UnboundedError, NotInvertibleError)):
        highest(v * y, reach=(3.9, 0.1))


@pytest.fixture(scope="module")
def halves():
    """Tubes of two halves of a box about q = 3.9, cut across q, and their arrivals."""
    wide, goal = np.array([0.5e-3 * (1 + 1e-9), 2e-3]), closed(4.0, 2.0)
    tubes = [tube_about(motion_of(HILL, [q], [q**0.5], [0.0], 2.0**-5), wide) for q in (3.8995, 3.9005)]
    around = closed(3.95, 3.95**0.5, 0.06, radius=0.1)
    numbers = ([3.9], [0.0], SPREAD, [2.0**-5])
    whole = SetEnclosed(HILL, *map(np.array, numbers), np.array([0, -1, -1]), np.array([3.9, 0.0, 0.0]))
    return prove(whole, *tubes), [prove(arrived(), each, goal, around) for each in tubes], goal, around


def test_a_set_arrives_where_all_of_its_tubes_do(halves):
    """As late, and as high, as the last of them."""
    covered, parts, goal, around = halves
    claim = SetArrived(OWN, np.array([3.0]))
    fact = prove(claim, covered, *parts)
    assert fact.found["time"][0] == max(part.found["time"][0] for part in parts)
    assert fact.found["lyapunov"][0] == max(part.found["lyapunov"][0] for part in parts)
    assert parts[0].found["lyapunov"][0] > parts[1].found["lyapunov"][0]
    again = prove(arrived(), covered.premises[0].replay(), goal, around)
    lower = prove(arrived(2.9), covered.premises[0], goal, around)
    other = prove(arrived(own=replace(OWN, single=False)), covered.premises[0], goal, around)
    for premises in (
        (),
        (covered,),
        (goal,),
        (covered, parts[0]),
        (covered, parts[1], parts[0]),
        (covered, *parts, parts[0]),
        (covered, again, parts[1]),
        (covered, lower, parts[1]),
        (covered, other, parts[1]),
        (covered, covered.premises[0], parts[1]),
        (parts[0], *parts),
        (covered.premises[0], *parts),
    ):
        refused(claim, *premises)
    for level in (2.9, 3.1):
        refused(replace(claim, level=np.array([level])), covered, *parts, match="another level")
    refused(replace(claim, level=np.array([0.0])), covered, *parts)
    sent = pickle.loads(pickle.dumps(fact))
    assert sent.replay().found["lyapunov"] == fact.found["lyapunov"]
    forged = sent._replace(claim=replace(sent.claim, level=np.array([1.0])))
    with pytest.raises(NotProvedError):
        forged.replay()
