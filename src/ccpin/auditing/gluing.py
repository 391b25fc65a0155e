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
from ccpin.auditing.closures import Closures, Equations, columns, exact
from ccpin.auditing.document import Array, Document, Integers

_CLOSE = 1e-9  # of the region's width: faces nearer than this are one
_NEWTON = 12


class Contact(NamedTuple):
    """A face two boxes share: the middle in the first one's coordinates, and the turn that leads to the second's."""

    first: int
    second: int
    middle: Array
    turn: Array


def contacts(document: Document) -> Iterator[Contact]:
    """Every pair of boxes whose closures share a face (over the coordinates that a slice does not hold)."""
    centre = document.centre[:, document.independent]
    low, high = centre - document.half, centre + document.half
    width = document.upper - document.lower
    held = width <= 0.0
    for k in map(int, np.flatnonzero(~held)):
        ends, begins = _places(high[:, k], document, k, width), _places(low[:, k], document, k, width)
        order = np.argsort(begins, kind="stable")
        first = np.searchsorted(begins[order], ends - _CLOSE, "left")
        last = np.searchsorted(begins[order], ends + _CLOSE, "right")
        for a in range(len(low)):
            candidates = order[first[a] : last[a]]
            turn = np.zeros(low.shape[1])
            turn[k] = np.round((high[a, k] - low[candidates[0], k]) / width[k]) * width[k] if candidates.size else 0.0
            begin, end = np.maximum(low[a], low[candidates] + turn), np.minimum(high[a], high[candidates] + turn)
            overlap = end - begin
            overlap[:, held] = overlap[:, k] = 1.0
            for row in np.flatnonzero(np.all(overlap > _CLOSE, axis=1)):
                middle = 0.5 * (begin[row] + end[row])
                middle[k] = high[a, k]
                yield Contact(a, int(candidates[row]), middle, turn)


def _places(face: Array, document: Document, k: int, width: Array) -> Array:
    """Where faces lie in the region, from 0 to 1; on a coordinate that closes on itself its end is its beginning."""
    place = (face - document.lower[k]) / width[k]
    return np.asarray(np.mod(place + _CLOSE, 1.0) - _CLOSE if document.wrapped[k] else place)


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
