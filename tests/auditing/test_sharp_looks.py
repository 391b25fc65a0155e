"""The auditor's lemma at equality, on rows of second degree: for them its bounds are attained at a corner."""

from fractions import Fraction

import numpy as np
import pytest
from flint import arb, arb_mat

from ccpin.auditing.boxes import Box, _half_width, contracts, look
from ccpin.auditing.gluing import near
from ccpin.auditing.reading import widened
from tests.support.rows import Quadratic
from tests.support.rows import exact as _exact


def looked(closures, e=0.5, r=0.25, slope=0.0, middle=0.0):
    """The lemma over |δ| ≤ e and a part of half width r about `middle`, of a tube about the origin."""
    box = Box([arb(0), arb(0)], _exact([[1.0], [slope]]), _exact([[1.0]]), [arb(1)], np.array([e]), np.array([1]))
    return look(closures, box, (np.array([-e]), np.array([e])), np.array([middle]), np.array([r]))


def test_the_offset_is_attained_at_a_corner():
    """Y = φ(δ = e), with its half of the second derivative along D."""
    closures = Quadratic(c=0.125, g=0.25, a=0.5, b=0.0625, d=0.03125)
    for slope in (0.0, 0.5):
        at_corner = closures.at(np.array([0.5, 0.5 * slope]))[0]
        np.testing.assert_allclose(looked(closures, slope=slope).offset, at_corner, rtol=1e-12)


def test_the_mean_takes_half_of_the_change_along_the_part_and_all_of_that_along_the_cell():
    """M̄ = |b|e + ½|d|r."""
    found = looked(Quadratic(b=0.25, d=0.5))
    np.testing.assert_allclose(found.carried, [[0.25 * 0.5 + 0.5 * 0.5 * 0.25]], rtol=1e-12)


@pytest.mark.parametrize(("b", "d", "e", "r"), [(0.0, 1.0, 0.5, 1.0), (1.0, 0.0, 1.0, 0.5), (1.0, 2.0, 0.5, 0.25)])
def test_one_at_most_up_to_where_the_slope_may_vanish(b, d, e, r):
    """M = |b|e + |d|r reaches 1 where φ_y reaches 0."""
    for size, sure in ((1 - 1e-9, True), (1 + 1e-9, False)):
        assert looked(Quadratic(b=b * size, d=d * size), e, r).one_at_most == sure


@pytest.mark.parametrize(("c", "d", "r"), [(0.5, 0.0, 0.5), (0.375, 1.0, 0.5)])
def test_one_at_least_up_to_where_the_image_touches_the_end(c, d, r):
    """Y + M̄r = c + ½ d r² reaches r."""
    assert looked(Quadratic(c=c * (1 - 1e-9), d=d), 0.0, r).one_at_least
    assert not looked(Quadratic(c=c * (1 + 1e-9), d=d), 0.0, r).one_at_least


def test_none_from_where_the_row_cannot_vanish():
    """|f| = r + M̄r + what varies over the cell: c = r + g e for a line."""
    for g, e in ((0.0, 0.0), (0.25, 0.5)):
        assert looked(Quadratic(c=(0.25 + g * e) * (1 + 1e-9), g=g), e).none
        assert not looked(Quadratic(c=(0.25 + g * e) * (1 - 1e-9), g=g), e).none
    assert looked(Quadratic(c=0.25 + 0.125 * 0.25**2 + 1e-9, d=0.25), 0.0).none
    assert not looked(Quadratic(c=0.25 + 0.125 * 0.25**2 - 1e-9, d=0.25), 0.0).none


@pytest.mark.parametrize(("matrix", "sure"), [([[0.5, 0.499], [0.499, 0.5]], True), ([[0.5, 0.5], [0.5, 0.5]], False)])
def test_a_matrix_contracts_up_to_a_spectral_radius_of_one(matrix, sure):
    assert contracts([[arb(x) for x in row] for row in matrix]) == sure
    assert not contracts([[arb(3.0)]])
    assert not contracts([[arb(float("inf"))]])


def test_boxes_are_claimed_as_widened_by_their_roundings():
    u = 2.0**-53
    np.testing.assert_allclose(widened(np.array(0.0), np.array(0.0)), 1e-14, rtol=1e-12)
    np.testing.assert_allclose(widened(np.array(-1e6), np.array(0.0)), 1e-14 + 4e6 * u, rtol=1e-12)
    assert widened(np.array(0.0), np.array(2.0**20)) - 2.0**20 == pytest.approx(2**22 * u, rel=0.3)


def test_a_solution_is_known_within_the_ball_that_the_contraction_leaves():
    """Theorem N without parameters about a solution of a parabola, y + y²/2 + c = 0."""
    for c in (-0.4, 0.3, 0.45):
        found = near(Quadratic(c=c, d=1.0), np.array([1]), np.zeros(2))
        assert found is not None
        theta, radius = found
        assert abs(theta[1] - (np.sqrt(1 - 2 * c) - 1)) <= radius < 1e-10
    assert near(Quadratic(c=0.5 + 1e-9, d=1.0), np.array([1]), np.zeros(2)) is None  # no solution at all


def test_cells_and_parts_are_looked_at_where_they_are():
    """Y and M̄ about θ₀ = θ_c + Dδ₀ + Eζ₀, by hand."""
    closures = Quadratic(c=0.125, g=0.25, a=0.5, b=0.25, d=0.125)
    box = Box([arb(0.5), arb(-0.25)], _exact([[1.0], [0.5]]), _exact([[1.0]]), [arb(1)], np.array([2.0]), np.array([1]))
    found = look(closures, box, (np.array([0.25]), np.array([1.25])), np.array([0.125]), np.array([0.25]))
    along, e, r = np.array([1.0, 0.5]), 0.5, 0.25
    value, slope = closures.at(np.array([0.5, -0.25]) + 0.75 * along + [0.0, 0.125])
    A = 1.0 / slope[0, 1]
    bent = closures.bend @ along
    offset = abs(A * value) + abs(A * slope @ along) * e + 0.5 * abs(A * bent @ along) * e**2
    np.testing.assert_allclose(found.offset, offset, rtol=1e-12)
    np.testing.assert_allclose(found.carried, [[A * (bent[1] * e + 0.5 * 0.125 * r)]], rtol=1e-12)


class Cubic(Quadratic):
    """φ = y + y³/6: its slope, 1 + y²/2, as evaluated is closer than what its change bounds."""

    def value(self, theta, motions):
        return arb_mat(1, 1, [theta[1] + theta[1] ** 3 / 6])

    def jacobian(self, motions):
        return arb_mat(1, 2, [arb(0), 1 + motions[1] ** 2 / 2])

    def variation(self, motions, direction):
        return arb_mat(1, 2, [arb(0), motions[1] * direction[1]])


@pytest.mark.parametrize(("r", "sure"), [(1.1, True), (1.16, True), (1.17, False)])
def test_slopes_are_evaluated_about_the_part(r, sure):
    """About y = 2, Ã = 1/3: |1 − (1 + y²/2)/3| < 1 up to y = √10, where the bound by change ends at r = 1."""
    box = Box([arb(0), arb(2)], _exact([[1.0], [0.0]]), _exact([[1.0]]), [arb(2)], np.zeros(1), np.array([1]))
    found = look(Cubic(), box, (np.zeros(1), np.zeros(1)), np.zeros(1), np.array([r]))
    assert found.one_at_most == sure


@pytest.mark.parametrize(("low", "high"), [(1.0, 3.0), (-0.1, 0.3), (1e6, 1e6 + 0.1)])
def test_half_widths_reach_both_ends_and_no_farther(low, high):
    (found,) = _half_width(np.array([low]), np.array([high]))
    middle = Fraction(0.5 * (low + high))
    least = max(Fraction(high) - middle, middle - Fraction(low))
    assert least <= Fraction(found) <= least + 2 * Fraction(np.spacing(found))


def test_a_weight_that_is_proposed_is_checked(monkeypatch):
    monkeypatch.setattr(np.linalg, "solve", lambda *_: np.ones(2))
    assert contracts([[arb(0.5), arb(0.4)], [arb(0.4), arb(0.5)]])
    assert not contracts([[arb(0.5), arb(0.6)], [arb(0.4), arb(0.5)]])


class Misled(Quadratic):
    """A line y + c whose slope in plain floating point is off, so that Ã is and |I − Ãφ_y| is what is told."""

    def __init__(self, c, rest):
        super().__init__(c=c)
        self.steep = 1.0 / (1.0 - rest)

    def at(self, theta):
        return np.zeros(1), np.array([[0.0, self.steep]])


@pytest.mark.parametrize(
    ("rest", "factor"),
    [(0.19, 1.25), (0.21, 4.0), (0.7, 4.0), (0.8, 64.0), (0.98, 64.0), (0.99, 4096.0), (0.9999, None)],
)
def test_balls_grow_until_the_contraction_maps_them_into_themselves(rest, factor):
    """|Ãφ| + rest r < r: at r = k|Ãφ| up to rest = 1 − 1/k."""
    found = near(Misled(0.5, rest), np.array([1]), np.zeros(2))
    if factor is None:
        assert found is None
    else:
        assert found[1] == pytest.approx(factor * 0.5 * (1 - rest), rel=1e-9)
    assert near(Misled(0.0, 0.5), np.array([1]), np.zeros(2))[1] == pytest.approx(1.25e-15, rel=1e-9, abs=0.0)
