"""What the search for singular curves hands to the kernel, and what it gets: facts about tubes, chains and a region."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Indices, joined
from ccpin.covering.region import Region
from ccpin.domain.singular.following import TubeChain
from ccpin.proof.curves.singular_covers import SingularCovered
from ccpin.proof.curves.tube_claims import GluedTubes, SingularTubes, tubes_of
from ccpin.proof.curves.tubes import Stated, no_tubes, stated
from ccpin.proof.equations import Problem, closures_of
from ccpin.proof.facts import Fact, prove, prove_some
from ccpin.proof.ranges import Ranges

_MORE, _LEAST = 4, 10_000  # boxes that the kernel may look at for each of a search, and besides


class ProvedCurves(NamedTuple):
    """Facts: about all tubes, curve by curve; that each is glued to the next; and that there are no others.

    The latter two are ``None`` where a file says so; the last also where the work was interrupted.
    """

    tubes: Fact
    glue: Fact | None
    covered: Fact | None


class SearchEffort(NamedTuple):
    """How finely a search looked, and at how many boxes; and whether it came to its end."""

    resolution: float
    tried: int
    ended: bool


def proved_tubes(problem: Problem, given: Stated) -> tuple[Fact, Indices]:
    """The fact about those tubes that the kernel finds proved, and which they are."""
    arrays = given._replace(along=np.asarray(given.along, dtype=np.int64))
    fact, proved = prove_some(SingularTubes(closures_of(problem), *arrays))
    return fact, np.flatnonzero(proved)


def proved_chains(problem: Problem, chains: Sequence[TubeChain]) -> tuple[ProvedCurves, list[TubeChain]]:
    """Facts about chains, and what is left of these: tubes that are proved, each glued to the next, or chains apart."""
    tubes, kept = proved_tubes(problem, stated(joined([no_tubes(problem), *(chain.tubes for chain in chains)])))
    owner = np.repeat(np.arange(len(chains)), [len(chain.tubes.half) for chain in chains])[kept]
    runs = [np.flatnonzero(owner == k) for k in range(len(chains))]
    pairs = [np.zeros((0, 2), dtype=np.int64)]
    for run, chain in zip(runs, chains, strict=True):
        pairs.append(np.stack([run, np.roll(run, -1)], axis=1)[: len(run) if chain.closed else -1])
    first, second = np.concatenate(pairs).T
    glue = prove_some(GluedTubes(closures_of(problem), first, second), tubes)[0]
    links = set(zip(glue.claim.first.tolist(), glue.claim.second.tolist(), strict=True))
    proved, found = tubes_of(glue.claim.equations, [tubes]), list[TubeChain]()
    for run in runs:
        parts = _unbroken(run.tolist(), links)
        found += [TubeChain(proved.take(np.array(part)), (part[-1], part[0]) in links) for part in parts]
    return ProvedCurves(tubes, glue, None), found


def _unbroken(run: list[int], links: set[tuple[int, int]]) -> Iterator[list[int]]:
    """The parts of a run of which each is linked to the next."""
    part = list[int]()
    for number in run:
        if part and (part[-1], number) not in links:
            yield part
            part = []
        part.append(number)
    if part:
        yield part


def proved_cover(problem: Problem, region: Region, ranges: Ranges, effort: SearchEffort, tubes: Fact) -> Fact:
    """The fact about all singular configurations over a region: those in tubes, and boxes that may hold others."""
    middle = np.zeros(problem.system.n_free)
    middle[problem.system.dependent] = ranges.middle
    claim = SingularCovered(
        closures_of(problem),
        lower=region.lower,
        upper=region.upper,
        limits=ranges.limits,
        middle=middle,
        resolution=np.array([effort.resolution]),
        most=np.array([_MORE * effort.tried + _LEAST if effort.ended else effort.tried], dtype=np.int64),
    )
    return prove(claim, tubes)
