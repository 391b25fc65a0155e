"""Runs in the compiled core: under a law of its own, or on and on under a constant effort, as far as it can.

A run under a law is the core's as a whole, sampled loops included, or not at all. Where nothing acts but a constant
effort and constant wrenches, and nothing is watched for, the core goes on in whatever coordinates the motion is in, and
comes back at the end of the time, where the coordinates are to be left (`coordinate_switching`), or where something is
out of the ordinary; how to go on is the run's to decide.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import Array, frozen
from ccpin.control.control_law import ControlLaw, of_own, stated
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.dynamics.state import StateModel
from ccpin.native import Declining
from ccpin.simulation.events.samples import SAMPLED, StateSample, Stop
from ccpin.simulation.events.settling import Settling
from ccpin.simulation.events.watches import Instant
from ccpin.simulation.integration.budget import Budget
from ccpin.simulation.integration.coordinate_switching import CoordinateSwitching
from ccpin.simulation.integration.core_numbers import TABLEAUX, constant_law, law_numbers, nominal_model
from ccpin.simulation.plant.plant import EffortBounds

_PLAIN = Settling(np.empty(0))._asdict() | {"origin": 0.0, "first_step": 0.0}
_PLAIN |= dict.fromkeys(("sampling", "leaving", "friction"))
"""What a run is told that neither settles nor is sampled nor leaves its coordinates, and in which nothing rubs."""
_COLUMNS = tuple(name for name in SAMPLED if name != "limits")


class CoreRun(NamedTuple):
    """What the compiled core answers.

    Attributes:
        columns: The samples, by the fields of `StateSample` but limits.
        a_free: q̈′ at each, of runs that may leave their coordinates alone.
        ended: How it ended: ``finished``, ``settled``, ``evaluations`` or ``seconds`` spent, ``interrupted``, or
            ``left``: where coordinates are to be left, or where only the reference can tell.
        since: Since when it is settled. evaluations: of the equations of motion.
        raised: What a signal's handler raised.
        memory: What a sampled loop remembers, for `SampledCommands.adopt`.
        time, state, place, first_step: Where it has come to: t, (q, q̇), q′, and the step it would take next (0: to be
            chosen). creeping: how many steps in a row were next to nothing.
        mode: In which joints with friction are there, for `StickSlip.adopt`.
    """

    columns: dict[str, Array]
    a_free: Array
    ended: str
    since: float
    evaluations: int
    raised: BaseException | None
    memory: Any
    time: float
    state: Array
    place: Array
    first_step: float
    creeping: int
    mode: Any

    @classmethod
    def of(cls, done: int, *answer: Any) -> CoreRun:
        """From the core's answer: in how many rows of its columns there are samples, these, q̈′, and the rest."""
        count = len(_COLUMNS)
        columns = {name: column[:done] for name, column in zip(_COLUMNS, answer[:count], strict=True)}
        return cls(columns, answer[count][:done], *answer[count + 1 :])

    @property
    def stop(self) -> Stop | None:
        """Why it ended before its time, in the reference's words, or ``None``."""
        if self.ended == "finished":
            return None
        if self.ended == "settled":
            return Stop.settled(self.since)
        t = float(self.columns["t"][-1])
        return Stop.exhausted(t, self.ended) if self.raised is None else Stop.broken_off(t, self.raised)

    def instant(self, model: StateModel) -> Instant:
        """Where it has come to, in the coordinates of the model that it ran in."""
        return Instant(self.time, model.at(self.state[: model.nq], self.place), frozen(self.state[model.nq :]))

    def samples(self, u: Array, switching: CoordinateSwitching) -> list[StateSample]:
        """The samples of a run under a constant effort, in the coordinates that the motion was begun in."""
        found, home = self.columns, switching.home
        reading = found["q"], found["v"], found["a"]
        if switching.model is not home:
            reading = switching.own.coordinates.readings(found["q_free"], found["v_free"], self.a_free)
        told = switching.told_rows(*(found[name] for name in ("q_free", "v_free", "friction")))
        nothing = np.zeros(home.mechanism.n_free)
        columns = found["t"].tolist(), *reading, *told, found["closure_error"].tolist()
        return [
            StateSample(t, q, v, a, u, x, w, f, nothing, error)
            for t, q, v, a, x, w, f, error in zip(*columns, strict=True)
        ]


def run_in_core(
    model: ReducedModel,
    law: ControlLaw,
    method: str,
    start: Instant,
    numbers: dict[str, Any],
    settling: Settling | None = None,
    budget: Budget | None = None,
) -> CoreRun | None:
    """A run from a start, or ``None`` where the law, the method or the motion is not one the core can answer for.

    Args:
        model: The reduced model.
        law: The law.
        method: The integrator.
        start: Where and when it begins.
        numbers: times (N,) of the samples, beginning at the start's, rtol, atol, max_step, singular_rcond, lower and
            upper bounds of u (a run that would go beyond is not the core's), wrenches (`wrench_rows`), sampling
            (`SampledCommands.numbers`) and, where joints rub, friction (`StickSlip.numbers`).
        settling: End once settled.
        budget: End once it is spent.
    """
    own = stated(law)
    told = law_numbers(model, own)
    if method not in TABLEAUX or own is None or told is None:
        return None
    nominal, held = nominal_model(model, own), own.idle and numbers["sampling"] is None
    if not (model.actuation is None or held) or (nominal is not None and isinstance(nominal.core, Declining)):
        return None
    times = numbers["times"]
    run = (
        _PLAIN | numbers | (budget or Budget()).numbers() | {"begin": times[0], "until": times[-1], "origin": own.start}
    )
    run |= {"start": np.concatenate([start.state.q, start.v])} | ({} if settling is None else settling._asdict())
    laws = () if nominal is None else (nominal.core, of_own(nominal, start.state, own.near).q_free)
    answer = model.core.simulate(start.state.q_free, told, run, TABLEAUX[method], *laws)
    return None if answer is None else CoreRun.of(*answer)


class ConstantEffortRuns:
    """Takes a motion under a constant effort to the core, from change to change of its coordinates.

    Args:
        method: The integrator, one of `TABLEAUX`.
        numbers: rtol, atol and singular_rcond.
        bounds: What the motors can give.
    """

    def __init__(self, method: str, numbers: dict[str, Any], bounds: EffortBounds) -> None:
        self._tableau, self._numbers, self._bounds = TABLEAUX[method], numbers, bounds

    def effort(self, law: ControlLaw, motors: int) -> Array | None:
        """The constant u of a law; ``None`` where it has none, or where the motors cannot give it."""
        told = stated(law)
        if told is None or told.kind != "constant":
            return None
        u = told.constant if told.constant.size else np.zeros(motors)
        return u if self._bounds.hold(u) else None

    def run(self, start: Instant, numbers: dict[str, Any], u: Array, switching: CoordinateSwitching) -> CoreRun | None:
        """On from an instant, in its coordinates; ``None`` where the core cannot begin.

        Args:
            start: Where and when it begins.
            numbers: until, times of the samples up to it, first_step (0: the integrator's own), max_step, what is
                left of evaluations and seconds, and friction (`StickSlip.numbers`).
            u: The effort.
            switching: Whose coordinates these are, and when they are to be left.
        """
        t, state, v = start
        effort = u[: state.model.n_actuated]  # a sibling may have no motors: then u = 0
        unbounded = np.full(len(effort), np.inf)
        run = _PLAIN | self._numbers | numbers | EffortBounds(-unbounded, unbounded).numbers()
        run |= {"begin": t, "start": np.concatenate([state.q, v])}
        run |= {"wrenches": switching.wrenches, "leaving": switching.leaving()}
        answer = state.model.core.simulate(state.q_free, constant_law(effort), run, self._tableau)
        return None if answer is None else CoreRun.of(*answer)
