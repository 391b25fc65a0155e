"""Validated integration: the recorded dynamics, the step theorem, enclosures of motions and the certified move."""

import sys
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import ccpin
from ccpin.control import certify_law
from ccpin.description import CLOSURE_KINDS
from ccpin.errors import CcpinError, ConvergenceError, InvalidInputError, UnsupportedMechanismError
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.tree import build_tree
from tests.oracles import rpdr as oracle
from tests.support.limp import Limp
from tests.support.loading import script
from tests.support.singular import least_singular_value
from tests.support.strategies import Growth

flint = pytest.importorskip("flint")

from ccpin.validated import certify_move, enclose  # noqa: E402
from ccpin.validated.arithmetic.balls import ball  # noqa: E402
from ccpin.validated.arithmetic.series import all_series, gradients, values  # noqa: E402
from ccpin.validated.arithmetic.tape import Tape  # noqa: E402
from ccpin.validated.flow.closing import closed_start  # noqa: E402
from ccpin.validated.flow.defect import defect_along  # noqa: E402
from ccpin.validated.flow.motion_task import task_of  # noqa: E402
from ccpin.validated.flow.regularity import regular  # noqa: E402
from ccpin.validated.flow.step import (  # noqa: E402
    ProvenStep,
    StepOptions,
    WatchedField,
    attempt,
    evaluate,
    march,
    start_box,
    start_of,
)
from ccpin.validated.model.closed_loop import recorded_loop  # noqa: E402
from ccpin.validated.model.recorded_tree import closure_rows, exact_joints  # noqa: E402
from tests.support.paper import GOAL, K_V, START  # noqa: E402

FREE = [0, 2, 1, 3]  # the paper's (q1, q2, q3, q4) in ccpin's order (q1, q3, q2, q4)


@pytest.fixture(autouse=True)
def _precision():
    with flint.ctx.workprec(128):
        yield


@pytest.fixture(scope="module")
def law(rpdr_model):
    return paper_law(rpdr_model)


def paper_law(model, K_p=(11.0, 11.0)):
    return ccpin.control.PDSimpleGravity(model, GOAL, K_p, K_V)


@pytest.fixture(scope="module")
def motion(rpdr_model, law):
    """The first 0.1 s of the paper's move, by an ordinary integrator."""
    return accurately(rpdr_model, law, START, None, 0.1)


@pytest.fixture(scope="module")
def enclosure(rpdr_model, law):
    return enclose(rpdr_model, law, START, None, 0.1)


def accurately(model, controller, q0, v0, duration):
    return ccpin.simulate(model, controller, q0, v0, duration=duration, method="DOP853", rtol=1e-12, atol=1e-13)


def started(model, law, v0):
    """The loop, and its exact start at the paper's."""
    task = task_of(model, law, START, None, 0.1, StepOptions(30, 1e-18, 16), 128)
    return task.loop, task.start(START, v0)


def balls(*arrays):
    return [ball(float(x)) for x in np.concatenate(arrays)]


def numbers(box):
    return np.array([float(x.mid()) for x in box])


@pytest.mark.parametrize("stated", [{}, {"damping": 0.3, "stiffness": 1.7, "spring_reference": 0.2}])
@pytest.mark.parametrize("name", ["rpdr", "slider_crank", "planar_3rrr", "delta"])
def test_recorded_dynamics(name, stated):
    """The tape's (ρq̇, q̈) and energies are the reduced model's at random closed states, under every law it knows."""
    last = ccpin.load(name).tree.names[-1]
    model = ccpin.ReducedModel(ccpin.load(name, joints={last: stated}))
    n, rng = model.n, np.random.default_rng(1)
    q_d = model.alpha(model.mechanism.q_reference)
    gains = q_d, rng.uniform(5, 9, n), rng.uniform(0.5, 0.9, n)
    laws = None, ccpin.control.PDSimpleGravity(model, *gains), ccpin.control.PDFullGravity(model, *gains)
    for controller in laws:
        loop = recorded_loop(model, controller)
        q_free = model.sigma(q_d + 0.05 * rng.normal(size=n))
        q, v = model.alpha(q_free), rng.normal(size=n)
        u = np.zeros(model.n_actuated) if controller is None else controller.torque(0.0, q, v, q_free)
        expected = np.concatenate([model.rho(q_free) @ v, model.forward_dynamics(q, v, u, q_free)])
        found = numbers(values(loop.field, balls(q_free, v)))
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * max(1.0, np.abs(expected).max()))
        energy = model.energy(q, v, q_free)
        np.testing.assert_allclose(numbers(values(loop.energies, balls(q_free, v))), energy, rtol=1e-12)


@pytest.mark.parametrize("planar", [False, True])
@pytest.mark.parametrize("kind", CLOSURE_KINDS)
def test_recorded_closures(kind, planar):
    """φ on a tape is φ, on open configurations too, for every closure kind on a moving ancestor."""
    growth = Growth(np.random.default_rng(3), planar)
    trunk = growth.grow("base", ["revolute", "prismatic"])
    growth.close(kind, growth.grow(trunk, ["revolute"] * 3), growth.grow(trunk, ["prismatic", "revolute"]))
    description = growth.drawn().description
    tree = build_tree(description)
    constraints = Constraints(tree, description.closures, ())
    joints = exact_joints(tree)
    tape = Tape(len(joints))
    program = tape.program(closure_rows(tape, constraints, joints, tape.inputs))
    q_free = np.random.default_rng(4).normal(size=len(joints))
    np.testing.assert_allclose(
        numbers(values(program, balls(q_free))), constraints.residual(q_free), rtol=0, atol=1e-13
    )


def known(name):
    """A program x′ = f(x) with its start and solution."""
    tape = Tape(1)
    (x,) = tape.inputs
    if name == "x²":
        return tape.program([x * x]), 1.0, lambda t: 1 / (1 - t)
    if name == "sin x":
        return tape.program([tape.sincos(x)[0]]), 1.0, lambda t: 2 * (t.exp() * ball(0.5).tan()).atan()
    if name == "cos x":
        return tape.program([tape.sincos(x)[1]]), 0.0, lambda t: 2 * ((t / 2).tanh()).atan()
    solution = tape.solve([[x, tape.node(0)], [tape.node(1), x]], [[1], [1]])  # second entry: (1 − 1/x)/x
    return tape.program([solution[1][0] + solution[0][0] * solution[0][0]]), 1.0, lambda t: (1 + 2 * t).sqrt()


@pytest.mark.parametrize("name", ["x²", "sin x", "cos x", "A⁻¹b"])
def test_equations_with_known_solutions(name):
    """Steps enclose closed-form solutions to 1e-18, and the first Taylor coefficient's gradient is right."""
    program, start, solution = known(name)
    options = StepOptions(order=25, tolerance=1e-20, pieces=4, shortest=2.0**-20, longest=1.0)
    time, steps = 0.0, list(march(WatchedField(program, lambda box: 1.0), [ball(start)], 0.5, options))
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
    steps = list(march(WatchedField(program, lambda box: 1.0), [ball(start)], 2.0, options))
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
    """Krawczyk's box holds the closed form of σ, is as small as the precision, and is on the guess's branch."""
    loop = recorded_loop(rpdr_model, None)
    q = balls(START)
    for mode in (1.0, -1.0):
        expected = oracle.sigma(START, mode)[FREE]
        box = closed_start(loop, q, expected)
        np.testing.assert_allclose(np.angle(np.exp(1j * (numbers(box) - expected))), 0.0, rtol=0, atol=1e-14)
        assert max(float(x.rad()) for x in box) < 1e-35
        assert all(phi.contains(0) for phi in values(loop.closure, [*box, *balls([0.0, 0.0])]))


def test_a_start_that_cannot_be_closed_is_refused(rpdr_model):
    """Where no solution is near nothing is claimed."""
    loop = recorded_loop(rpdr_model, None)
    with pytest.raises(ConvergenceError, match="proven to exist"):
        closed_start(loop, balls(np.radians([180.0, 0.0])), np.array([np.pi, 0.3, 0.0, 0.2]))


def test_encloses_what_an_integrator_computes(enclosure, motion):
    """Every sample of the move lies in the sharp box at its time (to the integrator's accuracy) and in the step's."""
    assert enclosure.verdict == "proven"
    assert enclosure.times[-1] >= 0.1
    for t, q_free, v in zip(motion.t, motion.q_free, motion.v, strict=True):
        assert enclosure.contains(t, q_free, v, tolerance=1e-9)
        k = min(np.searchsorted(enclosure.times, t, side="right") - 1, len(enclosure.steps) - 1)
        assert np.all((enclosure.q_free_lower[k] - 1e-9 <= q_free) & (q_free <= enclosure.q_free_upper[k] + 1e-9))
        assert np.all((enclosure.v_lower[k] - 1e-9 <= v) & (v <= enclosure.v_upper[k] + 1e-9))
    assert max(float(x.rad()) for x in enclosure.box(float(enclosure.times[-1]))) < 1e-13
    assert not enclosure.contains(0.1, motion.q_free[-1] + 1e-8, motion.v[-1], tolerance=1e-9)


def test_enclosures_of_other_orders_and_precisions_overlap(rpdr_model, law, enclosure):
    """Both hold the one exact trajectory, so their boxes meet at every time."""
    other = enclose(rpdr_model, law, START, None, 0.1, precision=192, order=22, tolerance=1e-22, pieces=5)
    for t in np.linspace(0.0, 0.1, 41):
        assert all(a.overlaps(b) for a, b in zip(enclosure.box(t), other.box(t), strict=True))


def test_determinant_bound(enclosure, motion):
    """The bound on |det ψ_q′| lies below a₃a₄|sin(q1 + q3 − q2 − q4)| at every sample, and within 30 % of it."""
    for k, (begin, end) in enumerate(zip(enclosure.times[:-1], enclosure.times[1:], strict=True)):
        inside = (begin <= motion.t) & (motion.t <= end)
        exact = np.array([abs(np.sin(oracle.fold(q[FREE]))) * oracle.A3 * oracle.A4 for q in motion.q_free[inside]])
        assert np.all(0.7 * exact < enclosure.determinant[k])
        assert np.all(enclosure.determinant[k] <= exact)
    assert enclosure.smallest_determinant == enclosure.determinant.min()


@pytest.mark.parametrize("wrong", ["gain", "mass", "branch"])
def test_a_wrong_model_does_not_contain_the_motion(rpdr, rpdr_model, law, motion, wrong):
    """A gain, a mass wrong by one part in a million, or the other assembly mode: the motion is not enclosed."""
    model, controller, guess = rpdr_model, law, None
    if wrong == "gain":
        controller = paper_law(model, [11.0 * (1 + 1e-6), 11.0])
    elif wrong == "mass":
        links = tuple(
            replace(link, inertia=replace(link.inertia, mass=link.inertia.mass * (1 + 1e-6)))
            if link.name == "link3"
            else link
            for link in rpdr.description.links
        )
        model = ccpin.ReducedModel(ccpin.load(replace(rpdr.description, links=links)))
    else:
        guess = oracle.sigma(START, -1.0)[FREE]
    other = enclose(model, controller, START, None, 0.05, guess=guess)
    k = 50
    assert motion.t[k] == pytest.approx(0.05)
    assert not other.contains(min(motion.t[k], other.times[-1]), motion.q_free[k], motion.v[k], tolerance=1e-8)


def test_a_step_that_is_too_long_fails(rpdr_model, law):
    """The hypotheses do not hold for a step of 0.25 s, and do for one of 2⁻⁸ s."""
    loop, box = started(rpdr_model, law, None)
    start = start_of(box)
    series = all_series(loop.field, start.centre, 20)
    assert isinstance(attempt(regular(loop), start, series, 2.0**-8, 8), ProvenStep)
    refused = attempt(regular(loop), start, series, 0.25, 8)
    assert isinstance(refused, str)
    assert "proven" in refused or "Picard" in refused or "converge" in refused


def test_a_motion_into_a_singularity_is_followed_almost_there(rpdr_model):
    """Flung towards stretched links the enclosure stops shortly before the singularity, with a reason."""
    q0, v0 = np.radians([-108.0, -72.0]), [-8.0, 8.0]
    stopped = enclose(rpdr_model, None, q0, v0, 0.5, order=20, tolerance=1e-14, shortest_step=2.0**-11)
    singular = ccpin.simulate(rpdr_model, Limp(2), q0, v0, duration=0.5, singular_rcond=3e-3)
    assert singular.status == "singular"
    assert stopped.verdict == "refuted"
    assert 0.8 * singular.t[-1] < stopped.times[-1] < singular.t[-1] + 2e-3
    assert stopped.witness.kind == "singular"
    assert np.abs(rpdr_model.mechanism.constraints().residual(stopped.witness.q_free)).max() < 1e-9
    assert least_singular_value(rpdr_model.mechanism, stopped.witness.q_free) < 10 * stopped.witness.error + 1e-9
    assert oracle.elongation(stopped.witness.q) == pytest.approx(1.0, abs=1e-8)
    assert stopped.determinant[-1] < 0.3 * stopped.determinant[0]
    assert np.all(stopped.determinant > 0)


def test_energy_is_constant_along_undamped_swinging(rpdr_model):
    """Without torque the energy's ball holds the energy of the start at all times."""
    swing = enclose(rpdr_model, None, np.radians([-108.0, -120.0]), [1.0, -1.0], 0.2)
    start = swing.energy(0.0)
    assert swing.verdict == "proven"
    for t in np.linspace(0.0, 0.2, 21):
        assert swing.energy(t).contains(start.mid())
        assert swing.energy(t).rad() < 1e-14


def test_closed_loop_dissipates(enclosure, motion, law):
    """𝒱 + V(q_d) in balls decreases from step to step, by ∫q̇ᵀK_v q̇, and agrees with the law's own 𝒱."""
    steps = [values(enclosure.loop.lyapunov, start_box(step.end))[0] for step in enclosure.steps]
    assert all(later < earlier for earlier, later in pairwise(steps))
    samples = [values(enclosure.loop.lyapunov, enclosure.box(t))[0] for t in motion.t]
    drop = float((samples[0] - samples[-1]).mid())
    power = np.einsum("ti,i,ti->t", motion.v, K_V, motion.v)
    simpson = np.sum((power[:-2:2] + 4 * power[1:-1:2] + power[2::2]) / 3e3)
    assert drop == pytest.approx(simpson, rel=1e-6)
    own = law.lyapunov(motion.q[0], motion.v[0]) - law.lyapunov(motion.q[-1], motion.v[-1])
    assert drop == pytest.approx(own, abs=1e-9)


@pytest.mark.parametrize("name", ["slider_crank", "planar_3rrr"])
def test_other_mechanisms(name):
    """Enclosures hold the motion of mechanisms with sliding joints and with a ternary platform."""
    model = ccpin.ReducedModel(ccpin.load(name))
    q = model.alpha(model.mechanism.q_reference)
    controller = ccpin.control.PDSimpleGravity(model, q + 0.05, np.full(model.n, 5.0), np.full(model.n, 0.5))
    found = enclose(model, controller, q, None, 0.01, order=16, tolerance=1e-14, pieces=4)
    sample = accurately(model, controller, q, None, 0.01)
    assert found.verdict == "proven"
    assert all(found.contains(*state, tolerance=1e-9) for state in zip(sample.t, sample.q_free, sample.v, strict=True))


def test_the_papers_move_is_certified(rpdr_model, law):
    """From 𝒱 = 13.1 J the move is proven to reach 𝒱 < 2.9 J on q_d's branch; an integrator agrees with T and 𝒱."""
    move = certify_move(rpdr_model, law, START, arrival=2.9)
    assert move.verdict == "proven"
    assert not move.rigorous  # a plain number
    assert move.lyapunov_start == pytest.approx(law.lyapunov(START, np.zeros(2)), abs=1e-9)
    sample = accurately(rpdr_model, law, START, None, move.time)
    assert move.lyapunov == pytest.approx(law.lyapunov(sample.q[-1], sample.v[-1], sample.q_free[-1]), abs=1e-8)
    assert move.lyapunov < 2.9 < move.lyapunov_start
    assert move.enclosure.smallest_determinant > 0.05


def test_moves_that_are_not_proven_say_why(rpdr_model, law):
    """Too little time, and a state on the other assembly mode, however large the level: not covered."""
    early = certify_move(rpdr_model, law, START, arrival=2.9, duration=0.05)
    assert early.verdict == "undecided"
    assert "not proven to arrive" in early.reason
    other = oracle.sigma(GOAL, -1.0)[FREE]
    wrong = certify_move(rpdr_model, law, GOAL, arrival=1e3, duration=0.002, guess=other)
    assert wrong.verdict == "undecided"
    assert "branch" in wrong.reason


def test_a_move_whose_energy_is_too_low_is_refuted(rpdr_model):
    """With gains too small to hold the arms up 𝒱 falls below 0, by the reference's figures too: it cannot arrive."""
    raised = np.radians([20.0, -160.0])  # ∂g/∂q has the eigenvalue −0.63 N m/rad there
    weak = ccpin.control.PDSimpleGravity(rpdr_model, raised, 0.3, 0.1)
    slope = rpdr_model.gravity_derivative(weak.q_d, weak.q_free_d)
    start = raised + 0.2 * np.linalg.eigh(slope)[1][:, 0]
    move = certify_move(rpdr_model, weak, start, arrival=1.0, duration=0.05)
    assert (move.verdict, move.witness.kind) == ("refuted", "state")
    at = move.enclosure.at(move.time)
    assert np.abs(at.q_free - move.witness.q_free).max() < 1e-12
    assert weak.lyapunov(move.witness.q, at.v, at.q_free) < 0.0
    assert "never rises" in move.reason


@pytest.mark.slow
def test_from_the_papers_start_to_rest(rpdr_model, law):
    """With Theorem 3's own certificate the whole statement is proven: from 13.1 J into B₂ and to rest at q_d."""
    certificate = certify_law(law)
    move = certify_move(rpdr_model, law, START, arrival=certificate)
    assert move.verdict == "proven"
    assert move.rigorous
    assert move.lyapunov < certificate.level < move.lyapunov_start
    at = move.enclosure.at(move.time)
    assert certificate.contains(at.q_free[[0, 2]], at.v)


@pytest.mark.slow
def test_the_whole_move_is_enclosed(rpdr_model, law):
    """0.6 s of the paper's move, to rest within 1e-2 rad of the goal, agrees with the integrator throughout."""
    whole = enclose(rpdr_model, law, START, None, 0.6, pieces=32)
    sample = accurately(rpdr_model, law, START, None, 0.6)
    assert whole.verdict == "proven"
    assert all(whole.contains(*state, tolerance=1e-9) for state in zip(sample.t, sample.q_free, sample.v, strict=True))
    np.testing.assert_allclose(whole.at(0.6).q_free[[0, 2]], GOAL, rtol=0, atol=1e-2)


@pytest.mark.slow
def test_a_spatial_mechanism_is_enclosed():
    """The delta robot under PD."""
    model = ccpin.ReducedModel(ccpin.load("delta"))
    q = model.alpha(model.mechanism.q_reference)
    controller = ccpin.control.PDSimpleGravity(model, q + 0.1, np.full(3, 5.0), np.full(3, 0.5))
    found = enclose(model, controller, q, None, 0.02, order=20, tolerance=1e-14, pieces=4)
    sample = accurately(model, controller, q, None, 0.02)
    assert found.verdict == "proven"
    assert all(found.contains(*state, tolerance=1e-9) for state in zip(sample.t, sample.q_free, sample.v, strict=True))


def test_scope(rpdr_model):
    """Other laws, and starts of another shape, are refused with the reason."""
    with pytest.raises(UnsupportedMechanismError, match="TorqueFunction"):
        enclose(rpdr_model, ccpin.control.TorqueFunction(lambda t, q, v: q), START, None, 0.01)
    with pytest.raises(InvalidInputError, match="shape"):
        enclose(rpdr_model, None, [0.0], None, 0.01)


@pytest.mark.parametrize(
    "bad",
    [
        {"duration": -1.0},
        {"precision": 10},
        {"order": 1},
        {"tolerance": 1e-99},
        {"pieces": 0},
        {"shortest_step": 1.0, "longest_step": 0.1},
    ],
)
def test_bad_arguments(rpdr_model, bad):
    """Arguments out of range are named."""
    arguments = {"q0": START, "v0": None, "duration": 0.01, **bad}
    with pytest.raises(InvalidInputError, match=next(iter(bad)).partition("_")[0]):
        enclose(rpdr_model, None, **arguments)


def test_bad_arrivals(rpdr_model, law, enclosure):
    """A level that is not positive, a certificate of another law and a time not covered are refused."""
    with pytest.raises(InvalidInputError, match="positive"):
        certify_move(rpdr_model, law, START, arrival=0.0)

    class Other:
        level, rigorous = 1.0, True
        law = paper_law(rpdr_model, [12.0, 12.0])

    with pytest.raises(InvalidInputError, match="control laws"):
        certify_move(rpdr_model, law, START, arrival=Other())
    with pytest.raises(InvalidInputError, match="simple gravity"):
        certify_move(rpdr_model, None, START, arrival=1.0)
    with pytest.raises(InvalidInputError, match="not covered"):
        enclosure.box(1.0)


def test_python_flint_is_optional(rpdr_model, monkeypatch):
    """Without python-flint the error names the extra to install."""
    monkeypatch.setitem(sys.modules, "flint", None)
    with pytest.raises(CcpinError, match=r"ccpin\[validated\]"):
        enclose(rpdr_model, None, START, None, 0.01)


def test_taylor_coefficients_are_derivatives(rpdr_model, law):
    """x₁ = f(x₀) and 2x₂ = f′(x₀)f(x₀)."""
    loop, state = started(rpdr_model, law, [3.0, -1.0])
    rates, slopes = numbers(values(loop.field, state)), np.array([numbers(row) for row in gradients(loop.field, state)])
    coefficients = all_series(loop.field, state, 2)[: loop.field.inputs]
    np.testing.assert_allclose(numbers([c[1] for c in coefficients]), rates, rtol=1e-13)
    np.testing.assert_allclose(2 * numbers([c[2] for c in coefficients]), slopes @ rates, rtol=1e-12)


@pytest.mark.slow
def test_script(capsys):
    """scripts/certified_move.py covers the move and prints what it took."""
    assert script("certified_move").main(2.9)
    said = capsys.readouterr().out
    assert "rigorous: True" in said
    assert said.count(": proven, T = 0.1") == 2
