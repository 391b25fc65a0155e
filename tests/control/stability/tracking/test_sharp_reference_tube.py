"""A reference cut into cells, and what is proposed about them: boxes, and where they are glued to the path's."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import PPoly

from ccpin.control.references import PiecewisePolynomial, ReferenceState
from ccpin.control.stability.tracking import reference_tube as module
from ccpin.control.stability.tracking.cell_forms import TimeCells
from ccpin.control.stability.tracking.reference_tube import ReferenceTube, _cut, _pieces
from ccpin.control.stability.tracking.tracking_equations import ReferencePieces
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.proof.chords import Chord
from ccpin.proof.facts import NotProvedError
from ccpin.proof.newton import Boxes
from tests.support.drawing import drawn

WIDEN = 1e-13
LINE = Chord(drawn(0, 2, 2), drawn(1, 2, 2), np.abs(drawn(2, 2, 2)), np.zeros((2, 2, 2)))
CELLS = TimeCells(np.arange(3.0), LINE, None, None, np.zeros((2, 4)))


def test_boxes_about_cells(monkeypatch):
    """Along the chord whole, and across it as wide as the errors and what it strays."""
    asked, room = [], np.array([[0.1, 0.2], [0.3, 0.4]])
    monkeypatch.setattr(module, "certify_boxes", lambda *given: asked.append(given) or "tried")
    centre = drawn(50, 2, 4)
    tube = ReferenceTube(None, SimpleNamespace(problem="problem"), CELLS, centre, None)
    assert tube.boxes(room) == "tried"
    problem, about, half, across = asked[0]
    assert problem == "problem"
    np.testing.assert_array_equal(about, centre)
    np.testing.assert_allclose(across[:, :, 0], (LINE.end - LINE.start) / 2, rtol=1e-15)
    np.testing.assert_array_equal(across[:, :, 1:], [np.eye(2)] * 2)
    np.testing.assert_array_equal(half[:, 0], 1.0)
    np.testing.assert_allclose(half[:, 1:], (room + LINE.deviation) * (1.0 + WIDEN), rtol=1e-15)


@pytest.mark.parametrize("kept", [(True, True), (True, False), (False, True)])
def test_cells_are_glued_to_the_path_at_their_middle(monkeypatch, kept):
    """At (0, 0): where the path's box has the cell's own place; the path's boxes come first in the numbering."""
    along, asked = SimpleNamespace(claim=SimpleNamespace(kappa=np.zeros(5))), []
    path = SimpleNamespace(problem="problem", proved=SimpleNamespace(premises=(along, "more")))
    number, delta = np.array([3, 4]), drawn(70, 2, 3)
    monkeypatch.setattr(module, "proved_boxes", lambda problem, boxes: (("solutions", boxes), np.array(kept)))
    monkeypatch.setattr(module, "proved_glue", lambda *given: asked.append(given) or ("glue", "more glue"))
    tube = ReferenceTube(None, path, CELLS, None, (number, delta))
    if not all(kept):
        with pytest.raises(NotProvedError, match="box"):
            tube.proved("boxes")
        return
    assert tube.proved("boxes") == (("solutions", "boxes"), "glue", "more glue")
    problem, seams, facts = asked[0]
    assert (problem, facts) == ("problem", (along, ("solutions", "boxes")))
    np.testing.assert_array_equal(seams.first, number)
    np.testing.assert_array_equal(seams.second, [5, 6])
    np.testing.assert_array_equal(seams.at_first, delta)
    np.testing.assert_array_equal(seams.at_second, np.zeros((2, 3)))


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


def test_the_tube_of_a_reference(monkeypatch):
    """Its cells' middles in the path's boxes: which box, where in it, and σ there with q_d's own place."""
    system = SimpleNamespace(independent=np.array([0, 2]), n_free=3)
    D = drawn(5, 2, 3, 3)
    path = SimpleNamespace(
        verdict="proven", times=np.array([0.0, 2.0, 3.0]), problem=SimpleNamespace(system=system), reading="reading",
        boxes=Boxes(drawn(6, 2, 3), *(drawn(7, 2, 3),), D, *(drawn(8, 2, 2) for _ in range(4)), np.zeros(2)),
    )  # fmt: skip
    asked, about = [], []
    times = np.array([0.0, 1.0, 2.0, 5.0])
    pieces = PPoly(np.array([[[1.0, 0.5], [0.25, 1.0]], [[0.0, 0.0], [2.0, 1.0]]]), np.array([0.0, 2.0, 5.0]))
    monkeypatch.setattr(module, "_pieces", lambda _: (pieces, np.zeros(2, bool)))
    monkeypatch.setattr(module, "_cut", lambda *_: times)
    monkeypatch.setattr(module, "_check_told", lambda _, __, at: asked.append(at))
    monkeypatch.setattr(module, "certify_path", lambda *given: asked.append(given) or path)
    motion = [ReferencePieces(piece.c, piece.x) for piece in (pieces, pieces.derivative(1), pieces.derivative(2))]
    equations = SimpleNamespace(motion=motion)
    monkeypatch.setattr(module, "equations_of", lambda *given: about.append(given) or equations)
    deviation = np.array([[0.1, 0.4], [0.3, 0.2], [0.2, 0.1]])
    real = TimeCells.of

    def strayed(*given):
        made = real(*given)
        return made._replace(place=made.place._replace(deviation=deviation))

    monkeypatch.setattr(TimeCells, "of", strayed)
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
    assert found.equations is equations
    assert about[0][:2] == (law, "reading")
    np.testing.assert_array_equal(about[0][2].c, pieces.c)
    np.testing.assert_array_equal(about[0][2].x, pieces.x)
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
    np.testing.assert_array_equal(found.at[0], number)
    np.testing.assert_array_equal(found.at[1], delta)
    np.testing.assert_array_equal(found.cells.times, times)
    path.verdict = "undecided"
    open_end = module.tube_of(law, 3)
    assert open_end.centre.size == 0
    assert open_end.path is path


def test_what_is_claimed_of(monkeypatch):
    """The law's configuration at q_d(0), with q_d's own place; its gains, by its kind."""
    asked = []
    monkeypatch.setattr(module, "kind_of", lambda law: law.kind)
    monkeypatch.setattr(module, "closures_of", lambda problem: (problem, "closures"))
    monkeypatch.setattr(module, "bodies_on_joints_of", lambda *given: asked.append(given) or "free")
    monkeypatch.setattr(module, "TrackingEquations", lambda *given: given)
    reading = SimpleNamespace(
        system=SimpleNamespace(independent=np.array([0, 2])), problem="problem", theta=lambda q_free: q_free + 1.0
    )
    model = SimpleNamespace(mechanism="mechanism", gravity_vector="gravity")
    near = SimpleNamespace(q_free=np.zeros(3), q=np.array([5.0, 6.0]))
    law = SimpleNamespace(model=model, near=near, kind="pd_plus", K_p="K_p", K_v="K_v")
    *found, theta = module.equations_of(law, reading, "reference")
    assert found == [("problem", "closures"), "free", ("pd_plus", "K_p", "K_v"), "reference"]
    assert asked == [("mechanism", reading, "gravity")]
    np.testing.assert_array_equal(theta, [5.0, 1.0, 6.0])
    for kind in (None, "pd", "pd_gravity"):
        with pytest.raises(UnsupportedMechanismError, match="ComputedTorque or PDPlus"):
            module.feedback_of(SimpleNamespace(kind=kind))
