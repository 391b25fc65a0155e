"""A tube round one enclosed motion that holds all motions from a set of starts.

Theorem Z of `ccpin/proof/theorems/motion_tube.md`, whose names A_m, L, M, P, X, Y, H, G, z₀ and u are used here. All of
it is computed in doubles rounded outwards (`ccpin.validated.arithmetic.ball_arrays`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.validated.arithmetic.ball_arrays import BallArray, exactly, inverse, raised
from ccpin.validated.loop_equations import ClosedLoopEquations
from ccpin.validated.sets.curvature import Curvature, Instants, UnboundedError, at_middles, boxes, curvature_over

_TIGHT = 1e-7  # of an image, above it: 3 asks for a strict inequality
_TRIES = 60  # images, each begun a little above the one before


class SliceFrames(NamedTuple):
    """What the tube is written in: A_m, L, M of each slice, doubles, and F′ at its middle, of shape (B, N, N)."""

    frame: Array
    rate: Array
    curve: Array
    slope: BallArray


class TimeSlice(NamedTuple):
    """A slice of the tube, proven.

    Attributes:
        instant: The slice, alone (B = 1).
        frame, rate, curve: A_m, L, M, of shape (N, N).
        end: A at the slice's end, of shape (N, N).
        bound: u, of shape (N,).
        kept: z₀ + hGu, of shape (N,).
        reach: Half-widths |A_m||P|u of the tube about ξ̄, of shape (N,).
    """

    instant: Instants
    frame: Array
    rate: Array
    curve: Array
    end: BallArray
    bound: Array
    kept: Array
    reach: Array

    @property
    def time(self) -> float:
        """t_m in seconds."""
        return float(self.instant.time[0])


class _TubeTerms(NamedTuple):
    """G = constant + Σ_k quadratic_k u_k by slices; A at their beginnings and ends."""

    constant: Array
    quadratic: Array
    begin: BallArray
    end: BallArray


def frames(loop: ClosedLoopEquations, instants: Instants, begin: Array) -> SliceFrames:
    """Frames that follow the linearised flow from a frame at the first slice's beginning: chosen, not proven.

    Raises:
        UnboundedError: The closed loop is not proven regular at the middles.
    """
    middle = at_middles(loop, instants)
    curve = np.einsum("bijk,bk->bij", middle.bend.mid, middle.value.mid) + middle.slope.mid @ middle.slope.mid
    found, identity = [], np.eye(begin.shape[0])
    for half, first, second in zip(instants.half, middle.slope.mid, curve, strict=True):
        before, after = (identity + t * first + 0.5 * t**2 * second for t in (-half, half))
        frame = np.linalg.solve(before, begin)
        back = np.linalg.inv(frame)
        found.append((frame, back @ first @ frame, back @ second @ frame))
        begin = after @ frame
    chosen = (np.array(part) for part in zip(*found, strict=True))
    return SliceFrames._make([*chosen, middle.slope])


def advance(
    loop: ClosedLoopEquations,
    instants: Instants,
    moving: SliceFrames,
    before: tuple[BallArray, Array],
    room: Array,
    pieces: int,
) -> list[TimeSlice]:
    """The slices proven, in order, up to the first whose tube does not fit into the room for it.

    The theorem's 1 is `boxes`, its 2 `_terms`, its 3 `_fitting`.

    Args:
        loop: The closed loop.
        instants: B slices.
        moving: Their frames.
        before: A and the bound of |z| at the first slice's beginning.
        room: The bounds of |z| for which σ and F″ are bounded on the slices, of shape (B, N).
        pieces: Into how many intervals each coordinate of a cross-section is cut.

    Raises:
        UnboundedError: σ, ψ_q′ or D is not proven regular on boxes with that room.
    """
    stretch = _stretch(instants.half, moving)
    wide = raised(np.abs(moving.frame) @ (stretch @ room[:, :, None]))[:, :, 0]
    around = boxes(loop, instants, wide, pieces)
    terms = _terms(instants.half, moving, curvature_over(loop, instants, moving.slope, around), stretch)
    last, bound, found = *before, list[TimeSlice]()
    for k in range(len(room)):
        turned = inverse(terms.begin.at(k))
        if turned is None:
            break
        start = raised((turned @ last).size @ bound)
        fitting = _fitting(terms.constant[k], terms.quadratic[k], 2 * instants.half[k], start, room[k])
        if fitting is None:
            break
        inside, bound = fitting
        last, (frame, rate, curve) = terms.end.at(k), (x[k] for x in moving[:3])
        reach = raised(np.abs(frame) @ (stretch[k] @ inside))
        found.append(TimeSlice(instants.part(np.s_[k : k + 1]), frame, rate, curve, last, inside, bound, reach))
    return found


def _fitting(constant: Array, quadratic: Array, h: float, start: Array, room: Array) -> tuple[Array, Array] | None:
    """u ≤ room with z₀ + hGu < u (the theorem's 3), and z₀ + hGu; ``None`` where none was found."""
    inside = start
    for _ in range(_TRIES):
        kept = raised(start + h * raised(raised(constant + quadratic @ inside) @ inside))
        if not np.all(kept < room):  # NaN too
            return None
        if np.all(kept < inside):
            return inside, kept
        inside = np.minimum(kept * (1.0 + _TIGHT) + 1e-300, room)
    return None


def _stretch(half: Array, moving: SliceFrames) -> Array:
    """Bounds I + E of |P|, of shape (B, N, N)."""
    time = half[:, None, None]
    off = time * np.abs(moving.rate) + 0.5 * time**2 * np.abs(moving.curve)
    return raised(np.eye(off.shape[-1]) + raised(off))


def _terms(half: Array, moving: SliceFrames, known: Curvature, stretch: Array) -> _TubeTerms:
    """The parts of G (the theorem's 2).

    Raises:
        UnboundedError: A slice is too long for its frame, or the frame nearly singular.
    """
    time, size = half[:, None, None], moving.frame.shape[-1]
    frame, rate, curve, t = (exactly(x) for x in (*moving[:3], time))
    back = inverse(frame)
    off = stretch - np.eye(size)
    delta = off.sum(axis=2).max(axis=1) * (1.0 + 1e-12)
    if back is None or not np.all(delta < 0.9):
        raise UnboundedError("the tube's cross-section is too thin in some direction for the arithmetic")
    unstretch = raised(stretch + (delta**2 / (1.0 - delta))[:, None, None])
    x = back @ known.slope @ frame
    y = back @ known.change @ frame
    first = (x @ rate - curve + y).size
    second = (exactly(np.array(0.5)) * (x @ curve) + y @ rate).size
    third = (y @ curve).size
    constant = (x - rate).size + raised(time * first + time**2 * second + 0.5 * time**3 * third)
    constant = raised(unstretch @ raised(constant))
    turned = known.bend @ frame.at(np.s_[:, None])  # H[·, A_m]
    turned = turned.swapped(2, 3) @ frame.at(np.s_[:, None])
    flat = BallArray(*(z.reshape(len(half), size, size * size) for z in turned))
    bilinear = raised((back @ flat).size).reshape(len(half), size, size, size)
    quadratic = np.einsum("bia,bacd,bcj,bdk->bijk", unstretch, bilinear, stretch, stretch, optimize=True)
    steps = exactly(np.eye(size)) + t * rate, exactly(0.5 * time**2) * curve
    begin = exactly(np.eye(size)) - t * rate + steps[1]
    return _TubeTerms(constant, raised(0.5 * quadratic), frame @ begin, frame @ (steps[0] + steps[1]))
