"""Searches that propose what is not so, and claims and certificates that were forged: none becomes a fact."""

from dataclasses import fields, replace

import numpy as np
import pytest

import ccpin
from ccpin import programs
from ccpin.programs.instructions import Kind
from ccpin.programs.program import Program
from ccpin.programs.program_sources import INPUTS
from ccpin.proof.facts import NotProvedError, Unproved, prove
from ccpin.validated import certify_program
from ccpin.validated.programs import certifying
from ccpin.validated.programs.branch_claim import BranchOverCells
from ccpin.validated.programs.program_equations import ProgramEquations
from ccpin.validated.programs.proposals import proposed_branch
from ccpin.validated.programs.rounding_claim import ProgramComputed
from ccpin.validated.programs.steps_claim import StepsFindSigma

pytest.importorskip("flint")
HALF, FORMAT = 0.1, np.zeros(1, dtype=np.int64)


@pytest.fixture(scope="module")
def program():
    """A slider crank's, with Newton steps."""
    return recorded("slider_crank")


def recorded(name, **more) -> Program:
    model = ccpin.ReducedModel(ccpin.load(name))
    return programs.record(model, ("sigma", "forward_dynamics"), **({"given": "near"} | more))


def region(program, half=HALF):
    n = len(program.source.independent)
    middle = np.array(program.example[:n])
    return middle - half, middle + half


@pytest.fixture(scope="module")
def proved(program):
    """The facts about it, and their claims."""
    found = certify_program(program, region(program), bounds={"v": 1.0, "u": 1.0}, formats=("double",), max_cells=16)
    assert found.verdict == "proven", found.reason
    return found


def branch_claim(program, cells=(8,)):
    return proposed_branch(ProgramEquations(program.source), *region(program), cells)


def jumping(claim):
    """Cells of the branch on which the crank is folded the other way, from the middle on."""
    other = recorded("slider_crank")
    x = np.array(other.example)
    rng, equations = np.random.default_rng(0), claim.equations
    for _ in range(200):
        samples = ((*x[:1].tolist(), *(x[1:3] + rng.uniform(-3, 3, 2)).tolist(), *x[3:].tolist()),)
        tried = ProgramEquations(equations.source._replace(samples=samples + equations.source.samples[1:]))
        with np.errstate(all="ignore"):
            found = proposed_branch(tried, claim.lower, claim.upper, claim.counts)
        far = np.abs(np.sin(found.centre - claim.centre)).max()
        if np.isfinite(found.centre).all() and far > 0.3 and np.abs(found.centre).max() < 6:
            break
    else:
        raise AssertionError("no other branch")
    parts = {}
    for name in ("centre", "slopes", "radius", "preconditioner"):
        parts[name] = np.concatenate([getattr(claim, name)[:4], getattr(found, name)[4:]])
    return replace(claim, **parts)


FALSE_BRANCHES = {
    "tubes too narrow": lambda c: replace(c, radius=1e-3 * c.radius),
    "tubes too wide": lambda c: replace(c, radius=2e4 * c.radius),
    "another middle": lambda c: replace(c, centre=c.centre + 0.05),
    "slopes of another sign": lambda c: replace(c, slopes=-c.slopes),
    "no preconditioner": lambda c: replace(c, preconditioner=np.zeros_like(c.preconditioner)),
    "a cell left out": lambda c: replace(
        c, **{name: getattr(c, name)[1:] for name in ("centre", "slopes", "radius", "preconditioner")}
    ),
    "other counts": lambda c: replace(c, counts=c.counts - 1),
    "a wider box": lambda c: replace(c, upper=c.upper + 0.2),
    "a box of no width": lambda c: replace(c, upper=c.lower),
    "cells in another order": lambda c: replace(c, centre=c.centre[::-1].copy()),
    "no numbers": lambda c: replace(c, centre=np.full_like(c.centre, np.nan)),
    "two branches": jumping,
}


@pytest.mark.parametrize("way", FALSE_BRANCHES)
def test_false_branches(program, way):
    claim = branch_claim(program)
    prove(claim)
    with pytest.raises(NotProvedError):
        prove(FALSE_BRANCHES[way](claim))


def test_cells_of_two_branches_are_each_proved_alone(program):
    """What is refused above is that they are one: over half the box each is a branch."""
    made = jumping(branch_claim(program))
    for part, ends in ((slice(4), (0.0, 0.5)), (slice(4, 8), (0.5, 1.0))):
        kept = {name: getattr(made, name)[part] for name in ("centre", "slopes", "radius", "preconditioner")}
        lower, upper = (made.lower + share * (made.upper - made.lower) for share in ends)
        prove(replace(made, lower=lower, upper=upper, counts=made.counts // 2, **kept))


def test_false_steps(program, proved):
    """A start from too far; steps of a program without any; a premise of another kind, or of another mechanism's."""
    equations, branch = proved.branch.claim.equations, proved.branch
    for start in (5.0, 1.0):
        with pytest.raises(NotProvedError):
            prove(StepsFindSigma(equations, np.full(2, start)), branch)
    with pytest.raises(NotProvedError):
        prove(StepsFindSigma(equations, np.full(2, 0.01)), proved.steps)
    with pytest.raises(NotProvedError):
        prove(StepsFindSigma(equations, np.full(2, 0.01)))
    closed = ProgramEquations(program.source._replace(steps=0))
    with pytest.raises(NotProvedError):
        prove(StepsFindSigma(closed, np.full(2, 0.01)), prove(replace(branch_claim(program), equations=closed)))
    with pytest.raises(NotProvedError):
        prove(StepsFindSigma(closed, np.full(2, 0.01)), branch)


def test_false_values(proved):
    """A start from farther than the steps', missing, exchanged and pickled premises, other bounds, no format."""
    claim, (branch, steps) = proved.computed[0].claim, proved.computed[0].premises
    again = prove(branch.claim)
    for changed, premises in (
        (replace(claim, start=1.01 * claim.start), (branch, steps)),
        (claim, (branch,)),
        (claim, (steps, branch)),
        (claim, (again, steps)),
        (claim, (branch, Unproved(steps.claim, (branch,)))),
        (claim, (branch, proved.computed[0])),
        (replace(claim, bounds=claim.bounds[:1]), (branch, steps)),
        (replace(claim, bounds=-claim.bounds), (branch, steps)),
        (replace(claim, bounds=np.full(2, 1e170)), (branch, steps)),
        (replace(claim, bounds=np.full(2, np.inf)), (branch, steps)),
        (replace(claim, format=np.array([2])), (branch, steps)),
        (replace(claim, format=np.array([0.0])), (branch, steps)),
    ):
        with pytest.raises(NotProvedError):
            prove(changed, *premises)


def test_values_are_refused_where_pivots_vanish():
    """A program that divides by sin q − ½ over a box in which this is 0, and overflows beyond it in float alone."""
    program = recorded("slider_crank", given="closed")
    equations = ProgramEquations(program.source)
    middle = np.array(program.example[:1])
    branch = prove(proposed_branch(equations, middle - HALF, middle + HALF, (8,)))
    start = np.full(2, 1e-6)
    prove(ProgramComputed(equations, start, np.array([1e15, 1.0]), FORMAT), branch)
    with pytest.raises(NotProvedError, match="too large"):
        prove(ProgramComputed(equations, start, np.array([1e19, 1.0]), FORMAT + 1), branch)
    with pytest.raises(NotProvedError, match=r"vanish|bounded"):
        prove(ProgramComputed(equations, np.full(2, 2.0), np.ones(2), FORMAT), branch)


def test_certificates_are_about_what_was_asked(proved, program):
    """Facts put into a certificate of another program, region, bounds or start leave it undecided."""
    closed = recorded("slider_crank", given="closed")
    fewer = recorded("slider_crank", steps=1)
    other = proved.program.pivots[0]._replace(scale=1e-3)
    for changed in (
        {"program": closed},
        {"program": fewer},
        {"program": replace(program, pivots=(other, *program.pivots[1:]))},
        {"program": replace(program, corrections=program.corrections[::-1])},
        {"lower": proved.lower - 1e-9},
        {"upper": proved.upper + 1e-9},
        {"bounds": 1.01 * proved.bounds},
        {"start": 1.01 * proved.start},
        {"branch": prove(proved.branch.claim)},
        {"steps": None},
        {"computed": ()},
        {"computed": (proved.branch,)},
        {"computed": (Unproved(proved.computed[0].claim, proved.computed[0].premises),)},
    ):
        assert replace(proved, **changed).verdict == "undecided", changed


def more(code):
    """Instructions, one of which reads q̇."""
    last = code.instructions[-1]._replace(kind=Kind.ADD, target=code.size, a=3, b=3, constant=None)
    return code._replace(instructions=(*code.instructions, last), size=code.size + 1)


def _halved(code):
    """The first instruction, whose target is a double."""
    return code.instructions[0]._replace(target=float(code.instructions[0].target))


def _nothing():
    """Sizes of what only laws and steps read."""
    return (0,) * (len(INPUTS) - 4)


FALSE_SOURCES = {
    "a place beyond x": lambda s: s._replace(independent=(3,)),
    "a place twice": lambda s: s._replace(independent=(0, 0)),
    "fewer equations": lambda s: s._replace(closure=s.closure._replace(outputs=s.closure.outputs[:1])),
    "an output that is not there": lambda s: s._replace(closure=s.closure._replace(outputs=(0, 10**6))),
    "equations that read more": lambda s: s._replace(closure=more(s.closure)),
    "equations that are an input": lambda s: s._replace(closure=s.closure._replace(outputs=(s.closure.outputs[0], 3))),
    "sizes of too few": lambda s: s._replace(sizes=s.sizes[:4]),
    "sizes of too many": lambda s: s._replace(sizes=(*s.sizes, 0, 0, 0)),
    "sizes of one more than there are": lambda s: s._replace(sizes=(*s.sizes, *_nothing(), 0)),
    "a list": lambda s: s._replace(closure=s.closure._replace(instructions=list(s.closure.instructions))),
    "a value twice": lambda s: s._replace(
        closure=s.closure._replace(instructions=(*s.closure.instructions, s.closure.instructions[0]))
    ),
    "ports exchanged": lambda s: s._replace(ports=(s.ports[1], s.ports[0], *s.ports[2:])),
    "a port of another size": lambda s: s._replace(ports=(*s.ports[:2], ("v", 2), *s.ports[3:])),
    "a port twice": lambda s: s._replace(ports=(*s.ports, s.ports[-1])),
    "a list of outputs": lambda s: s._replace(closure=s.closure._replace(outputs=list(s.closure.outputs))),
    "constants that are no inputs": lambda s: s._replace(sizes=(*s.sizes[:4], 1)),
    "corrections beside Newton's": lambda s: s._replace(checked=2),
    "corrections of no number": lambda s: s._replace(checked=2.0, steps=0),
    "corrections of some": lambda s: s._replace(checked=1, steps=0),
    "corrections of too few": lambda s: s._replace(
        checked=2, steps=0, inner=s.inner._replace(outputs=s.inner.outputs[:1])
    ),
    "a value beyond the last": lambda s: s._replace(
        steps=0, closure=s.closure._replace(size=max(item.target for item in s.closure.instructions))
    ),
    "a target of no number": lambda s: s._replace(
        closure=s.closure._replace(instructions=(_halved(s.closure), *s.closure.instructions[1:]))
    ),
    "steps of no number": lambda s: s._replace(steps=1.0),
    "fewer steps than none": lambda s: s._replace(steps=-1),
}


@pytest.mark.parametrize("way", FALSE_SOURCES)
def test_false_sources(program, way):
    with pytest.raises(NotProvedError):
        ProgramEquations(FALSE_SOURCES[way](program.source))


def test_what_is_wrong_with_a_source_is_said(program):
    """Places and ports that would do no harm elsewhere, or be noticed later."""
    source = program.source
    for changed, told in (
        (source._replace(independent=(False,)), "places that are none"),
        (source._replace(independent=(source.sizes[0],)), "a place twice"),
        (
            source._replace(
                ports=(*source.ports, source.ports[-1]),
                samples=tuple((*row, *row[-source.ports[-1][1] :]) for row in source.samples),
            ),
            "or twice",
        ),
    ):
        with pytest.raises(NotProvedError, match=told):
            ProgramEquations(changed)


def test_a_reference_may_be_an_input(program):
    """Sizes of what laws read of it stand after the others; here there is nothing to read."""
    source = program.source._replace(sizes=(*program.source.sizes, *_nothing()))
    assert ProgramEquations(source).sizes == ProgramEquations(program.source).sizes


def test_planted_searches(program, monkeypatch):
    """A search that proposes false tubes or jumps to another branch certifies nothing."""
    made = certifying.proposed_branch
    for false in ("tubes too narrow", "another middle", "slopes of another sign", "no preconditioner"):
        monkeypatch.setattr(certifying, "proposed_branch", lambda *a, false=false: FALSE_BRANCHES[false](made(*a)))
        found = certify_program(program, region(program), bounds={"v": 1.0, "u": 1.0}, max_cells=16)
        assert found.verdict == "undecided", false
        assert found.branch is None


def test_claims_are_of_classes_that_are_known(proved):
    """No subclass, and no other object, is taken for them."""

    class Mine(BranchOverCells):
        pass

    claim = proved.branch.claim
    with pytest.raises(NotProvedError, match="no claim"):
        prove(Mine(*(getattr(claim, each.name) for each in fields(claim))))
