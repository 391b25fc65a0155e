"""A mechanism with other constants: as a description that has what its equations are linear in, and as a model."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array, instance
from ccpin.description.changes.overrides import with_stated
from ccpin.description.model import Inertia, Joint, Link, MechanismDescription
from ccpin.dynamics.parameters import BODY, INERTIAL, DynamicParameters
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.errors import InvalidInputError
from ccpin.kinematics.tree import ROOT_JOINT, build_tree
from ccpin.mechanism.mechanism import Mechanism

AT_LEAST_ZERO = ("armature", "damping", "friction", "stiffness")
"""Kinds of constants of joints that are not negative."""


def with_constants(model: ReducedModel | Mechanism, parameters: DynamicParameters) -> MechanismDescription:
    """What the model's file says, with other constants: to be loaded, or written by `ccpin.description`.

    A link that a movable joint carries takes its body's inertia, less that of the links fixed to it; a
    joint with a Stribeck speed, which stays, the breakaway level.

    Raises:
        InvalidInputError: The constants are another mechanism's, a spring has an offset and no stiffness, a rotor,
            damper, dry friction or spring is negative, or a body has no mass or moments that no body has
            (`ccpin.identification.consistent` finds such as have).
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
        if kind in AT_LEAST_ZERO and value < 0.0:
            raise InvalidInputError(f"'{name}' would be {value:.3g}, and may not be negative")
        if kind not in INERTIAL:
            changes.setdefault(name.partition(":")[2], {})[kind] = value
    for name, change in changes.items():
        offset, stiffness = change.pop("offset", 0.0), change.get("stiffness", 0.0)
        if "stribeck" in change:
            change["breakaway"] = change["friction"] + change.pop("stribeck")
        if offset and not stiffness:
            raise InvalidInputError(
                f"the joint '{name}' has an offset of {offset:.3g} and no stiffness, which no file states"
            )
        change["spring_reference"] = offset / stiffness if stiffness else 0.0
    return with_stated(replace(description, links=tuple(links.values())), changes)


def stated_otherwise(
    model: ReducedModel, links: Callable[[Link], Link], joints: Callable[[Joint], Joint]
) -> ReducedModel:
    """The model with other masses and other numbers of joints, in the same coordinates: closures stay as they are."""

    def changed(stated: MechanismDescription) -> MechanismDescription:
        return replace(stated, links=tuple(map(links, stated.links)), joints=tuple(map(joints, stated.joints)))

    mechanism = model.mechanism
    whole, held = changed(mechanism.description), mechanism.held and changed(mechanism.held)
    tree = build_tree(held or whole, ROOT_JOINT in mechanism.tree.names)
    return ReducedModel(replace(mechanism, description=whole, held=held, tree=tree), model.gravity_vector)


def with_stribeck_speeds(model: ReducedModel, speeds: Mapping[str, float]) -> ReducedModel:
    """The model whose joints have these Stribeck speeds, rad/s or m/s; 0: no such effect. Levels stay as stated."""

    def joint(each: Joint) -> Joint:
        speed = speeds.get(each.name, each.stribeck_speed)
        return replace(each, stribeck_speed=speed, breakaway=each.breakaway if speed else 0.0)

    return stated_otherwise(model, lambda link: link, joint) if speeds else model


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
