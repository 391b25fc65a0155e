"""One step, its pieces and the march: linear equations, for which the theorem's numbers are matrix exponentials."""

from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import expm

pytest.importorskip("flint")

from ccpin.programs.tape import Tape
from ccpin.validated.arithmetic.balls import ball, flint
from ccpin.validated.arithmetic.programs import in_balls
from ccpin.validated.arithmetic.series import all_series
from ccpin.validated.flow import crossing as crossings
from ccpin.validated.flow.defect import defect_along
from ccpin.validated.flow.marching import QUANTUM, StepOptions, march
from ccpin.validated.flow.step import (
    ProvenStep,
    Start,
    WatchedField,
    _piece,
    _RefusedError,
    attempt,
    evaluate,
    start_of,
)
from ccpin.validated.sets.instants import instants_over
from ccpin.validated.sets.propagation import marks_over
from tests.support.enclosures import MarchedField

J = np.array([[-1.0, 0.5], [-2.0, 0.25]])
PLUS = np.array([[0.0, 0.5], [2.0, 0.25]])  # M⁺
MINUS = np.array([[-1.0, 0.5], [2.0, 0.25]])  # M


pytestmark = pytest.mark.usefixtures("precise")


def linear(matrix, constant=None):
    tape = Tape(len(matrix))
    rows = [sum((x * Fraction(c) for x, c in zip(tape.inputs, row, strict=True)), 0) for row in matrix]
    return in_balls(tape, [r + (0 if constant is None else Fraction(constant[k])) for k, r in enumerate(rows)])


def floats(box):
    return np.array([float(x.mid()) for x in box])


def test_a_piece_grows_by_the_exponentials_of_its_slopes():
    """ē = exp(M⁺δ)(e + δd), e⁺ = exp(Mδ)e + exp(M⁺δ)δd, |off-diagonal| entries, the diagonal's with their sign."""
    error, added, share = np.array([1e-3, 2e-3]), np.array([1e-4, 3e-4]), 0.5
    path = [flint().arb(1.0, 0.25), flint().arb(-2.0, 0.125)]
    tube, during, after = _piece(linear(J), path, [ball(x) for x in error], [ball(x) for x in added], ball(share))
    expected = expm(PLUS * share) @ (error + added)
    np.testing.assert_allclose(floats(during), expected, rtol=1e-9)
    np.testing.assert_allclose(floats(after), expm(MINUS * share) @ error + expm(PLUS * share) @ added, rtol=1e-9)
    for x, centre, half, e in zip(tube, (1.0, -2.0), (0.25, 0.125), expected, strict=True):
        assert float(x.mid()) == centre
        assert float(x.rad()) == pytest.approx(half + e, rel=1e-8)


def test_a_box_that_does_not_hold_its_image_is_refused():
    """One component does, the other runs away."""
    tape = Tape(2)
    x, _ = tape.inputs
    program = in_balls(tape, [x * x, 0])
    with pytest.raises(_RefusedError, match="own image"):
        _piece(program, [ball(1), ball(0)], [ball(0.1), ball(0.1)], [ball(0), ball(0)], ball(2))


def test_slopes_that_are_not_bounded_are_refused():
    """In one component: the gain of a turn of half a turn and more."""
    tape = Tape(2)
    x, y = tape.inputs
    program = in_balls(tape, [tape.gain(x), y])
    with pytest.raises(_RefusedError, match="not bounded"):
        _piece(program, [ball(-1), ball(0)], [ball(0.5), ball(0)], [ball(0), ball(0)], ball(0.125))


def test_a_step_by_the_theorem():
    """Two pieces: p over each, ē and e in turn, the defect's share of each, and the box at the end."""
    program, h = linear(J), 0.25
    start = Start([ball(1.0), ball(-0.5)], [ball(1e-3), ball(2e-3)])
    series = all_series(program, start.centre, 6)
    asked = iter([0.5, 0.25])
    seen = []

    def quantity(box):
        seen.append(box)
        return next(asked)

    step = attempt(WatchedField(program, quantity), start, series, h, 2)
    d = floats(defect_along(program, series, ball(h)))
    assert np.all(d > 0.0)
    half = 0.5 * h
    e, largest = np.array([1e-3, 2e-3]), np.zeros(2)
    for _ in range(2):
        largest = np.maximum(largest, expm(PLUS * half) @ (e + half * d))
        e = expm(MINUS * half) @ e + expm(PLUS * half) @ (half * d)
    np.testing.assert_allclose(floats(step.error), largest, rtol=1e-9)
    np.testing.assert_allclose(floats(step.end.radius), e, rtol=1e-8)
    np.testing.assert_allclose(floats(step.end.centre), expm(J * h) @ [1.0, -0.5], atol=1e-7)
    assert step.quantity == 0.25
    assert step.length == h
    assert step.remainder == pytest.approx(d.max() * h, rel=1e-9)
    assert len(step.boxes) == len(seen) == 2


def test_the_defect_enters_by_its_share_of_each_piece():
    """From a point, one piece or two: h d in all where slopes are small."""
    program = linear(1e-6 * J)
    series = all_series(program, [ball(1.0), ball(-0.5)], 2)
    start = Start([ball(1.0), ball(-0.5)], [ball(0), ball(0)])
    d = floats(defect_along(program, series, ball(0.25)))
    for pieces in (1, 2, 4):
        step = attempt(WatchedField(program, lambda box: 1.0), start, series, 0.25, pieces)
        np.testing.assert_allclose(floats(step.end.radius), 0.25 * d, rtol=1e-5)


def test_the_pieces_are_those_of_the_step():
    """Of x′ = 1 from 3: piece k holds 3 + [k, k + 1] h/K and no more."""
    tape = Tape(1)
    program = in_balls(tape, [tape.node(1)])
    start = Start([ball(3.0)], [ball(0)])
    step = attempt(WatchedField(program, lambda box: 1.0), start, all_series(program, start.centre, 2), 0.5, 4)
    for k, (box,) in enumerate(step.boxes):
        assert float(box.lower()) == pytest.approx(3.0 + 0.125 * k, rel=1e-9)
        assert float(box.upper()) == pytest.approx(3.125 + 0.125 * k, rel=1e-9)
    assert [float(x) for x in evaluate([[ball(1), ball(2), ball(3)]], ball(2))] == [17.0]


@pytest.mark.parametrize("quantity", [0.0, -1.0, float("nan")])
def test_a_quantity_that_is_not_proved_positive_is_refused(quantity):
    tape = Tape(1)
    program = in_balls(tape, [tape.node(1)])
    start = Start([ball(3.0)], [ball(0)])
    series = all_series(program, start.centre, 2)
    assert "nonsingular" in attempt(WatchedField(program, lambda box: quantity), start, series, 0.5, 4)
    assert attempt(WatchedField(program, lambda box: 1.0, lambda box: "this"), start, series, 0.5, 4) == "this"


@pytest.mark.parametrize(("duration", "longest"), [(0.1, np.inf), (3.5 * 2.0**-4, 2.0**-4), (0.25, 0.25)])
def test_a_march_ends_when_it_is_to(duration, longest):
    """No earlier than asked, no later than a multiple of 2⁻⁴⁰ s, all times exact."""
    assert Fraction(QUANTUM) == Fraction(1, 2**40)
    options = StepOptions(order=8, tolerance=1e-12, pieces=2, shortest=2.0**-4, longest=longest)
    if duration == 0.1:
        options = options._replace(shortest=2.0**-10)
    steps = list(
        march(MarchedField(linear(0.1 * J), lambda box: 1.0), [ball(1.0), flint().arb(2.0, 1e-9)], duration, options)
    )
    assert all(isinstance(step, ProvenStep) for step in steps)
    total = sum(Fraction(step.length) for step in steps)
    assert Fraction(duration) <= total < Fraction(duration) + Fraction(QUANTUM)
    assert max(step.length for step in steps) <= longest
    assert all((Fraction(step.length) * 2**40).denominator == 1 for step in steps)
    assert float(sum(step.length for step in steps)) == float(total)
    np.testing.assert_allclose(floats(steps[-1].end.centre), expm(0.1 * J * float(total)) @ [1.0, 2.0], rtol=1e-9)


def test_slices_cover_a_step_and_no_more():
    """Of x = 3 + 2t ± 0.25 over 2⁻³ s, in three: times, halves, the middles and what is passed over."""
    units = 2**37 + 1
    step = ProvenStep(units * QUANTUM, [[ball(3.0), ball(2.0)]], 0.0, [ball(0.25)], [], 1.0, start_of([ball(0)]))
    found = instants_over(step, marks_over(step.length, 3))
    begin, end = found.time - found.half, found.time + found.half
    assert begin[0] == 0.0
    assert end[-1] == step.length
    np.testing.assert_array_equal(begin[1:], end[:-1])
    np.testing.assert_allclose(found.half, step.length / 6, rtol=1e-9)
    np.testing.assert_allclose(found.middle.mid[:, 0], 3.0 + 2.0 * found.time, rtol=1e-15)
    np.testing.assert_allclose(found.middle.rad[:, 0], 0.25, rtol=1e-8)
    np.testing.assert_allclose(found.during.mid[:, 0], 3.0 + 2.0 * found.time, rtol=1e-15)
    np.testing.assert_allclose(found.during.rad[:, 0], 0.25 + 2.0 * found.half, rtol=1e-8)
    assert set(begin) <= set(marks_over(step.length, 6))


def test_determinants_and_their_signs():
    assert [crossings.sign_of(x) for x in (flint().arb(2, 1), flint().arb(-2, 1), flint().arb(0, 1))] == [1, -1, 0]
    assert crossings.sign_of(flint().arb(1, 1)) == 0
    assert crossings.sign_of(flint().arb(-1, 1)) == 0
