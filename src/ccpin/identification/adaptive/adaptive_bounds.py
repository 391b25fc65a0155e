"""Bounds over cells, for all constants of a box: 2 of Theorem L (`ccpin/proof/theorems/adaptive.md`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.control.stability.tracking.motion_bounds import Motion
from ccpin.identification.adaptive.adaptive_equations import AdaptiveEquations
from ccpin.identification.adaptive.adaptive_states import AdaptiveStates
from ccpin.identification.adaptive.regressor_bounds import RegressorBounds
from ccpin.proof.balls import Affine, product
from ccpin.proof.rounding import SLACK

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
    numbers = 18 * (1 + len(states.theta.lin)) * max(joints, 8 * len(own.lower))
    step = max(1, int(_NUMBERS // numbers))
    parts = [
        _part(own, states.chunk(slice(k, k + step)), room[k : k + step]) for k in range(0, len(states.theta.mid), step)
    ]
    columns = zip(*parts, strict=True)
    return CellBounds(*(_joined(each) for each in columns))


def _joined(parts: Sequence[Any]) -> Any:
    """Cells one behind the other."""
    if not isinstance(parts[0], Affine):
        return np.concatenate(parts)
    mid, rad = (np.concatenate(x) for x in zip(*((form.mid, form.rad) for form in parts), strict=True))
    return Affine(mid, np.concatenate([form.lin for form in parts], axis=1), rad, parts[0].boxed)


def _part(own: AdaptiveEquations, states: AdaptiveStates, room: Array) -> CellBounds:
    n, span = states.error.mid.shape[1], own.upper - own.lower
    centre, half = _middle(own.lower, own.upper)
    at = RegressorBounds(own.closures.system, own.masses, own.bodies, own.gravity, states.theta, states.asked.v)
    columns, rates = at.columns(states.asked, own.shares), at.rates(states.asked, states.rate, own.shares)
    still = Motion(states.asked.v, states.error, states.error * 0.0)
    coupled, inertia = at.columns(still, own.shares, still=False), at.inertia(own.shares)

    def most(x: Affine) -> Array:
        middle = _combined(x, centre).magnitude
        return np.asarray((middle + np.einsum("q,kqi->ki", half, x[:, 1:].magnitude)) * SLACK)

    def doubted(x: Affine) -> Array:
        return np.asarray(np.einsum("q,kqi->ki", span, x[:, 1:].magnitude) * SLACK)

    def about(x: Affine, place: Array, half: Array) -> Affine:
        middle, spread = _combined(x, place), np.einsum("q,kqij->kij", half, x[:, 1:].magnitude)
        return Affine(middle.mid, middle.lin, (middle.rad + spread) * SLACK, middle.boxed)

    least, greatest = (np.where(own.adds, end, centre) for end in (own.lower, own.upper))
    others = np.where(own.adds, 0.0, half)
    along = np.einsum("kqi,ki->kq", columns[:, 1:].magnitude, room[:, n:]) ** 2 @ own.gains.adaptation
    return CellBounds(
        inertia=about(inertia, centre, half),
        least=about(inertia, least, others),
        most=about(inertia, greatest, others),
        doubt=doubted(columns),
        doubt_rate=doubted(rates),
        force=most(columns),
        force_rate=most(rates),
        coupling=most(coupled),
        adapted=along * SLACK,
    )


def _middle(lower: Array, upper: Array) -> tuple[Array, Array]:
    """A box's middle as doubles, and how far its ends are from there at most, to a rounding that `SLACK` covers."""
    centre = 0.5 * (lower + upper)
    return centre, np.maximum(upper - centre, centre - lower)


def _combined(x: Affine, place: Array) -> Affine:
    """Columns (K, 1 + k, …) at a place θ of the box."""
    letters = "ijm"[: x.mid.ndim - 2]
    return product(f"kq{letters},q->k{letters}", x, np.append(1.0, place))
