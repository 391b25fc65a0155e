"""Masses: the reduced model, its derivatives and linearization, its assembly modes, and end effectors."""

from ccpin.dynamics.assembly import assembly_modes
from ccpin.dynamics.linearization import linearize
from ccpin.dynamics.wrenches import Wrench

__all__ = ["Wrench", "assembly_modes", "linearize"]
__dir__ = __all__.copy
