"""Claims about what programs compute, where each number is attained: tubes of lines, and of y² = q."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from ccpin.proof.facts import NotProvedError, prove
from ccpin.validated.programs import rounding_claim
from ccpin.validated.programs.rounding_claim import ProgramComputed
from ccpin.validated.programs.steps_claim import StepsFindSigma
from tests.support.linear_tubes import UP, U, equations_of, near, tubes_of

pytest.importorskip("flint")
SINGLE = 2.0**-24
BOX = [1.0], [2.0]


def halves(steps, **more):
    """2y = q in four cells, middles off by 10⁻⁶; and a program of it."""
    equations = equations_of(lambda q, y: [y * 2 - q], 1, 1, steps, **more)
    return tubes_of(equations, BOX, [4], [[0.5]], 1e-3, off=1e-6, preconditioner=np.array([[0.5]]))


def computed(claim, start, bounds=(), number=0, weight=None):
    """What is found of its program."""
    branch, start = prove(claim), np.array(start)
    premises = [branch]
    if claim.equations.source.steps:
        premises.append(prove(StepsFindSigma(claim.equations, start if weight is None else np.array(weight)), branch))
    made = ProgramComputed(claim.equations, start, np.array(bounds, dtype=float), np.array([number]))
    return prove(made, *premises).found


def quotient(tape, q, y, v):
    """v/y, yv and y."""
    return [tape.solve(np.array([[y]]), np.array([[v]]))[0, 0], y * v, y]


def test_all_cells_are_within_what_is_found(monkeypatch):
    """The largest of y is in the last cell, the smallest pivot in the first; so it is, however many are looked at."""
    claim, w, b = halves(0, inner=quotient, others=1), 1e-3, 3.0
    low, high = 0.5 - w - 2e-6, 1.0 + w + 2e-6  # y: the middle, and the image about it, are off by 10⁻⁶ each
    found = computed(claim, [w], [b])
    code = claim.equations.made.code
    assert found["pivots"] == near([0.5 - w], 1e-5)
    assert found["size"][1] == near(high, 1e-9)
    assert found["size"][code.outputs[1]] == near(b * high, 1e-9)
    assert found["error"][1:] == pytest.approx([U * b * high, 0.0], rel=1e-6, abs=2e-290)
    assert found["range"][:, 2] == near([low + 2e-6, high], 1e-9)
    assert found["range"][:, 1] == near([-b * high, b * high], 1e-9)
    assert found["range"][:, 0] == near([-b / (0.5 - w), b / (0.5 - w)], 0.05)
    monkeypatch.setattr(rounding_claim, "_MEMORY", 1.0)
    again = computed(claim, [w], [b])
    for name, numbers in found.items():
        assert again[name].tolist() == numbers.tolist(), name


def test_ranges_are_wider_by_what_their_ends_round():
    """|2v| ≤ 2b: first order's spread is 2⁻⁴³ wider, its sum with the middle 2⁻⁴⁰ of the size."""
    found = computed(halves(0, inner=lambda tape, q, y, v: [v * 2], others=1), [1e-3], [3.0])
    assert found["range"][1, 0] / 6.0 - 1.0 == near(UP + 2.0**-43, 1e-2)
    assert found["range"][0, 0] / -6.0 - 1.0 == near(UP + 2.0**-43, 1e-2)


def test_errors_are_widened():
    """By 2⁻⁴⁰ once: a third times q loses |2/3|(d + u(1/3 + …)), a formula."""
    third = Fraction(1, 3)
    found = computed(halves(0, inner=lambda tape, q, y: [q * third]), [1e-3])
    off = abs(float(Fraction(1 / 3) - third))
    plain = 2.0 * (off + U * (1 / 3 + 2 * off))
    assert found["error"][0] / plain - 1.0 == near(2 * UP, 0.2)  # `error_sweeps` widens what is lost by as much


def test_inputs_have_axes_of_their_own():
    """v − v′ and v − q: no two inputs move together."""
    claim = halves(0, inner=lambda tape, q, y, v, w: [v - w, v - q * 2], others=2)
    found = computed(claim, [1e-3], [0.5, 0.25])
    assert found["range"] == near(np.array([[-0.75, -0.5 - 4.0], [0.75, 0.5 - 2.0]]), 1e-9)


def expanded(tape, q, y, v, w):
    """(a + 1)(b + 1) − ab − a − b − 1 of q with q, y and v, of v with v and w, and of y with v: all are 0."""
    pairs = (q, q), (q, y), (q, v), (v, v), (v, w), (y, v)
    return [(a + 1) * (b + 1) - a * b - a - b - 1 for a, b in pairs]


@pytest.mark.parametrize(("axes", "seen"), [(11, 5), (10, 2), (7, 2), (6, 0)])
def test_products_of_inputs_are_known(axes, seen, monkeypatch):
    """Of q with all and of what else is read with itself; else |d||d′| counts twice, once for each product.

    Of 1 + 1 + 2 inputs there are 7 products, 3 without q.
    """
    monkeypatch.setattr(rounding_claim, "_AXES", axes)
    found = computed(halves(0, inner=expanded, others=2), [1e-3], [0.5, 0.25])["range"][1]
    h, b, c, r = 0.125, 0.5, 0.25, 1e-3 + 1e-6  # y moves with q by h/2, and by r alone
    y = h / 2 + r
    apart = 2 * np.array([h * h, h * y, h * b, b * b, b * c, (r if seen == 5 else y) * b])
    known = {5: [1, 1, 1, 1, 1, 0], 2: [0, 0, 0, 1, 1, 0], 0: [0] * 6}[seen]
    assert found == pytest.approx(np.where(known, 0.0, apart), rel=1e-4, abs=1e-13)


def lost(weight, top):
    """In float: ρ₁ and ρ₂ of the two steps y − (2y − q)/2, of what their subtractions lose in a cell with σ ≤ top.

    |y − σ| ≤ w + 2·10⁻⁶ before the first, as the middles are off by 10⁻⁶ and the image is as much.
    """
    first = SINGLE * (weight + 2e-6 + top)
    return first, SINGLE * (first + 2e-6 + top)


def test_steps_lose_what_their_subtractions_do():
    """In float, from w = ¼: y at the end is off by ρ₂, it is in the tube of ρ₂ and the image, ρ₁ + ρ₂ + u moves it."""
    found = computed(halves(1), [0.25], number=1)
    first, second = lost(0.25, 1.0)
    assert found["error"] == near([2 * second], 1e-5)
    assert found["range"][1] / 2 - 1.0 == near(2e-6 + second, 1e-4)
    assert found["range"][0] / 2 - 0.5 == near(-lost(0.25, 0.625)[1], 1e-4)
    assert found["correction"] == near([first + second + SINGLE], 1e-5)


@pytest.mark.parametrize(("share", "proved"), [(1.001, True), (0.999, False)])
def test_computed_steps_stay_in_their_tube(share, proved):
    """A start so small that rounding in float alone leads out of it: w = ρ₁."""
    weight = share * SINGLE * (1.0 + 2e-6) / (1.0 - SINGLE)
    if proved:
        computed(halves(1), [weight], number=1)
        return
    with pytest.raises(NotProvedError, match="stay near"):
        computed(halves(1), [weight], number=1)


def pairs(number, start, weight):
    """2y = q and 2z = q, the first from as near as float can be."""
    equations = equations_of(lambda q, y, z: [y * 2 - q, z * 2 - q], 1, 2, 1)
    claim = tubes_of(equations, BOX, [4], [[0.5], [0.5]], 1e-3, preconditioner=0.5 * np.eye(2))
    return computed(claim, start, number=number, weight=weight)


def test_the_worst_number_says_whether_steps_stay():
    pairs(1, [1e-7, 0.25], [1e-7, 0.25])
    with pytest.raises(NotProvedError, match="stay near"):
        pairs(1, [0.5e-7, 0.25], [0.5e-7, 0.25])


@pytest.mark.parametrize("shares", [(1.0, 1.0), (0.5, 0.25)])
def test_the_farthest_number_says_how_near_steps_end(shares):
    """y² = q and z² = q: e₁ = ½Λe₀² and Λ(e₀ + ½e₁)e₁, of the share of its start that the farthest number has."""
    equations = equations_of(lambda q, y, z: [y * y - q, z * z - q], 1, 2, 1)
    middle = np.sqrt(1.125)
    C = np.diag([0.5 / middle] * 2)
    claim = tubes_of(equations, ([1.0], [1.25]), [1], [[C[0, 0]]] * 2, 0.02, preconditioner=C)
    claim = replace(claim, centre=np.full((1, 2), middle))
    weight = np.array([0.05, 0.05])
    found = computed(claim, weight * shares, weight=weight)
    known = prove(StepsFindSigma(equations, weight), prove(claim)).found["factor"][0]
    e0 = max(shares)
    e1 = 0.5 * known * e0**2
    assert found["error"] == near([2 * known * (e0 + 0.5 * e1) * e1 * 0.05], 1e-9)


def test_ends_of_steps_are_wherever_the_last_one_may_be():
    """The correction's length is of both numbers; of two whose errors differ the root of the sum of squares."""
    found = pairs(1, [0.25, 0.25], [0.25, 0.25])
    one = computed(halves(1), [0.25], number=1)
    assert found["correction"] == near(np.sqrt(2.0) * one["correction"], 1e-5)
