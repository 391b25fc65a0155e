"""How far all motions of the paper's robot from a box of starts are enclosed, and the cost, beside Codac's.

The box is |q − q₀| ≤ r, |q̇| ≤ r about the paper's start. Codac gets the closed loop as a differential equation with
the dependent angles among the states, its own settings, and slices of 0.2 ms (with 1 ms it loses all sooner).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import ccpin
from benchmarks.measured import Measured, Options
from benchmarks.peers import NotForThisError, codac
from benchmarks.timing import timed
from ccpin.validated import enclose_set
from tests.oracles import rpdr as oracle
from tests.support.paper import GOAL, K_P, K_V, START, to_paper

PART, WHO, PEER = "enclosures", "ccpin", "Codac, CtcLohner"
UNTIL, COST = "time enclosed", "CPU time"
RADII = (0.0, 1e-5, np.radians(0.5))
STEP, SHORT, LONG, OURS = 2e-4, 0.002, 0.03, 0.1  # s: the peer's step; a quick look, the peer's motion, ours
EXACT = 1e-9  # what an exact start is for the sets of starts


def measure(options: Options) -> Iterator[Measured]:
    """Both, from each box."""
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    law = ccpin.control.PDSimpleGravity(model, GOAL, K_P, K_V)
    for radius in RADII if options.deep else RADII[:1]:
        subject = f"rpdr, starts within {radius:.3g}"
        duration = OURS if options.deep else SHORT
        spread = (max(radius, EXACT), max(radius, EXACT))
        found, seconds = timed(lambda s=spread, d=duration: enclose_set(model, law, START, None, d, spread=s))
        reached = min(tube.duration for tube in found.tubes)
        yield Measured(PART, subject, UNTIL, WHO, reached, note=found.verdict)
        yield Measured(PART, subject, COST, WHO, seconds)
        yield from _peer(model, subject, radius, LONG if options.deep else SHORT)


def _peer(model: ccpin.ReducedModel, subject: str, radius: float, duration: float) -> Iterator[Measured]:
    q = to_paper(model.mechanism, model.sigma(START))
    start = np.concatenate([q[:2], q[:2] + q[2:], np.zeros(2)])
    far = np.abs(oracle.rho(q)[:2] + oracle.rho(q)[2:]).sum(axis=1)  # to first order: in the peer's favour
    spread = radius * np.concatenate([np.ones(2), far, np.ones(2)])
    try:
        law = codac.Law(K_P, K_V, GOAL, model.at(GOAL).g)
        found = codac.enclosed(law, start, spread, duration, STEP)
    except NotForThisError as reason:
        yield Measured(PART, subject, UNTIL, PEER, None, note=str(reason))
        return
    yield Measured(PART, subject, UNTIL, PEER, found.until, note=f"of {duration:g} s tried")
    yield Measured(PART, subject, COST, PEER, found.cost)
