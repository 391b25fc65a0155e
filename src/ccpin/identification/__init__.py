"""From a robot's log to its model: what was measured, and the motion behind it."""

from ccpin.identification.log import Log
from ccpin.identification.smoothing import smoothed

__all__ = ["Log", "smoothed"]
__dir__ = __all__.copy
