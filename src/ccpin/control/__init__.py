"""Control: set-point and tracking laws, the sampled loop, Theorem 3 as a tool, and tracking with a σ that is off."""

from ccpin.control.control_law import ControlLaw, Measurement, TorqueFunction
from ccpin.control.laws import CoulombCompensation, PDFullGravity, PDSimpleGravity
from ccpin.control.online import OnlineLaw, OnlineSigma
from ccpin.control.references import Hold, PointToPoint, Reference, Waypoints, through_points
from ccpin.control.sampling import Sampling
from ccpin.control.servos import Servos
from ccpin.control.stability.set_point.gains import local_gains, suggest_gains
from ccpin.control.stability.set_point.theorem3 import certify_set_point
from ccpin.control.stability.tracking.tracking_error import certify_tracking, largest_sigma_error
from ccpin.control.tracking import ComputedTorque, PDOnlineGravity, PDPlus, WithSigmaError

__all__ = [
    "ComputedTorque",
    "ControlLaw",
    "CoulombCompensation",
    "Hold",
    "Measurement",
    "OnlineLaw",
    "OnlineSigma",
    "PDFullGravity",
    "PDOnlineGravity",
    "PDPlus",
    "PDSimpleGravity",
    "PointToPoint",
    "Reference",
    "Sampling",
    "Servos",
    "TorqueFunction",
    "Waypoints",
    "WithSigmaError",
    "certify_set_point",
    "certify_tracking",
    "largest_sigma_error",
    "local_gains",
    "suggest_gains",
    "through_points",
]
__dir__ = __all__.copy
