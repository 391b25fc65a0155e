"""`enclose`: a trajectory of the closed loop with a proof, and σ certified along it.

Theorem M of `ccpin/proof/theorems/enclosure.md`; it also says which numbers the mechanism's and the law's are taken to
be. Its 1 is `MotionTask.start`, its 2 `march`, its 3 `regular`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, frozen, numbers
from ccpin.control.control_law import ControlLaw, idle
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.errors import InvalidInputError
from ccpin.mechanism.assumptions import without_dry_friction
from ccpin.mechanism.mechanism import Mechanism
from ccpin.proof.verdict import Judged, Verdict, Witness
from ccpin.validated.arithmetic.ball_arrays import of_balls
from ccpin.validated.arithmetic.balls import Ball, around, ball, bounds, centre_of, flint, hull, magnitude, upper
from ccpin.validated.arithmetic.series import gradients, values
from ccpin.validated.flow.crossing import Crossing, find_crossing
from ccpin.validated.flow.defect import sizes_along
from ccpin.validated.flow.motion_task import task_of
from ccpin.validated.flow.regularity import regular
from ccpin.validated.flow.step import SHORTEST_STEP, ProvenStep, StepOptions, march, start_box, start_of
from ccpin.validated.model.closed_loop import ClosedLoop
from ccpin.validated.model.recorded_coordinates import configuration


class StateBox(NamedTuple):
    """A box of states of doubles, rounded outwards.

    Attributes:
        q_free: Centre of q′, of shape (n′,).
        q_free_radius: Half-widths, alike.
        v: Centre of q̇, of shape (n,).
        v_radius: Half-widths, alike.
    """

    q_free: Array
    q_free_radius: Array
    v: Array
    v_radius: Array


@dataclass(frozen=True, eq=False, repr=False)
class Enclosure(Judged):
    """A proven enclosure of one trajectory of K steps.

    Attributes:
        times: Ends of the steps, exact, of shape (K + 1,), in seconds.
        q_free, q_free_radius: A box around q′ at those times, of shape (K + 1, nq), rad or m.
        v, v_radius: A box around q̇ at those times, of shape (K + 1, n); of a sampled loop around q̇ and the efforts.
        q_free_lower, q_free_upper: A box around q′ during each step, of shape (K, nq).
        v_lower, v_upper: A box around q̇ during each step, of shape (K, n).
        determinant: A lower bound of |det ψ_q′| on each step's box, positive, of shape (K,).
        left_open: An upper bound of the size of φ's redundant rows during each step, m and rad, of shape (K,).
        verdict: ``"proven"``: the motion is closed and nonsingular over the whole time asked for. ``"refuted"``: it
            meets a singular configuration within that time, `witness` (Theorem X of
            `ccpin/proof/theorems/crossing.md`; free motions only).
            ``"undecided"``: it is enclosed up to ``times[-1]``, and what comes then is not known.
        reason: The verdict in a sentence, with what stopped the enclosure and which argument to raise.
        witness: The singular configuration met, where refuted.
        precision: Working precision in bits.
        loop: The programs that were integrated.
        steps: What was proven of each step, in balls.
        start: The exact closed start, in the numbers that hold q′ in `loop`'s programs, and q̇.
    """

    times: Array
    q_free: Array
    q_free_radius: Array
    v: Array
    v_radius: Array
    q_free_lower: Array
    q_free_upper: Array
    v_lower: Array
    v_upper: Array
    determinant: Array
    left_open: Array
    verdict: Verdict
    reason: str
    witness: Witness | None
    precision: int
    loop: ClosedLoop
    steps: tuple[ProvenStep, ...]
    start: tuple[Ball, ...]

    @property
    def smallest_determinant(self) -> float:
        """A lower bound of |det ψ_q′| along the whole trajectory (infinite without steps)."""
        return float(self.determinant.min(initial=np.inf))

    def box(self, t: float) -> list[Ball]:
        """The state (q′, q̇) at a time as balls, sharp: the Taylor polynomial and its proven error.

        Raises:
            InvalidInputError: The time is not covered.
        """
        with flint().ctx.workprec(self.precision):
            return _told(self.loop, self.inputs(t))

    def inputs(self, t: float) -> list[Ball]:
        """`box` in the numbers that the programs of `loop` take: of a circle in q′ the angle."""
        if not 0.0 <= t <= self.times[-1]:
            raise InvalidInputError(f"t = {t} s is not covered: the enclosure reaches from 0 to {self.times[-1]:.9g} s")
        k = min(int(np.searchsorted(self.times, t, side="right")) - 1, len(self.steps) - 1)
        if k < 0:
            return list(self.start)
        with flint().ctx.workprec(self.precision):
            return self.steps[k].box(ball(float(t)) - ball(float(self.times[k])))

    def at(self, t: float) -> StateBox:
        """The box of `box` in doubles."""
        return _bounds(self.loop, self.inputs(t))

    def contains(self, t: float, q_free: ArrayLike, v: ArrayLike, tolerance: float = 0.0) -> bool:
        """Whether (q′, q̇) is in the sharp box at a time, widened by a tolerance (an integrator's, say).

        A quaternion and its negative are one rotation.
        """
        box = self.box(t)
        state = np.concatenate([self._nearest(numbers(q_free, "q_free"), box), numbers(v, "v")])
        with flint().ctx.workprec(self.precision):
            slack = ball(tolerance)
            return all(around(x, slack).contains(ball(float(s))) for x, s in zip(box, state, strict=True))

    def _nearest(self, q_free: Array, box: Sequence[Ball]) -> Array:
        """Q′ with the signs of its quaternions as in a box."""
        signed = q_free.copy()
        for joint in self.loop.joints:
            if joint.kind.unit == 4:
                p = slice(joint.q.stop - 4, joint.q.stop)
                signed[p] *= np.copysign(1.0, signed[p] @ centre_of(box[p]))
        return signed

    def energy(self, t: float) -> Ball:
        """Kinetic and potential energy at a time, in joules, as a ball."""
        with flint().ctx.workprec(self.precision):
            kinetic, potential = values(self.loop.energies, self.inputs(t))
            return kinetic + potential


def enclose(
    model: ReducedModel | Mechanism,
    law: ControlLaw | None,
    q0: ArrayLike,
    v0: ArrayLike | None,
    duration: float,
    *,
    near: ArrayLike | None = None,
    precision: int = 128,
    order: int = 30,
    tolerance: float = 1e-18,
    pieces: int = 16,
    shortest_step: float = SHORTEST_STEP,
    longest_step: float = np.inf,
) -> Enclosure:
    """Enclose the closed loop's exact trajectory, or say where the proof stops.

    Args:
        model: The reduced model (or a mechanism).
        law: `PDSimpleGravity`, `PDFullGravity`, `NoTorque` or ``None`` for no torque.
        q0: Start, of shape (model.nq,): the exact doubles.
        v0: Velocity at the start, of shape (n,), exact; default at rest.
        duration: Time in seconds (rounded up to a multiple of 2⁻⁴⁰ s).
        near: Chooses the branch of σ(q0); default the mechanism's reference.
        precision: Working precision in bits.
        order: Order N of the Taylor steps.
        tolerance: Remainder allowed to one step, in rad, m and per second; keep it well above 2^−precision.
        pieces: Boxes per step. More are slower and let errors grow less.
        shortest_step: Where no step of this length (s) can be proven the enclosure stops.
        longest_step: Longest step in seconds.

    Raises:
        CcpinError: python-flint is not installed.
        InvalidInputError: A bad argument.
        UnsupportedMechanismError: A mechanism or law outside the scope.
        ConvergenceError: The exact closed start is not proven to exist.
    """
    model = model_of(model)
    options = StepOptions(order, tolerance, pieces, shortest_step, longest_step)
    task = task_of(model, law, q0, near, duration, options, precision)
    with flint().ctx.workprec(precision):
        loop, start = task.loop, task.start(q0, v0)
        steps, reason = [], ""
        for step in march(regular(loop), start, duration, options):
            if not isinstance(step, ProvenStep):
                reason = step.reason
                break
            steps.append(step)
        met = None
        if reason and steps and idle(law):
            since = sum(step.length for step in steps)
            met = find_crossing(model, loop, start_box(steps[-1].end), since, duration - since, options)
        found = collect(loop, start, steps, reason, precision, met)
    return replace(found, reason=found.reason + without_dry_friction(model.mechanism))


def collect(
    loop: ClosedLoop,
    start: Sequence[Ball],
    steps: Sequence[ProvenStep],
    reason: str,
    precision: int,
    met: Crossing | None = None,
) -> Enclosure:
    """The enclosure that proven steps make; `reason` says why it ended early, if it did, `met` what it then met."""
    nodes = [_bounds(loop, start_box(s)) for s in (start_of(start), *(step.end for step in steps))]
    columns: StateBox = StateBox(*(frozen(column) for column in zip(*nodes, strict=True)))
    during = [bounds(hull([_told(loop, box) for box in step.boxes])) for step in steps]
    split = columns.q_free.shape[1]
    size = split + columns.v.shape[1]
    below, above = np.moveaxis(np.reshape(during, (len(steps), 2, size)), 1, 0)
    times = np.concatenate([[0.0], np.cumsum([step.length for step in steps])])
    told = f"closed and nonsingular for {times[-1]:.9g} s, in {len(steps)} steps"
    if met is not None:
        told = f"the motion is singular at a time between t = {met.after:.9g} s and {met.before:.9g} s"
    elif reason:
        told = (
            f"rigour stops at t = {times[-1]:.9g} s after {len(steps)} steps: {reason}; more pieces=, a higher order= "
            "or precision=, or a smaller shortest_step= may lead farther"
        )
    return Enclosure(
        **columns._asdict(),
        times=frozen(times),
        q_free_lower=frozen(below[:, :split]),
        q_free_upper=frozen(above[:, :split]),
        v_lower=frozen(below[:, split:]),
        v_upper=frozen(above[:, split:]),
        determinant=frozen([step.quantity for step in steps]),
        left_open=frozen([left_open(loop, step) for step in steps]),
        verdict="refuted" if met else "undecided" if reason else "proven",
        reason=told,
        witness=met.witness if met else None,
        precision=precision,
        loop=loop,
        steps=tuple(steps),
        start=tuple(start),
    )


def left_open(loop: ClosedLoop, step: ProvenStep) -> float:
    """An upper bound of |φ_i| along a step for the rows of φ left out as redundant; 0 where there are none.

    φ_i(x(t)) is φ_i(p(t)), whose Taylor series `defect` bounds, and at most |∂φ_i/∂x| times the error off that.
    """
    if loop.left_out is None:
        return 0.0
    length = ball(step.length)
    along = sizes_along(loop.left_out, step.polynomial, length)
    slopes = gradients(loop.left_out, hull(step.boxes))
    off = (sum((magnitude(a) * e for a, e in zip(row, step.error, strict=True)), ball(0)) for row in slopes)
    return max(upper(size + change) for size, change in zip(along, off, strict=True))


def _told(loop: ClosedLoop, box: Sequence[Ball]) -> list[Ball]:
    """A box of (x, q̇, …) as one of (q′, q̇, …)."""
    return [*configuration(loop.joints, box), *box[loop.n_x :]]


def _bounds(loop: ClosedLoop, box: Sequence[Ball]) -> StateBox:
    box, n_free = _told(loop, box), loop.joints[-1].q.stop
    centre, radius = of_balls([box]).at(0)
    return StateBox(centre[:n_free], radius[:n_free], centre[n_free:], radius[n_free:])
