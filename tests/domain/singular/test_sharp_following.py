"""Curves followed on a circle: each tube glued to the next, both ways, until it closes or is not wanted."""

import numpy as np
import pytest

from ccpin.domain.singular import following as module
from ccpin.domain.singular.following import TubeChain, follow, prolonged
from ccpin.proof.curves.tubes import glued
from tests.support.straight_curves import PROBLEM, is_chain, straighten, tubes

HALF = 0.4


@pytest.fixture(autouse=True)
def _straight(monkeypatch):
    """Tubes of one length are proved about every point."""
    straighten(monkeypatch, module)

    def about(problem, theta, kernel, sizes, forward):
        way = 1.0 if forward is None or forward[0] > 0.0 else -1.0
        return tubes((theta[0], HALF), way=way)

    monkeypatch.setattr(module, "_tube_at", about)
    monkeypatch.setattr(module, "onto_curves", lambda problem, theta, kernel, steps: (theta, kernel, np.array([True])))


def within(low, high):
    return lambda tube: bool(low <= tube.theta[0, 0] <= high)


def test_a_curve_is_followed_both_ways():
    """Until it is not wanted beyond a tube; s grows along all of them."""
    found = follow(PROBLEM, np.zeros(2), np.ones(1), within(-1.0, 1.6))
    assert not found.closed
    assert is_chain(found)
    middles = found.tubes.theta[:, 0]
    assert np.all(np.diff(middles) > 0.0)
    assert middles[0] < -1.0 <= middles[1]
    assert middles[-2] <= 1.6 < middles[-1]
    assert np.all(found.tubes.tangent[:, 0] == 1.0)


def test_a_curve_that_returns_is_closed():
    found = follow(PROBLEM, np.zeros(2), np.ones(1), lambda tube: True)
    assert found.closed
    assert is_chain(found)
    assert 2 * np.pi - HALF < found.tubes.theta[-1, 0] < 2 * np.pi


def test_a_curve_that_is_not_proved_to_return_is_open(monkeypatch):
    """Its last tubes hold where it began, and are not glued to that."""

    def here(problem, one, other):
        return glued(problem, one, other) & (np.abs(one.theta - other.theta)[:, 0] < 1.0)

    monkeypatch.setattr(module, "glued", here)
    found = follow(PROBLEM, np.zeros(2), np.ones(1), within(-7.0, 7.0))
    assert not found.closed


def test_what_was_cut_short_goes_on():
    """What was there stays, closed chains as they are."""
    short = follow(PROBLEM, np.zeros(2), np.ones(1), within(-0.2, 0.2))
    longer = prolonged(PROBLEM, short, within(-1.0, 1.0))
    assert is_chain(longer)
    assert set(short.tubes.theta[:, 0]) < set(longer.tubes.theta[:, 0])
    ring = TubeChain(short.tubes, True)
    assert prolonged(PROBLEM, ring, lambda tube: True) is ring
    assert prolonged(PROBLEM, short, lambda tube: True).closed


def test_a_next_tube_is_glued_and_settled(monkeypatch):
    """One that is not glued, not proved, or about a point that no step has settled, is none."""
    one = tubes((0.0, HALF))
    found = module._next(PROBLEM, one)
    assert glued(PROBLEM, one, found)[0]
    assert found.tangent[0, 0] == 1.0
    back = module._next(PROBLEM, one.turned())
    assert back.theta[0, 0] < 0.0 > back.tangent[0, 0]
    with monkeypatch.context() as other:
        other.setattr(module, "glued", lambda *_: np.array([False]))
        assert module._next(PROBLEM, one) is None
    with monkeypatch.context() as other:
        other.setattr(module, "_tube_at", lambda *_: None)
        assert module._next(PROBLEM, one) is None
    monkeypatch.setattr(module, "onto_curves", lambda problem, theta, kernel, steps: (theta, kernel, np.array([False])))
    assert module._next(PROBLEM, one) is None
