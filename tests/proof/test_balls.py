"""Affine forms: what they say they hold they hold, rounding included."""

from fractions import Fraction

import numpy as np
import pytest

from ccpin.proof.balls import Affine, affine, cross, inverse, joined, product, sine_versine, stacked, summed

PARAMETERS, BOXED = 5, 3


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def form(rng, *shape, size=0.1):
    """A random form of three parameters in a box and two in a ball."""
    lin = size * rng.normal(size=(PARAMETERS, *shape))
    return Affine(rng.normal(size=shape), lin, size**2 * rng.random(shape), BOXED)


def parameters(rng):
    """A point of the box and the ball, corners and surface among them."""
    ball = rng.normal(size=PARAMETERS - BOXED)
    return np.concatenate([rng.choice([-1.0, 1.0], BOXED), ball / np.linalg.norm(ball) * rng.choice([0.3, 1.0])])


def member(rng, some, at):
    """One of the arrays that a form stands for."""
    return (
        some.mid + np.tensordot(at[: len(some.lin)], some.lin, axes=1) + rng.choice([-1, 1], some.mid.shape) * some.rad
    )


def holds(some, value, at):
    """Whether a value is among a form's at given parameters."""
    left = np.abs(value - some.mid - np.tensordot(at[: len(some.lin)], some.lin, axes=1))
    return np.all(left <= some.rad * (1.0 + 1e-12) + 1e-15) and np.all(np.abs(value) <= some.magnitude)


OPERATIONS = {
    "sum": (lambda a, b: a + b, lambda a, b: a + b),
    "difference": (lambda a, b: a - b, lambda a, b: a - b),
    "product": (lambda a, b: product("bij,bjk->bik", a, b), lambda a, b: a @ b),
    "cross": (lambda a, b: cross(a, b), np.cross),
    "stacked": (lambda a, b: stacked([a, b], 1), lambda a, b: np.stack([a, b], 1)),
    "joined": (lambda a, b: joined([a, b], -2), lambda a, b: np.concatenate([a, b], -2)),
    "scaled": (lambda a, b: a * 3.0 + b * np.arange(3.0), lambda a, b: a * 3.0 + b * np.arange(3.0)),
    "summed": (lambda a, b: summed(a - b, 1), lambda a, b: (a - b).sum(axis=1)),
    "sine": (lambda a, b: sine_versine(a)[0] + b, lambda a, b: np.sin(a) + b),
    "versine": (lambda a, b: sine_versine(a)[1] - b, lambda a, b: 1.0 - np.cos(a) - b),
    "transposed": (lambda a, b: a.transposed() + b, lambda a, b: np.swapaxes(a, -1, -2) + b),
}


@pytest.mark.parametrize("name", OPERATIONS)
@pytest.mark.parametrize("size", [1.0, 1e-3])
def test_operations_hold_their_members(rng, name, size):
    """Every operation, at random members of its operands that share their parameters."""
    on_forms, on_numbers = OPERATIONS[name]
    for _ in range(20):
        a, b = form(rng, 2, 3, 3, size=size), form(rng, 2, 3, 3, size=size)
        result = on_forms(a, b)
        for _ in range(20):
            at = parameters(rng)
            assert holds(result, on_numbers(member(rng, a, at), member(rng, b, at)), at)


@pytest.mark.parametrize("size", [0.03, 1e-4])
def test_solutions_hold_their_members(rng, size):
    """M⁻¹r for members of M and r; a form with a singular member is not called regular."""
    for _ in range(20):
        middle = np.linalg.qr(rng.normal(size=(2, 3, 3)))[0]
        matrix = form(rng, 2, 3, 3, size=size)
        matrix = Affine(middle, matrix.lin, matrix.rad, BOXED)
        right, prepared = form(rng, 2, 3, 2, size=size), inverse(matrix)
        result = prepared.solve(right)
        if size < 1e-3:
            assert prepared.regular.all()
        for _ in range(20):
            at = parameters(rng)
            solution = np.linalg.solve(member(rng, matrix, at), member(rng, right, at))
            for k in np.flatnonzero(prepared.regular):
                assert holds(result[k], solution[k], at)
        wide = Affine(middle, 3.0 * np.broadcast_to(middle, (1, 2, 3, 3)), np.zeros((2, 3, 3)), 1)
        assert not inverse(wide).regular.any()
        assert np.isnan(inverse(wide).solve(right).rad).all()


def test_the_radius_is_of_second_order(rng):
    """Quantities that move together are not taken for independent: x·x − x·x is zero to second order."""
    for size in (1e-1, 1e-2, 1e-3):
        x = Affine(np.ones(1), np.full((1, 1), size), np.zeros(1), 1)
        nothing = product("i,i->i", x, x) - product("i,i->i", x, x)
        assert nothing.spread[0] == pytest.approx(2.0 * size**2, rel=1e-6)


def test_rounding_is_inside(rng):
    """Sums of products and differences that cancel, against exact rational arithmetic."""
    for _ in range(50):
        a, b = rng.normal(size=(2, 7)) * 10.0 ** rng.integers(-8, 8, (2, 7))
        b[1] = -a[0] * b[0] / a[1]
        found = product("i,i->", a, b)
        exact = sum((Fraction(x) * Fraction(y) for x, y in zip(a, b, strict=True)), Fraction(0))
        assert abs(exact - Fraction(float(found.mid))) <= Fraction(float(found.rad))
        third = affine(a) + b - a
        for k in range(7):
            exact = Fraction(b[k])
            assert abs(exact - Fraction(third.mid[k])) <= Fraction(third.rad[k])
