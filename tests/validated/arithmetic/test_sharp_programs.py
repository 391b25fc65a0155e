"""Programs against power series computed otherwise, to every order: values, gradients, Taylor coefficients, jets."""

from fractions import Fraction
from itertools import permutations

import numpy as np
import pytest

pytest.importorskip("flint")

from ccpin.programs.instructions import Kind
from ccpin.programs.tape import Node, Tape, is_zero
from ccpin.validated.arithmetic.ball_arrays import BallArray, exactly, joined
from ccpin.validated.arithmetic.balls import ball, flint
from ccpin.validated.arithmetic.jets import Jet, jets_over
from ccpin.validated.arithmetic.programs import in_balls
from ccpin.validated.arithmetic.series import NotInvertibleError, all_series, extend, gradients, values

LENGTH = 7


pytestmark = pytest.mark.usefixtures("precise")


def recorded(tape, x, y):
    """Every operation, on two inputs."""
    s, c = tape.sincos(x * y + 1)
    matrix = [[x + 3, y * Fraction(1, 2)], [s, 4 - x]]
    z = tape.solve(matrix, [[y, tape.node(1)], [x * x, c]])
    turned = tape.gain(x * Fraction(1, 4), 0) - tape.gain(y * Fraction(1, 5), 1)
    five = tape.node(5)
    return [
        five * (x * y) + x * x - s * c - y,
        2 * (x - y) * 3 - (-y),
        z[0, 0],
        z[0, 1] * x,
        z[1, 0],
        z[1, 1] - z[0, 0] * y,
        turned,
        five,
    ]


def by_series(x, y):
    """The same of power series."""
    arb_series = flint().arb_series
    inner = x * y + 1
    s, c = inner.sin(), inner.cos()
    a, b, d, e = x + 3, y / 2, s, 4 - x
    det = a * e - b * d
    first = (e * y - b * x * x) / det, (a * x * x - d * y) / det
    second = (e - b * c) / det, (a * c - d) / det
    g = turning(x / 4) - turning_slope(y / 5)
    six = 6 * (x - y) + y
    return [
        5 * x * y + x * x - s * c - y,
        six,
        first[0],
        second[0] * x,
        first[1],
        second[1] - first[0] * y,
        g,
        arb_series([5], prec=LENGTH),
    ]


def turning(w):
    return 2 * w.acos() / (1 - w * w).sqrt()


def turning_slope(w):
    """g′ = (w g − 2)/(1 − w²)."""
    return (w * turning(w) - 2) / (1 - w * w)


def program():
    tape = Tape(2)
    return in_balls(tape, recorded(tape, *tape.inputs))


def line(*coefficients):
    return flint().arb_series([ball(Fraction(c, 10)) for c in coefficients], prec=LENGTH)


def near(found, expected, scale=1e-30):
    assert all(abs(a - b) < scale for a, b in zip(found, expected, strict=True))


def test_values_and_taylor_coefficients():
    x, y = line(7, 3, -2, 4, 1, 5, -3), line(-4, 9, 5, 1, -2, 3, 2)
    expected = by_series(x, y)
    run = program()
    near(values(run, [x[0], y[0]]), [e[0] for e in expected])
    series = [[p[k] for k in range(LENGTH)] for p in (x, y)] + [[] for _ in range(run.size - 2)]
    extend(run, series, LENGTH)
    for number, e in zip(run.outputs, expected, strict=True):
        near(series[number], [e[k] for k in range(LENGTH)], 1e-28)


def test_series_along_solutions():
    """X′ = f(x): (k + 1)x_{k+1} is f's coefficient, to the order asked for."""
    tape = Tape(2)
    x, y = tape.inputs
    s, c = tape.sincos(x)
    run = in_balls(tape, [y, c * y - s])
    series = all_series(run, [ball(Fraction(1, 2)), ball(Fraction(1, 3))], 5)
    assert [len(row) for row in series[:2]] == [6, 6]
    p, q = (flint().arb_series(row, prec=5) for row in series[:2])
    expected = (q, p.cos() * q - p.sin())
    for k in range(5):
        near([(k + 1) * row[k + 1] for row in series[:2]], [e[k] for e in expected])


def test_gradients_at_points():
    run = program()
    x, y = ball(Fraction(7, 10)), ball(Fraction(-4, 10))
    found = gradients(run, [x, y])
    for k, way in enumerate(((1, 0), (0, 1))):
        ahead = by_series(flint().arb_series([x, way[0]], prec=2), flint().arb_series([y, way[1]], prec=2))
        near([row[k] for row in found], [e[1] for e in ahead])


def test_gradients_are_narrowed_by_the_mean_value_theorem():
    """Of x · (x − 1) · x over x = 1 ± 0.1: the values that a product is made of are narrowed about the middle."""
    tape = Tape(1)
    (x,) = tape.inputs
    square = x * x
    run = in_balls(tape, [square * square])
    box = flint().arb(1, 0.125)
    ((found,),) = gradients(run, [box])
    inner = ball(1) + flint().arb(0, 2 * 1.125 * 0.125)  # x² about 1, by 2x over the box: [0.71875, 1.28125]
    wider = box * box
    assert inner.rad() > wider.rad() or float(inner.rad()) == pytest.approx(0.28125)
    assert found.contains(4 * ball(1.125) ** 3)
    assert found.contains(4 * ball(0.875) ** 3)
    difference = in_balls(tape, [(x * x - x * 2) * (x * x - x * 2)])
    ((thin,),) = gradients(difference, [box])
    # u = x² − 2x = −1 + (x − 1)²; u′ = 2(x − 1) = ±0.25: u about −1 by ±0.25 · 0.125; 2u u′ within 2 · 1.03125 · 0.25
    assert float(thin.abs_upper()) == pytest.approx(2 * 1.03125 * 0.25, rel=1e-6)


def test_solutions_in_gradients_are_narrowed():
    """Z = 1/x over 2 ± 0.5: about ½ by 0.5 · 1/x², and z² with it."""
    tape = Tape(1)
    (x,) = tape.inputs
    z = tape.solve([[x]], [[tape.node(1)]])[0, 0]
    ((found,),) = gradients(in_balls(tape, [z * z]), [flint().arb(2, 0.125)])
    for at in (1.875, 2.125):
        assert found.contains(ball(-2) / ball(at) ** 3)
    wide = 1 / flint().arb(2, 0.125)
    assert found.rad() <= (2 * wide * wide * wide).rad() * 1.01


def test_matrices_that_may_be_singular_are_refused():
    tape = Tape(1)
    (x,) = tape.inputs
    run = in_balls(tape, [tape.solve([[x]], [[tape.node(1)]])[0, 0]])
    for what in (values, gradients):
        with pytest.raises(NotInvertibleError):
            what(run, [flint().arb(0, 1)])
    with pytest.raises(NotInvertibleError):
        jets_over(run, [Jet(BallArray(np.zeros(1), np.ones(1)))], 0)


def test_repeated_sines_are_the_same_and_have_their_cosine():
    tape = Tape(1)
    (x,) = tape.inputs
    s, c = tape.sincos(x)
    again, also = tape.sincos(x)
    assert (s.index, c.index) == (again.index, also.index)
    found = values(in_balls(tape, [again, also]), [ball(Fraction(1, 3))])
    near(found, [ball(Fraction(1, 3)).sin(), ball(Fraction(1, 3)).cos()])


def test_recording_leaves_out_what_is_zero():
    tape = Tape(1)
    (x,) = tape.inputs
    assert is_zero(0)
    assert is_zero(Fraction(0))
    assert not is_zero(Fraction(1))
    assert not is_zero(x)
    assert not is_zero(tape.node(0))
    assert tape.add(x, 0) is x
    assert tape.subtract(x, 0) is x
    assert tape.multiply(x, 0) == 0


def test_recorded_once_and_only_what_outputs_need():
    tape = Tape(1)
    (x,) = tape.inputs
    assert (x * x).index == (x * x).index
    assert (x * Fraction(1, 3)).index == (x * Fraction(1, 3)).index
    (found,) = values(in_balls(tape, [x * Fraction(1, 3)]), [ball(1)])
    assert found.rad() < 1e-30
    assert abs(found * 3 - 1) < 1e-30
    tape.sincos(x)
    kept = in_balls(tape, [x * x, 2])
    assert Kind.SINE not in {item.kind for item in kept.instructions}
    assert Kind.CONSTANT in {item.kind for item in kept.instructions}
    assert all(isinstance(item.constant, type(ball(1))) for item in kept.instructions if item.constant is not None)
    also = in_balls(tape, [x * x], [tape.sincos(x)[0]])
    assert Kind.SINE in {item.kind for item in also.instructions}
    assert 0 not in {item.target for item in also.instructions}


def test_derivatives_on_the_tape():
    """Of every operation but solutions, which are held: against power series along the direction."""
    tape = Tape(2)
    x, y = tape.inputs
    s, c = tape.sincos(x * y)
    held = tape.solve([[x]], [[tape.node(1)]])[0, 0]
    expressions = [s, c, x - y * 3, x + x * y, tape.gain(x * Fraction(1, 4)), tape.gain(y * Fraction(1, 5), 1), 7, held]
    slopes = tape.derivative(expressions, {0: 2, 1: x * y})
    assert is_zero(slopes[6])
    assert is_zero(slopes[7])
    at = [ball(Fraction(7, 10)), ball(Fraction(-4, 10))]
    found = values(in_balls(tape, slopes), at)
    p, q = (flint().arb_series([a, d], prec=2) for a, d in zip(at, (ball(2), at[0] * at[1]), strict=True))
    inner = p * q
    expected = [inner.sin(), inner.cos(), p - 3 * q, p + inner, turning(p / 4), turning_slope(q / 5)]
    near(found[:6], [e[1] for e in expected])
    assert isinstance(slopes[0], Node)
    assert tape.derivative([x], {1: 1}) == [0]


DIRECTIONS = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, -1.0], [2.0, 1.0], [1.0, -2.0]])


def curved(bases, over=None):
    """Inputs x(s) = x₀ + a·s + ½ sᵀBs + (1/6) C sss with s ∈ ℝ², as jets at bases (B, 2)."""
    rng = np.random.default_rng(0)
    found = []
    for k in range(2):
        a, b, c = rng.normal(size=2), rng.normal(size=(2, 2)), rng.normal(size=(2, 2, 2))
        b, c = b + b.T, sum(c.transpose(p) for p in permutations(range(3)))
        parts = [exactly(bases[:, k])] + [exactly(np.repeat(part[None], len(bases), axis=0)) for part in (a, b, c)]
        found.append(Jet(*parts))
    return found


@pytest.mark.parametrize("order", [1, 2, 3])
def test_jets_are_taylor_coefficients_along_every_line(order):
    """Of s ↦ w(x(s)) along directions d the coefficients are w′d, ½ w″dd and (1/6) w‴ddd; the derivatives symmetric."""
    bases = np.array([[0.7, -0.4], [0.2, 0.9]])
    inputs = [Jet(*(part if k <= order else None for k, part in enumerate(jet))) for jet in curved(bases)]
    found = jets_over(program(), inputs, order)
    for d in DIRECTIONS:
        for row in range(2):
            lines = []
            for jet in inputs:
                terms = [jet.value.mid[row]]
                for degree, factorial in ((1, 1), (2, 2), (3, 6)):
                    part = jet[degree]
                    terms.append(0.0 if part is None else contracted(part.mid[row], d, degree) / factorial)
                lines.append(flint().arb_series(terms, prec=4))
            expected = by_series(*lines)
            for jet, e in zip(found, expected, strict=True):
                for degree, factorial in ((0, 1), (1, 1), (2, 2), (3, 6)):
                    if degree > order:
                        assert jet[degree] is None
                        continue
                    part = jet[degree]
                    told = 0.0 if part is None else contracted(part.mid[row], d, degree) / factorial
                    assert told == pytest.approx(float(e[degree]), abs=1e-11)
    for jet in found:
        for degree in range(2, order + 1):
            part = jet[degree]
            if part is not None:
                for turned in permutations(range(degree)):
                    other = part.mid.transpose(0, *(1 + k for k in turned))
                    np.testing.assert_allclose(part.mid, other, rtol=0, atol=1e-11)
                assert part.rad.max() < 1e-10


def contracted(part, d, degree):
    for _ in range(degree):
        part = part @ d
    return float(part)


def test_values_alone():
    found = jets_over(program(), [Jet(exactly(np.array([0.7]))), Jet(exactly(np.array([-0.4])))], 0)
    expected = values(program(), [ball(0.7), ball(-0.4)])
    for jet, e in zip(found, expected, strict=True):
        assert jet.value.mid[0] == pytest.approx(float(e), abs=1e-14)
        assert jet.slope is jet.bend is jet.twist is None


def pair(centre, reach):
    """A coordinate at its centre and over centre ± reach, with the slope 1."""
    value = joined(exactly(np.array([centre])), BallArray(np.array([centre]), np.array([reach])))
    return Jet(value, exactly(np.ones((2, 1))))


def test_pairs_are_narrowed_by_taylors_theorem():
    """Of x² about 1 over ±δ: the value 2δ + δ², attained, the slope 2δ, the bend 2; and so on for x³ and its twist."""
    tape = Tape(1)
    (x,) = tape.inputs
    d = 0.25
    square, cube = jets_over(in_balls(tape, [x * x, x * x * x]), [pair(1.0, d)], 3, np.array([[d]]))
    assert square.value.mid[1] == 1.0
    assert square.value.rad[1] == pytest.approx(2 * d + d * d, rel=1e-9)
    assert square.value.rad[0] < 1e-15
    assert square.slope.rad[1, 0] == pytest.approx(2 * d, rel=1e-9)
    assert square.bend.rad[1, 0, 0] < 1e-14
    assert square.twist is None or square.twist.mid.shape[0] == 1
    assert cube.value.rad[1] == pytest.approx((1 + d) ** 3 - 1, rel=0.02)
    assert cube.value.rad[1] >= (1 + d) ** 3 - 1
    assert cube.slope.rad[1, 0] == pytest.approx(6 * d + 3 * d * d, rel=1e-9)
    assert cube.bend.rad[1, 0, 0] == pytest.approx(6 * d, rel=1e-9)
    assert cube.twist.mid.tolist() == [[[[6.0]]]]


def test_what_cancels_is_narrowed_to_its_ends():
    """X (1 − x) about ½ over ±δ: ¼ ± δ², attained; (1 + x²)/x as a solution, its twist over the box alone."""
    tape = Tape(1)
    (x,) = tape.inputs
    d = 0.25
    parabola, quotient = jets_over(
        in_balls(tape, [x * (1 - x), tape.solve([[x]], [[1 + x * x]])[0, 0]]), [pair(0.5, d)], 3, np.array([[d]])
    )
    assert parabola.value.mid[1] == 0.25
    assert parabola.value.rad[1] == pytest.approx(d * d, rel=1e-9)
    assert quotient.twist.mid.shape == (1, 1, 1, 1)
    for at in (0.25, 0.5, 0.75):
        for jet, values_there in ((quotient, (at + 1 / at, 1 - at**-2, 2 * at**-3, -6 * at**-4)),):
            for part, value in zip(jet, values_there, strict=True):
                assert abs(part.mid.ravel()[-1] - value) <= part.rad.ravel()[-1]
