"""Points and directions of a tree's bodies as polynomials of degree at most two in joint variables.

A chain is read from its tip to its root. In the frame of joint k before it moves, a point x of its body is
Rot(axis, q_k) x (revolute), x + q_k axis (prismatic) or R_k x (spherical); the joint's placement then takes it
to the parent body. Rotations are affine in (cos, sin), so one joint raises the degree by one; what would pass
degree two is named as an unknown first (`Unknowns.product`).

Revolute joints that follow one another about parallel axes (prismatic ones may lie between) form a run: their
rotations commute, so with θ_k the sum of the run's angles up to joint k, a vector fixed in body k is
Rot(a, θ_k) times a constant, and a whole planar chain is affine in the (cos θ_k, sin θ_k).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, skew
from ccpin.description.joint_kinds import JOINT_KINDS
from ccpin.description.rotations import quaternion_matrix
from ccpin.domain.theorem2.polynomials import Polynomial, combine
from ccpin.domain.theorem2.unknowns import (
    AngleTerm,
    Ball,
    Circle,
    Slide,
    Unknowns,
    Vector,
    constant_vector,
    plus,
    turned,
    without_noise,
)
from ccpin.kinematics.tree import Tree, TreeJoint

PARALLEL = 1e-13  # sine of the angle below which two axes are one but for the roundings of a few products of frames
_TURNS = ("rx", "ry", "rz")
_Rotation = Sequence[tuple[Polynomial, Array]]  # Σ polynomial · matrix, equal to a rotation


class AngleRun(NamedTuple):
    """How a revolute joint's angle enters: summed onto `parent`'s (``None``: it stands alone), times `sign`.

    `axis` is the run's axis in the frame of its first joint.
    """

    parent: int | None
    sign: float
    axis: Array


class SimpleTree(NamedTuple):
    """A tree of slides, turns and balls, every joint of several steps (planar, floating, …) cut into these.

    Attributes:
        joints: Its joints by their numbers.
        parts: The numbers of each of the mechanism's joints' parts, root side first; of the world (0) none but 0.
    """

    joints: dict[int, TreeJoint]
    parts: dict[int, tuple[int, ...]]

    def path(self, joints: Iterable[int]) -> list[int]:
        """The parts of joints one behind the other."""
        return [part for joint in joints for part in self.parts[joint]]


def simple_tree(tree: Tree) -> SimpleTree:
    """A mechanism's tree in parts, the rotations of placements without noise."""
    joints: dict[int, TreeJoint] = {}
    parts: dict[int, tuple[int, ...]] = {0: (0,)}
    for joint in tree.joints:
        placement = joint.placement.copy()
        placement[:3, :3] = without_noise(placement[:3, :3])
        parent, numbers = parts[joint.parent][-1], list[int]()
        for part in _parts(joint):
            number = len(joints) + 1
            joints[number] = replace(part, number=number, parent=parent, placement=placement)
            numbers.append(number)
            parent, placement = number, np.eye(4)
        parts[joint.number] = tuple(numbers)
    return SimpleTree(joints, parts)


def _parts(joint: TreeJoint) -> list[TreeJoint]:
    """A joint as slides, turns (on the circle where it is kept there) and a ball, in their order."""
    kind, start = joint.kind, joint.q.start
    if kind.nv == 1 or kind.steps == _TURNS:
        return [joint]
    ball = kind.unit == 4
    plain = kind.nv - (3 if ball else 0)
    parts = []
    for k, axis in enumerate(kind.directions(joint.axis)[:plain]):
        circle = kind.unit == 2 and k == plain - 1
        name = "prismatic" if kind.slides[k] else "continuous" if circle else "revolute"
        window = slice(start + k, start + k + 1 + circle)
        part = replace(joint, name=f"{joint.name}:{kind.components[k]}", kind=JOINT_KINDS[name], q=window, axis=axis)
        parts.append(part)
    if ball:
        parts.append(replace(joint, kind=JOINT_KINDS["spherical"], q=slice(start + plain, start + plain + 4)))
    return parts


def _angular(joint: TreeJoint) -> bool:
    """Whether one angle is all it has."""
    return joint.kind.nv == 1 and not joint.kind.sliding


def find_runs(
    joints: dict[int, TreeJoint], on_loops: set[int], ancestors: set[int], merge: bool
) -> dict[int, AngleRun]:
    """The run each revolute joint belongs to.

    A run ends at every body from which some loop is measured (`ancestors`), so that each joint has one angle
    variable for all loops; without `merge` every joint stands alone.
    """
    runs: dict[int, AngleRun] = {}
    for j, joint in joints.items():
        if not _angular(joint):
            continue
        runs[j] = AngleRun(None, 1.0, joint.axis)
        axis, k = joint.placement[:3, :3] @ joint.axis, joint.parent
        while merge and k and j in on_loops and k not in ancestors:
            before = joints[k]
            if not before.kind.sliding:
                if _angular(before) and np.linalg.norm(np.cross(axis, before.axis)) < PARALLEL:
                    runs[j] = AngleRun(k, float(np.sign(axis @ before.axis)) * runs[k].sign, runs[k].axis)
                break
            axis, k = before.placement[:3, :3] @ axis, before.parent
    return runs


class Kinematics:
    """Joint variables of the active joints of a tree, and the points and directions they carry.

    Args:
        joints: The tree.
        runs: From `find_runs`.
        active: Joints that occur in a closure or a coupling.
        q_free: The centre, of shape (nq,).
    """

    def __init__(
        self, joints: dict[int, TreeJoint], runs: dict[int, AngleRun], active: list[int], q_free: Array
    ) -> None:
        self.joints = joints
        self.runs = runs
        self.unknowns = Unknowns()
        self.variables: dict[int, tuple[Polynomial, ...]] = {}
        self._rotations: dict[int, _Rotation] = {}
        self._slides: dict[int, float] = {}
        for j in active:
            self._introduce(j, q_free)

    def _introduce(self, j: int, q_free: Array) -> None:
        joint = self.joints[j]
        start = joint.q.start
        if joint.kind.sliding:
            self._slides[j] = float(q_free[start])
            self.variables[j] = self.unknowns.chart(Slide(start, self._slides[j], joint.name), q_free)
        elif joint.kind.unit == 4:
            unit = q_free[joint.q] / np.linalg.norm(q_free[joint.q])
            x, y, z, w = (float(c) for c in unit)
            self.variables[j] = self.unknowns.chart(Ball(start, (x, y, z, w), joint.name), q_free)
            self._rotations[j] = _ball_rotation(self.variables[j], (x, y, z, w))
        else:
            terms = self._angle_terms(j)
            centre = sum(term.at(q_free) for term in terms)
            self.variables[j] = self.unknowns.chart(Circle(terms, centre, joint.name), q_free)
            self._rotations[j] = _circle_rotation(self.variables[j], self.runs[j].axis, centre)

    def _angle_terms(self, j: int) -> tuple[AngleTerm, ...]:
        run = self.runs[j]
        before = () if run.parent is None else self._angle_terms(run.parent)
        return (self.angle_term(j)._replace(sign=run.sign), *before)

    def angle_term(self, j: int) -> AngleTerm:
        """A joint's own angle."""
        return AngleTerm(self.joints[j].q.start, self.joints[j].kind.unit == 2, 1.0)

    def turn(self, j: int) -> tuple[Polynomial, Polynomial]:
        """(cos, sin) of a revolute joint's own angle from the centre."""
        cosine, sine = self.variables[j]
        run = self.runs[j]
        if run.parent is not None:
            c, s = self.variables[run.parent]
            cosine, sine = cosine * c + sine * s, sine * c - cosine * s
        return cosine, sine.scaled(run.sign)

    def carried(self, chain: list[int], vector: Array, *, point: bool) -> Vector:
        """A point (or direction) fixed in the chain's last body, seen from the body before its first joint."""
        result = constant_vector(without_noise(vector))
        for group in reversed(self._groups(chain)):
            result = self._through(group, result, point)
        return result

    def _groups(self, chain: list[int]) -> list[list[int]]:
        """The chain cut into runs (with the prismatic joints inside them) and single joints."""
        groups: list[list[int]] = []
        for j in chain:
            run = self.runs.get(j)
            heads = [i for i, group in enumerate(groups) if run is not None and run.parent in group]
            if heads:
                inside = [k for group in groups[heads[-1] :] for k in group]
                groups[heads[-1] :] = [[*inside, j]]
            else:
                groups.append([j])
        return groups

    def _through(self, group: list[int], vector: Vector, point: bool) -> Vector:
        """A vector in the last body of a group, seen from the body before its first joint."""
        turn = np.eye(3)
        rotation: _Rotation = [(Polynomial.constant(1.0), np.eye(3))]
        if not self.joints[group[-1]].kind.sliding:
            vector = self.unknowns.affine_vector(vector)
        total = constant_vector(np.zeros(3))
        for j in group:
            joint = self.joints[j]
            if j != group[0]:
                if point:
                    total = plus(total, self._rotate(rotation, constant_vector(turn @ joint.placement[:3, 3])))
                turn = without_noise(turn @ joint.placement[:3, :3])
            if joint.kind.sliding:
                if point:
                    moved = self.variables[j][0] + Polynomial.constant(self._slides[j])
                    travel = constant_vector(without_noise(turn @ joint.axis))
                    x, y, z = (self.unknowns.product(moved, c) for c in self._rotate(rotation, travel))
                    total = plus(total, (x, y, z))
            else:
                rotation = self._rotations[j]
        total = plus(total, self._rotate(rotation, turned(turn, vector)))
        first = self.joints[group[0]].placement
        total = turned(first[:3, :3], total)
        return plus(total, constant_vector(first[:3, 3])) if point else total

    def _rotate(self, rotation: _Rotation, vector: Vector) -> Vector:
        if any(p.degree for p, _ in rotation):
            vector = self.unknowns.affine_vector(vector)
        terms = [(p, turned(matrix, vector)) for p, matrix in rotation]
        x, y, z = (combine((1.0, self.unknowns.product(p, v[i])) for p, v in terms) for i in range(3))
        return x, y, z


def _circle_rotation(variables: tuple[Polynomial, ...], axis: Array, centre: float) -> _Rotation:
    """Rot(a, θ₀ + Δ) = aaᵀ + cos Δ (I − aaᵀ) R₀ + sin Δ [a]× R₀, R₀ = Rot(a, θ₀)."""
    along, cross = np.outer(axis, axis), skew(axis)
    across = np.eye(3) - along
    base = np.cos(centre) * across + np.sin(centre) * cross  # the axis is fixed: what is across alone is turned
    factors = Polynomial.constant(1.0), *variables
    return list(zip(factors, map(without_noise, (along, across @ base, cross @ base)), strict=True))


def _ball_rotation(variables: tuple[Polynomial, ...], centre: tuple[float, float, float, float]) -> _Rotation:
    """R₀ R(δ): the nine entries of R(δ) are quadratic in the unit quaternion δ."""
    x, y, z, w = variables
    base = quaternion_matrix(np.array(centre))
    entries = (
        (w * w + x * x - y * y - z * z, (x * y - w * z).scaled(2.0), (x * z + w * y).scaled(2.0)),
        ((x * y + w * z).scaled(2.0), w * w - x * x + y * y - z * z, (y * z - w * x).scaled(2.0)),
        ((x * z - w * y).scaled(2.0), (y * z + w * x).scaled(2.0), w * w - x * x - y * y + z * z),
    )
    unit = np.eye(3)
    return [(entries[i][k], without_noise(np.outer(base[:, i], unit[k]))) for i in range(3) for k in range(3)]
