"""From motors to the joints of a serial robot, through the closed chain between them."""

from ccpin.transmission.identifying_geometry import identify_geometry
from ccpin.transmission.motor_limits import certify_limits
from ccpin.transmission.pictures import plot_limits, plot_shortcuts
from ccpin.transmission.ros2_package import export_ros2
from ccpin.transmission.serial_robots import serial_robot
from ccpin.transmission.shortcuts import compare, motor_loads
from ccpin.transmission.surveys import survey
from ccpin.transmission.swing import Swing
from ccpin.transmission.transmission import Transmission

__all__ = [
    "Swing",
    "Transmission",
    "certify_limits",
    "compare",
    "export_ros2",
    "identify_geometry",
    "motor_loads",
    "plot_limits",
    "plot_shortcuts",
    "serial_robot",
    "survey",
]
__dir__ = __all__.copy
