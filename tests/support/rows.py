"""Rows of second degree in balls, as the auditor asks for them: its bounds are attained at corners."""

import numpy as np
from flint import arb, arb_mat


class Quadratic:
    """φ = c + g q + y + ½ a q² + b q y + ½ d y²."""

    m, n_free = 1, 2

    def __init__(self, c=0.0, g=0.0, a=0.0, b=0.0, d=0.0):
        self.c, self.line, self.bend = c, np.array([g, 1.0]), np.array([[a, b], [b, d]])

    def motions(self, theta):
        return theta

    def value(self, theta, motions):
        x = arb_mat(2, 1, list(theta))
        half = (x.transpose() * exact(self.bend) * x)[0, 0] / 2
        return arb_mat(1, 1, [self.c + (exact(self.line[None]) * x)[0, 0] + half])

    def jacobian(self, motions):
        return exact(self.line[None]) + (exact(self.bend) * arb_mat(2, 1, list(motions))).transpose()

    def variation(self, motions, direction):
        return (exact(self.bend) * arb_mat(2, 1, list(direction))).transpose()

    def at(self, theta):
        slope = self.line + self.bend @ theta
        return np.array([self.c + self.line @ theta + 0.5 * theta @ self.bend @ theta]), slope[None]


def exact(values):
    return arb_mat(*np.shape(values), [arb(float(x)) for x in np.ravel(values)])
