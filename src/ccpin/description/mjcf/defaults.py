"""MJCF's default classes and compiler settings: what an element means beyond what it says."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ccpin.description.elements.xml import XmlElement, fail
from ccpin.description.mjcf.element import Angles, Element, merged
from ccpin.description.mjcf.general import ACTUATORS, as_general

MAIN = "main"


@dataclass(frozen=True)
class Compiler:
    """The settings of ``<compiler>`` that change what a mechanism is.

    Attributes:
        inertia_from_geom: "true" always, "auto" where a body has no inertial, "false" never.
        inertia_groups: First and last geom group that counts for inertia.
        mesh_folder: What to put before mesh file names.
        mesh_inertia: What meshes that do not say their inertia have; older files say it for all (exactmeshinertia).
        total_mass: The mass to scale the model to; not positive for none.
    """

    angles: Angles = field(default_factory=Angles)
    autolimits: bool = True
    inertia_from_geom: str = "auto"
    inertia_groups: tuple[float, float] = (0.0, 5.0)
    balance_inertia: bool = False
    bound_mass: float = 0.0
    bound_inertia: float = 0.0
    total_mass: float = -1.0
    mesh_folder: str = ""
    mesh_inertia: str = "legacy"
    strip_path: bool = False
    align_free: bool = False


def read_compiler(sections: Sequence[XmlElement]) -> Compiler:
    """Merge all ``<compiler>`` elements, later attributes winning.

    Raises:
        DescriptionError: A setting is malformed, or asks for global coordinates.
    """
    if not sections:
        return Compiler()
    values: dict[str, str] = {}
    for section in sections:
        values |= Element.of(section).values
    said = Element(sections[-1], values)
    if said.choice("coordinate", ("local", "global"), "local") == "global":
        raise said.fail('global coordinates are not supported; save the model with coordinate="local"')
    sequence = said.text("eulerseq") or "xyz"
    if len(sequence) != 3 or set(sequence.lower()) - set("xyz"):
        raise said.fail(f'eulerseq="{sequence}" should be three of the letters x, y, z, X, Y, Z')
    degrees = said.choice("angle", ("degree", "radian"), "degree") == "degree"
    first, last = said.vector("inertiagrouprange", 2, (0.0, 5.0))
    return Compiler(
        angles=Angles(np.pi / 180.0 if degrees else 1.0, sequence),
        autolimits=said.flag("autolimits", True),
        inertia_from_geom=said.choice("inertiafromgeom", ("false", "true", "auto"), "auto"),
        inertia_groups=(float(first), float(last)),
        balance_inertia=said.flag("balanceinertia", False),
        bound_mass=_not_negative(said, "boundmass"),
        bound_inertia=_not_negative(said, "boundinertia"),
        total_mass=said.number("settotalmass", -1.0),
        mesh_folder=said.text("meshdir") or said.text("assetdir") or "",
        mesh_inertia="exact" if said.flag("exactmeshinertia", False) else "legacy",
        strip_path=said.flag("strippath", False),
        align_free=said.flag("alignfree", False),
    )


def _not_negative(said: Element, name: str) -> float:
    value = said.number(name, 0.0)
    if value < 0.0:
        raise said.fail(f"{name} should not be negative")
    return value


class Defaults:
    """The tree of default classes, flattened: each class holds all it inherits.

    Args:
        sections: The top-level ``<default>`` elements.

    Raises:
        DescriptionError: A nested class has no name, a name is taken twice, or an attribute is unknown.
    """

    def __init__(self, sections: Iterable[XmlElement]) -> None:
        self._classes: dict[str, dict[str, dict[str, str]]] = {MAIN: {}}
        for section in sections:
            name = Element.of(section).text("class") or MAIN
            self._classes[MAIN] = self._content(section, self._classes[MAIN])
            self._classes[name] = self._classes[MAIN]
            self._nest(section, MAIN)

    def _nest(self, section: XmlElement, parent: str) -> None:
        for child in section.iterchildren("default"):
            name = Element.of(child).text("class")
            if not name:
                raise fail(child, "a nested default needs a class name")
            if name in self._classes:
                raise fail(child, f"the default class '{name}' is defined twice")
            self._classes[name] = self._content(child, self._classes[parent])
            self._nest(child, name)

    def _content(self, section: XmlElement, inherited: Mapping[str, dict[str, str]]) -> dict[str, dict[str, str]]:
        content = dict(inherited)
        for child in section.iterchildren("*"):
            if child.tag == "default":
                continue
            own = Element.of(child).values
            if child.tag in ACTUATORS:
                content["general"] = as_general(child.tag, own, content.get("general", {}))
            else:
                content[child.tag] = merged(content.get(child.tag, {}), own)
        return content

    def actuator(self, xml: XmlElement) -> Element:
        """Return an actuator in <general>'s words, with the defaults of its class merged in."""
        bare = Element.of(xml)
        inherited = self._classes[self.check(bare.text("class") or MAIN, bare)].get("general", {})
        return Element(xml, as_general(xml.tag, bare.values, inherited))

    def check(self, name: str, element: Element) -> str:
        """Return the class name if there is such a class, and blame `element` if not."""
        if name not in self._classes:
            raise element.fail(f"there is no default class '{name}'; there are: {', '.join(self._classes)}")
        return name

    def resolve(self, xml: XmlElement, childclass: str = MAIN, tag: str | None = None) -> Element:
        """Return an element with the defaults of its class, or else of `childclass`, merged in.

        Args:
            xml: The element as written.
            childclass: The class in force where the element stands.
            tag: The tag its defaults are filed under, where that is not its own.
        """
        bare = Element.of(xml)
        name = self.check(bare.text("class") or childclass, bare)
        return Element.of(xml, self._classes[name].get(tag or xml.tag))
