"""Searches for a bound of ‖∂g/∂q‖ that go wrong: K_p is above every slope on the atlas, or nothing is proven.

The oracle is ‖∂g/∂q‖ of the model at points of the atlas.
"""

import numpy as np
import pytest

from ccpin.control import suggest_gains
from ccpin.control.stability.set_point import certified_cells, gains, starting_cells
from ccpin.control.stability.set_point.certified_cells import CellStore
from ccpin.domain import certify
from ccpin.errors import UnattainableGainsError
from tests.support.paper import GOAL

HALF = 0.28


@pytest.fixture(scope="module")
def square(model):
    """Boxes over a square about the goal."""
    return certify(model.mechanism, GOAL, (GOAL - HALF, GOAL + HALF), max_depth=8)


@pytest.fixture(scope="module")
def steepest(model):
    """The largest ‖∂g/∂q‖ on a grid."""
    axis = np.linspace(-HALF, HALF, 15)
    return max(np.linalg.norm(model.gravity_derivative(GOAL + np.array([x, y])), 2) for x in axis for y in axis)


def proven(model, square):
    """β, where it is said to be proven."""
    try:
        found = suggest_gains(model, GOAL, square)
    except UnattainableGainsError as refused:
        found = refused.gains
    return found.beta if found.verdict == "proven" else np.inf


def test_an_honest_search_is_near_the_truth(model, square, steepest):
    assert steepest <= proven(model, square) <= 1.07 * steepest


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_slopes_that_are_too_small(model, square, steepest, monkeypatch, share):
    honest = certified_cells.wells
    monkeypatch.setattr(
        certified_cells, "wells", lambda *given: [w._replace(beta=share * w.beta) for w in honest(*given)]
    )
    assert proven(model, square) >= steepest


@pytest.mark.parametrize("kept", [slice(1, None), slice(None, -1), slice(None, None, 2), slice(0, 0)])
def test_cells_left_out(model, square, steepest, monkeypatch, kept):
    honest = gains.gravity_slope_over
    monkeypatch.setattr(gains, "gravity_slope_over", lambda *a: (f := honest(*a))._replace(cells=f.cells[kept]))
    assert proven(model, square) == np.inf


@pytest.mark.slow
def test_halves_lost(model, square, steepest, monkeypatch):
    """Of a cell that is halved one half is kept, twice."""
    honest = CellStore.halve_proved

    def one(self, number):
        children = honest(self, number)
        return children and (children[0], children[0])

    monkeypatch.setattr(CellStore, "halve_proved", one)
    assert proven(model, square) >= steepest


def test_cells_that_are_not_glued(model, square, monkeypatch):
    monkeypatch.setattr(starting_cells, "_glued_pairs", lambda atlas: set())
    assert proven(model, square) == np.inf


@pytest.mark.parametrize("share", [0.25, 0.9])
def test_smaller_cells_than_the_atlas_has(model, square, monkeypatch, share):
    """Those that come with it shrink about their middles: what is between them is no cell's."""
    honest = CellStore.add_proved

    def smaller(self, boxes, lower, upper, touching):
        middle = 0.5 * (lower + upper)
        honest(self, boxes, middle + share * (lower - middle), middle + share * (upper - middle), touching)

    monkeypatch.setattr(CellStore, "add_proved", smaller)
    assert proven(model, square) == np.inf
