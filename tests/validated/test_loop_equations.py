"""Equations of closed loops: programs that are none, turns that are none, and what tells loops apart."""

import copy
import pickle
from dataclasses import fields, replace

import pytest

pytest.importorskip("flint")

from ccpin.programs.instructions import Code, Instruction, Kind, LinearSystem
from ccpin.programs.tape import Tape
from ccpin.proof.facts import NotProvedError
from ccpin.validated.arithmetic.balls import ball, flint
from ccpin.validated.arithmetic.programs import in_balls, require_program
from ccpin.validated.loop_equations import ClosedLoopEquations, Upright, Wrapped
from tests.support.parabola import circle


def program(*instructions, outputs=(0,), size=9, inputs=2):
    return Code(size, inputs, tuple(Instruction(*item) for item in instructions), outputs)


def sound(given, inputs=2):
    try:
        require_program(given, inputs)
    except NotProvedError:
        return False
    return True


ONE = ball(1)
SYSTEM = LinearSystem(((0, 1), (1, 0)), ((0,), (1,)))
GOOD = {
    "nothing": program(outputs=()),
    "inputs": program(outputs=(0, 1)),
    "sums and products": program(
        (Kind.ADD, 2, 0, 1), (Kind.SUBTRACT, 3, 2, 0), (Kind.MULTIPLY, 8, 3, 3), outputs=(8, 3)
    ),
    "constants": program((Kind.CONSTANT, 2, None, None, ONE), (Kind.SCALE, 3, 2, None, ONE), outputs=(3,)),
    "a sine and its cosine": program((Kind.SINE, 2, 0, 3), (Kind.COSINE, 3, 0, 2), outputs=(2,)),
    "two pairs": program(
        (Kind.SINE, 2, 0, 3), (Kind.COSINE, 3, 0, 2), (Kind.SINE, 4, 2, 5), (Kind.COSINE, 5, 2, 4), outputs=(5,)
    ),
    "a gain": program((Kind.GAIN, 2, 0, 0), (Kind.GAIN, 3, 0, 2), outputs=(2,)),
    "a solution": program((Kind.SOLVE, 2, None, SYSTEM), (Kind.PART, 3, 2, 0), (Kind.PART, 4, 2, 1), outputs=(4,)),
    "of two columns": program(
        (Kind.SOLVE, 2, None, SYSTEM._replace(right=((0, 1), (1, 0)))), (Kind.PART, 3, 2, 3), outputs=(3,)
    ),
}
BAD = {
    "no program": None,
    "a tuple": tuple(program()),
    "other inputs": program(inputs=1),
    "instructions in a list": program()._replace(instructions=[]),
    "outputs in a list": program(outputs=[0]),
    "no instruction": program()._replace(instructions=((Kind.ADD, 2, 0, 1, None),)),
    "an output that is not there": program(outputs=(2,)),
    "a negative output": program(outputs=(-1,)),
    "an output that is no number": program(outputs=(True,)),
    "an input defined again": program((Kind.ADD, 1, 0, 0)),
    "a value defined twice": program((Kind.ADD, 2, 0, 0), (Kind.ADD, 2, 0, 1)),
    "a value out of range": program((Kind.ADD, 9, 0, 0)),
    "a value that is no number": program((Kind.ADD, 2.0, 0, 0)),
    "a value of a system": program((Kind.SOLVE, 2, None, SYSTEM), (Kind.ADD, 2, 0, 1)),
    "a system twice": program((Kind.SOLVE, 2, None, SYSTEM), (Kind.SOLVE, 2, None, SYSTEM)),
    "an operand that comes later": program((Kind.ADD, 2, 0, 3), (Kind.ADD, 3, 0, 0)),
    "a first operand that comes later": program((Kind.MULTIPLY, 2, 3, 0), (Kind.ADD, 3, 0, 0)),
    "itself": program((Kind.SUBTRACT, 2, 2, 0)),
    "an operand that is no number": program((Kind.ADD, 2, 0, 1.0)),
    "a system as an operand": program((Kind.SOLVE, 2, None, SYSTEM), (Kind.ADD, 3, 2, 0)),
    "a system as an output": program((Kind.SOLVE, 2, None, SYSTEM), outputs=(2,)),
    "no constant": program((Kind.CONSTANT, 2)),
    "a double as a constant": program((Kind.CONSTANT, 2, None, None, 1.0)),
    "a factor without end": program((Kind.SCALE, 2, 0, None, flint().arb(0, float("inf")))),
    "a factor that is no number": program((Kind.SCALE, 2, 0, None, flint().arb("nan"))),
    "a multiple of nothing": program((Kind.SCALE, 2, 3, None, ONE)),
    "a sine alone": program((Kind.SINE, 2, 0, 3), (Kind.ADD, 3, 0, 0)),
    "a sine of something else": program((Kind.SINE, 2, 0, 3), (Kind.COSINE, 3, 1, 2)),
    "a cosine of another sine": program((Kind.SINE, 2, 0, 3), (Kind.COSINE, 3, 0, 4), (Kind.SINE, 4, 0, 3)),
    "a sine of nothing": program((Kind.SINE, 2, 4, 3), (Kind.COSINE, 3, 4, 2)),
    "two sines": program((Kind.SINE, 2, 0, 3), (Kind.SINE, 3, 0, 2)),
    "a negative derivative": program((Kind.GAIN, 2, 0, -1)),
    "half a derivative": program((Kind.GAIN, 2, 0, 0.5)),
    "a gain of nothing": program((Kind.GAIN, 2, 3, 0)),
    "a part of nothing": program((Kind.PART, 2, 0, 0)),
    "a part too far": program((Kind.SOLVE, 2, None, SYSTEM), (Kind.PART, 3, 2, 2)),
    "a part before the first": program((Kind.SOLVE, 2, None, SYSTEM), (Kind.PART, 3, 2, -1)),
    "half a part": program((Kind.SOLVE, 2, None, SYSTEM), (Kind.PART, 3, 2, 0.5)),
    "a part of no number": program((Kind.SOLVE, 2, None, SYSTEM), (Kind.PART, 3, 2.0, 0)),
    "no system": program((Kind.SOLVE, 2, None, tuple(SYSTEM))),
    "an empty system": program((Kind.SOLVE, 2, None, LinearSystem((), ()))),
    "no square matrix": program((Kind.SOLVE, 2, None, SYSTEM._replace(matrix=((0, 1), (1,))))),
    "a wide matrix": program((Kind.SOLVE, 2, None, LinearSystem(((0, 1),), ((0,),)))),
    "rows that are missing": program((Kind.SOLVE, 2, None, SYSTEM._replace(right=((0,),)))),
    "rows of several lengths": program((Kind.SOLVE, 2, None, SYSTEM._replace(right=((0,), (0, 1))))),
    "a row in a list": program((Kind.SOLVE, 2, None, SYSTEM._replace(matrix=((0, 1), [1, 0])))),
    "a matrix in a list": program((Kind.SOLVE, 2, None, SYSTEM._replace(matrix=[(0, 1), (1, 0)]))),
    "an entry that is not there": program((Kind.SOLVE, 2, None, SYSTEM._replace(matrix=((0, 1), (1, 3))))),
    "an entry that is not there, right": program((Kind.SOLVE, 2, None, SYSTEM._replace(right=((0,), (5,))))),
    "an input as an instruction": program((0, 2)),
    "an unknown kind": program((11, 2, 0, 0)),
    "an unknown kind with a system": program((11, 2, None, SYSTEM)),
}


@pytest.mark.parametrize("name", GOOD)
def test_programs_that_are(name):
    assert sound(GOOD[name])


@pytest.mark.parametrize("name", BAD)
def test_programs_that_are_none(name):
    assert not sound(BAD[name])


def refused(one, **changes):
    with pytest.raises(NotProvedError):
        replace(one, **changes)


def more(given, outputs):
    return given._replace(outputs=outputs)


def test_programs_of_other_sizes():
    """Every one of them has as many inputs as the state has numbers, and the outputs that are due."""
    one = circle(0)
    for name in ("field", "drift", "closure", "energies"):
        given = getattr(one, name)
        refused(one, **{name: more(given, given.outputs[1:])})
        refused(one, **{name: more(given, (*given.outputs, 0))})
        refused(one, **{name: given._replace(inputs=2)})
    refused(one, jacobian=more(one.jacobian, one.jacobian.outputs * 2))
    replace(one, jacobian=more(one.jacobian, one.jacobian.outputs * 4))
    replace(one, jacobian=more(one.jacobian, ()))
    refused(one, lyapunov=one.energies)
    replace(one, lyapunov=one.closure)
    replace(one, left_out=one.energies)
    refused(one, left_out=one.energies._replace(inputs=4))
    refused(one, efforts=one.closure)


def test_states_with_efforts():
    """As many as are held; a law that is sampled has some."""
    one = circle(0)
    tape = Tape(4)
    q, y, v, u = tape.inputs
    held = {name: in_balls(tape, outputs) for name, outputs in (("field", [v, v, u, 0]), ("drift", [v, v, 0, 0]))}
    rest = {"closure": in_balls(tape, [y]), "jacobian": in_balls(tape, []), "energies": in_balls(tape, [q, y])}
    known = ClosedLoopEquations(2, 1, (0,), **held, **rest, efforts=in_balls(tape, [q]))
    assert known.sizes == {"Q": 1, "Y": 1, "V": 1, "X": 4, "D": 3}
    refused(known, efforts=None)
    refused(known, efforts=in_balls(tape, [q, q]))
    refused(known, n=3)
    refused(known, n=-1, efforts=in_balls(tape, [q, q, q]))
    refused(one, n=2)
    refused(one, n=0)


def test_places_that_are_none():
    one = circle(0)
    for places in ([0], (2,), (-1,), (0.0,), (True,), (0, 1), ()):
        refused(one, independent=places)
    refused(one, n_x=3)
    refused(one, n_x=-2)
    refused(one, n_x=2.0)
    refused(one, n=True)
    assert (one.dependent, circle(1).dependent) == ((1,), (0,))


def test_turns_that_are_none():
    """Places in x, targets that are finite balls, in tuples."""
    one, four = circle(0), tuple(ball(0.5) for _ in range(4))
    wide = replace(one, wrapped=(Wrapped(0, ball(1)), Wrapped(1, ball(2))))
    assert len(wide.wrapped) == 2
    for turns in (
        [Wrapped(0, ball(1))],
        (Wrapped(2, ball(1)),),
        (Wrapped(-1, ball(1)),),
        (Wrapped(0.0, ball(1)),),
        (Wrapped(0, 1.0),),
        (Wrapped(0, flint().arb("nan")),),
        ((0, ball(1)),),
        (Upright(0, four),),
        (Wrapped(0, ball(1)), Wrapped(2, ball(1))),
    ):
        refused(one, wrapped=turns)
    tape = Tape(6)
    recorded = {
        "field": in_balls(tape, [0] * 6),
        "drift": in_balls(tape, [0] * 6),
        "energies": in_balls(tape, [0, 0]),
        "jacobian": in_balls(tape, []),
        "closure": in_balls(tape, [0] * 4),
    }
    ball_loop = ClosedLoopEquations(5, 1, (0,), **recorded, upright=(Upright(1, four),))
    for turns in (
        [Upright(1, four)],
        (Upright(2, four),),
        (Upright(-1, four),),
        (Upright(1, four[:3]),),
        (Upright(1, list(four)),),
        (Upright(1, (*four[:3], 0.5)),),
        (Upright(1, (*four[:3], flint().arb("inf"))),),
        (Wrapped(1, four),),
        (Upright(1, four), Upright(1, four[:3])),
    ):
        refused(ball_loop, upright=turns)


def test_whose_rates_are_the_numbers_rates():
    """As the programs have it."""
    one = circle(0)
    assert one.scalar
    assert not replace(one, drift=more(one.drift, one.drift.outputs[::-1])).scalar


def test_digests_tell_loops_apart():
    """Every instruction and constant counts, and to which program it belongs; copies and pickles are the same."""
    one = circle(0)
    for again in (circle(0), copy.deepcopy(one), pickle.loads(pickle.dumps(one)), replace(one)):
        assert again.digest == one.digest
    third = ball(1) / 3
    scaled = [
        item._replace(constant=item.constant * (1 + third / 2**100)) if item.kind == Kind.SCALE else item
        for item in one.field.instructions
    ]
    fuzzy = [
        item._replace(constant=item.constant + flint().arb(0, 1e-30)) if item.kind == Kind.SCALE else item
        for item in one.field.instructions
    ]
    with flint().ctx.workprec(200):
        others = [
            circle(1),
            replace(one, field=one.field._replace(instructions=tuple(scaled))),
            replace(one, field=one.field._replace(instructions=tuple(fuzzy))),
            replace(one, drift=one.field),
            replace(one, energies=more(one.energies, one.energies.outputs[::-1])),
            replace(one, left_out=one.energies),
            replace(one, lyapunov=one.closure),
            replace(one, wrapped=(Wrapped(0, ball(1)),)),
            replace(one, wrapped=(Wrapped(0, third),)),
            replace(one, free="another"),
        ]
    assert len({each.digest for each in (one, *others)}) == 1 + len(others)
    wide = replace(one, wrapped=(Wrapped(0, third),))
    assert pickle.loads(pickle.dumps(wide)).digest == wide.digest


def test_what_they_hold_cannot_be_written_to():
    one = circle(0)
    for each in fields(one):
        value = getattr(one, each.name)
        assert value is None or isinstance(value, int | str | tuple)
    with pytest.raises(AttributeError):
        one.field = one.drift
