"""Stretches of a motion under a constant effort, in the compiled core, in whatever coordinates the motion is in.

Where nothing acts but a constant effort and constant wrenches, and nothing is watched for, a run lets the core go on as
far as it can. The core comes back at the end of the stretch, where the coordinates are to be left
(`ccpin.simulation.following`), or where something is out of the ordinary; how to go on is the run's to decide.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import Array, frozen
from ccpin.control.laws import ControlLaw, NoTorque, undelayed
from ccpin.simulation.commanding import Held
from ccpin.simulation.following import Following
from ccpin.simulation.happenings import Moment
from ccpin.simulation.in_core import PLAIN, TABLEAUX, Answer
from ccpin.simulation.plant import EffortBounds
from ccpin.simulation.samples import StateSample


class Span(NamedTuple):
    """What is asked for.

    Attributes:
        begin: Where the stretch begins. end: when it ends at the latest, s.
        times: Of the samples between them.
        first_step: Of the integrator; ``None``: one of its own. longest: no step is longer, s.
        left: What is left of a budget (`Allowance.left`).
    """

    begin: Moment
    end: float
    times: Array
    first_step: float | None
    longest: float
    left: dict[str, float]


class Stretch(NamedTuple):
    """What the core has done of it.

    Attributes:
        here: Where it has come to. left: whether that is for the coordinates, or for what is out of the ordinary.
        samples: Those up to there. evaluations: of the equations of motion.
        first_step: What the integrator would try next, s. creeping: how many steps in a row were next to nothing.
        raised: What a signal's handler raised.
    """

    here: Moment
    left: bool
    samples: list[StateSample]
    evaluations: int
    first_step: float | None
    creeping: int
    raised: BaseException | None


class Coasting:
    """Takes stretches to the core.

    Args:
        method: The integrator, one of `TABLEAUX`.
        numbers: rtol, atol and singular_rcond.
        bounds: What the motors can give.
    """

    def __init__(self, method: str, numbers: dict[str, Any], bounds: EffortBounds) -> None:
        self._tableau, self._numbers, self._bounds = TABLEAUX[method], numbers, bounds

    def effort(self, law: ControlLaw, motors: int) -> Array | None:
        """The constant u of a law; ``None`` where it has none, or where the motors cannot give it."""
        law = undelayed(law)
        if not isinstance(law, Held) and type(law) is not NoTorque:
            return None
        u = law.effort if isinstance(law, Held) else np.zeros(motors)
        return u if self._bounds.hold(u) else None

    def stretch(self, span: Span, u: Array, following: Following) -> Stretch | None:
        """A stretch in the present coordinates; ``None`` where the core cannot begin it."""
        t, state, v = span.begin
        model = state.model
        effort = u[: model.n_actuated]  # a sibling may have no motors: then u = 0
        unbounded = np.full(len(effort), np.inf)
        run = (
            PLAIN
            | self._numbers
            | span.left
            | {
                "begin": t,
                "until": span.end,
                "times": span.times,
                "start": np.concatenate([state.q, v]),
                "first_step": span.first_step or 0.0,
                "max_step": span.longest,
                "lower": (-unbounded).tolist(),
                "upper": unbounded.tolist(),
                "wrenches": following.wrenches,
                "leaving": following.leaving(),
            }
        )
        answer = model.core.simulate(
            state.q_free, {"kind": "constant", "constant": effort.tolist()}, run, self._tableau
        )
        if answer is None:
            return None
        found = Answer(*answer)
        here = Moment(found.time, model.at(found.state[: model.nq], found.place), frozen(found.state[model.nq :]))
        stride, samples = found.first_step or None, _samples(found, u, following)
        left = found.ended == "left"
        return Stretch(here, left, samples, found.evaluations, stride, found.creeping, found.raised)


def _samples(found: Answer, u: Array, following: Following) -> list[StateSample]:
    """The core's samples, in the coordinates that the motion was begun in."""
    rows, home = slice(found.done), following.home
    reading = found.q[rows], found.v[rows], found.a[rows]
    if following.model is not home:
        reading = following.own.coordinates.readings(found.q_free[rows], found.v_free[rows], found.a_free[rows])
    nothing = np.zeros(home.mechanism.n_free)
    samples = []
    for t, q, v, a, x, w, error in zip(
        found.t[rows], *reading, found.q_free[rows], found.v_free[rows], found.closure_error[rows], strict=True
    ):
        q_free, v_free = following.told_row(x, w)
        samples.append(StateSample(float(t), q, v, a, u, q_free, v_free, nothing, nothing, float(error)))
    return samples
