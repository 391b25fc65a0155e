"""Motions of the reduced model, and what is read off them: forces, friction, settling, Lyapunov functions."""

from __future__ import annotations

from ccpin.simulation.forces import BearingForce, PeakForce, closure_forces, closure_forces_at, joint_forces
from ccpin.simulation.friction import JointFriction
from ccpin.simulation.happenings import Event
from ccpin.simulation.journal import Move
from ccpin.simulation.metrics import LyapunovHistory, Metrics, lyapunov_along, set_point_metrics
from ccpin.simulation.run import Budget
from ccpin.simulation.samples import Happening, StateSample, Stop
from ccpin.simulation.settling import Settling
from ccpin.simulation.simulate import simulate
from ccpin.simulation.stepper import METHODS, Simulator
from ccpin.simulation.stick_slip import FrictionForce, friction_force
from ccpin.simulation.supervision import SupervisedMotion, supervise
from ccpin.simulation.trajectory import Trajectory, load_npz

__all__ = [
    "METHODS",
    "BearingForce",
    "Budget",
    "Event",
    "FrictionForce",
    "Happening",
    "JointFriction",
    "LyapunovHistory",
    "Metrics",
    "Move",
    "PeakForce",
    "Settling",
    "Simulator",
    "StateSample",
    "Stop",
    "SupervisedMotion",
    "Trajectory",
    "closure_forces",
    "closure_forces_at",
    "friction_force",
    "joint_forces",
    "load_npz",
    "lyapunov_along",
    "set_point_metrics",
    "simulate",
    "supervise",
]
