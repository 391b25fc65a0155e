"""What is told of a move: all of it from facts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ccpin.proof.facts import Fact, NotProvedError, ProvableClaim, is_fact
from ccpin.proof.verdict import Judged, Verdict, Witness, not_known_of
from ccpin.validated.arithmetic.balls import Ball, flint, lower, upper
from ccpin.validated.arithmetic.series import NotInvertibleError
from ccpin.validated.flow.crossing import witness_of
from ccpin.validated.flow.enclosure import Enclosure
from ccpin.validated.flow.motion_claim import end_of
from ccpin.validated.flow.start_claim import ClosedStart
from ccpin.validated.sets.arrival_claim import Arrived, NeverArrives, SetArrived
from ccpin.validated.sets.arrival_equations import ArrivalEquations
from ccpin.validated.sets.lyapunov import lyapunov_at
from ccpin.validated.sets.set_enclosure import covers
from ccpin.validated.sets.subdivision import Starts, Tube


@dataclass(frozen=True, eq=False, repr=False)
class MoveCertificate(Judged):
    """What was proven of a move.

    Attributes:
        equations: The closed loop, its set point, and what its level is proved of.
        level: c in joules.
        enclosure: The motion up to T; of a set, that from the middle of its first part.
        point: The fact about σ(q_d), from which 𝒱 is counted.
        proved: The fact that it arrives, or never does (`ccpin.validated.sets.arrival_claim`), if there is one.
        stopped: What could not be proven, and what more would do; nothing where all was.
        starts: The box of starts of a set; ``None`` without a spread.
        tubes: All motions of a set up to T, a tube a part; none without a spread.
        without: What is left out of the mechanism, in words.
        assumes: The limits that the mechanism states and that are taken not to be met (of dry friction: `reason`).
    """

    equations: ArrivalEquations
    level: float
    enclosure: Enclosure
    point: Fact
    proved: Fact | None
    stopped: str = ""
    starts: Starts | None = None
    tubes: tuple[Tube, ...] = ()
    without: str = ""
    assumes: tuple[str, ...] = ()

    @property
    def verdict(self) -> Verdict:
        """``"proven"``: the theorem's hypotheses hold, the motion converges to the set point.

        ``"refuted"``: it does not, as 𝒱 < 0 at T: 𝒱 never rises along the motion, and is 0 at the set point (said only
        where 𝒱 is one function of the state: a continuous joint may arrive one turn on, where it is another).
        ``"undecided"``: neither; so it is of one that was pickled, until it is replayed.
        """
        if self._known is None:
            return "undecided"
        return "refuted" if is_fact(self._known, NeverArrives) else "proven"

    @property
    def reason(self) -> str:
        """The verdict in a sentence, with what was spent and what more would do."""
        return self._told + self.without

    @property
    def _told(self) -> str:
        known = self._known
        if known is None:
            return self.stopped or not_known_of("this move")
        if is_fact(known, NeverArrives):
            return (
                f"at t = {self.time:.6g} s 𝒱 < {self.lyapunov:.6g} J, below its value 0 at the set point, and 𝒱 never "
                "rises: the motion does not arrive"
            )
        all_of_it = f"in {len(self.tubes)} tubes all motions are" if self.tubes else "the motion is"
        given = "" if self.rigorous else f"; that c = {self.level:.6g} J is a level of Theorem 3 is the caller's part"
        return f"{all_of_it} in B₂ from t = {self.time:.6g} s on: 𝒱 < {self.lyapunov:.6g} J{given}"

    @property
    def witness(self) -> Witness | None:
        """The state at T that refutes (its velocity is the enclosure's)."""
        known = self._known
        if not is_fact(known, NeverArrives):
            return None
        with flint().ctx.workprec(self.enclosure.precision):
            return witness_of("state", self.enclosure.loop, end_of(known.premises[0]).balls())

    @property
    def rigorous(self) -> bool:
        """Whether c, below which it is proven to come, is a fact's; a plain number is the caller's part."""
        return self.verdict == "proven" and self.equations.set_point is not None

    @property
    def time(self) -> float:
        """T in seconds, the last part's of a set (where nothing is decided, where the enclosure or the tubes end)."""
        if self._known is not None:
            return float(self._known.found["time"][0])
        return max([tube.duration for tube in self.tubes], default=float(self.enclosure.times[-1]))

    @property
    def lyapunov_start(self) -> float:
        """A lower bound of 𝒱 at the start, in joules; of a set, in its middle."""
        value = self._lyapunov(self.enclosure.start)
        return -np.inf if value is None else lower(value)

    @property
    def lyapunov(self) -> float:
        """An upper bound of 𝒱 at T, in joules, on all of a set (infinite where that is not decided)."""
        if self._known is not None:
            return float(self._known.found["lyapunov"][0])
        value = None if self.tubes else self._lyapunov(self.enclosure.inputs(self.time))
        return np.inf if value is None else upper(value)

    @property
    def _known(self) -> Fact | None:
        """The fact, if it is about this move."""
        proved, moved = self.proved, self.enclosure
        if proved is None or not any(is_fact(proved, kind) for kind in self._kinds):
            return None
        if self.starts is None:
            known = moved.verdict == "proven" and proved.premises[0] is moved.motion and not self.tubes
        else:
            known = covers(proved.premises[0], self.tubes, self.starts, 0.0) and moved is self.tubes[0].enclosure
        known = known and proved.digest == self.equations.digest
        known = known and (is_fact(proved, NeverArrives) or proved.claim.level[0] == self.level)
        return proved if known else None

    @property
    def _kinds(self) -> tuple[type[ProvableClaim], ...]:
        """What may be proved of it: of one motion, or of a set."""
        return (Arrived, NeverArrives) if self.starts is None else (SetArrived,)

    def _lyapunov(self, box: Sequence[Ball]) -> Ball | None:
        """𝒱 on a box of states, where that is known."""
        if not is_fact(self.point, ClosedStart):
            return None
        with flint().ctx.workprec(self.enclosure.precision):
            try:
                return lyapunov_at(self.equations, self.point).over(box)
            except (NotInvertibleError, NotProvedError):
                return None

    def replay(self) -> MoveCertificate:
        """The same, what was found proved once more from its data alone.

        Raises:
            NotProvedError: It does not hold.
        """
        point = self.point.replay()
        if self.proved is None:
            tubes = tuple(tube.replay() for tube in self.tubes)
            return replace(self, point=point, enclosure=self.enclosure.replay(), tubes=tubes)
        proved = self.proved.replay()
        moved = proved.premises[0]
        if self.starts is None:
            return replace(self, point=point, proved=proved, enclosure=self.enclosure.resting_on(moved))
        tubes = tuple(tube.resting_on(held) for tube, held in zip(self.tubes, moved.premises, strict=True))
        return replace(self, point=point, proved=proved, enclosure=tubes[0].enclosure, tubes=tubes)
