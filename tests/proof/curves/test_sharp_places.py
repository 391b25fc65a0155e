"""Where a curve's points are, and where they lie in tubes: the bounds attained, and each comparison at equality."""

import numpy as np
import pytest

from ccpin.proof.curves import tubes as module
from ccpin.proof.curves.tubes import Places, Points, Tubes, glued, places_in, zeros_in
from tests.support.straight_curves import PROBLEM

ROOM = 1e-13
SLACK = 1.0 + 1e-10


def tube(**others):
    """One tube in (θ₁, θ₂, w) along θ₁, w free: its curve is about (0, 0, ½), l = 2."""
    made = {
        "theta": np.zeros((1, 2)), "kernel": np.full((1, 1), 0.5), "pairing": np.full((1, 1), 2.0),
        "along": np.zeros(1, dtype=np.intp), "tangent": np.array([[1.0, -0.5, 0.25]]), "half": np.ones(1),
        "radius": np.array([[0.0, 0.5, 0.5]]), "gain": np.zeros((1, 3, 2)), "kappa": np.zeros(1),
        "hull": np.zeros((1, 3)),
    }  # fmt: skip
    return Tubes(**(made | others))


def solved(monkeypatch, zero, share=0.5, noise=0.0, s=0.0, **others):
    """The zero of G = (θ₂ − z₁, w − z₂) in a tube whose P is `share` of its inverse: κ = 1 − share."""
    gain = np.zeros((1, 3, 2))
    gain[0, 1, 0] = gain[0, 2, 1] = share

    def first_order(problem, theta, kernel, pairing):
        return np.concatenate([theta[:, 1:], kernel], axis=1) - zero, None

    monkeypatch.setattr(module, "first_order", first_order)
    monkeypatch.setattr(module, "rounding_at", lambda *_: np.array([noise]))
    given = tube(gain=gain, kappa=np.array([1.0 - share]), **others)
    return zeros_in(PROBLEM, given, np.array([s]))


def test_zeros_are_within_their_error(monkeypatch):
    """‖x − x*‖ ≤ ‖PG‖/(1 − κ) in the norm of R, attained where G is linear and P a share of its inverse."""
    found = solved(monkeypatch, np.array([0.1, 0.7]))
    off = 0.5**4 * np.array([0.1, 0.2])  # four chords, each halves what is left
    np.testing.assert_allclose(found.x[0], [0.0, 0.1 - off[0], 0.7 - off[1]], rtol=1e-14, atol=1e-16)
    np.testing.assert_allclose(found.error[0], [ROOM, off[1] * SLACK, off[1] * SLACK], rtol=2e-11, atol=3e-13)
    assert found.error[0, 2] - off[1] * SLACK == pytest.approx(ROOM * (1 + found.x[0, 2]), rel=1e-2, abs=0.0)
    found = solved(monkeypatch, np.array([0.1, 0.7]), radius=np.array([[0.0, 0.25, 0.5]]))
    np.testing.assert_allclose(found.error[0, 1:], off * SLACK, rtol=2e-11)


def test_zeros_begin_where_they_are_asked(monkeypatch):
    """At s = ½ the tube's middle line is at (½, −¼, 5/8)."""
    found = solved(monkeypatch, np.array([-0.25, 0.625]), s=0.5)
    np.testing.assert_array_equal(found.x[0], [0.5, -0.25, 0.625])
    np.testing.assert_allclose(found.error[0], ROOM * (1 + np.abs(found.x[0])), rtol=1e-12)


def test_zeros_know_what_is_rounded(monkeypatch):
    """|P| times the rounding of G's rows is added to what is left."""
    found = solved(monkeypatch, np.array([0.0, 0.5]), noise=1e-3)
    np.testing.assert_allclose(found.error[0, 1:], 1e-3 * SLACK, rtol=1e-9)


def test_zeros_stay_in_their_tubes(monkeypatch):
    """A chord that leads out is not gone; one that just leads to the end is."""
    out = solved(monkeypatch, np.array([1.001, 0.5]))
    np.testing.assert_array_equal(out.x[0], [0.0, 0.0, 0.5])
    assert out.error[0, 1] >= 1.001
    end = solved(monkeypatch, np.array([1.0, 0.5]), radius=np.array([[0.0, 0.5, 0.5]]))
    assert end.x[0, 1] == 0.5
    along = solved(monkeypatch, np.array([-0.45 - 0.25, 0.5]), s=0.5, share=1.0)
    assert along.x[0, 1] == pytest.approx(-0.7, rel=1e-12)


def placed(x, error=(0.0, 0.0, 0.0), **others):
    return places_in(PROBLEM, Points(np.array([x]), np.array([error])), tube(**others))


def test_places_along():
    """s is θ₁'s way times the tangent's sign; it is inside while |s| and its error are within δ."""
    for x, way in ((0.5, 1.0), (-0.5, 1.0), (0.5, -1.0), (0.5 + 2 * np.pi, 1.0), (0.5 - 4 * np.pi, 1.0)):
        tangent = way * np.array([[1.0, 0.0, 0.0]])
        s = way * (x - 2 * np.pi * np.round(x / 2 / np.pi))
        wide = 0.01 + ROOM * (1 + abs(x))
        found = placed((x, 0.0, 3.0), (0.01, 0.0, 0.0), tangent=tangent)
        assert found.s[0] == pytest.approx(s, abs=1e-15)
        assert found.error[0] == pytest.approx(wide, abs=1e-15)
        for share, inside in ((1 + 1e-13, True), (1 - 1e-13, False)):
            half = np.array([(abs(s) + wide) * share])
            assert placed((x, 0.0, 3.0), (0.01, 0.0, 0.0), tangent=tangent, half=half).inside[0] == inside


def test_places_are_told_from_the_tubes_middle():
    """Of a tube about (0.3, 0.1, 0.5) the point (0.5, 0.1, 3) lies 0.2 on, and 0.1 beside where its tangent leads."""
    about = {"theta": np.array([[0.3, 0.1]]), "tangent": np.array([[1.0, -0.5, 0.0]])}
    for radius, inside in ((0.1 + 1e-9, True), (0.1 - 1e-9, False)):
        found = placed((0.5, 0.1, 3.0), radius=np.array([[0.0, radius, 0.5]]), **about)
        assert found.s[0] == pytest.approx(0.2, abs=1e-15)
        assert found.inside[0] == inside


@pytest.mark.parametrize(("share", "inside"), [(1 + 1.1e-10, True), (1 + 0.9e-10, False), (1 - 1e-9, False)])
def test_places_across(share, inside):
    """|gap − t s| + error + |t| (error of s) within R."""
    x, error = (0.5, 0.2, 3.0), (0.01, 0.02, 0.0)
    wide = 0.01 + 1.5 * ROOM
    off = abs(0.2 + 0.5 * 0.5) + 0.02 + 1.2 * ROOM + 0.5 * wide
    radius = np.array([[0.0, off * share, 0.5]])
    assert placed(x, error, radius=radius).inside[0] == inside


@pytest.mark.parametrize(("share", "inside"), [(1 + 1.1e-10, True), (1 + 0.9e-10, False), (1 - 1e-9, False)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_places_of_kernels(share, inside, sign):
    """w is divided by lᵀw: of 3 ± 0.1 with l = 2 it is ½, off by (0.1 + ½ 0.2)/(6 − 0.2) at most."""
    x, error = (0.4, -0.2, sign * 3.0), (0.0, 0.0, 0.1)
    blur = 0.2 * SLACK + ROOM
    wide = ROOM * 1.4
    off = 0.25 * 0.4 + (0.1 + 0.5 * blur) / (6.0 - blur) + ROOM * 4.0 + 0.25 * wide
    radius = np.array([[0.0, 0.5, off * share]])
    assert placed(x, error, radius=radius).inside[0] == inside


def test_places_of_kernels_whose_length_may_be_zero():
    """|lᵀw| is to be above its own error, or nothing is known of w/lᵀw."""
    wide = {"radius": np.array([[0.0, 1e300, 1e300]])}
    for kernel, inside in ((0.1 + 1e-12, True), (0.1 + 2e-14, False), (0.1, False), (0.05, False), (0.0, False)):
        assert placed((0.0, 0.0, kernel), (0.0, 0.0, 0.1 / SLACK), **wide).inside[0] == inside


# Gluing.


@pytest.fixture
def script(monkeypatch):
    """Places are told, not found: (inside, s, error) by what is asked, s of a zero in a tube that runs along `way`."""

    def told(answers):
        monkeypatch.setattr(module, "zeros_in", lambda problem, tubes, s: (tubes, s))

        def places(problem, points, tubes):
            (of, s), before = points, tubes
            inside, at, error = answers(float(of.kernel[0, 0]), float(of.tangent[0, 0]), float(s[0]), before)
            return Places(np.array([inside]), np.array([at]), np.array([error]))

        monkeypatch.setattr(module, "places_in", places)

    return told


def pair():
    first, following = tube(kernel=np.full((1, 1), 1.0)), tube(kernel=np.full((1, 1), 2.0), half=np.full(1, 0.5))
    return first, following


@pytest.mark.parametrize(
    ("last", "first", "same"),
    [
        ((True, 0.5, 0.1), (True, 0.2, 0.1), True),
        ((True, 0.1, 0.1), (True, -0.5, 0.1), False),
        ((True, 0.101, 0.1), (True, -0.5, 0.1), True),
        ((True, 0.5, 0.1), (True, 0.3, 0.1), False),
        ((True, 0.5, 0.1), (True, 0.299, 0.1), True),
        ((True, 0.5, 0.1), (True, 0.35, 0.04), True),
        ((True, 0.5, 0.1), (True, 0.37, 0.04), False),
        ((False, 0.5, 0.1), (True, 0.2, 0.1), False),
        ((True, 0.5, 0.1), (False, 0.2, 0.1), False),
        ((True, -0.5, 0.1), (True, -0.8, 0.1), False),
    ],
)
def test_tubes_are_glued_by_two_zeros_in_one_order(script, last, first, same):
    """The later one a tube's middle, ahead of the other tube's middle."""

    def answers(of, way, s, before):
        if of == 1.0:  # the first tube's zeros, in the following one: asked where the others do not show it
            return False, 0.0, 0.0
        return last if s == 0.0 else first

    script(answers)
    assert glued(PROBLEM, *pair())[0] == same


def test_tubes_are_glued_from_either_side(script):
    """Turned round, the following tube is the one before."""

    def answers(of, way, s, before):
        if of == 2.0:
            return False, 0.0, 0.0
        assert way == -1.0
        assert before.tangent[0, 0] == -1.0
        return (True, 0.5, 0.1) if s == 0.0 else (True, 0.2, 0.1)

    script(answers)
    assert glued(PROBLEM, *pair())[0]


def test_the_earlier_zero_is_behind_the_middle(script):
    """It is asked at −s, s within δ = ½."""
    asked = []

    def answers(of, way, s, before):
        asked.append((of, s))
        return True, 0.5, 0.1

    script(answers)
    assert not glued(PROBLEM, *pair())[0]
    assert all(-0.5 < s <= 0.0 for of, s in asked if of == 2.0)
    assert any(s < 0.0 for _, s in asked)


def test_of_several_tubes_each_is_glued_for_itself(monkeypatch):
    """One whose middle is not ahead, or not inside, is not glued because another one is."""
    two = tube()._replace(**{name: np.repeat(value, 3, axis=0) for name, value in tube()._asdict().items()})
    monkeypatch.setattr(module, "zeros_in", lambda problem, tubes, s: s)

    def places(problem, s, tubes):
        if not np.any(s):
            return Places(np.array([True, True, False]), np.array([0.5, 0.05, 0.5]), np.full(3, 0.1))
        return Places(np.ones(3, dtype=bool), np.array([0.2, -0.5, 0.2]), np.full(3, 0.1))

    monkeypatch.setattr(module, "places_in", places)
    assert module._begin_in(PROBLEM, two, two).tolist() == [True, False, False]
