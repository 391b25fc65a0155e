"""Tips of serial chains and their derivatives, for many configurations at once: arrays have the configurations last.

Chains are padded on the root side to one length (`ccpin.proof.chains`); with the configurations last every operation
runs along memory, and one sweep moves all chains. A turn about a, after the constant rotation R, is
(R a)aᵀ + cos θ (R − (R a)aᵀ) + sin θ R[a]×: three constant matrices a joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, skew
from ccpin.proof.chains import ChainStack


class SweptChains(NamedTuple):
    """C chains of k joints at B configurations.

    Attributes:
        x: Tips, of shape (3, C, B).
        a: Axes of turning joints, zero elsewhere, of shape (3, k, C, B).
        b: ∂x/∂θ_j, of shape (3, k, C, B).
    """

    x: Array
    a: Array
    b: Array


class Turns(NamedTuple):
    """The constants of a sweep, of shapes (k, …, C, 1).

    Attributes:
        joints: Indices in θ with a zero appended, of shape (k, C).
        still, cosine, sine: The parts of a joint's rotation, of shape (k, 3, 3, C, 1).
        axes, translations: R a, and where the joint is in the frame above, of shape (k, 3, C, 1).
        turning, sliding: 1.0 where a joint turns or slides, of shape (k, C, 1).
        tips: Of shape (3, C, 1).
        points: 1.0 for points, 0.0 for directions, of shape (C, 1).
    """

    joints: Indices
    still: Array
    cosine: Array
    sine: Array
    axes: Array
    translations: Array
    turning: Array
    sliding: Array
    tips: Array
    points: Array


def turns_of(stack: ChainStack) -> Turns:
    """The constants of a stack of chains."""
    axes = (stack.rotations @ stack.axes[..., None])[..., 0]
    turning = stack.turning[..., None, None] > 0.0
    along = axes[..., :, None] * stack.axes[..., None, :]
    return Turns(
        joints=np.ascontiguousarray(stack.joints.T),
        still=_last(np.where(turning, along, stack.rotations)),
        cosine=_last(np.where(turning, stack.rotations - along, 0.0)),
        sine=_last(np.where(turning, stack.rotations @ skew(stack.axes), 0.0)),
        axes=_last(axes),
        translations=_last(stack.translations),
        turning=_last(stack.turning),
        sliding=_last(stack.sliding),
        tips=np.ascontiguousarray(stack.tips.T)[..., None],
        points=stack.points[:, None],
    )


def _last(array: Array) -> Array:
    """(C, k, …) as (k, …, C, 1)."""
    return np.ascontiguousarray(np.moveaxis(np.swapaxes(array, 0, 1), 1, -1))[..., None]


def by_joint(joints: Indices, values: Array) -> Array:
    """Values (B, n′) of joints (k, C), n′ where padded: by joint and chain, of shape (k, C, B), zero where padded."""
    return np.asarray(np.concatenate([values.T, np.zeros((1, len(values)))])[joints])


def positions(turns: Turns, theta: Array) -> Array:
    """Tips at θ (B, n′), of shape (3, C, B): from the tips to the root, as no axes are asked for."""
    angles = by_joint(turns.joints, theta)
    cosine, sine, slides = np.cos(angles), np.sin(angles), angles * turns.sliding
    x = np.broadcast_to(turns.tips, (3, *angles.shape[1:]))
    for j in reversed(range(len(angles))):
        turned = cosine[j] * _times(turns.cosine[j], x)
        turned += sine[j] * _times(turns.sine[j], x)
        turned += _times(turns.still[j], x)
        x = turned + turns.points * (turns.translations[j] + turns.axes[j] * slides[j])
    return x


def sweep(turns: Turns, theta: Array) -> SweptChains:
    """Move all chains from root to tip at θ (B, n′)."""
    angles = by_joint(turns.joints, theta)
    cosine, sine, slides = np.cos(angles), np.sin(angles), angles * turns.sliding
    axes, origins = np.empty((3, *angles.shape)), np.empty((3, *angles.shape))
    turn, origin = np.broadcast_to(np.eye(3)[..., None, None], (3, 3, *angles.shape[1:])), np.zeros((3, 1, 1))
    for j in range(len(angles)):
        origins[:, j] = origin = origin + _times(turn, turns.translations[j])
        axes[:, j] = _times(turn, turns.axes[j])
        origin = origin + slides[j] * axes[:, j]
        own = turns.cosine[j] * cosine[j]
        own += turns.sine[j] * sine[j]
        own += turns.still[j]
        turn = _times(turn[:, :, None], own)
    tip = _times(turn, turns.tips) + turns.points * origin
    turning = axes * turns.turning
    b = crossed(turning, tip[:, None] - turns.points * origins)
    b += axes * (turns.sliding * turns.points)
    return SweptChains(tip, turning, b)


def _times(matrix: Array, vector: Array) -> Array:
    """A matrix, its columns along the second axis, times a vector along the first: three products and two sums."""
    product = matrix[:, 0] * vector[0]
    product += matrix[:, 1] * vector[1]
    product += matrix[:, 2] * vector[2]
    return np.asarray(product)


def crossed(u: Array, v: Array) -> Array:
    """u × v along the first axis."""
    result = np.empty_like(u)
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        np.multiply(u[j], v[k], out=result[i])
        result[i] -= u[k] * v[j]
    return result


# From vectors by joint (or by two joints) to rows of φ: sums of products with the rows of B_c.


class Rows:
    """Sums of w·v over vectors v (3, S, B): what enters a row of φ, or one entry of its derivatives.

    Attributes:
        places: The numbers of the sums, ascending, of shape (L,).
    """

    def __init__(self, products: Sequence[tuple[int, int, Array]]) -> None:
        """From (number of the sum, which vector, w)."""
        ordered = sorted(products, key=lambda product: product[0])
        self.places, count = np.unique(np.array([p[0] for p in ordered], dtype=np.intp), return_counts=True)
        self._source = np.array([product[1] for product in ordered], dtype=np.intp)
        self._weight = np.array([product[2] for product in ordered]).reshape(-1, 3).T[..., None].copy()
        self._layers = layers(count)

    def sums(self, vectors: Array) -> Array:
        """The sums, of shape (L, B)."""
        product = self._weight[0] * vectors[0, self._source]
        product += self._weight[1] * vectors[1, self._source]
        product += self._weight[2] * vectors[2, self._source]
        total = product[self._layers[0][1]]
        for to, layer in self._layers[1:]:
            total[to] += product[layer]
        return np.asarray(total)


def layers(count: Indices) -> tuple[tuple[Indices, Indices], ...]:
    """For r = 0, 1, … which of some sums have an r-th term, and its place among all terms, one sum after the other."""
    first = np.cumsum(count) - count
    sums = [np.flatnonzero(count > r) for r in range(int(count.max(initial=1)))]
    return tuple((some, first[some] + r) for r, some in enumerate(sums))


# The same with the configurations first.


class StackMotion(NamedTuple):
    """The chains at B configurations.

    Attributes:
        x: Tips, of shape (B, C, 3).
        a: Axes of turning joints, zero elsewhere, of shape (B, C, k, 3).
        b: ∂x/∂θ_j, of shape (B, C, k, 3).
    """

    x: Array
    a: Array
    b: Array


def move(stack: ChainStack, theta: Array) -> StackMotion:
    """The chains at θ of shape (B, n′)."""
    return moved(turns_of(stack), theta)


def moved(turns: Turns, theta: Array) -> StackMotion:
    """The same, where the constants are known."""
    motion = sweep(turns, theta)
    a, b = (np.ascontiguousarray(np.transpose(vectors, (3, 2, 1, 0))) for vectors in (motion.a, motion.b))
    return StackMotion(np.ascontiguousarray(np.transpose(motion.x, (2, 1, 0))), a, b)
