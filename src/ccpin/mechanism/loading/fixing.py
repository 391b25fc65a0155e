"""Joints of a description fixed at a displacement, whole or component by component."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array
from ccpin.description.joint_kinds import FIXED
from ccpin.description.model import Coupling, Joint, LoopClosure, MechanismDescription, frame, inverse, rotation_to
from ccpin.description.names import choices
from ccpin.errors import InvalidInputError
from ccpin.kinematics.tree import ROOT_JOINT, Tree, TreeJoint


def locked_joints(tree: Tree, names: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """The joints that names of joints or components lock, and which components of each (none: the whole joint).

    Raises:
        InvalidInputError: A name is of no movable joint of the file, or of none of its components.
    """
    asked = dict[str, list[str]]()
    for name in names:
        joint, component = tree.split(name)
        if joint not in tree.names or joint == ROOT_JOINT:
            movable = [name for name in tree.names if name != ROOT_JOINT]
            raise InvalidInputError(f"locked: '{joint}' is no movable joint of the file; {choices(joint, movable)}")
        kind = tree.joint(joint).kind
        if component and component not in kind.components:
            known = ", ".join(kind.components) or "none: name the joint alone"
            raise InvalidInputError(f"locked: '{name}': components of the {kind.name} joint '{joint}' are {known}")
        asked.setdefault(joint, []).extend([component] if component else kind.components)
    wholes = {joint: len(set(parts)) == len(tree.joint(joint).kind.components) for joint, parts in asked.items()}
    return {joint: () if wholes[joint] else tuple(dict.fromkeys(parts)) for joint, parts in asked.items()}


def fixed(
    description: MechanismDescription, tree: Tree, q_free: Array, names: Sequence[str]
) -> tuple[MechanismDescription, list[str]]:
    """The description with joints fixed where a configuration q′ of its tree has them, and what that entails, in words.

    Couplings keep what the joint gives them as a constant; one that leaves a single joint to move fixes that one too.
    """
    if not names:
        return description, list[str]()
    still, follows = list(names), []
    for coupling in _until_none(description.couplings, still):
        left = next(term.joint for term in coupling.terms if term.joint not in still)
        still.append(left)
        follows.append(f"'{left}' is locked too: coupling '{coupling.name}' leaves it no motion")
    inside = _placed(tree, q_free)
    driven = [name for name in description.actuated or () if name in still]
    if driven:
        follows.append(f"motors of {', '.join(driven)} are left out: the joints are locked")
    coupled = {name for coupling in description.couplings for name in _joints(coupling)}
    theta = {name: _displacement(tree, name, q_free) for name in coupled}

    def moving(marked: tuple[str, ...] | None) -> tuple[str, ...] | None:
        return None if marked is None else tuple(name for name in marked if name not in still)

    def without(pose: Mapping[str, tuple[float, ...]]) -> dict[str, tuple[float, ...]]:
        return {name: value for name, value in pose.items() if name not in still}

    couplings = (_folded(coupling, still, theta) for coupling in description.couplings)
    return replace(
        description,
        joints=tuple(
            _fixed(joint, tree, inside[joint.name]) if joint.name in still else joint for joint in description.joints
        ),
        couplings=tuple(coupling for coupling in couplings if coupling is not None),
        independent=moving(description.independent),
        dependent_hint=moving(description.dependent_hint) or (),
        actuated=moving(description.actuated),
        motors=tuple(motor for motor in description.motors if motor.joint not in still),
        reference=without(description.reference),
        poses={name: without(pose) for name, pose in description.poses.items()},
    ), follows


def _placed(tree: Tree, q_free: Array) -> dict[str, Array]:
    """Each joint's moving frame (4, 4) in that of the joint that carries it."""
    with tree.scratch.lent() as data:
        pin.forwardKinematics(tree.model, data, q_free)
        return {joint.name: data.liMi[joint.number].homogeneous.copy() for joint in tree.joints}


def _joints(coupling: Coupling) -> list[str]:
    return [term.joint for term in coupling.terms]


def _until_none(couplings: Sequence[Coupling], still: Sequence[str]) -> Iterable[Coupling]:
    """Couplings that leave one joint to move, as long as there are any: the caller adds it to `still`."""
    while True:
        found = next((c for c in couplings if len({j for j in _joints(c) if j not in still}) == 1), None)
        if found is None or all(joint not in still for joint in _joints(found)):
            return
        yield found


def _displacement(tree: Tree, name: str, q_free: Array) -> float:
    joint = tree.joint(name)
    return joint.kind.told(q_free[joint.q])[0]


def _folded(coupling: Coupling, still: Sequence[str], theta: Mapping[str, float]) -> Coupling | None:
    """A coupling with what fixed joints give it as a constant; ``None`` where nothing is left to move."""
    left = [term for term in coupling.terms if term.joint not in still]
    if not left or len(left) == len(coupling.terms):
        return coupling if left else None
    constant = sum(
        float(np.polynomial.polynomial.polyval(theta[term.joint] - term.reference, np.array(term.coefficients)))
        for term in coupling.terms
        if term.joint in still
    )
    first, *others = left
    first = replace(first, coefficients=(first.coefficients[0] + constant, *first.coefficients[1:]))
    return replace(coupling, terms=(first, *others))


def _fixed(joint: Joint, tree: Tree, moved: Array) -> Joint:
    """Where the moving frame stands in the parent link's, whatever the tree did to the joint's own frame."""
    carrier, child = tree.attachments[joint.parent].placement, tree.attachments[joint.child].placement
    return Joint(joint.name, FIXED, joint.parent, joint.child, inverse(carrier) @ moved @ child)


def component_locks(tree: Tree, q_free: Array, joint: TreeJoint, components: Sequence[str]) -> list[LoopClosure]:
    """One closure for each component of a joint that is to keep its value at a configuration q′.

    A slide's keeps the joint's origin in the plane across it. A turn's keeps two lines across its axis at a right
    angle, one fixed in the carrying body and one in the joint's own: of a ball a universal joint about the two is left.
    """
    parent, child = joint.stated.parent, joint.stated.child
    reference = _placed(tree, q_free)[joint.name]
    b, a = (inverse(tree.attachments[link].placement) for link in (child, parent))
    closures = []
    for component in components:
        k = joint.kind.components.index(component)
        direction = joint.kind.directions(joint.axis)[k]
        if joint.kind.slides[k]:
            at_a = frame(reference[:3, 3], rotation_to(joint.placement[:3, :3] @ direction)[:, [2, 0, 1]])
            at_b, kind = np.eye(4), "in_plane"
        else:
            across = rotation_to(direction)
            at_a = frame(reference[:3, 3], reference[:3, :3] @ across)
            at_b, kind = frame(np.zeros(3), across), "perpendicular"
        closures.append(LoopClosure(f"{joint.name}:{component} locked", kind, parent, child, a @ at_a, b @ at_b))
    return closures
