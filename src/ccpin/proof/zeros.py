"""Claims about zeros of prolonged systems (`prolongations`): singular configurations on lines, cusps over planes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ccpin.arrays import Array
from ccpin.proof.equations import derivatives
from ccpin.proof.facts import Examined, Fact, Form, ProvableClaim, provable, require
from ccpin.proof.prolongations import Prolongation

_UNIT = 1.0 + 1e-9  # entries of unit vectors, as rounded


@dataclass(frozen=True, eq=False)
class _Zeros(ProvableClaim):
    x: Annotated[Array, Form("Bx")]
    origin: Annotated[Array, Form("BP")]
    directions: Array
    pairing: Annotated[Array, Form("BM")]
    rows = "B"

    @property
    def system(self) -> Prolongation:
        """F."""
        return Prolongation(self.equations, self.origin, self.directions, self.pairing)

    def examined(self, *premises: Fact) -> Examined:
        """The lemma of `extended`, l as it is there."""
        require(not premises, "zeros rest on nothing else")
        require(self.x.shape[1] == self.system.unknowns, "points with other unknowns")
        with np.errstate(all="ignore"):
            point = self.system.at(self.x, lambda theta: derivatives(self.equations, theta))
            error = self.system.proved_within(point)
        small = np.all(np.abs(self.pairing) <= _UNIT, axis=1)
        return Examined(np.asarray(small & np.isfinite(error)), {"error": error})


@provable
@dataclass(frozen=True, eq=False)
class SingularPoints(_Zeros):
    """On each of B lines q = q₀ + s d a closed configuration whose φ_y is singular, and regular along the line.

    Attributes:
        x: (s, y, w), w meant to span the kernel of φ_y, of shape (B, 1 + 2m).
        origin: q₀, of shape (B, n).
        directions: d, of shape (B, n, 1).
        pairing: l, entries in [−1, 1], of shape (B, m).

    Found: `error` (B,): exactly one has s, y and w so near, with lᵀw = 1.
    """

    directions: Annotated[Array, Form("BP1")]
    theorem = "folds"


@provable
@dataclass(frozen=True, eq=False)
class Cusps(_Zeros):
    """Over each of B planes q = q₀ + D s a closed configuration at which (s, y) ↦ s is a cusp.

    Attributes:
        x: (s, y, v, w), of shape (B, 2 + 3m).
        origin: q₀, of shape (B, n).
        directions: D, of shape (B, n, 2).
        pairing: l, entries in [−1, 1], of shape (B, m).

    Found: `error` (B,): exactly one has s, y, v and w so near, with lᵀv = 1 and lᵀw = 0.
    """

    directions: Annotated[Array, Form("BP2")]
    theorem = "cusps"
