"""Claims about tubes: each holds one singular curve and nothing else of it, and one curve runs on from tube to tube."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ccpin.arrays import Array, Indices, joined
from ccpin.proof.curves.tubes import Stated, Tubes, glued, no_tubes, proved_again
from ccpin.proof.equations import Closures
from ccpin.proof.facts import Examined, Fact, Form, ProvableClaim, provable, require


@provable
@dataclass(frozen=True, eq=False)
class SingularTubes(ProvableClaim):
    """In each of T tubes: over every |s| ≤ δ exactly one |e| ≤ R with G = 0, on one smooth curve; all as in Theorem R.

    Found: `gain` (T, N′, 2m + 1), a P; `kappa` (T,), κ; `hull` (T, N′), how far the curve is from the segment.
    """

    theta: Annotated[Array, Form("TN")]
    kernel: Annotated[Array, Form("TM")]
    pairing: Annotated[Array, Form("TM")]
    along: Annotated[Indices, Form("T", "i", 0)]
    tangent: Annotated[Array, Form("Tx")]
    half: Annotated[Array, Form("T", above=0.0)]
    radius: Annotated[Array, Form("Tx", least=0.0)]
    rows, theorem = "T", "tubes"

    @property
    def stated(self) -> Stated:
        """The tubes' data."""
        return Stated(*(getattr(self, name) for name in Stated._fields))

    def examined(self, *premises: Fact) -> Examined:
        """Y + ZR < R."""
        system, rows = self.equations.system, np.arange(len(self.along))
        require(not premises, "tubes rest on nothing else")
        require(system.n == 2, "singular configurations that are no curves")
        require(self.tangent.shape[1] == system.n_free + system.m, "tubes in another space")
        require(self.along < self.tangent.shape[1], "a parameter that is no coordinate")
        unit = (np.abs(self.tangent[rows, self.along]) == 1.0) & (self.radius[rows, self.along] == 0.0)
        found = proved_again(self.equations.problem, self.stated)
        tubes = found.tubes
        return Examined(found.proved & unit, {"gain": tubes.gain, "kappa": tubes.kappa, "hull": tubes.hull})


def tubes_of(equations: Closures, facts: Sequence[Fact]) -> Tubes:
    """The tubes of several facts, one behind the other.

    Raises:
        NotProvedError: They are facts of another kind.
    """
    require([type(fact.claim) is SingularTubes for fact in facts], "premises that are no tubes")
    return joined([no_tubes(equations.problem), *(Tubes(*fact.claim.stated, **fact.found) for fact in facts)])


@provable
@dataclass(frozen=True, eq=False)
class GluedTubes(ProvableClaim):
    """The curve of tube `first[i]` is that of tube `second[i]`, and runs on in it the same way.

    Premises are the facts about the tubes, numbered through.
    """

    first: Annotated[Indices, Form("K", "i", 0)]
    second: Annotated[Indices, Form("K", "i", 0)]
    rows, theorem = "K", "tubes"

    def examined(self, *premises: Fact) -> Examined:
        """Two zeros of the one in the other."""
        tubes = tubes_of(self.equations, premises)
        require(np.maximum(self.first, self.second) < len(tubes.half), "a number of no tube")
        return Examined(glued(self.equations.problem, tubes.take(self.first), tubes.take(self.second)), {})
