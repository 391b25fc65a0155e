"""Theorem N of one box, proved by cutting its parameters into cells.

A box is θ = θ_c + Dδ + Eζ, |δ| ≤ h, |ζ| ≤ R, E = [0; V]. Claimed: for every such δ, φ = 0 has exactly one solution in
the tube |ζ| ≤ R, and φ_y is nonsingular there. The Ã and w of the document are not used: any will do, cell by cell.

**Lemma.** Over a cell δ₀ ± e and a part ζ₀ ± r of ζ-space let θ₀ = θ_c + Dδ₀ + Eζ₀, J₀ = φ_θ(θ₀), f(δ, ζ) = Ãφ(θ) with
a real m×m matrix Ã, and let H_j hold ÃΣ_c ∂φ_θ/∂θ_c d_jc for the j-th column d_j of D, G_j for that of E. Let

    Y ≥ |f(δ₀, ζ₀)| + |ÃJ₀D|e + ½ Σ_j |H_jD|e e_j,
    M ≥ |I − Ã(J₀)_yV| + Σ_j |(H_j)_yV|e_j + Σ_j |(G_j)_yV|r_j,
    M̄ ≥ the same with ½ before the last sum,

componentwise: for every δ of the cell

1. Mw < w for a w > 0: φ = 0 has at most one solution in the part, and φ_y is nonsingular all over it;
2. Y + M̄r < r: it has one at least;
3. |f(δ₀, ζ₀)|_i > (Y − |f(δ₀, ζ₀)| + r + M̄r)_i for an i: it has none.

M may be met with |I − Ãφ_yV| as evaluated over the part, and M̄ with M. The claim follows from 2 for any part of the
tube, and 1 for what 3 leaves of the tube.

*Proof.* Ã(J(θ) − J₀) = Σ_j ∫₀¹ H_j dt (δ − δ₀)_j + Σ_j ∫₀¹ G_j dt (ζ − ζ₀)_j, so |I − f_ζ| ≤ M, and the average of f_ζ
over the segment from ζ₀ is within M̄ of I, as ∫ τ dτ = ½ (likewise Y, along the segment from δ₀). 1: K(ζ) = ζ − f(δ, ζ)
contracts in the norm max |ζ_i|/w_i, and f_ζ = Ãφ_yV is nonsingular. 2: |K(ζ) − ζ₀| ≤ Y + M̄r < r: K maps the part into
its interior (Brouwer). 3: |f(δ, ζ) − f(δ₀, ζ₀)| is at most the right side. ∎

Signs are kept until |·| is taken of a product with V or D: near a singular configuration large terms cancel there.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from flint import arb, arb_mat

from ccpin.auditing.closures import BallEquations, columns, exact, floats, inverse_of
from ccpin.auditing.reading import Array, ClaimedDocument, Integers, widened

_PARTS = 6  # of the tube, tried for 2 one after another
_ROOM = 1.05  # on Y + M̄r for the next part: 2 asks for a strict inequality
_NEWTON = 8  # steps: quadratic, and only proposes a part's middle
_ROUNDS = 6  # over the tube's faces, which are moved in where 3 holds
_LOOKS = 4096  # cells of one box


Cell = tuple[Array, Array]
"""Parameters δ between two corners."""
Sizes = list[list[arb]]
"""Bounds of a matrix, entry by entry."""


class Box(NamedTuple):
    """A box in balls: θ_c, D, V and R; h as doubles; which coordinates y are."""

    centre: list[arb]
    directions: arb_mat
    modes: arb_mat
    radius: list[arb]
    half: Array
    dependent: Integers


def box_of(document: ClaimedDocument, k: int) -> Box:
    """The k-th box of a document."""
    return Box(
        [arb(float(x)) for x in document.centre[k]],
        exact(document.directions[k]),
        exact(document.modes[k]),
        [arb(float(x)) for x in document.radius[k]],
        widened(document.centre[k, document.independent], document.half[k]),
        document.dependent,
    )


def proved(closures: BallEquations, document: ClaimedDocument, k: int, cuts: int) -> bool | None:
    """Whether the k-th box's claim was proved or, as by `box_proved`, refuted."""
    return box_proved(closures, box_of(document, k), cuts)


def box_proved(closures: BallEquations, box: Box, cuts: int) -> bool | None:
    """Whether a box's claim was proved (``True``) or refuted (``False``), cut in two so many times one after another.

    It is refuted where 3 holds for the whole tube over a single δ: there is no solution in it. ``None``: neither.
    """
    if not all(r > 0 for r in box.radius):
        return False

    def held(cell: Cell, done: int) -> bool:
        return holds(closures, box, cell, narrowing=done >= cuts // 4)

    left = unproved(box.half, cuts, held)
    if left is None:
        return True
    return False if _misses(closures, box, 0.5 * (left[0] + left[1])) else None


def unproved(half: Array, cuts: int, held: Callable[[Cell, int], bool], weight: Array | float = 1.0) -> Cell | None:
    """A cell of |δ| ≤ h that was not proved, cut in two so many times one after another; ``None``: all were.

    `held` tells whether a cell was proved, and is told how often it was cut; the cut is across the largest of its
    widths times their weights.
    """
    cells, looks = [(-half, half, 0)], _LOOKS
    while cells:
        low, high, done = cells.pop()
        looks -= 1
        if held((low, high), done):
            continue
        if done == cuts or not looks:
            return low, high
        axis = int(np.argmax((high - low) * weight))
        middle = 0.5 * (low[axis] + high[axis])
        below, above = high.copy(), low.copy()
        below[axis] = above[axis] = middle
        cells += [(low, below, done + 1), (above, high, done + 1)]
    return None


def _misses(closures: BallEquations, box: Box, delta: Array) -> bool:
    """Whether a box's tube was proved to hold no solution at δ."""
    radius = np.array([float(r.upper()) for r in box.radius])
    found = look(closures, box, (delta, delta), np.zeros_like(radius), radius)
    return found is not None and found.none


class Looked(NamedTuple):
    """The lemma over a cell and a part: which of 1, 2, 3 hold, and Y and |M̄| (upper bounds)."""

    one_at_most: bool
    one_at_least: bool
    none: bool
    offset: Array
    carried: Array


def holds(closures: BallEquations, box: Box, cell: Cell, narrowing: bool) -> bool:
    """The claim for one cell; `narrowing`: the tube is narrowed by 3 where 1 does not hold for all of it."""
    radius = np.array([float(r.upper()) for r in box.radius])
    tube = look(closures, box, cell, np.zeros_like(radius), radius)
    if tube is None:
        return False
    if not tube.one_at_most and not (narrowing and _one_in_tube(closures, box, cell, radius)):
        return False
    if tube.one_at_least:
        return True
    middle = _solution(closures, box, 0.5 * (cell[0] + cell[1]))
    room = np.nextafter(radius - np.abs(middle), -np.inf)
    part = room
    for _ in range(_PARTS):
        if not np.all(part > 0):
            return False
        found = look(closures, box, cell, middle, part)
        if found is None or found.one_at_least:
            return found is not None
        part = np.minimum(room, _ROOM * (found.offset + found.carried @ part))
    return False


def _one_in_tube(closures: BallEquations, box: Box, cell: Cell, radius: Array) -> bool:
    """Whether 1 holds for what 3 leaves of the tube, tried at its ends."""
    lower, upper = -radius, radius.copy()
    for _ in range(_ROUNDS):
        for k in range(len(radius)):
            for side in (False, True):
                end = lower.copy(), upper.copy()
                end[not side][k] = lower[k] + (0.75 if side else 0.25) * (upper[k] - lower[k])
                found = look(closures, box, cell, 0.5 * (end[0] + end[1]), np.array(_half_width(*end)))
                if found is not None and found.none:
                    (upper if side else lower)[k] = end[not side][k]
        left = look(closures, box, cell, 0.5 * (lower + upper), np.array(_half_width(lower, upper)))
        if left is not None and left.one_at_most:
            return True
    return False


def _solution(closures: BallEquations, box: Box, delta: Array) -> Array:
    """ζ of a solution at δ, by Newton's method in plain floating point."""
    zeta, modes = np.zeros(closures.m), floats(box.modes)
    base = np.array([float(x) for x in box.centre]) + floats(box.directions) @ delta
    for _ in range(_NEWTON):
        theta = base.copy()
        theta[box.dependent] += modes @ zeta
        phi, jacobian = closures.at(theta)
        try:
            step = np.linalg.solve(jacobian[:, box.dependent] @ modes, phi)
        except np.linalg.LinAlgError:
            break
        zeta = zeta - step
    return zeta


def look(closures: BallEquations, box: Box, cell: Cell, middle: Array, part: Array) -> Looked | None:
    """The lemma over a cell (low, high) and ζ₀ ± r; ``None`` where no Ã was found."""
    delta = 0.5 * (cell[0] + cell[1])
    spread = _half_width(*cell)
    shift = box.directions * exact(delta)
    lift = embedded(box, exact(middle))
    start = [x + shift[i, 0] + lift[i] for i, x in enumerate(box.centre)]
    along = (box.directions * arb_mat(len(spread), 1, [arb(0, e) for e in spread])).entries()
    aside = embedded(box, arb_mat(len(part), 1, [arb(0, float(r)) for r in part]))
    motions = closures.motions(start)
    slope = closures.jacobian(motions)
    around = closures.motions([x + a + b for x, a, b in zip(start, along, aside, strict=True)])
    chosen = box.dependent
    A = inverse_of(floats(columns(slope, chosen)) @ floats(box.modes))
    if A is None:
        return None
    bends = [A * closures.variation(around, move) for move in moves_of(box)]
    drift, plain = _sizes(A * (slope * box.directions)), defect(A * (columns(slope, chosen) * box.modes))
    whole, mean = plain, plain
    for k, (bend, width) in enumerate(zip(bends, [*spread, *map(float, part)], strict=True)):
        bent = _scaled(_sizes(columns(bend, chosen) * box.modes), width)
        whole = _sum(whole, bent)
        mean = _sum(mean, bent if k < len(spread) else _scaled(bent, 0.5))
        if k < len(spread):
            drift = _sum(drift, _scaled(_sizes(bend * box.directions), 0.5 * width))
    whole = _least(whole, defect(A * (columns(closures.jacobian(around), chosen) * box.modes)))
    least = _least(mean, whole)
    value = A * closures.value(start, motions)
    offset = [sum((row[j] * arb(e) for j, e in enumerate(spread)), abs(value[i, 0])) for i, row in enumerate(drift)]
    reach = [arb(float(r)) for r in part]
    image = [sum((x * r for x, r in zip(row, reach, strict=True)), y) for row, y in zip(least, offset, strict=True)]
    return Looked(
        contracts(whole),
        all(x < r for x, r in zip(image, reach, strict=True)),
        any(2 * abs(f) > x + r for f, x, r in zip(value.entries(), image, reach, strict=True)),
        np.array([_upper(x) for x in offset]),
        np.array([[_upper(x) for x in row] for row in least]),
    )


def _half_width(low: Array, high: Array) -> list[float]:
    """e ≥ |x − (low + high)/2| for x between low and high, as the middle is rounded."""
    middle = 0.5 * (low + high)
    return [float(np.nextafter(max(b - m, m - a), np.inf)) for a, m, b in zip(low, middle, high, strict=True)]


def moves_of(box: Box) -> list[list[arb]]:
    """How θ moves with each parameter: the columns of D, and of E."""
    along = box.directions.transpose().tolist()
    return [*along, *(embedded(box, exact(unit)) for unit in np.eye(len(box.radius)))]


def embedded(box: Box, zeta: arb_mat) -> list[arb]:
    """Eζ."""
    moved, whole = box.modes * zeta, [arb(0)] * len(box.centre)
    for row, index in enumerate(box.dependent):
        whole[int(index)] = moved[row, 0]
    return whole


def contracts(matrix: Sizes) -> bool:
    """Whether |M|w < w for some w > 0: the sum of the powers of |M| applied to 1, where it converges."""
    rough = np.array([[_upper(x) for x in row] for row in matrix])
    if not np.all(np.isfinite(rough)):
        return False
    try:
        weight = np.linalg.solve(np.eye(len(rough)) - rough, np.ones(len(rough)))
    except np.linalg.LinAlgError:
        return False
    if not np.all(weight > 0):
        return False
    w = [arb(float(x)) for x in weight]
    return all(sum((x * y for x, y in zip(row, w, strict=True)), arb(0)) < w[i] for i, row in enumerate(matrix))


def defect(matrix: arb_mat) -> Sizes:
    """|I − X|."""
    return [[abs(int(i == j) - matrix[i, j]) for j in range(matrix.ncols())] for i in range(matrix.nrows())]


def _sizes(matrix: arb_mat) -> Sizes:
    """|X|."""
    return [[abs(matrix[i, j]) for j in range(matrix.ncols())] for i in range(matrix.nrows())]


def _scaled(sizes: Sizes, by: float) -> Sizes:
    return [[x * by for x in row] for row in sizes]


def _sum(one: Sizes, other: Sizes) -> Sizes:
    return [[x + y for x, y in zip(a, b, strict=True)] for a, b in zip(one, other, strict=True)]


def _least(one: Sizes, other: Sizes) -> Sizes:
    """Of two bounds the lower, entry by entry."""
    return [[min(x, y, key=_upper) for x, y in zip(a, b, strict=True)] for a, b in zip(one, other, strict=True)]


def _upper(x: arb) -> float:
    return float(x.upper())
