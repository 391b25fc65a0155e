"""One singular curve as covers list it: got from a chain of tubes, and checked anew from these alone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, joined, rows_of
from ccpin.domain.closures.system import Reading
from ccpin.domain.singular.following import TubeChain
from ccpin.domain.singular.sampled import CurveKind, SingularCurve
from ccpin.proof.curves.curve_equations import values_at
from ccpin.proof.curves.tubes import Frames, Tubes, certify_tubes, glued, zeros_in
from ccpin.proof.equations import Problem
from ccpin.proof.newton import without_turns

_STILL = 1e-7  # rad, m: along a self-motion q moves less, by the middles' errors alone
_AGAIN, _ROUNDED = 1e-6, 1e-15  # how far the same bounds may differ when formed again


class CertifiedCurve(NamedTuple):
    """A connected curve of singular configurations, in tubes that hold it and no other (Theorem R of `curves.tubes`).

    Attributes:
        kind: ``fold`` or ``self-motion``, as for `SingularCurve`; told from where the tubes' middles are, not proved.
        q: Image of the tubes' middles in the independent coordinates, of shape (k, 2); one row for a self-motion.
        q_free: The middles of the tubes, in order, of shape (k, nq).
        closed: Whether it is proved to close on itself (turns of 2π of a joint not counted). What is not closed leaves
            the region, or ends where it could not be followed or, of covers merged, was not proved to go on in another.
        error: A singular configuration of the curve is this near each middle in every coordinate (rad, m), (k,).
        radius: The whole arc in a tube is this near its middle, (k,).
        tubes: The tubes themselves.
    """

    kind: CurveKind
    q: Array
    q_free: Array
    closed: bool
    error: Array
    radius: Array
    tubes: Tubes

    @property
    def points(self) -> SingularCurve:
        """Its points as `singularities` gives them, for pictures and `cusps`; of a closed one the first comes last."""
        order = np.arange(len(self.q_free) + self.closed) % len(self.q_free)
        q = self.q if self.kind == "self-motion" else self.q[order]
        return SingularCurve(self.kind, q, self.q_free[order], self.closed, self.error[order])


def as_curve(reading: Reading, chain: TubeChain) -> CertifiedCurve:
    """The curve in a chain's tubes."""
    system, tubes = reading.system, chain.tubes
    at = zeros_in(reading.problem, tubes, np.zeros(len(tubes.half)))
    error = (np.abs(at.x - tubes.x) + at.error)[:, : system.n_free].max(axis=1)
    reach = (np.abs(tubes.tangent) * tubes.half[:, None] + tubes.hull)[:, : system.n_free].max(axis=1)
    q = tubes.theta[:, system.independent]
    still = bool(np.ptp(q, axis=0).max() < _STILL)
    q = without_turns(q[:1], system.periodic[system.independent]) if still else q
    q_free = reading.configuration(tubes.theta)
    return CertifiedCurve("self-motion" if still else "fold", q, q_free, chain.closed, error, reach, tubes)


def holds(problem: Problem, curve: CertifiedCurve) -> bool:
    """Whether Theorem R holds for the tubes of a curve, and each is glued to the next.

    κ and the bounds of |e| are to be those that follow: neither less nor, so that no other configuration counts as on
    the curve, more.
    """
    tubes = curve.tubes
    values = values_at(problem, tubes.theta, tubes.kernel, tubes.pairing)
    proved = certify_tubes(problem, values, Frames(tubes.along, tubes.tangent, tubes.gain), tubes.half, tubes.radius)
    known = all(
        np.allclose(getattr(proved.tubes, name), getattr(tubes, name), rtol=_AGAIN, atol=_ROUNDED)
        for name in ("hull", "kappa")
    )
    following = joined([rows_of(tubes, slice(1, None)), rows_of(tubes, slice(0, int(curve.closed)))])
    same = glued(problem, rows_of(tubes, slice(0, len(following.half))), following)
    return bool(proved.proved.all() and known and same.all())
