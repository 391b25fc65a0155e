"""Chains joined on curves that are straight lines and circles, where what each tube holds is known to the last bit."""

import numpy as np
import pytest

from ccpin.arrays import joined
from ccpin.domain.singular import joining as module
from ccpin.domain.singular.following import TubeChain
from ccpin.domain.singular.joining import _around, _Piece, _Pool, held, one_of_each, without_held
from ccpin.proof.curves.tubes import Points, TubeBounds
from tests.support.straight_curves import PROBLEM, is_chain, straighten, tubes, values

SLACK = 1.0 + 1e-10


@pytest.fixture(autouse=True)
def _straight(monkeypatch):
    straighten(monkeypatch, module)


def chain(*pieces, way=1.0, closed=False):
    return TubeChain(tubes(*pieces[:: int(way)], way=way), closed)


def run(first, last, step=0.25, half=0.4):
    """Tubes at k · step: each holds the middle of the next."""
    return [(k * step, half) for k in range(first, last)]


def ends(one):
    """Lower and upper ends of what a chain's tubes hold, (T, 2)."""
    return np.stack([one.tubes.theta[:, 0] - one.tubes.half, one.tubes.theta[:, 0] + one.tubes.half], axis=1)


def holds_all(after, before):
    """Whether points of every tube before are in a tube after, on the circle."""
    low, high = np.concatenate([ends(one) for one in after]).T
    for one in before:
        for a, b in ends(one):
            for x in np.linspace(a + 1e-9, b - 1e-9, 41):
                turns = 2 * np.pi * np.arange(-3, 4)[:, None]
                if not np.any((low <= x + turns) & (x + turns <= high)):
                    return False
    return True


# Lemma J.


def test_what_others_hold():
    """A tube that no one other holds is held by two that overlap, in halves; not where they leave a gap, or touch."""
    one = tubes((0.5, 0.5))
    assert held(PROBLEM, one, tubes((0.5, 0.6))).tolist() == [True]
    assert held(PROBLEM, one, tubes((0.2, 0.4), (0.8, 0.4))).tolist() == [True]
    assert held(PROBLEM, one, tubes((0.2, 0.25), (0.8, 0.25))).tolist() == [False]
    assert held(PROBLEM, one, tubes((0.2, 0.3), (0.8, 0.3))).tolist() == [False]
    assert held(PROBLEM, one, tubes((0.0, 0.45), (1.0, 0.45))).tolist() == [False]  # the middle
    assert held(PROBLEM, one, tubes((0.35, 0.36), (0.9, 0.21))).tolist() == [True]
    assert held(PROBLEM, one, tubes((0.5, 0.499))).tolist() == [False]
    assert held(PROBLEM, one, tubes((0.5 + 2 * np.pi, 0.6))).tolist() == [True]


def test_each_tube_is_held_for_itself():
    """Three of which the middle one is not."""
    others = tubes((0.0, 0.6), (4.0, 0.3), (4.4, 0.3))
    assert held(PROBLEM, tubes((0.0, 0.5), (2.0, 0.5), (4.2, 0.4)), others).tolist() == [True, False, True]


@pytest.mark.parametrize(
    ("change", "same"),
    [
        ({}, True),
        ({"way": -1.0}, True),
        ({"radius": 0.2}, False),
        ({"pairing": 1.0 + 2.0**-50}, False),
        ({"pieces": ((0.5, 0.5), (0.5 + 1e-15, 0.5))}, False),
        ({"pieces": ((0.5, 0.5), (0.5, 0.5 + 1e-15))}, False),
    ],
)
def test_a_tube_among_the_others_is_held_by_itself(change, same):
    """Bit for bit, whichever way it runs; else one that just reaches its ends is not."""
    piece, other = change.pop("pieces", ((0.5, 0.5), (0.5, 0.5)))
    one, others = tubes(piece), tubes(other, **change)
    assert module._among(one, others).tolist() == [same]
    if same:
        assert held(PROBLEM, one, others).tolist() == [True]


def test_tubes_along_other_coordinates_are_others():
    one = tubes((0.5, 0.5))
    assert not module._among(one, one._replace(along=np.ones(1, dtype=np.intp))).any()
    assert not module._among(one, one._replace(tangent=np.array([[1.0, 1e-16, 0.0]]))).any()


@pytest.mark.parametrize(("z", "hull"), [(0.5, 0.3), (0.0, 0.3), (3.0, 0.3), (0.5, 0.0)])
def test_what_a_piece_of_a_tube_is_within(monkeypatch, z, hull):
    """x ∈ x_m + h t′ + e, |e| first by the tube's own hull and tangent, then three times by Y + Z|e|."""
    y = np.array([[0.0, 0.02, 0.01]])
    asked = []

    def bounds(problem, at, frames, half, radius):
        asked.append((frames.tangent[0], half[0], radius[0]))
        return TubeBounds(y, np.diag([0.0, z, z])[None])

    def tilted(*given):
        return values(*given)._replace(slope=np.array([[[-0.2, 1.0, 0.0], [0.0, 0.0, 1.0]]]))

    one = tubes((0.5, 0.5), way=-1.0)._replace(hull=np.array([[0.0, hull, hull]]), tangent=np.array([[-1.0, 0.4, 0.0]]))
    monkeypatch.setattr(module, "values_at", tilted)
    monkeypatch.setattr(module, "bounds_of", bounds)
    middle = Points(np.array([[0.25, 0.06, 1.0]]), np.zeros((1, 3)))
    found = _around(PROBLEM, one, _Piece(np.array([0.125]), np.array([0.2])), middle)
    radius = np.array([0.0, 0.01 + hull + 1e-13 + 0.2 * 0.6, hull + 1e-13])  # at s = ⅛ the middle line has θ₂ = 0.05
    for tangent, half, given in asked:
        np.testing.assert_allclose(tangent, [-1.0, -0.2, 0.0], atol=1e-14)
        assert half == 0.2
        np.testing.assert_allclose(given, radius, rtol=1e-12, atol=1e-25)
        radius = np.minimum(radius, (y[0] + z * radius) * SLACK)
        radius[0] = 0.0
    assert len(asked) == 3
    expected = (0.2 * np.array([1.0, 0.2, 0.0]) + radius) * SLACK + 1e-13
    np.testing.assert_allclose(found.error[0], expected, rtol=1e-12)
    np.testing.assert_array_equal(found.x, middle.x)


# Chains.


def test_pools_know_whose_their_tubes_are():
    pool = _Pool.of([chain(*run(0, 3)), chain(*run(5, 7))])
    assert pool.owner.tolist() == [0, 0, 0, 1, 1]
    assert pool.place.tolist() == [0, 1, 2, 0, 1]
    assert pool.after.tolist() == [2, 1, 0, 1, 0]
    np.testing.assert_array_equal(pool.tubes.half, joined([chain(*run(0, 3)).tubes, chain(*run(5, 7)).tubes]).half)


@pytest.mark.parametrize("ways", [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)])
@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1), (1, 2, 0)])
def test_parts_of_a_line_are_one(ways, order):
    """Two that overlap are joined, whichever way they run; what lies apart stays as it is."""
    parts = [chain(*run(0, 6), way=ways[0]), chain(*run(4, 10), way=ways[1]), chain((-2.5, 0.3))]
    found = one_of_each(PROBLEM, [parts[k] for k in order])
    assert sorted(len(one.tubes.half) for one in found) == [1, 10]
    assert not any(one.closed for one in found)
    assert all(is_chain(one) for one in found)
    assert holds_all(found, parts)


@pytest.mark.parametrize("ways", [(1.0, 1.0, 1.0), (1.0, -1.0, 1.0), (-1.0, -1.0, 1.0)])
def test_parts_of_a_circle_are_one_and_closed(ways):
    parts = [chain(*run(a, b), way=way) for (a, b), way in zip([(0, 10), (8, 20), (18, 28)], ways, strict=True)]
    (found,) = one_of_each(PROBLEM, parts)
    assert found.closed
    assert is_chain(found)
    assert holds_all([found], parts)
    assert len(found.tubes.half) <= 27


def test_a_chain_that_meets_itself_is_closed():
    """Beyond where it began it is left out, what began before it too."""
    one = chain(*run(0, 30))
    (found,) = one_of_each(PROBLEM, [one])
    assert found.closed
    assert is_chain(found)
    assert holds_all([found], [one])


def test_what_is_left_out_is_held_or_all_stays():
    """A last tube that is longer than what goes on would be lost: both chains stay."""
    one, other = chain(*run(0, 4), (1.0, 1.2)), chain(*run(2, 6))
    found = one_of_each(PROBLEM, [one, other])
    assert holds_all(found, [one, other])
    assert all(is_chain(each) for each in found)
    assert any(np.any(each.tubes.half == 1.2) for each in found)


def test_of_chains_that_hold_one_another_one_stays():
    whole, part, again = chain(*run(0, 10)), chain((1.0, 0.3), (1.25, 0.3)), chain(*run(0, 10), way=-1.0)
    for given in ([whole, part, again], [part, again, whole], [again, whole, part]):
        found = without_held(PROBLEM, given)
        assert len(found) == 1
        assert len(found[0].tubes.half) == 10
    assert without_held(PROBLEM, [part, chain((4.0, 0.3))])[0] is part
    assert without_held(PROBLEM, []) == []


def test_closed_chains_stay_and_open_ones_in_them_go():
    """Also where the open one holds all of it."""
    ring, line = TubeChain(chain(*run(0, 26)).tubes, True), chain(*run(-2, 30))
    for given in ([ring, line], [line, ring]):
        assert [one.closed for one in without_held(PROBLEM, given)] == [True]
    said, longer = TubeChain(chain(*run(0, 10)).tubes, True), chain(*run(-2, 12))
    assert sorted(one.closed for one in without_held(PROBLEM, [said, longer])) == [False, True]
    assert [one.closed for one in without_held(PROBLEM, [chain(*run(2, 9)), ring])] == [True]


@pytest.mark.parametrize("seed", range(30))
def test_nothing_is_lost(seed):
    """Whatever chains there are, what they held is held, by chains that are what they say, and once more the same."""
    rng = np.random.default_rng(seed)
    parts = []
    for _ in range(rng.integers(1, 5)):
        middle, pieces = rng.uniform(0.0, 2 * np.pi), []
        for _ in range(rng.integers(1, 9)):
            half = rng.uniform(0.3, 1.0)
            pieces.append((middle, half))
            middle += rng.uniform(0.2, 0.9) * half
        one = TubeChain(tubes(*pieces), False)
        if is_chain(one):
            parts.append(module._turned(one) if rng.integers(2) else one)
    found = one_of_each(PROBLEM, parts)
    assert len(found) <= len(parts)
    assert all(is_chain(one) for one in found)
    if parts:
        assert holds_all(found, parts)
    again = one_of_each(PROBLEM, found)
    assert sorted(len(one.tubes.half) for one in again) == sorted(len(one.tubes.half) for one in found)


def test_a_closed_chain_is_not_gone_on_in():
    """Nor does it go on itself; another open one is, and keeps its place among those that stay."""
    ring, line = TubeChain(chain(*run(0, 26)).tubes, True), chain(*run(2, 6), (1.5, 0.4))
    assert module._longer(PROBLEM, [line, ring], 0) is None
    assert module._longer(PROBLEM, [ring, line], 0) is None
    on, apart = chain(*run(4, 10)), [chain((k, 0.3)) for k in (3.5, 4.5)]
    found, place = module._longer(PROBLEM, [on, apart[0], chain(*run(0, 6)), apart[1]], 2)
    assert place == 1
    assert [len(one.tubes.half) for one in found] == [1, 10, 1]
    assert found[0] is apart[0]
    assert found[2] is apart[1]


def test_turned_chains_run_the_other_way():
    one = chain(*run(0, 3))
    turned = module._turned(one)
    np.testing.assert_array_equal(turned.tubes.theta[:, 0], [0.5, 0.25, 0.0])
    np.testing.assert_array_equal(turned.tubes.tangent[:, 0], [-1.0, -1.0, -1.0])
    assert is_chain(turned)
