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

from ccpin.arrays import Array
from ccpin.description.closure_kinds import PARALLEL, LoopRows, PlaneNormal, rows_of
from ccpin.description.model import Coupling, LoopClosure
from ccpin.errors import UnsupportedMechanismError
from ccpin.kinematics.tree import Tree


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

    def orientations(self, data: pin.Data) -> tuple[Array, Array]:
        """The world's view (3, 3) of frames A and B, from forward kinematics."""
        ends = ((self.joint_a, self.frame_a), (self.joint_b, self.frame_b))
        a, b = (data.oMi[joint].rotation @ frame[:3, :3] for joint, frame in ends)
        return a, b


def resolve_closures(
    tree: Tree, closures: Iterable[LoopClosure], reduce_planar: bool = True
) -> tuple[ResolvedClosure, ...]:
    """Place closures in the tree; with `reduce_planar` drop the rows that planarity proves constant."""
    data = tree.model.createData()
    pin.computeJointJacobians(tree.model, data, pin.neutral(tree.model))
    return tuple(_resolve(tree, data, closure, reduce_planar) for closure in closures)


def _resolve(tree: Tree, data: pin.Data, closure: LoopClosure, reduce_planar: bool) -> ResolvedClosure:
    carrier_a, carrier_b = tree.attachments[closure.link_a], tree.attachments[closure.link_b]
    frame_a, frame_b = carrier_a.placement @ closure.placement_a, carrier_b.placement @ closure.placement_b
    supports_a, supports_b = (list(tree.model.supports[carrier.joint]) for carrier in (carrier_a, carrier_b))
    shared = [a for a, b in zip(supports_a, supports_b, strict=False) if a == b]
    path_a, path_b = (tuple(int(j) for j in supports[len(shared) :]) for supports in (supports_a, supports_b))
    normal = PlaneNormal()
    world = plane_normal(tree, data, (*path_a, *path_b)) if reduce_planar else None
    if world is not None:
        turns = [data.oMi[joint].rotation for joint in (carrier_a.joint, carrier_b.joint, shared[-1])]
        frames = (turns[0] @ frame_a[:3, :3], turns[1] @ frame_b[:3, :3], turns[2])
        normal = PlaneNormal(*(np.asarray(frame.T @ world) for frame in frames))
    return ResolvedClosure(
        *(closure, carrier_a.joint, carrier_b.joint, int(shared[-1]), frame_a, frame_b, path_a, path_b),
        mask_a=tree.support(carrier_a.joint) - tree.support(shared[-1]),
        mask_b=tree.support(carrier_b.joint) - tree.support(shared[-1]),
        rows=rows_of(closure, normal),
        normal=normal.C,
    )


def plane_normal(tree: Tree, data: pin.Data, joints: Iterable[int]) -> Array | None:
    """Unit normal (3,) in the world of the plane the joints' bodies move parallel to, or ``None`` if there is none.

    Args:
        tree: The free system.
        data: After Pinocchio's `computeJointJacobians` at any configuration.
        joints: Indices of the joints on the loop, or of all joints.
    """
    turns, slides = list[Array](), list[Array]()
    for joint in joints:
        for column in data.J[:, tree.joints[joint - 1].v].T:
            turning = float(np.linalg.norm(column[3:])) > PARALLEL
            (turns if turning else slides).append(column[3:] if turning else column[:3])
    if not turns:
        return None
    normal = np.array(turns[0])
    parallel = all(np.linalg.norm(np.cross(normal, axis)) < PARALLEL for axis in turns)
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
