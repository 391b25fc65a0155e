"""Theorem E against closed forms: legs of known lengths that cannot meet in one platform."""

import numpy as np
import pytest

import ccpin
from ccpin import domain
from ccpin.domain import CellStatus, certify
from ccpin.domain.atlas.platform import platform_empty, platform_of
from ccpin.domain.chains import closure_system
from tests.oracles import delta as spheres
from tests.oracles import planar_3rpr as sextic
from tests.oracles import planar_3rrr as three_legs

POINTS = 100_000


def system_of(name):
    """A model's closures."""
    mechanism = ccpin.load(name)
    return closure_system(mechanism, mechanism.q_reference)


def circumradius(arms):
    """Of the triangles of the three spheres' centres, (K,)."""
    centres = np.array([spheres.sphere_centres(row) for row in arms])
    one, two = centres[:, 1] - centres[:, 0], centres[:, 2] - centres[:, 0]
    edges = [np.linalg.norm(edge, axis=1) for edge in (one, two, one - two)]
    return np.prod(edges, axis=0) / (2.0 * np.linalg.norm(np.cross(one, two), axis=1))


@pytest.mark.parametrize("half", [0.0, 0.02])
def test_no_delta_closes_where_it_says_so(half):
    """Of 100,000 points none has the platform level; four fifths of those where the spheres miss are told."""
    system = system_of("delta")
    arms = np.random.default_rng(0).uniform(-np.pi, np.pi, (POINTS, 3))
    empty = platform_empty(system, platform_of(system), arms, np.full_like(arms, half))
    inside = arms + half * np.random.default_rng(1).uniform(-1.0, 1.0, arms.shape)
    missed = circumradius(inside) > spheres.FOREARM
    assert not np.any(empty & ~missed)
    assert np.mean(empty) > (0.8 * np.mean(missed) if half == 0.0 else 1e-3)


def modes_of_3rrr(angles):
    """How many assembly modes three motors' angles (K, 3) have: the knees are the base of a 3-RPR."""
    way = np.exp(1j * three_legs.DIRECTIONS)
    knees = three_legs.BASE_RADIUS * way + three_legs.PROXIMAL * np.exp(1j * angles)
    pins = three_legs.PLATFORM_RADIUS * way
    shape = knees[:, 1:2] - knees[:, :1], knees[:, 2:] - knees[:, :1], pins[1] - pins[0], pins[2] - pins[0]
    return sextic.modes(np.full((len(angles), 3), three_legs.DISTAL), shape=shape)


def test_no_3rrr_closes_where_it_says_so():
    """Of 100,000 points none has a real root of the sextic."""
    system = system_of("planar_3rrr")
    angles = np.random.default_rng(2).uniform(-np.pi, np.pi, (POINTS, 3))
    empty = platform_empty(system, platform_of(system), angles, np.zeros_like(angles))
    modes, doubtful = modes_of_3rrr(angles)
    assert not np.any(empty & ~doubtful & (modes > 0))
    assert np.mean(empty) > 0.8 * np.mean(modes == 0)


@pytest.mark.slow
def test_cells_of_an_atlas_are_emptied():
    """Of the 3-RRR's turns, where the triangle inequality says nothing: 20,000 points, and an end in time."""
    mechanism = ccpin.load("planar_3rrr")
    q0 = domain.scalar_coordinates_at(mechanism, mechanism.q_reference)
    atlas = certify(mechanism, q0, max_depth=4, exhaustive=True, resolution=0.1, seconds=20.0)
    q = np.random.default_rng(3).uniform(-np.pi, np.pi, (20_000, 3))
    modes, doubtful = modes_of_3rrr(q)
    empty = atlas.status(q) == CellStatus.EMPTY
    assert not np.any(empty & ~doubtful & (modes > 0))
    assert empty.mean() > 0.02


@pytest.mark.parametrize("name", ["rpdr", "stewart", "four_bar"])
def test_what_is_no_platform_of_known_legs_is_left_alone(name):
    """Too few legs, or legs whose length is what changes."""
    assert platform_of(system_of(name)) is None
