"""Tracking with σ off by ε: the bound holds against errors that do their worst, and is not much above them."""

from functools import lru_cache

import numpy as np
import pytest

import ccpin
from ccpin.control import (
    ComputedTorque,
    Hold,
    PDOnlineGravity,
    PDPlus,
    PointToPoint,
    Reference,
    Waypoints,
    WithSigmaError,
    certify_tracking,
    largest_sigma_error,
)
from ccpin.control.online import capped_sigma
from ccpin.control.stability.tracking.cell_forms import forms_of
from ccpin.control.stability.tracking.reference_tube import feedback_of, tube_of
from ccpin.control.stability.tracking.storage import floor, storage_of
from ccpin.control.stability.tracking.tube_search import choice_for
from ccpin.errors import ConvergenceError, InvalidInputError, UnsupportedMechanismError
from ccpin.proof.balls import Affine, affine
from tests.support.long_cases import later
from tests.support.paper import GOAL, START
from tests.support.sigma_attacks import WithWrongSigma, dependent_rows, pushing, switching
from tests.support.tracked import LAWS, MOVES, RUN, assert_within, law_for, model_of
from tests.support.walkthrough import file

every_law = pytest.mark.parametrize("law_class", LAWS)
one_law = pytest.mark.parametrize("law_class", later(*LAWS))


@lru_cache
def certificate(law_class, sigma_error, **given):
    return certify_tracking(law_for(law_class), sigma_error, **given)


def attacked(law, proof, signs, seeds):
    """The largest errors under δ that push each error most and δ that switch at random, all within the bound."""
    attacks = [pushing(law, proof.sigma_error, sign * axis) for axis in np.eye(2) for sign in signs]
    attacks += [switching(law, proof.sigma_error, seed) for seed in seeds]
    options = RUN | {"rtol": min(1e-5, 1e-2 * proof.sigma_error), "atol": 1e-12}
    motions = (ccpin.simulate(law.model, WithWrongSigma(law, attack), START, **options) for attack in attacks)
    return np.max([assert_within(proof, law, motion) for motion in motions], axis=0)


@one_law
def test_no_error_of_sigma_breaks_the_bound(law_class):
    """And a bound of half the size would be broken (computed torque's in each coordinate)."""
    law, proof = law_for(law_class), certificate(law_class, 1e-3)
    assert proof.verdict == "proven"
    share = attacked(law, proof, signs=(1.0,), seeds=(0,)) / proof.error
    assert share.max() > 0.5
    assert share.min() > (0.5 if law_class is ComputedTorque else 0.4)


@pytest.mark.slow
@every_law
@pytest.mark.parametrize("sigma_error", [1e-5, 1e-3, 1e-2])
def test_many_errors_of_sigma(law_class, sigma_error):
    """Of both signs, and twenty that switch at random."""
    law, proof = law_for(law_class), certificate(law_class, sigma_error)
    assert proof.verdict == "proven"
    assert np.all(attacked(law, proof, signs=(1.0, -1.0), seeds=range(20)) > 0.25 * proof.error)


@every_law
@pytest.mark.slow
def test_delta(law_class):
    """Eighteen dependent coordinates: the bound holds against constant and switching δ."""
    law = law_for(law_class, "delta")
    proof = certify_tracking(law, 1e-3, cells=20)
    assert proof.verdict == "proven"
    rows, rng = dependent_rows(law.model), np.random.default_rng(2)
    for seed in range(2):
        direction = rng.normal(size=len(rows))
        constant = 1e-3 * direction / np.linalg.norm(direction)
        for error in (lambda t, state, v, d=constant: d, switching(law, 1e-3, seed)):
            motion = ccpin.simulate(law.model, WithWrongSigma(law, error), MOVES["delta"][0], **RUN)
            assert_within(proof, law, motion)


@pytest.mark.parametrize("name", later("slider_crank", "gripper", "four_bar", "planar_3rrr"))
def test_other_mechanisms(name):
    """Couplings alone, sliding joints, one coordinate and three: the push that does most, and one at random."""
    model = ccpin.ReducedModel(ccpin.load(file(name) if name == "gripper" else name))
    start = model.alpha(model.mechanism.q_reference)
    law = ComputedTorque(model, PointToPoint(model, start, start + 0.05, 0.3), [400.0] * model.n, [40.0] * model.n)
    proof = certify_tracking(law, 1e-4, cells=24)
    assert proof.verdict == "proven"
    for error in (pushing(law, 1e-4, np.eye(model.n)[0]), switching(law, 1e-4, 0)):
        assert_within(proof, law, ccpin.simulate(model, WithWrongSigma(law, error), start, **RUN | {"duration": 0.35}))


@pytest.mark.slow
@one_law
def test_a_start_that_is_off(law_class):
    """Errors at the corners of what is allowed at t = 0 die out within the bound, and the bound with them."""
    law = law_for(law_class)
    proof = certify_tracking(law, 1e-4, initial_error=[2e-3, 1e-3], initial_speed=0.02)
    for e, e_dot in (([2e-3, 1e-3], [0.02, 0.02]), ([-2e-3, 1e-3], [0.02, -0.02])):
        start = MOVES["rpdr"][0] - np.array(e)
        attack = WithWrongSigma(law, switching(law, 1e-4, 1))
        motion = ccpin.simulate(law.model, attack, start, -np.array(e_dot), **RUN)
        assert_within(proof, law, motion)
    assert np.all(proof.ultimate < 0.05 * proof.error)
    assert np.all(proof.errors[0] >= [2e-3, 1e-3])


@pytest.mark.parametrize("law_class", later(PDPlus, ComputedTorque))
def test_friction_that_the_model_does_not_have(law_class):
    """Coulomb friction of a known level on the motors is a disturbance."""
    law, level = law_for(law_class), np.array([0.05, 0.03])
    proof = certify_tracking(law, 1e-4, disturbance=level)
    motion = ccpin.simulate(law.model, law, START, friction=(level, np.zeros(2)), **RUN)
    worst = assert_within(proof, law, motion)
    assert np.all(worst > 0.1 * proof.error)


@one_law
def test_input_to_state(law_class):
    """The bound is in first order of ε, and |e| ≤ unit · γ ε."""
    small, large = certificate(law_class, 1e-6), certificate(law_class, 1e-4)
    np.testing.assert_allclose(100.0 * small.error, large.error, rtol=0.02)
    for proof in (small, large):
        assert np.all(proof.error <= proof.unit[:2] * proof.gain * proof.sigma_error * (1.0 + 1e-6))
        assert proof.decay > 0.0
        assert proof.start == 0.0
        assert np.all(proof.ultimate <= proof.errors[-1])


@pytest.mark.slow
@one_law
def test_more_cells_are_nearer(law_class):
    """Twice the cells lower the bound; by how much tells how far it is from its limit."""
    coarse, fine = certificate(law_class, 1e-3, cells=48).error, certificate(law_class, 1e-3).error
    assert np.all(fine < coarse)
    assert np.all(coarse < 2.5 * fine)


@one_law
def test_holding_a_set_point(law_class):
    """A reference that rests is one cell; against a σ off by a constant and by what does most."""
    law = law_for(law_class, reference=Hold(model_of("rpdr"), GOAL))
    proof = certify_tracking(law, 1e-2)
    assert proof.verdict == "proven"
    assert len(proof.errors) == 1
    offset = np.zeros(4)
    offset[dependent_rows(law.model)] = 1e-2 * np.sqrt(0.5)
    assert_within(proof, law, ccpin.simulate(law.model, WithSigmaError(law, offset), GOAL, **RUN))
    worst = WithWrongSigma(law, pushing(law, 1e-2, np.eye(2)[0]))
    assert assert_within(proof, law, ccpin.simulate(law.model, worst, GOAL, **RUN))[0] > 0.3 * proof.error[0]


@pytest.mark.slow
@pytest.mark.parametrize("degree", later(3, 5))
def test_waypoints(degree):
    """A spline of several pieces, of degree three and five."""
    model = model_of("rpdr")
    points = np.array([START, 0.5 * (START + GOAL) + 0.1, GOAL])
    law = law_for(ComputedTorque, reference=Waypoints(model, [0.0, 0.3, 0.6], points, degree))
    proof = certify_tracking(law, 1e-4)
    assert proof.verdict == "proven"
    motion = ccpin.simulate(model, WithWrongSigma(law, switching(law, 1e-4, 0)), START, **RUN | {"duration": 0.7})
    assert_within(proof, law, motion)


@pytest.mark.parametrize("states", later(2, 5))
@every_law
def test_the_storage_function_falls_as_it_should(law_class, states):
    """V̇ = −xᵀWx − xᵀSΔ along the closed loop, by differences of V, with D and C of States and the law's own Δ."""
    law = law_for(law_class)
    proof = certificate(law_class, 1e-3)
    plan = _plan(law)
    rng, t = np.random.default_rng(4), 0.13
    wanted, offset = law.reference.at(t), np.array([0.0, 3e-3, 0.0, -2e-3])
    for _ in range(states):
        q, v = wanted.q - 1e-2 * rng.normal(size=2), wanted.v - 0.2 * rng.normal(size=2)
        state = law.state(q)

        def storage(t, q, v):
            at = law.state(q)
            found = storage_of(
                feedback_of(law), plan, affine(at.D[None]), affine(at.C(v)[None]), affine(at.damping[None])
            )
            return found, np.concatenate([law.reference.at(t).q - q, law.reference.at(t).v - v])

        u = WithSigmaError(law, offset).torque(t, state, v)
        a, h = state.forward_dynamics(v, u), 1e-5
        values = []
        for s in (-h, h):
            found, x = storage(t + s, q + s * v + 0.5 * s * s * a, v + s * a)
            values.append(x @ found.P.mid[0] @ x)
        found, x = storage(t, q, v)
        gap = u - law.torque(t, state, v)
        delta = np.linalg.solve(state.D, gap) if law_class is ComputedTorque else gap
        expected = -x @ found.W.mid[0] @ x - x @ found.S @ delta
        assert (values[1] - values[0]) / (2.0 * h) == pytest.approx(expected, rel=1e-4)
    assert proof.verdict == "proven"


def _plan(law):
    """A plan from the model at the start."""
    state = law.near
    return choice_for(feedback_of(law), np.ones(2), state.D[None], state.C(np.ones(2))[None], state.damping[None])


def test_floor_is_below():
    """Members of a form of symmetric matrices, whose entries differ in size, less the floor are positive definite."""
    rng = np.random.default_rng(0)
    size = np.diag([1.0, 10.0, 1e-3])
    for _ in range(50):
        middle = np.eye(3) + 0.2 * rng.random((3, 3))
        lin, rad = 0.03 * rng.normal(size=(2, 3, 3)), 0.02 * rng.random((3, 3))
        parts = (size @ (0.5 * (part + np.swapaxes(part, -1, -2))) @ size for part in (middle, lin, rad))
        middle, lin, rad = parts
        lowest = floor(Affine(middle[None], lin[:, None], rad[None], 2))[0]
        for _ in range(20):
            signs = np.triu(rng.choice([-1.0, 1.0], (3, 3)))
            some = middle + np.tensordot(rng.choice([-1.0, 1.0], 2), lin, axes=1) + (signs + np.triu(signs, 1).T) * rad
            assert np.linalg.eigvalsh(np.linalg.inv(size) @ (some - lowest) @ np.linalg.inv(size))[0] > 0.0


@pytest.mark.slow
def test_newton_from_sample_to_sample():
    """As many Newton steps as are said to suffice, from any σ of the sample before, leave less than ε; so does |φ|."""
    law = law_for(ComputedTorque)
    for sigma_error, period in ((1e-3, 1e-3), (1e-6, 1e-3), (1e-9, 1e-4)):
        proof = certificate(ComputedTorque, sigma_error)
        demand = proof.on_line(period)
        assert 1 <= demand.steps <= 4
        model, rng, rows = law.model, np.random.default_rng(1), dependent_rows(law.model)
        for t in rng.uniform(0.0, 0.3, 30):
            wanted = law.reference.at(t)
            q, direction = wanted.q, rng.normal(size=len(rows))
            start = model.sigma(q - period * wanted.v, law.near.q_free)
            start[rows] += sigma_error * direction / np.linalg.norm(direction)
            exact = model.sigma(q, start)
            assert np.linalg.norm((start - exact)[rows]) <= demand.start
            solved = capped_sigma(model.parametrization, q, start, 8, demand.tolerance)
            assert np.linalg.norm((solved.point.q_free - exact)[rows]) <= sigma_error
            assert solved.steps <= demand.steps
    with pytest.raises(ConvergenceError, match="shorter period"):
        certificate(ComputedTorque, 1e-3).on_line(0.5)


@pytest.mark.slow
def test_the_largest_error_of_sigma():
    """It is proved, and a tenth more is not."""
    law = law_for(ComputedTorque)
    best = largest_sigma_error(law, cells=16)
    assert best.verdict == "proven"
    assert certify_tracking(law, 1.15 * best.sigma_error, cells=16).verdict == "undecided"


@pytest.mark.parametrize("cells", later(24, 128))
def test_what_cannot_be_proved_is_undecided_and_says_why(cells):
    """Too large an ε, a path through a singularity, gains that are too weak: no bound, and no exception."""
    large = certify_tracking(law_for(ComputedTorque), 0.3, cells=cells)
    assert large.verdict == "undecided"
    assert np.all(np.isinf(large.error))
    assert "sigma_error" in large.reason
    with pytest.raises(InvalidInputError, match="no proved motion"):
        large.on_line(1e-3)
    model = model_of("rpdr")
    through = PointToPoint(model, START, np.radians([-180.0, -20.0]), 1.0)
    lost = certify_tracking(law_for(ComputedTorque, reference=through), 1e-4, cells=cells)
    assert lost.verdict == "undecided"
    assert "reference itself" in lost.reason
    for gains, said in (((11.0, 1e-4), "errors up to"), ((1e-4, 0.65), "no storage function")):
        weak = PDPlus(model, PointToPoint(model, *MOVES["rpdr"]), *([gain] * 2 for gain in gains))
        reason = certify_tracking(weak, 1e-4, cells=cells).reason
        assert said in reason
        assert "stiffer gains" in reason


class _Circle(Reference):
    """No polynomial."""

    duration = 1.0

    def at(self, t):
        return Hold(model_of("rpdr"), GOAL).at(t)


def test_what_the_theorem_is_not_about_is_refused():
    """Other laws, motors elsewhere, references that are no polynomials, bad numbers."""
    model = model_of("rpdr")
    law = law_for(ComputedTorque)
    with pytest.raises(UnsupportedMechanismError, match="ComputedTorque or PDPlus"):
        certify_tracking(PDOnlineGravity(model, law.reference, [11.0] * 2, [0.65] * 2), 1e-3)
    elsewhere = ccpin.ReducedModel(ccpin.load("rpdr", actuated=["joint3", "joint4"], independent=["joint1", "joint2"]))
    with pytest.raises(UnsupportedMechanismError, match="motors sit elsewhere"):
        certify_tracking(
            ComputedTorque(elsewhere, PointToPoint(elsewhere, START, GOAL, 1.0), [1.0] * 2, [1.0] * 2), 1e-3
        )
    with pytest.raises(UnsupportedMechanismError, match="piecewise polynomial"):
        certify_tracking(ComputedTorque(model, _Circle(), [100.0] * 2, [20.0] * 2), 1e-3)
    for wrong in ({"disturbance": -1.0}, {"initial_error": [1.0, 2.0, 3.0]}, {"initial_speed": np.nan}, {"cells": 0}):
        with pytest.raises(InvalidInputError):
            certify_tracking(law, 1e-3, **wrong)
    for wrong in (0.0, -1.0, np.inf):
        with pytest.raises(InvalidInputError, match="sigma_error"):
            certify_tracking(law, wrong)
    with pytest.raises(InvalidInputError, match="law"):
        certify_tracking("computed torque", 1e-3)


def test_cells_cover_the_reference():
    """q_d, q̇_d and q̈_d at random times are in their cells' forms."""
    law = law_for(ComputedTorque)
    tube = tube_of(law, 40)
    room = np.zeros((len(tube.centre), 4))
    boxes, proved = tube.boxes(room[:, :2])
    assert proved.all()
    states = forms_of(tube.equations.closures.system, boxes, tube.cells, room)
    for t in np.random.default_rng(0).uniform(0.0, 0.4, 200):
        k = min(int(np.searchsorted(tube.cells.times, t, side="right")) - 1, len(room) - 1)
        wanted = law.reference.at(t)
        s = np.clip(2.0 * (t - tube.cells.times[k]) / (tube.cells.times[k + 1] - tube.cells.times[k]) - 1.0, -1.0, 1.0)
        theta = law.model.sigma(wanted.q, law.near.q_free)
        for form, value in ((states.theta, theta), (states.v_d, wanted.v), (states.a_d, wanted.a)):
            assert np.all(np.abs(value - form.mid[k] - s * form.lin[0, k]) <= form.rad[k])
