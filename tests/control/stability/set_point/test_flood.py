"""The flood's boundary: what it proves stays below U wherever two members do not carry the same σ."""

import numpy as np
import pytest

import ccpin
from ccpin.control import PDSimpleGravity
from ccpin.control.stability.set_point.certified_cells import CellStore
from ccpin.control.stability.set_point.flood import Flood, FloodLimits
from ccpin.control.stability.set_point.starting_cells import cells_around
from tests.support.paper import GOAL, K_P, K_V


@pytest.fixture
def torn(monkeypatch):
    """Members never agree with one another but with the one they were proved from; the faces (member, other, face)."""
    faces = []

    def told(self, number, others):
        found = [self.face(number, other) for other in others]
        faces.extend((number, other, face) for other, face in zip(others, found, strict=True) if face is not None)
        return [False] * len(others)

    monkeypatch.setattr(CellStore, "agree", told)
    return faces


@pytest.fixture
def flooded(torn):
    """The store, and what a flood found in it."""
    law = PDSimpleGravity(ccpin.ReducedModel(ccpin.load("rpdr")), GOAL, 4.0 * np.asarray(K_P), K_V)
    limits = FloodLimits(12, 300)
    store = cells_around(law, 44.0, limits)
    return store, Flood(store, lambda well: True, limits, lambda flooded: True).run(GOAL)


def test_a_face_where_members_disagree_stays_boundary_when_one_is_halved(torn, flooded):
    """The level is at most U's least value on every face between members that carry different σ."""
    store, found = flooded
    assert any(not store[number].live for number, *_ in torn)
    least = min(store.well(number).range_over(face.lower, face.upper).upper for number, _, face in torn)
    assert 0.0 < found.level <= least
