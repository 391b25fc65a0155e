"""What is searched: regions and whether they close on themselves, limits that belong to a claim, what is refused."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

import ccpin
from ccpin.domain.closures import searchable as module
from ccpin.domain.closures.searchable import check_searchable, region_about, region_of, searched_ranges
from ccpin.domain.closures.seeds import checked_configuration, seed_at_coordinates
from ccpin.domain.closures.system import reading_of
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.proof.ranges import NO_LIMIT
from tests.support.geared import geared
from tests.support.rods import rod_four_bar

TURN = 2.0 * np.pi


def seed_of(q, periodic=(True, False), limits=()):
    """A seed of two independent coordinates with joints' limits, and its mechanism."""
    joints = [
        SimpleNamespace(name=f"j{k}", kind=SimpleNamespace(nq=1), q=slice(k, k + 1), v=slice(k, k + 1))
        for k in range(2)
    ]
    ends = np.array(limits or [[-np.inf, np.inf]] * 2, dtype=float)
    system = SimpleNamespace(periodic=np.array(periodic), independent=np.array([0, 1]), n=2)
    reading = SimpleNamespace(system=system, chart=SimpleNamespace(joints=joints))
    model = SimpleNamespace(lowerPositionLimit=ends[:, 0], upperPositionLimit=ends[:, 1])
    mechanism = SimpleNamespace(independent=("j0", "j1"), tree=SimpleNamespace(model=model))
    return mechanism, SimpleNamespace(reading=reading, q=np.array(q, dtype=float))


@pytest.mark.parametrize(
    ("width", "wrapped"),
    [
        (TURN, True), (TURN - 0.97e-9, True), (TURN + 0.97e-9, True), (TURN - 1.03e-9, False), (TURN - 1.9e-9, False),
        (4.0, False),
    ],
)  # fmt: skip
def test_a_full_turn_closes_on_itself(width, wrapped):
    """To 1e-9, and is one exactly then; of a slide none does."""
    mechanism, seed = seed_of((2.0, 1.0))
    region = region_of(mechanism, seed, ([1.0, 0.0], [1.0 + width, TURN]))
    assert region.wrapped.tolist() == [wrapped, False]
    assert region.upper.tolist() == [1.0 + TURN if wrapped else 1.0 + width, TURN]


@pytest.mark.parametrize(("width", "known"), [(TURN + 0.97e-9, True), (TURN + 1.03e-9, False), (9.0, False)])
def test_more_than_a_turn_is_refused(width, known):
    """Of a turn; a slide may go as far as it likes, and one such turn is enough."""
    for periodic in ((True, False), (True, True)):
        mechanism, seed = seed_of((2.0, 1.0), periodic)
        bounds = [1.0, 0.0], [1.0 + width, 99.0 if not periodic[1] else 2.0]
        if known:
            assert region_of(mechanism, seed, bounds).wrapped[0]
        else:
            with pytest.raises(InvalidInputError, match="exceed a full turn"):
                region_of(mechanism, seed, bounds)


@pytest.mark.parametrize(
    ("q", "where"),
    [
        ((1.0, 2.0), None), ((3.0, 5.0), None), ((0.9, 3.0), "j0"), ((3.1, 3.0), "j0"), ((2.0, 1.9), "j1"),
        ((2.0, 5.1), "j1"), ((0.6, 3.0), "j0"), ((5.0, 3.0), "j0"), ((2.0, 8.0), "j1"),
    ],
)  # fmt: skip
def test_a_region_holds_the_place_one_starts_at(q, where):
    mechanism, seed = seed_of(q)
    bounds = [1.0, 2.0], [3.0, 5.0]
    if where is None:
        assert region_of(mechanism, seed, bounds).upper.tolist() == [3.0, 5.0]
    else:
        with pytest.raises(InvalidInputError, match=f"outside the region in '{where}'"):
            region_of(mechanism, seed, bounds)
    turned, seed = seed_of((99.0, q[1]))
    if 2.0 <= q[1] <= 5.0:
        assert region_of(turned, seed, ([1.0, 2.0], [1.0 + TURN, 5.0])).wrapped[0]  # a whole turn holds every angle


@pytest.mark.parametrize(
    ("limits", "bounds"),
    [
        ([[-1.0, 2.0], [0.5, 3.0]], [[-1.0, 2.0], [0.5, 3.0]]),
        ([[-np.inf, np.inf], [0.5, 3.0]], [[-np.pi, np.pi], [0.5, 3.0]]),
        ([[-9.0, 9.0], [-9.0, 9.0]], [[-np.pi, np.pi], [-9.0, 9.0]]),
        ([[1.0, 1.0 + TURN - 0.97e-9], [0.5, 3.0]], [[-np.pi, np.pi], [0.5, 3.0]]),
        ([[-4.0, 0.5], [0.5, 3.0]], [[-4.0, 0.5], [0.5, 3.0]]),
        ([[-1.0, np.inf], [0.5, 3.0]], [[-np.pi, np.pi], [0.5, 3.0]]),
        ([[0.5, 0.5 + TURN - 1.03e-9], [0.5, 3.0]], [[0.5, 0.5 + TURN - 1.03e-9], [0.5, 3.0]]),
    ],
)
def test_regions_are_what_joints_allow_by_default(limits, bounds):
    """All of a turn where they allow it to 1e-9, else as far as their limits."""
    mechanism, seed = seed_of((0.75, 1.0), limits=limits)
    seed = SimpleNamespace(reading=seed.reading, q=np.array([bounds[0][0], 1.0]))
    region = region_of(mechanism, seed, None)
    np.testing.assert_allclose(np.column_stack([region.lower, region.upper]), bounds, rtol=0, atol=1e-15)


@pytest.mark.parametrize("ends", [[-np.inf, np.inf], [0.5, np.inf], [-np.inf, 0.5]])
def test_slides_without_limits_have_no_region_by_default(ends):
    mechanism, seed = seed_of((0.75, 1.0), limits=[[-1.0, 2.0], ends])
    with pytest.raises(InvalidInputError, match="'j1' has no limits"):
        region_of(mechanism, seed, None)


# What is searched of the others


@cache
def crank():
    mechanism = ccpin.load("slider_crank")
    return mechanism, reading_of(mechanism, mechanism.q_reference)


def test_a_region_may_be_anywhere():
    """It need not hold the reference."""
    mechanism, reading = crank()
    region = region_about(mechanism, reading, ([2.0], [2.5]))
    assert (region.lower.tolist(), region.upper.tolist()) == ([2.0], [2.5])
    assert region_about(mechanism, reading, None).wrapped.tolist() == [True]


@pytest.mark.parametrize("ends", [(-0.2, 0.3), (-np.inf, 0.3), (-0.2, np.inf)])
def test_limits_belong_to_what_is_claimed(monkeypatch, ends):
    """Of slides, where there are any, as they are stated; of turns none."""
    mechanism, reading = crank()
    model = SimpleNamespace(
        lowerPositionLimit=np.array([-1.0, -1.0, ends[0]]), upperPositionLimit=np.array([1.0, 1.0, ends[1]])
    )
    tree = SimpleNamespace(model=model, joints=mechanism.tree.joints)
    monkeypatch.setattr(module, "component_names", lambda tree: ["crank", "rod", "slide"])
    told = SimpleNamespace(tree=tree, q_reference=mechanism.q_reference)
    ranges = searched_ranges(told, reading, region_about(mechanism, reading, ([2.0], [2.5])))
    assert ranges.limits.tolist() == [[-NO_LIMIT, NO_LIMIT], [max(ends[0], -NO_LIMIT), min(ends[1], NO_LIMIT)]]


def searched(n=2, m=3, units=(0, 2), rods=(), moduli=(0.0, 0.0), turnable=(False, False)):
    """A mechanism and a reading that can be searched, but for what is told."""
    joints = [SimpleNamespace(kind=SimpleNamespace(unit=unit)) for unit in units]
    system = SimpleNamespace(m=m, n=n, n_free=n + m, moduli=np.array(moduli))
    reading = SimpleNamespace(system=system, chart=SimpleNamespace(joints=joints), rods=rods)
    loops = [SimpleNamespace(turnable=turns, closure=SimpleNamespace(name="loop", kind="kind")) for turns in turnable]
    return SimpleNamespace(n=n, name="told", constraints=lambda: SimpleNamespace(loops=loops)), reading


@pytest.mark.parametrize(
    ("told", "why"),
    [
        ({}, None), ({"n": 1}, None), ({"n": 3}, None), ({"n": 0}, "0 independent"), ({"n": 4}, "4 independent"),
        ({"m": 8}, None), ({"m": 5}, None), ({"m": 9}, "9 of its coordinates"), ({"units": (0, 4)}, "ball joints"),
        ({"units": (4, 0)}, "ball joints"), ({"rods": ("rod",)}, "distance closures"),
        ({"moduli": (0.0, 1.0)}, "continuous"), ({"turnable": (False, True)}, "turned over"),
    ],
)  # fmt: skip
def test_what_cannot_be_searched_is_refused(told, why):
    if why is None:
        check_searchable(*searched(**told))
    else:
        with pytest.raises(UnsupportedMechanismError, match=why):
            check_searchable(*searched(**told))


@pytest.mark.parametrize(
    ("told", "known"),
    [({}, True), ({"units": (0, 4)}, False), ({"rods": ("rod",)}, False), ({"moduli": (0.0, 1.0)}, False)],
)
def test_ranges_of_all_there_is_are_of_what_can_be_searched(monkeypatch, told, known):
    monkeypatch.setattr(module, "ranges_of", lambda *_: "ranges")
    assert module.all_values(searched(**told)[1], np.zeros(2), np.ones(2)) == ("ranges" if known else None)


# Where certificates begin


def test_a_seed_is_closed_at_the_coordinates_asked_for():
    """Bit for bit, also of a circle turned more than once, and of a joint that no loop knows."""
    mechanism, _ = crank()
    seed = seed_at_coordinates(mechanism, [0.1])
    assert seed.q.tolist() == [0.1]
    np.testing.assert_allclose(
        mechanism.constraints().residual(seed.reading.configuration(seed.theta)), 0.0, atol=1e-10
    )
    bar = ccpin.load(rod_four_bar())
    seed = seed_at_coordinates(bar, [-1.2])
    assert seed.q.tolist() == [-1.2]
    spun = seed_at_coordinates(_spinning(), [0.75 + TURN])
    assert spun.q.tolist() == [0.75 + TURN]
    q_free = spun.reading.configuration(spun.theta)
    np.testing.assert_allclose(_spinning().constraints().residual(q_free), 0.0, atol=1e-10)


@cache
def _spinning():
    return geared([((0.0, 1.0),), ((0.0, -1.0),)], ("continuous", "continuous"), (0.25, 0.25))


@pytest.mark.parametrize("q", [[0.1, 0.2], [np.nan], [np.inf], [[0.1]], []])
def test_coordinates_that_are_none_are_refused(q):
    with pytest.raises(InvalidInputError, match="1 finite numbers"):
        seed_at_coordinates(crank()[0], q)


@pytest.mark.parametrize("q", [[0.1, np.nan], [np.inf, 0.1], [0.1]])
def test_every_coordinate_is_looked_at(rpdr, q):
    with pytest.raises(InvalidInputError, match="2 finite numbers"):
        seed_at_coordinates(rpdr, q)


@pytest.mark.parametrize("q", [[0.0, 0.0], [0.0, 0.0, np.nan], [np.inf, 0.0, 0.0], [[0.0, 0.0, 0.0]]])
def test_configurations_that_are_none_are_refused(q):
    with pytest.raises(InvalidInputError, match="3 finite numbers"):
        checked_configuration(crank()[0], q)
