"""The claim that motors hold a box of efforts, over equations of which every bound is a formula."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ccpin.programs.program_sources import ProgramSource
from ccpin.programs.tape import Tape
from ccpin.proof.facts import NotProvedError, prove
from ccpin.transmission import effort_box_claim
from ccpin.transmission.effort_box_claim import EffortBoxHeld
from ccpin.validated.programs.branch_claim import BranchOverCells, cells_of
from ccpin.validated.programs.program_equations import ProgramEquations

pytest.importorskip("flint")


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


def root():
    """y² = q with the motor at y: u = 2yτ, M = [0 −1; 1 2y], and only the entry 2(y − y_c) of I − P M is not 0."""
    branch = branch_of(
        source_of(lambda q, y: y * y - q, math.sqrt),
        1.0,
        1.25,
        math.sqrt,
        lambda q: 0.5 / math.sqrt(q),
        lambda y: 2 * y,
    )
    y = branch.claim.centre[0, 0]
    P = np.array([[[2 * y, 1.0], [-1.0, 0.0]]])
    most = 2 * (y + branch.claim.slopes[0, 0, 0] * 0.125 + branch.found["image"][0, 0])
    return EffortBoxHeld(branch.claim.equations, np.array([1]), np.array([3.0]), np.array([1e3]), P), branch, 3.0 * most


def square(half):
    """y = q² with the motor at y, q in 1 ± half: u = τ/2q at most b/2(1 − half), singular at 0."""
    branch = branch_of(
        source_of(lambda q, y: y - q * q, lambda q: q * q), 1 - half, 1 + half,
        lambda q: q * q, lambda q: 2 * q, lambda y: 1.0, radius=2.0,
    )  # fmt: skip
    P = 0.5 * np.array([[[1.0, 2.0], [-1.0, 0.0]]])
    return EffortBoxHeld(branch.claim.equations, np.array([1]), np.array([3.0]), np.array([1e6]), P), branch


def test_what_motors_give_is_what_the_formula_says():
    claim, branch, most = root()
    used = prove(claim, branch).found["used"][0, 0]
    assert most * (1 - 1e-12) < used < most * (1 + 1e-5)


@pytest.mark.parametrize("half", [0.5, 0.9, 0.99])
def test_towards_a_singular_posture_it_is_too(half):
    claim, branch = square(half)
    used = prove(claim, branch).found["used"][0, 0]
    most = 3.0 / (2 * (1 - half))
    assert most * (1 - 1e-9) < used < most * (1 + 1e-4)


def test_a_singular_posture_is_let_in_nowhere():
    claim, branch = square(1.0001)
    with pytest.raises(NotProvedError):
        prove(claim, branch)


@pytest.mark.parametrize(("share", "proved"), [(1.00001, True), (0.9999999, False)])
def test_motors_hold_from_what_they_need_on(share, proved):
    claim, branch, most = root()
    tried = replace(claim, room=np.array([most * share]))
    if proved:
        prove(tried, branch)
        return
    with pytest.raises(NotProvedError, match="hold the box"):
        prove(tried, branch)


def test_a_bound_that_is_too_small_is_not_taken(monkeypatch):
    """W just above, and just below, of what (1) asks for; 0 and no number are none."""
    claim, branch = square(0.5)

    def above(factor):
        def made(given, off):
            exact = np.linalg.solve(np.eye(2) - off, given + 1e-12 * given.max())
            return exact * factor

        return made

    monkeypatch.setattr(effort_box_claim, "_above", above(1.0 + 1e-9))
    prove(claim, branch)
    for factor in (1.0 - 1e-9, 0.0, -1.0, np.nan, np.inf):
        monkeypatch.setattr(effort_box_claim, "_above", above(factor))
        with pytest.raises(NotProvedError):
            prove(claim, branch)
    monkeypatch.setattr(effort_box_claim, "_above", lambda given, off: given * np.array([[1.0], [3.0]]))
    with pytest.raises(NotProvedError, match="regular"):
        prove(claim, branch)
