"""What the dialects add to a URDF: loops (`loop_elements`), couplings, independence, a pose."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ccpin.description.elements.joint_tree import JointTree
from ccpin.description.elements.xml import XmlElement, child, children, fail, number, numbers, text_attribute, truth
from ccpin.description.model import Coupling, CouplingTerm, Joint, LoopClosure
from ccpin.description.names import hint
from ccpin.description.urdf.loop_elements import read_loops

_MOST_TERMS = 1_000_000  # joints over all couplings: bounds time and memory


class Marks(NamedTuple):
    """All a URDF's extension elements state; the fields are those of MechanismDescription."""

    closures: tuple[LoopClosure, ...]
    couplings: tuple[Coupling, ...]
    independent: tuple[str, ...] | None
    independent_is_default: bool
    dependent_hint: tuple[str, ...]
    reference: dict[str, tuple[float, ...]]
    poses: dict[str, dict[str, tuple[float, ...]]]
    gravity: tuple[float, float, float]
    notes: tuple[str, ...] = ()


def marked_independent(root: XmlElement) -> set[str]:
    """The joints the file marks as independent."""
    return {str(joint.get("name")) for joint in root.iterfind("joint[@independent]") if truth(joint, "independent")}


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
    return Marks(
        closures=closures,
        couplings=tuple(couplings),
        independent=independent,
        independent_is_default=independent is not None and any(name not in marked for name in independent),
        dependent_hint=tuple(hints),
        reference=_reference(root),
        gravity=_gravity(root),
        poses=_poses(root, {joint.name for joint in joints if joint.kind != "fixed"}),
        notes=tuple(notes),
    )


def _couplings(root: XmlElement, joints: Sequence[Joint]) -> tuple[list[Coupling], list[str]]:
    """``<coupling>``: ratio·Σ(joints of the predecessor chain) − Σ(joints of the successor chain) = 0.

    Chains are counted from the nearest common ancestor. Also returns the successors' joints: where a file
    leaves `independent` out on both sides, those are the dependent ones.
    """
    tree, count = JointTree(joints), 0
    couplings: list[Coupling] = []
    hints: list[str] = []
    for element in children(root, "coupling"):
        name, ratio = text_attribute(element, "name"), number(child(element, "ratio"), "value")
        ends = [text_attribute(child(element, role), "link") for role in ("predecessor", "successor")]
        for role, link in zip(("predecessor", "successor"), ends, strict=True):
            if link not in tree.links:
                raise fail(element, f"{role} link '{link}' does not exist{hint(link, tree.links)}")
        between = list(tree.moving_between(*ends))
        drivers, driven = ([joint.name for joint, side in between if side == wanted] for wanted in (1.0, -1.0))
        count += len(between)
        if count > _MOST_TERMS:
            raise fail(element, f"the couplings up to this one join more than {_MOST_TERMS} joints")
        terms = [CouplingTerm(joint, (0.0, ratio)) for joint in drivers]
        couplings.append(Coupling(name, (*terms, *(CouplingTerm(joint, (0.0, -1.0)) for joint in driven))))
        hints += driven
    return couplings, hints


def _gravity(root: XmlElement) -> tuple[float, float, float]:
    """``<gravity xyz>``, ccpin's own word, m/s² in the root link's axes."""
    stated = next(children(root, "gravity"), None)
    x, y, z = (0.0, 0.0, -9.81) if stated is None else numbers(stated, "xyz", 3)
    return x, y, z


def _reference(root: XmlElement) -> dict[str, tuple[float, ...]]:
    """``<group_state name="reference">`` (SRDF's element) with ``<joint name value>`` children."""
    return {
        text_attribute(joint, "name"): numbers(joint, "value", None)
        for state in children(root, "group_state")
        if state.get("name") == "reference"
        for joint in children(state, "joint")
    }


def _poses(root: XmlElement, movable: set[str]) -> dict[str, dict[str, tuple[float, ...]]]:
    """The other named ``<group_state>``s; joints that are fixed or of another robot are left out of them."""
    poses: dict[str, dict[str, tuple[float, ...]]] = {}
    for state in children(root, "group_state"):
        name = state.get("name")
        if name and name != "reference":
            stated = {text_attribute(joint, "name"): joint for joint in children(state, "joint")}
            poses.setdefault(name, {}).update(
                {joint: numbers(element, "value", None) for joint, element in stated.items() if joint in movable}
            )
    return poses
