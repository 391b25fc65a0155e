"""ccpin: from a cut-open URDF and its loop closures to the reduced model of a closed-chain mechanism.

The equations implemented are those of Ghorbel, Chételat, Gunawardana and Longchamp, "Modeling and Set Point Control
of Closed-Chain Mechanisms: Theory and Experiment" (IEEE Transactions on Control Systems Technology, 2000);
docstrings cite them by number.
"""

from __future__ import annotations

from ccpin import control, domain, plotting, visualization
from ccpin.control.references import Hold, PointToPoint, Reference, Waypoints, through_points
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
from ccpin.dynamics.derivatives import (
    ForwardDynamicsDerivatives,
    GeneralizedForceDerivatives,
    InverseDynamicsDerivatives,
)
from ccpin.dynamics.end_effector import EndEffector
from ccpin.dynamics.free_system import Energy
from ccpin.dynamics.linearization import Linearization, closed_loop_derivative, linearize
from ccpin.dynamics.reduced_model import ReducedModel, ReducedTerms
from ccpin.errors import CcpinError
from ccpin.mechanism.mechanism import Mechanism, load
from ccpin.mechanism.mobility import Mobility
from ccpin.simulation.forces import BearingForce, closure_forces, joint_forces
from ccpin.simulation.in_core import Settling
from ccpin.simulation.simulate import simulate
from ccpin.simulation.stick_slip import friction_force
from ccpin.simulation.trajectory import Trajectory

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
