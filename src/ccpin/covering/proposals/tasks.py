"""The two tasks of building an atlas, as pure functions of plain arrays: prove cells, and glue boxes at faces.

A task's result depends on its own arrays only, so it may run in any process and be kept on disk.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, Mask, apply, joined, rows_of
from ccpin.covering.proposals.krawczyk import certify_boxes
from ccpin.covering.proposals.solving import glued, newton
from ccpin.covering.runner import Arrays, Runner
from ccpin.native.certifier import certifier
from ccpin.proof.equations import Problem
from ccpin.proof.newton import Boxes
from ccpin.proof.requirements import meets
from ccpin.proof.rounding import TURN

_AT_FACE, _AT_CENTRE = 5, 10  # Newton's steps
_NEAR = 1e-4  # at a face: σ is only passed there
_FIELDS = len(Boxes._fields)


def compiled(problem: Problem) -> bool:
    """Whether the core computes the tasks: it lets go of the interpreter's lock, and is quick on few boxes."""
    return certifier(problem.system, problem.phasors) is not None


class CellsToProve(NamedTuple):
    """Cells to prove: centre and half widths (B, n), and a closed configuration near a point of each, θ (B, n′).

    `turn_to` (B, n′) is the θ near which periodic dependent coordinates of the centres are kept.
    """

    centre: Array
    half: Array
    start: Array
    turn_to: Array


class Proved(NamedTuple):
    """What came of cells: their boxes, which are proved (B,), and how far σ stretches each coordinate (B, n)."""

    boxes: Boxes
    proved: Mask
    stretch: Array

    @classmethod
    def unpack(cls, arrays: Arrays) -> Proved:
        """From a task's result."""
        return cls(Boxes(*arrays[:_FIELDS]), *arrays[_FIELDS:])  # type: ignore[arg-type]


def prove_task(problem: Problem, arrays: Arrays) -> Arrays:
    """`prove` between plain tuples of arrays."""
    found = prove(problem, CellsToProve(*arrays))  # type: ignore[arg-type]
    return (*found.boxes, found.proved, found.stretch)


def glue_task(problem: Problem, arrays: Arrays) -> Arrays:
    """Which boxes carry the same σ as others at a common point: (*first, δ, *second, δ′) → one mask (B,)."""
    half = _FIELDS + 1
    first, second = Boxes(*arrays[:_FIELDS]), Boxes(*arrays[half : half + _FIELDS])  # type: ignore[arg-type]
    return (glued(problem, first, arrays[_FIELDS], second, arrays[-1]),)  # type: ignore[arg-type]


def prove(problem: Problem, cells: CellsToProve) -> Proved:
    """Follow σ from each start to its cell's centre and try Theorem N there."""
    system = problem.system
    with np.errstate(all="ignore"):
        at_face = newton(problem, cells.start, _AT_FACE, _NEAR)
        step = cells.centre - cells.start[:, system.independent]
        theta = at_face.theta
        theta[:, system.dependent] += apply(at_face.slopes, step)
        theta[:, system.independent] = cells.centre
        at_centre = newton(problem, theta, _AT_CENTRE)
        settled = at_face.settled & at_centre.settled
        theta = _turned(problem, at_centre.theta, cells.turn_to)
        stretch = np.linalg.norm(np.where(settled[:, None, None], at_centre.slopes, at_face.slopes), axis=1)
    rows = np.flatnonzero(settled)
    attempt = certify_boxes(problem, theta[rows], cells.half[rows], np.eye(system.n))
    boxes = Boxes(*(_spread(array, rows, len(theta)) for array in attempt.boxes))
    boxes.centre[:] = theta
    proved = np.zeros(len(theta), dtype=np.bool_)
    proved[rows] = attempt.proved
    kept = np.flatnonzero(proved)
    proved[kept] = meets(problem, boxes.take(kept))
    return Proved(boxes, proved, stretch)


def _spread(array: Array, rows: Indices, count: int) -> Array:
    """Rows put back where they were among `count`, zeros elsewhere."""
    result = np.zeros((count, *array.shape[1:]))
    result[rows] = array
    return result


def _turned(problem: Problem, theta: Array, turn_to: Array) -> Array:
    """Turn periodic dependent coordinates by whole turns to within half a turn of a reference."""
    system = problem.system
    turns = np.round((theta - turn_to) / TURN)
    movable = system.periodic.copy()
    movable[system.independent] = False
    return np.where(movable & np.isfinite(turns), theta - TURN * turns, theta)


def prove_cells(runner: Runner, cells: CellsToProve, chunk: int) -> Proved:
    """`tasks.prove`, in chunks of so many.

    Raises:
        Stopped: As for `Runner.map`.
    """
    results = runner.map(prove_task, [rows_of(cells, part) for part in _parts(len(cells.centre), chunk)])
    return joined(Proved.unpack(result) for result in results)


def glue_boxes(runner: Runner, first: Boxes, delta: Array, second: Boxes, delta_second: Array, chunk: int) -> Mask:
    """`newton.glued`, in chunks of so many.

    Raises:
        Stopped: As for `Runner.map`.
    """
    arrays: Arrays = (*first, delta, *second, delta_second)
    chunks = [tuple(array[part] for array in arrays) for part in _parts(len(delta), chunk)]
    same = [result[0] for result in runner.map(glue_task, chunks)]
    return np.concatenate([np.zeros(0, dtype=np.bool_), *same]).astype(np.bool_)


def _parts(count: int, chunk: int) -> list[slice]:
    return [slice(k, k + chunk) for k in range(0, count, chunk)]
