"""Every claim of a certificate, checked one by one."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccpin.auditing.reading import ClaimedDocument, Curves, read
from ccpin.errors import CcpinError, InvalidInputError

if TYPE_CHECKING:
    from ccpin.auditing.closures import BallClosures
    from ccpin.auditing.gluing import SharedFace

_CUTS = 24  # halvings of a cell one after another, before its box is left undecided
_NEAR = 1e-9  # rad or m: how far a seed may be from a closed configuration
_PART = 16  # tasks handed to a worker at a time
_ENOUGH = 8  # claims of a kind that are not proved: no more of it are looked at
_SEARCHED, _LONG = (
    ("empty", "count", "cover"),
    4,
)  # what is searched for, and for how many one counts that is not decided
_WORDS = {
    "box": "boxes with exactly one nonsingular solution",
    "glue": "shared faces with one σ",
    "apart": "shared faces at which two sheets have two σ",
    "empty": "cells without a closed configuration",
    "singular": "cells with a singular configuration",
    "demand": "boxes within the limits, motors in hold of them, as dexterous as said",
    "count": "cells with as many closed configurations, none singular",
    "tube": "tubes with one singular curve each",
    "joint": "tubes whose curve goes on in the next",
    "once": "tubes whose curve is no other one on the list",
    "cover": "parts of the region without other singular configurations",
}
_ALWAYS = ("box", "glue", "tube", "joint", "once", "cover")


Result = tuple[str, tuple[int, ...], "bool | None", bool]
"""A kind of claim, which of them, whether it was proved or refuted, and whether there is a way to look at it."""


class Claim(NamedTuple):
    """One kind of claim.

    Attributes:
        what: What it says.
        of: How many there are.
        checked: How many were looked at.
        failed: Which of these were refuted: the document says what is false.
        undecided: Which of these were neither proved nor refuted.
    """

    what: str
    of: int
    checked: int
    failed: tuple[tuple[int, ...], ...]
    undecided: tuple[tuple[int, ...], ...] = ()


class AuditProgress(NamedTuple):
    """How many checks are done, and of how many."""

    done: int
    of: int


@dataclass(frozen=True)
class Audit:
    """What an auditor found.

    Attributes:
        theorem: The theorem's text, as the document has it.
        fingerprint: SHA-256 of the closures it is about.
        claims: The claims checked.
        not_checked: What the document says besides, in words.
        claim: What the document claims as a whole, in words: shares of the region as its cells have them, and numbers
            as its boxes have them.
    """

    theorem: str
    fingerprint: str
    claims: tuple[Claim, ...]
    not_checked: str
    claim: str

    @property
    def holds(self) -> bool:
        """Whether everything looked at was proved: where all was, `claim` is true."""
        return not any(claim.failed or claim.undecided for claim in self.claims)

    @property
    def refuted(self) -> bool:
        """Whether something that the document says was proved to be false."""
        return any(claim.failed for claim in self.claims)

    @property
    def whole(self) -> bool:
        """Whether every claim of the kinds in `claims` was looked at."""
        return all(claim.checked == claim.of for claim in self.claims)

    def __str__(self) -> str:
        lines = [f"closures {self.fingerprint[:16]}…", self.claim]
        for claim in self.claims:
            some = "" if claim.checked == claim.of else f" of {claim.of}"
            good = claim.checked - len(claim.failed) - len(claim.undecided)
            lines.append(f"{claim.what}: {good} proved of {claim.checked} looked at{some}")
            for word, which in (("FALSE", claim.failed), ("not decided", claim.undecided)):
                if which:
                    shown = ", ".join(str(f[0] if len(f) == 1 else f) for f in which[:_ENOUGH])
                    lines.append(f"  {word}: {shown}{', …' if len(which) > _ENOUGH else ''}")
        return "\n".join([*lines, f"not looked at: {self.not_checked}"])


def verify(
    path: str | Path,
    *,
    sample: int | None = None,
    seed: int = 0,
    workers: int = 1,
    progress: Callable[[AuditProgress], None] | None = None,
) -> Audit:
    """Check a certificate that an atlas's, a sheet atlas's or a singular cover's `save` wrote, by code of its own.

    First the document must be what its format declares and agree with itself (`declared`, `structure`, `cells`): cells
    tile the region, each certified one has its own box, and what closes on itself is a full turn.

    Proved are, of atlases: Theorem K for the boxes; that the seed is a solution of its box; that neighbours carry the
    same σ where the document does not list them as unglued (of sheets: where it says so), and that every box is reached
    from the seed's by such neighbours; that cells called singular hold a singular configuration; and that those called
    empty hold none, where that can be told by the triangle inequality, by the lengths of legs that meet in one body, or
    by a search of all values of up to six dependent coordinates (a claim counts as looked at if so); and, by such a
    search, how many there are over the cells of sheets that are counted, none of them singular, and that two sheets do
    not meet in one over certified cells. Of a workspace's boxes
    it is proved that they keep the document's limits, that the motors determine the motion, and its dexterity.

    Of singular curves: that each tube holds one and no other singular configuration; that it is the next tube's curve
    too, and closed curves' last tube's the first's; that no curve is listed twice; and that no part of the region has
    singular configurations, in any assembly mode, but in these tubes and in the boxes listed as uncovered, by a search
    of its own.

    Where eight claims of a kind are not proved, or two searches ended without an answer, no more of that kind are
    looked at.

    Args:
        path: The .json or .npz file.
        sample: How many claims of each kind (boxes, shared faces, cells; tubes, parts of the region), chosen at random;
            default all.
        seed: Of that choice.
        workers: Processes to share the work among. A script that asks for more than one needs the guard
            ``if __name__ == "__main__":``.
        progress: Called after every few checks.

    Raises:
        InvalidInputError: The file is no certificate, contradicts itself, or its fingerprint is another closure's.
        CcpinError: python-flint is not installed.
    """
    try:
        import flint  # noqa: F401
    except ImportError as error:
        raise CcpinError("verifying needs python-flint: pip install 'ccpin[validated]'") from error
    if sample is not None and sample < 1:
        raise InvalidInputError(f"sample = {sample} must be at least 1")
    if progress is not None and not callable(progress):
        raise InvalidInputError(f"progress must be a function, not {type(progress).__name__}")
    from ccpin.auditing.wording import besides, claimed

    document = read(path)
    kinds = _of_curves(document) if isinstance(document, Curves) else _of_cells(document)
    chosen = {kind: _chosen(len(every), sample, seed + k) for k, (kind, every) in enumerate(kinds.items())}
    tasks = [(kind, kinds[kind][k]) for kind, rows in chosen.items() for k in rows]
    found = _Outcomes(kinds)
    done = 0
    for part in _results(document, tasks, workers, found):
        for result in part:
            found.add(*result)
        done += len(part)
        if progress is not None:
            progress(AuditProgress(done, len(tasks)))
    claims = [found.claim(kind) for kind, every in kinds.items() if kind in _ALWAYS or every]
    if document.ranges is not None:
        claims.append(_ranged(document))
    if isinstance(document, ClaimedDocument) and document.seed is not None:
        claims.insert(2, _reached(document, document.seed, [(c.first, c.second) for c in kinds["glue"]]))
    return Audit(
        theorem=document.header["theorem"],
        fingerprint=document.header["fingerprint"],
        claims=tuple(claims),
        not_checked=besides(document),
        claim=claimed(document),
    )


class _Outcomes:
    """What was found of each kind of claim."""

    def __init__(self, kinds: dict[str, list[Any]]) -> None:
        self._kinds = kinds
        self._looked = dict.fromkeys(kinds, 0)
        self._open: dict[str, list[tuple[tuple[int, ...], bool | None]]] = {kind: [] for kind in kinds}

    def add(self, kind: str, which: tuple[int, ...], good: bool | None, seen: bool) -> None:
        """One more; none where enough of its kind were not proved, so that the work has an end."""
        if not seen or self.enough(kind):
            return
        self._looked[kind] += 1
        if good is not True:
            self._open[kind].append((which, good))

    def enough(self, kind: str) -> bool:
        """Whether so many of a kind were not proved that no more are looked at; searches without end count for more."""
        long = _LONG if kind in _SEARCHED else 1
        return sum(1 if good is False else long for _, good in self._open[kind]) >= _ENOUGH

    def claim(self, kind: str) -> Claim:
        """What was found of a kind."""
        failed, undecided = (
            tuple(sorted(which for which, good in self._open[kind] if good is word)) for word in (False, None)
        )
        return Claim(_WORDS[kind], len(self._kinds[kind]), self._looked[kind], failed, undecided)


def _of_cells(document: ClaimedDocument) -> dict[str, list[Any]]:
    """What is claimed of an atlas or of sheets."""
    from ccpin.auditing.gluing import apart

    boxes = list(range(len(document.centre)))
    return {
        "box": boxes,
        "glue": _faces(document),
        "apart": [] if document.faces is None else list(apart(document, document.faces)),
        "empty": list(range(len(document.empty.number))),
        "singular": list(range(len(document.singular.number))),
        "demand": [] if document.demands is None else boxes,
        "count": [] if document.counts is None else list(range(len(document.counts.said))),
    }


def _of_curves(document: Curves) -> dict[str, list[Any]]:
    """What is claimed of singular curves."""
    from ccpin.auditing.closures import BallClosures
    from ccpin.auditing.exclusion import parts

    joints, first = list[tuple[int, int]](), 0
    for size, closed in zip(document.sizes.tolist(), document.closed.tolist(), strict=True):
        joints += [(k, k + 1) for k in range(first, first + size - 1)]
        joints += [(first + size - 1, first)] if closed else []
        first += size
    count = len(parts(BallClosures(document), document))
    tubes = list(range(len(document.tubes)))
    once = tubes if len(document.sizes) > 1 else []
    return {"tube": tubes, "joint": joints, "once": once, "cover": list(range(count))}


def _faces(document: ClaimedDocument) -> list[Any]:
    """Where boxes are said to carry the same σ."""
    from ccpin.auditing.gluing import SharedFace, contacts

    if document.faces is None:
        unglued = {tuple(sorted(map(int, pair))) for pair in document.unglued}
        return [c for c in contacts(document) if tuple(sorted((c.first, c.second))) not in unglued]
    rows = zip(*document.faces, strict=True)
    return [SharedFace(int(a), int(b), at_a, at_a - at_b) for a, b, at_a, at_b in rows]


def _chosen(count: int, sample: int | None, seed: int) -> NDArray[np.int64]:
    if sample is None or sample >= count:
        return np.arange(count)
    return np.sort(np.random.default_rng(seed).choice(count, sample, replace=False))


def _results(
    document: ClaimedDocument | Curves, tasks: list[Any], workers: int, found: _Outcomes
) -> Iterator[list[Result]]:
    """What is found of tasks, in their order; those of kinds of which there is enough are left out."""
    if workers <= 1:
        held = _OpenDocument.of(document)
        for kind, what in tasks:
            yield [(kind, (), None, False)] if found.enough(kind) else _checked(held, [(kind, what)])
        return
    parts = [tasks[k : k + _PART] for k in range(0, len(tasks), _PART)]
    with ProcessPoolExecutor(workers, get_context("spawn"), _open, (document,)) as pool:
        yield from pool.map(_checked_there, parts)


class _OpenDocument(NamedTuple):
    """A document, its closures and what its cells need, made once."""

    document: Any
    closures: BallClosures
    cells: Any

    @staticmethod
    def of(document: ClaimedDocument | Curves) -> _OpenDocument:
        from ccpin.auditing.closures import BallClosures
        from ccpin.auditing.empty_cells import Emptiness
        from ccpin.auditing.exclusion import Exclusion

        closures = BallClosures(document)
        cells = Exclusion(closures, document) if isinstance(document, Curves) else Emptiness(closures, document)
        return _OpenDocument(document, closures, cells)


_held: list[_OpenDocument] = []  # of a process of the pool


def _open(document: ClaimedDocument | Curves) -> None:
    _held[:] = [_OpenDocument.of(document)]


def _checked_there(tasks: Iterable[Any]) -> list[Result]:
    return _checked(_held[0], tasks)


def _checked(held: _OpenDocument, tasks: Iterable[Any]) -> list[Result]:
    looks = _looks(held)
    return [(kind, *looks[kind](what)) for kind, what in tasks]


def _looks(held: _OpenDocument) -> dict[str, Callable[[Any], tuple[tuple[int, ...], bool | None, bool]]]:
    """How each kind of claim is looked at: which one it is, whether it was proved, and whether there is a way."""
    from ccpin.auditing.boxes import proved
    from ccpin.auditing.counts import counted
    from ccpin.auditing.gluing import same_solution
    from ccpin.auditing.singular_curves import goes_on, listed_once, one_curve
    from ccpin.auditing.singular_points import singular
    from ccpin.auditing.workspace import met

    document, closures, cells = held

    def empty(k: int) -> tuple[tuple[int, ...], bool | None, bool]:
        good = cells.proved(k)
        return (int(document.empty.number[k]),), good, good is not None or cells.searched

    def different(face: SharedFace) -> bool | None:
        same = same_solution(closures, document, face)
        return None if same is None else not same

    return {
        "box": lambda k: ((k,), proved(closures, document, k, _CUTS), True),
        "glue": lambda face: ((face.first, face.second), same_solution(closures, document, face), True),
        "apart": lambda face: ((face.first, face.second), different(face), True),
        "empty": empty,
        "singular": lambda k: ((int(document.singular.number[k]),), singular(closures, document, k), True),
        "demand": lambda k: ((k,), met(closures, document, k, _CUTS), True),
        "count": lambda k: ((int(document.counts.cells.number[k]),), counted(cells, k), cells.searched),
        "tube": lambda k: ((k,), one_curve(closures, document, k), True),
        "joint": lambda pair: (pair, goes_on(closures, document, *pair), True),
        "once": lambda k: ((k,), listed_once(cells, k), True),
        "cover": lambda k: ((k,), cells.proved(k), True),
    }


def _ranged(document: ClaimedDocument | Curves) -> Claim:
    """That the ranges stated hold every closed configuration that keeps the limits stated."""
    from ccpin.auditing.closures import BallClosures
    from ccpin.auditing.reach import Reach
    from ccpin.auditing.stated_ranges import unproved

    wrong = unproved(Reach(BallClosures(document), document, frozenset()))
    count = len(document.dependent)
    what = "coordinates whose range holds all configurations within the limits stated"
    return Claim(what, count, count, (), tuple((j,) for j in wrong))


def _reached(document: ClaimedDocument, seed: NDArray[np.float64], pairs: list[tuple[int, int]]) -> Claim:
    """That each box is joined to the seed's."""
    from ccpin.auditing.closures import BallClosures
    from ccpin.auditing.gluing import in_tube, near

    reached = np.zeros(len(document.centre), dtype=np.bool_)
    found = near(BallClosures(document), document.dependent, seed)
    still = np.zeros(len(document.independent))
    seeded = found is not None and bool(np.max(np.abs(found[0] - seed)) <= _NEAR)
    todo = [k for k in range(len(reached)) if found and seeded and in_tube(document, k, *found, still)]
    seeds = list(todo)
    beside: dict[int, list[int]] = {}
    for a, b in pairs:
        beside.setdefault(a, []).append(b)
        beside.setdefault(b, []).append(a)
    while todo:
        k = todo.pop()
        if not reached[k]:
            reached[k] = True
            todo += [other for other in beside.get(k, []) if not reached[other]]
    lost = tuple((int(k),) for k in np.flatnonzero(~reached))
    refuted, undecided = (lost, ()) if seeds else ((), lost)
    return Claim("boxes reached from the seed over such faces", len(reached), len(reached), refuted, undecided)
