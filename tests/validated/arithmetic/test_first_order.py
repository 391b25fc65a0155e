"""Functions to first order: bounds that are attained, roundings as stated, and truth at random arguments."""

from fractions import Fraction

import numpy as np
import pytest

from ccpin.validated.arithmetic.first_order import (
    FirstOrder,
    constant,
    linear,
    preconditioned,
    reciprocal,
    root,
    sine_and_cosine,
)

flint = pytest.importorskip("flint")
U = 2.0**-53
EXACT, SINE = pytest.approx, 2.0**-50


def form(mid, slopes, rad):
    return FirstOrder(np.array([mid]), np.array([slopes]), np.array([rad]))


def near(found, expected):
    """Whether a bound is what it is to be, to nine digits, and not below."""
    return bool(expected <= found <= expected * (1 + 1e-9) + 2e-290)


A, B = form(3.0, [0.5, -0.25], 0.125), form(-2.0, [0.25, 0.5], 0.0625)


def test_sizes_and_their_rounding():
    assert near(A.spread[0], 0.875)
    assert near(A.size[0], 3.875)
    assert 2.125 * (1 - 1e-9) <= A.least[0] < 2.125
    assert form(0.0, [0.0], 1.0).spread[0] == 1.0 + 2.0**-43
    assert form(1.0, [0.0], 0.0).size[0] == 1.0 + 2.0**-43
    assert form(1.0, [0.0], 0.0).least[0] == 1.0 - 2.0**-43
    assert form(0.25, [0.5], 0.0).least[0] < 0.0


def test_sums():
    for found, mid, slopes in ((A + B, 1.0, [0.75, 0.25]), (A - B, 5.0, [0.25, -0.75])):
        assert found.mid[0] == mid
        assert found.slopes[0].tolist() == slopes
        assert near(found.rad[0], 0.1875 + 2 * U * (3.875 + 2.8125))
    assert near((linear(A.mid, A.slopes) + linear(B.mid, B.slopes)).rad[0], 2 * U * (3.75 + 2.75))
    nothing = linear(np.zeros(1), np.zeros((1, 1)))
    assert 0.0 < (nothing + nothing).rad[0] <= 1e-290
    assert near((nothing + nothing).rad[0], 1e-290)


def test_products_attain_their_bounds():
    """At ξ = 1 and both at their upper ends, all signs alike, the remainder is the whole radius."""
    a, b = form(3.0, [0.5, 0.25], 0.125), form(2.0, [0.25, 0.5], 0.0625)
    found = a * b
    true = Fraction(3.875) * Fraction(2.8125) - Fraction(6) - sum(map(Fraction, found.slopes[0].tolist()))
    assert found.slopes[0].tolist() == [3 * 0.25 + 2 * 0.5, 3 * 0.5 + 2 * 0.25]
    assert near(found.rad[0], float(true) + 4 * U * 3.875 * 2.8125)
    x, y = form(3.0, [0.0], 0.0), form(7.0, [0.0], 0.0)
    assert near((x * y).rad[0], 84 * U)
    nothing = form(0.0, [0.0], 0.0)
    assert near((nothing * nothing).rad[0], 1e-290)


def test_multiples():
    found = A.scaled(-3.0, 0.25)
    assert found.mid[0] == -9.0
    assert found.slopes[0].tolist() == [-1.5, 0.75]
    assert near(found.rad[0], 0.375 + 0.25 * 3.875 + 2 * U * 3 * 3.875)
    exact = form(3.0, [0.0], 0.0)
    assert near(exact.scaled(7.0, 0.0).rad[0], 42 * U)
    assert near(form(0.0, [0.0], 0.0).scaled(1.0, 0.0).rad[0], 1e-290)


def test_wider_and_constant():
    assert near(A.widened(np.array([0.5])).rad[0], 0.625)
    found = constant(2.5, 0.5, 3)
    assert found.mid.tolist() == [2.5]
    assert found.rad.tolist() == [0.5]
    assert found.slopes.shape == (1, 3)
    assert not found.slopes.any()
    assert not linear(A.mid, A.slopes).rad.any()


def test_reciprocals_attain_their_bounds():
    """1/x at the end nearest to 0 is what its line there and the radius say."""
    x = form(2.0, [0.5], 0.25)
    found = reciprocal(x)
    assert found.mid[0] == 0.5
    assert found.slopes[0, 0] == -0.125
    true = 1 / 1.25 - (0.5 + 0.125)
    assert near(found.rad[0], true + 4 * U)
    assert near(reciprocal(form(-2.0, [0.5], 0.25)).rad[0], true + 4 * U)
    assert np.isinf(reciprocal(form(0.5, [0.5], 0.25)).rad[0])
    assert np.isinf(reciprocal(form(0.5, [0.25], 0.25)).rad[0])
    assert near(reciprocal(form(2.0, [0.0], 0.0)).rad[0], 4 * U)
    assert near(reciprocal(form(2.0**970, [0.0], 0.0)).rad[0], 1e-290)


def test_roots():
    x = form(4.0, [0.5], 0.25)
    found = root(x)
    assert found.mid[0] == 2.0
    assert found.slopes[0, 0] == 0.125
    bend = 0.75**2 / (8 * 3.25**1.5)
    assert near(found.rad[0], 0.25 * 0.25 + bend + 16 * U)
    for t in (-0.75, 0.75):
        assert abs(np.sqrt(4.0 + t) - 2.0 - 0.25 * t) <= bend
    assert np.isinf(root(form(0.5, [0.5], 0.25)).rad[0])
    assert np.isinf(root(form(-4.0, [0.5], 0.25)).rad[0])
    assert near(root(form(4.0, [0.0], 0.0)).rad[0], 16 * U)


def test_sines():
    x = form(0.75, [0.5, -0.25], 0.125)
    sine, cosine = sine_and_cosine(x)
    for found, value, slope in ((sine, np.sin(0.75), np.cos(0.75)), (cosine, np.cos(0.75), -np.sin(0.75))):
        assert found.mid[0] == EXACT(value, rel=1e-15)
        assert found.slopes[0] == EXACT(np.array([0.5, -0.25]) * slope, rel=1e-14)
        expected = (abs(slope) + SINE) * 0.125 + 0.5 * 0.875**2 + 2 * SINE * 1.875
        assert found.rad[0] == EXACT(expected, rel=1e-9)
    sharp = sine_and_cosine(form(0.75, [0.0], 0.0))[0]
    assert near(sharp.rad[0], 2 * SINE)
    for k in (0, 1):  # where the slope is 0, roundings are all that small residues and slopes have
        flat = form([np.pi / 2, 0.0][k], [0.0], 2.0**-24)
        expected = SINE * 2.0**-24 + 2.0**-49 + 2 * SINE * (1 + 2.0**-24)
        assert sine_and_cosine(flat)[k].rad[0] == EXACT(expected + 7e-17 * 2.0**-24, rel=2e-9, abs=0)
    straight = sine_and_cosine(form(0.0, [0.0], 0.125))[0]
    assert near(straight.rad[0], (1 + SINE) * 0.125 + 0.5 * 0.125**2 + 2 * SINE * 1.125)


@pytest.mark.parametrize("seed", range(4))
def test_truth_at_random_arguments(seed):
    """Every operation, at random ξ and residues, in exact numbers."""
    rng = np.random.default_rng(seed)
    operations = {
        "+": (lambda a, b: a + b, lambda x, y: x + y),
        "-": (lambda a, b: a - b, lambda x, y: x - y),
        "*": (lambda a, b: a * b, lambda x, y: x * y),
        "1/": (lambda a, _: reciprocal(a), lambda x, _: 1 / x),
        "root": (lambda a, _: root(a), lambda x, _: x.sqrt()),
        "sin": (lambda a, _: sine_and_cosine(a)[0], lambda x, _: x.sin()),
        "cos": (lambda a, _: sine_and_cosine(a)[1], lambda x, _: x.cos()),
    }
    with flint.ctx.workprec(200):
        for _ in range(50):
            pair = [form(rng.uniform(1, 3), rng.uniform(-0.3, 0.3, 2).tolist(), rng.uniform(0, 0.1)) for _ in "ab"]
            xi = rng.choice([-1.0, 1.0], 2) if rng.random() < 0.5 else rng.uniform(-1, 1, 2)
            at = [value(each, xi, rng.choice([-1.0, 1.0]) * each.rad[0]) for each in pair]
            for made, true in operations.values():
                found = made(*pair)
                assert abs(true(*at) - value(found, xi, 0.0)) <= flint.arb(found.rad[0])


def value(found, xi, residue):
    """Mid + slopes·ξ + residue, exactly."""
    total = flint.arb(float(found.mid[0])) + flint.arb(float(residue))
    for slope, x in zip(found.slopes[0].tolist(), xi.tolist(), strict=True):
        total += flint.arb(slope) * flint.arb(x)
    return total


def test_preconditioned_tables():
    """|C T| and |I − C T| by entry: middles, slopes that cancel, radii, roundings."""
    C = np.array([[[2.0, -1.0], [0.5, 1.0]]])
    table = [[form(0.5, [0.25], 0.125), form(0.25, [0.0], 0.0)], [form(0.25, [0.5], 0.0), form(1.0, [0.5], 0.25)]]
    sizes = np.array([[0.875, 0.25], [0.75, 1.75]])
    rounding = 8 * 4 * U * (np.abs(C[0]) @ sizes)
    radii = np.abs(C[0]) @ np.array([[0.125, 0.0], [0.0, 0.25]])
    moving = np.abs(C[0] @ np.array([[0.25, 0.0], [0.5, 0.5]]))
    middle = C[0] @ np.array([[0.5, 0.25], [0.25, 1.0]])
    found = preconditioned(C, table)[0]
    assert found == EXACT(np.abs(middle) + moving + radii + rounding, rel=1e-9)
    assert (found >= np.abs(middle) + moving + radii).all()
    left = preconditioned(C, table, less_identity=True)[0]
    assert left == EXACT(np.abs(np.eye(2) - middle) + moving + radii + rounding + 32 * U, rel=1e-12)
    exact = [[form(1.0, [0.0], 0.0), form(0.0, [0.0], 0.0)], [form(0.0, [0.0], 0.0), form(1.0, [0.0], 0.0)]]
    alone = preconditioned(np.eye(2)[None], exact, less_identity=True)[0]
    assert alone == EXACT(32 * U * np.array([[2.0, 1.0], [1.0, 2.0]]), rel=1e-9, abs=0)
    nothing = preconditioned(np.zeros((1, 2, 2)), exact)[0]
    assert near(nothing[0, 0], 1e-290)
