"""The claims of `identifiable`: so many columns of Y are independent, and so many combinations of them vanish."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ccpin.arrays import Indices
from ccpin.identification.combinations.exact_spaces import doubles, reduced
from ccpin.identification.combinations.identification_equations import IdentificationEquations
from ccpin.proof.facts import Examined, Fact, Form, ProvableClaim, is_fact, provable, require
from ccpin.validated.arithmetic.balls import Ball, flint
from ccpin.validated.flow.start_claim import PRECISION, ClosedStart, state_of


@provable
@dataclass(frozen=True, eq=False)
class IndependentColumns(ProvableClaim):
    """No combination of some constants but 0 is without effect: a minor of their forms is not 0. Lower bound.

    The premises are closed states; their forms are stacked in this order.

    Attributes:
        chosen: Which forms, of shape (r,).
        columns: Which constants, of shape (r,).
        precision: In bits.
    """

    equations: IdentificationEquations
    chosen: Annotated[Indices, Form("r", "i", least=0)]
    columns: Annotated[Indices, Form("r", "i", least=0)]
    precision: Annotated[Indices, PRECISION]
    theorem = "identifiable"

    def subjects(self, *premises: Fact) -> tuple[str, ...]:
        """The closures."""
        return (self.equations.loop.digest,) * len(premises)

    def examined(self, *premises: Fact) -> Examined:
        """A determinant that does not hold 0."""
        require([is_fact(premise, ClosedStart) for premise in premises], "a premise is no closed state")
        require(self.columns < self.equations.sizes["P"], "a constant that is none")
        with flint().ctx.workprec(int(self.precision[0])):
            forms = stacked_forms(self.equations, premises)
            require(self.chosen < len(forms), "a form that is none")
            minor = [[forms[row][column] for column in self.columns.tolist()] for row in self.chosen.tolist()]
            require(abs(flint().arb_mat(minor).det()) > 0, "the minor is not proved nonzero")
        return Examined(np.ones(1, dtype=np.bool_), {})


@provable
@dataclass(frozen=True, eq=False)
class VanishingCombinations(ProvableClaim):
    """So many independent z have Y z = 0 at every closed configuration, by structure. Upper bound.

    Attributes:
        chosen: Which of those that structure shows, in the order of `vanishing.identities`, of shape (s,).

    Found: `combinations` (1, s, p), in reduced echelon form from the last constant on, rounded to doubles.
    """

    equations: IdentificationEquations
    chosen: Annotated[Indices, Form("s", "i", least=0)]
    theorem = "identifiable"

    def examined(self, *premises: Fact) -> Examined:
        """Their rank, in exact numbers."""
        require(not premises, "structure rests on nothing else")
        width = self.equations.sizes["P"]
        shown = self.equations.identities
        require(self.chosen < len(shown), "a combination that structure does not show")
        form = reduced(shown[self.chosen][:, ::-1], width)
        require(len(form.rows) == len(self.chosen), "combinations that depend on each other")
        return Examined(np.ones(1, dtype=np.bool_), {"combinations": doubles(form.rows[:, ::-1])[None]})


def stacked_forms(equations: IdentificationEquations, states: tuple[Fact, ...]) -> list[list[Ball]]:
    """The forms at closed states, one after the other, at the current precision."""
    return [form for state in states for form in equations.forms(state_of(state).balls())]
