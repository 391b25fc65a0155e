"""Bernstein coefficients by exact fractions, their stated roundings, and which paths are refused."""

from fractions import Fraction
from math import comb

import numpy as np
import pytest
from scipy.interpolate import BSpline, PPoly

from ccpin.domain.paths import pieces as module
from ccpin.domain.paths.pieces import pieces_of
from ccpin.errors import InvalidInputError
from ccpin.proof.chords import _bernstein, chords_of, points_of

U = Fraction(1, 2**53)


def exact(coefficients, s, h, sizes=False):
    """β_i of Σ c_k t^k (the lowest power first) over [s, s + h], or of the absolute values."""
    d = len(coefficients) - 1
    c = [abs(Fraction(x)) if sizes else Fraction(x) for x in coefficients]
    a = [h**j * sum(comb(i, j) * c[i] * s ** (i - j) for i in range(j, d + 1)) for j in range(d + 1)]
    return [sum(Fraction(comb(i, j), comb(d, j)) * a[j] for j in range(i + 1)) for i in range(d + 1)]


@pytest.mark.parametrize("degree", [1, 2, 3, 5])
def test_bernstein_coefficients_and_their_roundings(degree):
    """Of the piece that the stretch begins in, from its own beginning; off by at most (8d + 16)u of the sizes."""
    rng = np.random.default_rng(degree)
    pieces = PPoly(rng.normal(size=(degree + 1, 3, 2)), np.array([-1.0, 0.5, 2.0, 4.0]))
    start, length = np.array([-1.0, 0.0, 0.5, 1.75, 2.5, 4.0]), np.array([0.5, 0.5, 0.75, 0.25, 1.5, 0.0])
    values, rounding = _bernstein(pieces, start, length)
    assert values.shape == rounding.shape == (degree + 1, 6, 2)
    for k, number in enumerate([0, 0, 1, 1, 2, 2]):
        s, h = Fraction(start[k]) - Fraction(pieces.x[number]), Fraction(length[k])
        for i in (0, 1):
            coefficients = pieces.c[::-1, number, i].tolist()
            told = exact(coefficients, s, h)
            sizes = exact(coefficients, s, h, sizes=True)
            for value, off, beta, size in zip(values[:, k, i], rounding[:, k, i], told, sizes, strict=True):
                assert abs(Fraction(value) - beta) <= Fraction(off)
                assert off == pytest.approx(float((8 * degree + 16) * U * size), rel=1e-12, abs=0)


def test_coefficients_of_nothing_are_rounded_too():
    """By the least double that is normal."""
    _, rounding = _bernstein(PPoly(np.zeros((2, 1, 1)), np.array([0.0, 1.0])), np.zeros(1), np.ones(1))
    np.testing.assert_array_equal(rounding, np.finfo(float).tiny)


def test_how_far_a_piece_strays_from_its_chord():
    """t² over [0, 1] by a half: coefficients 0, 0, 1 against 0, ½, 1; every stretch and coordinate by its own."""
    pieces = PPoly(np.array([[[1.0, -3.0]], [[0.0, 2.0]], [[0.0, 1.0]]]), np.array([0.0, 2.0]))
    found = chords_of(pieces, np.array([0.0, 1.0, 2.0]))
    np.testing.assert_allclose(found.start, [[0.0, 1.0], [1.0, 0.0]], atol=1e-14)
    np.testing.assert_allclose(found.end, [[1.0, 0.0], [4.0, -7.0]])
    np.testing.assert_allclose(found.deviation, [[0.5, 1.5], [0.5, 1.5]], rtol=1e-13)
    _, rounding = _bernstein(pieces, np.array([0.0, 1.0]), np.ones(2))
    np.testing.assert_array_equal(found.rounding[:, 0], rounding[0])
    np.testing.assert_array_equal(found.rounding[:, 1], rounding[-1])
    away = Fraction(1, 2) + Fraction(rounding[1, 0, 0])
    least = away * (1 + 2 * U) + 8 * U
    assert least < Fraction(found.deviation[0, 0]) < least + 8 * U
    at, off = points_of(pieces, np.array([0.5, 2.0]))
    np.testing.assert_allclose(at, [[0.25, 1.25], [4.0, -7.0]])
    assert np.all(off < 1e-13)


def test_straight_pieces_stray_by_roundings():
    """Their own, and 8u of both ends."""
    pieces = PPoly(np.array([[[3.0]], [[5.0]]]), np.array([0.0, 1.0]))
    found = chords_of(pieces, np.array([0.0, 1.0]))
    _, rounding = _bernstein(pieces, np.zeros(1), np.ones(1))
    assert found.deviation[0, 0] == pytest.approx(rounding.max() + float(8 * U * (5 + 8)), rel=1e-9, abs=0)


def line(*values):
    return PPoly(np.array(values, float)[:, None, None] * np.ones((1, 1, 2)), np.array([0.0, 1.0]))


def broken(jump, coordinate=0, size=1.0):
    """Two constant pieces, in one coordinate apart."""
    coefficients = np.full((1, 3, 2), size)
    coefficients[0, 1:, coordinate] += jump
    return PPoly(coefficients, np.array([0.0, 1.0, 2.0, 3.0]))


@pytest.mark.parametrize("coordinate", [0, 1])
def test_paths_that_jump(coordinate):
    """By more than 1e-9, whatever is rounded; at any knot."""
    assert pieces_of(broken(0.95e-9, coordinate), 2)
    for jump in (1.05e-9, 1.0, -1.05e-9):
        with pytest.raises(InvalidInputError, match=r"jumps by .* at parameter 1"):
            pieces_of(broken(jump, coordinate), 2)
    _, rounding = _bernstein(broken(0.0, size=1e6), np.array([1.0]), np.ones(1))
    off = float(rounding[0, 0, 0])
    assert 1e-9 < off < 3e-9
    assert pieces_of(broken(0.9 * (1e-9 + 2 * off), coordinate, 1e6), 2)


def test_paths_in_other_words():
    """Waypoints, splines with knots that repeat, B-splines by their polynomials."""
    found = pieces_of([[0.0, 1.0], [2.0, 3.0], [1.0, 1.0]], 2)
    np.testing.assert_array_equal(found.x, [0.0, 1.0, 2.0])
    np.testing.assert_allclose(found([0.5, 1.5]), [[1.0, 2.0], [1.5, 2.0]])
    assert pieces_of([[0.0, 1.0], [2.0, 3.0]], 2).c.shape == (2, 1, 2)
    coefficients = np.array([[[1.0], [9.0], [1.0]], [[0.0], [9.0], [1.0]]])
    for knots in ([0.0, 1.0, 1.0, 2.0], [0.0, 1.0, 1.0, 3.0]):
        found = pieces_of(PPoly(coefficients, np.array(knots)), 1)
        np.testing.assert_array_equal(found.x, [0.0, 1.0, knots[-1]])
        np.testing.assert_array_equal(found.c[:, :, 0], [[1.0, 1.0], [0.0, 1.0]])
    last = pieces_of(PPoly(coefficients[:, [0, 2, 1]], np.array([0.0, 1.0, 2.0, 2.0])), 1)
    np.testing.assert_array_equal(last.x, [0.0, 1.0, 2.0])
    rng = np.random.default_rng(0)
    spline = BSpline(np.array([-2.0, -1, 0, 0.5, 2, 3, 4, 5.5]), rng.normal(size=(5, 2)), 2)
    found = pieces_of(spline, 2)
    np.testing.assert_array_equal(found.x, [0.0, 0.5, 2.0, 3.0])
    t = np.linspace(0.0, 2.9, 20)
    np.testing.assert_allclose(found(t), spline(t), atol=1e-12)
    assert len(pieces_of(line(*[1e-3] * 51), 2).c) == 51


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ([[0.0, 1.0]], "two waypoints"), (np.zeros((2, 3)), "two waypoints"), (np.zeros(2), "two waypoints"),
        (np.zeros((2, 2, 2)), "two waypoints"), (np.zeros((0, 2)), "two waypoints"),
        ([[0.0, 1.0], [np.nan, 1.0]], "finite"), ([[0.0, 1.0], [0.0, np.inf]], "finite"),
        (line(*[1e-3] * 52), "degree 51"), (line(1e300, 1e300, 1e300), "overflow"),
        (PPoly(np.zeros((2, 2, 3)), np.array([0.0, 1.0, 2.0])), "spline of 3 knots"),
        (PPoly(np.zeros((2, 2)), np.array([0.0, 1.0, 2.0])), "coefficients of shape"),
        (PPoly(np.zeros((2, 1, 2)), np.array([0.0, np.inf])), "finite"),
    ],
)  # fmt: skip
def test_paths_that_are_none(path, said):
    if said == "overflow":
        path = PPoly(np.array([[[1e300, 0.0]], [[0.0, 0.0]], [[0.0, 0.0]]]), np.array([0.0, 1e30]))
    with np.errstate(all="ignore"), pytest.raises(InvalidInputError, match=said):
        pieces_of(path, 2)


def test_knots_increase():
    """Nowhere decrease, and somewhere increase."""
    for knots in ([0.0, 1.0, 1.0, 2.0], [0.0, 0.0, 1.0], [0.0, 1.0]):
        np.testing.assert_array_equal(module._increasing(np.array(knots)), knots)
    for knots in ([0.0, 0.0], [0.0, 1.0, 0.5], [1.0, 0.5], [[0.0, 1.0], [0.0, 1.0]], [0.0, 0.5, 0.5, 0.4]):
        with pytest.raises(InvalidInputError, match="increase"):
            module._increasing(np.array(knots))
