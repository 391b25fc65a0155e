"""A mechanism's closures, motions of its bodies and structure, recorded for claims about what can be identified."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

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


def recorded_motions(model: ReducedModel) -> tuple[IdentificationEquations, Numbering]:
    """What claims about a model are about, at the current precision, and its numbers x."""
    tree, near = model.mechanism.tree, model.mechanism.q_reference
    loop, own = recorded_loop(model, None, near)
    tape = Tape(loop.n_x + loop.n)
    x, v = np.split(np.array(tape.inputs, dtype=object), [loop.n_x])
    recorded = recorded_model(tape, model, own, (x, v), near)
    twists, gravity = _twists(tape, model, own.joints, x, recorded.motion.rho)
    stretches: list[Any] = []
    for joint in own.joints:
        if joint.kind.nq == 1:
            stretches.append(x[joint.x.start])
        elif joint.kind.springs:
            vector, cosine = ball_at(joint, np.array([0.0, 0.0, 0.0, 1.0]), own.near).relative(tape, x)
            stretches += list(vector * tape.gain(tape.node(cosine)))
    outputs = [*twists, *gravity, *recorded.motion.rho.ravel(), *stretches]
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


def _twists(
    tape: Tape, model: ReducedModel, joints: tuple[ExactJoint, ...], x: Table, rho: Table
) -> tuple[list[Any], list[Any]]:
    """Twists of all bodies for each unit q̇, about their origins in their axes, and gravity in these."""
    n, nothing = rho.shape[1], np.zeros(3, dtype=object)
    moving = {0: [(nothing, nothing)] * n}
    pull = {0: Constants(model).gravity()}
    for joint in joints:
        placed, moved, axes = joint.placement, relative_motion(tape, joint, x[joint.x]), unit_axes(tape, joint)
        turn, arm = placed[:3, :3] @ moved[:3, :3], placed[:3, 3] + placed[:3, :3] @ moved[:3, 3]
        slides = np.array(joint.kind.slides)
        pull[joint.number] = pull[joint.parent] @ turn
        moving[joint.number] = []
        for i, (speed, omega) in enumerate(moving[joint.parent]):
            rates = rho[joint.v, i]
            drawn = (speed + cross(omega, arm)) @ turn + rates[slides] @ axes[slides]
            moving[joint.number].append((drawn, omega @ turn + rates[~slides] @ axes[~slides]))
    order = [joint.number for joint in joints]
    twists = [entry for k in order for pair in moving[k] for part in pair for entry in part]
    return twists, [entry for k in order for entry in pull[k]]


def _frame(placement: Array) -> Numbers:
    return _numbers(exact_placement(placement))


def _numbers(table: Table) -> Numbers:
    return tuple(tuple(Fraction(entry) for entry in row) for row in table)
