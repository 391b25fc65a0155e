"""What is known beforehand: shares and units, and what becomes of it in an estimate."""

import numpy as np
import pytest

from ccpin.errors import InvalidInputError
from ccpin.identification import consistent, identify
from ccpin.identification.estimates.stated_priors import stated_prior

PRIOR = {"inertia": "10 %", "armature": 1e-4, "damping": 0.02, "friction": 0.02, "friction:joint3": 0.005}


@pytest.fixture(scope="module")
def informed(bench):
    return identify(bench.model, bench.log(1), prior=PRIOR)


def test_a_share_of_a_body_is_of_the_largest_number_that_it_could_have(bench):
    """|h| ≤ √(m s) and |I_ij| ≤ s, s = ½ tr I, of any cloud of points; attained by points on a line."""
    parameters = bench.model.parameters
    found = stated_prior(parameters, parameters.of("inertia"), {"inertia": "10 %"})
    assert np.array_equal(found.columns, parameters.of("inertia"))
    body, off = parameters.values[:10], found.deviations[:10]
    s = (body[4] + body[6] + body[9]) / 2.0
    assert np.allclose(off, 0.1 * np.array([body[0], *[np.sqrt(body[0] * s)] * 3, *[s] * 6]), rtol=1e-12)


def test_a_name_outweighs_its_kind(bench):
    parameters = bench.model.parameters
    found = stated_prior(parameters, parameters.of("friction"), {"friction:joint3": 0.1, "friction": "50 %"})
    told = dict(zip((parameters.names[k] for k in found.columns), found.deviations, strict=True))
    assert told == {f"friction:joint{k}": pytest.approx(0.1 if k == 3 else 0.01) for k in (1, 2, 3, 4)}


def test_what_logs_do_not_tell_keeps_the_priors_deviation(bench, informed):
    parameters = bench.model.parameters
    assert set(informed.combinations) == {parameters.names[k] for k in informed.effects.columns}
    off = dict(zip(informed.combinations, informed.deviations, strict=True))
    prior = stated_prior(parameters, informed.effects.columns, PRIOR)
    stated = dict(zip((parameters.names[k] for k in prior.columns), prior.deviations, strict=True))
    for name in ("Ixx:link1", "Iyz:link4", "my:link2"):  # across the plane: no motor feels them
        assert off[name] == pytest.approx(stated[name], rel=1e-6)
        assert informed.values[informed.combinations.index(name)] == pytest.approx(
            informed.stated[informed.combinations.index(name)], abs=1e-9
        )
    assert all(off[name] <= stated[name] * (1.0 + 1e-9) for name in off)
    assert off["friction:joint3"] < 0.1 * stated["friction:joint3"]


def test_the_posterior_is_that_of_two_measurements(bench, informed):
    """Precisions of logs alone and of the prior add up: Mᵀ C⁻¹ M + diag(1/d²), of all constants."""
    parameters, columns = bench.model.parameters, informed.effects.columns
    alone = identify(bench.model, bench.log(1))
    d = stated_prior(parameters, columns, PRIOR).deviations
    M = alone.multiples[:, columns] * d  # in deviations
    precision = M.T @ np.linalg.solve(alone.covariance, M) + np.eye(len(d))
    order = [informed.combinations.index(parameters.names[k]) for k in columns]
    covariance = informed.covariance[np.ix_(order, order)] / np.outer(d, d)
    assert np.abs(covariance - np.linalg.inv(precision)).max() < 0.02
    before = parameters.values[columns]
    mode = before + d * np.linalg.solve(precision, M.T @ np.linalg.solve(alone.covariance, alone.values - alone.stated))
    assert np.abs((informed.values[order] - mode) / d).max() < 0.02


def test_consistent_constants_heed_the_prior(bench, informed):
    pytest.importorskip("cvxpy")
    found = consistent(bench.model, informed)
    off = (informed.multiples @ found.values - informed.values) / informed.deviations
    assert np.abs(off).max() < 1.0


@pytest.mark.parametrize(
    ("prior", "told"),
    [
        ({"colour": 1.0}, "'colour' is no constant"),
        ({"stiffness": 1.0}, "not among the constants that are looked for"),
        ({"mass": "heavy"}, "neither a number nor a share"),
        ({"mass": 0.0}, "deviation of 'mass:link1'"),
        ({"armature": "5 %"}, "'armature:joint3' is stated as nothing"),
        (["mass"], "a mapping"),
    ],
)
def test_priors_that_say_nothing_are_told(bench, prior, told):
    parameters = bench.model.parameters
    with pytest.raises(InvalidInputError, match=told):
        stated_prior(parameters, parameters.of("inertia", "armature"), prior)
