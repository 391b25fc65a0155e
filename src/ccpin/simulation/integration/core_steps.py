"""Steps with u held, in the compiled core, in whatever coordinates the motion is in.

A step that only the reference can take, such as one on which coordinates are changed, has no answer here: the run takes
it from the last certain instant, and the next steps are the core's again. Efforts beyond what motors give are cut off
before, as `ccpin.simulation.plant.plant` does, and that is told as events alike.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, Mask, frozen
from ccpin.control.control_law import HeldEffort
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.dynamics.state import StateModel
from ccpin.simulation.events.samples import EventRecord, StateSample
from ccpin.simulation.events.watches import Instant
from ccpin.simulation.integration.core_numbers import TABLEAUX
from ccpin.simulation.integration.run import Run
from ccpin.simulation.plant.plant import EffortBounds

if TYPE_CHECKING:
    from ccpin.native._core import HeldMotion

_HELD = HeldEffort(np.empty(0))  # any: only its kind is asked for


class HeldStep(NamedTuple):
    """Where a step has come to, what happened where it began, and what a signal's handler raised that ended it."""

    sample: StateSample
    happened: list[EventRecord]
    raised: BaseException | None


class CoreSteps:
    """The steps of one simulator in the core, and how far these are ahead of its run.

    Args:
        home: The model whose coordinates are reported.
        method: The integrator, one of `TABLEAUX`.
        numbers: rtol, atol, max_step and singular_rcond.
        bounds: What the motors can give.

    Attributes:
        ahead: The motion after the last step; ``None`` where the run is up to date.
    """

    def __init__(self, home: ReducedModel, method: str, numbers: dict[str, Any], bounds: EffortBounds) -> None:
        self._home, self._tableau, self._numbers, self._bounds = home, TABLEAUX[method], numbers, bounds
        self._nothing = frozen(np.zeros(home.mechanism.n_free))
        self._model: StateModel | None = None
        self._motion: HeldMotion | None = None
        self._counted, self._beyond = 0, b""
        self._q_free = home.mechanism.q_reference
        self.ahead: StateSample | None = None

    def begin(self) -> None:
        """Another motion begins."""
        self.ahead = None

    def step(self, run: Run, u: ArrayLike, dt: float) -> HeldStep | None:
        """A step of a run with u held; ``None`` where only the reference can tell."""
        efforts = np.asarray(u)
        if efforts.shape != self._bounds.lower.shape or efforts.dtype.kind not in "fiu":
            return None
        given = np.minimum(np.maximum(efforts, self._bounds.lower), self._bounds.upper)
        if self.ahead is None and not self._start(run):
            return None
        beyond = given != efforts
        jumps = beyond.tobytes() != self._beyond
        if self._motion is None or (jumps and not np.isfinite(efforts).all()):
            return None
        own = given if run.model is self._home else given[: run.model.n_actuated]  # a sibling may have none: u = 0
        answer = self._motion.step(own, dt)
        if answer is None:
            return None
        happened = self._jump(run, beyond) if jumps else []
        q, v, a, told, self._q_free, v_free, closure, reached, raised = answer
        t = run.here.t if self.ahead is None else self.ahead.t
        told = told if own is given else frozen(given)
        free = run.switching.told_row(self._q_free, v_free)
        self.ahead = StateSample(t + reached, q, v, a, told, *free, self._nothing, self._nothing, closure)
        return HeldStep(self.ahead, happened, raised)

    def land(self, run: Run) -> None:
        """Bring the run up to date."""
        if self.ahead is None or self._motion is None or self._model is None:
            return
        q, v = np.split(self._motion.state(), [self._model.nq])
        run.here = Instant(self.ahead.t, self._model.at(q, self._q_free), frozen(v))
        run.first_step = self._motion.last_step
        run.evaluations += self._motion.evaluations - self._counted
        self.ahead = None

    def _start(self, run: Run) -> bool:
        """Go on from where the run is, in its coordinates; whether the core can."""
        _, state, v = run.here
        switching = run.switching
        stated = switching.stated_under(_HELD) is not None
        if stated and state.model is not self._home:
            return False
        if self._model is not state.model:
            numbers = self._numbers | {"wrenches": switching.wrenches, "leaving": switching.leaving() | {"most": 1.0}}
            self._motion = state.model.core.held_motion(switching.own.core, self._tableau, **numbers)
            self._model = state.model
        if self._motion is None:
            return False
        self._counted, self._beyond = self._motion.evaluations, b""
        most = np.inf if stated else switching.most
        return self._motion.start(state.q_free, state.q, v, run.first_step or 0.0, most)

    def _jump(self, run: Run, beyond: Mask) -> list[EventRecord]:
        """u has jumped to where motors give less than asked for, or back: what that is called."""
        self._beyond = beyond.tobytes()
        if run.saturation is None:
            return []
        t, q, v, q_free = self._place(run)
        return [EventRecord(name, t, q, v, q_free) for name in run.saturation.jump(beyond)]

    def _place(self, run: Run) -> tuple[float, Array, Array, Array]:
        """t, q, q̇ in the coordinates of `home` and q′, before the step."""
        if self.ahead is not None:
            return self.ahead.t, self.ahead.q, self.ahead.v, self.ahead.q_free
        t, state, v = run.here
        return t, *run.switching.reported(state, v)
