"""Planar closures as sums of phasors: φ(θ) = Σ_j ℓ_j (P_j cos Φ_j + Q_j sin Φ_j) + G θ + d, Φ = Cθ.

In a chain whose turns are all about one direction, link j points along an angle Φ_j that is a sum of joint angles
with coefficients ±1. Slides that come before every turn move the tip along fixed directions and join G.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, cross
from ccpin.domain.chains import UNIT_ROUNDOFF, Chain, ClosureSystem

_PARALLEL = 64.0 * UNIT_ROUNDOFF


@dataclass(frozen=True, eq=False)
class Phasors:
    """K links of planar closures.

    Attributes:
        signs: C, of shape (K, n′).
        lengths: ℓ (m; 1 for directions), of shape (K,).
        cosine_weights, sine_weights: P_j and Q_j as columns, of shape (m, K).
        linear: G, of shape (m, n′).
        offset: d, of shape (m,).
    """

    signs: Array
    lengths: Array
    cosine_weights: Array
    sine_weights: Array
    linear: Array
    offset: Array


class PhasorValues(NamedTuple):
    """φ (B, m), φ_θ (B, m, n′), and the links in φ: z_j = ∂φ/∂cos u, i z_j = ∂φ/∂sin u at u = 0, each (B, m, K)."""

    phi: Array
    jacobian: Array
    along: Array
    across: Array


class _Phasor(NamedTuple):
    sign: Array
    length: float
    cosine: Array
    sine: Array


def phasors_of(system: ClosureSystem) -> Phasors | None:
    """The phasor form of a system, or ``None`` where a chain is not planar (to rounding) or slides after a turn."""
    linear, offset = system.couplings.copy(), system.offset.copy()
    links: list[_Phasor] = []
    for chain in system.chains:
        if not _resolve(chain, links, linear, offset):
            return None
    if not links or np.any(system.moduli):
        return None
    return Phasors(
        signs=np.array([link.sign for link in links]),
        lengths=np.array([link.length for link in links]),
        cosine_weights=np.column_stack([link.cosine for link in links]),
        sine_weights=np.column_stack([link.sine for link in links]),
        linear=linear,
        offset=offset,
    )


def _resolve(chain: Chain, links: list[_Phasor], linear: Array, offset: Array) -> bool:
    """Add a chain's links; False (and nothing promised about the arguments) where it has no phasor form.

    At θ = 0 frame j is turned by Γ_j = Γ_{j−1} R_j against the root. With every axis ± the unit vector e along
    the root frame, the vector r of link j is Γ_j r turned by the sum of signed angles, and by nothing along e.
    """
    turn = np.eye(3)
    sign = np.zeros(linear.shape[1])
    normal: Array | None = None
    vectors: list[tuple[Array, Array]] = []
    for k, joint in enumerate(chain.joints):
        vectors.append((sign.copy(), turn @ chain.translations[k]))
        turn = turn @ chain.rotations[k]
        axis = turn @ chain.axes[k]
        if chain.prismatic[k]:
            if normal is not None:
                return False
            if not chain.direction:
                linear[:, joint] += chain.weights @ axis
            continue
        normal = axis if normal is None else normal
        if np.linalg.norm(cross(normal, axis)) > _PARALLEL:
            return False
        sign[joint] = np.copysign(1.0, normal @ axis)
    vectors.append((sign.copy(), turn @ chain.tip))
    used = vectors[-1:] if chain.direction else vectors
    for signs, vector in used:
        _add_link(signs, vector, normal, chain.weights, links, offset)
    return True


def _add_link(
    signs: Array, vector: Array, normal: Array | None, weights: Array, links: list[_Phasor], offset: Array
) -> None:
    """The part of a vector in the plane becomes a phasor, the rest (and all, before the first turn) a constant."""
    if normal is None or not np.any(signs):
        offset += weights @ vector
        return
    axial = (vector @ normal) * normal
    offset += weights @ axial
    planar = vector - axial
    length = float(np.linalg.norm(planar))
    if length > 0.0:
        first = planar / length
        links.append(_Phasor(signs, length, weights @ first, weights @ cross(normal, first)))


def phasor_values(phasors: Phasors, theta: Array) -> PhasorValues:
    """φ, φ_θ and the links' vectors in φ at θ of shape (B, n′).

    With u the deviation of a link's angle, its part of φ is z cos u + (i z) sin u.
    """
    angles = np.sum(phasors.signs * theta[:, None], axis=-1)
    cosine, sine = phasors.lengths * np.cos(angles), phasors.lengths * np.sin(angles)
    along = phasors.cosine_weights * cosine[:, None] + phasors.sine_weights * sine[:, None]
    across = phasors.sine_weights * cosine[:, None] - phasors.cosine_weights * sine[:, None]
    phi = np.sum(along, axis=-1) + np.sum(phasors.linear * theta[:, None], axis=-1) + phasors.offset
    return PhasorValues(phi, phasors.linear + across @ phasors.signs, along, across)
