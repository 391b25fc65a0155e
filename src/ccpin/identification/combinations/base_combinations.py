"""What `base_parameters` tells of constants that motions show: combinations and their number, read off facts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np

from ccpin.arrays import Array, FrozenMapping, Indices, frozen
from ccpin.dynamics.parameters import DynamicParameters
from ccpin.identification.combinations.dependent_columns import DependentColumns
from ccpin.identification.combinations.dependent_search import SHARE
from ccpin.identification.combinations.rank_claims import IndependentColumns, VanishingCombinations
from ccpin.proof.facts import Fact, ProvableClaim, is_fact
from ccpin.proof.verdict import not_known_of

C = TypeVar("C", bound=ProvableClaim)
_SHOWN = 1e-12  # of a coefficient in words


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """What of π the motion shows: Y π = Y_base (grouping π), and how many there are of them.

    All numbers are read off facts; one that was pickled says nothing until it is replayed.

    Attributes:
        parameters: π.
        facts: What is proved: the lower bound, the upper one, and the box where there is one.
        fewer: What is shown without each of the sensors and those after it, by the sensor, in the order given.
    """

    parameters: DynamicParameters
    facts: tuple[Fact, ...]
    fewer: Mapping[str, BaseParameters]

    def replay(self) -> BaseParameters:
        """The same, proved once more.

        Raises:
            NotProvedError: It does not hold.
        """
        fewer = FrozenMapping((name, each.replay()) for name, each in self.fewer.items())
        return replace(self, facts=tuple(fact.replay() for fact in self.facts), fewer=fewer)

    def _known(self, kind: type[C]) -> C | None:
        """The claim of a kind that is proved of these constants, where all facts are about one mechanism."""
        known = [fact for fact in self.facts if type(fact) is Fact]
        about = {(fact.digest, fact.claim.equations.sizes["P"]) for fact in known}
        if len(about) != 1 or {size for _, size in about} != {len(self.parameters)}:
            return None
        return next((fact.claim for fact in known if is_fact(fact, kind)), None)

    @property
    def lower(self) -> int:
        """So many combinations are proved independent."""
        shown = self._known(IndependentColumns)
        return 0 if shown is None else len(shown.columns)

    @property
    def upper(self) -> int:
        """So many at most: all others are proved to be without effect, by structure."""
        shown = self._known(VanishingCombinations)
        return len(self.parameters) - (0 if shown is None else len(shown.chosen))

    @property
    def within(self) -> int:
        """So many are enough, to 1e-12 of the forms' size over `box`; as many as `upper` where that is not proved."""
        return len(self.base)

    @property
    def box(self) -> Array | None:
        """|q − q_ref| ≤ h over which that is so, of shape (n,), rad or m; ``None``: nowhere but where it is exact."""
        return None if self._dependent is None else self._dependent.half

    @property
    def states(self) -> int:
        """Closed states that the lower bound rests on."""
        return next((len(fact.premises) for fact in self.facts if is_fact(fact, IndependentColumns)), 0)

    @property
    def added(self) -> Mapping[str, tuple[int, int]]:
        """By each of the sensors: at least and at most so many combinations more (`within`)."""
        steps = [*self.fewer.values(), self]
        return FrozenMapping(
            (name, (max(after.lower - before.within, 0), after.within - before.lower))
            for name, before, after in zip(self.fewer, steps, steps[1:], strict=False)
        )

    @property
    def base(self) -> Indices:
        """The constants that combinations are written on, of shape (within,)."""
        return self._regrouped[0]

    @property
    def grouping(self) -> Array:
        """Of shape (within, p), ones at `base`."""
        return self._regrouped[1]

    @cached_property
    def _exact(self) -> tuple[Indices, Array]:
        """Base and grouping by structure alone."""
        columns, whole = np.arange(len(self.parameters)), np.eye(len(self.parameters))
        fact = next((each for each in self.facts if is_fact(each, VanishingCombinations)), None)
        if fact is None or self._known(VanishingCombinations) is None:
            return columns, whole
        combinations = fact.found["combinations"][0]
        hidden = [int(np.flatnonzero(row)[-1]) for row in combinations]
        columns = np.setdiff1d(columns, hidden)
        grouping = whole[columns]
        grouping[:, hidden] = -combinations[:, columns].T
        return columns, grouping

    @cached_property
    def _dependent(self) -> DependentColumns | None:
        """What is proved to 1e-12, if it is of columns that structure leaves."""
        claim, columns = self._known(DependentColumns), self._exact[0]
        if claim is None or not np.isin(claim.columns, columns).all():
            return None
        used = np.flatnonzero((claim.combinations != 0.0).any(axis=0))
        return claim if np.isin(used, columns).all() and (claim.share <= SHARE).all() else None

    @cached_property
    def _regrouped(self) -> tuple[Indices, Array]:
        columns, grouping = self._exact
        if self._dependent is not None:
            others = self._dependent.columns
            apart = np.setdiff1d(columns, others)
            at, rest = np.searchsorted(columns, apart), np.searchsorted(columns, others)
            grouping = grouping[at] - self._dependent.combinations[:, apart].T @ grouping[rest]
            columns = apart
        columns.flags.writeable = False
        return columns, frozen(grouping)

    @property
    def proved(self) -> bool:
        """Whether the number is proved: from both sides, or, where `upper` is larger, to 1e-12 over `box`."""
        return self.lower == self.within

    @property
    def values(self) -> Array:
        """The combinations of the model's own constants, of shape (within,)."""
        return np.asarray(self.grouping @ self.parameters.values)

    @property
    def words(self) -> tuple[str, ...]:
        """Each combination, as ``Izz:link + 0.078 mass:other``."""
        return tuple(self._told(row, k) for row, k in zip(self.grouping, self.base.tolist(), strict=True))

    @property
    def reason(self) -> str:
        """What is proved, in a sentence."""
        if any(type(fact) is not Fact for fact in self.facts):
            return not_known_of("these constants")
        count, more = len(self.parameters), "".join(f"; {_what_adds(*each)}" for each in self.added.items())
        if self.lower == self.upper:
            return f"{self.lower} of {count} combinations are identifiable: proved from both sides{more}"
        if self.box is not None:
            return (
                f"{self.lower} of {count} combinations are identifiable: no fewer, and of these all others are made to "
                f"{SHARE:.0e} of their size over ±{self.box.max():.3g} (rad, m) about the reference; exactly, at most "
                f"{self.upper} are{more}"
            )
        return (
            f"at least {self.lower} and at most {self.upper} of {count} combinations are identifiable; "
            f"{self.upper - self.lower} seem to depend on others at {self.states} states, which is not proved{more}"
        )

    def __repr__(self) -> str:
        return f"BaseParameters({self.reason})"

    def _told(self, row: Array, base: int) -> str:
        names, told = self.parameters.names, self.parameters.names[base]
        for k in np.flatnonzero(np.abs(row) > _SHOWN).tolist():
            if k != base:
                sign, size = "-" if row[k] < 0.0 else "+", abs(row[k])
                told += f" {sign} {names[k]}" if abs(size - 1.0) < _SHOWN else f" {sign} {size:.6g} {names[k]}"
        return told


def _what_adds(sensor: str, between: tuple[int, int]) -> str:
    least, most = between
    return f"{sensor} adds {least}" if least == most else f"{sensor} adds between {least} and {most}"
