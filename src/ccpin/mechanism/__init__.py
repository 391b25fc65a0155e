"""From a description to a closed, analysed mechanism."""

from __future__ import annotations

from ccpin.mechanism.from_pinocchio import describe_pinocchio
from ccpin.mechanism.loading import load
from ccpin.mechanism.mechanism import Mechanism
from ccpin.mechanism.mobility import Mobility

__all__ = ["Mechanism", "Mobility", "describe_pinocchio", "load"]
