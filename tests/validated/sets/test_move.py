"""Moves that are proved to arrive, refuted, or undecided with a reason."""

from dataclasses import replace

import numpy as np
import pytest

import ccpin
from ccpin.control.stability.set_point.theorem3 import certify_law
from ccpin.errors import InvalidInputError
from tests.oracles import rpdr as oracle
from tests.support.loading import script

flint = pytest.importorskip("flint")

from ccpin.validated import certify_move, enclose  # noqa: E402
from tests.support.enclosures import FREE, accurately, paper_law  # noqa: E402
from tests.support.long_cases import later  # noqa: E402
from tests.support.paper import GOAL, START  # noqa: E402

pytestmark = pytest.mark.usefixtures("precise")
QUICK = {"order": 12, "tolerance": 1e-12, "pieces": 4, "precision": 64}
as_sharp_as = pytest.mark.parametrize("options", later(QUICK, {}), ids=["quick", "sharp"])


@pytest.fixture(scope="module")
def enclosure(rpdr_model, law):
    return enclose(rpdr_model, law, START, None, 0.1)


@as_sharp_as
def test_the_papers_move_is_certified(rpdr_model, law, options):
    """From 𝒱 = 13.1 J the move is proven to reach 𝒱 < 2.9 J on q_d's branch; an integrator agrees with T and 𝒱."""
    move = certify_move(rpdr_model, law, START, arrival=2.9, **options)
    assert move.verdict == "proven"
    assert not move.rigorous  # a plain number
    assert "caller's part" in move.reason
    assert move.lyapunov_start == pytest.approx(law.lyapunov(START, np.zeros(2)), abs=1e-9)
    sample = accurately(rpdr_model, law, START, None, move.time)
    assert move.lyapunov == pytest.approx(law.lyapunov(sample.q[-1], sample.v[-1], sample.q_free[-1]), abs=1e-8)
    assert move.lyapunov < 2.9 < move.lyapunov_start
    assert move.enclosure.smallest_determinant > 0.05


@as_sharp_as
def test_moves_that_are_not_proven_say_why(rpdr_model, law, options):
    """Too little time, and a state on the other assembly mode, however large the level: not covered."""
    early = certify_move(rpdr_model, law, START, arrival=2.9, duration=0.05, **options)
    assert early.verdict == "undecided"
    assert "not proven to arrive" in early.reason
    other = oracle.sigma(GOAL, -1.0)[FREE]
    wrong = certify_move(rpdr_model, law, GOAL, arrival=1e3, duration=0.002, near=other, **options)
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
def test_bad_arrivals(rpdr_model, law, enclosure):
    """A level that is not positive, a certificate of another law and a time not covered are refused."""
    with pytest.raises(InvalidInputError, match="positive"):
        certify_move(rpdr_model, law, START, arrival=0.0)

    class Known:
        level, rigorous, law = 1.0, True, paper_law(rpdr_model)

    with pytest.raises(InvalidInputError, match="set-point certificate"):
        certify_move(rpdr_model, law, START, arrival=Known())
    other = certify_law(paper_law(rpdr_model, [12.0, 12.0]), max_depth=4, budget=12)
    with pytest.raises(InvalidInputError, match="control laws"):
        certify_move(rpdr_model, law, START, arrival=other)
    for level in (0.0, np.inf):
        with pytest.raises(InvalidInputError, match="positive"):
            certify_move(rpdr_model, law, START, arrival=replace(other, law=law, level=level))
    with pytest.raises(InvalidInputError, match="simple gravity"):
        certify_move(rpdr_model, None, START, arrival=1.0)
    with pytest.raises(InvalidInputError, match="not covered"):
        enclosure.box(1.0)


@pytest.mark.slow
def test_script(capsys):
    """scripts/certified_move.py covers the move and prints what it took."""
    assert script("certified_move").main(2.9)
    said = capsys.readouterr().out
    assert "rigorous: True" in said
    assert said.count(": proven, T = 0.1") == 2
