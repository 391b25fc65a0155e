"""Tubes: about a segment of x-space exactly one curve of singular configurations, from end to end.

Theorem R, its bounds and what gluing proves are in `ccpin/proof/theorems/tubes.md`, whose names x, t, δ, R and P are
used here.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, Mask, apply, inverses, rows_of
from ccpin.proof.curves.curve_equations import Values, drift, first_order, rounding_at, values_at
from ccpin.proof.equations import Problem
from ccpin.proof.newton import without_turns
from ccpin.proof.rounding import SLACK

_WIDEN = 1e-13  # of 1 + |x|: far above its roundings
_ROUNDS = 4  # of |e| ≤ Y + Z|e|
_CHORDS = 4  # steps to a zero
_CLOSE = 1e-4  # of the radii: an enclosure so small will do
_BACK = (0.4, 0.1)  # of δ: how far before its middle a zero is sought


class Tubes(NamedTuple):
    """T tubes, exactly the data of Theorem R.

    Attributes:
        theta, kernel: x₀, of shapes (T, n′) and (T, m).
        pairing: l, of shape (T, m).
        along: j, of shape (T,).
        tangent: t, of shape (T, N).
        half: δ, of shape (T,).
        radius: R, of shape (T, N).
        gain: P, of shape (T, N, M).
        kappa: κ, of shape (T,).
        hull: The curve has |e| ≤ this, of shape (T, N).
    """

    theta: Array
    kernel: Array
    pairing: Array
    along: Indices
    tangent: Array
    half: Array
    radius: Array
    gain: Array
    kappa: Array
    hull: Array

    def take(self, rows: Indices | Mask) -> Tubes:
        """Some of them."""
        return rows_of(self, rows)

    def turned(self) -> Tubes:
        """The same tubes with s the other way."""
        return self._replace(tangent=-self.tangent)

    @property
    def x(self) -> Array:
        """x₀, of shape (T, N)."""
        return np.concatenate([self.theta, self.kernel], axis=1)


def no_tubes(problem: Problem) -> Tubes:
    """None of a problem's tubes."""
    m, size = problem.system.m, problem.system.n_free
    columns = {"theta": size, "kernel": m, "pairing": m, "tangent": size + m, "radius": size + m, "hull": size + m}
    return Tubes(
        **{name: np.zeros((0, width)) for name, width in columns.items()},
        along=np.zeros(0, dtype=np.intp),
        half=np.zeros(0),
        gain=np.zeros((0, size + m, 2 * m + 1)),
        kappa=np.zeros(0),
    )


class Frames(NamedTuple):
    """Where tubes are to be: j (B,), t (B, N) and P (B, N, M)."""

    along: Indices
    tangent: Array
    gain: Array


class Stated(NamedTuple):
    """What a tube is: the data of Theorem R but for P, which may be any, and for κ and |e|, which follow.

    Attributes:
        theta, kernel, pairing, along, tangent, half, radius: As for `Tubes`.
    """

    theta: Array
    kernel: Array
    pairing: Array
    along: Indices
    tangent: Array
    half: Array
    radius: Array


def stated(tubes: Tubes) -> Stated:
    """What tubes are."""
    return Stated(*(getattr(tubes, name) for name in Stated._fields))


def proved_again(problem: Problem, given: Stated) -> TriedTubes:
    """Tubes that are stated, with the P, κ and bounds of |e| that follow, and whether Theorem R holds for each."""
    values = values_at(problem, given.theta, given.kernel, given.pairing)
    frames = Frames(given.along, given.tangent, inverse_without(values.slope, given.along))
    return certify_tubes(problem, values, frames, given.half, given.radius)


def frames_at(slope: Array, forward: Array | None = None) -> Frames:
    """The frames for G′ (B, M, N): the tangent, its largest component, and the inverse without that.

    The tangents point along `forward` (N,), if that is given.
    """
    along, tangent = tangents_at(slope, forward)
    return Frames(along, tangent, inverse_without(slope, along))


def tangents_at(slope: Array, forward: Array | None = None) -> tuple[Indices, Array]:
    """The largest component of each tangent, of shape (B,), and the tangents, of length 1 there, (B, N)."""
    tangent = np.linalg.svd(slope)[2][:, -1]
    if forward is not None:
        tangent = np.where((tangent @ forward)[:, None] < 0.0, -tangent, tangent)
    along = np.argmax(np.abs(tangent), axis=1)
    return along, tangent / np.abs(np.take_along_axis(tangent, along[:, None], axis=1))


def inverse_without(slope: Array, along: Indices) -> Array:
    """The inverses of G′ (B, M, N) without columns j (B,), rows of zeros in their places, of shape (B, N, M)."""
    count, m, n = slope.shape
    others = np.argsort(np.arange(n)[None] == along[:, None], axis=1, kind="stable")[:, :m]
    gain = np.zeros((count, n, m))
    square = np.take_along_axis(slope, others[:, None], axis=2)
    np.put_along_axis(gain, others[:, :, None], inverses(square), axis=1)
    return gain


class TubeBounds(NamedTuple):
    """Y and Z of B boxes x = x₀ + s t + e: (B, N) and (B, N, N)."""

    y: Array
    z: Array


def bounds_of(problem: Problem, values: Values, frames: Frames, half: Array, radius: Array) -> TubeBounds:
    """The bounds of Theorem R for half lengths δ (B,) and radii R (B, N)."""
    n_free, n = problem.system.n_free, values.slope.shape[2]
    gain, size = frames.gain, np.abs(frames.gain)
    room = _room(values.x)
    half = half * (1.0 + 2.0**-50) + room.max(axis=1)
    length = np.abs(frames.tangent) * half[:, None]
    box = length + radius + room
    off = drift(problem, values, box)
    curved = (gain @ values.bend.reshape(*values.slope.shape[:2], n * n)).reshape(*gain.shape[:2], n, n)
    along = apply(curved, frames.tangent[:, None])
    weighted = gain @ values.slope
    noise = size.sum(axis=2) * values.rounding[:, None]
    turn, spread = length[:, :n_free].sum(axis=1)[:, None], length[:, n_free:].sum(axis=1)[:, None]
    second = apply(size, off.turned * turn**2 + 2.0 * off.mixed * turn * spread)
    y = np.abs(apply(gain, values.value)) + np.abs(apply(weighted, frames.tangent)) * half[:, None]
    y += 0.5 * np.abs(apply(along, frames.tangent)) * half[:, None] ** 2 + 0.5 * second
    y += noise * (1.0 + length.sum(axis=1))[:, None] ** 2
    by_theta, by_kernel = off.along(size, box[:, :n_free].sum(axis=1), box[:, n_free:].sum(axis=1))
    z = np.abs(np.eye(n) - weighted) + np.abs(along) * half[:, None, None]
    z += (radius[:, None, None] @ np.abs(curved))[:, :, 0]
    z[..., :n_free] += by_theta[..., None]
    z[..., n_free:] += by_kernel[..., None]
    z += (noise * (1.0 + box.sum(axis=1))[:, None])[..., None]
    rows = np.arange(len(z))
    z[rows, frames.along], z[rows, :, frames.along], y[rows, frames.along] = 0.0, 0.0, 0.0
    return TubeBounds(y, z)


class TriedTubes(NamedTuple):
    """Tubes tried, and which of them are proved (the others' numbers mean nothing)."""

    tubes: Tubes
    proved: Mask


def certify_tubes(problem: Problem, values: Values, frames: Frames, half: Array, radius: Array) -> TriedTubes:
    """Check Theorem R for tubes with half lengths δ (B,) and radii R (B, N)."""
    with np.errstate(all="ignore"):
        bounds = bounds_of(problem, values, frames, half, radius)
        image = bounds.y + apply(bounds.z, radius)
        inner = np.arange(radius.shape[1])[None] != frames.along[:, None]
        share = np.where(inner, apply(bounds.z, radius) / radius, 0.0)
        kappa = share.max(axis=1) * SLACK
        proved = np.all((image * SLACK < radius) | ~inner, axis=1) & (kappa < 1.0)
        hull = radius
        for _ in range(_ROUNDS):
            hull = np.minimum(hull, (bounds.y + apply(bounds.z, hull)) * SLACK)
    tubes = Tubes(
        theta=values.theta,
        kernel=values.kernel,
        pairing=values.pairing,
        along=frames.along,
        tangent=frames.tangent,
        half=half,
        radius=radius,
        gain=frames.gain,
        kappa=kappa,
        hull=hull,
    )
    return TriedTubes(tubes, proved)


def _room(x: Array) -> Array:
    """What tubes about points (…, N) are longer and wider by: what is asked of rounded points is asked inside."""
    return _WIDEN * (1.0 + np.abs(x))


class Points(NamedTuple):
    """Zeros of G: x (B, N) within an error (B, N)."""

    x: Array
    error: Array


def zeros_in(problem: Problem, tubes: Tubes, s: Array) -> Points:
    """The curve's points at parameters |s| ≤ δ of tubes, of shape (T,)."""
    size, x = problem.system.n_free, tubes.x + tubes.tangent * s[:, None]
    for _ in range(_CHORDS):
        step = apply(tubes.gain, first_order(problem, x[:, :size], x[:, size:], tubes.pairing)[0])
        if np.all(np.abs(step) <= _CLOSE * tubes.radius):
            break
        inside = np.abs(x - step - tubes.x - tubes.tangent * s[:, None]) <= tubes.radius
        x = np.where(inside.all(axis=1, keepdims=True), x - step, x)
    else:
        step = apply(tubes.gain, first_order(problem, x[:, :size], x[:, size:], tubes.pairing)[0])
    noise = rounding_at(problem, x[:, :size], x[:, size:], tubes.pairing)[:, None]
    left = np.abs(step) + np.abs(tubes.gain).sum(axis=2) * noise
    share = (left / np.where(tubes.radius > 0.0, tubes.radius, np.inf)).max(axis=1) / (1.0 - tubes.kappa)
    return Points(x, share[:, None] * tubes.radius * SLACK + _room(x))


class Places(NamedTuple):
    """Where points are in tubes: whether surely inside (B,), and s (B,) within an error (B,)."""

    inside: Mask
    s: Array
    error: Array


def places_in(problem: Problem, points: Points, tubes: Tubes) -> Places:
    """Where points lie in the tubes beside them, w divided by the tube's lᵀw; angles modulo 2π."""
    size, rows = problem.system.n_free, np.arange(len(tubes.half))
    kernel, spread = points.x[:, size:], points.error[:, size:]
    scale = np.sum(tubes.pairing * kernel, axis=1, keepdims=True)
    blur = np.sum(np.abs(tubes.pairing) * spread, axis=1, keepdims=True) * SLACK + _WIDEN
    with np.errstate(all="ignore"):
        scaled = kernel / scale
        spread = (spread + np.abs(scaled) * blur) / (np.abs(scale) - blur)
        spread = np.where(np.isfinite(spread), spread, np.inf)
    gap = np.concatenate([without_turns(points.x[:, :size] - tubes.theta, problem.system.periodic), scaled], axis=1)
    gap[:, size:] -= tubes.kernel
    error = np.concatenate([points.error[:, :size], spread], axis=1) + _room(points.x)
    s, wide = gap[rows, tubes.along] * tubes.tangent[rows, tubes.along], error[rows, tubes.along]
    off = np.abs(gap - tubes.tangent * s[:, None]) + error + np.abs(tubes.tangent) * wide[:, None]
    off[rows, tubes.along] = 0.0
    inside = (np.abs(scale[:, 0]) > blur[:, 0]) & (np.abs(s) + wide <= tubes.half)
    return Places(inside & np.all(off * SLACK <= tubes.radius, axis=1), s, wide)


def glued(problem: Problem, tubes: Tubes, following: Tubes) -> Mask:
    """Whether each tube's curve is that of the one following it, and runs on in it the same way; of shape (T,)."""
    same = _begin_in(problem, following, tubes)
    rows = np.flatnonzero(~same)
    if rows.size:
        same[rows] = _begin_in(problem, tubes.take(rows).turned(), following.take(rows).turned())
    return same


def _begin_in(problem: Problem, tubes: Tubes, before: Tubes) -> Mask:
    """Whether two zeros of each tube, its middle one and one before that, lie so in the tube before it, (T,)."""
    last = places_in(problem, zeros_in(problem, tubes, np.zeros(len(tubes.half))), before)
    same, ahead = np.zeros(len(last.s), dtype=np.bool_), last.inside & (last.s > last.error)
    for part in _BACK:
        if not np.any(ahead & ~same):
            break
        first = places_in(problem, zeros_in(problem, tubes, -part * tubes.half), before)
        same |= ahead & first.inside & (last.s - first.s > last.error + first.error)
    return same
