"""What a file's numbers make doubtful: units mixed up, degrees for radians, one hinge askew in a loop.

No law forbids any of these numbers, but for one: in a loop of hinges alone Σ ωₖ aₖ = 0 over their axes aₖ, so where all
but one axis are parallel the odd one's ω is 0. It cannot turn, and so the others stay parallel.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal, NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.description.checks import principal_moments
from ccpin.description.joint_kinds import FIXED, JOINT_KINDS
from ccpin.description.model import Inertia, LoopClosure, MechanismDescription
from ccpin.kinematics.loops import loop_path
from ccpin.kinematics.points import joint_poses
from ccpin.kinematics.tree import Tree

_AFAR = 30.0  # times: a body so much larger or smaller than the mechanism is in other units, or made up
_MANY_TURNS, _MOST_DEGREES, _ROUND = 30.0, 720.0, 5.0  # rad; a limit between them and a multiple of this may be degrees
_PARALLEL = 1e-6  # sine of the angle between two axes of a file

Weight = Literal["wrong", "doubtful", "note"]


class Finding(NamedTuple):
    """One thing found, in a sentence, and its weight."""

    weight: Weight
    sentence: str


def of_units(description: MechanismDescription) -> Iterator[Finding]:
    """Centres of mass and radii of gyration √(J/m) beside the largest distance between joints, m."""
    size = reach(description)
    moving = {joint.child for joint in description.joints if joint.kind != FIXED}
    solid = [(x.name, x.inertia) for x in description.links if x.name in moving and x.inertia and x.inertia.mass > 0.0]
    radii = [_gyration(inertia) for _, inertia in solid]
    for (name, inertia), radius in zip(solid, radii, strict=True):
        far = float(np.linalg.norm(inertia.com))
        for what, length in (
            ("its centre of mass is", far),
            ("its moments of inertia are those of a radius of", radius),
        ):
            if length > _AFAR * size:
                yield Finding("doubtful", f"link '{name}': {what} {length:.3g} m, and {_beside(size)}")
    if 0.0 < max(radii, default=0.0) < size / _AFAR:
        bodies = f"all moments of inertia are those of bodies of {max(radii):.2g} m or less"
        yield Finding("doubtful", f"{bodies}, and {_beside(size)}")


def reach(description: MechanismDescription) -> float:
    """The longest way from joint to joint or to a loop's end, m; 1 where all are in one point."""
    ends = [place for closure in description.closures for place in (closure.placement_a, closure.placement_b)]
    places = [*(joint.placement for joint in description.joints), *ends]
    return max((float(np.linalg.norm(place[:3, 3])) for place in places), default=0.0) or 1.0


def _beside(size: float) -> str:
    return f"joints are {size:.3g} m apart at most: which is in other units than m, kg, kg m²?"


def _gyration(inertia: Inertia) -> float:
    return float(np.sqrt(max(principal_moments(inertia)[-1], 0.0) / inertia.mass))


def of_limits(description: MechanismDescription) -> Iterator[Finding]:
    """Limits of angles that are many turns and round numbers."""
    for joint in description.joints:
        if joint.kind == FIXED or not JOINT_KINDS[joint.kind].angle:
            continue
        stated = [x for x in (joint.lower, joint.upper) if _MANY_TURNS <= abs(x) <= _MOST_DEGREES and x % _ROUND == 0.0]
        if stated:
            turns = f"{abs(stated[-1]) / (2 * np.pi):.0f} turns"
            yield Finding(
                "note", f"joint '{joint.name}' has a limit of {stated[-1]:g} rad, which is {turns}: is it in degrees?"
            )


def in_radians(description: MechanismDescription) -> dict[str, tuple[float, ...]]:
    """The reference pose with its angles taken for degrees."""
    kinds = {joint.name: joint.kind for joint in description.joints if joint.kind != FIXED}
    turns = {name for name, kind in kinds.items() if JOINT_KINDS[kind].nv == 1 and not JOINT_KINDS[kind].sliding}
    stated = description.reference
    return {
        name: (float(np.radians(value[0])),) if name in turns and len(value) == 1 else value
        for name, value in stated.items()
    }


def of_axes(tree: Tree, description: MechanismDescription, q_free: Array) -> Iterator[Finding]:
    """Hinges that cannot turn at q′, of shape (nq,), as they alone are not parallel in a loop of hinges."""
    poses = joint_poses(tree.scratch, q_free)
    for closure in description.closures:
        axes = _axes(tree, poses, closure)
        for name in axes:
            others = [axis for other, axis in axes.items() if other != name]
            apart = _sine(others[0], axes[name]) if len(others) > 2 else 0.0
            if apart > _PARALLEL and all(_sine(others[0], axis) <= _PARALLEL for axis in others):
                own = "the loop's own joint" if name == closure.name else f"joint '{name}'"
                said = f"the other {len(others)} axes of loop '{closure.name}' are parallel, its own is not"
                yield Finding(
                    "doubtful", f"{own} cannot turn: {said}, by {np.degrees(np.arcsin(min(apart, 1.0))):.3g}°"
                )


def _axes(tree: Tree, poses: Array, closure: LoopClosure) -> dict[str, Array]:
    """The axes of a loop of hinges in the world by name; none where something else is in it."""
    path = loop_path(tree, closure)
    joints = [tree.joints[number - 1] for number in (*path.a, *path.b)]
    if closure.kind != "revolute" or any(joint.kind.nv != 1 or joint.kind.sliding for joint in joints):
        return {}
    axes = {joint.name: poses[joint.number, :3, :3] @ joint.kind.directions(joint.axis)[0] for joint in joints}
    frame = poses[path.carrier_a.joint] @ path.carrier_a.placement @ closure.placement_a
    return axes | {closure.name: frame[:3, 2]}


def _sine(a: Array, b: Array) -> float:
    return float(np.linalg.norm(np.cross(a, b)))
