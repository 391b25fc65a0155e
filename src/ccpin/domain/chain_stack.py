"""Chains side by side, padded to one length, so that one sweep moves all of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, apply, cross, skew
from ccpin.domain.chains import Chain, ClosureSystem


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


def move(stack: ChainStack, theta: Array) -> StackMotion:
    """Sweep all chains from root to tip at θ of shape (B, n′)."""
    angles = gather(stack, theta)
    count, chains, k = angles.shape
    turns = angles * stack.turning
    sines, versines = np.sin(turns)[..., None, None], (2.0 * np.sin(0.5 * turns) ** 2)[..., None, None]
    slides = (angles * stack.sliding)[..., None]
    crosses = skew(stack.axes)
    axes, origins = np.empty((count, chains, k, 3)), np.empty((count, chains, k, 3))
    turn, origin = np.broadcast_to(np.eye(3), (count, chains, 3, 3)), np.zeros((count, chains, 3))
    for j in range(k):
        origin = origin + apply(turn, stack.translations[:, j])
        turn = turn @ stack.rotations[:, j]
        axis = apply(turn, stack.axes[:, j])
        axes[:, :, j], origins[:, :, j] = axis, origin
        origin = origin + slides[:, :, j] * axis
        turned = turn @ crosses[:, j]
        turn = turn + sines[:, :, j] * turned + versines[:, :, j] * (turned @ crosses[:, j])
    points = stack.points[:, None]
    tip = apply(turn, stack.tips) + points * origin
    arms = tip[:, :, None] - points[:, None] * origins
    turning = axes * stack.turning[..., None]
    b = cross(turning, arms) + axes * (stack.sliding * points)[..., None]
    return StackMotion(tip, turning, b)


# φ, φ_θ and φ_θθ of a closure system over a batch of configurations.


class Derivatives(NamedTuple):
    """φ (B, m), φ_θ (B, m, n′), φ_θθ (B, m, n′, n′) and |∂x_c/∂θ_j| of the chains (B, C, k)."""

    phi: Array
    jacobian: Array
    hessian: Array
    arms: Array


def derivatives(system: ClosureSystem, stack: ChainStack, theta: Array) -> Derivatives:
    """φ, φ_θ and φ_θθ at θ (B, n′)."""
    phi, jacobian, motion = first_order(system, stack, theta)
    hessian = np.zeros((len(theta), system.m, system.n_free, system.n_free))
    second = _second(motion)
    k = stack.joints.shape[1]
    for row, chain in enumerate(system.chains):
        rows = np.flatnonzero(np.any(chain.weights != 0.0, axis=1))
        first = k - len(chain.joints)
        part = second[:, row, first:, first:] @ chain.weights[rows].T
        hessian[np.ix_(np.arange(len(theta)), rows, chain.joints, chain.joints)] += np.moveaxis(part, 3, 1)
    return Derivatives(phi, jacobian, hessian, np.linalg.norm(motion.b, axis=3))


def first_order(system: ClosureSystem, stack: ChainStack, theta: Array) -> tuple[Array, Array, StackMotion]:
    """φ (B, m), φ_θ (B, m, n′) and the chains at θ (B, n′)."""
    motion = move(stack, theta)
    phi = (theta[:, None] @ system.couplings.T)[:, 0] + system.offset
    for row in np.flatnonzero(system.moduli):
        phi[:, row] -= system.moduli[row] * np.round(phi[:, row] / system.moduli[row])
    phi = phi + np.sum(apply(stack.weights, motion.x), axis=1)
    columns = motion.b @ np.swapaxes(stack.weights, 1, 2)
    flat = columns.reshape(len(theta), stack.joints.size, system.m)
    return phi, system.couplings + np.swapaxes(flat, 1, 2) @ stack.placement, motion


def _second(motion: StackMotion) -> Array:
    """∂²x/∂θ_i∂θ_j = a_i × b_j for i ≤ j along the chain, of shape (B, C, k, k, 3)."""
    product = cross(motion.a[:, :, :, None], motion.b[:, :, None])
    upper = np.triu(np.ones(product.shape[2:4], dtype=np.bool_))
    return np.where(upper[:, :, None], product, np.swapaxes(product, 2, 3))


def third_along(system: ClosureSystem, stack: ChainStack, theta: Array, turn: Array) -> Array:
    """Σ_k ∂³φ/∂θ_i∂θ_j∂θ_k v_k at θ (B, n′) for v of shape (B, n′), of shape (B, m, n′, n′)."""
    motion, rates = move(stack, theta), gather(stack, turn)
    k, size = stack.joints.shape[1], system.n_free
    first, middle, last = np.sort(np.indices((k, k, k)).reshape(3, -1), axis=0)
    product = cross(motion.a[:, :, first], cross(motion.a[:, :, middle], motion.b[:, :, last]))
    tensor = product.reshape(*motion.b.shape[:2], k * k, k, 3)
    turned = (rates[:, :, None, None] @ tensor)[..., 0, :] @ np.swapaxes(stack.weights, 1, 2)
    parts = np.moveaxis(turned.reshape(*motion.b.shape[:2], k, k, system.m), 4, 1)
    place = stack.placement.reshape(-1, k, size)
    return np.asarray((np.swapaxes(place, 1, 2) @ parts @ place).sum(axis=2))
