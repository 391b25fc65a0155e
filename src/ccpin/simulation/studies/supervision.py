"""A supervisor that switches the set point: move, wait once settled, move on (Section IV-B, repetitive motion)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, instance, number, positive
from ccpin.control.control_law import Delayed
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.dynamics.state import Near
from ccpin.errors import InvalidInputError
from ccpin.files import Journal
from ccpin.kinematics.coordinates import checked_q
from ccpin.mechanism.mechanism import Mechanism
from ccpin.simulation.events.samples import Stop
from ccpin.simulation.events.settling import Settling
from ccpin.simulation.integration.budget import Allowance, Budget
from ccpin.simulation.integration.simulator import Simulator
from ccpin.simulation.plant.commands import LawLike, law_of
from ccpin.simulation.results.trajectory import Trajectory, joined
from ccpin.simulation.studies.journal import Move, Stored, Unfinished
from ccpin.simulation.studies.origins import numbers_of, origin_of

LawTo = Callable[[Array, Array], LawLike]


@dataclass(frozen=True)
class SupervisedMotion:
    """The whole motion and its moves.

    Attributes:
        moves: The whole moves in order, and what there is of the one that ended the motion early. With a journal they
            are on disk and read when asked for.
        stop: How the whole ended: ``finished`` after the last goal's wait, else what ended it.
    """

    moves: Sequence[Move]
    stop: Stop

    @cached_property
    def trajectory(self) -> Trajectory:
        """The moves' trajectories as one, with the status, message and cause of the whole."""
        return joined([move.trajectory for move in self.moves])._replace(**self.stop._asdict())


def supervise(
    model: ReducedModel | Mechanism,
    law_to: LawTo,
    q0: ArrayLike,
    goals: Sequence[ArrayLike],
    *,
    wait: float,
    settling: Settling | None = None,
    timeout: float = 10.0,
    near: Near = None,
    sample_period: float = 1e-3,
    budget: Budget | None = None,
    journal: str | Path | None = None,
    name: str = "",
    **options: Any,
) -> SupervisedMotion:
    """Visit goals one after the other: set q_d, move until settled, wait, set the next.

    One `Simulator` goes through all of it: time, filter, delay, the command held, stick and slip run on. Each law's
    own clock begins when its goal is set, and runs on while waiting.

    Args:
        model: The reduced model, or a mechanism.
        law_to: Makes the law for a goal: (q_d, a configuration on the current branch) → law, as for `Simulator`.
        q0: Start at rest, of shape (model.nq,).
        goals: The set points in order (repeat them for cycles).
        wait: Seconds to wait once settled (the settled band's hold time counts as waiting).
        settling: Band, speed and hold; its goal is replaced by each move's. Default `Settling`'s.
        timeout: Longest time of a move without the wait, s.
        near: Chooses the assembly mode of σ(q0).
        sample_period: Time between samples, s.
        budget: What the whole may cost.
        journal: A file to write each whole move to once it is over, so that memory does not grow; where the file is
            there the motion goes on after the last move in it, to the same bits (a law's own memory aside: laws are
            made anew for each goal). A journal of another mechanism, bench, or version of ccpin is refused.
        name: What `law_to` is called in the journal: needed where it is a function, of which nothing else tells whether
            it is the same one.
        options: As for `Simulator`: method, tolerances, friction, sampling, region, events, …

    Returns:
        SupervisedMotion: Up to the last goal, or up to where the motion ended, with why: a move that did not settle, a
        wait that a region, an event or a singularity ended, Ctrl-C, the budget, an exception of a law or of `law_to`,
        a journal that cannot be written (the stop's `cause`).

    Raises:
        InvalidInputError: No goals, a bad argument, a journal of another task.
        Exception: As `simulate` does for the first move.
    """
    if not isinstance(goals, Sequence | np.ndarray) or not len(goals):
        raise InvalidInputError("goals must be a sequence of at least one set point")
    if not callable(law_to):
        raise InvalidInputError(f"law_to must be a function (q_d, q′) → law, not {type(law_to).__name__}")
    model = model_of(model)
    visited = [np.array(checked_q(model.coordinates, goal)) for goal in goals]
    wait = number(wait, "wait", "a number of seconds")
    rule = Settling(goal=visited[0]) if settling is None else instance(settling, "settling", Settling)
    timeout, allowance = positive(timeout, "timeout"), Allowance.of(budget or Budget(), 0)
    supervisor = _Supervisor(Simulator(model, **options), law_to, rule, wait, timeout, sample_period, allowance)
    supervisor.simulator.reset(q0, near=near)
    if journal is None:
        return supervisor.visit(visited, [])
    task = {"format": "ccpin-moves-3", **origin_of(law_to, name, "law_to"), **model.digests._asdict()}
    task |= {"q0": np.asarray(q0).tolist(), "wait": wait, "timeout": timeout, "sample_period": sample_period}
    task |= {"settling": [float(x) for x in rule[1:]], **numbers_of(options)}
    with Journal(journal, task) as records:
        stored = Stored(records)
        if len(stored):
            supervisor.simulator.recall(stored.carried())
        return supervisor.visit(visited, stored)


@dataclass
class _Supervisor:
    """What stays the same from move to move, and what has been spent."""

    simulator: Simulator
    law_to: LawTo
    rule: Settling
    wait: float
    timeout: float
    sample_period: float
    allowance: Allowance
    spent: int = 0

    def visit(self, goals: list[Array], log: Stored | list[Move]) -> SupervisedMotion:
        """Make the moves that the log has not."""
        for goal in goals[len(log) :]:
            try:
                move, stop = self.move(goal)
            except (Exception, KeyboardInterrupt) as error:
                if not len(log):
                    raise
                kind = "interrupted" if isinstance(error, KeyboardInterrupt) else "failed"
                message = f"the move at t = {self.simulator.t:.6g} s could not begin: {error}"
                return SupervisedMotion(log, Stop(kind, message, error))  # type: ignore[arg-type]
            if stop is not None:
                return SupervisedMotion(Unfinished(log, move), stop)
            try:
                self._keep(log, move)
            except (Exception, KeyboardInterrupt) as error:
                return SupervisedMotion(Unfinished(log, move), Stop.broken_off(move.end, error))
        return SupervisedMotion(log, Stop("finished", f"{len(log)} moves, {self.simulator.t:.6g} s in all"))

    def _keep(self, log: Stored | list[Move], move: Move) -> None:
        if isinstance(log, Stored):
            log.append(move, self.simulator.memory())
        else:
            log.append(move)

    def move(self, goal: Array) -> tuple[Move, Stop | None]:
        """One move and its wait, and why they ended early, if they did."""
        simulator, hold = self.simulator, self.rule.hold
        simulator.recall(simulator.memory())  # as a motion does that goes on from its journal
        start = simulator.t
        simulator.law = Delayed(law_of(simulator.model, self.law_to(goal, simulator.sample().q_free)), start)
        motion = self._go(start + self.timeout, self.rule._replace(goal=goal))
        if motion.status != "settled":
            late = f"the move to {np.array2string(goal, precision=6)} had not settled after {self.timeout:.6g} s"
            return Move(goal, start, None, simulator.t, motion), simulator.stop or Stop("finished", late)
        settled, stop = simulator.t - hold, None
        if self.wait > hold:
            motion = joined([motion, self._go(settled + self.wait, None)])
            stop = simulator.stop
        return Move(goal, start, settled, simulator.t, motion), stop

    def _go(self, until: float, settling: Settling | None) -> Trajectory:
        budget = self.allowance.left(self.spent)
        motion = self.simulator.run(until, sample_period=self.sample_period, settling=settling, budget=budget)
        self.spent += motion.evaluations
        return motion
