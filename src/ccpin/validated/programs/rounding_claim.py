"""The claim of what a program does over a region: pivots, ranges, errors of rounding. Theorem E of `program_rounding`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ccpin.arrays import Array, Indices
from ccpin.proof.facts import Examined, Fact, Form, ProvableClaim, is_fact, provable, require
from ccpin.validated.arithmetic.first_order import FirstOrder, linear
from ccpin.validated.programs.branch_claim import BranchOverCells, Cells, cells_of, tubes
from ccpin.validated.programs.error_sweeps import FORMATS, arriving, swept
from ccpin.validated.programs.program_equations import ProgramEquations
from ccpin.validated.programs.steps_claim import StepsFindSigma

_OUT = 1.0 + 2.0**-40  # on bounds made of some sums and products of doubles
_MEMORY = 3e7  # numbers that are kept at a time


@provable
@dataclass(frozen=True, eq=False)
class ProgramComputed(ProvableClaim):
    """What a program computes, over q in the box of a branch, |y − σ(q)| ≤ w and bounds of its other inputs.

    Premises: the branch over cells; for a program with Newton steps what they find. Inputs are numbers of the format;
    outputs are compared with those of the exact program at σ(q), or where there are no steps at the y given.

    Attributes:
        start: w; with steps: that of theirs, or less.
        bounds: Of the other inputs' absolute values.
        format: 0: double, 1: float.

    Found: `error` (outputs,), what computed outputs are off by at most; `range` (2, outputs), where they are; `size`
    (values,), bounds of all absolute values that are computed, 0 for numbers of none; `pivots` (P,), lower bounds of
    theirs; `correction` (1,), bound of the length of the last correction of y as computed, 0 without steps.
    """

    equations: ProgramEquations
    start: Annotated[Array, Form("Y", least=0.0)]
    bounds: Annotated[Array, Form("W", least=0.0)]
    format: Annotated[Indices, Form("1", "i", least=0, below=2)]
    theorem = "program_rounding"

    def examined(self, *premises: Fact) -> Examined:
        """(E1) to (E4) in every cell."""
        stepping = self.equations.source.steps > 0
        require(len(premises) == 1 + stepping, "a program's values rest on a branch, and on its steps")
        branch = premises[0]
        require(is_fact(branch, BranchOverCells), "a program's values rest on a branch over cells")
        if stepping:
            steps = premises[1]
            require(is_fact(steps, StepsFindSigma) and steps.premises[0].claim is branch.claim, "steps of another branch")
            require(self.start <= steps.claim.start, "y from farther than the steps' ")
        cells = cells_of(branch.claim.lower, branch.claim.upper, branch.claim.counts)
        axes = sum(self.equations.sizes[key] for key in "QYW")
        count = max(1, int(_MEMORY / ((axes + 2) * self.equations.program.code.size)))
        parts = [slice(k, k + count) for k in range(0, len(cells.centre), count)]
        found = [self._over(premises, cells, part) for part in parts]
        least = {name: np.min([each[name] for each in found], axis=0) for name in ("pivots", "lower")}
        most = {name: np.max([each[name] for each in found], axis=0) for name in ("error", "upper", "size", "correction")}
        told = {"pivots": least["pivots"], "range": np.stack([least["lower"], most["upper"]])}
        told |= {name: most[name] for name in ("error", "size", "correction")}
        require([np.isfinite(numbers).all() for numbers in told.values()], "values that are not bounded")
        return Examined(np.ones(1, dtype=np.bool_), told)

    def _over(self, premises: tuple[Fact, ...], cells: Cells, part: slice) -> Mapping[str, Array]:
        """What is found over some cells.

        Raises:
            NotProvedError: A pivot may vanish, a value may be too large, an angle out of reach.
        """
        equations, numbers = self.equations, FORMATS[int(self.format[0])]
        program, made = equations.program, equations.made
        jumps = dict[int, Array]()
        if made.iterates:
            errors = premises[1].found["errors"][part]
            start = premises[1].claim.start
            jumps = {k: errors[:, -1] * (w * _OUT) for k, w in zip(made.iterates[-1], start.tolist(), strict=True)}
        found = swept(program, self._inputs(premises[0], cells, part), numbers, jumps)
        require(found.reached, "a sine of an angle out of reach")
        size = np.zeros(program.code.size)
        for number, value in enumerate(found.values):
            if value is not None:
                size[number] = np.max(value.size)
        require(size < numbers.largest, "a value that is not bounded, or too large for the format")
        pivots = [np.min(found.values[pivot.number].least) for pivot in made.pivots]
        require([pivot > 0.0 for pivot in pivots], "a pivot that may vanish")
        outputs = program.code.outputs
        count = len(made.code.outputs)
        error = arriving(program, found, outputs).max(axis=1)
        ends = [found.values[number] for number in outputs[:count]]
        reach = [v.spread + v.size * (_OUT - 1.0) for v in ends]
        lower = np.array([np.min(v.mid - far) for v, far in zip(ends, reach, strict=True)])
        upper = np.array([np.max(v.mid + far) for v, far in zip(ends, reach, strict=True)])
        correction = np.zeros(1)
        if made.corrections:
            exact = (errors[:, -2:].sum(axis=1)[:, None] * start).max(axis=0)
            correction[0] = np.sqrt(((exact + error[count:]) ** 2).sum()) * _OUT
        return {
            "error": error[:count] * _OUT, "lower": lower, "upper": upper, "size": size,
            "pivots": np.array(pivots), "correction": correction,
        }  # fmt: skip

    def _inputs(self, branch: Fact, cells: Cells, part: slice) -> list[FirstOrder]:
        """Q, y and what else is read, as functions of ξ."""
        radius = (branch.found["image"][part] + self.start) * _OUT
        count = len(self.bounds)
        q, y = tubes(branch.claim, cells, part, radius, count)
        slopes = np.zeros((count, *q[0].slopes.shape))
        slopes[np.arange(count), :, slopes.shape[2] - count + np.arange(count)] = self.bounds[:, None]
        return [*q, *y, *(linear(np.zeros_like(q[0].mid), each) for each in slopes)]
