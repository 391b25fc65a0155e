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


class Rows:
    """φ = c + Lθ + ½ θᵀBθ row by row, with as many rows as c has, in any number of coordinates."""

    def __init__(self, c, line, bend=None):
        self.c, self.line = np.array(c, dtype=float), np.array(line, dtype=float)
        self.m, self.n_free = self.line.shape
        self.bend = np.zeros((self.m, self.n_free, self.n_free)) if bend is None else np.array(bend, dtype=float)

    def motions(self, theta):
        return theta

    def value(self, theta, motions):
        x = arb_mat(self.n_free, 1, list(theta))
        flat = exact(self.c[:, None]) + exact(self.line) * x
        return arb_mat(
            self.m,
            1,
            [f + (x.transpose() * exact(B) * x)[0, 0] / 2 for f, B in zip(flat.entries(), self.bend, strict=True)],
        )

    def jacobian(self, motions):
        return exact(self.line) + self.variation(motions, motions)

    def variation(self, motions, direction):
        d = arb_mat(self.n_free, 1, list(direction))
        return arb_mat(self.m, self.n_free, [x for B in self.bend for x in (exact(B) * d).entries()])

    def at(self, theta):
        bent = self.bend @ theta
        return self.c + self.line @ theta + 0.5 * bent @ theta, self.line + bent
