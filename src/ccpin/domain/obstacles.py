"""Where demands are proved to fail: a limit passed, motors that lose hold, too little dexterity, no way on.

Seen from a configuration of the branch, a straight line of q (or of task coordinates x) is followed by certified boxes
of the closures alone. At its end, enclosed in a point's box,

- a joint is beyond a limit by more than the enclosure is wide,
- or det ψ_q′ has the other sign than at the start, both proved to be nonzero: it vanishes in between,
- or 1/κ(J), bounded from above by Weyl's inequality, is less than what was asked for.

Where the line cannot be followed `refutation` looks for the singular configuration on it, or for a proof that there is
none at its end. What fails at a point of the line fails on every convex set that holds the line.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PPoly

from ccpin.arrays import Array
from ccpin.domain.boxes import Boxes, Demands, Problem, certify_boxes, closure_values
from ccpin.domain.demands import conditioning, reach, regular
from ccpin.domain.newton import encloses, solve_in_boxes
from ccpin.domain.refutation import empty_witness, singular_witness
from ccpin.domain.verdict import Witness
from ccpin.domain.walker import Walker
from ccpin.errors import SingularConfigurationError

_HALVINGS = 20


def demand_witness(problem: Problem, theta: Array, targets: Iterable[Array]) -> Witness | None:
    """The first of the straight lines from θ (n′,) to some q (n,) at whose end a demand is proved to fail."""
    demands = problem.demands
    plain = problem._replace(demands=None)
    for target in targets:
        walker = _walked(plain, theta, target)
        if walker is None:
            continue
        if walker.here < 1.0:
            found = empty_witness(plain, target[None]) or singular_witness(walker, [target])
        else:
            found = None if demands is None else _failing(plain, demands, walker)
        if found is not None:
            return found
    return None


def _walked(problem: Problem, theta: Array, target: Array) -> Walker | None:
    """A walker as far along the line as it goes, or ``None`` where the start cannot be enclosed."""
    q = theta[problem.system.independent]
    pieces = PPoly(np.stack([(target - q)[None], q[None]]), np.array([0.0, 1.0]))
    try:
        walker = Walker(problem, pieces, np.zeros(len(q)), theta)
    except SingularConfigurationError:
        return None
    walker.walk(1.0)
    return walker


class _Place(NamedTuple):
    """Where a walker was at a parameter, enclosed in a box of no width."""

    q: Array
    box: Boxes


def _failing(problem: Problem, demands: Demands, walker: Walker) -> Witness | None:
    """What is proved to fail where a walker ended."""
    first, last = _place(problem, walker, 0.0), _place(problem, walker, 1.0)
    if first is None or last is None:
        return None
    low, high = reach(problem, last.box)
    q_free, error = problem.system.chart.configuration(last.box.centre[0]), float(np.max(high - low))
    if np.any((low > demands.upper) | (high < demands.lower)):
        return Witness("limit", last.q, q_free, error)
    if not demands.driven.size:
        return None
    if conditioning(problem, demands, last.box)[1][0] < demands.dexterity:
        return Witness("dexterity", last.q, q_free, error)
    signs = [_sign(problem, demands, place) for place in (first, last)]
    return _between(problem, demands, walker, signs[0]) if signs[0] * signs[1] < 0.0 else None


def _between(problem: Problem, demands: Demands, walker: Walker, sign: float) -> Witness | None:
    """Where det ψ_q′ changes its sign, by halving; ``None`` where that is nowhere proved."""
    low, high, found = 0.0, 1.0, None
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        place = _place(problem, walker, middle)
        here = 0.0 if place is None else _sign(problem, demands, place)
        if place is None or here == 0.0:
            break
        low, high = (middle, high) if here == sign else (low, middle)
        found = place
    if found is None:
        return None
    line = walker.pieces(high) - walker.pieces(low)
    q_free = problem.system.chart.configuration(found.box.centre[0])
    return Witness("singular", found.q, q_free, float(np.abs(line).max()))


def _place(problem: Problem, walker: Walker, at: float) -> _Place | None:
    """A walker's place at a parameter, if it can be enclosed there."""
    k = int(np.clip(np.searchsorted(walker.times, at, side="right") - 1, 0, len(walker.times) - 2))
    boxes, start, end = walker.boxes.take(np.array([k])), walker.times[k], walker.times[k + 1]
    n = problem.system.n
    delta = np.zeros((1, 1 + n))
    delta[0, 0] = 2.0 * (at - start) / (end - start) - 1.0
    theta = solve_in_boxes(problem, boxes, delta).theta
    point = certify_boxes(problem, theta, np.zeros((1, n)), np.eye(n))
    ball = point.boxes.centre, point.boxes.radius, point.boxes.modes
    if not point.proved[0] or not encloses(problem, boxes, delta, *ball)[0]:
        return None
    return _Place(theta[0, problem.system.independent], point.boxes)


def _sign(problem: Problem, demands: Demands, place: _Place) -> float:
    """The sign of det ψ_q′, 0 where it is not proved to be nonsingular.

    The rows of φ alone: those in which no independent coordinate of the task space takes part.
    """
    if not regular(problem, demands, place.box)[0]:
        return 0.0
    system = problem.system
    rows = np.ones(system.m, dtype=np.bool_)
    for chain in system.chains:
        if np.isin(chain.joints, system.independent).any():
            rows &= ~np.any(chain.weights != 0.0, axis=1)
    others = np.setdiff1d(system.dependent, demands.driven)
    return float(np.linalg.slogdet(closure_values(problem, place.box.centre)[1][0][np.ix_(rows, others)])[0])
