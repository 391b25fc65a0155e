"""Claims and facts: a claim is data that anybody makes; a fact is a claim whose hypotheses `prove` has checked.

`prove(claim, *premises)` is the only way to a fact (the abstract type of theorems of LCF). `Fact` has no constructor,
no subclass and no assignment, and a copy is itself; its arrays are backed by bytes, so that nothing can be written to
them. Pickled, a fact is `Unproved` again, whatever it was: what crosses a file or a process is believed only after
`replay`, which is `prove` once more. So workers, files and the compiled core propose, and what they do wrong costs a
proof, never makes a false one. This guards against mistakes and forged data, not against a program that means to cheat
(``object.__new__(Fact)``): no idiom of Python does.

What a claim may say is declared with it: every array is ``Annotated`` with its `Form`. Theorems are about these shapes
(with fewer rows of a preconditioner than equations, AG = 0 would say less than G = 0), and what is no finite number is
refused before it is compared with anything. A premise counts if it is about the same equations, told by their `digest`,
or about those that the claim says it is to be about (`subjects`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, NamedTuple, Protocol, TypeGuard, TypeVar, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from ccpin.arrays import Mask
from ccpin.errors import CcpinError

_WORDS = {"f": "float64", "i": "int64", "b": "bool"}


class NotProvedError(CcpinError):
    """A claim that is none, or a hypothesis of its theorem that does not hold."""


class Equations(Protocol):
    """What claims are about, as far as facts need to know."""

    @property
    def digest(self) -> str:
        """SHA-256 of all numbers that they are made of."""

    @property
    def sizes(self) -> Mapping[str, int]:
        """The lengths of the axes that forms name by capital letters."""


class Form(NamedTuple):
    """What an array of a claim must be.

    Attributes:
        axes: A letter an axis: capitals are the equations' (`Equations.sizes`), others agree within the claim.
        kind: f: float64; i: int64; b: bool.
        least: No entry is below it; `above`: nor at or below it.
        below: No entry is as large.
    """

    axes: str
    kind: str = "f"
    least: float = -np.inf
    above: float = -np.inf
    below: float = np.inf


class Examined(NamedTuple):
    """Which rows of a claim are proved, and the numbers found on the way, a row of each for each row of the claim."""

    proved: Mask
    found: Mapping[str, NDArray[Any]]


def sealed(value: Any) -> Any:
    """A copy of an array of numbers that can never be written to (itself if it is one); all else as it is."""
    if not isinstance(value, np.ndarray | list | tuple):
        return value
    array = np.asarray(value)
    if array.dtype.kind not in "fiub" or (type(value) is np.ndarray and isinstance(value.base, bytes)):
        return array
    return np.ndarray(array.shape, array.dtype, buffer=array.tobytes())


@dataclass(frozen=True, eq=False)
class ProvableClaim:
    """What is claimed of equations. Subclasses add arrays, each ``Annotated`` with its `Form`, and `examined`.

    `rows`: the letter of the axis along which it is many claims, each of its own; none: it is one. `theorem`: the file
    of the theorem that it rests on.
    """

    equations: Any
    forms: ClassVar[Mapping[str, Form]] = MappingProxyType({})
    rows: ClassVar[str] = ""
    theorem: ClassVar[str] = ""

    def __init_subclass__(cls) -> None:
        hints = get_type_hints(cls, include_extras=True)
        cls.forms = MappingProxyType(
            {name: hint.__metadata__[0] for name, hint in hints.items() if get_origin(hint) is Annotated}
        )

    def __post_init__(self) -> None:
        for field in fields(self)[1:]:
            object.__setattr__(self, field.name, sealed(getattr(self, field.name)))

    def examined(self, *premises: Fact) -> Examined:
        """Check the hypotheses, row by row.

        Raises:
            NotProvedError: The premises are not those of the theorem.
        """
        raise NotImplementedError

    def subjects(self, *premises: Fact) -> tuple[str, ...]:
        """The digests of what each premise is to be about: the claim's equations."""
        return (self.equations.digest,) * len(premises)

    def take(self: C, rows: Any) -> C:
        """The claim of some of its rows."""
        chosen = {field.name: getattr(self, field.name)[rows] for field in fields(self)[1:]}
        return type(self)(self.equations, **chosen)

    def well_formed(self) -> Mask:
        """Which rows have numbers in their range, if every array has its form: all that is said of one row alone.

        Raises:
            NotProvedError: An array has not, or holds a number out of its range that other rows speak of too.
        """
        lengths, good_rows = dict(self.equations.sizes), np.ones(self._count(), dtype=np.bool_)
        for name, form in self.forms.items():
            array = getattr(self, name)
            good = isinstance(array, np.ndarray) and array.dtype == _WORDS[form.kind] and array.ndim == len(form.axes)
            require(good, f"{name} is no array of {_WORDS[form.kind]} with {len(form.axes)} axes")
            for letter, length in zip(form.axes, array.shape, strict=True):
                due = int(letter) if letter.isdigit() else lengths.setdefault(letter, length)
                require(length == due, f"{name} has {length} rows along an axis where {due} are due")
            if form.kind != "b":
                inside = (array >= form.least) & (array > form.above) & (array < form.below)  # nor is ∞, or no number
                if form.axes[:1] == self.rows and form.kind == "f":
                    good_rows &= inside.all(axis=tuple(range(1, array.ndim)))
                else:
                    require(inside, f"{name} has an entry out of its range")
        return good_rows

    def _count(self) -> int:
        """How many rows it has: 1 where it is one claim about all of its arrays."""
        first = getattr(self, next(iter(self.forms)))
        return len(first) if self.rows and np.ndim(first) else 1


C = TypeVar("C", bound=ProvableClaim)
_KINDS: set[type[ProvableClaim]] = set()
_EQUATIONS: set[type] = set()


def provable(kind: type[C]) -> type[C]:
    """Let `prove` know a kind of claim. Only `ccpin.proof` and rooms with theorems of their own do so.

    ``tests/proof/test_facts.py`` has them by name.
    """
    _KINDS.add(kind)
    return kind


def known(kind: type[T]) -> type[T]:
    """Let `prove` know a kind of equations, whose numbers were checked when they were made."""
    _EQUATIONS.add(kind)
    return kind


T = TypeVar("T")


def require(holds: Any, otherwise: str) -> None:
    """Nothing, if all of something holds.

    Raises:
        NotProvedError: It does not.
    """
    if not np.all(holds):
        raise NotProvedError(otherwise)


class Fact:
    """A claim that was proved, from premises that were. Made by `prove` and `prove_some` alone.

    Attributes:
        claim: What was claimed.
        premises: The facts that it rests on, as they were given.
        found: Numbers that the check found, read-only.
        digest: Of the equations.
    """

    __slots__ = ("claim", "digest", "found", "premises")
    claim: Any
    premises: tuple[Fact, ...]
    found: Mapping[str, NDArray[Any]]
    digest: str

    def __new__(cls, *_: Any, **__: Any) -> Fact:
        """Refuse.

        Raises:
            TypeError: Always.
        """
        raise TypeError("facts are made by prove() alone")

    def __init_subclass__(cls) -> None:
        """Refuse.

        Raises:
            TypeError: Always.
        """
        raise TypeError("a fact has no other kinds")

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"a fact does not change: '{name}'")

    def __delattr__(self, name: str) -> None:
        raise AttributeError(f"a fact does not change: '{name}'")

    def __copy__(self) -> Fact:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Fact:
        return self

    def __reduce__(self) -> tuple[Callable[..., Unproved], tuple[Any, ...]]:
        return Unproved, (self.claim, self.premises)

    def __repr__(self) -> str:
        return f"Fact({type(self.claim).__name__}, {self.claim.theorem})"

    def replay(self) -> Fact:
        """The same, proved once more from its data and its premises' alone."""
        return _replayed(self, {})


def is_fact(given: object, kind: type[ProvableClaim]) -> TypeGuard[Fact]:
    """Whether something is a fact of a kind of claim: what was pickled is none until it is replayed."""
    return type(given) is Fact and type(given.claim) is kind


class Unproved(NamedTuple):
    """A claim with its premises, from a file or another process: nothing is known of it until it is replayed."""

    claim: Any
    premises: tuple[Any, ...] = ()

    def replay(self) -> Fact:
        """The fact.

        Raises:
            NotProvedError: It is none.
        """
        return _replayed(self, {})


def _replayed(given: Fact | Unproved, done: dict[int, Fact]) -> Fact:
    """Premises that several facts share are replayed once, and stay shared."""
    require(type(given) in (Fact, Unproved), "neither a fact nor a claim with its premises")
    if id(given) not in done:
        done[id(given)] = prove(given.claim, *(_replayed(premise, done) for premise in given.premises))
    return done[id(given)]


def prove(claim: ProvableClaim, *premises: Fact) -> Fact:
    """The fact of a claim.

    Raises:
        NotProvedError: It is malformed, or a hypothesis of its theorem does not hold.
    """
    digest, examined = _examined(claim, premises)
    failed = int(np.argmin(examined.proved)) if len(examined.proved) else 0
    require(examined.proved, f"{claim.theorem} does not hold for row {failed} of {len(examined.proved)}")
    return _minted(claim, premises, examined.found, digest)


def prove_some(claim: ProvableClaim, *premises: Fact) -> tuple[Fact, Mask]:
    """The fact of those rows of a claim that are proved, and which they are: one check for all.

    Raises:
        NotProvedError: It is malformed, or the premises are not the theorem's.
    """
    digest, (proved, found) = _examined(claim, premises)
    require(bool(claim.rows) or proved, "one claim about all of its arrays is proved whole or not at all")
    if not proved.all():
        claim, found = claim.take(proved), {name: array[proved] for name, array in found.items()}
    return _minted(claim, premises, found, digest), proved


def _examined(claim: ProvableClaim, premises: tuple[Fact, ...]) -> tuple[str, Examined]:
    require(type(claim) in _KINDS and type(claim.equations) in _EQUATIONS, "no claim that the kernel knows")
    require([type(premise) is Fact for premise in premises], "a premise is no fact")
    digest = claim.equations.digest
    formed = claim.well_formed()
    require(tuple(p.digest for p in premises) == claim.subjects(*premises), "a premise is about other equations")
    examined = claim.examined(*premises)
    return digest, examined._replace(proved=examined.proved & formed)


def _minted(claim: ProvableClaim, premises: tuple[Fact, ...], found: Mapping[str, NDArray[Any]], digest: str) -> Fact:
    own = type(claim)(*(getattr(claim, field.name) for field in fields(claim)))
    kept = MappingProxyType({name: sealed(array) for name, array in found.items()})
    fact = object.__new__(Fact)
    for name, value in (("claim", own), ("premises", premises), ("found", kept), ("digest", digest)):
        object.__setattr__(fact, name, value)
    return fact
