"""`certify_move`: a proof that a motion ends in the sublevel set from which Theorem 3 takes over.

Theorem. Let the law be PD with simple gravity compensation (28) and c a level such that every state of

    B₂ = {(σ(q), q̇): q ∈ 𝒬, 𝒱 < c},    𝒬 the connected component of {q: U(q) < c} that holds q_d,    U = 𝒱 at q̇ = 0,

on q_d's branch of σ leads to rest at q_d (Theorem 3 with c certified, `ccpin.control.stability.theorem3`). Suppose

1. the motion from the start exists on [0, T], closed and nonsingular (`ccpin.validated.enclose`), and its state at T
   lies in a box X = (Q′, V) of which Q are the independent coordinates;
2. 𝒱 < c on X;
3. with w = q_d − (the centre of Q), the lift of every line q + s w, 0 ≤ s ≤ 1, from the closed configurations in Q′ by
   dq′/ds = ρ(q′) w, exists in boxes on which ψ_q′ is nonsingular and U < c;
4. its end, a box about σ(q_d), lies in a box in which ψ̄(q′, q) = 0 has one solution for each q of the end (Krawczyk),
   and U < c on the convex hull of the end and q_d, a box.

Then the motion exists for all time, ψ_q′ is nonsingular along it, and it converges to (q_d, 0).

Proof. By 1 and 2 the state at T has 𝒱 < c. By 3 the line from q(T), lifted continuously from q′(T), stays in {U < c}
without meeting a singularity and ends within the radius of Q of q_d; by 4 it ends on the branch of σ(q_d) and is joined
to q_d inside {U < c}. So q(T) ∈ 𝒬 and q′(T) = σ(q(T)) on that branch: the state at T is in B₂. ∎

With `spread` the statement is about every start within it. Let the motion from the middle of the starts satisfy 1., 3.
and 4., and let at T every motion be in the cross-section S = {ξ̄ + Az, |z| ≤ u} of a tube (`ccpin.validated.tube`),
with 𝒱 < c on S. Then they all converge to (q_d, 0). For a state of S the segment to ξ̄ lies in S, σ is one analytic
function on its q's, and U ≤ 𝒱 < c along it: its q is joined to ξ̄'s in {U < c} on one branch, and so to q_d. ∎ Where one
tube does not do, the starts are cut into parts with a tube each (`ccpin.validated.tubes`).

A level that was only sampled makes the conclusion only as good as the level; the result says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import positive
from ccpin.control.laws import PDSimpleGravity
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.errors import InvalidInputError
from ccpin.mechanism.left_out import limits_left_out, without_dry_friction
from ccpin.mechanism.mechanism import Mechanism
from ccpin.proof.digests import digest, require_same
from ccpin.proof.verdict import Verdict, Witness
from ccpin.validated.arrival import Goal, SetArrival, goal_of, lyapunov, single_valued, unconnected
from ccpin.validated.balls import Ball, flint, lower, upper
from ccpin.validated.crossing import witness_of
from ccpin.validated.dynamics import ClosedLoop, closed_loop
from ccpin.validated.enclose import SHORTEST_STEP, Enclosure, checked_options, collect, exact_start, regular
from ccpin.validated.sets import checked_cut, job_of, starts_of, told
from ccpin.validated.step import Options, Step, march, start_box
from ccpin.validated.tubes import Job, Starts, Tube, cover

_RETRY = 0.9
_NEVER = (
    "at t = {:.6g} s 𝒱 < {:.6g} J, below its value 0 at the set point, and 𝒱 never rises: the motion does not arrive"
)
_MORE = "more pieces=, a higher order= or precision= may do more"


class Certificate(Protocol):
    """What a certified set point says, as `ccpin.control.stability.theorem3.SetPointCertificate` does."""

    @property
    def law(self) -> PDSimpleGravity:
        """The law that it is about."""

    @property
    def level(self) -> float:
        """The level c in joules."""

    @property
    def rigorous(self) -> bool:
        """Whether it is proven."""


@dataclass(frozen=True, eq=False)
class MoveCertificate:
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

    def __repr__(self) -> str:
        return f"MoveCertificate({self.verdict}: {self.reason})"


def certify_move(
    model: ReducedModel | Mechanism,
    law: PDSimpleGravity,
    q0: ArrayLike,
    v0: ArrayLike | None = None,
    *,
    arrival: Certificate | float,
    duration: float = 1.0,
    guess: ArrayLike | None = None,
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
        guess: Chooses the branch of the start.
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
    if not isinstance(law, PDSimpleGravity):
        raise InvalidInputError("the level certified is about PD with simple gravity compensation: pass that law")
    model, (level, rigorous) = model_of(model), _level(arrival, law)
    require_same("a certified move", law.digests, model.digests, "closures", "dynamics")
    sampled = not rigorous and not isinstance(arrival, int | float)
    options = checked_options(duration, precision, Options(order, tolerance, pieces, SHORTEST_STEP, np.inf))
    cut = checked_cut(parts, cells, np.inf)
    with flint().ctx.workprec(precision):
        loop = closed_loop(model, law, model.at(q0, guess).q_free)
        goal = goal_of(loop, law, level)
        starts = starts_of(model, loop, q0, v0, spread)
        if starts.spread.any():
            inside = SetArrival(loop, goal, options, cells)
            move = _of_a_set(job_of(model, loop, guess, duration, options, precision, cut, inside), starts, parts)
        else:
            start = exact_start(model, loop, q0, v0, guess)
            move = _of_one(loop, start, goal, duration, options, precision)
    if move.verdict == "proven" and sampled:
        move = replace(move, verdict="undecided", reason=f"{move.reason}, but that level was only sampled: certify it")
    reason = move.reason + without_dry_friction(model.mechanism)
    assumes = limits_left_out(model.mechanism)
    return replace(move, reason=reason, level=level, rigorous=rigorous, assumes=assumes)


def _of_one(
    loop: ClosedLoop, start: list[Ball], goal: Goal, duration: float, options: Options, precision: int
) -> MoveCertificate:
    """What is proven of one start (its level is the caller's)."""
    run = _run(loop, start, goal, duration, options)
    enclosure = collect(loop, start, run.steps, run.stopped, precision)
    end = start_box(run.steps[-1].end) if run.steps else start
    return MoveCertificate(
        run.verdict,
        run.reason,
        witness_of("state", loop, end) if run.verdict == "refuted" else None,
        float(enclosure.times[-1]),
        lower(lyapunov(loop, goal, start)),
        upper(lyapunov(loop, goal, end)),
        goal.level,
        False,
        enclosure,
    )


def _of_a_set(job: Job, starts: Starts, parts: int) -> MoveCertificate:
    """What is proven of a set of starts (its level is the caller's)."""
    arrival = job.arrived
    assert isinstance(arrival, SetArrival)
    tubes, missing = cover(job, starts, parts)
    middle = tubes[0].enclosure
    verdict, reason = told(tubes, missing, parts)
    time = max(tube.duration for tube in tubes)
    if verdict == "proven":
        reason = f"in {len(tubes)} tubes all motions are in B₂ from t = {time:.6g} s on: 𝒱 < {arrival.largest:.6g} J"
    at_start = lower(lyapunov(job.loop, arrival.goal, middle.start))
    highest = arrival.largest if verdict == "proven" else np.inf
    return MoveCertificate(
        verdict, reason, None, time, at_start, highest, arrival.goal.level, False, middle, tuple(tubes)
    )


class _Outcome(NamedTuple):
    verdict: Verdict
    reason: str
    steps: list[Step]
    stopped: str


def _run(loop: ClosedLoop, start: Sequence[Ball], goal: Goal, duration: float, options: Options) -> _Outcome:
    """Step until 1.–4. hold, or until 𝒱 < 0 where that says that the motion never arrives."""
    steps: list[Step] = []
    time, ask_below, missing, never = 0.0, goal.level, "𝒱 is not below the level", single_valued(loop, goal.law)
    if (value := upper(lyapunov(loop, goal, start))) < 0.0 and never:
        return _Outcome("refuted", _NEVER.format(time, value), steps, "")
    for step in march(regular(loop), start, duration, options):
        if not isinstance(step, Step):
            told = f"rigour stops at t = {time:.9g} s after {len(steps)} steps: {step.reason}"
            return _Outcome("undecided", f"{told}; {_MORE}", steps, step.reason)
        steps.append(step)
        time += step.length
        end = start_box(step.end)
        value = upper(lyapunov(loop, goal, end))
        if value < 0.0 and never:
            return _Outcome("refuted", _NEVER.format(time, value), steps, "")
        if value < ask_below:
            missing = unconnected(loop, end, goal, options)
            if not missing:
                return _Outcome("proven", f"from t = {time:.6g} s on the motion is in B₂: 𝒱 < {value:.6g} J", steps, "")
            ask_below = _RETRY * value
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
