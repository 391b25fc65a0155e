"""From a description to a closed, analysed mechanism."""

from __future__ import annotations

from ccpin.mechanism.loading.loader import load
from ccpin.mechanism.mechanism import Mechanism
from ccpin.mechanism.motion.mobility import Mobility
from ccpin.mechanism.pinocchio.reader import describe_pinocchio

__all__ = ["Mechanism", "Mobility", "describe_pinocchio", "load"]
