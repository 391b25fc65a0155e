"""Negations carried along: the same numbers to the bit, and none left but at outputs and what is odd or even."""

import numpy as np

from ccpin.programs.evaluation import values_of
from ccpin.programs.instructions import Kind
from ccpin.programs.signs import unsigned
from ccpin.programs.tape import Tape


def grown(seed):
    """A tape of random sums, products, reciprocals and sines, with many a minus, and its last values."""
    rng = np.random.default_rng(seed)
    tape = Tape(4)
    nodes = list(tape.inputs)
    for _ in range(60):
        a, b = (nodes[k] for k in rng.integers(len(nodes), size=2))
        made = [
            lambda a=a, b=b: a - b,
            lambda a=a: -a,
            lambda a=a, b=b: -a * b,
            lambda a=a, b=b: -a - b,
            lambda a=a: a * -3,
            lambda a=a: tape.reciprocal(-a),
            lambda a=a: tape.sincos(-a)[0],
        ][rng.integers(7)]()
        if not isinstance(made, int):
            nodes.append(made)
    return tape, nodes[-6:]


def test_the_same_numbers_to_the_bit():
    """All outputs, and the sizes of what is kept besides; values are numbered without gaps."""
    rng = np.random.default_rng(0)
    fewer = 0
    for seed in range(40):
        tape, last = grown(seed)
        code = tape.code(last)
        kept = [item.target for item in code.instructions][::3]
        found, numbers = unsigned(code, kept)
        assert [item.target for item in found.instructions] == list(range(found.inputs, found.size))
        inputs = list(rng.normal(size=(4, 50)))
        with np.errstate(all="ignore"):
            before, after = values_of(code, inputs, np), values_of(found, inputs, np)
        for a, b in zip(code.outputs, found.outputs, strict=True):
            np.testing.assert_array_equal(before[a], after[b])
        for a, b in zip(kept, numbers, strict=True):
            np.testing.assert_array_equal(np.abs(before[a]), np.abs(after[b]))
        minus = [
            sum(item.kind == Kind.SCALE and item.constant < 0 for item in each.instructions) for each in (code, found)
        ]
        fewer += minus[0] - minus[1]
        assert len(found.instructions) <= len(code.instructions) + len(code.outputs)
    assert fewer > 100


def test_nothing_is_left_of_a_product_of_negatives():
    """(−a)(−b) − (−c) is a b + c: two operations."""
    tape = Tape(3)
    a, b, c = tape.inputs
    found, _ = unsigned(tape.code([(-a) * (-b) - (-c)]))
    assert len(found.instructions) == 2
    assert not any(item.kind == Kind.SCALE for item in found.instructions)
