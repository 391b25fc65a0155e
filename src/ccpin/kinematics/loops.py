"""Closures and couplings placed in the tree: who carries each end, and what planarity proves.

A loop is planar if every revolute axis on it is parallel to one direction n, every prismatic axis is
perpendicular to it and no other joint lies on it. All its links then move parallel to the plane ⟂ n in every
configuration, so rows that measure displacement along n, or a direction against n, are constant: they are
dropped by proof, not by numerical rank at one configuration. Rows that are redundant for any other reason
(Bennett's or Sarrus' linkage) are all kept; ψ is then judged by rank.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from fractions import Fraction
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array, cross
from ccpin.description.closure_kinds import PARALLEL, LoopRows, PlaneNormal, rows_of
from ccpin.description.model import Coupling, LoopClosure
from ccpin.errors import UnsupportedMechanismError
from ccpin.kinematics.tree import Attachment, Tree, rest_poses


class ResolvedClosure(NamedTuple):
    """One closure, placed.

    Attributes:
        closure: What was declared.
        joint_a, joint_b: Indices of the joints that carry the two ends (0: the world).
        ancestor: Index of their nearest common ancestor joint C (0: the world).
        frame_a, frame_b: 4×4 closure frames in those joints' frames.
        path_a, path_b: The joints between C and each end, root first.
        mask_a, mask_b: 1.0 for their velocity components, else 0.0, of shape (n′,).
        rows: Its rows of φ.
        normal: Plane normal of a planar loop in C, or ``None``.
    """

    closure: LoopClosure
    joint_a: int
    joint_b: int
    ancestor: int
    frame_a: Array
    frame_b: Array
    path_a: tuple[int, ...]
    path_b: tuple[int, ...]
    mask_a: Array
    mask_b: Array
    rows: LoopRows
    normal: Array | None

    @property
    def size(self) -> int:
        """Number of rows."""
        return len(self.rows.rows)

    @property
    def turnable(self) -> bool:
        """Whether its rows vanish with its axes turned end for end too; in a plane most axes cannot turn over."""
        return bool(self.rows.alignment) and any(self.rows.direction_rows)

    def extent(self, model: pin.Model) -> float:
        """The sum of the lengths around the loop at zero displacement, m."""
        links = (model.jointPlacements[joint].translation for joint in (*self.path_a, *self.path_b))
        ends = (self.frame_a[:3, 3], self.frame_b[:3, 3])
        return sum(float(np.linalg.norm(v)) for v in (*links, *ends)) + (self.closure.length or 0.0)

    def orientations(self, data: pin.Data) -> tuple[Array, Array]:
        """The world's view (3, 3) of frames A and B, from forward kinematics."""
        ends = ((self.joint_a, self.frame_a), (self.joint_b, self.frame_b))
        a, b = (data.oMi[joint].rotation @ frame[:3, :3] for joint, frame in ends)
        return a, b


class LoopPath(NamedTuple):
    """Where a closure's loop runs in a tree, by joint numbers.

    Attributes:
        carrier_a, carrier_b: What the closure's two links are attached to.
        ancestor: The nearest common ancestor joint C (0: the world).
        a, b: The joints between C and each end, root first.
    """

    carrier_a: Attachment
    carrier_b: Attachment
    ancestor: int
    a: tuple[int, ...]
    b: tuple[int, ...]


def loop_path(tree: Tree, closure: LoopClosure) -> LoopPath:
    """The joints on a closure's loop."""
    carriers = tree.attachments[closure.link_a], tree.attachments[closure.link_b]
    supports = [[int(joint) for joint in tree.model.supports[carrier.joint]] for carrier in carriers]
    shared = set(supports[0]).intersection(supports[1])
    paths = [tuple([joint for joint in support if joint not in shared]) for support in supports]
    return LoopPath(*carriers, max(shared), *paths)


def resolve_closures(
    tree: Tree, closures: Iterable[LoopClosure], reduce_planar: bool = True
) -> tuple[ResolvedClosure, ...]:
    """Place closures in the tree; with `reduce_planar` drop the rows that planarity proves constant."""
    poses = rest_poses(tree)
    return tuple(_resolve(tree, poses, closure, reduce_planar) for closure in closures)


def _resolve(tree: Tree, poses: Array, closure: LoopClosure, reduce_planar: bool) -> ResolvedClosure:
    path = loop_path(tree, closure)
    ends = path.carrier_a, path.carrier_b
    frames = ends[0].placement @ closure.placement_a, ends[1].placement @ closure.placement_b
    normal = PlaneNormal()
    world = plane_normal(tree, poses, (*path.a, *path.b)) if reduce_planar else None
    if world is not None:
        turns = [(poses[end.joint] @ frame)[:3, :3] for end, frame in zip(ends, frames, strict=True)]
        normal = PlaneNormal(*(np.asarray(turn.T @ world) for turn in (*turns, poses[path.ancestor, :3, :3])))
    shared = tree.support(path.ancestor)
    return ResolvedClosure(
        *(closure, ends[0].joint, ends[1].joint, path.ancestor, *frames, path.a, path.b),
        mask_a=tree.support(ends[0].joint) - shared,
        mask_b=tree.support(ends[1].joint) - shared,
        rows=rows_of(closure, normal),
        normal=normal.C,
    )


def plane_normal(tree: Tree, poses: Array, joints: Iterable[int]) -> Array | None:
    """Unit normal (3,) in the world of the plane the joints' bodies move parallel to, or ``None`` if there is none.

    Args:
        tree: The free system.
        poses: Its `rest_poses`.
        joints: Numbers of the joints on the loop, or of all joints.
    """
    turns, slides = list[Array](), list[Array]()
    for number in joints:
        joint = tree.joints[number - 1]
        axes = joint.kind.directions(joint.axis) @ poses[number, :3, :3].T
        for axis, slide in zip(axes, joint.kind.slides, strict=True):
            (slides if slide else turns).append(axis)
    if not turns:
        return None
    normal = np.array(turns[0])
    parallel = all(np.linalg.norm(cross(normal, axis)) < PARALLEL for axis in turns)
    return normal if parallel and all(abs(normal @ axis) < PARALLEL for axis in slides) else None


class ResolvedTerm(NamedTuple):
    """One joint's part of a coupling.

    Attributes:
        idx_q, idx_v: Where the joint sits in q′ and q̇′.
        wrapped: Whether it is an angle on the circle.
        coefficients: Of the polynomial in the displacement from the reference, lowest power first.
        reference: Where displacements are counted from.
    """

    idx_q: int
    idx_v: int
    wrapped: bool
    coefficients: Array
    reference: float

    def angle(self, q_free: Array) -> float:
        """The joint's displacement from the term's reference; on the circle in (−π, π] before the reference."""
        i = self.idx_q
        return float((math.atan2(q_free[i + 1], q_free[i]) if self.wrapped else q_free[i]) - self.reference)

    def slope(self, order: int, q_free: Array) -> float:
        """The polynomial's derivative of an order there."""
        if len(self.coefficients) <= order:
            return 0.0
        derivative = np.polynomial.polynomial.polyder(self.coefficients, order)
        return float(np.polynomial.polynomial.polyval(self.angle(q_free), derivative))


class ResolvedCoupling(NamedTuple):
    """A coupling placed in the tree; its row of φ holds modulo `modulus` (0: exactly)."""

    coupling: Coupling
    terms: tuple[ResolvedTerm, ...]
    modulus: float

    def value(self, q_free: Array) -> float:
        """The row of φ."""
        total = sum(term.slope(0, q_free) for term in self.terms)
        return math.remainder(total, self.modulus) if self.modulus else total


def resolve_coupling(tree: Tree, coupling: Coupling) -> ResolvedCoupling:
    """Place a coupling; where a continuous joint takes part the row is read modulo what whole turns add to it.

    Raises:
        UnsupportedMechanismError: A continuous joint enters with a power above one or an irrational ratio: the
            relation then depends on the number of turns, which a configuration on the circle does not hold.
    """
    terms, ratios = [], []
    for term in coupling.terms:
        joint = tree.joint(term.joint)
        wrapped = joint.kind.unit == 2
        if wrapped:
            slope = term.coefficients[1] if len(term.coefficients) > 1 else 0.0
            ratio = Fraction(slope).limit_denominator(1000)
            if any(term.coefficients[2:]) or abs(float(ratio) - slope) > 1e-12:
                raise UnsupportedMechanismError(
                    f"coupling '{coupling.name}': joint '{term.joint}' is continuous, so its ratio must be a "
                    "fraction of whole numbers up to 1000; make the joint revolute for any other relation"
                )
            ratios.append(ratio)
        coefficients = np.array(term.coefficients, dtype=np.float64)
        terms.append(ResolvedTerm(joint.q.start, joint.v.start, wrapped, coefficients, term.reference))
    return ResolvedCoupling(coupling, tuple(terms), 2 * math.pi * _common_divisor(ratios))


def _common_divisor(ratios: list[Fraction]) -> float:
    """The largest number of which every ratio is a whole multiple (0 without ratios)."""
    denominator = math.lcm(*(r.denominator for r in ratios))
    return math.gcd(*(int(r * denominator) for r in ratios)) / denominator
