"""Bounds of φ and its Jacobian over boxes: what Theorem K needs, from link lengths alone.

Notation. A box is θ = θ_c + Dδ + Eζ, |δ| ≤ h, |ζ| ≤ R, with D (n′×p) and E (n′×m), zero in the independent rows;
f = Ãφ. L = |D|h and W = L + |E|R bound the moves of the joints. Wanted, componentwise,

    Y ≥ |f(δ, 0)|,    Z(R) ≥ |I − f_ζ(δ, ζ)|,    Z̄(R) ≥ |I − ∫₀¹ f_ζ(δ, τζ) dτ|.

**Reach bounds** (any tree). By Taylor's formula with the exact φ_θθ at the centre and the third derivatives
bounded along the segment,

    Y  = |Ãφ_c| + |ÃφD|h + ½ hᵀ|Dᵀ(Ãφ_θθ)D|h + ⅙ Σ_c g_c T_c(L, L, L),
    Z  = |I − Ãφ_θE| + |N|(h, R) + ½ Σ_c g_c T_c(W, W, |E|),       N = Eᵀ(Ãφ_θθ)[D, E],
    Z̄  = the same with (h, R/2) and T_c(L, L, ·) + T_c(L, r, ·) + T_c(r, r, ·)/3, r = |E|R,

g_ic = ‖row i of ÃB_c‖₂, T_c(x, y, z) = Σ ρ_l x_i y_j z_k over the joints of chain c, l the deepest of i, j, k and
the other two turning joints: |a_i × (a_j × b_l)| ≤ |b_l| ≤ ρ_l. For ρ_l take the smaller of the length of the
chain from o_l to the tip with its slides over the box, and |b_l| at the centre + Σ_{k deeper} ρ_k W_k (the distance
of the tip from axis l depends on deeper joints only, and at a rate of at most ρ_k). Slides have ρ = 1. Only products
of the third-order terms with vectors are formed: Z̄R and Zw are what Theorem K asks for.

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

from typing import NamedTuple, Protocol

import numpy as np

from ccpin.arrays import Array, Indices, Mask, apply, rows_of
from ccpin.proof.chains import ChainStack, Derivatives, gather

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


class Bounds(Protocol):
    """Y, Z̄ and Z of B boxes."""

    @property
    def y(self) -> Array:
        """Y ≥ |f(δ, 0)|, of shape (B, m)."""

    def mean(self, radius: Array) -> Image:
        """Z̄(R)R ≤ `.of(R)` for radii (B, m); both parts grow with R."""

    def contraction(self, radius: Array, weight: Array) -> Image:
        """Z(R)w ≤ `.of(w)` for radii and weights (B, m); the rest is linear in w."""

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


class ReachBounds(NamedTuple):
    """Reach bounds of B boxes (`Bounds`).

    Attributes:
        stack: The chains.
        linear: The shared part.
        y: Y, of shape (B, m).
        mixed: |N|, of shape (B, m, m, p + m).
        gains: g, of shape (B, m, C).
        position: |θ|, of shape (B, C, k).
        arms: |b|, of shape (B, C, k).
    """

    stack: ChainStack
    linear: LinearPart
    y: Array
    mixed: Array
    gains: Array
    position: Array
    arms: Array

    def take(self, rows: Rows) -> ReachBounds:
        """See `Bounds`."""
        return ReachBounds(self.stack, rows_of(self.linear, rows), *(array[rows] for array in self[2:]))

    def mean(self, radius: Array) -> Image:
        """See `Bounds`."""
        widths = self.linear.widths(radius)
        reach = self._reach(self.linear.moves + widths)
        moves, width = gather(self.stack, self.linear.moves), gather(self.stack, widths)
        third = _trilinear(self.stack, reach, moves, moves, width)
        third += _trilinear(self.stack, reach, moves, width, width)
        third += _trilinear(self.stack, reach, width, width, width) / 3.0
        return Image(self.linear.affine(widths) + self._first(0.5 * radius), 0.5 * apply(self.gains, third))

    def contraction(self, radius: Array, weight: Array) -> Image:
        """See `Bounds`."""
        widths = self.linear.widths(radius)
        box = self.linear.moves + widths
        moves = gather(self.stack, box)
        third = _trilinear(self.stack, self._reach(box), moves, moves, gather(self.stack, self.linear.widths(weight)))
        return Image(self.linear.affine(widths) + self._first(radius), 0.5 * apply(self.gains, third))

    def curvature(self, radius: Array, weight: Array) -> Array:
        """See `Bounds`."""
        second = (self.mixed[..., -weight.shape[1] :] @ weight[:, None, :, None])[..., 0]
        centre = apply(second, weight)
        box, turn = self.linear.moves + self.linear.widths(radius), gather(self.stack, self.linear.widths(weight))
        third = _trilinear(self.stack, self._reach(box), gather(self.stack, box), turn, turn)
        return np.asarray(centre + apply(self.gains, third) + self.linear.curvature_margin(weight))

    def _first(self, radius: Array) -> Array:
        width = np.concatenate([self.linear.half, radius], axis=1)
        return np.asarray((self.mixed @ width[:, None, :, None])[..., 0])

    def _reach(self, box: Array) -> Array:
        return chain_reach(self.stack, self.arms, self.position, gather(self.stack, box), self.linear.rounding)


def reach_bounds(stack: ChainStack, theta: Array, values: Derivatives, frame: Frame) -> ReachBounds:
    """Reach bounds of boxes centred at θ (B, n′) with the derivatives there."""
    linear = linear_part(frame, values.phi, values.jacobian)
    count, m, size = values.jacobian.shape
    second = (frame.preconditioner @ values.hessian.reshape(count, m, size**2)).reshape(values.hessian.shape)
    directions, half = frame.directions[:, None], frame.half[:, None]
    quadratic = np.abs(np.swapaxes(directions, 2, 3) @ (second @ directions))
    square = (half[..., None, :] @ quadratic @ half[..., None])[..., 0, 0]
    along = np.swapaxes(second @ frame.modes[:, None], 2, 3)
    mixed = np.abs(along @ np.concatenate([frame.directions, frame.modes], axis=2)[:, None])
    gains = np.swapaxes(np.linalg.norm(frame.preconditioner[:, None] @ stack.weights, axis=3), 1, 2)
    position, moves = gather(stack, np.abs(theta)), gather(stack, linear.moves)
    third = _trilinear(stack, chain_reach(stack, values.arms, position, moves, frame.rounding), moves, moves, moves)
    y = linear.constant + 0.5 * square + apply(gains, third) / 6.0
    return ReachBounds(stack, linear, y, mixed, gains, position, values.arms)


def chain_reach(stack: ChainStack, arms: Array, position: Array, box: Array, rounding: Array) -> Array:
    """ρ ≥ |b_l| for every joint wherever the joints move by at most `box`; everything of shape (B, C, k).

    Args:
        stack: The chains.
        arms: |b_l| at the centre, with errors of at most `rounding` (B,).
        position: |θ| at the centre, for slides.
        box: The joints' moves.
        rounding: Of shape (B,).
    """
    reach = np.empty_like(arms)
    slide_reach = stack.sliding * stack.points[:, None]
    travel = slide_reach * (position + box)
    lengths = np.linalg.norm(stack.translations, axis=2) * stack.points[:, None]
    length = np.broadcast_to(np.linalg.norm(stack.tips, axis=1), arms.shape[:2])
    drift = np.zeros(arms.shape[:2])
    for j in reversed(range(arms.shape[2])):
        length = length + travel[..., j]
        shorter = np.minimum(length, arms[..., j] + rounding[:, None] + drift)
        reach[..., j] = stack.turning[:, j] * shorter + slide_reach[:, j]
        drift = drift + reach[..., j] * box[..., j]
        length = length + lengths[:, j]
    return reach


def _trilinear(stack: ChainStack, reach: Array, x: Array, y: Array, z: Array) -> Array:
    """T_c(x, y, z), of shape (B, C): by deepest joint, the other two summed over turning joints not deeper."""
    x_turn, y_turn, z_turn = x * stack.turning, y * stack.turning, z * stack.turning
    y_to, z_to = np.cumsum(y_turn, axis=2), np.cumsum(z_turn, axis=2)
    x_above, y_above = np.zeros_like(x), np.zeros_like(y)
    x_above[..., 1:], y_above[..., 1:] = np.cumsum(x_turn, axis=2)[..., :-1], y_to[..., :-1]
    return np.asarray(np.sum(reach * ((x * y_to + x_above * y) * z_to + x_above * y_above * z), axis=2))
