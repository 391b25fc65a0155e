"""Motors' constants of made-up rows: the mode of a posterior that is written out here, and when there is none."""

from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
from scipy.linalg import null_space, sqrtm
from scipy.optimize import minimize

import ccpin
from ccpin.errors import ConvergenceError, InvalidInputError
from ccpin.identification import Log
from ccpin.identification.estimates.effort_samples import EffortSamples
from ccpin.identification.estimates.motor_constants import (
    MotorConstants,
    StatedMotors,
    asked_motors,
    fitted_motors,
    told_motors,
)
from ccpin.identification.estimates.robust_fit import EffortRows

SIZE, STEP, INF = 60, 1e-6, np.inf


class Robot(NamedTuple):
    """Y π = A diag(k) u, the last of the constants π as it is stated, and P β = p of the others, β."""

    Y: np.ndarray
    A: np.ndarray
    force: np.ndarray
    stated: float
    P: np.ndarray
    p: np.ndarray

    def fitted(self, asked):
        samples, none = [self.sample(slice(20)), self.sample(slice(20, SIZE))], np.zeros((*self.force.shape, 0))
        model = SimpleNamespace(n=self.force.shape[1])
        return fitted_motors(model, samples, self.rows_of, lambda samples: none, asked, False)

    def sample(self, of):
        """A log of some of its samples."""
        A = self.A[of]
        motion = SimpleNamespace(transmission=lambda model, chosen: A[chosen])
        places = np.arange(len(A))
        return EffortSamples(motion, places, 0, places, np.zeros(A.shape[:2]), self.Y[of], self.force[of], {})

    def rows_of(self, samples):
        """W β = A u less what the stated constant makes."""
        return self.rows(np.concatenate([each.Y for each in samples]))

    def rows(self, Y):
        return EffortRows(Y[..., :-1], self.force - self.stated * Y[..., -1], self.P, self.p)

    def moved(self, k):
        """W β = A u of M Y."""
        return self.rows(self.A @ (np.linalg.inv(self.A) @ self.Y / k[:, None]))


def robot(k, known, stated, noise, seed):
    """Two motors; noise is in what columns say, and of so many constants something is known, to a tenth."""
    draw = np.random.default_rng(seed)
    A, Y = np.eye(2) + 0.4 * draw.normal(size=(SIZE, 2, 2)), draw.normal(size=(SIZE, 2, 5)) * [1.0, 0.3, 2.0, 1.0, 1.0]
    pi = np.r_[draw.uniform(0.5, 2.0, 4), stated]
    told = (A @ (np.linalg.solve(A, (Y @ pi)[..., None]) / np.array(k)[:, None]))[..., 0]
    P = np.eye(4)[:known] / (0.1 * pi[:known, None])
    return Robot(Y, A, told + noise * draw.normal(size=(SIZE, 2)), stated, P, P @ pi[:4] + draw.normal(size=known))


def motors(*deviations, of=2):
    """The last of so many."""
    first = of - len(deviations)
    return StatedMotors(("hip", "knee", "ankle")[first:of], np.arange(first, of), np.array(deviations))


def weighted(rows, deviation):
    """Rows in deviations, what is known beforehand below."""
    W = np.concatenate([(rows.W / deviation[:, None]).reshape(-1, rows.W.shape[2]), rows.P])
    return W, np.r_[(rows.tau / deviation).ravel(), rows.p]


def posterior(of, asked, deviation, k):
    """log p(k | u)."""
    W, tau = weighted(of.moved(k), deviation)
    left, H = tau - W @ np.linalg.lstsq(W, tau, rcond=None)[0], W.T @ W
    N = null_space(of.P) if len(of.P) else np.eye(len(H))
    free = np.linalg.slogdet(N.T @ H @ N)[1] if N.size else 0.0
    off = (1.0 - k[asked.places]) / asked.deviations
    return -(left @ left + np.linalg.slogdet(H)[1] - free + off @ off) / 2.0


def at(asked, log_k):
    """k of all motors."""
    k = np.ones(2)
    k[asked.places] = np.exp(log_k)
    return k


CASES = {
    "bodies": ((1.5, 0.7), 4, 0.0, (INF, INF), 0.02),
    "some bodies": ((1.5, 0.7), 2, 0.0, (INF, INF), 0.02),
    "motors": ((1.5, 0.7), 0, 0.0, (0.1, 0.3), 0.02),
    "a stated constant": ((1.5, 0.7), 0, 1.3, (INF, INF), 0.02),
    "one motor": ((1.0, 0.6), 0, 0.0, (INF,), 0.02),
    "a motor and bodies": ((2.0, 0.6), 3, 0.3, (0.2, INF), 0.3),
    "far away": ((60.0, 0.6), 3, 1.0, (INF, INF), 0.002),
}


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_k_is_the_mode_of_its_posterior(case):
    """To a hundredth of a deviation; the covariance is the inverse of all information that there is."""
    k, known, stated, deviations, noise = case
    of, asked = robot(k, known, stated, noise, 7), motors(*deviations)
    found = of.fitted(asked)
    own, told, sigma = found.k[asked.places], found.fit.covariance, found.fit.deviation
    m, log_k = len(own), np.log(own)
    best = minimize(lambda x: -posterior(of, asked, sigma, at(asked, x)), log_k, options={"gtol": 1e-9})
    assert (np.abs(own - np.exp(best.x)) <= 0.01 * np.sqrt(np.diag(told)[-m:])).all()
    drawn = weighted(of.moved(found.k), sigma)
    np.testing.assert_allclose(weighted(found.rows, sigma)[0], drawn[0], atol=1e-12 * np.abs(drawn[0]).max())
    moved = [[weighted(of.moved(at(asked, log_k + s * STEP * e)), sigma) for s in (1.0, -1.0)] for e in np.eye(m)]
    W_k, tau_k = (np.array([(more[i] - less[i]) / (2.0 * STEP) for more, less in moved]) for i in range(2))
    J = np.column_stack([drawn[0], (W_k @ found.fit.beta[:4] - tau_k).T / own])
    root = np.linalg.inv(np.real(sqrtm(drawn[0].T @ drawn[0])))
    C = np.array([-root @ drawn[0].T @ each @ root for each in W_k])
    C = (C + C.swapaxes(1, 2)) / 2.0
    free = np.eye(4) - root @ of.P.T @ np.linalg.inv(of.P @ root @ root @ of.P.T) @ of.P @ root
    information = J.T @ J
    information[4:, 4:] += np.diag(asked.deviations**-2.0)
    information[4:, 4:] += [[np.trace(x @ y - free @ x @ free @ y) for y in C] for x in C] / np.outer(own, own)
    L = np.linalg.cholesky(told)
    np.testing.assert_allclose(L.T @ information @ L, np.eye(4 + m), atol=1e-3)


@pytest.mark.parametrize("stated", [1.0, 1e3])
def test_exact_logs_tell_exact_constants(stated):
    """Steps end where rounding does, which there is far above a hundredth of a deviation."""
    k = np.array([1.5, 0.7])
    np.testing.assert_allclose(robot(k, 0, stated, 0.0, 0).fitted(motors(INF, INF)).k, k, rtol=1e-9)


def test_one_motor_that_has_settled_is_not_all():
    """The second is as its column says, and on rows that share no constant."""
    of, k = robot((1.0, 1.0), 0, 0.0, 0.0, 0), np.array([1.5, 1.0])
    Y = of.Y * [[1, 1, 0, 0, 1], [0, 0, 1, 1, 1]]
    alone = of._replace(A=np.tile(np.eye(2), (SIZE, 1, 1)), Y=Y, force=Y @ [0.5, 2.0, 1.0, 1.5, 0.7] / k, stated=0.7)
    np.testing.assert_allclose(alone.fitted(motors(INF, INF)).k, k, rtol=1e-12)


def test_motors_that_were_not_asked_for_are_as_their_columns_say():
    none = motors()
    assert robot((1.0, 1.0), 4, 0.0, 0.02, 0).fitted(none).k is None
    assert told_motors(none, None, np.eye(4), np.eye(4)).values.size == 0


def test_what_settles_nowhere_is_an_error():
    """Efforts that have nothing to do with a motion are none, and so is 1/k; or next to nothing fixes the scale."""
    of = robot((1.0, 1.0), 0, 5.0, 0.0, 0)
    for each in (
        of._replace(force=np.random.default_rng(1).normal(size=(SIZE, 2))),
        robot((1.5, 0.7), 0, 1e-2, 0.0, 0),
    ):
        with pytest.raises(ConvergenceError, match="do not settle"):
            each.fitted(motors(INF, INF))


def alike(*shares):
    """Motors whose efforts one constant explains, in such shares; what is left is as large in all of them: 0.01."""
    draw = np.random.default_rng(0)
    both = np.linalg.qr(np.column_stack([np.tile([1.0, -1.0], SIZE // 2), draw.normal(size=(SIZE, 3))]))[0]
    Y = np.stack([both[:, 1:] * shares, np.zeros((SIZE, 3))], axis=2)
    force = Y[..., 0] + 0.01 * np.tile([1.0, -1.0], SIZE // 2)[:, None]
    return Robot(Y, np.tile(np.eye(3), (SIZE, 1, 1)), force, 0.0, np.zeros((0, 1)), np.zeros(0))


def test_motors_of_a_tenth_of_what_is_open_are_named():
    shares = np.array([0.105, 0.095, np.sqrt(1.0 - 0.105**2 - 0.095**2)])
    with pytest.raises(InvalidInputError, match="the scale of hip, ankle: with"):
        alike(*shares).fitted(motors(INF, INF, INF, of=3))


def test_a_hundred_millionth_of_a_scale_is_rounding():
    """Of columns of size 1/(σ √3), each known to d, σ √3/d is the least that no constant explains."""
    of, sigma = alike(*np.full(3, 3.0**-0.5)), 0.01 * np.sqrt(SIZE / (SIZE - 1.0 / 3.0))
    less, more = (motors(*np.full(3, sigma * 3.0**0.5 / share), of=3) for share in (0.97e-8, 1.03e-8))
    with pytest.raises(InvalidInputError, match="nothing fixes the scale"):
        of.fitted(less)
    np.testing.assert_allclose(of.fitted(more).k, 1.0, atol=1e-6)


def test_a_share_of_k_is_a_deviation():
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    for asked in ("10 %", 0.1, {"joint2": 0.1, "joint1": "10 %"}):
        found = asked_motors(model, asked)
        assert found.names == ("joint1", "joint2")
        assert found.places.tolist() == [0, 1]
        assert found.deviations.tolist() == [0.1, 0.1]
    assert asked_motors(model, {"joint2": None}).deviations.tolist() == [INF]
    assert asked_motors(model, {"joint2": None}).places.tolist() == [1]
    assert asked_motors(model, True).deviations.tolist() == [INF, INF]
    more = ccpin.ReducedModel(ccpin.load("rpdr", actuated=["joint1", "joint2", "joint3"]))
    assert asked_motors(more, False).names == ()


def test_what_is_told_of_motors():
    """Their block of a covariance of β, a Stribeck speed and k; values are twice the first of β and three times all."""
    draw = np.random.default_rng(0).normal(size=(5, 5))
    covariance, to_values = draw @ draw.T, np.array([[2.0, 0.0], [3.0, 3.0]])
    found = told_motors(motors(INF, INF), np.array([1.5, 0.7]), covariance, to_values)
    np.testing.assert_allclose(found.values, [1.5, 0.7])
    np.testing.assert_allclose(found.deviations**2, np.diag(covariance)[3:])
    np.testing.assert_allclose(found.covariance, covariance[3:, 3:])
    cross = [[2.0 * covariance[k, 0], 3.0 * (covariance[k, 0] + covariance[k, 1])] for k in (3, 4)]
    np.testing.assert_allclose(found.with_values, cross)


def test_a_corrected_log_has_efforts_of_which_k_is_one():
    log = Log(np.arange(3.0), {"q_knee": np.arange(3.0), "u_knee": np.arange(3.0) + 1.0})
    found = MotorConstants(("knee",), np.array([1.5]), np.eye(1), np.eye(1)).corrected(log)
    assert found.columns["u_knee"].tolist() == [1.5, 3.0, 4.5]
    assert found.columns["q_knee"].tolist() == [0.0, 1.0, 2.0]
