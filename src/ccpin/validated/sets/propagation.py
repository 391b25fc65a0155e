"""A tube grown along an enclosed motion: frames, room and batches are chosen here, and proved by the tube theorem.

Frames follow the linearised flow, which turns their edges towards one another. Before they are nearly parallel the tube
is put into an orthogonal frame (Lohner's: the columns' QR factors, the longest column first).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.validated.arithmetic.ball_arrays import BallArray, exactly, inverse, of_balls, raised
from ccpin.validated.arithmetic.balls import Ball, around, ball
from ccpin.validated.flow.marching import QUANTUM
from ccpin.validated.flow.step import ProvenStep
from ccpin.validated.loop_equations import ClosedLoopEquations
from ccpin.validated.sets.curvature import Instants, UnboundedError, at_middles, feedback
from ccpin.validated.sets.tube_theorem import TimeSlice, advance, frames

_FINE = 0.04  # slices of this over the fastest rate of the linearised flow,
_STRIDE = 3e-3  # in which nothing moves farther from the middle, rad or m (velocities: over that rate)
_FINER = 4  # times a slice may be halved where it fails
_AT_ONCE = 512  # pieces of boxes at a time
_ROOM = 1.15  # of the spread that the linearised flow may have: what the nonlinear one gets
_AIR = 0.05  # of the largest spread, besides: for edges that are nearly none
_THINNEST = 0.02  # of a frame's edges, against the others
_GROWTH = 20.0  # of what the linearised flow makes of the tube: wider ones are given up
_PARALLEL = 60.0  # condition number of a frame's edges, from which on Lohner's frame is taken


class Cut(NamedTuple):
    """How finely a tube is cut.

    Attributes:
        pieces: Into how many intervals each coordinate of a cross-section is cut.
        longest: The longest slice, s; infinite: as the flow's rates ask for.
    """

    pieces: int
    longest: float


class CrossSection(NamedTuple):
    """A cross-section of the tube: frame A and bound of |z|."""

    frame: BallArray
    bound: Array


def first_section(loop: ClosedLoopEquations, start: Instants, spread: Array) -> CrossSection:
    """The box of starts in a frame no edge of which is much thinner than the others, as the flow mixes them."""
    units = _units(loop, fastest_rate(loop, start))
    edges = np.maximum(spread, _THINNEST * units * (spread / units).max())
    return CrossSection(exactly(np.diag(edges)), np.minimum(spread / edges * (1.0 + 1e-15), 1.0))


def fastest_rate(loop: ClosedLoopEquations, instants: Instants) -> float:
    """The largest rate 1/s of the linearised flow at some slices' middles."""
    slope, size = at_middles(loop, instants).slope.mid, 2 * loop.n
    if loop.efforts is not None:
        slope = slope[:, :size, :size] + slope[:, :size, size:] @ feedback(loop, instants, None, 1).mid
    return float(np.abs(np.linalg.eigvals(slope)).max())


def sampled_section(loop: ClosedLoopEquations, step: ProvenStep, section: CrossSection, cut: Cut) -> CrossSection:
    """A cross-section (q, q̇, …) of a sampled loop just after a sample: the law's efforts follow from q and q̇.

    e_u = Ke, e the deviation of (q, q̇) and K in the range of ∂u/∂(q, q̇) over a box about the cross-section. With F in
    its middle a frame with the columns (B, FB) and (0, ε) has ε z_u = (K − F)Bz there.
    """
    size = 2 * loop.n
    units = _units(loop, fastest_rate(loop, instants_of(step, 0.0, 1)))
    rows = section.frame.at(np.s_[:size])
    begin = _turned(rows.mid[:, :size], section.bound[:size], units)
    back = inverse(exactly(begin))
    if back is None:
        raise UnboundedError("the tube's cross-section is too thin in some direction for the arithmetic")
    bound = raised((back @ rows).size @ section.bound)
    reach = raised(rows.size @ section.bound)
    gains = feedback(loop, beginning(step), reach, cut.pieces).at(0)
    along = gains.mid @ begin
    off = (gains @ exactly(begin) - exactly(along)).size
    edges = np.maximum(_THINNEST * (np.abs(along) @ bound), off @ bound)
    frame = np.block([[begin, np.zeros((size, len(along)))], [along, np.diag(edges)]])
    return CrossSection(exactly(frame), np.append(bound, raised(raised(off @ bound) / edges)))


def grow(
    loop: ClosedLoopEquations, step: ProvenStep, since: float, section: CrossSection, cut: Cut
) -> Iterator[list[TimeSlice]]:
    """Batches of slices over one step of the enclosed motion.

    Raises:
        UnboundedError: The tube could not be proven on a slice; those before it were given.
    """
    whole = instants_of(step, since, 1)
    rate = fastest_rate(loop, whole)
    moved = np.abs(whole.during.mid - whole.middle.mid)[0] + whole.during.rad[0]
    moved[loop.n_x :] /= max(rate, 1.0)
    count = math.ceil(max(step.length / cut.longest, step.length * rate / _FINE, moved.max() / _STRIDE, 1.0))
    finest, instants = count << _FINER, instants_of(step, since, count)
    batch = most = max(1, _AT_ONCE // cut.pieces**loop.n)
    last, bound = section
    done = 0
    while done < len(instants.time):
        part = instants.part(np.s_[done : done + batch])
        begin = last.mid
        if loop.efforts is None:
            begin = _turned(begin, bound, _units(loop, rate))
        spread = np.abs(np.linalg.solve(begin, last.mid)) @ bound
        room = np.tile(_ROOM * spread + _AIR * spread.max(), (len(part.time), 1))
        try:
            with np.errstate(all="ignore"):  # what is not finite is not proven
                found = advance(loop, part, frames(loop, part, begin), (last, bound), room, cut.pieces)
            missing = "the tube grows too fast"
        except (UnboundedError, np.linalg.LinAlgError) as error:
            found, missing = [], str(error)
        if not found and batch > 1:
            batch //= 2
        elif not found and count < finest:
            count, done = 2 * count, 2 * done
            instants = instants_of(step, since, count)
        elif not found:
            raise UnboundedError(missing)
        if not found:
            continue
        batch = min(most, 2 * len(found))
        done += len(found)
        last, bound = found[-1].end, found[-1].kept
        yield found
        if growth(found[-1]) > _GROWTH:
            raise UnboundedError(f"the tube has grown to {_GROWTH:g} times what the linearised flow makes of it")


def _units(loop: ClosedLoopEquations, rate: float) -> Array:
    """In what edges of a cross-section (q, q̇) are compared, of shape (2n,)."""
    return np.repeat([1.0, max(rate, 1.0)], loop.n)


def _turned(frame: Array, bound: Array, units: Array) -> Array:
    """The frame itself, or Lohner's where its edges, in these units, are nearly parallel."""
    edges = frame * bound / units[:, None]
    lengths = np.linalg.norm(edges, axis=0)
    if np.linalg.cond(edges / np.maximum(lengths, 1e-3 * lengths.max())) < _PARALLEL:
        return frame
    orthogonal = np.linalg.qr(edges[:, np.argsort(-lengths)])[0]
    widths = np.abs(orthogonal.T @ edges).sum(axis=1)
    return np.asarray(units[:, None] * orthogonal * np.maximum(widths, _THINNEST * widths.max()))


def growth(piece: TimeSlice) -> float:
    """How much larger a tube is than the linearised flow's image of the starts' box."""
    return float((piece.reach / np.abs(piece.frame).sum(axis=1)).max())


def beginning(step: ProvenStep) -> Instants:
    """A step's first moment."""
    at = of_balls([step.box(ball(0))])
    return Instants(np.zeros(1), np.zeros(1), at, at)


def instants_of(step: ProvenStep, since: float, count: int) -> Instants:
    """A step as so many slices, all times multiples of 2⁻⁴¹ s and so exact; twice as many keep the cuts.

    Args:
        step: The step.
        since: When it begins, s.
        count: How many.
    """
    units = round(step.length / QUANTUM)
    marks = [units * k // count * QUANTUM for k in range(count + 1)]
    middle, during = list[list[Ball]](), list[list[Ball]]()
    times, halves = list[float](), list[float]()
    for first, last in pairwise(marks):
        centre, half = 0.5 * (first + last), 0.5 * (last - first)
        middle.append(step.box(ball(centre)))
        during.append(step.box(around(ball(centre), ball(half))))
        times.append(since + centre)
        halves.append(half)
    return Instants(np.array(times), np.array(halves), of_balls(middle), of_balls(during))
