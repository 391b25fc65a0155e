"""A law made for one mechanism and used on another computes with its own: the same as a function that calls it.

``CCPIN_PAIRS=20 pytest -m slow -s tests/simulation/integration/test_nominal_laws.py`` takes as many pairs a law.
"""

import os
import sys
import time

import numpy as np
import pytest

import ccpin
from ccpin import control
from ccpin.control import Measurement, Sampling
from ccpin.control.control_law import Delayed, NoTorque
from ccpin.description import scaled
from tests.support.backends import same_on_both
from tests.support.long_cases import later

PAIRS = int(os.environ.get("CCPIN_PAIRS", "20"))
START, GOAL = np.radians((-118.0, -62.0)), np.radians((-108.0, -72.0))
BOTH = ("PDFullGravity", "ComputedTorque")
TIGHT = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-13}
SEEDS = (1,)  # of other rods too
SHORT, LONG = 0.15, 0.3  # what every run and slow ones simulate [s]


def pair(seed):
    """A nominal model and a plant: other masses, inertias, dampers and gravity; of every second pair other rods."""
    rng = np.random.default_rng(seed)
    description, models = ccpin.load("rpdr").settled(), []
    for _ in range(2):
        factors = {link.name: float(rng.uniform(0.5, 2.0)) for link in description.links}
        lengths = float(rng.uniform(0.98, 1.02)) if seed % 2 else 1.0
        one = scaled(description, masses=factors, lengths=lengths)
        gravity = rng.normal(size=3) * (0, 3.0, 0) + (0, -9.81, 0)
        models.append(ccpin.ReducedModel(ccpin.load(one), gravity=gravity))
    return models


def reference(model):
    return control.PointToPoint(model, START, GOAL, 0.2)


LAWS = {
    "NoTorque": lambda model: NoTorque(model),
    "PDSimpleGravity": lambda model: control.PDSimpleGravity(model, GOAL, 30.0, 3.0),
    "PDFullGravity": lambda model: control.PDFullGravity(model, GOAL, 30.0, 3.0),
    "CoulombCompensation": lambda model: control.CoulombCompensation(
        control.PDFullGravity(model, GOAL, 30.0, 3.0), 0.1
    ),
    "ComputedTorque": lambda model: control.ComputedTorque(model, reference(model), 100.0, 20.0),
    "PDPlus": lambda model: control.PDPlus(model, reference(model), 30.0, 3.0),
    "PDOnlineGravity": lambda model: control.PDOnlineGravity(model, reference(model), 30.0, 3.0),
    "WithSigmaError": lambda model: control.WithSigmaError(
        control.PDPlus(model, reference(model), 30.0, 3.0), [0, 0, 1e-3, 1e-3]
    ),
    "Delayed": lambda model: Delayed(control.PDPlus(model, reference(model), 30.0, 3.0), 0.01),
    "Servos": lambda model: control.Servos(model, [0.1, -0.2]),
}


def as_function(law, breaks):
    return control.TorqueFunction(lambda t, q, v: law.torque(t, Measurement(q), v), switching_times=breaks)


def compare(name, seed, sampling=None, duration=LONG):
    """At every sample the law gives what a function gives; so both motions are one. And how long each took."""
    nominal, plant = pair(seed)
    law = LAWS[name](nominal)
    breaks = sorted({law.next_switch(t) for t in (-1.0, 0.0, 0.1, 0.2)} - {np.inf})
    options = {"duration": duration, "sample_period": 0.01, "sampling": sampling, **TIGHT}
    options |= {} if sampling is None else {"method": "RK45"}  # begins anew at every sample
    began = time.perf_counter()
    found = ccpin.simulate(plant, law, START, **options)
    between = time.perf_counter()
    alone = ccpin.simulate(plant, as_function(law, breaks), START, **options)
    spent = between - began, time.perf_counter() - between
    assert found.status == alone.status == "finished"
    if sampling is None:
        u = np.array([law.torque(t, Measurement(q), v) for t, q, v in zip(found.t, found.q, found.v, strict=True)])
        inside = np.setdiff1d(np.arange(len(u)), np.searchsorted(found.t, breaks))
        np.testing.assert_allclose(found.u[inside], u[inside], rtol=0, atol=1e-12 * (1.0 + np.abs(u).max()))
    np.testing.assert_allclose(found.q, alone.q, rtol=0, atol=1e-9)
    return spent


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[same_on_both] * (name not in ("PDFullGravity", "ComputedTorque"))) for name in LAWS],
)
def test_a_law_computes_with_its_own_model(name):
    """With full gravity and computed torque it was as if they knew the plant."""
    for seed in SEEDS:
        compare(name, seed, duration=SHORT)


@pytest.mark.parametrize(
    "name", ["ComputedTorque", *(pytest.param(name, marks=same_on_both) for name in ("PDFullGravity", "PDPlus"))]
)
@pytest.mark.parametrize("counts", later(None, 4000))
@pytest.mark.parametrize("duration", later(SHORT, LONG))
def test_so_it_does_as_a_sampled_loop(name, counts, duration):
    """With and without encoders."""
    for seed in SEEDS:
        compare(name, seed, Sampling(period=0.001, encoder_counts=counts, velocity_cutoff=200.0), duration)


@pytest.mark.slow
@pytest.mark.parametrize("name", LAWS)
def test_many_pairs(name, capsys):
    """And what a law costs, and the same law as a function."""
    spent = 1e3 * np.array([compare(name, seed) for seed in range(PAIRS)])
    with capsys.disabled():
        sys.stdout.write(f"\n{name}: {spent[:, 0].mean():.2f} ms, as a function {spent[:, 1].mean():.2f} ms")


def test_a_law_that_does_not_know_the_plant_rests_elsewhere():
    """Full gravity compensation of a light model under a heavy plant leaves an error; of the plant's it leaves none."""
    light, heavy = ccpin.ReducedModel(ccpin.load("rpdr")), None
    heavy = ccpin.ReducedModel(ccpin.load(scaled(light.mechanism.settled(), masses=1.3)))
    ends = {}
    for name, model in (("its own", heavy), ("nominal", light)):
        law = control.PDFullGravity(model, GOAL, 30.0, 3.0)
        ends[name] = ccpin.simulate(heavy, law, GOAL, duration=4.0, sample_period=0.5).q[-1]
    np.testing.assert_allclose(ends["its own"], GOAL, atol=1e-9)
    rest = 30.0 * (GOAL - ends["nominal"])  # K_p q̃ = g_plant − g_law there
    there = [model.at(ends["nominal"]).g for model in (heavy, light)]
    np.testing.assert_allclose(rest, there[0] - there[1], atol=1e-4)
    assert np.abs(ends["nominal"] - GOAL).max() > 1e-3


class Halved(control.PDFullGravity):
    """A law of a user's own that changes what another one says."""

    def torque(self, t, state, v):
        """Half of it."""
        return 0.5 * super().torque(t, state, v)


@pytest.mark.parametrize("wrapped", [False, True])
@pytest.mark.parametrize("sampling", [None, Sampling(period=0.001)])
def test_an_overridden_torque_is_what_acts(rpdr_model, wrapped, sampling):
    """It was ignored where the simulation asked another method."""
    law = Halved(rpdr_model, GOAL, 30.0, 3.0)
    used = control.CoulombCompensation(law, 0.0) if wrapped else law
    options = {"duration": 0.05, "sample_period": 0.01, "sampling": sampling, "max_step": 0.01}
    found = ccpin.simulate(rpdr_model, used, START, **options)
    wanted = ccpin.simulate(rpdr_model, as_function(law, ()), START, **options)
    np.testing.assert_allclose(found.q, wanted.q, rtol=0, atol=1e-12)
    unhalved = control.PDFullGravity(rpdr_model, GOAL, 30.0, 3.0).torque(0.0, rpdr_model.at(START), np.zeros(2))
    assert np.abs(found.u[0] - unhalved).max() > 0.1


def test_an_overridden_torque_of_one_law_alone_is_what_acts(rpdr_model):
    """Bound to the instance rather than its class."""
    law = control.PDFullGravity(rpdr_model, GOAL, 30.0, 3.0)
    law.torque = lambda t, state, v: np.zeros(2)
    assert not ccpin.simulate(rpdr_model, law, START, duration=0.01).u.any()


@pytest.mark.skipif(ccpin.backend().name != "native", reason="the compiled core is what is asked")
def test_the_core_takes_a_law_of_another_model():
    """It was left to the reference, 44 times slower."""
    nominal, plant = pair(0)
    law = LAWS["ComputedTorque"](nominal)
    run = ccpin.Simulator(plant, law)
    run.reset(START)
    assert run._run_in_core(np.linspace(0.0, 0.3, 31), None, None) is not None
