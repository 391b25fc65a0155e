"""Motions of the reduced model, and what is read off them: forces, friction, settling, Lyapunov functions."""

from __future__ import annotations

from ccpin.simulation.cases import grid, latin_hypercube, sobol
from ccpin.simulation.forces import BearingForce, PeakForce, closure_forces, closure_forces_at, joint_forces
from ccpin.simulation.friction import JointFriction
from ccpin.simulation.metrics import LyapunovHistory, Metrics, lyapunov_along, set_point_metrics
from ccpin.simulation.simulate import Settling, simulate
from ccpin.simulation.stick_slip import FrictionForce, friction_force
from ccpin.simulation.supervision import Move, SupervisedMotion, supervise
from ccpin.simulation.sweeps import Sweep, SweepProgress, sweep
from ccpin.simulation.trajectory import Trajectory, load_npz

__all__ = [
    "BearingForce",
    "FrictionForce",
    "JointFriction",
    "LyapunovHistory",
    "Metrics",
    "Move",
    "PeakForce",
    "Settling",
    "SupervisedMotion",
    "Sweep",
    "SweepProgress",
    "Trajectory",
    "closure_forces",
    "closure_forces_at",
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
