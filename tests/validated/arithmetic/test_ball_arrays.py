"""Arrays of balls in doubles hold what exact arithmetic gives."""

from fractions import Fraction

import numpy as np
import pytest

pytest.importorskip("flint")

from ccpin.validated.arithmetic.ball_arrays import BallArray, exactly, hull, inverse, of_balls, sine_and_cosine
from ccpin.validated.arithmetic.balls import flint


def drawn(rng, *shape):
    """Balls of all sizes, and a point in each, exact."""
    scale = 10.0 ** rng.integers(-12, 6, shape)
    wide = BallArray(rng.normal(size=shape) * scale, rng.random(shape) * scale * rng.integers(0, 2, shape))
    inside = np.vectorize(Fraction)(wide.mid) + np.vectorize(Fraction)(wide.rad) * np.vectorize(Fraction)(
        rng.uniform(-1, 1, shape)
    )
    return wide, inside


def holds(wide, exact):
    """Whether every exact entry is in its ball."""
    gap = np.abs(np.vectorize(Fraction)(wide.mid) - exact)
    return bool(np.all(gap <= np.vectorize(Fraction)(wide.rad)))


@pytest.mark.parametrize("seed", range(5))
def test_operations_hold_exact_results(seed):
    """Sums, differences, products and matrix products of points in balls are in the results' balls."""
    rng = np.random.default_rng(seed)
    (a, x), (b, y) = drawn(rng, 40, 3, 3), drawn(rng, 40, 3, 3)
    assert holds(a + b, x + y)
    assert holds(a - b, x - y)
    assert holds(a * b, x * y)
    assert holds(a @ b, np.array([p @ q for p, q in zip(x, y, strict=True)]))
    assert np.all(np.vectorize(Fraction)(a.size) >= np.abs(x))


def test_inverses_hold_exact_inverses():
    """Inverses of corners of the stack lie in the balls; what may be singular is refused."""
    rng = np.random.default_rng(1)
    near = BallArray(rng.normal(size=(30, 4, 4)) + 4 * np.eye(4), np.full((30, 4, 4), 1e-3))
    found = inverse(near)
    for k in range(30):
        corner = near.mid[k] + near.rad[k] * rng.choice([-1, 1], (4, 4))
        exact = flint().arb_mat(corner.tolist()).inv()
        gap = np.array([[float(abs(exact[i, j] - found.mid[k, i, j]).upper()) for j in range(4)] for i in range(4)])
        assert np.all(gap <= found.rad[k] * (1 + 1e-9))
    assert inverse(BallArray(np.ones((2, 2)), np.zeros((2, 2)))) is None
    assert inverse(BallArray(np.eye(2), np.full((2, 2), 0.6))) is None


def test_sines_hold_sines():
    """Over balls of angles of all sizes."""
    rng = np.random.default_rng(2)
    angle = BallArray(rng.uniform(-7, 7, 200), 10.0 ** rng.uniform(-9, 1, 200))
    sine, cosine = sine_and_cosine(angle)
    for fraction in (-1.0, -0.3, 0.0, 0.7, 1.0):
        at = angle.mid + fraction * angle.rad
        assert np.all(np.abs(np.sin(at) - sine.mid) <= sine.rad + 1e-15)
        assert np.all(np.abs(np.cos(at) - cosine.mid) <= cosine.rad + 1e-15)
    assert np.all(sine_and_cosine(exactly(angle.mid))[0].rad < 1e-14)


def test_hulls_and_balls():
    """A hull holds its group; balls of more bits than a double's become doubles that hold them."""
    rng = np.random.default_rng(3)
    stack, inside = drawn(rng, 12, 2)
    around = hull(stack, 4)
    assert around.mid.shape == (3, 2)
    for k in range(12):
        assert holds(around.at(k // 4), inside[k])
    with flint().ctx.workprec(200):
        third = flint().arb(1) / 3
        held = of_balls([[third]])
        assert abs(third - held.mid[0, 0]) <= flint().arb(held.rad[0, 0])
        assert held.rad[0, 0] < 1e-16
