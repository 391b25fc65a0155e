"""A law without torque that is stated in the independent coordinates, so that it ends where these do."""

import numpy as np

from ccpin.control import ControlLaw


class Limp(ControlLaw):
    """No torque from so many motors."""

    def __init__(self, motors):
        self.motors = motors

    def torque(self, t, state, v):
        """Zeros."""
        return np.zeros(self.motors)

    def next_switch(self, t):
        """Never."""
        return np.inf
