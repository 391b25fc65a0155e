"""What a run meets beside the equations of motion: limits, contacts and the motors between law and joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import Array, records
from ccpin.control.control_law import ControlLaw, idle, undelayed
from ccpin.control.sampling import ContinuousCommands, SampledCommands, Sampling
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.dynamics.state import State
from ccpin.errors import InvalidInputError
from ccpin.mechanism.mechanism import Mechanism
from ccpin.simulation.events.surfaces import Surface, SurfaceWatch
from ccpin.simulation.events.watches import Watch
from ccpin.simulation.plant.contact import Contact, ContactForces
from ccpin.simulation.plant.limits import Limits, Saturation, Stops
from ccpin.simulation.plant.motors import CurrentLoops, MotorModel, TorqueSpeed


class EffortBounds(NamedTuple):
    """The least and largest u of each motor."""

    lower: Array
    upper: Array

    def hold(self, u: Array) -> bool:
        """Whether they contain u."""
        return bool(((u >= self.lower) & (u <= self.upper)).all())

    def numbers(self) -> dict[str, list[float]]:
        """The same as the compiled core takes them."""
        return {name: bound.tolist() for name, bound in self._asdict().items()}


class Plant:
    """The bench on which a mechanism moves, checked against it.

    Args:
        model: The reduced model.
        limits: How limits are treated.
        contacts: Which points of links meet planes.
        motors: What stands between commands and efforts.

    Attributes:
        loaded: Whether stops or contacts may push on the joints.
        plain: Whether bounds of efforts are all of this that acts; a motion that stays within them is the motion
            without. effort_bounds: these.

    Raises:
        InvalidInputError: A bad argument.
    """

    def __init__(
        self, model: ReducedModel, limits: Limits | None, contacts: Sequence[Contact], motors: MotorModel | None
    ) -> None:
        if not isinstance(limits, Limits | None) or not isinstance(motors, MotorModel | None):
            raise InvalidInputError("limits must be a `Limits`, motors a `MotorModel`")
        self._model, self.limits, self.motors = model, limits or Limits(), motors or MotorModel()
        self._saturation = Saturation(model, self.limits)
        self._curve = TorqueSpeed(model, self.motors)
        stops = [Stops(model, self.limits)] if self.limits.position == "stop" else []
        contacts = records(contacts, "contacts", Contact)
        self._pushing: list[Stops | ContactForces] = [*stops, *([ContactForces(model, contacts)] if contacts else [])]
        self.loaded = bool(self._pushing)
        CurrentLoops(self.motors, model.n_actuated)
        ends = "end" in (self.limits.position, self.limits.velocity, self.limits.effort)
        self.effort_bounds = EffortBounds(self._saturation.lower, self._saturation.upper)
        self.plain = not (self.loaded or ends or self.motors.held or self._curve.acts or self._saturation.by_speed)

    def check_law(self, law: ControlLaw, sampling: Sampling | None) -> None:
        """Lag and rate need commands that are held, a law that remembers its own period.

        Raises:
            InvalidInputError: They are not, or it is another.
        """
        if self.motors.held and sampling is None and not idle(law):
            raise InvalidInputError(
                "motors with a lag or a rate need commands that are held: run the law with sampling=, or step(u, dt)"
            )
        period = None if sampling is None else sampling.period
        if law.period is not None and law.period != period:
            loop = "continuously" if period is None else f"every {period:g} s"
            raise InvalidInputError(
                f"{type(undelayed(law)).__name__} remembers from sample to sample, {law.period:g} s apart, and would "
                f"be asked {loop}: give sampling=Sampling({law.period:g})"
            )

    def loads(self, t: float, state: State, v: Array) -> Array | None:
        """What stops and contacts do to the free system's joints, N m or N, of shape (n′,); ``None`` where none is."""
        if not self.loaded:
            return None
        return np.asarray(sum(one.loads(t, state, v) for one in self._pushing))

    def potential(self, state: State) -> float:
        """The energy in stops and contacts, J."""
        return float(sum(one.potential(state) for one in self._pushing))

    def commands(
        self, inner: ContinuousCommands | SampledCommands, t: float, state: State, v: Array
    ) -> ContinuousCommands | SampledCommands | MotorCommands:
        """Commands as the motors follow them; themselves where motors follow every one."""
        bounds = [bounds for bounds in (self._saturation, self._curve) if bounds.acts]
        if not (bounds or self.motors.held):
            return inner
        loops = CurrentLoops(self.motors, self._model.n_actuated) if self.motors.held else None
        if loops is not None and isinstance(inner, SampledCommands):
            loops.settle(inner.effort(t, state, v))
        return MotorCommands(inner, bounds, loops)

    def saturation(self, commands: ContinuousCommands | SampledCommands | MotorCommands) -> SurfaceWatch | None:
        """Tells where motors give less than they are asked for; ``None`` where they never do."""
        if not isinstance(commands, MotorCommands) or not commands.bounded:
            return None
        names = self._motor_names()
        surfaces = [Surface(f"{name}: saturated", f"{name}: within its limits") for name in names]
        return SurfaceWatch(commands.margins, surfaces, short_steps=False)

    def watches(self, commands: ContinuousCommands | SampledCommands | MotorCommands) -> list[Watch]:
        """What else is to be looked for."""
        watches: list[Watch] = []
        for one in self._pushing:
            watches.append(SurfaceWatch(one.gaps, [Surface(f"{name}: met", f"{name}: left") for name in one.names]))
        mechanism = self._model.mechanism
        if self.limits.position == "end":
            stops = Stops(self._model, Limits())
            watches.append(SurfaceWatch(stops.gaps, [Surface(name, name) for name in stops.names], terminal=True))
        if self.limits.velocity == "end":
            watches.append(_speed_watch(mechanism))
        names = self._motor_names()
        if self._saturation.by_speed:
            surfaces = [Surface(f"{name}: near its speed limit", f"{name}: slower again") for name in names]
            watches.append(SurfaceWatch(self._saturation.headroom, surfaces, short_steps=False))
        if self.limits.effort == "end":
            lower, upper = mechanism.motors.limits.T
            surfaces = [Surface(f"{name}: asked for more than it can give", name) for name in names]
            watches.append(
                SurfaceWatch(
                    lambda t, state, v: _margins(commands.effort(t, state, v), lower, upper),
                    surfaces,
                    terminal=True,
                    short_steps=False,
                )
            )
        return watches

    def _motor_names(self) -> list[str]:
        return [f"motor of '{motor.joint}'" for motor in self._model.mechanism.motors.each]


class MotorCommands:
    """Commands through the motors' current loops and within what the motors can give.

    Args:
        inner: Who commands.
        bounds: What bounds u.
        loops: The current loops, if they take time.

    Attributes:
        bounded: Whether u has bounds.
    """

    def __init__(
        self,
        inner: ContinuousCommands | SampledCommands,
        bounds: Sequence[Saturation | TorqueSpeed],
        loops: CurrentLoops | None,
    ) -> None:
        self._inner, self._bounds, self._loops = inner, tuple(bounds), loops
        self.bounded = bool(bounds)

    @property
    def law(self) -> ControlLaw:
        """The law; it may be replaced while the run goes on."""
        return self._inner.law

    @law.setter
    def law(self, law: ControlLaw) -> None:
        self._inner.law = law

    def instant(self, t: float, state: State, v: Array) -> float:
        """Take the command where one is due; when the next one is."""
        due = self._inner.instant(t, state, v)
        if self._loops is not None:
            self._loops.command(t, self._inner.effort(t, state, v))
        return due

    def effort(self, t: float, state: State, v: Array) -> Array:
        """u as the motors exert it."""
        lower, upper = self._between(state, v)
        return np.minimum(np.maximum(self._reached(t, state, v), lower), upper)

    def margins(self, t: float, state: State, v: Array) -> Array:
        """How far each motor is from what it can give, negative where it gives less than it is asked for."""
        return _margins(self._reached(t, state, v), *self._between(state, v))

    def next_switch(self, t: float) -> float | None:
        """The law's, or the end of a ramp before it."""
        switch = self._inner.next_switch(t)
        if self._loops is None or switch is None:
            return switch
        return min(switch, self._loops.next_switch(t))

    def memory(self) -> dict[str, Array]:
        """What is remembered, as arrays; `recall` brings it back."""
        return self._inner.memory() | (self._loops.memory() if self._loops is not None else {})

    def numbers(self) -> dict[str, Any] | None:
        """The sampled loop in plain numbers, as the compiled core takes it."""
        return self._inner.numbers()

    def adopt(self, memory: Any) -> None:
        """Go on from what the compiled core's loop remembers."""
        self._inner.adopt(memory)

    def recall(self, memory: Mapping[str, Array]) -> None:
        """Go on from what another run of the same motors remembered."""
        self._inner.recall(memory)
        if self._loops is not None:
            self._loops.recall(memory)

    def _reached(self, t: float, state: State, v: Array) -> Array:
        """What the current loops have made of the command."""
        return self._inner.effort(t, state, v) if self._loops is None else self._loops.effort(t)

    def _between(self, state: State, v: Array) -> tuple[Array, Array]:
        pairs = [bounds.bounds(state, v) for bounds in self._bounds]
        if len(pairs) == 1:
            return pairs[0]
        lower = np.max([pair[0] for pair in pairs], axis=0, initial=-np.inf)
        return lower, np.min([pair[1] for pair in pairs], axis=0, initial=np.inf)


def _margins(u: Array, lower: Array, upper: Array) -> Array:
    return np.minimum(u - lower, upper - u)


def _speed_watch(mechanism: Mechanism) -> SurfaceWatch:
    """Ends a motion where a joint is faster than its limit."""
    joints = mechanism.joints
    places = np.flatnonzero((joints.velocity > 0) & np.isfinite(joints.velocity))
    most = joints.velocity[places]
    names = [f"{joints.names[k]}: faster than {joints.velocity[k]:g}" for k in places]
    surfaces = [Surface(name, name) for name in names]
    return SurfaceWatch(lambda t, state, v: most - np.abs(state.v_free(v)[places]), surfaces, terminal=True)
