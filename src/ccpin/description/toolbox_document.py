"""The robot.yaml of toolbox-parallel-robots as checked lists of names.

These files hold names only, so they are read as names: every scalar is text, and tags, anchors, aliases and deep
nesting, which they never need, are refused before anything is built from them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import yaml

from ccpin.errors import DescriptionError, InvalidXmlError

MAX_BYTES = 128 * 1024
MAX_DEPTH = 8
KEYS = ("closed_loop", "type", "name_mot", "joint_name", "joint_type")


class ToolboxDocument(NamedTuple):
    """What a robot.yaml states.

    Attributes:
        pairs: The two frames of each loop.
        kinds: ``"3d"`` or ``"6d"``, one a pair.
        motors: Actuated joints.
        overrides: Joint types by joint name.
        notes: What was assumed or left out.
    """

    pairs: tuple[tuple[str, str], ...]
    kinds: tuple[str, ...]
    motors: tuple[str, ...]
    overrides: dict[str, str]
    notes: tuple[str, ...]


def parse_document(text: bytes, source: str) -> ToolboxDocument:
    """Read and check a robot.yaml.

    Raises:
        InvalidXmlError: Not YAML, or refused for safety.
        DescriptionError: A key is missing, or a list has the wrong length or holds anything but names.
    """
    content = _parse_yaml(text, source)
    if not isinstance(content, dict) or "closed_loop" not in content:
        raise DescriptionError(f"not a mapping with the keys {', '.join(KEYS)}", source=source, element="closed_loop")
    pairs = content["closed_loop"]
    if not isinstance(pairs, list) or not all(isinstance(pair, list) and len(pair) == 2 for pair in pairs):
        raise DescriptionError("not a list of pairs [frameA, frameB]", source=source, element="closed_loop")
    named = [_names(pair, "closed_loop", source) for pair in pairs]
    notes = [f"{source}: the key '{key}' is not read" for key in content if key not in KEYS]
    if "type" not in content:
        notes.append(f"{source}: 'type' is missing, every loop is taken as 6d")
    kinds = _names(content.get("type", ["6d"] * len(pairs)), "type", source)
    joints = _names(content.get("joint_name", []), "joint_name", source)
    types = _names(content.get("joint_type", []), "joint_type", source)
    motors = _names(content.get("name_mot", []), "name_mot", source)
    _same_length("type", kinds, "closed_loop", pairs, source)
    _same_length("joint_type", types, "joint_name", joints, source)
    for key, names in (("joint_name", joints), ("name_mot", motors)):
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise DescriptionError(f"{', '.join(twice)} named more than once", source=source, element=key)
    return ToolboxDocument(
        pairs=tuple((a, b) for a, b in named),
        kinds=tuple("3d" if kind.lower() == "3d" else "6d" for kind in kinds),
        motors=tuple(motors),
        overrides=dict(zip(joints, types, strict=True)),
        notes=tuple(notes),
    )


def _parse_yaml(text: bytes, source: str) -> Any:
    """The document as lists, dicts and strings.

    Raises:
        InvalidXmlError: Not YAML, too large or too deep, or with tags, anchors or aliases.
    """
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
        raise DescriptionError("not a list of names", source=source, element=key)
    return value


def _same_length(key: str, values: list[str], other: str, others: list[Any], source: str) -> None:
    if len(values) != len(others):
        raise DescriptionError(f"has {len(values)} entries where {other} has {len(others)}", source=source, element=key)
