"""How far apart the ends of closures are at a configuration, closed or not: a length and an angle for each.

With R = R_AᵀR_B and d = p_B − p_A the length is the norm of the closure's rows that measure d, also of those that
planar motion makes constant (|d| for a ball, the distance from the axis for a cylinder, | |d| − L | for a rod), and the
angle is

- that of R, where all directions are to coincide (fixed, prismatic),
- that between the z axes (revolute, cylindrical, planar),
- arcsin |x_A · y_B|, how far the two are from perpendicular (universal, perpendicular),
- 0 where no direction matters.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.description.closure_kinds import Gap, LoopRows, PlaneNormal, Vector, rows_of
from ccpin.description.model import LoopClosure
from ccpin.kinematics.points import joint_poses
from ccpin.kinematics.tree import Tree


class ClosureGap(NamedTuple):
    """How far a closure is from closed.

    Attributes:
        name: The closure's.
        length: m.
        angle: rad, in [0, π].
    """

    name: str
    length: float
    angle: float


def gaps(tree: Tree, closures: Iterable[LoopClosure], q_free: Array) -> tuple[ClosureGap, ...]:
    """The gap of each closure where the tree's joints stand at q′, of shape (nq,)."""
    poses = joint_poses(tree.scratch, q_free)
    placed = {name: poses[link.joint] @ link.placement for name, link in tree.attachments.items()}
    return tuple(_gap(closure, *(placed[link] @ frame for link, frame in closure.ends)) for closure in closures)


def _gap(closure: LoopClosure, a: Array, b: Array) -> ClosureGap:
    d, rows = b[:3, 3] - a[:3, 3], rows_of(closure, PlaneNormal())
    turns = {"A": a[:3, :3], "B": b[:3, :3], "C": np.eye(3)}

    def vector(v: Vector) -> Array:
        return np.asarray(d if isinstance(v, Gap) else turns[v.frame] @ v.local)

    values = np.array(rows.evaluate(vector, lambda x, y: float(x @ y), lambda terms: sum(w * s for w, s in terms)))
    directions = np.array(rows.direction_rows, dtype=bool)
    length = float(np.linalg.norm(values[~directions]))
    if closure.length is not None and closure.kind == "distance":
        length = abs(float(np.linalg.norm(d)) - closure.length)
    return ClosureGap(closure.name, length, _angle(rows, turns["A"].T @ turns["B"], values[directions]))


def _angle(rows: LoopRows, turn: Array, directions: Array) -> float:
    if len(rows.alignment) == 3:
        skewed = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        return float(np.arctan2(np.linalg.norm(skewed), np.trace(turn) - 1.0))
    if rows.alignment:
        ((a, b),) = rows.alignment
        along = turn @ b
        return float(np.arctan2(np.linalg.norm(np.cross(a, along)), a @ along))
    return float(np.arcsin(min(float(np.linalg.norm(directions)), 1.0)))
