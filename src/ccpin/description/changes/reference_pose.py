"""The pose a user states near which the loops are to close: it chooses the assembly mode of the reference."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ccpin.description.joint_kinds import FIXED
from ccpin.description.model import MechanismDescription
from ccpin.description.names import choices
from ccpin.errors import InvalidInputError

Pose = str | Mapping[str, ArrayLike]
"""The name of a pose in the file, or joint displacements by name (`MechanismDescription.reference`)."""


def with_reference(description: MechanismDescription, pose: Pose) -> MechanismDescription:
    """The description with another reference pose.

    Args:
        description: What the file says.
        pose: One of its poses by name (a keyframe, a group_state), or displacements of some joints: the others stay as
            the file's reference has them.

    Raises:
        InvalidInputError: No such pose, no such movable joint, or something else than finite numbers.
    """
    if isinstance(pose, str):
        poses = {**description.poses, **({"reference": description.reference} if description.reference else {})}
        if pose not in poses:
            known = choices(pose, tuple(poses)) if poses else "the file names none: state joints, {'crank': 0.5}"
            raise InvalidInputError(f"reference: '{pose}' is no pose of the file; {known}")
        return replace(description, reference=poses[pose])
    if not isinstance(pose, Mapping):
        raise InvalidInputError("reference must be the name of a pose or a mapping like {'crank': 0.5}")
    movable = [joint.name for joint in description.joints if joint.kind != FIXED]
    stated = {name: _displacement(name, value, movable) for name, value in pose.items()}
    return replace(description, reference={**description.reference, **stated})


def _displacement(name: str, value: ArrayLike, movable: Sequence[str]) -> tuple[float, ...]:
    if name not in movable:
        raise InvalidInputError(f"reference: '{name}' is no movable joint; {choices(str(name), movable)}")
    try:
        numbers = np.atleast_1d(np.asarray(value, dtype=np.float64))
    except (TypeError, ValueError):
        numbers = np.array([np.nan])
    if numbers.ndim != 1 or not np.isfinite(numbers).all():
        raise InvalidInputError(f"reference: the displacement of '{name}' is {value!r}; it must be finite numbers")
    return tuple(numbers.tolist())
