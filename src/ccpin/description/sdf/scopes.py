"""Models as scopes of names: links, joints, frames and nested models, where each is and which link carries it.

Poses are those at zero displacement. A pose is stated in the frame `relative_to` names; without it a link's in its
model's frame, a joint's in its child's, a frame's in that of what it is attached to.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from ccpin.arrays import Array
from ccpin.description.elements.xml import XmlElement, fail, tag, text_attribute
from ccpin.description.model import IDENTITY, inverse
from ccpin.description.sdf.includes import Including
from ccpin.description.sdf.values import first, flag, own, placement, relative_to, required

MODEL, WORLD = "__model__", "world"
LONGEST_CHAIN = 200  # poses that refer to one another: found by recursion, which Python limits
DEEPEST = 50  # models inside each other: read by recursion, which Python limits


class PlacedModel(NamedTuple):
    """How a model stands in its parent: under what name, where, and by which of its frames."""

    name: str
    pose: XmlElement | None
    frame: str | None
    static: bool


class Scope:
    """A <model> (or the <world>) with the names in it.

    Args:
        element: The <model> or <world>.
        including: Finds the files that are included.
        placed: How it stands in its parent; default as the element says itself.
        parent: The scope around it, if there is one.
        prefix: What its names begin with from outside; ``None``: its own name and ``::``.

    Raises:
        DescriptionError: A name is used twice, reserved or missing; an include cannot be resolved.
    """

    def __init__(
        self,
        element: XmlElement,
        including: Including,
        placed: PlacedModel | None = None,
        parent: Scope | None = None,
        prefix: str | None = "",
    ) -> None:
        self.element, self.parent = element, parent
        self.depth: int = 0 if parent is None else parent.depth + 1
        if self.depth > DEEPEST:
            raise fail(element, f"models are nested more than {DEEPEST} deep")
        self.placed = placed or _own_placing(element)
        outer = "" if parent is None else parent.prefix
        self.prefix: str = f"{outer}{self.placed.name}::" if prefix is None else prefix
        self.entries: dict[str, XmlElement] = {}
        self.nested: dict[str, Scope] = {}
        self.merged: list[Scope] = []
        self._poses: dict[str, Array] = {}
        self._pending: list[str] = []
        for child in own(element, "link", "joint", "frame", "model"):
            self._add(text_attribute(child, "name"), child)
            if tag(child) == "model":
                self.nested[child.get("name")] = Scope(child, including, None, self, None)
        for include in own(element, "include"):
            self._include(include, including)

    def _add(self, name: str, element: XmlElement) -> None:
        if name in self.entries:
            raise fail(element, "the name is used twice in its model; names must be unique")
        if name == WORLD or (name.startswith("__") and name.endswith("__")) or not all(name.split("::")):
            raise fail(element, "the name is reserved")
        self.entries[name] = element

    def _include(self, include: XmlElement, including: Including) -> None:
        model = including.model(include)
        said = _own_placing(model)
        placed = PlacedModel(
            name=required(include, "name") if first(include, "name") is not None else said.name,
            pose=said.pose if first(include, "pose") is None else first(include, "pose"),
            frame=include.findtext("placement_frame") or said.frame,
            static=flag(include, "static", said.static),
        )
        if include.get("merge", "false").lower() in ("true", "1"):
            self.merged.append(Scope(model, including, placed, self, self.prefix))
        else:
            self._add(placed.name, include)
            self.nested[placed.name] = Scope(model, including, placed, self, None)
        including.leave()

    def inside(self) -> Iterator[Scope]:
        """This scope and all below it, in file order."""
        yield self
        for scope in (*self.nested.values(), *self.merged):
            yield from scope.inside()

    @property
    def frozen(self) -> bool:
        """Whether the model, or one around it, is static."""
        return self.placed.static or (self.parent is not None and self.parent.frozen)

    def to_top(self) -> Array:
        """The model's frame (4, 4) in the world."""
        if self.parent is None:
            return self._placement()
        return self.parent.to_top() @ self.parent.nested_pose(self)

    def pose(self, name: str, where: XmlElement) -> Array:
        """The frame (4, 4) of what is named, in this model's frame; `where` is blamed if there is no such thing.

        Raises:
            DescriptionError: No such name, or poses that refer to each other in a circle.
        """
        if name == MODEL or (name == WORLD and tag(self.element) == WORLD):
            return IDENTITY
        if name == WORLD:
            return inverse(self.to_top())
        if name in self._poses:
            return self._poses[name]
        scope, rest = self._lookup(name, where)
        if scope is not self:
            return self.nested_pose(scope) @ scope.pose(rest, where)
        if name in self._pending:
            raise fail(where, f"the poses of {', '.join(self._pending)} refer to each other in a circle")
        if len(self._pending) > LONGEST_CHAIN:
            raise fail(where, f"more than {LONGEST_CHAIN} poses in a row refer to the one stated after them")
        self._pending.append(name)
        try:
            element = self.entries[name]
            if name in self.nested:
                found = self.nested_pose(self.nested[name])
            else:
                found = self._stated(first(element, "pose"), self._default_frame(element), element)
        finally:
            self._pending.pop()
        self._poses[name] = found
        return found

    def nested_pose(self, scope: Scope) -> Array:
        """The frame (4, 4) of a model directly inside this one."""
        placed = scope.placed
        stated = self._stated(placed.pose, MODEL, scope.element)
        if placed.frame is None or placed.frame == MODEL:
            return stated
        return stated @ inverse(scope.pose(placed.frame, scope.element))

    def _placement(self) -> Array:
        """Where a model stands that has no scope around it."""
        stated = placement(self.placed.pose)
        if self.placed.frame is None or self.placed.frame == MODEL:
            return stated
        return stated @ inverse(self.pose(self.placed.frame, self.element))

    def _stated(self, pose: XmlElement | None, default: str, where: XmlElement) -> Array:
        return self.pose(relative_to(pose) or default, where if pose is None else pose) @ placement(pose)

    def _default_frame(self, element: XmlElement) -> str:
        if tag(element) == "joint":
            return required(element, "child")
        return element.get("attached_to") or MODEL

    def link_of(self, name: str, where: XmlElement) -> str:
        """The full name of the link that carries what is named; "world" is its own.

        Raises:
            DescriptionError: No such name, or attachments in a circle.
        """
        return self._carrier(name, where, set())

    def _carrier(self, name: str, where: XmlElement, seen: set[tuple[int, str]]) -> str:
        if name == WORLD:
            return WORLD
        if (id(self), name) in seen or len(seen) > LONGEST_CHAIN:
            raise fail(where, f"'{name}' is attached to itself, in a circle (or by more than {LONGEST_CHAIN} frames)")
        seen.add((id(self), name))
        if name == MODEL:
            return self._canonical(where, seen)
        scope, rest = self._lookup(name, where)
        if scope is not self:
            return scope._carrier(rest, where, seen)
        element = self.entries[name]
        if name in self.nested:
            return self.nested[name]._carrier(MODEL, where, seen)
        if tag(element) == "link":
            return self.prefix + name
        on = required(element, "child") if tag(element) == "joint" else element.get("attached_to") or _closing(element)
        return self._carrier(on, element, seen)

    def _canonical(self, where: XmlElement, seen: set[tuple[int, str]]) -> str:
        """The link a model's own frame is fixed to: the one it names, else its first, else that of a model in it."""
        if tag(self.element) == WORLD:
            return WORLD
        stated = self.element.get("canonical_link")
        if stated:
            return self._carrier(stated, self.element, seen)
        for name, element in self.entries.items():
            if tag(element) == "link":
                return self.prefix + name
        for scope in (*self.nested.values(), *self.merged):
            return scope._carrier(MODEL, where, seen)
        raise fail(self.element, "the model has no link")

    def _lookup(self, name: str, where: XmlElement) -> tuple[Scope, str]:
        """The scope in which a name is at home, and the name there."""
        if name in self.entries:
            return self, name
        head, _, rest = name.partition("::")
        if rest and head in self.nested:
            return self.nested[head], rest
        for scope in self.merged:
            if head in scope.entries:
                return scope, name
        known = ", ".join(self.entries) or "nothing"
        raise fail(where, f"there is no '{name}' in model '{self.placed.name}', which holds {known}")


def _closing(frame: XmlElement) -> str:
    """What a frame that is attached to nothing hangs on: its model.

    onshape-to-robot writes its closing frames relative to a link without attaching them; they mean that link.
    """
    on = relative_to(first(frame, "pose"))
    return on if on and text_attribute(frame, "name").startswith("closing_") else MODEL


def _own_placing(element: XmlElement) -> PlacedModel:
    name = text_attribute(element, "name") if tag(element) == "model" else element.get("name") or WORLD
    return PlacedModel(name, first(element, "pose"), element.get("placement_frame"), flag(element, "static", False))
