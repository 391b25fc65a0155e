"""A tube round one enclosed motion that holds all motions from a set of starts.

Theorem Z of `ccpin/proof/theorems/motion_tube.md`, whose names A_m, L, M, P, X, Y, H, G, z₀ and u are used here. All of
it is computed in doubles rounded outwards (`ccpin.validated.arithmetic.ball_arrays`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.validated.arithmetic.ball_arrays import BallArray, exactly, inverse, joined, raised
from ccpin.validated.flow.step import ProvenStep
from ccpin.validated.loop_equations import ClosedLoopEquations
from ccpin.validated.sets.curvature import Curvature, UnboundedError, boxes, curvature_over, feedback
from ccpin.validated.sets.instants import Instants, beginning

_TIGHT = 1e-7  # of an image, above it: 3 asks for a strict inequality
_TRIES = 60  # images, each begun a little above the one before
_THIN = "the tube's cross-section is too thin in some direction for the arithmetic"


class SliceFrames(NamedTuple):
    """What the tube is written in: A_m, L, M of each slice, doubles of shape (B, N, N)."""

    frame: Array
    rate: Array
    curve: Array


class CrossSection(NamedTuple):
    """A cross-section of the tube: frame A, of shape (N, N), and bound of |z|."""

    frame: BallArray
    bound: Array


class HeldSlice(NamedTuple):
    """What is proven of a slice.

    Attributes:
        bound: u, of shape (N,).
        kept: z₀ + hGu, of shape (N,).
        reach: Half-widths |A_m||P|u of the tube about ξ̄, of shape (N,).
        end: A at the slice's end, of shape (N, N).
    """

    bound: Array
    kept: Array
    reach: Array
    end: BallArray


class _TubeTerms(NamedTuple):
    """G = constant + Σ_k quadratic_k u_k by slices; A at their beginnings and ends."""

    constant: Array
    quadratic: Array
    begin: BallArray
    end: BallArray


def handed_on(frame: Array, section: CrossSection, gains: BallArray | None = None) -> Array:
    """Bounds of |z| in another frame of all that a cross-section holds: |A⁺⁻¹A||z|.

    At a sample deviations (e, e_u) of (q, q̇) and the efforts become (e, Ke).

    Args:
        frame: A⁺, of shape (N, N).
        section: The cross-section; before the first slice of (q, q̇) alone.
        gains: K, of shape (motors, 2n), at a sample.

    Raises:
        UnboundedError: A⁺ is nearly singular.
    """
    held, back = section.frame, inverse(exactly(frame))
    if back is None:
        raise UnboundedError(_THIN)
    if gains is not None:
        states = held.at(np.s_[: gains.mid.shape[1]])
        held = joined(states, gains @ states)
    return raised((back @ held).size @ section.bound)


def gains_about(loop: ClosedLoopEquations, step: ProvenStep, section: CrossSection, cells: int) -> BallArray:
    """The range of ∂u/∂(q, q̇) over a cross-section where a step of a sampled loop begins.

    Raises:
        UnboundedError: The motors' efforts are not proven to exist there.
    """
    reach = raised(section.frame.at(np.s_[: 2 * loop.n]).size @ section.bound)
    return feedback(loop, beginning(step), reach, cells).at(0)


def advance(
    loop: ClosedLoopEquations,
    instants: Instants,
    slope: BallArray,
    moving: SliceFrames,
    before: CrossSection,
    room: Array,
    cells: int,
) -> list[HeldSlice]:
    """The slices proven, in order, up to the first whose tube does not fit into the room for it.

    The theorem's 1 is `boxes`, its 2 `_terms`, its 3 `_fitting`.

    Args:
        loop: The closed loop.
        instants: B slices.
        slope: F′ at their middles, of shape (B, N, N).
        moving: Their frames.
        before: The cross-section at the first slice's beginning.
        room: The bounds of |z| for which σ and F″ are bounded on the slices, of shape (B, N).
        cells: Into how many intervals each coordinate of a cross-section is cut.

    Raises:
        UnboundedError: σ, ψ_q′ or D is not proven regular on boxes with that room.
    """
    stretch = _stretch(instants.half, moving)
    wide = raised(np.abs(moving.frame) @ (stretch @ room[:, :, None]))[:, :, 0]
    around = boxes(loop, instants, wide, cells)
    terms = _terms(instants.half, moving, curvature_over(loop, instants, slope, around), stretch)
    (last, bound), found = before, list[HeldSlice]()
    for k in range(len(room)):
        turned = inverse(terms.begin.at(k))
        if turned is None:
            break
        start = raised((turned @ last).size @ bound)
        fitting = _fitting(terms.constant[k], terms.quadratic[k], 2 * instants.half[k], start, room[k])
        if fitting is None:
            break
        inside, bound = fitting
        last = terms.end.at(k)
        reach = raised(np.abs(moving.frame[k]) @ (stretch[k] @ inside))
        found.append(HeldSlice(inside, bound, reach, last))
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
    frame, rate, curve, t = (exactly(x) for x in (*moving, time))
    back = inverse(frame)
    off = stretch - np.eye(size)
    delta = off.sum(axis=2).max(axis=1) * (1.0 + 1e-12)
    if back is None or not np.all(delta < 0.9):
        raise UnboundedError(_THIN)
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
