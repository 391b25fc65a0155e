"""Constants of a mechanism that programs take exactly, and those of them that are inputs: named parameters.

A parameter is `"gravity"` (m/s², along its direction), `"mass:LINK"` (kg; the link's rotational inertia goes with it,
its centre of mass stays), `"length:JOINT"` (m, from the frame of the joint before along the joint's placement; what is
mounted farther out moves along), `"length:CLOSURE/A"` or `/B` (the same of a closure's frame on its body),
`"origin:JOINT/x"` (`/y`, `/z`; m, a coordinate of its frame's origin on the parent link), `"origin:CLOSURE/A/x"` and
`/B/x` (of a closure's frame on its link), `"turn:JOINT/x"` and `"turn:CLOSURE/A/x"` (rad; a turn of that frame about
its origin and the link's axes, x first, then y, z; 0 in the model), `"distance:CLOSURE"` (m, of one of that kind),
`"ratio:COUPLING/JOINT"` (the coefficient of the joint's displacement), and `"damping:JOINT"`, `"armature:JOINT"`,
`"stiffness:JOINT"`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ccpin.description.model import Joint
from ccpin.description.names import choices
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import InvalidInputError
from ccpin.kinematics.loops import ResolvedClosure
from ccpin.programs.recording.recorded_tree import ExactJoint, Table, exact, exact_placement, rational, turn_about
from ccpin.programs.tape import Expression, Tape

_UNITS = {
    "gravity": "m/s²", "mass": "kg", "length": "m", "origin": "m", "turn": "rad", "distance": "m", "ratio": "1",
    "damping": "N m s/rad or N s/m", "armature": "kg m² or kg", "stiffness": "N m/rad or N/m",
}  # fmt: skip
GEOMETRY = ("origin", "turn", "distance", "ratio")  # what closures are made of, each number by itself


class Parameter(NamedTuple):
    """One constant that is an input.

    Attributes:
        name: As it is called. kind, of: Its parts.
        value: The model's own.
        unit: Its unit.
    """

    name: str
    kind: str
    of: str
    value: float
    unit: str


class MassOfBody(NamedTuple):
    """Mass, centre of mass (3,) and inertia (3, 3) about it, in its joint's frame."""

    mass: Expression
    lever: Table
    inertia: Table


def parameters_of(model: ReducedModel, names: Sequence[str]) -> tuple[Parameter, ...]:
    """The parameters of those names.

    Raises:
        InvalidInputError: There is no such parameter, it is named twice, or is of a size that says no direction.
    """
    found = tuple(_parameter(model, name) for name in names)
    if len(set(names)) != len(found):
        raise InvalidInputError(f"a parameter is named twice: {', '.join(names)}")
    return found


def geometry_of(model: ReducedModel) -> tuple[Parameter, ...]:
    """All numbers that closures are made of, joints' origins first."""
    found = ((kind, of, value) for kind in GEOMETRY for of, value in _values(model, kind).items())
    return tuple(Parameter(f"{kind}:{of}", kind, of, value, _UNITS[kind]) for kind, of, value in found)


def _parameter(model: ReducedModel, name: str) -> Parameter:
    kind, _, of = name.partition(":")
    if kind not in _UNITS or (kind == "gravity") != (not of):
        raise InvalidInputError(f"'{name}' is no parameter: {', '.join(_UNITS)}, with ':' and a name after all but it")
    value = _values(model, kind).get(of)
    if value is None:
        raise InvalidInputError(f"'{name}': there is no '{of}'; {choices(of, tuple(_values(model, kind)))}")
    if kind in ("gravity", "mass", "length") and not value > 0.0:
        raise InvalidInputError(f"'{name}' is {value:g} in the model: a factor of it says nothing")
    return Parameter(name, kind, of, value, _UNITS[kind])


def _values(model: ReducedModel, kind: str) -> dict[str, float]:
    """The constants of a kind by what they are of."""
    tree, description = model.mechanism.tree, model.mechanism.description
    if kind == "gravity":
        return {"": float(np.linalg.norm(model.gravity_vector))}
    if kind == "mass":
        return {link.name: 0.0 if link.inertia is None else link.inertia.mass for link in description.links}
    if kind == "length":
        ends = {joint.name: joint.placement for joint in tree.joints}
        for loop in model.parametrization.constraints.loops:
            ends |= {f"{loop.closure.name}/A": loop.frame_a, f"{loop.closure.name}/B": loop.frame_b}
        return {name: float(np.linalg.norm(frame[:3, 3])) for name, frame in ends.items()}
    loops, couplings = model.parametrization.constraints.loops, model.parametrization.constraints.couplings
    if kind in ("origin", "turn"):
        frames = {joint.name: joint.stated.placement for joint in tree.joints if joint.stated.parent}
        for loop in loops:
            frames |= {f"{loop.closure.name}/{end}": at for end, (_, at) in zip("AB", loop.closure.ends, strict=True)}
        own = {f"{name}/{axis}": float(at[k, 3]) for name, at in frames.items() for k, axis in enumerate("xyz")}
        return own if kind == "origin" else dict.fromkeys(own, 0.0)
    if kind == "distance":
        return {loop.closure.name: loop.closure.length for loop in loops if loop.closure.length is not None}
    if kind == "ratio":
        terms = ((each.coupling.name, term) for each in couplings if not each.modulus for term in each.coupling.terms)
        return {f"{name}/{term.joint}": term.coefficients[1] for name, term in terms if len(term.coefficients) > 1}
    if kind == "armature":
        return {joint.name: float(tree.model.armature[joint.v.start]) for joint in tree.joints}
    return {joint.name: float(getattr(joint.stated, kind)) for joint in tree.joints}


class Constants:
    """What a recording takes as constants; those that are parameters are expressions of a tape's inputs.

    Args:
        model: The model.
        given: Parameters and their expressions.
    """

    def __init__(self, model: ReducedModel, given: Mapping[Parameter, Expression] | None = None) -> None:
        self._model, self._tree = model, model.mechanism.tree
        self._given = {(each.kind, each.of): (each, value) for each, value in (given or {}).items()}

    def joints(self, joints: Sequence[ExactJoint]) -> tuple[ExactJoint, ...]:
        """The joints with their placements."""
        named = zip(joints, self._tree.joints, strict=True)
        return tuple(
            joint._replace(placement=self._placed(joint.placement, known.name, known.stated.parent))
            for joint, known in named
        )

    def ends(self, loop: ResolvedClosure) -> tuple[Table, Table]:
        """The frames of a closure on its two bodies."""
        closure = loop.closure
        ends = zip("AB", (loop.frame_a, loop.frame_b), (closure.link_a, closure.link_b), strict=True)
        first, second = (
            self._placed(exact_placement(frame), f"{closure.name}/{end}", link) for end, frame, link in ends
        )
        return first, second

    def changed(self, rows: list[Expression], joints: Sequence[ExactJoint], x: Table) -> list[Expression]:
        """The rows of φ with other distances, (|gap|² − L²)/2L₀, and other ratios, c (θ − θ_ref)."""
        constraints, found = self._model.parametrization.constraints, list(rows)
        first = constraints.row_slices()
        for (kind, of), (known, value) in self._given.items():
            stated, (name, _, joint) = rational(known.value), of.partition("/")
            if kind == "distance":
                found[first[name].start] += (value * value - stated * stated) * (-1 / (2 * stated))
            elif kind == "ratio":
                coupling = next(each.coupling for each in constraints.couplings if each.coupling.name == name)
                reference = next(term.reference for term in coupling.terms if term.joint == joint)
                place = joints[self._tree.joint(joint).number - 1].x.start
                found[first[name].start] += (value - stated) * (x[place] - rational(reference))
        return found

    def gravity(self) -> Table:
        """Gravity in the world's axes."""
        vector = exact(self._model.gravity_vector)
        factor = self._factor("gravity", "")
        return vector if factor is None else vector * factor

    def damping(self, joint: ExactJoint) -> Expression:
        """Of a joint."""
        return self._of(joint, "damping", self._stated(joint).damping)

    def stiffness(self, joint: ExactJoint) -> Expression:
        """Of a joint's spring."""
        return self._of(joint, "stiffness", self._stated(joint).stiffness)

    def armature(self, joint: ExactJoint, place: int) -> Expression:
        """The rotor's inertia of an entry of q̇′."""
        return self._of(joint, "armature", self._tree.model.armature[place])

    def sprung(self, joint: ExactJoint) -> bool:
        """Whether a joint has a spring."""
        name = self._tree.joints[joint.number - 1].name
        return bool(self._stated(joint).stiffness) or ("stiffness", name) in self._given

    def body(self, tape: Tape, joint: ExactJoint) -> MassOfBody:
        """A joint's body: m, m c and the inertia about the joint's origin are linear in the masses of its links."""
        held = self._tree.model.inertias[joint.number]
        whole = MassOfBody(rational(held.mass), exact(held.lever), exact(held.inertia))
        links = self._links(joint)
        if not links:
            return whole
        if len(links) == 1 and links[0][0].mass == held.mass:
            factor = links[0][1]
            return MassOfBody(whole.mass * factor, whole.lever, whole.inertia * factor)
        mass, moment, about = whole.mass, whole.lever * whole.mass, _about_origin(whole)
        for own, factor in links:
            mass = mass + (factor - 1) * own.mass
            moment = moment + own.lever * own.mass * (factor - 1)
            about = about + _about_origin(own) * (factor - 1)
        lever = moment * tape.reciprocal(mass)
        return MassOfBody(mass, lever, about - _steiner(mass, lever))

    def _links(self, joint: ExactJoint) -> list[tuple[MassOfBody, Expression]]:
        """Links of a body whose masses are parameters, in the joint's frame, and the factors of their masses."""
        found = list[tuple[MassOfBody, Expression]]()
        for link in self._model.mechanism.description.links:
            factor, attached = self._factor("mass", link.name), self._tree.attachments[link.name]
            if factor is None or attached.joint != joint.number or link.inertia is None:
                continue
            turned, frame = exact_placement(attached.placement)[:3, :3], exact(attached.placement)
            com = turned @ exact(link.inertia.com) + frame[:3, 3]
            tensor = turned @ exact(link.inertia.rotational) @ turned.T
            found.append((MassOfBody(rational(link.inertia.mass), com, tensor), factor))
        return found

    def _stated(self, joint: ExactJoint) -> Joint:
        return self._tree.joints[joint.number - 1].stated

    def _of(self, joint: ExactJoint, kind: str, value: float) -> Expression:
        known = self._given.get((kind, self._tree.joints[joint.number - 1].name))
        return rational(value) if known is None else known[1]

    def _factor(self, kind: str, of: str) -> Expression | None:
        """What a constant is to be multiplied with, or ``None``."""
        known = self._given.get((kind, of))
        return None if known is None else known[1] * (1 / rational(known[0].value))

    def _placed(self, placement: Table, of: str, link: str) -> Table:
        """A frame of a body with another length, origin or turn, the latter along and about a link's axes."""
        factor, found = self._factor("length", of), placement.copy()
        if factor is not None:
            found[:3, 3] = found[:3, 3] * factor
        for k, axis in enumerate("xyz"):
            if ("origin", f"{of}/{axis}") in self._given:
                known, value = self._given["origin", f"{of}/{axis}"]
                turn = exact_placement(self._tree.attachments[link].placement)
                found[:3, 3] = found[:3, 3] + turn[:3, k] * (value - rational(known.value))
            if ("turn", f"{of}/{axis}") in self._given:
                angle = self._given["turn", f"{of}/{axis}"][1]
                about = exact_placement(self._tree.attachments[link].placement)[:3, k]
                found[:3, :3] = turn_about(angle.tape, about, angle) @ found[:3, :3]
        return found


def _steiner(mass: Expression, lever: Table) -> Table:
    """M (|c|² I − c cᵀ)."""
    return (np.eye(3, dtype=object) * (lever @ lever) - np.outer(lever, lever)) * mass


def _about_origin(body: MassOfBody) -> Table:
    return body.inertia + _steiner(body.mass, body.lever)
