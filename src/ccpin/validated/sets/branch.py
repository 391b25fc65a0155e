"""Boxes of states of the reduced model: σ proven over a box of q, and the jets of q̈ there in the coordinates (q, q̇).

Theorem P of `ccpin/proof/theorems/closed_boxes.md`, in doubles rounded outwards; its names w, R, Q, Y and C are used
here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Mask
from ccpin.programs.instructions import Code
from ccpin.validated.arithmetic.ball_arrays import BallArray, exactly, inverse, raised, stacked, zeros
from ccpin.validated.arithmetic.jets import Jet, jets_over, narrowed
from ccpin.validated.arithmetic.series import NotInvertibleError
from ccpin.validated.loop_equations import ClosedLoopEquations

_ROUNDS = 12  # boxes tried, each a little larger than the last one's image
_NEWTON_STEPS = 3  # from nearly closed configurations: quadratic, and not a proof
_SIGMA_ROUNDS = 3  # narrowings of σ and ρ over a box by those at its centre
_INFLATION = 1.02  # of an image: the next box must hold its own strictly
_SMALLEST = 1e-14  # rad or m, of a box: above the rounding of its centre


class Jets(NamedTuple):
    """Outputs over B boxes with their derivatives along d directions.

    Attributes:
        value: Of shape (B, outputs).
        slope: Of shape (B, outputs, d).
        bend: Of shape (B, outputs, d, d).
    """

    value: BallArray
    slope: BallArray
    bend: BallArray


def closed_boxes(
    loop: ClosedLoopEquations, centre: Array, reach: Array, least: Array | None = None
) -> tuple[BallArray, Mask]:
    """Boxes Q × Y of Theorem P, and for which of them its inequality (`image` within the radius) is proven.

    Args:
        loop: The mechanism.
        centre: Nearly closed configurations, of shape (B, n′).
        reach: w, of shape (B, n).
        least: Lower bounds of R, of shape (B, m).
    """
    dependent, independent = list(loop.dependent), list(loop.independent)
    radius = np.zeros_like(centre)
    radius[:, independent] = reach
    if not dependent:
        return BallArray(centre, radius), np.ones(len(centre), dtype=np.bool_)
    phi, slopes = _closure(loop, exactly(centre))
    near = exactly(np.linalg.inv(slopes.mid[:, :, dependent]))
    open_by = (near @ phi.at(np.s_[:, :, None])).size[:, :, 0]
    identity = exactly(np.eye(len(dependent)))

    def image() -> Array:
        _, over = _closure(loop, BallArray(centre, radius))
        moved = (near @ over.at(np.s_[:, :, independent])).size @ reach[:, :, None]
        changed = (identity - near @ over.at(np.s_[:, :, dependent])).size @ radius[:, dependent, None]
        return raised(open_by + (moved + changed)[:, :, 0])

    floor = open_by + _SMALLEST if least is None else np.maximum(least, open_by + _SMALLEST)
    radius[:, dependent] = floor
    for _ in range(_ROUNDS):
        found = image()
        held = np.all(found < radius[:, dependent], axis=1)
        if held.all():
            break
        radius[:, dependent] = np.where(held[:, None], radius[:, dependent], np.maximum(_INFLATION * found, floor))
    return BallArray(centre, radius), np.asarray(held)


def nearly_closed(loop: ClosedLoopEquations, centre: Array, offset: Array) -> Array:
    """Configurations (B, n′) near σ at q + offset (B, n), from nearly closed ones by Newton's method; not a proof."""
    theta, dependent = centre.copy(), list(loop.dependent)
    if dependent:
        _, slopes = _closure(loop, exactly(centre))
        along = slopes.mid[:, :, list(loop.independent)] @ offset[:, :, None]
        theta[:, dependent] -= np.linalg.solve(slopes.mid[:, :, dependent], along)[:, :, 0]
    theta[:, list(loop.independent)] += offset
    for _ in range(_NEWTON_STEPS if dependent else 0):
        phi, slopes = _closure(loop, exactly(theta))
        theta[:, dependent] -= np.linalg.solve(slopes.mid[:, :, dependent], phi.mid[:, :, None])[:, :, 0]
    return theta


def _closure(loop: ClosedLoopEquations, q_free: BallArray) -> tuple[BallArray, BallArray]:
    """φ and φ_q′ over boxes, of shapes (B, m) and (B, m, n′)."""
    unit = exactly(np.broadcast_to(np.eye(loop.n_x), (len(q_free.mid), loop.n_x, loop.n_x)))
    found = jets_over(loop.closure, _inputs(loop, q_free, [unit]), order=1)
    return _gathered(found, loop.n_x)[:2]


class ClosedStates(NamedTuple):
    """B boxes of closed states with a point of each, their centres, in one stack: first the centres, then the boxes.

    Attributes:
        rest: q̇, or q̇ and u, of shape (2B, d − n).
        q_free: σ(q), of shape (2B, n′).
        slopes: ρ = σ_q, σ_qq and σ_qqq, of shapes (2B, n′, n), (2B, n′, n, n), (2B, n′, n, n, n).
        reach: Bounds of the distance from centre to the box's points along s, of shape (B, d); ``None`` where there are
            no centres.
    """

    rest: BallArray
    q_free: BallArray
    slopes: tuple[BallArray, BallArray, BallArray]
    reach: Array | None


def states_of(
    loop: ClosedLoopEquations, q_free: BallArray, rest: BallArray, reach: Array | None = None
) -> ClosedStates:
    """σ and its derivatives over closed boxes, narrowed by those at their centres where there are some.

    Args:
        loop: The mechanism.
        q_free: From `closed_boxes`; centres first, each in its box, where a reach is given.
        rest: As in the result.
        reach: Likewise.

    Raises:
        NotInvertibleError: ψ_q′ is not proven nonsingular on one of them.
    """
    q_free, n, dependent = BallArray(*(x.copy() for x in q_free)), loop.n, list(loop.dependent)
    rho, bend, twist = (zeros(len(q_free.mid), loop.n_x, *[n] * degree) for degree in (1, 2, 3))
    slopes = rho, bend, twist
    slopes[0].mid[:, list(loop.independent)] = np.eye(n)
    for _ in range((1 if reach is None else _SIGMA_ROUNDS) if dependent else 0):
        jacobian = _closure(loop, q_free)[1]
        over = inverse(jacobian.at(np.s_[:, :, dependent]))
        if over is None:
            raise NotInvertibleError
        _write(slopes[0], dependent, -(over @ jacobian.at(np.s_[:, :, list(loop.independent)])))
        for degree in (2, 3):
            found = jets_over(loop.closure, _inputs(loop, q_free, slopes[: degree - 1]), order=degree)
            open_by = stacked(_or_zero(x[degree], len(q_free.mid), *[n] * degree) for x in found).swapped(-1, 1)
            flat = BallArray(*(x.reshape(*x.shape[:2], -1) for x in open_by))
            _write(slopes[degree - 1], dependent, -(over @ flat))
        if reach is not None:
            _narrow(q_free, slopes, dependent, reach[:, :n])
    return ClosedStates(rest, q_free, slopes, reach)


def _narrow(
    q_free: BallArray, slopes: tuple[BallArray, BallArray, BallArray], dependent: list[int], reach: Array
) -> None:
    """Narrow σ and its first and second derivatives over boxes, in place."""
    for k in dependent:
        value, slope, bend = (x.at(np.s_[:, k]) for x in (q_free, *slopes[:2]))
        sharp = narrowed(Jet(value, slope, bend, slopes[2].at(np.s_[len(reach) :, k])), reach)
        for whole, part in zip((q_free, *slopes[:2]), sharp, strict=False):
            assert part is not None, "every part was given"
            whole.mid[:, k], whole.rad[:, k] = part


def _write(whole: BallArray, rows: list[int], part: BallArray) -> None:
    for numbers, found in zip(whole, part, strict=True):
        numbers[:, rows] = found.reshape(len(found), len(rows), *numbers.shape[2:])


def jets_of(states: ClosedStates, loop: ClosedLoopEquations, program: Code) -> Jets:
    """A program's jets over the boxes along s = (q, the rest of its inputs).

    Raises:
        NotInvertibleError: ψ_q′ or D is not proven nonsingular on one of them.
    """
    n, (boxes, rest) = loop.n, states.rest.mid.shape
    d = n + rest
    along = [zeros(boxes, loop.n_x, *[d] * degree) for degree in (1, 2, 3)]
    for degree, (whole, part) in enumerate(zip(along, states.slopes, strict=True)):
        for numbers, found in zip(whole, part, strict=True):
            numbers[(slice(None), slice(None), *[slice(n)] * (degree + 1))] = found
    over = np.s_[0 if states.reach is None else boxes // 2 :]
    along[2] = along[2].at(over)
    inputs = [
        Jet(states.q_free.at(np.s_[:, k]), *(x.at(np.s_[:, k]) for x in along[: 1 if k in loop.independent else 3]))
        for k in range(loop.n_x)
    ]
    unit = np.broadcast_to(np.eye(d), (boxes, d, d))
    inputs += [Jet(states.rest.at(np.s_[:, k]), exactly(unit[:, n + k])) for k in range(rest)]
    order = 2 if states.reach is None else 3
    return Jets(*(x.at(over) for x in _gathered(jets_over(program, inputs, order, states.reach), d)))


def _inputs(loop: ClosedLoopEquations, q_free: BallArray, slopes: Sequence[BallArray]) -> list[Jet]:
    """q′ with the slopes given, each of shape (B, n′, d, …), at rest."""
    still = Jet(exactly(np.zeros(len(q_free.mid))))
    moving = [Jet(q_free.at(np.s_[:, k]), *(x.at(np.s_[:, k]) for x in slopes)) for k in range(q_free.mid.shape[1])]
    return [*moving, *[still] * (loop.field.inputs - loop.n_x)]


def _gathered(found: list[Jet], width: int) -> Jets:
    """Outputs' jets side by side, zeros filled in."""
    boxes = len(found[0].value.mid)
    parts = ([_or_zero(x[degree], boxes, *[width] * degree) for x in found] for degree in range(3))
    return Jets(*(stacked(part, axis=1) for part in parts))


def _or_zero(x: BallArray | None, *shape: int) -> BallArray:
    return zeros(*shape) if x is None else x
