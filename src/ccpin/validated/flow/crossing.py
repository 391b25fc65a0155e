"""A free motion proved to meet a singular configuration: what refutes that it stays on its branch of σ.

Theorem X of `ccpin/proof/theorems/crossing.md`; the other coordinates: `ccpin.mechanism.other_coordinates`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import CcpinError
from ccpin.mechanism.other_coordinates.independent_sets import best_independent, with_independent
from ccpin.proof.verdict import Witness
from ccpin.validated.arithmetic.ball_arrays import of_balls
from ccpin.validated.arithmetic.balls import Ball, ball, centre_of, lower, upper
from ccpin.validated.arithmetic.series import values
from ccpin.validated.flow.regularity import regular, signed_determinant
from ccpin.validated.flow.step import ProvenStep, StepOptions, march
from ccpin.validated.model.closed_loop import ClosedLoop, recorded_loop
from ccpin.validated.model.recorded_coordinates import configuration

_HALVINGS = 60  # of one step's time, where signs are proved that long


class Crossing(NamedTuple):
    """When and where a motion is singular: a time between the two, and the configuration's neighbourhood."""

    after: float
    before: float
    witness: Witness


def sign_of(value: Ball) -> int:
    """+1 or −1 where all numbers of the ball have that sign, else 0."""
    return int(lower(value) > 0.0) - int(upper(value) < 0.0)


def find_crossing(
    model: ReducedModel, loop: ClosedLoop, here: Sequence[Ball], since: float, duration: float, options: StepOptions
) -> Crossing | None:
    """Where a free motion, enclosed up to the box of states `here` at t = `since`, is proved to meet a singularity."""
    if loop.left_out is not None or loop.turns:  # other rows may be kept in other coordinates, and other numbers
        return None
    sign = sign_of(signed_determinant(loop, here))
    followed = _other_coordinates(model, loop, here)
    if not sign or followed is None:
        return None
    other, start = followed
    time, unknown = since, list[ProvenStep]()  # the steps since the time at which the sign was last proved
    for step in march(regular(other), start, duration, options):
        if not isinstance(step, ProvenStep):
            return None
        found = sign_of(signed_determinant(loop, step.box(ball(step.length))))
        unknown.append(step)
        if found == -sign:
            return _located(loop, unknown, time, sign)
        if found == sign:
            time, unknown = time + sum(done.length for done in unknown), []
    return None


def _other_coordinates(
    model: ReducedModel, loop: ClosedLoop, here: Sequence[Ball]
) -> tuple[ClosedLoop, list[Ball]] | None:
    """The motion in coordinates that measure it well at a box of states, and that box in them."""
    q_free = centre_of(configuration(loop.joints, here))
    try:
        names = best_independent(model.mechanism, q_free, model.rho(q_free))
        sibling = ReducedModel(with_independent(model.mechanism, names, q_free), model.gravity_vector)
        other = recorded_loop(sibling, None, q_free)
    except CcpinError:
        return None
    if other.independent == loop.independent or not other.scalar or other.turns:
        return None
    x_rate = values(loop.drift, here)
    return other, [*here[: loop.n_x], *[x_rate[k] for k in other.independent]]


def _located(loop: ClosedLoop, steps: Sequence[ProvenStep], begin: float, sign: int) -> Crossing:
    """The singular time between two of which the determinant's sign is proved, as near as halving finds them.

    The sign is proved where the steps begin and, the other one, where the last ends; over the steps before the last, if
    there are any, it is not known, so the singular configuration may be anywhere on them.
    """
    *before, step = steps
    first, last = 0.0, step.length
    for _ in range(_HALVINGS):
        middle = 0.5 * (first + last)
        found = sign_of(signed_determinant(loop, step.box(ball(middle))))
        if found == 0 or not first < middle < last:
            break
        if found == sign:
            first, before = middle, []
        else:
            last = middle
    box = step.box(ball(first).union(ball(last)))
    for other in before:
        box = [a.union(b) for a, b in zip(box, other.box(ball(0).union(ball(other.length))), strict=True)]
    known = begin if before else begin + sum(done.length for done in steps[:-1]) + first
    end = begin + sum(done.length for done in steps[:-1]) + last
    return Crossing(known, end, witness_of("singular", loop, box))


def witness_of(kind: Literal["singular", "state"], loop: ClosedLoop, box: Sequence[Ball]) -> Witness:
    """The middle of a box of states."""
    q_free, error = of_balls([configuration(loop.joints, box)]).at(0)
    return Witness(kind, centre_of(box[k] for k in loop.independent), q_free, float(error.max()))
