"""Balls as sums of doubles: the same numbers, or a little more."""

from fractions import Fraction

import numpy as np
import pytest

pytest.importorskip("flint")

from ccpin.validated.arithmetic.balls import ball, flint, with_radius
from ccpin.validated.arithmetic.exact_numbers import ExactBox, boxed, centres, exact_box

THIRD = Fraction(1, 3)


def arb(*numbers):
    return flint().arb(*numbers)


def exactly(x):
    man, exp = x.man_exp()
    return Fraction(int(man)) * Fraction(2) ** int(exp)


@pytest.mark.parametrize("bits", [53, 64, 106, 128, 300])
def test_balls_come_back_as_they_were(bits):
    """Middle and radius, whatever their size; with as many doubles as the bits ask for."""
    with flint().ctx.workprec(bits):
        some = [
            ball(1) / 3,
            ball(-7) / 3 + arb(0, 1e-5),
            arb(2, 0.5),
            ball(0),
            ball(1e300) / 3,
            ball(1e-200) / 7,
        ]
        found = boxed(some, bits)
        assert found.parts.shape == (6, bits // 53 + 1)
        for x, y, row, radius in zip(some, found.balls(), found.parts.tolist(), found.radius.tolist(), strict=True):
            assert sum(map(Fraction, row)) == exactly(x.mid()) == exactly(y.mid())
            assert Fraction(radius) == exactly(x.rad()) == exactly(y.rad())
        assert [exactly(x) for x in centres(found.parts)] == [exactly(x.mid()) for x in some]


def test_what_is_left_of_a_middle_goes_into_the_radius():
    """Of more bits than there are doubles for, or smaller than doubles are; centres may be balls."""
    with flint().ctx.workprec(400):
        third = ball(1) / 3
        for bits in (53, 128):
            found = boxed([third, third + arb(0, 1.0)], bits)
            for row, radius, own in zip(found.parts.tolist(), found.radius.tolist(), (0, 1), strict=True):
                off = abs(sum(map(Fraction, row)) - exactly(third.mid()))
                assert off > 0
                assert off + own <= Fraction(radius) <= (off + own) * (1 + Fraction(1, 2**27)) + Fraction(1, 10**100)
        tiny = boxed([arb(2) ** -2000, arb(0, arb(2) ** -2000)], 128)
        assert tiny.radius.tolist() == [5e-324, 5e-324]
        told = exact_box([arb(1, 0.25), ball(2)], [ball(0.5), ball(0.1)], 64)
        assert told.radius[0] >= 0.75
        assert told.radius[0] == pytest.approx(0.75, rel=1e-8)
        assert told.radius[1] == 0.1
        odd = exact_box([ball(1)], [ball(1) / 3], 64).radius[0]
        assert THIRD <= Fraction(odd) <= THIRD * (1 + Fraction(1, 2**50))
    empty = boxed([], 64)
    assert (empty.parts.shape, empty.radius.shape, empty.balls()) == ((0, 2), (0,), [])


def test_boxes_hold_boxes_to_the_last_bit():
    """In every number."""
    whole = ExactBox(np.array([[1.0, 1e-20], [2.0, 0.0]]), np.array([0.5, 0.25]))
    assert whole.holds(whole)
    assert whole.holds(ExactBox(np.array([[1.25, 1e-20], [2.0, 0.0]]), np.array([0.25, 0.25])))
    assert whole.holds(ExactBox(np.array([[0.75, 1e-20], [1.9, 0.0]]), np.array([0.25, 0.1])))
    for k in (0, 1):
        for name in ("parts", "radius"):
            for sign in (1.0, -1.0) if name == "parts" else (1.0,):
                other = whole._replace(**{name: getattr(whole, name).copy()})
                getattr(other, name)[(k, 1) if name == "parts" else k] += sign * 1e-16
                assert not whole.holds(other)
    assert whole.holds(ExactBox(np.array([[1.0 + 2.0**-20], [2.0]]), np.array([0.5 - 2.0**-19, 0.25])))


@pytest.mark.parametrize("radius", [1.0, 0.5, 3.0, 2.0**-30, 0.75, 1e-5, 0.1, 1.0 + 2.0**-29, 1.0 + 2.0**-40, 0.0])
def test_radii_are_what_they_are_told_to_be(radius):
    """Of 30 bits exactly, of more a part in 2²⁸ above."""
    found = with_radius(ball(2), ball(radius))
    assert found.mid() == 2
    assert exactly(found.rad()) >= Fraction(radius)
    if exactly(ball(radius)).numerator.bit_length() <= 30:
        assert exactly(found.rad()) == Fraction(radius)
    assert float(found.rad()) <= radius * (1.0 + 2.0**-28)
