"""Cells said to hold the q of a singular configuration.

**Lemma** (Krawczyk). With any vector l, F(s, y, w) = (φ(q₀ + s d, y), φ_y w, lᵀw − 1) = 0 says that φ_y is singular at
a closed configuration over q₀ + s d. Where |ÃF(x₀)| + |I − ÃF′(x)|r < r, row by row, for all |x − x₀| ≤ r there is one
within r.
"""

from __future__ import annotations

import numpy as np
from flint import arb, arb_mat

from ccpin.auditing.boxes import defect
from ccpin.auditing.closures import BallClosures, exact, floats
from ccpin.auditing.reading import Array, ClaimedDocument, corners
from ccpin.auditing.singular_curves import Singular

_NEWTON = 30  # steps of Newton's method, at most


def singular(closures: BallClosures, document: ClaimedDocument, k: int) -> bool | None:
    """Whether the k-th cell called singular was proved to hold the q of a singular configuration; ``None``: not so."""
    theta, low_high = document.witnesses[k], corners(document, document.singular, k)
    jacobian = closures.at(theta)[1]
    u, _, w = np.linalg.svd(jacobian[:, document.dependent])
    normal = u[:, -1] @ jacobian[:, document.independent]
    normal = np.where(document.upper > document.lower, normal, 0.0)
    directions = [normal / max(float(np.linalg.norm(normal)), 1e-300), *np.eye(len(normal))]
    return any(_on_line(closures, document, theta, d, w[-1], low_high) for d in directions if np.any(d)) or None


def _on_line(
    closures: BallClosures,
    document: ClaimedDocument,
    theta: Array,
    direction: Array,
    weak: Array,
    cell: tuple[Array, Array],
) -> bool:
    """The same along one line."""
    m, y, q = closures.m, document.dependent, document.independent
    along, kernel, theta = 0.0, weak.copy(), theta.copy()
    start = theta[q].copy()
    inverse: Array = np.zeros((2 * m + 1, 2 * m + 1))
    for _ in range(_NEWTON):
        balls, weights = [arb(float(x)) for x in theta], [arb(float(x)) for x in kernel]
        value, slope = _extended(closures, document, balls, weights, direction, weak)
        try:
            inverse = np.linalg.inv(floats(slope)).astype(np.float64)
        except np.linalg.LinAlgError:
            return False
        step = inverse @ floats(value)[:, 0]
        if not np.all(np.isfinite(step)):
            return False
        along, kernel = along - step[0], kernel - step[m + 1 :]
        theta[y] -= step[1 : m + 1]
        theta[q] = start + along * direction
        if np.max(np.abs(step)) < 1e-12:
            break
    centre = [arb(float(x)) for x in theta]
    for row, index in enumerate(int(i) for i in q):  # q₀ + s d exactly, not as rounded
        centre[index] = arb(float(start[row])) + arb(float(along)) * arb(float(direction[row]))
    weights, A = [arb(float(x)) for x in kernel], exact(inverse)
    value = A * _extended(closures, document, centre, weights, direction, weak)[0]
    size = max(float(abs(f).upper()) for f in value.entries())
    for factor in (2.0, 16.0, 256.0):
        r = factor * max(size, 1e-15)
        around = [x + arb(0, r * float(abs(d))) for x, d in zip(centre, _lifted(document, direction, 1.0), strict=True)]
        near = [x + arb(0, r) for x in weights]
        image = A * _extended(closures, document, around, near, direction, weak)[1]
        if all(abs(f) + sum(row, arb(0)) * r < r for f, row in zip(value.entries(), defect(image), strict=True)):
            return _inside([around[int(i)] for i in q], cell)
    return False


def _lifted(document: ClaimedDocument, direction: Array, others: float) -> Array:
    """By how much each coordinate moves as s and y move by one."""
    moves: Array = np.full(len(document.independent) + len(document.dependent), others)
    moves[document.independent] = direction
    return moves


def _extended(
    closures: BallClosures,
    document: ClaimedDocument,
    theta: list[arb],
    kernel: list[arb],
    direction: Array,
    pairing: Array,
) -> tuple[arb_mat, arb_mat]:
    """F and F′: G and G′ of `singular_curves`, along the line."""
    system, x, m = Singular(closures, document.dependent, pairing), [*theta, *kernel], closures.m
    moves = np.zeros((system.n_free, system.m))
    moves[document.independent, 0] = direction
    moves[document.dependent, 1 : m + 1] = moves[closures.n_free :, m + 1 :] = np.eye(m)
    moved = system.motions(x)
    return system.value(x, moved), system.jacobian(moved) * exact(moves)


def _inside(q: list[arb], cell: tuple[Array, Array]) -> bool:
    """Whether q is in a cell, whose corners are outward by a rounding, in the coordinates that are not held."""
    return all(
        low == high or (x >= arb(float(low)) and x <= arb(float(high))) for x, low, high in zip(q, *cell, strict=True)
    )
