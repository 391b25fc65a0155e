"""A mechanism's description with other constants: what its equations of motion are linear in, written into the file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array, instance
from ccpin.description.changes.overrides import with_stated
from ccpin.description.model import Inertia, MechanismDescription
from ccpin.dynamics.parameters import BODY, INERTIAL, DynamicParameters
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.errors import InvalidInputError
from ccpin.mechanism.mechanism import Mechanism


def with_constants(model: ReducedModel | Mechanism, parameters: DynamicParameters) -> MechanismDescription:
    """What the model's file says, with other constants: to be loaded, or written by `ccpin.description`.

    A link that a movable joint carries takes its body's inertia, less that of the links fixed to it.

    Raises:
        InvalidInputError: The constants are another mechanism's, a spring has an offset and no stiffness, or a body has
            no mass or moments that no body has (`ccpin.identification.consistent` finds such as have).
    """
    model = model_of(model)
    stated, tree, description = model.parameters, model.mechanism.tree, model.mechanism.description
    if instance(parameters, "parameters", DynamicParameters).names != stated.names:
        raise InvalidInputError("the constants are those of another mechanism")
    links = {link.name: link for link in description.links}
    for joint, body in zip(tree.joints, bodies(stated), strict=True):
        if np.array_equal(parameters.values[body], stated.values[body]):
            continue
        name = joint.stated.child
        whole = _inertia(parameters.values[body], name)
        fixed = [(link, at) for link, at in tree.attachments.items() if at.joint == joint.number and link != name]
        for link, at in fixed:
            inertia = links[link].inertia
            if inertia is not None:
                whole -= pin.SE3(at.placement).act(pin.Inertia(inertia.mass, inertia.com, inertia.rotational))
        own = pin.SE3(tree.attachments[name].placement).actInv(whole)
        links[name] = replace(links[name], inertia=Inertia(own.mass, own.lever, own.inertia))
    changes: dict[str, dict[str, float]] = {}
    for kind, name, value in zip(stated.kinds, stated.names, parameters.values.tolist(), strict=True):
        if kind not in INERTIAL:
            changes.setdefault(name.partition(":")[2], {})[kind] = value
    for name, change in changes.items():
        offset, stiffness = change.pop("offset", 0.0), change.get("stiffness", 0.0)
        if offset and not stiffness:
            raise InvalidInputError(
                f"the joint '{name}' has an offset of {offset:.3g} and no stiffness, which no file states"
            )
        change["spring_reference"] = offset / stiffness if stiffness else 0.0
    return with_stated(replace(description, links=tuple(links.values())), changes)


def bodies(parameters: DynamicParameters) -> list[slice]:
    """Where the ten numbers of each body stand."""
    return [slice(k, k + BODY) for k, kind in enumerate(parameters.kinds) if kind == "mass"]


def _inertia(values: Array, name: str) -> pin.Inertia:
    if values[0] <= 0.0:
        raise InvalidInputError(f"'{name}' would have a mass of {values[0]:.3g} kg")
    found = pin.Inertia.FromDynamicParameters(values)
    x, y, z = np.linalg.eigvalsh(found.inertia)
    if x < 0.0 or x + y < z * (1.0 - 1e-9):
        raise InvalidInputError(
            f"'{name}' would have principal moments of {x:.3g}, {y:.3g}, {z:.3g} kg m², as no body has"
        )
    return found
