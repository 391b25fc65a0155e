"""What the reader of an MJCF body tree collects: links, joints, sites and the poses at qpos0."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from ccpin.description.mjcf_element import XmlElement, inverse, label_of
from ccpin.description.mjcf_schema import WORLD
from ccpin.description.model import Array, Joint, Link
from ccpin.errors import DescriptionError


@dataclass(frozen=True, eq=False)
class Site:
    """A site: the body it is fixed to and its frame (4, 4) there."""

    body: str
    placement: Array


@dataclass(frozen=True, eq=False)
class Tree:
    """What the worldbody says.

    Attributes:
        links: All links, the root "world" first, parents before children.
        joints: All joints, parents before children.
        poses: Every body's frame (4, 4) in the world at qpos0.
        sites: The named sites.
        reference: Displacements of the movable joints at qpos0.
        passive_forces: Joints with springs, damping or friction, by those words.
        notes: What was left out.
    """

    links: list[Link] = field(default_factory=list)
    joints: list[Joint] = field(default_factory=list)
    poses: dict[str, Array] = field(default_factory=dict)
    sites: dict[str, Site] = field(default_factory=dict)
    reference: dict[str, tuple[float, ...]] = field(default_factory=dict)
    passive_forces: dict[str, list[str]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def pose_between(self, first: str, second: str) -> Array:
        """Return the frame (4, 4) of body `second` in body `first` at qpos0."""
        return inverse(self.poses[first]) @ self.poses[second]


class Names:
    """Hands out element names, each once, so that unnamed elements get names no other one has."""

    def __init__(self, what: str, given: Iterable[XmlElement], source: str | None) -> None:
        self._taken: set[str] = {WORLD} if what == "body" else set()
        for xml in given:
            name = xml.get("name")
            if name in self._taken:
                raise DescriptionError(f"the {what} name '{name}' is used twice", source=source, element=label_of(xml))
            if name:
                self._taken.add(name)

    def fresh(self, wanted: str) -> str:
        """Return `wanted`, with underscores appended until no other element has that name."""
        while wanted in self._taken:
            wanted += "_"
        self._taken.add(wanted)
        return wanted
