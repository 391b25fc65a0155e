"""Bounds along polynomials: attained where all coefficients are positive, else as the rules of `defect` say."""

from math import factorial

import numpy as np
import pytest

pytest.importorskip("flint")

from ccpin.programs.tape import Tape
from ccpin.validated.arithmetic.balls import ball, flint
from ccpin.validated.arithmetic.programs import in_balls
from ccpin.validated.arithmetic.series import NotInvertibleError, all_series, extend
from ccpin.validated.flow.defect import _AlongPolynomial, defect_along, sizes_along

N, H = 4, 0.5
X, Y = [0.5, 0.25, 0.125, 0.5, 1.0], [0.25, 0.5, 1.0, 0.125, 0.25]
POWERS = H ** np.arange(20)


pytestmark = pytest.mark.usefixtures("precise")


def along(outputs, *polynomials):
    """What is known of outputs (recorded from the inputs) along polynomials: terms, ω and the coefficients."""
    tape = Tape(len(polynomials))
    program = in_balls(tape, outputs(tape, *tape.inputs))
    series = [[ball(c) for c in p] for p in polynomials] + [[] for _ in range(program.size - len(polynomials))]
    extend(program, series, N)
    run = _AlongPolynomial.over(program, series, ball(H))
    return program, series, run


def of(found, k=0):
    program, _, run = found
    return run.bounds[program.outputs[k]]


def test_sizes_along_polynomials_hold_products_of_inputs():
    """‖x y‖ and what is beyond degree N − 1 make up x(h) y(h) where all coefficients are positive."""
    tape = Tape(2)
    x, y = tape.inputs
    program = in_balls(tape, [x * y, x + y])
    (product, total) = sizes_along(program, [[ball(c) for c in p] for p in (X, Y)], ball(H))
    assert float(product) == pytest.approx((X @ POWERS[:5]) * (Y @ POWERS[:5]), rel=1e-12)
    assert float(total) == pytest.approx((X + np.array(Y)) @ POWERS[:5], rel=1e-12)


def test_what_a_product_has_beyond_its_degree_is_attained():
    """At h, of positive coefficients; (x − y) counts both rests, a factor its size."""
    found = along(lambda tape, x, y: [x * y, x - y, x + y, x * -3], X, Y)
    exact = np.convolve(X, Y)
    assert float(of(found, 0).rest) == pytest.approx(exact[N:] @ POWERS[N : len(exact)], rel=1e-12)
    assert float(of(found, 0).size) == pytest.approx(exact[:N] @ POWERS[:N], rel=1e-12)
    both = (X[N] + Y[N]) * H**N
    assert float(of(found, 1).rest) == pytest.approx(both, rel=1e-12)
    assert float(of(found, 2).rest) == pytest.approx(both, rel=1e-12)
    assert float(of(found, 3).rest) == pytest.approx(3 * X[N] * H**N, rel=1e-12)
    again = along(lambda tape, x, y: [(x * y) * (x + y)], X, Y)
    assert float(of(again).rest + of(again).size) == pytest.approx(
        (X @ POWERS[:5]) * (Y @ POWERS[:5]) * ((X + np.array(Y)) @ POWERS[:5]), rel=1e-12
    )


def truncated(a, b):
    """T(a, b)."""
    return sum(abs(a[i]) * abs(b[j]) * H ** (i + j) for i in range(N) for j in range(N) if i + j >= N)


def test_sines_by_their_rule_and_above_what_they_are():
    """T(u, |sin| + |cos|) + ω_u."""
    program, series, _ = found = along(lambda tape, x: [*tape.sincos(x)], X)
    s, c = ([float(x) for x in series[number]] for number in program.outputs)
    expected = truncated(X, np.abs(s) + np.abs(c)) + X[N] * H**N
    at = X @ POWERS[:5]
    for k, (row, value) in enumerate(((s, np.sin(at)), (c, np.cos(at)))):
        assert float(of(found, k).rest) == pytest.approx(expected, rel=1e-12)
        assert abs(value - row @ POWERS[:N]) < expected
        assert float(of(found, k).size) == pytest.approx(np.abs(row) @ POWERS[:N], rel=1e-12)


def gain_series(centre, order, count):
    """Derivatives of g⁽ᵏ⁾ at a point, from its power series."""
    x = flint().arb_series([ball(centre), 1], prec=order + count + 1)
    g = 2 * x.acos() / (1 - x * x).sqrt()
    return [float(g[order + j]) * factorial(order + j) for j in range(count + 1)]


@pytest.mark.parametrize("order", [0, 1])
def test_gains_by_their_rule_and_above_what_they_are(order):
    """Σ_j |g⁽ʲ⁾(u₀)|/j! · (what (ũ − u₀)ʲ has from degree N on), Lagrange's remainder and sup|g′| ω_u."""
    u = [0.5, 0.125, 0.0625, -0.125, 0.25]
    program, series, _ = found = along(lambda tape, x: [tape.gain(x, order)], u)
    steps = np.abs(u[:N]) * POWERS[:N]
    reach, rest = steps[1:].sum(), abs(u[N]) * H**N
    slopes = gain_series(u[0], order, N)
    power, total = np.array([1.0]), 0.0
    for j in range(1, N):
        power = np.convolve(power, [0.0, *steps[1:]])
        total += abs(slopes[j]) / factorial(j) * power[N:].sum()
    low = gain_series(u[0] - reach - rest, order, N)  # where |g⁽ʲ⁾| is largest
    total += abs(low[N]) / factorial(N) * reach**N + abs(low[1]) * rest
    assert float(of(found).rest) == pytest.approx(total, rel=1e-6)
    value = gain_series(u @ POWERS[:5], order, 0)[0]
    told = [float(x) for x in series[program.outputs[0]]] @ POWERS[:N]
    assert abs(value - told) < total


def test_solutions_by_their_rule_and_above_what_they_are():
    """|A(t)⁻¹|(ω_B + T(A, z) + ω_A‖z‖): 1/x of an x that falls, where |1/x| is largest at h; alike for two columns."""
    x = [2.0, -0.25, -0.125, -0.125, -0.0625]
    program, series, _ = found = along(lambda tape, a: [tape.solve([[a]], [[tape.node(1)]])[0, 0]], x)
    z = [float(c) for c in series[program.outputs[0]]]
    size = np.abs(z) @ POWERS[:N]
    expected = (truncated(x, z) + abs(x[N]) * H**N * size) / (x @ POWERS[:5])
    assert float(of(found).rest) == pytest.approx(expected, rel=1e-7)
    assert float(of(found).rest) >= abs(1 / (x @ POWERS[:5]) - z @ POWERS[:N])


def test_systems_by_their_rule():
    """Two unknowns, two columns, entries with rests."""

    def outputs(tape, x, y):
        return tape.solve([[x + 3, y], [0, tape.node(2)]], [[y, tape.node(1)], [x, x * y]]).ravel()

    program, series, _ = found = along(outputs, X, Y)
    x, y = np.array(X), np.array(Y)
    a = [[np.add(x, [3.0, 0, 0, 0, 0]), y], [np.zeros(5), [2.0, 0, 0, 0, 0]]]
    z = [of(found, k).terms for k in range(4)]
    z = [[float(t) for t in terms] for terms in z]
    tops = [sum(np.abs(p) * POWERS[:5]) for p in (a[0][0], y)]
    inner = [a[0][0] @ POWERS[:5], 3.5]
    rest = {"x": X[N] * H**N, "y": Y[N] * H**N, "xy": np.convolve(x, y)[N:] @ POWERS[N:9]}

    def tail(p, terms):
        return sum(abs(p[i]) * H**i * terms[j] for i in range(N) for j in range(N) if i + j >= N)

    def residual(row, column):
        known = [[rest["y"], 0.0], [rest["x"], rest["xy"]]][row][column]
        own = [rest["x"], rest["y"]] if row == 0 else [0.0, 0.0]
        return known + sum(tail(a[row][k], z[2 * k + column]) + own[k] * sum(z[2 * k + column]) for k in (0, 1))

    first = 1.0 / 3.5  # |A⁻¹| over the step: 1/(x + 3), y/(2(x + 3)) and ½, at their ends
    assert inner[0] > 3.5
    for column in (0, 1):
        assert float(of(found, 2 + column).rest) == pytest.approx(0.5 * residual(1, column), rel=1e-7)
        told = float(of(found, column).rest)
        least = first * residual(0, column)
        assert least < told < 1.05 * (least + tops[1] / 7.0 * residual(1, column))
    end = np.linalg.solve(
        [[a[0][0] @ POWERS[:5], y @ POWERS[:5]], [0.0, 2.0]],
        [[y @ POWERS[:5], 1.0], [x @ POWERS[:5], (x @ POWERS[:5]) * (y @ POWERS[:5])]],
    ).ravel()
    for k, value in enumerate(end):
        row = series[program.outputs[k]]
        assert abs(value - [float(c) for c in row] @ POWERS[:N]) <= float(of(found, k).rest)


def test_the_range_of_a_value_reaches_its_ends():
    """C₀ + c₁ t + …, on [0, h], of positive coefficients: from 0 to h, with ω at the end."""
    *_, run = along(lambda tape, x: [x], [0.5, 0.25, -0.5, 0.25, 1.0])
    found = run.range(0)
    beyond = 0.5 * H**2 + 0.25 * H**3 + H**4
    assert float(found.lower()) == pytest.approx(0.5 - beyond, rel=1e-8)
    assert float(found.upper()) == pytest.approx(0.5 + 0.25 * H + beyond, rel=1e-8)


def test_matrices_that_may_be_singular_along_the_way_are_refused():
    with pytest.raises(NotInvertibleError):
        along(lambda tape, a: [tape.solve([[a]], [[tape.node(1)]])[0, 0]], [1.0, -2.0, 0.0, 0.0, 0.0])


def test_the_defect_of_a_known_solution():
    """X′ = x² from ½: of the polynomial of degree N, p′ − p² has the terms of p² from degree N on, attained at h."""
    tape = Tape(1)
    (x,) = tape.inputs
    program = in_balls(tape, [x * x])
    series = all_series(program, [ball(0.5)], N)
    p = np.array([float(c) for c in series[0]])
    square = np.convolve(p, p)
    assert float(defect_along(program, series, ball(H))[0]) == pytest.approx(
        square[N:] @ POWERS[N : len(square)], rel=1e-12
    )
