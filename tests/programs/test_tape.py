"""What is recorded on tapes, copied between them, differentiated and lowered, beside power series of the same."""

import math
from fractions import Fraction

import numpy as np
import pytest

from ccpin.programs.evaluation import values_of
from ccpin.programs.folding import Arithmetic, folded
from ccpin.programs.instructions import Kind
from ccpin.programs.lowering import lowered
from ccpin.programs.tape import Node, Tape, is_zero

AT = (0.7, -0.4)


def everything(tape, x, y):
    """Every operation there is."""
    s, c = tape.sincos(x * y + 1)
    z = tape.solve([[x + 3, y], [s, 4 - x]], [[y, tape.node(1)], [x * x, c]])
    return [
        s * c,
        x - y * 3,
        tape.root(x * y + 2) * y,
        tape.reciprocal(x + y * y),
        tape.angle(y + 1, x),
        tape.angle(tape.node(2), y - 3),
        tape.angle(x, tape.node(1)),
        tape.gain(x * Fraction(1, 4)),
        tape.gain(y * Fraction(1, 5), 1) + 5,
        *z.ravel(),
    ]


def as_numbers(x, y, sqrt, sin, cos, atan):
    """The same of numbers or power series."""
    s, c = sin(x * y + 1), cos(x * y + 1)
    a, b, d = x + 3, y, 4 - x
    det = a * d - b * s

    def gain(w):
        return 4 * atan(sqrt((1 - w) / (1 + w))) / sqrt(1 - w * w)

    def slope(w):
        return (w * gain(w) - 2) / (1 - w * w)

    return [
        s * c,
        x - y * 3,
        sqrt(x * y + 2) * y,
        1 / (x + y * y),
        atan((y + 1) / x),
        math.pi - atan(2 / (3 - y)),
        atan(x),
        gain(x * 0.25),
        slope(y * 0.2) + 5,
        (d * y - b * (x * x)) / det,
        (d - b * c) / det,
        (a * (x * x) - s * y) / det,
        (a * c - s) / det,
    ]


def computed(tape, outputs, at=AT):
    done = lowered(tape.code(outputs), np.array([at, (0.3, 0.2)]))
    values = values_of(done.code, [np.float64(number) for number in at], np)
    return [float(values[number]) for number in done.code.outputs]


def wanted(at=AT):
    return as_numbers(*at, math.sqrt, math.sin, math.cos, math.atan)


def test_values():
    tape = Tape(2)
    np.testing.assert_allclose(computed(tape, everything(tape, *tape.inputs)), wanted(), rtol=1e-13)


def test_copies_on_another_tape():
    """At expressions of it: the same functions of those."""
    first = Tape(2)
    code = first.code(everything(first, *first.inputs))
    tape = Tape(2)
    x, y = tape.inputs
    found = computed(tape, tape.inlined(code, [x * y + 1, y + Fraction(1, 4)]))
    np.testing.assert_allclose(found, wanted((AT[0] * AT[1] + 1, AT[1] + 0.25)), rtol=1e-13)


def test_copies_at_constants_are_constants():
    first = Tape(2)
    x, y = first.inputs
    outputs = [x + y, x - y, x * y, x * 5, first.root(x), first.reciprocal(x)]
    tape = Tape(0)
    found = tape.inlined(first.code(outputs), [Fraction(9, 4), Fraction(1, 3)])
    assert found == [
        Fraction(31, 12), Fraction(23, 12), Fraction(3, 4), Fraction(45, 4), Fraction(3, 2), Fraction(4, 9)
    ]  # fmt: skip


@pytest.mark.parametrize("way", [(1, 0), (0, 1), (2, -3)])
def test_derivatives_through_everything(way):
    """Solutions move along, by power series of flint's."""
    flint = pytest.importorskip("flint")
    tape = Tape(2)
    slopes = tape.derivative(everything(tape, *tape.inputs), dict(enumerate(way)), held=False)
    series = [flint.arb_series([value, step], prec=2) for value, step in zip(AT, way, strict=True)]
    functions = (type(series[0]).sqrt, type(series[0]).sin, type(series[0]).cos, type(series[0]).atan)
    true = [each[1] for each in as_numbers(*series, *functions)]
    np.testing.assert_allclose(computed(tape, slopes), [float(value.mid()) for value in true], rtol=1e-12, atol=1e-14)


def test_what_does_not_move_has_no_derivative():
    tape = Tape(2)
    x, y = tape.inputs
    z = tape.solve([[x]], [[y]])[0, 0]
    fixed = [tape.root(x), tape.reciprocal(x), tape.angle(x, x + 1), tape.gain(x), tape.sincos(x)[0], x * x, 7]
    assert all(map(is_zero, tape.derivative(fixed, {1: 1}, held=False)))
    assert is_zero(tape.derivative([z], {0: 1})[0])
    assert not is_zero(tape.derivative([z], {0: 1}, held=False)[0])


def test_solutions_of_which_a_part_moves():
    tape = Tape(2)
    x, y = tape.inputs
    z = tape.solve([[x, 0], [0, y]], [[1], [1]])
    found = computed(tape, tape.derivative(z.ravel().tolist(), {0: 1}, held=False))
    np.testing.assert_allclose(found, [-1.0 / AT[0] ** 2, 0.0], rtol=1e-14)


def test_constants_are_exact_where_they_are_rational():
    tape = Tape(1)
    assert tape.root(Fraction(9, 4)) == Fraction(3, 2)
    assert tape.reciprocal(Fraction(3, 2)) == Fraction(2, 3)
    third = tape.root(3)
    assert isinstance(third, Node)
    assert tape.root(3).index == third.index
    (x,) = tape.inputs
    sine, _ = tape.sincos(x)
    code = tape.code(
        [
            x * third + tape.reciprocal(third),
            tape.angle(third, 1) * x,
            third,
            third * sine,
            third * 2,
            tape.sincos(third)[0],
            tape.gain(tape.root(Fraction(1, 2))),
        ]
    )
    assert Kind.ROOT in {item.kind for item in code.instructions}
    plain = folded(code, Arithmetic(float, math.sqrt, lambda a: 1 / a, math.atan2))
    kinds = {item.kind for item in plain.instructions}
    assert not kinds & {Kind.ROOT, Kind.RECIPROCAL, Kind.MULTIPLY}
    assert {Kind.SCALE, Kind.CONSTANT} <= kinds
    values = values_of(plain, [2.0], np)
    found = [values[number] for number in plain.outputs]
    root = 3**0.5
    expected = [
        2 * root + 1 / root,
        2 * math.pi / 3,
        root,
        root * math.sin(2.0),
        2 * root,
        math.sin(root),
        math.pi / 2**0.5,
    ]
    np.testing.assert_allclose(found, expected, rtol=1e-14)


@pytest.mark.parametrize("symmetric", [False, True])
def test_sparse_systems_are_solved(symmetric):
    """Against NumPy, where pivots on the diagonal would vanish, too; loops that share nothing cost nothing."""
    rng = np.random.default_rng(2)
    pattern = rng.random((6, 6)) < 0.45
    pattern = pattern | pattern.T if symmetric else pattern
    np.fill_diagonal(pattern, symmetric)
    pattern[[0, 1, 2, 3, 4, 5], [1, 2, 3, 4, 5, 0]] |= not symmetric
    places = [(r, c) for r in range(6) for c in range(6) if pattern[r, c] and (c >= r or not symmetric)]
    tape = Tape(len(places) + 6)
    matrix = np.zeros((6, 6), dtype=object)
    for node, (r, c) in zip(tape.inputs, places, strict=False):
        matrix[r, c] = node
        if symmetric:
            matrix[c, r] = node
    right = np.array(tape.inputs[len(places) :], dtype=object)[:, None]
    code = tape.code(tape.solve(matrix, right).ravel())
    assert Kind.SOLVE in {item.kind for item in code.instructions}
    samples = rng.normal(size=(20, code.inputs)) + 0.5
    done = lowered(code, samples)
    assert Kind.SOLVE not in {item.kind for item in done.code.instructions}
    assert len(done.pivots) == 6
    for sample in samples[:5]:
        A = np.zeros((6, 6))
        for value, (r, c) in zip(sample, places, strict=False):
            A[r, c] = value
            if symmetric:
                A[c, r] = value
        values = values_of(done.code, list(sample), np)
        found = [values[number] for number in done.code.outputs]
        scale = np.linalg.cond(A)
        np.testing.assert_allclose(found, np.linalg.solve(A, sample[len(places) :]), rtol=1e-13 * scale**2, atol=1e-12)


def test_a_matrix_singular_by_structure_is_told():
    tape = Tape(2)
    x, y = tape.inputs
    code = tape.code(tape.solve([[x, 0], [y, 0]], [[1], [1]]).ravel())
    with pytest.raises(ZeroDivisionError, match="structure"):
        lowered(code, np.ones((3, 2)))
