"""How each kind of claim is looked at, and which claims of it a document has."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccpin.auditing.boxes import proved
from ccpin.auditing.closures import BallClosures
from ccpin.auditing.counts import counted
from ccpin.auditing.empty_cells import Emptiness
from ccpin.auditing.exclusion import Exclusion, parts
from ccpin.auditing.findings import Claim, Outcomes, Result
from ccpin.auditing.gluing import SharedFace, apart, contacts, in_tube, near, same_solution
from ccpin.auditing.reach import Reach
from ccpin.auditing.reading import ClaimedDocument, Curves
from ccpin.auditing.singular_curves import goes_on, listed_once, one_curve
from ccpin.auditing.singular_points import singular
from ccpin.auditing.stated_ranges import unproved
from ccpin.auditing.workspace import met

_CUTS = 24  # halvings of a cell one after another, before its box is left undecided
_NEAR = 1e-9  # rad or m: how far a seed may be from a closed configuration
_PART = 16  # tasks handed to a worker at a time


def claims_of(document: ClaimedDocument | Curves) -> dict[str, list[Any]]:
    """What is claimed, by kind."""
    return _of_curves(document) if isinstance(document, Curves) else _of_cells(document)


def _of_cells(document: ClaimedDocument) -> dict[str, list[Any]]:
    """What is claimed of an atlas or of sheets."""
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
    if document.faces is None:
        unglued = {tuple(sorted(map(int, pair))) for pair in document.unglued}
        return [c for c in contacts(document) if tuple(sorted((c.first, c.second))) not in unglued]
    rows = zip(*document.faces, strict=True)
    return [SharedFace(int(a), int(b), at_a, at_a - at_b) for a, b, at_a, at_b in rows]


def results(
    document: ClaimedDocument | Curves, tasks: list[Any], workers: int, found: Outcomes
) -> Iterator[list[Result]]:
    """What is found of tasks, in their order; those of kinds of which there is enough are left out."""
    if workers <= 1:
        held = _OpenDocument.of(document)
        for kind, what in tasks:
            yield [(kind, (), None, False)] if found.enough(kind) else _checked(held, [(kind, what)])
        return
    chunks = [tasks[k : k + _PART] for k in range(0, len(tasks), _PART)]
    with ProcessPoolExecutor(workers, get_context("spawn"), _open, (document,)) as pool:
        yield from pool.map(_checked_there, chunks)


class _OpenDocument(NamedTuple):
    """A document, its closures and what its cells need, made once."""

    document: Any
    closures: BallClosures
    cells: Any

    @staticmethod
    def of(document: ClaimedDocument | Curves) -> _OpenDocument:
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


def ranged(document: ClaimedDocument | Curves) -> Claim:
    """That the ranges stated hold every closed configuration that keeps the limits stated."""
    wrong = unproved(Reach(BallClosures(document), document, frozenset()))
    count = len(document.dependent)
    what = "coordinates whose range holds all configurations within the limits stated"
    return Claim(what, count, count, (), tuple((j,) for j in wrong))


def reached(document: ClaimedDocument, seed: NDArray[np.float64], pairs: list[tuple[int, int]]) -> Claim:
    """That each box is joined to the seed's."""
    there = np.zeros(len(document.centre), dtype=np.bool_)
    found = near(BallClosures(document), document.dependent, seed)
    still = np.zeros(len(document.independent))
    seeded = found is not None and bool(np.max(np.abs(found[0] - seed)) <= _NEAR)
    todo = [k for k in range(len(there)) if found and seeded and in_tube(document, k, *found, still)]
    seeds = list(todo)
    beside: dict[int, list[int]] = {}
    for a, b in pairs:
        beside.setdefault(a, []).append(b)
        beside.setdefault(b, []).append(a)
    while todo:
        k = todo.pop()
        if not there[k]:
            there[k] = True
            todo += [other for other in beside.get(k, []) if not there[other]]
    lost = tuple((int(k),) for k in np.flatnonzero(~there))
    refuted, undecided = (lost, ()) if seeds else ((), lost)
    return Claim("boxes reached from the seed over such faces", len(there), len(there), refuted, undecided)
