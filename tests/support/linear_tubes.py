"""Equations whose tubes have formulas: lines above all, which need room for nothing but rounding."""

import numpy as np
import pytest

from ccpin.programs.program_sources import ProgramSource
from ccpin.programs.tape import Tape
from ccpin.validated.programs.branch_claim import BranchOverCells, cells_of
from ccpin.validated.programs.program_equations import ProgramEquations

U, UP = 2.0**-53, 2.0**-40  # a roundoff; what bounds are widened by


def near(value, share):
    """Numbers that differ from a value, however small it is, by as much of it at most."""
    return pytest.approx(value, rel=share, abs=0.0)


def equations_of(build, independent, dependent, steps=0, inner=None, others=0):
    """Equations of so many numbers q and y, and a program of them and so many of v: 2y alone, where nothing is told."""
    tape = Tape(independent + dependent + others)
    rows = build(*tape.inputs[: independent + dependent])
    results = [tape.inputs[independent + dependent - 1] * 2] if inner is None else inner(tape, *tape.inputs)
    samples = tuple((1.0 + 0.1 * k,) * (independent + dependent + others) for k in range(2))
    ports = (("q", independent), ("y", dependent), *([("v", others)] if others else []))
    sizes = (independent + dependent, others, 0, 0, 0)
    source = ProgramSource(tape.code(rows), tape.code(results), tuple(range(independent)), sizes, ports, steps, samples)
    return ProgramEquations(source)


def tubes_of(equations, box, counts, slopes, radius, off=0.0, preconditioner=None):
    """Tubes about S q, the middles off by as much, of as many cells."""
    lower, upper, counts = *(np.array(each, dtype=float) for each in box), np.array(counts, dtype=np.int64)
    q = cells_of(lower, upper, counts).centre
    S = np.broadcast_to(np.asarray(slopes, dtype=float), (len(q), *np.shape(slopes)[-2:])).copy()
    m = S.shape[1]
    C = np.eye(m) if preconditioner is None else preconditioner
    y = np.asarray(np.einsum("bij,bj->bi", S, q) + off)
    wide = np.broadcast_to(np.asarray(radius, dtype=float), (len(q), m)).copy()
    return BranchOverCells(equations, lower, upper, counts, y, S, wide, np.broadcast_to(C, (len(q), m, m)).copy())
