"""Cells of a reference as the theorem writes them: what each parameter moves, what is rounded, how far it jumps."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import PPoly

from ccpin.control.references import PiecewisePolynomial, ReferenceState
from ccpin.control.stability.tracking import reference_tube as module
from ccpin.control.stability.tracking.reference_tube import ReferenceTube, _chord_form, _cut, _errors, _kicks, _pieces
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.proof.chords import Chord
from ccpin.proof.newton import Boxes
from ccpin.proof.rounding import SLACK

WIDEN = 1e-13


def drawn(seed, *shape):
    return np.random.default_rng(seed).uniform(0.5, 2.0, shape) * np.random.default_rng(seed + 100).choice(
        [-1, 1], shape
    )


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


class Case:
    """A tube of two cells over two coordinates, with two that depend, on one of which σ is not proved."""

    def __init__(self, monkeypatch, proved=(True, True), same=(True, True), deviation=1.0):
        self.system = SimpleNamespace(n_free=4, independent=np.array([1, 3]), dependent=np.array([0, 2]))
        motion = tuple(chord(10 * k) for k in range(3))
        self.motion = (motion[0]._replace(deviation=deviation * motion[0].deviation), *motion[1:])
        self.boxes = Boxes(
            *(drawn(k, 2, *shape) for k, shape in enumerate([(4,), (3,), (4, 3), (2, 2), (2, 2), (2,), (2,), ()]))
        )
        self.boxes = self.boxes._replace(radius=np.abs(self.boxes.radius))
        self.problem = SimpleNamespace(system=self.system)
        self.centre = drawn(50, 2, 4)
        self.inside, self.delta = Boxes(*(drawn(60 + k, 2, 3) for k in range(8))), drawn(70, 2, 3)
        self.asked = []
        monkeypatch.setattr(
            module,
            "certify_boxes",
            lambda *given: self.asked.append(given) or SimpleNamespace(boxes=self.boxes, proved=np.array(proved)),
        )
        monkeypatch.setattr(module, "glued", lambda *given: self.asked.append(given) or np.array(same)[: len(given[2])])

    def tube(self):
        return ReferenceTube(self.problem, None, None, None, None, self.motion, self.centre, (self.inside, self.delta))


ROOM, SPEED = np.array([[0.1, 0.2], [0.3, 0.4]]), np.array([[5.0, 6.0], [7.0, 8.0]])


def test_cells_as_forms_of_place_error_and_speed(monkeypatch):
    """θ = centre + D(s, −e), off by the boxes' radii and the chord's deviation; q̇ = q̇_d − ė."""
    case = Case(monkeypatch)
    found, proved = case.tube().states(ROOM, SPEED)
    assert proved.tolist() == [True, True]
    problem, centre, half, across = case.asked[0]
    assert problem is case.problem
    np.testing.assert_array_equal(centre, case.centre)
    line = case.motion[0]
    np.testing.assert_allclose(across[:, :, 0], (line.end - line.start) / 2, rtol=1e-15)
    np.testing.assert_array_equal(across[:, :, 1:], [np.eye(2)] * 2)
    np.testing.assert_array_equal(half[:, 0], 1.0)
    exact = (ROOM + line.deviation) * (1.0 + WIDEN)
    np.testing.assert_allclose(half[:, 1:], exact, rtol=1e-15)
    D = case.boxes.directions
    np.testing.assert_array_equal(found.theta.mid, case.centre)
    assert found.theta.lin.shape == (5, 2, 4)
    assert found.theta.boxed == 5
    np.testing.assert_array_equal(found.theta.lin[0], D[:, :, 0])
    for i in (0, 1):
        np.testing.assert_allclose(found.theta.lin[1 + i], -D[:, :, 1 + i] * ROOM[:, [i]], rtol=1e-15)
    assert not found.theta.lin[3:].any()
    rad = np.einsum("kpi,ki->kp", np.abs(D[:, :, 1:]), line.deviation)
    rad[:, case.system.dependent] += np.einsum("kij,kj->ki", np.abs(case.boxes.modes), case.boxes.radius)
    np.testing.assert_allclose(found.theta.rad, rad, rtol=1e-11)
    for part, room, first in ((found.e, ROOM, 1), (found.e_dot, SPEED, 3)):
        np.testing.assert_array_equal(part.lin, _errors(room, first).lin)
    for part, line in ((found.v_d, case.motion[1]), (found.a_d, case.motion[2])):
        np.testing.assert_array_equal(part.mid, _chord_form(line, 5).mid)
        np.testing.assert_array_equal(part.lin, _chord_form(line, 5).lin)
        assert part.boxed == 5
    np.testing.assert_array_equal(found.v.lin, found.v_d.lin - found.e_dot.lin)
    np.testing.assert_array_equal(found.v.mid, found.v_d.mid)


def test_roundings_of_cells(monkeypatch):
    """1e-13 of one and the centre, and of it all."""
    case = Case(monkeypatch, deviation=0.0)
    case.boxes = case.boxes._replace(radius=0.0 * case.boxes.radius)
    found, _ = case.tube().states(ROOM, SPEED)
    np.testing.assert_allclose(found.theta.rad, WIDEN * (1.0 + np.abs(case.centre)), rtol=1e-9)
    case = Case(monkeypatch)
    case.motion = (case.motion[0]._replace(deviation=np.full((2, 2), 1e9)), *case.motion[1:])
    found, _ = case.tube().states(ROOM, SPEED)
    D = np.abs(case.boxes.directions[:, [1, 3], 1:])
    least = 1e9 * D.sum(axis=2) + WIDEN * (1.0 + np.abs(case.centre[:, [1, 3]]))
    np.testing.assert_allclose(found.theta.rad[:, [1, 3]], least * (1.0 + WIDEN), rtol=1e-15)


@pytest.mark.parametrize(
    ("proved", "same", "expected"),
    [
        ((True, True), (True, False), (True, False)), ((True, True), (False, True), (False, True)),
        ((False, True), (True,), (False, True)), ((False, True), (False,), (False, False)),
        ((False, False), (), (False, False)),
    ],
)  # fmt: skip
def test_cells_are_glued_to_the_path_at_their_middle(monkeypatch, proved, same, expected):
    """At (0, 0): where the path's box has the cell's own place."""
    case = Case(monkeypatch, proved, same)
    _, found = case.tube().states(ROOM, SPEED)
    assert tuple(found.tolist()) == expected
    rows = np.flatnonzero(proved)
    if not rows.size:
        assert len(case.asked) == 1
        return
    problem, inside, delta, boxes, middle = case.asked[1]
    assert problem is case.problem
    np.testing.assert_array_equal(inside.centre, case.inside.centre[rows])
    np.testing.assert_array_equal(delta, case.delta[rows])
    np.testing.assert_array_equal(boxes.centre, case.boxes.centre[rows])
    np.testing.assert_array_equal(middle, np.zeros((len(rows), 3)))


# The cells' times.


def reference(coefficients, breaks, start=(10.0, 20.0)):
    told = PiecewisePolynomial(np.array(start), np.array(breaks, float), np.array(coefficients, float))
    return SimpleNamespace(as_polynomial=lambda: told)


LINES = [[[1.0, -2.0], [0.0, 0.0]], [[0.5, 0.0], [2.0, -4.0]]]  # t, −2t; then from (2, −4) on


@pytest.mark.parametrize("begin", [0.0, 1.5])
def test_pieces_with_the_rests_before_and_after(begin):
    """From t = 0, where it begins later; a second after its end."""
    found, rests = _pieces(reference(LINES, begin + np.array([0.0, 2.0, 3.0])))
    late = int(begin > 0.0)
    assert found.x.tolist() == [0.0] * late + [begin, begin + 2.0, begin + 3.0, begin + 4.0]
    assert rests.tolist() == [True] * late + [False, False, True]
    for t, q in ((0.0, (10, 20)), (0.5 * begin, (10, 20)), (begin + 1, (11, 18)), (begin + 2.5, (12.25, 16))):
        np.testing.assert_allclose(found(t), q)
    np.testing.assert_allclose(found([begin + 3.0, begin + 3.9]), [[12.5, 16.0]] * 2)
    np.testing.assert_allclose(found.derivative(1)([begin + 0.5, begin + 3.5]), [[1.0, -2.0], [0.0, 0.0]])


def test_a_set_point_is_one_rest():
    found, rests = _pieces(reference(np.empty((0, 1, 2)), []))
    assert found.x.tolist() == [0.0, 1.0]
    assert rests.tolist() == [True]
    np.testing.assert_array_equal(found([0.0, 0.9]), [[10.0, 20.0]] * 2)


@pytest.mark.parametrize(
    ("coefficients", "breaks"),
    [
        (LINES, [0.0, 2.0]), (LINES, [0.0, 2.0, 2.0]), (LINES, [0.0, 3.0, 2.0]), (LINES, [-0.5, 2.0, 3.0]),
        (LINES, [-1e-300, 2.0, 3.0]), (LINES, [0.0, 1.0, 2.0, 3.0]), (np.ones((2, 2)), [0.0, 2.0, 3.0]),
        (np.empty((2, 0, 2)), [0.0, 2.0, 3.0]), (LINES, [2.0, 2.0, 3.0]),
    ],
)  # fmt: skip
def test_polynomials_that_are_none(coefficients, breaks):
    with pytest.raises(InvalidInputError, match=r"shape|breaks"):
        _pieces(reference(coefficients, breaks))


def test_references_that_are_no_polynomials():
    with pytest.raises(UnsupportedMechanismError):
        _pieces(SimpleNamespace(as_polynomial=lambda: None))


def test_pieces_are_cut_into_equal_cells():
    """As many as asked for in all, shared by duration, and one for every rest."""
    knots, rests = np.array([0.0, 1.0, 3.0, 4.0, 5.0]), np.array([True, False, False, True])
    np.testing.assert_allclose(_cut(knots, rests, 6), [0.0, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0])
    np.testing.assert_allclose(_cut(knots, rests, 1), [0.0, 1.0, 3.0, 4.0, 5.0])
    np.testing.assert_allclose(_cut(knots, rests, 4), [0.0, 1.0, 1 + 2 / 3, 1 + 4 / 3, 3.0, 3.5, 4.0, 5.0])


PATH = PPoly(np.array([[[3.0, -1.0]], [[2.0, 0.5]], [[1.0, 4.0]]]), np.array([0.0, 2.0]))


@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize(("share", "held"), [(0.95, True), (1.05, False), (1e6, False)])
@pytest.mark.parametrize("place", [(0, 0), (1, 1)])
def test_references_tell_one_motion(order, share, held, place):
    """Q_d, q̇_d and q̈_d at every time, to 1e-9 of one and the largest."""
    times = np.array([0.25, 1.5])
    values = np.array([PATH(times), PATH.derivative(1)(times), PATH.derivative(2)(times)])
    values[order][place] += share * 1e-9 * (1.0 + np.abs(values[order]).max())
    told = SimpleNamespace(at=lambda t: ReferenceState(*values[:, times.tolist().index(t)]))
    if held:
        module._check_told(told, PATH, times)
    else:
        with pytest.raises(InvalidInputError, match="two motions"):
            module._check_told(told, PATH, times)


@pytest.mark.parametrize(("apart", "held"), [(0.95e-9, True), (1.05e-9, False)])
def test_references_that_rest_at_zero_tell_one_motion(apart, held):
    still, zero = PPoly(np.zeros((3, 1, 2)), np.array([0.0, 2.0])), np.zeros(2)
    told = SimpleNamespace(at=lambda t: ReferenceState(zero + apart, zero, zero))
    if held:
        module._check_told(told, still, np.array([0.5]))
    else:
        with pytest.raises(InvalidInputError, match="two motions"):
            module._check_told(told, still, np.array([0.5]))


def test_jumps_between_cells():
    """Of both sides' ends with their roundings, at knots; at the beginning of the speed alone, from rest."""
    motion = tuple(chord(20 + 10 * k, 3) for k in range(3))
    found = _kicks(motion, np.array([True, False, True]))
    assert found.shape == (3, 4)
    np.testing.assert_array_equal(found[0, :2], 0.0)
    speed = motion[1]
    np.testing.assert_allclose(found[0, 2:], (np.abs(speed.start[0]) + speed.rounding[0, 0]) * SLACK, rtol=1e-14)
    np.testing.assert_array_equal(found[1], 0.0)
    for part, columns in zip(motion, (slice(0, 2), slice(2, 4)), strict=False):
        exact = np.abs(part.start[2] - part.end[1]) + part.rounding[2, 0] + part.rounding[1, 1]
        np.testing.assert_allclose(found[2, columns], exact * SLACK, rtol=1e-14)


def test_the_tube_of_a_reference(monkeypatch):
    """Its cells' middles in the path's boxes: which box, where in it, and σ there with q_d's own place."""
    system = SimpleNamespace(independent=np.array([0, 2]), n_free=3)
    D = drawn(5, 2, 3, 3)
    path = SimpleNamespace(
        verdict="proven", times=np.array([0.0, 2.0, 3.0]), problem=SimpleNamespace(system=system), reading="reading",
        boxes=Boxes(drawn(6, 2, 3), *(drawn(7, 2, 3),), D, *(drawn(8, 2, 2) for _ in range(4)), np.zeros(2)),
    )  # fmt: skip
    asked = []
    times = np.array([0.0, 1.0, 2.0, 5.0])
    pieces = PPoly(np.array([[[1.0, 0.5], [0.25, 1.0]], [[0.0, 0.0], [2.0, 1.0]]]), np.array([0.0, 2.0, 5.0]))
    monkeypatch.setattr(module, "_pieces", lambda _: (pieces, np.zeros(2, bool)))
    monkeypatch.setattr(module, "_cut", lambda *_: times)
    monkeypatch.setattr(module, "_check_told", lambda _, __, at: asked.append(at))
    monkeypatch.setattr(module, "certify_path", lambda *given: asked.append(given) or path)
    monkeypatch.setattr(module, "masses_of", lambda *_: "masses")
    deviation = np.array([[0.1, 0.4], [0.3, 0.2], [0.2, 0.1]])
    real = module.chords_of
    monkeypatch.setattr(module, "chords_of", lambda *given: real(*given)._replace(deviation=deviation))
    solved = np.full((3, 3), 7.0)
    monkeypatch.setattr(
        module, "solve_in_boxes", lambda _, boxes, at: asked.append((boxes, at)) or SimpleNamespace(theta=solved.copy())
    )
    law = SimpleNamespace(
        reference=None, near=SimpleNamespace(q_free="near"), model=SimpleNamespace(mechanism=None, gravity_vector=None)
    )
    found = module.tube_of(law, 3)
    (_, given, room, near), middle, (boxes, delta) = asked
    assert (given, near) == (pieces, "near")
    np.testing.assert_array_equal(room, [0.3, 0.4])
    np.testing.assert_array_equal(middle, [0.5, 1.5, 3.5])
    q = np.array([[0.5, 0.25], [1.5, 0.75], [2.375, 2.5]])
    np.testing.assert_allclose(found.centre[:, [0, 2]], q, rtol=1e-14)
    np.testing.assert_array_equal(found.centre[:, 1], 7.0)
    number, s = [0, 0, 1], np.array([-0.5, 0.5, 2.0])  # beyond the path's end in its last box
    np.testing.assert_array_equal(boxes.centre, path.boxes.centre[number])
    np.testing.assert_allclose(delta[:, 0], s, rtol=1e-14)
    place = path.boxes.centre[number][:, [0, 2]] + s[:, None] * D[number][:, [0, 2], 0]
    np.testing.assert_allclose(place + delta[:, 1:], q, rtol=1e-13)
    np.testing.assert_array_equal(found.at[1], delta)
    np.testing.assert_array_equal(found.times, times)
    kicks = _kicks(found.motion, np.array([True, False, True]))
    np.testing.assert_array_equal(found.kicks, kicks)
    path.verdict = "undecided"
    open_end = module.tube_of(law, 3)
    assert open_end.centre.size == 0
    assert open_end.path is path
