"""Bounds of φ and its Jacobian over boxes: what Theorem N needs.

Notation. A box is θ = θ_c + Dδ + Eζ, |δ| ≤ h, |ζ| ≤ R, with D (n′×p) and E (n′×m), zero in the independent rows;
f = Ãφ. L = |D|h and W = L + |E|R bound the moves of the joints. Wanted, componentwise,

    Y ≥ |f(δ, 0)|,    Z(R) ≥ |I − f_ζ(δ, ζ)|,    Z̄(R) ≥ |I − ∫₀¹ f_ζ(δ, τζ) dτ|.

**Taylor bounds** (any equations, `taylor`) take third derivatives from lengths for closures (`reach_bounds`).

**Planar bounds** (φ a sum of phasors z_j e^{iu_j}, u_j = (CD)_j δ + (CE)_j ζ the deviation of link j's angle, so that
joint motions that cancel in a link cancel in the bound). With α = Ãz, κ = Ã(iz) and U_j ≥ |u_j|,

    f = Ãφ_c + Ãφ_θ Dδ + Σ_j α_j (cos u_j − 1) + κ_j (sin u_j − u_j),
    f_ζ − Ãφ_θE = Σ_j [κ_j (cos u_j − 1) − α_j sin u_j] (CE)_j,

and 0 ≤ 1 − cos u ≤ 2 sin²(U/2), |u − sin u| ≤ U³/6, |sin u| ≤ s(U) = sin min(U, π/2),
0 ≤ u²/2 − (1 − cos u) ≤ U⁴/24. The sums of 1 − cos are one-signed term by term; sums linear or quadratic in u are also
formed exactly before the absolute value is taken, and the smaller of the two bounds counts. Means over τ use Jensen's
inequality for the concave s and the integrals of the powers.

Rounding: γ · magnitude bounds the error of every entry of φ, φ_θ, φ_θθ (`ClosureSystem.rounding`); Y and Z carry it
through |Ã|, |D|, |E|. Errors of the bounds' own arithmetic, on nonnegative terms, are below 1e-12 relative and
are covered by the factor 1 + 1e-10 with which `newton` compares.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from ccpin.arrays import Array, Indices, Mask, apply

Rows = Indices | Mask


class Frame(NamedTuple):
    """How B boxes are parametrized: Ã (B, m, m), D (B, n′, p), E (B, n′, m), h (B, p), and γ · magnitude (B,)."""

    preconditioner: Array
    directions: Array
    modes: Array
    half: Array
    rounding: Array


class Image(NamedTuple):
    """A bound in two parts: a matrix (B, m, m) to be applied to a vector, and what to add (B, m)."""

    matrix: Array
    rest: Array

    def of(self, vector: Array) -> Array:
        """The bound: matrix · vector + rest, of shape (B, m)."""
        return np.asarray(apply(self.matrix, vector) + self.rest)


class Contraction(NamedTuple):
    """Z in two parts: a matrix (B, m, m), and what is to be added to matrix · w, linear in w (B, m)."""

    matrix: Array
    rest: Callable[[Array], Array]

    def of(self, weight: Array) -> Array:
        """Zw for weights w (B, m), of shape (B, m)."""
        return np.asarray(apply(self.matrix, weight) + self.rest(weight))


class Bounds(Protocol):
    """Y, Z̄ and Z of B boxes."""

    @property
    def y(self) -> Array:
        """Y ≥ |f(δ, 0)|, of shape (B, m)."""

    def mean(self, radius: Array) -> Image:
        """Z̄(R)R ≤ `.of(R)` for radii (B, m); both parts grow with R."""

    def contraction(self, radius: Array) -> Contraction:
        """Z(R) for radii (B, m): Z(R)w ≤ `.of(w)`."""

    def curvature(self, radius: Array, weight: Array) -> Array:
        """Ω with |f_ζ(δ, ζ) − f_ζ(δ, ζ′)| w ≤ Ω max_k |ζ − ζ′|_k/w_k on the tube, of shape (B, m)."""

    def take(self, rows: Rows) -> Bounds:
        """The bounds of some of the boxes."""


class LinearPart(NamedTuple):
    """What both kinds of bound share.

    Attributes:
        half: h, of shape (B, p).
        moves: L = |D|h, of shape (B, n′).
        spread: |E|, of shape (B, n′, m).
        constant: |Ãφ_c| + |Ãφ_θD|h with its rounding margin, of shape (B, m).
        defect: |I − Ãφ_θE|, of shape (B, m, m).
        rounding: γ · magnitude, of shape (B,).
        margin: Σ_j |Ã_ij| γ · magnitude, of shape (B, m).
    """

    half: Array
    moves: Array
    spread: Array
    constant: Array
    defect: Array
    rounding: Array
    margin: Array

    def widths(self, radius: Array) -> Array:
        """|E|R, of shape (B, n′)."""
        return apply(self.spread, radius)

    def affine(self, widths: Array) -> Array:
        """|I − Ãφ_θE| at the centre with the rounding margin of everything in Z, of shape (B, m, m)."""
        size = 1.0 + (self.moves + widths).sum(axis=1)
        return np.asarray(self.defect + self.margin[:, :, None] * (self.spread.sum(axis=1) * size[:, None])[:, None])

    def curvature_margin(self, weight: Array) -> Array:
        """The rounding margin of a second derivative applied to |E|w twice, of shape (B, m)."""
        return np.asarray(self.margin * self.widths(weight).sum(axis=1)[:, None] ** 2)


def linear_part(frame: Frame, phi: Array, jacobian: Array) -> LinearPart:
    """The linear part from φ (B, m) and φ_θ (B, m, n′) at the centres."""
    moves = apply(np.abs(frame.directions), frame.half)
    weighted = frame.preconditioner @ jacobian
    residual = np.abs(frame.preconditioner @ phi[..., None])
    slope = np.abs(weighted @ frame.directions) @ frame.half[..., None]
    margin = np.abs(frame.preconditioner).sum(axis=2) * frame.rounding[:, None]
    return LinearPart(
        half=frame.half,
        moves=moves,
        spread=np.abs(frame.modes),
        constant=(residual + slope)[..., 0] + margin * (1.0 + moves.sum(axis=1))[:, None] ** 2,
        defect=np.abs(np.eye(phi.shape[1]) - weighted @ frame.modes),
        rounding=frame.rounding,
        margin=margin,
    )
