"""Coordinates that follow a motion: passive runs go on through singularities of the coordinates they were started in."""

from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import ccpin
from ccpin import native
from ccpin.control import PDSimpleGravity
from ccpin.control.sampling import Sampling
from ccpin.description.mjcf.reader import read_mjcf
from ccpin.mechanism.siblings import LEVERAGE, Measure, _swapped, best_independent, with_independent
from ccpin.simulation import closure_forces_at
from tests.oracles import descriptor
from tests.support import linkages
from tests.support.agreement import reference_model
from tests.support.places import SHARED

TIGHT = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-13, "sample_period": 0.01}
OTHERS = pytest.mark.skipif(not SHARED.is_dir(), reason=f"no {SHARED}: these files belong to others")
SPRINGS = {f"leg{k}_extension": {"stiffness": 500.0, "spring_reference": 0.05} for k in range(1, 7)}


def five_bar():
    """MJCF, two motors, thrown; its motors' angles end where the distal links stretch."""
    return ccpin.ReducedModel(ccpin.load(read_mjcf(linkages.FIVE_BAR.encode(), None))), np.array([4.0, -3.0])


def rssr():
    """Measured by its rocker, which swings to and fro while the crank goes round, and by the rod's spin."""
    mechanism = ccpin.load(linkages.rssr(), independent=["rocker", "ball:rx"], free=["ball"])
    return ccpin.ReducedModel(mechanism, gravity=(0.0, -9.81, 0.0)), np.array([1.0, 0.5])


def stewart():
    """On springs, pushed off; measured by its legs' lengths."""
    mechanism = ccpin.load(linkages.stewart_on_balls(), joints=SPRINGS)
    return ccpin.ReducedModel(mechanism), np.array([0.5, -0.4, 0.3, 0.2, -0.6, 0.1])


def cassie():
    """Two closed loops of a leg, let go, its rods free to spin."""
    mechanism = ccpin.load(SHARED / "cassie_like", free=ccpin.load(SHARED / "cassie_like").locked)
    return ccpin.ReducedModel(mechanism), np.zeros(mechanism.n)


def gepettos_five_bar():
    """Another's five-bar; it swings within its coordinates."""
    mechanism = ccpin.load(SHARED / "5bar_linkage_iso3d")
    return ccpin.ReducedModel(mechanism), np.zeros(mechanism.n)


def strandbeest():
    """A pair of legs measured by a foot's bar, adrift and tumbling without weight, its crank turning."""
    mechanism = ccpin.load(linkages.strandbeest(), floating_base=True, independent=["root_joint", "Pl_base_bl"])
    v = np.array([0.1, 0.0, -0.2, 0.3, 0.5, 0.2, 2.0])
    return ccpin.ReducedModel(mechanism, gravity=(0.0, 0.0, 0.0)), v


CASES = {
    "five-bar": five_bar,
    "RSSR": rssr,
    "Stewart": stewart,
    "cassie_like": cassie,
    "5bar_linkage_iso3d": gepettos_five_bar,
    "strandbeest": strandbeest,
}
EVERY = [pytest.param(name, marks=OTHERS) if name in ("cassie_like", "5bar_linkage_iso3d") else name for name in CASES]
ENDING = [case for case in EVERY if case != "strandbeest" and getattr(case, "values", "") != ("5bar_linkage_iso3d",)]
every_case = pytest.mark.parametrize("name", EVERY)


@cache
def case(name):
    return CASES[name]()


def released(name, duration, **options):
    model, v = case(name)
    q = model.alpha(model.mechanism.q_reference)
    return model, ccpin.simulate(model, None, q, v, duration=duration, **(TIGHT | options))


def energies(model, run):
    """Kinetic and potential energy at every sample, of the free system."""
    return np.array([model.free_system.energy(*at) for at in zip(run.q_free, run.v_free, strict=True)]).T


def assert_it_goes_on(model, run, duration):
    """To the end, closed, and without losing or gaining energy."""
    kinetic, potential = energies(model, run)
    total = kinetic + potential
    assert (run.status, run.t[-1]) == ("finished", pytest.approx(duration))
    assert run.closure_error.max() <= 1e-10
    assert np.abs(total - total[0]).max() <= 1e-6 * kinetic.max()


@every_case
def test_a_passive_motion_goes_on(name):
    """Two seconds: closed to 1e-10, energy kept to 1e-6 of the largest kinetic energy."""
    model, run = released(name, 2.0)
    assert_it_goes_on(model, run, 2.0)


@pytest.mark.slow
@every_case
def test_a_passive_motion_goes_on_for_a_minute(name):
    """Sixty seconds likewise."""
    model, run = released(name, 60.0)
    assert_it_goes_on(model, run, 60.0)
