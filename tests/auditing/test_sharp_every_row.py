"""The auditor's answers where two coordinates depend: one row that fails is enough, whichever it is."""

from types import SimpleNamespace

import numpy as np
import pytest
from flint import arb, arb_mat

from ccpin.auditing.boxes import Box, look
from ccpin.auditing.gluing import in_tube, near


class Shifted:
    """φ = y + c of two rows over one q; ball arithmetic may be told another c, and another slope of the second row."""

    m, n_free = 2, 3

    def __init__(self, c, told=None, slope=1.0):
        self.c, self.told, self.slope = np.array(c), np.array(c if told is None else told), slope

    def motions(self, theta):
        return theta

    def at(self, theta):
        return theta[1:] + self.c, np.eye(3)[1:]

    def value(self, theta, motions):
        return arb_mat(2, 1, [theta[k + 1] + float(self.told[k]) for k in range(2)])

    def jacobian(self, motions):
        return arb_mat(2, 3, [0, 1, 0, 0, 0, self.slope])

    def variation(self, motions, direction):
        return arb_mat(2, 3)


def looked(c):
    box = Box(
        [arb(0)] * 3,
        arb_mat(3, 1, [1, 0, 0]),
        arb_mat(2, 2, [1, 0, 0, 1]),
        [arb(1), arb(1)],
        np.array([0.5]),
        np.array([1, 2]),
    )
    return look(Shifted(c), box, (np.array([-0.5]), np.array([0.5])), np.zeros(2), np.ones(2))


def test_a_part_holds_a_solution_by_all_rows_and_none_by_any():
    """|A φ| = (0, 2) about a part of half widths 1: row 2 says that none is there."""
    inside, outside = looked((0.0, 0.0)), looked((0.0, 2.0))
    assert (bool(inside[1]), bool(inside[2])) == (True, False)
    assert (bool(outside[1]), bool(outside[2])) == (False, True)


def test_a_solution_is_known_as_well_as_its_worst_row():
    """An error of 1e-9 in one row, and a slope that is off by 0.9 there: r > 1e-9 + 0.9 r takes r = 64e-9."""
    dependent = np.array([1, 2])
    radius = near(Shifted((0.0, 0.0), (0.0, 1e-9)), dependent, np.zeros(3))[1]
    assert 1e-9 < radius < 2e-9
    radius = near(Shifted((0.0, 0.0), (0.0, 1e-9), 1.9), dependent, np.zeros(3))[1]
    assert radius == pytest.approx(64e-9)


def told(q=(0.0, 0.0), y=(0.0, 0.0), tube=(0.25, 0.25), periodic=False):
    document = SimpleNamespace(
        centre=np.zeros((1, 4)),
        directions=np.vstack([np.eye(2), np.zeros((2, 2))])[None],
        modes=np.eye(2)[None],
        radius=np.array([tube]),
        half=np.array([[0.25, 0.25]]),
        independent=np.array([0, 1]),
        dependent=np.array([2, 3]),
        periodic=np.array([False, False, False, periodic]),
    )
    return in_tube(document, 0, np.array([*q, *y]), 1e-6, np.zeros(2))


def test_a_tube_is_left_by_any_coordinate():
    assert told() is True
    assert told(q=(0.0, 0.3)) is None
    assert told(q=(0.3, 0.0)) is None
    assert told(y=(0.0, 0.3)) is False
    assert told(y=(0.3, 0.0)) is False


def test_beyond_a_tube_that_is_wider_than_a_turn_nothing_is_said():
    """Another turn of the second angle may lead back into it."""
    assert told(y=(0.3, 0.0), tube=(0.25, 1.0), periodic=True) is False
    assert told(y=(0.3, 0.0), tube=(0.25, 7.0), periodic=True) is None
