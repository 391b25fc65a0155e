"""Claims about branches and steps where each number is attained: lines, of which tubes need room for rounding alone."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from ccpin.proof.facts import NotProvedError, prove
from ccpin.validated.programs.branch_claim import CELLS, cells_of, tubes
from ccpin.validated.programs.steps_claim import StepsFindSigma
from tests.support.linear_tubes import UP, U, equations_of, near, tubes_of

pytest.importorskip("flint")


def test_cells_are_wider_by_what_their_middles_and_edges_round():
    """By a 2⁻⁴⁰th of themselves, where they are wide; by 4u(|a| + |b|), where they are narrow."""
    wide = cells_of(np.array([0.0]), np.array([1.0]), np.array([1]))
    assert wide.half[0, 0] - 0.5 == near(0.5 * UP + 4 * U, 1e-3)
    ends = 1.0, 1.0 + 2.0**-30 + 2.0**-52  # the middle is rounded: one side is longer
    narrow = cells_of(*(np.array([each]) for each in ends), np.array([1]))
    middle = Fraction(narrow.centre[0, 0])
    sides = middle - Fraction(ends[0]), Fraction(ends[1]) - middle
    assert sides[0] != sides[1]
    room = Fraction(narrow.half[0, 0]) - max(sides)
    assert float(room) == near(4 * U * sum(ends), 1e-5)


def test_tubes_are_functions_of_axes_of_their_own():
    """q = q_c + hξ; y = y_c + S h ξ + R ξ′, each y with an axis of its own, and 2u|S|h for the rounding of S h."""
    equations = equations_of(lambda q, p, y, z: [y - q, z - p], 2, 2)
    S, R = np.array([[3.0, -5.0], [0.25, 7.0]]), np.array([0.125, 0.5])
    made = tubes_of(equations, ([0.5, 1.0], [1.5, 4.0]), [1, 1], S, R)
    cells = cells_of(made.lower, made.upper, made.counts)
    h = cells.half[0]
    q, y = tubes(made, cells, slice(None), made.radius, 1)
    assert [each.slopes[0].tolist() for each in q] == [[h[0], 0, 0, 0, 0], [0, h[1], 0, 0, 0]]
    for k in range(2):
        assert y[k].slopes[0].tolist() == [*(S[k] * h), *np.eye(2)[k] * R, 0.0]
        assert y[k].rad[0] == near(2 * U * np.abs(S[k]) @ h, 1e-6)
        assert (y[k].mid[0], q[k].mid[0], q[k].rad[0]) == (made.centre[0, k], cells.centre[0, k], 0.0)


def test_many_cells_are_all_looked_at():
    """More than are evaluated at a time: the last ones as the first; one of the last that is false is refused."""
    equations = equations_of(lambda q, y: [y * y - q], 1, 1, steps=1)
    count = CELLS + 44
    made = tubes_of(equations, ([1.0], [2.0]), [count], [[0.5]], 1e-3)
    q = cells_of(made.lower, made.upper, made.counts).centre
    y = np.sqrt(q)
    made = replace(made, centre=y, slopes=(0.5 / y)[..., None], preconditioner=(0.5 / y)[..., None])
    branch = prove(made)
    C, h, R = 0.5 / y, 0.5 / count, 1e-3
    Z = 2 * C * (C * h + R)
    f = C * (C * h) ** 2
    assert branch.found["image"] == near(f + Z * (f + Z * R), 1e-6)
    steps = prove(StepsFindSigma(equations, np.array([0.01])), branch)
    assert steps.found["factor"].shape == (count,)
    assert (np.diff(steps.found["factor"]) < 0.0).all()
    false = made.centre.copy()
    false[-1] += 2e-3
    with pytest.raises(NotProvedError, match="without a solution"):
        prove(replace(made, centre=false))


@pytest.mark.parametrize(("share", "proved"), [(1 + 1e-6, True), (1 - 1e-6, False)])
def test_joints_leave_room_for_rounding(share, proved):
    """Lines y = 3q: what two cells need at their face is 8(n + 4)u of both cells' sizes, and the first's rounding."""
    equations = equations_of(lambda q, y: [y - q * 3], 1, 1)
    made = tubes_of(equations, ([0.5], [1.5]), [2], [[3.0]], 1e-12)
    image = prove(made).found["image"][0, 0]
    sizes = sum(abs(3.0 * c) + 3.0 * (1.0 + abs(c) + 0.25) for c in (0.75, 1.25))
    needed = 8 * 5 * U * sizes + image
    assert needed > 3 * image
    tried = replace(made, radius=np.array([[1e-12], [needed * share]]))
    if proved:
        prove(tried)
        return
    with pytest.raises(NotProvedError, match="same branch"):
        prove(tried)


@pytest.mark.parametrize(("share", "proved"), [(1 + 1e-6, True), (1 - 1e-6, False)])
def test_joints_leave_room_for_slopes_that_differ(share, proved):
    """Planes y = 3q + 2p, of two cells along q of which the second has another slope along p, and both are off."""
    equations = equations_of(lambda q, p, y: [y - q * 3 - p * 2], 2, 1)
    slopes = np.array([[[3.0, 2.0]], [[3.0, 2.0625]]])
    middle = np.array([[-0.5, 0.0], [0.5, 0.0]])
    off, other, p = 1e-3, 2e-3, 0.5
    made = tubes_of(equations, ([-1.0, -p], [1.0, p]), [2, 1], slopes, 0.1)
    made = replace(made, centre=np.einsum("bij,bj->bi", slopes, middle) + np.array([[-off], [other]]))
    needed = (off + other) + 0.0625 * p + off  # apart at the face's middle, turned along it, the first's own
    assert needed > other + 0.0625 * p  # what the second cell by itself needs
    tried = replace(made, radius=np.array([[0.1], [needed * share]]))
    if proved:
        prove(tried)
        return
    with pytest.raises(NotProvedError, match="same branch"):
        prove(tried)


def test_steps_are_widened_by_what_they_round():
    """e₁ = ½Λ(1 + 2⁻⁴⁰), and Λ = λ/(1 − δ) by 2⁻³⁰, which 1/(1 − δ) may need."""
    equations = equations_of(lambda q, y: [y * y - q], 1, 1, steps=1)
    made = tubes_of(equations, ([1.0], [1.25]), [1], [[0.5]], 0.02)
    y = np.sqrt(np.array([[1.125]]))
    C = 0.5 / y[0, 0]
    made = replace(made, centre=y, slopes=np.full((1, 1, 1), C), preconditioner=np.full((1, 1, 1), C))
    branch, start = prove(made), 0.05
    found = prove(StepsFindSigma(equations, np.array([start])), branch).found
    factor, errors = found["factor"][0], found["errors"][0]
    assert errors[1] / (0.5 * factor) - 1.0 == near(UP, 1e-2)
    assert errors[2] / (factor * (1.0 + 0.5 * errors[1]) * errors[1]) - 1.0 == near(UP, 1e-2)
    delta = 2 * C * (C * 0.125 + branch.found["image"][0, 0] + start)
    assert factor / (2 * C * start / (1.0 - delta)) - 1.0 == near(2.0**-30, 0.05)


def test_bends_along_every_direction_are_bounded():
    """|Cφ_yy η| for all η: two numbers of η that work against each other when they are equal."""
    equations = equations_of(lambda q, y, z: [y * y + z - q * 2, y * z - q * q], 1, 2, steps=1)
    inverse = np.linalg.inv(np.array([[2.0, 1.0], [1.0, 1.0]]))  # φ_y at y = z = 1: [[1, −1], [−1, 2]]
    slopes = inverse @ np.array([[2.0], [2.0]])
    made = tubes_of(equations, ([1.0 - 1e-6], [1.0 + 1e-6]), [1], slopes, 1e-6, preconditioner=inverse)
    made = replace(made, centre=np.ones((1, 2)))
    weight = np.array([0.01, 0.02])
    branch = prove(made)
    found = prove(StepsFindSigma(equations, weight), branch).found["factor"][0]
    # φ_yy η = [[2η₁, 0], [η₂, η₁]]
    bend = np.array(
        [
            [2 * abs(inverse[k, 0]) * weight[0] + abs(inverse[k, 1]) * weight[1], abs(inverse[k, 1]) * weight[0]]
            for k in range(2)
        ]
    )
    change = weight + branch.found["image"][0] + np.abs(slopes[:, 0]) * 1e-6
    turned = np.array(
        [
            [2 * abs(inverse[k, 0]) * change[0] + abs(inverse[k, 1]) * change[1], abs(inverse[k, 1]) * change[0]]
            for k in range(2)
        ]
    )
    lam, delta = ((table @ weight / weight).max() for table in (bend, turned))
    assert found == near(lam / (1.0 - delta), 1e-5)
