"""A supervisor that switches the set point: move, wait once settled, move on (Section IV-B, repetitive motion)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, instance, number
from ccpin.control.laws import ControlLaw
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.dynamics.state import Near
from ccpin.errors import InvalidInputError
from ccpin.kinematics.checked import checked_q
from ccpin.mechanism.mechanism import Mechanism
from ccpin.simulation.simulate import Settling, simulate
from ccpin.simulation.trajectory import Trajectory


class Move(NamedTuple):
    """One move of a supervised motion.

    Attributes:
        goal: q_d, of shape (model.nq,).
        start: Time at which q_d was set. settled: time at which the motion had settled, ``None`` if it did not.
        end: Time at which the wait was over.
        trajectory: The motion from start to end, its time beginning at zero.
    """

    goal: Array
    start: float
    settled: float | None
    end: float
    trajectory: Trajectory


class SupervisedMotion(NamedTuple):
    """The whole motion and its moves."""

    trajectory: Trajectory
    moves: tuple[Move, ...]


def supervise(
    model: ReducedModel | Mechanism,
    law_to: Callable[[Array, Array], ControlLaw],
    q0: ArrayLike,
    goals: Sequence[ArrayLike],
    *,
    wait: float,
    settling: Settling | None = None,
    timeout: float = 10.0,
    guess: Near = None,
    **options: Any,
) -> SupervisedMotion:
    """Visit goals one after the other: set q_d, move until settled, wait, set the next.

    Args:
        model: The reduced model, or a mechanism.
        law_to: Makes the law for a goal: (q_d, a configuration on the current branch) → law.
        q0: Start at rest, of shape (model.nq,).
        goals: The set points in order (repeat them for cycles).
        wait: Seconds to wait once settled (the settled band's hold time counts as waiting).
        settling: Band, speed and hold; its goal is replaced by each move's. Default `Settling`'s.
        timeout: Longest time of a move without the wait, s.
        guess: Chooses the assembly mode of σ(q0).
        options: Passed on to `simulate` (method, tolerances, sample_period, friction, sampling, …). A sampled loop
            starts anew with each move and each wait, with the efforts applied last still at the motors.

    Returns:
        SupervisedMotion: Up to the last goal, or up to the first move that did not settle (the trajectory's status
        and message then say why).

    Raises:
        InvalidInputError: No goals, or as `simulate` does for the first move.
    """
    if not isinstance(goals, Sequence | np.ndarray) or not len(goals):
        raise InvalidInputError("goals must be a sequence of at least one set point")
    model = model_of(model)
    if not callable(law_to):
        raise InvalidInputError(f"law_to must be a function (q_d, q′) → law, not {type(law_to).__name__}")
    rule = Settling(goal=np.zeros(model.nq)) if settling is None else instance(settling, "settling", Settling)
    wait = number(wait, "wait", "a number of seconds")
    here = model.at(q0, guess)
    q, v, q_free = here.q, np.zeros(model.n), here.q_free
    moves: list[Move] = []
    whole: Trajectory | None = None
    for raw_goal in goals:
        goal = checked_q(model.coordinates, raw_goal)
        law = law_to(goal, q_free)
        start = 0.0 if whole is None else float(whole.t[-1])
        motion = simulate(
            model, law, q, v, duration=timeout, guess=q_free, settling=rule._replace(goal=goal), **options
        )
        settled = start + float(motion.t[-1]) - rule.hold if motion.status == "settled" else None
        options = _carried_on(options, motion)
        if settled is not None and wait > rule.hold:
            q, v, q_free = motion.q[-1], motion.v[-1], motion.q_free[-1]
            motion = motion.then(simulate(model, law, q, v, duration=wait - rule.hold, guess=q_free, **options))
            options = _carried_on(options, motion)
        whole = motion if whole is None else whole.then(motion)
        moves.append(Move(goal, start, settled, float(whole.t[-1]), motion))
        if settled is None:
            break
        q, v, q_free = motion.q[-1], motion.v[-1], motion.q_free[-1]
    assert whole is not None
    if moves[-1].settled is not None:
        whole = whole._replace(message=f"{len(moves)} moves, {whole.t[-1]:.6g} s in all")
    return SupervisedMotion(whole, tuple(moves))


def _carried_on(options: dict[str, Any], motion: Trajectory) -> dict[str, Any]:
    """The options with a sampled loop's motors at the efforts a motion ended with."""
    sampling = options.get("sampling")
    if sampling is None:
        return options
    return options | {"sampling": replace(sampling, effort_before=tuple(motion.u[-1].tolist()))}
