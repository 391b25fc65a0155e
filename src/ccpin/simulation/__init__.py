"""Motions of the reduced model, and what is read off them: forces, friction, settling, Lyapunov functions."""

from ccpin.simulation.events.settling import Settling
from ccpin.simulation.events.watches import Event
from ccpin.simulation.integration.budget import Budget
from ccpin.simulation.plant.contact import Contact
from ccpin.simulation.plant.disturbances import Disturbance, Push
from ccpin.simulation.plant.friction import JointFriction
from ccpin.simulation.plant.limits import Limits
from ccpin.simulation.plant.motors import MotorModel
from ccpin.simulation.results.forces import closure_forces, joint_forces
from ccpin.simulation.results.limit_violations import exceeded
from ccpin.simulation.results.metrics import lyapunov_along, set_point_metrics
from ccpin.simulation.results.sizing import demands
from ccpin.simulation.studies.cases import grid, latin_hypercube, sobol
from ccpin.simulation.studies.mujoco_runs import run_in_mujoco
from ccpin.simulation.studies.supervision import supervise

__all__ = [
    "Budget",
    "Contact",
    "Disturbance",
    "Event",
    "JointFriction",
    "Limits",
    "MotorModel",
    "Push",
    "Settling",
    "closure_forces",
    "demands",
    "exceeded",
    "grid",
    "joint_forces",
    "latin_hypercube",
    "lyapunov_along",
    "run_in_mujoco",
    "set_point_metrics",
    "sobol",
    "supervise",
]
__dir__ = __all__.copy
