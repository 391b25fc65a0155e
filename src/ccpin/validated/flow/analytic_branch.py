"""σ over a polydisc of q: the one analytic solution of φ(q, y) = 0 near polynomials y_N(q)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.validated.arithmetic.ball_arrays import raised
from ccpin.validated.arithmetic.balls import Ball, around, ball, upper
from ccpin.validated.arithmetic.polydisc import Analytic, Ring, constants, evaluated, inverse, ring, unit
from ccpin.validated.arithmetic.series import NotInvertibleError, values
from ccpin.validated.flow.closing import assembled
from ccpin.validated.loop_equations import ClosedLoopEquations

_OUT = 1.0 + 2.0**-40  # on what is not negative: covers the roundings in computing it
_ROUGH = 1e-12  # of a polynomial's norm: covers the roundings in its value


class AnalyticBranch(NamedTuple):
    """σ(c + Rξ) for complex |ξ_i| ≤ 1: of y ↦ y − Bφ(q, y), contractions of |y − y_N| ≤ r, the fixed points.

    Attributes:
        loop: The closures.
        centre, reach: c and R.
        inputs: q, y_N and what is 0, inputs of programs, with r left of each of y.
        radius: r, of shape (Y,).
        near: B, polynomials.
        image: ‖σ − y_N‖ at most, of shape (Y,).
        share: β < 1, Lipschitz' constant where y is measured in r.
    """

    loop: ClosedLoopEquations
    centre: Array
    reach: Array
    inputs: Analytic
    radius: Array
    near: Analytic
    image: Array
    share: float

    @property
    def proved(self) -> bool:
        """Whether the tube is mapped into its interior, by a contraction."""
        return self.share < 1.0 and bool(np.all(self.image < self.radius))

    def closed(self, q: Sequence[Ball], xi: Array, y: Sequence[Ball]) -> list[Ball] | None:
        """The numbers x of σ at a real q = c + Rξ, about a computed y in the tube; ``None`` where it is not in there.

        |y − σ| ≤ |B φ(q, y)|/(1 − β), in r.
        """
        waves = np.prod(xi**self.near.ring.exponents, axis=1)  # of modulus 1 at most, and off by a few roundings
        middle = self.inputs.at(list(self.loop.dependent))
        off = np.array([upper(abs(a - ball(b))) for a, b in zip(y, (middle.mid @ waves).tolist(), strict=True)])
        if not np.all(off + _ROUGH * middle.size < self.radius):
            return None
        box = assembled(self.loop, q, y)
        left = np.array([upper(abs(x)) for x in values(self.loop.closure, self.loop.at_rest(box))])
        size = np.abs(self.near.mid @ waves) + _ROUGH * self.near.size
        most = float(np.max(raised(raised(size @ left) / self.radius), initial=0.0)) / (1.0 - self.share) * _OUT
        return assembled(
            self.loop, q, [around(c, ball(most * float(r) * _OUT)) for c, r in zip(y, self.radius, strict=True)]
        )


@np.errstate(all="ignore")
def branch_over(
    loop: ClosedLoopEquations, centre: Array, reach: Array, y: Array, radius: Array, degree: int
) -> AnalyticBranch | None:
    """‖Bφ(q, y_N)‖ + ‖I − Bφ_y‖ r about polynomials y_N(ξ), of shape (Y, K); ``None`` where there is none."""
    known = ring(len(centre), degree)
    whole, dependent = _inputs(loop, centre, reach, y, known), list(loop.dependent)
    rest = np.zeros(len(whole.mid))
    rest[dependent] = radius
    tube = whole._replace(rest=rest)
    try:
        slopes = evaluated(loop.closure, tube, dependent).slopes
        near = inverse(slopes)
        left = evaluated(loop.closure, whole).values
    except NotInvertibleError:
        return None
    turned = raised((unit(len(y), known) - near @ slopes).size @ radius)
    still = (near @ Analytic(left.mid[:, None], left.rest[:, None], known)).size[:, 0]
    share = float(np.max(raised(turned / radius), initial=0.0))
    return AnalyticBranch(loop, centre, reach, tube, radius, near, raised(still + turned), share)


def _inputs(loop: ClosedLoopEquations, centre: Array, reach: Array, y: Array, known: Ring) -> Analytic:
    """c + Rξ and y_N, at rest."""
    mid = np.zeros((loop.field.inputs, len(known.exponents)))
    mid[list(loop.independent), 0] = centre
    for k, (place, r) in enumerate(zip(loop.independent, reach.tolist(), strict=True)):
        mid[place, np.argmax(known.exponents[:, k] == 1)] = r  # the first is ξ_k itself
    mid[list(loop.dependent)] = y
    return Analytic(mid, np.zeros(len(mid)), known)


@np.errstate(all="ignore")
def followed(loop: ClosedLoopEquations, centre: Array, reach: Array, y: Array, degree: int) -> Array | None:
    """Polynomials y_N near σ(c + Rξ), from its value at c: Newton's method for polynomials, a proposal."""
    known, dependent = ring(len(centre), degree), list(loop.dependent)
    found = constants(y, np.zeros_like(y), known).mid
    try:
        for _ in range((degree + 1).bit_length() + 1):
            inputs = _inputs(loop, centre, reach, found, known)
            left, slopes = evaluated(loop.closure, inputs, dependent)
            step = inverse(slopes.polynomials) @ Analytic(left.mid[:, None], np.zeros((len(y), 1)), known)
            found = found - step.mid[:, 0]
    except NotInvertibleError:
        return None
    return found if np.all(np.isfinite(found)) else None
