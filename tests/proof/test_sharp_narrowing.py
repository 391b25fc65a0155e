"""Proposition U at equality: how far another tube may reach before σ is no longer proved alone in it."""

from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.proof import narrowing
from ccpin.proof.bounds import Contraction, Image
from ccpin.proof.equations import Problem
from ccpin.proof.narrowing import Candidates, alone_in
from ccpin.proof.newton import Boxes


class Growing:
    """Bounds with Y = 0, Z̄(R) = 1 and Z(R) = slope · R: contraction holds up to 1/slope exactly."""

    y = np.zeros((1, 1))

    def __init__(self, slope):
        self._slope = slope

    def mean(self, radius):
        return Image(np.ones((1, 1, 1)), np.zeros((1, 1)))

    def contraction(self, radius):
        return Contraction(self._slope * radius[:, None], np.zeros_like)


def held(monkeypatch, slope, gap=0.0, half=0.0, lean=0.0, radius=0.01, modes=1.0):
    """Whether σ of a box about y = 2 + 3q, |q| ≤ 0.5, is alone in a candidate that is moved, widened or leant."""
    monkeypatch.setattr(narrowing, "bounds_of", lambda problem, boxes: Growing(slope))
    one = np.ones((1, 1, 1))
    box = Boxes(
        np.array([[0.0, 2.0]]), np.full((1, 1), 0.5), np.array([[[1.0], [3.0]]]), modes * one, one,
        np.array([[radius]]), np.ones((1, 1)), np.array([0.5]),
    )  # fmt: skip
    candidate = Candidates(np.zeros(1, int), np.array([[0.0, 2.0 + gap]]), np.array([[0.5, half]]), (3.0 + lean) * one)
    system = SimpleNamespace(dependent=np.array([1]), independent=np.array([0]), m=1, n=1)
    return bool(alone_in(Problem(system, None, None), box, candidate)[0])


@pytest.mark.parametrize(
    ("change", "reach"),
    [
        ({"gap": 0.25}, 0.25),
        ({"gap": -0.25}, 0.25),
        ({"half": 0.25}, 0.25),
        ({"lean": 0.5}, 0.25),
        ({"lean": -0.5}, 0.25),
        ({"gap": 0.25, "half": 0.5, "lean": -0.25}, 0.875),
        ({"gap": 0.25, "modes": 0.5}, 0.5),
        ({"half": 0.25, "modes": 0.5}, 0.5),
        ({"lean": 0.5, "modes": 0.5}, 0.5),
        ({"radius": 0.25}, 0.25),
    ],
)
def test_alone_up_to_where_the_contraction_ends(monkeypatch, change, reach):
    assert held(monkeypatch, (1 - 1e-9) / reach, **change)
    assert not held(monkeypatch, 1 / reach, **change)
    assert not held(monkeypatch, (1 - 0.5e-10) / reach, **change)
    assert not held(monkeypatch, np.nan, **change)


def test_a_reach_that_newtons_image_lowers_is_taken_as_lowered(monkeypatch):
    """Z̄ = ½ halves a reach of 1 to ½, not below the tube's own radius."""
    monkeypatch.setattr(Growing, "mean", lambda self, radius: Image(np.full((1, 1, 1), 0.5), np.zeros((1, 1))))
    assert held(monkeypatch, 1.99, half=1.0)
    assert not held(monkeypatch, 2.01, half=1.0)
    assert not held(monkeypatch, 1.3, half=1.0, radius=0.8)
    monkeypatch.setattr(Growing, "y", np.full((1, 1), 0.25))
    assert held(monkeypatch, 1.33, half=1.0)
    assert not held(monkeypatch, 1.34, half=1.0)


def test_a_reach_keeps_room_for_rounding(monkeypatch):
    """A candidate of no width about σ itself is taken 1e-13 wide."""
    assert held(monkeypatch, 1e13 * (1 - 1e-3), radius=0.0)
    assert not held(monkeypatch, 1e13 * (1 + 1e-3), radius=0.0)
