"""A mechanism's closures and dynamics over numbers on a tape: the one definition that all programs are made of.

    ẋ = Γ(x) ρ(x) q̇ (13),    D(q) q̈ + ρᵀ(D′b + C′q̇′ + B′q̇′ + g′) = τ (22),
    b = ρ̇q̇ = −ψ_q′⁻¹[φ̇_q′ q̇′; α̇_q′ q̇′] (35),

with x the numbers that hold q′ (`recorded_coordinates`; ẋ = Γ q̇′), τ a generalized force, B′ the joints' dampers,
springs in g′ and no dry friction. Where φ has more rows than its rank m, ψ_q′ is of m rows that are independent at the
configuration that it is recorded about.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import qr

from ccpin.arrays import Array
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.programs.recording.ball_joints import BallAngle, BallTurn, ball_at, turn_rates, turn_rows, turns_of
from ccpin.programs.recording.constants import Constants
from ccpin.programs.recording.recorded_closures import ClosureRows
from ccpin.programs.recording.recorded_coordinates import StateLayout, layout_of, numbers_of
from ccpin.programs.recording.recorded_forces import (
    ClosureTerms,
    DynamicTerms,
    closure_terms,
    dynamic_terms,
    with_springs,
)
from ccpin.programs.recording.recorded_tree import (
    ExactJoint,
    Table,
    closure_rows,
    exact_joints,
    poses,
    rates,
    rational,
)
from ccpin.programs.tape import Expression, Tape


class Numbering(NamedTuple):
    """The numbers x that hold a mechanism's configuration.

    Attributes:
        joints: The joints, with their places in x.
        q: Where the independent coordinates stand.
        turns: Single turns of balls among q; their numbers come after the joints'.
        near: The numbers that angles on circles are counted from, of shape (n_x,).
    """

    joints: tuple[ExactJoint, ...]
    q: StateLayout
    turns: tuple[BallAngle, ...]
    near: Array

    @property
    def dependent(self) -> tuple[int, ...]:
        """Places of the numbers y that closures decide."""
        return tuple(k for k in range(len(self.near)) if k not in self.q.places)

    def numbers(self, q_free: Array) -> Array:
        """The numbers x of a configuration of shape (nq,), rounded; angles within half a turn of those `near`."""
        return numbers_of(self.joints, q_free, self.near, self.turns)


class RecordedModel(NamedTuple):
    """What a mechanism does, as expressions of x and q̇.

    Attributes:
        rows: φ, all rows.
        kept, others: Rows that are independent where it was recorded, as many as the rank, and the others.
        closure: As many equations as numbers depend: the rows kept, unit lengths, single turns of balls.
        rates: Γ, with rows for turns, of shape (n_x, n′).
        motion: ρ, q̇′, b, ẋ.
        frames: The pose of every joint's body, by its number (0: the world).
        terms: D, the bias force, g and energies.
        balls: Turns that are to be less than half a one.
    """

    rows: list[Expression]
    kept: list[int]
    others: list[int]
    closure: list[Expression]
    rates: Table
    motion: ClosureTerms
    frames: dict[int, Table]
    terms: DynamicTerms
    balls: tuple[BallTurn, ...]


def numbering(model: ReducedModel, near: Array) -> Numbering:
    """The numbers of a model's mechanism, counted from those of a configuration of shape (nq,)."""
    joints = exact_joints(model.mechanism.tree)
    turns = turns_of(model.coordinates, joints, numbers_of(joints, near))
    return Numbering(joints, layout_of(model.coordinates, joints), turns, numbers_of(joints, near, None, turns))


def recorded_model(
    tape: Tape,
    model: ReducedModel,
    held: Numbering,
    state: tuple[Table, Table],
    near: Array,
    constants: Constants | None = None,
) -> RecordedModel:
    """Record a mechanism over inputs (x, q̇) of a tape; rows of φ are chosen at a configuration of shape (nq,)."""
    mechanism, constraints = model.mechanism, model.parametrization.constraints
    constants = Constants(model) if constants is None else constants
    joints, turns, (x, _) = constants.joints(held.joints), held.turns, state
    rows = all_rows(tape, model, held, x, constants)
    kept, others = independent_rows(model, near)
    phi = [rows[k] for k in kept]
    table = np.vstack([rates(tape, joints, x), turn_rates(tape, turns, x, mechanism.n_free)])
    moving = ClosureRows(tape, constraints, constants, joints, x, rows, kept, table)
    motion = closure_terms(tape, moving, state, table, held.q)
    frames = poses(tape, joints, x)
    terms = dynamic_terms(tape, constants, joints, frames, motion, state)
    stiff = [joint for joint in joints if constants.sprung(joint)]
    references = [mechanism.tree.joints[joint.number - 1].stated.spring_reference for joint in stiff]
    sprung = [
        ball_at(joint, np.array([0.0, 0.0, 0.0, 1.0]), held.near) if joint.kind.unit else joint for joint in stiff
    ]
    terms = with_springs(tape, terms, constants, list(zip(sprung, references, strict=True)), x, motion.rho)
    closure = closure_equations(tape, held, x, phi)
    balls = (*(turn.ball for turn in turns), *(each for each in sprung if isinstance(each, BallTurn)))
    return RecordedModel(rows, kept, others, closure, table, motion, frames, terms, balls)


def all_rows(tape: Tape, model: ReducedModel, held: Numbering, x: Table, constants: Constants) -> list[Expression]:
    """φ of numbers x, all rows."""
    joints = constants.joints(held.joints)
    rows = closure_rows(tape, model.parametrization.constraints, joints, x, held.near, constants.ends)
    return constants.changed(rows, joints, x)


def closure_equations(tape: Tape, held: Numbering, x: Table, phi: Sequence[Expression]) -> list[Expression]:
    """As many equations as numbers depend: the rows of φ that are kept, unit lengths, single turns of balls."""
    return [*phi, *_unit_lengths(held.joints, x, held.dependent), *turn_rows(tape, held.turns, x)]


def independent_rows(model: ReducedModel, near: Array) -> tuple[list[int], list[int]]:
    """Rows of φ that are independent at a configuration, as many as its rank, and the others; all where none is."""
    constraints, rank = model.parametrization.constraints, model.mechanism.n_free - model.n
    if constraints.size == rank:
        return list(range(rank)), []
    order = qr(constraints.value(near).jacobian.T, mode="r", pivoting=True)[1].tolist()
    return sorted(order[:rank]), sorted(order[rank:])


def _unit_lengths(joints: tuple[ExactJoint, ...], x: Table, dependent: tuple[int, ...]) -> list[Expression]:
    """½(|p|² − 1) of the quaternions p among the dependent numbers."""
    found, half = list[Expression](), rational(0.5)
    for joint in joints:
        if joint.kind.unit == 4 and joint.x.stop - 1 in dependent:
            p = x[joint.x][-4:]
            found.append((p @ p) * half - half)
    return found
