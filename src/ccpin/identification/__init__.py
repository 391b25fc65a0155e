"""From a robot's log to its model: motions that show it, what was measured, what can be identified, and constants."""

from ccpin.dynamics.changed_constants import with_constants
from ccpin.identification.adaptive_certificate import certify_adaptive
from ccpin.identification.adaptive_tracking import AdaptiveTracking
from ccpin.identification.calibration import calibrate
from ccpin.identification.chosen_poses import calibration_poses
from ccpin.identification.consistency import consistent
from ccpin.identification.estimation import identify
from ccpin.identification.exciting_motions import excitation
from ccpin.identification.explained_efforts import explained
from ccpin.identification.identifiable import base_parameters
from ccpin.identification.log import Log
from ccpin.identification.sensors import Sensor
from ccpin.identification.smoothing import smoothed

__all__ = [
    "AdaptiveTracking",
    "Log",
    "Sensor",
    "base_parameters",
    "calibrate",
    "calibration_poses",
    "certify_adaptive",
    "consistent",
    "excitation",
    "explained",
    "identify",
    "smoothed",
    "with_constants",
]
__dir__ = __all__.copy
