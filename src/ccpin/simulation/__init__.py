"""Motions of the reduced model, and what is read off them: forces, friction, settling, Lyapunov functions."""

from __future__ import annotations

from ccpin.simulation.forces import BearingForce, PeakForce, closure_forces, closure_forces_at, joint_forces
from ccpin.simulation.in_core import Settling
from ccpin.simulation.metrics import LyapunovHistory, lyapunov_along
from ccpin.simulation.simulate import simulate
from ccpin.simulation.stick_slip import FrictionForce, friction_force
from ccpin.simulation.trajectory import Trajectory

__all__ = [
    "BearingForce",
    "FrictionForce",
    "LyapunovHistory",
    "PeakForce",
    "Settling",
    "Trajectory",
    "closure_forces",
    "closure_forces_at",
    "friction_force",
    "joint_forces",
    "lyapunov_along",
    "simulate",
]
