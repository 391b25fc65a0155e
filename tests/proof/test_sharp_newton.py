"""Solutions in proved boxes at equality: steps that stay in tubes and lower ‖f‖, errors, weights."""

from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.proof import newton
from ccpin.proof.bounds import Contraction
from ccpin.proof.equations import Problem
from ccpin.proof.newton import SolutionBall, TubesAt, check, in_tubes, predict, solve_in_boxes, weights_for, within
from ccpin.proof.rounding import SLACK, widened
from tests.support.straight import boxes_about, circles, straight


def problem_of(equations):
    return Problem(equations.system, equations.stack, equations.phasors)


PLANE = straight([[1.0], [2.0]])
BOX = boxes_about([[0.5, 0.5, 1.0]], 0.25, [[1.0], [2.0]], [1.0, 0.5])


def test_all_boxes_are_checked_each_by_the_bounds_that_prove_it():
    """However many, with whatever modes; a whole turn by phasors alone, and what phasors do not prove by lengths."""
    count = 2 * newton._PART + 5
    centre = np.zeros((count, 3))
    centre[1::3, 1] = 0.5  # no solution there
    boxes = boxes_about(centre, 0.25, [[1.0], [2.0]], 0.1)
    modes = boxes.modes.copy()
    modes[2::3, 0, 0] = 2.0
    gain = np.linalg.inv(modes)
    found = check(PLANE, boxes._replace(modes=modes, preconditioner=gain))
    assert found.proved.tolist() == [k % 3 != 1 for k in range(count)]
    turn = boxes_about([[0.0, 0.0], [0.0, 1.0]], np.pi, [[-1.0]], 0.1)
    assert check(circles(planar=True), turn).proved.tolist() == [True, False]
    assert check(circles(), turn).proved.tolist() == [False, False]


def test_a_point_of_a_box_is_where_its_numbers_say():
    """θ_c + Dδ + Eζ."""
    rng = np.random.default_rng(1)
    boxes = BOX._replace(modes=rng.normal(size=(1, 2, 2)), directions=rng.normal(size=(1, 3, 2)), half=np.ones((1, 2)))
    delta, zeta = rng.normal(size=(1, 2)), rng.normal(size=(1, 2))
    stated = boxes.centre[0] + boxes.directions[0] @ delta[0]
    np.testing.assert_allclose(predict(problem_of(PLANE), boxes, delta)[0], stated, rtol=1e-14)
    stated[1:] += boxes.modes[0] @ zeta[0]
    np.testing.assert_allclose(predict(problem_of(PLANE), boxes, delta, zeta)[0], stated, rtol=1e-14)


def test_parameters_are_of_a_box_by_all_of_them():
    plane = straight([[1.0, 1.0]])
    boxes = boxes_about([[0.0, 0.0, 0.0]], [0.25, 0.5], [[1.0, 1.0]], 0.1)
    most = widened(np.zeros(2), np.array([0.25, 0.5]))
    for share, held in (([1.0, 1.0], True), ([-1.0, 1.0], True), ([1.01, 0.0], False), ([0.0, -1.9], False)):
        assert within(problem_of(plane), boxes, np.array([share]) * most).tolist() == [held]


# Steps.


def evaluated(residual, size, step):
    return newton._Evaluation(np.array([residual]), np.array([size]), np.array([step]))


def stepped(monkeypatch, step, sizes, zeta=(0.25, 0.125)):
    """Where a step leads from ζ with f = (0.1, −0.2), ‖f‖ = 1, κ = ½ and R = (1, ½); `sizes`: ‖f‖ at what is tried."""
    tried = []

    def evaluate(problem, boxes, delta, trial):
        tried.append(trial.copy())
        return evaluated(trial[0], sizes[len(tried) - 1], (0.0, 0.0))

    monkeypatch.setattr(newton, "_evaluate", evaluate)
    boxes, now = BOX._replace(kappa=np.array([0.5])), evaluated((0.1, -0.2), 1.0, step)
    trial, after = newton._step(problem_of(PLANE), boxes, np.zeros((1, 1)), np.array([zeta]), now)
    assert after.residual.tolist() == trial.tolist()
    assert after.size.tolist() == [sizes[len(tried) - 1]]
    return trial[0].tolist()


@pytest.mark.parametrize(
    ("step", "sizes", "taken"),
    [
        ((0.75, 0.375), (0.5,), True),  # to the tube's very end, and by κ
        ((-1.25, -0.625), (0.1,), True),
        ((0.76, 0.0), (0.1,), False),
        ((0.0, 0.376), (0.1,), False),
        ((0.0, -0.7), (0.1,), False),
        ((1.2, 0.0), (0.1,), False),
        ((0.5, 0.25), (0.51, 0.4), False),
        ((0.5, 0.25), (0.99, 0.4), False),
        ((0.5, 0.25), (np.nan, 0.4), False),
    ],
)
def test_a_newton_step_is_taken_within_the_tube_and_where_it_lowers_f_enough(monkeypatch, step, sizes, taken):
    """By κ at least; else it is K's, −f."""
    moved = step if taken else (-0.1, 0.2)
    assert stepped(monkeypatch, step, sizes) == [0.25 + moved[0], 0.125 + moved[1]]


def test_residuals_are_measured_in_the_boxs_weights():
    """The largest |f_i|/w_i, and the step that solves the equations."""
    boxes = BOX._replace(weight=np.array([[2.0, 0.25]]), modes=2.0 * BOX.modes, preconditioner=0.5 * BOX.preconditioner)
    found = newton._evaluate(problem_of(PLANE), boxes, np.zeros((1, 1)), np.array([[0.25, -0.5]]))
    np.testing.assert_allclose(found.residual, [[0.25, -0.5]], rtol=1e-15)
    np.testing.assert_allclose(found.size, [2.0], rtol=1e-15)
    np.testing.assert_allclose(found.step, [[-0.25, 0.5]], rtol=1e-15)


def test_errors_are_what_is_left_of_f_by_what_contracts(monkeypatch):
    """(‖f‖ + rounding)/(1 − κ) in the weights, when ‖f‖ is at most the worst row's rounding."""
    noise = np.array([[0.1, 0.05], [0.001, 0.0]])
    monkeypatch.setattr(newton, "noise_of", lambda equations, boxes: noise)
    boxes = boxes_about([[0.0, 0.15, 0.0], [0.0, 0.15, 0.0]], 0.25, [[1.0], [2.0]], 1.0, kappa=np.array([0.5, 0.75]))
    boxes = boxes._replace(weight=np.array([[1.0, 0.25], [1.0, 1.0]]))
    found = solve_in_boxes(problem_of(PLANE), boxes, np.zeros((2, 1)))
    size, margin = np.array([0.15, 0.0]), np.array([0.2, 0.001])
    stated = (SLACK * (size + margin) / (1.0 - boxes.kappa))[:, None] * boxes.weight
    np.testing.assert_allclose(found.error, stated, rtol=1e-12)
    np.testing.assert_allclose(found.zeta, [[0.0, 0.0], [-0.15, 0.0]], atol=1e-16)
    np.testing.assert_allclose(found.theta, [[0.0, 0.15, 0.0], [0.0, 0.0, 0.0]], atol=1e-16)


def test_solutions_are_found_from_wherever_the_box_begins():
    """sin(q + y) = 0 with a poor preconditioner."""
    equations = circles()
    boxes = boxes_about([[0.1, 0.0]], 0.05, [[-0.5]], 0.3, preconditioner=0.6)
    delta = np.array([[0.05]])
    assert check(equations, boxes).proved.all()
    found = solve_in_boxes(problem_of(equations), boxes, delta)
    assert abs(found.theta.sum()) <= found.error[0, 0] < 1e-10
    np.testing.assert_allclose(found.theta, predict(problem_of(equations), boxes, delta, found.zeta))


# Tubes in modes whose inverse is only nearly known.


def held(monkeypatch, inverse, modes, radius, gap=0.0, blurred=0.0, error=0.0, turned=None):
    """Whether balls lie in a tube whose modes have a computed inverse."""
    inverse, modes, radius = np.atleast_2d(inverse)[None], np.atleast_2d(modes)[None], np.atleast_1d(radius)[None]
    monkeypatch.setattr(newton, "inverses", lambda given: inverse)
    m = radius.shape[1]
    system = SimpleNamespace(dependent=np.arange(m), periodic=np.zeros(m, dtype=bool), m=m)
    gap, blurred, error = (np.broadcast_to(np.array(x, dtype=float), (1, m)) for x in (gap, blurred, error))
    tubes, ball = TubesAt(np.zeros((1, m)), radius, modes), SolutionBall(gap, error, turned)
    return bool(in_tubes(system, tubes, blurred, ball)[0])


@pytest.mark.parametrize("less", [1e-8, -1e-8])
def test_an_inverse_that_is_none_counts(monkeypatch, less):
    """|ζ| ≤ |Mx| + 2 |I − MV| |Mx|: with M = 0.8 for V = 1 a gap of 1 may be 0.8 + 0.32, the worst row telling."""
    fits = less > 0
    assert held(monkeypatch, 0.8, 1.0, 1.12 + less, gap=1.0) == fits
    assert held(monkeypatch, 0.5, 2.0, 0.5 + 0.05 + 0.25 + less, gap=-1.0, blurred=0.1, error=0.5) == fits
    worst = np.diag([1.0, 0.8]), np.eye(2)
    assert held(monkeypatch, *worst, np.array([1.4, 1.2]) + less, gap=1.0) == fits
    assert held(monkeypatch, *worst, np.array([1.4 + less, 9.0]), gap=1.0) == fits
    assert held(monkeypatch, *worst, np.array([9.0, 1.2 + less]), gap=1.0) == fits


@pytest.mark.parametrize(
    ("inverse", "enough"), [(0.54, True), (0.51, True), (0.49, False), (0.46, False), (0.2, False)]
)
def test_an_inverse_that_is_half_wrong_says_nothing(monkeypatch, inverse, enough):
    assert held(monkeypatch, inverse, 1.0, 1e9, gap=1.0) == enough


@pytest.mark.parametrize("less", [1e-6, -1e-6])
def test_products_that_cancel_leave_their_roundings(monkeypatch, less):
    """V = [1 K; 0 1] and a ball in the same modes: (m + 2) u 2K of it, once in MV′ and twice in I − MV."""
    K, u, size = 2.0**26, 2.0**-53, 1e3
    modes = np.array([[1.0, K], [0.0, 1.0]])
    inverse = np.array([[1.0, -K], [0.0, 1.0]])
    first = size * (1.0 + 4 * u * (2 * K + 1)) + 1e-13 * (1.0 + K)
    stated = first * (1.0 + 2.0 * 4 * u * (2 * K + 2)) * (1 + 1e-10) + less
    assert held(monkeypatch, inverse, modes, np.array([stated, 9e3]), error=size, turned=modes[None]) == (less > 0)


# Weights.


class Told:
    """Z as it is told: a matrix and a rest."""

    def __init__(self, matrix, rest=0.0):
        self.matrix, self.rest = np.array(matrix, dtype=float), rest

    def contraction(self, radius):
        return Contraction(self.matrix, lambda weight: self.rest * weight)


def test_weights_show_that_z_contracts():
    """Zw ≤ κw, and κ no larger than that asks by 2e-9."""
    matrices = [
        [[0.5, 0.25], [0.125, 0.5]],
        [[0.0, 8.0], [0.03, 0.0]],
        [[0.5, 0.0], [0.0, 0.9]],
        [[0.0, 0.0], [0.0, 0.0]],
    ]
    bounds = Told(matrices, 0.0625)
    weight, kappa = weights_for(bounds, np.ones((4, 2)))
    assert np.all(weight > 0.0)
    shrunk = np.max((np.einsum("bij,bj->bi", bounds.matrix, weight) + 0.0625 * weight) / weight, axis=1)
    assert np.all(kappa >= shrunk * SLACK)
    assert np.all(kappa <= shrunk * SLACK + 3e-9)
    assert np.all(kappa < 1.0)


def test_what_does_not_contract_has_no_weights():
    """A spectral radius of one or more, a row that grows, no number."""
    for matrix in (
        [[0.0, 1.0], [1.0, 0.0]],
        [[0.5, 0.0], [0.0, 2.0]],
        [[np.nan, 0.0], [0.0, 0.5]],
        [[1.0, 0.0], [0.0, 0.0]],
    ):
        with np.errstate(all="ignore"):
            assert not weights_for(Told([matrix]), np.ones((1, 2)))[1][0] < 1.0


def test_many_are_weighed_each_by_itself():
    """Those that are done are left as they are."""
    found = weights_for(Told([[[0.5]], [[3.0]], [[0.25]]]), np.ones((3, 1)))[1]
    np.testing.assert_allclose(found, [0.5, 3.0, 0.25], rtol=1e-8)


def test_boxes_are_taken_by_a_mask_or_by_numbers():
    boxes = boxes_about([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], 0.25, [[1.0], [2.0]], 0.1)
    assert boxes.take(np.array([False, True])).centre[:, 0].tolist() == [1.0]
    assert boxes.take(np.array([1, 0, 1])).centre[:, 0].tolist() == [1.0, 0.0, 1.0]
    assert boxes.take(np.array([True, True])) is boxes
    assert len(boxes.take(np.array([1, 1])).kappa) == 2
