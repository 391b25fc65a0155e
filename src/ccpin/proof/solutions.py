"""Claims about boxes of closures: solutions in them, and boxes that carry the same solution.

Theorem N (`theorems/theorem_n.md`) says of a box θ = θ_c + Dδ + Eζ, |δ| ≤ h, |ζ| ≤ R, that over every δ there is
exactly one ζ* with φ(θ) = 0. Its lemma G glues two such boxes: a solution of the one, known to within a ball, lies in
the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, Mask, apply, joined
from ccpin.proof.equations import Closures
from ccpin.proof.facts import Examined, Fact, Form, ProvableClaim, provable, require
from ccpin.proof.newton import Boxes, SolutionBall, TubesAt, check, in_tubes, noise_of, reached
from ccpin.proof.rounding import SLACK, TURN, UNIT_ROUNDOFF, product_of, sum_of
from ccpin.work import side_by_side

_PART = 256  # pairs of boxes at once: bounds memory
_PI_OFF = 8.5 * UNIT_ROUNDOFF  # 2π as a double is off by 2.21u, a product of it by 2πu a turn at most


@provable
@dataclass(frozen=True, eq=False)
class SolutionsInBoxes(ProvableClaim):
    """In each of B boxes: for every |δ| ≤ h (widened) exactly one |ζ| ≤ R with φ = 0; there φ_y is nonsingular.

    Found: `image` (B, m), Z̄(R)R.
    """

    centre: Annotated[Array, Form("BN")]
    half: Annotated[Array, Form("Bp", least=0.0)]
    directions: Annotated[Array, Form("BNp")]
    modes: Annotated[Array, Form("BMM")]
    preconditioner: Annotated[Array, Form("BMM")]
    radius: Annotated[Array, Form("BM", above=0.0)]
    weight: Annotated[Array, Form("BM", above=0.0)]
    kappa: Annotated[Array, Form("B", least=0.0, below=1.0)]
    rows, theorem = "B", "theorem_n"

    @property
    def boxes(self) -> Boxes:
        """The boxes."""
        return Boxes(*(getattr(self, name) for name in Boxes._fields))

    def examined(self, *premises: Fact) -> Examined:
        """(N1) and (N2)."""
        require(not premises, "solutions in boxes rest on nothing else")
        checked = check(self.equations, self.boxes)
        return Examined(checked.proved, {"image": checked.image})


class _GlueBoxes(NamedTuple):
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
    require(len(facts) > 0 and [type(fact.claim) is SolutionsInBoxes for fact in facts], "premises that are no boxes")
    require([fact.claim.half.shape[1] == facts[0].claim.half.shape[1] for fact in facts], "boxes of different kinds")
    boxes: list[Boxes] = [fact.claim.boxes for fact in facts]
    return boxes[0] if len(boxes) == 1 else joined(boxes)


def _tubes_of(equations: Closures, facts: Sequence[Fact], *numbers: Indices) -> _GlueBoxes:
    """The same with what gluing asks of them.

    Raises:
        NotProvedError: As for `boxes_of`; a number is none of theirs, or their last n parameters are not q.
    """
    boxes, system = boxes_of(facts), equations.system
    require([np.all(rows < len(boxes.kappa)) for rows in numbers], "a number of no box")
    p = boxes.half.shape[1]
    across = boxes.directions[:, :, max(p - system.n, 0) :]
    unit = np.broadcast_to(np.eye(system.n), (len(across), system.n, system.n))
    require(np.array_equal(across[:, system.independent], unit), "boxes that are no graphs over q")
    return _GlueBoxes(
        boxes=boxes,
        image=np.concatenate([fact.found["image"] for fact in facts]),
        noise=noise_of(equations, boxes),
        slopes=np.abs(across[:, system.dependent]).sum(axis=2),
        reached=reached(system, boxes),
        plain=np.all(boxes.modes == np.eye(system.m), axis=(1, 2)),
    )


@provable
@dataclass(frozen=True, eq=False)
class GluedBoxes(ProvableClaim):
    """Boxes `first[i]` and `second[i]` carry the same solution at a common point, δ of the one and δ′ of the other.

    Premises are the facts about the boxes, numbered through. The point lies in both boxes as widened. In the first |ζ*
    + f(δ, 0)| ≤ Z̄ρ for every ρ ≥ |ζ*|, ρ ≤ R; with s = max |f(δ, 0)|/(R − Z̄(R)R) that is s R, and the ball of radius
    s Z̄(R)R lies in the second's tube. Found: `turn` (K, n), by how many whole turns q of the first is ahead of that
    of the second.
    """

    first: Annotated[Indices, Form("K", "i", 0)]
    second: Annotated[Indices, Form("K", "i", 0)]
    at_first: Annotated[Array, Form("Kp")]
    at_second: Annotated[Array, Form("Kp")]
    rows, theorem = "K", "theorem_n"

    def examined(self, *premises: Fact) -> Examined:
        """Lemma G."""
        tubes = _tubes_of(self.equations, premises, self.first, self.second)
        same = np.zeros(len(self.first), dtype=np.bool_)
        turn = np.zeros((len(self.first), self.equations.system.n), dtype=np.int64)
        plain = tubes.plain[self.first] & tubes.plain[self.second]
        each = np.flatnonzero(plain), np.flatnonzero(~plain)
        parts = [alike[start : start + _PART] for alike in each for start in range(0, len(alike), _PART)]
        for rows, done in zip(parts, side_by_side(partial(self._agree, tubes), parts), strict=True):
            same[rows], turn[rows] = done
        return Examined(same, {"turn": turn})

    def _agree(self, tubes: _GlueBoxes, rows: Indices) -> tuple[Mask, Indices]:
        """Whether some of the pairs are glued, and the turns between them."""
        here, there = (self.first[rows], self.at_first[rows]), (self.second[rows], self.at_second[rows])
        with np.errstate(all="ignore"):
            return _agree(self.equations, tubes, here, there)


@provable
@dataclass(frozen=True, eq=False)
class Met(ProvableClaim):
    """The solution that point `point[i]` encloses is that of box `first[i]` at δ, and that of box `second[i]` at δ′.

    Premises: the fact about the points (boxes without parameters), then those about the boxes, numbered through. q of
    the point is compared with that at δ and δ′ modulo whole turns. Found: `turn`, as for `GluedBoxes`.
    """

    first: Annotated[Indices, Form("K", "i", 0)]
    second: Annotated[Indices, Form("K", "i", 0)]
    at_first: Annotated[Array, Form("Kp")]
    at_second: Annotated[Array, Form("Kp")]
    point: Annotated[Indices, Form("K", "i", 0)]
    rows, theorem = "K", "theorem_n"

    def examined(self, *premises: Fact) -> Examined:
        """Lemma G."""
        points, tubes = boxes_of(premises[:1]), _tubes_of(self.equations, premises[1:], self.first, self.second)
        require(points.half.shape[1] == 0 and np.all(self.point < len(points.kappa)), "a point that is none")
        point = points.take(self.point)
        q = point.centre[:, self.equations.system.independent]
        ball = SolutionBall(point.centre, point.radius, point.modes)
        held, turns = np.ones(len(q), dtype=np.bool_), list[Indices]()
        for rows, delta in ((self.first, self.at_first), (self.second, self.at_second)):
            with np.errstate(all="ignore"):
                place = _placed(self.equations, tubes, (rows, delta), (q, np.zeros_like(q)))
                held &= place.over & _inside(self.equations, tubes, place, ball)
            turns.append(place.turn)
        return Examined(held, {"turn": turns[1] - turns[0]})


def glued_by(glue: Fact) -> tuple[Fact, ...]:
    """The facts about boxes, numbered through, of which a fact says that pairs are glued.

    Raises:
        NotProvedError: It is a fact of another kind.
    """
    require(type(glue.claim) in (GluedBoxes, Met), "premises of other kinds")
    return glue.premises[1:] if type(glue.claim) is Met else glue.premises


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
    equations: Closures, tubes: _GlueBoxes, at: tuple[Indices, Array], q: tuple[Array, Array] | None = None
) -> _Place:
    """Where points q, sums of two doubles (default: the boxes' own), are: at δ, but for turns and little else."""
    (rows, delta), periodic = at, equations.system.periodic[equations.system.independent]
    here, rest = _exact(equations, tubes.boxes, rows, delta)
    gap, of_gap = sum_of((here if q is None else q[0]), -here)
    turn = np.where(periodic, np.round(gap / TURN), 0.0)
    left = (gap - TURN * turn) + (of_gap + ((rest if q is None else q[1]) - rest))
    off = (np.abs(left) + _PI_OFF * np.abs(turn)).max(axis=1, initial=0.0)
    size = np.abs(delta)
    size[:, size.shape[1] - here.shape[1] :] += off[:, None]
    base = tubes.boxes.centre[rows] + apply(tubes.boxes.directions[rows], delta)
    return _Place(rows, base, turn.astype(np.int64), off, np.all(size <= tubes.reached[rows], axis=1))


def _agree(
    equations: Closures, tubes: _GlueBoxes, first: tuple[Indices, Array], second: tuple[Indices, Array]
) -> tuple[Mask, Indices]:
    """Whether boxes are glued at δ of the one and δ′ of the other, and the turns between them."""
    here = _placed(equations, tubes, first)
    place = _placed(equations, tubes, second, _exact(equations, tubes.boxes, *first))
    ball, known = _ball(equations, tubes, here.rows, here.base)
    return np.asarray(here.over & place.over & known & _inside(equations, tubes, place, ball)), place.turn


def _ball(equations: Closures, tubes: _GlueBoxes, rows: Indices, base: Array) -> tuple[SolutionBall, Mask]:
    """What boxes' solutions are known to where θ_c + Dδ is base (K, N), and whether they are, (K,)."""
    boxes, dependent = tubes.boxes, equations.system.dependent
    radius, image = boxes.radius[rows], tubes.image[rows]
    residual = apply(boxes.preconditioner[rows], equations.values(base))
    share = np.max((np.abs(residual) + tubes.noise[rows]) / (radius - SLACK * image), axis=1, keepdims=True)
    theta, modes = base, None if tubes.plain[rows].all() else boxes.modes[rows]
    theta[:, dependent] -= residual if modes is None else apply(modes, residual)
    return SolutionBall(theta, SLACK * (share * image + tubes.noise[rows]), modes), share[:, 0] <= 1.0


def at_centres(equations: Closures, facts: Sequence[Fact], rows: Indices) -> tuple[Array, Array]:
    """The dependent coordinates of the solutions over the middles of boxes of facts, by number: y and errors, (K, m).

    Errors are not finite where nothing is known.
    """
    tubes, dependent = _tubes_of(equations, facts, rows), equations.system.dependent
    with np.errstate(all="ignore"):
        ball, known = _ball(equations, tubes, rows, tubes.boxes.centre[rows])
        error = ball.error if ball.modes is None else apply(np.abs(ball.modes), ball.error)
    return ball.theta[:, dependent], np.where(known[:, None], error * SLACK, np.inf)


def _inside(equations: Closures, tubes: _GlueBoxes, place: _Place, ball: SolutionBall) -> Mask:
    """Whether what the balls hold lies in the boxes' tubes there, of shape (K,)."""
    rows = place.rows
    modes = None if tubes.plain[rows].all() else tubes.boxes.modes[rows]
    there = TubesAt(place.base, tubes.boxes.radius[rows], modes)
    return in_tubes(equations.system, there, tubes.slopes[rows] * place.off[:, None], ball)
