"""What SDFormat's elements say: numbers, vectors, flags and poses stand as text between tags."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from ccpin.arrays import Array
from ccpin.description.elements.xml import TRUTH, XmlElement, fail, numbers_in, spelt, tag
from ccpin.description.model import IDENTITY, frame, frame_from_rpy

UNLIMITED = 1e16  # SDFormat's own: a limit as large is none


def own(element: XmlElement, *names: str) -> list[XmlElement]:
    """The child elements of those names, in file order; names with a prefix of their own (``drake:``) are others."""
    return [child for child in element.iterchildren("*") if tag(child) in names and named_so(child)]


def first(element: XmlElement | None, name: str) -> XmlElement | None:
    """The first child element of a name, or ``None``."""
    return None if element is None else next(iter(own(element, name)), None)


def named_so(element: XmlElement) -> bool:
    """Whether an element is SDFormat's: without a prefix, or a part of one of Drake's constraints."""
    return not element.prefix or "_constraint_" in tag(element)


def unread(element: XmlElement, known: Iterable[str]) -> list[str]:
    """The names of child elements that are not among those known, with their prefix where they have one.

    Raises:
        DescriptionError: A name is so like a known one that it must be a misspelling.
    """
    expected, strangers = tuple(known), dict[str, None]()
    for other in element.iterchildren("*"):
        name = tag(other)
        if other.prefix and not (name in expected and "_constraint" in name):
            strangers[f"{other.prefix}:{name}"] = None
        elif not spelt(other, name, expected):
            strangers[name] = None
    return list(strangers)


def text(element: XmlElement | None, name: str) -> str | None:
    """The text of the first child element of a name, or ``None`` where it is absent or empty."""
    found = first(element, name)
    return None if found is None or found.text is None else found.text.strip() or None


def required(element: XmlElement, name: str) -> str:
    """The text of a child element that must be there."""
    found = text(element, name)
    if found is None:
        raise fail(element, f"<{name}> is missing or empty")
    return found


def numbers(element: XmlElement, count: int) -> Array:
    """The `count` finite numbers an element's text holds."""
    return np.array(numbers_in((element.text or "").strip(), count, element))


def number(element: XmlElement | None, name: str, default: float) -> float:
    """The finite number of a child element; `default` where it is absent."""
    found = first(element, name)
    return default if found is None else float(numbers(found, 1)[0])


def limit(element: XmlElement | None, name: str, default: float) -> float:
    """A number that may be infinite: in SDFormat 1e16 and more means so."""
    found = first(element, name)
    if found is None:
        return default
    written = (found.text or "").strip()
    try:
        value = float(written)
    except ValueError:
        raise fail(found, f"{written[:80]!r} is not numeric") from None
    if math.isnan(value):
        raise fail(found, f"{written[:80]!r} is not a number")
    return math.copysign(math.inf, value) if abs(value) >= UNLIMITED else value


def flag(element: XmlElement | None, name: str, default: bool) -> bool:
    """The truth value of a child element; `default` where it is absent."""
    found = first(element, name)
    if found is None:
        return default
    written = (found.text or "").strip().lower()
    if written not in TRUTH:
        raise fail(found, f"{written[:80]!r} is neither true nor false")
    return TRUTH[written]


def placement(pose: XmlElement | None) -> Array:
    """The frame (4, 4) of a <pose>: x y z roll pitch yaw (or a quaternion), identity where absent or empty."""
    if pose is None or not (pose.text or "").strip():
        return IDENTITY
    format_ = pose.get("rotation_format", "euler_rpy")
    if format_ == "quat_xyzw":
        values = numbers(pose, 7)
        if not 1e-6 < math.hypot(*values[3:]) < 1e9:
            raise fail(pose, "the quaternion has no length, or no bounded one")
        from scipy.spatial.transform import Rotation  # rare, and long to import

        return frame(values[:3], Rotation.from_quat(values[3:]).as_matrix())
    if format_ != "euler_rpy":
        raise fail(pose, f"rotation_format {format_!r} is neither euler_rpy nor quat_xyzw")
    values = numbers(pose, 6)
    unit = math.pi / 180 if TRUTH.get(pose.get("degrees", "false").lower(), False) else 1.0
    return frame_from_rpy(tuple(values[:3].tolist()), tuple((unit * values[3:]).tolist()))


def relative_to(pose: XmlElement | None) -> str | None:
    """The frame a <pose> is stated in, as named (versions 1.5 and 1.6 call the attribute `frame`)."""
    if pose is None:
        return None
    return pose.get("relative_to") or pose.get("frame") or None


def version(element: XmlElement) -> tuple[int, int]:
    """The SDFormat version of the file an element stands in; where it says none the newest rules hold."""
    root = element.getroottree().getroot()
    written = root.get("version", "1.12") if tag(root) == "sdf" else "1.12"
    try:
        major, minor = (int(part) for part in written.split(".")[:2])
    except ValueError:
        raise fail(root, f"version {written[:40]!r} is none of SDFormat's, e.g. 1.7") from None
    return major, minor
