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
from ccpin.domain.closures.scalar_coordinates import elementary_joints
from ccpin.domain.closures.system import Reading, chain_of, steps_along
from ccpin.errors import UnsupportedMechanismError
from ccpin.mechanism.mechanism import Mechanism
from ccpin.proof.balls import Affine
from ccpin.proof.chains import Chain, ChainStack, stack_chains

T = TypeVar("T")
_DATA = 1e-14  # what eigenvalues of a body's second moments may be off by, of the largest


class Bodies(NamedTuple):
    """Tips with mass, of chains of one length.

    Attributes:
        stack: One chain a centre of mass, and one a principal direction of a body that turns.
        weights: w_c: masses (kg) and second moments (kg m²), of shape (C,).
        fall: γ, gravity, for the centres of mass, zero for directions, of shape (C, 3).
    """

    stack: ChainStack
    weights: Affine
    fall: Array


class Masses(NamedTuple):
    """The free system's dynamics as chains.

    Attributes:
        bodies: The tips with mass, by their chains' lengths.
        loops: The closures' chains, alike.
        armature, damping, stiffness, rest: Of the joints, of shape (n′,).
    """

    bodies: tuple[Bodies, ...]
    loops: tuple[ChainStack, ...]
    armature: Array
    damping: Array
    stiffness: Array
    rest: Array


def masses_of(mechanism: Mechanism, reading: Reading, gravity: Array) -> Masses:
    """The masses of a mechanism whose joints turn about or slide along one axis each.

    Raises:
        UnsupportedMechanismError: A joint of another kind, no closures, or one that keeps a distance.
    """
    plural = next((joint for joint in mechanism.tree.joints if joint.kind.nv != 1), None)
    if plural is not None:
        raise UnsupportedMechanismError(
            f"{mechanism.name}: the {plural.kind.name} joint '{plural.name}' has several freedoms, whose error has no "
            "size that does not depend on a chart; describe it as joints about one axis each"
        )
    if not reading.system.m:
        raise UnsupportedMechanismError(f"{mechanism.name} has no dependent coordinates, so σ cannot be off")
    if reading.rods:
        raise UnsupportedMechanismError(
            f"{mechanism.name}: a closure that keeps a distance is certified as a rod, which the law does not compute "
            "with; describe it as a link on joints"
        )
    tips = list[_Tip]()
    elementary, model = elementary_joints(mechanism, reading.chart), mechanism.tree.model
    for number, inertia in enumerate(model.inertias):
        path = steps_along(elementary, list(model.supports[number])[1:]) if number else []
        if inertia.mass and path:
            tips.append(_Tip(chain_of(path, inertia.lever, False, np.zeros((1, 3))), inertia.mass, 0.0, gravity))
        if np.any(inertia.inertia) and any(not step.prismatic for step in path):
            about = np.asarray(inertia.inertia)
            moments, axes = np.linalg.eigh(0.5 * np.trace(about) * np.eye(3) - about)
            doubt = _DATA * float(np.abs(moments).max())
            chains = (chain_of(path, axis, True, np.zeros((1, 3))) for axis in axes.T)
            tips += [_Tip(chain, m, doubt, np.zeros(3)) for chain, m in zip(chains, moments, strict=True)]
    n_free, joints = reading.system.n_free, mechanism.joints
    loops = _by_length(reading.system.chains, reading.system.chains)
    return Masses(
        bodies=tuple(_bodies(group, n_free) for group in _by_length(tips, [tip.chain for tip in tips])),
        loops=tuple(stack_chains(tuple(group), n_free, reading.system.m) for group in loops),
        armature=joints.armature,
        damping=joints.damping,
        stiffness=joints.stiffness,
        rest=joints.spring_reference,
    )


class _Tip(NamedTuple):
    """A chain with its weight, what that may be off by, and its gravity."""

    chain: Chain
    weight: float
    doubt: float
    fall: Array


def _by_length(items: Sequence[T], chains: Sequence[Chain]) -> list[list[T]]:
    """Items in groups of chains with equally many joints."""
    groups: dict[int, list[T]] = {}
    for item, chain in zip(items, chains, strict=True):
        groups.setdefault(len(chain.joints), []).append(item)
    return list(groups.values())


def _bodies(tips: list[_Tip], n_free: int) -> Bodies:
    weights, doubts = np.array([tip.weight for tip in tips]), np.array([tip.doubt for tip in tips])
    stack = stack_chains(tuple(tip.chain for tip in tips), n_free, 1)
    return Bodies(stack, Affine(weights, np.zeros((0, len(tips))), doubts), np.array([tip.fall for tip in tips]))
