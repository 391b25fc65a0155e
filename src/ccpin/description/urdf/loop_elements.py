"""The elements by which URDF dialects close loops, each as a closure.

=============================  ===========================================================================
URDF+                          ``<loop>`` with predecessor, successor, axis, axis2, length
Isaac Sim                      ``<loop_joint>`` with link1 and link2 (or link1 twice, as its manual has it)
Fusion exporters               ``<loop_joint>`` with parent, child, parent_origin, child_origin, axis
Drake                          ``<drake:ball_constraint>``, ``<drake:distance_constraint>``
proposed for urdfdom           ``<constraint>`` with parent, child and an origin and axis for each
=============================  ===========================================================================
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

from ccpin.arrays import Array
from ccpin.description.closure_kinds import CLOSURE_KINDS
from ccpin.description.elements.graph import Z_TO_X, Z_TO_Y, zero_poses
from ccpin.description.elements.xml import (
    ZERO,
    XmlElement,
    child,
    children,
    fail,
    number,
    numbers,
    origin,
    spelt,
    strange_attributes,
    tag,
    text_attribute,
    unit_vector,
    unread,
)
from ccpin.description.model import IDENTITY, X_AXIS, Joint, LoopClosure, frame, frame_from_rpy, inverse, rotation_to
from ccpin.description.names import hint
from ccpin.errors import DescriptionError

# What URDF+ and Isaac Sim call closure kinds beside ccpin's own names.
SYNONYMS = {"ball": "spherical", "continuous": "revolute", "hinge": "revolute", "weld": "fixed"}
# Every child element of a loop element, and every attribute of those.
_ENDS = ("parent", "child", "parent_origin", "child_origin")
_PARTS: dict[str, tuple[str, ...]] = {
    "loop": ("predecessor", "successor", "axis", "axis2", "length"),
    "loop_joint": ("link1", "link2", "axis", "length", *_ENDS),
    "constraint": (*_ENDS, "parent_axis", "child_axis", "length"),
    "ball_constraint": tuple(f"ball_constraint_{part}" for part in ("body_A", "body_B", "p_AP", "p_BQ")),
    "distance_constraint": tuple(
        f"distance_constraint_{part}"
        for part in ("body_A", "body_B", "p_AP", "p_BQ", "distance", "stiffness", "damping")
    ),
}
_ATTRIBUTES = ("name", "type", "link", "xyz", "rpy", "value", "frame")


def read_loops(root: XmlElement, joints: Sequence[Joint], notes: list[str]) -> tuple[LoopClosure, ...]:
    """The closures of every loop element under the <robot> root.

    Raises:
        DescriptionError: An element is incomplete, misspelt or names what does not exist.
    """
    for element in root.iterchildren("*"):
        spelt(element, tag(element), READERS)
    tree, closures = _ZeroPoses(joints), list[LoopClosure]()
    for position, element in enumerate(children(root, *READERS), start=1):
        strangers = unread(element, _PARTS[tag(element)])
        closures.append(READERS[tag(element)](element, position, tree))
        notes += [f"loop '{closures[-1].name}': <{stranger}> is not read" for stranger in strangers]
        for part in element.iter("*"):
            unknown = strange_attributes(part, _ATTRIBUTES)
            notes += [f"loop '{closures[-1].name}': {name} of <{tag(part)}> is not read" for name in unknown]
        if _has(element, "distance_constraint_stiffness", "distance_constraint_damping"):
            notes.append(f"loop '{closures[-1].name}': its stiffness and damping are left out: it is rigid here")
    return tuple(closures)


class _ZeroPoses:
    """The zero poses of the links, worked out where an element needs them."""

    def __init__(self, joints: Sequence[Joint]) -> None:
        self._joints = joints

    @cached_property
    def _poses(self) -> Mapping[str, Array]:
        below = {joint.child for joint in self._joints}
        root = next((joint.parent for joint in self._joints if joint.parent not in below), "")
        return zero_poses(root, self._joints)

    def between(self, first: str, second: str, element: XmlElement) -> Array:
        """The frame (4, 4) of the second link in the first's, at zero displacement."""
        for link in (first, second):
            if link not in self._poses:
                raise fail(element, f"link '{link}' does not exist{hint(link, self._poses)}")
        return inverse(self._poses[first]) @ self._poses[second]


def _urdf_plus(element: XmlElement, _: int, __: _ZeroPoses) -> LoopClosure:
    """``<predecessor link><origin xyz rpy/></predecessor>``, a successor likewise, axes in the origins' frames."""
    ends = child(element, "predecessor"), child(element, "successor")
    kind = closure_kind(text_attribute(element, "type"), element)
    if kind in ("revolute", "prismatic", "cylindrical", "planar") and not _has(element, "axis"):
        raise fail(element, f"a {kind} loop needs an <axis>")
    return _closure(element, kind, ends, [origin(next(children(end, "origin"), None)) for end in ends])


def _loop_joint(element: XmlElement, _: int, tree: _ZeroPoses) -> LoopClosure:
    """``<link1 link xyz rpy/>`` and link2 (the manual of Isaac Sim writes link1 twice), or parent and child."""
    kind = closure_kind(text_attribute(element, "type"), element)
    if _has(element, "parent", "child"):
        return _by_origins(element, kind, tree)
    ends = [*children(element, "link1"), *children(element, "link2")]
    if len(ends) != 2:
        raise fail(element, f"<link1> and <link2> are needed, and there are {len(ends)} of them")
    return _closure(element, kind, ends, [origin(end) for end in ends])


def _closure(element: XmlElement, kind: str, ends: Sequence[XmlElement], frames: Sequence[Array]) -> LoopClosure:
    """A closure whose axes are stated once, for both frames."""
    a, b = frames
    axis = next(children(element, "axis"), None)
    if kind == "universal" and (axis is not None or tag(element) == "loop"):
        a = _turned(a, rotation_to(unit_vector(child(element, "axis"), "xyz")) @ Z_TO_X)
        b = _turned(b, rotation_to(unit_vector(child(element, "axis2"), "xyz")) @ Z_TO_Y)
    elif axis is not None:
        turn = rotation_to(unit_vector(axis, "xyz"))
        a, b = _turned(a, turn), _turned(b, turn)
    return _named(element, kind, ends, a, b)


def _by_origins(element: XmlElement, kind: str, tree: _ZeroPoses) -> LoopClosure:
    """Parent and child with an origin each; the axis is stated in the joint's frame, or in the parent link's.

    A child_origin that states no rotation takes the parent's, as the links stand at zero displacement.
    """
    roles = [child(element, role) for role in ("parent", "child")]
    first, second = (next(children(element, f"{role}_origin"), None) for role in ("parent", "child"))
    a, b = origin(first), origin(second)
    if second is None or second.get("rpy") is None:
        parent, follower = (text_attribute(role, "link") for role in roles)
        b = frame(b[:3, 3], tree.between(follower, parent, element)[:3, :3] @ a[:3, :3])
    axis = next(children(element, "axis"), None)
    if axis is not None:
        along = unit_vector(axis, "xyz")
        within = a[:3, :3].T @ along if axis.get("frame") == "parent" else along
        a, b = (_turned(end, rotation_to(within)) for end in (a, b))
    return _named(element, kind, roles, a, b)


def _constraint(element: XmlElement, _: int, __: _ZeroPoses) -> LoopClosure:
    """urdfdom's proposal: an origin and an axis (default x, as a URDF joint's) for parent and child each."""
    kind = closure_kind(text_attribute(element, "type"), element)
    ends = []
    for role, across in (("parent", Z_TO_X), ("child", Z_TO_Y)):
        said = next(children(element, f"{role}_axis"), None)
        axis = X_AXIS if said is None else unit_vector(said, "xyz")
        turn = rotation_to(axis) @ across if kind == "universal" else rotation_to(axis)
        ends.append(_turned(origin(next(children(element, f"{role}_origin"), None)), turn))
    return _named(element, kind, [child(element, role) for role in ("parent", "child")], *ends)


def _has(element: XmlElement, *names: str) -> bool:
    return next(children(element, *names), None) is not None


def _named(element: XmlElement, kind: str, ends: Sequence[XmlElement], a: Array, b: Array) -> LoopClosure:
    """The closure of an element with its name and length, between the links its ends name."""
    link_a, link_b = (text_attribute(end, "link") for end in ends)
    length = number(child(element, "length"), "value") if kind == "distance" else None
    return LoopClosure(text_attribute(element, "name"), kind, link_a, link_b, a, b, length)


def _turned(placement: Array, rotation: Array) -> Array:
    return frame(placement[:3, 3], placement[:3, :3] @ rotation)


def _drake_constraint(element: XmlElement, position: int, _: _ZeroPoses) -> LoopClosure:
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
    return link, IDENTITY if found is None else frame_from_rpy(numbers(found, "value", 3), ZERO)


READERS: dict[str, Callable[[XmlElement, int, _ZeroPoses], LoopClosure]] = {
    "loop": _urdf_plus,
    "loop_joint": _loop_joint,
    "constraint": _constraint,
    "ball_constraint": _drake_constraint,
    "distance_constraint": _drake_constraint,
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
