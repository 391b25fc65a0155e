"""Which boxes touch, and whether they carry the same solution where they do.

At the middle of a shared face a solution is proved within a small ball by Theorem K with no parameters; both boxes have
it where that ball lies in both tubes, the second one's up to whole turns. By uniqueness it is both boxes' solution
there, and so all over the face (the set where two continuous solutions agree is open and closed).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from flint import arb, arb_mat

from ccpin.auditing.boxes import box_of
from ccpin.auditing.cells import WHOLE
from ccpin.auditing.closures import Closures, Equations, columns, exact
from ccpin.auditing.document import Array, Document, Integers

_NEWTON = 12


class Contact(NamedTuple):
    """A face two boxes share: the middle in the first one's coordinates, and the turn that leads to the second's."""

    first: int
    second: int
    middle: Array
    turn: Array


def contacts(document: Document) -> Iterator[Contact]:
    """Every pair of boxes whose cells share a face (over the coordinates that a slice does not hold), once."""
    low, high = document.place, document.place + document.size
    start, width = document.lower, document.upper - document.lower
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
                middle = start + width * (0.5 * (begin[row] + end[row]) / WHOLE)
                middle[k] = start[k] + width[k] * (high[a, k] / WHOLE)
                yield Contact(a, int(beside[row]), middle, turn.copy())


def same_solution(closures: Closures, document: Document, contact: Contact) -> bool:
    """Whether the two boxes of a contact are proved to carry the same solution."""
    q = contact.middle
    found = solution(closures, document, contact.first, q)
    if found is None:
        return False
    theta, radius = found
    return all(
        in_tube(document, k, theta, radius, turn)
        for k, turn in ((contact.first, np.zeros_like(q)), (contact.second, contact.turn))
    )


def solution(closures: Closures, document: Document, k: int, q: Array) -> tuple[Array, float] | None:
    """θ and a radius about its y within which a solution over q is proved to be; sought from a box's middle."""
    offset = q - document.centre[k, document.independent]
    theta = document.centre[k] + document.directions[k] @ offset
    theta[document.independent] = q
    return near(closures, document.dependent, theta)


def near(closures: Equations, dependent: Integers, theta: Array) -> tuple[Array, float] | None:
    """A solution near θ over its q, and the radius within which it is proved."""
    theta = theta.copy()
    inverse: Array = np.zeros((closures.m, closures.m))
    for _ in range(_NEWTON):
        phi, jacobian = closures.at(theta)
        try:
            inverse = np.linalg.inv(jacobian[:, dependent]).astype(np.float64)
        except np.linalg.LinAlgError:
            return None
        step = inverse @ phi
        theta[dependent] -= step
        if not np.all(np.isfinite(theta)):
            return None
        if np.max(np.abs(step), initial=0.0) < 1e-13:
            break
    point, A = [arb(float(x)) for x in theta], exact(inverse)
    value = A * closures.value(point, closures.motions(point))
    size = max((float(abs(value[i, 0]).upper()) for i in range(closures.m)), default=0.0)
    for factor in (4.0, 64.0, 4096.0):
        radius = factor * max(size, 1e-15)
        ball = list(point)
        for index in dependent:
            ball[int(index)] = ball[int(index)] + arb(0, radius)
        slope = A * columns(closures.jacobian(closures.motions(ball)), dependent)
        rest = max(
            float(sum((abs(int(i == j) - slope[i, j]) for j in range(closures.m)), arb(0)).upper())
            for i in range(closures.m)
        )
        if rest < 1.0 and size + rest * radius < radius:
            return theta, radius
    return None


def in_tube(document: Document, k: int, theta: Array, radius: float, turn: Array) -> bool:
    """Whether every y within the radius of θ's is in a box's tube, θ turned back by `turn` and whole turns of y."""
    box = box_of(document, k)
    turns = [2 * arb.pi() * round(float(t) / (2.0 * np.pi)) for t in turn]
    q = [arb(float(x)) - t for x, t in zip(theta[document.independent], turns, strict=True)]
    delta = [a - box.centre[int(i)] for a, i in zip(q, document.independent, strict=True)]
    if any(not abs(d) <= arb(float(h)) for d, h in zip(delta, box.half, strict=True)):
        return False
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
        return False
    return all(abs(zeta[i, 0]) <= r for i, r in enumerate(box.radius))
