"""What the entries are asked for: arguments checked, the closed loop recorded, and its motions' exact closed starts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, numbers, positive, step_or_infinite, vector, whole
from ccpin.control.control_law import ControlLaw
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import InvalidInputError
from ccpin.proof.facts import Fact, is_fact
from ccpin.validated.arithmetic.balls import Ball, ball, flint
from ccpin.validated.arithmetic.exact_numbers import ExactBox, boxed
from ccpin.validated.flow.marching import QUANTUM, StepOptions
from ccpin.validated.flow.motion_claim import MotionEnclosed
from ccpin.validated.flow.start_search import proved_start
from ccpin.validated.model.closed_loop import ClosedLoop, recorded_loop
from ccpin.validated.model.configurations import on_manifold, unwound


class MotionAsked(NamedTuple):
    """The motion that an enclosure is asked for.

    Attributes:
        q, v: Its start: a box of q and the doubles of q̇.
        x: The computed x of its branch.
        duration: In seconds.
    """

    q: ExactBox
    v: Array
    x: Array
    duration: float

    def is_of(self, motion: Fact | None) -> bool:
        """Whether a fact is about a motion from this start."""
        if not is_fact(motion, MotionEnclosed):
            return False
        start = motion.premises[0].claim
        near = self.x[list(start.equations.dependent)]
        known, own = (start.q, start.q_radius, start.near, start.v), (*self.q, near, self.v)
        return all(np.array_equal(*pair) for pair in zip(known, own, strict=True))


class MotionTask(NamedTuple):
    """Motions of a closed loop to be enclosed.

    Attributes:
        model: The reduced model.
        loop: It and its law, recorded.
        near: Chooses the branch of σ at a start.
        duration: Seconds.
        options: How to step.
        precision: In bits.
    """

    model: ReducedModel
    loop: ClosedLoop
    near: ArrayLike | None
    duration: float
    options: StepOptions
    precision: int

    def from_doubles(self, q0: ArrayLike, v0: ArrayLike | None) -> MotionAsked:
        """The motion from the closed configuration of doubles."""
        return self.asked(q0, exact_q(self.model, self.loop, numbers(q0, "q0")), velocity(self.model, v0))

    def asked(self, about: ArrayLike, q: Sequence[Ball], v: Array) -> MotionAsked:
        """That from numbers q at `independent` and v, on the branch of σ at the doubles `about`, which are about q."""
        x = self.loop.own.numbers(self.model.at(about, self.near).q_free)
        return MotionAsked(boxed(q, self.precision), v, x, self.duration)

    def start(self, asked: MotionAsked) -> Fact:
        """The fact about the exact closed start.

        Raises:
            ConvergenceError: It is not proven.
        """
        return proved_start(self.loop.equations, asked.q, asked.x, asked.v, self.precision)


def task_of(
    model: ReducedModel,
    law: ControlLaw | None,
    q0: ArrayLike,
    near: ArrayLike | None,
    duration: float,
    options: StepOptions,
    precision: int,
    *,
    held: bool = False,
) -> MotionTask:
    """Check how motions are to be enclosed, and record the loop about a start; `held`: with efforts held from samples.

    Raises:
        InvalidInputError: An option is out of its range.
        UnsupportedMechanismError: A mechanism or law outside the scope.
    """
    _check_options(duration, precision, options)
    with flint().ctx.workprec(precision):
        loop = recorded_loop(model, law, model.at(q0, near).q_free, held=held)
    return MotionTask(model, loop, near, duration, options, precision)


def _check_options(duration: float, precision: int, options: StepOptions) -> None:
    positive(duration, "duration")
    order, tolerance, pieces, shortest_step, longest_step = options
    if not (whole(precision, "precision", 53) <= 100_000 and whole(order, "order", 2) <= 1000):
        raise InvalidInputError(f"precision = {precision} and order = {order} are at most 100,000 bits and 1000")
    if not whole(pieces, "pieces") <= 10_000:
        raise InvalidInputError(f"pieces = {pieces} are at most 10,000")
    positive(tolerance, "tolerance"), positive(shortest_step, "shortest_step")
    step_or_infinite(longest_step, "longest_step")
    if not 2.0**-precision < tolerance < 1:
        raise InvalidInputError(f"tolerance = {tolerance} must lie between 2^-precision and 1")
    if not QUANTUM <= shortest_step <= longest_step:
        raise InvalidInputError(f"the shortest step {shortest_step} must be at least 2⁻⁴⁰ s and at most the longest")


def velocity(model: ReducedModel, v0: ArrayLike | None) -> Array:
    """The doubles of q̇ at a start, of shape (n,); default at rest."""
    return np.zeros(model.n) if v0 is None else vector(v0, "v0", model.n)


def exact_q(model: ReducedModel, loop: ClosedLoop, q: Array) -> list[Ball]:
    """The numbers at `loop.independent` of an exact q of shape (model.nq,)."""
    found = list[Ball]()
    for part in model.coordinates.parts:
        held = [ball(float(x)) for x in q[part.q]]
        if part.whole is not None:
            held = on_manifold(part.kind, held)
        if part.kind.unit == 2 and not part.slides[-1]:
            near = loop.own.near[loop.equations.independent[len(found) + len(held) - 1]]
            held[-1] = unwound(held[-1], float(near))
        found += held
    return found


def on_circles(model: ReducedModel, q: Array) -> Array:
    """The q of shape (model.nq,) of one number for each velocity: of an angle its point on the circle."""
    parts = [
        q[part.v] if part.whole is None else [np.cos(q[part.v.start]), np.sin(q[part.v.start])]
        for part in model.coordinates.parts
    ]
    return np.concatenate(parts)
