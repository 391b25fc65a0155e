"""The body tree of an MJCF file as links and joints, with every body's pose at qpos0."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ccpin.arrays import Array
from ccpin.description.mjcf.defaults import MAIN, Compiler, Defaults
from ccpin.description.mjcf.element import Element
from ccpin.description.mjcf.geoms import Assets, Geom, geom_visual, read_geom
from ccpin.description.mjcf.inertia import body_inertia
from ccpin.description.mjcf.joints import JointReader, Names, Site, Tree
from ccpin.description.mjcf.schema import BODY_IGNORED, BODY_UNSUPPORTED, WORLD
from ccpin.description.model import IDENTITY, Link, Visual
from ccpin.description.xml import XmlElement, fail


@dataclass(frozen=True, eq=False)
class _Item:
    """A child of a body: frames around it are folded into `offset`, and so is their childclass."""

    xml: XmlElement
    offset: Array
    childclass: str


class TreeReader:
    """Walks the bodies depth first, as MuJoCo numbers them.

    Args:
        worlds: The ``<worldbody>`` sections.
        defaults: The default classes.
        compiler: The compiler settings.
        assets: Meshes and materials.

    Raises:
        DescriptionError: Two bodies or two joints have the same name.
    """

    def __init__(self, worlds: Sequence[XmlElement], defaults: Defaults, compiler: Compiler, assets: Assets) -> None:
        bodies = [xml for world in worlds for xml in world.iter("body")]
        joints = [xml for world in worlds for xml in world.iter("joint", "freejoint")]
        self.tree = Tree(Names("body", bodies), Names("joint", joints))
        self._worlds, self._defaults, self._compiler, self._assets = worlds, defaults, compiler, assets
        self._chains = JointReader(compiler, self.tree)
        self._count = 0

    def read(self) -> Tree:
        """Read all bodies.

        Raises:
            DescriptionError: An element is unknown, unsupported, or says something wrong.
        """
        items = [item for world in self._worlds for item in self._items(world, IDENTITY, MAIN)]
        self.tree.poses[WORLD] = IDENTITY
        geoms = self._read_parts(WORLD, items)
        self.tree.links.append(Link(WORLD, None, self._visuals(geoms)))
        for item in items:
            if item.xml.tag in ("joint", "freejoint", "inertial"):
                raise fail(item.xml, "the world can have neither joints nor an inertia")
            if item.xml.tag == "body":
                self._read_body(item, WORLD, moves=False)
        return self.tree

    def _items(self, parent: XmlElement, offset: Array, childclass: str) -> Iterator[_Item]:
        """Yield a body's children, with those of ``<frame>`` elements in the frames' places."""
        for xml in parent.iterchildren("*"):
            if xml.tag in BODY_UNSUPPORTED:
                raise fail(xml, f"<{xml.tag}> is not supported; save the compiled model as MJCF")
            if xml.tag == "frame":
                said = Element.of(xml)
                inner = self._defaults.check(said.text("childclass") or childclass, said)
                yield from self._items(xml, offset @ said.pose(self._compiler.angles), inner)
            elif xml.tag in ("joint", "freejoint", "inertial") and parent.tag == "frame":
                raise fail(xml, "this element inside a <frame> is not supported; put it into the body")
            elif xml.tag in ("body", "joint", "freejoint", "inertial", "geom", "site"):
                yield _Item(xml, offset, childclass)
            elif xml.tag not in BODY_IGNORED:
                raise fail(xml, f"<{xml.tag}> is no element of a body")

    def _read_body(self, item: _Item, parent: str, *, moves: bool) -> None:
        said = Element.of(item.xml)
        self._count += 1
        name = said.text("name") or self.tree.body_names.fresh(f"body_{self._count}")
        childclass = self._defaults.check(said.text("childclass") or item.childclass, said)
        placement = item.offset @ said.pose(self._compiler.angles)
        items = list(self._items(item.xml, IDENTITY, childclass))
        joints = [
            Element.of(part.xml) if part.xml.tag == "freejoint" else self._defaults.resolve(part.xml, part.childclass)
            for part in items
            if part.xml.tag in ("joint", "freejoint")
        ]
        self.tree.poses[name] = self.tree.poses[parent] @ placement
        self._chains.read(joints, parent, name, placement)
        moves = moves or bool(joints)
        geoms = self._read_parts(name, items)
        inertia = body_inertia(said, self._inertial(items), geoms, self._compiler, moves)
        self.tree.links.append(Link(name, inertia, self._visuals(geoms)))
        self._note_body(said, name)
        for child in items:
            if child.xml.tag == "body":
                self._read_body(child, name, moves=moves)

    def _inertial(self, items: Sequence[_Item]) -> Element | None:
        found = [item.xml for item in items if item.xml.tag == "inertial"]
        if len(found) > 1:
            raise fail(found[1], "a body can have one <inertial> only")
        return Element.of(found[0]) if found else None

    def _read_parts(self, body: str, items: Sequence[_Item]) -> list[Geom]:
        """Record the sites among the items and return the geoms."""
        geoms = []
        for item in items:
            if item.xml.tag == "geom":
                said = self._defaults.resolve(item.xml, item.childclass)
                geoms.append(read_geom(said, item.offset, self._compiler, self._assets))
            elif item.xml.tag == "site":
                self._read_site(body, item)
        return geoms

    def _read_site(self, body: str, item: _Item) -> None:
        said = self._defaults.resolve(item.xml, item.childclass)
        name = said.text("name")
        if name in self.tree.sites:
            raise said.fail("the site name is used twice")
        if name:
            spans = "fromto" in said.values
            placement = said.span().placement if spans else said.pose(self._compiler.angles)
            self.tree.sites[name] = Site(body, item.offset @ placement)

    def _visuals(self, geoms: Sequence[Geom]) -> tuple[Visual, ...]:
        drawn = (geom_visual(geom, self._assets) for geom in geoms)
        return tuple(visual for visual in drawn if visual is not None)

    def _note_body(self, said: Element, name: str) -> None:
        if said.flag("mocap", False):
            self.tree.notes.append(f"Body '{name}' is moved from outside (mocap); here it stays where it is.")
        if said.number("gravcomp", 0.0) != 0.0:
            self.tree.notes.append(f"The gravity compensation (gravcomp) of body '{name}' is left out.")
