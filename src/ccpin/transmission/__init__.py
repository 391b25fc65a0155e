"""From motors to the joints of a serial robot, through the closed chain between them."""

from ccpin.transmission.shortcuts import compare, motor_loads
from ccpin.transmission.swing import Swing
from ccpin.transmission.transmission import Transmission

__all__ = ["Swing", "Transmission", "compare", "motor_loads"]
__dir__ = __all__.copy
