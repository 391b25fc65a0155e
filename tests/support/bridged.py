"""Programs of models with all derivatives, and closed states by the numbers that programs take."""

from functools import cache
from itertools import islice

import numpy as np

import ccpin
from ccpin import programs
from tests.support.closed import closed_near
from tests.support.places import ROOT

CASES = {
    "rpdr": lambda: ccpin.load("rpdr"),
    "planar_3rrr": lambda: ccpin.load("planar_3rrr"),
    "ankle": lambda: ccpin.load(ROOT / "docs/howto/ankle.urdf"),
    "slider_crank with springs": lambda: ccpin.load(
        "slider_crank", joints={"crank": {"stiffness": 2.0, "spring_reference": 0.3}}
    ),
    "delta": lambda: ccpin.load("delta"),
}


@cache
def model(name):
    return ccpin.ReducedModel(CASES[name]())


@cache
def recorded(name, what=("forward_dynamics",), given="closed"):
    return programs.record(model(name), what, given=given, derivatives=("q", "v", "u"))


def states_of(reduced, count=4, seed=0, spread=0.1):
    """Closed states near the reference, and the inputs q, y, v, u of each, row by row."""
    rng, found, rows = np.random.default_rng(seed), [], []
    for state in islice(closed_near(reduced, rng, spread), count):
        numbers = programs.configuration(state)
        v, u = rng.normal(size=reduced.n), rng.normal(size=reduced.n_actuated)
        found.append(state)
        rows.append((numbers["q"], numbers["y"], v, u))
    return found, [np.array(column) for column in zip(*rows, strict=True)]


def close(found, expected, tolerance=1e-12):
    expected = np.asarray(expected)
    scale = max(1.0, float(np.abs(expected).max(initial=0.0)))
    np.testing.assert_allclose(np.asarray(found), expected, rtol=0.0, atol=tolerance * scale)
