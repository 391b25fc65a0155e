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

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.domain.theorem2.polynomial import Polynomial, combine
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
from ccpin.errors import UnsupportedMechanismError
from ccpin.mechanism.mechanism import Mechanism

PARALLEL = 1e-13
ANGULAR = ("revolute", "continuous")
SUPPORTED = (*ANGULAR, "prismatic", "spherical")


class JointData(NamedTuple):
    """A joint of the tree: its constant placement in the parent joint's frame, kind and axis."""

    name: str
    kind: str
    parent: int
    idx_q: int
    axis: Array
    rotation: Array
    translation: Array


class Run(NamedTuple):
    """How a revolute joint's angle enters: summed onto `parent`'s (``None``: it stands alone), times `sign`.

    `axis` is the run's axis in the frame of its first joint.
    """

    parent: int | None
    sign: float
    axis: Array


def joint_data(mechanism: Mechanism) -> dict[int, JointData]:
    """Every movable joint of the mechanism, by its number in the tree."""
    model, axes = mechanism.tree.model, {joint.name: joint.axis for joint in mechanism.description.joints}
    joints = {}
    for j in range(1, model.njoints):
        name, placement = model.names[j], model.jointPlacements[j]
        kind = mechanism.tree.kinds[name]
        axis = np.array(axes[name]) if kind in ("revolute", "prismatic") else np.array([0.0, 0.0, 1.0])
        joints[j] = JointData(
            name,
            kind,
            int(model.parents[j]),
            int(model.idx_qs[j]),
            axis,
            without_noise(np.array(placement.rotation)),
            np.array(placement.translation),
        )
    return joints


def path(joints: dict[int, JointData], ancestor: int, tip: int) -> list[int]:
    """The joints between an ancestor's body and a tip's, root first."""
    chain = []
    while tip != ancestor:
        chain.append(tip)
        tip = joints[tip].parent
    return chain[::-1]


def find_runs(joints: dict[int, JointData], on_loops: set[int], ancestors: set[int], merge: bool) -> dict[int, Run]:
    """The run each revolute joint belongs to.

    A run ends at every body from which some loop is measured (`ancestors`), so that each joint has one angle
    variable for all loops; without `merge` every joint stands alone.
    """
    runs: dict[int, Run] = {}
    for j, joint in joints.items():
        if joint.kind not in ANGULAR:
            continue
        runs[j] = Run(None, 1.0, joint.axis)
        axis, k = joint.rotation @ joint.axis, joint.parent
        while merge and k and j in on_loops and k not in ancestors:
            before = joints[k]
            if before.kind != "prismatic":
                if before.kind in ANGULAR and np.linalg.norm(np.cross(axis, before.axis)) < PARALLEL:
                    runs[j] = Run(k, float(np.sign(axis @ before.axis)) * runs[k].sign, runs[k].axis)
                break
            axis, k = before.rotation @ axis, before.parent
    return runs


class _Rotation(NamedTuple):
    """Σ polynomial · matrix, equal to a rotation."""

    parts: tuple[tuple[Polynomial, Array], ...]


class Kinematics:
    """Joint variables of the active joints of a tree, and the points and directions they carry.

    Args:
        joints: The tree.
        runs: From `find_runs`.
        active: Joints that occur in a closure or a coupling.
        q_free: The centre, of shape (nq,).

    Raises:
        UnsupportedMechanismError: An active joint is planar or floating.
    """

    def __init__(self, joints: dict[int, JointData], runs: dict[int, Run], active: list[int], q_free: Array) -> None:
        self.joints = joints
        self.runs = runs
        self.unknowns = Unknowns()
        self.variables: dict[int, tuple[Polynomial, ...]] = {}
        self._rotations: dict[int, _Rotation] = {}
        self._slides: dict[int, float] = {}
        for j in active:
            if joints[j].kind not in SUPPORTED:
                raise UnsupportedMechanismError(
                    f"Theorem 2 is implemented for {', '.join(SUPPORTED)} joints; joint '{joints[j].name}' is "
                    f"{joints[j].kind} and lies on a loop"
                )
            self._introduce(j, q_free)

    def _introduce(self, j: int, q_free: Array) -> None:
        joint = self.joints[j]
        if joint.kind == "prismatic":
            self._slides[j] = float(q_free[joint.idx_q])
            self.variables[j] = self.unknowns.chart(Slide(joint.idx_q, self._slides[j], joint.name), q_free)
        elif joint.kind == "spherical":
            unit = q_free[joint.idx_q : joint.idx_q + 4] / np.linalg.norm(q_free[joint.idx_q : joint.idx_q + 4])
            x, y, z, w = (float(c) for c in unit)
            self.variables[j] = self.unknowns.chart(Ball(joint.idx_q, (x, y, z, w), joint.name), q_free)
            self._rotations[j] = _ball_rotation(self.variables[j], (x, y, z, w))
        else:
            terms = self._angle_terms(j)
            centre = sum(term.at(q_free) for term in terms)
            self.variables[j] = self.unknowns.chart(Circle(terms, centre, joint.name), q_free)
            self._rotations[j] = _circle_rotation(self.variables[j], self.runs[j].axis, centre)

    def _angle_terms(self, j: int) -> tuple[AngleTerm, ...]:
        terms: list[AngleTerm] = []
        k: int | None = j
        while k is not None:
            terms.append(AngleTerm(self.joints[k].idx_q, self.joints[k].kind == "continuous", self.runs[k].sign))
            k = self.runs[k].parent
        return tuple(terms)

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
        rotation = _Rotation(((Polynomial.constant(1.0), np.eye(3)),))
        if self.joints[group[-1]].kind != "prismatic":
            vector = self.unknowns.affine_vector(vector)
        total = constant_vector(np.zeros(3))
        for j in group:
            joint = self.joints[j]
            if j != group[0]:
                if point:
                    total = plus(total, self._rotate(rotation, constant_vector(turn @ joint.translation)))
                turn = without_noise(turn @ joint.rotation)
            if joint.kind == "prismatic":
                if point:
                    moved = self.variables[j][0] + Polynomial.constant(self._slides[j])
                    travel = constant_vector(without_noise(turn @ joint.axis))
                    x, y, z = (self.unknowns.product(moved, c) for c in self._rotate(rotation, travel))
                    total = plus(total, (x, y, z))
            else:
                rotation = self._rotations[j]
        total = plus(total, self._rotate(rotation, turned(turn, vector)))
        first = self.joints[group[0]]
        total = turned(first.rotation, total)
        return plus(total, constant_vector(first.translation)) if point else total

    def _rotate(self, rotation: _Rotation, vector: Vector) -> Vector:
        if any(p.degree for p, _ in rotation.parts):
            vector = self.unknowns.affine_vector(vector)
        terms = [(p, turned(matrix, vector)) for p, matrix in rotation.parts]
        x, y, z = (combine((1.0, self.unknowns.product(p, v[i])) for p, v in terms) for i in range(3))
        return x, y, z


def _circle_rotation(variables: tuple[Polynomial, ...], axis: Array, centre: float) -> _Rotation:
    """Rot(a, θ₀ + Δ) = aaᵀ + cos Δ (I − aaᵀ) R₀ + sin Δ [a]× R₀, R₀ = Rot(a, θ₀)."""
    x, y, z = axis
    along, cross = np.outer(axis, axis), np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    across = np.eye(3) - along
    base = along + np.cos(centre) * across + np.sin(centre) * cross
    return _Rotation(
        (
            (Polynomial.constant(1.0), without_noise(along)),
            (variables[0], without_noise(across @ base)),
            (variables[1], without_noise(cross @ base)),
        )
    )


def _ball_rotation(variables: tuple[Polynomial, ...], centre: tuple[float, float, float, float]) -> _Rotation:
    """R₀ R(δ): the nine entries of R(δ) are quadratic in the unit quaternion δ."""
    x, y, z, w = variables
    base = _matrix(centre)
    entries = (
        (w * w + x * x - y * y - z * z, (x * y - w * z).scaled(2.0), (x * z + w * y).scaled(2.0)),
        ((x * y + w * z).scaled(2.0), w * w - x * x + y * y - z * z, (y * z - w * x).scaled(2.0)),
        ((x * z - w * y).scaled(2.0), (y * z + w * x).scaled(2.0), w * w - x * x - y * y + z * z),
    )
    unit = np.eye(3)
    return _Rotation(
        tuple((entries[i][k], without_noise(np.outer(base[:, i], unit[k]))) for i in range(3) for k in range(3))
    )


def _matrix(quaternion: tuple[float, float, float, float]) -> Array:
    x, y, z, w = np.array(quaternion) / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
