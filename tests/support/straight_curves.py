"""Curves that are straight lines and circles: G = (θ₂, w − 1) over (θ₁, θ₂, w), θ₁ an angle, so that all is known."""

from types import SimpleNamespace

import numpy as np

from ccpin.proof.curves import tubes as module
from ccpin.proof.curves.curve_equations import Drift, Values
from ccpin.proof.curves.tubes import Stated, glued, proved_again

PROBLEM = SimpleNamespace(system=SimpleNamespace(n_free=2, m=1, periodic=np.array([True, False])))


def values(problem, theta, kernel, pairing):
    """Its zeros are θ₂ = 0, w = 1, any θ₁."""
    count = len(theta)
    slope = np.tile(np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), (count, 1, 1))
    value = np.concatenate([theta[:, 1:], kernel - 1.0], axis=1)
    return Values(theta, kernel, pairing, value, slope, np.zeros((count, 2, 3, 3)), None, np.zeros(count))


def straighten(monkeypatch, *others):
    """Tubes, and what other modules ask for values, are of these equations."""
    for place in (module, *others):
        monkeypatch.setattr(place, "values_at", values)
    monkeypatch.setattr(module, "first_order", lambda *given: (values(*given).value,))
    monkeypatch.setattr(module, "rounding_at", lambda problem, theta, *_: np.zeros(len(theta)))
    monkeypatch.setattr(module, "drift", lambda problem, at, box: Drift(*np.zeros((2, len(box), 2))))


def tubes(*pieces, way=1.0, pairing=1.0, radius=0.1):
    """Proved tubes about |θ₁ − c| ≤ h."""
    c, h = np.array(pieces, dtype=float).T
    count = len(c)
    given = Stated(
        theta=np.stack([c, np.zeros(count)], axis=1),
        kernel=np.ones((count, 1)),
        pairing=np.full((count, 1), pairing),
        along=np.zeros(count, dtype=np.intp),
        tangent=np.tile([way, 0.0, 0.0], (count, 1)),
        half=h,
        radius=np.tile([0.0, radius, radius], (count, 1)),
    )
    found = proved_again(PROBLEM, given)
    assert found.proved.all()
    return found.tubes


def is_chain(one):
    """Whether it is what it says: glued from each tube to the next, and from the last to the first."""
    count = len(one.tubes.half)
    pairs = [(k, k + 1) for k in range(count - 1)] + [(count - 1, 0)] * one.closed
    each = [one.tubes.take(np.array([k])) for k in range(count)]
    return all(bool(glued(PROBLEM, each[a], each[b])[0]) for a, b in pairs)
