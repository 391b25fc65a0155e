"""Constants of programs as they are enclosed, and certificates with parts of another kind: each number by hand."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import ccpin
from ccpin import programs
from ccpin.programs.instructions import Code, Instruction, Kind
from ccpin.validated import certify_program

flint = pytest.importorskip("flint")

from ccpin.validated.arithmetic.balls import ball  # noqa: E402
from ccpin.validated.programs.certificate_documents import _code_of  # noqa: E402
from ccpin.validated.programs.program_equations import _distance, _factor, _numpy_constants  # noqa: E402


def test_products_with_powers_of_two_alone_are_exact():
    assert _factor(ball(-0.5), -0.5, None).exact
    assert not _factor(ball(0.75), 0.75, None).exact
    assert not _factor(ball(0.5), 0.75, None).exact
    assert not _factor(ball(0.5), 0.5, 0.75).exact


def test_how_far_doubles_are_is_the_farthest():
    assert _distance(ball(1.0), [1.0, 1.0]) == 0.0
    assert 2.0 <= _distance(ball(1.0), [3.0, 1.0, 1.5]) <= 2.0 * (1 + 2.0**-50)
    made = _factor(ball(1.0), 1.25, 4.0)
    assert (made.value, made.off) == (1.0, 0.0)
    assert 3.0 <= made.double <= 3.0 * (1 + 2.0**-50)
    assert 0.25 <= made.single <= 0.25 * (1 + 2.0**-50)


def test_what_numpy_has_for_constants():
    """Constants, what is made of them alone, and the factors of products with one."""
    code = Code(
        9, 1,
        (
            Instruction(Kind.CONSTANT, 1, constant=Fraction(1, 3)),
            Instruction(Kind.CONSTANT, 2, constant=Fraction(2, 7)),
            Instruction(Kind.ADD, 3, 1, 2), Instruction(Kind.MULTIPLY, 4, 3, 0), Instruction(Kind.MULTIPLY, 5, 0, 2),
            Instruction(Kind.SCALE, 6, 0, constant=Fraction(1, 10)), Instruction(Kind.MULTIPLY, 7, 0, 0),
            Instruction(Kind.ADD, 8, 7, 1),
        ),
        (8,),
    )  # fmt: skip
    third, both = 1 / 3, 1 / 3 + 2 / 7
    assert _numpy_constants(code) == {1: third, 2: 2 / 7, 3: both, 4: both, 5: 2 / 7, 6: 0.1}


def test_a_program_of_as_many_values_as_inputs_is_read():
    document = {"size": 3, "inputs": 3, "instructions": [], "outputs": [2]}
    assert _code_of(document) == Code(3, 3, (), (2,))
    with pytest.raises(ValueError, match="a program of 3 values"):
        _code_of(document | {"inputs": 4})


def test_facts_of_a_program_with_more_premises_are_not_of_this_one():
    model = ccpin.ReducedModel(ccpin.load("four_bar"))

    def made(given):
        program = programs.record(model, "rho", given=given)
        middle = np.array(program.example[:1])
        return certify_program(program, (middle - 0.01, middle + 0.01), bounds={}, max_cells=1)

    closed, near = made("closed"), made("near")
    assert (closed.verdict, near.verdict) == ("proven", "proven")
    assert replace(near, computed=closed.computed).verdict == "undecided"
    assert replace(closed, computed=near.computed).verdict == "undecided"
