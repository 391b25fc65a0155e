"""The search for a tube that the tracking error cannot leave: what goes in must be larger than what comes out.

E and Ė are the unknowns of Theorem T (`ccpin/proof/theorems/tracking.md`). They start from the bound that the cells'
middles alone would give, and grow until its 4 and 5 seem to hold on every cell, or until something is no longer proved.
What is found is proposed: `TubeKept` proves it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Mask
from ccpin.control.stability.tracking.cell_forms import forms_of
from ccpin.control.stability.tracking.deviation import Deviation, deviation_of
from ccpin.control.stability.tracking.error_equations import Feedback, StorageChoice, equation_of
from ccpin.control.stability.tracking.reference_tube import ReferenceTube
from ccpin.control.stability.tracking.storage import gain, storage_of, widths
from ccpin.control.stability.tracking.tube_claim import TubeKept
from ccpin.control.stability.tracking.tube_levels import Disturbances, Levels, levels_of
from ccpin.proof.balls import affine
from ccpin.proof.facts import Fact, NotProvedError, prove
from ccpin.proof.newton import Boxes

_ROUNDS = 10  # wider tubes tried, before the bound is left undecided
_FIRST = 2.2  # times what the cells' middles ask for: the first tube
_MORE = 1.3  # times what was needed: the next tube
_PLANNED = 48  # cells at whose middles plans are compared, at most: a plan is a choice, its proof is over all


class FoundTube(NamedTuple):
    """What a search ends with.

    Attributes:
        proved: The fact about a tube; ``None`` where none was found.
        reason: Why, in a sentence.
    """

    proved: Fact | None
    reason: str


class TubeSearch:
    """Looks for E and Ė with which Theorem T's hypotheses hold."""

    def __init__(self, tube: ReferenceTube, given: Disturbances) -> None:
        self.tube, self.given = tube, given
        self.rounds = 0

    def found(self) -> FoundTube:
        """What is proved, after as many rounds as it takes."""
        tube, own, n = self.tube, self.tube.equations, len(self.given.push)
        if tube.path.verdict != "proven":
            return FoundTube(None, f"the reference itself leaves what is proved: {tube.path.reason}")
        room = np.zeros((len(tube.centre), 2 * n))
        boxes, proved = tube.boxes(room[:, :n])
        if not proved.all():
            return self._stopped("σ is not proved", ~proved, room)
        states = forms_of(own.closures.system, boxes, tube.cells, room)
        middle = deviation_of(own, states.middles(), 0.0)
        choice = self._choice(middle)
        if choice is None:
            return FoundTube(None, "no storage function was found along the reference: stiffer gains would do more")
        room = levels_of(own.feedback, choice, middle, self.given, tube.cells).needed * _FIRST
        for self.rounds in range(1, _ROUNDS + 1):
            boxes, proved = tube.boxes(room[:, :n])
            if not proved.all():
                return self._stopped("σ is not proved", ~proved, room)
            if self.rounds == 1:  # mostly it holds, and is worked out once
                found = self._proved(choice, boxes, room)
                if found.proved is not None:
                    return found
            states = forms_of(own.closures.system, boxes, tube.cells, room)
            deviation = deviation_of(own, states, self.given.sigma_error)
            levels = levels_of(own.feedback, choice, deviation, self.given, tube.cells, room)
            stopped = self._open(levels, room)
            if stopped is not None:
                return stopped
            if levels.held(room):
                return self._proved(choice, boxes, room)
            room = np.maximum(room, levels.needed) * _MORE
        return FoundTube(
            None,
            f"after {_ROUNDS} rounds the bound still grows, for a σ off by {self.given.sigma_error:.3g} lets the law "
            "deviate the more, the larger the error: a smaller sigma_error, more cells= or stiffer gains would do more",
        )

    def _choice(self, middle: Deviation) -> StorageChoice | None:
        rows = slice(None, None, 1 + len(middle.push) // _PLANNED)
        raw = np.linalg.norm(middle.slope.mid, axis=2) * self.given.sigma_error + middle.push @ self.given.push
        scale = raw.max(axis=0)
        scale = np.where(scale > 0.0, scale, max(float(scale.max()), 1e-300))
        law = self.tube.equations.feedback
        return choice_for(law, scale, middle.D.mid[rows], middle.C.mid[rows], middle.damping.mid[rows])

    def _open(self, levels: Levels, room: Array) -> FoundTube | None:
        """Why no level is known, if one is not: which of 1 to 3 fails."""
        sources = levels.sources
        checks = (
            (~np.isfinite(levels.widths).all(axis=1), "D is not proved positive definite"),
            (np.isinf(sources), "V̇ is not proved negative"),
            (np.isnan(sources), f"φ_y (within {self.given.sigma_error:.3g} of σ) or D is not proved nonsingular"),
        )
        for failed, what in checks:
            if np.any(failed):
                return self._stopped(what, np.asarray(failed), room)
        return None

    def _stopped(self, what: str, where: Mask, room: Array) -> FoundTube:
        """A reason: what fails first, where, for which errors, and what would do more."""
        k, cells = int(np.argmax(where)), self.tube.cells
        place = f"t = {cells.times[k]:.6g} s, q_d = {cells.place.start[k].tolist()}"
        among = f"for errors up to {room[k, : len(self.given.push)].max():.3g}"
        more = "a smaller sigma_error, more cells= or stiffer gains would do more"
        return FoundTube(None, f"{what} {among} at {place}: {more}")

    def _proved(self, choice: StorageChoice, boxes: Boxes, room: Array) -> FoundTube:
        """The fact, and what it says."""
        claim = TubeKept(
            equations=self.tube.equations,
            times=self.tube.cells.times,
            room=room,
            scale=choice.scale,
            decay=np.array([choice.decay]),
            cross=np.array([choice.cross]),
            storage=np.zeros((0, 0)) if choice.P is None else choice.P,
            sigma_error=np.array([self.given.sigma_error]),
            disturbance=self.given.push,
            start=self.given.start,
        )
        path = self.tube.path.proved
        assert path is not None
        try:
            fact = prove(claim, path, *self.tube.proved(boxes))
        except NotProvedError as error:
            return FoundTube(None, f"a bound was found, and did not hold when it was to be proved: {error}")
        worst = float(fact.found["bound"][:, : len(self.given.push)].max())
        said = f"|q_d − q| stays below {worst:.3g} ({np.degrees(worst):.3g}°, where angles) with σ off by at most "
        return FoundTube(fact, f"{said}{self.given.sigma_error:.3g}: {len(room)} cells, {self.rounds} rounds")


def choice_for(law: Feedback, scale: Array, D: Array, C: Array, damping: Array) -> StorageChoice | None:
    """The storage function whose bound of e is about the least, for deviations of a scale and terms at K places."""
    best, least, n, terms = None, np.inf, len(scale), [affine(term) for term in (D, C, damping)]
    for choice in equation_of(law.kind).choices(law, scale, D):
        storage = storage_of(law, choice, *terms)
        with np.errstate(all="ignore"):
            reach = gain(storage, choice)[:, None] * widths(storage)[:, :n] / scale
        worst = float(reach.sum(axis=1).max())
        if worst < least:
            best, least = choice, worst
    return best
