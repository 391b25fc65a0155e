"""Constants from logs: exact without noise, as sure as they say with it, and such as bodies have."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import chi2

import ccpin
from ccpin.description.formats import write_description
from ccpin.errors import InvalidInputError
from ccpin.identification import Log, consistent, identify, with_constants


def test_without_noise_the_constants_are_found(bench):
    found = identify(bench.model, bench.log(0, effort=0.0, encoder=0.0))
    off = np.abs(found.values - found.stated) / np.maximum(np.abs(found.stated), 1e-3)
    assert off.max() < 1e-3
    assert found.samples[0] > 900


def test_a_robot_told_wrong_is_told_right_by_its_log(bench):
    wrong = ccpin.ReducedModel(ccpin.load("rpdr"))  # knows of no friction
    found = identify(wrong, bench.log(1))
    truth = found.multiples @ bench.model.parameters.values
    off = (found.values - truth) / found.deviations
    assert (np.abs(found.stated - truth) / found.deviations).max() > 20.0
    assert np.abs(off).max() < 4.5
    assert 0.5 < np.sqrt(np.mean(off**2)) < 1.6


@pytest.mark.slow
def test_intervals_hold_what_they_say(bench):
    off = []
    for seed in range(200):
        found = identify(bench.model, bench.log(seed))
        off.append((found.values - found.stated) / found.deviations)
    assert 0.93 < np.mean(np.abs(off) < 1.96) < 0.97


def test_noise_that_hangs_together_is_told(bench):
    """An autoregressive noise of φ has an autocorrelation of φ, white noise none, to 1/√N; encoders are exact."""
    white, draw = bench.log(11, encoder=1e-9), np.random.default_rng(11)
    noise = lfilter([1.0], [1.0, -0.6], draw.normal(size=(len(white.t), 2)), axis=0)
    efforts = bench.tau + 0.02 * np.sqrt((bench.tau**2).mean(axis=0)) * noise
    coloured = Log(white.t, dict(white.columns) | {f"u_joint{k + 1}": efforts[:, k] for k in range(2)})
    for log, wanted in ((white, 0.0), (coloured, 0.6)):
        found = identify(bench.model, log).autocorrelation
        assert np.abs(found - wanted).max() < 4.0 / np.sqrt(len(log.t))


def test_values_are_the_multiples_of_the_constants_they_come_with(bench):
    found = identify(bench.model, bench.log(2))
    assert np.allclose(found.multiples @ found.parameters.values, found.values, rtol=1e-9, atol=1e-12)
    assert len(found.combinations) == len(found.values) == np.linalg.matrix_rank(found.multiples)
    assert len(found.table().splitlines()) == len(found.values)
    unit = dict(zip(found.parameters.names, found.parameters.units, strict=True))
    for name, told, line in zip(found.combinations, found.units, found.table().splitlines(), strict=True):
        assert told == unit[name.split()[0]]
        assert line.endswith(f"{name}   [{told}]")


def test_a_combination_says_what_it_cannot_be_told_from(bench):
    """Moving mass from one member of a combination to the others changes no force."""
    found = identify(bench.model, bench.log(3), kinds=("inertia",))
    values = bench.model.parameters.values
    still = np.linalg.svd(found.multiples[:, found.effects.columns])[2][len(found.values) :]
    moved = np.zeros(len(values))
    moved[found.effects.columns] = np.random.default_rng(0).normal(size=len(still)) @ still
    Y = bench.model.regressor_many(bench.q[::50], bench.v[::50], bench.a[::50])
    assert np.abs(Y @ moved).max() < 1e-12 * np.abs(Y).max() * np.abs(moved).sum()


def test_only_the_kinds_asked_for_are_looked_for(bench):
    found = identify(bench.model, bench.log(4), kinds=("friction",))
    assert all(name.startswith("friction:") for name in found.combinations)
    assert np.allclose(found.values, 0.02, rtol=0.0, atol=4.0 * found.deviations.max())


def test_consistent_constants_are_bodies_and_near(bench):
    pytest.importorskip("cvxpy")
    pytest.importorskip("clarabel")
    noisy = bench.log(5, effort=2.0)  # so noisy that bodies of negative moment come out
    found = identify(bench.model, noisy)
    kept = consistent(bench.model, found)
    for first in np.flatnonzero([kind == "mass" for kind in kept.kinds]):
        m, hx, hy, hz, xx, xy, yy, xz, yz, zz = kept.values[first : first + 10]
        inertia, h = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), np.array([hx, hy, hz])
        about = inertia - (h @ h * np.eye(3) - np.outer(h, h)) / m
        x, y, z = np.linalg.eigvalsh(about)
        assert m > 0.0
        assert x > -1e-9 * z
        assert x + y > z * (1.0 - 1e-6)
    positive = kept.of("armature", "damping", "friction")
    assert kept.values[positive].min() > -1e-9
    near, root = np.linalg.inv(found.covariance), found.multiples
    misfit = root @ kept.values - found.values
    stated = root @ bench.model.parameters.values - found.values
    assert misfit @ near @ misfit <= stated @ near @ stated + 1.0  # what is stated is consistent, too


def test_consistent_constants_of_a_clean_log_are_the_values(bench):
    pytest.importorskip("cvxpy")
    found = identify(bench.model, bench.log(6))
    kept = consistent(bench.model, found)
    off = (found.multiples @ kept.values - found.values) / found.deviations
    assert np.abs(off).max() < 1.0


def test_constants_are_written_into_a_description_and_read_again(bench, tmp_path):
    parameters = bench.model.parameters
    values = np.array(parameters.values)
    values[parameters.of("inertia")] *= 1.2
    values[parameters.of("damping")] = 0.03
    changed = type(parameters)(parameters.names, parameters.kinds, parameters.units, values)
    again = ccpin.ReducedModel(ccpin.load(with_constants(bench.model, changed)))
    assert np.allclose(again.parameters.values, values, rtol=1e-12, atol=1e-15)
    path = tmp_path / "learnt.urdf"
    write_description(with_constants(bench.model, changed), path)
    assert np.allclose(ccpin.ReducedModel(ccpin.load(path)).parameters.values, values, rtol=1e-9, atol=1e-12)
    for name in ("mass:link1", "armature:joint1", "damping:joint2", "friction:joint3", "stiffness:joint4"):
        kind, _, where = name.partition(":")
        with pytest.raises(InvalidInputError, match=f"'{where}' would have a {kind}|'{name}' would be -"):
            with_constants(bench.model, changed.plus({name: -1.0}))


def test_what_nothing_can_be_learnt_from_is_told(bench):
    log = bench.log(0)
    for wrong, told in (
        ([], "no log"),
        (Log(log.t, {name: column for name, column in log.columns.items() if name != "u_joint2"}), "u_joint2"),
        (log.between(0.0, 0.08), "too few"),
        (Log(log.t, {name: column * (name[0] == "q") for name, column in log.columns.items()}), "all efforts are 0"),
        ([log, bench.log(1), Log(log.t, dict(log.columns), "copy")], r"logs\[0\] and logs\[2\] are one"),
    ):
        with pytest.raises(InvalidInputError, match=told):
            identify(bench.model, wrong)
    with pytest.raises(InvalidInputError, match="kind"):
        identify(bench.model, log, kinds=("colour",))
    other = ccpin.ReducedModel(ccpin.load("four_bar"))
    with pytest.raises(InvalidInputError):
        consistent(other, identify(bench.model, log))


def test_a_box_holds_the_ellipsoid_of_its_confidence(bench):
    """√χ²_r deviations either way of each combination's first parameter: how far the ellipsoid goes, and no farther."""
    found = identify(bench.model, bench.log(7), kinds=("inertia",))
    lower, upper = found.box(0.99)
    moved = np.flatnonzero(upper > lower)
    assert [bench.model.parameters.names[k] for k in moved] == [name.split()[0] for name in found.combinations]
    away = found.multiples @ (0.5 * (lower + upper)) - found.values
    np.testing.assert_allclose(away, 0.0, atol=1e-9 * np.abs(found.values).max())
    root, reach = np.linalg.cholesky(found.covariance), found.multiples @ (0.5 * (upper - lower))
    farthest = np.sqrt(chi2.ppf(0.99, len(found.values))) * np.linalg.norm(root, axis=1)
    np.testing.assert_allclose(reach, farthest, rtol=1e-9)
    around = found.box(0.99, bench.model.parameters)
    still = np.setdiff1d(np.arange(len(lower)), moved)
    np.testing.assert_array_equal(around[0][still], bench.model.parameters.values[still])
    for mine, own in zip(around, (lower, upper), strict=True):
        np.testing.assert_allclose(found.multiples @ mine, found.multiples @ own, atol=1e-12)
    with pytest.raises(InvalidInputError, match="another mechanism"):
        found.box(0.9, ccpin.ReducedModel(ccpin.load("four_bar")).parameters)
    for wrong in (0.0, 1.0, -0.5, np.nan, "much"):
        with pytest.raises(InvalidInputError, match="confidence"):
            found.box(wrong)
