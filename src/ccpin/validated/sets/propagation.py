"""A tube grown along an enclosed motion: frames, room and batches are chosen here, and proved by the tube theorem.

Frames follow the linearised flow, which turns their edges towards one another. Before they are nearly parallel the tube
is put into an orthogonal frame (Lohner's: the columns' QR factors, the longest column first).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.proof.facts import Fact, NotProvedError, prove
from ccpin.validated.arithmetic.ball_arrays import BallArray, exactly
from ccpin.validated.flow.marching import QUANTUM
from ccpin.validated.flow.step import ProvenStep
from ccpin.validated.loop_equations import ClosedLoopEquations
from ccpin.validated.sets.branch import Jets
from ccpin.validated.sets.curvature import UnboundedError, at_middles, feedback
from ccpin.validated.sets.instants import Instants, instants_over
from ccpin.validated.sets.slices_claim import SlicesHeld, last_section, middles_of
from ccpin.validated.sets.tube_theorem import CrossSection, SliceFrames, gains_about, handed_on

_FINE = 0.04  # slices of this over the fastest rate of the linearised flow,
_STRIDE = 3e-3  # in which nothing moves farther from the middle, rad or m (velocities: over that rate)
_FINER = 4  # times a slice may be halved where it fails
_AT_ONCE = 512  # pieces of boxes at a time
_ROOM = 1.15  # of the spread that the linearised flow may have: what the nonlinear one gets
_AIR = 0.05  # of the largest spread, besides: for edges that are nearly none
_THINNEST = 0.02  # of a frame's edges, against the others
_GROWTH = 20.0  # of what the linearised flow makes of the tube: wider ones are given up
_PARALLEL = 60.0  # condition number of a frame's edges, from which on Lohner's frame is taken
_HANDED = 1.0 + 1e-13  # of a bound handed on: what another machine makes of it is in it as well


class Cut(NamedTuple):
    """How finely a tube is cut.

    Attributes:
        pieces: Into how many intervals each coordinate of a cross-section is cut.
        longest: The longest slice, s; infinite: as the flow's rates ask for.
    """

    pieces: int
    longest: float


def first_section(loop: ClosedLoopEquations, step: ProvenStep, spread: Array) -> CrossSection:
    """The box of starts in a frame no edge of which is much thinner than the others, as the flow mixes them."""
    units = _units(loop, fastest_rate(loop, whole_of(step)))
    edges = np.diag(np.maximum(spread, _THINNEST * units * (spread / units).max()))
    return in_frame(edges, CrossSection(exactly(np.eye(len(spread))), spread))


def in_frame(frame: Array, section: CrossSection, gains: BallArray | None = None) -> CrossSection:
    """A cross-section in another frame, with all that it holds."""
    return CrossSection(exactly(frame), handed_on(frame, section, gains) * _HANDED)


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
    units, rows = _units(loop, fastest_rate(loop, whole_of(step))), section.frame.mid[:size]
    begin = _turned(rows[:, :size], section.bound[:size], units)
    bound = np.abs(np.linalg.solve(begin, rows)) @ section.bound
    gains = gains_about(loop, step, section, cut.pieces)
    along = gains.mid @ begin
    edges = np.maximum(_THINNEST * (np.abs(along) @ bound), gains.rad @ np.abs(begin) @ bound)
    frame = np.block([[begin, np.zeros((size, len(along)))], [along, np.diag(edges)]])
    return in_frame(frame, section, gains)


def grow(loop: ClosedLoopEquations, step: ProvenStep, section: CrossSection, cut: Cut, bits: int) -> Iterator[Fact]:
    """Facts about slices over one step of the enclosed motion, from a cross-section where it begins.

    Raises:
        UnboundedError: The tube could not be proven on a slice; those before it were given.
    """
    assert step.fact is not None, "the step of a closed loop"
    whole = whole_of(step)
    rate = fastest_rate(loop, whole)
    moved = np.abs(whole.during.mid - whole.middle.mid)[0] + whole.during.rad[0]
    moved[loop.n_x :] /= max(rate, 1.0)
    count = math.ceil(max(step.length / cut.longest, step.length * rate / _FINE, moved.max() / _STRIDE, 1.0))
    finest, marks = count << _FINER, marks_over(step.length, count)
    batch = most = max(1, _AT_ONCE // cut.pieces**loop.n)
    done = 0
    while done < count:
        try:
            found = _proved(loop, step.fact, marks[done : done + batch + 1], section, cut, bits, rate)
        except (NotProvedError, UnboundedError, np.linalg.LinAlgError) as error:
            if batch > 1:
                batch //= 2
            elif count < finest:
                count, done = 2 * count, 2 * done
                marks = marks_over(step.length, count)
            else:
                raise UnboundedError(str(error)) from None
            continue
        held = len(found.found["bound"])
        batch = min(most, 2 * held)
        done += held
        yield found
        if growth(found) > _GROWTH:
            raise UnboundedError(f"the tube has grown to {_GROWTH:g} times what the linearised flow makes of it")
        section = last_section(found)


def _proved(
    loop: ClosedLoopEquations, step: Fact, marks: Array, section: CrossSection, cut: Cut, bits: int, rate: float
) -> Fact:
    """The fact about some slices from a cross-section, in frames that are begun in it."""
    last = section.frame.mid
    bound = in_frame(last, section).bound
    with np.errstate(all="ignore"):  # what is not finite is not proven
        begin = _turned(last, bound, _units(loop, rate)) if loop.efforts is None else last
        spread = np.abs(np.linalg.solve(begin, last)) @ bound
        room = np.tile(_ROOM * spread + _AIR * spread.max(), (len(marks) - 1, 1))
        moving = frames(*middles_of(loop, step, marks, bits), begin)
    cells, precision = np.array([cut.pieces]), np.array([bits])
    return prove(SlicesHeld(loop, marks, *moving, room, last, bound, cells, precision), step)


def frames(instants: Instants, middle: Jets, begin: Array) -> SliceFrames:
    """Frames that follow the linearised flow from a frame at the first slice's beginning."""
    curve = np.einsum("bijk,bk->bij", middle.bend.mid, middle.value.mid) + middle.slope.mid @ middle.slope.mid
    found, identity = [], np.eye(begin.shape[0])
    for half, first, second in zip(instants.half, middle.slope.mid, curve, strict=True):
        before, after = (identity + t * first + 0.5 * t**2 * second for t in (-half, half))
        frame = np.linalg.solve(before, begin)
        back = np.linalg.inv(frame)
        found.append((frame, back @ first @ frame, back @ second @ frame))
        begin = after @ frame
    return SliceFrames(*(np.array(part) for part in zip(*found, strict=True)))


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


def growth(slices: Fact) -> float:
    """How much larger a tube is than the linearised flow's image of the starts' box, at the end of slices."""
    reach = slices.found["reach"]
    return float((reach[-1] / np.abs(slices.claim.frame[len(reach) - 1]).sum(axis=1)).max())


def whole_of(step: ProvenStep) -> Instants:
    """A step as one slice."""
    return instants_over(step, marks_over(step.length, 1))


def marks_over(length: float, count: int) -> Array:
    """So many slices' ends over a length, multiples of 2⁻⁴⁰ s and so exact; twice as many keep the cuts."""
    units = round(length / QUANTUM)
    return np.array([units * k // count * QUANTUM for k in range(count + 1)])
