"""What Theorem L's inequalities compare (`ccpin/proof/theorems/adaptive.md`, whose names are used here)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, apply, inverses
from ccpin.control.stability.tracking.storage import floor, inverted
from ccpin.control.stability.tracking.tube_levels import ROOM
from ccpin.identification.adaptive.adaptive_bounds import CellBounds
from ccpin.identification.adaptive.adaptive_equations import AdaptiveEquations
from ccpin.proof.balls import Affine, affine, inverse
from ccpin.proof.rounding import SLACK

_CLEAR = 1e-9  # relative: covers the rounding of eigenvalues
_ROOM = 1e-8  # so that a bound that was solved for meets, with SLACK, the inequality that is checked


class AdaptiveLevels(NamedTuple):
    """What one choice of rooms and rates gives.

    Attributes:
        level: V_s^½ at most over each cell, of shape (K,).
        widths: |s_i| ≤ widths_i V_s^½, of shape (K, n).
        errors: |q − q_d| at most over each cell, of shape (K, n).
        entries: Bounds of (|q − q_d|, |s|) at the beginning of each cell, of shape (K, 2n).
        rates: |ṡ|, of shape (K, n).
        efforts: |Y_r π̂ − K s|, the generalized force that the law asks for, of shape (K, n).
        power: p, of shape (1,): of ∫ sᵀKs a second, in the mean.
        first: V(0), of shape (1,).
        ultimate: |q − q_d| as t → ∞, of shape (n,).
    """

    level: Array
    widths: Array
    errors: Array
    entries: Array
    rates: Array
    efforts: Array
    power: Array
    first: Array
    ultimate: Array

    @property
    def bound(self) -> Array:
        """Of (|q − q_d|, |s|) over each cell, of shape (K, 2n)."""
        return np.hstack([self.errors, self.level[:, None] * self.widths * SLACK])

    @property
    def needed(self) -> Array:
        """Rooms that would hold all that comes out, of shape (K, 2n)."""
        return np.maximum(self.bound, self.entries)

    def held(self, room: Array, rates: Array) -> bool:
        """Whether all that comes out is less than what went in."""
        return bool(np.all(self.needed * ROOM < room) and np.all(self.rates * ROOM < rates))


def levels_of(
    own: AdaptiveEquations, bounds: CellBounds, times: Array, room: Array, rates: Array, start: Array
) -> AdaptiveLevels:
    """The inequalities' sides where states are within `room` (K, 2n) and `rates` (K, n), from `start` (2n,) on."""
    gains, n = own.gains, rates.shape[1]
    T, K, S = gains.period, gains.damping, room[:, n:]
    with np.errstate(all="ignore"):
        X = inverted(floor(bounds.least))
        size = np.sqrt(np.diagonal(X, axis1=1, axis2=2))
        decay = decay_of(bounds.most, K)
        grip = grip_of(bounds.inertia, X)
        held = T * _lately(bounds.force_rate)
        drawn = bounds.doubt + held + bounds.coupling
        late = (held + apply(delayed(T * _lately(grip), K), _lately(drawn))) * SLACK
        driven = bounds.doubt + late
        drive = np.sqrt(0.5 * _squared(X, driven)) * SLACK
        swing = _lately(S)
        moved = (swing * late).sum(axis=1) + T * (_lately(rates) * _lately(bounds.doubt)).sum(axis=1)
        moved += T * (swing * _lately(bounds.doubt_rate)).sum(axis=1) + T * _lately(bounds.adapted)
        power = 0.5 * moved.max(keepdims=True) * SLACK
        unknown = 0.5 * ((own.upper - own.lower) ** 2 / gains.adaptation).sum() * SLACK
        before = float(np.sqrt(0.5 * start[n:] @ bounds.inertia.magnitude[0] @ start[n:])) * SLACK
        first = np.array([before**2 + unknown]) * SLACK
        jerked = T * drive.max()
        most = np.sqrt(max(first[0], (np.sqrt(power[0] / decay.min()) + jerked) ** 2 + unknown)) + jerked
        rest, durations = 2.0 * drive / decay * SLACK, np.diff(times)
        level, after = carried(np.array([before]), rest[:, None], 0.5 * decay[:, None], durations, most * SLACK)
        widths = np.sqrt(2.0) * size * SLACK
        errors, later = carried(start[:n], level * widths / gains.slope * SLACK, gains.slope + 0.0 * widths, durations)
        entries = np.vstack([start, np.hstack([later[:-1], after[:-1] * widths[:-1] * SLACK])])
        return AdaptiveLevels(
            level=level[:, 0],
            widths=widths,
            errors=errors,
            entries=entries,
            rates=apply(grip, drawn + K * swing) * SLACK,
            efforts=(bounds.force + K * S) * SLACK,
            power=power,
            first=first,
            ultimate=min(rest[-1], most) * widths[-1] / gains.slope * SLACK,
        )


def _squared(X: Array, bound: Array) -> Array:
    """xᵀXx of each cell at most, |x| ≤ `bound` (K, n)."""
    return np.asarray(np.einsum("ki,kij,kj->k", bound, np.abs(X), bound) * SLACK)


def grip_of(inertia: Affine, X: Array) -> Array:
    """Bounds of the entries of D⁻¹ (K, n, n): by an enclosure of it, or by X ⪰ D⁻¹, whichever is less."""
    size = np.sqrt(np.diagonal(X, axis1=1, axis2=2))
    enclosed = inverse(inertia).solve(affine(np.broadcast_to(np.eye(size.shape[1]), X.shape))).magnitude
    return np.asarray(np.fmin(enclosed, size[:, :, None] * size[:, None, :] * SLACK))


def delayed(moved: Array, damping: Array) -> Array:
    """K(I − AK)⁻¹A at most, A = `moved` (K, n, n) ≥ 0; infinite where ρ(AK) < 1 is not proved.

    W ≥ 0 with W − AK W ≥ 1 proves it, and is above (1 − AK)⁻¹.
    """
    loop = moved * damping
    identity, found = np.eye(len(damping)), np.full(loop.shape, np.inf)
    above = np.abs(inverses(identity - loop) @ (identity + _ROOM))
    held = np.all(above - (loop @ above) * SLACK >= identity, axis=(1, 2))
    found[held] = (damping[:, None] * (above @ moved))[held] * SLACK
    return found


def _lately(values: Array) -> Array:
    """The larger of a cell's number and the one of the cell before: what holds since the last sample."""
    return np.concatenate([values[:1], np.maximum(values[1:], values[:-1])])


def decay_of(inertia: Affine, damping: Array) -> Array:
    """The largest α with K − ½αD ⪰ 0 proved for all D of each cell, of shape (K,)."""
    outer = np.sqrt(damping[:, None] * damping)
    top = np.full(len(inertia.mid), np.nan)
    usable = np.isfinite(inertia.magnitude).all(axis=(1, 2))
    top[usable] = np.linalg.eigvalsh(inertia.mid[usable] / outer)[:, -1]
    top += np.linalg.norm(inertia.spread / outer, axis=(1, 2))
    return np.asarray(2.0 / (top * (1.0 + _CLEAR)))


def carried(start: Array, rest: Array, decay: Array, durations: Array, most: float = np.inf) -> tuple[Array, Array]:
    """x at most over each cell and at its end, of shape (K, …), where ẋ ≤ −decay (x − rest) and x ≤ most.

    The last cell has no end.
    """
    reached, ends, x = np.empty_like(rest), np.empty_like(rest), start
    for k, (there, rate) in enumerate(zip(rest, decay, strict=True)):
        after = there + (x - there) * np.exp(-rate * durations[k]) if k + 1 < len(rest) else there
        reached[k] = np.minimum(np.maximum(x, after) * SLACK, most)
        ends[k] = x = np.minimum(after * SLACK, most)
    return reached, ends
