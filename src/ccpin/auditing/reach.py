"""Chains whose ends are too far apart to meet, over boxes of all coordinates.

**Lemma.** Let a closure's point rows read Σ_c W_c x_c + d = 0. Cut each chain anywhere: the head's tip h_c(θ) is a
point that the joints above the cut move; what is behind it are segments whose lengths seen by W_c are at most l_i. No
configuration of a box of all coordinates closes these rows where |Σ W_c h_c + d| > Σ l_i; nor, where the lengths are
exactly l_i, where l_k > |Σ W_c h_c + d| + Σ_{i≠k} l_i for some k.

*Proof.* Σ W_c h_c + d and the segments add up to 0: none is longer than all others together. ∎

W_c sees a segment's length as it is where no turn of the chain is before it, where W_cᵀW_c = I, and where W_cW_cᵀ = I
and all turns of the chain before it are about the direction that W_c does not see, so that they keep the part of it
that W_c sees.
"""

from __future__ import annotations

from collections.abc import Set
from typing import NamedTuple

import numpy as np
from flint import arb

from ccpin.auditing.closures import BallClosures, Path, TipMotion, motion_of
from ccpin.auditing.lengths import least_size, norm_of, root_of, segments_of
from ccpin.auditing.reading import Array, ClaimedDocument, Curves

_TAIL = 0.6  # rad: joints that may turn more than this each way are behind the cut


class CornerBox(NamedTuple):
    """A box of all coordinates by its corners, as doubles."""

    low: Array
    high: Array

    @property
    def middle(self) -> Array:
        """Between the corners."""
        return 0.5 * (self.low + self.high)

    @property
    def half(self) -> Array:
        """Half of its edges."""
        return 0.5 * (self.high - self.low)

    def balls(self) -> list[arb]:
        """All of it."""
        return [arb(float(a)).union(arb(float(b))) for a, b in zip(self.low, self.high, strict=True)]

    def halves(self, axis: int) -> tuple[CornerBox, CornerBox]:
        """Both halves along an axis."""
        return self.cut(axis, float(self.middle[axis]))

    def cut(self, axis: int, place: float) -> tuple[CornerBox, CornerBox]:
        """Both parts where an axis is cut."""
        below, above = self.high.copy(), self.low.copy()
        below[axis] = above[axis] = place
        return CornerBox(self.low, below), CornerBox(above, self.high)


class ChainGroup(NamedTuple):
    """The chains of one closure's point rows: their numbers and the rows."""

    rows: tuple[int, ...]
    chains: tuple[int, ...]


class Reach:
    """The lengths of a document's chains, made once.

    Attributes:
        unbounded: Coordinates that slide without bounds that boxes could have.
        first: The others, but for last joints of chains in no other loop: without these the lemma does.
    """

    def __init__(self, closures: BallClosures, document: ClaimedDocument | Curves, unbounded: Set[int]) -> None:
        self.closures, self.document, self.unbounded = closures, document, unbounded
        by_rows: dict[tuple[int, ...], list[int]] = {}
        for k, chain in enumerate(document.chains):
            rows = tuple(int(r) for r in np.flatnonzero(np.any(chain.weights != 0.0, axis=1)))
            by_rows.setdefault(rows, []).append(k)
        self.groups = [
            ChainGroup(rows, tuple(chains)) for rows, chains in by_rows.items() if rows and self._plain(rows, chains)
        ]
        self.norms = [norm_of(path.weights) for path in closures.paths]
        self.segments = [segments_of(path, norm) for path, norm in zip(closures.paths, self.norms, strict=True)]
        own = set(document.dependent.tolist())
        ours = [[j for j in chain.joints.tolist() if j in own] for chain in document.chains]
        loops = [{j for k in group.chains for j in ours[k]} for group in self.groups]
        last = {joints[-1] for joints in ours if joints and sum(joints[-1] in loop for loop in loops) == 1}
        self.first = np.array(sorted({*range(closures.n_free)} - unbounded - last), dtype=np.int64)

    def _plain(self, rows: tuple[int, ...], chains: list[int]) -> bool:
        document, chosen = self.document, list(rows)
        shared = any(
            k not in chains and np.any(chain.weights[chosen] != 0.0) for k, chain in enumerate(document.chains)
        )
        linear = np.any(document.couplings[chosen] != 0.0) or np.any(document.moduli[chosen] != 0.0)
        return not (shared or linear or any(document.chains[k].direction for k in chains))

    def too_far(self, box: CornerBox) -> bool:
        """Whether the chains, cut where they turn freely, cannot meet."""
        balls, half = box.balls(), box.half
        for group in self.groups:
            gap, longest, shortest = [self.closures.offset[row, 0] for row in group.rows], list[arb](), list[arb]()
            for number in group.chains:
                chain, path = self.document.chains[number], self.closures.paths[number]
                pairs = zip(chain.joints.tolist(), chain.prismatic.tolist(), strict=True)
                free = [j in self.unbounded if slides else half[j] > _TAIL for j, slides in pairs]
                cut = free.index(True) if any(free) else len(free)
                rest = self.behind(number, cut, balls)
                if rest is None:
                    break
                moved = path.weights * head_of(path, cut, balls).x
                gap = [value + moved[row, 0] for value, row in zip(gap, group.rows, strict=True)]
                longest += [long for long, _ in rest]
                shortest += [short for _, short in rest]
            else:
                if _cannot_close(gap, longest, shortest):
                    return True
        return False

    def behind(self, number: int, cut: int, balls: list[arb]) -> list[tuple[arb, arb]] | None:
        """The most and the least of the segments behind a cut; ``None`` where one slides without bounds."""
        turns, found = self.closures.paths[number].turns[cut:], list[tuple[arb, arb]]()
        for k, turn in enumerate(turns):
            segments = self.segments[number][cut + k]
            if turn.prismatic and turn.joint in self.unbounded:
                return None
            found += [segments.before] if k else []
            if turn.prismatic:
                by = abs(balls[turn.joint])
                found.append((by * segments.along[0], least_size(by) * segments.along[1]))
        return [*found, self.segments[number][-1].before] if turns else []


def head_of(path: Path, cut: int, balls: list[arb]) -> TipMotion:
    """The part of a chain above a cut: its tip is where the joint is at which it was cut."""
    if cut == len(path.turns):
        return motion_of(path, balls)
    return motion_of(Path(path.turns[:cut], path.turns[cut].translation, False, path.weights), balls)


def _cannot_close(gap: list[arb], longest: list[arb], shortest: list[arb]) -> bool:
    """The lemma for a sum of heads, bounds of segments' lengths, and the lengths of those known exactly (else 0)."""
    least = root_of(sum((least_size(x) * least_size(x) for x in gap), arb(0)))
    most = root_of(sum((abs(x) * abs(x) for x in gap), arb(0)))
    total = sum(longest, arb(0))
    return least > total or any(short > most + (total - long) for short, long in zip(shortest, longest, strict=True))


def below(x: arb) -> float:
    """A double below all of a ball."""
    return float(np.nextafter(float(x.lower()), -np.inf))


def above(x: arb) -> float:
    """A double above all of a ball."""
    return float(np.nextafter(float(x.upper()), np.inf))
