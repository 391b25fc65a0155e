"""The claim that a fixed number of Newton steps finds σ from all y near it: Theorem K of `program_steps`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ccpin.arrays import Array
from ccpin.proof.facts import Examined, Fact, Form, ProvableClaim, is_fact, provable, require
from ccpin.validated.arithmetic.first_order import linear, preconditioned
from ccpin.validated.programs.branch_claim import CELLS, BranchOverCells, GridCells, cells_of, placed, tabled, tubes
from ccpin.validated.programs.program_equations import ProgramEquations

_OUT = 1.0 + 2.0**-40  # on bounds made of some hundred sums and products of doubles that are not negative


@provable
@dataclass(frozen=True, eq=False)
class StepsFindSigma(ProvableClaim):
    """From |y − σ(q)| ≤ w, q in the box, the program's exact steps end within e w of σ(q), e falling.

    The premise is the branch over cells.

    Attributes:
        start: w.

    Found: `errors` (B, steps + 2), e before the first step and after each, and after the one with the last matrix;
    `factor` (B,), λ/(1 − δ).
    """

    equations: ProgramEquations
    start: Annotated[Array, Form("Y", above=0.0)]
    theorem = "program_steps"

    def examined(self, *premises: Fact) -> Examined:
        """(K1), and (K2) step by step."""
        require(len(premises) == 1 and is_fact(premises[0], BranchOverCells), "steps rest on a branch over cells")
        steps = self.equations.source.steps
        require(steps > 0, "a program without Newton steps")
        branch = premises[0]
        cells = cells_of(branch.claim.lower, branch.claim.upper, branch.claim.counts)
        parts = [slice(k, k + CELLS) for k in range(0, len(cells.centre), CELLS)]
        factor = np.concatenate([self._factor(branch, cells, part) for part in parts])
        errors = [np.ones_like(factor)]
        for _ in range(steps):
            errors.append(0.5 * factor * errors[-1] ** 2 * _OUT)
            require(errors[-1] < errors[-2], "a step that is not proved to come nearer")
        errors.append(factor * (errors[-2] + 0.5 * errors[-1]) * errors[-1] * _OUT)
        require(errors[-1] <= 1.0, "a last step that is not proved to stay near")
        return Examined(np.ones(1, dtype=np.bool_), {"errors": np.stack(errors, axis=1), "factor": factor})

    def _factor(self, branch: Fact, cells: GridCells, part: slice) -> Array:
        """λ/(1 − δ), of shape (B,).

        Raises:
            NotProvedError: δ is not below 1.
        """
        equations, claim, weight = self.equations, branch.claim, self.start
        C, m = claim.preconditioner[part], equations.n_y
        q, y = tubes(claim, cells, part, (branch.found["image"][part] + weight) * _OUT, m)
        at = placed(equations, q, y)
        directions = np.zeros((m, len(q[0].mid), q[0].slopes.shape[-1]))
        directions[np.arange(m), :, -m + np.arange(m)] = weight[:, None]
        ways = [linear(np.zeros(len(q[0].mid)), slopes) for slopes in directions]

        def norm(table: Array) -> Array:
            return np.asarray((np.einsum("bij,j->bi", table, weight) / weight).max(axis=1) * _OUT)

        delta = norm(preconditioned(C, tabled(equations.slopes, at, m), less_identity=True))
        bend = norm(preconditioned(C, tabled(equations.bend, [*at, *ways], m)))
        require(delta < 0.999, "a Jacobian that is not proved invertible near the branch")
        return np.asarray(bend / (1.0 - delta) * (1.0 + 2.0**-30))
