"""A cubic φ whose own derivatives are exact; how far it may bend is made up."""

from types import SimpleNamespace

import numpy as np

from ccpin.proof.equations import Derivatives

M, SIZE, Q, Y = 3, 5, np.array([3, 1]), np.array([0, 4, 2])
TAU, MARGIN = np.array([0.3, 0.5, 0.7]), 1e-3


class Cubic:
    """φ of three rows over five coordinates, and the problem that has it."""

    def __init__(self, seed=0):
        rng = np.random.default_rng(seed)
        self.p, self.J = rng.normal(size=M), rng.normal(size=(M, SIZE))
        H, T = rng.normal(size=(M, SIZE, SIZE)), rng.normal(size=(M, SIZE, SIZE, SIZE))
        self.H = H + np.swapaxes(H, 1, 2)
        self.T = sum(
            np.moveaxis(T, (1, 2, 3), order)
            for order in ((1, 2, 3), (1, 3, 2), (2, 1, 3), (2, 3, 1), (3, 1, 2), (3, 2, 1))
        )
        self.asked = []
        system = SimpleNamespace(
            m=M, n=2, n_free=SIZE, independent=Q, dependent=Y, rounding=MARGIN, magnitude=self._magnitude
        )
        self.problem = SimpleNamespace(system=system, stack=None, rounding=lambda at: MARGIN * self._magnitude(at))

    def _magnitude(self, reach):
        self.asked.append(("magnitude", np.array(reach)))
        return 1.0 + reach[:, 0]

    def derivatives(self, problem, theta):
        t = theta
        curl = np.einsum("mijk,bk->bmij", self.T, t)
        hessian = self.H + curl
        jacobian = self.J + np.einsum("bmij,bj->bmi", self.H + 0.5 * curl, t)
        phi = self.p + np.einsum("mi,bi->bm", self.J, t)
        phi = phi + 0.5 * np.einsum("bmij,bi,bj->bm", self.H + curl / 3.0, t, t)
        return Derivatives(phi, jacobian, hessian, np.zeros((len(t), 1, 1)))

    def third(self, problem, theta, arms, box):
        self.asked.append(("third", np.array(box)))
        return np.tile(TAU, (len(theta), 1))

    def third_along(self, problem, theta, turn):
        return np.einsum("mijk,bk->bmij", self.T, turn)


def slope_of(function, x, step=1e-5):
    """The derivatives of a function of rows, by central differences."""
    columns = []
    for k in range(x.shape[1]):
        move = np.zeros_like(x)
        move[:, k] = step
        columns.append((function(x + move) - function(x - move)) / (2.0 * step))
    return np.stack(columns, axis=2)


def rows(rng, count, size):
    return 0.5 * rng.normal(size=(count, size))
