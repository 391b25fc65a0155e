"""What claims about tracking errors are about: closures, the bodies on them, a law's feedback, and its reference."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.control.stability.tracking.error_equations import ErrorEquation, Feedback, equation_of
from ccpin.control.stability.tracking.masses import BodiesOnJoints, Masses, Tip, masses_of
from ccpin.proof.chains import ClosureSystem
from ccpin.proof.digests import digest
from ccpin.proof.equations import Closures, row_of
from ccpin.proof.facts import known, require, sealed


class ReferencePieces(NamedTuple):
    """q_d(t) = Σ c_i (t − x_k)^(d−i) between knots: c (d + 1, K, n), x (K + 1,) from 0 s on, the last piece a rest."""

    c: Array
    x: Array

    def derivative(self) -> ReferencePieces:
        """q̇_d."""
        degree = len(self.c) - 1
        powers = np.arange(degree, 0, -1, dtype=np.float64)
        return ReferencePieces(powers[:, None, None] * self.c[:-1] if degree else 0.0 * self.c, self.x)


@known
@dataclass(frozen=True, eq=False)
class TrackingEquations:
    """Closures, the free system on them, a law's feedback and its reference, in copies that cannot be written to.

    Attributes:
        closures: φ, whose facts may be premises.
        free: The bodies in the same θ, and what acts on the joints.
        feedback: The law's kind and gains.
        reference: q_d, which goes on resting after its last knot.
        theta: θ of the law's configuration at q_d(0), of shape (n′,).
    """

    closures: Closures
    free: BodiesOnJoints
    feedback: Feedback
    reference: ReferencePieces
    theta: Array

    def __post_init__(self) -> None:
        require(type(self.closures) is Closures, "closures that the kernel does not know")
        system, (tips, *joints) = self.closures.system, self.free
        chains = row_of(self.closures, tuple(tip.chain for tip in tips)).system.chains if tips else ()
        own = [
            Tip(chain, float(tip.weight), float(tip.doubt), finite_vector(tip.fall, 3))
            for chain, tip in zip(chains, tips, strict=True)
        ]
        free = BodiesOnJoints(tuple(own), *(finite_vector(values, system.n_free) for values in joints))
        object.__setattr__(self, "free", free)
        object.__setattr__(self, "theta", finite_vector(self.theta, system.n_free))
        object.__setattr__(self, "feedback", _own_feedback(self.feedback, system.n))
        object.__setattr__(self, "reference", own_pieces(self.reference, system))
        weights = np.array([(tip.weight, tip.doubt) for tip in own])
        require(np.isfinite(weights), "bodies without a weight")
        require([tip.doubt >= 0.0 for tip in own], "a weight that is off by less than nothing")

    def __reduce__(self) -> tuple[type[TrackingEquations], tuple[Any, ...]]:
        return TrackingEquations, (self.closures, self.free, self.feedback, self.reference, self.theta)

    @property
    def sizes(self) -> Mapping[str, int]:
        """Those of the closures; X: of the error (e, ė)."""
        return {**self.closures.sizes, "X": 2 * self.closures.system.n}

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all of it."""
        return digest((self.closures.digest, self.free, self.feedback, self.reference, self.theta))

    @cached_property
    def masses(self) -> Masses:
        """The bodies side by side."""
        return masses_of(self.closures.system, self.free)

    @property
    def error(self) -> ErrorEquation:
        """How the tracking error moves."""
        return equation_of(self.feedback.kind)

    @cached_property
    def motion(self) -> tuple[ReferencePieces, ReferencePieces, ReferencePieces]:
        """q_d, q̇_d and q̈_d."""
        speed = self.reference.derivative()
        return self.reference, speed, speed.derivative()


def finite_vector(values: Any, size: int) -> Array:
    """A copy of finite numbers.

    Raises:
        NotProvedError: They are none.
    """
    array = np.array(values, dtype=np.float64)
    require(array.shape == (size,) and np.all(np.isfinite(array)), "numbers of another size, or none")
    return np.asarray(sealed(array))


def _own_feedback(feedback: Feedback, n: int) -> Feedback:
    """A copy of gains that are symmetric: their storage functions are about such.

    Raises:
        NotProvedError: They are not, or of a kind that no error equation is known of.
    """
    equation_of(feedback.kind)
    gains = [np.array(values, dtype=np.float64) for values in (feedback.K_p, feedback.K_v)]
    for gain in gains:
        require(gain.shape == (n, n) and np.all(np.isfinite(gain)), "gains of another size, or none")
        require(np.array_equal(gain, gain.T), "gains that are not symmetric")
    return Feedback(feedback.kind, *(sealed(gain) for gain in gains))


def own_pieces(reference: ReferencePieces, system: ClosureSystem) -> ReferencePieces:
    """A copy of polynomials from t = 0 on, of which the last rests: it is to go on without end.

    Raises:
        NotProvedError: They are none.
    """
    c, x = (np.array(values, dtype=np.float64) for values in reference)
    require(c.ndim == 3 and len(c) > 0 and c.shape[2] == system.n, "polynomials of another size")
    require(x.shape == (c.shape[1] + 1,) and len(x) > 1, "knots of other polynomials")
    require(np.all(np.isfinite(c)) and np.all(np.isfinite(x)), "polynomials with what is no number")
    require(x[0] == 0.0 and np.all(np.diff(x) > 0.0), "knots that do not increase from t = 0 on")
    require(not c[:-1, -1].any(), "a reference that does not come to rest")
    return ReferencePieces(sealed(c), sealed(x))
