"""Linkages whose passive motions leave the coordinates they begin in, and how such motions are looked at."""

from functools import cache

import numpy as np
import pytest

import ccpin
from tests.support import linkages
from tests.support.places import SHARED
from tests.support.reading import read_mjcf

TIGHT = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-13, "sample_period": 0.01}
SPRINGS = {f"leg{k}_extension": {"stiffness": 500.0, "spring_reference": 0.05} for k in range(1, 7)}


def five_bar():
    """MJCF, two motors, thrown; its motors' angles end where the distal links stretch."""
    return ccpin.ReducedModel(ccpin.load(read_mjcf(linkages.FIVE_BAR.encode(), None))), np.array([4.0, -3.0])


def hung_bar():
    """MJCF, a double pendulum measured by the height of its pin, which turns back wherever the upper bar is upright."""
    described = read_mjcf(linkages.HUNG_BAR.encode(), None)
    mechanism = ccpin.load(described, independent=["height", "turn"], reference={"swing": 0.3, "turn": 0.1})
    return ccpin.ReducedModel(mechanism), np.zeros(2)


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
    "hung bar": hung_bar,
    "RSSR": rssr,
    "Stewart": stewart,
    "cassie_like": cassie,
    "5bar_linkage_iso3d": gepettos_five_bar,
    "strandbeest": strandbeest,
}
"""By name: the reduced model and its first velocities."""
STRETCHING = np.radians([-108.0, -72.0]), np.array([-8.0, 8.0])
"""A start of the RPDR, q and q̇, from which it stretches its loop."""


@cache
def case(name):
    return CASES[name]()


def released(name, duration, **options):
    model, v = case(name)
    q = model.alpha(model.mechanism.q_reference)
    return model, ccpin.simulate(model, None, q, v, duration=duration, **(TIGHT | options))


def assert_it_goes_on(model, run, duration):
    """To the end, closed, and without losing or gaining energy."""
    kinetic, potential = run.energy(model)
    total = kinetic + potential
    assert (run.status, run.t[-1]) == ("finished", pytest.approx(duration))
    assert run.closure_error.max() <= 1e-10
    assert np.abs(total - total[0]).max() <= 1e-6 * kinetic.max()
