"""Functions analytic in a polydisc: against polynomials in whole numbers, where bounds are attained, and series."""

from fractions import Fraction
from math import comb, factorial

import numpy as np
import pytest

pytest.importorskip("flint")
from ccpin.programs.instructions import Code, Instruction, Kind, LinearSystem
from ccpin.validated.arithmetic.ball_arrays import BallArray, exactly
from ccpin.validated.arithmetic.balls import ball, flint, upper
from ccpin.validated.arithmetic.chebyshev import between, beyond, bounded, waves
from ccpin.validated.arithmetic.polydisc import (
    Analytic,
    constants,
    evaluated,
    inverse,
    ring,
    sine_and_cosine,
    solution,
    stacked,
    unit,
)
from ccpin.validated.arithmetic.series import NotInvertibleError

PLANE, LINE = ring(2, 3), ring(1, 12)


def whole(rng, *shape, known=PLANE, rest=0.0):
    """Functions with whole coefficients."""
    mid = rng.integers(-4, 5, (*shape, len(known.exponents))).astype(float)
    return Analytic(mid, np.full(shape, rest), known)


def dense(f):
    """Coefficients by exponents, of twice the degree."""
    table = np.zeros((7, 7))
    for k, a in zip(f.ring.exponents, f.mid, strict=True):
        table[tuple(k)] = a
    return table


def multiplied(a, b):
    """The product of two dense polynomials."""
    found = np.zeros((7, 7))
    for i, j in np.argwhere(a):
        found[i:, j:] += a[i, j] * b[: 7 - i, : 7 - j]
    return found


def near(rest, exact):
    """A bound that holds and is attained but for roundings."""
    assert exact <= rest <= exact * (1 + 1e-9) + 1e-11


def test_the_ring():
    """C(N + n, n) monomials by degree; 1, ξ₁ and ξ₂ first."""
    assert len(PLANE.exponents) == comb(5, 2)
    assert len(ring(3, 4).exponents) == comb(7, 3)
    assert sorted(map(tuple, PLANE.exponents[:3].tolist())) == [(0, 0), (0, 1), (1, 0)]


@pytest.mark.parametrize("seed", range(4))
def test_products_are_those_of_polynomials(seed):
    """What is of degree N is exact, and what is beyond, and what factors leave, is all of what is left."""
    rng = np.random.default_rng(seed)
    f, g = whole(rng), whole(rng)
    signs = np.abs(f.mid), np.abs(g.mid)
    exact, sizes = multiplied(dense(f), dense(g)), multiplied(*(dense(f._replace(mid=each)) for each in signs))
    product = f * g
    low = np.add.outer(np.arange(7), np.arange(7)) <= 3
    assert np.array_equal(dense(product)[low], exact[low])
    near(product.rest, sizes[~low].sum())
    a, b = f._replace(rest=np.array(0.5)), g._replace(rest=np.array(0.25))
    near((a * b).rest - product.rest, 0.5 * signs[1].sum() + 0.25 * signs[0].sum() + 0.125)
    assert (f * g).size >= np.abs(exact).sum()


def test_sums_and_scales():
    """Coefficients and what is left add; a factor that is not sure makes as much of all."""
    rng = np.random.default_rng(1)
    f, g = whole(rng, rest=0.5), whole(rng, rest=0.25)
    assert np.array_equal((f + g).mid, f.mid + g.mid)
    assert np.array_equal((f - g).mid, f.mid - g.mid)
    near((f + g).rest, 0.75)
    near((f - g).rest, 0.75)
    near(f.scaled(-3.0, 0.125).rest, 3 * 0.5 + 0.125 * (np.abs(f.mid).sum() + 0.5))
    assert np.array_equal(f.scaled(-3.0, 0.0).mid, -3.0 * f.mid)
    near(f.size, np.abs(f.mid).sum() + 0.5)
    assert f.polynomials.rest == 0.0


def test_products_of_matrices():
    """Sums of products, entry by entry."""
    rng = np.random.default_rng(2)
    a, b = whole(rng, 2, 3, rest=0.5), whole(rng, 3, 2, rest=0.25)
    found = a @ b
    for i in range(2):
        for j in range(2):
            terms = [a.at((i, k)) * b.at((k, j)) for k in range(3)]
            assert np.array_equal(found.mid[i, j], sum(term.mid for term in terms))
            near(found.rest[i, j], sum(term.rest for term in terms))


@pytest.mark.parametrize(("m", "u"), [(0.7, 0.5), (-2.0, 1.5), (0.0, 0.0)])
def test_sines(m, u):
    """sin(m + uξ) has u^k/k! times ± sin m or cos m; what is beyond N is left, and no more."""
    angle = constants(np.array(m), np.array(0.0), LINE)
    angle.mid[1] = u
    for found, derivatives in zip(
        sine_and_cosine(angle), ([np.sin, np.cos], [np.cos, lambda x: -np.sin(x)]), strict=True
    ):
        exact = [(-1) ** (k // 2) * derivatives[k % 2](m) * u**k / factorial(k) for k in range(30)]
        off = np.abs(found.mid - exact[:13]).sum() + np.abs(exact[13:]).sum()
        assert off <= found.rest + 1e-15
        assert found.rest <= 2 * sum(u**k / factorial(k) for k in range(13, 30)) + 1e-13


def test_a_sine_knows_what_is_left():
    """|sin(m + δ) − sin m| up to |δ|."""
    angle = constants(np.array(0.5), np.array(1e-3), LINE)
    sine, cosine = sine_and_cosine(angle)
    assert np.sin(0.5 + 1e-3) - sine.mid[0] <= sine.rest <= 1.5e-3
    assert cosine.mid[0] - np.cos(0.5 + 1e-3) <= cosine.rest <= 1.5e-3


def test_a_large_turn_has_no_bound():
    """Of sin u up to u⁴⁰/40!, |u| = s, as much is left as sinh s has beyond; from s = 20.5 on it is not told."""
    s = 20.0
    known = float(sum(Fraction(s) ** k / factorial(k) for k in range(1, 41, 2)))
    beyond_it = float(sum(Fraction(s) ** k / factorial(k) for k in range(41, 141, 2)))
    found = sine_and_cosine(constants(np.array(0.0), np.array(s), LINE))[0].rest
    assert known + beyond_it <= found <= known + 1.05 * beyond_it
    for large in (21.5, 1e3):
        assert np.isinf(sine_and_cosine(constants(np.array(0.5), np.array(large), LINE))[0].rest)


def test_roundings_of_sums_are_counted():
    """½ + (½ + 2⁻⁵³) is 2⁻⁵³ off: one unit of both, and not more than that is counted."""
    a, b = (constants(np.array(x), np.array(0.0), LINE) for x in (0.5, 0.5 + 2.0**-53))
    for total in (a + b, b + a):
        off = abs(Fraction(0.5) + Fraction(0.5 + 2.0**-53) - Fraction(total.mid[0]))
        assert off == Fraction(2) ** -53
        assert off <= Fraction(float(total.rest)) <= off * Fraction(11, 10)


def test_roundings_of_products_are_counted():
    """In exact numbers; 1e-200 squared is 0 in doubles, and is not."""
    rng, tiny = np.random.default_rng(7), np.full(1, 1e-200)
    f, g = (constants(x, np.zeros(1), LINE) for x in rng.uniform(1.0, 2.0, (2, 1)))
    f.mid[0, 1], g.mid[0, 1] = rng.uniform(1.0, 2.0, 2)
    (a, b), (c, d) = ([Fraction(x) for x in each.mid[0, :2].tolist()] for each in (f, g))
    small = constants(tiny, np.zeros(1), LINE)
    for exact, found in (
        ((a * c, a * d + b * c, b * d), (f * g).at(0)),
        ((a * c, a * d + b * c, b * d), (f.at(np.s_[:, None]) @ g.at(np.s_[:, None])).at((0, 0))),
        ((a / 10, b / 10, Fraction(0)), f.scaled(0.1, 0.1 - float(np.nextafter(0.1, 0.0))).at(0)),
        ((Fraction(1e-200) ** 2,), (small * small).at(0)),
        ((Fraction(1e-200) ** 2,), (small.at(np.s_[:, None]) @ small.at(np.s_[:, None])).at((0, 0))),
        ((Fraction(1e-200) ** 2,), small.scaled(1e-200, 0.0).at(0)),
    ):
        off = sum(abs(x - Fraction(y)) for x, y in zip(exact, found.mid.tolist(), strict=False))
        assert 0 < off <= Fraction(float(found.rest))


def geometric(a):
    """(1, 1) matrices a − ξ, whose inverses have coefficients a^(−k−1)."""
    mid = np.zeros((1, 1, len(LINE.exponents)))
    mid[0, 0, :2] = a, -1.0
    return Analytic(mid, np.zeros((1, 1)), LINE)


def test_solutions():
    """1/(a − ξ): what is left is Σ a^(−k−1) beyond N, times what bounds of it are above it."""
    a = 4.0
    one = constants(np.ones((1, 1)), np.zeros((1, 1)), LINE)
    np.testing.assert_allclose(inverse(geometric(a)).mid[0, 0], a ** -(np.arange(13) + 1.0), rtol=1e-12)
    found = solution(geometric(a), one)
    off = np.abs(found.mid[0, 0] - a ** -(np.arange(13) + 1.0)).sum() + a**-13.0 / (a - 1.0)
    assert off <= found.rest[0, 0] <= 3 * off + 1e-14
    loose = solution(geometric(a)._replace(rest=np.array([[0.5]])), one)
    assert 1 / (a - 1.5) - 1 / (a - 1.0) <= loose.rest[0, 0] <= 3 * (1 / (a - 1.5) - 1 / (a - 1.0))
    for wrong in (geometric(1.0), geometric(0.0), geometric(a)._replace(rest=np.array([[3.5]]))):
        with pytest.raises(NotInvertibleError):
            solution(wrong, one)


def test_the_largest_row_bounds_all():
    """A pair of equations that are coupled: each is off by what the other is."""
    mid = np.zeros((2, 2, len(LINE.exponents)))
    mid[..., 0] = [[1.0, 0.25], [0.25, 1.0]]
    matrix = Analytic(mid, np.array([[0.0, 0.0], [0.125, 0.0]]), LINE)
    right = constants(np.array([[1.0], [0.0]]), np.zeros((2, 1)), LINE)
    found = solution(matrix, right)
    for off in (-0.125, 0.125):
        exact = np.linalg.solve([[1.0, 0.25], [0.25 + off, 1.0]], [1.0, 0.0])
        assert np.all(np.abs(exact - found.mid[:, 0, 0]) <= found.rest[:, 0])


def test_programs():
    """A sum, its slopes, and what is not known over complex numbers."""
    items = (
        Instruction(Kind.ADD, 2, 0, 1),
        Instruction(Kind.GAIN, 3, 2, 0),
    )
    mid = np.zeros((2, len(LINE.exponents)))
    mid[:, 1] = 1.0, 2.0
    inputs = Analytic(mid, np.zeros(2), LINE)
    with pytest.raises(NotInvertibleError):
        evaluated(Code(4, 2, items, (3,)), inputs)
    values, slopes = evaluated(Code(3, 2, items[:1], (2,)), inputs, (1, 0))
    assert values.mid[0, 1] == 3.0
    assert np.array_equal(slopes.mid[0, :, 0], [1.0, 1.0])


def test_stacks_and_units():
    assert np.array_equal(unit(2, LINE).mid[..., 0], np.eye(2))
    one = constants(np.array(1.0), np.array(0.5), LINE)
    assert stacked([one, one]).mid.shape == (2, 13)


def test_chebyshev_polynomials():
    """Π T_k by cosines."""
    rng = np.random.default_rng(3)
    points = rng.uniform(-1.0, 1.0, (5, 2))
    found = waves(points, 3)
    exact = np.prod(np.cos(ring(2, 3).exponents * np.arccos(points)[:, None]), axis=2)
    assert np.all(np.abs(found.mid - exact) <= found.rad + 1e-15)
    assert found.rad.max() < 1e-13


def test_chebyshev_polynomials_of_high_degree():
    """r_(i+j) = 2 (r_i + r_j) + r_(i−j) + 9u at most: 8uN² covers that, u = 2⁻⁵³, where (1 + √2)^N would not do."""
    points = np.linspace(-1.0, 1.0, 7)
    found = waves(points[:, None], 99)
    with flint().ctx.workprec(128):
        off = [[upper(abs(ball(x).chebyshev_t(k) - ball(t))) for k, t in enumerate(row)]
               for x, row in zip(points.tolist(), found.mid.tolist(), strict=True)]  # fmt: skip
    assert np.all(off <= found.rad)
    assert found.rad.max() < 99**2 * 2.0**-50


@pytest.mark.parametrize(("n", "degree", "rho"), [(1, 5, 2.0), (2, 3, 4.0), (3, 8, 10.0)])
def test_what_is_beyond_a_degree(n, degree, rho):
    """The series itself, summed: the bound is at most what the ratio of its first terms makes of it."""
    exact = 2**n * sum(comb(m + n - 1, n - 1) * rho**-m for m in range(degree + 1, degree + 200))
    found = float(beyond(np.array([3.0]), n, degree, rho)[0])
    assert 3.0 * exact * (1 - 1e-12) <= found <= 3.0 * exact * 1.1
    assert np.isinf(beyond(np.ones(1), n, degree, 1.01)[0])


def test_what_is_beyond_is_not_nothing():
    """1e-620 is 0 in doubles."""
    assert beyond(np.ones(1), 1, 30, 1e20)[0] > 0.0


@pytest.mark.parametrize("a", [1.5, 3.0])
def test_bounds_over_a_box_hold(a):
    """1/(a − ξ): its largest value is at 1; M = 1/(a − (ρ + 1/ρ)/2) on an ellipse that reaches less than a."""
    degree = 20
    points = np.cos((np.arange(degree + 1) + 0.5) * np.pi / (degree + 1))[:, None]
    rho = 0.9 * (a + np.sqrt(a * a - 1.0))
    most = np.array([1.0 / (a - 0.5 * (rho + 1.0 / rho))])
    found = bounded(exactly(1.0 / (a - points)), points, degree, most, rho)[0]
    series = 1 / np.sqrt(a * a - 1.0) * (1 + 2 / (a + np.sqrt(a * a - 1.0) - 1.0))
    assert 1.0 / (a - 1.0) <= found * (1 + 1e-9)
    assert found <= series * (1 + 1e-6) + 50 * beyond(most, 1, degree, rho)[0]


def test_nothing_is_known_between_points_that_do_not_decide():
    """The same point twice, and what values are is not known."""
    points = np.array([[0.5], [0.5]])
    assert np.isinf(bounded(exactly(np.zeros((2, 1))), points, 1, np.ones(1), 10.0)[0])
    still = np.array([[-1.0], [1.0]])
    held = bounded(BallArray(np.zeros((2, 1)), np.full((2, 1), 0.25)), still, 1, np.zeros(1), 10.0)[0]
    assert 0.25 <= held <= 0.5 * (1 + 1e-9)


def test_what_is_beyond_counts():
    """With values 0 the bound is t (1 + Σ|L|): 3 at ξ = ±1 for lines."""
    points = np.array([[-1.0], [1.0]])
    most = np.ones(1)
    found = bounded(exactly(np.zeros((2, 1))), points, 1, most, 10.0)[0]
    assert found == pytest.approx(3.0 * beyond(most, 1, 1, 10.0)[0], rel=1e-9)


@pytest.mark.parametrize(("short", "bound"), [((1.0, 1.0), 3.0), ((1.0, 0.52), 2.04 / 0.52), ((0.48, 1.0), np.inf)])
def test_a_matrix_that_is_no_inverse(short, bound):
    """L diagonal beside V = I, of 1 and 2: (L₁ + 2 L₂)/(1 − δ), δ the larger of 1 − L₁ and 1 − L₂; ∞ over ½."""
    near, values = np.diag(short), exactly(np.array([[1.0], [2.0]]))
    found = between(near, exactly(np.eye(2)), values, np.zeros(1))[0]
    assert found == pytest.approx(bound, rel=1e-9)


def test_ellipses_that_are_too_narrow():
    """κ of a line is (N + 2)/((N + 2)ρ) = 1/ρ: below ¾ it is used."""
    assert np.isfinite(beyond(np.ones(1), 1, 5, 1 / 0.74)[0])
    assert np.isinf(beyond(np.ones(1), 1, 5, 1 / 0.76)[0])


def test_programs_of_every_instruction():
    """Values and slopes of (2 − x) y sin x cos x + 3, and A⁻¹b, near ξ = 0, by formulas of numbers."""
    three = flint().arb(3)
    items = (
        Instruction(Kind.CONSTANT, 2, constant=flint().arb(2)),
        Instruction(Kind.SUBTRACT, 3, 2, 0),
        Instruction(Kind.MULTIPLY, 4, 3, 1),
        Instruction(Kind.SINE, 5, 0, 6),
        Instruction(Kind.COSINE, 6, 0, 5),
        Instruction(Kind.MULTIPLY, 7, 4, 5),
        Instruction(Kind.MULTIPLY, 8, 7, 6),
        Instruction(Kind.SCALE, 9, 8, constant=three),
    )
    mid = np.zeros((2, len(LINE.exponents)))
    mid[:, 0] = x, y = 0.7, 1.3
    inputs = Analytic(mid, np.zeros(2), LINE)
    values, slopes = evaluated(Code(10, 2, items, (9,)), inputs, (0, 1))
    s, c = np.sin(x), np.cos(x)
    assert values.mid[0, 0] == pytest.approx(3 * (2 - x) * y * s * c, rel=1e-14)
    exact = 3 * y * (-s * c + (2 - x) * (c * c - s * s)), 3 * (2 - x) * s * c
    np.testing.assert_allclose(slopes.mid[0, :, 0], exact, rtol=1e-13)
    system = LinearSystem(((0, 1), (1, 2)), ((1, 0), (0, 2)))
    solve = (
        items[0],
        Instruction(Kind.SOLVE, 3, None, system),
        *(Instruction(Kind.PART, 4 + k, 3, k) for k in range(4)),
    )
    program = Code(8, 2, solve, (4, 5, 6, 7))
    found = evaluated(program, inputs).values
    np.testing.assert_allclose(found.mid[:, 0], np.linalg.solve([[x, y], [y, 2]], [[y, x], [x, 2]]).ravel(), rtol=1e-13)
    with pytest.raises(NotInvertibleError):
        evaluated(program, inputs, (0,))


@pytest.mark.parametrize("off", [0.25, 0.48])
def test_what_is_left_of_a_solution_is_sharp(off):
    """1 ± off, solved for 1: 1/(1 − off) is off/(1 − off) from 1; two rows, of which the other is exact."""
    matrix = unit(2, LINE)._replace(rest=np.array([[off, 0.0], [0.0, 0.0]]))
    one = constants(np.ones((2, 1)), np.zeros((2, 1)), LINE)
    assert solution(matrix, one).rest[0, 0] == pytest.approx(off / (1.0 - off), rel=1e-9)
    with pytest.raises(NotInvertibleError):
        solution(matrix._replace(rest=np.array([[0.52, 0.0], [0.0, 0.0]])), one)
