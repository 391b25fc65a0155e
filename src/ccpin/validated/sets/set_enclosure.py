"""`enclose_set`: all motions of the closed loop from a box of starts, with a proof."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import numbers, positive, step_or_infinite, whole
from ccpin.control.control_law import ControlLaw
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.kinematics.coordinates import checked_q
from ccpin.mechanism.assumptions import without_dry_friction
from ccpin.mechanism.mechanism import Mechanism
from ccpin.proof.facts import Fact, is_fact
from ccpin.proof.verdict import Judged, Verdict, not_known_of
from ccpin.validated.arithmetic.balls import centre_of, flint
from ccpin.validated.flow.marching import QUANTUM, StepOptions
from ccpin.validated.flow.motion_task import MotionTask, exact_q, task_of, velocity
from ccpin.validated.sets.propagation import Cut
from ccpin.validated.sets.set_claim import SetEnclosed
from ccpin.validated.sets.subdivision import Starts, Tube, TubeTask, cover, proved_set


@dataclass(frozen=True, eq=False, repr=False)
class SetEnclosure(Judged):
    """All motions from a box of starts.

    Attributes:
        tubes: Parts that cover the box, each with the starts it is about.
        starts: The box.
        asked: How long its motions were to be enclosed, s.
        covered: The fact that they all are in the tubes (`ccpin.validated.sets.set_claim`), if they are.
        stopped: What could not be proven, and which argument to raise; nothing where all was.
        assumes: What is left out of the mechanism, in words.
    """

    tubes: tuple[Tube, ...]
    starts: Starts
    asked: float
    covered: Fact | None
    stopped: str = ""
    assumes: str = ""

    @property
    def verdict(self) -> Verdict:
        """``"proven"``: every motion exists, closed and nonsingular, over the time asked for, in one of the tubes.

        ``"undecided"``: the last tube could not be proven so far, and other parts may not have been tried; so it is of
        one that was pickled, until it is replayed.
        """
        return "proven" if covers(self.covered, self.tubes, self.starts, self.asked) else "undecided"

    @property
    def reason(self) -> str:
        """The verdict in a sentence, with what stopped it and which argument to raise."""
        if self.verdict == "proven":
            return f"all motions from the set are closed and nonsingular, in {len(self.tubes)} tubes{self.assumes}"
        stopped = self.stopped or not_known_of("these motions")
        return stopped + self.assumes

    def replay(self) -> SetEnclosure:
        """The same, what was found proved once more from its data alone.

        Raises:
            NotProvedError: It does not hold.
        """
        if self.covered is None:
            return replace(self, tubes=tuple(tube.replay() for tube in self.tubes))
        covered = self.covered.replay()
        tubes = (tube.resting_on(held) for tube, held in zip(self.tubes, covered.premises, strict=True))
        return replace(self, tubes=tuple(tubes), covered=covered)

    def contains(self, t: float, q: ArrayLike, v: ArrayLike, tolerance: float = 0.0, *, effort: ArrayLike = ()) -> bool:
        """Whether a state at a time is in one of the tubes, widened by a part of its width; computed.

        q has one number for each velocity, of a circle the angle. Efforts held by a sampled loop belong to the state.
        """
        return any(bool(np.abs(tube.coordinates(t, q, v, effort)).max() <= 1.0 + tolerance) for tube in self.tubes)


def enclose_set(
    model: ReducedModel | Mechanism,
    law: ControlLaw | None,
    q0: ArrayLike,
    v0: ArrayLike | None,
    duration: float,
    *,
    spread: ArrayLike | tuple[ArrayLike, ArrayLike],
    near: ArrayLike | None = None,
    parts: int = 16,
    cells: int = 8,
    longest_slice: float = np.inf,
    period: float | None = None,
    precision: int = 128,
    order: int = 30,
    tolerance: float = 1e-18,
    pieces: int = 16,
) -> SetEnclosure:
    """Enclose the motions of all starts in a box.

    Args:
        model: As for `ccpin.validated.enclose`.
        law: As there.
        q0: Centre of the starts, of shape (model.nq,).
        v0: Centre of their velocities; default at rest.
        duration: Time in seconds.
        spread: How far starts are from the centre: one number for all of q and q̇, or a pair, of q (rad, m) and of q̇
            (per second), each one number or n of them.
        near: Chooses the branch of σ(q0).
        parts: Into how many boxes, each with a tube of its own, the starts may be cut.
        cells: Into how many intervals each coordinate of q is cut across a tube. More are slower, as cellsⁿ, and let it
            grow less.
        longest_slice: The longest slice of time, s; default as the rates of the closed loop ask for.
        period: The law is read at the multiples of this time (s, rounded up to one of 2⁻⁴⁰ s) and held in between;
            `PDSimpleGravity` only. Default: it acts at every moment.
        precision: Of the centres' motions, as for `ccpin.validated.enclose`.
        order: As there.
        tolerance: As there.
        pieces: As there.

    Raises:
        CcpinError: python-flint is not installed.
        InvalidInputError: A bad argument.
        UnsupportedMechanismError, ConvergenceError: As for `ccpin.validated.enclose`; also where a ball, planar or
            floating joint is independent as a whole.
    """
    model = model_of(model)
    cut, options = checked_cut(parts, cells, longest_slice), StepOptions(order, tolerance, pieces)
    task = task_of(model, law, q0, near, duration, options, precision, held=period is not None)
    with flint().ctx.workprec(precision):
        starts = starts_of(task, q0, v0, spread)
        if not starts.spread.any():
            raise InvalidInputError("spread = 0 leaves one motion: `enclose` encloses it")
        tubes = TubeTask(task, cut)
        if period is not None:
            tubes = tubes._replace(period=math.ceil(positive(period, "period") / QUANTUM) * QUANTUM)
        found = cover(tubes, starts, parts)
        covered, missing = proved_set(task.loop.equations, starts, found, duration)
    stopped = "" if covered else told(found.tubes, missing, parts)
    assumes = without_dry_friction(model.mechanism)
    return SetEnclosure(tuple(found.tubes), starts, duration, covered, stopped, assumes)


def checked_cut(parts: int, cells: int, longest_slice: float) -> Cut:
    """How finely tubes are cut, checked with the number of parts.

    Raises:
        InvalidInputError: One is out of its range.
    """
    whole(parts, "parts")
    if not whole(cells, "cells") <= 100:
        raise InvalidInputError(f"cells = {cells} are at most 100")
    step_or_infinite(longest_slice, "longest_slice")
    return Cut(cells, longest_slice)


def starts_of(task: MotionTask, q0: ArrayLike, v0: ArrayLike | None, spread: Any) -> Starts:
    """A box of starts; its centre has the angle of a circle in q0.

    Raises:
        InvalidInputError: A bad shape, or a negative spread.
        UnsupportedMechanismError: Coordinates whose rates are not q̇.
    """
    model, loop = task.model, task.loop
    if not loop.own.q.scalar:
        raise UnsupportedMechanismError(
            "sets of starts are boxes in coordinates whose rates are q̇: ball, planar and floating joints that are "
            "independent as a whole have none; name components or other joints as independent, in place of one of "
            f"{', '.join(model.mechanism.independent)}"
        )
    pair = tuple(spread) if isinstance(spread, tuple) and len(spread) == 2 else (spread, spread)
    widths = []
    for part in pair:
        width = numbers(part, "spread")
        if width.shape not in ((), (model.n,)) or not np.all((width >= 0.0) & np.isfinite(width)):
            raise InvalidInputError(
                f"spread = {spread!r} must be zero or a positive number, or a pair (of q, of q̇) of them, each one "
                f"number or {model.n}"
            )
        widths.append(np.broadcast_to(width, (model.n,)))
    v = velocity(model, v0)
    centre = exact_q(model, loop, checked_q(model.coordinates, q0))
    return Starts(centre_of(centre), v, np.concatenate(widths))


def covers(covered: Fact | None, tubes: Sequence[Tube], starts: Starts, duration: float) -> bool:
    """Whether a fact says that tubes hold all motions from a box of starts for some seconds."""
    if not is_fact(covered, SetEnclosed):
        return False
    claim = covered.claim
    known = zip((claim.q, claim.v, claim.spread), starts, strict=True)
    own = all(np.array_equal(*pair) for pair in known) and claim.duration[0] >= duration
    return own and tuple(tube.known for tube in tubes) == covered.premises


def told(tubes: list[Tube], missing: str, parts: int) -> str:
    """What could not be proven of a set, and what to raise."""
    return f"of at most {parts} parts {len(tubes) - 1} are proven; {missing}; more parts= or cells= may do more"
