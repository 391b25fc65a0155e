"""Narrowing and settling boxes as tasks: pure functions of plain arrays, for any process, and kept on disk.

Of the tubes a chunk of boxes is given those beside its own boxes.
"""

from __future__ import annotations

import numpy as np

from ccpin.arrays import joined, rows_of
from ccpin.covering.runner import Arrays, Runner
from ccpin.proof.curves.settled_boxes import Nearby, settled_beside
from ccpin.proof.curves.singular_covers import narrowed_to_singular
from ccpin.proof.curves.tubes import Tubes
from ccpin.proof.equations import Problem
from ccpin.proof.narrowing import Candidates
from ccpin.proof.ranges import Ranges

_CHUNK = 1000  # boxes of a task
_FIELDS = len(Candidates._fields)


def narrow_boxes(runner: Runner, ranges: Ranges, boxes: Candidates) -> Candidates:
    """The boxes that may hold singular configurations within the ranges, narrowed.

    Raises:
        Stopped: As for `Runner.map`.
    """
    parts = _parts(len(boxes.cell))
    found = runner.map(narrow_task, [(*ranges, *rows_of(boxes, part)) for part in parts])
    return joined([rows_of(boxes, slice(0)), *(Candidates(*arrays) for arrays in found)])  # type: ignore[arg-type]


def narrow_task(problem: Problem, arrays: Arrays) -> Arrays:
    """`narrow_boxes` for one chunk: (*ranges, *boxes) → boxes."""
    ranges, boxes = Ranges(*arrays[:4]), Candidates(*arrays[4:])  # type: ignore[arg-type]
    return tuple(narrowed_to_singular(problem, ranges, boxes))


def settle_boxes(runner: Runner, nearby: Nearby, boxes: Candidates) -> Candidates:
    """The boxes that are not proved to hold no singular configurations but those of the tubes' curves.

    Raises:
        Stopped: As for `Runner.map`.
    """
    beside = nearby.beside(boxes)
    rows, chunks = np.flatnonzero(beside.worth), list[Arrays]()
    parts = [rows[part] for part in _parts(len(rows))]
    for part in parts:
        near = beside.nearest[part]
        tubes, places = np.unique(near, return_inverse=True)
        chunks.append((*rows_of(boxes, part), places.reshape(near.shape), *nearby.tubes.take(tubes)))
    left = np.ones(len(boxes.cell), dtype=np.bool_)
    for part, (done,) in zip(parts, runner.map(settle_task, chunks), strict=True):
        left[part] = ~np.asarray(done, dtype=np.bool_)
    return rows_of(boxes, left)


def settle_task(problem: Problem, arrays: Arrays) -> Arrays:
    """`covering.settled_beside` for one chunk: (*boxes, nearest, *tubes) → which are settled (B,)."""
    boxes, tubes = Candidates(*arrays[:_FIELDS]), Tubes(*arrays[_FIELDS + 1 :])  # type: ignore[arg-type]
    nearest = np.asarray(arrays[_FIELDS], dtype=np.intp)
    return (settled_beside(problem._replace(phasors=None), boxes, tubes, nearest),)


def _parts(count: int) -> list[slice]:
    return [slice(first, first + _CHUNK) for first in range(0, count, _CHUNK)]
