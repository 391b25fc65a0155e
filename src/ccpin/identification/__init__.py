"""From a robot's log to its model: motions that show it, what was measured, and the motion behind that."""

from ccpin.identification.excitation import excitation
from ccpin.identification.log import Log
from ccpin.identification.smoothing import smoothed

__all__ = ["Log", "excitation", "smoothed"]
__dir__ = __all__.copy
