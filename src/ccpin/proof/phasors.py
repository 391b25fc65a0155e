"""Planar closures as sums of phasors, φ(θ) = Σ_j ℓ_j (P_j cos Φ_j + Q_j sin Φ_j) + G θ + d, Φ = Cθ, and their bounds.

In a chain whose turns are all about one direction, link j points along an angle Φ_j that is a sum of joint angles
with coefficients ±1. Slides that come before every turn move the tip along fixed directions and join G. The bounds
are the trigonometric ones of `bounds`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, apply, cross, rows_of
from ccpin.proof.bounds import Contraction, Frame, Image, LinearPart, Rows, linear_part
from ccpin.proof.chains import Chain, ClosureSystem
from ccpin.proof.rounding import UNIT_ROUNDOFF

_PARALLEL = 64.0 * UNIT_ROUNDOFF  # sine of the angle between axes that are one but for products of rotations


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


# Bounds.


class PlanarBounds(NamedTuple):
    """Planar bounds of B boxes (`Bounds`).

    Attributes:
        linear: The shared part.
        y: Y, of shape (B, m).
        alpha, kappa: α and κ, of shape (B, m, K).
        modes: CE, of shape (B, K, m).
        angle: |CD|h, of shape (B, K).
        mixed: |Σ_j α_j (CE)_jk (C[D, E])_je|, of shape (B, m, m, p + m).
    """

    linear: LinearPart
    y: Array
    alpha: Array
    kappa: Array
    modes: Array
    angle: Array
    mixed: Array

    def take(self, rows: Rows) -> PlanarBounds:
        """See `Bounds`."""
        return rows_of(self, rows)

    def mean(self, radius: Array) -> Image:
        """See `Bounds`."""
        a, b = self.angle, self._widths(radius)
        versine = 0.5 * (a * a + a * b + b * b / 3.0)
        sine = np.sin(np.minimum(a + 0.5 * b, 0.5 * np.pi))
        cube = (4.0 * a**3 + 6.0 * a * a * b + 4.0 * a * b * b + b**3) / 24.0
        return Image(self._matrix(radius, 0.5 * radius, versine, sine, cube), np.zeros_like(radius))

    def contraction(self, radius: Array) -> Contraction:
        """See `Bounds`."""
        angle = self.angle + self._widths(radius)
        sine = np.sin(np.minimum(angle, 0.5 * np.pi))
        return Contraction(self._matrix(radius, radius, _versine(angle), sine, angle**3 / 6.0), np.zeros_like)

    def curvature(self, radius: Array, weight: Array) -> Array:
        """See `Bounds`."""
        angle, turn = self.angle + self._widths(radius), self._widths(weight)
        gain = np.abs(self.alpha) + np.abs(self.kappa) * np.minimum(angle, 1.0)[:, None]
        return np.asarray(apply(gain, turn * turn) + self.linear.curvature_margin(weight))

    def _widths(self, radius: Array) -> Array:
        """|CE|R, of shape (B, K)."""
        return apply(np.abs(self.modes), radius)

    def _matrix(self, radius: Array, linear: Array, versine: Array, sine: Array, cube: Array) -> Array:
        """|I − Ãφ_θE| + the smaller bound of |Σ α sin u (CE)| + |Σ κ (1 − cos u)(CE)|; `linear` is R in |N|(h, R)."""
        width = np.concatenate([self.linear.half, linear], axis=1)[:, None, :, None]
        modes = np.swapaxes(self.modes, 1, 2)[:, None]
        alpha = np.abs(self.alpha[:, :, None] * modes)
        expanded = (self.mixed @ width)[..., 0] + (alpha @ cube[:, None, :, None])[..., 0]
        first = np.minimum(expanded, (alpha @ sine[:, None, :, None])[..., 0])
        second = _one_signed(self.kappa[:, :, None] * modes, versine[:, None, None])
        return np.asarray(self.linear.affine(self.linear.widths(radius)) + first + second)


def planar_bounds(phasors: Phasors, values: PhasorValues, frame: Frame) -> PlanarBounds:
    """Planar bounds of boxes with the phasors' values at their centres."""
    linear = linear_part(frame, values.phi, values.jacobian)
    alpha, kappa = frame.preconditioner @ values.along, frame.preconditioner @ values.across
    along, modes = phasors.signs @ frame.directions, phasors.signs @ frame.modes
    angle = apply(np.abs(along), frame.half)
    mixed = alpha[:, :, None] * np.swapaxes(modes, 1, 2)[:, None]
    mixed = np.abs(mixed @ np.concatenate([along, modes], axis=2)[:, None])
    curved = _one_signed(alpha, _versine(angle)[:, None])
    cubic = apply(np.abs(kappa), angle**3 / 6.0)
    y = linear.constant + np.minimum(curved, _expanded(alpha, along, angle, frame.half)) + cubic
    return PlanarBounds(linear, y, alpha, kappa, modes, angle, mixed)


def _expanded(alpha: Array, along: Array, angle: Array, half: Array) -> Array:
    """|Σ α_j (1 − cos u_j)| by its exact quadratic part and the rest, of shape (B, m)."""
    widths = half[:, None]
    quadratic = np.swapaxes(along, 1, 2)[:, None] @ (alpha[..., None] * along[:, None])
    square = (widths[..., None, :] @ np.abs(quadratic) @ widths[..., None])[..., 0, 0]
    return np.asarray(0.5 * square + apply(np.abs(alpha), angle**4 / 24.0))


def _versine(angle: Array) -> Array:
    """The largest 1 − cos u for |u| ≤ angle."""
    return np.asarray(2.0 * np.sin(0.5 * np.minimum(angle, np.pi)) ** 2)


def _one_signed(coefficients: Array, bound: Array) -> Array:
    """The largest |Σ c_j v_j| for 0 ≤ v_j ≤ bound_j, over the last axis."""
    products = coefficients * bound
    sums = np.maximum(products, 0.0).sum(axis=-1), np.maximum(-products, 0.0).sum(axis=-1)
    return np.asarray(np.maximum(*sums))
