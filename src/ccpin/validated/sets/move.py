"""`certify_move`: a proof that a motion ends in the sublevel set from which Theorem 3 takes over.

Theorem A of `ccpin/proof/theorems/arrival.md`, and with `spread` its corollary. Its 1 is `march`, or of a set `cover`;
2 is asked of `lyapunov`, or of a set of `SetArrival`; 3 and 4 are `unconnected`. Where one tube does not do, the starts
are cut into parts with a tube each (`ccpin.validated.sets.subdivision`).

A level that was only sampled makes the conclusion only as good as the level; the result says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import positive
from ccpin.control.control_law import kind_of
from ccpin.control.laws import PDSimpleGravity
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.errors import InvalidInputError
from ccpin.mechanism.assumptions import limits_left_out, without_dry_friction
from ccpin.mechanism.mechanism import Mechanism
from ccpin.proof.digests import digest, require_same
from ccpin.proof.verdict import Judged, Verdict, Witness
from ccpin.validated.arithmetic.balls import Ball, flint, lower, upper
from ccpin.validated.flow.crossing import witness_of
from ccpin.validated.flow.enclosure import Enclosure, proved_motion, told_of
from ccpin.validated.flow.marching import StepOptions, march
from ccpin.validated.flow.motion_task import MotionAsked, MotionTask, task_of
from ccpin.validated.flow.proved_steps import ProvedSteps
from ccpin.validated.flow.start_claim import state_of
from ccpin.validated.flow.step import ProvenStep, start_box
from ccpin.validated.sets.arrival import RETRY, Goal, SetArrival, goal_of, lyapunov, single_valued, unconnected
from ccpin.validated.sets.set_enclosure import checked_cut, starts_of, told
from ccpin.validated.sets.subdivision import Starts, Tube, TubeTask, cover, proved_set

_NEVER = (
    "at t = {:.6g} s 𝒱 < {:.6g} J, below its value 0 at the set point, and 𝒱 never rises: the motion does not arrive"
)
_MORE = "more pieces=, a higher order= or precision= may do more"


class Certificate(Protocol):
    """What a certified set point says, as a `SetPointCertificate` of `ccpin.control.stability.set_point` does."""

    @property
    def law(self) -> PDSimpleGravity:
        """The law that it is about."""

    @property
    def level(self) -> float:
        """The level c in joules."""

    @property
    def rigorous(self) -> bool:
        """Whether it is proven."""


@dataclass(frozen=True, eq=False, repr=False)
class MoveCertificate(Judged):
    """What was proven of a move.

    Attributes:
        verdict: ``"proven"``: the theorem's hypotheses hold, the motion converges to the set point. ``"refuted"``: it
            does not, as 𝒱 < 0 at T: 𝒱 never rises along the motion, and is 0 at the set point (said only where 𝒱 is
            one function of the state: a continuous joint may arrive one turn on, where it is another).
            ``"undecided"``: neither.
        reason: The verdict in a sentence, with what was spent and what more would do.
        witness: The state at T that refutes (its velocity is the enclosure's).
        time: T in seconds, the last part's of a set (the end of the enclosure where undecided).
        lyapunov_start: A lower bound of 𝒱 at the start, in joules; of a set, in its middle.
        lyapunov: An upper bound of 𝒱 at T, in joules, on all of a set.
        level: c in joules.
        rigorous: Whether c came with a certificate that calls it proven; with a plain number that is the caller's part.
        enclosure: The motion up to T; of a set, that from the middle of its first part.
        tubes: All motions of a set up to T, a tube a part; none without a spread.
        assumes: The limits that the mechanism states and that are taken not to be met (of dry friction: `reason`).
    """

    verdict: Verdict
    reason: str
    witness: Witness | None
    time: float
    lyapunov_start: float
    lyapunov: float
    level: float
    rigorous: bool
    enclosure: Enclosure
    tubes: tuple[Tube, ...] = ()
    assumes: tuple[str, ...] = ()


def certify_move(
    model: ReducedModel | Mechanism,
    law: PDSimpleGravity,
    q0: ArrayLike,
    v0: ArrayLike | None = None,
    *,
    arrival: Certificate | float,
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
    model, (level, rigorous) = model_of(model), _level(arrival, law)
    require_same("a certified move", law.digests, model.digests, "closures", "dynamics")
    sampled = not rigorous and not isinstance(arrival, int | float)
    cut = checked_cut(parts, cells, np.inf)
    task = task_of(model, law, q0, near, duration, StepOptions(order, tolerance, pieces), precision)
    with flint().ctx.workprec(precision):
        goal, starts = goal_of(task.loop, law, level), starts_of(task, q0, v0, spread)
        if starts.spread.any():
            inside = SetArrival(task.loop, goal, task.options, cells)
            move = _of_a_set(TubeTask(task, cut, inside), starts, parts)
        else:
            move = _of_one(task, task.from_doubles(q0, v0), goal)
    if move.verdict == "proven" and sampled:
        move = replace(move, verdict="undecided", reason=f"{move.reason}, but that level was only sampled: certify it")
    reason = move.reason + without_dry_friction(model.mechanism)
    assumes = limits_left_out(model.mechanism)
    return replace(move, reason=reason, level=level, rigorous=rigorous, assumes=assumes)


def _of_one(task: MotionTask, asked: MotionAsked, goal: Goal) -> MoveCertificate:
    """What is proven of one start (its level is the caller's)."""
    loop, fact = task.loop, task.start(asked)
    start = state_of(fact).balls()
    run = _run(task, start, goal)
    motion, refused = proved_motion(loop.equations, fact, run.steps, [], task.precision)
    if not run.stopped:
        asked = asked._replace(duration=float(motion.found["times"][-1]))
    enclosure = told_of(loop, asked, motion, refused or run.stopped)
    if refused:
        run = _Outcome("undecided", refused, [], refused)
    end = start_box(run.steps[-1].end) if run.steps else start
    return MoveCertificate(
        run.verdict,
        run.reason,
        witness_of("state", loop, end) if run.verdict == "refuted" else None,
        float(enclosure.times[-1]),
        lower(lyapunov(loop.equations, goal, start)),
        upper(lyapunov(loop.equations, goal, end)),
        goal.level,
        False,
        enclosure,
    )


def _of_a_set(task: TubeTask, starts: Starts, parts: int) -> MoveCertificate:
    """What is proven of a set of starts (its level is the caller's)."""
    arrival = task.arrived
    assert isinstance(arrival, SetArrival)
    found = cover(task, starts, parts)
    tubes, middle = found.tubes, found.tubes[0].enclosure
    covered, missing = proved_set(task.motion.loop.equations, starts, found, min(tube.duration for tube in tubes))
    verdict: Verdict = "undecided" if covered is None else "proven"
    time = max(tube.duration for tube in tubes)
    reason = told(tubes, missing, parts)
    if verdict == "proven":
        reason = f"in {len(tubes)} tubes all motions are in B₂ from t = {time:.6g} s on: 𝒱 < {arrival.largest:.6g} J"
    at_start = lower(lyapunov(task.motion.loop.equations, arrival.goal, middle.start))
    highest = arrival.largest if verdict == "proven" else np.inf
    return MoveCertificate(
        verdict, reason, None, time, at_start, highest, arrival.goal.level, False, middle, tuple(tubes)
    )


class _Outcome(NamedTuple):
    verdict: Verdict
    reason: str
    steps: list[ProvenStep]
    stopped: str


def _run(task: MotionTask, start: Sequence[Ball], goal: Goal) -> _Outcome:
    """Step until Theorem A's 1–4 hold, or until 𝒱 < 0 where that says that the motion never arrives."""
    loop, own, options = task.loop, task.loop.equations, task.options
    steps: list[ProvenStep] = []
    time, ask_below, missing, never = 0.0, goal.level, "𝒱 is not below the level", single_valued(loop, goal.law)
    if (value := upper(lyapunov(own, goal, start))) < 0.0 and never:
        return _Outcome("refuted", _NEVER.format(time, value), steps, "")
    for step in march(ProvedSteps(own, task.precision), start, task.duration, options):
        if not isinstance(step, ProvenStep):
            told = f"rigour stops at t = {time:.9g} s after {len(steps)} steps: {step.reason}"
            return _Outcome("undecided", f"{told}; {_MORE}", steps, step.reason)
        steps.append(step)
        time += step.length
        end = start_box(step.end)
        value = upper(lyapunov(own, goal, end))
        if value < 0.0 and never:
            return _Outcome("refuted", _NEVER.format(time, value), steps, "")
        if value < ask_below:
            missing = unconnected(loop, end, goal, options)
            if not missing:
                return _Outcome("proven", f"from t = {time:.6g} s on the motion is in B₂: 𝒱 < {value:.6g} J", steps, "")
            ask_below = RETRY * value
    told = f"not proven to arrive within {time:.6g} s and {len(steps)} steps: {missing}"
    return _Outcome("undecided", f"{told}; a longer duration= or {_MORE}", steps, "")


def _level(arrival: Certificate | float, law: PDSimpleGravity) -> tuple[float, bool]:
    """The level, and whether its certificate says it is proven (a plain number has none); K_v is no part of it.

    Raises:
        InvalidInputError: It is not a positive number.
        DifferentSubjectsError: It is another law's, or that of a law of another mechanism.
    """
    if not isinstance(getattr(arrival, "level", None), float):
        level, rigorous = positive(arrival, "arrival", "a set-point certificate or a positive number of joules"), False
    else:
        assert not isinstance(arrival, int | float)
        level, rigorous = float(arrival.level), bool(arrival.rigorous)
        ours, theirs = (
            one.digests._replace(law=digest((one.q_d, one.K_p, one.gravity_d))) for one in (law, arrival.law)
        )
        require_same("arrival at a set point", ours, theirs, "closures", "dynamics", "law")
    if not (np.isfinite(level) and level > 0):
        raise InvalidInputError(f"the certified level c = {level} J must be a positive number")
    return level, rigorous
