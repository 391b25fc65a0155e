"""What certificates say of facts about y² = p q: of which facts, which statuses, rounded to which side."""

import math
from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.programs.certified_region import CertifiedRegion
from ccpin.programs.lowering import Pivot
from ccpin.programs.program import Port, Program
from ccpin.programs.program_sources import ProgramSource
from ccpin.programs.tape import Tape
from ccpin.proof.facts import NotProvedError, prove
from ccpin.validated.programs.branch_claim import BranchOverCells
from ccpin.validated.programs.program_certificate import ProgramCertificate, _bits, _down, _up
from ccpin.validated.programs.program_equations import ProgramEquations
from ccpin.validated.programs.rounding_claim import ProgramComputed
from ccpin.validated.programs.steps_claim import StepsFindSigma

pytest.importorskip("flint")
PORTS = (("q", 1), ("y", 1), ("v", 1), ("p", 1), ("h", 1))


def root_of_a_product(steps=0, checked=0):
    """σ(q, p) = √(p q), and a program of y v h; where asked with a correction of y after it."""
    tape = Tape(5)
    q, y, v, p, h = tape.inputs
    closure = tape.code([y * y - p * q])
    inner = tape.code([y * v * h, *([(y * y - p * q) * tape.reciprocal(y)] if checked else [])])
    samples = tuple((1.0 + 0.1 * k, math.sqrt(1.0 + 0.1 * k), 0.5, 1.0, 0.1) for k in range(4))
    return ProgramSource(closure, inner, (0,), (2, 1, 0, 0, 1, 1), PORTS, steps, samples, checked)


def facts(steps=0, checked=0, formats=(0, 1), bounds=(1.0, 2.0), start=1e-3):
    """A certificate of it over 1 ≤ q ≤ 1.02, 1 ≤ p ≤ 1.01: σ within 0.01 of a plane."""
    equations = ProgramEquations(root_of_a_product(steps, checked))
    lower, upper = np.array([1.0, 1.0]), np.array([1.02, 1.01])
    y = math.sqrt(1.01 * 1.005)
    branch = prove(
        BranchOverCells(
            equations, lower, upper, np.array([1, 1]), np.array([[y]]),
            np.array([[[0.5 * 1.005 / y, 0.5 * 1.01 / y]]]), np.array([[0.01]]), np.array([[[0.5 / y]]]),
        )
    )  # fmt: skip
    start, bounds = np.array([start]), np.array(bounds)
    stepped = prove(StepsFindSigma(equations, start), branch) if steps else None
    premises = (branch,) if stepped is None else (branch, stepped)
    computed = tuple(prove(ProgramComputed(equations, start, bounds, np.array([k])), *premises) for k in formats)
    made = equations.made
    program = Program(
        "root", tuple(Port(name, (size,), "1", ("0",)) for name, size in PORTS), (Port("f", (1,), "1", ("0",)),),
        made.code, made.pivots, made.corrections, 1e-6 if made.corrections else 0.0, source=equations.source,
    )  # fmt: skip
    return ProgramCertificate(program, lower, upper, bounds, branch, stepped, computed, start=start)


@pytest.fixture(scope="module")
def plain():
    return facts()


@pytest.fixture(scope="module")
def stepping():
    return facts(steps=2)


def test_the_three_are_proven(plain, stepping):
    for certificate in (plain, stepping, facts(checked=1)):
        assert certificate.verdict == "proven"
        lower, upper = certificate.ranges()["f"]
        assert (lower[0], upper[0]) == pytest.approx((-2.02, 2.02), rel=0.01)


def test_sigma_is_one_of_both(plain):
    """Its slope along p is not asked of q; the ends of both are the region's, in the program's order."""
    equations = plain.branch.claim.equations
    assert equations.places == (0, 3)
    assert equations.sizes == {"Q": 2, "Y": 1, "W": 2, "P": 0}
    assert equations.arranged("qp", "y", "vh") == [*"qyvph"]
    assert equations.apart("qyvph") == ([*"qp"], ["y"], [*"vh"])
    region = plain.guarded().region
    y = math.sqrt(1.01 * 1.005)
    assert region.lower == pytest.approx((1.0, y - 0.0085, -1.0, 1.0, -2.0), abs=2e-4)
    assert region.upper == pytest.approx((1.02, y + 0.0085, 1.0, 1.01, 2.0), abs=2e-4)
    assert region.formats == ("double", "float")
    assert "p in the box [1.0, 1.01]" in plain.statement()
    tape = Tape(5)
    false = plain.program.source._replace(closure=tape.code([tape.inputs[1] - tape.inputs[4]]))
    with pytest.raises(NotProvedError, match="more than x and p"):
        ProgramEquations(false)


def test_corrections_of_a_step_are_bounded():
    """(y² − p q)/y, of which 0 is the value on the branch: 2(start + K) and what first order leaves."""
    certificate = facts(checked=1)
    found = certificate.computed[0].found["correction"][0]
    assert 2e-3 < found < 3e-3
    assert certificate._possible("double") == [0, 2]
    assert "status is 0 or 2" in certificate.statement()
    assert facts().computed[0].found["correction"][0] == 0.0


def told(pivots, correction, scales=(1.0,), corrections=(1,), format="double"):
    """The statuses of a certificate with such facts."""
    fact = SimpleNamespace(found={"pivots": np.array(pivots), "correction": np.array([correction])})
    program = SimpleNamespace(
        pivots=tuple(Pivot(0, scale) for scale in scales), corrections=corrections, tolerance=1e-6
    )
    return ProgramCertificate._possible(SimpleNamespace(_fact=lambda name: fact, program=program), format)


def test_which_statuses_are_possible():
    """A pivot is to be above twice what is refused, and its square a number; a correction below 0.9 of it."""
    assert told([2.05e-6], 0.0) == [0]
    assert told([1.95e-6], 0.0) == [0, 1]
    assert told([1.95e-6, 1.0], 0.0, (1.0, 1.0)) == [0, 1]
    assert told([2.05e-6], 0.0, (-1.0,)) == [0]
    assert told([1.95e-6], 0.0, (-1.0,)) == [0, 1]
    assert told([1.0], 0.0, (math.nan,)) == [0, 1]
    for format, least in (("double", 2.0**-1022), ("float", 2.0**-126)):
        assert told([2.05 * math.sqrt(least)], 0.0, (0.0,), format=format) == [0]
        assert told([1.95 * math.sqrt(least)], 0.0, (0.0,), format=format) == [0, 1]
    assert told([1.0], 0.895e-6) == [0]
    assert told([1.0], 0.905e-6) == [0, 2]
    assert told([1.0], 9.0, corrections=()) == [0]
    assert told([0.0], 9.0) == [0, 1, 2]


def test_facts_of_others_are_none(plain, stepping):
    """Of another program, ports, region, bounds, start, branch or steps, fewer, mixed, with a region."""
    again = prove(stepping.branch.claim)
    shorter = facts(bounds=(1.0, 1.0))
    inputs = plain.program.inputs
    region = CertifiedRegion((0.0,) * 5, (9.0,) * 5, ("double",), "")
    swapped = (*inputs[:2], inputs[4], inputs[3], inputs[2])
    for made in (
        replace(plain, branch=None),
        replace(plain, computed=()),
        replace(plain, computed=(plain.computed[0], shorter.computed[1])),
        replace(plain, computed=(plain.branch,)),
        replace(plain, computed=(plain.computed[0], None)),
        replace(plain, lower=plain.lower - 1e-9),
        replace(plain, upper=plain.upper + 1e-9),
        replace(plain, bounds=plain.bounds * 1.01),
        replace(plain, start=plain.start * 1.01),
        replace(plain, program=replace(plain.program, inputs=swapped)),
        replace(plain, program=replace(plain.program, region=region)),
        replace(plain, program=replace(plain.program, code=plain.program.code._replace(outputs=(0,)))),
        replace(plain, program=stepping.program),
        replace(plain, branch=stepping.branch),
        replace(plain, branch=stepping.branch, program=stepping.program),
        replace(stepping, branch=plain.branch, program=plain.program),
        replace(stepping, steps=None),
        replace(stepping, steps=prove(stepping.steps.claim, stepping.branch)),
        replace(stepping, branch=again),
        replace(stepping, computed=plain.computed),
    ):
        assert made.verdict == "undecided"
        assert made.statement().startswith("undecided")
    assert replace(plain, computed=plain.computed[:1]).verdict == "proven"


def test_numbers_are_rounded_to_their_side():
    """To two digits, by a billionth before: what is nearer to a number is not trusted to be below it."""
    for value in np.geomspace(1e-12, 1e12, 400).tolist():
        up, down = Fraction(_up(value)), Fraction(_down(value))
        assert down <= Fraction(value) <= up
        assert up - down <= Fraction(value) / 4
    assert (_up(1.2 * (1 - 0.95e-9)), _up(1.2 * (1 - 1.05e-9))) == ("1.3", "1.2")
    assert (_down(1.2 * (1 + 0.95e-9)), _down(1.2 * (1 + 1.05e-9))) == ("1.1", "1.2")
    assert (_up(0.0), _down(0.0), _down(math.inf)) == ("0", "0", "inf")


def test_bits_before_the_point():
    assert [_bits(size) for size in (0.0, 0.3, 0.99, 1.0, 1.99, 2.0, 5.0, 8.0, 1023.0)] == [0, 0, 0, 1, 1, 2, 3, 4, 10]
