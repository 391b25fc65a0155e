"""What claims about adaptive laws are about: closures, bodies whose constants lie in a box, gains, and a reference."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import Array, Mask
from ccpin.control.stability.tracking.masses import BodiesOnJoints, Masses, masses_of
from ccpin.control.stability.tracking.tracking_equations import ReferencePieces, finite_vector, own_pieces
from ccpin.identification.adaptive.regressor_bounds import OF_A_JOINT, TEN, TIPS, BodyFrames, Shares, frames_of
from ccpin.proof.chains import Chain
from ccpin.proof.digests import digest
from ccpin.proof.equations import Closures, row_of
from ccpin.proof.facts import known, require, sealed

_ADDS = np.isin(np.arange(TEN), (0, 4, 6, 9))  # of a body: its mass, and Ixx, Iyy, Izz
_DEFINITE = 1e-9  # of matrices with a diagonal of ones: far more than what eigenvalues are computed to


class AdaptiveGains(NamedTuple):
    """An adaptive law's numbers.

    Attributes:
        slope: Λ's diagonal, 1/s, of shape (n,).
        damping: K's diagonal, N m s/rad or N s/m, of shape (n,).
        adaptation: Γ's diagonal, of shape (k,).
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
    joints: π = known + B θ, θ in the box.

    Attributes:
        closures: φ, whose facts may be premises.
        frames: Each body's origin and axes as tips of chains, four a body.
        gravity: γ, of shape (3,).
        known, basis: Of the constants, of shapes (p,) and (p, k).
        lower, upper: The box, of shape (k,).
        gains: The law's.
        reference: q_d, which goes on resting after its last knot.
        theta: θ of the law's configuration at q_d(0), of shape (n′,).
    """

    closures: Closures
    frames: tuple[Chain, ...]
    gravity: Array
    known: Array
    basis: Array
    lower: Array
    upper: Array
    gains: AdaptiveGains
    reference: ReferencePieces
    theta: Array

    def __post_init__(self) -> None:
        require(type(self.closures) is Closures, "closures that the kernel does not know")
        system, frames = self.closures.system, tuple(self.frames)
        require(len(frames) % TIPS == 0, "bodies without an origin and three axes")
        size = TEN * (len(frames) // TIPS) + OF_A_JOINT * system.n_free
        basis = np.array(self.basis, dtype=np.float64)
        require(basis.ndim == 2 and len(basis) == size and np.all(np.isfinite(basis)), "no combinations of constants")
        (slope, damping, adaptation, period), count = self.gains, basis.shape[1]
        own = AdaptiveGains(
            finite_vector(slope, system.n), finite_vector(damping, system.n), finite_vector(adaptation, count),
            float(period),
        )  # fmt: skip
        for name, value in (
            ("frames", row_of(self.closures, frames).system.chains),
            ("gravity", finite_vector(self.gravity, 3)),
            ("known", finite_vector(self.known, size)),
            ("basis", sealed(basis)),
            ("lower", finite_vector(self.lower, count)),
            ("upper", finite_vector(self.upper, count)),
            ("gains", own),
            ("reference", own_pieces(self.reference, system)),
            ("theta", finite_vector(self.theta, system.n_free)),
        ):
            object.__setattr__(self, name, value)
        require(self.lower <= self.upper, "a box that is empty")
        require(own.slope > 0.0, "an error that does not die out")
        require(own.damping > 0.0, "gains that do not damp")
        require(own.adaptation > 0.0, "constants that are adapted without a gain")
        require(0.0 < own.period < np.inf, "no period")
        dampers = slice(size - 3 * system.n_free, size - 2 * system.n_free)
        least = np.minimum(self.basis[dampers] * self.lower, self.basis[dampers] * self.upper).sum(axis=1)
        require(self.known[dampers] + least >= 0.0, "dampers that drive")

    def __reduce__(self) -> tuple[type[AdaptiveEquations], tuple[Any, ...]]:
        box = self.gravity, self.known, self.basis, self.lower, self.upper
        return AdaptiveEquations, (self.closures, self.frames, *box, self.gains, self.reference, self.theta)

    @property
    def sizes(self) -> Mapping[str, int]:
        """Those of the closures; X: of two errors."""
        return {**self.closures.sizes, "X": 2 * self.closures.system.n}

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all of it."""
        box = self.gravity, self.known, self.basis, self.lower, self.upper
        return digest((self.closures.digest, self.frames, box, self.gains, self.reference, self.theta))

    @cached_property
    def shares(self) -> Shares:
        """What Y_r's columns are made of: of the known constants, and of each of θ."""
        return Shares.of(np.hstack([self.known[:, None], self.basis]), self.closures.system.n_free)

    @cached_property
    def adds(self) -> Mask:
        """Which of θ only add to D: it is positive semidefinite of one of them more, of shape (k,).

        That is a mass, Ixx, Iyy, Izz, a rotor; and bodies of which the 6×6 inertia [[m1, −h×], [h×, I]] is definite.
        """
        n_free, ten = self.closures.system.n_free, TEN * (len(self.frames) // TIPS)
        rotors = np.all(self.basis[ten : ten + n_free] >= 0.0, axis=0)
        bodies = np.moveaxis(self.basis[:ten].reshape(-1, TEN, self.basis.shape[1]), 2, 1)
        plain = np.all(np.where(_ADDS, bodies >= 0.0, bodies == 0.0), axis=2)
        return np.asarray(rotors & np.all(plain | _definite(bodies), axis=0))

    @cached_property
    def masses(self) -> Masses:
        """The closures' chains side by side, without bodies: these are in `bodies`."""
        nothing = np.zeros(self.closures.system.n_free)
        return masses_of(self.closures.system, BodiesOnJoints((), nothing, nothing, nothing, nothing))

    @cached_property
    def bodies(self) -> tuple[BodyFrames, ...]:
        """The bodies' frames side by side."""
        return frames_of(self.closures.system, self.frames)

    @cached_property
    def motion(self) -> tuple[ReferencePieces, ReferencePieces, ReferencePieces]:
        """q_d, q̇_d and q̈_d."""
        speed = self.reference.derivative()
        return self.reference, speed, speed.derivative()


def _definite(bodies: Array) -> Mask:
    """Whether the 6×6 inertia of ten numbers, (…, 10), is proved positive definite."""
    m, x, y, z, xx, xy, yy, xz, yz, zz = np.moveaxis(bodies, -1, 0)
    o = np.zeros_like(m)
    rows = [
        [m, o, o, o, z, -y], [o, m, o, -z, o, x], [o, o, m, y, -x, o],
        [o, -z, y, xx, xy, xz], [z, o, -x, xy, yy, yz], [-y, x, o, xz, yz, zz],
    ]  # fmt: skip
    M = np.moveaxis(np.array(rows), (0, 1), (-2, -1))
    own = np.diagonal(M, axis1=-2, axis2=-1)
    size = np.sqrt(np.where(own > 0.0, own, 1.0))
    scaled = M / (size[..., :, None] * size[..., None, :])
    return np.asarray(np.linalg.eigvalsh(scaled)[..., 0] > _DEFINITE)
