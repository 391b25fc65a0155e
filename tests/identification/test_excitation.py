"""Motions that show constants: within limits between samples too, on the branch by proof, better than chance."""

import numpy as np
import pytest

from ccpin.errors import InvalidInputError
from ccpin.identification import excitation
from ccpin.identification.estimates.felt_combinations import Motions, effects, kinds_of
from tests.support.random_motions import least_of_random

DURATION, SPEED, EFFORT = 4.0, 3.0, 1.0


@pytest.fixture(scope="module")
def box(model):
    middle = model.alpha(model.mechanism.q_reference)
    return {"lower": middle - 0.3, "upper": middle + 0.3, "speed": SPEED, "effort": EFFORT}


@pytest.fixture(scope="module")
def found(model, box):
    return excitation(model, DURATION, **box, starts=20, iterations=2)


def along(reference, count):
    return (np.array(rows) for rows in zip(*map(reference.at, np.linspace(0.0, DURATION, count)), strict=True))


def test_a_motion_is_within_limits_between_samples_too_and_from_rest_to_rest(model, box, found):
    q, v, a = along(found.reference, 20001)
    assert np.all(q >= box["lower"])
    assert np.all(q <= box["upper"])
    assert np.abs(v).max() <= SPEED
    assert np.abs(model.inverse_dynamics_many(q, v, a)).max() <= EFFORT
    assert np.abs(v[[0, -1]]).max() < 1e-12
    assert np.array_equal(q[0], q[-1])
    assert found.share <= 1.0


def test_it_stays_on_its_branch_by_proof(found):
    assert found.path.proved
    assert found.told.endswith(found.path.reason)


def test_its_condition_is_that_of_the_regressor_in_combinations_told_apart(model, box, found):
    reach = np.full(2, 0.3)
    told = effects(model, Motions(box["lower"] + reach, reach, np.full(2, SPEED), np.full(2, 36.0)), kinds_of(model))
    W = told.reduced(model.regressor_many(*along(found.reference, 80)))
    assert W.shape[1] == found.rank
    assert np.isclose(np.linalg.cond(W), found.condition, rtol=1e-9)
    states = np.random.default_rng(1).uniform(-1.0, 1.0, (3, 40, 2))
    Y = model.regressor_many(box["lower"] + reach * (1.0 + states[0]), *states[1:])
    x = np.random.default_rng(2).normal(size=len(told.columns))
    exact = (Y[..., told.columns] / told.scale @ x).ravel()
    assert np.allclose(told.reduced(Y) @ (told.basis.T @ x), exact, rtol=0.0, atol=1e-3 * np.abs(exact).max())


@pytest.mark.slow
@pytest.mark.parametrize("criterion", ["condition", "trace"])
def test_it_tells_more_than_the_best_of_a_thousand_random_fourier_motions(model, box, criterion):
    best = excitation(model, DURATION, **box, criterion=criterion)
    reach = (box["upper"] - box["lower"]) / 2.0
    condition, trace, _ = least_of_random(model, best.effects, (box["lower"] + reach, reach[0], SPEED), DURATION)
    assert best.condition < condition if criterion == "condition" else best.trace < trace


def test_it_is_saved_as_a_table(found, tmp_path):
    found.save(tmp_path / "motion.csv", 0.01)
    rows = np.genfromtxt(tmp_path / "motion.csv", delimiter=",", names=True)
    assert rows.dtype.names == ("t", "q_joint1", "q_joint2", "v_joint1", "v_joint2", "a_joint1", "a_joint2")
    assert np.array_equal(found.reference.at(rows["t"][17]).q, [rows["q_joint1"][17], rows["q_joint2"][17]])


@pytest.mark.parametrize("period", [0.1, 0.03])
def test_a_table_ends_at_rest(model, box, tmp_path, period):
    """Where periods, as doubles, do not fill the duration the last row is after its end."""
    short = excitation(model, 0.7, **box, starts=1, iterations=0)
    short.save(tmp_path / "motion.csv", period)
    t, *rows = np.loadtxt(tmp_path / "motion.csv", delimiter=",", skiprows=1).T
    assert 0.7 - 1e-12 < t[-1] < 0.7 + period - 1e-12
    assert np.allclose([row[-1] for row in rows], [*short.reference.at(0.0).q, 0.0, 0.0, 0.0, 0.0], atol=1e-12)


def test_limits_that_leave_no_motion_are_told(model, box):
    for wrong in (
        {"upper": box["lower"]},
        {"speed": 0.0},
        {"effort": [1.0]},
        {"start": box["upper"] + 1.0},
        {"criterion": "beauty"},
        {"kinds": ("colour",)},
    ):
        with pytest.raises(InvalidInputError):
            excitation(model, DURATION, **(box | wrong), starts=2, iterations=0)
    for wrong in ({"speed": 1e-9}, {"start": box["upper"]}):
        with pytest.raises(InvalidInputError, match="a longer duration, more speed or effort, or a start farther from"):
            excitation(model, DURATION, **(box | wrong), starts=2, iterations=0)
