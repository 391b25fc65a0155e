"""The body tree of an MJCF file as links and joints, with every body's pose at qpos0."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

from ccpin.arrays import Array
from ccpin.description.elements.xml import XmlElement, fail
from ccpin.description.mjcf.defaults import MAIN, Compiler, Defaults
from ccpin.description.mjcf.element import Element
from ccpin.description.mjcf.geoms import Assets, Geom, geom_visual, read_geom
from ccpin.description.mjcf.inertia import body_inertia
from ccpin.description.mjcf.joints import JointReader, NameGiver, Site, WorldBody
from ccpin.description.mjcf.schema import BODY_IGNORED, BODY_UNSUPPORTED, WORLD
from ccpin.description.model import IDENTITY, Link, Visual

_EXPANDED = "s = mujoco.MjSpec.from_file(file); s.compile(); then read what s.to_xml() returns"


class _Child(NamedTuple):
    """A child of a body: frames around it are folded into `offset`, and so is their childclass."""

    xml: XmlElement
    offset: Array
    childclass: str


_Items = dict[str, list[_Child]]
"""A body's children by tag, those called freejoint among the joints."""


class BodyReader:
    """Walks the bodies of the ``<worldbody>`` sections depth first, as MuJoCo numbers them.

    Raises:
        DescriptionError: Two bodies or two joints have the same name.
    """

    def __init__(self, worlds: Sequence[XmlElement], defaults: Defaults, compiler: Compiler, assets: Assets) -> None:
        bodies = [xml for world in worlds for xml in world.iter("body")]
        joints = [xml for world in worlds for xml in world.iter("joint", "freejoint")]
        self.tree = WorldBody(NameGiver("body", bodies), NameGiver("joint", joints))
        self._worlds, self._defaults, self._compiler, self._assets = worlds, defaults, compiler, assets
        self._chains = JointReader(compiler, self.tree)
        self._count = 0

    def read(self) -> WorldBody:
        """Read all bodies.

        Raises:
            DescriptionError: An element is unknown, unsupported, or says something wrong.
        """
        items: _Items = defaultdict(list)
        for world in self._worlds:
            self._collect(items, world, IDENTITY, MAIN)
        for item in items["joint"] + items["inertial"]:
            raise fail(item.xml, "the world can have neither joints nor an inertia")
        self.tree.poses[WORLD] = IDENTITY
        geoms = self._read_parts(WORLD, items)
        self.tree.links.append(Link(WORLD, None, self._visuals(geoms)))
        for item in items["body"]:
            self._read_body(item, WORLD, moves=False)
        return self.tree

    def _collect(self, items: _Items, parent: XmlElement, offset: Array, childclass: str) -> None:
        """Sort a body's children, with those of ``<frame>`` elements in the frames' places."""
        for xml in parent.iterchildren("*"):
            if xml.tag in BODY_UNSUPPORTED:
                raise fail(xml, f"<{xml.tag}> is MuJoCo's to expand: {_EXPANDED}")
            if xml.tag == "frame":
                said = Element.of(xml)
                inner = self._defaults.check(said.text("childclass") or childclass, said)
                self._collect(items, xml, offset @ said.pose(self._compiler.angles), inner)
            elif xml.tag in ("body", "joint", "freejoint", "inertial", "geom", "site"):
                items[xml.tag.removeprefix("free")].append(_Child(xml, offset, childclass))
            elif xml.tag not in BODY_IGNORED:
                raise fail(xml, f"<{xml.tag}> is no element of a body")

    def _read_body(self, item: _Child, parent: str, *, moves: bool) -> None:
        said = Element.of(item.xml)
        self._count += 1
        name = said.text("name") or self.tree.body_names.fresh(f"body_{self._count}")
        childclass = self._defaults.check(said.text("childclass") or item.childclass, said)
        placement = item.offset @ said.pose(self._compiler.angles)
        items: _Items = defaultdict(list)
        self._collect(items, item.xml, IDENTITY, childclass)
        joints = [(self._defaults.resolve(joint.xml, joint.childclass), joint.offset) for joint in items["joint"]]
        self.tree.poses[name] = self.tree.poses[parent] @ placement
        self._chains.read(joints, parent, name, placement)
        moves = moves or bool(joints)
        geoms = self._read_parts(name, items)
        inertials = [inertial.xml for inertial in items["inertial"]]
        if len(inertials) > 1:
            raise fail(inertials[1], "a body can have one <inertial> only")
        inertial = Element.of(inertials[0]) if inertials else None
        stands = items["inertial"][0].offset if inertials else IDENTITY
        inertia = body_inertia(said, inertial, stands, geoms, self._assets, self._compiler, moves)
        self.tree.links.append(Link(name, inertia, self._visuals(geoms)))
        if inertial is not None and not {"diaginertia", "fullinertia"} & inertial.values.keys():
            self.tree.notes.append(f"Body '{name}' is a point mass: its <inertial> says nothing of its inertia.")
        self._note_body(said, name)
        for body in items["body"]:
            self._read_body(body, name, moves=moves)

    def _read_parts(self, body: str, items: _Items) -> list[Geom]:
        """Record the sites among the items and return the geoms."""
        for item in items["site"]:
            said = self._defaults.resolve(item.xml, item.childclass)
            name = said.text("name")
            if name in self.tree.sites:
                raise said.fail("the site name is used twice")
            if name:
                pose = said.span().placement if "fromto" in said.values else said.pose(self._compiler.angles)
                self.tree.sites[name] = Site(body, item.offset @ pose)
        geoms = ((self._defaults.resolve(item.xml, item.childclass), item.offset) for item in items["geom"])
        return [read_geom(said, offset, self._compiler, self._assets) for said, offset in geoms]

    def _visuals(self, geoms: Sequence[Geom]) -> tuple[Visual, ...]:
        return tuple(filter(None, (geom_visual(geom, self._assets) for geom in geoms)))

    def _note_body(self, said: Element, name: str) -> None:
        if said.flag("mocap", False):
            self.tree.notes.append(f"Body '{name}' is moved from outside (mocap); here it stays where it is.")
        if said.number("gravcomp", 0.0) != 0.0:
            self.tree.notes.append(f"The gravity compensation (gravcomp) of body '{name}' is left out.")
