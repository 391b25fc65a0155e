"""φ, φ_θ and φ_θθ of a closure system over a batch of configurations."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccpin.domain.chain_stack import ChainStack, StackMotion, cross, move
from ccpin.domain.chains import ClosureSystem

Array = NDArray[np.float64]


class Derivatives(NamedTuple):
    """φ (B, m), φ_θ (B, m, n′), φ_θθ (B, m, n′, n′) and |∂x_c/∂θ_j| of the chains (B, C, k)."""

    phi: Array
    jacobian: Array
    hessian: Array
    arms: Array


def values(system: ClosureSystem, stack: ChainStack, theta: Array) -> tuple[Array, Array]:
    """φ (B, m) and φ_θ (B, m, n′) at θ (B, n′)."""
    phi, jacobian, _ = _first_order(system, stack, theta)
    return phi, jacobian


def derivatives(system: ClosureSystem, stack: ChainStack, theta: Array) -> Derivatives:
    """φ, φ_θ and φ_θθ at θ (B, n′)."""
    phi, jacobian, motion = _first_order(system, stack, theta)
    hessian = np.zeros((len(theta), system.m, system.n_free, system.n_free))
    second = _second(motion)
    k = stack.joints.shape[1]
    for row, chain in enumerate(system.chains):
        rows = np.flatnonzero(np.any(chain.weights != 0.0, axis=1))
        first = k - len(chain.joints)
        part = second[:, row, first:, first:] @ chain.weights[rows].T
        hessian[np.ix_(np.arange(len(theta)), rows, chain.joints, chain.joints)] += np.moveaxis(part, 3, 1)
    return Derivatives(phi, jacobian, hessian, np.linalg.norm(motion.b, axis=3))


def _first_order(system: ClosureSystem, stack: ChainStack, theta: Array) -> tuple[Array, Array, StackMotion]:
    motion = move(stack, theta)
    phi = (theta[:, None] @ system.gears.T)[:, 0] + system.offset
    for row in np.flatnonzero(system.moduli):
        phi[:, row] -= system.moduli[row] * np.round(phi[:, row] / system.moduli[row])
    phi = phi + np.sum((stack.weights @ motion.x[..., None])[..., 0], axis=1)
    columns = motion.b @ np.swapaxes(stack.weights, 1, 2)
    flat = columns.reshape(len(theta), stack.joints.size, system.m)
    return phi, system.gears + np.swapaxes(flat, 1, 2) @ stack.placement, motion


def _second(motion: StackMotion) -> Array:
    """∂²x/∂θ_i∂θ_j = a_i × b_j for i ≤ j along the chain, of shape (B, C, k, k, 3)."""
    product = cross(motion.a[:, :, :, None], motion.b[:, :, None])
    upper = np.triu(np.ones(product.shape[2:4], dtype=np.bool_))
    return np.where(upper[:, :, None], product, np.swapaxes(product, 2, 3))
