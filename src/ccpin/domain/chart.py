"""Scalar coordinates θ of the free system: one number for each velocity component, whatever the joints are.

Revolute and prismatic joints are their own coordinate; a continuous joint is its angle. Joints with more freedom
are read as a sequence of elementary ones, re-centred at a reference configuration:

- planar: slide x, slide y, turn about z;
- spherical: R = R_ref · R_x(θ₁) R_y(θ₂) R_z(θ₃);
- floating: slides x, y, z, then as spherical.

θ ↦ q′ is defined for every θ and smooth, so a statement about solutions θ of φ(q′(θ)) = 0 is a statement about
closed configurations. Where θ₂ = ±90° the three turns are dependent and no certificate is possible; re-centre
the chart there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ccpin.arrays import Array
from ccpin.errors import UnsupportedMechanismError
from ccpin.kinematics.coordinates import component_names
from ccpin.mechanism.mechanism import Mechanism

Z = np.array([0.0, 0.0, 1.0])


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
    kind: str
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
            theta[joint.v] = _theta_of(joint, q_free[joint.q])
        return theta

    def configuration(self, theta: Array) -> Array:
        """q′ of θ, over any leading axes: shape (…, n′) → (…, nq)."""
        q_free = np.empty((*theta.shape[:-1], self.nq))
        for joint in self.joints:
            q_free[..., joint.q] = _configuration_of(joint, theta[..., joint.v])
        return q_free


def _theta_of(joint: ChartJoint, q: Array) -> Array:
    if joint.kind == "continuous":
        return np.array([np.arctan2(q[1], q[0])])
    if joint.kind == "planar":
        return np.array([q[0], q[1], np.arctan2(q[3], q[2])])
    if joint.kind in ("spherical", "floating"):
        turn = Rotation.from_matrix(joint.reference.T @ Rotation.from_quat(q[-4:]).as_matrix())
        return np.concatenate([q[:-4], turn.as_euler("XYZ")])
    return q


def _configuration_of(joint: ChartJoint, theta: Array) -> Array:
    if joint.kind == "continuous":
        return np.concatenate([np.cos(theta), np.sin(theta)], axis=-1)
    if joint.kind == "planar":
        return np.concatenate([theta[..., :2], np.cos(theta[..., 2:]), np.sin(theta[..., 2:])], axis=-1)
    if joint.kind in ("spherical", "floating"):
        turns = Rotation.from_matrix(joint.reference) * Rotation.from_euler("XYZ", theta[..., -3:].reshape(-1, 3))
        return np.concatenate([theta[..., :-3], turns.as_quat().reshape(*theta.shape[:-1], 4)], axis=-1)
    return theta


def chart_at(mechanism: Mechanism, q_free: Array) -> Chart:
    """The chart of a mechanism centred at a configuration of shape (nq,)."""
    model, kinds = mechanism.tree.model, mechanism.tree.kinds
    joints = []
    for number, name in enumerate(model.names):
        if number == 0:
            continue
        q = slice(int(model.idx_qs[number]), int(model.idx_qs[number] + model.nqs[number]))
        v = slice(int(model.idx_vs[number]), int(model.idx_vs[number] + model.nvs[number]))
        reference = np.eye(3)
        if kinds[name] in ("spherical", "floating"):
            reference = Rotation.from_quat(q_free[q][-4:]).as_matrix()
        joints.append(ChartJoint(str(name), kinds[name], q, v, reference))
    return Chart(tuple(joints), mechanism.nq, mechanism.n_free)


def elementary_joints(mechanism: Mechanism, chart: Chart) -> list[list[Elementary]]:
    """Each joint as elementary ones, root side first, by Pinocchio's joint index less one."""
    axes = {joint.name: joint.axis for joint in mechanism.description.joints}
    placements = list(mechanism.tree.model.jointPlacements)[1:]
    result = []
    for joint, placement in zip(chart.joints, placements, strict=True):
        before = np.asarray(placement.homogeneous)
        first = joint.v.start
        if joint.kind in ("revolute", "prismatic"):
            result.append([Elementary(before, np.asarray(axes[joint.name]), joint.kind == "prismatic", first)])
        elif joint.kind == "continuous":
            result.append([Elementary(before, Z, False, first)])
        else:
            result.append(_virtual(joint, before))
    return result


def _virtual(joint: ChartJoint, before: Array) -> list[Elementary]:
    """A planar, spherical or floating joint as slides and turns."""
    x, y, z = np.eye(3)
    turned = np.eye(4)
    turned[:3, :3] = joint.reference
    slides = {"planar": [x, y], "spherical": [], "floating": [x, y, z]}[joint.kind]
    turns = [z] if joint.kind == "planar" else [x, y, z]
    steps = [(axis, True) for axis in slides] + [(axis, False) for axis in turns]
    result = []
    for k, (axis, prismatic) in enumerate(steps):
        placement = turned if k == len(slides) else np.eye(4)
        result.append(Elementary(before @ placement if k == 0 else placement, axis, prismatic, joint.v.start + k))
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
        joint = by_joint[name.partition(":")[0]]
        wanted = [name] if ":" in name else names[joint.v]
        turning = any(component.endswith(("rx", "ry", "rz")) for component in wanted)
        if turning and joint.kind in ("spherical", "floating"):
            raise UnsupportedMechanismError(
                f"'{name}' is independent and turns about several axes at once: a certified region is a box in "
                "scalar coordinates, so name 1-dof joints (or planar and translation components) as independent"
            )
        chosen += [names.index(component) for component in wanted]
    return np.array(chosen, dtype=np.intp)
