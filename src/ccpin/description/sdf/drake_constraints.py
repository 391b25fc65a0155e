"""Drake's constraints in SDFormat files as closures: weld, ball, distance."""

from __future__ import annotations

import numpy as np

from ccpin.arrays import Array
from ccpin.description.elements.xml import XmlElement, fail, tag
from ccpin.description.model import LoopClosure, frame, inverse
from ccpin.description.sdf.scopes import Scope
from ccpin.description.sdf.values import first, number, numbers, required, unread

CONSTRAINTS = ("weld_constraint", "ball_constraint", "distance_constraint")
_POINTS = ("body_A", "body_B", "p_AP", "p_BQ")


def drake_closures(scope: Scope, notes: list[str]) -> tuple[LoopClosure, ...]:
    """The closures of a model's ``drake:`` constraints, named after their kind and number.

    Raises:
        DescriptionError: A constraint is incomplete, misspelt or names what does not exist.
    """
    elements = [e for e in scope.element.iterchildren("*") if e.prefix and tag(e) in CONSTRAINTS]
    return tuple(_closure(scope, element, k, notes) for k, element in enumerate(elements, start=1))


def _closure(scope: Scope, element: XmlElement, position: int, notes: list[str]) -> LoopClosure:
    kind = tag(element)
    name = element.get("name") or f"{scope.prefix}{kind}_{position}"
    if kind == "weld_constraint":
        unread(element, ("parent", "child"))
        ends = [_placed(scope, required(element, role), np.eye(4), element) for role in ("parent", "child")]
        return LoopClosure(name, "fixed", ends[0][0], ends[1][0], ends[0][1], ends[1][1])
    extra = ("distance", "stiffness", "damping") if kind == "distance_constraint" else ()
    unread(element, [f"{kind}_{part}" for part in (*_POINTS, *extra)])
    (link_a, a), (link_b, b) = (
        _placed(scope, required(element, f"{kind}_{body}"), _point(element, f"{kind}_{point}"), element)
        for body, point in (("body_A", "p_AP"), ("body_B", "p_BQ"))
    )
    if kind == "ball_constraint":
        return LoopClosure(name, "spherical", link_a, link_b, a, b)
    length = number(element, f"{kind}_distance", 0.0)
    if not length > 0:
        raise fail(element, f"<{kind}_distance> must be positive")
    if first(element, f"{kind}_stiffness") is not None or first(element, f"{kind}_damping") is not None:
        notes.append(f"loop '{name}': its stiffness and damping are left out: it is rigid here")
    return LoopClosure(name, "distance", link_a, link_b, a, b, length)


def _point(element: XmlElement, name: str) -> Array:
    found = first(element, name)
    return frame(np.zeros(3) if found is None else numbers(found, 3))


def _placed(scope: Scope, name: str, within: Array, where: XmlElement) -> tuple[str, Array]:
    """The link that carries what is named, and a frame fixed in it."""
    link = scope.link_of(name, where)
    own = link.removeprefix(scope.prefix) if scope.prefix else link
    return link, inverse(scope.pose(own, where)) @ scope.pose(name, where) @ within
