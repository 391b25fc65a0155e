"""The potential well U(q) = V(σ(q)) − V(q_d) + q̃ᵀg(q_d) + ½ q̃ᵀK_p q̃ of a set point, bounded over certified boxes.

U is the part of the Lyapunov function that depends on q alone: 𝒱 = ½ q̇ᵀDq̇ + U. Its gradient vanishes at q_d and its
Hessian is K_p + ∂g/∂q.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices
from ccpin.control.stability.set_point.potential import GravityBounds

_ROUNDING = 1e-12  # of the terms' sizes and of singular values: covers their rounding in doubles
_SWEEPS = 200  # over all coordinates, at most
_SETTLED = 1e-4  # of an edge: a sweep in which none moves more is the last


class Range(NamedTuple):
    """lower ≤ min U over a box ≤ upper (J), and a point q (n,) of the box near the minimum."""

    lower: float
    upper: float
    point: Array


class Well(NamedTuple):
    """|U(q_c + δ) − (value + gradient·δ + ½ δᵀ hessian δ)| ≤ remainder over one box, and ‖∂g/∂q‖₂ ≤ beta there.

    So is the least singular value of ρᵀSᵀ at least `effort`, if that is positive: every generalized force is one that
    motors can exert.

    Attributes:
        centre: q_c, of shape (n,).
        value: In joules.
        gradient: Of shape (n,).
        hessian: K_p + ∂g/∂q at the centre, of shape (n, n).
        remainder: In joules.
        beta: In N m/rad (or N/m).
        effort: Infinite where the motors sit on the independent joints.
    """

    centre: Array
    value: float
    gradient: Array
    hessian: Array
    remainder: float
    beta: float
    effort: float

    def range_over(self, lower: Array, upper: Array) -> Range:
        """Bounds of min U over the part [lower, upper] of the box (degenerate edges allowed).

        Where the quadratic is convex on the part, a point p near its minimum gives the bound
        min ≥ Q(p) + min_δ ∇Q(p)·(δ − p) by convexity; else each term is bounded by itself.
        """
        low, high = lower - self.centre, upper - self.centre
        free = np.flatnonzero(high > low)
        start = np.where(high > low, 0.5 * (low + high), low)
        curvature = float(np.linalg.eigvalsh(self.hessian[np.ix_(free, free)])[0]) if free.size else 0.0
        half = 0.5 * (high - low)
        if curvature > 0.0:
            start = point = self._descend(start, low, high, free)
            slope = self.gradient + self.hessian @ point
            drop = np.maximum(slope * (point - low), slope * (point - high)).sum()
        else:
            slope = self.gradient + self.hessian @ start
            drop = np.abs(slope) @ half - 0.5 * curvature * (half @ half)
            point = start - np.sign(slope) * half
        least = self.quadratic(start) - float(drop)
        return Range(least - self.remainder, self.quadratic(point) + self.remainder, self.centre + point)

    def quadratic(self, delta: Array) -> float:
        """The value + gradient·δ + ½ δᵀ hessian δ."""
        return float(self.value + self.gradient @ delta + 0.5 * delta @ self.hessian @ delta)

    def _descend(self, point: Array, low: Array, high: Array, free: Indices) -> Array:
        """Minimise the quadratic over the box one coordinate after the other."""
        point = point.copy()
        for _ in range(_SWEEPS if free.size > 1 else 1):
            before = point.copy()
            for k in free:
                slope = self.gradient[k] + self.hessian[k] @ point
                point[k] = min(max(point[k] - slope / self.hessian[k, k], low[k]), high[k])
            if np.all(np.abs(point - before) <= _SETTLED * (high - low)):
                break
        return point


class SetPoint(NamedTuple):
    """A law's numbers.

    Attributes:
        q_d: Of shape (n,).
        K_p, K_v: Of shape (n, n).
        gravity_d: g(q_d), of shape (n,).
        potential_d: V(σ(q_d)) in joules.
        motors: S of motors that do not sit on the independent joints, by the rates of the joints, of shape (motors, ·).
    """

    q_d: Array
    K_p: Array
    K_v: Array
    gravity_d: Array
    potential_d: float
    motors: Array | None


def wells(law: SetPoint, centres: Array, half: Array, slopes: Array, bounds: GravityBounds) -> list[Well]:
    """U over B boxes with centres and half-widths (B, n), and D (B, n′, n), σ's slopes at the centres."""
    norms, efforts, found = bounds.norm, _efforts(law, slopes, bounds.turning), []
    for k, centre in enumerate(centres):
        error = law.q_d - centre
        parts = np.array(
            [bounds.value[k], -law.potential_d, error @ law.gravity_d, 0.5 * error @ law.K_p @ error], dtype=np.float64
        )
        slopes = np.abs(bounds.gradient[k]) + np.abs(law.gravity_d) + np.abs(law.K_p) @ (np.abs(error) + half[k])
        rounding = _ROUNDING * (np.abs(parts).sum() + slopes @ half[k])
        found.append(
            Well(
                centre=centre,
                value=float(parts.sum()),
                gradient=bounds.gradient[k] - law.gravity_d - law.K_p @ error,
                hessian=bounds.hessian[k] + law.K_p,
                remainder=float(bounds.remainder[k] + rounding),
                beta=float(norms[k]),
                effort=float(efforts[k]),
            )
        )
    return found


def _efforts(law: SetPoint, slopes: Array, turning: Array) -> Array:
    """Lower bounds of the least singular value of S ρ over boxes: ρ is within `turning` of D, the slopes, (B,).

    By Weyl's inequality singular values move by at most ‖|S| turning‖, of which the Frobenius norm is a bound.
    """
    motors = law.motors
    if motors is None:
        return np.full(len(slopes), np.inf)
    driven = motors @ slopes[:, : motors.shape[1]]
    moved = np.linalg.norm(np.abs(motors) @ turning[:, : motors.shape[1]], axis=(1, 2))
    singular = np.linalg.svd(driven, compute_uv=False)
    return np.asarray(singular[:, -1] - _ROUNDING * singular[:, 0] - moved)
