"""Errors of smoothed motions: their covariance beside dense matrices, and what they do to constants."""

import numpy as np
import pytest
import scipy.sparse as sparse

from ccpin.identification import identify
from ccpin.identification.estimates import estimation
from ccpin.identification.estimates.shooting import force_slopes
from ccpin.identification.logs.penalized_splines import (
    Knots,
    Measurements,
    SplineErrors,
    banded,
    fitted,
    normal_equations,
)


def test_errors_of_a_spline_are_those_of_its_noise_and_of_its_prior():
    """Cov δc = A⁻¹ (N + κ P) A⁻¹ in dense matrices; two coordinates, of which each has its own penalty."""
    draw, knots, t = np.random.default_rng(0), Knots.over(0.0, 1.0, 0.2), np.linspace(0.0, 1.0, 30)
    basis = [knots.basis(t, order) for order in range(3)]
    penalty = sparse.kron(knots.roughness(), sparse.diags_array([1e-4, 3e-4])).tocsr()
    rows = sparse.kron(basis[0], sparse.eye_array(2)).tocsr()
    normal = normal_equations(Measurements(rows, draw.normal(size=60), np.full(60, 0.1)), 2)
    errors = SplineErrors(basis, fitted(normal, banded(penalty, 2)).factor, penalty, 0.3)
    times, slopes = np.array([2, 3, 17]), draw.normal(size=(3, 3, 2, 4))
    N, P = 100.0 * (rows.T @ rows).toarray(), penalty.toarray()
    inverse = np.linalg.inv(N + P)
    G = sum(
        np.einsum("tj,tir->jir", design.toarray()[times], each) for design, each in zip(basis, slopes, strict=True)
    ).reshape(-1, 4)
    expected = G.T @ inverse @ (N + 0.3 * P) @ inverse @ G
    np.testing.assert_allclose(errors.covariance(times, slopes), expected, rtol=1e-6)


def test_slopes_of_forces_by_accelerations_are_the_inertia(bench):
    Q, V, A = (block[::200] for block in (bench.q, bench.v, bench.a))
    slopes = force_slopes(bench.model, bench.model.parameters.values, (Q, V, A), np.zeros((len(Q), 2)))
    D = np.array([bench.model.at(q).D for q in Q])
    np.testing.assert_allclose(slopes[..., 4:], D, atol=1e-7 * np.abs(D).max())


@pytest.mark.slow
def test_with_coarse_encoders_intervals_hold_and_those_of_white_noise_do_not(bench, monkeypatch):
    logs, off = [bench.log(seed, encoder=1e-3) for seed in range(20)], []
    monkeypatch.setattr(estimation, "with_coloured_noise", lambda covariance, *rest: covariance)
    for _ in range(2):
        found = [identify(bench.model, each) for each in logs]
        off.append(np.mean([np.abs(each.values - each.stated) < 1.96 * each.deviations for each in found]))
        monkeypatch.setattr(estimation, "with_motion_errors", lambda model, samples, rows, fit, *rest: fit.covariance)
    assert 0.92 < off[0] < 0.985
    assert off[1] < 0.8
