"""Planar bounds: trigonometric, for closures in phasor form (see `bounds`)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, apply, rows_of
from ccpin.domain.bounds import Frame, Image, LinearPart, Rows, linear_part
from ccpin.domain.phasors import Phasors, PhasorValues


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
        return self._image(radius, 0.5 * radius, versine, sine, cube)

    def contraction(self, radius: Array, weight: Array) -> Image:
        """See `Bounds`."""
        angle = self.angle + self._widths(radius)
        sine = np.sin(np.minimum(angle, 0.5 * np.pi))
        return self._image(radius, radius, _versine(angle), sine, angle**3 / 6.0)

    def curvature(self, radius: Array, weight: Array) -> Array:
        """See `Bounds`."""
        angle, turn = self.angle + self._widths(radius), self._widths(weight)
        gain = np.abs(self.alpha) + np.abs(self.kappa) * np.minimum(angle, 1.0)[:, None]
        return np.asarray(apply(gain, turn * turn) + self.linear.curvature_margin(weight))

    def _widths(self, radius: Array) -> Array:
        """|CE|R, of shape (B, K)."""
        return apply(np.abs(self.modes), radius)

    def _image(self, radius: Array, linear: Array, versine: Array, sine: Array, cube: Array) -> Image:
        """|I − Ãφ_θE| + the smaller bound of |Σ α sin u (CE)| + |Σ κ (1 − cos u)(CE)|; `linear` is R in |N|(h, R)."""
        width = np.concatenate([self.linear.half, linear], axis=1)[:, None, :, None]
        modes = np.swapaxes(self.modes, 1, 2)[:, None]
        alpha = np.abs(self.alpha[:, :, None] * modes)
        expanded = (self.mixed @ width)[..., 0] + (alpha @ cube[:, None, :, None])[..., 0]
        first = np.minimum(expanded, (alpha @ sine[:, None, :, None])[..., 0])
        second = _one_signed(self.kappa[:, :, None] * modes, versine[:, None, None])
        matrix = self.linear.affine(self.linear.widths(radius)) + first + second
        return Image(matrix, np.zeros_like(radius))


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
