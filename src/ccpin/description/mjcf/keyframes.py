"""MJCF's keyframes as named poses."""

from __future__ import annotations

from collections.abc import Iterable

from ccpin.description.elements.xml import XmlElement
from ccpin.description.mjcf.element import Element
from ccpin.description.mjcf.joints import WorldBody

Pose = dict[str, tuple[float, ...]]


def read_keyframes(sections: Iterable[XmlElement], tree: WorldBody) -> dict[str, Pose]:
    """The displacements at each ``<key>`` that states qpos, by its name, or ``key_1``, … by its place in the file.

    Raises:
        DescriptionError: qpos has not as many numbers as the model, or a name comes twice.
    """
    poses: dict[str, Pose] = {}
    for index, xml in enumerate((xml for section in sections for xml in section.iterchildren("*")), start=1):
        said = Element.of(xml)
        name = said.text("name") or f"key_{index}"
        if name in poses:
            raise said.fail(f"the key name '{name}' is used twice")
        if said.text("qpos") is None:
            continue
        size = sum(len(value) for value in tree.reference.values())
        numbers = said.vector("qpos", size).tolist()
        poses[name] = {joint: _displacement(numbers, len(value)) for joint, value in tree.reference.items()}
    return poses


def _displacement(numbers: list[float], size: int) -> tuple[float, ...]:
    """Take a joint's numbers off the front; MuJoCo's quaternions have w first."""
    taken = [numbers.pop(0) for _ in range(size)]
    if size >= 4:
        w = taken.pop(-4)
        taken.append(w)
    return tuple(taken)
