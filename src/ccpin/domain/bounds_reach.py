"""Reach bounds: for any tree, from the exact second derivatives at the centre and link lengths (see `bounds`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccpin.domain.bounds import Frame, Image, LinearPart, Rows, linear_part
from ccpin.domain.chains import ClosureSystem
from ccpin.domain.derivatives import Derivatives

Array = NDArray[np.float64]


class ChainStack(NamedTuple):
    """The C chains of a system side by side, padded on the root side to the same number k of joints.

    Attributes:
        joints: Indices in θ with a zero appended (n′ where padded), of shape (C, k).
        turning: 1.0 where a joint turns, of shape (C, k).
        slide_reach: 1.0 where a joint slides a point, of shape (C, k).
        lengths: |translation| to a joint from the one above (0 for directions), of shape (C, k).
        tip: |tip|, of shape (C,).
    """

    joints: NDArray[np.intp]
    turning: Array
    slide_reach: Array
    lengths: Array
    tip: Array


def stack_chains(system: ClosureSystem) -> ChainStack:
    """Pad the chains of a system."""
    k = max(system.depth, 1)
    shape = (len(system.chains), k)
    joints = np.full(shape, system.n_free, dtype=np.intp)
    turning, sliding, lengths = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    for row, chain in enumerate(system.chains):
        window = slice(k - len(chain.joints), k)
        joints[row, window] = chain.joints
        turning[row, window] = ~chain.prismatic
        if not chain.direction:
            sliding[row, window] = chain.prismatic
            lengths[row, window] = np.linalg.norm(chain.translations, axis=1)
    return ChainStack(joints, turning, sliding, lengths, np.array([np.linalg.norm(c.tip) for c in system.chains]))


class _Terms(NamedTuple):
    """Per-box arrays: Y (B, m), |N| (B, m, m, p + m), g (B, m, C), |θ| (B, C, k), |b| (B, C, k)."""

    linear: LinearPart
    y: Array
    mixed: Array
    gains: Array
    position: Array
    arms: Array


@dataclass(frozen=True, eq=False)
class ReachBounds:
    """Reach bounds of B boxes."""

    stack: ChainStack
    terms: _Terms

    @property
    def y(self) -> Array:
        """See `Bounds`."""
        return self.terms.y

    def take(self, rows: Rows) -> ReachBounds:
        """See `Bounds`."""
        linear = LinearPart(*(array[rows] for array in self.terms.linear))
        return ReachBounds(self.stack, _Terms(linear, *(array[rows] for array in self.terms[1:])))

    def mean(self, radius: Array) -> Image:
        """See `Bounds`."""
        linear = self.terms.linear
        widths = linear.widths(radius)
        reach = self._reach(linear.moves + widths)
        moves, width = self._gather(linear.moves), self._gather(widths)
        third = _trilinear(self.stack, reach, moves, moves, width)
        third += _trilinear(self.stack, reach, moves, width, width)
        third += _trilinear(self.stack, reach, width, width, width) / 3.0
        return Image(linear.affine(widths) + self._first(0.5 * radius), 0.5 * self._weighted(third))

    def contraction(self, radius: Array, weight: Array) -> Image:
        """See `Bounds`."""
        linear = self.terms.linear
        widths = linear.widths(radius)
        box = linear.moves + widths
        moves = self._gather(box)
        third = _trilinear(self.stack, self._reach(box), moves, moves, self._gather(linear.widths(weight)))
        return Image(linear.affine(widths) + self._first(radius), 0.5 * self._weighted(third))

    def curvature(self, radius: Array, weight: Array) -> Array:
        """See `Bounds`."""
        linear = self.terms.linear
        second = (self.terms.mixed[..., -weight.shape[1] :] @ weight[:, None, :, None])[..., 0]
        centre = (second @ weight[..., None])[..., 0]
        box, turn = linear.moves + linear.widths(radius), self._gather(linear.widths(weight))
        third = _trilinear(self.stack, self._reach(box), self._gather(box), turn, turn)
        return np.asarray(centre + self._weighted(third) + linear.curvature_margin(weight))

    def _first(self, radius: Array) -> Array:
        width = np.concatenate([self.terms.linear.half, radius], axis=1)
        return np.asarray((self.terms.mixed @ width[:, None, :, None])[..., 0])

    def _weighted(self, third: Array) -> Array:
        """Σ_c g_c T_c, of shape (B, m)."""
        return np.asarray((self.terms.gains @ third[..., None])[..., 0])

    def _gather(self, moves: Array) -> Array:
        return _gather(self.stack, moves)

    def _reach(self, box: Array) -> Array:
        return chain_reach(
            self.stack, self.terms.arms, self.terms.position, self._gather(box), self.terms.linear.rounding
        )


def reach_bounds(
    system: ClosureSystem, stack: ChainStack, theta: Array, values: Derivatives, frame: Frame
) -> ReachBounds:
    """Reach bounds of boxes centred at θ (B, n′) with the derivatives there."""
    linear = linear_part(frame, values.phi, values.jacobian)
    count, m, n_free = values.jacobian.shape
    second = (frame.preconditioner @ values.hessian.reshape(count, m, -1)).reshape(count, m, n_free, n_free)
    directions, half = frame.directions[:, None], frame.half[:, None]
    quadratic = np.abs(np.swapaxes(directions, 2, 3) @ (second @ directions))
    square = (half[..., None, :] @ quadratic @ half[..., None])[..., 0, 0]
    along = np.swapaxes(second @ frame.modes[:, None], 2, 3)
    mixed = np.abs(along @ np.concatenate([frame.directions, frame.modes], axis=2)[:, None])
    shape = (count, *stack.joints.shape)
    arms, gains = np.zeros(shape), np.zeros((count, m, shape[1]))
    for row, (chain, motion) in enumerate(zip(system.chains, values.motions, strict=True)):
        arms[:, row, shape[2] - len(chain.joints) :] = np.linalg.norm(motion.b, axis=2)
        gains[:, :, row] = np.linalg.norm(frame.preconditioner @ chain.weights, axis=2)
    position = _gather(stack, np.abs(theta))
    moves = _gather(stack, linear.moves)
    third = _trilinear(stack, chain_reach(stack, arms, position, moves, frame.rounding), moves, moves, moves)
    y = linear.constant + 0.5 * square + (gains @ third[..., None])[..., 0] / 6.0
    return ReachBounds(stack, _Terms(linear, y, mixed, gains, position, arms))


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
    travel = stack.slide_reach * (position + box)
    length = np.broadcast_to(stack.tip, arms.shape[:2])
    drift = np.zeros(arms.shape[:2])
    for j in reversed(range(arms.shape[2])):
        length = length + travel[..., j]
        shorter = np.minimum(length, arms[..., j] + rounding[:, None] + drift)
        reach[..., j] = stack.turning[:, j] * shorter + stack.slide_reach[:, j]
        drift = drift + reach[..., j] * box[..., j]
        length = length + stack.lengths[:, j]
    return reach


def _gather(stack: ChainStack, moves: Array) -> Array:
    """Moves (B, n′) by chain and joint, of shape (B, C, k), zero where padded."""
    padded = np.concatenate([moves, np.zeros((len(moves), 1))], axis=1)
    return np.asarray(padded[:, stack.joints])


def _trilinear(stack: ChainStack, reach: Array, x: Array, y: Array, z: Array) -> Array:
    """T_c(x, y, z), of shape (B, C): by deepest joint, the other two summed over turning joints not deeper."""
    x_turn, y_turn, z_turn = x * stack.turning, y * stack.turning, z * stack.turning
    y_to, z_to = np.cumsum(y_turn, axis=2), np.cumsum(z_turn, axis=2)
    x_above, y_above = np.zeros_like(x), np.zeros_like(y)
    x_above[..., 1:], y_above[..., 1:] = np.cumsum(x_turn, axis=2)[..., :-1], y_to[..., :-1]
    return np.asarray(np.sum(reach * ((x * y_to + x_above * y) * z_to + x_above * y_above * z), axis=2))
