"""Motions of the reduced model, and what is read off them: forces, friction, settling, Lyapunov functions."""

from __future__ import annotations

from ccpin.simulation.events.samples import EventRecord, StateSample, Stop
from ccpin.simulation.events.settling import Settling
from ccpin.simulation.events.watches import Event
from ccpin.simulation.integration.budget import Budget
from ccpin.simulation.integration.simulator import METHODS, Simulator
from ccpin.simulation.integration.single_run import simulate
from ccpin.simulation.plant.contact import Contact
from ccpin.simulation.plant.disturbances import Disturbance, Push
from ccpin.simulation.plant.friction import JointFriction
from ccpin.simulation.plant.limits import Limits
from ccpin.simulation.plant.motors import MotorModel
from ccpin.simulation.plant.stick_slip import FrictionForce, friction_force
from ccpin.simulation.results.forces import BearingForce, PeakForce, closure_forces, closure_forces_at, joint_forces
from ccpin.simulation.results.limit_violations import Exceeded, exceeded
from ccpin.simulation.results.metrics import LyapunovHistory, Metrics, lyapunov_along, set_point_metrics
from ccpin.simulation.results.sizing import Sizing, demands
from ccpin.simulation.results.trajectory import Trajectory, load_npz
from ccpin.simulation.studies.cases import grid, latin_hypercube, sobol
from ccpin.simulation.studies.journal import Move
from ccpin.simulation.studies.supervision import SupervisedMotion, supervise
from ccpin.simulation.studies.sweeps import Sweep, SweepProgress, sweep

__all__ = [
    "METHODS",
    "BearingForce",
    "Budget",
    "Contact",
    "Disturbance",
    "Event",
    "EventRecord",
    "Exceeded",
    "FrictionForce",
    "JointFriction",
    "Limits",
    "LyapunovHistory",
    "Metrics",
    "MotorModel",
    "Move",
    "PeakForce",
    "Push",
    "Settling",
    "Simulator",
    "Sizing",
    "StateSample",
    "Stop",
    "SupervisedMotion",
    "Sweep",
    "SweepProgress",
    "Trajectory",
    "closure_forces",
    "closure_forces_at",
    "demands",
    "exceeded",
    "friction_force",
    "grid",
    "joint_forces",
    "latin_hypercube",
    "load_npz",
    "lyapunov_along",
    "set_point_metrics",
    "simulate",
    "sobol",
    "supervise",
    "sweep",
]
