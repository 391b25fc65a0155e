"""Singular curves in the auditor: G's derivatives, tubes and their ends, slanted boxes, and what covers the rest."""

from fractions import Fraction
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("flint")

from flint import arb, arb_mat

from ccpin.auditing import exclusion, singular_curves, slanted
from ccpin.auditing.exclusion import Exclusion
from ccpin.auditing.reach import CornerBox
from ccpin.auditing.slanted import SlantedBox
from tests.support.rows import Quadratic, Rows, exact

TURN = 2.0 * np.pi


def balls(values):
    return [arb(float(x)) for x in values]


class Cubics(Rows):
    """Rows with a third derivative C besides: ⅙ Σ C_ijkl θ_j θ_k θ_l."""

    def __init__(self, c, line, bend, third):
        super().__init__(c, line, bend)
        self.third = np.array(third)

    def _third(self, one, other):
        size = range(self.n_free)
        return arb_mat(self.m, self.n_free, [
            sum((self.third[i, j, k, n] * one[k] * other[n] for k in size for n in size), arb(0))
            for i in range(self.m) for j in size
        ])  # fmt: skip

    def value(self, theta, motions):
        sixth = self._third(theta, theta) * arb_mat(self.n_free, 1, list(theta)) * (arb(1) / 6)
        return super().value(theta, motions) + sixth

    def jacobian(self, motions):
        return super().jacobian(motions) + self._third(motions, motions) * (arb(1) / 2)

    def variation(self, motions, direction):
        bent = super().variation(motions, direction)
        return bent if motions is direction else bent + self._third(motions, direction)  # of the slope at θ itself

    def second_variation(self, motions, one, other):
        return self._third(one, other)


def symmetric(values):
    """A third derivative that does not depend on the order of its arguments."""
    orders = ((0, 1, 2, 3), (0, 1, 3, 2), (0, 2, 1, 3), (0, 2, 3, 1), (0, 3, 1, 2), (0, 3, 2, 1))
    return sum(np.transpose(values, order) for order in orders)


def test_g_and_its_derivatives():
    """G = (φ, φ_y w, lᵀw − 1) and G″ along a direction, against differences."""
    rng = np.random.default_rng(6)
    bend = rng.normal(size=(2, 4, 4))
    third = symmetric(rng.normal(size=(2, 4, 4, 4)))
    closures = Cubics(rng.normal(size=2), rng.normal(size=(2, 4)), bend + bend.transpose(0, 2, 1), third)
    dependent, pairing = np.array([3, 1]), rng.normal(size=2)
    system = singular_curves.Singular(closures, dependent, pairing)
    assert (system.m, system.n_free) == (5, 6)
    x, way = rng.normal(size=(2, 6))

    def at(x, what):
        moved = system.motions(balls(x))
        found = {
            "value": lambda: system.value(balls(x), moved),
            "slope": lambda: system.jacobian(moved),
            "bend": lambda: system.variation(moved, balls(way)),
        }[what]()
        return np.array([float(v) for v in found.entries()]).reshape(found.nrows(), found.ncols())

    def differ(what, direction):
        return (at(x + 1e-5 * direction, what) - at(x - 1e-5 * direction, what)) / 2e-5

    inner = np.array([float(v) for v in closures.jacobian(balls(x[:4])).entries()]).reshape(2, 4)[:, dependent]
    phi = [float(v) for v in closures.value(balls(x[:4]), balls(x[:4])).entries()]
    np.testing.assert_allclose(at(x, "value")[:, 0], [*phi, *(inner @ x[4:]), pairing @ x[4:] - 1.0], atol=1e-12)
    np.testing.assert_allclose(at(x, "slope").T, [differ("value", e)[:, 0] for e in np.eye(6)], atol=1e-7)
    np.testing.assert_allclose(at(x, "bend"), differ("slope", way), atol=1e-7)


# Tubes


def tube_of(centre, tangent, radius, along=0, half=0.5, pairing=(1.0,), system=None, n_free=None):
    """A tube of N numbers with their last as w."""
    size = len(centre) - len(pairing) if n_free is None else n_free
    system = system or SimpleNamespace(
        closures=SimpleNamespace(n_free=size, m=len(pairing)), pairing=balls(pairing), n_free=len(centre)
    )
    tube = SimpleNamespace(
        theta=np.array(centre[:size]), kernel=np.array(centre[size:]), along=along, half=half,
        tangent=np.array(tangent), radius=np.array(radius),
    )  # fmt: skip
    others = np.delete(np.arange(len(centre)), along)
    return singular_curves.TubeEquations(tube, system, balls(centre), balls(tangent), balls(radius), others)


def test_whole_turns_are_taken_off():
    for angle in (0.5, -2.0, 3.1):
        for turns in (-3, 0, 2):
            left = singular_curves.without_turns(arb(angle + TURN * turns, 0.01))
            assert float(left.mid()) == pytest.approx(angle, abs=1e-12)
            assert float(left.rad()) == pytest.approx(0.01, rel=1e-6)


@pytest.mark.parametrize(
    ("changed", "good"),
    [
        ({}, True),
        ({"tangent": (-1.0, 0.5, 2.0)}, True),
        ({"tangent": (1.0 + 1e-15, 0.5, 2.0)}, False),
        ({"tangent": (0.5, 1.0, 2.0)}, False),
        ({"tangent": (2.0, 1.0, 2.0)}, False),
        ({"radius": (1e-300, 0.1, 0.2)}, False),
        ({"half": 0.0}, False),
        ({"half": 1e-300}, True),
        ({"along": 3}, False),
        ({"along": -1, "tangent": (0.5, 0.5, 1.0), "radius": (0.1, 0.1, 0.0)}, False),
    ],
)
@pytest.mark.parametrize("answer", [True, False, None])
def test_a_tube_is_proved_as_a_box(monkeypatch, changed, good, answer):
    """θ_c = x₀, D = t, E = 1 without row j, R without R_j, h = δ."""
    at = {"tangent": (1.0, 0.5, 2.0), "radius": (0.0, 0.1, 0.2), "along": 0, "half": 0.5, **changed}
    if at["along"] == 3:
        made = tube_of((4.0, 5.0, 6.0), (*at["tangent"], 1.0), (*at["radius"], 0.0), 0, at["half"])
        made.tube.along = 3
    else:
        made = tube_of((4.0, 5.0, 6.0), at["tangent"], at["radius"], 0, at["half"])
        made.tube.along = at["along"]
    asked = []
    monkeypatch.setattr(singular_curves, "placed", lambda closures, document, k: made)
    monkeypatch.setattr(singular_curves, "box_proved", lambda system, box, cuts: asked.append(box) or answer)
    assert singular_curves.one_curve(None, None, 0) is (answer if good else False)
    if good:
        (box,) = asked
        assert [float(x) for x in box.centre] == [4.0, 5.0, 6.0]
        assert [float(x) for x in box.directions.entries()] == list(at["tangent"])
        assert [float(x) for x in box.radius] == [0.1, 0.2]
        assert box.half.tolist() == [at["half"]]
        assert box.dependent.tolist() == [1, 2]
        assert box.modes == exact(np.eye(2))


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("second", [True, False])
def test_a_curve_goes_on_by_either_way(monkeypatch, first, second):
    asked = []
    monkeypatch.setattr(singular_curves, "placed", lambda closures, document, k: k)
    monkeypatch.setattr(singular_curves, "turns", lambda closures, document: "turns")

    def begins(inner, outer, turning, sign):
        asked.append((inner, outer, turning, sign))
        return first if sign > 0 else second

    monkeypatch.setattr(singular_curves, "_begins_in", begins)
    assert singular_curves.goes_on(None, None, 4, 7) is ((first or second) or None)
    assert asked == [(7, 4, "turns", 1.0), (4, 7, "turns", -1.0)][: 1 if first else 2]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("places", "good"),
    [
        ({0: 0.5, -0.4: 0.25, -0.1: 0.4}, True),
        ({0: 0.5, -0.4: None, -0.1: 0.4}, True),
        ({0: 0.5, -0.4: 0.75, -0.1: 0.4}, True),
        ({0: 0.5, -0.4: None, -0.1: None}, False),
        ({0: 0.5, -0.4: 0.75, -0.1: 0.75}, False),
        ({0: 0.5, -0.4: 0.5, -0.1: 0.5}, False),
        ({0: 0.5, -0.4: -3.0, -0.1: -3.0}, True),
        ({0: None, -0.4: 0.25, -0.1: 0.4}, False),
        ({0: 0.0, -0.4: -0.25, -0.1: -0.1}, False),
        ({0: -0.1, -0.4: -0.25, -0.1: -0.2}, False),
    ],
)
def test_arcs_run_the_same_way(monkeypatch, sign, places, good):
    """Two zeros of the one in the other, in the same order, the middle's ahead of (behind) its middle."""
    inner = tube_of((0.0, 0.0), (1.0, 0.0), (0.0, 0.1), half=2.0)

    def place_of(one, s, other, turning):
        assert one is inner
        share = round(sign * s / 2.0, 9)
        return None if places[share] is None else arb(sign * places[share])

    monkeypatch.setattr(singular_curves, "_place_of", place_of)
    assert singular_curves._begins_in(inner, None, None, sign) == good


def test_a_zero_is_sought_where_it_is_and_has_a_ball(monkeypatch):
    """x₀ + st; the radius in all coordinates but j; and in the tube itself first."""
    inner = tube_of((4.0, 5.0, 6.0), (1.0, 0.5, 2.0), (0.0, 0.1, 0.2))
    asked, told = [], {}
    found = [(np.array([4.25, 5.5, 6.5]), 0.125)]

    def near(system, others, x):
        asked.append((others.tolist(), x.tolist()))
        return found[0]

    monkeypatch.setattr(singular_curves, "near", near)
    monkeypatch.setattr(singular_curves, "place", lambda x, tube, turning: asked.append(x) or told[id(tube)])
    for first, second, expected in ((None, 2.0, None), (1.0, 2.0, 2.0), (1.0, None, None)):
        outer = object()
        told.update({id(inner): first, id(outer): second})
        asked.clear()
        assert singular_curves._place_of(inner, 0.25, outer, None) is expected
        assert asked[0] == ([1, 2], [4.25, 5.125, 6.5])
        assert [float(b.mid()) for b in asked[1]] == [4.25, 5.5, 6.5]
        assert [float(b.rad()) for b in asked[1]] == pytest.approx([0.0, 0.125, 0.125], rel=1e-6)
    found[0] = None
    assert singular_curves._place_of(inner, 0.25, outer, None) is None


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_place_in_a_tube(sign):
    """s = ±(x_j − x₀_j), |s| ≤ δ, |e| ≤ R, w divided by lᵀw, angles modulo 2π."""
    tube = tube_of((4.0, 5.0, 0.5), (sign, 0.5, 2.0), (0.0, 0.25, 0.125), half=0.5, pairing=(2.0,))
    turning = [False, True, False]

    def told(s, e=0.0, w=0.0, scale=1.0, turns=0, radius=0.0):
        s = np.float64(s)
        x = [arb(4.0 + sign * s), arb(5.0 + 0.5 * s + e + TURN * turns, radius), arb(scale * (0.5 + 2.0 * s + w))]
        return singular_curves.place(x, tube, turning)

    for end in (-1.0, 1.0):
        for s in (0.0, 0.4999 * end):
            # lᵀw = 1 only where w = 1/2: all w are that, divided by their lᵀw
            straight = tube_of((4.0, 5.0, 0.5), (sign, 0.5, 0.0), (0.0, 0.25, 0.125), half=0.5, pairing=(2.0,))
            x = [arb(4.0 + sign * s), arb(5.0 + 0.5 * s), arb(3.0)]
            assert float(singular_curves.place(x, straight, turning)) == pytest.approx(s, abs=1e-12)
            for e, inside in ((0.2499, True), (0.2501, False), (-0.2499, True), (-0.2501, False)):
                x[1] = arb(5.0 + 0.5 * s + e)
                assert (singular_curves.place(x, straight, turning) is not None) == inside
                x[1] += TURN * 7
                assert (singular_curves.place(x, straight, turning) is not None) == inside
                assert singular_curves.place(x, straight, [False] * 3) is None
            x[1] = arb(5.0 + 0.5 * s, 0.2499)
            assert singular_curves.place(x, straight, turning) is not None
            x[1] = arb(5.0 + 0.5 * s, 0.2501)
            assert singular_curves.place(x, straight, turning) is None
        x = [arb(4.0 + 0.5001 * end), arb(5.0 + 0.25 * end * sign), arb(3.0)]
        assert singular_curves.place(x, straight, turning) is None
    # here w = ½ is off x₀ + st by 2s
    assert told(0.06) is not None
    assert told(0.063) is None
    assert singular_curves.place([arb(4.0), arb(5.0), arb(0.0, 1.0)], tube, turning) is None


def test_kernels_are_compared_as_whole_vectors():
    """Of w = (1, 3) with l = (1, 0): (1, 3) again, of (2, 6) too; all w against all of a tube's."""
    tube = tube_of((0.0, 1.0, 3.0), (1.0, 0.0, 0.0), (0.0, 0.1, 0.1), half=0.5, pairing=(1.0, 0.0))
    for scale in (1.0, -2.0, 5.0):
        for third, inside in ((3.0, True), (3.09, True), (3.11, False)):
            x = [arb(0), arb(scale), arb(scale * third)]
            assert (singular_curves.place(x, tube, [False] * 3) is not None) == inside


@pytest.mark.parametrize("k", [0, 1])
@pytest.mark.parametrize("turning", [False, True])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_lies_beyond_a_tube(monkeypatch, k, turning, sign):
    """By |t|δ + R and more, in any coordinate; of an angle, where that and the gap are less than a turn."""
    monkeypatch.setattr(singular_curves, "_beyond", lambda *_: False)
    tube = tube_of((4.0, 5.0, 9.0), (sign, 0.5 * sign, 2.0), (0.25, 0.25, 0.1), half=0.5)
    reach = (0.75, 0.5)[k]

    def told(gap, tube=tube):
        x = balls((4.0, 5.0, 99.0))
        x[k] += gap
        return singular_curves._apart(x, tube, [turning] * 2 + [False])

    for side in (-1.0, 1.0):
        assert told(side * (reach + 1e-6))
        assert not told(side * (reach - 1e-6))
        assert told(side * (TURN + reach / 2.0)) == (not turning)
        wide = tube_of((4.0, 5.0, 9.0), (sign, sign, 2.0), (1.5, 1.5, 0.1), half=1.5)
        assert told(side * 3.1, wide)  # 3.1 and 3 are less than a turn
        broad = tube_of((4.0, 5.0, 9.0), (sign, sign, 2.0), (1.7, 1.7, 0.1), half=1.39)
        assert told(side * 3.2, broad) == (not turning)
    assert not told(0.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_what_lies_beside_a_tube(sign, side):
    """|e_k| > R_k along the tube's own axes, of a tube that is no longer than one in any direction."""
    tube = tube_of((4.0, 5.0, 9.0), (sign, 0.5, 0.1), (0.0, 0.25, 0.1), half=0.5)

    def told(s, e, tube=tube, turning=(False, True, False), turns=0):
        x = [arb(4.0 + sign * s), arb(5.0 + 0.5 * s + e + TURN * turns), arb(77.0)]
        return singular_curves._beyond(x, tube, list(turning))

    for s in (0.3 * side, 0.0, 0.7 * side):
        for turns in (0, -4):
            assert told(s, side * (0.25 + 1e-6), turns=turns)
            assert not told(s, side * (0.25 - 1e-6), turns=turns)
    for tangent, radius, half, short in (
        ((sign, 0.5, 0.1), (0.0, 0.25, 0.1), 0.999, True),
        ((sign, 0.5, 0.1), (0.0, 0.25, 0.1), 1.001, False),
        ((sign, 1.0, 0.1), (0.0, 0.25, 0.1), 0.76, False),
        ((sign, 0.5, 0.1), (0.0, 0.6, 0.1), 0.81, False),
        ((sign, 0.5, 0.1), (0.0, 0.6, 0.1), 0.79, True),
        ((sign, 0.5, 3.0), (0.0, 0.25, 0.1), 0.31, False),
    ):
        other = tube_of((4.0, 5.0, 9.0), tangent, radius, half=half)
        assert told(0.0, side * 1.5, other) == short
    lean = tube_of((4.0, 5.0, 9.0), (0.5, 0.1, sign), (0.25, 0.1, 0.0), along=2, half=0.5)
    assert not told(0.0, side * 1.5, lean)  # j is of w
    second = tube_of((4.0, 5.0, 9.0), (0.5, sign, 0.1), (0.25, 0.0, 0.1), along=1, half=0.5)
    assert singular_curves._beyond([arb(4.0 + side * 0.26), arb(5.0), arb(0)], second, [False] * 3)
    assert not singular_curves._beyond([arb(4.0 + side * 0.24), arb(5.0), arb(0)], second, [False] * 3)


# Slanted boxes


def test_a_box_about_a_slanted_one():
    box = SlantedBox(balls((1.0, 2.0)), 0, np.array([1.0, -0.5]), 0.25, np.array([0.0, -0.125]), np.array([0.0, 0.5]))
    found = box.balls()
    for ball, low, high in zip(found, (0.75, 2.0 - 0.125 - 0.125), (1.25, 2.0 + 0.125 + 0.5), strict=True):
        assert (float(ball.lower()), float(ball.upper())) == pytest.approx((low, high), abs=1e-6)


def some_rows(rng, scale=0.1):
    bend = scale * rng.normal(size=(2, 3, 3))
    return Rows(0.02 * rng.normal(size=2), rng.normal(size=(2, 3)), bend + bend.transpose(0, 2, 1))


@pytest.mark.parametrize("along", [0, 1, 2])
@pytest.mark.parametrize("seed", range(4))
def test_what_lemma_c_leaves(along, seed):
    """−PG − PG′t s − ½(PG″t)t s² + (1 − PG′ − (PG″t)s − ½PG″e)e, term by term, cut with |e| ≤ r."""
    rng = np.random.default_rng(seed)
    system = some_rows(rng)
    others = [k for k in range(3) if k != along]
    x, t, sigma = 0.01 * rng.normal(size=3), rng.normal(size=3), 0.05
    t[along] = 1.0
    low, high = -rng.uniform(0.05, 0.2, 3), rng.uniform(0.05, 0.2, 3)
    low[along] = high[along] = 0.0
    P = np.linalg.inv(system.at(x)[1][:, others]) * (1.0 + 0.05 * rng.normal(size=(2, 2)))
    box = SlantedBox(balls(x), along, t, sigma, low, high)
    left = slanted._narrowed(system, box, exact(P), [arb(0, 99.0)] * 3)
    middle, half = x + 0.5 * (low + high), 0.5 * (high - low)
    value, slope = system.at(middle)
    bent = np.einsum("ri,icd->rcd", P, system.bend)
    wide = np.einsum("ri,icd,d->rc", np.abs(P), np.abs(system.bend), half)
    run, curl = P @ slope @ t, np.einsum("rcd,d->rc", bent, t)
    bend = curl @ t
    for r, k in enumerate(others):
        centre = -(P @ value)[r] - 0.25 * bend[r] * sigma**2
        reach = abs(run[r]) * sigma + 0.25 * abs(bend[r]) * sigma**2
        for c in others:
            rest = abs(float(c == k) - (P @ slope)[r, c]) + abs(curl[r, c]) * sigma + 0.5 * wide[r, c]
            reach += rest * half[c]
        np.testing.assert_allclose(left.low[k], max(-half[k], centre - reach), rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(left.high[k], min(half[k], centre + reach), rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose([float(c) for c in left.centre], middle, atol=1e-15)
    assert left.low[along] == left.high[along] == 0.0


@pytest.mark.parametrize(("low", "high"), [(1.0, 1.5), (-1.5, -1.0), (1000.0, np.nextafter(1000.0, 2000.0))])
@pytest.mark.parametrize("turned", [False, True])
def test_what_is_left_of_a_box_is_about_its_own_middle(low, high, turned):
    """Nothing is cut off where P says nothing."""
    low, high = (-high, -low) if turned else (low, high)
    box = SlantedBox(
        balls((5.0, 0.0, 0.0)), 0, np.array([1.0, 0.0, 0.0]), 0.1, np.array([0, low, -1]), np.array([0, high, 1])
    )
    left = slanted._narrowed(some_rows(np.random.default_rng(0)), box, exact(np.zeros((2, 2))), [arb(0, 1e4)] * 3)
    centre = Fraction(float(left.centre[1].mid()))
    assert centre + Fraction(left.low[1]) <= Fraction(low)
    assert centre + Fraction(left.high[1]) >= Fraction(high)
    np.testing.assert_allclose(left.high[1] - left.low[1], high - low, rtol=1.1 if high - low < 1e-9 else 1e-12)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_nothing_is_left_where_no_zero_is(side):
    """e = c of a line, |e| ≤ ½; or where nothing is in B too."""
    for c, left in ((0.49, True), (0.51, False), (0.75, False), (1.5, False)):
        system = Rows([side * c, 0.0], np.eye(3)[:2])
        box = SlantedBox(
            balls(np.zeros(3)), 2, np.array([0.0, 0.0, 1.0]), 0.1, np.array([-0.5, -0.5, 0]), np.array([0.5, 0.5, 0])
        )
        for order in ([0, 1], [1, 0]):
            turned = Rows(system.c[order], system.line[order])
            P = exact(np.eye(2)[:, order])
            assert (slanted._narrowed(turned, box, P, [arb(0, 9.0)] * 3) is not None) == left
    system = Rows([0.0, 0.0], np.eye(3)[:2])
    for k in range(3):
        for off, meets in ((0.39, True), (0.61, False)):
            within = [arb(0, 9.0)] * 3
            within[k] = arb(side * (off if k < 2 else off - 0.4), 0.1 if k < 2 else 0.01)
            if k == 2:
                within[k] = arb(side * (0.1 if meets else 0.12), 0.01)
            assert (slanted._narrowed(system, box, exact(np.eye(2)), within) is not None) == meets


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("along", [0, 1, 2])
@pytest.mark.parametrize("seed", range(3))
def test_a_slanted_box_in_a_tube(sign, along, seed):
    """|s| ≤ δ and |e| ≤ R at all its corners, angles modulo 2π."""
    rng = np.random.default_rng(seed)
    j = seed
    x, gap, t, tangent = rng.normal(size=(4, 3))
    gap *= 0.1
    t[along], tangent[j] = 1.0, sign
    low, high = -rng.uniform(0.05, 0.2, 3), rng.uniform(0.05, 0.2, 3)
    low[along] = high[along] = 0.0
    sigma = 0.3
    corners = [gap + s * t + e for s in (-sigma, sigma) for e in product(*zip(low, high, strict=True))]
    s = np.array([corner[j] * sign for corner in corners])
    off = np.array([corner - tangent * a for corner, a in zip(corners, s, strict=True)])
    half, radius = np.abs(s).max(), np.abs(off).max(axis=0)
    radius[j] = 0.0
    for turns in (0, 3):
        centre = x + gap
        centre[0] += TURN * turns
        box = SlantedBox(balls(centre), along, t, sigma, low, high)
        fits = tube_of(x, tangent, radius * (1 + 1e-6), along=j, half=half * (1 + 1e-6))
        assert slanted._inside(box, fits, [True, False, False])
        assert slanted._inside(box, fits, [False] * 3) == (turns == 0)
        short = tube_of(x, tangent, radius * (1 + 1e-6), along=j, half=half * (1 - 1e-6))
        assert not slanted._inside(box, short, [True, False, False])
        for k in {0, 1, 2} - {j}:
            narrow = radius * (1 + 1e-6)
            narrow[k] = radius[k] * (1 - 1e-6)
            thin = tube_of(x, tangent, narrow, along=j, half=half * (1 + 1e-6))
            assert not slanted._inside(box, thin, [True, False, False])


def kernel(a, r, pairing, m=1):
    system = SimpleNamespace(closures=SimpleNamespace(m=m), pairing=balls(np.atleast_1d(pairing)))
    entries = zip(np.ravel(a).tolist(), np.ravel(r).tolist(), strict=True)
    return slanted._kernel(system, arb_mat(m, m, [arb(v, s) for v, s in entries]))


def test_kernels_are_enclosed():
    """p = l/(a² + l²) of [a; l], and |1 − PA| u with u = |p|/(1 − |1 − PA|), a millionth more."""
    for a, r, pairing in ((0.5, 0.25, 1.0), (-0.5, 0.25, 0.5), (0.125, 0.5, -2.0)):
        p, reach = kernel(a, r, pairing)
        rest = abs(a) * r / (a * a + pairing**2)
        np.testing.assert_allclose(p, pairing / (a * a + pairing**2), rtol=1e-12)
        np.testing.assert_allclose(reach, rest * (np.abs(p) + 1e-12) / (1 - rest) * (1 + 1e-6), rtol=1e-7)
    for r, good in ((0.99, True), (1.01, False)):
        assert (kernel(1.0, r, 0.0) is not None) == good
    rng = np.random.default_rng(1)
    A, weights = rng.normal(size=(2, 2)), rng.normal(size=2)
    p, reach = kernel(A, np.full((2, 2), 0.01), weights, m=2)
    left = np.linalg.pinv(np.vstack([A, weights]))
    rest = np.abs(left[:, :2]) @ np.full((2, 2), 0.01)
    np.testing.assert_allclose(p, left[:, -1], rtol=1e-12)
    np.testing.assert_allclose(reach, rest @ np.linalg.solve(np.eye(2) - rest, np.abs(p)), rtol=2e-6)


@pytest.mark.parametrize("row", [0, 1])
def test_a_kernel_s_bound_that_is_proposed_is_checked(monkeypatch, row):
    solve, factor = np.linalg.solve, np.ones(2)
    monkeypatch.setattr(np.linalg, "solve", lambda A, b: factor * solve(A, b))
    A, r, weights = np.diag([0.5, 0.25]), np.full((2, 2), 0.1), np.array([1.0, 0.5])
    assert kernel(A, r, weights, m=2) is not None
    for wrong in (0.9, 0.6, 0.1, 0.0, -1.0):
        factor[row] = wrong
        assert kernel(A, r, weights, m=2) is None


def test_a_kernel_that_may_be_any_length_has_no_bound(monkeypatch):
    """|1 − PA| = 1 and p = 0: |w| ≤ |w| says nothing."""
    monkeypatch.setattr(np.linalg, "pinv", lambda A: np.zeros((1, 2)))
    monkeypatch.setattr(np.linalg, "solve", lambda A, b: np.ones(1))
    assert kernel(1.0, 0.0, 0.0) is None


def plane_system(c=0.0, lean=0.0):
    """φ = c + q + ½ y² + l p (1 + y) over q and p: singular along p if l = 0."""
    bend = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, lean], [0.0, lean, 1.0]])
    closures = Rows([c], [[1.0, lean, 0.0]], [bend])
    closures.second_variation = lambda motions, one, other: arb_mat(1, 3)
    return singular_curves.Singular(closures, np.array([2]), np.array([1.0]))


def test_a_box_is_cut_down_to_what_is_about_the_curve(monkeypatch):
    """All of it lies in the slanted box that is narrowed; what is left of it is all of what that leaves."""
    asked = []
    box = CornerBox(np.array([-0.1, 0.3, -0.2]), np.array([0.1, 0.7, 0.05]))
    monkeypatch.setattr(slanted, "_narrowed", lambda system, found, P, within: asked.append((found, within)))
    monkeypatch.setattr(slanted, "_kernel", lambda system, inner: (np.array([1.0]), np.array([0.25])))
    lean = plane_system(lean=0.5)
    assert slanted.cut_down(box, lean, None, [False] * 4) is None
    found, within = asked[0]
    assert [float(x.mid()) for x in within[:3]] == pytest.approx(box.middle.tolist())
    extent, x = np.array([0.1, 0.2, 0.125, 0.25]), np.array([0.0, 0.5, -0.075, 1.0])
    np.testing.assert_allclose([float(c) for c in found.centre], x, atol=1e-15)
    j = found.along
    assert found.tangent[j] == 1.0
    assert found.half == pytest.approx(extent[j], rel=1e-6)
    extent[j] = found.half
    e = extent + np.abs(found.tangent) * extent[j]
    e[j] = 0.0
    np.testing.assert_allclose(found.high[e > 0] / e[e > 0] - 1.0, 1e-12, rtol=1e-3)
    np.testing.assert_array_equal(found.low, -found.high)
    assert found.high[j] == 0.0
    assert np.abs(found.tangent).max() > 0.1
    thin = CornerBox(np.array([1000.0, 0.3, -0.2]), np.array([np.nextafter(1000.0, np.inf), 0.7, 0.05]))
    slanted.cut_down(thin, plane_system(-1000.0), None, [False] * 4)
    found, _ = asked[-1]
    ends = [Fraction(float(found.centre[0].mid())) + side * Fraction(found.high[0]) for side in (-1, 1)]
    assert ends[0] <= Fraction(thin.low[0])
    assert ends[1] >= Fraction(thin.high[0])
    small = found._replace(tangent=np.zeros(4), half=0.0, centre=balls((0.05, 0.5, -0.1, 1.0)),
                           low=np.array([-0.02, -0.5, -0.05, 0.0]), high=np.array([0.5, 0.01, 0.05, 0.0]))  # fmt: skip
    monkeypatch.setattr(slanted, "_narrowed", lambda *_: small)
    left = slanted.cut_down(box, plane_system(), None, [False] * 4)
    np.testing.assert_allclose([left.low, left.high], [[0.03, 0.3, -0.15], [0.1, 0.51, -0.05]], atol=1e-7)
    for inside, expected in ((True, type(None)), (False, CornerBox)):
        monkeypatch.setattr(slanted, "_inside", lambda *_, answer=inside: answer)
        assert type(slanted.cut_down(box, plane_system(), "a tube", [False] * 4)) is expected
    for centre in ((-0.25, 0.5, -0.1, 1.0), (0.05, 0.5, -0.29, 1.0), (0.05, 0.5, 0.2, 1.0)):
        off = small._replace(centre=balls(centre), low=np.full(4, -0.05), high=np.full(4, 0.05))
        monkeypatch.setattr(slanted, "_narrowed", lambda *_, left=off: left)
        assert slanted.cut_down(box, plane_system(), None, [False] * 4) is None


def test_boxes_off_a_fold_are_empty_and_boxes_on_it_keep_it():
    """q = −c, y = 0 along p, wherever in a box."""
    for c in (0.0, 0.03, -0.04):
        for y in (-0.04, 0.0, 0.04):
            box = CornerBox(np.array([-0.05, 0.2, y - 0.05]), np.array([0.05, 0.3, y + 0.05]))
            left = slanted.cut_down(box, plane_system(c), None, [False] * 4)
            assert left is not None
            assert np.all((left.low <= [-c, 0.2, 0.0]) & (left.high >= [-c, 0.3, 0.0]))
            assert left.half[[0, 2]].max() < 0.02
    for c in (0.06, -0.2):
        box = CornerBox(np.array([-0.05, 0.2, -0.01]), np.array([0.05, 0.3, 0.01]))
        assert slanted.cut_down(box, plane_system(c), None, [False] * 4) is None
    level = slanted.cut_down(CornerBox(np.full(3, -3.0), np.full(3, 3.0)), plane_system(), None, [False] * 4)
    assert level is None or np.all((level.low <= 0.0) & (level.high >= 0.0))


# The cover


def cover(n=2, listed=((), ()), free=None, **more):
    """A cover without what it makes of a document."""
    made = object.__new__(Exclusion)
    low, high = (np.reshape(ends, (-1, n)) for ends in listed)
    made._free = np.array([False] * n if free is None else free)
    made._listed, made._reach = 0.5 * (low + high), 0.5 * (high - low) + 1e-12
    made.reach = SimpleNamespace(too_far=lambda box: False, first=np.arange(n))
    vars(made).update(more)
    return made


def box(*ends):
    return CornerBox(*np.array(ends, dtype=float).T)


def test_what_a_cover_makes_of_a_document(monkeypatch):
    """|t|δ + R, and listed boxes 1e-12 wider."""
    tubes = [tube_of((1.0, 2.0, 3.0), (-1.0, 0.5, 2.0), (0.0, 0.25, 0.125), half=0.5)]
    document = SimpleNamespace(
        tubes=[t.tube for t in tubes], uncovered_lower=np.array([[1.0, -4.0]]), uncovered_upper=np.array([[2.0, 8.0]]),
        sizes=np.array([1]),
    )  # fmt: skip
    monkeypatch.setattr(exclusion, "turns", lambda closures, document: [True, False, False])
    monkeypatch.setattr(exclusion, "placed", lambda closures, document, k: tubes[k])
    monkeypatch.setattr(exclusion, "Reach", lambda *_: None)
    monkeypatch.setattr(exclusion, "parts", lambda *_: [])
    found = Exclusion(SimpleNamespace(n_free=2), document)
    np.testing.assert_allclose(found._extents, [[0.5, 0.5, 1.125]])
    np.testing.assert_allclose(found._listed, [[1.5, 2.0]])
    np.testing.assert_allclose(found._reach - [[0.5, 6.0]], 1e-12, rtol=1e-3)
    np.testing.assert_array_equal(found._middles, [[1.0, 2.0]])
    assert found._free.tolist() == [True, False]


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("axis", [0, 1])
def test_boxes_are_listed_where_one_listed_box_holds_all_of_them(side, axis):
    """Up to its end, angles modulo 2π."""
    some = cover(2, (((-1.0, 2.0), (50.0, 50.0)), ((1.0, 6.0), (51.0, 51.0))), [True, False])
    reach = (1.0, 2.0)[axis]
    for turns in (-1, 0, 5):
        for over, listed in ((-1e-9, True), (1e-9, False)):
            for half in (0.25, 0.0):
                middle = np.array([TURN * turns, 4.0])
                middle[axis] += side * (reach - half + over)
                part = CornerBox(middle - half, middle + half)
                assert some._is_listed(part) == listed
                other = cover(2, (((-1.0, 2.0),), ((1.0, 6.0),)))
                assert other._is_listed(part) == (listed and turns == 0)
    assert not cover(2)._is_listed(box((0, 1), (0, 1)))
    wide = box((-1.01, 1.01), (3.0, 5.0))
    assert not some._is_listed(wide)


def test_listed_boxes_are_wider_by_a_little():
    some = cover(1, (((0.0,),), ((1.0,),)))
    assert some._is_listed(box((-0.9e-12, 1.0)))
    assert not some._is_listed(box((-1.2e-12, 1.0)))
    np.testing.assert_allclose(some._gaps(np.array([3.0]), some._listed), [[2.5]])


def test_a_box_is_cut_where_a_listed_box_ends():
    """Half of a 1e-12 within it; that of which most is held, along the axis of which least is."""
    some = cover(2, (((0.5, -9.0), (9.0, 9.0)), ((9.0, 9.0), (10.0, 10.0))))
    axis, place = some._face(box((0, 1), (0, 1)))
    assert axis == 0
    assert 0.5 - 0.6e-12 < place < 0.5 - 0.4e-12
    left = cover(2, (((-9.0, -9.0),), ((0.5, 9.0),)))
    axis, place = left._face(box((0, 1), (0, 1)))
    assert axis == 0
    assert 0.5 + 0.4e-12 < place < 0.5 + 0.6e-12
    middle = cover(2, (((0.2, 0.1),), ((0.7, 0.95),)))
    axis, place = middle._face(box((0, 1), (0, 1)))
    assert (axis, round(place, 9)) == (0, 0.7)
    axis, place = cover(2, (((0.3, 0.1),), ((0.8, 0.95),)))._face(box((0, 1), (0, 1)))
    assert (axis, round(place, 9)) == (0, 0.3)
    axis, place = cover(2, (((0.3, 0.1),), ((0.8, 0.95),)), [True, False])._face(box((TURN, TURN + 1), (0, 1)))
    assert (axis, round(place - TURN, 9)) == (0, 0.3)
    assert cover(2, (((0.3, 0.1),), ((0.49, 0.95),)))._face(box((0, 1), (0, 1))) is None  # 0.16 of it
    assert cover(2, (((0.3, 0.1),), ((0.55, 0.95),)))._face(box((0, 1), (0, 1))) is not None
    assert cover(2, (((-1, -1),), ((2, 2),)))._face(box((0, 1), (0, 1))) is None  # all of it
    assert cover(2, (((3.0, -1),), ((4.0, 2),)))._face(box((0, 1), (0, 1))) is None
    assert cover(2)._face(box((0, 1), (0, 1))) is None
    flat = cover(2, (((-1.0, -1.0),), ((2.0, 2.0),)))._face(box((0, 1), (0.5, 0.5)))
    assert flat is None


@pytest.mark.parametrize("turns", [-2, 0, 1])
def test_tubes_beside_a_configuration(turns):
    """Within twice their box of θ, in all coordinates, angles modulo 2π."""
    some = cover(2, free=[True, False])
    some._middles, some._extents = np.array([[3.0, 1.0], [30.0, 30.0]]), np.array([[0.5, 0.25, 9.0], [0.1, 0.1, 9.0]])
    for off, beside in ((0.99, [0]), (1.01, [])):
        for side in (-1.0, 1.0):
            assert some.beside(np.array([3.0 + TURN * turns + side * off, 1.0])) == beside
            assert some.beside(np.array([3.0 + TURN * turns, 1.0 + side * off / 2.0])) == beside
    assert some.beside(np.array([3.0, 1.0 + TURN])) == []
    assert some.beside(np.array([3.0 + 40.0 * TURN, 1.0])) == [0]
    some._extents = np.zeros((2, 3))
    assert some.beside(np.array([3.0 + 0.9e-12, 1.0])) == [0]
    assert some.beside(np.array([3.0 + 2e-12, 1.0])) == []
    some._middles = np.zeros((0, 2))
    assert some.beside(np.zeros(2)) == []


def test_rows_known_modulo_something_move_little():
    some = cover(closures=SimpleNamespace(moduli=np.array([0.0, 2.0, 4.0])))
    for radii, over in (((99.0, 0.19, 0.39), False), ((0.0, 0.21, 0.0), True), ((0.0, 0.0, 0.41), True)):
        assert some._turns_over(arb_mat(3, 1, [arb(0, r) for r in radii])) == over


class Seen:
    """Which boxes a search looked at."""

    def __init__(self, holds):
        self.holds, self.boxes = holds, []

    def __call__(self, part):
        self.boxes.append(part)
        return part if self.holds(part) else None


def test_every_part_of_a_part_is_looked_at(monkeypatch):
    """Until nothing is left; not proved where something stays that is narrow, or takes too long."""
    some = cover(2, parts=[box((8, 9), (8, 9)), box((0, 1), (0, 2))])
    some._steepest = lambda part: int(np.argmax(part.half))
    some._left_of = Seen(lambda part: part.half.max() > 0.3)
    assert some.proved(1) is True
    last = [part for part in some._left_of.boxes if part.half.max() <= 0.3]
    assert sum(np.prod(2.0 * part.half) for part in last) == pytest.approx(2.0)
    assert len({(*part.low, *part.high) for part in last}) == len(last)
    root = np.array([0.3, 1.7])
    some._left_of = Seen(lambda part: np.all((part.low <= root) & (root <= part.high)))
    assert some.proved(1) is None
    assert 0.5e-6 / 2 < some._left_of.boxes[-1].half.max() < 1e-6
    monkeypatch.setattr(exclusion, "_BUDGET", 7)
    some._left_of = Seen(lambda part: True)
    assert some.proved(1) is None
    assert len(some._left_of.boxes) == 7
    some._left_of = lambda part: None
    assert some.proved(1) is True


def test_parts_are_cut_at_listed_faces_and_taken_as_they_shrink():
    some = cover(2, (((0.5, -9.0),), ((9.0, 9.0),)), parts=[box((0, 1), (0, 2))])
    some._steepest = lambda part: int(np.argmax(part.half))
    some._left_of = Seen(lambda part: part.high[0] > 0.55 and not some._is_listed(part))
    assert some.proved(0) is True
    assert len(some._left_of.boxes) == 3
    smaller = box((0.1, 0.2), (0.1, 0.2))
    plain = cover(2, parts=[box((0, 1), (0, 2))])
    seen = []
    plain._left_of = lambda part: seen.append(part) or (None if part is smaller else smaller)
    assert plain.proved(0) is True
    assert seen[1:] == [smaller]


def left_of(closures, part, **more):
    some = cover(
        closures.n_free, closures=closures, document=SimpleNamespace(dependent=np.array([closures.n_free - 1]))
    )
    closures.moduli = np.zeros(closures.m)
    some._beside_curves = lambda part: "beside"
    vars(some).update(more)
    return some._left_of(part)


def test_what_may_be_singular_is_left_of_a_box():
    """φ = c + q + ½ y²: nothing where φ has no zero or φ_y none; else what closes, and what is beside curves."""

    def fold(c=0.0, slope=0.0):
        return Rows([c], [[1.0, slope]], [np.diag([0.0, 1.0])])

    on = box((-0.3, 0.3), (-0.3, 0.3))
    assert left_of(fold(), on).half.max() == 0.3
    assert left_of(fold(), box((-0.1, 0.1), (-0.1, 0.1))) == "beside"
    assert left_of(fold(), box((-0.1, 0.1), (-0.149, 0.149))) == "beside"
    assert left_of(fold(), box((-0.3, 0.3), (-0.151, 0.151))).half.max() > 0.15
    assert left_of(fold(), on, _is_listed=lambda part: True) is None
    assert left_of(fold(), on, reach=SimpleNamespace(too_far=lambda part: True)) is None
    assert left_of(fold(1.0), on) is None
    assert left_of(fold(-1.0), on) is None
    for low, regular in ((0.01, True), (-0.01, False)):
        assert (left_of(fold(), box((-0.5, 0.5), (low, 0.3))) is None) == regular
    wide = box((-2, 2), (-1, 1))
    assert left_of(fold(), wide, _free=np.array([False, True])) is wide
    assert left_of(fold(), wide, _free=np.array([True, False])) is wide
    over = box((-0.3, 0.3), (-0.8, 0.8))
    assert left_of(fold(), over, _turns_over=lambda phi: True) is over
    assert left_of(fold(), over, _free=np.array([False, True])) is not over
    long = box((-2, 2), (-0.1, 0.1))
    assert left_of(fold(), long, _free=np.array([True, True])) is long
    assert left_of(fold(), long, _free=np.array([False, True])) is not long
    assert left_of(fold(), over, _closing=lambda *_: None) is None
    two = Rows([0.0, 5.0], [[1.0, 0, 0], [0, 1, 0]])
    assert left_of(two, box((-1, 1), (-1, 1), (-1, 1))) is None
    two.c[:] = [5.0, 0.0]
    assert left_of(two, box((-1, 1), (-1, 1), (-1, 1))) is None


def closing(closures, part):
    some = cover(closures.n_free, closures=closures)
    at = exclusion._Middle.of(closures, part)
    return some._closing(part, closures.jacobian(closures.motions(part.balls())), at)


def test_what_closes_is_left():
    """Of a line 0 = c + 4 q + y: q = −(c + y)/4, over y; nothing where rows leave nothing in common."""
    left = closing(Rows([0.5], [[4.0, 1.0]]), box((-3, 3), (-1, 2)))
    np.testing.assert_allclose([left.low, left.high], [[-0.625, -1.0], [0.125, 2.0]], atol=1e-6)
    kept = closing(Rows([0.5], [[4.0, 1.0]]), box((-0.5, 0.0), (-1, 2)))
    np.testing.assert_array_equal([kept.low, kept.high], [[-0.5, -1.0], [0.0, 2.0]])
    assert closing(Rows([0.5], [[4.0, 1.0]]), box((0.2, 3), (-1, 2))) is None
    flat = box((-1, 1), (-1, 1))
    assert closing(Rows([0.0], [[0.0, 0.0]]), flat) is flat
    two = closing(Rows([0.5, -1.0], [[4.0, 0, 1.0], [0, 8.0, 1.0]]), box((-3, 3), (-3, 3), (-1, 2)))
    np.testing.assert_allclose([two.low[:2], two.high[:2]], [[-0.625, -0.125], [0.125, 0.25]], atol=1e-6)


def test_what_is_searched_is_a_little_more_than_there_is(monkeypatch):
    """1e-12 of one more than the larger end; what is stated where nothing is found."""
    ends = CornerBox(np.array([-3.0, -np.inf, 1.0]), np.array([2.0, 9.0, np.inf]))
    monkeypatch.setattr(exclusion, "intervals", lambda reach: ends)
    monkeypatch.setattr(exclusion, "Reach", lambda *_: SimpleNamespace(first=np.array([1, 0])))
    ranges = SimpleNamespace(lower=np.array([-7.0, -5.0]), upper=np.array([8.0, 6.0]))
    document = SimpleNamespace(dependent=np.array([1, 2]), ranges=ranges)
    found = exclusion.searched(None, document)
    np.testing.assert_array_equal(np.round([found.low, found.high], 9), [[-3.0, -7.0, 1.0], [2.0, 9.0, 6.0]])
    room = np.array([4.0, 10.0, 7.0])
    np.testing.assert_allclose(1e12 * (np.array([-3.0, -7.0, 1.0]) - found.low), room, rtol=2e-3)
    np.testing.assert_allclose(1e12 * (found.high - [2.0, 9.0, 6.0]), room, rtol=2e-3)
    document.uncovered_lower = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    document.uncovered_upper = np.array([[2.5, 4.0, 99.0], [1.0, 1.6, 1.0]])
    share = 2.5 / 5.0 * 4.0 / 16.0 + 1.0 / 5.0 * 1.6 / 16.0 * 1.0 / 5.0
    assert exclusion.listed_share(None, document) == pytest.approx(share, rel=1e-9)
    document.uncovered_lower = document.uncovered_upper - 1.0
    assert exclusion.listed_share(None, document) == pytest.approx(2.0 / (5.0 * 16.0 * 5.0), rel=1e-9)
    document.uncovered_upper += 1e3
    assert exclusion.listed_share(None, document) == 1.0


@pytest.mark.parametrize(("wide", "count"), [(1, 64), (25.5, 64), (25.7, 128), (51.1, 128), (51.3, 256), (1e9, 1024)])
def test_parts_tile_what_is_searched(monkeypatch, wide, count):
    """Six times halved, and on until they are 0.4 wide, ten times at most; along first coordinates alone."""
    whole = box((0, wide), (-1, 2), (5, 5.1))
    monkeypatch.setattr(exclusion, "searched", lambda *_: whole)
    monkeypatch.setattr(exclusion, "Reach", lambda *_: SimpleNamespace(first=np.array([0, 2])))
    found = exclusion.parts(None, None)
    assert len(found) == count
    assert sum(np.prod(2.0 * part.half) for part in found) == pytest.approx(wide * 3.0 * 0.1)
    assert len({(*part.low, *part.high) for part in found}) == count
    assert all(part.low[1] == -1.0 and part.high[1] == 2.0 for part in found)


def test_tubes_that_may_hold_a_box_are_tried(monkeypatch):
    """One after the other, with their own l; nothing is left as soon as one leaves nothing."""
    some = cover(
        2,
        free=[True, False],
        turning="turning",
        closures=Quadratic(),
        document=SimpleNamespace(dependent=np.array([1])),
    )
    some._middles, some._lengths = np.array([[1.0 + TURN, 1.0], [1.0, 1.5], [9.0, 9.0]]), np.array([0.4, 0.2, 1.0])
    some.tubes = [SimpleNamespace(system=k) for k in range(3)]
    part = box((0.9, 1.1), (0.8, 1.2))
    assert some._near(part) == [0, 1]
    asked = []
    answers = {0: "less", 1: None}

    def cut_down(box, system, tube, turning):
        asked.append((box, system, tube, turning))
        return answers[system]

    monkeypatch.setattr(exclusion, "cut_down", cut_down)
    assert some._beside_curves(part) is None
    assert asked == [(part, 0, some.tubes[0], "turning"), ("less", 1, some.tubes[1], "turning")]
    answers[0] = None
    asked.clear()
    assert some._beside_curves(part) is None
    assert len(asked) == 1
    alone = []
    monkeypatch.setattr(exclusion, "cut_down", lambda box, system, tube, turning: alone.append((box, tube)) or "left")
    some._lengths = np.array([0.1, 0.1, 0.1])
    assert some._beside_curves(part) == "left"
    assert alone == [(part, None)]
