"""The claim that proved boxes meet what is asked besides: limits, motors that determine the motion, dexterity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ccpin.arrays import Array, Indices
from ccpin.proof.equations import Closures, Requirements
from ccpin.proof.facts import Examined, Fact, Form, ProvableClaim, provable, require
from ccpin.proof.requirements import meets
from ccpin.proof.solutions import boxes_of

_LARGEST = np.finfo(np.float64).max


@provable
@dataclass(frozen=True, eq=False)
class Demanded(ProvableClaim):
    """All boxes of the facts that are its premises meet some `Requirements`; the largest number stands for no limit."""

    lower: Annotated[Array, Form("N")]
    upper: Annotated[Array, Form("N")]
    driven: Annotated[Indices, Form("d", "i", 0)]
    units: Annotated[Array, Form("P", above=0.0)]
    dexterity: Annotated[Array, Form("1", least=0.0, below=1.0)]
    theorem = "demands"

    @classmethod
    def of(cls, equations: Closures, demands: Requirements) -> Demanded:
        """The claim of what a search asks for."""
        lower, upper = (np.clip(limit, -_LARGEST, _LARGEST) for limit in (demands.lower, demands.upper))
        dexterity = np.array([demands.dexterity], dtype=np.float64)
        return cls(equations, lower, upper, demands.driven.astype(np.int64), demands.units, dexterity)

    def examined(self, *premises: Fact) -> Examined:
        """Theorem D, and limits."""
        n, size = self.equations.sizes["P"], self.equations.sizes["N"]
        known = len(np.unique(self.driven)) == len(self.driven) in (0, n) and np.all(self.driven < size)
        require(known, "motors that do not drive as many coordinates as there are independent ones")
        demands = Requirements(self.lower, self.upper, self.driven, self.units, float(self.dexterity[0]))
        problem = self.equations.problem._replace(requirements=demands)
        return Examined(np.array([bool(meets(problem, boxes_of(premises)).all())]), {})
