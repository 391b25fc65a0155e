"""Errors of smoothed motions: their covariance beside dense matrices, and what they do to constants."""

from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sparse

import ccpin
from ccpin.identification import Log, identify
from ccpin.identification.estimates import estimation
from ccpin.identification.estimates.effort_samples import by_log
from ccpin.identification.estimates.motion_errors import with_motion_errors
from ccpin.identification.estimates.robust_fit import EffortRows, RobustFit
from ccpin.identification.estimates.shooting import force_slopes
from ccpin.identification.logs.penalized_splines import (
    Knots,
    Measurements,
    SplineErrors,
    banded,
    fitted,
    normal_equations,
)
from ccpin.identification.logs.smoothing import smoothed

STEP = 1e-4


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


@pytest.fixture(scope="module")
def rubbing():
    """An RPDR whose motors are on joints that are no coordinates."""
    joints = {f"joint{k + 1}": {"friction": 0.5, "damping": 0.3} for k in range(4)}
    return ccpin.ReducedModel(ccpin.load("rpdr", joints=joints, actuated=["joint3", "joint4"]))


def moved(model, pi, begin, chosen, added, k):
    """Some samples of a motion, 3.1 ms apart; a motor gives k times the effort that is told."""
    t = begin + 3.1e-3 * np.arange(40)
    q = model.alpha(model.mechanism.q_reference) + 0.3 * np.sin(np.outer(t, [7.0, 9.0]) + [0.0, 1.0])
    q += 1e-4 * np.random.default_rng(len(chosen)).normal(size=q.shape)
    columns = {f"q_joint{j + 1}": q[:, j] for j in range(2)} | {f"u_joint{j + 3}": 0.0 * t for j in range(2)}
    motion = smoothed(Log(t, columns), model)
    force = model.regressor_many(motion.q, motion.v, motion.a) @ pi
    u = np.linalg.solve(motion.transmission(model, np.arange(40)), force[..., None])[..., 0] / k
    chosen = np.array(chosen, dtype=int)
    return SimpleNamespace(motion=motion._replace(u=u), chosen=chosen, t=t[chosen], added=added)


def slopes_of(model, pi, k, motion, at):
    """M⁻¹ ∂(M Y π − A u)/∂(q, q̇, q̈), M = A diag(1/k) A⁻¹, by differences of all of it, of shape (len(at), n, 3n)."""
    x, u = np.hstack([motion.q, motion.v, motion.a])[at], motion.u[at]

    def off(x):
        q, v, a = np.split(x, 3, axis=1)
        A = np.swapaxes(model.terms_many(q, v).rho, 1, 2) @ model.actuation.T
        force = model.regressor_many(q, v, a) @ pi
        return (A @ (np.linalg.solve(A, force[..., None]) / k[:, None] - u[..., None]))[..., 0]

    steps = STEP * np.eye(x.shape[1])
    slopes = np.stack([(off(x + e) - off(x - e)) / (2.0 * STEP) for e in steps], axis=2)
    return np.linalg.solve(turned(model, motion, at, k), slopes)


def turned(model, motion, at, k):
    """M."""
    A = motion.transmission(model, at)
    return A @ np.diag(1.0 / k) @ np.linalg.inv(A)


@pytest.mark.parametrize("k", [None, np.array([1.3, 0.8])])
def test_what_errors_of_motions_add_is_the_sum_over_all_pairs_of_samples(rubbing, k):
    """Of four logs, of which one has one sample and one none, slopes of 40 ms apart, dry friction none of them."""
    model, draw, share = rubbing, np.random.default_rng(4), np.ones(2) if k is None else k
    still = np.array(model.parameters.values)
    still[model.parameters.of("friction")] = 0.0
    load, heavier = {model.parameters.names[0]: 0.4}, np.r_[0.4, np.zeros(len(still) - 1)]
    samples = [
        moved(model, still, 0.1, np.r_[2:14, 17:39], {}, share),
        moved(model, still + heavier, 0.5, np.arange(30), load, share),
        moved(model, still, 0.9, [7], {}, share),
        moved(model, still, 1.3, [], {}, share),
    ]
    count = sum(len(each.chosen) for each in samples)
    W, deviation, root = draw.normal(size=(count, 2, 3)), np.array([0.5, 2.0]), draw.normal(size=(3, 3))
    counted = np.arange(count) % 5 != 2
    rows = EffortRows(W, np.zeros((count, 2)), np.zeros((0, 3)), np.zeros(0))
    fit = RobustFit(np.zeros(3), root @ root.T, deviation, counted, np.zeros(count), np.zeros((0, 3)))
    scores, S = by_log(samples, np.where(counted[:, None, None], W / deviation[:, None] ** 2, 0.0)), np.zeros((3, 3))
    for each, X, pi in zip(samples[:3], scores, (still, still + heavier, still), strict=False):
        motion, t, size = each.motion, each.t, len(each.chosen)
        first = {int((t[j] - t[0]) / 0.04): j for j in reversed(range(size))}
        at = sorted({*first.values(), size - 1})
        L = slopes_of(model, pi, share, motion, each.chosen[at])
        L = np.array([[np.interp(t, t[at], L[:, i, j]) for j in range(6)] for i in range(2)]).transpose(2, 0, 1)
        L = (turned(model, motion, each.chosen, share) @ L).reshape(size, 2, 3, 2)
        felt = np.einsum("sidj,sir->dsjr", L, X).reshape(-1, 3)
        errors = motion.errors.covariance(each.chosen, np.eye(6 * size).reshape(3, size, 2, -1))
        S += felt.T @ errors @ felt
    found = with_motion_errors(model, samples, rows, fit, model.parameters, k)
    np.testing.assert_allclose(found, fit.covariance + fit.covariance @ S @ fit.covariance, rtol=1e-6)


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
