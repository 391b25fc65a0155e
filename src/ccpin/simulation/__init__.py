"""Motions of the reduced model, and what is read off them: forces, friction, settling, Lyapunov functions."""

from __future__ import annotations

from ccpin.simulation.budget import Budget
from ccpin.simulation.cases import grid, latin_hypercube, sobol
from ccpin.simulation.contact import Contact
from ccpin.simulation.demands import Demands, demands
from ccpin.simulation.disturbances import Disturbance, Push
from ccpin.simulation.exceeded import Exceeded, exceeded
from ccpin.simulation.forces import BearingForce, PeakForce, closure_forces, closure_forces_at, joint_forces
from ccpin.simulation.friction import JointFriction
from ccpin.simulation.happenings import Event
from ccpin.simulation.journal import Move
from ccpin.simulation.limits import Limits
from ccpin.simulation.metrics import LyapunovHistory, Metrics, lyapunov_along, set_point_metrics
from ccpin.simulation.motors import MotorModel
from ccpin.simulation.samples import Happening, StateSample, Stop
from ccpin.simulation.settling import Settling
from ccpin.simulation.simulate import simulate
from ccpin.simulation.stepper import METHODS, Simulator
from ccpin.simulation.stick_slip import FrictionForce, friction_force
from ccpin.simulation.supervision import SupervisedMotion, supervise
from ccpin.simulation.sweeps import Sweep, SweepProgress, sweep
from ccpin.simulation.trajectory import Trajectory, load_npz

__all__ = [
    "METHODS",
    "BearingForce",
    "Budget",
    "Contact",
    "Demands",
    "Disturbance",
    "Event",
    "Exceeded",
    "FrictionForce",
    "Happening",
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
