"""The claim that motors hold a box of joint efforts all over a region: Theorem B of `effort_box`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ccpin.arrays import Array, Indices, inverses
from ccpin.programs.program_sources import slopes_of
from ccpin.proof.facts import Examined, Fact, Form, ProvableClaim, is_fact, provable, require
from ccpin.validated.arithmetic.first_order import FirstOrder, linear, preconditioned
from ccpin.validated.programs.branch_claim import CELLS, BranchOverCells, GridCells, cells_of, placed, tabled, tubes
from ccpin.validated.programs.program_equations import ProgramEquations, Runnable, runnable

_OUT = 1.0 + 2.0**-40  # on bounds made of some hundred sums and products of doubles that are not negative
_LEAST = 1e-290  # above what underflows add


@provable
@dataclass(frozen=True, eq=False)
class EffortBoxHeld(ProvableClaim):
    """Over a branch every |τ| ≤ b on q is balanced by exactly one u on the motors' numbers of x, |u| ≤ r.

    The premise is the branch over cells.

    Attributes:
        motors: Places of the motors' numbers in x.
        box: b.
        room: r.
        preconditioner: P of each cell, its columns in the order of (q, y), its rows in that of (u, λ).

    Found: `used` (B, Q), Σ_j W_ij, above every |u_i|.
    """

    equations: ProgramEquations
    motors: Annotated[Indices, Form("Q", "i", least=0)]
    box: Annotated[Array, Form("Q", above=0.0)]
    room: Annotated[Array, Form("Q", above=0.0)]
    preconditioner: Annotated[Array, Form("BNN")]
    theorem = "effort_box"

    def examined(self, *premises: Fact) -> Examined:
        """(1) and (2), cell by cell."""
        require(len(premises) == 1 and is_fact(premises[0], BranchOverCells), "a box of efforts rests on a branch")
        branch, source = premises[0], self.equations.source
        cells = cells_of(branch.claim.lower, branch.claim.upper, branch.claim.counts)
        places = (*source.independent, *source.dependent)
        require(self.preconditioner.shape[:2] == (len(cells.centre), len(places)), "a matrix of x for each cell")
        by_q = runnable(slopes_of(source.closure, source.independent))
        parts = [slice(k, k + CELLS) for k in range(0, len(cells.centre), CELLS)]
        used = np.concatenate([self._used(branch, cells, part, by_q) for part in parts])
        require(used <= self.room, "a cell where motors are not proved to hold the box")
        return Examined(np.ones(1, dtype=np.bool_), {"used": used})

    def _used(self, branch: Fact, cells: GridCells, part: slice, by_q: Runnable) -> Array:
        """Σ_j W_ij of the motors, of shape (B, Q).

        Raises:
            NotProvedError: W does not satisfy (1).
        """
        P, n = self.preconditioner[part], len(self.box)
        q, y = tubes(branch.claim, cells, part, branch.found["image"][part])
        off = preconditioned(P, balance(self.equations, self.motors.tolist(), by_q, q, y), less_identity=True)
        given = np.abs(P[:, :, :n]) * self.box * _OUT + _LEAST
        with np.errstate(all="ignore"):
            bound = _above(given, off)
        require(bound > 0.0, "a bound that is none")
        require((given + off @ bound) * _OUT < bound, "a cell whose matrix is not proved regular")
        return np.asarray(bound[:, :n].sum(axis=2) * _OUT)


def balance(
    equations: ProgramEquations, motors: list[int], by_q: Runnable, q: list[FirstOrder], y: list[FirstOrder]
) -> list[list[FirstOrder]]:
    """M = [Aᵀ φ_xᵀ] over tubes, its rows in the order of (q, y)."""
    source, at = equations.source, placed(equations, q, y)
    table = [tabled(program, at, equations.n_y) for program in (by_q, equations.slopes)]
    columns = [
        [row[k] for row in part] for part, size in zip(table, (len(q), len(y)), strict=True) for k in range(size)
    ]
    nothing = np.zeros_like(q[0].mid), np.zeros_like(q[0].slopes)
    zero, one = linear(*nothing), linear(nothing[0] + 1.0, nothing[1])
    places = (*source.independent, *source.dependent)
    return [[*(one if place == m else zero for m in motors), *row] for place, row in zip(places, columns, strict=True)]


def _above(given: Array, off: Array) -> Array:
    """A W somewhat above (1 − G)⁻¹ of what is given, if that is positive: whether it is enough is asked afterwards."""
    size = given.max(axis=(1, 2), keepdims=True)
    return np.asarray(inverses(np.eye(off.shape[-1]) - off) @ (given * (1.0 + 1e-6) + 1e-9 * size))
