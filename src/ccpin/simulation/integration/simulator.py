"""One motion that goes on for as long as it is asked to, a step, a stretch or a recorded run at a time."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import integrate

from ccpin.arrays import Array, choice, frozen, instance, number, positive, records, step_or_infinite, vector
from ccpin.control.control_law import ControlLaw, HeldEffort
from ccpin.control.sampling import ContinuousCommands, SampledCommands, Sampling
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.dynamics.state import Near, State
from ccpin.dynamics.wrenches import Pushes, Wrenches, wrench_rows
from ccpin.errors import DifferentSubjectsError, InvalidInputError, UnsupportedMechanismError
from ccpin.kinematics.coordinates import checked_q
from ccpin.mechanism.mechanism import Mechanism
from ccpin.native import Declining
from ccpin.proof.digests import digest_or_none
from ccpin.simulation.events.samples import ColumnNames, EventRecord, StateSample, Stop
from ccpin.simulation.events.settling import Settling, SettlingWatch
from ccpin.simulation.events.watches import Event, EventWatch, Instant, RegionWatch, Watch
from ccpin.simulation.integration.budget import Budget
from ccpin.simulation.integration.coordinate_switching import CoordinateSwitching
from ccpin.simulation.integration.core_numbers import TABLEAUX
from ccpin.simulation.integration.core_runs import ConstantEffortRuns, run_in_core
from ccpin.simulation.integration.core_steps import CoreSteps
from ccpin.simulation.integration.notes import of_efforts, on_balls, stepped_in_python
from ccpin.simulation.integration.recorder import Recorder, sample_times
from ccpin.simulation.integration.run import IntegrationSettings, Run
from ccpin.simulation.integration.step_size import natural_step
from ccpin.simulation.plant.commands import CheckedLaw, LawLike, law_of
from ccpin.simulation.plant.contact import Contact
from ccpin.simulation.plant.friction import FrictionLike, JointFriction, joint_friction
from ccpin.simulation.plant.limits import Limits
from ccpin.simulation.plant.motors import MotorModel
from ccpin.simulation.plant.plant import Plant
from ccpin.simulation.plant.stick_slip import StickSlip
from ccpin.simulation.results.limit_violations import beyond_limits
from ccpin.simulation.results.trajectory import Trajectory

METHODS = ("RK45", "DOP853", "RK23", "Radau", "BDF", "LSODA")


class Simulator:
    """A motion under way: D q̈ + C q̇ + damping q̇ + g = ρᵀ(Sᵀu + Jᵀw + f) (22), q′ = σ(q) (27), f: dry friction.

    It carries time, the joints' stick and slip, filter, delay and the command held of a sampled law, events and counts
    from call to call. `step` holds u for a while, `advance` lets the law act, `run` records a `Trajectory`; they may
    follow each other in any order. `reset` comes first. One thread may use a simulator at a time.

    Nothing is stepped over: a law (and a function for `wrenches`) that has `next_switch` is integrated from switch to
    switch; where one has not, and where friction, events or a region are looked at, no step is longer than a 32nd of
    the time in which the mechanism would fall its own length (`step_size`). Output changes nothing.

    Args:
        model: The reduced model, or a mechanism.
        law: A `ControlLaw`, a function (t, q, v) → u, or ``None`` for no torque.
        method: One of SciPy's RK45, DOP853, RK23, Radau, BDF, LSODA.
        rtol: The integrator's relative tolerance.
        atol: The integrator's absolute tolerance, in rad, m and per second.
        max_step: The integrator's longest step in seconds; default as above.
        region: End where it says False of q (a certified domain's ``contains``, say).
        singular_rcond: End where ψ_q′'s reciprocal condition number falls below this. Without torque, and under a
            function (t, q, v) or another law that holds `everywhere`, the motion goes on in other independent
            coordinates instead (`coordinate_switching`) unless events, a region, limits, contacts or settling
            read the model's, and ends where the mechanism itself is singular.
        friction: Dry and viscous friction: ``{joint: (coulomb, viscous)}`` for any joints, or a pair of arrays
            (coulomb, viscous) for the independent ones, breakaway level and Stribeck speed following where there is
            such an effect (`JointFriction`); default what the mechanism's joints state (`joints.friction`),
            ``{}`` for none.
        wrenches: On links, as for `State.forward_dynamics`: constant in world axes, or a function (t, state, v).
        sampling: Run the law as a digital controller does; default continuously, a law that remembers by its period.
        events: What to look for along the motion.
        limits: How limits of positions, velocities and efforts are treated; default `Limits`': motors give no more
            than their limits, and nothing else.
        contacts: Points of links that meet planes.
        motors: Lag, rate and torque–speed curve of the motors; default none.

    Attributes:
        model: The reduced model.
        law: The law; it may be replaced at any time.
        stop: How the last call ended before its time, ``None`` if it did not.
        events: What happened since `reset`, in order.

    Raises:
        InvalidInputError: A bad argument.
        UnsupportedMechanismError: The mechanism has mobility 0.
    """

    def __init__(
        self,
        model: ReducedModel | Mechanism,
        law: LawLike = None,
        *,
        method: str = "RK45",
        rtol: float = 1e-9,
        atol: float = 1e-11,
        max_step: float | None = None,
        region: Callable[[Array], bool] | None = None,
        singular_rcond: float = 1e-7,
        friction: FrictionLike | JointFriction | None = None,
        wrenches: Wrenches | Pushes | None = None,
        sampling: Sampling | None = None,
        events: Sequence[Event] = (),
        limits: Limits | None = None,
        contacts: Sequence[Contact] = (),
        motors: MotorModel | None = None,
    ) -> None:
        self.model = model = model_of(model)
        if not model.n:
            raise UnsupportedMechanismError(f"{model.mechanism.name} has mobility 0: nothing moves, there is no motion")
        rtol, atol = positive(rtol, "rtol"), positive(atol, "atol")
        singular_rcond = number(singular_rcond, "singular_rcond")
        choice(method, "method", METHODS)
        max_step = None if max_step is None else step_or_infinite(max_step, "max_step")
        if region is not None and not callable(region):
            raise InvalidInputError(f"region must be a function of q, not {type(region).__name__}")
        self._law = law_of(model, law)
        if sampling is None and self._law.period is not None:
            sampling = Sampling(self._law.period)
        if sampling is not None:
            instance(sampling, "sampling", Sampling)
        events = records(events, "events", Event)
        self._method, self._sampling = method, sampling
        solver, natural = getattr(integrate, method), natural_step(model.mechanism)
        self._settings = IntegrationSettings(solver, rtol, atol, max_step, singular_rcond, wrenches, natural)
        self._friction = joint_friction(model, friction)
        self._region, self._looked_for = region, tuple(events)
        self._names = ColumnNames.of(model)
        self._plant = Plant(model, limits, records(contacts, "contacts", Contact), motors)
        self._plant.check_law(self._law, sampling)
        self._pushed = None if callable(wrenches) else wrench_rows(model.mechanism.tree, wrenches)
        self._plain = not (callable(wrenches) or region is not None or events)
        self._plain = self._plain and self._plant.plain and (sampling is None or not np.any(sampling.encoder_noise))
        bench = (self._friction, self._pushed, limits, tuple(contacts), motors, sampling)
        self._bench = digest_or_none(bench)  # what moves besides; empty where a function does
        self._nothing = frozen(np.zeros(model.mechanism.n_free))
        self._core_steps: CoreSteps | None = None
        self._constant: ConstantEffortRuns | None = None
        if self._plain and sampling is None and method in TABLEAUX:
            numbers = {"rtol": rtol, "atol": atol, "singular_rcond": singular_rcond}
            self._constant = ConstantEffortRuns(method, numbers, self._plant.effort_bounds)
            if not (self._friction.names or isinstance(model.core, Declining)):
                numbers = numbers | {"max_step": np.inf if max_step is None else max_step}
                self._core_steps = CoreSteps(model, method, numbers, self._plant.effort_bounds)
        self._run: Run | None = None
        self._held_back: BaseException | None = None
        self.stop: Stop | None = None
        self.events: list[EventRecord] = []

    # Where it is.

    @property
    def t(self) -> float:
        """The time, s."""
        return self._moving.here.t if self._ahead is None else self._ahead.t

    @property
    def state(self) -> State:
        """The State, of `model` or, where its coordinates were left for others, of a sibling of it.

        Raises:
            SingularConfigurationError: Three revolutes that are a ball are in gimbal lock, where q′ has none.
        """
        run = self._moving
        return run.switching.seen(run.here.state)

    @property
    def v(self) -> Array:
        """q̇, of shape (n,)."""
        if self._ahead is not None:
            return self._ahead.v
        run = self._moving
        return np.array(run.switching.reported(run.here.state, run.here.v).v)

    @property
    def evaluations(self) -> int:
        """Evaluations of the equations of motion since `reset`."""
        return self._moving.evaluations

    @property
    def law(self) -> ControlLaw:
        """The law."""
        return self._law

    @law.setter
    def law(self, law: LawLike) -> None:
        self._law = law_of(self.model, law)
        self._plant.check_law(self._law, self._sampling)
        if self._run is not None:
            self._run.commands.law = CheckedLaw(self._law.begin(), self.model, self._run.switching.reported)
            self._run.switching.law = self._law

    def sample(self) -> StateSample:
        """The motion as it is now."""
        return self._moving.sample(self._moving.here)

    # Moving on.

    def reset(
        self, q: ArrayLike | State, v: ArrayLike | None = None, *, t: float = 0.0, near: Near = None
    ) -> StateSample:
        """Begin a motion.

        Args:
            q: Where, of shape (model.nq,), or a State.
            v: Velocity, of shape (n,); default at rest.
            t: The time, s.
            near: Chooses the assembly mode of σ(q); default the mechanism's reference.

        Raises:
            InvalidInputError: A bad argument.
            UnreachableError, SingularConfigurationError: σ(q) does not exist.
        """
        state = self.model.at(q, near)
        v_start = np.zeros(self.model.n) if v is None else vector(v, "v", self.model.n)
        switching = self._switching()
        switching.begin(state)
        self._begin(Instant(float(t), state, frozen(v_start)), switching)
        return self.sample()

    def _switching(self) -> CoordinateSwitching:
        looks = self._looked_for or self._region is not None or not self._plant.plain
        reads = "events, a region, limits or contacts are looked for" if looks else ""
        return CoordinateSwitching(self.model, self._law, self._settings.wrenches, reads, self._friction.names)

    def _begin(self, here: Instant, switching: CoordinateSwitching) -> None:
        """Begin in the coordinates that the motion is in."""
        t, state, v = here
        law = CheckedLaw(self._law.begin(), self.model, switching.reported)
        commands: ContinuousCommands | SampledCommands = ContinuousCommands(law)
        if self._sampling is not None:
            own = switching.reported(state, v)
            commands = SampledCommands(self.model, law, self._sampling, own.q, own.v, t, switching.reported)
        driven = self._plant.commands(commands, t, state, v)
        watches: list[Watch] = [EventWatch(event) for event in self._looked_for]
        if self._region is not None:
            watches.append(RegionWatch(self._region))
        watches += self._plant.watches(driven)
        contact = StickSlip(self.model, self._friction)
        parts = driven, contact, self._plant, tuple(watches), switching
        self._run = Run(self._settings, *parts, here, self._constant, self._plant.saturation(driven))
        self.stop, self.events, self._held_back = None, [], None
        if self._core_steps is not None:
            self._core_steps.begin()

    def step(self, u: ArrayLike | None, dt: float) -> StateSample:
        """Hold an effort for a while.

        With `sampling` it is the command at all samples from now on and before the end, with saturation and delay.

        Args:
            u: Efforts of the actuated joints, of shape (motors,); ``None``: the law acts.
            dt: For how long, s.

        Returns:
            StateSample: The motion at the end, or where it stopped; `stop` tells.

        Raises:
            InvalidInputError: A bad argument.
            Exception: Whatever a law or an event raised. The simulator is then where its last certain instant was.
            KeyboardInterrupt: The call before this one was interrupted: Ctrl-C ends a step early, as `stop` tells, and
                is raised by the next call, so that no loop goes on unawares.
        """
        self._raise_what_was_held_back()
        if u is not None and self._core_steps is not None:
            found = self._core_steps.step(self._begun, u, dt)
            if found is not None:
                self.stop = None if found.raised is None else self._broken_off(found.sample.t, found.raised)
                self.events += found.happened
                return found.sample
        run = self._moving
        until = run.here.t + positive(dt, "dt")
        if u is None:
            return self.advance(until)
        commands = run.commands
        own, held = commands.law, HeldEffort(np.array(vector(u, "u", self.model.n_actuated)))
        commands.law = run.switching.law = held
        try:
            return self._advanced(until, commanded=False)
        finally:
            commands.law, run.switching.law = own, self._law

    def advance(self, until: float) -> StateSample:
        """Let the law act up to a time, in seconds, and at it; returns and raises as `step`."""
        return self._advanced(until, commanded=True)

    def _advanced(self, until: float, commanded: bool) -> StateSample:
        self._raise_what_was_held_back()
        run = self._moving
        self._later(until)
        record = Recorder(np.empty(0))
        try:
            self.stop = run.advance(until, record, Budget(), commanded=commanded)
        except KeyboardInterrupt as error:
            self.stop = self._broken_off(run.here.t, error)
        finally:
            self.events += record.events
        return self.sample()

    def _broken_off(self, t: float, raised: BaseException) -> Stop:
        """The end of a step that was interrupted; the interrupt is held back for the next call."""
        self._held_back = raised
        return Stop.broken_off(t, raised)

    def _raise_what_was_held_back(self) -> None:
        raised, self._held_back = self._held_back, None
        if raised is not None:
            raise raised

    def run(
        self,
        until: float,
        *,
        sample_period: float = 1e-3,
        settling: Settling | None = None,
        budget: Budget | None = None,
    ) -> Trajectory:
        """Let the law act up to a time, and record it.

        Args:
            until: The time, s.
            sample_period: Time between samples, s.
            settling: End once settled.
            budget: End once it is spent.

        Returns:
            Trajectory: From now on up to the time, or to where the motion ended, whatever the cause: Ctrl-C and
            whatever a law raises included, which is then its `cause`.

        Raises:
            InvalidInputError: A bad argument.
            Exception: Whatever a law raised before the first sample.
        """
        run, began = self._moving, time.perf_counter()
        self._later(until)
        start, evaluations = run.here.t, run.evaluations
        times = sample_times(start, until, positive(sample_period, "sample_period"), self._sample_size)
        if settling is not None:
            instance(settling, "settling", Settling)
            goal = checked_q(self.model.coordinates, settling.goal)
            settling = settling._replace(goal=np.array(goal))
        events: list[EventRecord] = []
        run.come_back(settling is not None)
        columns = self._run_in_core(times, settling, budget)
        in_core = columns is not None
        if columns is None:
            watch = None if settling is None else SettlingWatch(settling, self.model.coordinates)
            record = Recorder(times)
            run.first_step = None
            self.stop = self._recorded(until, record, budget or Budget(), watch)
            self.events += record.events
            columns, events = record.columns(), record.events
        stop = self.stop or Stop("finished", f"simulated {until - start:.6g} s")
        spent = time.perf_counter() - began
        sampled = (columns[name] for name in ("t", "q_free", "v_free", "u"))
        passed = dict.fromkeys(one.note for one in beyond_limits(self.model.mechanism, *sampled))
        efforts = of_efforts(self.model, self._law, columns["q_free"], columns["u"])
        stepped = "stepped by the compiled core"
        if not (in_core or run.in_core):
            stepped = stepped_in_python(self.model, self._law, self._method, self._plain, spent)
        return Trajectory(
            **columns,
            **stop._asdict(),
            events=tuple(sorted(events, key=lambda event: event.t)),
            evaluations=run.evaluations - evaluations,
            wall_time=spent,
            names=self._names,
            origin=self.model.digests._replace(law=self._law.digests.law),
            notes=(stepped, *on_balls(run.switching), *efforts, *passed),
        )

    def _recorded(self, until: float, record: Recorder, budget: Budget, watch: Watch | None) -> Stop | None:
        run = self._moving
        try:
            stop = run.advance(until, record, budget, watch)
            record.last(run.here, run)
        except (Exception, KeyboardInterrupt) as error:
            if not record.samples:
                raise
            with suppress(Exception):
                record.last(run.here, run)
            return Stop.broken_off(run.here.t, error)
        return stop

    @property
    def _sample_size(self) -> int:
        """Bytes of a sample."""
        own, mechanism = self.model, self.model.mechanism
        return 8 * (2 + own.nq + 2 * own.n + own.n_actuated + mechanism.nq + 3 * mechanism.n_free)

    # In the compiled core, where it can.

    def _run_in_core(self, times: Array, settling: Settling | None, budget: Budget | None) -> dict[str, Any] | None:
        """The samples of a recorded run, column by column, or ``None`` where only the reference can tell."""
        run, settings = self._moving, self._settings
        constant = settling is None and run.constant_effort is not None  # a run that may change its coordinates
        if not self._plain or run.model is not self.model or constant:
            return None
        numbers = {
            "times": times,
            "rtol": settings.rtol,
            "atol": settings.atol,
            "max_step": run.longest_step(),
            "singular_rcond": settings.singular_rcond,
            "wrenches": self._pushed,
            "sampling": run.commands.numbers(),
            "friction": run.contact.numbers(),
            **self._plant.effort_bounds.numbers(),
        }
        found = run_in_core(self.model, run.commands.law, self._method, run.here, numbers, settling, budget)
        if found is None:
            return None
        self.stop = found.stop
        run.commands.adopt(found.memory)
        run.contact.adopt(found.mode)
        last = {name: column[-1] for name, column in found.columns.items()}
        run.here = Instant(float(last["t"]), self.model.at(last["q"], last["q_free"]), frozen(last["v"]))
        run.evaluations += found.evaluations
        nothing = np.broadcast_to(self._nothing, (len(found.columns["t"]), len(self._nothing)))
        return {**found.columns, "limits": nothing}

    # What it carries.

    def memory(self) -> dict[str, Array]:
        """Everything carried from call to call but the law's own memory, as arrays; `recall` brings it back."""
        run = self._moving
        t, state, v = run.here
        here = {"t": np.array(t), "q": state.q, "v": v, "q_free": state.q_free, "origin": self._origin}
        return here | run.switching.memory() | run.contact.memory() | run.commands.memory()

    def recall(self, memory: Mapping[str, Array]) -> None:
        """Go on from what `memory` gave, in this simulator or another with the same arguments, to the last bit.

        Raises:
            InvalidInputError: Something is missing in it.
        """
        switching = self._switching()
        for name in ("t", "q", "v", "q_free", "origin", *switching.memory()):
            if name not in memory:
                raise InvalidInputError(f"the memory has no '{name}': `Simulator.memory` of this version gives one")
        if not np.array_equal(memory["origin"], self._origin):
            raise DifferentSubjectsError("the memory is of another mechanism or plant than this simulator's")
        model = switching.recall(memory)
        state = model.at(memory["q"], memory["q_free"])
        self._begin(Instant(float(memory["t"]), state, frozen(memory["v"])), switching)
        run = self._moving
        run.contact.recall(memory)
        run.commands.recall(memory)

    @property
    def _origin(self) -> NDArray[np.str_]:
        """Whose memory it is: the digests of closures, dynamics and plant, and of what this simulator adds to it."""
        own = self.model.digests
        return np.array([own.closures, own.dynamics, own.plant, self._bench])

    @property
    def _begun(self) -> Run:
        """The run, which the core's steps may be ahead of."""
        if self._run is None:
            raise InvalidInputError("the simulator has no motion yet: call reset(q, v) first")
        return self._run

    @property
    def _moving(self) -> Run:
        """The run, where the last call has left it."""
        run = self._begun
        if self._core_steps is not None:
            self._core_steps.land(run)
        return run

    @property
    def _ahead(self) -> StateSample | None:
        """The motion after the core's last step, where that is ahead of the run."""
        return None if self._core_steps is None else self._core_steps.ahead

    def _later(self, until: float) -> None:
        if not (np.isfinite(until) and until > self.t):
            raise InvalidInputError(f"until = {until} must be a time later than t = {self.t:.6g} s")
