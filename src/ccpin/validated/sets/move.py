"""`certify_move`: a proof that a motion ends in the sublevel set from which Theorem 3 takes over.

Theorem A of `ccpin/proof/theorems/arrival.md`, and with `spread` its corollary. `march`, or of a set `cover`, and
`connection` propose; `Arrived`, `SetArrived` and `NeverArrives` are what is proved. Where one tube does not do, the
starts are cut into parts with a tube each (`ccpin.validated.sets.subdivision`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import positive
from ccpin.control.control_law import kind_of
from ccpin.control.laws import PDSimpleGravity
from ccpin.control.stability.set_point.set_point_certificate import SetPointCertificate
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.errors import InvalidInputError
from ccpin.mechanism.assumptions import limits_left_out, without_dry_friction
from ccpin.mechanism.mechanism import Mechanism
from ccpin.proof.digests import digest, require_same
from ccpin.proof.facts import Fact, NotProvedError, prove
from ccpin.validated.arithmetic.balls import Ball, flint
from ccpin.validated.arithmetic.exact_numbers import exact_box
from ccpin.validated.flow.enclosure import proved_motion, told_of
from ccpin.validated.flow.marching import StepOptions, march
from ccpin.validated.flow.motion_task import MotionAsked, MotionTask, task_of
from ccpin.validated.flow.proved_steps import ProvedSteps
from ccpin.validated.flow.start_claim import state_of
from ccpin.validated.flow.step import ProvenStep, start_box
from ccpin.validated.sets.arrival import RETRY, Goal, SetArrival, WayToGoal, connection, goal_of
from ccpin.validated.sets.arrival_claim import NeverArrives
from ccpin.validated.sets.arrival_reading import arrival_equations_of
from ccpin.validated.sets.proved_move import MoveCertificate
from ccpin.validated.sets.set_enclosure import checked_cut, starts_of, told
from ccpin.validated.sets.subdivision import Starts, TubeTask, cover, proved_set

_MORE = "more pieces=, a higher order= or precision= may do more"


def certify_move(
    model: ReducedModel | Mechanism,
    law: PDSimpleGravity,
    q0: ArrayLike,
    v0: ArrayLike | None = None,
    *,
    arrival: SetPointCertificate | float,
    duration: float = 1.0,
    near: ArrayLike | None = None,
    spread: ArrayLike | tuple[ArrayLike, ArrayLike] = 0.0,
    parts: int = 16,
    cells: int = 8,
    precision: int = 128,
    order: int = 30,
    tolerance: float = 1e-18,
    pieces: int = 16,
) -> MoveCertificate:
    """Prove that a motion under PD with simple gravity compensation ends at its set point.

    Args:
        model: The reduced model, or a mechanism.
        law: The law.
        q0: Start, of shape (n,), exact doubles.
        v0: Velocity at the start; default at rest.
        arrival: The level c: a set-point certificate of this law, or a number of joules known to be a certified level.
        duration: How long to wait for the motion to arrive, in seconds.
        near: Chooses the branch of the start.
        spread: How far starts may be from q0 and v0, as for `ccpin.validated.enclose_set`.
        parts: As there.
        cells: As there.
        precision: As for `ccpin.validated.enclose`.
        order: As there.
        tolerance: As there.
        pieces: As there.

    Raises:
        CcpinError: python-flint is not installed.
        InvalidInputError: A bad argument, or another law.
        DifferentSubjectsError: The law is of another mechanism than the model, or the certificate of another law.
        UnsupportedMechanismError, ConvergenceError: As for `ccpin.validated.enclose`.
    """
    if kind_of(law) != "pd":
        raise InvalidInputError("the level certified is about PD with simple gravity compensation: pass that law")
    model, (level, sublevel) = model_of(model), _level(arrival, law)
    require_same("a certified move", law.digests, model.digests, "closures", "dynamics")
    cut = checked_cut(parts, cells, np.inf)
    task = task_of(model, law, q0, near, duration, StepOptions(order, tolerance, pieces), precision)
    set_point = None if sublevel is None else sublevel.claim.equations
    with flint().ctx.workprec(precision):
        equations = arrival_equations_of(task, law, set_point)
        goal, starts = goal_of(equations, level, sublevel, task.options, precision), starts_of(task, q0, v0, spread)
        if starts.spread.any():
            move = _of_a_set(TubeTask(task, cut, SetArrival(goal)), starts, parts)
        else:
            move = _of_one(task, task.from_doubles(q0, v0), goal)
    if move.verdict == "proven" and sublevel is None and isinstance(arrival, SetPointCertificate):
        move = replace(move, proved=None, stopped=f"{move.reason}, but that level is not proved: certify it")
    without, assumes = without_dry_friction(model.mechanism), limits_left_out(model.mechanism)
    return replace(move, level=level, without=without, assumes=assumes)


def _of_one(task: MotionTask, asked: MotionAsked, goal: Goal) -> MoveCertificate:
    """What is proven of one start."""
    loop, start = task.loop, task.start(asked)
    run = _run(task, state_of(start).balls(), goal)
    motion, refused = proved_motion(loop.equations, start, run.steps, [], task.precision)
    if not run.stopped:
        asked = asked._replace(duration=float(motion.found["times"][-1]))
    enclosure = told_of(loop, asked, motion, refused or run.stopped)
    proved, missing = None, refused or run.missing
    if not missing:
        proved, missing = _proved(goal, motion, run.joined)
    return MoveCertificate(goal.equations, goal.level, enclosure, goal.point, proved, missing)


def _proved(goal: Goal, motion: Fact, joined: WayToGoal | None) -> tuple[Fact | None, str]:
    """The fact that a motion arrives, or never does where nothing joins it to the set point; or what is refused."""
    never = NeverArrives(goal.equations, np.array([goal.precision]))
    try:
        return prove(never, motion, goal.point) if joined is None else goal.arrived(motion, joined), ""
    except NotProvedError as refused:
        return None, str(refused)


def _of_a_set(task: TubeTask, starts: Starts, parts: int) -> MoveCertificate:
    """What is proven of a set of starts."""
    search = task.arrived
    assert isinstance(search, SetArrival)
    goal, found = search.goal, cover(task, starts, parts)
    tubes, proved = found.tubes, None
    shortest = min(tube.duration for tube in tubes)
    covered, missing = proved_set(task.motion.loop.equations, starts, found, shortest)
    if covered is not None:
        try:
            arrived = [goal.arrived(tube, search.joined[tube.premises[-1]]) for tube in covered.premises]
            proved = goal.all_arrived(covered, arrived)
        except NotProvedError as refused:
            missing = str(refused)
    stopped = told(tubes, missing, parts) if missing else ""
    return MoveCertificate(
        goal.equations, goal.level, tubes[0].enclosure, goal.point, proved, stopped, starts, tuple(tubes)
    )


class _Outcome(NamedTuple):
    """Where steps of a motion end.

    Attributes:
        steps: They.
        missing: What is not proven there; nothing: the motion is joined to the set point, or never arrives.
        joined: What joins it to the set point.
        stopped: Why there is no next step; nothing where none was due.
    """

    steps: list[ProvenStep]
    missing: str = ""
    joined: WayToGoal | None = None
    stopped: str = ""


def _run(task: MotionTask, start: Sequence[Ball], goal: Goal) -> _Outcome:
    """Step until Theorem A's 1–4 hold, or until 𝒱 < 0 where that says that the motion never arrives."""
    own, options, never = task.loop.equations, task.options, goal.equations.single
    steps: list[ProvenStep] = []
    time, ask_below, missing = 0.0, goal.level, "𝒱 is not below the level"
    if goal.highest(start) < 0.0 and never:
        return _Outcome(steps)
    for step in march(ProvedSteps(own, task.precision), start, task.duration, options):
        if not isinstance(step, ProvenStep):
            words = f"rigour stops at t = {time:.9g} s after {len(steps)} steps: {step.reason}"
            return _Outcome(steps, f"{words}; {_MORE}", stopped=step.reason)
        steps.append(step)
        time += step.length
        value = goal.highest(start_box(step.end))
        if value < 0.0 and never:
            return _Outcome(steps)
        if value < ask_below:
            joined = connection(goal, exact_box(*step.end, task.precision))
            if isinstance(joined, WayToGoal):
                return _Outcome(steps, joined=joined)
            missing, ask_below = joined, RETRY * value
    words = f"not proven to arrive within {time:.6g} s and {len(steps)} steps: {missing}"
    return _Outcome(steps, f"{words}; a longer duration= or {_MORE}")


def _level(arrival: SetPointCertificate | float, law: PDSimpleGravity) -> tuple[float, Fact | None]:
    """The level, and the fact that it is Theorem 3's, where there is one; K_v is no part of it.

    Raises:
        InvalidInputError: It is not a positive number.
        DifferentSubjectsError: It is another law's, or that of a law of another mechanism.
    """
    if not isinstance(arrival, SetPointCertificate):
        return positive(arrival, "arrival", "a set-point certificate or a positive number of joules"), None
    ours, theirs = (one.digests._replace(law=digest((one.q_d, one.K_p, one.gravity_d))) for one in (law, arrival.law))
    require_same("arrival at a set point", ours, theirs, "closures", "dynamics", "law")
    if not (np.isfinite(arrival.level) and arrival.level > 0):
        raise InvalidInputError(f"the certified level c = {arrival.level} J must be a positive number")
    return float(arrival.level), arrival.sublevel if arrival.verdict == "proven" else None
