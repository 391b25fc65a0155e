"""Writing a description as the pair of files that toolbox-parallel-robots reads: robot.yaml and robot.urdf."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml

from ccpin.arrays import Array
from ccpin.description.elements.xml import cannot
from ccpin.description.model import IDENTITY, Joint, Link, LoopClosure, MechanismDescription, frame
from ccpin.description.urdf.writer import write_urdf
from ccpin.errors import InvalidInputError
from ccpin.files import write_text

_AXIS_POINT = frame([0.0, 0.0, 0.1])  # a second point on the axis, 0.1 m along it: with both held, one turn is left


class _Pair(NamedTuple):
    """Two frames that one entry of closed_loop joins: their names, the type, and the fixed joints that carry them."""

    frames: tuple[str, str]
    kind: str
    joints: tuple[Joint, Joint]


def write_toolbox(description: MechanismDescription, path: str | Path) -> tuple[str, ...]:
    """Write robot.yaml at `path`, and its robot.urdf beside it.

    The frames that a loop joins are links of their own, fixed where the closure's frames are. A revolute closure,
    which the format has not, becomes two spherical ones on its axis.

    Returns:
        What is stated and not written, in sentences.

    Raises:
        DescriptionError: A closure of another kind, or what `write_urdf` refuses.
        InvalidInputError: A file cannot be written, or robot.urdf beside it is what was read, or a part of that.
    """
    beside = Path(path).with_name("robot.urdf")
    if beside.exists() and _was_read(beside, Path(path), Path(description.source or "")):
        raise InvalidInputError(f"'{path}' has its robot.urdf beside it, which is what was read: use another folder")
    joined = [pair for closure in description.closures for pair in _pairs(description, closure)]
    links = [Link(name) for pair in joined for name in pair.frames]
    joints = [joint for pair in joined for joint in pair.joints]
    everything = {"links": (*description.links, *links), "joints": (*description.joints, *joints)}
    urdf = replace(description, closures=(), **everything)  # type: ignore[arg-type]
    notes = write_urdf(urdf, beside)
    document = {
        "closed_loop": [list(pair.frames) for pair in joined],
        "type": [pair.kind for pair in joined],
        "name_mot": list(description.actuated or ()),
    }
    text = yaml.safe_dump(document, sort_keys=False, default_flow_style=None, allow_unicode=True)
    write_text(path, text)
    return notes


def _was_read(beside: Path, path: Path, source: Path) -> bool:
    """Whether robot.urdf is the source, or belongs to a YAML that is the source and another than the one to write."""
    if not source.is_file():
        return False
    of_another = source.suffix in (".yaml", ".yml") and source.parent.samefile(beside.parent)
    return beside.samefile(source) or (of_another and source.resolve() != path.resolve())


def _pairs(description: MechanismDescription, closure: LoopClosure) -> list[_Pair]:
    """The entries that ask for what a closure asks for."""
    name = closure.name
    if closure.kind == "fixed":
        return [_pair(closure, name, "6d", IDENTITY)]
    if closure.kind == "spherical":
        return [_pair(closure, name, "3d", IDENTITY)]
    if closure.kind == "revolute":
        return [_pair(closure, name, "3d", IDENTITY), _pair(closure, f"{name}_axis", "3d", _AXIS_POINT)]
    raise cannot(description, f"closure '{name}'", f"a robot.yaml has no {closure.kind} closure")


def _pair(closure: LoopClosure, name: str, kind: str, along: Array) -> _Pair:
    frames = tuple(f"{name}_{side}" for side in "ab")
    joints = tuple(
        Joint(f"{own}_fixed", "fixed", link, own, np.asarray(placement) @ along)
        for own, (link, placement) in zip(frames, closure.ends, strict=True)
    )
    return _Pair((frames[0], frames[1]), kind, (joints[0], joints[1]))
