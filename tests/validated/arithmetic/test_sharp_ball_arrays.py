"""Balls in doubles: radii as their operations' rounding and radii ask for, attained at the ends, and hardly more."""

from fractions import Fraction

import numpy as np
import pytest

pytest.importorskip("flint")

from ccpin.validated.arithmetic import balls
from ccpin.validated.arithmetic.ball_arrays import BallArray, exactly, hull, inverse, of_balls, raised, sine_and_cosine
from ccpin.validated.arithmetic.balls import ball, flint

U = 2.0**-53
OUT = 1.0 + 2.0**-46


def wide(mid, rad=0.0):
    mid = np.asarray(mid, float)
    return BallArray(mid, np.broadcast_to(np.asarray(rad, float), mid.shape).copy())


def test_what_is_rounded_up_is_above_some_hundred_roundings_and_underflows():
    assert 1.0 + 100 * U <= raised(np.array(1.0)) <= 1.0 + 2.0**-45
    assert raised(np.array(0.0)) == 1e-290


def test_roundings_of_exact_numbers():
    """A sum is off by u of itself, a product by 2u, k products by 4(k + 2)u, each at the radii's own rounding."""
    a, b = wide([3.0]), wide([7.0])
    assert (a + b).rad == 10 * U * OUT
    assert (a - b).rad == 4 * U * OUT
    assert (a * b).rad == 42 * U * OUT
    assert (wide([[3.0]]) @ wide([[7.0]])).rad == 21 * 12 * U * (1 + 12 * U) * OUT
    assert (wide([0.0]) * wide([0.0])).rad == 1e-290
    assert (wide([[0.0]]) @ wide([[0.0]])).rad == 1e-290
    k = 2000
    found = (wide(np.ones((1, k))) @ wide(np.ones((k, 1)))).rad[0, 0]
    rounding = 4 * U * (k + 2)
    assert found / (k * rounding) == pytest.approx(1.0 + rounding, abs=2e-13)


def test_sums_and_products_reach_the_ends_of_their_balls():
    """The farthest points of two balls are at the edge of their sum, product and matrix product."""
    a, b = wide([-3.0, 2.0], [0.5, 0.25]), wide([7.0, 5.0], [0.125, 1.0])
    assert (a + b).rad == pytest.approx([0.625, 1.25], rel=1e-12)
    assert (a - b).rad == pytest.approx([0.625, 1.25], rel=1e-12)
    assert (a - b).mid.tolist() == [-10.0, -3.0]
    assert (a * b).rad == pytest.approx([3.5 * 7.125 - 21.0, 2.25 * 6.0 - 10.0], rel=1e-12)
    row, column = BallArray(a.mid[None], a.rad[None]), BallArray(b.mid[:, None], b.rad[:, None])
    assert (row @ column).rad[0, 0] == pytest.approx(3.5 * 7.125 - 21.0 + 2.25 * 6.0 - 10.0, rel=1e-12)
    assert a.size == pytest.approx([3.5, 2.25], rel=1e-12)
    assert a.size[0] == 3.5 * OUT


def test_hulls_reach_the_ends():
    found = hull(wide([1.0, 5.0, -2.0, 7.0, 7.5, 8.0], [1.0, 0.5, 0.25, 0.5, 0.25, 1.0]), 3)
    assert found.mid.tolist() == [1.625, 7.75]
    assert found.rad[0] == (3.875 + 4 * U * 5.5) * OUT
    assert found.rad[1] == (1.25 + 4 * U * 9.0) * OUT
    assert hull(wide([-3.0]), 1).rad == 3.0 * 4 * U * OUT
    ends = np.array([0.1, 0.7])  # the middle is rounded: both sides count
    both = hull(wide(ends), 2)
    assert all(abs(Fraction(x) - Fraction(both.mid[0])) <= Fraction(both.rad[0]) for x in ends)


def test_tables_of_balls_hold_what_they_are_made_of():
    third = flint().arb(1) / 3
    found = of_balls([[ball(2), flint().arb(5, 0.25)], [third, ball(-1)]])
    assert found.mid.tolist() == [[2.0, 5.0], [1.0 / 3.0, -1.0]]
    assert found.rad[0] == pytest.approx([0.0, 0.25], abs=1e-15, rel=1e-8)
    assert 0.0 < found.rad[1, 0] < 1e-16


def test_sines_of_balls():
    """|cos m| r + r²/2, at most 2, and a rounding of 2⁻⁵⁰ of the value and of the slope."""
    T = 2.0**-50
    for r in (0.0, 1e-3, 1.0):
        sine, cosine = sine_and_cosine(wide([0.0], r))
        assert (sine.mid[0], cosine.mid[0]) == (0.0, 1.0)
        assert abs(sine.rad[0] - (min((1 + T) * r + 0.5 * r * r, 2.0) + T) * OUT) <= 2 * U * r
        assert abs(cosine.rad[0] - (T * r + 0.5 * r * r + T) * OUT) <= U * r
    sine, cosine = sine_and_cosine(wide([0.0], 9.0))
    assert sine.rad[0] == cosine.rad[0] == (2.0 + T) * OUT
    for r in (1e-3, 0.3):  # the ends are farther than the slope alone tells
        near = sine_and_cosine(wide([-1.0], r))[0]
        assert r * np.cos(1.0) < np.sin(1.0 + r) - np.sin(1.0) + 0.5 * r * r <= near.rad[0] + 0.5 * r * r
        assert abs(np.sin(-1.0 + r) - near.mid[0]) <= near.rad[0]


def test_inverses_reach_the_ends():
    """1/(1 ± δ) is at most 1 + δ + δ²/(1 − δ), attained; so it is on the diagonal of a matrix."""
    assert inverse(wide([[1.0]], 0.25)).rad[0, 0] == pytest.approx(1.0 / 3.0, rel=1e-12)
    assert inverse(wide([[2.0]], 0.5)).rad[0, 0] == pytest.approx(1.0 / 6.0, rel=1e-12)
    found = inverse(wide(np.eye(2), np.diag([0.5, 0.1])))
    assert found.mid.tolist() == [[1.0, 0.0], [0.0, 1.0]]
    assert found.rad[0, 0] == pytest.approx(1.0, rel=1e-12)
    assert found.rad[1, 1] == pytest.approx(0.1 + 0.25 / 0.5, rel=1e-12)  # above 1/0.9 − 1
    rows = inverse(wide(np.eye(2), [[0.25, 0.25], [0.0, 0.0]]))
    assert rows.rad[0, 1] == pytest.approx(0.25 + 0.25 / 0.5, rel=1e-12)  # above 0.25/0.75


def test_matrices_that_may_be_singular_are_not_inverted():
    assert inverse(wide([[1.0]], 0.985)) is not None
    assert inverse(wide([[1.0]], 1.0)) is None
    assert inverse(wide([[[1.0]], [[1.0]]], [[[0.1]], [[1.5]]])) is None
    assert inverse(wide([[np.nan]])) is None
    assert inverse(exactly(np.zeros((2, 2)))) is None


def test_the_gain_of_turns_is_enclosed_with_its_derivatives_to_both_ends():
    """g(w) = 2 arccos(w)/√(1 − w²) by power series of arccos, at both ends of a ball; not at half a turn."""
    with flint().ctx.workprec(120):
        w = flint().arb(0.3, 0.125)
        for order in range(4):
            ends = [closed_form(x, order) for x in (w.lower(), w.upper())]
            found = balls.gain(w, order)
            for end in ends:
                assert found.contains(end.mid())
            assert float(found.rad()) == pytest.approx(abs(float((ends[0] - ends[1]).mid())) / 2, rel=1e-6)
        assert not balls.gain(flint().arb(-1), 0).is_finite()
        assert not balls.gain(flint().arb(-0.875, 0.25), 0).is_finite()
        assert balls.gain(flint().arb(-0.875, 0.0625), 0).is_finite()


def closed_form(w, order):
    """The k-th derivative of g from its power series about w."""
    x = flint().arb_series([w, 1], prec=order + 1)
    g = 2 * x.acos() / (1 - x * x).sqrt()
    return g[order] * flint().arb(order).gamma() * order if order else g[0]


def test_balls_about_balls_and_finite_boxes():
    x = balls.around(flint().arb(2, 0.25), flint().arb(0.5, 0.125))
    assert float(x.upper()) == pytest.approx(2.875)
    assert float(x.lower()) == pytest.approx(1.125)
    assert balls.finite([ball(1), ball(2)])
    assert not balls.finite([ball(1), ball("nan")])


def test_balls_put_together_keep_every_bit():
    with flint().ctx.workprec(300):
        x = flint().arb(1) / 3
        found = balls._put_together(*[(int(m), int(e)) for m, e in (x.mid().man_exp(), x.rad().man_exp())])
        assert found.mid().man_exp() == x.mid().man_exp()
    short = balls._put_together((5, 0), (1, -3))
    assert float(short.mid()) == 5.0
    assert float(short.rad()) == pytest.approx(0.125)
