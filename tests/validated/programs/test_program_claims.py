"""Claims about y² = q, of which every bound is a formula: tubes, gluing, Newton's steps, what programs compute."""

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from ccpin.programs.program_sources import ProgramSource
from ccpin.programs.tape import Tape
from ccpin.proof.facts import NotProvedError, prove
from ccpin.validated.programs.branch_claim import BranchOverCells, cells_of
from ccpin.validated.programs.program_equations import ProgramEquations
from ccpin.validated.programs.rounding_claim import ProgramComputed
from ccpin.validated.programs.steps_claim import StepsFindSigma

pytest.importorskip("flint")
U = 2.0**-53


def root_source(steps=0):
    """σ(q) = √q, and a program of y v and 1/y."""
    tape = Tape(3)
    q, y, v = tape.inputs
    closure = tape.code([y * y - q])
    inner = tape.code([y, y * v, tape.reciprocal(y)])
    samples = tuple((1.0 + 0.1 * k, math.sqrt(1.0 + 0.1 * k), 0.5) for k in range(4))
    return ProgramSource(closure, inner, (0,), (2, 1, 0, 0, 0), (("q", 1), ("y", 1), ("v", 1)), steps, samples)


def claim(lower=1.0, upper=1.25, cells=1, radius=0.02, steps=0):
    """Tubes about √q, middles exact but for rounding."""
    counts = np.array([cells])
    q = cells_of(np.array([lower]), np.array([upper]), counts).centre
    y = np.sqrt(q)
    return BranchOverCells(
        ProgramEquations(root_source(steps)), np.array([lower]), np.array([upper]), counts,
        y, (0.5 / y)[:, :, None], np.full_like(y, radius), (0.5 / y)[:, :, None],
    )  # fmt: skip


def tube_of(made):
    """By the formulas: f, Z on the tube, K and the image, of the first cell."""
    C = made.preconditioner[0, 0, 0]
    h = (made.upper - made.lower)[0] / made.counts[0] / 2
    S, R = made.slopes[0, 0, 0], made.radius[0, 0]
    f, Z = C * (S * h) ** 2, 2 * C * (S * h + R)
    return f, Z, f + Z * R, f + Z * (f + Z * R)


def test_cells_cover_a_box_and_are_hardly_wider():
    found = cells_of(np.array([1.0, -2.0]), np.array([1.7, 3.0]), np.array([2, 5]))
    assert found.centre.shape == (10, 2)
    assert found.centre[:5, 0] == pytest.approx(1.175)
    assert found.centre[:5, 1] == pytest.approx(np.arange(-1.5, 3.0))
    assert found.edges[0][[0, -1]].tolist() == [1.0, 1.7]
    assert found.edges[0] == pytest.approx([1.0, 1.35, 1.7], rel=1e-15)
    assert found.half[0] == pytest.approx([0.175, 0.5], rel=1e-9)
    for axis in (0, 1):
        for cell in range(10):
            k = cell // 5 if axis == 0 else cell % 5
            ends = [Fraction(found.edges[axis][k + side]) for side in (0, 1)]
            middle, half = Fraction(found.centre[cell, axis]), Fraction(found.half[cell, axis])
            room = half - max(ends[1] - middle, middle - ends[0])
            assert room >= 4 * Fraction(U) * abs(middle)
            assert room <= Fraction(2) ** -39 * half + 16 * Fraction(U) * 3


def test_cells_of_no_width_are_none():
    with pytest.raises(NotProvedError, match="no width"):
        cells_of(np.array([1.0]), np.array([1.0 + 2.0**-50]), np.array([64]))


def test_a_tube_is_what_its_formulas_say():
    made = claim()
    _, _, K, image = tube_of(made)
    found = prove(made).found["image"][0, 0]
    assert K < 0.02
    assert found == pytest.approx(image, rel=1e-8)
    assert found > image * (1 - 1e-12)
    for q in np.linspace(1.0, 1.25, 7):
        away = abs(math.sqrt(q) - made.centre[0, 0] - made.slopes[0, 0, 0] * (q - 1.125))
        assert away <= found


@pytest.mark.parametrize(("share", "proved"), [(1.000001, True), (0.999999, False)])
def test_tubes_hold_from_where_they_are_proved_on(share, proved):
    """R is as small as f + ZR allows: R with f + ZR = R by the quadratic."""
    made = claim()
    C, Sh = made.preconditioner[0, 0, 0], made.slopes[0, 0, 0] * 0.125
    least = min(np.roots([2 * C, 2 * C * Sh - 1, C * Sh**2]).real)
    tried = replace(made, radius=np.full((1, 1), least * share))
    if proved:
        prove(tried)
        return
    with pytest.raises(NotProvedError, match="without a solution"):
        prove(tried)


@pytest.mark.parametrize(("share", "proved"), [(1.0001, True), (0.9999, False)])
def test_cells_are_joined_from_where_they_are_proved_to_be(share, proved):
    """Between two cells: the lines' distance at the face, and the first's image, against the second's radius."""
    made = claim(cells=2)
    image = tube_of(made)[3]
    ends = [y[0] + S[0, 0] * (1.125 - q) for y, S, q in zip(made.centre, made.slopes, (1.0625, 1.1875), strict=True)]
    least = abs(ends[0] - ends[1]) + image
    off = 3e-4  # so that the tubes must be wider than each by itself
    moved = made.centre + np.array([[0.0], [off]])
    needed = abs(ends[0] - ends[1] - off) + image
    assert needed > least
    tried = replace(made, centre=moved, radius=np.array([[0.02], [needed * share]]))
    if proved:
        prove(tried)
        return
    with pytest.raises(NotProvedError, match="same branch"):
        prove(tried)


def test_the_other_root_is_not_joined():
    made = claim(cells=2)
    sign = np.array([1.0, -1.0])[:, None]
    other = replace(
        made, centre=sign * made.centre, slopes=sign[:, :, None] * made.slopes,
        preconditioner=sign[:, :, None] * made.preconditioner,
    )  # fmt: skip
    with pytest.raises(NotProvedError, match="same branch"):
        prove(other)


@pytest.mark.parametrize("steps", [1, 2])
@pytest.mark.parametrize("start", [0.05, 0.2])
def test_steps_are_what_their_formulas_say(steps, start):
    made = claim(steps=steps)
    branch = prove(made)
    C, Sh, K = made.preconditioner[0, 0, 0], made.slopes[0, 0, 0] * 0.125, branch.found["image"][0, 0]
    factor = 2 * C * start / (1 - 2 * C * (Sh + K + start))
    errors = [1.0]
    for _ in range(steps):
        errors.append(0.5 * factor * errors[-1] ** 2)
    errors.append(factor * (errors[-2] + 0.5 * errors[-1]) * errors[-1])
    found = prove(StepsFindSigma(made.equations, np.array([start])), branch).found
    assert found["errors"][0] == pytest.approx(errors, rel=1e-7)
    assert (found["errors"][0] >= np.array(errors) * (1 - 1e-12)).all()
    assert found["factor"][0] == pytest.approx(factor, rel=1e-7)
    for y in (math.sqrt(1.2) - start, math.sqrt(1.2) + start):
        near = y
        for error in errors[1 : steps + 1]:
            last, near = near, near - (near * near - 1.2) / (2 * near)
            assert abs(near - math.sqrt(1.2)) <= error * start + 1e-15
        near -= (near * near - 1.2) / (2 * last)
        assert abs(near - math.sqrt(1.2)) <= errors[-1] * start + 1e-15


def test_steps_from_too_far_are_refused():
    """δ ≥ 0.999; a first step that is not proved to come nearer; a last one that leaves."""
    made = claim(steps=1)
    branch = prove(made)
    C, Sh, K = made.preconditioner[0, 0, 0], made.slopes[0, 0, 0] * 0.125, branch.found["image"][0, 0]
    room = 1 / (2 * C) - Sh - K

    def of(factor):
        """The start with Λ = 2Cw/(1 − 2C(Sh + K + w))."""
        return room * factor / (1 + factor)

    for start, word in (
        (room - 0.0009 / (2 * C), "invertible"),
        (room - 0.0011 / (2 * C), "nearer"),
        (of(2.0001), "nearer"),
        (of(1.9999), "stay near"),
        (of(1.2362), "stay near"),
    ):
        with pytest.raises(NotProvedError, match=word):
            prove(StepsFindSigma(made.equations, np.array([start])), branch)
    prove(StepsFindSigma(made.equations, np.array([of(1.2359)])), branch)  # ½Λ²(1 + ¼Λ) = 1 at 1.23607


def test_weights_scale_steps():
    """Two equations: each y by its own weight, and a coupling between them."""
    tape = Tape(4)
    q, y, z, v = tape.inputs
    closure, inner = tape.code([y * y - q, z - y * z * Fraction(1, 10) - q]), tape.code([z * v])
    ys = [(1.0 + 0.1 * k, math.sqrt(1.0 + 0.1 * k)) for k in range(4)]
    samples = tuple((a, b, a / (1 - b / 10), 0.5) for a, b in ys)
    source = ProgramSource(closure, inner, (0,), (3, 1, 0, 0, 0), (("q", 1), ("y", 2), ("v", 1)), 1, samples)
    equations = ProgramEquations(source)
    a, b = 1.01, math.sqrt(1.01)
    z = a / (1 - b / 10)
    jacobian = np.array([[2 * b, 0.0], [-z / 10, 1 - b / 10]])
    inverse = np.linalg.inv(jacobian)
    one = BranchOverCells(
        equations, np.array([1.0]), np.array([1.02]), np.array([1]), np.array([[b, z]]),
        (inverse @ [[1.0], [1.0]])[None], np.full((1, 2), 1e-3), inverse[None],
    )  # fmt: skip
    branch = prove(one)
    weight = np.array([0.02, 0.05])
    found = prove(StepsFindSigma(equations, weight), branch).found["factor"][0]
    bend = np.abs(inverse) @ np.array([[2 * 0.02, 0.0], [0.1 * 0.05, 0.1 * 0.02]])
    plain = np.array([[2 * 0.02, 0.0], [-0.1 * 0.05, -0.1 * 0.02]])
    assert (np.abs(inverse @ plain) <= bend + 1e-15).all()
    lam = ((np.abs(inverse[:, :1]) * 2 * 0.02 @ [[1.0, 0.0]] + _second(inverse, weight)) @ weight / weight).max()
    wide = np.abs(one.slopes[0, :, 0]) * 0.01 + branch.found["image"][0] + weight
    change = np.array([[2 * wide[0], 0.0], [0.1 * wide[1], 0.1 * wide[0]]])
    delta = ((np.abs(inverse) @ change) @ weight / weight).max()
    assert lam * (1 - 1e-9) <= found <= 1.02 * lam / (1 - delta)


def _second(inverse, weight):
    """|C| of the second equation's bend, by entry."""
    return np.abs(inverse[:, 1:]) @ np.array([[0.1 * weight[1], 0.1 * weight[0]]])


def computed(start=1e-3, bound=2.0, number=0):
    """What is found of y, y v and 1/y."""
    branch = prove(claim())
    claimed = ProgramComputed(branch.claim.equations, np.array([start]), np.array([bound]), np.array([number]))
    return branch, prove(claimed, branch).found


@pytest.mark.parametrize(("number", "unit"), [(0, 2.0**-53), (1, 2.0**-24)])
def test_small_programs_lose_what_their_formulas_say(number, unit):
    branch, found = computed(number=number)
    y, far = branch.claim.centre[0, 0], branch.claim.slopes[0, 0, 0] * 0.125 + branch.found["image"][0, 0] + 1e-3
    bend = far**2 / y**2 / (y - far)
    size = 1 / y + far / y**2 + bend
    assert found["error"] == pytest.approx([0.0, unit * 2 * (y + far), unit * size], rel=1e-6, abs=2e-290)
    assert (found["error"][1:] >= unit * np.array([2 * (y + far), 1 / (y - far)]) * (1 - 1e-12)).all()
    lower, upper = found["range"]
    assert lower == pytest.approx([y - far, -2 * (y + far), 1 / y - far / y**2 - bend], rel=1e-6)
    assert upper == pytest.approx([y + far, 2 * (y + far), size], rel=1e-6)
    assert lower[0] <= y - far
    assert upper[0] >= y + far
    assert found["size"][:3] == pytest.approx([1.25, y + far, 2.0], rel=1e-9)
    assert found["correction"].tolist() == [0.0]
    assert found["pivots"].shape == (0,)


def test_values_too_large_are_refused():
    computed(bound=2.0**118, number=1)
    for bound, number in ((2.0**120, 1), (2.0**1000, 0)):
        with pytest.raises(NotProvedError, match="too large"):
            computed(bound=bound, number=number)


@pytest.mark.parametrize("steps", [1, 2])
def test_computed_steps_are_what_their_formulas_say(steps):
    """Rounding in float is felt, truth is √q: |ŷ − σ| ≤ its bound, which is Theorem K's and what a last step loses."""
    made = claim(steps=steps)
    branch = prove(made)
    start = np.array([0.05])
    known = prove(StepsFindSigma(made.equations, start), branch)
    for number, unit in ((0, 2.0**-53), (1, 2.0**-24)):
        values = ProgramComputed(made.equations, start, np.array([2.0]), np.array([number]))
        found = prove(values, branch, known).found
        exact = known.found["errors"][0, -1] * 0.05
        assert found["error"][0] >= exact
        assert found["error"][0] <= (exact + 6 * unit) * 1.5
        assert found["error"][1] >= 2 * found["error"][0]
        assert found["error"][1] <= 2.001 * found["error"][0] + 3 * unit
        last = known.found["errors"][0, -2] * 0.05
        assert last <= found["correction"][0] <= (last + exact + 8 * unit) * 1.5
        assert 2 * 0.9 <= found["pivots"][0] <= 2 * (1.0 - 0.04)
        half = prove(replace(values, start=0.5 * start), branch, known).found
        assert half["error"][0] < 0.8 * found["error"][0] or number == 1
