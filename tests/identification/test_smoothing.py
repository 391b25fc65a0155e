"""Motions behind noisy samples: exact where nothing is noisy, without phase, closed, and as sure as they say."""

import numpy as np
import pytest
import scipy.sparse as sparse
from scipy.interpolate import BSpline, make_smoothing_spline

import ccpin
from ccpin.description.finding import find_file
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.identification import Log, smoothed
from ccpin.identification.logs.log import position
from ccpin.identification.logs.penalized_splines import (
    Knots,
    Measurements,
    apart,
    banded,
    fitted,
    freedom,
    inverse_band,
    normal_equations,
    spread,
    variances,
)

NOISE = 2e-4
T = np.arange(0.0, 1.0, 2.5e-3)


@pytest.fixture(scope="module")
def motion(model):
    w, size = 2 * np.pi * np.array([1.1, 1.7]), np.array([0.25, 0.2])
    middle = model.alpha(model.mechanism.q_reference)
    angle = np.outer(T, w)
    return middle + size * np.sin(angle), size * w * np.cos(angle), -size * w**2 * np.sin(angle)


def noisy(motion, seed):
    off = NOISE * np.random.default_rng(seed).normal(size=motion[0].shape)
    return {f"q_joint{k + 1}": column for k, column in enumerate((motion[0] + off).T)}


def test_the_spline_is_the_dense_minimiser():
    rng = np.random.default_rng(0)
    t, n = np.sort(rng.uniform(0.0, 1.0, 40)), 2
    knots = Knots.over(0.0, 1.0, 0.1)
    slopes, s = rng.normal(size=(40, n)), rng.uniform(0.5, 2.0, 40)
    rows = Measurements(spread(knots.basis(t, 1), slopes), rng.normal(size=40), s)
    direct = np.kron(knots.roughness().toarray(), np.diag([1e-4, 1e-3])) + 1e-3 * np.eye(knots.size * n)
    normal, penalty = normal_equations(rows, n), banded(sparse.csr_array(direct), n)
    fit = fitted(normal, penalty)
    x = rows.matrix.toarray() / s[:, None]
    inverse = np.linalg.inv(x.T @ x + direct)
    assert np.allclose(fit.c.ravel(), inverse @ x.T @ (rows.y / s), rtol=1e-9, atol=1e-12)
    assert np.isclose(freedom(normal, penalty), np.trace(x @ inverse @ x.T), rtol=1e-9)
    asked = spread(knots.basis(t), np.tile([0.0, 1.0], (40, 1)))
    wanted = np.einsum("ri,ij,rj->r", asked.toarray(), inverse, asked.toarray())
    assert np.allclose(variances(inverse_band(fit.factor), asked), wanted)
    assert np.allclose(variances(inverse_band(fit.factor), apart(knots.basis(t), n)[1]), wanted)


def test_derivatives_of_the_basis_are_those_of_their_splines():
    knots, t = Knots.over(-1.0, 2.0, 0.3), np.linspace(-1.0, 2.0, 101)
    c = np.random.default_rng(0).normal(size=knots.size)
    spline = BSpline(knots.t, c, 5)
    for order in range(4):
        assert np.allclose(knots.basis(t, order) @ c, spline(t, order), rtol=1e-9, atol=1e-9)
    fine = np.linspace(-1.0, 2.0, 200001)
    assert np.isclose(c @ knots.roughness() @ c, np.trapezoid(spline(fine, 3) ** 2, fine), rtol=1e-6)


def test_samples_without_noise_are_met_and_a_parabola_exactly(model, motion):
    found = smoothed(Log(T, {f"q_joint{k + 1}": motion[0][:, k] for k in range(2)}), model)
    assert np.abs(found.q - motion[0]).max() < 1e-10
    assert np.abs(found.a - motion[2]).max() < 1e-3
    middle = model.alpha(model.mechanism.q_reference)
    parabola = {f"q_joint{k + 1}": middle[k] + 0.1 * T - 0.2 * T**2 for k in range(2)}
    found = smoothed(Log(T, parabola), model, noise={"q_joint1": 1e-3, "q_joint2": 1e-3})  # as smooth as it gets
    assert np.abs(found.a + 0.4).max() < 1e-4


def test_noise_and_errors_are_what_they_are_said_to_be(model, motion):
    drawn = [smoothed(Log(T, noisy(motion, seed)), model) for seed in range(3)]
    levels = [each.noise[name] for each in drawn for name in ("q_joint1", "q_joint2")]
    assert abs(np.mean(levels) / NOISE - 1.0) < 4.0 / np.sqrt(2.0 * len(levels) * len(T))
    off = np.concatenate([(each.q - motion[0]) / each.q_deviation for each in drawn])
    assert 0.6 < np.sqrt(np.mean(off**2)) < 1.15
    alone = np.array([make_smoothing_spline(T, column).derivative(2)(T) for column in noisy(motion, 0).values()]).T
    inner = slice(20, -20)
    ours, theirs = (np.sqrt(np.mean((each - motion[2])[inner] ** 2)) for each in (drawn[0].a, alone))
    assert ours < theirs  # SciPy's penalises the second derivative
    assert not any(each.outliers for each in drawn)


def test_time_reversed_the_answer_is(model, motion):
    columns = noisy(motion, 7)
    forward = smoothed(Log(T, columns), model)
    backward = smoothed(Log(T[-1] - T[::-1], {name: column[::-1] for name, column in columns.items()}), model)
    assert np.abs(forward.q - backward.q[::-1]).max() < 1e-3 * NOISE
    assert np.abs(forward.v + backward.v[::-1]).max() < 1e-3 * np.abs(forward.v).max()


def test_outliers_are_named_and_gaps_bridged(model, motion):
    columns = noisy(motion, 8)
    spoilt = columns["q_joint1"].copy()
    spoilt[[40, 41, 300]] += [0.02, -0.03, 0.004]
    spoilt[150:160] = np.nan
    found = smoothed(Log(T, columns | {"q_joint1": spoilt}), model)
    assert [(each.column, each.t) for each in found.outliers] == [("q_joint1", T[k]) for k in (40, 41, 300)]
    assert {each.log for each in found.outliers} == {"a log"}
    assert np.abs(found.q - motion[0]).max() < 2.0 * NOISE


def test_a_spline_reaches_to_both_ends():
    for seed in range(50):
        begin, length, spacing = np.random.default_rng(seed).uniform([-1.0, 1.0, 0.001], [1.0, 9.0, 0.01])
        ends = np.array([begin, begin + length])
        assert Knots.over(*ends, spacing).basis(ends).shape == (2, Knots.over(*ends, spacing).size)


def test_an_encoder_on_a_passive_joint_and_a_measured_velocity_add_what_they_know(model, motion):
    columns, rng = noisy(motion, 9), np.random.default_rng(9)
    plain = smoothed(Log(T, columns), model)
    q_free = model.sigma_many(motion[0])
    turns = position(model, "joint3", q_free) + 4.0 * np.pi + NOISE / 10.0 * rng.normal(size=len(T))
    more = smoothed(Log(T, columns | {"q_joint3": turns}), model)
    assert np.linalg.norm(more.q_deviation) < 0.8 * np.linalg.norm(plain.q_deviation)
    assert np.linalg.norm(more.q - motion[0]) < 0.8 * np.linalg.norm(plain.q - motion[0])
    speeds = motion[1][:, 1] + 1e-3 * rng.normal(size=len(T))
    faster = smoothed(Log(T, columns | {"v_joint2": speeds}), model)
    assert np.linalg.norm((faster.v - motion[1])[:, 1]) < 0.5 * np.linalg.norm((plain.v - motion[1])[:, 1])


def test_sensors_that_contradict_one_another_are_told_by_what_they_miss(model, motion):
    columns = noisy(motion, 9)
    turns = position(model, "joint3", model.sigma_many(motion[0])) + 0.02
    found = smoothed(Log(T, columns | {"q_joint3": turns}), model, noise={"q_joint3": NOISE})
    missed = turns - position(model, "joint3", model.sigma_many(found.q))
    np.testing.assert_allclose(found.noise["q_joint3"], np.sqrt(np.mean(missed**2)), rtol=1e-6)
    assert max(found.noise.values()) > 20.0 * NOISE


def test_efforts_stay_as_they_were_measured(model, motion):
    effort = np.where(T > 0.5, np.nan, T)
    found = smoothed(Log(T, noisy(motion, 0) | {"u_joint2": effort}), model)
    assert np.array_equal(found.u[:, 1], effort, equal_nan=True)
    assert np.all(np.isnan(found.u[:, 0]))


def test_efforts_far_from_all_positions_are_not_looked_at(model, motion):
    columns = noisy(motion, 0)
    spoilt, seldom = columns["q_joint1"].copy(), columns["q_joint2"].copy()
    spoilt[150:200] = np.nan
    seldom[np.arange(len(T)) % 4 > 0] = np.nan
    efforts, every = {"u_joint1": T, "u_joint2": T}, np.arange(len(T))
    kept = smoothed(Log(T, columns | efforts | {"q_joint1": spoilt}), model).with_efforts()
    assert np.array_equal(kept, np.setdiff1d(every, np.arange(152, 198)))
    kept = smoothed(Log(T, columns | efforts | {"q_joint2": seldom}), model).with_efforts()
    assert np.array_equal(kept, every)


def test_a_column_of_zeros_is_a_motion_at_rest(model):
    found = smoothed(Log(T, {"q_joint1": np.zeros(len(T)), "q_joint2": np.full(len(T), 0.5)}), model)
    assert np.abs(found.q - [0.0, 0.5]).max() < 1e-12
    assert np.abs(found.v).max() < 1e-9
    assert 0.0 < found.noise["q_joint1"] < 1e-12


def test_what_cannot_be_smoothed_is_told(model, motion):
    columns = noisy(motion, 0)
    for log, told in (
        (Log(T, {"q_joint1": columns["q_joint1"]}), "no column 'q_joint2'"),
        (Log(T[:4], {name: column[:4] for name, column in columns.items()}), "4 samples"),
        (Log(T, columns | {"q_joint9": T}), "joint9"),
    ):
        with pytest.raises(InvalidInputError, match=told):
            smoothed(log, model)
    for wrong in ({"noise": {"u_joint1": 1.0}}, {"noise": {"q_joint1": 0.0}}, {"spacing": -1.0}, {"spacing": 1e-9}):
        with pytest.raises(InvalidInputError):
            smoothed(Log(T, columns), model, **wrong)


def test_coordinates_on_a_circle_are_refused_by_name(tmp_path):
    text = find_file("rpdr").read_text()
    path = tmp_path / "turning.urdf"
    path.write_text(text.replace('name="joint1" type="revolute"', 'name="joint1" type="continuous"'))
    with pytest.raises(UnsupportedMechanismError, match="joint1"):
        smoothed(Log(T, {"q_joint1": T, "q_joint2": T}), ccpin.load(path))
