"""What the tube theorem asks of the closed loop over slices of time: F′ at their middles and the ranges of F″."""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.programs.instructions import Code
from ccpin.validated.arithmetic.ball_arrays import BallArray, hull, joined, raised, zeros
from ccpin.validated.arithmetic.balls import centre_of
from ccpin.validated.arithmetic.jets import Jet, jets_over
from ccpin.validated.arithmetic.series import NotInvertibleError
from ccpin.validated.loop_equations import HALF_A_TURN, ClosedLoopEquations
from ccpin.validated.sets.branch import ClosedStates, Jets, closed_boxes, jets_of, nearly_closed, states_of
from ccpin.validated.sets.instants import Instants

_POINT = 1e-15  # rad or m: the box about a q that is a point, in doubles
_LARGER = 1.05  # than needed: room for the pieces' own boxes in it
_REGULAR = "ψ_q′ or D is not proven nonsingular on a box about the tube"
_BRANCH = "σ is not proven to be single on a box about the tube"


class UnboundedError(ArithmeticError):
    """A hypothesis about a slice that failed, in words (caught inside this package)."""


class StateBoxes(NamedTuple):
    """Boxes about the tube, on which σ is proven.

    Attributes:
        centre: σ at the middles, of shape (B, n′).
        q_free: Q × Y, alike.
        v: V, of shape (B, n).
        states: σ and its derivatives at the centres and over the pieces of the boxes, P pieces a box.
        pieces: P.
    """

    centre: BallArray
    q_free: BallArray
    v: BallArray
    states: ClosedStates
    pieces: int


class Curvature(NamedTuple):
    """F over slices, N = 2n.

    Attributes:
        slope: F′ at the middles, of shape (B, N, N).
        change: The range of d/dt F′ = F″[F] along the enclosed motion, of shape (B, N, N).
        bend: The range H of F″ over the boxes, of shape (B, N, N, N).
    """

    slope: BallArray
    change: BallArray
    bend: BallArray


def at_middles(loop: ClosedLoopEquations, instants: Instants) -> Jets:
    """F, F′ and F″ at the middles of slices.

    Raises:
        UnboundedError: The closed loop is not proven regular there.
    """
    v = instants.middle.at(np.s_[:, loop.n_x :])
    return _flow_jets(loop, _jets(_states(loop, _middles(loop, instants), v, None), loop, loop.field), v)


def _middles(loop: ClosedLoopEquations, instants: Instants) -> BallArray:
    """σ at the middles, in boxes as small as the doubles are."""
    q_free = instants.middle.at(np.s_[:, : loop.n_x])
    centre, proven = closed_boxes(loop, q_free.mid, q_free.rad[:, list(loop.independent)] + _POINT)
    if not proven.all():
        raise UnboundedError(_BRANCH)
    return centre


def boxes(loop: ClosedLoopEquations, instants: Instants, reach: Array, pieces: int) -> StateBoxes:
    """Boxes of the half-widths (B, N) about the motion over slices, with σ on pieces of them.

    Raises:
        UnboundedError: σ is not proven to be single there.
    """
    split, n, independent = loop.n_x, loop.n, list(loop.independent)
    centre = instants.middle.mid
    moved = np.abs(instants.during.mid - centre) + instants.during.rad
    q_reach, v_reach = raised(moved[:, independent] + reach[:, :n]), raised(moved[:, split:] + reach[:, n:])
    found, _ = closed_boxes(loop, centre[:, :split], q_reach, moved[:, loop.dependent])
    whole, proven = closed_boxes(loop, centre[:, :split], q_reach, _LARGER * found.rad[:, loop.dependent])
    middles = _middles(loop, instants)
    inside = np.all(middles.rad[:, loop.dependent] < whole.rad[:, loop.dependent])
    if not (proven.all() and inside):
        raise UnboundedError(_BRANCH)
    for angle in loop.wrapped:
        off = np.abs(whole.mid[:, angle.place] - float(angle.target.mid())) + whole.rad[:, angle.place]
        if not np.all(off < np.pi * (1.0 - 1e-9)):
            raise UnboundedError(HALF_A_TURN)
    for turned in loop.upright:
        place = slice(turned.place, turned.place + 4)
        reference = centre_of(turned.reference)
        if not np.all(whole.mid[:, place] @ reference - whole.rad[:, place] @ np.abs(reference) > 1e-9):
            raise UnboundedError(HALF_A_TURN)
    v = BallArray(centre[:, split:], v_reach)
    return StateBoxes(middles, whole, v, _in_pieces(loop, whole, v, pieces), pieces**n)


def _in_pieces(loop: ClosedLoopEquations, whole: BallArray, v: BallArray, pieces: int) -> ClosedStates:
    """σ over the pieces of boxes Q × Y, each coordinate of Q cut into as many intervals; all of V with each.

    Raises:
        UnboundedError: It is not proven on some piece, or not to be the one of the box.
    """
    independent = list(loop.independent)
    places = np.array(list(product(np.linspace(-1.0, 1.0, 2 * pieces + 1)[1::2], repeat=loop.n)))
    count = len(places)  # pieces of a box: those of the first, then those of the second, …
    large, rest = (BallArray(*(np.repeat(x, count, axis=0) for x in wide)) for wide in (whole, v))
    offset = large.rad[:, independent] * np.tile(places, (len(whole.mid), 1))
    reach = raised(large.rad[:, independent] / pieces * (1.0 + 1e-12) + 1e-15 * np.abs(large.mid[:, independent]))
    near = nearly_closed(loop, large.mid, offset)
    points, proven = closed_boxes(loop, near, np.full_like(reach, _POINT))
    box, also = closed_boxes(loop, near, reach)
    off = np.abs(near - large.mid) + np.maximum(points.rad, box.rad)
    own = np.all(raised(off)[:, loop.dependent] < large.rad[:, loop.dependent], axis=1)
    if not (proven & also & own).all():
        raise UnboundedError(_BRANCH)
    centre_rest = BallArray(rest.mid, np.zeros_like(rest.rad))
    whole_reach = np.concatenate([reach, rest.rad], axis=1)
    return _states(loop, joined(points, box), joined(centre_rest, rest), whole_reach)


def curvature_over(loop: ClosedLoopEquations, instants: Instants, slope: BallArray, around: StateBoxes) -> Curvature:
    """The ranges of F″ beside F′ at the middles, `at_middles`' slope.

    Raises:
        UnboundedError: ψ_q′ or D is not proven nonsingular on the boxes.
    """
    alone = boxes(loop, instants, np.zeros((len(instants.time), loop.n + around.v.mid.shape[1])), 1)
    along = _flow_jets(loop, _jets(alone.states, loop, loop.field), alone.v)
    change = (along.bend @ _flow(loop, instants.during).at(np.s_[:, None, :, None])).at((..., 0))
    over = _jets(around.states, loop, loop.field)
    bend = hull(over.bend.at(np.s_[:, loop.n_x :]), around.pieces)
    size = loop.n + around.v.mid.shape[1]
    whole = zeros(len(instants.time), size, size, size)
    for numbers, part in zip(whole, bend, strict=True):
        numbers[:, loop.n :] = part
    return Curvature(slope, change, whole)


def feedback(loop: ClosedLoopEquations, instants: Instants, reach: Array | None, pieces: int) -> BallArray:
    """Balls around ∂u/∂(q, q̇) of a sampled law, of shape (B, motors, 2n): at middles, or in boxes (2n,) about them.

    Raises:
        UnboundedError: The motors' efforts are not proven to exist there.
    """
    assert loop.efforts is not None, "asked for sampled loops only"
    size, rest = 2 * loop.n, len(loop.efforts.outputs)
    if reach is None:
        states = _states(loop, _middles(loop, instants), instants.middle.at(np.s_[:, loop.n_x :]), None)
        return _jets(states, loop, loop.efforts).slope.at(np.s_[:, :, :size])
    around = boxes(loop, instants, np.append(reach, np.zeros(rest))[None], pieces)
    over = _jets(around.states, loop, loop.efforts).slope
    return hull(over, around.pieces).at(np.s_[:, :, :size])


def _flow(loop: ClosedLoopEquations, states: BallArray) -> BallArray:
    """F over boxes of states (q′, q̇)."""
    try:
        found = jets_over(loop.field, [Jet(states.at(np.s_[:, k])) for k in range(loop.field.inputs)], order=0)
    except NotInvertibleError:
        raise UnboundedError(_REGULAR) from None
    parts = [states.at(np.s_[:, loop.n_x + k]) for k in range(loop.n)]
    parts += [jet.value for jet in found[loop.n_x :]]
    return BallArray(*(np.stack(column, axis=1) for column in zip(*parts, strict=True)))


def _flow_jets(loop: ClosedLoopEquations, field: Jets, v: BallArray) -> Jets:
    """F's jets from those of the outputs (q̇′, q̈)."""
    n, count, size = loop.n, len(v.mid), loop.n + v.mid.shape[1]
    value = BallArray(
        *(np.concatenate([a, b[:, loop.n_x :]], axis=1) for a, b in zip(v.at(np.s_[:, :n]), field.value, strict=True))
    )
    slope, bend = zeros(count, size, size), zeros(count, size, size, size)
    slope.mid[:, :n, n : 2 * n] = np.eye(n)
    for whole, part in ((slope, field.slope), (bend, field.bend)):
        for numbers, found in zip(whole, part, strict=True):
            numbers[:, n:] = found[:, loop.n_x :]
    return Jets(value, slope, bend)


def _states(loop: ClosedLoopEquations, q_free: BallArray, rest: BallArray, reach: Array | None) -> ClosedStates:
    try:
        return states_of(loop, q_free, rest, reach)
    except NotInvertibleError:
        raise UnboundedError(_REGULAR) from None


def _jets(states: ClosedStates, loop: ClosedLoopEquations, program: Code) -> Jets:
    try:
        return jets_of(states, loop, program)
    except NotInvertibleError:
        raise UnboundedError(_REGULAR) from None
