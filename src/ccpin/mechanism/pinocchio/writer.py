"""A mechanism's closures as Pinocchio's own constraint models, for those who go on with its solvers."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ccpin.description.model import frame
from ccpin.errors import UnsupportedMechanismError
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.loops import ResolvedClosure

_ALONG = 0.1  # m along the axis, of a second point: with both held, one turn is left


def constraint_models(constraints: Constraints) -> list[pin.RigidConstraintModel]:
    """`Mechanism.pinocchio_constraints` says what they are.

    Raises:
        UnsupportedMechanismError: A closure of another kind, or a coupling.
    """
    if constraints.couplings:
        names = ", ".join(coupling.coupling.name for coupling in constraints.couplings)
        raise UnsupportedMechanismError(f"Pinocchio has no constraint model of a coupling ({names})")
    return [model for loop in constraints.loops for model in _models(constraints.model, loop)]


def _models(model: pin.Model, loop: ResolvedClosure) -> list[pin.RigidConstraintModel]:
    kind, name = loop.closure.kind, loop.closure.name
    if kind == "fixed":
        return [_contact(model, loop, pin.ContactType.CONTACT_6D, name, np.eye(4))]
    point = pin.ContactType.CONTACT_3D
    if kind == "spherical":
        return [_contact(model, loop, point, name, np.eye(4))]
    if kind == "revolute":
        ahead = frame([0.0, 0.0, _ALONG])
        return [_contact(model, loop, point, name, np.eye(4)), _contact(model, loop, point, f"{name}_axis", ahead)]
    raise UnsupportedMechanismError(f"Pinocchio has no constraint model of a {kind} closure ('{name}')")


def _contact(model: pin.Model, loop: ResolvedClosure, kind: pin.ContactType, name: str, along: np.ndarray) -> object:
    ends = (loop.joint_a, pin.SE3(loop.frame_a @ along), loop.joint_b, pin.SE3(loop.frame_b @ along))
    contact = pin.RigidConstraintModel(kind, model, *ends, pin.ReferenceFrame.LOCAL)
    contact.name = name
    return contact
