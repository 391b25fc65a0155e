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
from ccpin.validated.series import NotInvertibleError
from ccpin.validated.tape import ADD, COSINE, MULTIPLY, PART, SCALE, SINE, SOLVE, SUBTRACT, Instruction, Program
from ccpin.validated.wide import Wide, inverse, of_balls, raised, sine_and_cosine, stacked


class Jet(NamedTuple):
    """A value over B boxes and its derivatives.

    Attributes:
        value: Of shape (B,).
        slope: ∂w/∂s, of shape (B, d); ``None`` where it is zero.
        bend: ∂²w/∂s², of shape (B, d, d); ``None`` where it is zero or not asked for.
    """

    value: Wide
    slope: Wide | None = None
    bend: Wide | None = None


def jets(program: Program, inputs: Sequence[Jet], order: int = 2, reach: Array | None = None) -> list[Jet]:
    """The outputs' jets.

    Args:
        program: The program.
        inputs: A jet for each input, with the same boxes and directions.
        order: 0, 1 or 2: how many derivatives.
        reach: δ, of shape (B/2, d): the first half of the boxes are the centres of the others. ``None``: no narrowing.

    Raises:
        NotInvertibleError: A matrix to be inverted may be singular on one of the boxes.
    """
    run = _Run(program.size, inputs, order, reach)
    for item in program.instructions:
        run.visit(item)
    return [run.found[number] for number in program.outputs]


class _Run:
    def __init__(self, size: int, inputs: Sequence[Jet], order: int, reach: Array | None) -> None:
        self.found: list[Any] = [*inputs, *[None] * (size - len(inputs))]
        self.order, self.boxes, self.reach = order, len(inputs[0].value.mid), reach
        self.width = next((x.slope.mid.shape[1] for x in inputs if x.slope is not None), 0)
        self.inverses: dict[Any, Wide] = {}
        self.angles: dict[int, tuple[Wide, Wide]] = {}

    def visit(self, item: Instruction) -> None:
        """One value's jet."""
        found, a, b = self.found, item.a, item.b
        if item.kind == MULTIPLY:
            result = self.product(found[a], found[b])
        elif item.kind == ADD:
            result = Jet(*(_sum(x, y) for x, y in zip(found[a], found[b], strict=True)))
        elif item.kind == SUBTRACT:
            result = Jet(*(_sum(x, None if y is None else -y) for x, y in zip(found[a], found[b], strict=True)))
        elif item.kind == SCALE:
            factor = of_balls([[item.constant]]).at(0)
            result = Jet(*(None if x is None else _spread(factor, x.mid.ndim) * x for x in found[a]))
        elif item.kind in (SINE, COSINE):
            sine, cosine = self.trigonometric(a)
            value, rate = (sine, cosine) if item.kind == SINE else (cosine, -sine)
            result = self.turned(found[a], value, rate)
        elif item.kind == SOLVE:
            result = self.solution(item)
        elif item.kind == PART:
            result = found[a][b]
        else:
            constant = of_balls([[item.constant]]).at(0)
            result = Jet(Wide(*(np.broadcast_to(x, self.boxes) for x in constant)))
        found[item.target] = self.narrowed(result) if isinstance(result, Jet) else result

    def narrowed(self, jet: Jet) -> Jet:
        """A jet over the boxes narrowed by what is known at their centres."""
        return jet if self.reach is None else narrowed(jet, self.reach)

    def product(self, a: Jet, b: Jet) -> Jet:
        """(ab)′ = ab′ + ba′, (ab)″ = ab″ + ba″ + a′b′ᵀ + b′a′ᵀ."""
        slope = _sum(_scaled(a.value, b.slope), _scaled(b.value, a.slope))
        bend = _sum(_scaled(a.value, b.bend), _scaled(b.value, a.bend))
        if self.order == 2 and a.slope is not None and b.slope is not None:
            cross = _outer(a.slope, b.slope)
            bend = _sum(bend, cross + cross.swapped(1, 2))
        return Jet(a.value * b.value, slope, bend)

    def turned(self, angle: Jet, value: Wide, rate: Wide) -> Jet:
        """w(angle) with w′ = rate and w″ = −value."""
        bend = _scaled(rate, angle.bend)
        if self.order == 2 and angle.slope is not None:
            bend = _sum(bend, _scaled(-value, _outer(angle.slope, angle.slope)))
        return Jet(value, _scaled(rate, angle.slope), bend)

    def trigonometric(self, angle: int) -> tuple[Wide, Wide]:
        """Sine and cosine of a value."""
        if angle not in self.angles:
            self.angles[angle] = sine_and_cosine(self.found[angle].value)
        return self.angles[angle]

    def solution(self, item: Instruction) -> list[Jet]:
        """From AZ = B: AZ′ = B′ − A′Z, AZ_kl = B_kl − A_kl Z − A_k Z_l − A_l Z_k; entries row-major."""
        left, right = self.table(item.b.matrix), self.table(item.b.right)
        if item.b.matrix not in self.inverses:
            inverted = inverse(left[0])
            if inverted is None:
                raise NotInvertibleError
            self.inverses[item.b.matrix] = inverted
        over = self.inverses[item.b.matrix]
        value = over @ right[0]
        slope = bend = None
        if self.order >= 1:
            over, z = over.at(np.s_[:, None]), value.at(np.s_[:, None])
            slope = over @ (right[1] - left[1] @ z)
        if self.order == 2 and slope is not None:
            over, z = over.at(np.s_[:, None]), value.at(np.s_[:, None, None])
            mixed = left[1].at(np.s_[:, :, None]) @ slope.at(np.s_[:, None])
            bend = over @ (right[2] - left[2] @ z - mixed - mixed.swapped(1, 2))
        rows, columns = value.mid.shape[1:]
        return [
            self.narrowed(Jet(*(None if x is None else x.at((..., i, j)) for x in (value, slope, bend))))
            for i in range(rows)
            for j in range(columns)
        ]

    def table(self, numbers: Sequence[Sequence[int]]) -> list[Wide]:
        """Values (B, rows, columns), slopes (B, d, …) and bends (B, d, d, …) of a matrix."""
        shapes = [(self.boxes,), (self.boxes, self.width), (self.boxes, self.width, self.width)]
        tables = []
        for degree, shape in enumerate(shapes[: self.order + 1]):
            nothing = Wide(np.zeros(shape), np.zeros(shape))
            rows = [[self.found[k][degree] for k in row] for row in numbers]
            tables.append(stacked((stacked(nothing if x is None else x for x in row) for row in rows), axis=-2))
        return tables


def narrowed(jet: Jet, reach: Array) -> Jet:
    """The second half of a jet's boxes narrowed by Taylor's theorem about the first half, their centres."""
    value, slope, bend = jet
    if slope is None:
        return jet
    half = len(reach)
    centre, over = np.s_[:half], np.s_[half:]
    turn = None
    if bend is not None:
        turn = raised((bend.at(over).size @ reach[:, :, None])[:, :, 0])
        slope = _narrower(slope, slope.at(centre), turn)
    moved = (slope.at(centre).size * reach).sum(axis=1)
    if turn is not None:
        moved = moved + 0.5 * (turn * reach).sum(axis=1)
    return Jet(_narrower(value, value.at(centre), raised(moved)), slope, bend)


def _narrower(x: Wide, centre: Wide, reach: Array) -> Wide:
    """The entries of x over boxes, or the centre's with a reach, whichever have the smaller radius."""
    half, found = len(centre.mid), centre + Wide(np.zeros_like(reach), reach)
    better = found.rad < x.rad[half:]
    both = (np.where(better, *pair) for pair in ((found.mid, x.mid[half:]), (found.rad, x.rad[half:])))
    return Wide(*(np.concatenate([old[:half], new]) for old, new in zip(x, both, strict=True)))


def _sum(a: Wide | None, b: Wide | None) -> Wide | None:
    if a is None or b is None:
        return a if b is None else b
    return a + b


def _scaled(factor: Wide, x: Wide | None) -> Wide | None:
    return None if x is None else _spread(factor, x.mid.ndim) * x


def _spread(factor: Wide, dimensions: int) -> Wide:
    """A column of numbers with axes added at its end."""
    return factor.at((..., *[None] * (dimensions - factor.mid.ndim)))


def _outer(a: Wide, b: Wide) -> Wide:
    return a.at(np.s_[:, :, None]) * b.at(np.s_[:, None, :])
