"""Storage functions by hand: matrices below a form, gains and widths of diagonal ones, and V̇ as it follows from V."""

from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.control.stability.tracking.error_equations import StorageChoice
from ccpin.control.stability.tracking.storage import (
    Storage,
    _constant,
    floor,
    gain,
    inverted,
    storage_of,
    widths,
)
from ccpin.proof.balls import Affine, affine


def form(mid, rad):
    mid = np.asarray(mid, float)
    return Affine(mid, np.zeros((0, *mid.shape)), np.asarray(rad, float) * np.ones_like(mid))


def test_a_floor_is_below_every_matrix_of_a_form_and_touches_the_lowest():
    """x_i x_j δ_ij with x = (1/√a_ii) is where Σ_j |δ_ij| √(a_ii/a_jj) is attained."""
    found = floor(form([[[4.0, 1.0], [1.0, 9.0]]], 0.5))[0]
    lost = np.array([0.5 * (1 + 2 / 3), 0.5 * (1 + 3 / 2)])
    np.testing.assert_allclose(np.diag(found), np.array([4.0, 9.0]) * (1 - 1e-9) - lost * (1 + 1e-10), rtol=1e-12)
    assert found[0, 1] == 1.0
    x = 1 / np.sqrt([4.0, 9.0])
    lowest = np.array([[3.5, 0.5], [0.5, 8.5]])
    assert x @ found @ x <= x @ lowest @ x
    np.testing.assert_allclose(x @ found @ x, x @ lowest @ x, rtol=1e-8)
    assert floor(form([[[1.0]]], 0.0))[0] == pytest.approx(1 - 1e-9, rel=1e-13)


def test_gains_and_widths_of_diagonal_storage_functions():
    """g² = λ_max(L Sᵀ(W − αP)⁻¹S L)/(4α): with P = 2, W = 4, α = ½, S = 3, L = 5: 225/3/2."""
    plan = StorageChoice(0.5, 0.0, np.array([5.0]), None)
    found = gain(Storage(form([[[2.0]]], 0.0), form([[[4.0]]], 0.0), np.array([[3.0]])), plan)
    np.testing.assert_allclose(found**2, 37.5, rtol=1e-8)
    assert found**2 >= 37.5 * (1 + 1.9e-9)  # what the floor and the eigenvalue's own rounding take
    np.testing.assert_allclose(
        widths(Storage(form([[[4.0]]], 1.0), form([[[4.0]]], 0.0), np.eye(1))), 3**-0.5, rtol=1e-9
    )
    assert widths(Storage(form([[[4.0]]], 4.1), form([[[4.0]]], 0.0), np.eye(1))) == np.inf


@pytest.mark.parametrize(
    ("share", "usable"), [(1.05, True), (0.95, False), (0.55, False), (-1.0, False), (np.nan, False)]
)
def test_inverses_of_matrices_that_are_clearly_positive_definite(share, usable):
    """Scaled to a unit diagonal the least eigenvalue of [1 a; a 1] is 1 − a, and 1e-7 is asked of it."""
    mixed = 1 - share * 1e-7
    M = np.array([[[4.0, 6.0 * mixed], [6.0 * mixed, 9.0]]])
    assert np.isfinite(inverted(M)).all() == usable
    assert np.all(inverted(np.zeros((1, 2, 2))) == np.inf)


@pytest.mark.parametrize("mixed", [0.0, 0.3, -0.999, 1 - 1e-6])
def test_inverses_are_bounded_from_above(mixed):
    """Found − M⁻¹ is positive semidefinite in exact numbers, and small."""
    M = np.array([[4.0, 6.0 * mixed], [6.0 * mixed, 9.0]])
    a, b, d = (Fraction(M[k]) for k in ((0, 0), (0, 1), (1, 1)))
    det = a * d - b * b
    found = [[Fraction(float(x)) for x in row] for row in inverted(M[None])[0]]
    more = [[found[0][0] - d / det, found[0][1] + b / det], [found[1][0] + b / det, found[1][1] - a / det]]
    assert more[0][0] > 0
    assert more[1][1] > 0
    assert more[0][0] * more[1][1] >= (more[0][1] + more[1][0]) ** 2 / 4
    assert float(max(more[0][0], more[1][1])) < 1e-12 / (1 - abs(mixed)) ** 3


def test_an_inverse_that_is_off_is_lifted_by_what_it_is_off(monkeypatch):
    """X = 0.9 I for M = I: |1 − XM| = 0.1 each, in the Frobenius norm 0.1 √2, over a least eigenvalue of 1."""
    monkeypatch.setattr(np.linalg, "inv", lambda M: 0.9 * np.tile(np.eye(2), (len(M), 1, 1)) + [[0.0, 0.2], [0.0, 0.0]])
    off = np.sqrt(2 * 0.1**2 + 2 * 0.1**2)
    np.testing.assert_allclose(inverted(np.eye(2)[None])[0], (0.9 + off) * np.eye(2) + 0.1 * (1 - np.eye(2)), rtol=1e-8)


def test_the_roundings_of_an_inverse_are_counted():
    """Of I, k = 400: (k + 4)u √k for what XM is off, and 4u √k for X's own two parts, above 1."""
    k, u = 400, 2.0**-53
    found = inverted(np.eye(k)[None])[0]
    np.testing.assert_allclose(np.diag(found) - 1.0, (k + 8) * np.sqrt(k) * u, rtol=0.0, atol=4 * u)


def test_w_is_what_the_storage_function_loses_along_motions():
    """V̇ = −xᵀWx − xᵀSΔ for ë = −K_p e − K_v ė − Δ, by the product rule, at random states."""
    rng = np.random.default_rng(1)
    K_p, K_v, P = (rng.normal(size=(n, n)) for n in (2, 2, 4))
    P = P + P.T
    W, S = _constant(SimpleNamespace(K_p=K_p, K_v=K_v), P)
    for _ in range(4):
        x, off = rng.normal(size=4), rng.normal(size=2)
        rate = np.concatenate([x[2:], -K_p @ x[:2] - K_v @ x[2:] - off])
        np.testing.assert_allclose(2 * x @ P @ rate, -x @ W.mid[0] @ x - x @ S @ off, rtol=1e-12)


def test_the_rounding_of_w_is_that_of_its_products():
    """(2n + 2)u of |P||A| + |A|ᵀ|P|: for n = 1 and all of them 1 that is 4u · [2 3; 3 4]."""
    W = _constant(SimpleNamespace(K_p=np.ones((1, 1)), K_v=np.ones((1, 1))), np.ones((2, 2)))[0]
    np.testing.assert_allclose(W.rad[0], 4 * 2.0**-53 * np.array([[2.0, 3.0], [3.0, 4.0]]), rtol=1e-9)


def test_pd_plus_loses_what_its_cross_term_says():
    """The same for D ë + (C + damping + K_v)ė + K_p e = −Δ and Ḋ = C + Cᵀ, symmetric gains."""
    rng = np.random.default_rng(2)
    D, C, b, K_p, K_v = rng.normal(size=(5, 2, 2))
    D, K_p, K_v, b = (a + a.T for a in (D, K_p, K_v, b))
    law, c = SimpleNamespace(K_p=K_p, K_v=K_v), 0.7
    found = storage_of(law, StorageChoice(1.0, c, np.ones(2), None), *(affine(a[None]) for a in (D, C, b)))
    P, W, S = found.P.mid[0], found.W.mid[0], found.S
    P_dot = np.block([[np.zeros((2, 2)), 0.5 * c * (C + C.T)], [0.5 * c * (C + C.T), 0.5 * (C + C.T)]])
    for _ in range(4):
        x, off = rng.normal(size=4), rng.normal(size=2)
        e, v = x[:2], x[2:]
        rate = np.concatenate([v, np.linalg.solve(D, -(C + b + K_v) @ v - K_p @ e - off)])
        np.testing.assert_allclose(2 * x @ P @ rate + x @ P_dot @ x, -x @ W @ x - x @ S @ off, rtol=1e-10)
