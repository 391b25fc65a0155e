"""An RPDR with friction, moved by sines, and what its encoders and drives would tell."""

from typing import NamedTuple

import numpy as np
import pytest

import ccpin
from ccpin.identification import Log

JOINTS = ("joint1", "joint2", "joint3", "joint4")
ENCODER = 2.0 * np.pi / 2**19


class Bench(NamedTuple):
    """A robot, its motion and the efforts that take it there."""

    model: ccpin.ReducedModel
    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    tau: np.ndarray

    def log(self, seed, effort=0.02, encoder=ENCODER):
        draw = np.random.default_rng(seed)
        columns = {f"q_joint{k + 1}": self.q[:, k] + encoder * draw.normal(size=len(self.t)) for k in range(2)}
        size = effort * np.sqrt((self.tau**2).mean(axis=0))
        columns |= {f"u_joint{k + 1}": self.tau[:, k] + size[k] * draw.normal(size=len(self.t)) for k in range(2)}
        return Log(self.t, columns)


@pytest.fixture(scope="session")
def bench():
    """Efforts are the inverse dynamics' and friction's own, not the regressor's."""
    stated = {name: {"friction": 0.02, "damping": 0.01} for name in JOINTS}
    model = ccpin.ReducedModel(ccpin.load("rpdr", joints=stated))
    t = np.arange(0.0, 4.0, 4e-3)
    w = 2.0 * np.pi * np.array([[0.5, 1.25], [0.75, 1.5]])
    size = np.array([[0.2, 0.08], [0.15, 0.09]])
    angle = t[:, None, None] * w + np.array([[0.0, 1.0], [2.0, 3.0]])
    q = model.alpha(model.mechanism.q_reference) + (size * np.sin(angle)).sum(axis=2)
    v, a = (size * w * np.cos(angle)).sum(axis=2), -(size * w**2 * np.sin(angle)).sum(axis=2)
    terms = model.terms_many(q, v)
    rates = np.einsum("sij,sj->si", terms.rho, v)
    rubbing = np.einsum("sij,si->sj", terms.rho, 0.02 * np.sign(rates))
    return Bench(model, t, q, v, a, model.inverse_dynamics_many(q, v, a) + rubbing)
