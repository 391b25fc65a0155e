"""Which boxes touch, and whether they carry the same solution where they do.

At the middle of a shared face a solution is proved within a small ball by Theorem N with no parameters; both boxes have
it where that ball lies in both tubes, the second one's up to whole turns. By uniqueness it is both boxes' solution
there, and so all over the face (the set where two continuous solutions agree is open and closed).
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import NamedTuple

import numpy as np
from flint import arb, arb_mat
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ccpin.auditing.boxes import box_of, defect
from ccpin.auditing.closures import BallClosures, BallEquations, columns, exact
from ccpin.auditing.reading import Array, ClaimedDocument, Faces, Integers
from ccpin.auditing.tiling import WHOLE

_NEWTON = 12  # steps at most: quadratic; what they end at is proved afterwards


class SharedFace(NamedTuple):
    """A face two boxes share: the middle in the first one's coordinates, and the turn that leads to the second's."""

    first: int
    second: int
    middle: Array
    turn: Array


def contacts(document: ClaimedDocument) -> Iterator[SharedFace]:
    """Every pair of boxes whose cells share a face (over the coordinates that a slice does not hold), once."""
    low, high = document.place, document.place + document.size
    start = [Fraction(float(x)) for x in document.lower]
    edge = [Fraction(float(x)) - a for x, a in zip(document.upper, start, strict=True)]
    width = document.upper - document.lower
    for k in map(int, np.flatnonzero(width > 0.0)):
        ends = np.where(document.wrapped[k], high[:, k] % WHOLE, high[:, k])
        order = np.argsort(low[:, k], kind="stable")
        begins = low[order, k]
        first, last = (np.searchsorted(begins, ends, side) for side in ("left", "right"))
        turn = np.zeros(len(width))
        others = np.flatnonzero(np.arange(len(width)) != k)
        for a in range(len(low)):
            beside = order[first[a] : last[a]]
            begin, end = np.maximum(low[a], low[beside]), np.minimum(high[a], high[beside])
            turn[k] = width[k] if high[a, k] != ends[a] else 0.0
            for row in np.flatnonzero(np.all((end > begin)[:, others], axis=1)):
                twice = begin[row] + end[row]
                twice[k] = 2 * high[a, k]
                middle = [float(a0 + e * int(w) / (2 * WHOLE)) for a0, e, w in zip(start, edge, twice, strict=True)]
                yield SharedFace(a, int(beside[row]), np.array(middle), turn.copy())


def sheets_of(document: ClaimedDocument, faces: Faces) -> Integers:
    """The sheet of each box: boxes that a way over glued faces joins have the same number."""
    count = len(document.centre)
    if not count:
        return np.zeros(0, dtype=np.int64)
    graph = coo_array((np.ones(len(faces.first)), (faces.first, faces.second)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def apart(document: ClaimedDocument, faces: Faces) -> Iterator[SharedFace]:
    """Faces of certified cells at which two boxes are said to be of two sheets: no way over glued faces joins them."""
    sheet = sheets_of(document, faces)
    cell = np.empty(len(sheet), dtype=np.int64)
    cell[document.over.box] = document.over.cell
    counts = document.counts
    certified = np.isin(cell, [] if counts is None else counts.cells.number[counts.certified])
    for contact in contacts(document):
        a, b = contact.first, contact.second
        if certified[a] and certified[b] and sheet[a] != sheet[b]:
            yield contact


def same_solution(closures: BallClosures, document: ClaimedDocument, contact: SharedFace) -> bool | None:
    """Whether the two boxes of a contact are proved to carry the same solution, or (``False``) two; ``None``: neither.

    They carry two where that of the first is proved to lie beyond the second one's tube, which holds the second's.
    """
    q = contact.middle
    found = solution(closures, document, contact.first, q)
    if found is None or not in_tube(document, contact.first, *found, np.zeros_like(q)):
        return None
    return in_tube(document, contact.second, *found, contact.turn)


def solution(closures: BallClosures, document: ClaimedDocument, k: int, q: Array) -> tuple[Array, float] | None:
    """θ and a radius about its y within which a solution over q is proved to be; sought from a box's middle."""
    offset = q - document.centre[k, document.independent]
    theta = document.centre[k] + document.directions[k] @ offset
    theta[document.independent] = q
    return near(closures, document.dependent, theta)


def near(closures: BallEquations, dependent: Integers, theta: Array) -> tuple[Array, float] | None:
    """A solution near θ over its q, and the radius within which it is proved."""
    theta = theta.copy()
    inverse: Array = np.zeros((closures.m, closures.m))
    for _ in range(_NEWTON):
        phi, jacobian = closures.at(theta)
        try:
            inverse = np.linalg.inv(jacobian[:, dependent]).astype(np.float64)
        except np.linalg.LinAlgError:
            return None
        if not (np.all(np.isfinite(inverse)) and np.all(np.isfinite(phi))):
            return None
        step = inverse @ phi
        theta[dependent] -= step
        if not np.all(np.isfinite(theta)):
            return None
        if np.max(np.abs(step), initial=0.0) < 1e-13:
            break
    point, A = [arb(float(x)) for x in theta], exact(inverse)
    value = A * closures.value(point, closures.motions(point))
    size = max((float(abs(f).upper()) for f in value.entries()), default=0.0)
    for factor in (1.25, 4.0, 64.0, 4096.0):
        radius = factor * max(size, 1e-15)
        ball = list(point)
        for index in dependent:
            ball[int(index)] = ball[int(index)] + arb(0, radius)
        slope = A * columns(closures.jacobian(closures.motions(ball)), dependent)
        rest = max(float(sum(row, arb(0)).upper()) for row in defect(slope))
        if rest < 1.0 and size + rest * radius < radius:
            return theta, radius
    return None


def in_tube(document: ClaimedDocument, k: int, theta: Array, radius: float, turn: Array) -> bool | None:
    """Whether every y within the radius of θ's is in a box's tube, θ turned back by `turn` and whole turns of y.

    ``False``: none is, whichever turns are taken. ``None``: neither, or θ is not over the box.
    """
    box = box_of(document, k)
    turns = [2 * arb.pi() * round(float(t) / (2.0 * np.pi)) for t in turn]
    q = [arb(float(x)) - t for x, t in zip(theta[document.independent], turns, strict=True)]
    delta = [a - box.centre[int(i)] for a, i in zip(q, document.independent, strict=True)]
    if any(not abs(d) <= arb(float(h)) for d, h in zip(delta, box.half, strict=True)):
        return None
    predicted = box.directions * arb_mat(len(delta), 1, delta)
    gaps = []
    for index in (int(i) for i in document.dependent):
        gap = arb(float(theta[index])) - box.centre[index] - predicted[index, 0]
        if document.periodic[index]:
            gap = gap - 2 * arb.pi() * round(float(gap.mid()) / (2.0 * np.pi))
        gaps.append(gap + arb(0, radius))
    try:
        zeta = box.modes.solve(arb_mat(len(gaps), 1, gaps))
    except ZeroDivisionError:
        return None
    if all(abs(zeta[i, 0]) <= r for i, r in enumerate(box.radius)):
        return True
    reach = (box.modes * arb_mat(len(gaps), 1, [arb(0, float(r.upper())) for r in box.radius])).entries()
    beyond = any(abs(zeta[i, 0]) > r for i, r in enumerate(box.radius))
    return False if beyond and _by_turns(document, gaps, reach) else None


def _by_turns(document: ClaimedDocument, gaps: list[arb], reach: list[arb]) -> bool:
    """Whether angles known modulo 2π lead into a tube's reach by their nearest turn alone, if by any."""
    turning = [bool(document.periodic[int(index)]) for index in document.dependent]
    return all(abs(gap) + abs(x) < 2 * arb.pi() for gap, x, turn in zip(gaps, reach, turning, strict=True) if turn)
