"""Lemma W and Proposition B against what their theorems state, and where their inequalities hold with equality."""

from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.proof.curves import settled_boxes as module
from ccpin.proof.curves.settled_boxes import (
    _inside,
    _narrowed,
    _Slanted,
    directions,
    extents,
    kernels,
    settled,
    settled_beside,
)
from ccpin.proof.curves.tubes import TubeBounds, tangents_at
from ccpin.proof.rounding import SLACK
from tests.support.made_up import made_up
from tests.support.waiting import any_boxes, any_tubes

N, ALONG = 6, 4  # coordinates of x, and the one that a slanted box runs along


@pytest.mark.parametrize("m", [1, 2])
def test_extents_are_those_of_the_corners(m):
    """θ = θ_c + Dδ of all corners |δ| = h is within them, the farthest at their ends."""
    problem, boxes = made_up(m), any_boxes(np.random.default_rng(1), 3, m)
    corners = np.array(list(product([-1.0, 1.0], repeat=2 + m)))
    moved = directions(problem, boxes) @ (boxes.half[:, None] * corners).transpose(0, 2, 1)
    for k, corner in enumerate(corners):
        expected = corner * boxes.half
        expected[:, problem.system.dependent] += np.einsum(
            "kij,kj->ki", boxes.slopes, expected[:, problem.system.independent]
        )
        np.testing.assert_allclose(moved[:, :, k], expected, rtol=1e-13)
    np.testing.assert_allclose(extents(problem, boxes), np.abs(moved).max(axis=2), rtol=2e-10)


def test_extents_are_widened_by_roundings_of_the_middle():
    """1e-15 (1 + |θ_c|) of boxes that are points."""
    boxes = any_boxes(np.random.default_rng(1), 1)._replace(centre=np.array([[0.0, 0.0, -3.0, 7.0]]))
    found = extents(made_up(), boxes._replace(half=np.zeros((1, 4))))
    np.testing.assert_allclose(found, [[1e-15, 1e-15, 4e-15, 8e-15]], rtol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_kernels_are_enclosed_by_what_the_lemma_states(monkeypatch, seed):
    """D = |1 − PA| + |P_J|Δ with Δ = |φ_yθ D|h + ½τρ² + γ(1 + ρ)², and 4γ Σ|P| Σ|l|: w is within Du of p."""
    rng, margin = np.random.default_rng(seed), 0.003
    problem, boxes, m, size = (
        made_up(rounding=0.001, magnitude=lambda theta: np.full(len(theta), 3.0)),
        any_boxes(rng, 1),
        2,
        4,
    )
    boxes = boxes._replace(half=0.01 * boxes.half)
    jacobian, hessian, pairing = rng.normal(size=(1, m, size)), rng.normal(size=(1, m, size, size)), rng.normal(size=m)
    third, u = rng.uniform(0.1, 1.0, (1, m)), np.array([5.0, 6.0])
    values, asked = SimpleNamespace(jacobian=jacobian, hessian=hessian, arms=None), []
    monkeypatch.setattr(module, "derivatives", lambda problem, theta: values)
    monkeypatch.setattr(module, "third_bound", lambda *arguments: asked.append(arguments) or third)
    monkeypatch.setattr(module, "solve_many", lambda matrix, right: u[None] / module._ROOM)
    inverse = np.linalg.pinv
    monkeypatch.setattr(np.linalg, "pinv", lambda matrix: 0.9 * inverse(matrix))
    middle, spread = kernels(problem, boxes, pairing[None])
    reach, D = extents(problem, boxes)[0], directions(problem, boxes)[0]
    np.testing.assert_array_equal(asked[0][3][0], reach)
    A = np.vstack([jacobian[0][:, problem.system.dependent], pairing])
    P, delta = 0.9 * inverse(A), np.zeros((m, m))
    for i in range(m):
        for j, column in enumerate(problem.system.dependent):
            delta[i, j] = np.abs(hessian[0, i, column] @ D) @ boxes.half[0]
            delta[i, j] += 0.5 * third[0, i] * reach.sum() ** 2 + margin * (1 + reach.sum()) ** 2
    wrong = np.abs(np.eye(m) - P @ A) + np.abs(P[:, :m]) @ delta
    wrong += 4 * margin * np.abs(P).sum(axis=1)[:, None] * np.abs(pairing).sum()
    np.testing.assert_allclose(middle[0], P[:, -1], rtol=1e-12)
    assert np.isfinite(spread).all() == np.all(np.abs(P[:, -1]) + wrong @ u < u)
    assert np.isfinite(spread).all()
    np.testing.assert_allclose(spread[0], wrong @ u, rtol=3e-10)


def lemma_w(monkeypatch, slope, pairing, third, u):
    """Lemma W where φ_y is diagonal, u is told and D = |P_J| third."""
    m = len(u)
    problem, boxes = made_up(m), any_boxes(np.random.default_rng(0), 1, m)
    jacobian = np.zeros((1, m, m + 2))
    jacobian[0][:, problem.system.dependent] = np.diag(slope)
    values = SimpleNamespace(jacobian=jacobian, hessian=np.zeros((1, m, m + 2, m + 2)), arms=None)
    monkeypatch.setattr(module, "derivatives", lambda problem, theta: values)
    monkeypatch.setattr(module, "extents", lambda problem, boxes: np.full((1, 1), 1.0))
    monkeypatch.setattr(module, "third_bound", lambda *_: 2.0 * np.array([third]))
    monkeypatch.setattr(module, "solve_many", lambda matrix, right: np.array([u]) / module._ROOM)
    return kernels(problem, boxes, np.array([pairing]))[1][0]


@pytest.mark.parametrize(
    ("pairing", "share", "u", "proved"),
    [
        (1.0, 0.499 / 0.5, 1.0, True),  # A = [1; 1]: p = ½ and |P_J| = ½, so ½ + Du ≤ u up to D = ½
        (1.0, 0.501 / 0.5, 1.0, False),
        (1.0, 1.9 * 0.5 / 0.5, 1.0, False),
        (1.0, 4.0, -1.0, False),
        (0.0, 1.0 - 1e-9, 1.0, True),  # p = 0 and |P_J| = 1
        (0.0, 1.0 - 0.9e-10, 1.0, False),
        (0.0, np.nan, 1.0, False),
    ],
)
def test_lemma_w_at_equality(monkeypatch, pairing, share, u, proved):
    """|p| + Du ≤ u and Du < u."""
    spread = lemma_w(monkeypatch, [1.0], [pairing], [share], [u])[0]
    assert np.isfinite(spread) == proved
    if proved:
        assert spread == pytest.approx(share * (0.5 if pairing else 1.0) * u, rel=3e-10)


def test_a_kernel_that_may_be_any_is_not_enclosed(monkeypatch):
    """Where Du = u, p = 0: |p| + Du ≤ u holds, and w may be any number."""
    share = next(x for x in 1.0 / SLACK + np.arange(-8, 9) * 2.0**-53 if 0.5 * (2.0 * x) * SLACK == 1.0)
    monkeypatch.setattr(module, "_ROOM", 1.0)
    assert np.isinf(lemma_w(monkeypatch, [1.0], [0.0], [share], [1.0])[0])


def test_all_of_a_kernel_is_enclosed_or_nothing(monkeypatch):
    """Of w = (w₁, w₂) with D = diag(0.1, 2)."""
    assert np.isinf(lemma_w(monkeypatch, [1.0, 1.0], [0.0, 0.0], [0.1, 2.0], [1.0, 1.0])).all()


def test_boxes_whose_kernel_is_not_enclosed_are_not_settled(monkeypatch):
    """Not tried either, be it one component of w; of the others θ and w are within extents and spread."""
    rng, problem, asked = np.random.default_rng(2), made_up(), []
    boxes, tubes = any_boxes(rng, 4), any_tubes(rng, 4, ALONG)
    kernel, spread = rng.normal(size=(4, 2)), rng.uniform(0.1, 1.0, (4, 2))
    spread[0, 1] = spread[2, 0] = np.inf
    monkeypatch.setattr(module, "kernels", lambda *_: (kernel, spread))
    monkeypatch.setattr(module, "_drawn", lambda *arguments: asked.append(arguments[1:]) or np.array([True, False]))
    np.testing.assert_array_equal(settled(problem, boxes, tubes), [False, True, False, False])
    theta, middle, extent, beside = asked[0]
    np.testing.assert_array_equal(theta, boxes.centre[[1, 3]])
    np.testing.assert_array_equal(middle, kernel[[1, 3]])
    np.testing.assert_array_equal(extent, np.hstack([extents(problem, boxes), spread])[[1, 3]])
    np.testing.assert_array_equal(beside.theta, tubes.theta[[1, 3]])


def test_what_one_tube_settles_is_settled(monkeypatch):
    """By the first, the second or neither of those beside it; what is settled is not asked of again."""
    rng, asked = np.random.default_rng(3), []
    boxes, tubes = (
        any_boxes(rng, 4)._replace(half=np.full((4, 4), 0.01), slopes=np.zeros((4, 2, 2))),
        any_tubes(rng, 5, ALONG),
    )
    nearest = np.array([[0, 1], [2, 3], [4, 0], [1, 2]])
    by = {(0, 0), (1, 3), (3, 1)}

    def tried(problem, some, beside):
        pairs = [
            (int(cell), int(np.argmin(np.abs(tubes.theta[:, 0] - x))))
            for cell, x in zip(some.cell, beside.theta[:, 0], strict=False)
        ]
        asked.extend(pairs)
        return np.array([pair in by for pair in pairs])

    monkeypatch.setattr(module, "settled", tried)
    monkeypatch.setattr(module, "_may_hold", lambda problem, theta, *_: np.ones(len(theta), dtype=bool))
    np.testing.assert_array_equal(settled_beside(made_up(), boxes, tubes, nearest), [True, True, False, True])
    assert sorted(asked) == [(0, 0), (1, 2), (1, 3), (2, 0), (2, 4), (3, 1)]


def slanted(rng, count):
    """Any slanted boxes along one coordinate."""
    tangent, radius = rng.uniform(-1, 1, (count, N)), rng.uniform(0.05, 0.2, (count, N))
    tangent[:, ALONG], radius[:, ALONG] = 1.0, 0.0
    return _Slanted(rng.normal(size=(count, N)), np.full(count, ALONG), tangent, rng.uniform(0.1, 0.2, count), radius)


def test_a_box_lies_in_the_slanted_box_drawn_about_it(monkeypatch):
    """Its corners have the s and e that are the ends of that; l is the tube's."""
    rng, seen = np.random.default_rng(4), []
    tubes, extent, x = any_tubes(rng, 1, ALONG), rng.uniform(0.1, 0.5, (1, N)), rng.normal(size=(1, N))
    tangent = rng.uniform(-1, 1, (1, N))
    tangent[0, ALONG] = -1.0
    monkeypatch.setattr(
        module, "first_order", lambda problem, theta, kernel, pairing: seen.append((theta, kernel, pairing)) or (0, 0)
    )
    monkeypatch.setattr(module, "tangents_at", lambda slope: (np.array([ALONG]), tangent))
    monkeypatch.setattr(
        module, "_narrowed", lambda problem, boxes, beside: seen.append(boxes) or (np.array([True]), boxes)
    )
    monkeypatch.setattr(module, "_inside", lambda *_: np.array([False]))
    assert module._drawn(made_up(), x[:, :4], x[:, 4:], extent, tubes)[0]
    (theta, kernel, pairing), boxes = seen
    assert [theta.tolist(), kernel.tolist(), pairing.tolist()] == [
        x[:, :4].tolist(),
        x[:, 4:].tolist(),
        tubes.pairing.tolist(),
    ]
    corners = np.array(list(product([-1.0, 1.0], repeat=N))) * extent
    s = corners[:, ALONG] * tangent[0, ALONG]
    off = np.abs(corners - s[:, None] * tangent)
    np.testing.assert_array_equal(boxes.x, x)
    assert boxes.half[0] == pytest.approx(np.abs(s).max(), rel=1e-15)
    np.testing.assert_allclose(boxes.radius[0], off.max(axis=0), rtol=2e-10)
    assert boxes.radius[0, ALONG] == 0.0


@pytest.mark.parametrize("count", [1, 3])
def test_tangents_are_of_length_one_in_their_largest_component(count):
    """The kernel of G′, which way it points told by `forward` where that is given."""
    slope = np.random.default_rng(count).normal(size=(count, N - 1, N))
    along, tangent = tangents_at(slope)
    np.testing.assert_allclose(np.einsum("kij,kj->ki", slope, tangent), 0.0, atol=1e-13)
    np.testing.assert_array_equal(np.abs(tangent[np.arange(count), along]), 1.0)
    np.testing.assert_array_equal(np.abs(tangent).max(axis=1), 1.0)
    for forward in (tangent[0], -tangent[0]):
        turned = tangents_at(slope, forward)[1]
        np.testing.assert_array_equal(np.abs(turned), np.abs(tangent))
        assert np.all(turned @ forward > 0.0)


def test_what_is_empty_or_inside_is_settled_and_nothing_else(monkeypatch):
    """At once or narrowed again; boxes 2 and 3 are narrowed by half, box 4 by nothing, box 5 in one coordinate only."""
    rng, count = np.random.default_rng(5), 6
    tubes, passes = any_tubes(rng, count, ALONG)._replace(half=np.arange(1.0, count + 1)), []
    tangents = np.full(count, ALONG), np.ones((count, N))
    monkeypatch.setattr(module, "first_order", lambda *_: (0, 0))
    monkeypatch.setattr(module, "tangents_at", lambda slope: tangents)

    def narrowed(problem, boxes, beside):
        number = beside.half.astype(int) - 1
        passes.append(number.tolist())
        radius = np.where((number < 4)[:, None], 0.5, 1.0) * boxes.radius
        radius[number == 5, 0] *= 0.5
        return number == 0, boxes._replace(radius=radius)

    def inside(problem, boxes, beside):
        return np.isin(beside.half, [2.0]) | (np.isin(beside.half, [3.0, 6.0]) & (len(passes) == 2))

    monkeypatch.setattr(module, "_narrowed", narrowed)
    monkeypatch.setattr(module, "_inside", inside)
    done = module._drawn(made_up(), np.zeros((count, 4)), np.zeros((count, 2)), np.ones((count, N)), tubes)
    np.testing.assert_array_equal(done, [True, True, True, False, False, True])
    assert passes == [[0, 1, 2, 3, 4, 5], [2, 3, 5]]


def proposition_b(monkeypatch, boxes, shift, y, z, tubes=None):
    """`_narrowed` with −P G(x₀), Y and Z told."""
    count, seen = len(boxes.x), []
    values = SimpleNamespace(value=np.zeros((count, 5)), slope=np.zeros((count, 5, N)))
    values.value[:, 0] = 1.0
    gain = np.zeros((count, N, 5))
    gain[:, :, 0] = -shift
    monkeypatch.setattr(
        module, "values_at", lambda problem, theta, kernel, pairing: seen.append((theta, kernel, pairing)) or values
    )
    monkeypatch.setattr(module, "inverse_without", lambda slope, along: gain)
    monkeypatch.setattr(
        module,
        "bounds_of",
        lambda problem, values, frames, half, radius: seen.append((frames, half, radius)) or TubeBounds(y, z),
    )
    tubes = any_tubes(np.random.default_rng(0), count, ALONG) if tubes is None else tubes
    found = _narrowed(made_up(), boxes, tubes)
    (theta, kernel, pairing), (frames, half, radius) = seen
    asked = np.hstack([theta, kernel]), pairing, frames.tangent, half, radius
    for given, same in zip((boxes.x, tubes.pairing, boxes.tangent, boxes.half, boxes.radius), asked, strict=True):
        np.testing.assert_array_equal(same, given)
    return found


def test_boxes_are_cut_down_to_what_the_proposition_leaves(monkeypatch):
    """|e + P G| ≤ Y − |P G| + ZR and |e| ≤ R; what is no number leaves all."""
    rng, count = np.random.default_rng(6), 40
    boxes = slanted(rng, count)
    shift, z = rng.uniform(-0.25, 0.25, (count, N)), rng.uniform(0.0, 0.1, (count, N, N))
    y = np.abs(shift) + rng.uniform(0.0, 0.1, (count, N))
    y[0, 1] = np.nan
    empty, smaller = proposition_b(monkeypatch, boxes, shift, y, z)
    left = y - np.abs(shift) + np.einsum("kij,kj->ki", z, boxes.radius)
    low, high = np.maximum(shift - left, -boxes.radius), np.minimum(shift + left, boxes.radius)
    low[0, 1], high[0, 1] = -boxes.radius[0, 1], boxes.radius[0, 1]
    low[:, ALONG] = high[:, ALONG] = 0.0
    expected = np.any(low > high, axis=1)
    assert 5 < expected.sum() < 35
    np.testing.assert_array_equal(empty, expected)
    kept = ~expected
    np.testing.assert_allclose(smaller.x[kept], (boxes.x + 0.5 * (low + high))[kept], rtol=1e-9)
    np.testing.assert_allclose(smaller.radius[kept], (0.5 * (high - low))[kept], rtol=1e-8)
    assert np.all(smaller.radius[:, ALONG] == 0.0)
    assert np.isfinite(smaller.radius).all()
    for name in ("along", "tangent", "half"):
        np.testing.assert_array_equal(getattr(smaller, name), getattr(boxes, name))


@pytest.mark.parametrize(("left", "empty"), [(0.4, True), (0.5 - 1e-9, True), (0.5 + 1e-9, False), (0.7, False)])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_boxes_are_empty_where_one_coordinate_leaves_nothing(monkeypatch, left, empty, sign):
    """|e + 1.5| ≤ 1 − left meets |e| ≤ 1 from left = ½ on."""
    boxes = slanted(np.random.default_rng(7), 1)
    radius, shift = boxes.radius.copy(), np.zeros((1, N))
    radius[0, 0], shift[0, 0] = 1.0, 1.5 * sign
    found = proposition_b(monkeypatch, boxes._replace(radius=radius), shift, np.abs(shift) + left, np.zeros((1, N, N)))[
        0
    ]
    assert found[0] == empty


def test_what_is_left_is_widened_by_roundings(monkeypatch):
    """Y = 1 by a rounding of Y, points by 1e-14 and four roundings of 1 + |x|."""
    boxes = slanted(np.random.default_rng(8), 1)
    boxes = boxes._replace(
        x=np.array([[0.0, 100.0, 0.0, 0.0, 0.0, 0.0]]), radius=np.where(np.arange(N) == 2, 1.0, 0.0)[None]
    )
    shift = np.where(np.arange(N) == 2, 0.25, 0.0)[None]
    y = np.abs(shift)
    radius = proposition_b(monkeypatch, boxes, shift, y, np.zeros((1, N, N)))[1].radius[0]
    assert radius[2] == pytest.approx(1e-12 * 0.25 + 1e-14 + 1.25 * 2.0**-51, rel=1e-3, abs=0.0)
    assert radius[0] == pytest.approx(1e-14 + 2.0**-51, rel=1e-6, abs=0.0)
    assert radius[1] == pytest.approx(1e-14 + 101 * 2.0**-51, rel=1e-6, abs=0.0)


def corners_in(boxes, tubes, periodic):
    """Of a slanted box's corners the largest |s| in the tube, and the largest |e| off its axis."""
    s, e = [], []
    for ends in product([-1.0, 1.0], repeat=N + 1):
        gap = (
            boxes.x[0]
            + ends[-1] * boxes.half[0] * boxes.tangent[0]
            + np.array(ends[:-1]) * boxes.radius[0]
            - tubes.x[0]
        )
        gap[periodic] -= 2.0 * np.pi * np.round(gap[periodic] / (2.0 * np.pi))
        along = gap[tubes.along[0]] * tubes.tangent[0, tubes.along[0]]
        s.append(abs(along))
        e.append(np.abs(gap - along * tubes.tangent[0]))
    off = np.max(e, axis=0)
    off[tubes.along[0]] = 0.0
    return max(s), off


def borders_of(boxes, tubes, half, radius, near):
    """A box is in a tube so long and wide, and in none that is shorter or in one coordinate narrower."""
    problem = made_up(periodic=[0, 1])

    def inside(half, radius):
        return _inside(problem, boxes, tubes._replace(half=np.array([half]), radius=radius[None]))[0]

    assert inside(half * (1.0 + near), radius * (1.0 + near))
    assert not inside(half * (1.0 - near), 1.9 * radius)
    for k in np.flatnonzero(radius):
        assert not inside(1.9 * half, radius * np.where(np.arange(N) == k, 1.0 - near, 1.9))


@pytest.mark.parametrize("seed", range(6))
def test_a_slanted_box_is_in_a_tube_where_its_corners_are(seed):
    """All of them, angles modulo 2π, up to 1e-13; the tube runs along another coordinate than the box."""
    rng = np.random.default_rng(seed)
    tubes = any_tubes(rng, 1, 1)
    boxes = slanted(rng, 1)._replace(x=tubes.x + rng.uniform(-0.1, 0.1, (1, N)))
    half, radius = corners_in(boxes, tubes, [])
    turned = boxes._replace(x=boxes.x + 2.0 * np.pi * np.array([[1.0, -2.0, 0.0, 0.0, 0.0, 0.0]]))
    borders_of(turned, tubes, half + 1e-13, radius + 1e-13 * (radius > 0.0), 1e-9)


def test_a_point_in_a_tube_is_in_it_up_to_roundings():
    """1e-13 each way."""
    rng = np.random.default_rng(1)
    tubes, boxes = any_tubes(rng, 1, 1), slanted(rng, 1)
    boxes = boxes._replace(x=tubes.x, half=np.zeros(1), radius=np.zeros((1, N)))
    borders_of(boxes, tubes, 1e-13, np.where(np.arange(N) == 1, 0.0, 1e-13), 1e-3)
