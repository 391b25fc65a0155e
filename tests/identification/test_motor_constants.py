"""Motors' constants from logs: found where something fixes the scale, with its deviation, and refused where not."""

import json

import numpy as np
import pytest

import ccpin
from ccpin.cli import main
from ccpin.errors import InvalidInputError
from ccpin.identification import Log, explained, identify

K = np.array([1.12, 0.9])
FRICTION = {"kinds": ("friction", "damping")}


def said(log, k):
    """A log whose efforts are told k times too small."""
    efforts = [name for name in log.columns if name[0] == "u"]
    return Log(log.t, dict(log.columns) | {name: log.columns[name] / x for name, x in zip(efforts, k, strict=True)})


def elsewhere(bench, seed):
    """The bench's robot with motors on joints that are no coordinates, and its log."""
    joints = {f"joint{k + 1}": {"friction": 0.02, "damping": 0.01} for k in range(4)}
    model = ccpin.ReducedModel(ccpin.load("rpdr", joints=joints, actuated=["joint3", "joint4"]))
    rho = model.terms_many(bench.q, bench.v).rho
    A = np.swapaxes(rho, 1, 2) @ model.actuation.T
    u, log = np.linalg.solve(A, bench.tau[..., None])[..., 0], bench.log(seed)
    u += 0.02 * np.sqrt((u**2).mean(axis=0)) * np.random.default_rng(seed).normal(size=u.shape)
    columns = {name: log.columns[name] for name in log.columns if name[0] == "q"}
    return model, Log(log.t, columns | {"u_joint3": u[:, 0], "u_joint4": u[:, 1]})


def test_noise_in_efforts_makes_no_constant_smaller(bench):
    """Regression of Y π on k u, by itself, misses by noise's share of the square; `identify` does not."""
    model, noise = bench.model, 0.3
    log = said(bench.log(0, noise), K)
    found = identify(model, log, motors=True, **FRICTION).motors
    assert np.abs((found.values - K) / found.deviations).max() < 4.0
    assert (found.deviations < 0.02).all()
    free = model.parameters.of(*FRICTION["kinds"])
    Y, u = model.regressor_many(bench.q, bench.v, bench.a), np.stack([log.columns[f"u_joint{j + 1}"] for j in range(2)])
    own = np.array(model.parameters.values)
    own[free] = 0.0
    columns = np.concatenate([-Y[..., free], np.einsum("js,ij->sij", u, np.eye(2))], axis=2)
    naive = np.linalg.lstsq(columns.reshape(-1, columns.shape[2]), (Y @ own).ravel(), rcond=None)[0][-2:]
    assert (naive < (1.0 - 0.5 * noise**2) * K).all()


def test_the_scales_own_deviation_is_told(bench):
    """Of a scale known by motors alone, each to a tenth: k = s κ has s of precision Σ κ²/0.1², and π goes with it."""
    estimate = identify(bench.model, said(bench.log(1), K), motors="10 %")
    of_k = estimate.motors
    s = 0.1 / np.linalg.norm(of_k.values)
    assert of_k.deviations == pytest.approx(s * of_k.values, rel=1e-2)
    size = np.outer(of_k.deviations, estimate.deviations)
    correlated = s**2 * np.outer(of_k.values, estimate.values) / size
    np.testing.assert_allclose(of_k.with_values / size, correlated, atol=0.1)
    assert correlated.max() > 0.99
    ratio = of_k.values[1] / of_k.values[0]
    slope = np.array([-ratio, 1.0]) / of_k.values[0]
    off = np.sqrt(slope @ of_k.covariance @ slope)
    assert off < 0.01
    assert abs(ratio - K[1] / K[0]) < 4.0 * off
    assert np.abs(estimate.values - estimate.stated)[0] < 4.0 * estimate.deviations[0]
    assert "motor:joint2" in estimate.table()


def test_what_is_known_of_bodies_fixes_the_scale(bench):
    estimate = identify(bench.model, said(bench.log(2), K), motors=True, prior={"inertia": "5 %"})
    assert np.abs((estimate.motors.values - K) / estimate.motors.deviations).max() < 4.0
    assert (estimate.motors.deviations < 0.05).all()


def test_a_motor_that_is_not_named_is_as_its_column_says(bench):
    found = identify(bench.model, said(bench.log(3), [1.0, K[1]]), motors={"joint2": None}).motors
    assert found.names == ("joint2",)
    assert abs(found.values[0] - K[1]) < 4.0 * found.deviations[0] < 0.04


def test_motors_that_are_known_well_are_none(bench):
    """With k = 1 ± 1e-8 all is as without, errors of the motion among it, wherever motors are."""
    model, log = elsewhere(bench, 4)
    one, plain = identify(model, log, motors=1e-8), identify(model, log)
    assert one.values == pytest.approx(plain.values, rel=1e-6, abs=1e-9)
    np.testing.assert_allclose(one.deviations, plain.deviations, rtol=1e-5)
    assert plain.motors.names == ()


def test_units_of_efforts_are_units_of_k(bench):
    """Efforts told in a unit half as large: k is half, deviations alike, and all constants as they were."""
    model, log = elsewhere(bench, 5)
    one, other = (identify(model, said(log, [c, c]), motors=True, **FRICTION) for c in (1.0, 0.5))
    assert np.abs((one.motors.values - 1.0) / one.motors.deviations).max() < 4.0
    assert other.motors.values == pytest.approx(0.5 * one.motors.values, rel=1e-5)
    np.testing.assert_allclose(other.motors.deviations, 0.5 * one.motors.deviations, rtol=1e-3)
    np.testing.assert_allclose(other.values, one.values, rtol=1e-4)
    np.testing.assert_allclose(other.deviations, one.deviations, rtol=1e-3)


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"motors": True}, "nothing fixes the scale of joint1, joint2"),
        ({"motors": {"elbow": "5 %"}}, "'elbow' is no motor"),
        ({"motors": "a lot"}, "'a lot' of 'all' is neither a number nor a share"),
        ({"motors": {"joint1": -1.0}}, "the deviation of 'joint1'"),
    ],
)
def test_what_tells_nothing_is_refused(bench, asked, words):
    with pytest.raises(InvalidInputError, match=words):
        identify(bench.model, bench.log(0), **asked)


def test_motors_that_are_not_as_many_as_coordinates_are_refused(bench):
    model = ccpin.ReducedModel(ccpin.load("rpdr", actuated=["joint1", "joint2", "joint3"]))
    log = bench.log(0)
    with pytest.raises(InvalidInputError, match="3 motors of 2 coordinates"):
        identify(model, Log(log.t, dict(log.columns) | {"u_joint3": 0.0 * log.t}), motors="5 %")


@pytest.mark.slow
def test_late_clocks_and_gross_errors_are_set_right_beside(bench):
    log = said(bench.log(6), K)
    late = identify(bench.model, log.delayed({"u": -4e-3}), motors=True, align=True, **FRICTION)
    assert late.delays[0].seconds == pytest.approx(4e-3, abs=1e-3)
    columns = dict(log.columns)
    columns["u_joint1"] = columns["u_joint1"] + 5.0 * (np.arange(len(log.t)) % 97 == 50)
    spoilt = identify(bench.model, Log(log.t, columns), motors=True, **FRICTION)
    assert len(spoilt.outliers) >= 5
    for each in (late.motors, spoilt.motors):
        assert np.abs((each.values - K) / each.deviations).max() < 4.0


@pytest.mark.slow
def test_stribecks_friction_is_found_beside(bench):
    """Levels and speeds of the simulated law, in true N m, from efforts told too small or too large."""
    terms = bench.model.terms_many(bench.q, bench.v)
    rates = np.einsum("sij,sj->si", terms.rho, bench.v)
    fall = 0.02 * np.exp(-((rates / 0.4) ** 2)) * np.sign(rates)
    log = said(bench._replace(tau=bench.tau + np.einsum("sij,si->sj", terms.rho, fall)).log(9), K)
    estimate = identify(bench.model, log, motors=True, stribeck=True, **FRICTION)
    assert np.abs((estimate.motors.values - K) / estimate.motors.deviations).max() < 4.0
    for each in estimate.stribeck:
        assert np.abs((each.values - [0.02, 0.04, 0.4]) / each.deviations).max() < 4.0
        assert each.deviations[2] < 0.1


@pytest.mark.slow
def test_a_corrected_log_is_explained_and_refined(bench):
    log = said(bench.log(7), K)
    estimate = identify(bench.model, log, motors=True, prior={"inertia": "5 %"})
    corrected = estimate.motors.corrected(log)
    assert (explained(bench.model, estimate.parameters, corrected).share < 0.03).all()
    assert (explained(bench.model, estimate.parameters, log).share > 0.05).all()
    with pytest.raises(InvalidInputError, match="take another estimate"):
        estimate.refined(bench.model, log)
    with pytest.raises(InvalidInputError, match="no column 'u_joint1'"):
        estimate.motors.corrected(Log(log.t, {"q_joint1": log.columns["q_joint1"]}))


@pytest.mark.slow
def test_the_command_finds_them(bench, tmp_path, capsys):
    pytest.importorskip("cvxpy")
    path, page = tmp_path / "run.csv", tmp_path / "page.html"
    said(bench.log(8), K).save(path)
    asked = ["identify", "rpdr", "--logs", str(path), "--motors"]
    assert main([*asked, "10%", "--prior", "inertia=5%", "--report", str(page), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["motors"]
    assert [each["k"] for each in told] == pytest.approx(K, rel=0.1)
    assert "the true effort over what the column says" in page.read_text(encoding="utf-8")
    assert main([*asked, "joint1=5%"]) == 0
    assert "motor:joint1" in capsys.readouterr().out
    assert main(asked) != 0


@pytest.mark.slow
def test_intervals_of_k_hold_what_they_say(bench):
    """Wherever motors are, k drawn about 1 by what is told of it."""
    draw, off = np.random.default_rng(0), []
    for seed in range(60):
        model, log = elsewhere(bench, seed)
        k = 1.0 + 0.05 * draw.normal(size=2)
        found = identify(model, said(log, k), motors="5 %").motors
        off.append((found.values - k) / found.deviations)
    assert (np.abs(off) < 1.96).mean() == pytest.approx(0.95, abs=0.05)
