"""Building one mechanism out of several: descriptions placed side by side under a common root."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import NamedTuple

from ccpin.arrays import Array, instance, records
from ccpin.description.checks import check
from ccpin.description.model import IDENTITY, Coupling, Joint, Link, LoopClosure, MechanismDescription, placement


class Part(NamedTuple):
    """A description to be placed in a larger one.

    Attributes:
        description: The part; its links, joints, closures and couplings are renamed ``<prefix><name>``.
        placement: Its root link's frame in the common root: 4×4, a `pinocchio.SE3` or (xyz, rpy).
    """

    description: MechanismDescription
    placement: Array = IDENTITY


def combine(
    name: str,
    parts: Mapping[str, Part],
    *,
    links: Iterable[Link] = (),
    joints: Iterable[Joint] = (),
    closures: Iterable[LoopClosure] = (),
    root: str = "world",
) -> MechanismDescription:
    """Place parts under a common root link and add what joins them.

    Args:
        name: The new mechanism's name.
        parts: Parts by prefix (``{"left_": …, "right_": …}``).
        links: Further links, e.g. what two arms hold.
        joints: Further tree joints, by the parts' new names.
        closures: The loops that close the whole.
        root: Name of the common root link.

    Raises:
        DescriptionError: The whole is unsound (see `ccpin.description.checks.check`).
    """
    instance(parts, "parts", Mapping, "a mapping of prefixes to Part")
    parts = {prefix: instance(part, f"parts['{prefix}']", Part) for prefix, part in parts.items()}
    renamed = {prefix: _renamed(part.description, prefix) for prefix, part in parts.items()}
    mounts = [
        Joint(f"{prefix}mount", "fixed", root, renamed[prefix].root, placement(part.placement, f"parts['{prefix}']"))
        for prefix, part in parts.items()
    ]
    every = list(renamed.values())
    return check(
        MechanismDescription(
            name=name,
            root=root,
            links=(Link(root), *(link for d in every for link in d.links), *records(links, "links", Link)),
            joints=(*mounts, *(joint for d in every for joint in d.joints), *records(joints, "joints", Joint)),
            closures=(*(c for d in every for c in d.closures), *records(closures, "closures", LoopClosure)),
            couplings=tuple(c for d in every for c in d.couplings),
            actuated=tuple(joint for d in every for joint in d.actuated or ()) or None,
            motors=tuple(motor for d in every for motor in d.motors),
            reference={joint: value for d in every for joint, value in d.reference.items()},
            notes=tuple(note for d in every for note in d.notes),
        )
    )


def _renamed(d: MechanismDescription, prefix: str) -> MechanismDescription:
    return replace(
        d,
        root=prefix + d.root,
        links=tuple(replace(link, name=prefix + link.name) for link in d.links),
        joints=tuple(
            replace(j, name=prefix + j.name, parent=prefix + j.parent, child=prefix + j.child) for j in d.joints
        ),
        closures=tuple(
            replace(c, name=prefix + c.name, link_a=prefix + c.link_a, link_b=prefix + c.link_b) for c in d.closures
        ),
        couplings=tuple(
            Coupling(prefix + c.name, tuple(replace(t, joint=prefix + t.joint) for t in c.terms)) for c in d.couplings
        ),
        actuated=None if d.actuated is None else tuple(prefix + name for name in d.actuated),
        motors=tuple(replace(m, name=prefix + m.name, joint=prefix + m.joint) for m in d.motors),
        reference={prefix + name: value for name, value in d.reference.items()},
        poses={},  # of a part: the whole is in none of them
        notes=tuple(f"{prefix}: {note}" for note in d.notes),
    )
