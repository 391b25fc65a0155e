"""What must hold of any description, whatever its format: a tree, physical inertias, references that exist."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from ccpin.description.closure_kinds import CLOSURE_KINDS
from ccpin.description.joint_kinds import FIXED, JOINT_KINDS, split_component
from ccpin.description.model import (
    Coupling,
    Inertia,
    Joint,
    Link,
    LoopClosure,
    MechanismDescription,
    Motor,
    skewness,
)
from ccpin.description.names import hint
from ccpin.errors import DescriptionError

MAGNITUDE_LIMIT = 1e9  # m, kg, kg m²: a larger number is taken for an error of the file
FORCE_LIMIT = 1e15  # of armature, damping, friction and stiffness: some hold a joint by one of them
_NAMED = 8  # names in a message
_RECORDS = {"links": Link, "joints": Joint, "closures": LoopClosure, "couplings": Coupling, "motors": Motor}


def check(description: MechanismDescription) -> MechanismDescription:
    """Return the description if it is sound, with a note for what is doubtful but usable.

    Inertia matrices that violate the triangle inequality are common in published files and leave the equations
    of motion well defined; they are noted. A negative principal moment is refused.

    Raises:
        DescriptionError: Duplicate or unknown names, a second root, a cycle, a zero axis, negative mass or
            principal moment, a closure between a link and itself, a coupling of joints without a displacement.
    """
    checker = _Checker(description)
    checker.run()
    return replace(description, notes=description.notes + tuple(checker.notes))


def principal_moments(inertia: Inertia) -> np.ndarray:
    """The principal moments about the centre of mass, kg m², smallest first."""
    return np.asarray(np.linalg.eigvalsh(0.5 * (inertia.rotational + inertia.rotational.T)))


def _slack(moments: np.ndarray) -> float:
    return 1e-6 * max(float(np.max(np.abs(moments))), 1e-12)


def of_no_body(element: str, inertia: Inertia) -> str | None:
    """A sentence where no distribution of mass has these moments: of mass 0, or against the triangle inequality."""
    moments = principal_moments(inertia)
    if inertia.mass == 0.0 and moments[2] > _slack(moments):
        return f"{element}: no body without mass has moments of inertia (the largest is {moments[2]:.6g} kg m²)"
    if moments[0] + moments[1] >= moments[2] - _slack(moments):
        return None
    return (
        f"{element}: no body has the principal moments {', '.join(f'{m:.6g}' for m in moments)} kg m² "
        "(the largest exceeds the sum of the other two); they are used as stated"
    )


class _Checker:
    """Runs the checks of one description; each method states one law."""

    def __init__(self, description: MechanismDescription) -> None:
        self.d = description
        self.notes: list[str] = []

    def fail(self, element: str, message: str) -> DescriptionError:
        return DescriptionError(message, source=self.d.source, element=element)

    def run(self) -> None:
        self.records_are_records()
        self.names_are_unique()
        self.joints_form_a_tree()
        for link in self.d.links:
            if link.inertia is not None:
                self.inertia_is_physical(f"link '{link.name}'", link.inertia)
        self.something_has_mass()
        self.joints_are_sound()
        self.components_are_distinct()
        self.closures_are_sound()
        self.couplings_are_sound()
        self.marks_are_sound()
        self.motors_are_sound()

    def records_are_records(self) -> None:
        for field, kind in _RECORDS.items():
            for place, thing in enumerate(getattr(self.d, field)):
                if not isinstance(thing, kind):
                    message = f"must be a {kind.__name__}, not {type(thing).__name__}"
                    raise self.fail(f"{field}[{place}]", message)
        self.links = {link.name for link in self.d.links}
        self.joints = {joint.name: joint for joint in self.d.joints}

    def names_are_unique(self) -> None:
        for kind, field in (("link", "links"), ("joint", "joints"), ("loop", "closures"), ("coupling", "couplings")):
            for name, count in Counter(thing.name for thing in getattr(self.d, field)).items():
                if count > 1:
                    raise self.fail(f"{kind} '{name}'", f"the name is used {count} times; names must be unique")

    def components_are_distinct(self) -> None:
        for name in self.joints:
            joint, component = name.rpartition(":")[::2]
            owner = self.joints.get(joint)
            if owner is not None and owner.kind != FIXED and component in JOINT_KINDS[owner.kind].components:
                raise self.fail(f"joint '{name}'", f"is also the name of a component of joint '{joint}'")

    def joints_form_a_tree(self) -> None:
        parent_of: dict[str, str] = {}
        for joint in self.d.joints:
            element = f"joint '{joint.name}'"
            for role, link in (("parent", joint.parent), ("child", joint.child)):
                if link not in self.links:
                    raise self.fail(element, f"{role} link '{link}' does not exist{hint(link, self.links)}")
            if joint.parent == joint.child:
                raise self.fail(element, f"link '{joint.child}' is its own parent")
            if joint.child in parent_of:
                message = f"link '{joint.child}' has two parents; cut the tree open and state the loop as a closure"
                raise self.fail(element, message)
            parent_of[joint.child] = joint.parent
        roots = sorted(self.links - set(parent_of))
        if len(roots) > 1:
            named = ", ".join(roots[:_NAMED]) + ", …" * (len(roots) > _NAMED)
            raise self.fail(f"link '{roots[1]}'", f"a second root: links {named} have no parent joint")
        rooted = set(roots)
        for link in self.links:
            way: set[str] = set()
            while link not in rooted:
                if link in way:
                    raise self.fail(f"link '{link}'", "the joints form a cycle; cut it and state the loop as a closure")
                way.add(link)
                link = parent_of[link]
            rooted |= way

    def something_has_mass(self) -> None:
        if all(link.inertia is None for link in self.d.links):
            self.notes.append("no link states an inertia: nothing has mass, so there is no dynamics, only kinematics")

    def inertia_is_physical(self, element: str, inertia: Inertia) -> None:
        if inertia.com.shape != (3,) or inertia.rotational.shape != (3, 3):
            raise self.fail(element, "the centre of mass must have shape (3,), the rotational inertia shape (3, 3)")
        values = np.concatenate([[inertia.mass], inertia.com, inertia.rotational.ravel()])
        if not np.all(np.isfinite(values)) or np.max(np.abs(values)) > MAGNITUDE_LIMIT:
            raise self.fail(element, "mass, centre of mass or inertia is not a finite number of sensible size")
        if inertia.mass < 0:
            raise self.fail(element, f"mass {inertia.mass:g} kg is negative")
        skewed = float(np.abs(inertia.rotational - inertia.rotational.T).max())
        if skewed > 1e-6 * float(np.abs(inertia.rotational).max()):
            raise self.fail(element, f"the inertia matrix is not symmetric: entries differ by {skewed:g} kg m²")
        moments = principal_moments(inertia)
        if moments[0] < -_slack(moments):
            raise self.fail(element, f"the inertia matrix has the negative principal moment {moments[0]:g} kg m²")
        if (doubt := of_no_body(element, inertia)) is not None:
            self.notes.append(doubt)

    def joints_are_sound(self) -> None:
        for joint in self.d.joints:
            element = f"joint '{joint.name}'"
            if joint.kind not in (*JOINT_KINDS, FIXED):
                raise self.fail(element, f"type '{joint.kind}' is not one of {', '.join((*JOINT_KINDS, FIXED))}")
            if joint.axis.shape != (3,) or not abs(np.linalg.norm(joint.axis) - 1) < 1e-9:
                raise self.fail(element, "the axis is the zero vector or not of unit length in space")
            self.placement_is_rigid(element, joint.placement)
            if not joint.lower <= joint.upper:
                raise self.fail(element, f"lower limit {joint.lower:g} exceeds upper limit {joint.upper:g}")
            self.physics_is_sound(element, joint)

    def physics_is_sound(self, element: str, joint: Joint) -> None:
        words = {"armature": "reflected rotor inertia", "damping": "damping", "friction": "friction"}
        for field, word in (words | {"stiffness": "stiffness"}).items():
            value = getattr(joint, field)
            if not 0 <= value < FORCE_LIMIT:
                raise self.fail(element, f"{word} {value:g} is negative, or not below {FORCE_LIMIT:g}")
        self.friction_is_sound(element, joint)
        for field in ("effort", "velocity"):
            if not getattr(joint, field) >= 0:
                raise self.fail(
                    element, f"the limit of {field}, {getattr(joint, field):g}, is negative or not a number"
                )
        self.is_sensible(element, (joint.spring_reference,), "the spring's reference")
        if not joint.stiffness:
            return
        kind = JOINT_KINDS.get(joint.kind)
        if kind is None or not kind.springs:
            known = ", ".join(name for name, entry in JOINT_KINDS.items() if entry.springs)
            raise self.fail(element, f"is {joint.kind}: a spring needs a joint of kind {known}")
        if kind.unit and joint.spring_reference:
            raise self.fail(
                element, f"the spring of a {joint.kind} joint pulls to its zero; it has no spring_reference"
            )

    def friction_is_sound(self, element: str, joint: Joint) -> None:
        if not (joint.breakaway == 0.0 or joint.friction <= joint.breakaway < FORCE_LIMIT):
            raise self.fail(
                element, f"breakaway {joint.breakaway:g} is below friction {joint.friction:g}, or too large"
            )
        if not 0.0 <= joint.stribeck_speed < FORCE_LIMIT:
            raise self.fail(
                element, f"stribeck_speed {joint.stribeck_speed:g} is negative, or not below {FORCE_LIMIT:g}"
            )
        if joint.breakaway > joint.friction and not joint.stribeck_speed:
            raise self.fail(
                element, f"breakaway {joint.breakaway:g} above friction {joint.friction:g} needs a stribeck_speed"
            )

    def placement_is_rigid(self, element: str, placement: np.ndarray) -> None:
        if placement.shape != (4, 4):
            raise self.fail(element, f"the placement has shape {placement.shape}; it must be (4, 4)")
        if not np.all(np.isfinite(placement)) or np.max(np.abs(placement)) > MAGNITUDE_LIMIT:
            raise self.fail(element, "the placement is not finite or too large")
        if skewness(placement[:3, :3].T) > 1e-9:
            raise self.fail(element, "the placement's rotation is not a rotation matrix")

    def closures_are_sound(self) -> None:
        for closure in self.d.closures:
            element = f"loop '{closure.name}'"
            if closure.kind not in CLOSURE_KINDS:
                raise self.fail(element, f"type '{closure.kind}' is not one of {', '.join(CLOSURE_KINDS)}")
            for link, _ in closure.ends:
                if link not in self.links:
                    raise self.fail(element, f"link '{link}' does not exist{hint(link, self.links)}")
            if closure.link_a == closure.link_b:
                raise self.fail(element, f"joins link '{closure.link_a}' to itself")
            self.placement_is_rigid(element, closure.placement_a)
            self.placement_is_rigid(element, closure.placement_b)
            if closure.kind == "distance" and not (closure.length is not None and 0 < closure.length < MAGNITUDE_LIMIT):
                raise self.fail(element, "a distance closure needs a positive length")

    def couplings_are_sound(self) -> None:
        for coupling in self.d.couplings:
            element = f"coupling '{coupling.name}'"
            if not coupling.terms:
                raise self.fail(element, "couples no joint")
            for term in coupling.terms:
                joint = f"joint '{term.joint}'"
                if term.joint not in self.joints:
                    raise self.fail(element, f"{joint} does not exist")
                kind = self.joints[term.joint].kind
                one_dof = [name for name, entry in JOINT_KINDS.items() if entry.nv == 1]
                if kind not in one_dof:
                    raise self.fail(element, f"{joint} is {kind}; only {', '.join(one_dof)} can be coupled")
                self.is_sensible(element, (*term.coefficients, term.reference), f"a coefficient of {joint}")
            if not any(c != 0 for term in coupling.terms for c in term.coefficients[1:]):
                raise self.fail(element, "every coefficient is zero")

    def marks_are_sound(self) -> None:
        movable = [joint.name for joint in self.d.joints if joint.kind != FIXED]
        for role, names in (("independent", self.d.independent), ("actuated", self.d.actuated)):
            for name in names or ():
                if split_component(name, self.joints)[0] not in self.joints:
                    raise self.fail(f"joint '{name}'", f"is marked {role} but does not exist{hint(name, movable)}")
        for pose in (self.d.reference, *self.d.poses.values()):
            for name, values in pose.items():
                if name not in self.joints:
                    raise self.fail(f"joint '{name}'", f"has a reference value but does not exist{hint(name, movable)}")
                self.is_sensible(f"joint '{name}'", values, "the reference value")

    def motors_are_sound(self) -> None:
        for motor in self.d.motors:
            element = f"motor '{motor.name}'"
            if motor.joint not in self.joints:
                raise self.fail(element, f"drives joint '{motor.joint}', which does not exist")
            if not 0 < abs(motor.gear) < MAGNITUDE_LIMIT:
                raise self.fail(element, f"gear {motor.gear:g} is zero, or not below {MAGNITUDE_LIMIT:g} in size")
            if not motor.lower <= motor.upper:
                raise self.fail(element, f"its lower bound {motor.lower:g} exceeds its upper bound {motor.upper:g}")
        for joint, count in Counter(motor.joint for motor in self.d.motors).items():
            if count > 1:
                raise self.fail(f"joint '{joint}'", f"has {count} motors; put them together as one")

    def is_sensible(self, element: str, values: Iterable[float], what: str) -> None:
        if not all(abs(value) < MAGNITUDE_LIMIT for value in values):
            raise self.fail(element, f"{what} is not finite or not below {MAGNITUDE_LIMIT:g}")
