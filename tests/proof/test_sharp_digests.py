"""Digests: what differs in a single number, name, kind or order has another one."""

from dataclasses import dataclass, make_dataclass
from enum import Enum
from functools import cached_property, partial
from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.errors import DifferentSubjectsError
from ccpin.proof.digests import Digests, UndigestedError, digest, require_same


class Colour(Enum):
    RED = 1


class Digested:
    def __init__(self, digested):
        self.digested = digested


class About:
    def __init__(self, digests, more):
        self.digests, self.more = digests, more


class Held:
    def __init__(self, **numbers):
        vars(self).update(numbers)

    @cached_property
    def twice(self):
        return 2 * self.one


class Called(Held):
    def __call__(self):
        return self.one


class Kind(type):
    """Of classes that hold nothing but numbers and words."""


class Empty(metaclass=Kind):
    __slots__ = ()


class Bare:
    __slots__ = ("one",)

    def __init__(self):
        self.one = 1


@dataclass(frozen=True)
class Record:
    one: float
    two: float


@pytest.mark.parametrize(
    "values",
    [
        (None, False, 0, "0", b"0", Colour.RED, 1),
        (1.0, np.float32(1.0), np.int64(1), np.ones(1), np.ones(1, dtype=np.int64), np.ones((1, 1))),
        (np.arange(4.0), np.arange(4.0)[::-1], np.arange(4.0).reshape(2, 2), np.arange(4.0).reshape(2, 2).T),
        (np.array([1, 2]), np.array([1, 3]), np.array([True, False]), np.array([False, True])),
        (Digests("a", "x"), Digests("a", "", "x"), Digests("a")),
        (About(Digests("a", "x"), 1), About(Digests("a", "y"), 1)),
        (Digested(1), Digested(2), Held(digested=1), (1,)),
        ({"a": 1}, {"a": 2}, {"b": 1}, {"a": 1, "b": 2}, {}),
        (slice(1), slice(2), slice(1, 2)),
        ((1, 2), (2, 1), [1, 2], {1, 2}, frozenset({1, 2}), (1, 2, 3), (1, (2,)), ((1,), 2)),
        (Record(1.0, 2.0), Record(2.0, 1.0), (1.0, 2.0)),
        (Held(one=1), Held(one=2), Held(two=1), SimpleNamespace(one=1)),
        (Held(one=1), Called(one=1), Called(one=2)),
    ],
    ids=lambda values: type(values[-1]).__name__,
)
def test_what_differs_has_another_digest(values):
    assert len({digest(value) for value in values}) == len(values)


def test_what_is_the_same_has_the_same():
    """Names, kept values and the order of keys and of sets do not enter; the first byte of a view may be anywhere."""
    assert digest(Digests("a", "x")) == digest(Digests("b", "x"))
    assert digest(About(Digests("a", "x"), 1)) == digest(Digests("b", "x"))
    assert digest({"a": 1, "b": 2}) == digest({"b": 2, "a": 1})
    for kind in (set, frozenset):
        assert digest(kind([0, 8])) == digest(kind([8, 0]))  # which are listed in two orders
    assert digest(-0.0) == digest(0.0)
    assert digest(np.arange(8.0)[::2]) == digest(np.array([0.0, 2.0, 4.0, 6.0]))
    held = Held(one=1)
    before = digest(held)
    assert held.twice == 2
    assert digest(held) == before


def test_pieces_do_not_run_into_each_other():
    """A class Ab with a field c, and a class A with a field bc."""
    one, other = make_dataclass("Ab", ["c"])(1), make_dataclass("A", ["bc"])(1)
    assert digest(one) != digest(other)


@pytest.mark.parametrize(
    "value",
    [len, lambda: 0, np.array([object()]), Record, Empty, Bare(), partial(int, 1), (1, len), {"a": len}, Held(one=len)],
    ids=lambda value: type(value).__name__,
)
def test_what_no_number_tells_has_none(value):
    with pytest.raises(UndigestedError):
        digest(value)


@pytest.mark.parametrize(("one", "other"), [("x", "y"), ("", "x"), ("x", ""), ("", "")])
@pytest.mark.parametrize("part", ["closures", "dynamics", "plant", "law"])
def test_objects_belong_together_where_both_say_the_same(part, one, other):
    ours, theirs = (Digests(name, **{part: said}) for name, said in (("one", one), ("other", other)))
    with pytest.raises(DifferentSubjectsError, match="do not belong together") as refused:
        require_same("a task", ours, theirs, part)
    silent = "one" if not one else "other"
    assert ("different" in str(refused.value)) == bool(one and other)
    assert (f"{silent} does not say" in str(refused.value)) == (not (one and other))
    require_same("a task", ours._replace(**{part: "x"}), theirs._replace(**{part: "x"}), part)
