"""Control: set-point and tracking laws, the sampled loop, Theorem 3 as a tool, and tracking with a σ that is off."""

from __future__ import annotations

from ccpin.control.laws import ControlLaw, CoulombCompensation, NoTorque, PDFullGravity, PDSimpleGravity, TorqueFunction
from ccpin.control.online import OnlineLaw, OnlineReport, OnlineSigma, capped_sigma
from ccpin.control.references import Hold, PointToPoint, Reference, ReferenceState, Waypoints, through_points
from ccpin.control.sampling import Sampling
from ccpin.control.servos import Servos
from ccpin.control.stability.set_point.flood import Budget, Flooded
from ccpin.control.stability.set_point.gains import Gains, local_gains, suggest_gains
from ccpin.control.stability.set_point.theorem3 import SetPointCertificate, certify_law, certify_set_point
from ccpin.control.stability.set_point.well import RegionSamples, sample_region
from ccpin.control.stability.tracking.on_line import OnlineDemand
from ccpin.control.stability.tracking.tracking_error import TrackingCertificate, certify_tracking, largest_sigma_error
from ccpin.control.tracking import ComputedTorque, PDOnlineGravity, PDPlus, TrackingLaw, WithSigmaError

__all__ = [
    "Budget",
    "ComputedTorque",
    "ControlLaw",
    "CoulombCompensation",
    "Flooded",
    "Gains",
    "Hold",
    "NoTorque",
    "OnlineDemand",
    "OnlineLaw",
    "OnlineReport",
    "OnlineSigma",
    "PDFullGravity",
    "PDOnlineGravity",
    "PDPlus",
    "PDSimpleGravity",
    "PointToPoint",
    "Reference",
    "ReferenceState",
    "RegionSamples",
    "Sampling",
    "Servos",
    "SetPointCertificate",
    "TorqueFunction",
    "TrackingCertificate",
    "TrackingLaw",
    "Waypoints",
    "WithSigmaError",
    "capped_sigma",
    "certify_law",
    "certify_set_point",
    "certify_tracking",
    "largest_sigma_error",
    "local_gains",
    "sample_region",
    "suggest_gains",
    "through_points",
]
