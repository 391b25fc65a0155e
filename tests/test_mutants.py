"""The table of mutants names what is there; the mutants themselves are run by ``python -m tests.mutants``."""

import ast
from pathlib import Path

import pytest

from tests.mutants.changes import changes_of
from tests.mutants.table import ROOMS, WHOLE, mutants_of, unlisted

TESTS = Path(__file__).parent


@pytest.mark.parametrize("room", ROOMS, ids=[room.module for room in ROOMS])
def test_every_place_and_fragment_of_the_table_is_there(room):
    assert list(mutants_of(room))
    assert [test for test in room.tests if not (TESTS / test.partition("::")[0]).is_file()] == []


@pytest.mark.parametrize("folder", WHOLE)
def test_whatever_a_claim_may_rest_on_is_in_the_table_or_excused(folder):
    assert unlisted(folder) == []


def test_each_number_inequality_and_term_is_changed():
    source = "C = 2.0\n\ndef f(x, y):\n    y += x**2\n    return (0.5 * x + y < 1.0) & (x > y)\n"
    found = {(change.place, change.what) for change in changes_of(source, ("C", "f"))}
    factors = {
        (place, f"{value} × {k}")
        for k in ("0.5", "0.9", "1.1", "2")
        for place, value in (("C", 2), ("f", 0.5), ("f", 1))
    }
    assert found == factors | {
        ("f", "without x ** 2"), ("f", "no square"), ("f", "without y"), ("f", "without 0.5 * x"),
        ("f", "not asked: x > y"), ("f", "not asked: 0.5 * x + y < 1.0"),
        ("f", "0.5 * x + y < 1.0: left × 0.5"), ("f", "x > y: left × 2"),
    }  # fmt: skip


def test_conditions_whole_factors_and_extremes_are_changed():
    source = "def f(x, y: int | None):\n    z: int | None = min(2 * x, y / 3) if x or y else np.all(x)\n"
    assert {change.what for change in changes_of(source, ("f",))} == {
        "max instead of min", "1 instead of 2", "1 instead of 3", "not asked: x", "not asked: y", "any instead of all",
    }  # fmt: skip


def test_comparisons_with_zero_are_changed_at_zero():
    source = "def f(x):\n    return x > 0, x < 0.0, x >= 0, x <= 0\n"
    made = [(change.what, ast.unparse(change.made)) for change in changes_of(source, ("f",))]
    assert made == [("0 let in", "x >= 0"), ("0 let in", "x <= 0.0"), ("0 left out", "x > 0"), ("0 left out", "x < 0")]


def test_a_place_that_is_gone_is_an_error():
    with pytest.raises(LookupError, match="no 'gone'"):
        list(mutants_of(ROOMS[0]._replace(places=("gone",))))
    with pytest.raises(LookupError, match="nothing to change"):
        list(mutants_of(ROOMS[0]._replace(sharpness=(("no such line", "", "never"),))))
