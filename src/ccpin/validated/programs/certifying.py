"""`certify_program`: what a program's arithmetic is sure to do over a region, with the search for it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, choice, corners, instance, numbers, records, vector, whole
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.programs.program import Program
from ccpin.proof.facts import Fact, NotProvedError, prove
from ccpin.validated.programs.error_sweeps import FORMATS
from ccpin.validated.programs.program_certificate import ProgramCertificate, bounds_of
from ccpin.validated.programs.program_equations import ProgramEquations
from ccpin.validated.programs.proposals import proposed_branch
from ccpin.validated.programs.rounding_claim import ProgramComputed
from ccpin.validated.programs.steps_claim import StepsFindSigma

_CLOSED, _NEAR, _HALVINGS = 1e-6, 0.02, 6  # how far y may be from σ(q), of programs without and with steps
_BETTER = 0.8  # of the bound before: else a finer cut is not worth it


def certify_program(
    program: Program,
    region: tuple[ArrayLike, ArrayLike],
    *,
    bounds: Mapping[str, ArrayLike],
    parameters: tuple[ArrayLike, ArrayLike] | None = None,
    start: ArrayLike | None = None,
    formats: Sequence[str] = ("double", "float"),
    max_cells: int = 4096,
) -> ProgramCertificate:
    """What a program is sure to do over a region: pivots, σ's steps, ranges, errors of rounding (Theorems Q, K and E).

    The region is a box of q, and of constants p where these are inputs, about a branch of σ, with bounds of what else
    the program reads. Over it the certificate says: σ is one function; the program's Newton steps, if it has some, find
    it from every y within `start`; no pivot vanishes and nothing overflows; and how far what a machine computes is from
    the exact values at σ(q) at most (at the y given, of a program without such steps, as `"step"` is), where the
    program's sine and cosine are those of `ccpin.programs` (or as good) and nothing is fused or reordered.

    Args:
        program: A program that was recorded (one that was loaded has not what it was made of).
        region: Lower and upper numbers of q, each of shape (n,).
        bounds: Of the absolute values of the other inputs, by name: `{"v": …, "u": …}`, of their shapes, or one number.
        parameters: Lower and upper numbers of p, each of its shape, of a program that was recorded with some.
        start: How far y may be from σ(q), by entry or one number: default 1e-6 where y is given closed; with steps the
            largest of 0.02, 0.01, … for which they are proved to be enough, with status 0 if that can be proved.
        formats: `"double"`, `"float"`, or both.
        max_cells: Into how many cells the box of q is cut at most.

    Raises:
        InvalidInputError: A region, bounds or formats that are none of this program's.
        UnsupportedMechanismError: A program that reads how far a ball is turned: q, y or its law have such a number.
    """
    program = instance(program, "program", Program)
    if program.source is None:
        raise InvalidInputError("a program that was loaded has not what it was made of: record it here")
    if program.region is not None:
        raise InvalidInputError("a program with a certified region: certify the program that it was made of")
    try:
        equations = ProgramEquations(program.source)
    except NotProvedError as error:
        raise UnsupportedMechanismError(f"no certificate of '{program.name}': {error}") from None
    m, (lower, upper) = equations.n_y, corners(region, "region", len(program.source.independent))
    if (parameters is None) != (program.source.sizes[4] == 0):
        raise InvalidInputError("parameters must be lower and upper numbers of p where the program reads it, else none")
    if parameters is not None:
        least, greatest = corners(parameters, "parameters", program.source.sizes[4])
        lower, upper = np.append(lower, least), np.append(upper, greatest)
    most = bounds_of(program, instance(bounds, "bounds", Mapping, "bounds of inputs by name"))
    asked = tuple(choice(name, "formats", [each.name for each in FORMATS]) for name in records(formats, "formats", str))
    if not asked:
        raise InvalidInputError('formats must be "double", "float" or both')
    search = _Search(program, equations, (lower, upper), most, asked)
    starts = [np.full(m, _NEAR / 2**k) for k in range(_HALVINGS)] if program.source.steps else [np.full(m, _CLOSED)]
    if start is not None:
        given = numbers(start, "start")
        starts = [np.full(m, float(given)) if given.ndim == 0 else vector(given, "start", m)]
        if not np.all(starts[0] > 0.0):
            raise InvalidInputError("start: every number must be positive")
    return search.best(starts, whole(max_cells, "max_cells"))


class _Search:
    """Finer and finer cuts of a region."""

    def __init__(
        self,
        program: Program,
        equations: ProgramEquations,
        corners: tuple[Array, Array],
        bounds: Array,
        formats: tuple[str, ...],
    ) -> None:
        self._program, self._equations, (self._lower, self._upper) = program, equations, corners
        self._bounds, self._formats = bounds, formats
        self._stopped = ""

    def best(self, starts: Sequence[Array], most: int) -> ProgramCertificate:
        """The certificate of the finest cut that is worth it: of q alone, or else of q and p alike."""
        n, constants = len(self._equations.source.independent), self._equations.source.sizes[4]
        found = self._finest([0] * constants, n, starts, most)
        if found is None and constants:
            found = self._finest([1] * constants, n, starts, most)
        return found or ProgramCertificate(
            self._program, self._lower, self._upper, self._bounds, None, None, (), self._told(most)
        )

    def _finest(self, along: list[int], n: int, starts: Sequence[Array], most: int) -> ProgramCertificate | None:
        """The same, of cuts of q and of those constants that are 1 in `along`."""
        found: ProgramCertificate | None = None
        count = 1
        while count ** (n + sum(along)) <= most:
            new = self._cut([count] * n + [count**each for each in along], starts)
            if new is not None:
                if found is not None and new.off > _BETTER * found.off:
                    return found if found.off < new.off else new
                found = new
            count *= 2
        return found

    def _told(self, most: int) -> str:
        return f"with up to {most} cells: {self._stopped or 'the box of q has more axes than that'}; raise max_cells"

    def _cut(self, counts: Sequence[int], starts: Sequence[Array]) -> ProgramCertificate | None:
        """The certificate with so many cells along each axis, if all is proved."""
        equations = self._equations
        try:
            branch = prove(proposed_branch(equations, self._lower, self._upper, counts))
        except NotProvedError as error:
            self._stopped = str(error)
            return None
        found: ProgramCertificate | None = None
        for start in starts:
            try:
                premises, steps = [branch], None
                if equations.source.steps:
                    steps = prove(StepsFindSigma(equations, start), branch)
                    premises.append(steps)
                computed = tuple(self._computed(name, start, premises) for name in self._formats)
            except NotProvedError as error:
                self._stopped = str(error)
                continue
            made = ProgramCertificate(
                self._program, self._lower, self._upper, self._bounds, branch, steps, computed, start=start
            )
            if made.always_trusted(self._formats[0]):
                return made
            found = found or made
        return found

    def _computed(self, name: str, start: Array, premises: Sequence[Fact]) -> Fact:
        number = np.array([[each.name for each in FORMATS].index(name)])
        return prove(ProgramComputed(self._equations, start, self._bounds, number), *premises)
