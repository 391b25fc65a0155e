"""One motion under way: the integrator's loop from switch to switch, and in between from event to event.

The integrator's vector is x = (q, q̇). At every evaluation q′ = σ(q) is found once, by Newton from the last accepted
step's State, and both the law and the dynamics read the State found; so the loops are closed to solver tolerance at
every sample and never drift. The integrator starts afresh where the equations of motion change: at every command of a
sampled controller, at the switching times of laws and forces, and where a joint with dry friction halts or breaks
loose. Output is read off the dense output and changes nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import Array, frozen
from ccpin.control.sampling import ContinuousCommands, SampledCommands
from ccpin.dynamics.state import State
from ccpin.dynamics.wrenches import Pushes, Wrenches, pushes_of
from ccpin.errors import ConvergenceError, InvalidInputError, SingularConfigurationError
from ccpin.simulation.events.samples import CHANGED, EventRecord, StateSample, Stop
from ccpin.simulation.events.surfaces import SurfaceWatch
from ccpin.simulation.events.watches import AcceptedStep, Instant, Watch
from ccpin.simulation.integration.budget import Allowance, Budget
from ccpin.simulation.integration.coordinate_switching import CoordinateSwitching
from ccpin.simulation.integration.core_runs import ConstantEffortRuns
from ccpin.simulation.integration.recorder import Recorder
from ccpin.simulation.integration.step_size import HasSwitches
from ccpin.simulation.plant.plant import MotorCommands, Plant
from ccpin.simulation.plant.stick_slip import ActingLoads, StickSlip, StickSlipWatch

_CREEPING = 1e-7  # s: shorter steps creep
_MOST_CREEPING = 200  # creeping steps in a row that end the coordinates
_CREEPING_RCOND = 1e-3  # of ψ_q′: above it short steps are no singularity's doing
_SHORTEST_STEP = 1e-10  # s: where a refused step was shortened below, the coordinates end
_REFUSALS = (ConvergenceError, SingularConfigurationError)


class IntegrationSettings(NamedTuple):
    """How a motion is integrated; `Simulator` says what each is."""

    solver_class: Any
    rtol: float
    atol: float
    max_step: float | None
    singular_rcond: float
    wrenches: Wrenches | Pushes | None
    natural_step: float


class Run:
    """One motion: where it is, what acts on it and what is watched for.

    Args:
        settings: How it is integrated.
        commands: Who commands the motors.
        contact: The joints with friction, in the coordinates of `switching.home`.
        plant: Limits, contacts and motors.
        watches: What is watched for. saturation: what of it tells where motors give less than they are asked for.
        switching: Whose coordinates the motion is in.
        here: Where the motion begins, in the coordinates of `switching.model`.
        constant: What takes the motion to the compiled core while its effort is constant, where it may.

    Attributes:
        model: The model in whose coordinates the motion is: the one given, or a sibling of it.
        here: The last instant that is certain. first_step: what the integrator would try next, s.
        evaluations: Of the equations of motion, so far.
        saturation: As given.
        in_core: Whether the compiled core takes its stretches under a constant effort.
    """

    def __init__(
        self,
        settings: IntegrationSettings,
        commands: ContinuousCommands | SampledCommands | MotorCommands,
        contact: StickSlip,
        plant: Plant,
        watches: tuple[Watch, ...],
        switching: CoordinateSwitching,
        here: Instant,
        constant: ConstantEffortRuns | None = None,
        saturation: SurfaceWatch | None = None,
    ) -> None:
        self.switching, self.model = switching, switching.model
        self.settings, self.commands = settings, commands
        self.contact = contact if self.model is switching.home else contact.moved(self.model)
        self._plant = plant
        self.here, self.evaluations = here, 0
        self.first_step: float | None = None
        self._pushes = pushes_of(self.model.mechanism.tree, settings.wrenches)
        self.saturation = saturation
        self._own = watches if saturation is None else (*watches, saturation)
        self._watches = self._all_watches()
        self._watched = any(watch.short_steps for watch in self._watches)
        self._creeping, self._latest, self._settles = 0, np.inf, False
        self._nothing = np.zeros(switching.home.mechanism.n_free)
        self._constant, self.in_core = constant, False

    @property
    def constant_effort(self) -> Array | None:
        """The u under which the compiled core may go on in any coordinates; ``None`` where it may not."""
        if self._constant is None or self.switching.stated is not None:
            return None
        return self._constant.effort(self.switching.law, self.switching.home.n_actuated)

    def advance(
        self, until: float, record: Recorder, budget: Budget, watch: Watch | None = None, commanded: bool = True
    ) -> Stop | None:
        """Move on to a time.

        Args:
            until: The time, s.
            record: Takes the samples that fall due, and what happens.
            budget: What that may cost.
            watch: One thing more to watch for.
            commanded: Whether a sampled law's command due at that time is given, too.

        Returns:
            Stop: Why the motion ended before; ``None`` if it did not.

        Raises:
            CcpinError: The friction problem, a law or an event failed; `here` is the last certain instant. So it is
                with whatever else a law raises.
        """
        limits = Allowance.of(budget, self.evaluations)
        self.come_back(watch is not None)
        self._settles = watch is not None
        self.in_core = not self._settles and self.constant_effort is not None
        extra = () if watch is None else (watch,)
        for one in (*self._watches, *extra):
            one.begin(self.here)
        while True:
            if self.here.t >= until and not commanded:
                return None
            command = self.commands.instant(*self.here)
            self._begin()
            record.up_to(self.here, self, _slack(self.here.t))
            if self.here.t >= until:
                return None
            switch, longest = self._next_switch(), self.longest_step()
            end = min(command, until)
            switches = switch < end - _slack(end)
            end = switch if switches else end
            if not self.in_core and self.first_step is None and self.here.t + longest < end:
                end, switches = self.here.t + longest, False  # SciPy probes as far as the end for one
            self._latest = end - _slack(end)
            while self.here.t < end:
                core = self.in_core
                if core:
                    stop = self._core_leg(end, longest, record, limits)
                else:
                    stop = self._leg(end, longest, record, (*self._watches, *extra), limits)
                if stop is not None:
                    return stop
                if core and not self.in_core:
                    break  # a first step is SciPy's to find
                if self.here.t < end:
                    self._begin()
            self.first_step = None if switches else self.first_step

    def come_back(self, settles: bool) -> None:
        """Be in the coordinates of `switching.home` again, where something is stated in them or settles in them.

        Raises:
            SingularConfigurationError: They are singular here.
        """
        if self.model is not self.switching.home and (settles or self.switching.stated is not None):
            self._take_up(*self.switching.back(self.here.state, self.here.v))

    def sample(self, instant: Instant) -> StateSample:
        """The motion at an instant, in the present mode of its joints."""
        t, state, v = instant
        drive, switching = self.drive(*instant), self.switching
        friction = self._nothing
        if self.contact.rubs:
            friction = switching.told_forces(state.model, self.contact.free_forces(state, v, drive))
        a = self.contact.acceleration(state, v, lambda: drive)
        q, velocity, q_free = switching.reported(state, v)
        return StateSample(
            t=float(t),
            q=q,
            v=frozen(velocity),
            a=switching.acceleration(state, v, a),
            u=self.commands.effort(t, state, v),
            q_free=q_free,
            v_free=frozen(switching.told_rate(state, state.v_free(v))),
            friction=friction,
            limits=self._nothing if drive.loads is None else drive.loads,
            closure_error=float(np.linalg.norm(self.model.parametrization.constraints.residual(state.q_free))),
        )

    def closed(self, x: Array, near: State | None = None) -> tuple[State, Array]:
        """The State at x's q, and q̇, which laws and all others of the user's may read only."""
        near = near or self.here.state
        q = self.model.coordinates.normalize(x[: self.model.nq])
        return near if (q == near.q).all() else self.model.at(q, near), frozen(x[self.model.nq :])

    def drive(self, t: float, state: State, v: Array) -> ActingLoads:
        """What acts from outside."""
        u = self.commands.effort(t, state, v)[: state.model.n_actuated]  # a sibling may have no motors: then u = 0
        return ActingLoads(u, self._pushes(t, state, v), self._plant.loads(t, state, v))

    # From switch to switch.

    def _begin(self) -> None:
        """Let every joint with friction rest or slide from here on."""
        if self.contact.eventful:
            t, state, v = self.here
            self.here = Instant(t, state, frozen(self.contact.begin(state, v, self.drive(t, state, v))))

    def _switches(self) -> tuple[float | None, ...]:
        """When the law and the wrenches change next."""
        wrenches, t = self.settings.wrenches, self.here.t
        switch: float | None = np.inf
        if wrenches is not None and not isinstance(wrenches, Mapping):
            switch = wrenches.next_switch(t) if isinstance(wrenches, HasSwitches) else None
        return self.commands.next_switch(t), switch

    def _next_switch(self) -> float:
        switch = min((switch for switch in self._switches() if switch is not None), default=np.inf)
        if not switch > self.here.t:
            raise InvalidInputError(f"next_switch({self.here.t}) returned {switch}; it must be later than that")
        return switch

    def longest_step(self) -> float:
        """How far a step of the integrator may reach from here, s; `step_size` says why."""
        if self.settings.max_step is not None:
            return self.settings.max_step
        return self.settings.natural_step if self._watched or None in self._switches() else np.inf

    # From event to event.

    def _core_leg(self, end: float, longest: float, record: Recorder, limits: Allowance) -> Stop | None:
        """Go on in the compiled core, as far as `end` or as it can; beyond that and in these coordinates, by `_leg`."""
        u, here = self.constant_effort, self.here
        assert self._constant is not None
        assert u is not None
        times = record.due(end - 2 * _slack(end))
        numbers = {"until": end, "times": times, "first_step": self.first_step or 0.0, "max_step": longest}
        numbers |= {"friction": self.contact.numbers()}
        found = self._constant.run(here, numbers | limits.left(self.evaluations).numbers(), u, self.switching)
        if found is None:
            self.in_core = False
            return None
        self.here, self.first_step = found.instant(here.state.model), found.first_step or None
        self._creeping = found.creeping
        self.contact.adopt(found.mode)
        self.evaluations += found.evaluations
        record.take(found.samples(u, self.switching))
        if found.raised is not None:
            raise found.raised
        stop = None
        if found.ended == "left":
            self.in_core = False
            ending = self._ending()
            stop = None if ending is None else self._elsewhere(record, ending)
        return stop or limits.exceeded(self.evaluations, self.here.t)

    def _leg(
        self, end: float, longest: float, record: Recorder, watches: tuple[Watch, ...], limits: Allowance
    ) -> Stop | None:
        """Integrate smooth equations up to `end`, up to an event that changes them, or to the end of the coordinates.

        Where σ fails inside a trial step, try again with a shorter one. Many steps in a row of less than a hundred
        nanoseconds are an approach to a singularity, where accelerations grow without bound.
        """
        shortened: float | None = None
        solver = None
        while self.here.t < end:
            try:
                solver = solver or self._solver(end, longest, shortened or self.first_step)
                message = solver.step()
                if solver.status == "failed":
                    return self._gave_up(record, f"the integrator failed at t = {self.here.t:.6g} s: {message}")
                seen = bool(watches) or record.due_before(solver.t)
                step = AcceptedStep(self.here, float(solver.t), solver.dense_output() if seen else None, self.closed)
                halts = [(at, watch) for watch in watches if (at := watch.look(step)) is not None]
                reached, cause = min(halts, key=lambda halt: halt[0], default=(step.end, None))
                arrived = step.at(reached) if reached < step.end else Instant(step.end, *self.closed(solver.y))
            except _REFUSALS as error:
                trial = shortened or min(getattr(solver, "h_abs", None) or np.inf, end - self.here.t)
                shortened = 0.25 * trial
                if shortened < _SHORTEST_STEP:
                    return self._elsewhere(record, str(error), error)
                solver = None
                continue
            shortened, self.first_step = None, getattr(solver, "h_abs", None)
            record.within(step, min(reached, end - 2 * _slack(end)), self)
            for watch in watches:
                record.happened([self._told(event) for event in watch.accept(step, reached)])
            ending = self._arrive(arrived, longest, cut=cause is not None)
            stop = None if cause is None else cause.act(self.here)
            if stop is None and ending is not None:
                stop = self._elsewhere(record, ending)
            if stop is None:
                stop = limits.exceeded(self.evaluations, self.here.t)
            if stop is not None or cause is not None or ending is not None:
                return stop
        return None

    def _arrive(self, arrived: Instant, longest: float, cut: bool) -> str | None:
        """Make an instant the present one; why its coordinates are to be left there, if they are.

        A step that an event cut short does not creep.
        """
        short = not cut and arrived.t - self.here.t < _CREEPING
        self.here = arrived
        stuck = longest > _CREEPING if self._follows() else arrived.state.rcond < _CREEPING_RCOND
        self._creeping = self._creeping + 1 if short and stuck else 0
        return self._ending()

    def _ending(self) -> str | None:
        """Why the coordinates are to be left at the present instant, if they are."""
        state = self.here.state
        rcond = state.rcond
        if rcond < self.settings.singular_rcond or self._creeping >= _MOST_CREEPING:
            return f"ψ_q′ is nearly singular (rcond {rcond:.1e})"
        return "" if self._follows() and self.switching.poor(state) else None

    def _follows(self) -> bool:
        """Whether the coordinates may be changed: nothing is stated in them, and nobody waits for them to settle."""
        return not self._settles and self.switching.stated is None

    def _elsewhere(self, record: Recorder, reason: str, error: BaseException | None = None) -> Stop | None:
        """Go on in other coordinates; where there are none, or something is stated in these, stop for the reason."""
        t, state, v = self.here
        found = self.switching.change(state, v) if self._follows() else None
        if found is None and reason:
            return Stop("singular", self.switching.why(t, state, reason), error)
        if found is not None:
            self._take_up(*found)
            q, velocity, q_free = self.switching.reported(*found)
            name = CHANGED + ", ".join(self.model.mechanism.independent)
            record.happened([EventRecord(name, t, q, np.array(velocity), q_free)])
        return None

    def _told(self, event: EventRecord) -> EventRecord:
        """An event in the coordinates that the motion was started in."""
        if self.model is self.switching.home:
            return event
        q, v, q_free = self.switching.reported(self.model.at(event.q, event.q_free), event.v)
        return event._replace(q=q, v=v, q_free=q_free)

    def _take_up(self, state: State, v: Array) -> None:
        """Be in the coordinates of a State's model from here on."""
        self.model, self.here = self.switching.model, Instant(self.here.t, state, frozen(v))
        self.contact = self.contact.moved(self.model)
        self._pushes = pushes_of(self.model.mechanism.tree, self.settings.wrenches)
        self._watches, self._creeping = self._all_watches(), 0
        self.in_core = not self._settles and self.constant_effort is not None

    def _all_watches(self) -> tuple[Watch, ...]:
        friction = (StickSlipWatch(self.contact, self.drive),) if self.contact.eventful else ()
        return (*friction, *self._own)

    def _gave_up(self, record: Recorder, message: str) -> Stop | None:
        """The integrator found no step short enough: beside a singularity because of that.

        Late in a long motion it comes to this: at 1e7 s times are 2e-9 s apart, and steps of ten of these are no less.
        """
        rcond = self.here.state.rcond
        if rcond < _CREEPING_RCOND:
            return self._elsewhere(record, f"ψ_q′ is nearly singular (rcond {rcond:.1e})")
        return Stop("failed", message)

    def _solver(self, end: float, longest: float, first_step: float | None) -> Any:
        t, state, v = self.here
        first = None if first_step is None else min(first_step, end - t, longest)
        x = np.concatenate([state.q, v])
        tolerances = {"rtol": self.settings.rtol, "atol": self.settings.atol, "max_step": longest}
        return self.settings.solver_class(self._derivative, t, x, end, first_step=first, **tolerances)

    def _derivative(self, t: float, x: Array) -> Array:
        """(q̇, q̈) at x; where the leg ends in a switch, as it is before."""
        self.evaluations += 1
        if not np.isfinite(x).all():
            raise ConvergenceError("the state is no longer finite")
        state, v = self.closed(x)
        a = self.contact.acceleration(state, v, lambda: self.drive(min(t, self._latest), state, v))
        return np.concatenate([self.model.coordinates.rate(state.q, v), a])


def _slack(t: float) -> float:
    """What two times near t may differ by and count as one, s."""
    return 16 * float(np.spacing(abs(t)))
