"""Covers of parts of a region, made apart, as the one cover of the region.

**Proposition M.** Let covers of the same closures, within the same limits, be of regions that together fill a box of
q-space. Then every singular configuration over the box that keeps the limits is on a curve of one of the covers, in its
tubes, or in a box that one of them lists.

*Proof.* Its q lies in one of the regions, whose cover claims that. ∎

A search goes beyond the bounds of its region by more than rounding sets two bounds apart (`candidates.BEYOND`), so that
nothing is between them. Curves that are proved to be one are listed as one, in tubes that hold all that theirs held
(`joining`). Where that is not proved both stay: the claim is the same, and one curve is listed twice.

None of this is believed where all covers were proved here: the kernel looks at the whole region once more, with the
tubes that are listed. Where one was read from a file the whole rests on that file, by the proposition.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ccpin.arrays import Array, Mask, joined
from ccpin.covering.region import Region
from ccpin.domain.closures.packing import same_reading
from ccpin.domain.singular.curve import as_curve
from ccpin.domain.singular.curves import SingularCover, concluded
from ccpin.domain.singular.following import TubeChain
from ccpin.domain.singular.joining import one_of_each
from ccpin.errors import InvalidInputError
from ccpin.proof.candidates import BEYOND
from ccpin.proof.equations import Problem
from ccpin.proof.ranges import ranges_over
from ccpin.proof.solutions import TURN

_ALIGNED = 0.1 * BEYOND  # of bounds (rad, m)
_LIMITS = ("interrupted", "budget")


def merge_covers(covers: Sequence[SingularCover]) -> SingularCover:
    """One cover of several, of which there is one at least; `ccpin.domain.merge` says the rest."""
    first = covers[0]
    for k, other in enumerate(covers[1:], start=2):
        _refuse_others(first, other, k)
    chains = [TubeChain(curve.tubes, curve.closed) for cover in covers for curve in cover.curves]
    curves = [as_curve(first.reading, chain) for chain in one_of_each(first.problem, chains)]
    region = filled(first.problem, [cover.region for cover in covers])
    proposed = replace(
        first,
        region=region,
        ranges=ranges_over(first.problem.system, first.ranges, (region.lower, region.upper)),
        curves=tuple(sorted(curves, key=lambda curve: curve.kind)),
        uncovered=joined(cover.uncovered for cover in covers),
        tried=sum(cover.tried for cover in covers),
        limit=next((limit for limit in _LIMITS if any(cover.limit == limit for cover in covers)), None),
        resolution=max(cover.resolution for cover in covers),
    )
    told = any(cover.proved is None or cover.proved.covered is None for cover in covers)
    return concluded(proposed, believed=told)


def _refuse_others(first: SingularCover, other: SingularCover, k: int) -> None:
    """What speaks of other things than the first."""
    if first.names != other.names or not same_reading(first.reading, other.reading):
        raise InvalidInputError(
            f"part {k} is about other closures than part 1: parts are of one mechanism as one file states it"
        )
    ours, theirs = first.ranges.limits, other.ranges.limits
    if np.any(ours != theirs):
        row = int(np.argmax(np.any(ours != theirs, axis=1)))
        raise InvalidInputError(
            f"part {k} was searched within other limits than part 1: {theirs[row].tolist()} and {ours[row].tolist()}"
        )


def filled(problem: Problem, regions: Sequence[Region]) -> Region:
    """The box that regions fill together, the smallest that holds them all; a full turn closes on itself.

    Raises:
        InvalidInputError: They leave a part of it out.
    """
    lower = np.min([region.lower for region in regions], axis=0)
    upper = np.max([region.upper for region in regions], axis=0)
    system = problem.system
    wrapped = system.periodic[system.independent] & (upper - lower >= TURN - _ALIGNED)
    whole = Region(lower, np.where(wrapped, lower + TURN, upper), wrapped)
    stretches = [[_stretches(whole, region, axis) for axis in range(len(lower))] for region in regions]
    cuts = [
        np.unique(np.clip(np.concatenate([[0.0, width], *(part[axis].ravel() for part in stretches)]), 0.0, width))
        for axis, width in enumerate(whole.width)
    ]
    covered = np.zeros([len(cut) - 1 for cut in cuts], dtype=np.bool_)
    for part in stretches:
        covered[np.ix_(*(_between(cut, bounds) for cut, bounds in zip(cuts, part, strict=True)))] = True
    if not covered.all():
        low, high = _missing(covered)
        corners = [
            [float(start + cut[k]) for start, cut, k in zip(lower, cuts, corner, strict=True)] for corner in (low, high)
        ]
        raise InvalidInputError(f"no part covers the region from {corners[0]} to {corners[1]}")
    return whole


def _stretches(whole: Region, part: Region, axis: int) -> Array:
    """Where a part lies along an axis of the whole: bounds from its lower end on, of shape (1 or 2, 2)."""
    start, width = part.lower[axis] - whole.lower[axis], part.width[axis]
    if not whole.wrapped[axis]:
        return np.array([[start, start + width]])
    if width >= TURN - _ALIGNED:
        return np.array([[0.0, TURN]])
    start = np.remainder(start, TURN)
    return np.array([[start, start + width], [start - TURN, start + width - TURN]])


def _between(cuts: Array, stretches: Array) -> Mask:
    """Which of the stretches between cuts lie in one of some others."""
    inside = (cuts[:-1, None] >= stretches[:, 0] - _ALIGNED) & (cuts[1:, None] <= stretches[:, 1] + _ALIGNED)
    return np.asarray(inside.any(axis=1))


def _missing(covered: Mask) -> tuple[list[int], list[int]]:
    """A box of cells that are not covered, as large as it gets from the first one on."""
    low = np.argwhere(~covered)[0].tolist()
    high = [k + 1 for k in low]
    for axis, count in enumerate(covered.shape):
        while high[axis] < count:
            slab = tuple(
                slice(high[axis], high[axis] + 1) if k == axis else slice(low[k], high[k]) for k in range(len(low))
            )
            if covered[slab].any():
                break
            high[axis] += 1
    return low, high
