"""The claim that a branch of σ is known over a box of q, cell by cell: Theorem Q of `program_branch`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices
from ccpin.proof.facts import Examined, Fact, Form, ProvableClaim, provable, require
from ccpin.validated.arithmetic.first_order import FirstOrder, linear, preconditioned
from ccpin.validated.programs.error_sweeps import evaluated
from ccpin.validated.programs.program_equations import ProgramEquations, Runnable

_UNIT = 2.0**-53
_OUT = 1.0 + 2.0**-40  # on bounds made of some hundred sums and products of doubles that are not negative
CELLS = 256  # at a time: bounds memory


class GridCells(NamedTuple):
    """Cells of a box of q.

    Attributes:
        centre, half: The cells, as |q − centre| ≤ half, of shape (B, n): a little wider than they are.
        edges: Of each axis.
    """

    centre: Array
    half: Array
    edges: tuple[Array, ...]


def cells_of(lower: Array, upper: Array, counts: Indices) -> GridCells:
    """A box cut into so many cells along each axis, the last axis fastest."""
    edges = []
    for least, most, count in zip(lower.tolist(), upper.tolist(), counts.tolist(), strict=True):
        inner = [least + (most - least) * (k / count) for k in range(1, count)]
        edges.append(np.array([least, *inner, most]))
    require([np.all(np.diff(each) > 0.0) for each in edges], "cells of no width")
    centres = [0.5 * each[:-1] + 0.5 * each[1:] for each in edges]
    halves = [
        np.maximum(each[1:] - c, c - each[:-1]) * _OUT + 4 * _UNIT * (np.abs(each[1:]) + np.abs(each[:-1]))
        for each, c in zip(edges, centres, strict=True)
    ]
    centre, half = (np.stack([x.ravel() for x in np.meshgrid(*part, indexing="ij")], 1) for part in (centres, halves))
    return GridCells(centre, half, tuple(edges))


def placed(equations: ProgramEquations, q: Sequence[FirstOrder], y: Sequence[FirstOrder]) -> list[FirstOrder]:
    """Inputs of φ: x and p, and 0 for what it does not read."""
    source = equations.source
    nothing = linear(np.zeros_like(q[0].mid), np.zeros_like(q[0].slopes))
    found = [nothing] * sum(source.sizes)
    for places, entries in ((equations.places, q), (source.dependent, y)):
        for place, entry in zip(places, entries, strict=True):
            found[place] = entry
    return found


def tabled(program: Runnable, inputs: Sequence[FirstOrder], rows: int) -> list[list[FirstOrder]]:
    """The outputs of a program, row by row."""
    entries = evaluated(program, inputs)

    def wide(part: Array) -> Array:
        return np.broadcast_to(part, (len(inputs[0].mid), *part.shape[1:]))

    whole = [FirstOrder(wide(e.mid), wide(e.slopes), wide(e.rad)) for e in entries]
    columns = len(whole) // rows
    return [whole[k * columns : (k + 1) * columns] for k in range(rows)]


@provable
@dataclass(frozen=True, eq=False)
class BranchOverCells(ProvableClaim):
    """Over each cell there is exactly one y with φ = 0 in |y − y_c − S(q − q_c)| ≤ R, and all together are one σ.

    σ is continuous over the box, and φ_y is nonsingular in all of the tubes.

    Attributes:
        lower, upper: The box.
        counts: Cells along each axis; the cells are numbered with the last axis fastest.
        centre, slopes, radius: y_c, S and R of each cell.
        preconditioner: C of each cell.

    Found: `image` (B, Y), |σ(q) − y_c − S(q − q_c)| at most.
    """

    equations: ProgramEquations
    lower: Annotated[Array, Form("Q")]
    upper: Annotated[Array, Form("Q")]
    counts: Annotated[Indices, Form("Q", "i", least=1)]
    centre: Annotated[Array, Form("BY")]
    slopes: Annotated[Array, Form("BYQ")]
    radius: Annotated[Array, Form("BY", above=0.0)]
    preconditioner: Annotated[Array, Form("BYY")]
    theorem = "program_branch"

    def examined(self, *premises: Fact) -> Examined:
        """(Q1) in every cell, (Q2) at every face between two."""
        require(not premises, "a branch rests on nothing else")
        cells = cells_of(self.lower, self.upper, self.counts)
        require(len(cells.centre) == len(self.centre), "a row for each cell")
        parts = [slice(k, k + CELLS) for k in range(0, len(self.centre), CELLS)]
        image = np.concatenate([self._image(cells, part) for part in parts])
        require(self._joined(cells, image), "cells that are not proved to carry the same branch")
        return Examined(np.ones(1, dtype=np.bool_), {"image": image})

    def _image(self, cells: GridCells, part: slice) -> Array:
        """|CG(q, 0)| + |I − Cφ_y| R.

        Raises:
            NotProvedError: It is not below R.
        """
        equations, C, radius = self.equations, self.preconditioner[part], self.radius[part]
        m = equations.n_y
        middle = tubes(self, cells, part, np.zeros_like(radius))
        residual = tabled(equations.closure, placed(equations, *middle), m)
        around = tubes(self, cells, part, radius)
        slopes = tabled(equations.slopes, placed(equations, *around), m)
        off = preconditioned(C, residual)[:, :, 0]
        turned = preconditioned(C, slopes, less_identity=True)
        image = (off + np.einsum("bij,bj->bi", turned, radius)) * _OUT
        require(image < radius, "a cell without a solution that is proved")
        return np.asarray((off + np.einsum("bij,bj->bi", turned, image)) * _OUT)

    def _joined(self, cells: GridCells, image: Array) -> bool:
        """Whether σ of each cell is that of the next, on the face between them."""
        shape, n = self.counts.tolist(), len(self.lower)
        numbers = np.arange(len(image)).reshape(shape)
        for axis in range(n):
            first = np.take(numbers, np.arange(shape[axis] - 1), axis).ravel()
            second = np.take(numbers, np.arange(1, shape[axis]), axis).ravel()
            # on the face q = f + d, |d| ≤ half but along the axis, where it is 0
            face = cells.centre[first].copy()
            edge = cells.edges[axis][1:-1].reshape([-1 if k == axis else 1 for k in range(n)])
            face[:, axis] = np.broadcast_to(edge, [s - (k == axis) for k, s in enumerate(shape)]).ravel()
            half = cells.half[first].copy()
            half[:, axis] = 0.0
            there, size = [], []
            for cell in (first, second):
                by = self.slopes[cell] * (face - cells.centre[cell])[:, None, :]
                there.append(self.centre[cell] + by.sum(axis=2))
                size.append(np.abs(self.centre[cell]) + self._reach(cell, face, cells))
            apart = np.abs(there[0] - there[1]) + 8 * (n + 4) * _UNIT * (size[0] + size[1])
            turned = (np.abs(self.slopes[first] - self.slopes[second]) * half[:, None, :]).sum(axis=2)
            if not np.all((apart + turned + image[first]) * _OUT < self.radius[second]):
                return False
        return True

    def _reach(self, cell: Indices, face: Array, cells: GridCells) -> Array:
        """Σ|S|(|f| + |q_c| + h): above all sizes in the difference."""
        across = np.abs(face) + np.abs(cells.centre[cell]) + cells.half[cell]
        return np.asarray((np.abs(self.slopes[cell]) * across[:, None, :]).sum(axis=2))


def tubes(
    claim: BranchOverCells, cells: GridCells, part: slice, radius: Array, axes: int = 0
) -> tuple[list[FirstOrder], list[FirstOrder]]:
    """Q and y over cells: q = q_c + hξ, |y − y_c − S(q − q_c)| ≤ radius, as functions of (ξ_q, ξ_y, …)."""
    n, m = len(claim.lower), radius.shape[1]
    half, rows = cells.half[part], len(radius)
    q_slopes = np.zeros((rows, n, n + m + axes))
    q_slopes[:, np.arange(n), np.arange(n)] = half
    y_slopes = np.zeros((rows, m, n + m + axes))
    y_slopes[:, :, :n] = claim.slopes[part] * half[:, None, :]
    y_slopes[:, np.arange(m), n + np.arange(m)] = radius
    rounding = _UNIT * (np.abs(claim.slopes[part]) * half[:, None, :]).sum(axis=2) * 2
    q = [linear(cells.centre[part][:, k], q_slopes[:, k]) for k in range(n)]
    y = [linear(claim.centre[part][:, k], y_slopes[:, k]).widened(rounding[:, k]) for k in range(m)]
    return q, y
