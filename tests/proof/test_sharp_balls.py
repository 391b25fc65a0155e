"""Affine forms where they are attained: every value at every corner is held, and none is held in vain."""

from itertools import product as pairs_of

import numpy as np
import pytest

from ccpin.proof import balls as module
from ccpin.proof.balls import Affine, affine, inverse, joined, product, sine_versine, stacked, summed

U = 2.0**-53


def form(mid, lin, rad, boxed=0):
    return Affine(np.asarray(mid, float), np.asarray(lin, float), np.asarray(rad, float), boxed)


def test_a_swing_is_attained_at_a_corner_and_on_a_sphere():
    lin = [[3.0], [-4.0], [6.0], [8.0]]
    assert form([1.0], lin, [0.5], 2).swing == pytest.approx(7.0 + 10.0, rel=1e-12)
    assert form([1.0], lin, [0.5], 0).swing == pytest.approx(np.sqrt(125.0), rel=1e-12)
    assert form([-1.0], lin, [0.5], 4).spread == pytest.approx(21.5, rel=1e-12)
    assert form([-1.0], lin, [0.5], 4).magnitude == pytest.approx(22.5, rel=1e-12)
    for value in (form([-1.0], lin, [0.5], 4), form([-1.0], lin, [0.5], 2)):
        assert value.spread >= value.swing + 0.5
        assert value.magnitude >= 1.0 + value.spread


def test_products_hold_their_corner_and_no_more():
    """(2 + 3ε + ½)(5 + 7ε′ + ¼) for two parameters of a box: the rest is 3·7, ½ (5 + 7) and ¼ (2 + 3 + ½)."""
    a, b = form([2.0], [[3.0], [0.0]], [0.5], 2), form([5.0], [[0.0], [7.0]], [0.25], 2)
    found = product("i,i->i", a, b)
    assert found.mid == 10.0
    np.testing.assert_array_equal(found.lin, [[15.0], [14.0]])
    assert found.rad == pytest.approx(21.0 + 0.5 * 12.0 + 0.25 * 5.5, rel=1e-12)
    assert found.magnitude >= (2 + 3 + 0.5) * (5 + 7 + 0.25)
    exact = product("i,i->i", a, np.array([4.0]))
    assert exact.rad == pytest.approx(2.0, rel=1e-12)


def test_sums_and_multiples_add_radii():
    a, b = form([2.0], [[3.0]], [0.5], 1), form([5.0], [[-1.0], [2.0]], [0.25], 1)
    total = a + b
    assert (total.mid, *total.lin[:, 0], total.boxed) == (7.0, 2.0, 2.0, 1)
    assert total.rad == pytest.approx(0.75, rel=1e-12)
    assert total.rad > 0.75
    assert (a - b).mid == -3.0
    assert (a - b).rad == pytest.approx(0.75, rel=1e-12)
    scaled = a * -2.0
    assert (scaled.mid, scaled.lin[0, 0]) == (-4.0, -6.0)
    assert scaled.rad == pytest.approx(1.0, rel=1e-12)
    column = form([[1.0, 2.0], [3.0, 4.0]], [[[1.0, 0.0], [0.0, 1.0]]], [[0.5, 0.25], [0.125, 1.0]], 1)
    added = summed(column, 0)
    np.testing.assert_array_equal(added.mid, [4.0, 6.0])
    np.testing.assert_array_equal(added.lin, [[1.0, 1.0]])
    np.testing.assert_allclose(added.rad, [0.625, 1.25], rtol=1e-12)


@pytest.mark.parametrize("K", [1, 3])
def test_roundings_are_those_that_the_sums_may_lose(K):
    """4u of a sum, 4(K + 1)u of K of them and 4(K + 2)u of K products, of the absolute values."""
    a = form(np.full(K, 3.0), np.full((2, K), 2.0), np.zeros(K), 2)
    size = 3.0 + 4.0
    np.testing.assert_allclose((a + 1.0).rad, 4 * U * (4.0 + 4.0), rtol=1e-6)
    np.testing.assert_allclose((a * 5.0).rad, 4 * U * 5.0 * size, rtol=1e-6)
    np.testing.assert_allclose(summed(a, 0).rad, 4 * (K + 1) * U * size * K, rtol=1e-6)
    np.testing.assert_allclose(product("i,i->", a, np.full(K, 5.0)).rad, 4 * (K + 2) * U * 5.0 * size * K, rtol=1e-6)
    assert np.all((affine(np.zeros(K)) * 1.0).rad == 1e-290)
    assert product("i,i->", np.zeros(K), np.zeros(K)).rad == 1e-290


@pytest.mark.parametrize("middle", [0.0, 0.7, -2.0, 3.0])
def test_sines_are_held_within_half_the_square(middle):
    """½x² is attained to first order at the sine's and the cosine's tops; the radius counts with the slope."""
    for width, rad in ((1e-3, 0.0), (0.5, 0.0), (0.0, 0.25), (1e-2, 1e-3)):
        angle = form([middle], [[width]], [rad], 1)
        sine, versine = sine_versine(angle)
        np.testing.assert_allclose(sine.mid, np.sin(middle), atol=1e-15)
        np.testing.assert_allclose(versine.mid, 1 - np.cos(middle), atol=1e-15)
        np.testing.assert_allclose(sine.lin, [[np.cos(middle) * width]], rtol=1e-14)
        np.testing.assert_allclose(versine.lin, [[np.sin(middle) * width]], rtol=1e-14)
        bent = 0.5 * (width + rad) ** 2 + 8 * U * (1 + width + rad)
        np.testing.assert_allclose(sine.rad, bent + abs(np.cos(middle)) * rad, rtol=1e-12)
        np.testing.assert_allclose(versine.rad, bent + abs(np.sin(middle)) * rad, rtol=1e-12)
        for e, r in pairs_of((-1, 1), repeat=2):
            x = middle + e * width + r * rad
            assert abs(np.sin(x) - sine.mid - e * sine.lin[0]) <= sine.rad
            assert abs(1 - np.cos(x) - versine.mid - e * versine.lin[0]) <= versine.rad
    still = sine_versine(form([middle], [[0.0]], [0.0], 1))
    np.testing.assert_allclose([part.rad[0] for part in still], 8 * U, rtol=1e-6)


@pytest.mark.parametrize(("rad", "regular"), [(0.999999, True), (1.000001, False)])
def test_matrices_are_regular_up_to_where_one_is_singular(rad, regular):
    """[1 ± rad] is singular from rad = 1 on."""
    assert inverse(form([[[2.0]]], np.zeros((0, 1, 1, 1)), [[[2 * rad]]])).regular[0] == regular


def test_solutions_are_held_at_their_corner():
    """(2 ± 1)x = 4 ± 1: x in [1, 5] about 2, so 3 away; nothing is held where a matrix may be singular."""
    right = form([[[4.0]]], np.zeros((0, 1, 1, 1)), [[[1.0]]])
    found = inverse(form([[[2.0]]], np.zeros((0, 1, 1, 1)), [[[1.0]]])).solve(right)
    assert found.mid == 2.0
    assert found.rad == pytest.approx(3.0, rel=2e-8)
    assert found.rad >= 3.0
    assert np.isnan(inverse(form([[[2.0]]], np.zeros((0, 1, 1, 1)), [[[2.5]]])).solve(right).rad)


def test_forms_side_by_side_keep_their_numbers():
    a, b = form([1.0], [[2.0]], [0.5], 1), form([3.0], [[4.0]], [0.25], 1)
    for found in (stacked([a, b], 0)[:, 0], joined([a, b], -1)):
        np.testing.assert_array_equal(found.mid, [1.0, 3.0])
        np.testing.assert_array_equal(found.lin, [[2.0, 4.0]])
        np.testing.assert_array_equal(found.rad, [0.5, 0.25])


def test_radii_grow_by_what_their_own_sums_round():
    """1 + 1e-13 and, of K = 1024 terms, 4(K + 1)u and 8(K + 2)u."""
    K = 1024
    still = form(np.zeros(K), np.zeros((0, K)), np.full(K, 1.0 / K))
    np.testing.assert_allclose((still * float(K)).rad - 1.0, 1e-13, rtol=2e-2)
    assert summed(still, 0).rad - 1.0 == pytest.approx(1e-13 + 4 * (K + 1) * U, rel=1e-3, abs=0.0)
    assert product("i,i->", still, np.ones(K)).rad - 1.0 == pytest.approx(1e-13 + 8 * (K + 2) * U, rel=1e-3, abs=0.0)


def test_forms_of_fewer_axes_are_added_to_all_entries():
    wide = form(np.ones((2, 2)), np.ones((1, 2, 2)), np.zeros((2, 2)), 1)
    found = wide + form(3.0, [2.0, 5.0], 0.25, 1)
    np.testing.assert_array_equal(found.lin, [np.full((2, 2), 3.0), np.full((2, 2), 5.0)])
    np.testing.assert_array_equal(summed(form([[1.0, 2.0]], [[[3.0, 4.0]]], [[0.0, 0.0]], 1), 1).lin, [[7.0]])


@pytest.mark.parametrize(("proposed", "held"), [(0.5, False), (1.9, False), (2.1, True)])
def test_an_error_that_is_proposed_is_checked(monkeypatch, proposed, held):
    """|y| ≤ |X(r − Mx₀)| + E|y| with E = ½ asks for twice the residual."""
    made = inverse(form([[[2.0]]], np.zeros((0, 1, 1, 1)), [[[1.0]]]))
    monkeypatch.setattr(module, "inverses", lambda _: np.full((1, 1, 1), proposed))
    assert np.isfinite(made.solve(form([[[0.0]]], np.zeros((0, 1, 1, 1)), [[[1.0]]])).rad) == held


def test_a_weight_that_is_proposed_is_checked(monkeypatch):
    monkeypatch.setattr(module, "solve_many", lambda *_: np.ones((1, 2)))
    for size, regular in ((0.49, True), (0.51, False), (0.9, False)):
        assert inverse(form([np.eye(2)], np.zeros((0, 1, 2, 2)), [np.full((2, 2), size)])).regular[0] == regular
