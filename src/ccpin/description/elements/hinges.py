"""Hinges that files state as two points of the same two bodies, for want of a hinge."""

from __future__ import annotations

import math

from ccpin.arrays import Array
from ccpin.description.model import LoopClosure, frame, rotation_to

_APART, _ROUNDED = 1e-4, 1e-4  # metres between two points of a hinge; share by which rounding may change that


def make_hinges(closures: list[LoopClosure], notes: list[str], word: str) -> None:
    """Replace two points of the same two bodies by the hinge they make, about the line through their points.

    Its sixth row, the points' distance, is the same number in both bodies, so it is redundant where the file states
    it exactly and contradicts the others where it is rounded (onshape-to-robot writes six digits): it is dropped.

    Args:
        closures: The spherical closures among them are looked at; changed in place.
        notes: Each hinge is noted here.
        word: What the format calls such closures.
    """
    points: dict[tuple[str, str], list[LoopClosure]] = {}
    for closure in closures:
        if closure.kind == "spherical":
            points.setdefault((closure.link_a, closure.link_b), []).append(closure)
    for pair in points.values():
        lines = [other - first for first, other in zip(_points(pair[0]), _points(pair[-1]), strict=True)]
        lengths = [math.hypot(*line) for line in lines]
        if len(pair) != 2 or min(lengths) < _APART or abs(lengths[0] - lengths[1]) > _ROUNDED * lengths[0]:
            continue
        first, second = pair
        a, b = (
            frame(point, rotation_to(line / length))
            for point, line, length in zip(_points(first), lines, lengths, strict=True)
        )
        hinge = LoopClosure(first.name, "revolute", first.link_a, first.link_b, a, b)
        closures[closures.index(first)] = hinge
        closures.remove(second)
        notes.append(f"The {word} '{first.name}' and '{second.name}' of the same bodies are read as a hinge.")


def _points(closure: LoopClosure) -> tuple[Array, Array]:
    return closure.placement_a[:3, 3], closure.placement_b[:3, 3]
