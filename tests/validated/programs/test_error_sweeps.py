"""What operations lose, and what of it arrives, against formulas of small programs."""

import math
from fractions import Fraction

import numpy as np
import pytest

from ccpin.programs.instructions import Code, Instruction, Kind
from ccpin.programs.sine_cosine import DOUBLE, FLOAT
from ccpin.programs.tape import Tape
from ccpin.proof.facts import NotProvedError
from ccpin.validated.arithmetic.first_order import linear
from ccpin.validated.programs import error_sweeps
from ccpin.validated.programs.error_sweeps import FORMATS, ErrorSweep, evaluated
from ccpin.validated.programs.program_equations import runnable

pytest.importorskip("flint")
THIRD = Fraction(1, 3)
X, Y = 0.7, 1.9
LEAST = {"double": 2.0**-1022, "float": 2.0**-126}
UNITS = {"double": 2.0**-53, "float": 2.0**-24}


def point(*numbers):
    """Inputs that are known."""
    return [linear(np.array([x]), np.zeros((1, 2))) for x in numbers]


def swept(build, numbers, *values):
    """A sweep over what is built on a tape of so many inputs."""
    tape = Tape(len(values))
    outputs = build(tape, *tape.inputs)
    code = tape.code(outputs)
    sweep = ErrorSweep(runnable(code), point(*values), numbers)
    sweep.run(code.outputs)
    return sweep, code


@pytest.mark.parametrize("numbers", FORMATS, ids=lambda numbers: numbers.name)
def test_formats_are_those_of_ieee(numbers):
    kind = {"double": np.float64, "float": np.float32}[numbers.name]
    assert numbers.unit == np.finfo(kind).eps / 2
    assert numbers.least == np.finfo(kind).tiny
    assert numbers.largest * 2.0**6 < float(np.finfo(kind).max) < numbers.largest * 2.0**25
    told = {"double": DOUBLE, "float": FLOAT}[numbers.name]
    assert (numbers.sine, numbers.reach) == (told.error, told.reach)


def test_formats_are_two():
    told = [(each.unit, each.least, each.largest) for each in error_sweeps.FORMATS]
    assert told == [(2.0**-53, 2.0**-1022, 2.0**1000), (2.0**-24, 2.0**-126, 2.0**120)]


@pytest.mark.parametrize("numbers", FORMATS, ids=lambda numbers: numbers.name)
def test_what_operations_lose_and_what_arrives(numbers):
    """Each operation by itself, then through all that stands on it: Σ |∂o/∂v| ℓ."""
    u = numbers.unit
    third = abs(Fraction(float(np.float32(1 / 3)) if numbers.name == "float" else 1 / 3) - THIRD)
    lost = {
        "sum": (lambda t, x, y: x + y, u * (X + Y), (1.0, 1.0)),
        "difference": (lambda t, x, y: x - y, u * (Y - X), None),
        "product": (lambda t, x, y: x * y, u * X * Y, None),
        "third": (lambda t, x, y: x * THIRD, (float(third) + u * (1 / 3 + float(third))) * X, None),
        "half": (lambda t, x, y: x * Fraction(-1, 2), 0.0, None),
        "reciprocal": (lambda t, x, y: t.reciprocal(y), u / Y, None),
        "root": (lambda t, x, y: t.root(y), u * math.sqrt(Y), None),
        "sine": (lambda t, x, y: t.sincos(x)[0], numbers.sine, None),
        "cosine": (lambda t, x, y: t.sincos(x)[1], numbers.sine, None),
    }
    for name, (make, loss, _) in lost.items():
        sweep, code = swept(lambda t, x, y, make=make: [make(t, x, y)], numbers, X, Y)
        (output,) = code.outputs
        assert sweep.lost[output][0] == pytest.approx(loss, rel=1e-6, abs=1.01 * numbers.least), name
        assert sweep.lost[output][0] >= loss, name
        assert sweep.arriving([output], {})[0, 0] == pytest.approx(loss, rel=1e-6, abs=2e-290 + 1.01 * numbers.least)
    zero, code = swept(lambda t, x, y: [x * y, x + y], numbers, 0.0, 0.0)
    for output in code.outputs:
        assert zero.lost[output][0] == pytest.approx(numbers.least, rel=1e-9)
    zero, code = swept(lambda t, x, y: [x * THIRD], numbers, 0.0, 0.0)
    assert zero.lost[code.outputs[0]][0] == pytest.approx(numbers.least, rel=1e-9)


DERIVED = {
    "sum": (lambda t, w, y: w + y, lambda w: 1.0),
    "first of a difference": (lambda t, w, y: w - y, lambda w: 1.0),
    "second of a difference": (lambda t, w, y: y - w, lambda w: -1.0),
    "a cancelling one": (lambda t, w, y: (w + y) - w, lambda w: 0.0),
    "a double one": (lambda t, w, y: (w + y) + w, lambda w: 2.0),
    "first of a product": (lambda t, w, y: w * y, lambda w: Y),
    "square": (lambda t, w, y: w * w, lambda w: 2 * w),
    "multiple": (lambda t, w, y: w * Fraction(3, 4), lambda w: 0.75),
    "sine": (lambda t, w, y: t.sincos(w)[0], math.cos),
    "cosine": (lambda t, w, y: t.sincos(w)[1], lambda w: -math.sin(w)),
    "reciprocal": (lambda t, w, y: t.reciprocal(w), lambda w: -1 / w**2),
    "root": (lambda t, w, y: t.root(w), lambda w: 0.5 / math.sqrt(w)),
}


@pytest.mark.parametrize("name", DERIVED)
def test_what_is_lost_early_arrives_times_the_derivative(name):
    """A value that is known to 1e-3 counts by its derivative; what it comes of does not."""
    make, slope = DERIVED[name]
    w = X * Y
    sweep, code = swept(lambda t, x, y: [x * y, make(t, x * y, y)], FORMATS[0], X, Y)
    early, output = code.outputs
    given = sweep.arriving([output], {early: np.array([1e-3])})[0, 0]
    assert given == pytest.approx(1e-3 * abs(slope(w)), rel=1e-9, abs=2e-15)
    assert given >= 1e-3 * abs(slope(w)) * (1 - 1e-15)
    assert sweep.arriving([early, output], {early: np.array([1e-3])})[0, 0] == pytest.approx(1e-3, rel=1e-9)
    with_own = sweep.arriving([output], {})[0, 0]
    later = sweep.arriving([output], {early: np.zeros(1)})[0, 0]
    assert with_own == pytest.approx(later + abs(slope(w)) * sweep.lost[early][0], rel=1e-6, abs=1e-30)


def test_sums_of_losses_are_rounded_up():
    sweep, code = swept(lambda t, x, y: [x * y], FORMATS[0], X, Y)
    found = sweep.arriving(code.outputs, {code.outputs[0]: np.ones(1)})[0, 0]
    assert found == (1.0 + 2.0**-43) * (1.0 + 2.0**-50)
    assert sweep.arriving(code.outputs, {code.outputs[0]: np.zeros(1)})[0, 0] == 1e-290
    assert sweep.lost[code.outputs[0]][0] == pytest.approx(2.0**-53 * X * Y * (1 + 2.0**-40), rel=2.0**-41, abs=0)


def test_inputs_lose_nothing():
    sweep, code = swept(lambda t, x, y: [x, x * y], FORMATS[0], X, Y)
    assert sweep.arriving([code.outputs[0]], {})[0, 0] == 1e-290


def test_values_are_widened_by_what_is_lost():
    """So that computed ones are in them; not where a program is exact."""
    for numbers, wide in ((FORMATS[1], True), (None, False)):
        sweep, code = swept(lambda t, x, y: [x * y], numbers, X, Y)
        assert (sweep.values[code.outputs[0]].rad[0] > 2.0**-25) == wide
    tape = Tape(2)
    code = tape.code([tape.inputs[0] * tape.inputs[1], tape.inputs[0] * 3])
    product, triple = evaluated(runnable(code), point(X, Y))
    assert (product.mid[0], triple.mid[0]) == (X * Y, 3 * X)


@pytest.mark.parametrize("numbers", FORMATS, ids=lambda numbers: numbers.name)
def test_angles_beyond_reach_are_told(numbers):
    for share, reached in ((0.999999, True), (1.000001, False)):
        for k in (0, 1):
            sweep, _ = swept(lambda t, x, k=k: [t.sincos(x)[k]], numbers, share * numbers.reach)
            assert sweep.reached.tolist() == [reached]


def test_constants_are_compared_with_what_is_computed():
    """A folded constant, NumPy's own, one of no rounding, one of an irrational number."""
    tape = Tape(1)
    (x,) = tape.inputs
    irrational = tape.root(2) * tape.root(3)
    code = tape.code([x * irrational, x * THIRD, x * 3, x * Fraction(-1, 4), tape.node(THIRD), x + tape.root(2)])
    program = runnable(code)
    product, third, three, quarter, constant, _ = (program.factors.get(k) for k in code.outputs)
    exact = math.sqrt(6)
    assert product.value == pytest.approx(exact, rel=1e-15)
    assert 0 < product.off <= 2.0**-52
    assert product.double >= product.off
    assert product.double >= abs(float(np.sqrt(2.0) * np.sqrt(3.0)) - exact) / 2
    assert product.single == pytest.approx(abs(float(np.float32(exact)) - exact), rel=1e-6)
    for each in (third, constant):
        assert each.off == pytest.approx(float(abs(Fraction(1 / 3) - THIRD)), rel=1e-6)
        assert each.single == pytest.approx(float(abs(Fraction(float(np.float32(1 / 3))) - THIRD)), rel=1e-6)
    assert three[1:] == (0.0, 0.0, 0.0, False)
    assert quarter[1:] == (0.0, 0.0, 0.0, True)
    assert not product.exact


def test_what_is_not_bounded_is_refused():
    code = Code(3, 2, (Instruction(Kind.ANGLE, 2, 0, 1),), (2,))
    with pytest.raises(NotProvedError, match="not bounded"):
        evaluated(runnable(code), point(X, Y))


def test_constants_alone():
    """A program of a constant, and one that adds one."""
    code = Code(3, 1, (Instruction(Kind.CONSTANT, 1, constant=THIRD), Instruction(1 + Kind.CONSTANT, 2, 0, 1)), (1, 2))
    sweep = ErrorSweep(runnable(code), point(X), FORMATS[0])
    sweep.run(code.outputs)
    off = float(abs(Fraction(1 / 3) - THIRD))
    assert sweep.lost[1][0] == pytest.approx(off, rel=1e-9)
    assert sweep.arriving([2], {})[0, 0] == pytest.approx(off + 2.0**-53 * (X + 1 / 3), rel=1e-9)
