"""A mechanism's closures, motions of its bodies and structure, recorded for claims about what can be identified."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, cross
from ccpin.dynamics.parameters import joint_kinds
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.identification.combinations.identification_equations import IdentificationEquations
from ccpin.identification.combinations.vanishing import MOVES, ClosedEnds, JoinedBody, Numbers
from ccpin.programs.recording.ball_joints import ball_at
from ccpin.programs.recording.constants import Constants
from ccpin.programs.recording.recorded_mechanism import Numbering, RecordedModel, recorded_model
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


def recorded_motions(
    model: ReducedModel, forces: Sequence[str] = (), base: bool = False
) -> tuple[IdentificationEquations, Numbering]:
    """What claims about a model are about, at the current precision, and its numbers x.

    Args:
        model: The model.
        forces: Closures and couplings whose forces λ are measured.
        base: Whether the wrench that holds the world is measured.
    """
    tree, near = model.mechanism.tree, model.mechanism.q_reference
    loop, own = recorded_loop(model, None, near)
    tape = Tape(loop.n_x + loop.n)
    x, v = np.split(np.array(tape.inputs, dtype=object), [loop.n_x])
    recorded = recorded_model(tape, model, own, (x, v), near)
    rho, freed = recorded.motion.rho, _opened(tape, model, recorded, own, forces)
    still = np.zeros((len(rho), 6 * base), dtype=object)
    rates = np.hstack([rho, freed, still])
    seen = body_motions(tape, model, own, x, rates, 6 * base)
    stretches = [entry for stretch in seen.stretches if stretch is not None for entry in stretch]
    outputs = [*seen.twists.ravel(), *seen.gravity.ravel(), *rates.ravel(), *stretches]
    bodies = tuple(
        JoinedBody(held.parent, _numbers(held.axes), joint.kind.slides, _numbers(held.placement), joint_kinds(joint))
        for held, joint in zip(own.joints, tree.joints, strict=True)
    )
    ends = tuple(
        ClosedEnds(each.joint_a, each.joint_b, _frame(each.frame_a), _frame(each.frame_b), moves)
        for each in model.parametrization.constraints.loops
        if each.closure.name not in forces and (moves := MOVES.get(each.closure.kind)) is not None
    )
    pull: tuple[Fraction, ...] = tuple(exact(model.gravity_vector).tolist())
    virtual = rates.shape[1] - model.n
    return IdentificationEquations(loop, in_balls(tape, outputs), bodies, ends, pull, virtual, base), own


def _opened(tape: Tape, model: ReducedModel, recorded: RecordedModel, own: Numbering, forces: Sequence[str]) -> Table:
    """Virtual rates R of all joints, of shape (n′, ·), a column for each row of closures.

    φ_q′ R is 1 in this row alone and α_q′ R = 0: these closures open, all others stay, q stays, and Rᵀφ_q′ᵀλ are
    their λ.
    """
    slices, jacobian = model.parametrization.constraints.row_slices(), recorded.motion.jacobian
    rows = [recorded.kept.index(k) for name in forces for k in range(slices[name].start, slices[name].stop)]
    known = [k for k in own.q.velocities if k >= 0]
    rest = [k for k in range(len(recorded.motion.rho)) if k not in known]
    right = np.zeros((len(jacobian), len(rows)), dtype=object)
    right[rows, range(len(rows))] = 1
    freed = np.zeros((len(recorded.motion.rho), len(rows)), dtype=object)
    freed[rest] = tape.solve(jacobian, right) if rows else right[: len(rest)]
    return freed


def body_motions(
    tape: Tape, model: ReducedModel, own: Numbering, x: Table, rates: Table, carried: int = 0
) -> MotionsOnTape:
    """What bodies and springs do, by the numbers x and joints' rates, a column for each unit q̇.

    Along the last columns, as many as are carried, the world moves by a unit twist.
    """
    count = rates.shape[1]
    world = np.vstack([np.zeros((count - carried, 6), dtype=object), np.eye(carried, 6, dtype=int).astype(object)])
    moving = {0: [(each[:3], each[3:]) for each in world]}
    pull = {0: Constants(model).gravity()}
    stretches = list[Table | None]()
    for joint in own.joints:
        placed, moved, axes = joint.placement, relative_motion(tape, joint, x[joint.x]), unit_axes(tape, joint)
        turn, arm = placed[:3, :3] @ moved[:3, :3], placed[:3, 3] + placed[:3, :3] @ moved[:3, 3]
        slides = np.array(joint.kind.slides)
        pull[joint.number] = pull[joint.parent] @ turn
        moving[joint.number] = []
        for i, (speed, omega) in enumerate(moving[joint.parent]):
            steps = rates[joint.v, i]
            drawn = (speed + cross(omega, arm)) @ turn + steps[slides] @ axes[slides]
            moving[joint.number].append((drawn, omega @ turn + steps[~slides] @ axes[~slides]))
        stretches.append(_stretch(tape, own, joint, x))
    order = [joint.number for joint in own.joints]
    twists = np.array([[[*speed, *omega] for speed, omega in moving[k]] for k in order], dtype=object)
    gravity = np.array([list(pull[k]) for k in order], dtype=object)
    return MotionsOnTape(twists.reshape(-1, count, 6), gravity.reshape(-1, 3), tuple(stretches))


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
