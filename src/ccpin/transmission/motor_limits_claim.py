"""The claims that motors hold efforts, or have speeds, all over a region: Theorem B of `motor_limits`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ccpin.arrays import Array, Indices, Mask, inverses
from ccpin.programs.program_sources import slopes_of
from ccpin.proof.facts import Examined, Fact, Form, ProvableClaim, is_fact, provable, require
from ccpin.validated.arithmetic.first_order import FirstOrder, linear, preconditioned
from ccpin.validated.programs.branch_claim import CELLS, BranchOverCells, GridCells, cells_of, placed, tabled, tubes
from ccpin.validated.programs.program_equations import ProgramEquations, Runnable, runnable

_ROUNDED = 2.0**-40  # of the size of some hundred sums and products of doubles
_OUT = 1.0 + _ROUNDED  # on those that are not negative
_LEAST = 1e-290  # above what underflows add


@dataclass(frozen=True, eq=False)
class MotorLimits(ProvableClaim):
    """What both claims say. The premise is the branch over cells.

    Attributes:
        motors: Places of the motors' numbers in x.
        size: L.
        rounded: Whether L is of an ellipsoid, p = 2, rather than of a box, p = ∞.
        friction: c of each number, in the order of (q, y).
        room: r.
        preconditioner: P of each cell.

    Found: `asked` (B, Q), |(w₁, …, wₙ)|* of each motor, and `lost` (B, Q), what friction takes besides.
    """

    equations: ProgramEquations
    motors: Annotated[Indices, Form("Q", "i", least=0)]
    size: Annotated[Array, Form("QQ")]
    rounded: Annotated[Mask, Form("1", "b")]
    friction: Annotated[Array, Form("N", least=0.0)]
    room: Annotated[Array, Form("Q", above=0.0)]
    preconditioner: Annotated[Array, Form("BNN")]
    theorem = "motor_limits"

    def matrix(self, by_q: Runnable, q: list[FirstOrder], y: list[FirstOrder]) -> list[list[FirstOrder]]:
        """M over tubes."""
        raise NotImplementedError

    def motor_rows(self) -> list[int]:
        """Which rows of M⁻¹ are the motors'."""
        raise NotImplementedError

    @property
    def _places(self) -> tuple[int, ...]:
        """Where (q, y) stand in x."""
        return (*self.equations.source.independent, *self.equations.source.dependent)

    def examined(self, *premises: Fact) -> Examined:
        """(1) and (2), cell by cell."""
        require(len(premises) == 1 and is_fact(premises[0], BranchOverCells), "motors' limits rest on a branch")
        branch, source = premises[0], self.equations.source
        cells = cells_of(branch.claim.lower, branch.claim.upper, branch.claim.counts)
        require(self.preconditioner.shape[:2] == (len(cells.centre), len(self._places)), "a matrix of x for each cell")
        require([motor in self._places for motor in self.motors.tolist()], "a motor's number that is none")
        by_q = runnable(slopes_of(source.closure, source.independent))
        parts = [slice(k, k + CELLS) for k in range(0, len(cells.centre), CELLS)]
        found = [self._used(branch, cells, part, by_q) for part in parts]
        asked, lost = (np.concatenate([each[k] for each in found]) for k in (0, 1))
        require((asked + lost) * _OUT <= self.room, "a cell where motors are not proved to hold it")
        return Examined(np.ones(1, dtype=np.bool_), {"asked": asked, "lost": lost})

    def _used(self, branch: Fact, cells: GridCells, part: slice, by_q: Runnable) -> tuple[Array, Array]:
        """The two sums of (2) for the motors, of shape (B, Q) each.

        Raises:
            NotProvedError: W does not satisfy (1).
        """
        P, n = self.preconditioner[part], len(self.size)
        q, y = tubes(branch.claim, cells, part, branch.found["image"][part])
        off = preconditioned(P, self.matrix(by_q, q, y), less_identity=True)
        taken = np.flatnonzero(self.friction)
        with np.errstate(all="ignore"):
            first = np.abs(P[:, :, :n] @ self.size) + _ROUNDED * (np.abs(P[:, :, :n]) @ np.abs(self.size))
            given = np.concatenate([first, np.abs(P[:, :, taken]) * self.friction[taken]], axis=2) * _OUT + _LEAST
            bound = _above(given, off)
        require(bound > 0.0, "a bound that is none")
        require((given + off @ bound) * _OUT < bound, "a cell whose matrix is not proved regular")
        own, others = np.split(bound[:, self.motor_rows()], [n], axis=2)
        asked = (np.hypot.reduce if self.rounded[0] else np.add.reduce)(own, axis=2)
        return asked * _OUT, others.sum(axis=2) * _OUT


@provable
@dataclass(frozen=True, eq=False)
class EffortsHeld(MotorLimits):
    """Over a branch exactly one u balances each τ of 𝓛 and |f| ≤ c, and |u| ≤ r; motors measure the motion."""

    def matrix(self, by_q: Runnable, q: list[FirstOrder], y: list[FirstOrder]) -> list[list[FirstOrder]]:
        """[Aᵀ φ_xᵀ]."""
        return balance(self.equations, self.motors.tolist(), by_q, q, y)

    def motor_rows(self) -> list[int]:
        """u comes first."""
        return list(range(len(self.motors)))


@provable
@dataclass(frozen=True, eq=False)
class SpeedsHeld(MotorLimits):
    """Over a branch rates of q in 𝓛 are rates of the motors' numbers of r at most."""

    def matrix(self, by_q: Runnable, q: list[FirstOrder], y: list[FirstOrder]) -> list[list[FirstOrder]]:
        """[B; φ_x]."""
        require(self.friction == 0.0, "friction of speeds")
        whole = balance(self.equations, list(self.equations.source.independent), by_q, q, y)
        return [list(row) for row in zip(*whole, strict=True)]

    def motor_rows(self) -> list[int]:
        """Rates of x are in the order of (q, y)."""
        return [self._places.index(motor) for motor in self.motors.tolist()]


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
    size = given.max(axis=1, keepdims=True)
    return np.asarray(inverses(np.eye(off.shape[-1]) - off) @ (given * (1.0 + 1e-6) + 1e-9 * size))
