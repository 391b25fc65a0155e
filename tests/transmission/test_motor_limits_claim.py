"""The claims that motors hold efforts or have speeds, over equations of which every bound is a formula."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ccpin.programs.program_sources import ProgramSource
from ccpin.programs.tape import Tape
from ccpin.proof.facts import NotProvedError, prove
from ccpin.transmission import motor_limits_claim
from ccpin.transmission.motor_limits_claim import EffortsHeld, SpeedsHeld
from ccpin.validated.programs.branch_claim import BranchOverCells, cells_of
from ccpin.validated.programs.program_equations import ProgramEquations

pytest.importorskip("flint")
BOX = np.array([False])


def source_of(equation, value):
    """φ(q, y) = 0 with y = value(q), and a program of y."""
    tape = Tape(2)
    q, y = tape.inputs
    closure, inner = tape.code([equation(q, y)]), tape.code([y * y])
    samples = tuple((1.0 + 0.1 * k, value(1.0 + 0.1 * k)) for k in range(4))
    return ProgramSource(closure, inner, (0,), (2, 0, 0, 0, 0), (("q", 1), ("y", 1)), 0, samples)


def branch_of(source, lower, upper, value, slope, by_y, radius=0.02):
    """The branch over one cell, and its equations."""
    equations, counts = ProgramEquations(source), np.array([1])
    (q,) = cells_of(np.array([lower]), np.array([upper]), counts).centre[0]
    return prove(
        BranchOverCells(
            equations, np.array([lower]), np.array([upper]), counts, np.array([[value(q)]]),
            np.array([[[slope(q)]]]), np.array([[radius]]), np.array([[[1.0 / by_y(value(q))]]]),
        )
    )  # fmt: skip


def claim_of(kind, branch, P, size=3.0, friction=(0.0, 0.0), room=1e6):
    """With the motor at y."""
    size, friction, room = np.array([[size]]), np.array(friction), np.array([room])
    return kind(branch.claim.equations, np.array([1]), size, BOX, friction, room, np.array([P]))


def root(kind, friction=(0.0, 0.0)):
    """y² = q: u = 2yτ, M⁻¹ = [2y 1; −1 0]; ẏ = q̇/2y, M⁻¹ = [1 0; 1/2y 1/2y]; and the ends of y in the tube.

    Of I − P M one entry is not 0, so that W has no room: the bounds are the values at an end.
    """
    branch = branch_of(
        source_of(lambda q, y: y * y - q, math.sqrt), 1.0, 1.25,
        math.sqrt, lambda q: 0.5 / math.sqrt(q), lambda y: 2 * y,
    )  # fmt: skip
    y = branch.claim.centre[0, 0]
    P = [[2 * y, 1.0], [-1.0, 0.0]] if kind is EffortsHeld else [[1.0, 0.0], [0.5 / y, 0.5 / y]]
    reach = branch.claim.slopes[0, 0, 0] * 0.125 + branch.found["image"][0, 0]
    return claim_of(kind, branch, P, friction=friction), branch, (y - reach, y + reach)


def square(half):
    """y = q² with the motor at y, q in 1 ± half: u = τ/2q at most b/2(1 − half), singular at 0."""
    branch = branch_of(
        source_of(lambda q, y: y - q * q, lambda q: q * q), 1 - half, 1 + half,
        lambda q: q * q, lambda q: 2 * q, lambda y: 1.0, radius=2.0,
    )  # fmt: skip
    return claim_of(EffortsHeld, branch, [[0.5, 1.0], [-0.5, 0.0]]), branch


def close_above(found, exact):
    return exact * (1 - 1e-12) < found < exact * (1 + 1e-5)


def test_what_motors_give_is_what_the_formula_says():
    claim, branch, (_, most) = root(EffortsHeld)
    found = prove(claim, branch).found
    assert close_above(found["asked"][0, 0], 3.0 * 2 * most)
    assert found["lost"].tolist() == [[0.0]]


def test_how_fast_they_are_is_what_the_formula_says():
    claim, branch, (least, _) = root(SpeedsHeld)
    assert close_above(prove(claim, branch).found["asked"][0, 0], 3.0 / (2 * least))


@pytest.mark.parametrize(("friction", "form"), [((0.5, 0.0), (1, 0)), ((0.0, 0.7), (0, 1)), ((0.5, 0.7), (1, 1))])
def test_friction_takes_what_the_formula_says(friction, form):
    """u = 2y(τ + f_q) + f_y: friction in the joint goes through the linkage, the motor's own is its level."""
    claim, branch, (_, most) = root(EffortsHeld, friction)
    found = prove(claim, branch).found
    lost = form[0] * friction[0] * 2 * most + form[1] * friction[1]
    assert close_above(found["lost"][0, 0], lost)
    assert close_above(found["asked"][0, 0], 3.0 * 2 * most)
    used = found["lost"][0, 0] + found["asked"][0, 0]
    prove(replace(claim, room=np.array([used * (1 + 1e-9)])), branch)
    with pytest.raises(NotProvedError, match="hold it"):
        prove(replace(claim, room=np.array([used * (1 - 1e-9)])), branch)


def test_speeds_know_of_no_friction():
    claim, branch, _ = root(SpeedsHeld)
    for friction in ([1e-3, 0.0], [0.0, 1e-3]):
        with pytest.raises(NotProvedError, match="friction"):
            prove(replace(claim, friction=np.array(friction)), branch)


@pytest.mark.parametrize("half", [0.5, 0.9, 0.99])
def test_towards_a_singular_posture_it_is_too(half):
    claim, branch = square(half)
    found = prove(claim, branch).found["asked"][0, 0]
    most = 3.0 / (2 * (1 - half))
    assert most * (1 - 1e-9) < found < most * (1 + 1e-4)


def test_a_singular_posture_is_let_in_nowhere():
    claim, branch = square(1.0001)
    with pytest.raises(NotProvedError):
        prove(claim, branch)


@pytest.mark.parametrize("kind", [EffortsHeld, SpeedsHeld])
@pytest.mark.parametrize(("share", "proved"), [(1.00001, True), (0.9999999, False)])
def test_motors_hold_from_what_they_need_on(kind, share, proved):
    claim, branch, (least, most) = root(kind)
    need = 3.0 * 2 * most if kind is EffortsHeld else 3.0 / (2 * least)
    tried = replace(claim, room=np.array([need * share]))
    if proved:
        prove(tried, branch)
        return
    with pytest.raises(NotProvedError, match="hold it"):
        prove(tried, branch)


@pytest.mark.parametrize("kind", [EffortsHeld, SpeedsHeld])
def test_the_motor_of_another_number_is_another(kind):
    """The joint is its own motor: u = τ and the rate is the joint's; a number that is none is refused."""
    claim, branch, _ = root(kind)
    P = np.array([np.eye(2)]) if kind is EffortsHeld else claim.preconditioner
    own = replace(claim, motors=np.array([0]), preconditioner=P)
    if kind is SpeedsHeld:
        assert close_above(prove(own, branch).found["asked"][0, 0], 3.0)
    for motor in (2, 100):
        with pytest.raises(NotProvedError, match="number that is none"):
            prove(replace(claim, motors=np.array([motor])), branch)


def test_a_bound_that_is_too_small_is_not_taken(monkeypatch):
    """W just above, and just below, of what (1) asks for; 0 and no number are none."""
    claim, branch = square(0.5)

    def above(factor):
        def made(given, off):
            exact = np.linalg.solve(np.eye(2) - off, given + 1e-12 * given.max())
            return exact * factor

        return made

    monkeypatch.setattr(motor_limits_claim, "_above", above(1.0 + 1e-9))
    prove(claim, branch)
    for factor in (1.0 - 1e-9, 0.0, -1.0, np.nan, np.inf):
        monkeypatch.setattr(motor_limits_claim, "_above", above(factor))
        with pytest.raises(NotProvedError):
            prove(claim, branch)
    monkeypatch.setattr(motor_limits_claim, "_above", lambda given, off: given * np.array([[1.0], [3.0]]))
    with pytest.raises(NotProvedError, match="regular"):
        prove(claim, branch)
