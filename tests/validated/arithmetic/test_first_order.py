"""Functions to first order: bounds that are attained, roundings as stated, and truth at random arguments."""

from fractions import Fraction

import numpy as np
import pytest

from ccpin.validated.arithmetic.first_order import (
    FirstOrder,
    constant,
    linear,
    preconditioned,
    products_of,
    reciprocal,
    root,
    sine_and_cosine,
)

flint = pytest.importorskip("flint")
U = 2.0**-53
EXACT, SINE = pytest.approx, 2.0**-50


def form(mid, slopes, rad, products=None):
    return FirstOrder(np.array([mid]), np.array([slopes]), np.array([rad]), products)


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
    assert near(found.rad[0], true + 8 * U)
    assert near(reciprocal(form(-2.0, [0.5], 0.25)).rad[0], true + 8 * U)
    assert np.isinf(reciprocal(form(0.5, [0.5], 0.25)).rad[0])
    assert np.isinf(reciprocal(form(0.5, [0.25], 0.25)).rad[0])
    assert near(reciprocal(form(2.0, [0.0], 0.0)).rad[0], 8 * U)
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
        expected = (abs(slope) + SINE) * 0.125 + 0.5 * abs(value) * 0.875**2 + 0.875**3 / 6
        expected += 2 * SINE * 1.875**2
        assert found.rad[0] == EXACT(expected, rel=1e-9)
    sharp = sine_and_cosine(form(0.75, [0.0], 0.0))[0]
    assert near(sharp.rad[0], 2 * SINE)
    for k in (0, 1):  # where the slope is 0, roundings are all that small residues and slopes have
        flat = form([np.pi / 2, 0.0][k], [0.0], 2.0**-24)
        expected = SINE * 2.0**-24 + 0.5 * 2.0**-48 + 2.0**-72 / 6 + 2 * SINE * (1 + 2.0**-24) ** 2
        assert sine_and_cosine(flat)[k].rad[0] == EXACT(expected + 7e-17 * 2.0**-24, rel=2e-9, abs=0)
    straight = sine_and_cosine(form(0.0, [0.0], 0.125))[0]
    assert near(straight.rad[0], (1 + SINE) * 0.125 + 0.125**3 / 6 + 2 * SINE * 1.125**2)


def test_products_are_axes():
    """Of groups of one, two and one axes, where the first is joined with all and the last with itself."""
    products = products_of([1, 2, 1], ((0, 0), (0, 1), (2, 0), (2, 2)))
    pairs = list(zip(products.first.tolist(), products.second.tolist(), strict=True))
    assert pairs == [(0, 0), (0, 1), (0, 2), (0, 3), (3, 3)]
    assert products.groups.tolist() == np.eye(4)[[0, 1, 1, 2, 3, 3, 3, 3, 3]].tolist()
    assert products.apart.tolist() == [[0, 0, 0, 1], [0, 1, 1, 1], [0, 1, 0, 1], [1, 1, 1, 1]]
    wide = A.beside(products)
    assert (wide.mid, wide.rad, wide.products) == (A.mid, A.rad, products)
    assert wide.slopes.tolist() == [[0.5, -0.25, 0.0, 0.0, 0.0, 0.0, 0.0]]


def multiplied(a, b, products):
    """Slopes of a product, and what is on no axis of it at most, in rationals, term by term."""
    (m, s, r), (n, t, o) = ([Fraction(x.mid[0]), list(map(Fraction, x.slopes[0])), Fraction(x.rad[0])] for x in (a, b))
    pairs = list(zip(products.first.tolist(), products.second.tolist(), strict=True))
    plain = len(s) - len(pairs)
    slopes, rest = [m * y + n * x for x, y in zip(s, t, strict=True)], abs(m) * o + abs(n) * r + r * o
    for i, x in enumerate(s):
        rest += abs(x) * o + r * abs(t[i])
        for j, y in enumerate(t):
            if (pair := (min(i, j), max(i, j))) in pairs:
                slopes[plain + pairs.index(pair)] += x * y
            else:
                rest += abs(x * y)
    return list(map(float, slopes)), float(rest)


P = products_of([1, 2, 1], ((0, 0), (0, 1), (2, 2)))


def test_products_on_axes_of_their_own_attain_their_bounds():
    """Of l l′ what is on no axis is the radius, term by term."""
    a = form(3.0, [0.5, -0.25, 0.125, 1.0, 0.0625, 0.5, 0.25, -0.125], 0.125, P)
    b = form(-2.0, [0.25, 0.5, -1.0, 0.75, 0.5, -0.25, 0.125, 1.0], 0.0625, P)
    slopes, rest = multiplied(a, b, P)
    rounding = 4 * U * float(a.size[0] * b.size[0])
    for found in (a * b, b * a):
        assert found.slopes[0].tolist() == slopes
        assert near(found.rad[0], rest + rounding)
        assert found.products is P
    assert near(b.bent.rad[0], multiplied(*[form(0.0, b.slopes[0].tolist(), 0.0625, P)] * 2, P)[1])
    for found in (a + b, a - b, -a, a.scaled(2.0, 0.0), a.widened(np.ones(1)), b.bent, *sine_and_cosine(a)):
        assert found.products is P
    assert reciprocal(a).products is root(form(9.0, [0.0] * 8, 0.0, P)).products is P
    assert linear(a.mid, a.slopes, P).products is constant(1.0, 0.0, 8, P).products is P


def test_second_terms_are_on_axes():
    """1/(2 + ξ/8) is 1/2 − ξ/32 + ξ²/512 − …; sin(m + ξ/8) has −ξ² sin(m)/128: what is left is of third order."""
    one = products_of([1], ((0, 0),))
    x = form(2.0, [0.125, 0.0], 0.0, one)
    inverse, (sine, cosine) = reciprocal(x), sine_and_cosine(x)
    assert inverse.slopes[0].tolist() == [-(2.0**-5), 2.0**-9]
    assert near(inverse.rad[0], 2.0**-12 / 1.875 + 8 * U + 2.0**-3 * 4 * U * 2.0**-6)
    assert sine.slopes[0] == EXACT([np.cos(2.0) / 8, -np.sin(2.0) / 128], rel=1e-14)
    assert cosine.slopes[0] == EXACT([-np.sin(2.0) / 8, -np.cos(2.0) / 128], rel=1e-14)
    for found in (sine, cosine):
        assert found.rad[0] == EXACT(2.0**-9 / 6, rel=1e-9)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("products", [None, products_of([1, 1], ((0, 0), (0, 1)))], ids=["first", "second"])
def test_truth_at_random_arguments(seed, products):
    """Every operation, at random ξ and residues, in exact numbers."""
    axes = 2 if products is None else len(products.groups)
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
            slopes = rng.uniform(-0.6, 0.6, (2, axes)) / axes
            pair = [form(rng.uniform(1, 3), each.tolist(), rng.uniform(0, 0.1), products) for each in slopes]
            xi = rng.choice([-1.0, 1.0], 2) if rng.random() < 0.5 else rng.integers(-(2**20), 2**20, 2) / 2.0**20
            if products is not None:  # products of such numbers are exact
                xi = np.append(xi, xi[products.first] * xi[products.second])
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
