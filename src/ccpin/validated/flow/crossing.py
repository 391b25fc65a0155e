"""A free motion proved to meet a singular configuration: what refutes that it stays on its branch of σ.

Theorem X of `ccpin/proof/theorems/crossing.md`; the other coordinates: `ccpin.mechanism.other_coordinates`. Here it is
searched for; `SingularMet` proves it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import CcpinError
from ccpin.mechanism.other_coordinates.independent_sets import best_independent, with_independent
from ccpin.proof.facts import Fact, NotProvedError, prove
from ccpin.proof.verdict import Witness
from ccpin.validated.arithmetic.ball_arrays import of_balls
from ccpin.validated.arithmetic.balls import Ball, ball, centre_of
from ccpin.validated.arithmetic.series import values
from ccpin.validated.flow.crossing_claim import SingularMet, sign_of
from ccpin.validated.flow.marching import StepOptions, march
from ccpin.validated.flow.motion_claim import end_of
from ccpin.validated.flow.proved_steps import ProvedSteps
from ccpin.validated.flow.regularity import signed_determinant
from ccpin.validated.flow.step import ProvenStep
from ccpin.validated.loop_equations import ClosedLoopEquations
from ccpin.validated.model.closed_loop import ClosedLoop, recorded_loop
from ccpin.validated.model.configurations import configuration

_HALVINGS = 60  # of one step's time, where signs are proved that long


def find_crossing(
    model: ReducedModel, loop: ClosedLoop, motion: Fact, duration: float, options: StepOptions, precision: int
) -> Fact | None:
    """The fact that a free motion, enclosed so far, meets a singularity within a time from there on."""
    if not loop.equations.free:  # other rows may be kept in other coordinates, and other numbers
        return None
    here = end_of(motion).balls()
    sign = sign_of(signed_determinant(loop.equations, here))
    followed = _other_coordinates(model, loop, here)
    if not sign or followed is None:
        return None
    other, start = followed
    steps, unknown = list[ProvenStep](), 0  # since the first of these the sign is not proved
    for step in march(ProvedSteps(other.equations, precision), start, duration, options):
        if not isinstance(step, ProvenStep):
            return None
        found = sign_of(signed_determinant(loop.equations, step.box(ball(step.length))))
        steps.append(step)
        if found == -sign:
            return _met(loop.equations, motion, steps, unknown, precision)
        if found == sign:
            unknown = len(steps)
    return None


def _met(
    loop: ClosedLoopEquations, motion: Fact, steps: Sequence[ProvenStep], unknown: int, precision: int
) -> Fact | None:
    """The fact that a motion is singular in one of its steps since a number of them, if it can be proved."""
    first, after, before = _located(loop, steps, unknown)
    numbers = (np.array([number]) for number in (first, after, len(steps) - 1, before, precision))
    try:
        return prove(SingularMet(loop, *numbers), motion, *(step.fact for step in steps if step.fact is not None))
    except NotProvedError:
        return None


def _other_coordinates(
    model: ReducedModel, loop: ClosedLoop, here: Sequence[Ball]
) -> tuple[ClosedLoop, list[Ball]] | None:
    """The motion in coordinates that measure it well at a box of states, and that box in them."""
    own, q_free = loop.equations, centre_of(configuration(loop.own.joints, here))
    try:
        names = best_independent(model.mechanism, q_free, model.rho(q_free))
        sibling = ReducedModel(with_independent(model.mechanism, names, q_free), model.gravity_vector)
        other = recorded_loop(sibling, None, q_free)
    except CcpinError:
        return None
    if other.equations.independent == own.independent or not other.own.q.scalar or other.own.turns:
        return None
    x_rate = values(own.drift, here)
    return other, [*here[: own.n_x], *[x_rate[k] for k in other.equations.independent]]


def _located(loop: ClosedLoopEquations, steps: Sequence[ProvenStep], unknown: int) -> tuple[int, float, float]:
    """The singular time between two of which the determinant's sign is proved, as near as halving finds them.

    The sign is proved where the steps since a number of them begin and, the other one, where the last ends; in between
    it is not known, so the singular configuration may be anywhere there, unless halving the last step tells it.

    Returns:
        The first time's step, or −1 where it is the beginning of all; when, since then; and when since the last begins.
    """
    step, sign = steps[-1], -sign_of(signed_determinant(loop, steps[-1].box(ball(steps[-1].length))))
    number, after = unknown - 1, steps[unknown - 1].length if unknown else 0.0
    first, last = 0.0, step.length
    for _ in range(_HALVINGS):
        middle = 0.5 * (first + last)
        found = sign_of(signed_determinant(loop, step.box(ball(middle))))
        if found == 0 or not first < middle < last:
            break
        if found == sign:
            first = middle
            number, after = len(steps) - 1, first
        else:
            last = middle
    return number, after, last


def witness_of(kind: Literal["singular", "state"], loop: ClosedLoop, box: Sequence[Ball]) -> Witness:
    """The middle of a box of states."""
    q_free, error = of_balls([configuration(loop.own.joints, box)]).at(0)
    return Witness(kind, centre_of(box[k] for k in loop.equations.independent), q_free, float(error.max()))
