"""What claims about adaptive laws are about: closures, bodies whose constants lie in a box, gains, and a reference."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.control.stability.tracking.masses import BodiesOnJoints, Masses, masses_of
from ccpin.control.stability.tracking.tracking_equations import ReferencePieces, finite_vector, own_pieces
from ccpin.identification.regressor_bounds import OF_A_JOINT, TEN, TIPS, Frames, frames_of
from ccpin.proof.chains import Chain
from ccpin.proof.digests import digest
from ccpin.proof.equations import Closures, row_of
from ccpin.proof.facts import known, require


class AdaptiveGains(NamedTuple):
    """An adaptive law's numbers.

    Attributes:
        slope: Λ's diagonal, 1/s, of shape (n,).
        damping: K's diagonal, N m s/rad or N s/m, of shape (n,).
        adaptation: Γ's diagonal, of all constants, of shape (p,): what is not adapted is not asked for.
        period: T, s.
    """

    slope: Array
    damping: Array
    adaptation: Array
    period: float


@known
@dataclass(frozen=True, eq=False)
class AdaptiveEquations:
    """Closures, bodies on them, the box of their constants, a law's gains and its reference, in copies of their own.

    The constants are ten of each body, body by body, then the rotors, dampers, springs and constant efforts of all
    joints; those with lower = upper are known.

    Attributes:
        closures: φ, whose facts may be premises.
        frames: Each body's origin and axes as tips of chains, four a body.
        gravity: γ, of shape (3,).
        lower, upper: The box, of shape (p,).
        gains: The law's.
        reference: q_d, which goes on resting after its last knot.
        theta: θ of the law's configuration at q_d(0), of shape (n′,).
    """

    closures: Closures
    frames: tuple[Chain, ...]
    gravity: Array
    lower: Array
    upper: Array
    gains: AdaptiveGains
    reference: ReferencePieces
    theta: Array

    def __post_init__(self) -> None:
        require(type(self.closures) is Closures, "closures that the kernel does not know")
        system, frames = self.closures.system, tuple(self.frames)
        require(len(frames) > 0 and len(frames) % TIPS == 0, "bodies without an origin and three axes")
        size = TEN * (len(frames) // TIPS) + OF_A_JOINT * system.n_free
        slope, damping, adaptation, period = self.gains
        own = AdaptiveGains(
            finite_vector(slope, system.n), finite_vector(damping, system.n), finite_vector(adaptation, size),
            float(period),
        )  # fmt: skip
        for name, value in (
            ("frames", row_of(self.closures, frames).system.chains),
            ("gravity", finite_vector(self.gravity, 3)),
            ("lower", finite_vector(self.lower, size)),
            ("upper", finite_vector(self.upper, size)),
            ("gains", own),
            ("reference", own_pieces(self.reference, system)),
            ("theta", finite_vector(self.theta, system.n_free)),
        ):
            object.__setattr__(self, name, value)
        require(self.lower <= self.upper, "a box that is empty")
        require(own.slope > 0.0, "an error that does not die out")
        require(own.damping > 0.0, "gains that do not damp")
        require(own.adaptation[self.adapted] > 0.0, "constants that are adapted without a gain")
        require(0.0 < own.period < np.inf, "no period")
        dampers = self.lower[size - OF_A_JOINT * system.n_free :].reshape(OF_A_JOINT, -1)[1]
        require(dampers >= 0.0, "dampers that drive")

    def __reduce__(self) -> tuple[type[AdaptiveEquations], tuple[Any, ...]]:
        held = self.closures, self.frames, self.gravity, self.lower, self.upper, self.gains, self.reference, self.theta
        return AdaptiveEquations, held

    @property
    def adapted(self) -> Array:
        """Where the constants stand that are not known."""
        return np.flatnonzero(self.upper > self.lower)

    @property
    def sizes(self) -> Mapping[str, int]:
        """Those of the closures; X: of two errors; A: of all constants."""
        return {**self.closures.sizes, "X": 2 * self.closures.system.n, "A": len(self.lower)}

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all of it."""
        box = self.gravity, self.lower, self.upper
        return digest((self.closures.digest, self.frames, box, self.gains, self.reference, self.theta))

    @cached_property
    def masses(self) -> Masses:
        """The closures' chains side by side, without bodies: these are in `bodies`."""
        nothing = np.zeros(self.closures.system.n_free)
        return masses_of(self.closures.system, BodiesOnJoints((), nothing, nothing, nothing, nothing))

    @cached_property
    def bodies(self) -> tuple[Frames, ...]:
        """The bodies' frames side by side."""
        return frames_of(self.closures.system, self.frames)

    @cached_property
    def motion(self) -> tuple[ReferencePieces, ReferencePieces, ReferencePieces]:
        """q_d, q̇_d and q̈_d."""
        speed = self.reference.derivative()
        return self.reference, speed, speed.derivative()
