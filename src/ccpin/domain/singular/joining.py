"""Chains of tubes that are of one curve made one: what was followed in parts, or found more than once.

What is joined here is joined by the corollary of `ccpin/proof/theorems/joining.md`, and what is left out is in tubes
that stay by its Lemma J. So every configuration that a chain held is held. Where one or the other is not proved both
chains stay as they are.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, Mask, apply, joined, rows_of
from ccpin.domain.singular.following import TubeChain
from ccpin.proof.curves.curve_equations import values_at
from ccpin.proof.curves.settled_boxes import Nearby
from ccpin.proof.curves.tubes import Frames, Points, Tubes, bounds_of, glued, inverse_without, places_in, zeros_in
from ccpin.proof.equations import Problem
from ccpin.proof.newton import without_turns
from ccpin.proof.rounding import SLACK

_LAST = 4  # tubes of a chain from which it may go on in another
_HALVINGS, _PASSES = 8, 3  # of a tube's length into pieces; of a piece's radii through its bounds
_REACH = 2.0  # half lengths: tubes that meet are no farther apart
_ROUNDING = 1e-13  # rad, m: above the roundings of sums of coordinates of order one and ten


def one_of_each(problem: Problem, chains: Iterable[TubeChain]) -> list[TubeChain]:
    """The chains with those of one curve made one, as far as that is proved: they hold what all of them held."""
    found, k = without_held(problem, chains), 0
    while k < len(found):  # of those before k none goes on in another: their ends met all tubes there are
        longer = _longer(problem, found, k)
        if longer is None:
            k += 1
        else:
            found, k = longer
    return without_held(problem, found)


def without_held(problem: Problem, chains: Iterable[TubeChain]) -> list[TubeChain]:
    """The chains without those of which all of the curve is in another one's tubes (Lemma J).

    Of several that hold one another one stays, a closed one if there is any.
    """
    found = list(chains)
    for chain in sorted(found, key=lambda chain: (chain.closed, len(chain.tubes.half))):
        others = [other for other in found if other is not chain and other.closed >= chain.closed]
        if any(bool(held(problem, chain.tubes, other.tubes).all()) for other in _beside(problem, chain, others)):
            found = [other for other in found if other is not chain]
    return found


def held(problem: Problem, tubes: Tubes, others: Tubes) -> Mask:
    """Of which tubes all of the curve is proved to be in tubes among others (Lemma J), of shape (T,).

    An end that just reaches another tube's is not; of a tube that is itself among the others there is nothing to prove.
    """
    nearby, found = Nearby(problem, others), np.ones(len(tubes.half), dtype=np.bool_)
    row = np.flatnonzero(~_among(tubes, others))
    s, half = np.zeros(len(row)), tubes.half[row]
    for _ in range(_HALVINGS):
        if not row.size:
            break
        middle = zeros_in(problem, tubes.take(row), s)
        with np.errstate(all="ignore"):
            going = ~nearby.hold(_around(problem, tubes.take(row), _Piece(s, half), middle))
        found[row[~nearby.hold(middle)]] = False  # and no shorter piece is
        going &= found[row]
        row, s, half = np.tile(row[going], 2), s[going], 0.5 * half[going]
        s, half = np.concatenate([s - half, s + half]), np.tile(half, 2)
    found[row] = False
    return found


def _among(tubes: Tubes, others: Tubes) -> Mask:
    """Which tubes are among others, bit for bit, whichever way they run, of shape (T,)."""
    known = set(_numbers_of(others))
    return np.array([numbers in known for numbers in _numbers_of(tubes)], dtype=np.bool_)


def _numbers_of(tubes: Tubes) -> list[bytes]:
    """All that a tube is, but for the way it runs."""
    way = np.take_along_axis(tubes.tangent, tubes.along[:, None], axis=1)
    fields = [tubes.x, tubes.pairing, tubes.along, way * tubes.tangent + 0.0, tubes.half, tubes.radius]
    return [row.tobytes() for row in np.column_stack(fields)]


class _Piece(NamedTuple):
    """|s − s_c| ≤ h of tubes, of shape (T,) each."""

    s: Array
    half: Array


def _around(problem: Problem, tubes: Tubes, piece: _Piece, middle: Points) -> Points:
    """Boxes that hold the curve on a piece of each tube, about its middle zero."""
    size, rows, half = problem.system.n_free, np.arange(len(piece.s)), piece.half
    values = values_at(problem, middle.x[:, :size], middle.x[:, size:], tubes.pairing)
    tangent = np.linalg.svd(values.slope)[2][:, -1]
    tangent = tangent * (tubes.tangent[rows, tubes.along] / tangent[rows, tubes.along])[:, None]
    radius = np.abs(tubes.x + piece.s[:, None] * tubes.tangent - middle.x) + tubes.hull + _ROUNDING
    radius += half[:, None] * np.abs(tubes.tangent - tangent)
    radius[rows, tubes.along] = 0.0
    frames = Frames(tubes.along, tangent, inverse_without(values.slope, tubes.along))
    for _ in range(_PASSES):
        bounds = bounds_of(problem, values, frames, half, radius)
        radius = np.fmin(radius, (bounds.y + apply(bounds.z, radius)) * SLACK)
    return Points(middle.x, (half[:, None] * np.abs(tangent) + radius) * SLACK + _ROUNDING)


class _Pool(NamedTuple):
    """The tubes of some chains: the chain of each, its place there, and how many come after it, of shape (T,)."""

    tubes: Tubes
    owner: Indices
    place: Indices
    after: Indices

    @staticmethod
    def of(chains: Sequence[TubeChain]) -> _Pool:
        """Those of chains, of which there is one at least."""
        sizes = [len(chain.tubes.half) for chain in chains]
        owner, place = np.repeat(np.arange(len(sizes)), sizes), np.concatenate([np.arange(size) for size in sizes])
        return _Pool(joined(chain.tubes for chain in chains), owner, place, np.repeat(sizes, sizes) - 1 - place)

    def near(self, problem: Problem, tube: Tubes) -> Indices:
        """Which of them may meet a tube (T = 1)."""
        gap = np.abs(without_turns(self.tubes.theta - tube.theta, problem.system.periodic)).max(axis=1)
        return np.flatnonzero(gap <= _REACH * np.maximum(self.tubes.half, tube.half))


def _beside(problem: Problem, chain: TubeChain, others: Sequence[TubeChain]) -> Iterator[TubeChain]:
    """The chains that have the first tube's middle zero in one of their tubes."""
    if others:
        pool, first = _Pool.of(others), rows_of(chain.tubes, slice(0, 1))
        rows = pool.near(problem, first)
        at = rows_of(zeros_in(problem, first, np.zeros(1)), np.zeros(len(rows), dtype=np.intp))
        inside = places_in(problem, at, pool.tubes.take(rows)).inside
        yield from (others[k] for k in np.unique(pool.owner[rows[inside]]))


class _Meeting(NamedTuple):
    """That a chain's tube `here` is glued to one of another (or of itself): how many tubes that leaves out, and which.

    Attributes:
        left_out: How many tubes are behind the one or before the other.
        owner: The other chain's number.
        turned: Whether that is taken the other way.
        here, there: The two tubes' places, the second in the way in which the other chain is taken.
    """

    left_out: int
    owner: int
    turned: bool
    here: int
    there: int


def _longer(problem: Problem, chains: list[TubeChain], number: int) -> tuple[list[TubeChain], int] | None:
    """The chains with one of them closed, or joined to another, and its number then; ``None``: neither is proved."""
    if chains[number].closed:
        return None
    pool = _Pool.of(chains)
    for turned in (False, True):
        chain = _turned(chains[number]) if turned else chains[number]
        for meeting in _meetings(problem, chain, pool):
            other, kept = chains[meeting.owner], None
            if meeting.owner == number and meeting.turned == turned and meeting.there < meeting.here:
                kept = _closed(problem, chain, meeting)
            elif meeting.owner != number and not other.closed:
                kept = _gone_on(problem, chain, _turned(other) if meeting.turned else other, meeting)
            if kept is not None:
                rest = [k for k in range(len(chains)) if k not in (number, meeting.owner)]
                first = sum(k < number for k in rest)
                others = [chains[k] for k in rest]
                return [*others[:first], kept, *others[first:]], first
    return None


def _meetings(problem: Problem, chain: TubeChain, pool: _Pool) -> list[_Meeting]:
    """Where the last tubes of a chain are glued to tubes of open ones, those first that leave the fewest out."""
    found, last = list[_Meeting](), len(chain.tubes.half) - 1
    for here in range(last, max(last - _LAST, -1), -1):
        tube = rows_of(chain.tubes, slice(here, here + 1))
        rows = pool.near(problem, tube)
        beside, again = pool.tubes.take(rows), tube.take(np.zeros(len(rows), dtype=np.intp))
        for turned, others in ((False, beside), (True, beside.turned())):
            for row in rows[glued(problem, again, others)]:
                there = int(pool.after[row] if turned else pool.place[row])
                found.append(_Meeting(last - here + there, int(pool.owner[row]), turned, here, there))
    return sorted(found)


def _closed(problem: Problem, chain: TubeChain, meeting: _Meeting) -> TubeChain | None:
    """What is left of a chain that meets itself, closed; ``None`` where that is not proved to hold the rest."""
    after = meeting.here + 1
    ends = [slice(meeting.there), slice(after, None)]
    kept = TubeChain(rows_of(chain.tubes, slice(meeting.there, after)), True)
    return _if_held(problem, [rows_of(chain.tubes, end) for end in ends], kept)


def _gone_on(problem: Problem, chain: TubeChain, other: TubeChain, meeting: _Meeting) -> TubeChain | None:
    """A chain that goes on in another one; ``None`` where it is not proved to hold the rest of both."""
    after = meeting.here + 1
    first, behind = (rows_of(chain.tubes, part) for part in (slice(after), slice(after, None)))
    before, on = (rows_of(other.tubes, part) for part in (slice(meeting.there), slice(meeting.there, None)))
    return _if_held(problem, [behind, before], TubeChain(joined([first, on]), False))


def _if_held(problem: Problem, left_out: list[Tubes], kept: TubeChain) -> TubeChain | None:
    return kept if bool(held(problem, joined(left_out), kept.tubes).all()) else None


def _turned(chain: TubeChain) -> TubeChain:
    """The chain the other way."""
    return chain._replace(tubes=chain.tubes.take(np.arange(len(chain.tubes.half))[::-1]).turned())
