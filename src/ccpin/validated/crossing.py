"""A free motion proved to meet a singular configuration: what refutes that it stays on its branch of σ.

Theorem. Let the motion of a mechanism without torque be enclosed up to t_s in its own coordinates q, and from the
states there up to t₁ in other coordinates of the same mechanism (`ccpin.mechanism.siblings`), so that q̇′ is the same.
If det ∂φ/∂y, y the coordinates that depend on q, is of one sign at t_s and of the other at t₁, then ψ_q′ is singular
at some time between.

Proof. A motion without torque is that of the free system under φ(q′) = 0, whatever coordinates it is written in, as
long as
they are regular: where both are, q′(t) is one analytic function. det ∂φ/∂y is continuous along it, and up to its sign
it is det ψ_q′. ∎
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import CcpinError
from ccpin.mechanism.siblings import best_independent, with_independent
from ccpin.proof.verdict import Witness
from ccpin.validated.balls import Ball, ball, determinant, flint, lower, upper
from ccpin.validated.dynamics import ClosedLoop, closed_loop, too_far_turned
from ccpin.validated.places import configuration
from ccpin.validated.series import values
from ccpin.validated.step import Field, Options, Step, evaluate, march

_HALVINGS = 60


class Crossing(NamedTuple):
    """When and where a motion is singular: a time between the two, and the configuration's neighbourhood."""

    after: float
    before: float
    witness: Witness


def signed_determinant(loop: ClosedLoop, box: Sequence[Ball]) -> Ball:
    """± det ψ_q′, always of the same sign, on a box of states or configurations."""
    at_rest = [*box[: loop.n_x], *[ball(0)] * (loop.field.inputs - loop.n_x)]
    size = math.isqrt(len(loop.jacobian.outputs))
    return determinant(flint().arb_mat(size, size, values(loop.jacobian, at_rest))) if size else ball(1)


def sign_of(value: Ball) -> int:
    """+1 or −1 where all numbers of the ball have that sign, else 0."""
    return int(lower(value) > 0.0) - int(upper(value) < 0.0)


def crossing(
    model: ReducedModel, loop: ClosedLoop, here: Sequence[Ball], since: float, duration: float, options: Options
) -> Crossing | None:
    """Where a free motion, enclosed up to the box of states `here` at t = `since`, is proved to meet a singularity."""
    if loop.left_out is not None or loop.turns:  # other rows may be kept in other coordinates, and other numbers
        return None
    sign = sign_of(signed_determinant(loop, here))
    followed = _other_coordinates(model, loop, here)
    if not sign or followed is None:
        return None
    other, start = followed
    field = Field(
        other.field,
        lambda box: max(0.0, lower(abs(signed_determinant(other, box)))),
        lambda box: too_far_turned(other, box),
    )
    time, unknown = since, list[Step]()  # the steps since the time at which the sign was last proved
    for step in march(field, start, duration, options):
        if not isinstance(step, Step):
            return None
        found = sign_of(signed_determinant(loop, _state(step, step.length)))
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
    q_free = middle_of(loop, here)
    try:
        names = best_independent(model.mechanism, q_free, model.rho(q_free))
        sibling = ReducedModel(with_independent(model.mechanism, names, q_free), model.gravity_vector)
        other = closed_loop(sibling, None, q_free)
    except CcpinError:
        return None
    if other.independent == loop.independent or not other.scalar or other.turns:
        return None
    x_rate = values(loop.drift, here)
    return other, [*here[: loop.n_x], *[x_rate[k] for k in other.independent]]


def middle_of(loop: ClosedLoop, box: Sequence[Ball]) -> Array:
    """The configuration q′ in the middle of a box of states or configurations."""
    return np.array([float(x.mid()) for x in configuration(loop.joints, box)])


def _state(step: Step, time: float | Ball) -> list[Ball]:
    path = evaluate(step.polynomial, ball(time))
    return [x + flint().arb(0, e.abs_upper()) for x, e in zip(path, step.error, strict=True)]


def _located(loop: ClosedLoop, steps: Sequence[Step], begin: float, sign: int) -> Crossing:
    """The singular time between two of which the determinant's sign is proved, as near as halving finds them.

    The sign is proved where the steps begin and, the other one, where the last ends; over the steps before the last, if
    there are any, it is not known, so the singular configuration may be anywhere on them.
    """
    *before, step = steps
    first, last = 0.0, step.length
    for _ in range(_HALVINGS):
        middle = 0.5 * (first + last)
        found = sign_of(signed_determinant(loop, _state(step, middle)))
        if found == 0 or not first < middle < last:
            break
        if found == sign:
            first, before = middle, []
        else:
            last = middle
    box = _state(step, ball(first).union(ball(last)))
    for other in before:
        box = [a.union(b) for a, b in zip(box, _state(other, ball(0).union(ball(other.length))), strict=True)]
    known = begin if before else begin + sum(done.length for done in steps[:-1]) + first
    end = begin + sum(done.length for done in steps[:-1]) + last
    return Crossing(known, end, witness_of("singular", loop, box))


def witness_of(kind: Literal["singular", "state"], loop: ClosedLoop, box: Sequence[Ball]) -> Witness:
    """The middle of a box of states."""
    told = configuration(loop.joints, box)
    q_free = np.array([float(x.mid()) for x in told])
    error = max(upper(abs(x - ball(float(c)))) for x, c in zip(told, q_free, strict=True))
    return Witness(kind, np.array([float(box[k].mid()) for k in loop.independent]), q_free, error)
