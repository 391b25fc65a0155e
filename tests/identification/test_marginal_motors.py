"""The marginal posterior of motors' constants: its slopes by differences, and its information by Gaussian laws."""

from typing import NamedTuple

import numpy as np
import pytest
from scipy.linalg import block_diag, null_space, sqrtm

from ccpin.identification.estimates.marginal_motors import marginal_rows, shown_shares
from ccpin.identification.estimates.robust_fit import EffortRows

SAMPLES, N, R, STEP = 6, 2, 5, 1e-5


class Case(NamedTuple):
    """A u = A diag(1/k) A⁻¹ W β + ε, and P of some of β."""

    W: np.ndarray
    A: np.ndarray
    P: np.ndarray
    deviation: np.ndarray

    def moved(self, log_k):
        """Wₖ, of shape (SAMPLES, N, R)."""
        return self.A @ (np.linalg.inv(self.A) @ self.W / np.exp(log_k)[:, None])

    def told(self, log_k):
        """What `marginal_rows` takes."""
        rows = EffortRows(self.moved(log_k), np.zeros((SAMPLES, N)), self.P, np.zeros(len(self.P)))
        return rows, self.A, np.linalg.inv(self.A), self.deviation


def case(known, elsewhere=False, seed=0):
    """Rows of P stand at right angles, as a prior of single constants has them."""
    draw = np.random.default_rng(seed)
    A = np.eye(N) + 0.5 * elsewhere * draw.normal(size=(SAMPLES, N, N))
    P = (draw.uniform(0.3, 3.0, R)[:, None] * np.linalg.qr(draw.normal(size=(R, R)))[0])[:known]
    return Case(draw.normal(size=(SAMPLES, N, R)), A, P, np.array([0.5, 2.0]))


@pytest.mark.parametrize("known", [0, 2, R])
@pytest.mark.parametrize("elsewhere", [False, True])
def test_slopes_are_those_of_the_determinants(known, elsewhere):
    of, log_k = case(known, elsewhere), np.array([0.1, -0.2])
    N_P = null_space(of.P) if known else np.eye(R)

    def term(log_k):
        W = (of.moved(log_k) / of.deviation[:, None]).reshape(-1, R)
        H = W.T @ W + of.P.T @ of.P
        return (np.linalg.slogdet(N_P.T @ H @ N_P)[1] if N_P.size else 0.0) / 2.0 - np.linalg.slogdet(H)[1] / 2.0

    slopes = [(term(log_k + STEP * e) - term(log_k - STEP * e)) / (2.0 * STEP) for e in np.eye(N)]
    C = shown_shares(*of.told(log_k))
    np.testing.assert_allclose(np.trace(C, axis1=1, axis2=2), slopes, atol=1e-8)
    R_, x = marginal_rows(*of.told(log_k))
    np.testing.assert_allclose(R_.T @ x, slopes, atol=1e-8)
    assert len(x) == (N if known else 0)


def test_curvature_and_gauss_newtons_are_the_information_of_a_gaussian_law():
    """Of A u ~ N(Wₖ b, Σ + Wₖ S Wₖᵀ), with β's second moment at its posterior mean, b bᵀ + S − H⁻¹."""
    of, log_k, b = case(R), np.array([0.1, -0.2]), np.array([1.0, -2.0, 0.5, 0.3, 1.5])
    S, sigma = np.linalg.inv(of.P.T @ of.P), np.diag(np.tile(of.deviation**2, SAMPLES))

    def law(log_k):
        W = of.moved(log_k).reshape(-1, R)
        return W @ b, sigma + W @ S @ W.T

    moved = [[law(log_k + sign * STEP * e) for sign in (1.0, -1.0)] for e in np.eye(N)]
    mean, V = ([(more[i] - less[i]) / (2.0 * STEP) for more, less in moved] for i in range(2))
    inverse = np.linalg.inv(law(log_k)[1])
    information = [
        [mean[i] @ inverse @ mean[j] + np.trace(inverse @ V[i] @ inverse @ V[j]) / 2.0 for j in range(N)]
        for i in range(N)
    ]
    W = of.moved(log_k).reshape(-1, R)
    H = W.T @ np.linalg.inv(sigma) @ W + of.P.T @ of.P
    second = np.outer(b, b) + S - np.linalg.inv(H)
    own = [block_diag(*[np.diag(e)] * SAMPLES) @ W for e in np.eye(N)]
    steps = np.array([[np.trace(x.T @ inverse @ y @ second) for y in own] for x in own])
    rows, _ = marginal_rows(*of.told(log_k))
    np.testing.assert_allclose(steps + rows.T @ rows, information, rtol=1e-6)


@pytest.mark.parametrize("known", [0, 2, R])
@pytest.mark.parametrize("elsewhere", [False, True])
def test_curvature_is_of_what_is_known(known, elsewhere):
    """tr C_iC_j − tr ΠC_iΠC_j by matrices' own roots, C_j's symmetric parts from slopes of H: ∂H = −2 H^½ C_j H^½."""
    of, log_k = case(known, elsewhere), np.array([0.1, -0.2])

    def information(log_k):
        W = (of.moved(log_k) / of.deviation[:, None]).reshape(-1, R)
        return W.T @ W + of.P.T @ of.P

    root = np.linalg.inv(np.real(sqrtm(information(log_k))))
    moved = [(information(log_k + STEP * e) - information(log_k - STEP * e)) / (2.0 * STEP) for e in np.eye(N)]
    C = [-root @ each @ root / 2.0 for each in moved]
    held = np.eye(R) - np.linalg.pinv(of.P @ root) @ of.P @ root if known else np.eye(R)
    rows, _ = marginal_rows(*of.told(log_k))
    wanted = [[np.trace(x @ y) - np.trace(held @ x @ held @ y) for y in C] for x in C]
    np.testing.assert_allclose(rows.T @ rows, wanted, atol=1e-8)


@pytest.mark.parametrize(("square", "counts"), [(0.97e-9, False), (1.03e-9, True)])
def test_what_logs_show_next_to_nothing_of_does_not_count(square, counts):
    """Of one constant w² is told by logs and 1 beforehand: C = w²/(1 + w²)."""
    share = np.sqrt(square)
    rows = EffortRows(np.full((1, 1, 1), np.sqrt(share / (1.0 - share))), np.zeros((1, 1)), np.eye(1), np.zeros(1))
    told, x = marginal_rows(rows, np.ones((1, 1, 1)), np.ones((1, 1, 1)), np.ones(1))
    assert told.size == counts
    np.testing.assert_allclose(told.ravel(), share if counts else [])
    np.testing.assert_allclose(np.abs(x), 1.0 if counts else [])


def test_constants_that_logs_show_count_whole_and_others_not():
    """Along the scale slope and curvature are how many known constants logs show: here three of four."""
    of = case(4)
    hidden = of.W @ np.linalg.svd(of.P)[2][:3].T @ np.linalg.svd(of.P)[2][:3]
    sharp = of._replace(W=1e6 * (hidden + of.W @ null_space(of.P) @ null_space(of.P).T))
    rows, x = marginal_rows(*sharp.told(np.zeros(N)))
    scale = rows @ np.ones(N)
    assert scale @ x == pytest.approx(3.0, abs=1e-6)
    assert scale @ scale == pytest.approx(3.0, abs=1e-6)
