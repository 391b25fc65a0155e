"""Legs that cannot meet in a body: the auditor's lemma against closed forms, and what it is not to prove."""

import numpy as np
import pytest

import ccpin
from ccpin.covering.cells import CellStatus
from ccpin.domain import certify, scalar_coordinates_at
from tests.oracles import delta as spheres
from tests.oracles import planar_3rrr as three_legs

pytest.importorskip("flint")

from flint import arb, arb_mat

from ccpin.auditing import closures, empty_cells, legs, reading
from tests.support.altered import changed, without_boxes
from tests.support.long_cases import later

SIZES = [10, pytest.param(1_500, marks=pytest.mark.slow)]


def looker(name, folder):
    """The auditor's search for a model, by a document of one box."""
    mechanism = ccpin.load(name)
    q0 = scalar_coordinates_at(mechanism, mechanism.q_reference)
    certify(mechanism, q0, (q0 - 1e-3, q0 + 1e-3), max_depth=1).save(folder / "box.json")
    read = reading.read(folder / "box.json")
    return mechanism, empty_cells.Emptiness(closures.BallClosures(read), read)


def apart(look, q, half):
    """Whether the legs are proved not to meet over q ± half."""
    return look.platform.cannot_meet(look.whole(q - half, q + half))


@pytest.mark.parametrize("points", SIZES)
@pytest.mark.parametrize("half", later(0.02, 0.0))
def test_delta(half, points, tmp_path):
    """Where the spheres of a level platform meet, be it by as little as there is, they are never told to miss."""
    _, look = looker("delta", tmp_path)
    assert len(look.platform.legs) == 6
    arms = np.random.default_rng(0).uniform(-np.pi, np.pi, (20 * points, 3))
    near = arms[np.argsort(np.abs(spheres.circumradius(arms) / spheres.FOREARM - 1.0))[:points]]
    inside = near + half * np.random.default_rng(1).uniform(-1.0, 1.0, near.shape)
    meet = spheres.circumradius(inside) <= spheres.FOREARM
    assert 0 < np.sum(meet) < points
    assert not any(apart(look, q, half) for q in near[meet])
    some = arms[spheres.circumradius(arms) > spheres.FOREARM][:points]
    assert np.mean([apart(look, q, half) for q in some]) > (0.4 if half else 0.8)


@pytest.mark.parametrize("points", SIZES)
def test_3rrr(points, tmp_path):
    """Where the sextic has no real root most is told, by single points; where it has one, never."""
    _, look = looker("planar_3rrr", tmp_path)
    assert len(look.platform.legs) == 3
    q = np.random.default_rng(2).uniform(-np.pi, np.pi, (points, 3))
    modes, doubtful = three_legs.modes(q)
    empty = np.array([apart(look, row, 0.0) for row in q])
    assert not np.any(empty & ~doubtful & (modes > 0))
    assert np.mean(empty[modes == 0]) > 0.8


@pytest.mark.parametrize("points", SIZES)
@pytest.mark.parametrize("name", later("delta", "hexa", "planar_3rrr"))
def test_no_box_that_holds_a_pose(name, points, tmp_path):
    """Boxes of any size about anything that closes."""
    mechanism, look = looker(name, tmp_path)
    model, rng = ccpin.ReducedModel(mechanism), np.random.default_rng(4)
    q0 = scalar_coordinates_at(mechanism, mechanism.q_reference)
    for _ in range(points):
        try:
            model.at(q := q0 + rng.normal(scale=0.5, size=len(q0)))
        except ccpin.errors.CcpinError:
            continue
        half = 10.0 ** rng.uniform(-6.0, 0.0) * rng.uniform(0.0, 1.0, len(q))
        assert not apart(look, q + half * rng.uniform(-0.9, 0.9, len(q)), half)


def ends_of(rng, size, count, stretched):
    """Legs whose lengths are those of a pose taken at random, `stretched` by a factor, and their β."""
    R = np.linalg.qr(rng.normal(size=(size, size)))[0]
    at, beta = rng.normal(size=(count, size)), rng.normal(size=(count, size))
    lengths = np.linalg.norm(at + rng.normal(size=size) + beta @ R.T, axis=1) * stretched
    still = [arb(0)]
    A = closures.exact(at)
    ends = legs._EndBalls(A, A, [arb_mat(count, size)], still, [arb(float(x)) ** 2 for x in lengths])
    return ends, closures.exact(beta)


@pytest.mark.parametrize(("size", "count"), [(2, 2), (2, 3), (3, 3), pytest.param(3, 6, marks=pytest.mark.slow)])
def test_the_lemma_holds_for_any_weights(size, count):
    """Whatever λ: poses there are violate nothing; and the same legs, too short for them, often do for the best one."""
    rng, told = np.random.default_rng(size + count), 0
    for _ in range(12):
        ends, beta = ends_of(rng, size, count, 1.0)
        body = object.__new__(legs.Legs)
        body.betas, body.legs, body.size = beta, [None] * count, size
        for _ in range(5):
            weights = rng.normal(scale=2.0, size=count)
            weights[-1] += 1.0 - weights.sum()
            assert not body._violated(weights, ends)
        assert not body._violated(legs._best(ends, closures.floats(beta)), ends)
        short, _ = ends_of(rng, size, count, 0.2)
        told += body._violated(legs._best(short, closures.floats(beta)), short)
    assert told > 4


@pytest.mark.slow
def test_reachable_cells_called_empty_are_not_proved(tmp_path):
    """Certified cells of a Delta, where there is nothing but these lemmas."""
    mechanism = ccpin.load("delta")
    q0 = scalar_coordinates_at(mechanism, mechanism.q_reference)
    atlas = certify(mechanism, q0, (q0 - 0.3, q0 + 0.3), max_depth=3)
    atlas.save(tmp_path / "delta.json")
    leaves = atlas.tree.leaves(CellStatus.CERTIFIED)[:8]

    def plant(arrays):
        arrays["tree_status"][leaves] = CellStatus.EMPTY
        without_boxes(arrays, leaves)

    read = reading.read(changed(tmp_path / "delta.json", tmp_path, plant, radius=0.0))
    look = empty_cells.Emptiness(closures.BallClosures(read), read)
    rows = np.flatnonzero(np.isin(read.empty.number, leaves))
    assert len(rows) == len(leaves)
    assert not any(look.proved(int(k)) for k in rows)
