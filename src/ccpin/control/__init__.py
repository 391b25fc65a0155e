"""Control: set-point and tracking laws, the sampled loop, and Theorem 3 as a tool."""

from __future__ import annotations

from ccpin.control.compensation import CoulombCompensation
from ccpin.control.gains import Gains, suggest_gains
from ccpin.control.laws import ControlLaw, NoTorque, PDFullGravity, PDSimpleGravity, TorqueFunction
from ccpin.control.lyapunov import LyapunovHistory, lyapunov_along
from ccpin.control.online import OnlineLaw, OnlineReport, OnlineSigma, capped_sigma
from ccpin.control.sampling import Sampling
from ccpin.control.stability import SetPointCertificate, certify_law, certify_set_point
from ccpin.control.tracking import ComputedTorque, PDOnlineGravity, PDPlus, TrackingLaw, WithSigmaError

__all__ = [
    "ComputedTorque",
    "ControlLaw",
    "CoulombCompensation",
    "Gains",
    "LyapunovHistory",
    "NoTorque",
    "OnlineLaw",
    "OnlineReport",
    "OnlineSigma",
    "PDFullGravity",
    "PDOnlineGravity",
    "PDPlus",
    "PDSimpleGravity",
    "Sampling",
    "SetPointCertificate",
    "TorqueFunction",
    "TrackingLaw",
    "WithSigmaError",
    "capped_sigma",
    "certify_law",
    "certify_set_point",
    "lyapunov_along",
    "suggest_gains",
]
