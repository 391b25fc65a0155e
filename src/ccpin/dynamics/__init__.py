"""Masses: the reduced model, its derivatives and linearization, its assembly modes, and end effectors."""

from __future__ import annotations

from ccpin.dynamics.assembly import AssemblyMode, AssemblyModes, assembly_modes
from ccpin.dynamics.derivatives import (
    ForwardDynamicsDerivatives,
    GeneralizedForceDerivatives,
    InverseDynamicsDerivatives,
)
from ccpin.dynamics.end_effector import Ellipsoid, EndEffector
from ccpin.dynamics.free_system import Energy
from ccpin.dynamics.inverse_kinematics import UnreachableTargetError
from ccpin.dynamics.linearization import Linearization, closed_loop_derivative, linearize
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.dynamics.state import ReducedTerms, State
from ccpin.dynamics.wrenches import Wrench

__all__ = [
    "AssemblyMode",
    "AssemblyModes",
    "Ellipsoid",
    "EndEffector",
    "Energy",
    "ForwardDynamicsDerivatives",
    "GeneralizedForceDerivatives",
    "InverseDynamicsDerivatives",
    "Linearization",
    "ReducedModel",
    "ReducedTerms",
    "State",
    "UnreachableTargetError",
    "Wrench",
    "assembly_modes",
    "closed_loop_derivative",
    "linearize",
]
