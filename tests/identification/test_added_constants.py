"""Logs of a robot with and without constants that are known to be added: a load on a link, which was weighed."""

import json

import numpy as np
import pinocchio as pin
import pytest

import ccpin
from ccpin.cli import main
from ccpin.dynamics.parameters import INERTIAL
from ccpin.errors import InvalidInputError
from ccpin.identification import Log, explained, identify, with_constants

K = np.array([1.12, 0.9])
BALL = pin.SE3(np.eye(3), np.array([0.2, 0.0, 0.05])).act(pin.Inertia.FromSphere(0.4, 0.03))
LOAD = {f"{kind}:link3": x for kind, x in zip(INERTIAL, BALL.toDynamicParameters().tolist(), strict=True)}


@pytest.fixture(scope="module")
def heavier(bench):
    """The description of the bench's robot with the ball."""
    return ccpin.ReducedModel(ccpin.load(with_constants(bench.model, bench.model.parameters.plus(LOAD))))


@pytest.fixture(scope="module")
def loaded(bench, heavier):
    """Efforts of the heavier robot's inverse dynamics, and of friction."""
    more, empty = (each.inverse_dynamics_many(bench.q, bench.v, bench.a) for each in (heavier, bench.model))
    return bench._replace(tau=bench.tau + more - empty)


def said(log, source="a log"):
    """A log whose efforts are told k times too small."""
    efforts = [name for name in log.columns if name[0] == "u"]
    return Log(log.t, dict(log.columns) | {n: log.columns[n] / x for n, x in zip(efforts, K, strict=True)}, source)


def test_a_load_that_is_known_fixes_the_scale(bench, loaded):
    """Without noise k and all that motors feel are found; the same logs without the load's word tell no scale."""
    logs = [said(each.log(0, 0.0, 0.0)) for each in (bench, loaded)]
    found = identify(bench.model, logs, motors=True, added=[{}, LOAD])
    np.testing.assert_allclose(found.motors.values, K, rtol=1e-6)
    np.testing.assert_allclose(found.values, found.stated, rtol=1e-6, atol=1e-6 * np.abs(found.stated).max())
    assert found.added == ({}, LOAD)
    with pytest.raises(InvalidInputError, match="nothing fixes the scale of joint1, joint2"):
        identify(bench.model, logs[:1], motors=True)


def same(bench, heavier, log, **asked):
    """Estimates with the load as added, and as part of the description: one is the other."""
    one, other = identify(bench.model, log, added=[LOAD], **asked), identify(heavier, log, **asked)
    values = bench.model.parameters.plus(LOAD).values - bench.model.parameters.values
    np.testing.assert_allclose(one.multiples, other.multiples, atol=1e-8)
    size = other.deviations
    np.testing.assert_allclose(one.values / size, (other.values - other.multiples @ values) / size, atol=1e-4)
    np.testing.assert_allclose(
        one.covariance / np.outer(size, size), other.covariance / np.outer(size, size), atol=1e-6
    )
    np.testing.assert_allclose(one.held_out[2].stated, other.held_out[2].stated, rtol=1e-6)
    np.testing.assert_allclose(one.held_out[2].found, other.held_out[2].found, rtol=1e-6)
    assert one.delays[0].seconds == pytest.approx(other.delays[0].seconds, rel=1e-4)
    return one, other, values


def test_constants_that_are_added_are_a_description_with_them(bench, heavier, loaded):
    one, other, _ = same(bench, heavier, loaded.log(1), kinds=("inertia", "friction", "damping"), align=True)
    told, stated = explained(bench.model, one.parameters.plus(LOAD), loaded.log(1)), other.parameters
    np.testing.assert_allclose(told.told, explained(heavier, stated, loaded.log(1)).told, atol=1e-6)


@pytest.mark.slow
def test_so_they_are_with_motors_stribecks_friction_and_by_simulated_motions(bench, heavier, loaded):
    one, other, _ = same(bench, heavier, said(loaded.log(2)), motors="10 %", stribeck=["joint3"])
    np.testing.assert_allclose(one.motors.values, other.motors.values, rtol=1e-6)
    one, other, values = same(bench, heavier, loaded.log(3), kinds=("friction", "damping"))
    by_motion, of_heavier = one.refined(bench.model, loaded.log(3)), other.refined(heavier, loaded.log(3))
    np.testing.assert_allclose(by_motion.missed, of_heavier.missed, rtol=1e-6)
    np.testing.assert_allclose(by_motion.values, of_heavier.values - other.multiples @ values, rtol=1e-4)


@pytest.mark.slow
def test_of_two_logs_each_has_its_own_load_in_simulated_motions(bench, loaded):
    logs = [bench.log(4), loaded.log(5)]
    estimate = identify(bench.model, logs, added=[{}, LOAD])
    found = estimate.refined(bench.model, logs)
    assert (found.missed[1] < 2.0 * found.missed[0]).all()
    assert np.abs((found.values - estimate.stated) / found.deviations).max() < 5.0


@pytest.mark.parametrize(
    ("added", "words"),
    [
        ([{}], "1 of 2 logs are told of"),
        ([{}, {"mass:arm": 1.0}], "'mass:arm' is no constant; "),
        ([{}, {"mass:link3": "heavy"}], "added: 'mass:link3'"),
        (0.5, "added"),
        ([{}, "mass"], "added"),
    ],
)
def test_what_is_no_load_is_refused(bench, added, words):
    with pytest.raises(InvalidInputError, match=words):
        identify(bench.model, [bench.log(0), bench.log(1)], added=added)


def test_the_command_takes_a_load(bench, loaded, tmp_path, capsys):
    paths = [str(tmp_path / name) for name in ("empty.csv", "loaded.csv")]
    for each, path in zip((bench, loaded), paths, strict=True):
        said(each.log(6)).save(path)
    load = [f"{name}={value!r}" for name, value in LOAD.items()]
    asked = ["identify", "rpdr", "--logs", *paths, "--motors", "--added"]
    assert main([*asked, paths[1], *load[:4], "--added", paths[1], *load[4:], "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert all(abs(each["k"] - k) < 4.0 * each["deviation"] for each, k in zip(told["motors"], K, strict=True))
    assert told["added"] == [{}, LOAD]
    assert main([*asked, "heavy.csv", *load]) == 1
    assert "'heavy.csv' is none of --logs" in capsys.readouterr().err


@pytest.mark.slow
def test_the_page_tells_of_a_load(bench, loaded, tmp_path, capsys):
    pytest.importorskip("cvxpy")
    path, page = tmp_path / "loaded.csv", tmp_path / "page.html"
    loaded.log(7).save(path)
    load = [f"{name}={value!r}" for name, value in LOAD.items()]
    assert main(["identify", "rpdr", "--logs", str(path), "--report", str(page), "--added", str(path), *load]) == 0
    assert f"in {path} 0.4 was added to mass:link3" in capsys.readouterr().out
    assert "What was added" in page.read_text(encoding="utf-8")
