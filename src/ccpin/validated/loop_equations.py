"""What claims about motions are about: the closed loop of a mechanism and its law as programs over numbers (x, q̇).

    (x, q̇)′ = f(x, q̇), φ(q, y) = 0 with x = (q, y),

recorded by `ccpin.validated.model.recorded_loop`. Whether they are a mechanism's is not asked here: theorems about
motions are about these programs, whose numbers cannot change.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, NamedTuple

from ccpin.programs.instructions import Code
from ccpin.proof.digests import digest
from ccpin.proof.facts import known, require
from ccpin.validated.arithmetic.balls import Ball, ball, flint
from ccpin.validated.arithmetic.programs import is_number, require_program, words
from ccpin.validated.arithmetic.series import values

HALF_A_TURN = (
    "an angle on a circle, or a ball's turn, is not proven less than half a turn from where it is counted from"
)


class Wrapped(NamedTuple):
    """An angle of q that a law reads on a circle: it is as recorded while less than half a turn from q_d's.

    Attributes:
        place: Where it stands in x.
        target: q_d's angle.
    """

    place: int
    target: Ball


class Upright(NamedTuple):
    """A ball joint whose rotation vector enters: it is as recorded while less than half a turn from a reference.

    Attributes:
        place: Where its quaternion begins in x.
        reference: The unit quaternion that it is counted from.
    """

    place: int
    reference: tuple[Ball, ...]


@known
@dataclass(frozen=True, eq=False)
class ClosedLoopEquations:
    """A mechanism under a law as programs over (x, q̇), which cannot be written to.

    Attributes:
        n_x, n: Sizes of x and q̇.
        independent: Places of q in x.
        field: f, of n_x + n outputs.
        closure: φ(x), |p|² − 1 for the quaternions in y and what holds single turns of balls: as many outputs as y has
            numbers.
        jacobian: A square matrix, row-major, whose determinant is ± that of ψ_q′.
        drift: (ẋ, 0): the mechanism moved with q̇ constant.
        energies: Kinetic energy and potential energy, in joules.
        left_out: The redundant rows of φ, or ``None``.
        lyapunov: 𝒱 + V(q_d) of Theorem 3 for PD with simple gravity compensation, else ``None``.
        efforts: u(q′, q̇) of a law that is sampled and held, else ``None``. The state is then (x, q̇, u) with u′ = 0,
            and `field` and `drift` have as many outputs.
        wrapped: Angles of q that the law reads on circles.
        upright: Balls whose rotation vectors enter, as coordinates or by springs.
        free: Which mechanism's motion without torque this is, whatever its coordinates; empty: another motion, or in
            numbers x that not all coordinates of the mechanism share.
    """

    n_x: int
    n: int
    independent: tuple[int, ...]
    field: Code
    closure: Code
    jacobian: Code
    drift: Code
    energies: Code
    left_out: Code | None = None
    lyapunov: Code | None = None
    efforts: Code | None = None
    wrapped: tuple[Wrapped, ...] = ()
    upright: tuple[Upright, ...] = ()
    free: str = ""

    def __post_init__(self) -> None:
        numbers = (self.n_x, self.n, *self.independent)
        require([type(k) is int and k >= 0 for k in numbers], "sizes and places that are none")
        require(type(self.independent) is tuple, "places that could be changed")
        require(set(self.independent) <= set(range(self.n_x)), "q elsewhere than in x")
        self._require_programs()
        self._require_turns()

    def __reduce__(self) -> tuple[type[ClosedLoopEquations], tuple[Any, ...]]:
        return ClosedLoopEquations, tuple(getattr(self, each.name) for each in fields(self))

    def _require_programs(self) -> None:
        """Programs of the state's numbers, with as many outputs as are due.

        Raises:
            NotProvedError: One is not.
        """
        held, rank = self.field.inputs - self.n_x - self.n, math.isqrt(len(self.jacobian.outputs))
        due = {
            "field": self.field.inputs,
            "drift": self.field.inputs,
            "closure": self.n_x - len(set(self.independent)),
            "jacobian": rank**2,
            "energies": 2,
            "lyapunov": 1,
            "efforts": held,
        }
        require((held > 0) == (self.efforts is not None) and held >= 0, "efforts held of no law")
        for each in fields(self):
            program = getattr(self, each.name)
            if isinstance(program, Code):
                require_program(program, self.field.inputs)
                outputs = len(program.outputs)
                require(outputs == due.get(each.name, outputs), f"{each.name} has {outputs} outputs")

    def _require_turns(self) -> None:
        """Angles and quaternions in x, their targets balls.

        Raises:
            NotProvedError: One is not.
        """
        require(type(self.wrapped) is tuple and type(self.upright) is tuple, "turns that could be changed")
        for kind, turns, size in ((Wrapped, self.wrapped, 1), (Upright, self.upright, 4)):
            for turn in turns:
                place, target = turn
                require(type(turn) is kind and type(place) is int, "a turn that is none")
                require(0 <= place <= self.n_x - size, "a turn elsewhere than in x")
                held = (target,) if kind is Wrapped else target
                require(type(held) is tuple and len(held) == size and all(map(is_number, held)), "no target")

    @cached_property
    def dependent(self) -> tuple[int, ...]:
        """Places of y in x, in order."""
        return tuple(k for k in range(self.n_x) if k not in self.independent)

    @cached_property
    def steady(self) -> ClosedLoopEquations:
        """The mechanism moved with q̇ constant, as the motion of a closed loop."""
        return replace(self, field=self.drift, free="")

    @property
    def scalar(self) -> bool:
        """Whether q̇ is the rate of the numbers q, one each, as the programs have it."""
        rates = [self.drift.outputs[k] for k in self.independent]
        return rates == list(range(self.n_x, self.n_x + self.n))

    @property
    def sizes(self) -> Mapping[str, int]:
        """Q, Y: of q and y; V: of q̇; X: of all numbers of a state; D: of (q̇, q̈, …), what deviations of states have."""
        q, y, states = len(self.independent), len(self.dependent), self.field.inputs
        return {"Q": q, "Y": y, "V": self.n, "X": states, "D": self.n + states - self.n_x}

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all instructions and constants."""
        return digest((repr({each.name: words(getattr(self, each.name)) for each in fields(self)}),))

    def at_rest(self, box: Sequence[Ball]) -> list[Ball]:
        """The configurations of a box of states, or of configurations, at rest: inputs of the programs."""
        return [*box[: self.n_x], *[ball(0)] * (self.field.inputs - self.n_x)]

    def at_a_sample(self, box: Sequence[Ball]) -> list[Ball]:
        """A box of states with the efforts that a sampled law reads from it; itself under any other."""
        if self.efforts is None:
            return list(box)
        read = box[: self.n_x + self.n]
        return [*read, *values(self.efforts, [*read, *[ball(0)] * len(self.efforts.outputs)])]


def too_far_turned(loop: ClosedLoopEquations, box: Sequence[Ball]) -> str:
    """What is not proven of the angles that the programs count within half a turn, on a box of states, or nothing."""
    near = (abs(angle.target - box[angle.place]) < flint().arb.pi() for angle in loop.wrapped)
    return "" if all(near) and all(_is_upright(turn, box) for turn in loop.upright) else HALF_A_TURN


def _is_upright(turn: Upright, box: Sequence[Ball]) -> bool:
    """Whether w > 0 on a box of numbers."""
    p = box[turn.place : turn.place + 4]
    return bool(sum((a * b for a, b in zip(turn.reference, p, strict=True)), flint().arb(0)) > 0)
