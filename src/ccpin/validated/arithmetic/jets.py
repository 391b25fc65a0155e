"""A tape's program run over many boxes at once, with first and second derivatives along chosen directions.

A jet of a function w over a box is a ball around its value, its gradient and its second derivatives for every point of
the box. With inputs x(s), s ∈ ℝᵈ, given as jets over a set of s, the program's outputs are jets of w(x(s)).

Boxes come in pairs, a centre s_c and a box s_c ± δ. What the rules of differentiation give over the box is narrowed for
every value of the program by Taylor's theorem about the centre,

    w ∈ w(s_c) + w′(s_c)δ + ½ w″(box)δδ,    w′ ∈ w′(s_c) + w″(box)δ,

so that what is lost to the dependence of one value on another is of the order of δ² in w and of δ in w″.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.programs.instructions import Code, Instruction, Kind
from ccpin.validated.arithmetic.ball_arrays import (
    BallArray,
    gain,
    inverse,
    of_balls,
    raised,
    sine_and_cosine,
    stacked,
    zeros,
)
from ccpin.validated.arithmetic.series import NotInvertibleError


class Jet(NamedTuple):
    """A value over B boxes and its derivatives.

    Attributes:
        value: Of shape (B,).
        slope: ∂w/∂s, of shape (B, d); ``None`` where it is zero or not asked for.
        bend: ∂²w/∂s², of shape (B, d, d), alike.
        twist: ∂³w/∂s³, of shape (B, d, d, d), alike; without the centres where boxes come with centres.
    """

    value: BallArray
    slope: BallArray | None = None
    bend: BallArray | None = None
    twist: BallArray | None = None


def jets_over(program: Code, inputs: Sequence[Jet], order: int = 3, reach: Array | None = None) -> list[Jet]:
    """The outputs' jets.

    Args:
        program: The program.
        inputs: A jet for each input, with the same boxes and directions.
        order: 0 to 3: how many derivatives.
        reach: δ, of shape (B/2, d): the first half of the boxes are the centres of the others. ``None``: no narrowing.

    Raises:
        NotInvertibleError: A matrix to be inverted may be singular on one of the boxes.
    """
    run = _JetEvaluation(program.size, inputs, order, reach)
    for item in program.instructions:
        run.visit(item)
    return [run.found[number] for number in program.outputs]


class _JetEvaluation:
    def __init__(self, size: int, inputs: Sequence[Jet], order: int, reach: Array | None) -> None:
        self.found: list[Any] = [*inputs, *[None] * (size - len(inputs))]
        self.order, self.boxes, self.reach = order, len(inputs[0].value.mid), reach
        self.over = np.s_[0 if reach is None else len(reach) :]
        self.width = next((x.slope.mid.shape[1] for x in inputs if x.slope is not None), 0)
        self.inverses: dict[Any, BallArray] = {}
        self.angles: dict[int, tuple[BallArray, BallArray]] = {}

    def visit(self, item: Instruction) -> None:
        """One value's jet."""
        found, a, b = self.found, item.a, item.b
        if item.kind == Kind.MULTIPLY:
            result = self.product(found[a], found[b])
        elif item.kind == Kind.ADD:
            result = Jet._make(_sum(x, y) for x, y in zip(found[a], found[b], strict=True))
        elif item.kind == Kind.SUBTRACT:
            result = Jet._make(_sum(x, None if y is None else -y) for x, y in zip(found[a], found[b], strict=True))
        elif item.kind == Kind.SCALE:
            factor = of_balls([[item.constant]]).at(0)
            result = Jet._make(None if x is None else _spread(factor, x.mid.ndim) * x for x in found[a])
        elif item.kind in (Kind.SINE, Kind.COSINE):
            sine, cosine = self.trigonometric(a)
            waves = (sine, cosine, -sine, -cosine) if item.kind == Kind.SINE else (cosine, -sine, -cosine, sine)
            result = self.composed(found[a], waves)
        elif item.kind == Kind.GAIN:
            result = self.composed(found[a], tuple(gain(found[a].value, b + k) for k in range(4)))
        elif item.kind == Kind.SOLVE:
            found[item.target] = self.solution(item)
            return
        elif item.kind == Kind.PART:
            result = found[a][b]
        else:
            constant = of_balls([[item.constant]]).at(0)
            result = Jet(BallArray(*(np.broadcast_to(x, self.boxes) for x in constant)))
        found[item.target] = self.narrowed(result)

    def narrowed(self, jet: Jet) -> Jet:
        """A jet over the boxes narrowed by what is known at their centres."""
        return jet if self.reach is None else narrowed(jet, self.reach)

    def product(self, a: Jet, b: Jet) -> Jet:
        """Leibniz' rule: (ab)′ = ab′ + ba′, (ab)″ = ab″ + ba″ + a′b′ᵀ + b′a′ᵀ, and so on."""
        slope, bend = (_sum(_scaled(a.value, y), _scaled(b.value, x)) for x, y in zip(a[1:3], b[1:3], strict=True))
        twist = None
        if self.order >= 2:
            cross = _outer(a.slope, b.slope)
            bend = _sum(bend, None if cross is None else cross + cross.swapped(1, 2))
        if self.order >= 3:
            one, two = self.over_boxes(a), self.over_boxes(b)
            twist = _sum(_scaled(one.value, b.twist), _scaled(two.value, a.twist))
            twist = _sum(twist, _shared(_sum(_outer(one.slope, two.bend), _outer(two.slope, one.bend))))
        return Jet(a.value * b.value, slope, bend, twist)

    def composed(self, x: Jet, w: tuple[BallArray, ...]) -> Jet:
        """w(x), of w with its first three derivatives at x."""
        slope, bend, twist = _scaled(w[1], x.slope), _scaled(w[1], x.bend), None
        if self.order >= 2:
            bend = _sum(bend, _scaled(w[2], _outer(x.slope, x.slope)))
        if self.order >= 3:
            (_, first, second, third), over = (part.at(self.over) for part in w), self.over_boxes(x)
            twist = _sum(_scaled(first, x.twist), _scaled(second, _shared(_outer(over.slope, over.bend))))
            twist = _sum(twist, _scaled(third, _outer(over.slope, _outer(over.slope, over.slope))))
        return Jet(w[0], slope, bend, twist)

    def over_boxes(self, jet: Jet) -> Jet:
        """A jet without the centres."""
        return Jet._make([*(None if x is None else x.at(self.over) for x in jet[:3]), jet.twist])

    def trigonometric(self, angle: int) -> tuple[BallArray, BallArray]:
        """Sine and cosine of a value."""
        if angle not in self.angles:
            self.angles[angle] = sine_and_cosine(self.found[angle].value)
        return self.angles[angle]

    def solution(self, item: Instruction) -> list[Jet]:
        """From AZ = B: AZ_k = B_k − A_k Z, AZ_kl = B_kl − A_kl Z − A_k Z_l − A_l Z_k and so on; entries row-major."""
        left, right = self.table(item.b.matrix), self.table(item.b.right)
        if item.b.matrix not in self.inverses:
            inverted = inverse(left[0])
            if inverted is None:
                raise NotInvertibleError
            self.inverses[item.b.matrix] = inverted
        over = self.inverses[item.b.matrix]
        z = [over @ right[0]]
        if self.order >= 1:
            over = over.at(np.s_[:, None])
            z.append(over @ (right[1] - left[1] @ z[0].at(np.s_[:, None])))
        if self.order >= 2:
            over = over.at(np.s_[:, None])
            mixed = left[1].at(np.s_[:, :, None]) @ z[1].at(np.s_[:, None])
            known = left[2] @ z[0].at(np.s_[:, None, None])
            z.append(over @ (right[2] - known - mixed - mixed.swapped(1, 2)))
        if self.order >= 3:
            over = over.at(np.s_[self.over, None])
            left, z0, z1, z2 = [*(x.at(self.over) for x in left[:3]), left[3]], *(x.at(self.over) for x in z)
            mixed = left[1].at(np.s_[:, :, None, None]) @ z2.at(np.s_[:, None])
            mixed = mixed + left[2].at(np.s_[:, None]) @ z1.at(np.s_[:, :, None, None])
            shared = mixed + mixed.swapped(1, 2) + mixed.swapped(1, 3)
            z.append(over @ (right[3] - left[3] @ z0.at(np.s_[:, None, None, None]) - shared))
        rows, columns = z[0].mid.shape[1:]
        return [self.narrowed(Jet(*(x.at((..., i, j)) for x in z))) for i in range(rows) for j in range(columns)]

    def table(self, numbers: Sequence[Sequence[int]]) -> list[BallArray]:
        """Values (B, rows, columns), slopes (B, d, …), bends (B, d, d, …) and twists of a matrix."""
        tables = []
        for degree in range(self.order + 1):
            boxes = self.boxes if degree < 3 or self.reach is None else len(self.reach)
            nothing = zeros(boxes, *[self.width] * degree)
            rows = [[self.found[k][degree] for k in row] for row in numbers]
            tables.append(stacked((stacked(nothing if x is None else x for x in row) for row in rows), axis=-2))
        return tables


def narrowed(jet: Jet, reach: Array) -> Jet:
    """The second half of a jet's boxes narrowed by Taylor's theorem about the first half, their centres.

    The remainder of degree k + 2 is counted twice or less, ¼ in place of 1/6.
    """
    found, half, moved = list[BallArray | None](jet), len(reach), None
    for degree in (2, 1, 0):
        x, rate = found[degree : degree + 2]
        if x is None or rate is None:
            continue
        near = rate.size if degree == 2 else rate.at(np.s_[half:]).size
        if moved is not None:
            near = rate.at(np.s_[:half]).size + 0.5 * moved
        moved = raised((near * reach.reshape(half, *[1] * degree, -1)).sum(axis=-1))
        found[degree] = _narrower(x, x.at(np.s_[:half]), moved)
    return Jet._make(found)


def _narrower(x: BallArray, centre: BallArray, reach: Array) -> BallArray:
    """The entries of x over boxes, or the centre's with a reach, whichever have the smaller radius."""
    half, found = len(centre.mid), centre + BallArray(np.zeros_like(reach), reach)
    better = found.rad < x.rad[half:]
    both = (np.where(better, *pair) for pair in ((found.mid, x.mid[half:]), (found.rad, x.rad[half:])))
    return BallArray(*(np.concatenate([old[:half], new]) for old, new in zip(x, both, strict=True)))


def _shared(x: BallArray | None) -> BallArray | None:
    """The sum of x_klm, x_lkm and x_mlk: symmetric where x is in its last two."""
    return None if x is None else x + x.swapped(1, 2) + x.swapped(1, 3)


def _sum(a: BallArray | None, b: BallArray | None) -> BallArray | None:
    if a is None or b is None:
        return a if b is None else b
    return a + b


def _scaled(factor: BallArray, x: BallArray | None) -> BallArray | None:
    return None if x is None else _spread(factor, x.mid.ndim) * x


def _spread(factor: BallArray, dimensions: int) -> BallArray:
    """A column of numbers with axes added at its end."""
    return factor.at((..., *[None] * (dimensions - factor.mid.ndim)))


def _outer(a: BallArray | None, b: BallArray | None) -> BallArray | None:
    """a_k b_l…, ``None`` where either is zero."""
    if a is None or b is None:
        return None
    return a.at((..., *[None] * (b.mid.ndim - 1))) * b.at(np.s_[:, None])
