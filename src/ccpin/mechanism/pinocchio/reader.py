"""A description of an existing Pinocchio model: its joints, bodies, geometries and constraints, without a file."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array, instance
from ccpin.description.checks import check
from ccpin.description.model import (
    IDENTITY,
    X_AXIS,
    Coupling,
    CouplingTerm,
    Inertia,
    Joint,
    Link,
    LoopClosure,
    MechanismDescription,
    Shape,
    Visual,
)
from ccpin.errors import InvalidInputError, UnsupportedMechanismError

_UNLIMITED = 1e16  # a limit as large is none
_AXES = np.eye(3)  # x, y and z
# Joints of several velocities as steps: kind and axis each, in the order of q.
_CHAINS: dict[str, tuple[tuple[str, Array], ...]] = {
    "JointModelTranslation": tuple(("prismatic", axis) for axis in _AXES),
    "JointModelSphericalZYX": tuple(("revolute", axis) for axis in _AXES[::-1]),
}
_WHOLE = {"JointModelFreeFlyer": "floating", "JointModelSpherical": "spherical", "JointModelPlanar": "planar"}


def describe_pinocchio(
    model: pin.Model, *, geometry: pin.GeometryModel | None = None, constraints: Iterable[Any] = ()
) -> MechanismDescription:
    """Describe a Pinocchio model, so that it can be loaded as a mechanism.

    q′ keeps its meaning and, joints standing in depth-first order as Pinocchio's own parsers put them, its order.
    Joints that ccpin has no kind for become chains of those it has: a composite joint its parts, a helical one a hinge
    and a slide with a coupling, a mimic joint a coupling.

    Args:
        model: The tree. Links are named as its body frames, the base ``universe`` where it has none.
        geometry: What to draw.
        constraints: `RigidConstraintModel`s (3D: spherical, 6D: fixed), `PointAnchorConstraintModel`s (spherical) and
            `FrameAnchorConstraintModel`s (fixed).

    Raises:
        InvalidInputError: The model is none, or a constraint is of no kind that closes a loop.
        UnsupportedMechanismError: A joint has no counterpart.
        DescriptionError: The whole is unsound (see `ccpin.description.checks.check`).
    """
    if not isinstance(model, pin.Model):
        raise InvalidInputError(f"a pinocchio.Model is needed, not {type(model).__name__}")
    reader = _ModelReader(model)
    reader.read()
    if geometry is not None:
        reader.draw(instance(geometry, "geometry", pin.GeometryModel, "a pinocchio.GeometryModel"))
    given = instance(constraints, "constraints", Iterable, "a sequence of constraint models")
    closures = tuple(reader.closure(k, constraint) for k, constraint in enumerate(given, start=1))
    return check(
        MechanismDescription(
            name=model.name or "mechanism",
            root=reader.names[0],
            links=tuple(reader.links.values()),
            joints=tuple(reader.joints),
            closures=closures,
            couplings=tuple(reader.couplings),
            dependent_hint=tuple(coupling.terms[0].joint for coupling in reader.couplings),
            gravity=tuple(model.gravity.linear.tolist()),
            notes=tuple(reader.notes),
        )
    )


class _ModelReader:
    """Goes through the joints in their order; `names` are the links they carry."""

    def __init__(self, model: pin.Model) -> None:
        self.model = model
        self.q = pin.neutral(model)
        self.names = [self._body(number) for number in range(model.njoints)]
        self.links = {self.names[0]: Link(self.names[0])}
        self.joints: list[Joint] = []
        self.couplings: list[Coupling] = []
        self.notes: list[str] = []

    def read(self) -> None:
        """All joints, then the frames that are bodies or points of interest."""
        for number in range(1, self.model.njoints):
            self._joint(number)
            inertia, name = self.model.inertias[number], self.names[number]
            said = Inertia(float(inertia.mass), np.array(inertia.lever), np.array(inertia.inertia))
            self.links[name] = Link(name, said if inertia.mass else None)
        taken = {joint.name for joint in self.joints}
        for frame in self.model.frames:
            wanted = frame.type in (pin.FrameType.BODY, pin.FrameType.OP_FRAME)
            if wanted and frame.name not in self.links and f"{frame.name}.fixed" not in taken:
                self.links[frame.name] = Link(frame.name)
                parent, placement = self.names[frame.parentJoint], np.array(frame.placement.homogeneous)
                self.joints.append(Joint(f"{frame.name}.fixed", "fixed", parent, frame.name, placement))

    def _body(self, number: int) -> str:
        """The name of the body a joint carries: of a body frame that coincides with the joint's, else the joint's."""
        for frame in self.model.frames:
            if frame.type == pin.FrameType.BODY and frame.parentJoint == number and frame.placement.isIdentity():
                return str(frame.name)
        return str(self.model.names[number])

    def _joint(self, number: int) -> None:
        name, parent = str(self.model.names[number]), self.names[self.model.parents[number]]
        steps = self._steps(self.model.joints[number], name)
        placement = np.array(self.model.jointPlacements[number].homogeneous)
        at = int(self.model.idx_vs[number])
        for k, (step, before) in enumerate(steps):
            last = k == len(steps) - 1
            child = self.names[number] if last else f"{self.names[number]}.{step.name}"
            if not last:
                self.links[child] = Link(child)
            known = replace(step, parent=parent, child=child, placement=placement @ before)
            own = self.model.joints[number].nv > 0 and not step.name.endswith(".slide")
            self.joints.append(self._with_limits(known, at + k, number) if own else known)
            parent, placement = child, IDENTITY

    def _steps(self, joint: Any, name: str) -> list[tuple[Joint, Array]]:
        """The motions of a joint in order, each with its frame (4, 4) in the one before."""
        word, said = joint.shortname(), joint.extract() if hasattr(joint, "extract") else joint
        if "Composite" in word:
            parts = zip(said.joints, said.jointPlacements, strict=True)
            found = []
            for k, (part, placement) in enumerate(parts, start=1):
                inner = self._steps(part, f"{name}.{k}")
                found += [
                    (step, np.array(placement.homogeneous) @ before if i == 0 else before)
                    for i, (step, before) in enumerate(inner)
                ]
            return found
        if word in _CHAINS:
            return [(_step(f"{name}.{k}", kind, axis), IDENTITY) for k, (kind, axis) in enumerate(_CHAINS[word], 1)]
        if word in _WHOLE:
            return [(_step(name, _WHOLE[word], _AXES[2]), IDENTITY)]
        columns = self._columns(joint)
        if "Universal" in word:
            return [(_step(f"{name}.{k}", "revolute", columns[3:, k - 1]), IDENTITY) for k in (1, 2)]
        if columns.shape[1] != 1:
            raise UnsupportedMechanismError(f"joint '{name}': ccpin has no counterpart of {word}")
        steps = self._one_velocity(name, columns[:, 0], joint.nq == 2)
        if "Mimic" in word:
            self._mimic(name, joint.id, said)
        return [(step, IDENTITY) for step in steps]

    def _one_velocity(self, name: str, axis: Array, circle: bool) -> list[Joint]:
        """A slide, a hinge, a hinge on a circle, or a screw as a hinge and a slide."""
        slide, turn = axis[:3], axis[3:]
        if not np.any(turn):
            return [_step(name, "prismatic", slide)]
        if np.any(slide):
            lead = float(slide @ turn) / float(turn @ turn)
            terms = CouplingTerm(f"{name}.slide", (0.0, 1.0)), CouplingTerm(name, (0.0, -lead))
            self.couplings.append(Coupling(f"{name}.thread", terms))
            return [_step(name, "revolute", turn), _step(f"{name}.slide", "prismatic", turn)]
        return [_step(name, "continuous" if circle else "revolute", turn)]

    def _mimic(self, name: str, number: int, said: Any) -> None:
        """θ = scaling θ_master + offset."""
        pairs = zip(self.model.mimicking_joints, self.model.mimicked_joints, strict=True)
        master = next(str(self.model.names[other]) for mimicking, other in pairs if mimicking == number)
        terms = CouplingTerm(name, (-said.offset, 1.0)), CouplingTerm(master, (0.0, -said.scaling))
        self.couplings.append(Coupling(f"mimic_{name}", terms))

    def _columns(self, joint: Any) -> Array:
        """The joint's motion subspace at the neutral configuration, of shape (6, velocities)."""
        data = joint.createData()
        joint.calc(data, self.q)
        return np.array(data.S, dtype=np.float64).reshape(6, -1)

    def _with_limits(self, joint: Joint, at: int, number: int) -> Joint:
        """A joint with the limits and the forces of its velocity component."""
        model, whole = self.model, self.model.joints[number]
        lower, upper = -np.inf, np.inf
        if whole.nq == whole.nv:
            place = int(model.idx_qs[number]) + at - int(model.idx_vs[number])
            lower, upper = (_bound(limit[place]) for limit in (model.lowerPositionLimit, model.upperPositionLimit))
        return replace(
            joint,
            lower=lower,
            upper=upper,
            effort=_bound(model.upperEffortLimit[at]),
            velocity=_bound(model.upperVelocityLimit[at]),
            armature=float(model.armature[at]),
            damping=float(model.damping[at]),
            friction=max(0.0, float(model.upperDryFrictionLimit[at])),
        )

    def closure(self, position: int, constraint: Any) -> LoopClosure:
        """A constraint as a closure."""
        word = type(constraint).__name__
        kind = {"PointAnchorConstraintModel": "spherical", "FrameAnchorConstraintModel": "fixed"}.get(word)
        if isinstance(constraint, pin.RigidConstraintModel):
            kind = "spherical" if constraint.type == pin.ContactType.CONTACT_3D else "fixed"
        if kind is None:
            known = "RigidConstraintModel, PointAnchorConstraintModel and FrameAnchorConstraintModel"
            raise InvalidInputError(f"constraint {position} is a {word}; loops are closed by {known}")
        ends = (constraint.joint1_id, constraint.joint1_placement), (constraint.joint2_id, constraint.joint2_placement)
        (link_a, a), (link_b, b) = ((self.names[number], np.array(at.homogeneous)) for number, at in ends)
        return LoopClosure(constraint.name or f"constraint_{position}", kind, link_a, link_b, a, b)

    def draw(self, geometry: pin.GeometryModel) -> None:
        """Hang a geometry model's shapes on the links of their joints."""
        for thing in geometry.geometryObjects:
            shape = _shape(thing)
            if shape is None:
                self.notes.append(f"geometry '{thing.name}' is no shape that can be drawn; it is left out of pictures")
                continue
            link = self.links[self.names[thing.parentJoint]]
            r, g, b, a = (float(part) for part in np.clip(thing.meshColor, 0.0, 1.0))
            visual = Visual(shape, np.array(thing.placement.homogeneous), (r, g, b, a))
            self.links[link.name] = replace(link, visuals=(*link.visuals, visual))


def _step(name: str, kind: str, axis: Array) -> Joint:
    length = float(np.linalg.norm(axis))
    return Joint(name, kind, "", "", axis=axis / length if length else X_AXIS)


def _bound(value: float) -> float:
    return float(np.copysign(np.inf, value)) if abs(value) >= _UNLIMITED else float(value)


def _shape(thing: pin.GeometryObject) -> Shape | None:
    """A geometry object's shape, if it can be drawn."""
    if thing.meshPath and thing.meshPath.lower().rpartition(".")[2] in ("stl", "obj", "dae", "ply", "glb", "gltf"):
        return Shape("mesh", tuple(np.array(thing.meshScale, dtype=np.float64).tolist()), mesh=str(thing.meshPath))
    form, word = thing.geometry, type(thing.geometry).__name__
    if word == "Box":
        return Shape("box", tuple((2.0 * np.array(form.halfSide)).tolist()))
    if word == "Sphere":
        return Shape("sphere", (float(form.radius),))
    if word == "Cylinder":
        return Shape("cylinder", (float(form.radius), 2.0 * float(form.halfLength)))
    if word == "Capsule":
        return Shape("capsule", (float(form.radius), 2.0 * float(form.halfLength)))
    return Shape("ellipsoid", tuple(np.array(form.radii).tolist())) if word == "Ellipsoid" else None
