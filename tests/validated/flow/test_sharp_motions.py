"""What is told of enclosed motions: where they are, that they arrive, that they meet a singularity."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.control.control_law import NoTorque

pytest.importorskip("flint")

import ccpin
from ccpin.errors import CcpinError, InvalidInputError
from ccpin.programs.tape import Tape
from ccpin.validated.arithmetic.balls import ball, flint
from ccpin.validated.arithmetic.programs import in_balls
from ccpin.validated.flow import crossing, enclosing, enclosure, regularity
from ccpin.validated.flow.enclosure import collect
from ccpin.validated.flow.marching import Stuck
from ccpin.validated.flow.motion_claim import left_open
from ccpin.validated.flow.motion_task import exact_q
from ccpin.validated.flow.step import ProvenStep, start_of
from ccpin.validated.model.closed_loop import recorded_loop
from ccpin.validated.sets import set_enclosure as sets
from ccpin.validated.sets.subdivision import TubesFound
from tests.oracles import rpdr as oracle
from tests.support.paper import GOAL, K_P, K_V, START
from tests.support.parabola import parabola

FREE = [0, 2, 1, 3]


pytestmark = pytest.mark.usefixtures("precise")


def arb(mid, rad=0.0):
    return flint().arb(mid, rad)


def plain(k, unit=0, q=None):
    return SimpleNamespace(x=slice(k, k + 1), q=q or slice(k, k + 1), kind=SimpleNamespace(unit=unit))


def jointed(**more):
    one = parabola()
    one.joints = (plain(0), plain(1))
    for name, value in more.items():
        setattr(one, name, value)
    return one


def line(begin, length, errors=(0.0, 0.25, 0.5), quantity=1.0):
    """A step of q = begin + t, y = 2, v = 3 − t."""
    polynomial = [[ball(begin), ball(1)], [ball(2), ball(0)], [ball(3), ball(-1)]]
    boxes = [
        [arb(begin + length / 2, length), arb(2, 0.5), arb(3, 1)],
        [arb(begin, 2 * length), arb(2, 0.25), arb(3, 2)],
    ]
    end = [ball(begin + length), arb(2, 0.125), arb(3 - length, 0.0625)]
    return ProvenStep(length, polynomial, 0.0, [ball(e) for e in errors], boxes, quantity, start_of(end))


def enclosed(**more):
    one = jointed(**more)
    steps = [line(4.0, 0.25, quantity=3.0), line(4.25, 0.5, quantity=2.0)]
    return collect(one, [ball(4), arb(2, 0.0625), ball(3)], steps, [0.0, 0.5], "", 120)


def test_the_times_and_boxes_of_an_enclosure():
    found = enclosed()
    assert found.times.tolist() == [0.0, 0.25, 0.75]
    assert found.verdict == "undecided"  # steps that are no facts
    np.testing.assert_allclose(found.q_free, [[4.0, 2.0], [4.25, 2.0], [4.75, 2.0]])
    np.testing.assert_allclose(found.q_free_radius[:, 1], [0.0625, 0.125, 0.125])
    np.testing.assert_allclose(found.v_radius[1:, 0], 0.0625)
    np.testing.assert_allclose(found.q_free_lower, [[3.5, 1.5], [3.25, 1.5]])
    np.testing.assert_allclose(found.q_free_upper, [[4.5, 2.5], [5.25, 2.5]])
    np.testing.assert_allclose(found.v_lower[:, 0], 1.0)
    np.testing.assert_allclose(found.v_upper[:, 0], 5.0)
    assert found.determinant.tolist() == [3.0, 2.0]
    assert found.smallest_determinant == 2.0
    assert found.left_open.tolist() == [0.0, 0.5]
    assert collect(jointed(), [ball(4), ball(2), ball(3)], [], [], "", 120).smallest_determinant == np.inf
    stopped = collect(jointed(), [ball(4), ball(2), ball(3)], [line(4.0, 0.25)], [0.0], "why", 120)
    assert (stopped.verdict, "why" in stopped.reason) == ("undecided", True)


def test_boxes_in_doubles_are_rounded_outwards():
    third = ball(1) / 3
    found = enclosure._bounds(jointed(), [third, arb(2, 0.25), third])
    assert abs(third - found.q_free[0]) <= ball(found.q_free_radius[0])
    assert 0.0 < found.q_free_radius[0] < 1e-16
    assert found.q_free_radius[1] == pytest.approx(0.25)


def test_states_at_times():
    """Of the step that a time is in, from its beginning; at knots the later one's."""
    found = enclosed()
    for t, begin in ((0.0, 4.0), (0.125, 4.0), (0.25, 4.25), (0.5, 4.25), (0.75, 4.25)):
        since = t if t < 0.25 else t - 0.25
        q, y, v = found.inputs(t)
        assert float(q.mid()) == begin + since
        assert float(y.rad()) == pytest.approx(0.25)
        assert float(v.mid()) == 3.0 - since
        assert float(v.rad()) == pytest.approx(0.5)
    for t in (-1e-9, 0.75 + 1e-9, np.nan):
        with pytest.raises(InvalidInputError):
            found.inputs(t)
    alone = collect(jointed(), [ball(4), ball(2), ball(3)], [], [], "", 120)
    assert [float(x) for x in alone.inputs(0.0)] == [4.0, 2.0, 3.0]


def test_what_is_in_an_enclosure():
    """All numbers, each in its ball, wider by the tolerance."""
    found = enclosed()
    for q, y, v, held in (
        (4.125, 2.2, 3.0, True), (4.125, 2.26, 3.0, False), (4.126, 2.0, 3.0, False), (4.125, 2.0, 3.38, False),
    ):  # fmt: skip
        assert found.contains(0.125, [q, y], [v]) is held
    assert found.contains(0.125, [4.125, 2.3], [2.9], tolerance=0.06)
    assert not found.contains(0.125, [4.125, 2.3], [2.9], tolerance=0.04)


def test_quaternions_are_compared_with_the_sign_of_the_box():
    kind = SimpleNamespace(unit=4)
    one = jointed(joints=(SimpleNamespace(x=slice(0, 5), q=slice(0, 5), kind=kind), plain(5)))
    found = replace(enclosed(), loop=one)
    box = [ball(x) for x in (7.0, 0.5, 0.5, -0.5, 0.5, 1.0)]
    q = np.array([-7.0, 0.5, 0.5, -0.5, 0.5, -1.0])
    np.testing.assert_array_equal(found._nearest(q, box), q)
    other = np.array([-7.0, -0.5, -0.5, 0.5, -0.5, -1.0])
    np.testing.assert_array_equal(found._nearest(other, box), q)


def test_energies_are_sums():
    tape = Tape(3)
    q, y, v = tape.inputs
    found = enclosed(energies=in_balls(tape, [v * v, q + y * 0]))
    assert float(found.energy(0.125).mid()) == pytest.approx((3 - 0.125) ** 2 + 4.125, rel=0.02)


def test_rows_left_out_are_bounded():
    """|φ(p)| along the polynomial, and the slopes times the errors, of the worst row."""
    tape = Tape(3)
    q, y, v = tape.inputs
    one = jointed(left_out=in_balls(tape, [q - y * 3, y + v * 2]))
    step = line(4.0, 0.25)
    first = 2.0 + 0.25 + 3 * 0.25  # |q − 3y| ≤ 2 + t by coefficients
    second = 2.0 + 6.0 + 0.5 + 0.25 + 2 * 0.5
    assert left_open(one, step) == pytest.approx(max(first, second), rel=1e-6)
    one.left_out = in_balls(tape, [q - y * 3])
    assert left_open(one, step) == pytest.approx(first, rel=1e-6)
    one.left_out = in_balls(tape, [q * y])  # a product of inputs
    assert left_open(one, step) > 8.0


def test_exact_starts_on_circles_are_in_the_turn_of_what_they_are_near():
    described = ccpin.load("rpdr").description
    joints = tuple(replace(j, kind="continuous", lower=-np.inf, upper=np.inf) for j in described.joints)
    model = ccpin.ReducedModel(ccpin.load(replace(described, joints=joints)))
    one = recorded_loop(model, None)
    near = one.own.near.copy()
    first, second = one.equations.independent
    near[first], near[second] = 4 * np.pi + 0.3, -2 * np.pi - 0.2
    q = np.array([np.cos(0.5), np.sin(0.5), np.cos(-0.4), np.sin(-0.4)]) * 2.0
    found = [float(x.mid()) for x in exact_q(model, one._replace(own=one.own._replace(near=near)), q)]
    np.testing.assert_allclose(found, [4 * np.pi + 0.5, -2 * np.pi - 0.4])
    planar = ccpin.ReducedModel(ccpin.load("rpdr"))
    far = recorded_loop(planar, None)
    far = far._replace(own=far.own._replace(near=np.full(4, 9 * np.pi)))
    assert [float(x) for x in exact_q(planar, far, START)] == START.tolist()
    slide = SimpleNamespace(q=slice(0, 1), whole=None, kind=SimpleNamespace(unit=2), slides=(True,))
    held = SimpleNamespace(coordinates=SimpleNamespace(parts=[slide]))
    at = SimpleNamespace(own=SimpleNamespace(near=np.array([9 * np.pi])), equations=SimpleNamespace(independent=(0,)))
    assert [float(x) for x in exact_q(held, at, np.array([0.5]))] == [0.5]


# `enclose`: when a motion is asked for a singularity.


@pytest.fixture
def marched(monkeypatch, rpdr_model):
    def run(stop, law=None):
        asked = []
        honest = enclosing.march

        def march(*given):
            yield next(honest(*given))
            yield from [stop] if stop else []

        monkeypatch.setattr(enclosing, "march", march)
        monkeypatch.setattr(enclosing, "find_crossing", lambda *given: asked.append(given))
        monkeypatch.setattr(enclosing, "without_dry_friction", lambda _: ", but")
        found = enclosing.enclose(rpdr_model, law, START, None, 0.01, longest_step=2.0**-8, pieces=4)
        monkeypatch.setattr(enclosing, "march", honest)
        return found, asked

    return run


def test_a_free_motion_that_is_stuck_is_asked_for_a_singularity(marched, rpdr_model, monkeypatch):
    """Once, for the time that is left; not one under a law, nor one that has no steps or is not stuck."""
    found, asked = marched(Stuck("why"))
    assert (len(found.steps), found.verdict) == (1, "undecided")
    assert "why" in found.reason
    assert found.reason.endswith(", but")
    assert len(asked) == 1
    assert asked[0][2] is found.motion
    assert asked[0][3] == pytest.approx(0.01 - found.times[-1], rel=1e-12)
    assert len(marched(Stuck("why"), NoTorque(rpdr_model))[1]) == 1
    assert marched(None)[1] == []
    assert marched(Stuck("why"), ccpin.control.PDSimpleGravity(rpdr_model, GOAL, K_P, K_V))[1] == []
    honest = enclosing.proved_motion
    with monkeypatch.context() as context:
        context.setattr(enclosing, "proved_motion", lambda *given: (honest(*given)[0], "refused"))
        found, asked = marched(Stuck("why"))
        assert asked == []
        assert "refused" in found.reason
    monkeypatch.setattr(enclosing, "march", lambda *_: iter([Stuck("why")]))
    calls = []
    monkeypatch.setattr(enclosing, "find_crossing", lambda *given: calls.append(given))
    assert len(enclosing.enclose(rpdr_model, None, START, None, 0.01).steps) == 0
    assert calls == []


# Crossings.


def test_determinants_are_those_of_the_closed_form(rpdr_model):
    """± a₃a₄ sin of the fold, whatever the speeds; 1 where nothing depends."""
    one = recorded_loop(rpdr_model, None)
    for q in (START, GOAL):
        q_free = oracle.sigma(q, 1.0)[FREE]
        exact = oracle.A3 * oracle.A4 * np.sin(oracle.fold(q_free[FREE]))
        for speeds in (None, [3.0, -2.0]):
            found = regularity.signed_determinant(one.equations, [ball(float(x)) for x in (*q_free, *(speeds or []))])
            assert abs(float(found.mid())) == pytest.approx(abs(exact), rel=1e-9)
    assert regularity.signed_determinant(SimpleNamespace(jacobian=SimpleNamespace(outputs=())), []) == ball(1)


class Followed:
    """A motion of x = t − 1 since t = 0.5, in steps of ¼, with det = −x told within its errors."""

    def __init__(self, monkeypatch, lengths, errors, stop=None):
        begins = 0.5 + np.cumsum([0.0, *lengths[:-1]])
        steps = [
            ProvenStep(h, [[ball(t - 1.0), ball(1)]], 0.0, [ball(e)], [], 1.0, start_of([ball(t + h - 1.0)]))
            for t, h, e in zip(begins, lengths, errors, strict=True)
        ]
        self.met = []
        monkeypatch.setattr(crossing, "signed_determinant", lambda loop, box: -box[0])
        monkeypatch.setattr(crossing, "march", lambda *_: iter([*steps, *([stop] if stop else [])]))
        one = SimpleNamespace(equations=None)
        monkeypatch.setattr(crossing, "_other_coordinates", lambda *_: (one, []))
        monkeypatch.setattr(crossing, "end_of", lambda _: SimpleNamespace(balls=lambda: [ball(-0.5)]))
        monkeypatch.setattr(crossing, "_met", lambda *given: self.met.append(given) or "met")

    def run(self, free="this"):
        known = SimpleNamespace(equations=SimpleNamespace(free=free))
        return crossing.find_crossing(None, known, None, 1.0, None, 120)


def test_a_crossing_is_located_since_the_sign_was_last_proved(monkeypatch):
    """All steps so far, and how many of them the sign is proved after."""
    motion = Followed(monkeypatch, [0.25, 0.25, 0.25], [0.125, 0.125, 0.125])
    assert motion.run() == "met"
    ((_, _, steps, unknown, bits),) = motion.met
    assert (len(steps), unknown, bits) == (3, 1, 120)
    wide = Followed(monkeypatch, [0.25, 0.25, 0.25], [0.5, 0.5, 0.125])
    assert wide.run() == "met"
    assert (len(wide.met[0][2]), wide.met[0][3]) == (3, 0)
    later = Followed(monkeypatch, [0.125, 0.125, 0.125, 0.25], [0.5, 0.125, 0.0625, 0.0625])
    assert later.run() == "met"
    assert (len(later.met[0][2]), later.met[0][3]) == (4, 3)


def test_crossings_that_are_not_told(monkeypatch):
    """What is no free motion, a sign that is not known, coordinates that are none; the steps end before."""
    lengths, errors = [0.25, 0.25, 0.25], [0.125] * 3
    assert Followed(monkeypatch, lengths, errors).run(free="") is None
    assert Followed(monkeypatch, [0.25], [0.125]).run() is None
    assert Followed(monkeypatch, [0.25], [0.125], Stuck("why")).run() is None
    one = Followed(monkeypatch, lengths, errors)
    monkeypatch.setattr(crossing, "_other_coordinates", lambda *_: None)
    assert one.run() is None
    one = Followed(monkeypatch, lengths, errors)
    monkeypatch.setattr(crossing, "signed_determinant", lambda loop, box: arb(0, 1))
    assert one.run() is None


def test_boxes_of_a_motion_at_times():
    step = line(4.0, 0.25)
    q, y, v = step.box(ball(0.125))
    assert (float(q.mid()), float(y.rad()), float(v.mid())) == pytest.approx((4.125, 0.25, 2.875))
    assert step.box(arb(0.125, 0.125))[0].contains(ball(4.25))


def test_witnesses_hold_the_box():
    one = jointed()
    found = crossing.witness_of("state", one, [arb(4.0, 0.5), arb(2, 0.25), ball(3)])
    assert found.q.tolist() == [4.0]
    assert found.q_free.tolist() == [4.0, 2.0]
    assert found.error == pytest.approx(0.5)
    assert crossing.witness_of("state", one, [arb(4.0, 0.125), arb(2, 0.25), ball(3)]).error == pytest.approx(0.25)


def test_other_coordinates_measure_the_same_motion(monkeypatch, rpdr_model):
    """Their rates are those of the motion; the same ones, ones with no rates and turns of balls are refused."""
    one = recorded_loop(rpdr_model, None)
    q_free, v = oracle.sigma(START, 1.0)[FREE], np.array([1.0, -2.0])
    here = [ball(float(x)) for x in (*q_free, *v)]
    monkeypatch.setattr(crossing, "best_independent", lambda *_: ("joint1", "joint3"))
    other, box = crossing._other_coordinates(rpdr_model, one, here)
    rates = rpdr_model.rho(q_free) @ v
    own, others = one.equations, other.equations.independent
    assert others != own.independent
    np.testing.assert_allclose([float(x.mid()) for x in box], [*q_free, *rates[list(others)]], atol=1e-9)
    numbers = other.own
    turned = numbers._replace(q=numbers.q._replace(scalar=False)), numbers._replace(turns=(1,))
    for change in ({"equations": own}, *({"own": each} for each in turned)):
        monkeypatch.setattr(crossing, "recorded_loop", lambda *_, c=change: other._replace(**c))
        assert crossing._other_coordinates(rpdr_model, one, here) is None

    def fails(*_):
        raise CcpinError

    monkeypatch.setattr(crossing, "recorded_loop", fails)
    assert crossing._other_coordinates(rpdr_model, one, here) is None


# Sets of starts.


def test_a_state_is_in_one_of_the_tubes():
    """All its coordinates within ±1, wider by the tolerance; in any of the tubes."""

    def tube(*z):
        return SimpleNamespace(coordinates=lambda *_: np.array(z))

    for tubes, tolerance, held in (
        ([tube(0.5, -1.0)], 0.0, True), ([tube(0.5, -1.01)], 0.0, False), ([tube(1.5, 0.0), tube(0.0, 0.9)], 0.0, True),
        ([tube(0.5, -1.01)], 0.02, True), ([tube(1.03, 0.0)], 0.02, False),
    ):  # fmt: skip
        assert sets.SetEnclosure(tubes, None, 0.0, None).contains(0.0, [0], [0], tolerance) is held


@pytest.mark.parametrize("spread", [0.1, (0.1, 0.2), ([0.1, 0.3], 0.2), ([0.1, 0.0], [0.2, 0.4]), (0.0, 0.2)])
def test_boxes_of_starts(rpdr_model, spread):
    task = SimpleNamespace(model=rpdr_model, loop=recorded_loop(rpdr_model, None))
    found = sets.starts_of(task, START, [1.0, 2.0], spread)
    pair = spread if isinstance(spread, tuple) else (spread, spread)
    np.testing.assert_array_equal(found.spread, np.concatenate([np.broadcast_to(p, 2) for p in pair]))
    np.testing.assert_array_equal(found.q, START)
    np.testing.assert_array_equal(found.v, [1.0, 2.0])


@pytest.mark.parametrize("spread", [-0.1, (0.1, -0.2), ([0.1, -0.3], 0.2), np.inf, ([0.1] * 3, 0.1), (0.1, 0.1, 0.1)])
def test_boxes_that_are_none(rpdr_model, spread):
    task = SimpleNamespace(model=rpdr_model, loop=recorded_loop(rpdr_model, None))
    with pytest.raises(InvalidInputError, match="spread"):
        sets.starts_of(task, START, None, spread)


def test_a_set_of_starts_as_asked(monkeypatch, rpdr_model):
    """Any width makes a set; a period is rounded up to the times that there are; friction is told."""
    jobs = []
    monkeypatch.setattr(sets, "without_dry_friction", lambda _: ", but")
    monkeypatch.setattr(sets, "cover", lambda job, *_: jobs.append(job) or TubesFound([None], [], [], "why"))
    law = ccpin.control.PDSimpleGravity(rpdr_model, GOAL, K_P, K_V)
    found = sets.enclose_set(rpdr_model, law, START, None, 0.01, spread=(1e-3, 0.0), period=0.001)
    assert (found.verdict, found.asked, found.covered) == ("undecided", 0.01, None)
    assert found.reason == sets.told([None], "why", 16) + ", but"
    assert 0.001 <= jobs[0].period < 0.001 + 2.0**-40
    assert (jobs[0].period * 2.0**40).is_integer()
    assert jobs[0].motion.loop.equations.efforts is not None
    sets.enclose_set(rpdr_model, law, START, None, 0.01, spread=1e-3)
    assert jobs[1].period == np.inf
    assert jobs[1].motion.loop.equations.efforts is None
    with pytest.raises(InvalidInputError, match="one motion"):
        sets.enclose_set(rpdr_model, law, START, None, 0.01, spread=0.0)
