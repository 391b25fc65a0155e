"""What the dialects add to a URDF: loops (URDF+, Isaac Sim, Drake), couplings, independence, a pose."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.description.closure_kinds import CLOSURE_KINDS
from ccpin.description.model import IDENTITY, Coupling, CouplingTerm, Joint, LoopClosure, frame, rotation_to
from ccpin.description.xml import (
    ZERO,
    XmlElement,
    child,
    children,
    fail,
    number,
    numbers,
    origin,
    tag,
    text_attribute,
    transform,
    unit_vector,
)
from ccpin.errors import DescriptionError

# What URDF+ and Isaac Sim call closure kinds beside ccpin's own names.
SYNONYMS = {"ball": "spherical", "continuous": "revolute", "hinge": "revolute", "weld": "fixed"}
Z_TO_X: Array = np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]])
Z_TO_Y: Array = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])


class Marks(NamedTuple):
    """All a URDF's extension elements state; the fields are those of MechanismDescription."""

    closures: tuple[LoopClosure, ...]
    couplings: tuple[Coupling, ...]
    independent: tuple[str, ...] | None
    independent_is_default: bool
    dependent_hint: tuple[str, ...]
    reference: dict[str, tuple[float, ...]]


def read_marks(root: XmlElement, joints: list[Joint]) -> Marks:
    """Read every extension element under the <robot> root.

    Raises:
        DescriptionError: An element is incomplete or names what does not exist.
    """
    closures = [READERS[tag(element)](element, k) for k, element in enumerate(children(root, *READERS), start=1)]
    couplings, hints = _couplings(root, joints)
    marked = {}
    for joint in root.iterfind("joint[@independent]"):
        marked[joint.get("name")] = value = joint.get("independent")
        if value not in ("true", "false"):
            raise fail(joint, f"independent='{value}' is neither true nor false")
    independent = None
    if marked or couplings:
        movable = [joint.name for joint in joints if joint.kind != "fixed"]
        independent = tuple(name for name in movable if marked.get(name, "true") == "true")
    return Marks(
        closures=tuple(closures),
        couplings=tuple(couplings),
        independent=independent,
        independent_is_default=independent is not None and any(name not in marked for name in independent),
        dependent_hint=tuple(hints),
        reference=_reference(root),
    )


def _named_loop(element: XmlElement, _: int) -> LoopClosure:
    """A loop of URDF+ or of Isaac Sim: name, type, two ends, axis, axis2, length.

    URDF+ writes ``<predecessor link><origin xyz rpy/></predecessor>`` and a successor likewise, Isaac Sim
    ``<link1 link xyz rpy/>`` and link2.
    """
    name, kind = text_attribute(element, "name"), closure_kind(text_attribute(element, "type"), element)
    urdf_plus = tag(element) == "loop"
    first, second = (
        child(element, role) for role in (("predecessor", "successor") if urdf_plus else ("link1", "link2"))
    )
    a, b = (origin(next(children(end, "origin"), None) if urdf_plus else end) for end in (first, second))
    axis = next(children(element, "axis"), None)
    if kind == "universal" and urdf_plus:
        a = _turned(a, rotation_to(unit_vector(child(element, "axis"), "xyz")) @ Z_TO_X)
        b = _turned(b, rotation_to(unit_vector(child(element, "axis2"), "xyz")) @ Z_TO_Y)
    elif axis is not None:
        turn = rotation_to(unit_vector(axis, "xyz"))
        a, b = _turned(a, turn), _turned(b, turn)
    elif urdf_plus and kind in ("revolute", "prismatic", "cylindrical", "planar"):
        raise fail(element, f"a {kind} loop needs an <axis>")
    length = number(child(element, "length"), "value") if kind == "distance" else None
    return LoopClosure(name, kind, text_attribute(first, "link"), text_attribute(second, "link"), a, b, length)


def _turned(placement: Array, rotation: Array) -> Array:
    return frame(placement[:3, 3], placement[:3, :3] @ rotation)


def _drake_constraint(element: XmlElement, position: int) -> LoopClosure:
    """Drake's ball and distance constraints, with or without their prefix; one without a name is numbered."""
    own = tag(element)
    (link_a, a), (link_b, b) = (_drake_end(element, own, *end) for end in (("A", "p_AP"), ("B", "p_BQ")))
    name = element.get("name") or own
    ball = own == "ball_constraint"
    length = None if ball else number(child(element, "distance_constraint_distance"), "value")
    kind = "spherical" if ball else "distance"
    return LoopClosure(f"{name}_{position}" if name == own else name, kind, link_a, link_b, a, b, length)


def _drake_end(element: XmlElement, own: str, side: str, point: str) -> tuple[str, Array]:
    """The body of one side and the frame at the point fixed to it."""
    link = text_attribute(child(element, f"{own}_body_{side}"), "name")
    found = next(children(element, f"{own}_{point}"), None)
    return link, IDENTITY if found is None else transform(numbers(found, "value", 3), ZERO)


READERS: dict[str, Callable[[XmlElement, int], LoopClosure]] = {
    "loop": _named_loop,
    "loop_joint": _named_loop,
    "ball_constraint": _drake_constraint,
    "distance_constraint": _drake_constraint,
}


def _couplings(root: XmlElement, joints: list[Joint]) -> tuple[list[Coupling], list[str]]:
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


def _reference(root: XmlElement) -> dict[str, tuple[float, ...]]:
    """``<group_state name="reference">`` (SRDF's element) with ``<joint name value>`` children."""
    return {
        text_attribute(joint, "name"): numbers(joint, "value", None)
        for state in children(root, "group_state")
        if state.get("name") == "reference"
        for joint in children(state, "joint")
    }


def closure_kind(name: str, element: XmlElement | None = None) -> str:
    """The closure kind a type names, with its synonyms (ball, weld, hinge).

    Raises:
        DescriptionError: It is none of them; the error blames `element`.
    """
    kind = SYNONYMS.get(name, name)
    if kind in CLOSURE_KINDS:
        return kind
    message = f"type '{name}' is not one of {', '.join((*CLOSURE_KINDS, *SYNONYMS))}"
    raise DescriptionError(message) if element is None else fail(element, message)
