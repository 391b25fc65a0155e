"""The attributes of SDFormat's elements: what is not known is named in a note, what is nearly known is refused.

Which elements stand where is asked where each is read (`values.unread`).
"""

from __future__ import annotations

from collections import Counter

from ccpin.description.elements.xml import XmlElement, doubled, strange_attributes, tag
from ccpin.description.sdf.drake_constraints import CONSTRAINTS

ATTRIBUTES: dict[str, tuple[str, ...]] = {
    "sdf": ("version",),
    "world": ("name",),
    "model": ("name", "canonical_link", "placement_frame"),
    "link": ("name",),
    "joint": ("name", "type"),
    "frame": ("name", "attached_to"),
    "pose": ("relative_to", "frame", "degrees", "rotation_format"),
    "inertial": ("auto",),
    "xyz": ("expressed_in",),
    "mimic": ("joint", "axis"),
    "include": ("merge",),
    "uri": (),
    **dict.fromkeys(("parent", "child", "axis", "axis2", "limit", "dynamics", "inertia", "mass"), ()),
    **dict.fromkeys(("lower", "upper", "effort", "velocity", "damping", "friction", "spring_stiffness"), ()),
    **dict.fromkeys(
        ("spring_reference", "multiplier", "offset", "reference", "gearbox_ratio", "gravity", "static"), ()
    ),
    **dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz", "placement_frame", "name"), ()),
}
_REPEATED = frozenset({"world", "model", "link", "joint", "frame", "include", *CONSTRAINTS})
_OTHERS = frozenset({"plugin", "sensor", "visual", "collision", "light", "gui", "scene", "physics", "actor", "state"})


def check_attributes(element: XmlElement, notes: list[str]) -> None:
    """Note every attribute that is not known, of an element and those in it that bear on the mechanism.

    Raises:
        DescriptionError: One is nearly the name of one that is missing there.
    """
    strange: Counter[str] = Counter()
    _check(element, strange)
    notes += doubled(element, _REPEATED, _OTHERS)
    notes += [said + (f" ({count} of it)" if count > 1 else "") for said, count in strange.items()]


def _check(element: XmlElement, strange: Counter[str]) -> None:
    known = ATTRIBUTES.get(tag(element))
    if known is not None and not element.prefix:
        strange.update(f"{name} of <{tag(element)}> is not read" for name in strange_attributes(element, known))
    for inner in element.iterchildren("*"):
        if tag(inner) not in _OTHERS:
            _check(inner, strange)
