"""Legs of a body: what the lemma is asked of, and its inequality, term by term."""

from types import SimpleNamespace

import numpy as np
import pytest

from tests.support.chains import X, Y, Z, chain, closures, stated

pytest.importorskip("flint")

from flint import arb, arb_mat

from ccpin.auditing import legs as platform
from ccpin.auditing.closures import BallClosures, exact, floats
from ccpin.auditing.legs import Legs
from ccpin.auditing.reach import CornerBox, Reach

TIPS = np.array([[0.5, 0.0, 0.0], [0.0, 0.75, 0.0], [-0.25, 0.5, 0.0]])
LINKS = (2.0, 3.0, 1.5)


def loop(k, chains, rows):
    """Chains with their two rows among all."""
    return [
        c._replace(weights=np.vstack([np.zeros((2 * k, 3)), c.weights, np.zeros((2 * (rows - k - 1), 3))]))
        for c in chains
    ]


def mechanism(legs=3, axis=Z, weights=(X, Y), **more):
    """Rails q_k at (0, k) along x, each with a link about z, whose end is a point of a body in the plane."""
    weights, count, made = np.array(weights), legs + bool(more.get("other")), []
    body = [
        (2 * legs, np.zeros(3), X, True),
        (2 * legs + 1, np.zeros(3), Y, True),
        (2 * legs + 2, np.zeros(3), axis, False),
    ]
    for k in range(legs):
        leg = chain([(k, k * Y, X, True), (legs + k, 0.25 * X, Z, False)], weights, LINKS[k] * X)
        made += loop(k, [leg, chain(body, -weights, TIPS[k])], count)
    size = 2 * legs + 3
    if count > legs:  # one leg of another body
        leg = chain([(0, 9 * Y, X, True), (size, np.zeros(3), Z, False)], weights, X)
        second = chain([(size + 1, np.zeros(3), Y, True)], -weights, X)
        made += loop(legs, [leg, second], count)
        size += 2
    system = closures(made, size, range(legs))
    system.offset = np.arange(1.0, len(system.offset) + 1) / 8.0
    return Reach(
        BallClosures(document := stated(system, np.zeros(legs), np.ones(legs))),
        document,
        more.get("unbounded", frozenset()),
    )


def test_the_body_that_most_legs_meet_in():
    """Each leg once, cut where it is first not known; one leg is no platform."""
    for other in (False, True):
        found = Legs.of(mechanism(other=other))
        assert [leg.number for leg in found.legs] == [0, 2, 4]
        assert [leg.cut for leg in found.legs] == [1, 1, 1]
        assert [leg.rows for leg in found.legs] == [(0, 1), (2, 3), (4, 5)]
        np.testing.assert_allclose(floats(found.betas), -TIPS[:, :2], atol=1e-15)
        assert [float(leg.far) for leg in found.legs] == pytest.approx(np.linalg.norm(TIPS, axis=1).tolist())
    assert len(Legs.of(mechanism(2)).legs) == 2
    assert Legs.of(mechanism(1)) is None
    assert Legs.of(mechanism(axis=Y)) is None  # the body turns out of the plane
    assert Legs.of(mechanism(weights=(2.0 * X, Y))) is None  # rows see it longer


def test_either_chain_is_the_leg_of_the_other():
    """Turned over, with a joint of each in its place; a leg without dependent joints is not cut."""
    reach = mechanism(2)
    group = reach.groups[0]
    leg = platform._leg(reach, group, 1)
    assert (leg.number, leg.cut) == (1, 0)
    np.testing.assert_allclose(floats(leg.beta)[:, 0], [LINKS[0], 0.0], atol=1e-15)
    assert float(leg.far) == pytest.approx(LINKS[0])
    still = chain([(0, X, X, True)], np.array([X, Y]))
    body = chain([(1, X, X, True), (2, X, Z, False)], -np.array([X, Y]), X)
    system = closures([still, body], 3, [0])
    document = stated(system, [0.0], [1.0])
    reach = Reach(BallClosures(document), document, frozenset())
    assert platform._leg(reach, reach.groups[0], 0).cut == 1


@pytest.mark.parametrize(("tilt", "seen"), [(0.0, True), (0.97e-13, True), (1.03e-13, False), (1.0, False)])
def test_bodies_turn_as_rows_see_them(tilt, seen):
    """About what two rows do not see; slides do as they like; three rows see all turns."""
    still = SimpleNamespace(rotation=exact(np.eye(3)), axis=exact(X), prismatic=True)
    turn = SimpleNamespace(rotation=exact(np.eye(3)), axis=exact(Z + tilt * X), prismatic=False)
    for turns in ([turn], [still, turn], [turn, still]):
        body = SimpleNamespace(turns=turns)
        assert platform._turns_as_seen(body, exact(np.array([X, Y]))) == seen
        assert platform._turns_as_seen(body, exact(np.eye(3)))
        assert not platform._turns_as_seen(body, exact(np.array([Y])))


def test_bodies_are_the_same_where_all_but_the_tip_is():
    reach = mechanism(3, other=True)
    keys = [platform._body(reach, group.rows, group.chains[1]) for group in reach.groups]
    assert keys[0] == keys[1] == keys[2] != keys[3]
    chains = reach.document.chains
    for name in ("joints", "rotations", "translations", "axes", "prismatic", "weights"):
        changed = getattr(chains[1], name).copy()
        changed[0] = ~changed[0] if name == "prismatic" else changed[0] + 1
        reach.document.chains[1] = chains[1]._replace(**{name: changed})
        assert platform._body(reach, reach.groups[0].rows, 1) != keys[1]
        reach.document.chains[1] = chains[1]


def test_vectors_are_uncertain_by_a_little_of_their_size():
    found = platform._blurred(exact(np.array([3.0, -4.0, 12.0])))
    np.testing.assert_array_equal(floats(found)[:, 0], [3.0, -4.0, 12.0])
    np.testing.assert_allclose([float(x.rad()) for x in found.entries()], 13e-11, rtol=1e-4)


@pytest.mark.parametrize(
    ("behind", "low", "high"),
    [
        ([(5, 5)], 5, 5),
        ([(3, 3), (1, 1)], 2, 4),
        ([(1, 1), (3, 3)], 2, 4),
        ([(3, 0), (1, 1)], 0, 4),
        ([(3, 2.5), (1, 1)], 1.5, 4),
        ([(2, 2), (2, 2)], 0, 4),
        ([(1, 1), (1, 1), (5, 5)], 3, 7),
        ([], 0, 0),
    ],
)
def test_lengths_behind_a_head(behind, low, high):
    """From what the longest leaves to all in a line; uncertain by 1e-11 of that and of what is far."""
    found = platform._square([(arb(most), arb(least)) for most, least in behind], arb(0))
    middle, half = 0.5 * (high + low), 0.5 * (high - low)
    assert float(found.mid()) == pytest.approx(middle**2, abs=1e-6)
    assert float(found.rad()) == pytest.approx(2.0 * middle * half + half**2, abs=1e-6)
    for far in (0.0, 20.0):
        (length,) = [platform._square([(arb(5), arb(5))], arb(far))]
        room = 1e-11 * (5.0 + far)
        assert float(length.rad()) == pytest.approx(10.0 * room, rel=1e-3)


def ends_over(half):
    reach = mechanism(3)
    legs = Legs.of(reach)
    low, high = np.zeros(9), np.zeros(9)
    low[:3], high[:3] = np.array([1.0, 2.0, 3.0]) - half, np.array([1.0, 2.0, 3.0]) + half
    low[3:], high[3:] = -1.0, 1.0
    return reach, legs, legs._ends(CornerBox(low, high))


@pytest.mark.parametrize("half", [0.0, 0.25])
def test_heads_of_legs_over_a_box(half):
    """Offsets and rails; the rails' slopes; how far q goes; the links' squares."""
    reach, _, ends = ends_over(half)
    offset = reach.document.offset.reshape(3, 2)
    at = offset + np.array([[1.25, 0.0], [2.25, 1.0], [3.25, 2.0]])
    np.testing.assert_allclose(floats(ends.at), at, atol=1e-15)
    for k in range(3):
        for ball, middle, reached in zip([ends.over[k, 0], ends.over[k, 1]], at[k], (half, 0.0), strict=True):
            assert float(ball.mid()) == pytest.approx(middle, abs=1e-9)
            assert float(ball.rad()) == pytest.approx(reached, abs=1e-8)
        expected = np.zeros((3, 2))
        expected[k, 0] = 1.0
        np.testing.assert_allclose(floats(ends.slopes[k]), expected, atol=1e-15)
        assert float(ends.deltas[k].mid()) == pytest.approx(0.0, abs=1e-9)
        assert float(ends.deltas[k].rad()) == pytest.approx(half, abs=1e-8)
        assert float(ends.squares[k].mid()) == pytest.approx(LINKS[k] ** 2)


def test_a_leg_without_a_length_says_nothing():
    reach, legs, _ = ends_over(0.0)
    legs.reach = SimpleNamespace(**{**vars(reach), "behind": lambda *_: None})
    box = CornerBox(np.zeros(9), np.zeros(9))
    assert legs._ends(box) is None
    assert not legs.cannot_meet(box)


def left_side(at, over, slopes, half, beta, lam, T):
    """tr AᵀNA + Σλ|β|² − |Σλβ|² − ‖T⁻¹‖², and by how much it may fall over a box."""
    W = lam[:, None] * (beta - lam @ beta)
    N = np.diag(lam) - np.outer(lam, lam) - W @ T.T @ T @ W.T
    value = np.trace(at.T @ N @ at) + lam @ np.sum(beta**2, axis=1) - np.sum((lam @ beta) ** 2)
    falls = sum(2.0 * abs(np.sum((N @ over) * slope)) * h for slope, h in zip(slopes, half, strict=True))
    return value - np.sum(np.linalg.inv(T) ** 2), falls


@pytest.mark.parametrize(("size", "count"), [(2, 2), (2, 3), (3, 4)])
@pytest.mark.parametrize("half", [0.0, 0.3])
def test_the_inequality_is_violated_where_its_left_side_is_larger(monkeypatch, size, count, half):
    """Squares of lengths that just are, and just are not, too short for it."""
    rng = np.random.default_rng(10 * size + count)
    for _ in range(5):
        at, beta = rng.normal(size=(2, count, size))
        slopes, weights = rng.normal(size=(2, count, size)), rng.normal(size=count)
        weights[-1] += 1.0 - weights.sum()
        T = rng.normal(size=(size, size)) + 2.0 * np.eye(size)
        monkeypatch.setattr(platform, "_spread", lambda crossed, moved, T=T: T)
        body = object.__new__(Legs)
        body.betas, body.size = exact(beta), size
        reach = np.array([half, 0.5 * half])
        value, falls = left_side(at, at, slopes, reach, beta, weights, T)
        squares = rng.uniform(1.0, 2.0, count)
        for share, violated in ((-1e-6, True), (1e-6, False)):
            off = share * (1.0 + falls)
            needed = squares + (value - falls + off - weights @ squares) / np.sum(weights**2) * weights
            ends = platform._EndBalls(
                exact(at), exact(at), [exact(s) for s in slopes], [arb(0, float(h)) for h in reach],
                [arb(float(x)) for x in needed],
            )  # fmt: skip
            assert body._violated(np.append(weights[:-1], 7.0), ends) == violated  # the last is what is left of 1


def test_what_is_no_number_or_not_invertible_violates_nothing(monkeypatch):
    rng = np.random.default_rng(0)
    ends = platform._EndBalls(*2 * (exact(9.0 * rng.normal(size=(2, 2))),), [arb_mat(2, 2)], [arb(0)], [arb(0)] * 2)
    body = object.__new__(Legs)
    body.betas, body.size = arb_mat(2, 2), 2
    for T in (np.full((2, 2), np.nan), np.array([[1.0, np.inf], [0.0, 1.0]]), np.zeros((2, 2))):
        monkeypatch.setattr(platform, "_spread", lambda crossed, moved, T=T: T)
        assert not body._violated(np.array([0.5, 0.5]), ends)
    monkeypatch.setattr(platform, "_spread", lambda crossed, moved: 10.0 * np.eye(2))
    assert body._violated(np.array([0.5, 0.5]), ends)
