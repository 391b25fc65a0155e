"""What the dialects add to a URDF: loops (`loop_elements`), couplings, independence, motors, a pose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ccpin.description.loop_elements import read_loops
from ccpin.description.model import Coupling, CouplingTerm, Joint, LoopClosure
from ccpin.description.xml import (
    XmlElement,
    child,
    children,
    fail,
    label,
    number,
    numbers,
    text_attribute,
    truth,
)


class Marks(NamedTuple):
    """All a URDF's extension elements state; the fields are those of MechanismDescription."""

    closures: tuple[LoopClosure, ...]
    couplings: tuple[Coupling, ...]
    independent: tuple[str, ...] | None
    independent_is_default: bool
    dependent_hint: tuple[str, ...]
    actuated: tuple[str, ...] | None
    armature: dict[str, float]
    reference: dict[str, tuple[float, ...]]
    notes: tuple[str, ...] = ()


def spoken_of(root: XmlElement) -> set[str]:
    """The joints that motors drive or that are marked independent: those that have to stay joints."""
    driven = {j.get("name") for element in children(root, "transmission") for j in children(element, "joint")}
    return driven | {j.get("name") for j in root.iterfind("joint[@independent]") if truth(j, "independent")}


def read_marks(root: XmlElement, joints: Sequence[Joint]) -> Marks:
    """Read every extension element under the <robot> root.

    Raises:
        DescriptionError: An element is incomplete or names what does not exist.
    """
    notes: list[str] = []
    closures = read_loops(root, joints, notes)
    couplings, hints = _couplings(root, joints)
    marked = {joint.get("name"): truth(joint, "independent") for joint in root.iterfind("joint[@independent]")}
    independent = None
    if marked or couplings:
        movable = [joint.name for joint in joints if joint.kind != "fixed"]
        independent = tuple(name for name in movable if marked.get(name, True))
    actuated, armature = _motors(root, {joint.name: joint.kind for joint in joints}, notes)
    return Marks(
        closures=closures,
        couplings=tuple(couplings),
        independent=independent,
        independent_is_default=independent is not None and any(name not in marked for name in independent),
        dependent_hint=tuple(hints),
        actuated=actuated,
        armature=armature,
        reference=_reference(root),
        notes=tuple(notes),
    )


def _couplings(root: XmlElement, joints: Sequence[Joint]) -> tuple[list[Coupling], list[str]]:
    """``<coupling>``: ratio·Σ(joints of the predecessor chain) − Σ(joints of the successor chain) = 0.

    Chains are counted from the nearest common ancestor. Also returns the successors' joints: where a file
    leaves `independent` out on both sides, those are the dependent ones.
    """
    by_child = {joint.child: joint for joint in joints}
    couplings: list[Coupling] = []
    hints: list[str] = []
    for element in children(root, "coupling"):
        name, ratio = text_attribute(element, "name"), number(child(element, "ratio"), "value")
        first, second = (_chain(element, role, by_child) for role in ("predecessor", "successor"))
        drivers, driven = (
            [joint.name for joint in chain if joint not in other and joint.kind != "fixed"]
            for chain, other in ((first, second), (second, first))
        )
        terms = [CouplingTerm(joint, (0.0, ratio)) for joint in drivers]
        couplings.append(Coupling(name, (*terms, *(CouplingTerm(joint, (0.0, -1.0)) for joint in driven))))
        hints += driven
    return couplings, hints


def _chain(coupling: XmlElement, role: str, by_child: dict[str, Joint]) -> list[Joint]:
    """The joints between a coupling's link and the root."""
    link = text_attribute(child(coupling, role), "link")
    if link not in by_child and all(link != joint.parent for joint in by_child.values()):
        raise fail(coupling, f"{role} link '{link}' does not exist")
    chain: list[Joint] = []
    while link in by_child:
        joint = by_child[link]
        if joint in chain:
            raise fail(coupling, "the joints form a cycle")
        chain.append(joint)
        link = joint.parent
    return chain


def _motors(
    root: XmlElement, kinds: Mapping[str, str], notes: list[str]
) -> tuple[tuple[str, ...] | None, dict[str, float]]:
    """Motors are the joints of <transmission>s; Drake's rotor inertia is reflected by its gear ratio squared.

    A transmission left on a fixed or absent joint drives nothing; it is noted.
    """
    actuated: dict[str, None] = {}
    armature: dict[str, float] = {}
    for element in children(root, "transmission"):
        for joint in children(element, "joint"):
            name = text_attribute(joint, "name")
            if kinds.get(name, "fixed") == "fixed":
                what = "is fixed" if name in kinds else "does not exist"
                notes.append(f"the {label(element)} is left out, since joint '{name}' {what}")
                continue
            actuated[name] = None
            for actuator in children(element, "actuator"):
                rotor = next(children(actuator, "rotor_inertia"), None)
                gear = next(children(actuator, "gear_ratio"), None)
                ratio = 1.0 if gear is None else number(gear, "value")
                if rotor is not None:
                    armature[name] = armature.get(name, 0.0) + ratio**2 * number(rotor, "value")
    return tuple(actuated) or None, armature


def _reference(root: XmlElement) -> dict[str, tuple[float, ...]]:
    """``<group_state name="reference">`` (SRDF's element) with ``<joint name value>`` children."""
    return {
        text_attribute(joint, "name"): numbers(joint, "value", None)
        for state in children(root, "group_state")
        if state.get("name") == "reference"
        for joint in children(state, "joint")
    }
