"""Closures as plain arrays: φ(θ) = Σ_c B_c x_c(θ) + G θ + d, and their derivatives over many configurations at once.

x_c is the tip of a serial chain: a point, or a fixed direction. The derivatives of a tip follow from its joints in the
order root to tip, with axes a, origins o and b = a × (x − o) for a revolute joint of a point chain, a × x of a
direction chain, a for a prismatic joint of a point chain, 0 of a direction chain: for joints j₁ ≤ … ≤ j_k along the
chain

    ∂ᵏx/∂θ_{j₁}…∂θ_{j_k} = a_{j₁} × (… × (a_{j_{k−1}} × b_{j_k})),

zero if any but the deepest, j_k, is prismatic (moving along a fixed axis turns nothing), or if a prismatic j_k
is repeated. Chains stand side by side, padded to one length, so that one sweep moves all of them.

Nothing here knows a mechanism: a `ClosureSystem` is picklable and is what worker processes receive.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, Mask
from ccpin.proof.rounding import UNIT_ROUNDOFF


class Chain(NamedTuple):
    """One chain of k joints, root to tip.

    Attributes:
        joints: Indices in θ, of shape (k,), each once.
        rotations, translations: Frame of a joint before it moves, in the frame of the one above after it has
            moved (the root's for the first), of shapes (k, 3, 3) and (k, 3).
        axes: Unit axes in the joint's own frame, of shape (k, 3).
        prismatic: Whether a joint slides, of shape (k,).
        tip: The tip in the last joint's frame (m, or unit direction), of shape (3,).
        direction: Whether the tip is a direction.
        weights: B_c, of shape (m, 3), in root axes.
    """

    joints: Indices
    rotations: Array
    translations: Array
    axes: Array
    prismatic: Mask
    tip: Array
    direction: bool
    weights: Array


@dataclass(frozen=True, eq=False)
class ClosureSystem:
    """Closures in scalar coordinates θ (n′,), of which n are independent and m = n′ − n depend.

    Attributes:
        chains: The chains c.
        couplings: G, of shape (m, n′): linear couplings.
        offset: d, of shape (m,).
        moduli: Of shape (m,): a coupling of continuous joints holds modulo this angle (0: exactly).
        independent, dependent: Indices in θ, of shapes (n,) and (m,).
        periodic: Whether θ + 2π e_j means the same configuration and the same closures, of shape (n′,).
    """

    chains: tuple[Chain, ...]
    couplings: Array
    offset: Array
    moduli: Array
    independent: Indices
    dependent: Indices
    periodic: Mask

    @property
    def n(self) -> int:
        """Number of independent coordinates."""
        return len(self.independent)

    @property
    def m(self) -> int:
        """Number of dependent coordinates and of closure rows."""
        return len(self.dependent)

    @property
    def n_free(self) -> int:
        """The size of θ."""
        return int(self.couplings.shape[1])

    @cached_property
    def scale(self) -> float:
        """An upper bound of every length that enters φ apart from slides, for rounding margins, at least 1 (m).

        It is the sum of all link lengths, directions and offsets with their weights.
        """
        scale = 1.0 + float(np.abs(self.offset).sum() + np.abs(self.couplings).sum())
        for chain in self.chains:
            length = np.linalg.norm(chain.translations, axis=1).sum() + np.linalg.norm(chain.tip)
            scale += float(length) * _largest_row(chain)
        return scale

    @cached_property
    def _slides(self) -> tuple[tuple[Indices, float], ...]:
        """The joints of each chain that slide, where there are any, and the length of the largest row of B_c."""
        sliding = (chain for chain in self.chains if np.any(chain.prismatic))
        return tuple((chain.joints[chain.prismatic], _largest_row(chain)) for chain in sliding)

    @property
    def depth(self) -> int:
        """The largest number of joints in a chain."""
        return max((len(chain.joints) for chain in self.chains), default=0)

    @property
    def rounding(self) -> float:
        """γ: |computed − exact| ≤ γ · `magnitude` for every entry of φ, its Jacobian and its second derivative.

        Each joint costs a 3×3 product, one sine and one cosine: fewer than 40 roundings of quantities at most 1
        or the reach; 64u a joint (and as much again for placements that are orthogonal to rounding only) is ample.
        Products of the bounds with n′×n′ matrices add 4u a column.
        """
        return (128.0 * (self.depth + 2) + 4.0 * self.n_free) * UNIT_ROUNDOFF

    def magnitude(self, theta: Array) -> Array:
        """An upper bound of every length in φ at θ (B, n′): `scale` and the slides, of shape (B,).

        Beyond 4 rad it grows with the angles: planar bounds add them up, with the roundings of so large numbers.
        """
        total = np.full(len(theta), self.scale)
        for joints, gain in self._slides:
            total += np.abs(theta[:, joints]).sum(axis=1) * gain
        return np.asarray(total * np.maximum(1.0, 0.25 * np.abs(theta).max(axis=1)))


def _largest_row(chain: Chain) -> float:
    """The length of the largest row of B_c, at least 1."""
    return float(np.linalg.norm(chain.weights, axis=1).max(initial=1.0))


class ChainStack(NamedTuple):
    """C chains, padded on the root side to the same number k of joints.

    Attributes:
        joints: Indices in θ with a zero appended (n′ where padded), of shape (C, k).
        placement: Which θ an entry belongs to, of shape (C · k, n′), one-hot rows, zero where padded.
        rotations, translations, axes: As in `Chain`, of shapes (C, k, 3, 3), (C, k, 3), (C, k, 3).
        turning, sliding: 1.0 where a joint turns or slides (both 0 where padded), of shape (C, k).
        tips: Of shape (C, 3).
        points: 1.0 for points, 0.0 for directions, of shape (C,).
        weights: Of shape (C, m, 3).
    """

    joints: Indices
    placement: Array
    rotations: Array
    translations: Array
    axes: Array
    turning: Array
    sliding: Array
    tips: Array
    points: Array
    weights: Array


def stack_chains(chains: tuple[Chain, ...], n_free: int, rows: int) -> ChainStack:
    """Pad chains in θ of size n′ that enter m rows; there may be none (couplings alone)."""
    count, k = len(chains), max((len(chain.joints) for chain in chains), default=0)
    joints = np.full((count, k), n_free, dtype=np.intp)
    rotations, translations = np.tile(np.eye(3), (count, k, 1, 1)), np.zeros((count, k, 3))
    axes, turning, sliding = np.zeros((count, k, 3)), np.zeros((count, k)), np.zeros((count, k))
    for row, chain in enumerate(chains):
        window = slice(k - len(chain.joints), k)
        joints[row, window] = chain.joints
        rotations[row, window], translations[row, window] = chain.rotations, chain.translations
        axes[row, window] = chain.axes
        turning[row, window], sliding[row, window] = ~chain.prismatic, chain.prismatic
    return ChainStack(
        joints=joints,
        placement=np.eye(n_free + 1)[joints.ravel(), :n_free],
        rotations=rotations,
        translations=translations,
        axes=axes,
        turning=turning,
        sliding=sliding,
        tips=np.array([chain.tip for chain in chains]).reshape(count, 3),
        points=np.array([0.0 if chain.direction else 1.0 for chain in chains]),
        weights=np.array([chain.weights for chain in chains]).reshape(count, rows, 3),
    )


def gather(stack: ChainStack, values: Array) -> Array:
    """Values of joints (B, n′) by chain and joint, of shape (B, C, k), zero where padded."""
    padded = np.concatenate([values, np.zeros((len(values), 1))], axis=1)
    return np.asarray(padded[:, stack.joints])
