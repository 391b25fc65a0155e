"""Reach bounds: for any tree, from the exact second derivatives at the centre and link lengths (see `bounds`)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, apply, rows_of
from ccpin.domain.bounds import Frame, Image, LinearPart, Rows, linear_part
from ccpin.domain.chain_stack import ChainStack, Derivatives, gather


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
