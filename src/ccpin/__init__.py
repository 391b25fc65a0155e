"""ccpin: from a cut-open URDF and its loop closures to the reduced model of a closed-chain mechanism.

The equations implemented are those of Ghorbel, Chételat, Gunawardana and Longchamp, "Modeling and Set Point Control
of Closed-Chain Mechanisms: Theory and Experiment" (IEEE Transactions on Control Systems Technology, 2000);
docstrings cite them by number.
"""

from __future__ import annotations

from ccpin import control, domain, plotting, visualization
from ccpin.derivatives import (
    ForwardDynamicsDerivatives,
    GeneralizedForceDerivatives,
    InverseDynamicsDerivatives,
)
from ccpin.description.model import (
    Coupling,
    CouplingTerm,
    Inertia,
    Joint,
    Link,
    LoopClosure,
    MechanismDescription,
    Shape,
    Visual,
)
from ccpin.end_effector import EndEffector
from ccpin.errors import CcpinError
from ccpin.forces import BearingForce, closure_forces, joint_forces
from ccpin.free_system import Energy
from ccpin.linearization import Linearization, closed_loop_derivative, linearize
from ccpin.mechanism import Mechanism, load
from ccpin.mobility import Mobility
from ccpin.reduced_model import ReducedModel, ReducedTerms
from ccpin.references import Hold, PointToPoint, Reference, Waypoints, through_points
from ccpin.simulation import Settling, simulate
from ccpin.stick_slip import friction_force
from ccpin.trajectory import Trajectory

__version__ = "0.1.0"

__all__ = [
    "BearingForce",
    "CcpinError",
    "Coupling",
    "CouplingTerm",
    "EndEffector",
    "Energy",
    "ForwardDynamicsDerivatives",
    "GeneralizedForceDerivatives",
    "Hold",
    "Inertia",
    "InverseDynamicsDerivatives",
    "Joint",
    "Linearization",
    "Link",
    "LoopClosure",
    "Mechanism",
    "MechanismDescription",
    "Mobility",
    "PointToPoint",
    "ReducedModel",
    "ReducedTerms",
    "Reference",
    "Settling",
    "Shape",
    "Trajectory",
    "Visual",
    "Waypoints",
    "closed_loop_derivative",
    "closure_forces",
    "control",
    "domain",
    "friction_force",
    "joint_forces",
    "linearize",
    "load",
    "plotting",
    "simulate",
    "through_points",
    "visualization",
]
