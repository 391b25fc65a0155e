"""A description with some of its masses, lengths and joint numbers scaled: what parameter studies vary."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from ccpin.arrays import Array, instance, number
from ccpin.description.checks import check
from ccpin.description.model import Link, MechanismDescription, Visual, frame
from ccpin.description.names import choices
from ccpin.errors import InvalidInputError

Factors = Mapping[str, float] | float
"""A factor each by name, or one for all."""

_JOINT_FIELDS = ("friction", "damping", "stiffness", "armature")


def scaled(
    description: MechanismDescription,
    *,
    masses: Factors = 1.0,
    inertias: Factors = 1.0,
    lengths: Factors = 1.0,
    friction: Factors = 1.0,
    damping: Factors = 1.0,
    stiffness: Factors = 1.0,
    armature: Factors = 1.0,
) -> MechanismDescription:
    """A description whose numbers are multiplied: ``{name: factor}`` each, or one factor for all.

    For a mechanism as it was loaded: ``ccpin.load(scaled(mechanism.settled(), masses={"arm": 1.1}))``.

    Args:
        description: What is scaled.
        masses: By link: mass and rotational inertia, the link being of denser stuff.
        inertias: By link: the rotational inertia alone.
        lengths: By link: everything placed on it, in all three directions: joints, closure points, centre of mass,
            pictures; its mass is kept, its rotational inertia is multiplied by the square. Factors of several links
            must fit together for the loops to close.
        friction: By joint, its Coulomb and breakaway levels.
        damping: By joint.
        stiffness: By joint.
        armature: By joint.

    Raises:
        InvalidInputError: An unknown name, or a factor that is negative (of lengths: not positive) or not finite.
        DescriptionError: The result is unsound.
    """
    instance(description, "description", MechanismDescription)
    links, joints = [link.name for link in description.links], [joint.name for joint in description.joints]
    mass, inertia = _factors("masses", masses, links), _factors("inertias", inertias, links)
    length = _factors("lengths", lengths, links)
    for name, factor in length.items():
        if factor <= 0:
            raise InvalidInputError(f"lengths: the factor of '{name}' is {factor}; it must be positive")
    given = zip(_JOINT_FIELDS, (friction, damping, stiffness, armature), strict=True)
    stated = {field: _factors(field, factors, joints) for field, factors in given}
    stated["breakaway"] = stated["friction"]
    return check(
        replace(
            description,
            links=tuple(_link(l, mass[l.name], inertia[l.name], length[l.name]) for l in description.links),  # noqa: E741
            joints=tuple(
                replace(
                    joint,
                    placement=_moved(joint.placement, length[joint.parent]),
                    **{field: getattr(joint, field) * factors[joint.name] for field, factors in stated.items()},
                )
                for joint in description.joints
            ),
            closures=tuple(
                replace(
                    closure,
                    placement_a=_moved(closure.placement_a, length[closure.link_a]),
                    placement_b=_moved(closure.placement_b, length[closure.link_b]),
                )
                for closure in description.closures
            ),
        )
    )


def _factors(word: str, factors: Factors, names: Iterable[str]) -> dict[str, float]:
    """A factor for each name; 1 where none is given."""
    known = list(names)
    given = factors if isinstance(factors, Mapping) else dict.fromkeys(known, factors)
    for name, factor in given.items():
        if name not in known:
            raise InvalidInputError(f"{word}: there is no '{name}'; {choices(str(name), known)}")
        number(factor, f"{word}: the factor of '{name}'", "a number, 0 or more", -1e-300)
    return {name: float(given.get(name, 1.0)) for name in known}


def _link(link: Link, mass: float, inertia: float, length: float) -> Link:
    visuals = link.visuals
    if length != 1.0:
        visuals = tuple(_visual(visual, length) for visual in visuals)
    if link.inertia is None:
        return replace(link, visuals=visuals)
    body, turn = link.inertia, mass * inertia * length**2
    body = replace(body, mass=mass * body.mass, com=length * body.com, rotational=turn * body.rotational)
    return replace(link, inertia=body, visuals=visuals)


def _visual(visual: Visual, length: float) -> Visual:
    shape = replace(visual.shape, size=tuple(length * size for size in visual.shape.size))
    return replace(visual, shape=shape, placement=_moved(visual.placement, length))


def _moved(placement: Array, length: float) -> Array:
    """A frame further from (or nearer to) its link's origin."""
    return placement if length == 1.0 else frame(length * placement[:3, 3], np.asarray(placement[:3, :3]))
