"""The claim of a program's pivots, ranges and errors of rounding over a region: Theorem E of `program_rounding`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ccpin.arrays import Array, Indices
from ccpin.proof.facts import Examined, Fact, Form, ProvableClaim, is_fact, provable, require
from ccpin.validated.arithmetic.first_order import FirstOrder, Products, linear, products_of
from ccpin.validated.programs.branch_claim import BranchOverCells, GridCells, cells_of, tubes
from ccpin.validated.programs.error_sweeps import FORMATS, ErrorSweep
from ccpin.validated.programs.program_equations import ProgramEquations
from ccpin.validated.programs.steps_claim import StepsFindSigma

_OUT = 1.0 + 2.0**-40  # on bounds made of some sums and products of doubles
_AXES = 480  # fewer than bounds of rounding are made for
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
    theirs; `correction` (1,), bound of the length of the last correction of y as computed, 0 where there is none.
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
            require(is_fact(steps, StepsFindSigma) and steps.premises[0] is branch, "steps of another branch")
            require(self.start <= steps.claim.start, "y from farther than the steps start")
        cells = cells_of(branch.claim.lower, branch.claim.upper, branch.claim.counts)
        axes = len(self._products.groups)
        count = max(1, int(_MEMORY / ((axes + 2) * self.equations.program.code.size)))
        parts = [slice(k, k + count) for k in range(0, len(cells.centre), count)]
        found = [self._over(premises, cells, part) for part in parts]
        told = {"pivots": np.min([each["pivots"] for each in found], axis=0)}
        told |= {name: np.max([each[name] for each in found], axis=0) for name in ("error", "size", "correction")}
        lower, upper = (np.array([each[name] for each in found]) for name in ("lower", "upper"))
        told["range"] = np.stack([lower.min(axis=0), upper.max(axis=0)])
        require([np.isfinite(numbers).all() for numbers in told.values()], "values that are not bounded")
        return Examined(np.ones(1, dtype=np.bool_), told)

    def _over(self, premises: tuple[Fact, ...], cells: GridCells, part: slice) -> Mapping[str, Array]:
        """What is found over some cells.

        Raises:
            NotProvedError: A pivot may vanish, a value may be too large, an angle out of reach.
        """
        equations, made = self.equations, self.equations.made
        sweep = ErrorSweep(equations.program, self._inputs(premises[0], cells, part), FORMATS[int(self.format[0])])
        off, correction = dict[int, Array](), np.zeros(1)
        if made.iterates:
            off, correction = self._stepped(sweep, premises, cells, part)
        sweep.run([item.target for item in equations.program.code.instructions])
        require(sweep.reached, "a sine of an angle out of reach")
        size = np.zeros(equations.program.code.size)
        for number, value in sweep.values.items():
            size[number] = np.max(value.size)
        require(size < FORMATS[int(self.format[0])].largest, "a value that is not bounded, or too large for the format")
        pivots = [np.min(sweep.values[pivot.number].least) for pivot in made.pivots]
        require([pivot > 0.0 for pivot in pivots], "a pivot that may vanish")
        if not made.iterates:  # of a step of the motion: corrections are values like others
            correction = _length(np.array([size[number] for number in made.corrections]))
        outputs = made.code.outputs
        error = sweep.arriving(outputs, off).max(axis=1) * _OUT
        ends = [sweep.values[number] for number in outputs]
        reach = [v.spread + v.size * (_OUT - 1.0) for v in ends]
        lower = np.array([np.min(v.mid - far) for v, far in zip(ends, reach, strict=True)])
        upper = np.array([np.max(v.mid + far) for v, far in zip(ends, reach, strict=True)])
        return {
            "error": error, "lower": lower, "upper": upper, "size": size,
            "pivots": np.array(pivots), "correction": correction,
        }  # fmt: skip

    def _stepped(
        self, sweep: ErrorSweep, premises: tuple[Fact, ...], cells: GridCells, part: slice
    ) -> tuple[dict[int, Array], Array]:
        """How far computed iterates are from σ at most, by the numbers of their values, and the last correction.

        Raises:
            NotProvedError: They leave the region in which the steps are known.
        """
        branch, steps = premises
        made, weight, factor = self.equations.made, steps.claim.start, steps.found["factor"][part]
        far = [np.broadcast_to((self.start / weight).max() * _OUT, factor.shape)]
        off, radius = dict[int, Array](), np.zeros((len(factor), len(weight)))
        for place, numbers in enumerate(made.iterates):
            last, before = place + 1 == len(made.iterates), radius
            sweep.run(numbers)
            rounding = sweep.arriving(numbers, dict.fromkeys(off, np.zeros(len(factor)))).T
            exact = factor * (far[-2] + 0.5 * far[-1] if last else 0.5 * far[-1]) * far[-1]
            radius = (exact[:, None] * weight + rounding) * _OUT
            far.append((radius / weight).max(axis=1) * _OUT)
            require(far[-1] <= 1.0, "computed steps that are not proved to stay near")
            around = tubes(branch.claim, cells, part, (branch.found["image"][part] + radius) * _OUT, len(self.bounds))
            off |= dict(zip(numbers, radius.T, strict=True))
            sweep.values.update(zip(numbers, self._with_products(around[1]), strict=True))
        ends = np.stack([sweep.lost[number] for number in made.iterates[-1]], axis=1)
        return off, _length((before + radius + ends).max(axis=0))

    def _inputs(self, branch: Fact, cells: GridCells, part: slice) -> list[FirstOrder]:
        """Q, y and what else is read, as functions of ξ."""
        radius = (branch.found["image"][part] + self.start) * _OUT
        count = len(self.bounds)
        q, y = tubes(branch.claim, cells, part, radius, count)
        slopes = np.zeros((count, *q[0].slopes.shape))
        slopes[np.arange(count), :, slopes.shape[2] - count + np.arange(count)] = self.bounds[:, None]
        rest = [linear(np.zeros_like(q[0].mid), each) for each in slopes]
        return self._with_products(self.equations.arranged(q, y, rest))

    @property
    def _products(self) -> Products:
        """Products of ξ that are axes: of q's with all, and of what else is read with itself; not if too many."""
        sizes = [self.equations.sizes[key] for key in "QYW"]
        some = (products_of(sizes, joined) for joined in (((0, 0), (0, 1), (0, 2), (2, 2)), ((2, 2),)))
        return next((each for each in some if len(each.groups) <= _AXES), products_of(sizes, ()))

    def _with_products(self, forms: Sequence[FirstOrder]) -> list[FirstOrder]:
        return [each.beside(self._products) for each in forms]


def _length(moved: Array) -> Array:
    """A bound of the length of what is no longer by entry, of shape (1,)."""
    return np.array([np.sqrt((moved**2).sum()) * _OUT])
