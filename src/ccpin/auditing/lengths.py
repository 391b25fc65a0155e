"""Lengths that a closure's rows see of a chain's segments (the lemma of `reach`)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from flint import arb, arb_mat

from ccpin.auditing.closures import Path, exact

PARALLEL, TILT = 1e-13, 1e-11  # what counts as parallel, or as I, and what it may do to a length


class Segments(NamedTuple):
    """What W sees at most and at least of the segment before a joint (or the tip), and of a slide of it by one.

    `as_is`: whether it sees all that is fixed before the joint moves as it is before any turn.
    """

    before: tuple[arb, arb]
    along: tuple[arb, arb]
    as_is: bool


def segments_of(path: Path, norm: arb) -> list[Segments]:
    """Those of a chain's joints, and of its tip."""
    rows = path.weights * path.weights.transpose()
    used = [i for i in range(rows.nrows()) if rows[i, i] != 0]
    whole = is_identity(path.weights.transpose() * path.weights)
    flat = len(used) == 2 and is_identity(arb_mat(2, 2, [rows[i, j] for i in used for j in used]))
    found, rotation, turned = list[Segments](), exact(np.eye(3)), False

    def seen(vector: arb_mat) -> tuple[arb, arb]:
        if turned and not (whole or flat):
            return size_of(vector) * norm, arb(0)
        size = size_of(path.weights * vector) + arb(0, TILT) * size_of(vector)
        return size, least_size(size)

    for turn in path.turns:
        before, rotation = seen(rotation * turn.translation), rotation * turn.rotation
        found.append(Segments(before, seen(rotation * turn.axis), whole or flat or not turned))
        turned = turned or not turn.prismatic
        flat = flat and (turn.prismatic or bool(size_of(path.weights * (rotation * turn.axis)) < PARALLEL))
    tip = seen(rotation * path.tip)
    return [*found, Segments(tip, tip, whole or flat or not turned)]


def is_identity(matrix: arb_mat) -> bool:
    """Whether a matrix is I but for roundings."""
    size = matrix.nrows()
    return all(abs(matrix[i, j] - int(i == j)) < PARALLEL for i in range(size) for j in range(size))


def norm_of(weights: arb_mat) -> arb:
    """‖W‖₂ ≤ √‖WWᵀ‖_∞."""
    square = weights * weights.transpose()
    sums = [sum((abs(square[i, j]) for j in range(square.ncols())), arb(0)) for i in range(square.nrows())]
    return root_of(max(sums, key=lambda x: float(x.upper())))


def size_of(vector: arb_mat) -> arb:
    """|x|, of a matrix ‖X‖_F."""
    return root_of(sum((abs(x) * abs(x) for x in vector.entries()), arb(0)))


def root_of(x: arb) -> arb:
    """The root of what is not negative, whatever roundings say."""
    return x.sqrt() if x > 0 else arb(0).union(arb(x.upper()).sqrt())


def least_size(x: arb) -> arb:
    """The least size in a ball."""
    return arb(0) if x.contains(0) else arb(abs(x).lower())
