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

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PPoly

from ccpin.arrays import Array
from ccpin.covering.proposals.krawczyk import certify_boxes, certify_points
from ccpin.domain.closures.system import Reading
from ccpin.domain.paths.refutation import empty_witness, singular_witness
from ccpin.domain.paths.walker import Walker
from ccpin.errors import SingularConfigurationError
from ccpin.proof.equations import Problem, Requirements, closure_values
from ccpin.proof.newton import Boxes, encloses, solve_in_boxes
from ccpin.proof.requirements import conditioning, reach, regular
from ccpin.proof.verdict import Kind, Witness

_BACK = (12, 6)  # strides before the end of a walk
_STUCK = 3  # lines on which a singular configuration is looked for: a search takes seconds
_HALVINGS = 12  # of the last stride
_SHARES = (0.3, 0.45, 0.65, 1.0)  # of a line: a demand that fails early spares the way to a singularity


def demand_witnesses(reading: Reading, theta: Array, targets: Iterable[Array]) -> Iterator[Witness]:
    """Where demands are proved to fail on straight lines from θ (n′,) to some q (n,), one place a line where found."""
    asked, stuck = reading.problem.requirements, 0
    reading = reading._replace(problem=reading.problem._replace(requirements=None))
    q = theta[reading.system.independent]
    for target in targets:
        for share in _SHARES:
            end = q + share * (target - q)
            walker = _walked(reading.problem, theta, end)
            if walker is None or len(walker.times) < 2:
                break
            found = None if asked is None else _failing(reading, asked, walker)
            if found is None and walker.here < 1.0:
                found = empty_witness(reading.problem, end[None])
                if found is None and stuck < _STUCK:
                    found, stuck = _singular(walker, reading, end), stuck + 1
            if found is not None:
                yield found
            if found is not None or walker.here < 1.0:
                break


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


def _singular(walker: Walker, reading: Reading, target: Array) -> Witness | None:
    """A singular configuration on the rest of a line, seen from some steps before a walker's end."""
    for steps in _BACK:
        if steps < len(walker.times):
            found = singular_witness(walker.back(steps), reading, [target])
            if found is not None:
                return found
    return None


class _PointBox(NamedTuple):
    """Where a walker was at a parameter, enclosed in a box of no width."""

    q: Array
    box: Boxes


def _failing(reading: Reading, asked: Requirements, walker: Walker) -> Witness | None:
    """The first place found on a walker's way at which a demand is proved to fail, if one fails at its end."""
    problem = reading.problem
    start = _place(problem, walker, 0.0)
    sign = 0.0 if start is None or not asked.driven.size else _sign(reading, asked, start)
    low, high = 0.0, walker.times[-1 if walker.here == 1.0 else max(1, len(walker.times) - 1 - _BACK[0])]
    last = _place(problem, walker, high)
    kind = None if last is None else _failure(reading, asked, last, sign)
    if last is None or kind is None:
        return None
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        place = _place(problem, walker, middle)
        here = None if place is None else _failure(reading, asked, place, sign)
        if here is None or place is None:
            low = middle
        else:
            high, last, kind = middle, place, here
    bottom, top = reach(problem, last.box)
    error = float(np.max(top - bottom))
    if kind == "singular":  # between the last place where the sign is proved to be the start's, and this one
        before = _place(problem, walker, low)
        kept = before is not None and sign * _sign(reading, asked, before) > 0.0
        error += float(np.abs(last.q - walker.pieces(low if kept else 0.0)).max())
    return Witness(kind, last.q, reading.configuration(last.box.centre[0]), error)


def _failure(reading: Reading, asked: Requirements, place: _PointBox, sign: float) -> Kind | None:
    """What is proved to fail at a place, det ψ_q′ having had a sign (0: unknown) at the start."""
    low, high = reach(reading.problem, place.box)
    if np.any((low > asked.upper) | (high < asked.lower)):
        return "limit"
    if not asked.driven.size:
        return None
    if conditioning(reading.problem, asked, place.box)[1][0] < asked.dexterity:
        return "dexterity"
    return "singular" if sign * _sign(reading, asked, place) < 0.0 else None


def _place(problem: Problem, walker: Walker, at: float) -> _PointBox | None:
    """A walker's place at a parameter, if it can be enclosed there."""
    k = int(np.clip(np.searchsorted(walker.times, at, side="right") - 1, 0, len(walker.times) - 2))
    boxes, start, end = walker.boxes.take(np.array([k])), walker.times[k], walker.times[k + 1]
    n = problem.system.n
    delta = np.zeros((1, 1 + n))
    delta[0, 0] = 2.0 * (at - start) / (end - start) - 1.0
    theta = solve_in_boxes(problem, boxes, delta).theta
    still = certify_boxes(problem, theta, np.zeros((1, n)), np.eye(n))
    point = certify_points(problem, theta)
    ball = point.boxes.centre, point.boxes.radius, point.boxes.modes
    in_both = encloses(problem, boxes, delta, *ball) & encloses(problem, still.boxes, np.zeros((1, n)), *ball)
    if not (still.proved & point.proved & in_both)[0]:
        return None
    return _PointBox(theta[0, problem.system.independent], still.boxes)


def _sign(reading: Reading, asked: Requirements, place: _PointBox) -> float:
    """The sign of det ψ_q′, 0 where it is not proved to be nonsingular.

    Of φ's rows alone, without those that hold a carriage: no coordinate of a carriage takes part in them.
    """
    if not regular(reading.problem, asked, place.box)[0]:
        return 0.0
    system = reading.system
    joints = system.n_free - sum(rod.place.stop - rod.place.start for rod in reading.rods)
    carriage = system.independent if joints > reading.chart.n_free else np.empty(0, dtype=np.intp)
    rows = np.ones(system.m, dtype=np.bool_)
    for chain in system.chains:
        if np.isin(chain.joints, carriage).any():
            rows &= ~np.any(chain.weights != 0.0, axis=1)
    others = np.setdiff1d(np.arange(system.n_free), np.union1d(asked.driven, carriage))
    return float(np.linalg.slogdet(closure_values(reading.problem, place.box.centre)[1][0][np.ix_(rows, others)])[0])
