"""From a robot's log to its model: motions that show it, what was measured, what can be identified, and constants."""

from ccpin.dynamics.changed_constants import with_constants
from ccpin.identification.adaptive.adaptive_certificate import certify_adaptive
from ccpin.identification.adaptive.adaptive_tracking import AdaptiveTracking
from ccpin.identification.calibration.calibrating import calibrate
from ccpin.identification.calibration.chosen_poses import calibration_poses
from ccpin.identification.calibration.sensors import Sensor
from ccpin.identification.combinations.identifiable import base_parameters
from ccpin.identification.estimates.consistency import consistent
from ccpin.identification.estimates.estimation import identify
from ccpin.identification.estimates.exciting_motions import excitation
from ccpin.identification.estimates.explained_efforts import explained
from ccpin.identification.logs.log import Log
from ccpin.identification.logs.smoothing import smoothed

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
