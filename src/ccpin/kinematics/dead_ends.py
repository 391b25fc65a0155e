"""Where the way of σ ends: a singular configuration on the lift of a straight line, seen from before it and gone up to.

Let d be what is left of the way up to it, and Y = ψ_q′⁻¹ B (`Parametrization.turn_between`). At a fold, where the lift
turns back, q′ = q′* + b √d + O(d) and 1/|Y|² is proportional to d (1 + O(√d)). At a crossing, where q′ goes on but
det ψ_q′ changes its sign, q′ is smooth and 1/|Y| proportional to d (1 + O(d)). What such a law calls g is a straight
line into zero; next to what is passed by it bends away (near an isolated singular point 1/|Y| ~ √(d² + ε²)).

Where three points of the walk lie on a line, q′ is followed up to the end in leaps that leave a 4th to a 64th of d,
begun by the law and closed by Newton's method. After each det ψ_q′ must have its sign, Y its direction, and g must have
followed its line, which then says anew where it ends. So down to the walk's shortest step, or to where rounding
decides. If q lies beyond, or before it by less than half that step (no step that is trusted ends there), the walk would
find the same with a hundred steps. Otherwise nothing is said and the walk goes on from where it was: what it answers
depends on none of this.
"""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.kinematics.linear import Factor, factorize
from ccpin.kinematics.points import moved

if TYPE_CHECKING:
    from ccpin.kinematics.parametrization import ClosedPoint, Parametrization

SHORTEST_STEP = 2.0**-30  # of the way: where no longer one is trusted, it is blocked
SINGULAR_WITHIN = 1e-6  # rad or m: a q that is blocked so near is called singular
_LINE = 0.1  # of the slope of g: it may change by less over three points,
_FOLLOWED = 0.5  # of what is left: a leap may find as much more or less,
_SURE = 0.03  # and the last one this
_SAME_DIRECTION = 0.9  # of the cosine between Y before and after a leap
_RESOLVED = 1e-2  # |Y|² times the tolerance of closed points: rounding's share of g
_MOST_LEAPS = 32
_MOST_SETTLING = 10  # steps of Newton's a leap


class _Law(Enum):
    FOLD = 2
    CROSSING = 1

    def g(self, square: float) -> float:
        """What is straight, of |Y|²."""
        return 1.0 / square if self is _Law.FOLD else 1.0 / float(np.sqrt(square))

    def reach(self, left: float, goal: float) -> float:
        """How much of the way leads, along the tangent, from where `left` is left to where `goal` is."""
        return 2.0 * (left - float(np.sqrt(left * goal))) if self is _Law.FOLD else left - goal


class _Prospect(NamedTuple):
    """An end seen ahead: what is left of the way up to it, and where it is."""

    law: _Law
    left: float
    end: float


class _Stand(NamedTuple):
    """A closed configuration with ψ_q′ factorised and Y."""

    q_free: Array
    factor: Factor
    probe: Array


class DeadEnds:
    """What watches one walk along the straight line from q_start to q.

    Args:
        parametrization: Whose walk.
        q_start: α of its start.
        q: Where it leads.
    """

    def __init__(self, parametrization: Parametrization, q_start: Array, q: Array) -> None:
        self._of = parametrization
        self._q_start, self._line = q_start, parametrization.coordinates.difference(q_start, q)
        self._last = list[tuple[float, float]]()
        self._next = np.inf  # not looked for where more is left than this

    def __call__(self, here: ClosedPoint, done: float) -> tuple[Array, float] | None:
        """q′ next to the singular configuration at which the way ends, and how much of it leads there, if that is seen.

        Args:
            here: Where the walk has come to.
            done: How much of the way that is.
        """
        self._last = [*self._last[-2:], (done, _square(here.probe))]
        sight = self._sight()
        if sight is None:
            return None
        self._next = sight.left / 16.0  # where nothing comes of it
        return self._gone_up_to(_Stand(here.q_free, here.factor, here.probe), done, *sight)

    def _sight(self) -> _Prospect | None:
        """The end that the last three points lie on a line into, if it is not clearly behind q."""
        if len(self._last) < 3:
            return None
        bent, seen = _LINE, None
        done = np.array([place for place, _ in self._last])
        for law in _Law:
            g = np.array([law.g(square) for _, square in self._last])
            before, slope = (np.diff(g) / np.diff(done)).tolist()
            if before < 0.0 and slope < 0.0 and abs(slope / before - 1.0) < bent:
                bent, left = abs(slope / before - 1.0), -float(g[2]) / slope
                seen = _Prospect(law, left, float(done[2]) + left)
        if seen is None or seen.left >= self._next or seen.end > 1.0 + 0.25 * seen.left:
            return None
        return seen if done[2] - done[0] >= 0.25 * seen.left else None

    def _gone_up_to(self, at: _Stand, place: float, law: _Law, left: float, end: float) -> tuple[Array, float] | None:
        """The same, in leaps from a closed configuration."""
        parametrization, tolerance, doubt = self._of, self._of.rules.tolerance, _LINE * left
        g, resolved = law.g(_square(at.probe)), law.g(2.0 * _RESOLVED / tolerance)
        rate = np.concatenate([np.zeros(parametrization.constraints.size), self._line])
        for _ in range(_MOST_LEAPS):
            wanted = min(max(4.0 * doubt, left / 64.0), left / 4.0)
            goal = max(4.0 * SHORTEST_STEP, wanted, left * resolved / g)
            if not goal < left:
                return None
            ahead = end - goal
            begun = moved(parametrization.model, at.q_free, law.reach(left, goal) * at.factor.solve(rate))
            found = self._settled(begun, ahead, at)
            if found is None:
                return None
            square = _square(found.probe)
            now = law.g(square)
            left = -now * (ahead - place) / (now - g) if now < g else np.inf
            if not abs(left - goal) <= _FOLLOWED * goal:
                return None
            doubt, end, place, g, at = abs(left - goal), ahead + left, ahead, now, found
            if not end - 2.0 * doubt <= 1.0 + 0.5 * SHORTEST_STEP:
                return None
            if goal <= 8.0 * SHORTEST_STEP or tolerance * square >= _RESOLVED:
                sure = doubt <= _SURE * goal and end + 2.0 * doubt <= 1.0 + 0.5 * SHORTEST_STEP and place < 1.0
                return (at.q_free, place) if sure and self._told(place, end + 2.0 * doubt, goal) else None
        return None

    def _told(self, place: float, end: float, left: float) -> bool:
        """Whether the walk calls q by the same name, singular or out of reach, wherever before the end it stops."""
        length = float(np.linalg.norm(self._line))
        if (1.0 - end) * length > SINGULAR_WITHIN:
            return True
        return left <= 8.0 * SHORTEST_STEP and (1.0 - place + 16.0 * SHORTEST_STEP) * length <= SINGULAR_WITHIN

    def _settled(self, q_free: Array, ahead: float, before: _Stand) -> _Stand | None:
        """Newton's method to a place on the line, on one side of det ψ_q′ = 0, in corrections that halve at least."""
        parametrization, rules, last = self._of, self._of.rules, np.inf
        equations = parametrization.equations(parametrization.coordinates.integrate(self._q_start, ahead * self._line))
        for _ in range(_MOST_SETTLING):
            residual, jacobian = equations(q_free)
            factor, size = factorize(jacobian), float(np.abs(residual).max(initial=0.0))
            if not factor.rcond > 0.0 or factor.sign != before.factor.sign:
                return None
            if size <= rules.tolerance or (last <= rules.noise and size <= rules.stalled):
                probe = factor.solve(parametrization.continuation.unstructured)
                cosine = float(np.sum(probe * before.probe)) / np.sqrt(_square(probe) * _square(before.probe))
                return _Stand(q_free, factor, probe) if cosine >= _SAME_DIRECTION else None
            step = factor.solve(-residual)
            length = float(np.linalg.norm(step))
            if not length <= max(rules.noise, min(1.0, 0.5 * last)):
                return None
            q_free, last = moved(parametrization.model, q_free, step), length
        return None


def _square(probe: Array) -> float:
    """|Y|²."""
    return float(np.sum(probe * probe))
