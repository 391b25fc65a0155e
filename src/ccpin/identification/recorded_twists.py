"""A mechanism's closures, motions of its bodies and structure, recorded for claims about what can be identified."""

from __future__ import annotations

from fractions import Fraction
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, cross
from ccpin.dynamics.parameters import joint_kinds
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.identification.identification_equations import IdentificationEquations
from ccpin.identification.vanishing import MOVES, ClosedEnds, JoinedBody, Numbers
from ccpin.programs.recording.ball_joints import ball_at
from ccpin.programs.recording.constants import Constants
from ccpin.programs.recording.recorded_mechanism import Numbering, recorded_model
from ccpin.programs.recording.recorded_tree import (
    ExactJoint,
    Table,
    exact,
    exact_placement,
    relative_motion,
    unit_axes,
)
from ccpin.programs.tape import Tape
from ccpin.validated.arithmetic.programs import in_balls
from ccpin.validated.model.closed_loop import recorded_loop


class MotionsOnTape(NamedTuple):
    """What bodies and springs do.

    Attributes:
        twists: Of the bodies for each unit q̇ (linear, angular), about their origins in their axes, of shape (B, n, 6).
        gravity: In these axes, of shape (B, 3).
        stretches: Of the joints' springs from zero; ``None`` of a joint that can have none.
    """

    twists: Table
    gravity: Table
    stretches: tuple[Table | None, ...]


def recorded_motions(model: ReducedModel) -> tuple[IdentificationEquations, Numbering]:
    """What claims about a model are about, at the current precision, and its numbers x."""
    tree, near = model.mechanism.tree, model.mechanism.q_reference
    loop, own = recorded_loop(model, None, near)
    tape = Tape(loop.n_x + loop.n)
    x, v = np.split(np.array(tape.inputs, dtype=object), [loop.n_x])
    recorded = recorded_model(tape, model, own, (x, v), near)
    seen = body_motions(tape, model, own, x, recorded.motion.rho)
    stretches = [entry for stretch in seen.stretches if stretch is not None for entry in stretch]
    outputs = [*seen.twists.ravel(), *seen.gravity.ravel(), *recorded.motion.rho.ravel(), *stretches]
    bodies = tuple(
        JoinedBody(held.parent, _numbers(held.axes), joint.kind.slides, _numbers(held.placement), joint_kinds(joint))
        for held, joint in zip(own.joints, tree.joints, strict=True)
    )
    ends = tuple(
        ClosedEnds(each.joint_a, each.joint_b, _frame(each.frame_a), _frame(each.frame_b), moves)
        for each in model.parametrization.constraints.loops
        if (moves := MOVES.get(each.closure.kind)) is not None
    )
    pull: tuple[Fraction, ...] = tuple(exact(model.gravity_vector).tolist())
    return IdentificationEquations(loop, in_balls(tape, outputs), bodies, ends, pull), own


def body_motions(tape: Tape, model: ReducedModel, own: Numbering, x: Table, rho: Table) -> MotionsOnTape:
    """What bodies and springs do, by the numbers x and ρ."""
    n, nothing = rho.shape[1], np.zeros(3, dtype=object)
    moving = {0: [(nothing, nothing)] * n}
    pull = {0: Constants(model).gravity()}
    stretches = list[Table | None]()
    for joint in own.joints:
        placed, moved, axes = joint.placement, relative_motion(tape, joint, x[joint.x]), unit_axes(tape, joint)
        turn, arm = placed[:3, :3] @ moved[:3, :3], placed[:3, 3] + placed[:3, :3] @ moved[:3, 3]
        slides = np.array(joint.kind.slides)
        pull[joint.number] = pull[joint.parent] @ turn
        moving[joint.number] = []
        for i, (speed, omega) in enumerate(moving[joint.parent]):
            rates = rho[joint.v, i]
            drawn = (speed + cross(omega, arm)) @ turn + rates[slides] @ axes[slides]
            moving[joint.number].append((drawn, omega @ turn + rates[~slides] @ axes[~slides]))
        stretches.append(_stretch(tape, own, joint, x))
    order = [joint.number for joint in own.joints]
    twists = np.array([[[*speed, *omega] for speed, omega in moving[k]] for k in order], dtype=object)
    gravity = np.array([list(pull[k]) for k in order], dtype=object)
    return MotionsOnTape(twists.reshape(-1, n, 6), gravity.reshape(-1, 3), tuple(stretches))


def _stretch(tape: Tape, own: Numbering, joint: ExactJoint, x: Table) -> Table | None:
    """A spring's displacement from zero; ``None`` of a joint that can have none."""
    if joint.kind.nq == 1:
        return x[joint.x]
    if not joint.kind.springs:
        return None
    vector, cosine = ball_at(joint, np.array([0.0, 0.0, 0.0, 1.0]), own.near).relative(tape, x)
    return np.asarray(vector * tape.gain(tape.node(cosine)))


def _frame(placement: Array) -> Numbers:
    return _numbers(exact_placement(placement))


def _numbers(table: Table) -> Numbers:
    return tuple(tuple(Fraction(entry) for entry in row) for row in table)
