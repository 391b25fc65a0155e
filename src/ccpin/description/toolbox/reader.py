"""The reader of toolbox-parallel-robots files: a robot.yaml that closes and motorises the robot.urdf beside it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from ccpin.arrays import frozen
from ccpin.description.checks import check
from ccpin.description.elements.xml import parse_xml
from ccpin.description.model import Joint, Link, LoopClosure, MechanismDescription
from ccpin.description.urdf.reader import urdf_description
from ccpin.errors import DescriptionError, DescriptionNotFoundError, InvalidXmlError

MAX_BYTES = 128 * 1024  # 128 KiB: bounds what a file makes the parser do
MAX_DEPTH = 8  # lists and tables inside each other: bounds the recursion that reads them
KEYS = ("closed_loop", "type", "name_mot", "joint_name", "joint_type")
AXES = dict(zip("XYZ", map(frozen, np.eye(3)), strict=True))  # by their letters in UJOINT_ab
UNIVERSAL = tuple(f"UJOINT_{a}{b}" for a in AXES for b in AXES if a != b)
JOINT_TYPES = ("SPHERICAL", "FIXED", *UNIVERSAL)


def _fail(source: str, element: str, message: str) -> DescriptionError:
    return DescriptionError(message, source=source, element=element)


class ToolboxDocument(NamedTuple):
    """What a robot.yaml states: two frames and ``"3d"`` or ``"6d"`` a loop, motors, joint types by name, notes."""

    pairs: tuple[tuple[str, str], ...]
    kinds: tuple[str, ...]
    motors: tuple[str, ...]
    overrides: dict[str, str]
    notes: tuple[str, ...]


def toolbox_description(text: bytes, file: Path) -> MechanismDescription:
    """Read a toolbox-parallel-robots YAML and the URDF beside it (``robot.urdf``, or the only ``.urdf`` there).

    A closed_loop pair names two frames, each a link or a joint (whose frame moves with its child link). The type
    ``3d`` makes their origins coincide (spherical), any other makes the frames coincide (fixed).

    Joint types apply in the joint's own frame: SPHERICAL frees every rotation about its origin, FIXED locks it at
    zero, UJOINT_ab replaces it by ``<name>_a``, which turns about that frame's axis a, and ``<name>_b``, about the
    turned frame's axis b, with a massless link between them.

    Raises:
        DescriptionNotFoundError: There is no URDF beside it, or several of which none is called robot.urdf.
        InvalidXmlError: One of the files is malformed, or refused for safety.
        DescriptionError: A list has the wrong length, a name does not exist, or the URDF is unsound.
    """
    source = str(file)
    document = parse_document(text, source)
    urdf = _urdf_beside(file)
    try:
        description = urdf_description(parse_xml(urdf.read_bytes(), str(urdf)))
    except OSError as error:
        raise DescriptionNotFoundError(f"cannot be read: {error.strerror}", source=str(urdf)) from None
    description = _override(description, document.overrides, source)
    movable = [joint.name for joint in description.joints if joint.kind != "fixed"]
    missing = [name for name in document.motors if name not in movable]
    if missing:
        listed = f"not among the movable joints, which are {', '.join(movable)}"
        raise _fail(source, "name_mot", f"{', '.join(missing)}: {listed}")
    return check(
        replace(
            description,
            closures=description.closures + _closures(document, description, source),
            actuated=document.motors or description.actuated,
            source=source,
            notes=description.notes + document.notes,
        )
    )


def _urdf_beside(file: Path) -> Path:
    named = file.parent / "robot.urdf"
    if named.is_file():
        return named
    found = sorted(path for path in file.parent.glob("*.urdf") if path.is_file())
    if len(found) == 1:
        return found[0]
    lack = f"none of {', '.join(path.name for path in found)} is called robot.urdf" if found else "there is no .urdf"
    raise DescriptionNotFoundError(f"needs its robot.urdf in the same folder: {lack}", source=str(file))


def _closures(document: ToolboxDocument, description: MechanismDescription, source: str) -> tuple[LoopClosure, ...]:
    links = {link.name for link in description.links}
    carriers = {joint.name: joint.child for joint in description.joints}
    for name, kind in document.overrides.items():
        if kind in UNIVERSAL:
            carriers[name] = carriers[f"{name}_{kind[-1]}"]

    def link_of(name: str) -> str:
        """The link whose frame that name stands for."""
        element = f"closed_loop frame '{name}'"
        if name not in links and name not in carriers:
            raise _fail(source, element, "is neither a link nor a joint of the URDF")
        if name in links and carriers.get(name, name) != name:
            message = f"is a link and a joint with another child ('{carriers[name]}'): rename one of them"
            raise _fail(source, element, message)
        return name if name in links else carriers[name]

    return tuple(
        LoopClosure(f"{a}_{b}", "spherical" if kind == "3d" else "fixed", link_of(a), link_of(b))
        for (a, b), kind in zip(document.pairs, document.kinds, strict=True)
    )


def _override(description: MechanismDescription, overrides: dict[str, str], source: str) -> MechanismDescription:
    """Apply the joint types; what the URDF says of such a joint's position, limits and rotor no longer applies."""
    joints, between, notes = list[Joint](), list[Link](), list[str]()
    _check_overrides(description, overrides, source)
    for joint in description.joints:
        kind = overrides.get(joint.name)
        if kind is None:
            joints.append(joint)
            continue
        words = {"rotor inertia": joint.armature, "damping": joint.damping, "friction": joint.breakaway_level}
        lost = [word for word, value in (words | {"spring": joint.stiffness}).items() if value]
        if lost:
            notes.append(f"{source}: joint '{joint.name}' becomes {kind} and loses its {', '.join(lost)}")
        if kind in UNIVERSAL:
            first, middle, second = _universal(joint, kind)
            joints += [first, second]
            between.append(middle)
        else:
            new = "fixed" if kind == "FIXED" else "spherical"
            joints.append(Joint(joint.name, new, joint.parent, joint.child, joint.placement))
    kept = {joint.name for joint in joints if joint.kind != "fixed"}
    marked = description.independent
    return replace(
        description,
        links=description.links + tuple(between),
        joints=tuple(joints),
        independent=None if marked is None else tuple(name for name in marked if name in kept),
        actuated=None if description.actuated is None else tuple(n for n in description.actuated if n in kept) or None,
        motors=tuple(motor for motor in description.motors if motor.joint in kept),
        reference={name: value for name, value in description.reference.items() if name not in overrides},
        notes=description.notes + tuple(notes),
    )


def _check_overrides(description: MechanismDescription, overrides: dict[str, str], source: str) -> None:
    kinds = {joint.name: joint.kind for joint in description.joints}
    for name, kind in overrides.items():
        element = f"joint_name '{name}'"
        if name not in kinds:
            raise _fail(source, element, "is not a joint of the URDF")
        if kind not in JOINT_TYPES:
            raise _fail(source, element, f"joint_type '{kind}' is not one of {', '.join(JOINT_TYPES)}")
        if kinds[name] == "fixed" and kind != "FIXED":
            raise _fail(source, element, f"is fixed in the URDF, and joint_type {kind} changes movable joints only")


def _universal(joint: Joint, kind: str) -> tuple[Joint, Link, Joint]:
    """The two revolute joints of UJOINT_ab and the massless link between them."""
    a, b = kind[-2], kind[-1]
    middle = Link(f"{joint.name}_{a}_link")
    first = Joint(f"{joint.name}_{a}", "revolute", joint.parent, middle.name, joint.placement, AXES[a])
    return first, middle, Joint(f"{joint.name}_{b}", "revolute", middle.name, joint.child, axis=AXES[b])


def parse_document(text: bytes, source: str) -> ToolboxDocument:
    """Read and check a robot.yaml.

    Raises:
        InvalidXmlError: Not YAML, or refused for safety.
        DescriptionError: A key is missing, or a list has the wrong length or holds anything but names.
    """
    content = _parse_yaml(text, source)
    if not isinstance(content, dict) or "closed_loop" not in content:
        raise _fail(source, "closed_loop", f"not a mapping with the keys {', '.join(KEYS)}")
    pairs = content["closed_loop"]
    if not isinstance(pairs, list) or not all(isinstance(pair, list) and len(pair) == 2 for pair in pairs):
        raise _fail(source, "closed_loop", "not a list of pairs [frameA, frameB]")
    named = [_names(pair, "closed_loop", source) for pair in pairs]
    notes = [f"{source}: the key '{key}' is not read" for key in content if key not in KEYS]
    if "type" not in content:
        notes.append(f"{source}: 'type' is missing, every loop is taken as 6d")
    kinds = _names(content.get("type", ["6d"] * len(pairs)), "type", source)
    joints = _names(content.get("joint_name", []), "joint_name", source)
    types = _names(content.get("joint_type", []), "joint_type", source)
    motors = _names(content.get("name_mot", []), "name_mot", source)
    lengths = ("type", kinds, "closed_loop", pairs), ("joint_type", types, "joint_name", joints)
    for key, values, other, others in lengths:
        if len(values) != len(others):
            raise _fail(source, key, f"has {len(values)} entries where {other} has {len(others)}")
    for key, names in (("joint_name", joints), ("name_mot", motors)):
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise _fail(source, key, f"{', '.join(twice)} named more than once")
    return ToolboxDocument(
        pairs=tuple((a, b) for a, b in named),
        kinds=tuple("3d" if kind.lower() == "3d" else "6d" for kind in kinds),
        motors=tuple(motors),
        overrides=dict(zip(joints, types, strict=True)),
        notes=tuple(notes),
    )


def _parse_yaml(text: bytes, source: str) -> Any:
    """The document as lists, dicts and strings, refused if too large or deep, or with tags, anchors or aliases."""
    if len(text) > MAX_BYTES:
        raise InvalidXmlError(f"the YAML is larger than {MAX_BYTES} bytes", source=source)
    try:
        _refuse_constructs(text, source)
        return yaml.load(text, Loader=yaml.BaseLoader)
    except (yaml.YAMLError, UnicodeError) as error:
        reason = " ".join(str(error).split())
        raise InvalidXmlError(f"not well-formed YAML: {reason[:300]}", source=source) from None


def _refuse_constructs(text: bytes, source: str) -> None:
    """Go through the parser's events, which it finds without recursion and without building anything."""
    depth = 0
    for event in yaml.parse(text, Loader=yaml.BaseLoader):
        where = f"line {event.start_mark.line + 1}" if event.start_mark else None
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > MAX_DEPTH:
            raise InvalidXmlError(f"nested more than {MAX_DEPTH} deep", source=source, element=where)
        if getattr(event, "anchor", None) is not None:
            raise InvalidXmlError("anchors and aliases are refused: repeat the names", source=source, element=where)
        tag = getattr(event, "tag", None)
        if tag is not None:
            raise InvalidXmlError(f"the tag {tag[:80]!r} is refused", source=source, element=where)


def _names(value: Any, key: str, source: str) -> list[str]:
    if not isinstance(value, list) or not all(isinstance(name, str) and name.strip() for name in value):
        raise _fail(source, key, "not a list of names")
    return value
