"""Stribeck's friction from logs: columns by their law, speeds found again, and none told where logs tell none."""

import json

import numpy as np
import pytest

import ccpin
from ccpin.cli import main
from ccpin.description.formats import write_description
from ccpin.dynamics.changed_constants import with_stribeck_speeds
from ccpin.errors import InvalidInputError
from ccpin.identification import base_parameters, consistent, explained, identify, with_constants

TRUE = {
    "joint1": (0.02, 0.03, 0.2),
    "joint2": (0.02, 0.035, 0.3),
    "joint3": (0.02, 0.04, 0.4),
    "joint4": (0.02, 0.045, 0.5),
}
JOINTS = tuple(TRUE)


def stribeck_log(bench, seed, effort=0.02, encoder=1e-5, joints=JOINTS):
    """The bench's motion, and efforts of friction by its law in these joints, Coulomb's in the others."""
    terms = bench.model.terms_many(bench.q, bench.v)
    rates = np.einsum("sij,sj->si", terms.rho, bench.v)
    more = np.zeros_like(rates)
    for k, name in enumerate(bench.model.mechanism.joints.names):
        c, s, v_s = TRUE[name]
        more[:, k] = (s - c) * np.exp(-((rates[:, k] / v_s) ** 2)) * np.sign(rates[:, k]) * (name in joints)
    return bench._replace(tau=bench.tau + np.einsum("sij,si->sj", terms.rho, more)).log(seed, effort, encoder)


@pytest.fixture(scope="module")
def found(bench):
    """What a model that knows of no friction learns."""
    return identify(ccpin.load("rpdr"), stribeck_log(bench, 0), stribeck=True)


def test_columns_are_the_laws(bench):
    """Y π with stated levels and speeds is inverse dynamics and friction by its law; other kinds are as without."""
    stated = {name: {"friction": c, "breakaway": s, "stribeck_speed": w} for name, (c, s, w) in TRUE.items()}
    model = ccpin.ReducedModel(ccpin.load("rpdr", joints=stated))
    assert len(model.parameters) == len(bench.model.parameters) + 4
    state = model.at(model.alpha(model.mechanism.q_reference))
    v, a = np.array([0.2, -0.15]), np.array([3.0, 2.0])
    c, s, v_s = np.array([TRUE[name] for name in model.mechanism.joints.names]).T
    rates = state.v_free(v)
    friction = (c + (s - c) * np.exp(-((rates / v_s) ** 2))) * np.sign(rates)
    wanted = state.tau(v, a) + state.rho.T @ friction
    assert state.regressor(v, a) @ model.parameters.values == pytest.approx(wanted, abs=1e-12)
    assert state.energy_regressor(v) @ model.parameters.values == pytest.approx(sum(state.energy(v)), abs=1e-12)


@pytest.mark.slow
def test_levels_and_speeds_are_found_without_noise(bench):
    clean = identify(ccpin.load("rpdr"), stribeck_log(bench, 0, effort=1e-6, encoder=1e-9), stribeck=True)
    for each in clean.stribeck:
        assert each.reason == ""
        assert each.values == pytest.approx(TRUE[each.joint], rel=1e-3)


def test_levels_and_speeds_are_found(bench, found):
    """Within four deviations, in intervals; unseen samples are missed by less than with Coulomb's friction alone."""
    assert [each.joint for each in found.stribeck] == [j.name for j in bench.model.mechanism.tree.joints]
    for each in found.stribeck:
        assert np.abs((each.values - TRUE[each.joint]) / each.deviations).max() < 4.0
        low, high = each.interval
        assert low < each.values[2] < high
        assert high - low == pytest.approx(2.0 * 1.96 * each.deviations[2], rel=0.3)
        assert each.gain > each.due
    for each in found.held_out:
        assert (each.found < 0.8 * each.coulomb).all()
        assert (each.coulomb < each.stated).all()
    assert "speed:joint4" in found.table()


def test_the_band_is_that_of_drawn_levels(found):
    """Standard deviation of the curve at some speeds, from draws of its three numbers."""
    one = found.stribeck[3]
    c, s, v_s = np.random.default_rng(0).multivariate_normal(one.values, one.covariance, 20000).T[..., None]
    speed = np.array([0.05, 0.3, 0.6, 1.5])
    drawn = c + (s - c) * np.exp(-((speed / v_s) ** 2))
    level, off = one.level(speed)
    np.testing.assert_allclose(level, drawn.mean(axis=0), rtol=1e-2)
    np.testing.assert_allclose(off, drawn.std(axis=0), rtol=5e-2)


def test_a_log_without_the_effect_tells_none(bench):
    """Coulomb's friction, with a reason; the constants are those of an estimate that was not asked for more."""
    log = bench.log(1)
    one, plain = identify(bench.model, log, stribeck=("joint1", "joint3")), identify(bench.model, log)
    assert [each.joint for each in one.stribeck] == ["joint1", "joint3"]
    assert all("no fall of friction with speed" in each.reason for each in one.stribeck)
    assert np.isnan(one.stribeck[0].values).all()
    np.testing.assert_array_equal(one.values, plain.values)
    assert one.model.parameters.names == plain.model.parameters.names
    assert one.held_out[0].coulomb is None
    assert "no Stribeck effect of joint1" in one.table()


@pytest.mark.slow
@pytest.mark.parametrize(("speed", "words"), [(1e-3, "too few samples"), (30.0, "c and s are not told apart")])
def test_speeds_that_logs_do_not_bound_are_told(bench, monkeypatch, speed, words):
    """A joint that falls below its slowest samples, or beyond its fastest, has no speed, whatever it is worth."""
    monkeypatch.setitem(TRUE, "joint4", (0.02, 2.0 if speed < 1.0 else 9.0, speed))
    told = identify(ccpin.load("rpdr"), stribeck_log(bench, 0, joints=("joint4",)), stribeck=("joint4",)).stribeck[0]
    assert words in told.reason or "no fall of friction" in told.reason
    assert np.isnan(told.values).all()


@pytest.mark.slow
def test_what_was_found_is_written_read_and_explains(bench, found, tmp_path):
    """As consistent constants, in a URDF whose model has them, and whose efforts are the log's."""
    pytest.importorskip("cvxpy")
    kept = consistent(found.model, found)
    description = with_constants(found.model, kept)
    write_description(description, tmp_path / "learnt.urdf")
    again = ccpin.ReducedModel(ccpin.load(tmp_path / "learnt.urdf"))
    np.testing.assert_allclose(again.parameters.values, kept.values, rtol=1e-9, atol=1e-12)
    joints = again.mechanism.joints
    assert (joints.breakaway > joints.friction).all()
    assert joints.stribeck_speed == pytest.approx([TRUE[name][2] for name in joints.names], rel=0.3)
    assert (explained(again, again.parameters, stribeck_log(bench, 7)).share < 0.03).all()


@pytest.mark.slow
def test_stated_speeds_are_kept_unless_asked_for(bench):
    """`stribeck:JOINT` is then a constant as others are; without the speeds constants are those of before."""
    stated = {name: {"friction": c, "breakaway": s, "stribeck_speed": w} for name, (c, s, w) in TRUE.items()}
    model = ccpin.ReducedModel(ccpin.load("rpdr", joints=stated))
    told = identify(model, stribeck_log(bench, 3))
    assert told.stribeck == ()
    off = (told.values - told.stated) / told.deviations
    assert np.abs(off[[name.startswith("stribeck") for name in told.combinations]]).max() < 4.0
    bare = with_stribeck_speeds(model, dict.fromkeys(JOINTS, 0.0))
    assert len(bare.parameters) == len(bench.model.parameters)


@pytest.mark.slow
def test_combinations_are_counted_without_it():
    pytest.importorskip("flint")
    rubbing = ccpin.load("rpdr", joints={"joint1": {"friction": 0.1, "breakaway": 0.2, "stribeck_speed": 0.1}})
    assert base_parameters(rubbing).reason == base_parameters(ccpin.load("rpdr")).reason


def test_what_is_no_joint_is_named(bench):
    log = bench.log(0)
    for wrong, words in ((("elbow",), "'elbow' is no joint of one velocity"), (7, "stribeck")):
        with pytest.raises(InvalidInputError, match=words):
            identify(bench.model, log, stribeck=wrong)
    with pytest.raises(InvalidInputError, match="'friction' is not among"):
        identify(bench.model, log, stribeck=True, kinds=("inertia",))


@pytest.mark.slow
def test_the_command_tells_it_and_writes_a_page(bench, tmp_path, capsys):
    pytest.importorskip("cvxpy")
    path, page, out = tmp_path / "run.csv", tmp_path / "page.html", tmp_path / "learnt.urdf"
    stribeck_log(bench, 0).save(path)
    asked = ["identify", "rpdr", "--logs", str(path), "--stribeck", "--report", str(page), "--out", str(out)]
    assert main([*asked, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [each["joint"] for each in told["stribeck"]] == ["joint1", "joint3", "joint2", "joint4"]
    assert told["stribeck"][3]["speed"] == pytest.approx(0.5, rel=0.1)
    assert all(np.less(each["found"], each["coulomb"]).all() for each in told["held_out"])
    assert "Friction that falls with speed" in page.read_text(encoding="utf-8")
    assert 'stribeck_speed="' in out.read_text(encoding="utf-8")
    assert main(["identify", "rpdr", "--logs", str(path), "--stribeck", "joint4"]) == 0
    assert "speed:joint4" in capsys.readouterr().out


@pytest.mark.slow
def test_intervals_of_levels_and_speeds_hold_what_they_say(bench):
    off = []
    for seed in range(60):
        told = identify(ccpin.load("rpdr"), stribeck_log(bench, seed), stribeck=True).stribeck
        off += [(each.values - TRUE[each.joint]) / each.deviations for each in told if not each.reason]
    assert len(off) > 230
    assert (np.abs(off) < 1.96).mean(axis=0) == pytest.approx([0.95] * 3, abs=0.04)
