"""Scalar coordinates θ of the free system: one number for each velocity component, whatever the joints are.

Each joint is read as its kind's elementary steps (`ccpin.description.joint_kinds`): plain numbers as they are, a circle
as its angle, a rotation re-centred at a reference configuration, R = R_ref · R_x(θ₁) R_y(θ₂) R_z(θ₃).

θ ↦ q′ is defined for every θ and smooth, so a statement about solutions θ of φ(q′(θ)) = 0 is a statement about
closed configurations. Where θ₂ = ±90° the three turns are dependent and no certificate is possible; re-centre
the chart there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccpin.arrays import Array
from ccpin.description.joint_kinds import JointKind
from ccpin.errors import UnsupportedMechanismError
from ccpin.kinematics.coordinates import component_names
from ccpin.mechanism.mechanism import Mechanism


class Elementary(NamedTuple):
    """One turn or slide: fixed placement (4×4) before it, unit axis (3,), kind, and its position in θ."""

    placement: Array
    axis: Array
    prismatic: bool
    position: int


@dataclass(frozen=True, eq=False)
class ChartJoint:
    """Where a joint sits in q′ and θ, its kind, and the rotation (3, 3) its turns are measured from."""

    name: str
    kind: JointKind
    q: slice
    v: slice
    reference: Array


@dataclass(frozen=True, eq=False)
class Chart:
    """θ (n′,) ↔ q′ (nq,) about a reference configuration, without Pinocchio.

    Attributes:
        joints: The movable joints in the order of Pinocchio's joint indices 1, 2, ….
        nq: Size of q′.
        n_free: Size of θ.
    """

    joints: tuple[ChartJoint, ...]
    nq: int
    n_free: int

    def theta(self, q_free: Array) -> Array:
        """θ of a configuration: angles in (−π, π] for circles and quaternions, as they are for the rest."""
        theta = np.empty(self.n_free)
        for joint in self.joints:
            theta[joint.v] = joint.kind.theta(q_free[joint.q], joint.reference)
        return theta

    def configuration(self, theta: Array) -> Array:
        """q′ of θ, over any leading axes: shape (…, n′) → (…, nq)."""
        q_free = np.empty((*theta.shape[:-1], self.nq))
        for joint in self.joints:
            q_free[..., joint.q] = joint.kind.configuration(theta[..., joint.v], joint.reference)
        return q_free


def chart_at(mechanism: Mechanism, q_free: Array) -> Chart:
    """The chart of a mechanism centred at a configuration of shape (nq,)."""
    joints = (ChartJoint(j.name, j.kind, j.q, j.v, j.kind.reference(q_free[j.q])) for j in mechanism.tree.joints)
    return Chart(tuple(joints), mechanism.nq, mechanism.n_free)


def elementary_joints(mechanism: Mechanism, chart: Chart) -> list[list[Elementary]]:
    """Each joint as its kind's elementary steps, root side first, by Pinocchio's joint index less one."""
    result = []
    for joint, charted in zip(mechanism.tree.joints, chart.joints, strict=True):
        steps, before = list[Elementary](), joint.placement
        for k, (axis, slides) in enumerate(zip(joint.kind.directions(joint.axis), joint.kind.slides, strict=True)):
            if not slides and all(step.prismatic for step in steps):
                turned = np.eye(4)
                turned[:3, :3] = charted.reference
                before = before @ turned
            steps.append(Elementary(before, axis, slides, joint.v.start + k))
            before = np.eye(4)
        result.append(steps)
    return result


def independent_indices(mechanism: Mechanism, chart: Chart) -> NDArray[np.intp]:
    """Which components of θ are the independent coordinates q, in their order.

    Raises:
        UnsupportedMechanismError: A rotation of a spherical or floating joint is independent: its coordinate
            is not one of the chart's.
    """
    names = component_names(mechanism.tree)
    by_joint = {joint.name: joint for joint in chart.joints}
    chosen: list[int] = []
    for name in mechanism.independent:
        owner, single = mechanism.tree.split(name)
        joint = by_joint[owner]
        wanted = [name] if single else names[joint.v]
        turning = any(component.endswith(("rx", "ry", "rz")) for component in wanted)
        if turning and joint.kind.unit == 4:
            raise UnsupportedMechanismError(
                f"'{name}' is independent and turns about several axes at once: a certified region is a box in "
                "scalar coordinates, so name 1-dof joints (or planar and translation components) as independent, "
                "and leave idle spins locked (load without free=)"
            )
        chosen += [names.index(component) for component in wanted]
    return np.array(chosen, dtype=np.intp)
