"""Tracking laws with an error of σ that does its worst."""

import numpy as np

from ccpin.control import ControlLaw
from ccpin.dynamics.state import State

_STEP = 1e-6  # rad, m: of central differences


def dependent_rows(model):
    """Which entries of q̇′ (all of scalar joints) belong to dependent coordinates."""
    return np.flatnonzero(~np.abs(model.coordinates.jacobian(model.mechanism.q_reference)).max(axis=0).astype(bool))


class WithWrongSigma(ControlLaw):
    """A tracking law at σ(q) + δ with δ = error(t, state, v) in the dependent coordinates."""

    def __init__(self, law, error):
        self.law, self.error, self.rows = law, error, dependent_rows(law.model)

    def torque(self, t, state, v):
        return efforts(self.law, self.rows, t, state, v, self.error(t, state, v))

    def next_switch(self, t):
        return self.law.next_switch(t)


def efforts(law, rows, t, state, v, delta):
    """The law's efforts with its terms at σ(q) + δ."""
    wrong = state.q_free.copy()
    wrong[rows] += delta
    return law.torque_with(t, state.q, v, State.of(law.model, state.q, law.model.parametrization.at(wrong)))


def pushing(law, size, direction):
    """The δ of a size that accelerates e along a direction most, by central differences of the law's efforts."""
    rows = dependent_rows(law.model)

    def error(t, state, v):
        steps = _STEP * np.eye(len(rows))
        slope = [efforts(law, rows, t, state, v, d) - efforts(law, rows, t, state, v, -d) for d in steps]
        pull = -np.array(slope) @ np.linalg.solve(state.D, direction)
        return size * pull / max(np.linalg.norm(pull), 1e-300)

    return error


def switching(law, size, seed, hold=5e-3):
    """A δ of a size that points somewhere else every `hold` seconds."""
    directions = np.random.default_rng(seed).normal(size=(1000, len(dependent_rows(law.model))))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    return lambda t, state, v: size * directions[int(t / hold) % 1000]
