"""Batches: each row as if asked for alone, whatever computes, however many threads, and what becomes of bad rows."""

import numpy as np
import pytest

import ccpin
from ccpin.errors import InvalidInputError, UnreachableError
from tests.support.agreement import reference_model
from tests.support.backends import same_on_both
from tests.support.long_cases import later


@pytest.fixture(scope="module", params=["native or numpy", pytest.param("numpy", marks=same_on_both)])
def model(request):
    """The five-bar on the backend in use, and on NumPy."""
    mechanism = ccpin.load("rpdr")
    return reference_model(mechanism) if request.param == "numpy" else ccpin.ReducedModel(mechanism)


@pytest.fixture(scope="module")
def place(model):
    """Q on the reference's branch, V, U; NumPy takes long over a row."""
    rng, rows = np.random.default_rng(11), 400 if model.backend.name == "native" else 16
    return np.radians([-150.0, -160.0]) + 0.2 * rng.normal(size=(rows, 2)), *rng.normal(size=(2, rows, 2))


MANY = {"sigma": 1, "terms": 2, "forward_dynamics": 3, "inverse_dynamics": 3, "forward_dynamics_derivatives": 3}
"""Arrays that each takes."""
NAMES = list(MANY)


def many(model, name, place, **options):
    """A batch's fields."""
    answer = getattr(model, f"{name}_many")(
        *(place[:1] if name == "sigma" else place[: 2 + (name != "terms")]), **options
    )
    return answer if isinstance(answer, tuple) else (answer,)


@pytest.mark.parametrize("name", NAMES)
def test_each_row_is_as_if_asked_for_alone(model, place, name):
    """To rounding of the one; the order of rows and the number of threads change nothing, to the bit."""
    found = many(model, name, place)
    rows = len(place[0])
    for row in (0, 7, rows - 1):
        alone = getattr(model, name)(
            *(array[row] for array in (place[:1] if name == "sigma" else place[: 2 + (name != "terms")]))
        )
        for values, value in zip(found, alone if isinstance(alone, tuple) else (alone,), strict=True):
            np.testing.assert_allclose(values[row], value, rtol=1e-12, atol=1e-12)
    order = np.random.default_rng(0).permutation(rows)
    for values, shuffled in zip(found, many(model, name, [a[order] for a in place], threads=3), strict=True):
        np.testing.assert_array_equal(values[order], shuffled)


@pytest.mark.parametrize("name", NAMES)
def test_rows_without_an_answer(model, place, name):
    """They raise, named by row, or are NaN with a reason; the others are untouched."""
    Q = place[0].copy()
    Q[3], Q[5, 0] = [1.5, -1.5], np.nan
    bad = (Q, *place[1:])
    with pytest.raises(UnreachableError, match="row 3: "):
        many(model, name, bad)
    failures = {}
    for values, clean in zip(many(model, name, bad, failures=failures), many(model, name, place), strict=True):
        assert np.isnan(values[[3, 5]]).all()
        np.testing.assert_array_equal(np.delete(values, [3, 5], axis=0), np.delete(clean, [3, 5], axis=0))
    assert set(failures) == {3, 5}
    assert "singularity" in failures[3]
    assert "not finite" in failures[5]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("value", later(np.nan, np.inf, -np.inf))
def test_rows_that_are_no_numbers(model, place, name, value):
    """Wherever in a row: in q, q̇ or what acts; the row is NaN throughout, and its reason is told."""
    place = [array[:8] for array in place]
    for column in range(MANY[name]):
        bad = [np.array(array) for array in place]
        bad[column][4, 1] = value
        with pytest.raises(InvalidInputError, match=r"row 4: .*finite"):
            many(model, name, bad)
        failures = {}
        for values, clean in zip(many(model, name, bad, failures=failures), many(model, name, place), strict=True):
            assert np.isnan(values[4]).all()
            np.testing.assert_array_equal(np.delete(values, 4, axis=0), np.delete(clean, 4, axis=0))
        assert list(failures) == [4]
        assert "finite" in failures[4]


def test_motors_elsewhere():
    """Least-norm efforts of three motors on two coordinates, in a batch as alone."""
    model = ccpin.ReducedModel(ccpin.load("rpdr", actuated=["joint1", "joint2", "joint3"]))
    rng = np.random.default_rng(2)
    Q = model.alpha(model.mechanism.q_reference) + 0.05 * rng.normal(size=(9, 2))
    V, A = rng.normal(size=(2, 9, 2))
    alone = [model.inverse_dynamics(*row) for row in zip(Q, V, A, strict=True)]
    np.testing.assert_allclose(model.inverse_dynamics_many(Q, V, A), alone, rtol=1e-12, atol=1e-12)


def test_no_rows(model):
    """Are answered by no rows."""
    assert model.terms_many(np.empty((0, 2)), np.empty((0, 2))).D.shape == (0, 2, 2)


def test_bad_arguments(model, place):
    """Shapes that do not fit, and no threads, are refused before anything is computed."""
    with pytest.raises(InvalidInputError, match="different lengths"):
        model.terms_many(place[0], place[1][:-1])
    with pytest.raises(InvalidInputError, match=r"V has shape .* \(N, 2\)"):
        model.terms_many(place[0], place[1][:, :1])
    with pytest.raises(InvalidInputError, match="threads"):
        model.sigma_many(place[0], threads=0)
