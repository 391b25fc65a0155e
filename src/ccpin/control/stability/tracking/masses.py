"""The free system's dynamics as chains: every body as a few tips with mass.

A body's kinetic energy is ½m|ċ|² + ½Σ_i s_i|u̇_i|², c its centre of mass, u_i the principal directions of its second
moments s_i = ∫(r·u_i)² dm = ½ tr I − I_i about c, for ½ωᵀIω = ½∫|ω × r|² dm: a tip of mass m, and three directions
with s_i, all of them tips of chains as `chains` has them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from ccpin.arrays import Array
from ccpin.proof.balls import Affine
from ccpin.proof.chains import Chain, ChainStack, ClosureSystem, stack_chains

T = TypeVar("T")


class Tip(NamedTuple):
    """A chain with a mass (kg) or second moment (kg m²), what that may be off by, and its gravity, of shape (3,)."""

    chain: Chain
    weight: float
    doubt: float
    fall: Array


class BodiesOnJoints(NamedTuple):
    """Bodies as tips, and what acts on the joints: all that is read off a mechanism for its dynamics.

    Attributes:
        tips: One a centre of mass, and one a principal direction of a body that turns.
        armature, damping, stiffness, rest: Of the joints, of shape (n′,).
    """

    tips: tuple[Tip, ...]
    armature: Array
    damping: Array
    stiffness: Array
    rest: Array


class Bodies(NamedTuple):
    """Tips with mass, of chains of one length.

    Attributes:
        stack: Their chains.
        weights: w_c: masses (kg) and second moments (kg m²), of shape (C,).
        fall: γ, gravity, for the centres of mass, zero for directions, of shape (C, 3).
    """

    stack: ChainStack
    weights: Affine
    fall: Array


class Masses(NamedTuple):
    """The free system's dynamics, and the closures', as chains side by side.

    Attributes:
        bodies: The tips with mass, by their chains' lengths.
        loops: The closures' chains, alike.
        free: The same, tip by tip, and what acts on the joints.
    """

    bodies: tuple[Bodies, ...]
    loops: tuple[ChainStack, ...]
    free: BodiesOnJoints


def masses_of(system: ClosureSystem, free: BodiesOnJoints) -> Masses:
    """A free system with the closures on it."""
    bodies = _by_length(free.tips, [tip.chain for tip in free.tips])
    loops = _by_length(system.chains, system.chains)
    return Masses(
        bodies=tuple(_bodies(group, system.n_free) for group in bodies),
        loops=tuple(stack_chains(tuple(group), system.n_free, system.m) for group in loops),
        free=free,
    )


def _by_length(items: Sequence[T], chains: Sequence[Chain]) -> list[list[T]]:
    """Items in groups of chains with equally many joints."""
    groups: dict[int, list[T]] = {}
    for item, chain in zip(items, chains, strict=True):
        groups.setdefault(len(chain.joints), []).append(item)
    return list(groups.values())


def _bodies(tips: list[Tip], n_free: int) -> Bodies:
    weights, doubts = np.array([tip.weight for tip in tips]), np.array([tip.doubt for tip in tips])
    stack = stack_chains(tuple(tip.chain for tip in tips), n_free, 1)
    return Bodies(stack, Affine(weights, np.zeros((0, len(tips))), doubts), np.array([tip.fall for tip in tips]))
