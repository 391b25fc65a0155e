"""φ, φ_θ and φ_θθ of a closure system over a batch of configurations."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccpin.domain.chains import Chain, ClosureSystem

Array = NDArray[np.float64]


class ChainMotion(NamedTuple):
    """A chain at B configurations.

    Attributes:
        x: Tips, of shape (B, 3).
        a: Axes, of shape (B, k, 3); zero for prismatic joints.
        b: ∂x/∂θ_j, of shape (B, k, 3).
    """

    x: Array
    a: Array
    b: Array


class Derivatives(NamedTuple):
    """φ (B, m), φ_θ (B, m, n′), φ_θθ (B, m, n′, n′) and the chains' motion."""

    phi: Array
    jacobian: Array
    hessian: Array
    motions: tuple[ChainMotion, ...]


def chain_motion(chain: Chain, theta: Array) -> ChainMotion:
    """Sweep a chain from root to tip at θ of shape (B, n′)."""
    count, k = len(theta), len(chain.joints)
    angles = theta[:, chain.joints]
    sines, versines = np.sin(angles), 2.0 * np.sin(0.5 * angles) ** 2
    axes, origins = np.empty((count, k, 3)), np.empty((count, k, 3))
    turn, origin = np.broadcast_to(np.eye(3), (count, 3, 3)), np.zeros((count, 3))
    for j in range(k):
        origin = origin + turn @ chain.translations[j]
        turn = turn @ chain.rotations[j]
        axis = turn @ chain.axes[j]
        axes[:, j], origins[:, j] = axis, origin
        if chain.prismatic[j]:
            origin = origin + angles[:, j, None] * axis
        else:
            cross = _skew(chain.axes[j])
            turned = turn @ cross
            turn = turn + sines[:, j, None, None] * turned + versines[:, j, None, None] * (turned @ cross)
    tip = turn @ chain.tip
    if chain.direction:
        arms = np.broadcast_to(tip[:, None], (count, k, 3))
        slides = np.zeros_like(axes)
    else:
        tip = tip + origin
        arms, slides = tip[:, None] - origins, axes
    b = np.where(chain.prismatic[:, None], slides, _cross(axes, arms))
    return ChainMotion(tip, np.where(chain.prismatic[:, None], 0.0, axes), b)


def values(system: ClosureSystem, theta: Array) -> tuple[Array, Array]:
    """φ (B, m) and φ_θ (B, m, n′) at θ (B, n′)."""
    phi, jacobian, _ = _first_order(system, theta)
    return phi, jacobian


def derivatives(system: ClosureSystem, theta: Array) -> Derivatives:
    """φ, φ_θ and φ_θθ at θ (B, n′)."""
    phi, jacobian, motions = _first_order(system, theta)
    hessian = np.zeros((len(theta), system.m, system.n_free, system.n_free))
    for chain, motion in zip(system.chains, motions, strict=True):
        rows = np.flatnonzero(np.any(chain.weights != 0.0, axis=1))
        second = _second(motion) @ chain.weights[rows].T
        hessian[np.ix_(np.arange(len(theta)), rows, chain.joints, chain.joints)] += np.moveaxis(second, 3, 1)
    return Derivatives(phi, jacobian, hessian, motions)


def _first_order(system: ClosureSystem, theta: Array) -> tuple[Array, Array, tuple[ChainMotion, ...]]:
    phi = (theta[:, None] @ system.gears.T)[:, 0] + system.offset
    jacobian = np.broadcast_to(system.gears, (len(theta), *system.gears.shape)).copy()
    for row in np.flatnonzero(system.moduli):
        phi[:, row] -= system.moduli[row] * np.round(phi[:, row] / system.moduli[row])
    motions = []
    for chain in system.chains:
        motion = chain_motion(chain, theta)
        phi += (motion.x[:, None] @ chain.weights.T)[:, 0]
        jacobian[:, :, chain.joints] += np.swapaxes(motion.b @ chain.weights.T, 1, 2)
        motions.append(motion)
    return phi, jacobian, tuple(motions)


def _second(motion: ChainMotion) -> Array:
    """∂²x/∂θ_i∂θ_j = a_i × b_j for i ≤ j along the chain, of shape (B, k, k, 3)."""
    product = _cross(motion.a[:, :, None], motion.b[:, None])
    upper = np.triu(np.ones(product.shape[1:3], dtype=np.bool_))
    return np.where(upper[:, :, None], product, np.swapaxes(product, 1, 2))


def _cross(u: Array, v: Array) -> Array:
    """The vector product over the last axis, with broadcasting."""
    x = u[..., 1] * v[..., 2] - u[..., 2] * v[..., 1]
    y = u[..., 2] * v[..., 0] - u[..., 0] * v[..., 2]
    z = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
    return np.stack([x, y, z], axis=-1)


def _skew(p: Array) -> Array:
    x, y, z = p
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
