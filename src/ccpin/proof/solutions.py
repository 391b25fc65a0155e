"""Claims about boxes of closures: solutions in them, and boxes that carry the same solution.

Theorem N (`theorems/theorem_n.md`) says of a box θ = θ_c + Dδ + Eζ, |δ| ≤ h, |ζ| ≤ R, that over every δ there is exactly
one ζ* with φ(θ) = 0. Its lemma G glues two such boxes: a solution of the one, known to within a ball, lies in the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, Mask, apply, joined
from ccpin.domain.bounds import Bounds, Frame
from ccpin.domain.boxes import Boxes, inverses
from ccpin.proof.closures import Closures
from ccpin.proof.facts import Claim, Examined, Fact, Form, provable, require
from ccpin.proof.rounding import SLACK, UNIT_ROUNDOFF, product_of, sum_of, widened

_PART = 256
TURN = 2.0 * np.pi


@provable
@dataclass(frozen=True, eq=False)
class Solutions(Claim):
    """In each of B boxes: for every |δ| ≤ h (widened) exactly one |ζ| ≤ R with φ = 0; there φ_y is nonsingular.

    Found: `image` (B, m), Z̄(R)R.
    """

    centre: Array
    half: Array
    directions: Array
    modes: Array
    preconditioner: Array
    radius: Array
    weight: Array
    kappa: Array
    rows, theorem = "B", "theorem_n"
    forms = MappingProxyType(
        {
            "centre": Form("BN"),
            "half": Form("Bp", least=0.0),
            "directions": Form("BNp"),
            "modes": Form("BMM"),
            "preconditioner": Form("BMM"),
            "radius": Form("BM", above=0.0),
            "weight": Form("BM", above=0.0),
            "kappa": Form("B", least=0.0, below=1.0),
        }
    )

    @property
    def boxes(self) -> Boxes:
        """The boxes."""
        return Boxes(*(getattr(self, name) for name in Boxes._fields))

    def examined(self, *premises: Fact) -> Examined:
        """(N1) and (N2)."""
        require(not premises, "solutions in boxes rest on nothing else")
        checked = check(self.equations, self.boxes)
        return Examined(checked.proved, {"image": checked.image})


class Checked(NamedTuple):
    """Which of B boxes fulfil (N1) and (N2), (B,), and Z̄(R)R of these, (B, m)."""

    proved: Mask
    image: Array


def check(equations: Closures, boxes: Boxes) -> Checked:
    """(N1) and (N2) of boxes, from their numbers alone: with phasors, where there are any, or else with reach bounds."""
    found = Checked(np.zeros(len(boxes.kappa), dtype=np.bool_), np.zeros_like(boxes.radius))
    plain = np.all(boxes.modes == np.eye(equations.system.m), axis=(1, 2))
    for reach in (False, True) if equations.phasors is not None else (True,):
        for alike in (plain, ~plain):
            rows = np.flatnonzero(alike & ~found.proved)
            for first in range(0, len(rows), _PART):
                part = rows[first : first + _PART]
                some = boxes.take(part)
                with np.errstate(all="ignore"):
                    bounds = equations.bounds(some.centre, frame_of(equations, some), reach)
                    found.proved[part], found.image[part] = holds(bounds, some)
    return found


def holds(bounds: Bounds, boxes: Boxes) -> Checked:
    """Whether (N1) Y + Z̄(R)R < R and (N2) Z(R)w ≤ κw, κ < 1, w > 0 hold, given bounds of B boxes."""
    radius, weight = boxes.radius, boxes.weight
    image, shrunk = bounds.mean(radius).of(radius), bounds.contraction(radius, weight).of(weight)
    inside = np.all((bounds.y + image) * SLACK < radius, axis=1)
    contracts = np.all(shrunk * SLACK <= boxes.kappa[:, None] * weight, axis=1)
    finite = np.isfinite(bounds.y + image + shrunk).all(axis=1) & (boxes.kappa < 1.0)
    return Checked(np.asarray(inside & contracts & finite & np.all(weight > 0.0, axis=1)), image)


def frame_of(equations: Closures, boxes: Boxes) -> Frame:
    """Boxes as Theorem N has them: E = [0; V], h widened."""
    modes = np.zeros((*boxes.centre.shape, equations.system.m))
    modes[:, equations.system.dependent] = boxes.modes
    half = reached(equations, boxes)
    return Frame(boxes.preconditioner, boxes.directions, modes, half, equations.rounding(boxes.centre))


def reached(equations: Closures, boxes: Boxes) -> Array:
    """h as the theorem has it, widened: by what δ is measured from, q_c where the parameters are q, else |θ_c|."""
    independent = equations.system.independent
    if boxes.half.shape[1] == len(independent):
        return widened(boxes.centre[:, independent], boxes.half)
    return widened(np.abs(boxes.centre).max(axis=1, initial=0.0, keepdims=True), boxes.half)


class _Tubes(NamedTuple):
    """What facts say of B boxes, numbered through.

    Attributes:
        boxes: The boxes.
        image: Z̄(R)R, of shape (B, m).
        noise: What f may be off by in the tube, of shape (B, m).
        slopes: Σ_k |D| over the parameters that are q, in the dependent rows, of shape (B, m).
        reached: h as the theorem has it, of shape (B, p).
        plain: Whether V = I, of shape (B,).
    """

    boxes: Boxes
    image: Array
    noise: Array
    slopes: Array
    reached: Array
    plain: Mask


def boxes_of(facts: Sequence[Fact]) -> Boxes:
    """The boxes of several facts, one behind the other.

    Raises:
        NotProvedError: There are none, or they are facts of another kind, or of boxes with other numbers of parameters.
    """
    require(len(facts) > 0 and [type(fact.claim) is Solutions for fact in facts], "premises that are no boxes")
    require([fact.claim.half.shape[1] == facts[0].claim.half.shape[1] for fact in facts], "boxes of different kinds")
    return facts[0].claim.boxes if len(facts) == 1 else joined(fact.claim.boxes for fact in facts)


def _tubes_of(equations: Closures, facts: Sequence[Fact], *numbers: Indices) -> _Tubes:
    """The same with what gluing asks of them.

    Raises:
        NotProvedError: As for `boxes_of`; a number is none of theirs, or their last n parameters are not q.
    """
    boxes, system = boxes_of(facts), equations.system
    require([np.all(rows < len(boxes.kappa)) for rows in numbers], "a number of no box")
    p = boxes.half.shape[1]
    across = boxes.directions[:, :, max(p - system.n, 0) :]
    unit = np.broadcast_to(np.eye(system.n), (len(across), system.n, system.n))
    require(p >= system.n and np.array_equal(across[:, system.independent], unit), "boxes that are no graphs over q")
    size = np.abs(boxes.centre) + apply(np.abs(boxes.directions), boxes.half)
    size[:, system.dependent] += apply(np.abs(boxes.modes), boxes.radius)
    return _Tubes(
        boxes=boxes,
        image=np.concatenate([fact.found["image"] for fact in facts]),
        noise=np.abs(boxes.preconditioner).sum(axis=2) * equations.rounding(size)[:, None],
        slopes=np.abs(across[:, system.dependent]).sum(axis=2),
        reached=reached(equations, boxes),
        plain=np.all(boxes.modes == np.eye(system.m), axis=(1, 2)),
    )


@provable
@dataclass(frozen=True, eq=False)
class Glued(Claim):
    """Boxes `first[i]` and `second[i]` carry the same solution at a common point, δ in the first's parameters, δ′ in the
    second's: premises are the facts about the boxes, numbered through.

    The point lies in both boxes as widened. In the first |ζ* + f(δ, 0)| ≤ Z̄ρ for every ρ ≥ |ζ*|, ρ ≤ R; with
    s = max |f(δ, 0)|/(R − Z̄(R)R) that is s R, and the ball of radius s Z̄(R)R lies in the second's tube. Found: `turn`
    (K, n), by how many whole turns q of the first is ahead of that of the second.
    """

    first: Indices
    second: Indices
    at_first: Array
    at_second: Array
    rows, theorem = "K", "theorem_n"
    forms = MappingProxyType(
        {
            "first": Form("K", "i", 0),
            "second": Form("K", "i", 0),
            "at_first": Form("Kp"),
            "at_second": Form("Kp"),
        }
    )

    def examined(self, *premises: Fact) -> Examined:
        """Lemma G."""
        tubes, count, n = (
            _tubes_of(self.equations, premises, self.first, self.second),
            len(self.first),
            self.equations.system.n,
        )
        same, turn = np.zeros(count, dtype=np.bool_), np.zeros((count, n), dtype=np.int64)
        plain = tubes.plain[self.first] & tubes.plain[self.second]
        for alike in (np.flatnonzero(plain), np.flatnonzero(~plain)):
            for start in range(0, len(alike), _PART):
                rows = alike[start : start + _PART]
                here, there = (self.first[rows], self.at_first[rows]), (self.second[rows], self.at_second[rows])
                with np.errstate(all="ignore"):
                    same[rows], turn[rows] = _agree(self.equations, tubes, here, there)
        return Examined(same, {"turn": turn})


@provable
@dataclass(frozen=True, eq=False)
class Met(Claim):
    """The solution that point `point[i]` encloses is that of box `first[i]` at δ, and that of box `second[i]` at δ′.

    Premises: the fact about the points (boxes without parameters), then those about the boxes, numbered through. q of
    the point is compared with that at δ and δ′ modulo whole turns. Found: `turn`, as for `Glued`.
    """

    first: Indices
    second: Indices
    at_first: Array
    at_second: Array
    point: Indices
    rows, theorem = "K", "theorem_n"
    forms = MappingProxyType({**Glued.forms, "point": Form("K", "i", 0)})

    def examined(self, *premises: Fact) -> Examined:
        """Lemma G."""
        require(len(premises) > 1, "points and boxes are needed")
        points, tubes = boxes_of(premises[:1]), _tubes_of(self.equations, premises[1:], self.first, self.second)
        require(points.half.shape[1] == 0 and np.all(self.point < len(points.kappa)), "a point that is none")
        point = points.take(self.point)
        q, ball = point.centre[:, self.equations.system.independent], _Ball(point.centre, point.radius, point.modes)
        held, turns = np.ones(len(q), dtype=np.bool_), list[Indices]()
        for rows, delta in ((self.first, self.at_first), (self.second, self.at_second)):
            with np.errstate(all="ignore"):
                place = _placed(self.equations, tubes, (rows, delta), (q, np.zeros_like(q)))
                held &= place.over & _inside(self.equations, tubes, place, ball, False)
            turns.append(place.turn)
        return Examined(held, {"turn": turns[1] - turns[0]})


class _Ball(NamedTuple):
    """What solutions are known to: θ (B, N) and V · [−error, error] (B, m) in the dependent coordinates."""

    theta: Array
    error: Array
    modes: Array


class _Place(NamedTuple):
    """Points of q at parameters of boxes.

    Attributes:
        rows: Which boxes, of shape (K,).
        base: θ_c + Dδ, of shape (K, N).
        turn: By how many whole turns q is ahead of the box's, of shape (K, n).
        off: What is left of the difference at most, of shape (K,): the parameters that are q are so much off.
        over: Whether the exact parameters are of the box as widened, of shape (K,).
    """

    rows: Indices
    base: Array
    turn: Indices
    off: Array
    over: Mask


def _exact(equations: Closures, boxes: Boxes, rows: Indices, delta: Array) -> tuple[Array, Array]:
    """q of θ_c + Dδ as sums of two doubles, (K, n) each; what is left out is of the order of u²."""
    independent, n = equations.system.independent, equations.system.n
    total, rest = sum_of(boxes.centre[rows][:, independent], delta[:, delta.shape[1] - n :])
    for k in range(delta.shape[1] - n):
        product, of_product = product_of(boxes.directions[rows][:, independent, k], delta[:, k, None])
        total, of_sum = sum_of(total, product)
        rest = rest + (of_product + of_sum)
    return total, rest


def _placed(
    equations: Closures, tubes: _Tubes, at: tuple[Indices, Array], q: tuple[Array, Array] | None = None
) -> _Place:
    """Where points q, sums of two doubles (default: of the boxes themselves), are: at δ, but for turns and little else."""
    (rows, delta), periodic = at, equations.system.periodic[equations.system.independent]
    here, rest = _exact(equations, tubes.boxes, rows, delta)
    gap, of_gap = sum_of((here if q is None else q[0]), -here)
    turn = np.where(periodic, np.round(gap / TURN), 0.0)
    left = (gap - TURN * turn) + (of_gap + ((rest if q is None else q[1]) - rest))
    off = (np.abs(left) + 8.0 * UNIT_ROUNDOFF * np.abs(turn)).max(axis=1, initial=0.0)  # 2π is no double
    size = np.abs(delta)
    size[:, size.shape[1] - here.shape[1] :] += off[:, None]
    base = tubes.boxes.centre[rows] + apply(tubes.boxes.directions[rows], delta)
    return _Place(rows, base, turn.astype(np.int64), off, np.all(size <= tubes.reached[rows], axis=1))


def _agree(
    equations: Closures, tubes: _Tubes, first: tuple[Indices, Array], second: tuple[Indices, Array]
) -> tuple[Mask, Indices]:
    """Whether boxes are glued at δ of the one and δ′ of the other, and the turns between them."""
    boxes, dependent = tubes.boxes, equations.system.dependent
    here = _placed(equations, tubes, first)
    place = _placed(equations, tubes, second, _exact(equations, boxes, *first))
    rows, radius, image = here.rows, boxes.radius[here.rows], tubes.image[here.rows]
    residual = apply(boxes.preconditioner[rows], equations.values(here.base))
    share = np.max((np.abs(residual) + tubes.noise[rows]) / (radius - SLACK * image), axis=1, keepdims=True)
    plain = bool(tubes.plain[rows].all() and tubes.plain[place.rows].all())
    theta, modes = here.base, boxes.modes[rows] if not plain else boxes.modes[:1]
    theta[:, dependent] -= residual if plain else apply(modes, residual)
    ball = _Ball(theta, SLACK * (share * image + tubes.noise[rows]), modes)
    held = here.over & place.over & (share[:, 0] <= 1.0) & _inside(equations, tubes, place, ball, plain)
    return np.asarray(held), place.turn


def _inside(equations: Closures, tubes: _Tubes, place: _Place, ball: _Ball, plain: bool) -> Mask:
    """Whether what the balls hold lies in the boxes' tubes there, of shape (K,); `plain`: V = I of all.

    Periodic coordinates are compared modulo 2π; 1e-13 is allowed for rounding, and what q may be off by.
    """
    system, rows = equations.system, place.rows
    gap, radius = (ball.theta - place.base)[:, system.dependent], tubes.boxes.radius[rows]
    gap -= np.where(system.periodic[system.dependent], TURN * np.round(gap / TURN), 0.0)
    blurred = 1e-13 * (1.0 + np.abs(ball.theta[:, system.dependent])) + tubes.slopes[rows] * place.off[:, None]
    if plain:
        return np.asarray(np.all((np.abs(gap) + blurred + ball.error) * SLACK <= radius, axis=1))
    modes, unit, roundings = tubes.boxes.modes[rows], np.eye(system.m), (system.m + 2) * UNIT_ROUNDOFF
    inverse = inverses(modes)
    size = np.abs(inverse)
    wrong = np.abs(unit - inverse @ modes) + roundings * (unit + size @ np.abs(modes))
    spread = np.abs(inverse @ ball.modes) + roundings * (size @ np.abs(ball.modes))
    reach = np.abs(apply(inverse, gap)) + apply(size, blurred) + apply(spread, ball.error)
    defect = wrong.sum(axis=2).max(axis=1)
    reach += (2.0 * defect * reach.max(axis=1))[:, None]  # Vζ = x has |ζ| ≤ |Mx| + X|ζ|, M the inverse as computed
    return np.asarray((defect < 0.5) & np.all(reach * SLACK <= radius, axis=1))
