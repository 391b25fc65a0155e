"""Boxes of joint efforts over regions: bounds by formulas, attacked by closed forms, forged, searched for wrongly."""

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest

from ccpin.errors import InvalidInputError
from ccpin.programs.program_sources import ProgramSource
from ccpin.programs.tape import Tape
from ccpin.proof.facts import NotProvedError, prove
from ccpin.transmission import certify_effort_box, effort_box, effort_box_claim
from ccpin.transmission.effort_box_claim import EffortBoxHeld
from ccpin.validated.programs.branch_claim import BranchOverCells, cells_of
from ccpin.validated.programs.program_equations import ProgramEquations
from tests.support.linkage_models import FORMS, transmission_of

pytest.importorskip("flint")
REGIONS = {"ankle": ([-0.15, -0.1], [0.15, 0.1]), "knee": ([-0.5], [0.5]), "neck": ([-0.5, -0.4], [0.5, 0.4])}


# Claims of which every bound is a formula.


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


def test_efforts_of_several_joints_add_up():
    """Teeth: u = J⁻ᵀτ with a constant J, so that |u| is at most |J⁻ᵀ| b, and no more is asked for."""
    found = transmission_of("neck")
    made = certify_effort_box(found, REGIONS["neck"], [2.0, 1.0])
    used = made.held.found["used"][0]
    expected = np.abs(np.linalg.inv(FORMS["neck"].jacobian(None).T)) @ [2.0, 1.0]
    np.testing.assert_allclose(used, expected, rtol=1e-5)
    assert (used >= expected * (1 - 1e-12)).all()


# Forged claims.


def forged():
    """Claims that are false, or malformed, each a change of one that is proved."""
    return {
        "a larger box": {"box": lambda x: 1.01 * x},
        "no box": {"box": lambda x: 0.0 * x},
        "a negative box": {"box": lambda x: -x},
        "a box of no number": {"box": lambda x: np.nan * x},
        "weaker motors": {"room": lambda x: 0.99 * x},
        "motors that give nothing": {"room": lambda x: 0.0 * x},
        "a motor twice": {"motors": lambda x: x[[0, 0]]},
        "another number's place": {"motors": lambda x: np.array([x[0], x[1] + 1])},
        "a place that is none": {"motors": lambda x: x + 100},
        "a negative place": {"motors": lambda x: x - 100},
        "a joint for a motor": {"motors": lambda x: np.array([0, x[1]])},
        "no preconditioner": {"preconditioner": lambda x: 0.0 * x},
        "another preconditioner": {"preconditioner": lambda x: x[::-1]},
        "a smaller one": {"preconditioner": lambda x: x[:, :-1, :-1]},
        "too few": {"preconditioner": lambda x: x[:-1]},
        "no numbers": {"preconditioner": lambda x: np.nan * x},
        "huge ones": {"preconditioner": lambda x: 1e300 * x},
    }


@pytest.fixture(scope="module")
def held():
    return certify_effort_box(transmission_of("ankle"), REGIONS["ankle"], max_cells=256)


@pytest.mark.parametrize("name", forged())
def test_a_forged_claim_becomes_no_fact(held, name):
    claim, (branch,) = held.held.claim, held.held.premises
    change = {field: made(getattr(claim, field)) for field, made in forged()[name].items()}
    with pytest.raises(NotProvedError):
        prove(replace(claim, **change), branch)


def test_a_box_rests_on_its_branch(held):
    claim, (branch,) = held.held.claim, held.held.premises
    other = certify_effort_box(transmission_of("knee"), REGIONS["knee"], max_cells=64).held
    for premises in ((), (branch, branch), other.premises, (held.held,)):
        with pytest.raises(NotProvedError):
            prove(claim, *premises)
    assert held.held.replay().found["used"].max() == held.held.found["used"].max()


# The search, and what it answers.


@pytest.mark.parametrize("name", REGIONS)
@pytest.mark.parametrize("count", [200, pytest.param(250_000, marks=pytest.mark.slow)])
def test_no_posture_of_the_region_asks_more(name, count):
    """All corners of the box at random postures and at the region's corners, by the closed form: a million points."""
    region = REGIONS[name]
    made = certify_effort_box(transmission_of(name), region, max_cells=256)
    assert made.verdict == "proven", made.reason
    rng, form, n = np.random.default_rng(1), FORMS[name], len(made.box)
    corners = np.stack(np.meshgrid(*zip(*region, strict=True), indexing="ij"), axis=-1).reshape(-1, n)
    signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * n, indexing="ij"), axis=-1).reshape(-1, n)
    most = 0.0
    for q in [*corners, *rng.uniform(*region, (count, n))]:
        asked = np.abs(np.linalg.solve(form.jacobian(q).T, (signs * made.box).T))
        most = max(most, float((asked.max(axis=1) / made.room).max()))
    assert 0.9 < most <= 1.0  # nor is it far from what is so


def test_a_box_that_is_too_large_is_refuted_by_a_posture():
    found = transmission_of("knee")
    known = certify_effort_box(found, REGIONS["knee"])
    made = certify_effort_box(found, REGIONS["knee"], 1.5 * known.box, max_cells=16)
    assert made.verdict == "refuted"
    q = made.witness.q_joint
    asked = np.abs(np.linalg.solve(FORMS["knee"].jacobian(q).T, made.box))
    assert (asked > made.room).any()
    assert "asks too much" in repr(made)
    wide = certify_effort_box(found, REGIONS["knee"], 1.0001 * known.box, max_cells=4)
    assert wide.verdict == "undecided"
    assert "raise max_cells" in wide.reason


def test_what_was_pickled_or_altered_is_not_known(held):
    assert held.verdict == "proven"
    assert pickle.loads(pickle.dumps(held.held.claim)).box.tolist() == held.box.tolist()
    for change in ({"box": 1.1 * held.box}, {"lower": held.lower - 0.1}, {"room": 0.5 * held.room}, {"held": None}):
        assert replace(held, **change).verdict == "undecided"
    assert pickle.loads(pickle.dumps(held)).verdict == "undecided"


def test_matrices_that_are_wrong_cost_the_proof(monkeypatch):
    """Proposals are trusted by nobody."""
    right = effort_box._BoxSearch._matrices
    for spoil in (lambda x: np.zeros_like(x), lambda x: -x, lambda x: np.swapaxes(x, 1, 2), lambda x: 3.0 * x):
        monkeypatch.setattr(
            effort_box._BoxSearch, "_matrices", lambda self, branch, spoil=spoil: spoil(right(self, branch))
        )
        assert certify_effort_box(transmission_of("knee"), REGIONS["knee"], max_cells=32).verdict == "undecided"


def test_regions_and_boxes_that_are_none_are_refused():
    found = transmission_of("knee")
    for region, more in (
        (([0.1], [0.1]), {}),
        (None, {}),
        (([0.0], [0.1]), {"box": [0.0]}),
        (([0.0], [0.1]), {"shape": [-1.0]}),
        (([0.0], [0.1]), {"effort": 0.0}),
        (([0.0], [0.1]), {"max_cells": 0}),
    ):
        with pytest.raises(InvalidInputError):
            certify_effort_box(found, region, **more)
