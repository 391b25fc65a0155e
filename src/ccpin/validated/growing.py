"""A tube grown along an enclosed motion: frames, room and batches are chosen here, and proved by the tube theorem."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.validated.curvature import Instants, UnboundedError, at_middles
from ccpin.validated.dynamics import ClosedLoop
from ccpin.validated.slices import instants_of
from ccpin.validated.step import Step
from ccpin.validated.tube import Slice, advance, frames
from ccpin.validated.wide import Wide, exactly

_FINE = 0.012  # slices of this over the fastest rate of the linearised flow
_AT_ONCE = 512  # pieces of boxes at a time
_ROOM, _AIR = 1.15, 0.05
_THINNEST = 0.02  # of a frame's edges, against the others
_GROWTH = 8.0


class Cut(NamedTuple):
    """How finely a tube is cut.

    Attributes:
        pieces: Into how many intervals each coordinate of a cross-section is cut.
        longest: The longest slice, s; infinite: as the flow's rates ask for.
    """

    pieces: int
    longest: float


class Section(NamedTuple):
    """A cross-section of the tube: frame A and bound of |z|."""

    frame: Wide
    bound: Array


def first_section(loop: ClosedLoop, start: Instants, spread: Array) -> Section:
    """The box of starts in a frame no edge of which is much thinner than the others, as the flow mixes them."""
    rate = fastest_rate(loop, start)
    units = np.repeat([1.0, rate], loop.n)
    edges = np.maximum(spread, _THINNEST * units * (spread / units).max())
    return Section(exactly(np.diag(edges)), np.minimum(spread / edges * (1.0 + 1e-15), 1.0))


def fastest_rate(loop: ClosedLoop, instants: Instants) -> float:
    """The largest rate 1/s of the linearised flow at some slices' middles."""
    rates = np.linalg.eigvals(at_middles(loop, instants).slope.mid)
    return max(float(np.abs(rates).max()), 1e-3)


def grow(loop: ClosedLoop, step: Step, since: float, section: Section, cut: Cut) -> Iterator[list[Slice]]:
    """Batches of slices over one step of the enclosed motion.

    Raises:
        UnboundedError: The tube could not be proven on a slice; those before it were given.
    """
    whole = instants_of(step, since, step.length)
    rate = fastest_rate(loop, whole)
    instants = instants_of(step, since, min(cut.longest, _FINE / rate))
    batch = most = max(1, _AT_ONCE // cut.pieces**loop.n)
    last, bound = section
    done = 0
    while done < len(instants.time):
        part = instants.part(np.s_[done : done + batch])
        room = np.tile(_ROOM * bound + _AIR, (len(part.time), 1))
        try:
            found = advance(loop, part, frames(loop, part, last.mid), (last, bound), room, cut.pieces)
        except UnboundedError:
            if batch == 1:
                raise
            found = []
        if not found:
            if batch == 1:
                raise UnboundedError("the tube grows too fast")
            batch = max(1, batch // 2)
            continue
        batch = min(most, 2 * len(found))
        done += len(found)
        last, bound = found[-1].end, found[-1].kept
        yield found
        if growth(found[-1]) > _GROWTH:
            raise UnboundedError(f"the tube has grown to {_GROWTH:g} times what the linearised flow makes of it")


def growth(piece: Slice) -> float:
    """How much larger a tube is than the linearised flow's image of the starts' box."""
    return float((piece.reach / np.abs(piece.frame).sum(axis=1)).max())
