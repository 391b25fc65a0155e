"""Reach bounds: third derivatives of closures over boxes, from link lengths alone, for any tree.

For joints j₁ ≤ … ≤ j_k along a chain ∂ᵏx/∂θ_{j₁}…∂θ_{j_k} = a_{j₁} × (… × (a_{j_{k−1}} × b_{j_k})), zero if any but the
deepest slides. So with g_ic = ‖row i of AB_c‖

    T(x, y, z) = Σ_c g_c Σ ρ_l x_i y_j z_k   over the joints of chain c, l the deepest of i, j, k, the others turning,

since |a_i × (a_j × b_l)| ≤ |b_l| ≤ ρ_l. For ρ_l take the smaller of the length of the chain from o_l to the tip with
its slides over the box, and |b_l| at the centre + Σ_{k deeper} ρ_k X_k (the distance of the tip from axis l depends on
deeper joints only, and at a rate of at most ρ_k). Slides have ρ = 1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ccpin.arrays import Array, Indices, apply
from ccpin.proof.bounds import Rows
from ccpin.proof.chains import ChainStack
from ccpin.proof.taylor import Form
from ccpin.proof.tips import by_joint


@dataclass(frozen=True, eq=False)
class ChainLengths:
    """Lengths in a stack of chains: of links behind joints (k, C, 1), tips (C, 1); 1.0 where slides move a point.

    `joints` and `turning` are those of `Turns`.
    """

    joints: Indices
    turning: Array
    links: Array
    tips: Array
    travelling: Array

    @classmethod
    def of(cls, stack: ChainStack) -> ChainLengths:
        """Of a stack of chains."""
        points = stack.points[:, None]
        links = np.linalg.norm(stack.translations, axis=2) * points
        tips, travelling = np.linalg.norm(stack.tips, axis=1), stack.sliding * points
        turning = stack.turning.T[..., None]
        return cls(stack.joints.T, turning, links.T[..., None], tips[:, None], travelling.T[..., None])

    def reach(self, arms: Array, position: Array, box: Array, rounding: Array) -> Array:
        """ρ ≥ |b_l| of every joint wherever the joints move by at most `box`; everything of shape (k, C, B).

        Args:
            arms: |b_l| at the centre, with errors of at most `rounding` (B,).
            position: |θ| at the centre, for slides.
            box: The joints' moves.
            rounding: Of shape (B,).
        """
        reach, travel = np.empty_like(arms), self.travelling * (position + box)
        length, drift = np.broadcast_to(self.tips, arms.shape[1:]), np.zeros(arms.shape[1:])
        for j in reversed(range(len(arms))):
            length = length + travel[j]
            shorter = np.minimum(length, arms[j] + rounding + drift)
            reach[j] = self.turning[j] * shorter + self.travelling[j]
            drift = drift + reach[j] * box[j]
            length = length + self.links[j]
        return reach


def trilinear(turning: Array, reach: Array, x: Array, y: Array, z: Array) -> Array:
    """T_c(x, y, z), of shape (C, B): by deepest joint, the other two summed over turning joints not deeper."""
    total = x_above = y_above = y_to = z_to = np.zeros(reach.shape[1:])
    for j in range(len(reach)):
        y_to, z_to = y_to + y[j] * turning[j], z_to + z[j] * turning[j]
        total = total + reach[j] * ((x[j] * y_to + x_above * y[j]) * z_to + x_above * y_above * z[j])
        x_above, y_above = x_above + x[j] * turning[j], y_to
    return total


@dataclass(frozen=True, eq=False)
class ReachDrift:
    """T of B centres (`DriftBound`).

    Attributes:
        lengths: Of the chains.
        gains: g, of shape (B, M, C).
        position: |θ|, of shape (k, C, B).
        arms: |b|, of shape (k, C, B).
        rounding: Of shape (B,).
    """

    lengths: ChainLengths
    gains: Array
    position: Array
    arms: Array
    rounding: Array

    def over(self, box: Array) -> Form:
        """See `DriftBound`."""
        joints, turning = self.lengths.joints, self.lengths.turning
        reach = self.lengths.reach(self.arms, self.position, by_joint(joints, box), self.rounding)

        def form(x: Array, y: Array, z: Array) -> Array:
            total = trilinear(turning, reach, *(by_joint(joints, vector) for vector in (x, y, z)))
            return apply(self.gains, total.T)

        return form

    def take(self, rows: Rows) -> ReachDrift:
        """See `DriftBound`."""
        position, arms = self.position[..., rows], self.arms[..., rows]
        return replace(self, gains=self.gains[rows], position=position, arms=arms, rounding=self.rounding[rows])


def chain_reach(stack: ChainStack, arms: Array, position: Array, box: Array, rounding: Array) -> Array:
    """`ChainLengths.reach` with the configurations first: everything of shape (B, C, k)."""
    arms, position, box = (np.transpose(values, (2, 1, 0)) for values in (arms, position, box))
    found = ChainLengths.of(stack).reach(arms, position, box, rounding)
    return np.ascontiguousarray(np.transpose(found, (2, 1, 0)))
