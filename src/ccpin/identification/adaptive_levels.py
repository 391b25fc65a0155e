"""What Theorem L's inequalities compare (`ccpin/proof/theorems/adaptive.md`, whose names are used here)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, apply, inverses
from ccpin.control.stability.tracking.motion_bounds import Motion
from ccpin.control.stability.tracking.storage import floor, inverted
from ccpin.control.stability.tracking.tube_levels import ROOM
from ccpin.identification.adaptive_equations import AdaptiveEquations
from ccpin.identification.adaptive_states import AdaptiveStates
from ccpin.identification.regressor_bounds import OF_A_JOINT, TEN, TIPS, RegressorBounds, Shares
from ccpin.proof.balls import Affine, affine, inverse
from ccpin.proof.rounding import SLACK, UNIT_ROUNDOFF

_CLEAR = 1e-9  # relative: covers the rounding of eigenvalues
_ADDS = np.isin(np.arange(TEN), (0, 4, 6, 9))  # of a body: its mass, and Ixx, Iyy, Izz
_ROOM = 1e-8  # so that a bound that was solved for meets, with SLACK, the inequality that is checked
_NUMBERS = 4e6  # in the largest array of one chunk


class CellBounds(NamedTuple):
    """Bounds over K cells, for all constants of the box; NaN where φ_y may be singular.

    Attributes:
        inertia, least, most: D of any constants of the box, and what is below and above all of them, of shape
            (K, n, n).
        doubt: |Y_r(π̂ − π)|, of shape (K, n).
        doubt_rate: Of its rate at constant π̂.
        force: |Y_r π̂|.
        force_rate: Of its rate at constant π̂.
        coupling: |(C + damping) s|.
        adapted: sᵀY_r Γ Y_rᵀs, of shape (K,).
    """

    inertia: Affine
    least: Affine
    most: Affine
    doubt: Array
    doubt_rate: Array
    force: Array
    force_rate: Array
    coupling: Array
    adapted: Array


def bounds_of(own: AdaptiveEquations, states: AdaptiveStates, room: Array) -> CellBounds:
    """Those of states with |s| within the second half of `room` (K, 2n), chunk by chunk."""
    joints = max(each.stack.joints.size * each.stack.joints.shape[1] for each in own.bodies)
    numbers = 18 * (1 + len(states.theta.lin)) * max(joints, 8 * len(own.adapted))
    step = max(1, int(_NUMBERS // numbers))
    parts = [
        _part(own, states.chunk(slice(k, k + step)), room[k : k + step]) for k in range(0, len(states.theta.mid), step)
    ]
    forms, arrays = zip(*((part[:3], part[3:]) for part in parts), strict=True)
    return CellBounds(*map(_joined, zip(*forms, strict=True)), *map(np.concatenate, zip(*arrays, strict=True)))


def _joined(forms: Sequence[Affine]) -> Affine:
    """Cells one behind the other."""
    mid, rad = (np.concatenate(x) for x in zip(*((f.mid, f.rad) for f in forms), strict=True))
    return Affine(mid, np.concatenate([f.lin for f in forms], axis=1), rad, forms[0].boxed)


def _part(own: AdaptiveEquations, states: AdaptiveStates, room: Array) -> CellBounds:
    adapted, n = own.adapted, states.error.mid.shape[1]
    centre = 0.5 * (own.lower + own.upper)
    half = _half(own, centre)[adapted]
    apart = (own.upper - own.lower)[adapted] * (1.0 + 4.0 * UNIT_ROUNDOFF)
    shares = Shares.of(np.hstack([centre[:, None], np.eye(len(centre))[:, adapted]]), own.closures.system.n_free)
    at = RegressorBounds(own.closures.system, own.masses, own.bodies, own.gravity, states.theta, states.asked.v)
    columns, rates = at.columns(states.asked, shares).magnitude, at.rates(states.asked, states.rate, shares).magnitude
    still = Motion(states.asked.v, states.error, states.error * 0.0)
    coupled = at.columns(still, shares, still=False).magnitude
    def whole(x: Array) -> Array:
        return np.asarray((x[:, 0] + np.einsum("q,kqi->ki", half, x[:, 1:])) * SLACK)

    def doubted(x: Array) -> Array:
        return np.asarray(np.einsum("q,kqi->ki", apart, x[:, 1:]) * SLACK)

    along = np.einsum("kqi,ki->kq", columns[:, 1:], room[:, n:]) ** 2 @ own.gains.adaptation[adapted]
    return CellBounds(
        *_inertias(own, at, centre), doubted(columns), doubted(rates), whole(columns), whole(rates), whole(coupled), along * SLACK
    )


def _inertias(own: AdaptiveEquations, at: RegressorBounds, centre: Array) -> tuple[Affine, Affine, Affine]:
    """D, what is below it and what is above it: masses, moments of inertia and rotors only add to D."""
    n_free, count = own.closures.system.n_free, len(own.frames) // TIPS
    adds = np.concatenate([np.tile(_ADDS, count), np.arange(OF_A_JOINT * n_free) < n_free])
    others, all_of_them = own.adapted[~adds[own.adapted]], own.adapted
    ends = np.stack([centre, np.where(adds, own.lower, centre), np.where(adds, own.upper, centre)], axis=1)
    columns = np.hstack([ends, np.eye(len(centre))[:, all_of_them]])
    inertia, half = at.inertia(Shares.of(columns, n_free)), _half(own, centre)
    single = inertia[:, 3:].magnitude

    def about(k: int, which: Array) -> Affine:
        spread = np.einsum("q,kqij->kij", half[which], single[:, np.searchsorted(all_of_them, which)]) * SLACK
        return Affine(inertia.mid[:, k], inertia.lin[:, :, k], (inertia.rad[:, k] + spread) * SLACK, inertia.boxed)

    return about(0, all_of_them), about(1, others), about(2, others)


def _half(own: AdaptiveEquations, centre: Array) -> Array:
    """How far constants are from the box's centre at most, of shape (p,)."""
    return np.asarray(np.maximum(own.upper - centre, centre - own.lower) * (1.0 + 4.0 * UNIT_ROUNDOFF))


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
        adapted, span = own.adapted, own.upper - own.lower
        unknown = 0.5 * (span[adapted] ** 2 / gains.adaptation[adapted]).sum() * SLACK
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
            level[:, 0], widths, errors, entries, apply(grip, drawn + K * swing) * SLACK, (bounds.force + K * S) * SLACK, power, first,
            min(rest[-1], most) * widths[-1] / gains.slope * SLACK,
        )  # fmt: skip


def _squared(X: Array, bound: Array) -> Array:
    """xᵀXx of each cell at most, |x| ≤ `bound` (K, n)."""
    return np.asarray(np.einsum("ki,kij,kj->k", bound, np.abs(X), bound) * SLACK)


def grip_of(inertia: Affine, X: Array) -> Array:
    """Bounds of the entries of D⁻¹ (K, n, n): by an enclosure of it, or by X ⪰ D⁻¹, whichever is less."""
    size = np.sqrt(np.diagonal(X, axis1=1, axis2=2))
    enclosed = inverse(inertia).solve(affine(np.broadcast_to(np.eye(size.shape[1]), X.shape))).magnitude
    return np.asarray(np.fmin(enclosed, size[:, :, None] * size[:, None, :] * SLACK))


def delayed(moved: Array, damping: Array) -> Array:
    """K(I − AK)⁻¹A at most, A = `moved` (K, n, n) ≥ 0; infinite where ρ(AK) < 1 is not proved."""
    loop = moved * damping
    identity, found = np.eye(len(damping)), np.full(loop.shape, np.inf)
    usable = np.isfinite(loop).all(axis=(1, 2))
    solved = inverses(np.where(usable[:, None, None], identity - loop, identity))
    above = np.abs(solved @ (identity + _ROOM))  # any W ≥ 0 with W − AK W ≥ I is above the inverse, and proves it
    held = usable & np.all(above - (loop @ above) * SLACK >= identity, axis=(1, 2))
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


def carried(
    start: Array, rest: Array, decay: Array, durations: Array, most: float = np.inf
) -> tuple[Array, Array]:
    """x at most over each cell and at its end, of shape (K, …), where ẋ ≤ −decay (x − rest) and x ≤ most.

    The last cell has no end.
    """
    reached, ends, x = np.empty_like(rest), np.empty_like(rest), start
    for k, (there, rate) in enumerate(zip(rest, decay, strict=True)):
        after = there + (x - there) * np.exp(-rate * durations[k]) if k + 1 < len(rest) else there
        reached[k] = np.minimum(np.maximum(x, after) * SLACK, most)
        ends[k] = x = np.minimum(after * SLACK, most)
    return reached, ends
