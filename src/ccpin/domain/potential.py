"""The free system's potential V′(θ) = −Σ_b m_b γ·c_b(θ) as chains, to be evaluated and bounded over many boxes at once.

c_b is the centre of mass of body b, the tip of a chain from the world to its joint (see `chains` for the derivatives
of a tip), and γ the acceleration of gravity. V′ is zero where all centres are at the world's origin, as in Pinocchio.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccpin.domain.chain_stack import ChainStack, cross, gather, move, stack_chains
from ccpin.domain.chains import UNIT_ROUNDOFF, Chain, ClosureSystem
from ccpin.domain.chart import Elementary, elementary_joints
from ccpin.errors import UnsupportedMechanismError
from ccpin.mechanism import Mechanism

Array = NDArray[np.float64]


class Potential(NamedTuple):
    """V′ of a mechanism in scalar coordinates θ (n′,).

    Attributes:
        stack: One chain of weights (1, 3) a body with mass, side by side.
        forces: |m_b γ| of the chains (N), of shape (C,).
        lengths: Σ |translations| + |tip| of the chains (m), of shape (C,).
        rounding: |computed − exact| ≤ rounding · `magnitude` for V′ and every entry of its derivatives.
    """

    stack: ChainStack
    forces: Array
    lengths: Array
    rounding: float

    def magnitude(self, theta: Array) -> Array:
        """Σ_b |m_b γ| · (an upper bound of the chain's length), slides included, at θ (B, n′), of shape (B,)."""
        slides = np.sum(gather(self.stack, np.abs(theta)) * self.stack.sliding, axis=2)
        return np.asarray((slides + self.lengths) @ self.forces)


class PotentialValues(NamedTuple):
    """V′ (B,), g′ = V′_θ (B, n′), V′_θθ (B, n′, n′) and |∂c_b/∂θ_j| of the chains (B, C, k)."""

    value: Array
    gradient: Array
    hessian: Array
    arms: Array


def potential_of(mechanism: Mechanism, system: ClosureSystem) -> Potential:
    """V′ of a mechanism in the chart of its closure system.

    Raises:
        UnsupportedMechanismError: No movable link has mass.
    """
    model = mechanism.tree.model
    elementary = elementary_joints(mechanism, system.chart)
    gravity = np.asarray(model.gravity.linear)
    chains = []
    for number, inertia in enumerate(model.inertias):
        if number == 0 or inertia.mass == 0.0:
            continue
        path, joint = list[Elementary](), number
        while joint:
            path = [*elementary[joint - 1], *path]
            joint = int(model.parents[joint])
        chains.append(_chain(path, np.asarray(inertia.lever), -inertia.mass * gravity))
    if not chains:
        raise UnsupportedMechanismError(
            f"{mechanism.name}: no movable link has mass, so there is no potential to bound"
        )
    depth = max(len(chain.joints) for chain in chains)
    lengths = [np.linalg.norm(c.translations, axis=1).sum() + np.linalg.norm(c.tip) for c in chains]
    return Potential(
        stack=stack_chains(tuple(chains), system.n_free),
        forces=np.array([np.linalg.norm(chain.weights) for chain in chains]),
        lengths=np.array(lengths),
        rounding=(128.0 * (depth + 2) + 4.0 * system.n_free) * UNIT_ROUNDOFF,
    )


def _chain(path: list[Elementary], tip: Array, weight: Array) -> Chain:
    placements = np.array([step.placement for step in path])
    return Chain(
        joints=np.array([step.position for step in path], dtype=np.intp),
        rotations=placements[:, :3, :3],
        translations=placements[:, :3, 3],
        axes=np.array([step.axis for step in path]),
        prismatic=np.array([step.prismatic for step in path]),
        tip=tip,
        direction=False,
        weights=weight[None],
    )


def potential_values(potential: Potential, theta: Array) -> PotentialValues:
    """V′ and its first two derivatives at θ (B, n′); ∂²c/∂θ_i∂θ_j = a_i × b_j for i ≤ j along a chain."""
    stack, count = potential.stack, len(theta)
    motion = move(stack, theta)
    weights = stack.weights[:, 0]
    flat = np.sum(motion.b * weights[:, None], axis=3).reshape(count, -1)
    turned = cross(np.broadcast_to(weights[:, None], motion.a.shape), motion.a)
    second = np.triu(turned @ np.swapaxes(motion.b, 2, 3))
    second = second + np.swapaxes(np.triu(second, 1), 2, 3)
    return PotentialValues(
        value=np.sum(motion.x * weights, axis=(1, 2)),
        gradient=flat @ stack.placement,
        hessian=np.sum(spread(stack, second), axis=1),
        arms=np.linalg.norm(motion.b, axis=3),
    )


def spread(stack: ChainStack, matrices: Array) -> Array:
    """Matrices by chain and joints (B, C, k, k) as matrices over θ, of shape (B, C, n′, n′)."""
    chains, k = stack.joints.shape
    place = stack.placement.reshape(chains, k, -1)
    return np.asarray(np.swapaxes(place, 1, 2) @ matrices @ place)
