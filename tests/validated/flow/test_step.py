"""One validated step: closed forms, defects, exact starts."""

import numpy as np
import pytest

import ccpin
from ccpin.description import Part, combine, read_description
from ccpin.errors import ConvergenceError
from tests.oracles import rpdr as oracle

flint = pytest.importorskip("flint")

from ccpin.programs.tape import Tape  # noqa: E402
from ccpin.validated.arithmetic.balls import ball  # noqa: E402
from ccpin.validated.arithmetic.programs import in_balls  # noqa: E402
from ccpin.validated.arithmetic.series import all_series, gradients, values  # noqa: E402
from ccpin.validated.flow.defect import defect_along  # noqa: E402
from ccpin.validated.flow.marching import StepOptions, march  # noqa: E402
from ccpin.validated.flow.regularity import regular  # noqa: E402
from ccpin.validated.flow.start_search import closed_start  # noqa: E402
from ccpin.validated.flow.step import (  # noqa: E402
    ProvenStep,
    attempt,
    evaluate,
    start_box,
    start_of,
)
from ccpin.validated.model.closed_loop import recorded_loop  # noqa: E402
from tests.support.enclosures import FREE, MarchedField, balls, numbers, started  # noqa: E402
from tests.support.geared import geared  # noqa: E402
from tests.support.paper import START  # noqa: E402

pytestmark = pytest.mark.usefixtures("precise")


def known(name):
    """A program x′ = f(x) with its start and solution."""
    tape = Tape(1)
    (x,) = tape.inputs
    if name == "x²":
        return in_balls(tape, [x * x]), 1.0, lambda t: 1 / (1 - t)
    if name == "sin x":
        return in_balls(tape, [tape.sincos(x)[0]]), 1.0, lambda t: 2 * (t.exp() * ball(0.5).tan()).atan()
    if name == "cos x":
        return in_balls(tape, [tape.sincos(x)[1]]), 0.0, lambda t: 2 * ((t / 2).tanh()).atan()
    solution = tape.solve([[x, tape.node(0)], [tape.node(1), x]], [[1], [1]])  # second entry: (1 − 1/x)/x
    return in_balls(tape, [solution[1][0] + solution[0][0] * solution[0][0]]), 1.0, lambda t: (1 + 2 * t).sqrt()


@pytest.mark.parametrize("name", ["x²", "sin x", "cos x", "A⁻¹b"])
def test_equations_with_known_solutions(name):
    """Steps enclose closed-form solutions to 1e-18, and the first Taylor coefficient's gradient is right."""
    program, start, solution = known(name)
    options = StepOptions(order=25, tolerance=1e-20, pieces=4, shortest=2.0**-20, longest=1.0)
    time, steps = 0.0, list(march(MarchedField(program, lambda box: 1.0), [ball(start)], 0.5, options))
    for step in steps:
        assert isinstance(step, ProvenStep)
        for fraction in (0.3, 1.0):
            (x,) = evaluate(step.polynomial, ball(fraction * step.length))
            gap = abs(x - solution(ball(time) + ball(fraction * step.length)))
            assert gap <= step.error[0] + ball(1e-30)
        time += step.length
        (end,) = start_box(step.end)
        assert end.overlaps(solution(ball(time)))
        assert end.rad() < 1e-17
    assert time == 0.5
    h = 1e-6
    ahead, behind = (numbers(values(program, [ball(start + d)]))[0] for d in (h, -h))
    slope = numbers(gradients(program, [ball(start)])[0])[0]
    assert slope == pytest.approx((ahead - behind) / (2 * h), abs=1e-8)


def test_a_solution_that_escapes_is_not_followed_beyond_its_end():
    """x′ = x² from 1 blows up at t = 1: the march ends before, and says so."""
    program, start, _ = known("x²")
    options = StepOptions(order=20, tolerance=1e-15, pieces=4, shortest=2.0**-14, longest=1.0)
    steps = list(march(MarchedField(program, lambda box: 1.0), [ball(start)], 2.0, options))
    assert not isinstance(steps[-1], ProvenStep)
    assert 0.9 < sum(step.length for step in steps[:-1]) < 1.0


def test_defect_bounds_the_defect(rpdr_model, law):
    """|p′ − f(p)| evaluated along a step stays below its bound, and comes near it at the end."""
    loop, start = started(rpdr_model, law, [1.0, -2.0])
    series, h = all_series(loop.field, [x.mid() for x in start], 12), ball(2.0**-7)
    polynomial = series[: loop.field.inputs]
    slope = [[k * c for k, c in enumerate(row)][1:] for row in polynomial]
    bound, largest = defect_along(loop.field, series, h), [0.0] * loop.field.inputs
    for k in range(1, 9):
        t = h * k / 8
        rates = values(loop.field, evaluate(polynomial, t))
        for i, (a, b) in enumerate(zip(evaluate(slope, t), rates, strict=True)):
            assert abs(a - b).lower() <= bound[i]
            largest[i] = max(largest[i], float(abs(a - b).mid()))
    for i in loop.dependent:
        assert largest[i] > 1e-4 * float(bound[i].mid()) > 0


def test_exact_start(rpdr_model):
    """Krawczyk's box holds the closed form of σ, is as small as the precision, and is on the branch of `near`."""
    loop = recorded_loop(rpdr_model, None).equations
    q = balls(START)
    for mode in (1.0, -1.0):
        expected = oracle.sigma(START, mode)[FREE]
        box = closed_start(loop, q, expected)
        np.testing.assert_allclose(np.angle(np.exp(1j * (numbers(box) - expected))), 0.0, rtol=0, atol=1e-14)
        assert max(float(x.rad()) for x in box) < 1e-35
        assert all(phi.contains(0) for phi in values(loop.closure, [*box, *balls([0.0, 0.0])]))


def test_a_coupling_leaves_the_loops_beside_it_sharp():
    """Gears tell their wheel exactly, and the five-bar's angles beside them are as small as the precision, too."""
    gears = geared([((0.0, 1.0),), ((0.0, -2.0),)], ["revolute"] * 2, [0.0, 0.0]).description
    model = ccpin.ReducedModel(
        ccpin.load(combine("both", {"bar_": Part(read_description("rpdr")), "gear_": Part(gears)}))
    )
    loop, start = recorded_loop(model, None).equations, model.at(model.alpha(model.mechanism.q_reference)).q_free
    assert len(loop.dependent) == 3
    box = closed_start(loop, balls(start[list(loop.independent)]), start)
    assert max(float(x.rad()) for x in box) < 1e-35


def test_a_start_that_cannot_be_closed_is_refused(rpdr_model):
    """Where no solution is near nothing is claimed."""
    loop = recorded_loop(rpdr_model, None).equations
    with pytest.raises(ConvergenceError, match="proven to exist"):
        closed_start(loop, balls(np.radians([180.0, 0.0])), np.array([np.pi, 0.3, 0.0, 0.2]))


def test_a_step_that_is_too_long_fails(rpdr_model, law):
    """The hypotheses do not hold for a step of 0.25 s, and do for one of 2⁻⁸ s."""
    loop, box = started(rpdr_model, law, None)
    start = start_of(box)
    series = all_series(loop.field, start.centre, 20)
    assert isinstance(attempt(regular(loop), start, series, 2.0**-8, 8), ProvenStep)
    refused = attempt(regular(loop), start, series, 0.25, 8)
    assert isinstance(refused, str)
    assert "proven" in refused or "Picard" in refused or "converge" in refused


def test_taylor_coefficients_are_derivatives(rpdr_model, law):
    """x₁ = f(x₀) and 2x₂ = f′(x₀)f(x₀)."""
    loop, state = started(rpdr_model, law, [3.0, -1.0])
    rates, slopes = numbers(values(loop.field, state)), np.array([numbers(row) for row in gradients(loop.field, state)])
    coefficients = all_series(loop.field, state, 2)[: loop.field.inputs]
    np.testing.assert_allclose(numbers([c[1] for c in coefficients]), rates, rtol=1e-13)
    np.testing.assert_allclose(2 * numbers([c[2] for c in coefficients]), slopes @ rates, rtol=1e-12)
