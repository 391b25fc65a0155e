"""One MJCF element with its defaults merged in, and the numbers, choices and frames read from it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ccpin.arrays import Array
from ccpin.description.elements.xml import ZERO, XmlElement, fail
from ccpin.description.mjcf.schema import ATTRIBUTES, LEAVES, NUMERIC, ORIENTATIONS, SOFT, SOFT_JOINT
from ccpin.description.model import frame, rotation_to
from ccpin.errors import DescriptionError

_LARGEST = 1e30  # a number beyond it is refused, and inf and NaN with it
_LONGEST = 10  # numbers of a numeric attribute: more are refused
_SOFT = {*SOFT, *SOFT_JOINT} - {"margin"}
_FLAGS = {"true": True, "false": False}


@dataclass(frozen=True)
class Angles:
    """How the file writes angles: `unit` radians to one unit, and the axes of its Euler angles."""

    unit: float = np.pi / 180.0
    sequence: str = "xyz"


class FromTo(NamedTuple):
    """Two end points: the frame (4, 4) midway, its z axis from the second to the first, and half the length."""

    placement: Array
    half_length: float


@dataclass(frozen=True)
class Element:
    """An element's attributes, checked against the format, with those of its default class merged in.

    Attributes:
        xml: The element as it stands in the file.
        values: The attributes as written, its own and those it inherits.
    """

    xml: XmlElement
    values: Mapping[str, str]

    @classmethod
    def of(cls, xml: XmlElement, inherited: Mapping[str, str] | None = None) -> Element:
        """Read an XML element, adding what it inherits.

        Raises:
            DescriptionError: An attribute does not belong to this element, or two orientations are given.
        """
        own = dict(xml.attrib)
        bare = cls(xml, own)
        parent = xml.getparent()
        within = f"{parent.tag}/{xml.tag}" if parent is not None else xml.tag
        allowed = ATTRIBUTES.get(within, ATTRIBUTES.get(xml.tag))
        for name in own:
            if allowed is not None and name not in allowed:
                raise bare.fail(f"unknown attribute '{name}'; it takes: {', '.join(sorted(allowed))}")
        for name in own.keys() & NUMERIC if xml.tag != "flag" else ():
            bare.some_numbers(name, _LONGEST)
        for child in xml.iterchildren("*") if xml.tag in LEAVES else ():
            if child.tag != "plugin":
                raise bare.fail(f"a <{child.tag}> does not belong inside this element")
        if len(ORIENTATIONS & own.keys()) > 1:
            raise bare.fail(f"only one of {', '.join(sorted(ORIENTATIONS & own.keys()))} may be given")
        return cls(xml, merged(inherited or {}, own))

    def fail(self, message: str) -> DescriptionError:
        """Return the error that blames this element."""
        return fail(self.xml, message)

    def text(self, name: str) -> str | None:
        """Return an attribute as written; ``None`` where it is absent or empty."""
        return self.values.get(name) or None

    def required(self, name: str) -> str:
        """Return an attribute that must be there."""
        value = self.text(name)
        if value is None:
            raise self.fail(f"the attribute '{name}' is required")
        return value

    def some_numbers(self, name: str, most: int) -> tuple[float, ...]:
        """Return between 1 and `most` finite numbers, or none where the attribute is absent."""
        written = self.values.get(name)
        if written is None:
            return ()
        try:
            values = tuple(float(part) for part in written.split())
        except ValueError:
            raise self.fail(f'{name}="{written}" is not a list of numbers') from None
        if not 1 <= len(values) <= most or not all(abs(value) <= _LARGEST for value in values):
            raise self.fail(f'{name}="{written}" should be at most {most} finite numbers, at least one')
        return values

    def vector(self, name: str, count: int, default: tuple[float, ...] | None = None) -> Array:
        """Return exactly `count` finite numbers; `default` where the attribute is absent."""
        values = self.some_numbers(name, count)
        values = values or default or ()
        if not values:
            raise self.fail(f"the attribute '{name}' is required ({count} numbers)")
        if len(values) != count:
            raise self.fail(f"{name} should be {count} numbers, not {len(values)}")
        return np.array(values)

    def number(self, name: str, default: float) -> float:
        """Return one finite number; `default` where the attribute is absent."""
        return float(self.vector(name, 1, (default,))[0])

    def choice(self, name: str, choices: tuple[str, ...], default: str) -> str:
        """Return one of the words `choices`; `default` where the attribute is absent."""
        value = self.values.get(name, default)
        if value not in choices:
            raise self.fail(f'{name}="{value}" should be one of: {", ".join(choices)}')
        return value

    def flag(self, name: str, default: bool) -> bool:
        """Return a truth value; `default` where the attribute is absent."""
        return _FLAGS[self.choice(name, tuple(_FLAGS), "true" if default else "false")]

    def bounds(self, switch: str, name: str, autolimits: bool) -> Array | None:
        """Return the two numbers of a range that is in force (its switch is true, or auto and it is given), or None."""
        word = self.choice(switch, ("true", "false", "auto"), "auto")
        bounds = self.vector(name, 2, (0.0, 0.0))
        given = bool(np.any(bounds))
        if word == "auto" and given and not autolimits:
            raise self.fail(f"{name} without {switch} is ambiguous when autolimits is off")
        if not (word == "true" or (word == "auto" and given)):
            return None
        return bounds

    def orientation(self, angles: Angles) -> Array:
        """Return the rotation matrix (3, 3) of quat, axisangle, xyaxes, zaxis or euler; else the identity."""
        for name, read in _READERS.items():
            if name in self.values:
                return read(self, angles)
        return np.eye(3)

    def pose(self, angles: Angles) -> Array:
        """Return the frame (4, 4) of pos and the orientation attributes."""
        return frame(self.vector("pos", 3, ZERO), self.orientation(angles))

    def span(self) -> FromTo:
        """Return where the attribute fromto puts an elongated shape.

        MuJoCo 4.0's manual has the z axis point to the second end; its compiler makes it point to the first.
        """
        ends = self.vector("fromto", 6)
        along = ends[:3] - ends[3:]
        turn = rotation_to(self.unit(along, "fromto"))
        return FromTo(frame((ends[:3] + ends[3:]) / 2.0, turn), math.hypot(*along) / 2.0)

    def unit(self, value: Array, name: str) -> Array:
        """Return `value` normalized; what has no direction is an error."""
        norm = math.hypot(*value)
        if norm < 1e-14:
            raise self.fail(f"{name} has no length, so no direction")
        return value / norm

    def quaternion(self, value: Array, name: str) -> Array:
        """Return the rotation matrix (3, 3) of a quaternion (w, x, y, z), normalized first."""
        w, x, y, z = self.unit(value, name)
        matrix: Array = Rotation.from_quat([x, y, z, w]).as_matrix()
        return matrix


def merged(inherited: Mapping[str, str], own: Mapping[str, str]) -> dict[str, str]:
    """Return the attributes of both, `own` winning; its orientation replaces every inherited one.

    Of solref and solimp and their like own numbers replace as many inherited ones, as MuJoCo has it.
    """
    drop = ORIENTATIONS if ORIENTATIONS & own.keys() else frozenset()
    soft = {
        name: " ".join([*own[name].split(), *inherited[name].split()[len(own[name].split()) :]])
        for name in _SOFT & own.keys() & inherited.keys()
    }
    return {**{name: value for name, value in inherited.items() if name not in drop}, **own, **soft}


def _axisangle(element: Element, angles: Angles) -> Array:
    value = element.vector("axisangle", 4)
    turn = element.unit(value[:3], "the axis of axisangle") * value[3] * angles.unit
    matrix: Array = Rotation.from_rotvec(turn).as_matrix()
    return matrix


def _xyaxes(element: Element, _: Angles) -> Array:
    value = element.vector("xyaxes", 6)
    x = element.unit(value[:3], "the x axis of xyaxes")
    y = element.unit(value[3:] - x * (x @ value[3:]), "the part of the y axis of xyaxes normal to x")
    return np.column_stack([x, y, np.cross(x, y)])


def _euler(element: Element, angles: Angles) -> Array:
    """Lower-case axes turn with the frame (factors from the left), upper-case ones stay (from the right)."""
    matrix = np.eye(3)
    for axis, angle in zip(angles.sequence, element.vector("euler", 3) * angles.unit, strict=True):
        turn = Rotation.from_euler(axis.lower(), angle).as_matrix()
        matrix = matrix @ turn if axis.islower() else turn @ matrix
    return matrix


_READERS: dict[str, Callable[[Element, Angles], Array]] = {
    "quat": lambda element, _: element.quaternion(element.vector("quat", 4), "quat"),
    "axisangle": _axisangle,
    "xyaxes": _xyaxes,
    "zaxis": lambda element, _: rotation_to(element.unit(element.vector("zaxis", 3), "zaxis")),
    "euler": _euler,
}
