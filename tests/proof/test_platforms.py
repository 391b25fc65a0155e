"""Theorem E against closed forms: legs of known lengths that cannot meet in one platform."""

import numpy as np
import pytest

import ccpin
from ccpin.covering.cells import CellStatus
from ccpin.covering.proposals.platforms import platform_empty
from ccpin.domain import certify, scalar_coordinates_at
from ccpin.domain.closures.system import reading_of
from ccpin.proof.chains import Chain, stack_chains
from ccpin.proof.emptiness import drift, empty_by, ends_over, platform_of
from ccpin.proof.tips import move
from tests.oracles import delta as spheres
from tests.oracles import planar_3rrr as three_legs

SIZES = [8_000, pytest.param(100_000, marks=pytest.mark.slow)]


def system_of(name):
    """A model's closures."""
    mechanism = ccpin.load(name)
    return reading_of(mechanism, mechanism.q_reference).system


@pytest.mark.parametrize("points", SIZES)
@pytest.mark.parametrize(
    ("half", "told"),
    [(0.02, 0.4), *(pytest.param(*case, marks=pytest.mark.slow) for case in ((0.0, 0.8), (0.05, 0.03)))],
)
def test_no_delta_closes_where_it_says_so(half, told, points):
    """No point of an emptied cell has the platform level; of points where the spheres miss a good share are told."""
    system = system_of("delta")
    arms = np.random.default_rng(0).uniform(-np.pi, np.pi, (points, 3))
    empty, _ = platform_empty(system, platform_of(system), arms, np.full_like(arms, half))
    inside = arms + half * np.random.default_rng(1).uniform(-1.0, 1.0, arms.shape)
    missed = spheres.circumradius(inside) > spheres.FOREARM
    assert not np.any(empty & ~missed)
    assert np.mean(empty) > told * np.mean(missed)


@pytest.mark.parametrize("points", SIZES)
@pytest.mark.parametrize(("half", "told"), [(0.0, 0.8), (0.1, 0.7)])
def test_no_3rrr_closes_where_it_says_so(half, told, points):
    """No point of an emptied cell has a real root of the sextic."""
    system, rng = system_of("planar_3rrr"), np.random.default_rng(2)
    centres = rng.uniform(-np.pi, np.pi, (points, 3))
    empty, _ = platform_empty(system, platform_of(system), centres, np.full_like(centres, half))
    modes, doubtful = three_legs.modes(centres + half * rng.uniform(-1.0, 1.0, centres.shape))
    assert not np.any(empty & ~doubtful & (modes > 0))
    assert np.mean(empty) > told * np.mean(modes == 0)


def test_a_tip_is_as_near_to_its_linearization_as_said():
    """`drift` of heads with several joints, against differences."""
    rng = np.random.default_rng(4)
    for k in range(20):
        head = _head(rng, 1 + k % 4)
        theta, width = rng.normal(size=(1, 4)), rng.uniform(0.01, 0.5, (1, 4))
        stack = stack_chains((head,), 4, 3)
        here = move(stack, theta)
        steps = width * rng.choice([-1.0, 1.0], (200, 4)) * rng.uniform(0.5, 1.0, (200, 1))
        there = move(stack, theta + steps).x[:, 0] - here.x[:, 0]
        linear = steps[:, head.joints] @ here.b[0, 0]
        moved, bent = drift(head, width, np.abs(theta) + width)
        assert np.all(np.linalg.norm(there, axis=1) <= moved * (1.0 + 1e-12))
        missed = np.linalg.norm(there - linear, axis=1)
        assert missed.max() <= bent[0] + 1e-14
        if not head.prismatic.any():
            assert missed.max() >= 0.02 * bent[0]


def _head(rng, count):
    """A chain of joints of both kinds."""
    turns = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    turns *= np.sign(np.linalg.det(turns))[:, None, None]
    axes = rng.normal(size=(count, 3))
    return Chain(
        joints=np.arange(count),
        rotations=turns,
        translations=rng.normal(size=(count, 3)),
        axes=axes / np.linalg.norm(axes, axis=1, keepdims=True),
        prismatic=rng.random(count) < 0.3,
        tip=rng.normal(size=3),
        direction=False,
        weights=np.eye(3),
    )


@pytest.mark.slow
def test_cells_of_an_atlas_are_emptied():
    """Of the 3-RRR's turns, where the triangle inequality says nothing: 20,000 points, and an end in time."""
    mechanism = ccpin.load("planar_3rrr")
    q0 = scalar_coordinates_at(mechanism, mechanism.q_reference)
    atlas = certify(mechanism, q0, max_depth=4, exhaustive=True, resolution=0.1, seconds=20.0)
    q = np.random.default_rng(3).uniform(-np.pi, np.pi, (20_000, 3))
    modes, doubtful = three_legs.modes(q)
    empty = atlas.status(q) == CellStatus.EMPTY
    assert not np.any(empty & ~doubtful & (modes > 0))
    assert empty.mean() > 0.02


@pytest.mark.parametrize("name", ["rpdr", "stewart", "four_bar"])
def test_what_is_no_platform_of_known_legs_is_left_alone(name):
    """Too few legs, or legs whose length is what changes."""
    assert platform_of(system_of(name)) is None


@pytest.mark.parametrize("size", [1e150, 1e200, 1e308])
@pytest.mark.parametrize("name", ["delta", "planar_3rrr"])
def test_weights_that_overflow_prove_nothing(name, size):
    """Of either sign, or such that they cancel, beside weights that prove the same cell empty."""
    system = system_of(name)
    legs = platform_of(system)
    centre, half = np.random.default_rng(5).uniform(-np.pi, np.pi, (200, 3)), np.zeros((200, 3))
    empty, weights = platform_empty(system, legs, centre, half)
    far = np.flatnonzero(empty)[0]
    tried = np.tile(weights[far], (4, 1))
    tried[1], tried[2, :2], tried[3, 0] = size, (size, -size), -size
    with np.errstate(all="ignore"):
        found, _ = empty_by(legs, ends_over(system, legs, np.tile(centre[far], (4, 1)), np.zeros((4, 3))), tried)
    assert found.tolist() == [True, False, False, False]
