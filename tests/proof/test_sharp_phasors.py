"""Planar bounds against the sums of phasors that `bounds` states, added up link by link, and at their corners."""

import numpy as np
import pytest

from ccpin.proof.phasors import Phasors, PhasorValues, _one_signed, _versine, planar_bounds
from tests.support.straight import random_frame

N, M, P, K = 4, 2, 2, 3


def case(rng, size):
    signs = rng.integers(-1, 2, (K, N)).astype(float)
    phasors = Phasors(signs, np.ones(K), np.zeros((M, K)), np.zeros((M, K)), np.zeros((M, N)), np.zeros(M))
    values = PhasorValues(*(rng.normal(size=(1, M, *shape)) for shape in ((), (N,), (K,), (K,))))
    return phasors, values, random_frame(rng, N, P, M, size)


class Stated:
    """Y, Z and Z̄ as `bounds` states them for phasors."""

    def __init__(self, phasors, values, frame):
        self.A, self.D, self.E, self.h = (a[0] for a in frame[:4])
        self.phi, self.J = values.phi[0], values.jacobian[0]
        self.alpha, self.kappa = self.A @ values.along[0], self.A @ values.across[0]
        self.CD, self.CE = phasors.signs @ self.D, phasors.signs @ self.E
        self.U = np.abs(self.CD) @ self.h
        self.moves = np.abs(self.D) @ self.h
        self.margin = np.abs(self.A).sum(axis=1) * frame.rounding[0]

    def y(self):
        line = np.abs(self.A @ self.phi) + np.abs(self.A @ self.J @ self.D) @ self.h
        found = line + self.margin * (1 + self.moves.sum()) ** 2 + np.abs(self.kappa) @ (self.U**3 / 6)
        versine = 1 - np.cos(np.minimum(self.U, np.pi))
        for i in range(M):
            ups, downs = (sum(max(s * a * v, 0) for a, v in zip(self.alpha[i], versine, strict=True)) for s in (1, -1))
            square = sum(np.outer(d, d) * a for d, a in zip(self.CD, self.alpha[i], strict=True))
            exact = 0.5 * self.h @ np.abs(square) @ self.h + np.abs(self.alpha[i]) @ (self.U**4 / 24)
            found[i] += min(max(ups, downs), exact)
        return found

    def image(self, radius, share, versine, sine, cube):
        widths = np.abs(self.E) @ radius
        size = 1 + (self.moves + widths).sum()
        found = np.abs(np.eye(M) - self.A @ self.J @ self.E)
        found = found + np.outer(self.margin, np.abs(self.E).sum(axis=0)) * size
        width = np.concatenate([self.h, share * radius])
        for i in range(M):
            for k in range(M):
                bent = np.abs((self.alpha[i] * self.CE[:, k]) @ np.column_stack([self.CD, self.CE])) @ width
                sizes = np.abs(self.alpha[i] * self.CE[:, k])
                terms = self.kappa[i] * self.CE[:, k] * versine
                signed = max(terms[terms > 0].sum(), -terms[terms < 0].sum())
                found[i, k] += min(bent + sizes @ cube, sizes @ sine) + signed
        return found

    def contraction(self, radius, weight):
        U = self.U + np.abs(self.CE) @ radius
        sine, versine = np.sin(np.minimum(U, np.pi / 2)), 1 - np.cos(np.minimum(U, np.pi))
        return self.image(radius, 1.0, versine, sine, U**3 / 6) @ weight

    def mean(self, radius):
        """Means over τ of U² / 2 and U³ / 6 at U = a + τb, by Gauss's formula, and of the concave s by Jensen's."""
        a, b = self.U, np.abs(self.CE) @ radius
        nodes, weights = np.polynomial.legendre.leggauss(4)
        along = [(0.5 * w, a + 0.5 * (1 + t) * b) for t, w in zip(nodes, weights, strict=True)]
        versine, cube = (sum(w * U**p / f for w, U in along) for p, f in ((2, 2), (3, 6)))
        return self.image(radius, 0.5, versine, np.sin(np.minimum(a + 0.5 * b, np.pi / 2)), cube) @ radius

    def curvature(self, radius, weight):
        U, turn = self.U + np.abs(self.CE) @ radius, np.abs(self.CE) @ weight
        gain = np.abs(self.alpha) + np.abs(self.kappa) * np.minimum(U, 1)
        return gain @ turn**2 + self.margin * (np.abs(self.E) @ weight).sum() ** 2


@pytest.mark.parametrize("size", [0.03, 0.3, 1.0, 3.0])
def test_planar_bounds_are_the_sums_that_the_theorem_states(size):
    rng = np.random.default_rng(3)
    for _ in range(8):
        given = case(rng, size)
        bounds, stated = planar_bounds(*given), Stated(*given)
        radius, weight = size * rng.uniform(0.1, 1, M), rng.uniform(0.1, 1, M)
        np.testing.assert_allclose(bounds.y[0], stated.y(), rtol=1e-11)
        np.testing.assert_allclose(bounds.mean(radius[None]).of(radius[None])[0], stated.mean(radius), rtol=1e-11)
        found = bounds.contraction(radius[None]).of(weight[None])[0]
        np.testing.assert_allclose(found, stated.contraction(radius, weight), rtol=1e-11)
        np.testing.assert_allclose(
            bounds.curvature(radius[None], weight[None])[0], stated.curvature(radius, weight), rtol=1e-11
        )


def test_what_bounds_a_versine_and_a_sum_of_one_sign():
    np.testing.assert_allclose(_versine(np.array([0.5, 3.0, 9.0])), [1 - np.cos(0.5), 1 - np.cos(3.0), 2.0], rtol=1e-13)
    assert _one_signed(np.array([1.0, -2.0, 3.0]), np.array([1.0, 5.0, 1.0])) == 10.0
    assert _one_signed(np.array([1.0, -2.0, 3.0]), np.array([1.0, 1.0, 1.0])) == 4.0
