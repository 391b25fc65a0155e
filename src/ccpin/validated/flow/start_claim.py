"""The claim that there is one closed state near a computed one: Theorem P of `closed_boxes`, 1 of Theorem M."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ccpin.arrays import Array, Indices
from ccpin.proof.facts import Examined, Fact, Form, NotProvedError, ProvableClaim, provable, require
from ccpin.validated.arithmetic.balls import ball, flint
from ccpin.validated.arithmetic.exact_numbers import ExactBox, boxed, centres
from ccpin.validated.arithmetic.series import NotInvertibleError
from ccpin.validated.flow.closing import assembled, krawczyk
from ccpin.validated.loop_equations import ClosedLoopEquations

PRECISION = Form("1", "i", least=53, below=100_001)  # bits


@provable
@dataclass(frozen=True, eq=False)
class ClosedStart(ProvableClaim):
    """For every q of a box there is one y in another with φ(q, y) = 0, near a computed one; with q̇ that is a state.

    Attributes:
        q, q_radius: The box of q, middles as sums of k doubles.
        y, radius: That of y, alike; in it the solution is the only one.
        sharp: Half-widths of a smaller one with the same centre, which holds the solution.
        near: The y that was computed.
        v: q̇, exact.
        precision: In bits, of the arithmetic.

    Found: `state`, `state_radius`, a box around (x, q̇), and the efforts that a sampled law reads there.
    """

    equations: ClosedLoopEquations
    q: Annotated[Array, Form("Qk")]
    q_radius: Annotated[Array, Form("Q", least=0.0)]
    y: Annotated[Array, Form("Yk")]
    radius: Annotated[Array, Form("Y", above=0.0)]
    sharp: Annotated[Array, Form("Y", above=0.0)]
    near: Annotated[Array, Form("Y")]
    v: Annotated[Array, Form("V")]
    precision: Annotated[Indices, PRECISION]
    theorem = "closed_boxes"

    def examined(self, *premises: Fact) -> Examined:
        """Krawczyk's condition for both boxes of y."""
        require(not premises, "a start rests on nothing else")
        require(self.sharp <= self.radius, "a smaller box that is larger")
        loop, bits = self.equations, int(self.precision[0])
        with flint().ctx.workprec(bits):
            q, y = ExactBox(self.q, self.q_radius).balls(), centres(self.y)
            radius, sharp = ([ball(r) for r in width.tolist()] for width in (self.radius, self.sharp))
            off = [abs(ball(a) - b) < r for a, b, r in zip(self.near.tolist(), y, radius, strict=True)]
            require(off, "the solution is not the one near the computed start")
            require(krawczyk(loop, q, y, radius) is not None, "σ is not proven to be single near the computed start")
            inside = krawczyk(loop, q, y, sharp)
            if inside is None:
                raise NotProvedError("no closed configuration is proven to be in the smaller box")
            try:
                state = loop.at_a_sample([*assembled(loop, q, inside), *map(ball, self.v.tolist())])
            except NotInvertibleError:
                raise NotProvedError("the motors' efforts are not proven to exist at the start") from None
            found = boxed(state, bits)
        return Examined(np.ones(1, dtype=np.bool_), {"state": found.parts, "state_radius": found.radius})


def state_of(fact: Fact) -> ExactBox:
    """The box of states that a start is in."""
    return ExactBox(fact.found["state"], fact.found["state_radius"])
