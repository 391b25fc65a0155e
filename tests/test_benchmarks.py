"""Every part of the benchmarks runs at its smallest and says what it should; no timing is judged here."""

import json
import os
from functools import cache
from importlib import import_module
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import ccpin
from benchmarks.__main__ import PARTS, main
from benchmarks.measured import NATIVE, NUMPY, Measured, Options
from benchmarks.page import page
from benchmarks.parts import memory, models, simulated
from benchmarks.peers import NotForThisError, codac, drake
from benchmarks.peers.mujoco import MuJoCo
from benchmarks.peers.pinocchio import Pinocchio
from benchmarks.subjects import backend, difference, model_on, place
from benchmarks.table import table
from benchmarks.targets import TARGETS, verdicts
from benchmarks.timing import exponent, in_turn
from tests.oracles import rpdr as oracle
from tests.support.paper import GOAL, K_P, K_V, START, to_paper
from tests.support.places import ROOT

SMALLEST = Options.smallest()
UNITS = {"s", "MB", "rad", "m", ""}
MODELS = ("rpdr", "delta", "stewart")


@cache
def measured(part):
    return list(import_module(f"benchmarks.parts.{part}").measure(SMALLEST))


LONG = ("enclosures", "simulated", "memory")


@pytest.mark.parametrize("part", [pytest.param(p, marks=pytest.mark.slow) if p in LONG else p for p in PARTS])
def test_each_part_measures(part):
    """Every figure is of its part, a finite number or absent with a reason, and no figure is given twice."""
    figures = measured(part)
    assert figures
    assert len({each[:4] for each in figures}) == len(figures)
    for each in figures:
        assert each.part == part
        assert each.unit in UNITS
        assert np.isfinite(each.value) if each.value is not None else each.note, each
        assert each.ratio is None or each.ratio > 0
    assert all(each.subject in table(figures) for each in figures)


def test_the_command_writes_what_it_measured(tmp_path, capsys):
    """A table, JSON that reads back to the same table, a picture and a page, and every target."""
    files = {name: tmp_path / f"found.{name}" for name in ("json", "png", "md")}
    main(["walks", "load", "--smallest", "--check", "--json", str(files["json"])])
    first = capsys.readouterr().out
    assert "== walks" in first
    assert all(target.what in first for target in TARGETS)
    main(["--read", str(files["json"]), "--check", "--figure", str(files["png"]), "--page", str(files["md"])])
    assert capsys.readouterr().out == first
    assert files["png"].read_bytes().startswith(b"\x89PNG")
    assert "## walks" in files["md"].read_text(encoding="utf-8")
    assert set(json.loads(files["json"].read_text(encoding="utf-8"))) == {"machine", "figures"}


def test_the_page_is_of_its_figures():
    """docs/benchmarks.md is what the figures beside it say."""
    found = json.loads((ROOT / "docs/benchmarks.json").read_text(encoding="utf-8"))
    figures = [Measured(**each) for each in found["figures"]]
    assert page(figures, found["machine"]) == (ROOT / "docs/benchmarks.md").read_text(encoding="utf-8")


def test_a_file_that_is_not_there_is_skipped_with_a_word():
    """Other people's models may be absent."""
    (figure,) = models.measure(SMALLEST._replace(models=("no/such/file",)))
    assert (figure.subject, figure.value, figure.note) == ("file", None, "skipped: no such file")


def test_an_absent_peer_is_skipped_with_a_word(monkeypatch):
    """Without Drake the step has no figure of its."""
    monkeypatch.setattr(drake, "drake_plant", None)
    mechanism = ccpin.load("rpdr")
    with pytest.raises(NotForThisError, match="pip install drake"):
        drake.Drake(mechanism, place(model_on(NUMPY, mechanism)))


@pytest.mark.parametrize("name", MODELS)
def test_mujoco_has_the_same_mechanism(name):
    """The MJCF's joint-space inertia and bias forces are Pinocchio's of the free system."""
    mechanism = ccpin.load(name)
    at = place(model_on(NUMPY, mechanism))
    peer, data = MuJoCo(mechanism, at), mechanism.pin_model.createData()
    peer.forward()
    inertia = np.zeros((mechanism.n_free, mechanism.n_free))
    mujoco.mj_fullM(peer.model, peer.data, inertia)
    assert difference(inertia, pin.crba(mechanism.pin_model, data, at.q_free)) < 1e-12
    assert difference(peer.data.qfrc_bias, pin.nle(mechanism.pin_model, data, at.q_free, at.v_free)) < 1e-12
    assert np.abs(peer.data.efc_pos).max() < 1e-9  # its loops are closed where ours are


@pytest.mark.parametrize("name", MODELS)
def test_drake_has_the_same_mechanism(name):
    """So is Drake's, where it is installed."""
    pytest.importorskip("pydrake")
    mechanism = ccpin.load(name)
    at = place(model_on(NUMPY, mechanism))
    peer, data = drake.Drake(mechanism, at), mechanism.pin_model.createData()
    peer.step()
    plant, context = peer.plant, peer.context
    assert difference(plant.CalcMassMatrix(context), pin.crba(mechanism.pin_model, data, at.q_free)) < 1e-12
    bias = plant.CalcBiasTerm(context) - plant.CalcGravityGeneralizedForces(context)
    assert difference(bias, pin.nle(mechanism.pin_model, data, at.q_free, at.v_free)) < 1e-12


@pytest.mark.parametrize("name", MODELS)
def test_pinocchio_is_asked_accurately(name):
    """The settings chosen for Pinocchio give the reduced model's acceleration."""
    mechanism = ccpin.load(name)
    at = place(model_on(NUMPY, mechanism))
    peer = Pinocchio(mechanism, at)
    peer.prepare_lcaba()
    peer.lcaba()
    assert difference(peer.acceleration(), at.a_free) < 1e-9  # also after lcaba, which has memory of its own
    assert difference(peer.lcaba(), at.a_free) < 1e-5


@pytest.mark.slow
def test_mujoco_runs_the_same_move():
    """Against the closed forms, sure of themselves: ccpin is near them, and MuJoCo as near as its step lets it."""
    figures = measured(simulated.PART)
    errors = {each.who: each.value for each in figures if each.quantity == simulated.ERROR}
    assert errors[simulated.REFERENCE] < 1e-12
    assert errors[f"{NUMPY}, RK45"] < 1e-8
    assert errors[simulated.RK4(1e-3)] < 1e-5


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="memory is measured on Linux")
@pytest.mark.slow
def test_memory_is_the_new_process_own():
    """What this process holds does not count, and what the new one held does, once it is given back too."""
    ballast = np.ones(100_000_000)  # 800 MB
    nothing = memory.peak("", NUMPY)
    assert nothing < ballast.nbytes / 1e6
    assert memory.peak("np.ones(25_000_000); ", NUMPY) - nothing > 150


def test_the_backend_is_put_back(monkeypatch):
    """What CCPIN_BACKEND says outside is not changed."""
    monkeypatch.setenv("CCPIN_BACKEND", "numpy")
    with backend(NATIVE):
        pass
    assert ccpin.backend().name == "numpy"
    monkeypatch.delenv("CCPIN_BACKEND")
    with backend("numpy"):
        assert ccpin.backend().name == "numpy"
    assert "CCPIN_BACKEND" not in os.environ


def test_a_verdict_names_all_that_miss():
    """The worst figure is shown, and every one beyond the limit; without figures there is no verdict."""
    target = next(each for each in TARGETS if each.what.startswith("q̈"))
    figures = [
        Measured(models.PART, name, models.ACCELERATION, NATIVE, 1e-6, "s", ratio)
        for name, ratio in (("a", 0.5), ("b", 0.7), ("c", 0.8))
    ]
    assert verdicts(figures)[0] == (target, False, "0.80", "b 0.70, c 0.80")
    assert verdicts(figures[:1])[0] == (target, True, "0.50", "a")
    assert all(each.met is None for each in verdicts([]))


def test_calls_are_timed_in_turn():
    """Each call comes once a round in the order given, and a power law's exponent is found."""
    seen = []
    times = in_turn({key: lambda k=key: seen.append(k) for key in "ab"}, 3, 0.0)
    assert "".join(seen[-6:]) == "ababab"
    assert times["a"].ratio(times["a"]) == 1.0
    assert exponent([1, 2, 4], [3.0, 12.0, 48.0]) == pytest.approx(2.0)


def test_codac_has_the_closed_loop(rpdr_model):
    """The equation that Codac gets is the reduced model's under the law."""
    pytest.importorskip("codac")
    from codac import IntervalVector

    law = ccpin.control.PDSimpleGravity(rpdr_model, GOAL, K_P, K_V)
    f, rng = codac.closed_loop(codac.Law(K_P, K_V, GOAL, rpdr_model.at(GOAL).g)), np.random.default_rng(3)
    for q in START + rng.uniform(-0.2, 0.2, (5, 2)):
        v, state = rng.normal(size=2), rpdr_model.at(q)
        paper = to_paper(rpdr_model.mechanism, state.q_free)
        found = np.ravel(f.eval(IntervalVector([*map(float, [*q, *(paper[:2] + paper[2:]), *v])])).mid())
        far = (oracle.rho(paper)[:2] + oracle.rho(paper)[2:]) @ v
        expected = [*v, *far, *state.forward_dynamics(v, law.torque(0.0, state, v))]
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-10)
