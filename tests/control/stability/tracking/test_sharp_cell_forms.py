"""Cells of a reference as the theorem writes them: what each parameter moves, what is rounded, how far it jumps."""

from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.control.stability.tracking import cell_forms as module
from ccpin.control.stability.tracking.cell_forms import CellForms, TimeCells, _chord_form, _errors, _kicks, forms_of
from ccpin.proof.balls import Affine
from ccpin.proof.chords import Chord
from ccpin.proof.newton import Boxes
from ccpin.proof.rounding import SLACK
from tests.support.drawing import drawn

WIDEN = 1e-13


def chord(seed, count=2, n=2):
    rounding = np.abs(drawn(seed + 3, count, 2, n))
    return Chord(drawn(seed, count, n), drawn(seed + 1, count, n), np.abs(drawn(seed + 2, count, n)), rounding)


def test_chords_as_forms():
    """Middle and half way, and beside it the deviation and 1e-13 of it and one."""
    one = chord(0)
    found = _chord_form(one, 5)
    np.testing.assert_allclose(found.mid, (one.start + one.end) / 2, rtol=1e-15)
    np.testing.assert_allclose(found.lin[0], (one.end - one.start) / 2, rtol=1e-15)
    assert found.lin.shape == (5, 2, 2)
    assert not found.lin[1:].any()
    assert found.boxed == 5
    np.testing.assert_allclose(found.rad, one.deviation, rtol=1e-12)
    plain = _chord_form(one._replace(deviation=np.zeros((2, 2))), 5)
    np.testing.assert_allclose(plain.rad, WIDEN * (1.0 + np.abs(found.mid)), rtol=1e-9)


@pytest.mark.parametrize("first", [1, 3])
def test_errors_are_parameters_of_their_own(first):
    room = np.array([[0.1, 0.2], [0.3, 0.4]])
    found = _errors(room, first)
    assert found.lin.shape == (5, 2, 2)
    assert found.boxed == 5
    assert not found.mid.any()
    assert not found.rad.any()
    expected = np.zeros((5, 2, 2))
    expected[first, :, 0], expected[first + 1, :, 1] = room[:, 0], room[:, 1]
    np.testing.assert_array_equal(found.lin, expected)


SYSTEM = SimpleNamespace(n=2, n_free=4, m=2, independent=np.array([1, 3]), dependent=np.array([0, 2]))
ROOM = np.array([[0.1, 0.2, 5.0, 6.0], [0.3, 0.4, 7.0, 8.0]])


def cells(deviation=1.0):
    """Two cells over two coordinates."""
    place, speed, acceleration = (chord(10 * k) for k in range(3))
    place = place._replace(deviation=deviation * place.deviation)
    return TimeCells(np.arange(3.0), place, speed, acceleration, np.zeros((2, 4)))


def boxes(radius=1.0):
    made = Boxes(*(drawn(k, 2, *shape) for k, shape in enumerate([(4,), (3,), (4, 3), (2, 2), (2, 2), (2,), (2,), ()])))
    return made._replace(radius=radius * np.abs(made.radius))


def test_cells_as_forms_of_place_error_and_speed():
    """θ = centre + D(s, −e), off by the boxes' radii and the chord's deviation; q̇ = q̇_d − ė."""
    some, about = cells(), boxes()
    found, D, line = forms_of(SYSTEM, about, some, ROOM), about.directions, some.place
    np.testing.assert_array_equal(found.theta.mid, about.centre)
    assert found.theta.lin.shape == (5, 2, 4)
    assert found.theta.boxed == 5
    np.testing.assert_array_equal(found.theta.lin[0], D[:, :, 0])
    for i in (0, 1):
        np.testing.assert_allclose(found.theta.lin[1 + i], -D[:, :, 1 + i] * ROOM[:, [i]], rtol=1e-15)
    assert not found.theta.lin[3:].any()
    rad = np.einsum("kpi,ki->kp", np.abs(D[:, :, 1:]), line.deviation)
    rad[:, SYSTEM.dependent] += np.einsum("kij,kj->ki", np.abs(about.modes), about.radius)
    np.testing.assert_allclose(found.theta.rad, rad, rtol=1e-11)
    for part, room, first in ((found.e, ROOM[:, :2], 1), (found.e_dot, ROOM[:, 2:], 3)):
        np.testing.assert_array_equal(part.lin, _errors(room, first).lin)
    for part, line in ((found.v_d, some.speed), (found.a_d, some.acceleration)):
        np.testing.assert_array_equal(part.mid, _chord_form(line, 5).mid)
        np.testing.assert_array_equal(part.lin, _chord_form(line, 5).lin)
        assert part.boxed == 5
    np.testing.assert_array_equal(found.v.lin, found.v_d.lin - found.e_dot.lin)
    np.testing.assert_array_equal(found.v.mid, found.v_d.mid)


def test_roundings_of_cells():
    """1e-13 of one and the centre, and of it all."""
    about = boxes(radius=0.0)
    found = forms_of(SYSTEM, about, cells(deviation=0.0), ROOM)
    np.testing.assert_allclose(found.theta.rad, WIDEN * (1.0 + np.abs(about.centre)), rtol=1e-9)
    wide, about = cells(), boxes()
    wide = wide._replace(place=wide.place._replace(deviation=np.full((2, 2), 1e9)))
    found = forms_of(SYSTEM, about, wide, ROOM)
    D = np.abs(about.directions[:, [1, 3], 1:])
    least = 1e9 * D.sum(axis=2) + WIDEN * (1.0 + np.abs(about.centre[:, [1, 3]]))
    np.testing.assert_allclose(found.theta.rad[:, [1, 3]], least * (1.0 + WIDEN), rtol=1e-15)


def test_cells_thickened_by_errors_of_sigma():
    """δ moves each dependent coordinate by ε and nothing else, with parameters of its own."""
    at = CellForms(*(Affine(drawn(k, 2, 4), drawn(9 + k, 2, 2, 4), np.zeros((2, 4)), 2) for k in range(6)))
    found = at.thickened(SYSTEM, 0.25)
    for wide, thin in zip(found, at, strict=True):
        assert wide.lin.shape[0] == 4
        np.testing.assert_array_equal(wide.lin[:2], thin.lin)
        np.testing.assert_array_equal(wide.mid, thin.mid)
        assert wide.boxed == 2
    expected = np.zeros((2, 2, 4))
    expected[0, :, 0] = expected[1, :, 2] = 0.25
    np.testing.assert_array_equal(found.theta.lin[2:], expected)
    assert all(not wide.lin[2:].any() for wide in found[1:])


def test_jumps_between_cells(monkeypatch):
    """Of both sides' ends with their roundings, at knots; at the beginning of the speed alone, from rest."""
    motion, times = tuple(chord(20 + 10 * k, 3) for k in range(3)), np.array([0.0, 1.0, 2.0, 3.0])
    told = iter(motion)
    monkeypatch.setattr(
        module, "chords_of", lambda pieces, at: (np.testing.assert_array_equal(at, times), next(told))[1]
    )
    cut = TimeCells.of([SimpleNamespace(x=np.array([0.0, 2.0, 3.0]))] * 3, times)
    assert (cut.place, cut.speed, cut.acceleration) == motion
    found = cut.kicks
    np.testing.assert_array_equal(found, _kicks(*motion[:2], np.array([True, False, True])))
    assert found.shape == (3, 4)
    np.testing.assert_array_equal(found[0, :2], 0.0)
    speed = motion[1]
    np.testing.assert_allclose(found[0, 2:], (np.abs(speed.start[0]) + speed.rounding[0, 0]) * SLACK, rtol=1e-14)
    np.testing.assert_array_equal(found[1], 0.0)
    for part, columns in zip(motion, (slice(0, 2), slice(2, 4)), strict=False):
        exact = np.abs(part.start[2] - part.end[1]) + part.rounding[2, 0] + part.rounding[1, 1]
        np.testing.assert_allclose(found[2, columns], exact * SLACK, rtol=1e-14)
