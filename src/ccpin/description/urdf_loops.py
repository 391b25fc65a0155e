"""What the dialects add to a URDF: loops (URDF+, Isaac Sim, Drake), couplings, independence, motors, a pose."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, frozen
from ccpin.description.model import ClosureKind, Coupling, CouplingTerm, Joint, LoopClosure, rotation_to
from ccpin.description.xml import (
    Element,
    child,
    children,
    label,
    number,
    numbers,
    origin,
    tag,
    text_attribute,
    unit_vector,
)
from ccpin.errors import DescriptionError

# Loop types of URDF+ and Isaac Sim by the motion they leave free.
LOOP_TYPES: dict[str, ClosureKind] = {
    "spherical": "spherical",
    "ball": "spherical",
    "revolute": "revolute",
    "continuous": "revolute",
    "hinge": "revolute",
    "fixed": "fixed",
    "weld": "fixed",
    "prismatic": "prismatic",
    "cylindrical": "cylindrical",
    "universal": "universal",
    "planar": "planar",
    "distance": "distance",
}


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
    notes: tuple[str, ...]


def read_marks(root: Element, joints: list[Joint], source: str | None) -> Marks:
    """Read every extension element under the <robot> root.

    Raises:
        DescriptionError: An element is incomplete or names what does not exist.
    """
    closures: list[LoopClosure] = []
    readers: dict[str, Callable[[Element, str | None], LoopClosure]] = {
        "loop": _urdf_plus_loop,
        "loop_joint": _isaac_loop,
        "ball_constraint": _drake_ball,
        "distance_constraint": _drake_distance,
    }
    for element in root:
        if tag(element) in readers:
            closures.append(readers[tag(element)](element, source))
    closures = _with_unique_names(closures)
    couplings, hints = _couplings(root, joints, source)
    movable = [j.name for j in joints if j.kind != "fixed"]
    marked = {j.get("name"): j.get("independent") for j in root.findall("joint") if j.get("independent") is not None}
    for name, value in marked.items():
        if value not in ("true", "false"):
            raise DescriptionError(
                f"independent='{value}' is neither true nor false", source=source, element=f"joint '{name}'"
            )
    independent = None
    if marked or couplings:
        independent = tuple(name for name in movable if marked.get(name, "true") == "true")
    actuated, armature = _motors(root, joints, source)
    return Marks(
        closures=tuple(closures),
        couplings=tuple(couplings),
        independent=independent,
        independent_is_default=independent is not None and any(name not in marked for name in independent),
        dependent_hint=tuple(hints),
        actuated=actuated,
        armature=armature,
        reference=_reference(root, source),
        notes=(),
    )


def _turned(placement: Array, rotation: Array) -> Array:
    turned = np.array(placement)
    turned[:3, :3] = placement[:3, :3] @ rotation
    return frozen(turned)


def _loop_kind(element: Element, source: str | None) -> ClosureKind:
    return closure_kind(text_attribute(element, "type", source), source, label(element))


def _urdf_plus_loop(element: Element, source: str | None) -> LoopClosure:
    """``<loop name type>`` with predecessor and successor (link and origin), axis, axis2, length."""
    name, kind = text_attribute(element, "name", source), _loop_kind(element, source)
    ends = []
    for role in ("predecessor", "successor"):
        end = child(element, role, source)
        ends.append((text_attribute(end, "link", source), origin(next(children(end, "origin"), None), source)))
    (link_a, placement_a), (link_b, placement_b) = ends
    axis = next(children(element, "axis"), None)
    if kind == "universal":
        placement_a, placement_b = _universal_frames(element, placement_a, placement_b, source)
    elif axis is not None:
        turn = rotation_to(unit_vector(axis, "xyz", source))
        placement_a, placement_b = _turned(placement_a, turn), _turned(placement_b, turn)
    elif kind in ("revolute", "prismatic", "cylindrical", "planar"):
        raise DescriptionError(f"a {kind} loop needs an <axis>", source=source, element=label(element))
    length = number(child(element, "length", source), "value", source) if kind == "distance" else None
    return LoopClosure(name, kind, link_a, link_b, placement_a, placement_b, length)


def _universal_frames(element: Element, a: Array, b: Array, source: str | None) -> tuple[Array, Array]:
    """Turn frame A so that its x axis is <axis> and frame B so that its y axis is <axis2>."""
    first = unit_vector(child(element, "axis", source), "xyz", source)
    second = unit_vector(child(element, "axis2", source), "xyz", source)
    z_to_x = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    z_to_y = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    return _turned(a, rotation_to(first) @ z_to_x), _turned(b, rotation_to(second) @ z_to_y)


def _isaac_loop(element: Element, source: str | None) -> LoopClosure:
    """``<loop_joint name type><link1 link xyz rpy/><link2 link xyz rpy/></loop_joint>`` of Isaac Sim."""
    name, kind = text_attribute(element, "name", source), _loop_kind(element, source)
    first, second = child(element, "link1", source), child(element, "link2", source)
    placement_a, placement_b = origin(first, source), origin(second, source)
    axis = next(children(element, "axis"), None)
    if axis is not None:
        turn = rotation_to(unit_vector(axis, "xyz", source))
        placement_a, placement_b = _turned(placement_a, turn), _turned(placement_b, turn)
    length = number(child(element, "length", source), "value", source) if kind == "distance" else None
    return LoopClosure(
        name,
        kind,
        text_attribute(first, "link", source),
        text_attribute(second, "link", source),
        placement_a,
        placement_b,
        length,
    )


def _drake_ends(element: Element, source: str | None) -> tuple[str, str, Array, Array]:
    """The bodies and points of a Drake constraint, in either of its spellings."""
    kind = tag(element)
    links, points = [], []
    for side, point_name in (("A", "p_AP"), ("B", "p_BQ")):
        body = child(element, f"{kind}_body_{side}", source)
        links.append(text_attribute(body, "name", source))
        point = next(children(element, f"{kind}_{point_name}"), None)
        placement = np.eye(4)
        if point is not None:
            placement[:3, 3] = numbers(point, "value", 3, source)
        points.append(frozen(placement))
    return links[0], links[1], points[0], points[1]


def _drake_ball(element: Element, source: str | None) -> LoopClosure:
    link_a, link_b, placement_a, placement_b = _drake_ends(element, source)
    return LoopClosure(element.get("name") or "ball_constraint", "spherical", link_a, link_b, placement_a, placement_b)


def _drake_distance(element: Element, source: str | None) -> LoopClosure:
    link_a, link_b, placement_a, placement_b = _drake_ends(element, source)
    length = number(child(element, "distance_constraint_distance", source), "value", source)
    name = element.get("name") or "distance_constraint"
    return LoopClosure(name, "distance", link_a, link_b, placement_a, placement_b, length)


def _with_unique_names(closures: list[LoopClosure]) -> list[LoopClosure]:
    """Number the closures of formats that do not name them (names an author gave stay as they are)."""
    anonymous = ("ball_constraint", "distance_constraint")
    return [
        LoopClosure(f"{c.name}_{i}", c.kind, c.link_a, c.link_b, c.placement_a, c.placement_b, c.length)
        if c.name in anonymous
        else c
        for i, c in enumerate(closures, start=1)
    ]


def _couplings(root: Element, joints: list[Joint], source: str | None) -> tuple[list[Coupling], list[str]]:
    """``<coupling>``: ratio·Σ(joints of the predecessor chain) − Σ(joints of the successor chain) = 0.

    Chains are counted from the nearest common ancestor. Also returns the successors' joints: where a file
    leaves `independent` out on both sides, those are the dependent ones.
    """
    by_child = {joint.child: joint for joint in joints}
    links = {joint.child for joint in joints} | {joint.parent for joint in joints}
    couplings, hints = [], []
    for element in root:
        if tag(element) != "coupling":
            continue
        name = text_attribute(element, "name", source)
        ratio = number(child(element, "ratio", source), "value", source)
        chains = []
        for role in ("predecessor", "successor"):
            link = text_attribute(child(element, role, source), "link", source)
            if link not in links:
                raise DescriptionError(f"{role} link '{link}' does not exist", source=source, element=label(element))
            chains.append(_chain(link, by_child, source, label(element)))
        shared = {joint.name for joint in chains[0]} & {joint.name for joint in chains[1]}
        terms = [
            CouplingTerm(joint.name, (0.0, coefficient))
            for chain, coefficient in zip(chains, (ratio, -1.0), strict=True)
            for joint in chain
            if joint.name not in shared and joint.kind != "fixed"
        ]
        hints += [joint.name for joint in chains[1] if joint.name not in shared and joint.kind != "fixed"]
        couplings.append(Coupling(name, tuple(terms)))
    return couplings, hints


def _chain(link: str, by_child: dict[str, Joint], source: str | None, element: str) -> list[Joint]:
    chain: list[Joint] = []
    while link in by_child:
        joint = by_child[link]
        if joint in chain:
            raise DescriptionError("the joints form a cycle", source=source, element=element)
        chain.append(joint)
        link = joint.parent
    return chain


def _motors(root: Element, joints: list[Joint], source: str | None) -> tuple[tuple[str, ...] | None, dict[str, float]]:
    """Motors are the joints of <transmission>s; Drake's rotor inertia is reflected by its gear ratio squared."""
    known = {joint.name for joint in joints}
    actuated: list[str] = []
    armature: dict[str, float] = {}
    for element in root:
        if tag(element) != "transmission":
            continue
        for joint in children(element, "joint"):
            name = text_attribute(joint, "name", source)
            if name not in known:
                raise DescriptionError(f"joint '{name}' does not exist", source=source, element=label(element))
            if name not in actuated:
                actuated.append(name)
            for actuator in children(element, "actuator"):
                rotor = next(children(actuator, "rotor_inertia"), None)
                gear = next(children(actuator, "gear_ratio"), None)
                ratio = 1.0 if gear is None else number(gear, "value", source)
                if rotor is not None:
                    armature[name] = armature.get(name, 0.0) + ratio**2 * number(rotor, "value", source)
    return tuple(actuated) or None, armature


def _reference(root: Element, source: str | None) -> dict[str, tuple[float, ...]]:
    """``<group_state name="reference">`` (SRDF's element) with ``<joint name value>`` children."""
    reference: dict[str, tuple[float, ...]] = {}
    for element in root:
        if tag(element) == "group_state" and element.get("name") == "reference":
            for joint in children(element, "joint"):
                name = text_attribute(joint, "name", source)
                reference[name] = tuple(float(x) for x in numbers(joint, "value", None, source))
    return reference


def closure_kind(name: str, source: str | None = None, element: str | None = None) -> ClosureKind:
    """The closure kind a type names, with its synonyms (ball, weld, hinge).

    Raises:
        DescriptionError: It is none of them; `source` and `element` say where it stands.
    """
    if name not in LOOP_TYPES:
        raise DescriptionError(f"type '{name}' is not one of {', '.join(LOOP_TYPES)}", source=source, element=element)
    return LOOP_TYPES[name]
