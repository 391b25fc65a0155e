"""The claim that slices of a tube hold motions: Theorem Z of `motion_tube` over one step of the motion in its middle.

What was computed to prove it is what is found.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from itertools import pairwise
from typing import Annotated

import numpy as np

from ccpin.arrays import Array, Indices
from ccpin.proof.facts import Examined, Fact, Form, NotProvedError, ProvableClaim, provable, require
from ccpin.validated.arithmetic.ball_arrays import BallArray, exactly
from ccpin.validated.arithmetic.balls import flint
from ccpin.validated.flow.start_claim import PRECISION
from ccpin.validated.flow.step_claim import StepEnclosed, step_of
from ccpin.validated.loop_equations import ClosedLoopEquations
from ccpin.validated.sets.branch import Jets
from ccpin.validated.sets.curvature import UnboundedError, at_middles
from ccpin.validated.sets.instants import Instants, instants_over
from ccpin.validated.sets.tube_theorem import CrossSection, HeldSlice, SliceFrames, advance

GROWS = "the tube grows too fast"


@provable
@dataclass(frozen=True, eq=False)
class SlicesHeld(ProvableClaim):
    """Motions that are in a cross-section at a moment of a step stay in a tube round the step's, slice by slice.

    That is over as many slices as are found, from the first on: closed and nonsingular, and on the branch of σ that the
    closed motion in the middle is on. Premise: the fact about the step.

    Attributes:
        marks: The moments between slices, of shape (B + 1,), in seconds since the step began.
        frame, rate, curve: A_m, L, M, of shape (B, N, N).
        room: Bounds of |z| for which σ and F″ are bounded, of shape (B, N).
        begin, bound: The cross-section's frame A, of shape (N, N), and bound of |z|, of shape (N,).
        cells: Into how many intervals each coordinate of a cross-section is cut.
        precision: In bits, of the arithmetic of the motion in the middle.

    Found, of K ≤ B slices: `bound`, u, `kept`, z₀ + hGu, and `reach`, |A_m||P|u, of shape (K, N); `end` and
    `end_radius`, A at their ends, of shape (K, N, N).
    """

    equations: ClosedLoopEquations
    marks: Annotated[Array, Form("t", least=0.0)]
    frame: Annotated[Array, Form("mDD")]
    rate: Annotated[Array, Form("mDD")]
    curve: Annotated[Array, Form("mDD")]
    room: Annotated[Array, Form("mD", least=0.0)]
    begin: Annotated[Array, Form("DD")]
    bound: Annotated[Array, Form("D", least=0.0)]
    cells: Annotated[Indices, Form("1", "i", least=1)]
    precision: Annotated[Indices, PRECISION]
    theorem = "motion_tube"

    def examined(self, *premises: Fact) -> Examined:
        """The slices, computed."""
        require(len(premises) == 1 and type(premises[0].claim) is StepEnclosed, "slices of no step")
        (step,) = premises
        loop, marks = self.equations, self.marks
        require(rates_are_velocities(loop), "coordinates whose rates are not q̇")
        require(len(marks) == len(self.frame) + 1 > 1 and marks[-1] <= step.claim.length[0], "slices beyond the step")
        require(_has_middles(marks), "slices whose middles are no doubles, or that do not follow one another")
        with flint().ctx.workprec(int(self.precision[0])), np.errstate(all="ignore"):  # what is not finite is refused
            try:
                instants, jets = middles_of(loop, step, marks, int(self.precision[0]))
                moving = SliceFrames(self.frame, self.rate, self.curve)
                before = CrossSection(exactly(self.begin), self.bound)
                held = advance(loop, instants, jets.slope, moving, before, self.room, int(self.cells[0]))
            except (UnboundedError, np.linalg.LinAlgError) as refused:
                raise NotProvedError(str(refused)) from None
        require(len(held) > 0, GROWS)
        return Examined(np.ones(1, dtype=np.bool_), _numbers_of(held))


def rates_are_velocities(loop: ClosedLoopEquations) -> bool:
    """Whether q̇ is the rate of the numbers q, one each, in the closed loop's own program."""
    rates = [loop.field.outputs[k] for k in loop.independent]
    return rates == list(range(loop.n_x, loop.n_x + loop.n))


def middles_of(loop: ClosedLoopEquations, step: Fact, marks: Array, bits: int) -> tuple[Instants, Jets]:
    """The motion of a step at the middles between marks, with the flow's jets there; of the last few they are kept.

    Raises:
        UnboundedError: The closed loop is not proven regular there.
    """
    return _middles(loop, step, marks.tobytes(), bits)


@lru_cache(maxsize=2)
def _middles(loop: ClosedLoopEquations, step: Fact, marks: bytes, bits: int) -> tuple[Instants, Jets]:
    with flint().ctx.workprec(bits):
        instants = instants_over(_step(step), np.frombuffer(marks))
        jets = at_middles(loop, instants)
    for array in (*instants.middle, *instants.during, *(x for part in jets for x in part)):
        array.flags.writeable = False  # what is kept cannot be written to
    return instants, jets


_step = lru_cache(maxsize=2)(step_of)


def _has_middles(marks: Array) -> bool:
    """Whether marks rise, and the middles between them are doubles.

    So are the halves then: b − a < b and b − a < a + b are multiples of what the last bits of a, b and a + b are of.
    """
    pairs = list(pairwise(marks.tolist()))
    return all(a < b and 2 * Fraction(0.5 * (a + b)) == Fraction(a) + Fraction(b) for a, b in pairs)


def _numbers_of(held: list[HeldSlice]) -> dict[str, Array]:
    """Slices as arrays."""
    bound, kept, reach, ends = zip(*held, strict=True)
    columns = {"bound": bound, "kept": kept, "reach": reach}
    columns |= {"end": tuple(end.mid for end in ends), "end_radius": tuple(end.rad for end in ends)}
    return {name: np.array(column) for name, column in columns.items()}


def marks_held(slices: Fact) -> Array:
    """The moments between the slices that are held, in seconds since the step began."""
    marks: Array = slices.claim.marks[: len(slices.found["bound"]) + 1]
    return marks


def last_section(slices: Fact) -> CrossSection:
    """The cross-section in which motions are at the end of the slices held."""
    found = slices.found
    return CrossSection(BallArray(found["end"][-1], found["end_radius"][-1]), found["kept"][-1])


def last_instant(slices: Fact) -> Instants:
    """The motion in the middle at the last of the slices held."""
    claim, k = slices.claim, len(slices.found["bound"]) - 1
    instants, _ = middles_of(claim.equations, slices.premises[0], claim.marks, int(claim.precision[0]))
    return instants.part(np.s_[k : k + 1])
