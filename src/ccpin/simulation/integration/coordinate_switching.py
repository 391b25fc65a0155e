"""Coordinates that follow a motion: before a run's independent coordinates end, others take their place.

Where ψ_q′ loses rank and φ_q′ does not, the mechanism is fine and the coordinates are not: a four-bar measured by its
rocker at the end of the rocker's swing, a ball's component after half a turn. A run goes on from there in a sibling
(`ccpin.mechanism.other_coordinates`), the same mechanism in other coordinates: q′ and q̇′ are the same before and after,
so energy, λ and closure are too, and q̇′ = ρ q̇ of the sibling lies in ker φ_q′. Three revolutes that are a ball joint
are the ball from there on (`concurrent_revolutes`), as their gimbal lock is none of the mechanism's.

What is reported is in the run's own coordinates all along, q = α(q′) and q̇ = α_q′ q̇′, which are always defined, and q′
has the columns of its own joints: of the angles that a ball may have, those nearest to the ones told before. What is
*stated* in them, as a feedback law or wrenches that read a State are, ends where they end.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import Array, frozen
from ccpin.control.control_law import ControlLaw, idle, undelayed
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.dynamics.state import State, StateModel
from ccpin.dynamics.wrenches import Pushes, Wrenches, wrench_rows
from ccpin.kinematics.coordinates import component_names
from ccpin.mechanism.motion.mobility import tangent
from ccpin.mechanism.other_coordinates.concurrent_revolutes import Balls, balls_of
from ccpin.mechanism.other_coordinates.independent_sets import LEVERAGE, Measure, best_independent, with_independent

_WORSE = 10.0  # times the leverage that coordinates began with: left there
_MOST_LEVERAGE = 1e3  # at which any are left
_FURTHEST_TURN = 2.0  # rad, of a ball from its chart's centre; the chart ends at π
_RANK_LOSS = 1e-4  # of φ_q′'s conditioning: the mechanism itself is singular below
_FRESH = 1e-9  # rad or m: a motion that has come no farther since a change is not changed again
_NO_MASS = 1e-6  # of the masses that single coordinates move: one below is none
_TAKES_PART = 0.1  # of the largest rate: joints that are named


class ReportedState(NamedTuple):
    """Where a motion is, as it is reported: q, q̇ and q′."""

    q: Array
    v: Array
    q_free: Array


class CoordinateSwitching:
    """Whose coordinates a run is in, when they are to be left, and for which.

    They are left where they have become ten times worse than they were when taken up (or a thousand times worse than
    the best), so that a run does not change to and fro: those taken up are the best there, and between any two changes
    lies a motion.

    Args:
        home: The model the run was started with; what is reported is in its coordinates.
        law: The law, which may be stated in them.
        wrenches: On links; functions of a State are stated in them too.
        reads: What else reads a State of `home`, in words (events, a region, limits), or nothing.
        rubbing: The joints (or components) with friction.

    Attributes:
        model: The model whose coordinates the run is in: `home` or a sibling, on ball joints where it has such.
        law: The law; it may be replaced.
        measure: How well the present coordinates measure the motion.
        most: The largest leverage (`Measure`) at which the present coordinates are kept.
    """

    def __init__(
        self,
        home: ReducedModel,
        law: ControlLaw,
        wrenches: Wrenches | Pushes | None = None,
        reads: str = "",
        rubbing: Sequence[str] = (),
    ) -> None:
        self.home = self.model = home
        self.law, self._wrenches, self._reads, self._rubbing = law, wrenches, reads, rubbing
        self._siblings: dict[tuple[str, ...], ReducedModel] = {}
        self.measure = Measure(home.mechanism)
        self.most = np.inf
        self._since = self._told = np.array(home.mechanism.q_reference)

    @cached_property
    def _balls(self) -> Balls | None:
        tree = self.home.mechanism.tree
        pushed = () if self._wrenches is None or callable(self._wrenches) else self._wrenches
        return balls_of(self.home.mechanism, {*(tree.split(name)[0] for name in self._rubbing), *pushed})

    @cached_property
    def _base(self) -> ReducedModel:
        """`home` on its ball joints."""
        home = self.home
        return home if self._balls is None else ReducedModel(self._balls.mechanism, home.gravity_vector)

    # In the coordinates of `home`.

    @property
    def own(self) -> ReducedModel:
        """The model of `home`'s coordinates on the joints that `model` has."""
        return self._own(self.model)

    @property
    def balls(self) -> tuple[str, ...]:
        """The ball joints that the motion is on."""
        balls = self._balls_of(self.model)
        return () if balls is None else balls.names

    def reported(self, state: State, v: Array) -> ReportedState:
        """Where a motion is, as it is reported."""
        return ReportedState(*self._own(state.model).reading(state, v), self.told(state))

    def acceleration(self, state: State, v: Array, a: Array) -> Array:
        """q̈ likewise."""
        return self._own(state.model).reading_rate(state, v, a)

    def told(self, state: State) -> Array:
        """q′ likewise, in the columns of `home`'s joints."""
        balls = self._balls_of(state.model)
        return state.q_free if balls is None else self._tell(balls, state.q_free)

    def told_rate(self, state: State, v_free: Array) -> Array:
        """q̇′ likewise; also of several columns."""
        balls = self._balls_of(state.model)
        return v_free if balls is None else balls.told_rate(self.told(state), v_free)

    def told_forces(self, model: StateModel, forces: Array) -> Array:
        """Forces on a model's joints likewise."""
        balls = self._balls_of(model)
        return forces if balls is None else balls.told_forces(forces)

    def told_row(self, q_free: Array, v_free: Array) -> tuple[Array, Array]:
        """q′ and q̇′ likewise, of q′ and q̇′ of `model`."""
        balls = self._balls_of(self.model)
        if balls is None:
            return q_free, v_free
        told = self._tell(balls, q_free)
        return told, frozen(balls.told_rate(told, v_free))

    def told_rows(self, q_free: Array, v_free: Array, forces: Array) -> tuple[Array, Array, Array]:
        """q′, q̇′ and forces likewise, of consecutive instants of `model`, a row each."""
        if self._balls_of(self.model) is None:
            return q_free, v_free, forces
        told = [self.told_row(*row) for row in zip(q_free, v_free, strict=True)]
        rubbed = [self.told_forces(self.model, row) for row in forces]
        return np.array([q for q, _ in told]), np.array([v for _, v in told]), np.array(rubbed)

    def _tell(self, balls: Balls, q_free: Array) -> Array:
        """q′ likewise, nearest to the one told before."""
        self._told = frozen(balls.told(q_free, self._told))
        return self._told

    def _balls_of(self, model: StateModel) -> Balls | None:
        """The balls that a model has in place of `home`'s joints, if it has any."""
        return None if self._own(model) is self.home else self._balls

    def seen(self, state: State) -> State:
        """A State as a caller sees it, on `home`'s joints.

        Raises:
            SingularConfigurationError: In gimbal lock there is none.
        """
        balls = self._balls_of(state.model)
        if balls is None:
            return state
        told, home = self.told(state), self.home
        names = best_independent(home.mechanism, told, balls.told_rate(told, state.rho))
        if names == home.mechanism.independent:
            return home.at(home.alpha(told), told)
        sibling = ReducedModel(with_independent(home.mechanism, names, told), home.gravity_vector)
        return sibling.at(sibling.alpha(told), told)

    def _own(self, model: StateModel) -> ReducedModel:
        return self.home if model.mechanism.tree is self.home.mechanism.tree else self._base

    # What is stated in them.

    def begin(self, state: State) -> None:
        """Take up the coordinates of the State's model there."""
        self._since = state.q_free
        self.most = min(_WORSE * max(1.0, self.measure.leverage(state.rho)), _MOST_LEVERAGE)

    @property
    def stated(self) -> str | None:
        """What is stated in the coordinates of `home`, in words; ``None`` if nothing is."""
        return self.stated_under(self.law)

    def stated_under(self, law: ControlLaw) -> str | None:
        """The same under another law."""
        law = undelayed(law)
        if not law.everywhere:
            return f"{type(law).__name__} is stated"
        if callable(self._wrenches):
            return "the wrenches, a function of a State, are stated"
        driven = self.home.mechanism.direct and not self.home.coordinates.constant
        if driven and not idle(law):
            return "a motor on a component of a joint acts"
        return self._reads or None

    def poor(self, state: State) -> bool:
        """Whether the coordinates are to be left at a State."""
        if self.stated is not None:
            return False
        return self.measure.leverage(state.rho) > self.most or self.measure.turned(state.q_free) > _FURTHEST_TURN

    def leaving(self) -> dict[str, Any]:
        """What tells where `poor` is, as the compiled core takes it."""
        return {"most": self.most, **self.measure.numbers(), "turn": _FURTHEST_TURN}

    @property
    def wrenches(self) -> Array | None:
        """Constant wrenches as the compiled core takes them for `model`."""
        return wrench_rows(self.model.mechanism.tree, None if callable(self._wrenches) else self._wrenches)

    def change(self, state: State, v: Array) -> tuple[State, Array] | None:
        """The same configuration and velocity in the best coordinates there, which the run is in from here on.

        ``None`` where it cannot change: something is stated in its coordinates, or they are the best there already.
        """
        if self.stated is not None or np.abs(state.q_free - self._since).max() < _FRESH:
            return None
        measure = self.measure
        if measure.leverage(state.rho) <= LEVERAGE and measure.turned(state.q_free) <= _FURTHEST_TURN:
            return None
        q_free, v_free, rho = state.q_free, state.v_free(v), state.rho
        if self._balls is not None and self.own is self.home:
            v_free, rho = (self._balls.gathered_rate(q_free, rate) for rate in (v_free, rho))
            self._told, q_free = q_free, self._balls.gathered(q_free)
        self.model = self._measured_by(best_independent(self._base.mechanism, q_free, rho), q_free)
        self.measure = Measure(self.model.mechanism)
        moved = self.model.at(self.model.alpha(q_free), q_free)
        velocity = self.model.coordinates.jacobian(moved.q_free) @ v_free
        self.begin(moved)
        return moved, velocity

    def back(self, state: State, v: Array) -> tuple[State, Array]:
        """The same configuration and velocity in the coordinates of `home`.

        Raises:
            SingularConfigurationError: They are singular there.
        """
        q, velocity, told = self.reported(state, v)
        moved = self.home.at(q, told)
        self.model, self.measure = self.home, Measure(self.home.mechanism)
        self.begin(moved)
        return moved, velocity

    def _measured_by(self, names: tuple[str, ...], centre: Array) -> ReducedModel:
        """The model in coordinates with a centre of their charts; one for each set whose charts have none."""
        if names == self._base.mechanism.independent and self._base.coordinates.constant:
            return self._base
        found = self._siblings.get(names)
        if found is None or not found.coordinates.constant:
            mechanism = with_independent(self._base.mechanism, names, centre)
            self._siblings[names] = found = ReducedModel(mechanism, self.home.gravity_vector)
        return found

    def memory(self) -> dict[str, Array]:
        """Whose coordinates the run is in, since where and up to what leverage, as arrays; `recall` brings it back."""
        names = () if self.model is self.home else self.model.mechanism.independent
        return {
            "measured_by": np.array(names, dtype=str),
            "since": self._since,
            "most": np.array(self.most),
            "told": self._told,
        }

    def recall(self, memory: Mapping[str, Array]) -> ReducedModel:
        """Be in the coordinates of a memory; their model."""
        names = tuple(memory["measured_by"].tolist())
        self._since, self.most = np.array(memory["since"]), float(memory["most"])
        self._told = np.array(memory["told"])
        self.model = self._measured_by(names, self._since) if names else self.home
        self.measure = Measure(self.model.mechanism)
        return self.model

    def why(self, t: float, state: State, reason: str) -> str:
        """Why the run ends at a State, in a sentence: whose end it is, the mechanism's or that of coordinates."""
        mechanism = state.model.mechanism
        left = tangent(mechanism.constraints(), state.q_free).conditioning(mechanism.mobility.rank)
        place = np.array2string(self.told(state), precision=6, separator=", ", max_line_width=10**6)
        if left < _RANK_LOSS:
            return (
                f"at t = {t:.6g} s the mechanism itself is singular at q′ = {place}: φ_q′ loses rank (singular values "
                f"down to {left:.1e} of the largest)"
            )
        if self.stated is not None:
            names = ", ".join(self.home.mechanism.independent)
            return f"at t = {t:.6g} s the coordinates {names} end, in which {self.stated}: {reason}"
        idle, mass = _massless(state)
        if mass < _NO_MASS:
            return (
                f"at t = {t:.6g} s {idle} can turn or slide without moving any mass, at q′ = {place}: D is nearly "
                f"singular ({mass:.1e}); give the links between them inertia, or make them one joint"
            )
        return f"at t = {t:.6g} s {reason}"


def _massless(state: State) -> tuple[str, float]:
    """The joints that move in the direction of least mass, and that mass relative to that of single coordinates."""
    alone = np.sqrt(np.diag(state.D))
    masses, directions = np.linalg.eigh(state.D / np.outer(alone, alone))
    motion = np.abs(state.rho @ (directions[:, 0] / alone))
    names = component_names(state.model.mechanism.tree)
    return ", ".join(name for name, x in zip(names, motion, strict=True) if x > _TAKES_PART * motion.max()), masses[0]
