"""Storage functions bound what they say with their rounding: against exact fractions, of nearly flat matrices."""

from fractions import Fraction

import numpy as np
import pytest

from ccpin.control import ComputedTorque
from ccpin.control.stability.tracking.error_equations import StorageChoice
from ccpin.control.stability.tracking.reference_tube import feedback_of
from ccpin.control.stability.tracking.storage import Storage, storage_of, widths
from ccpin.proof.balls import affine
from tests.support.tracked import law_for


def exact_inverse(matrix):
    """By Gauss's elimination in fractions."""
    n = len(matrix)
    rows = [
        [Fraction(float(x)) for x in row] + [Fraction(int(i == j)) for j in range(n)] for i, row in enumerate(matrix)
    ]
    for k in range(n):
        rows[k] = [x / rows[k][k] for x in rows[k]]
        for i in set(range(n)) - {k}:
            rows[i] = [x - rows[i][k] * y for x, y in zip(rows[i], rows[k], strict=True)]
    return [row[n:] for row in rows]


@pytest.mark.parametrize("flat", [1e-2, 1e-4, 1e-6])
def test_widths_are_above_those_of_the_exact_inverse(flat):
    """(P⁻¹)_ii^½ of matrices whose least eigenvalue is small, and not far above."""
    rng, kept = np.random.default_rng(0), 0
    for _ in range(50):
        turn = np.linalg.qr(rng.normal(size=(4, 4)))[0]
        P = turn @ np.diag([1.0, 0.5, 0.3, flat]) @ turn.T
        P = 0.5 * (P + P.T)
        found = widths(Storage(affine(P[None]), affine(P[None]), np.zeros((4, 2))))[0]
        exact = exact_inverse(P)
        assert all(Fraction(w) ** 2 >= exact[i][i] for i, w in enumerate(found))
        kept += np.all(found**2 <= (1.0 + 1e-8 / flat) * np.array([float(exact[i][i]) for i in range(4)]))
    assert kept > 40


def test_matrices_that_are_too_flat_are_not_inverted():
    """Where a least eigenvalue is as small as its rounding may be nothing is told."""
    P = np.array([[1.0, 1.0 - 1e-8], [1.0 - 1e-8, 1.0]])
    assert np.isinf(widths(Storage(affine(P[None]), affine(P[None]), np.zeros((2, 1))))).all()


def test_the_exact_rate_is_within_computed_torques_form():
    """W = −(PA + AᵀP) for a P whose products cancel."""
    law, rng = law_for(ComputedTorque), np.random.default_rng(1)
    K = [[Fraction(0)] * 2 for _ in range(2)]
    A = [[*K[0], 1, 0], [*K[0], 0, 1]] + [
        [*(-Fraction(float(x)) for x in p), *(-Fraction(float(x)) for x in v)]
        for p, v in zip(law.K_p, law.K_v, strict=True)
    ]
    nothing, wider = affine(np.zeros((1, 2, 2))), 0
    for _ in range(20):
        P = rng.normal(size=(4, 4))
        P = P + P.T
        form = storage_of(feedback_of(law), StorageChoice(1.0, 0.0, np.ones(2), P), nothing, nothing, nothing)
        for i, j in np.ndindex(4, 4):
            terms = (Fraction(P[i, k]) * A[k][j] + A[k][i] * Fraction(P[k, j]) for k in range(4))
            off = abs(-sum(terms) - Fraction(form.W.mid[0, i, j]))
            assert off <= Fraction(form.W.rad[0, i, j])
            wider += off > 0
    assert wider > 0
