"""A mechanism as MJCF, for timing MuJoCo on it: bodies, 1-dof joints, inertias and loops, nothing to look at.

MuJoCo's bodies must have mass, so joints between massless links become one body with several joints: these turn and
slide one after another, root side first, and their axes are stated in the body's frame at zero displacement.
"""

from __future__ import annotations

from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

import ccpin
from benchmarks.peers import NotForThisError

OPTIONS = {"solver": "Newton", "jacobian": "auto", "iterations": "20", "tolerance": "1e-14"}
EQUALITY_KINDS = {"spherical": "connect", "fixed": "weld"}


class Servo(NamedTuple):
    """A motor whose effort is offset − stiffness q − damping q̇ of its joint."""

    offset: float
    stiffness: float
    damping: float


def mjcf(
    mechanism: ccpin.Mechanism,
    *,
    timestep: float = 1e-3,
    integrator: str = "Euler",
    solref: str = "0.002 1",
    solimp: str = "0.9999 0.9999 0.001 0.5 2",
    servos: dict[str, Servo] | None = None,
) -> str:
    """The file's text.

    Args:
        mechanism: With 1-dof joints (no full circles) and spherical, fixed or planar closures.
        timestep: In seconds.
        integrator: One of MuJoCo's.
        solref: How fast an open loop closes (a time in seconds, a damping ratio).
        solimp: How stiff loops are.
        servos: Motors by joint.

    Raises:
        NotForThisError: MuJoCo has no such joint or closure, or a massless link branches or ends the tree.
    """
    root = ElementTree.Element("mujoco", model=mechanism.name)
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="false")
    gravity = _text(mechanism.description.gravity)
    option = {"timestep": repr(timestep), "integrator": integrator, "gravity": gravity}
    flags = ElementTree.SubElement(root, "option", OPTIONS | option)
    ElementTree.SubElement(flags, "flag", contact="disable", limit="disable", frictionloss="disable")
    bodies = _Bodies(mechanism, ElementTree.SubElement(root, "worldbody"))
    equality = ElementTree.SubElement(root, "equality")
    for loop in mechanism.constraints().loops:
        kind = "connect" if loop.normal is not None else EQUALITY_KINDS.get(loop.closure.kind)
        if kind is None:
            raise NotForThisError(f"this writer has no MJCF for a {loop.closure.kind} closure")
        name = loop.closure.name
        bodies.site(loop.joint_a, f"{name}/a", loop.frame_a)
        bodies.site(loop.joint_b, f"{name}/b", loop.frame_b)
        ElementTree.SubElement(
            equality, kind, name=name, site1=f"{name}/a", site2=f"{name}/b", solref=solref, solimp=solimp
        )
    if mechanism.couplings:
        raise NotForThisError("this writer has no MJCF for couplings")
    motors = ElementTree.SubElement(root, "actuator")
    for joint, (offset, stiffness, damping) in (servos or {}).items():
        law = {"gainprm": "0", "biastype": "affine", "biasprm": _text((offset, -stiffness, -damping))}
        ElementTree.SubElement(motors, "general", law, joint=joint)
    return ElementTree.tostring(root, encoding="unicode")


class _Bodies:
    """The tree of bodies: joints gathered until one that carries mass."""

    def __init__(self, mechanism: ccpin.Mechanism, world: ElementTree.Element) -> None:
        self.tree, self.model = mechanism.tree, mechanism.pin_model
        self.body_of = {0: world}
        waiting: dict[int, list[int]] = {}
        for joint in self.tree.joints:
            if joint.kind.nv != 1 or joint.kind.nq != 1:
                raise NotForThisError(f"this writer has no MJCF for a {joint.kind.name} joint")
            chain = [*waiting.pop(joint.parent, []), joint.number]
            if joint.parent not in self.body_of and len(chain) == 1:
                raise NotForThisError(f"the massless link after joint {self.tree.names[joint.parent - 1]} branches")
            if self.model.inertias[joint.number].mass > 0:
                self._add(chain)
            else:
                waiting[joint.number] = chain
        if waiting:
            raise NotForThisError("a link at the end of the tree has no mass")

    def _add(self, chain: list[int]) -> None:
        """A body for the joints of a chain; its frame is the last one's."""
        joints = [self.tree.joints[number - 1] for number in chain]
        place, frames = np.eye(4), []
        for joint in joints:
            place = place @ np.array(joint.placement)
            frames.append(place)
        parent = self.body_of[joints[0].parent]
        body = ElementTree.SubElement(parent, "body", name=joints[-1].name, **_pose(place))
        inertia = self.model.inertias[chain[-1]]
        moments = np.array(inertia.inertia)[(0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)]
        values = {"mass": _text([inertia.mass]), "pos": _text(inertia.lever), "fullinertia": _text(moments)}
        ElementTree.SubElement(body, "inertial", values)
        for joint, frame in zip(joints, frames, strict=True):
            seen = np.linalg.inv(place) @ frame
            axis = seen[:3, :3] @ joint.kind.directions(np.array(joint.axis))[0]
            kind = "slide" if joint.kind.sliding else "hinge"
            armature = _text([self.model.armature[joint.v.start]])
            values = {"pos": _text(seen[:3, 3]), "axis": _text(axis), "armature": armature}
            ElementTree.SubElement(body, "joint", values, name=joint.name, type=kind)
        self.body_of[chain[-1]] = body

    def site(self, joint: int, name: str, frame: np.ndarray) -> None:
        """A loop's end on the body that a joint carries."""
        if joint not in self.body_of:
            raise NotForThisError("a loop ends on a massless link")
        ElementTree.SubElement(self.body_of[joint], "site", name=name, **_pose(np.array(frame)))


def _pose(frame: np.ndarray) -> dict[str, str]:
    x, y, z, w = pin.Quaternion(frame[:3, :3]).coeffs()
    return {"pos": _text(frame[:3, 3]), "quat": _text((w, x, y, z))}


def _text(values: object) -> str:
    return " ".join(repr(float(value)) for value in np.asarray(values).ravel())
