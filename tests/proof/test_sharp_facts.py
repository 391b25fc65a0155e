"""What `prove` asks of a claim before its theorem is asked: forms, ranges, kinds, premises."""

from dataclasses import dataclass, replace
from types import MappingProxyType, SimpleNamespace
from typing import Annotated

import numpy as np
import pytest

from ccpin.proof import facts
from ccpin.proof.facts import (
    Examined,
    Fact,
    Form,
    NotProvedError,
    ProvableClaim,
    Unproved,
    is_fact,
    prove,
    prove_some,
    require,
    sealed,
)
from tests.support.straight import boxes_about, straight


class Numbers(SimpleNamespace):
    """Equations with two unknowns."""

    digest, sizes = "1", MappingProxyType({"N": 2})


@dataclass(frozen=True, eq=False)
class Rows(ProvableClaim):
    """What is said of each of B numbers and of whole numbers; proved where the first is below 4."""

    own: Annotated[np.ndarray, Form("Bk", least=1.0, below=5.0)]
    whole: Annotated[np.ndarray, Form("B", "i", 0)]
    rows, theorem = "B", "rows"

    def examined(self, *premises: Fact) -> Examined:
        """Row by row."""
        return Examined(self.own[:, 0] < 4.0, {"twice": 2.0 * self.own[:, 0]})


@dataclass(frozen=True, eq=False)
class Beside(ProvableClaim):
    """Rows that speak of N numbers too."""

    own: Annotated[np.ndarray, Form("Bk")]
    common: Annotated[np.ndarray, Form("N", above=1.0)]
    rows = "B"


@dataclass(frozen=True, eq=False)
class Whole(ProvableClaim):
    """One claim about all of its numbers, which are to be below 4."""

    own: Annotated[np.ndarray, Form("B")]
    theorem = "whole"

    def examined(self, *premises: Fact) -> Examined:
        """All at once."""
        return Examined(np.array([bool(np.all(self.own < 4.0))]), {})


@pytest.fixture(autouse=True)
def kinds(monkeypatch):
    """`prove` knows these for a while."""
    monkeypatch.setattr(facts, "_KINDS", {Rows, Whole, *facts._KINDS})
    monkeypatch.setattr(facts, "_EQUATIONS", {Numbers, *facts._EQUATIONS})


def test_facts_are_told_by_their_kind():
    """A claim is none, nor what is like a fact."""
    fact = prove(rows([[2.0]]))
    assert is_fact(fact, Rows)
    for other, kind in (
        (fact, Whole),
        (fact, ProvableClaim),
        (fact.claim, Rows),
        (None, Rows),
        (Unproved(fact.claim), Rows),
    ):
        assert not is_fact(other, kind)
    assert not is_fact(SimpleNamespace(claim=fact.claim), Rows)


def rows(own, whole=None):
    own = np.array(own, dtype=float)
    return Rows(Numbers(), own, np.zeros(len(own), dtype=np.int64) if whole is None else np.array(whole))


def beside(common):
    return Beside(Numbers(), np.ones((2, 1)), np.array(common))


def test_a_row_has_all_its_numbers_in_their_range():
    """From the least on, to below what is too large; one entry that is not is enough."""
    own = [[1.0, 4.9], [2.0, 5.0], [0.9, 1.0], [2.0, 9.0], [2.0, 0.75], [np.nan, 1.0], [1.0, -np.inf], [np.inf, 1.0]]
    assert rows(own).well_formed().tolist() == [True, *[False] * 7]


def test_what_other_rows_speak_of_too_is_in_its_range_or_nothing_is_proved():
    """Numbers above 1, whole numbers from 0 on, whatever their rows are."""
    assert beside((1.1, 1.1)).well_formed().all()
    for common in ((1.0, 2.0), (0.75, 2.0), (np.nan, 2.0), (np.inf, 2.0)):
        with pytest.raises(NotProvedError):
            beside(common).well_formed()
    with pytest.raises(NotProvedError):
        rows([[1.0], [1.0]], [0, -1]).well_formed()


@pytest.mark.parametrize("own", [np.ones((2, 1), dtype=np.float32), np.ones(2), np.array(1.0), None, "words", 1.0])
def test_what_is_no_array_of_its_form_is_no_claim(own):
    with pytest.raises(NotProvedError):
        Rows(Numbers(), own, np.zeros(2, dtype=np.int64)).well_formed()


def test_forms_agree_on_their_axes():
    """N is the equations' 2, B the same in a claim."""
    for claim in (beside((2.0,)), beside((2.0, 2.0, 2.0)), rows([[1.0], [1.0]], [0, 0, 0])):
        with pytest.raises(NotProvedError):
            claim.well_formed()


def test_one_claim_about_all_of_its_arrays_has_one_row():
    assert Whole(Numbers(), np.ones(3)).well_formed().tolist() == [True]


def test_those_rows_are_facts_that_are_formed_and_proved():
    """In one claim, each by itself; and what was found of them alone."""
    claim = rows([[1.0], [4.5], [0.5], [3.0]])
    fact, kept = prove_some(claim)
    assert kept.tolist() == [True, False, False, True]
    assert fact.claim.own.tolist() == [[1.0], [3.0]]
    assert fact.found["twice"].tolist() == [2.0, 6.0]
    for bad in ([[1.0], [4.5]], [[1.0], [0.5]]):
        with pytest.raises(NotProvedError):
            prove(rows(bad))


def test_what_is_proved_whole_or_not_at_all():
    fact, kept = prove_some(Whole(Numbers(), np.ones(3)))
    assert (fact.claim.own.tolist(), kept.tolist()) == ([1.0, 1.0, 1.0], [True])
    with pytest.raises(NotProvedError):
        prove_some(Whole(Numbers(), np.array([1.0, 5.0])))


def test_kinds_that_the_kernel_does_not_know():
    """Of claims, and of equations; and premises that are none, or are about others."""

    class Generous(Rows):
        pass

    class Other(Numbers):
        digest = "2"

    fine = rows([[1.0]])
    own = (fine.own, fine.whole)
    for claim in (Generous(Numbers(), *own), Rows(Other(), *own)):
        with pytest.raises(NotProvedError):
            prove(claim)
    facts._EQUATIONS.add(Other)
    for premise in (prove(Rows(Other(), *own)), fine, facts.Unproved(fine)):
        with pytest.raises(NotProvedError):
            prove(fine, premise)
    assert prove(fine, prove(fine)).premises[0].claim.own == [[1.0]]


def test_what_is_required_is_all_of_it():
    require([True, True], "")
    with pytest.raises(NotProvedError, match="that"):
        require([True, False], "that")


def test_arrays_of_numbers_are_sealed_and_nothing_else_is():
    """Lists and tuples of them too; a sealed one is itself, but not what only shares its memory."""
    for value in (np.ones(2), [1.0, 1.0], (1.0, 1.0), np.ones(2, dtype=bool)):
        array = sealed(value)
        assert type(array) is np.ndarray
        assert isinstance(array.base, bytes)
        assert sealed(array) is array
        assert np.array_equal(array, value)
    words = np.array([None, "a"])
    assert sealed(words) is words
    assert sealed("words") == "words"


def test_what_is_replayed_is_proved_once_and_stays_shared():
    one = prove(rows([[1.0]]))
    again = prove(rows([[2.0]]), one, one).replay()
    assert again is not one
    assert again.premises[0] is again.premises[1]
    assert again.claim.own == [[2.0]]


def test_the_same_of_closures():
    """y = 2q: a box that holds the line is a fact, one beside it is not."""
    from ccpin.proof.solutions import SolutionsInBoxes

    claim = SolutionsInBoxes(straight([[2.0]]), *boxes_about([[0.0, 0.0], [0.0, 1.0]], 0.5, [[2.0]], 0.1))
    assert prove_some(claim)[1].tolist() == [True, False]
    with pytest.raises(NotProvedError):
        prove(replace(claim, radius=-claim.radius))
