"""Laws along references whose tracking is certified, and the test that a motion is within the bound."""

from functools import lru_cache

import numpy as np

import ccpin
from ccpin.control import ComputedTorque, PDPlus, PointToPoint
from tests.support.paper import GOAL, START

MOVES = {"rpdr": (START, GOAL, 0.3), "delta": (np.array([-0.2, 0.1, 0.0]), np.array([0.1, 0.0, 0.1]), 0.3)}
GAINS = {
    ("rpdr", ComputedTorque): (400.0, 40.0),
    ("rpdr", PDPlus): (11.0, 0.65),
    ("delta", ComputedTorque): (400.0, 40.0),
    ("delta", PDPlus): (300.0, 25.0),
}
LAWS = (ComputedTorque, PDPlus)
RUN = {"duration": 0.45, "rtol": 1e-5, "atol": 1e-10, "sample_period": 4e-3}


@lru_cache
def model_of(name):
    return ccpin.ReducedModel(ccpin.load(name))


def law_for(law_class, name="rpdr", reference=None):
    model = model_of(name)
    reference = reference or PointToPoint(model, *MOVES[name])
    K_p, K_v = GAINS[name, law_class]
    return law_class(model, reference, [K_p] * model.n, [K_v] * model.n)


def errors_of(law, motion):
    """t and e along a motion."""
    return motion.t, np.array([law.error(t, q) for t, q in zip(motion.t, motion.q, strict=True)])


def assert_within(proof, law, motion):
    """Every sample's error is within the bound of its cell."""
    t, e = errors_of(law, motion)
    cell = np.clip(np.searchsorted(proof.times, t, side="right") - 1, 0, len(proof.errors) - 1)
    assert motion.status == "finished"
    assert np.all(np.abs(e) <= proof.errors[cell] + 1e-9)
    return np.abs(e).max(axis=0)
