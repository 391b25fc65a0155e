"""How closures' rows change, on a tape: by each entry of q̇′, and their second rates where q̇′ is held.

A vector of a tip is carried down its chain, joint by joint: with t and R a joint's slide and turn, l and w its own
linear and angular velocity in the body's axes, and v, v̇, v̈ the vector before,

    u = t + Rv,    u̇ = R(l + w × v + v̇),    ü = R(w × (l + w × v + 2v̇) + v̈)

(of a direction without t and l); where the joint's axes are the same before and after it moves R w = w, and R is taken
first. Quaternions are taken to be of unit length, as they stay along every motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import cross
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.loops import ResolvedClosure
from ccpin.programs.recording.constants import Constants
from ccpin.programs.recording.recorded_tree import (
    ExactJoint,
    Table,
    chain_of,
    evaluated_rows,
    relative_motion,
    unit_axes,
)
from ccpin.programs.tape import Expression, Tape


class _Moving(NamedTuple):
    """A vector in a loop's axes; by entries of q̇′, its rate, and its second rate with q̇′ held."""

    value: Table
    by: dict[int, Table]
    rate: Table
    change: Table


@dataclass(frozen=True)
class RowMotion:
    """A row, or a sum of products, by entries of q̇′, and its second rate with q̇′ held."""

    by: dict[int, Expression]
    change: Expression

    def __add__(self, other: RowMotion) -> RowMotion:
        every = {**self.by, **other.by}
        return RowMotion({k: self.by.get(k, 0) + other.by.get(k, 0) for k in every}, self.change + other.change)

    def __radd__(self, zero: int) -> RowMotion:
        return self

    def __mul__(self, factor: Expression) -> RowMotion:
        return RowMotion({k: each * factor for k, each in self.by.items()}, self.change * factor)


class ClosureRows(NamedTuple):
    """The rows of φ that are kept, and where they stand: those of loops first.

    Attributes:
        tape: The tape.
        constraints: φ.
        constants: Its constants.
        joints: The joints.
        x: The numbers.
        rows: All rows as expressions.
        kept: Which of them.
        table: Γ.
    """

    tape: Tape
    constraints: Constraints
    constants: Constants
    joints: Sequence[ExactJoint]
    x: Table
    rows: Sequence[Expression]
    kept: Sequence[int]
    table: Table

    def slopes(self) -> Table:
        """The rows by q̇′, of shape (rows kept, n′)."""
        n_free = self.table.shape[1]
        loops = self._loops(np.zeros(n_free, dtype=object))
        found = np.zeros((len(self.kept), n_free), dtype=object)
        for row, k in zip(found, self.kept, strict=True):
            if k < len(loops):
                row[list(loops[k].by)] = list(loops[k].by.values())
            else:
                by_x = [self.tape.derivative([self.rows[k]], {place: 1})[0] for place in range(len(self.table))]
                row[:] = np.array(by_x, dtype=object) @ self.table
        return found

    def changes(self, v_free: Table, along: dict[int, Expression]) -> list[Expression]:
        """The rows' second rates with q̇′ held, `along` being ẋ."""
        loops, derivative = self._loops(v_free), self.tape.derivative
        return [
            loops[k].change if k < len(loops) else derivative(derivative([self.rows[k]], along), along)[0]
            for k in self.kept
        ]

    def _loops(self, v_free: Table) -> list[RowMotion]:
        return [
            row
            for loop in self.constraints.loops
            for row in _loop_motions(self.tape, loop, self.joints, self.x, v_free, self.constants.ends(loop))
        ]


def _loop_motions(
    tape: Tape, loop: ResolvedClosure, joints: Sequence[ExactJoint], x: Table, v_free: Table, held: tuple[Table, Table]
) -> list[RowMotion]:
    still = np.zeros(3, dtype=object)

    def carried(tip: int, vector: Table, is_point: bool) -> _Moving:
        moving = _Moving(vector, {}, still, still)
        for joint in chain_of(joints, tip, loop.ancestor):
            moving = _placed(joint, _moved(tape, joint, x, v_free, moving, is_point), is_point)
        return moving

    def less(a: _Moving, b: _Moving) -> _Moving:
        by = {k: a.by.get(k, still) - b.by.get(k, still) for k in {**a.by, **b.by}}
        return _Moving(a.value - b.value, by, a.rate - b.rate, a.change - b.change)

    def dot(a: _Moving, b: _Moving) -> RowMotion:
        by = {k: a.by.get(k, still) @ b.value + a.value @ b.by.get(k, still) for k in {**a.by, **b.by}}
        return RowMotion(by, a.change @ b.value + (a.rate @ b.rate) * 2 + a.value @ b.change)

    return evaluated_rows(loop, held, carried, less, lambda local: _Moving(local, {}, still, still), dot)


def _moved(tape: Tape, joint: ExactJoint, x: Table, v_free: Table, vector: _Moving, is_point: bool) -> _Moving:
    """A vector of a joint's body beside the frame in which the joint moves."""
    motion, axes = relative_motion(tape, joint, x[joint.x]), unit_axes(tape, joint)
    R, slides = motion[:3, :3], np.array(joint.kind.slides)
    still, rates = np.zeros(3, dtype=object), v_free[joint.v]
    slid = rates[slides] @ axes[slides] if is_point else still
    turned = rates[~slides] @ axes[~slides]
    before = vector if joint.turning_axes else _turned(R, vector)
    own = {
        joint.v.start + k: (axis if is_point else still) if slides[k] else cross(axis, before.value)
        for k, axis in enumerate(axes)
    }
    rate = slid + cross(turned, before.value) + before.rate
    change = cross(turned, rate + before.rate) + before.change
    after = _Moving(before.value, before.by | own, rate, change)
    after = _turned(R, after) if joint.turning_axes else after
    return after._replace(value=after.value + motion[:3, 3]) if is_point else after


def _placed(joint: ExactJoint, vector: _Moving, is_point: bool) -> _Moving:
    """The same in the axes of the body that carries the joint."""
    placed = _turned(joint.placement[:3, :3], vector)
    return placed._replace(value=placed.value + joint.placement[:3, 3]) if is_point else placed


def _turned(R: Table, vector: _Moving) -> _Moving:
    by: Any = {k: R @ each for k, each in vector.by.items()}
    return _Moving(R @ vector.value, by, R @ vector.rate, R @ vector.change)
