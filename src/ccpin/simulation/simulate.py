"""Simulation of the reduced model under a control law, with SciPy's integrators.

The integrator's vector is x = (q, q̇). At every evaluation q′ = σ(q) is found once, by Newton from the last accepted
step's State, and both the law and the dynamics read the State found; so the loops are closed to solver tolerance at
every sample and never drift. The integrator starts afresh where the equations of motion change: at every command of a
sampled controller, and where a joint with dry friction halts or breaks loose.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import integrate

from ccpin.arrays import Array, Mask, choice, instance, number, positive, step_or_infinite, vector
from ccpin.control.laws import ControlLaw, NoTorque, TorqueFunction
from ccpin.control.sampling import ContinuousCommands, SampledCommands, Sampling
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.dynamics.state import Near, State
from ccpin.dynamics.wrenches import Pushes, Wrenches, pushes_of, wrench_rows
from ccpin.errors import (
    CcpinError,
    ConvergenceError,
    InvalidInputError,
    SingularConfigurationError,
    UnsupportedMechanismError,
)
from ccpin.kinematics.checked import checked_q
from ccpin.mechanism.mechanism import Mechanism
from ccpin.simulation.following import Following
from ccpin.simulation.friction import FrictionLike, JointFriction, joint_friction
from ccpin.simulation.in_core import simulate_in_core
from ccpin.simulation.stick_slip import Drive, StickSlip
from ccpin.simulation.trajectory import Status, Trajectory

METHODS = ("RK45", "DOP853", "RK23", "Radau", "BDF", "LSODA")
_CREEPING, _MOST_CREEPING, _CREEPING_RCOND = 1e-7, 200, 1e-3
_SHORTEST_STEP = 1e-10
_EVENT_WIDTH = 1e-10
_MOST_EVENTS = 200


class Settling(NamedTuple):
    """When a motion counts as settled: |q − goal| ≤ band and |v| ≤ speed in every component, for `hold` seconds.

    band in radians (or metres), speed in rad/s (or m/s).
    """

    goal: Array
    band: float = 0.0017453292519943296
    speed: float = 0.01
    hold: float = 0.05


_NEVER = Settling(np.empty(0))


class _Stop(NamedTuple):
    status: Status
    message: str


def simulate(
    model: ReducedModel | Mechanism,
    controller: ControlLaw | Callable[[float, Array, Array], ArrayLike] | None,
    q0: ArrayLike,
    v0: ArrayLike | None = None,
    *,
    duration: float,
    guess: Near = None,
    method: str = "RK45",
    rtol: float = 1e-9,
    atol: float = 1e-11,
    sample_period: float = 1e-3,
    max_step: float = np.inf,
    settling: Settling | None = None,
    region: Callable[[Array], bool] | None = None,
    singular_rcond: float = 1e-7,
    friction: FrictionLike | JointFriction | None = None,
    wrenches: Wrenches | Pushes | None = None,
    sampling: Sampling | None = None,
) -> Trajectory:
    """Integrate D q̈ + C q̇ + damping q̇ + g = ρᵀ(Sᵀu + Jᵀw + f) (22), q′ = σ(q) (27) under a law, f: dry friction.

    Args:
        model: The reduced model, or a mechanism.
        controller: A `ControlLaw`, a function (t, q, v) → u, or ``None`` for no torque.
        q0: Start, of shape (model.nq,).
        v0: Velocity at the start, of shape (n,); default at rest.
        duration: Longest time in seconds.
        guess: Chooses the assembly mode of σ(q0); default the mechanism's reference.
        method: One of SciPy's RK45, DOP853, RK23, Radau, BDF, LSODA.
        rtol: The integrator's relative tolerance.
        atol: The integrator's absolute tolerance, in rad, m and per second.
        sample_period: Time between samples in seconds (dense output of the integrator; q′ by σ at each).
        max_step: The integrator's longest step in seconds.
        settling: Stop once settled.
        region: Stop where it says False of q (a certified domain's ``contains``, say).
        singular_rcond: Stop where ψ_q′'s reciprocal condition number falls below this. Without torque, and under a
            function (t, q, v) or another law that holds `everywhere`, the motion goes on in other independent
            coordinates instead (`ccpin.simulation.following`), and stops where the mechanism itself is singular.
        friction: Coulomb and viscous friction: ``{joint: (coulomb, viscous)}`` for any joints, or a pair of arrays
            (coulomb, viscous) for the independent ones; default what the mechanism's joints state (`joints.friction`),
            ``{}`` for none. Whether a joint halts or breaks loose is looked at after every step of the integrator and
            at every sample.
        wrenches: On links, as for `State.forward_dynamics`: constant in world axes, or a function (t, state, v).
        sampling: Run the law as a digital controller does; default continuously.

    Returns:
        Trajectory: What was computed up to the stop, whatever its cause, with status and message. Its u is what the
        motors get (at a sampled controller's instants, from there on), without friction and wrenches.

    Raises:
        InvalidInputError: A bad argument.
        UnsupportedMechanismError: The mechanism has mobility 0.
        UnreachableError, SingularConfigurationError: σ(q0) does not exist. Nothing is raised once the motion has begun.
    """
    model = model_of(model)
    if not model.n:
        raise UnsupportedMechanismError(f"{model.mechanism.name} has mobility 0: nothing moves, there is no motion")
    law = _law(model, controller)
    start = model.at(q0, guess)
    v_start = np.zeros(model.n) if v0 is None else vector(v0, "v0", model.n)
    for name, value in (("duration", duration), ("sample_period", sample_period), ("rtol", rtol), ("atol", atol)):
        positive(value, name)
    choice(method, "method", METHODS)
    max_step = step_or_infinite(max_step, "max_step")
    if settling is not None:
        instance(settling, "settling", Settling)
        settling = settling._replace(goal=checked_q(model.coordinates, settling.goal))
    if region is not None and not callable(region):
        raise InvalidInputError(f"region must be a function of q, not {type(region).__name__}")
    if sampling is not None:
        instance(sampling, "sampling", Sampling)
    singular_rcond = number(singular_rcond, "singular_rcond")
    rubbing = joint_friction(model, friction)
    contact, pushes = StickSlip(model, rubbing), pushes_of(model.mechanism.tree, wrenches)
    times = np.arange(np.floor(duration / sample_period * (1 + 1e-12)) + 1) * sample_period
    if times[-1] < duration * (1 - 1e-9):
        times = np.append(times, duration)
    options = {"rtol": rtol, "atol": atol, "max_step": max_step}
    sized = _Sized(law, model)
    commands = (
        ContinuousCommands(sized) if sampling is None else SampledCommands(model, sized, sampling, start.q, v_start)
    )
    if not rubbing.names and not callable(wrenches) and region is None:
        numbers = {"times": times, "start": np.concatenate([start.q, v_start]), "singular_rcond": singular_rcond}
        numbers |= options | (settling or _NEVER)._asdict()
        numbers |= {"wrenches": wrench_rows(model.mechanism.tree, wrenches), "sampling": commands.numbers()}
        found = simulate_in_core(model, law, method, start.q_free, numbers)
        if found is not None:
            return found
    following = Following(model, law, wrenches)
    run = _Run(commands, contact, pushes, following, start, v_start, settling, region, singular_rcond)
    return run.integrate(times, getattr(integrate, method), options)


def _law(model: ReducedModel, controller: ControlLaw | Callable[..., ArrayLike] | None) -> ControlLaw:
    if controller is None:
        return NoTorque(model)
    if isinstance(controller, ControlLaw):
        return controller
    if callable(controller):
        return TorqueFunction(controller)
    raise InvalidInputError("controller must be a ControlLaw, a function (t, q, v) → u, or None")


class _Sized(ControlLaw):
    """A law whose u is looked at, so that one of the wrong size is told as the law's mistake.

    At a State in other coordinates than its model's it is given q and q̇ of its model's.
    """

    def __init__(self, law: ControlLaw, model: ReducedModel) -> None:
        self._law, self._model = law, model
        self._motors, self._size = model.mechanism.actuated, model.n_actuated

    def torque(self, t: float, q: Array, v: Array, guess: Array | None = None) -> Array:
        return self._sized(self._law.torque(t, q, v, guess))

    def torque_at(self, t: float, state: State, v: Array) -> Array:
        if state.model is not self._model:
            return self.torque(t, *self._model.reading(state, v), state.q_free)
        return self._sized(self._law.torque_at(t, state, v))

    def _sized(self, u: Array) -> Array:
        if np.shape(u) != (self._size,):
            raise InvalidInputError(
                f"the law returned u of shape {np.shape(u)}; it must be ({self._size},), efforts of "
                f"{', '.join(self._motors) or 'no motor'}"
            )
        return u


class _Event(NamedTuple):
    t: float
    halted: Mask


class _Run:
    """One integration: the right-hand side, the samples taken so far and the stop conditions.

    Attributes:
        near: The State σ starts from; between steps that of x itself.
        x: (q, q̇) at time t.
    """

    def __init__(
        self,
        commands: ContinuousCommands | SampledCommands,
        contact: StickSlip,
        pushes: Pushes,
        following: Following,
        start: State,
        v_start: Array,
        settling: Settling | None,
        region: Callable[[Array], bool] | None,
        singular_rcond: float,
    ) -> None:
        self.model, self.commands, self.contact, self.pushes = start.model, commands, contact, pushes
        self.settling, self.region, self.singular_rcond = settling, region, singular_rcond
        self.following, self.home = following, following.home
        self.following.begin(start)
        self.near = start
        self.t, self.x = 0.0, np.concatenate([start.q, v_start])
        self.first_step: float | None = None
        self.recent_events: list[float] = []
        self.settled_since: float | None = None
        self.evaluations = 0
        self.samples: list[tuple[float, Array, Array, Array, Array, float, Array]] = []

    def integrate(self, times: Array, solver_class: Any, options: dict[str, float]) -> Trajectory:
        try:
            stop = self.march(times, solver_class, options)
        except KeyboardInterrupt:
            if not self.samples:
                raise
            stop = _Stop("interrupted", f"interrupted at t = {self.samples[-1][0]:.6g} s")
        except CcpinError as error:
            if not self.samples:
                raise
            stop = _Stop("failed", str(error))
        *columns, v_free = (np.array(column) for column in zip(*self.samples, strict=True))
        return Trajectory._make([*columns, *stop, self.evaluations, v_free, self.following.changes])

    def march(self, times: Array, solver_class: Any, options: dict[str, float]) -> _Stop:
        """From command to command; between them from event to event."""
        end = float(times[-1])
        while True:
            command = self.commands.instant(self.t, self.near, self.x[self.model.nq :])
            until = command if command < end - 1e-9 * (command - self.t) else end
            self.begin()
            here = self.t + 1e-9 * (until - self.t)
            while len(self.samples) < len(times) and times[len(self.samples)] <= here:
                stop = self.sample(times[len(self.samples)], self.x)
                if stop is not None:
                    return stop
            if self.t >= end:
                return _Stop("finished", f"simulated {end:.6g} s")
            due = times[len(self.samples) : np.searchsorted(times, until - 1e-9 * (until - self.t))]
            while self.t < until:
                stop = self.leg(until, due[due > self.t], solver_class, options)
                if stop is not None:
                    return stop

    def begin(self, halted: Mask | None = None) -> None:
        """Let every joint with friction rest or slide from here on."""
        if not self.contact.eventful:
            return
        v = self.x[self.model.nq :]
        v = self.contact.begin(self.near, v, self.drive(self.t, self.near, v), halted)
        self.x = np.concatenate([self.x[: self.model.nq], v])

    def leg(self, until: float, due: Array, solver_class: Any, options: dict[str, float]) -> _Stop | None:
        """Integrate smooth equations up to `until`, an event or the end of the coordinates, sampling at the times due.

        Where σ fails inside a trial step, try again with a shorter one. Many steps in a row of less than a hundred
        nanoseconds are an approach to a singularity, where accelerations grow without bound.
        """
        shortened: float | None = None
        creeping = 0
        solver = self.solver(until, solver_class, options, self.first_step)
        while self.t < until:
            try:
                message = solver.step()
            except (ConvergenceError, SingularConfigurationError) as error:
                trial = shortened or min(getattr(solver, "h_abs", None) or np.inf, until - self.t)
                shortened = 0.25 * trial
                if shortened < _SHORTEST_STEP:
                    return self.elsewhere(str(error))
                solver = self.solver(until, solver_class, options, shortened)
                continue
            if solver.status == "failed":
                return _Stop("failed", f"the integrator failed at t = {self.t:.6g} s: {message}")
            shortened, self.first_step = None, getattr(solver, "h_abs", None)
            dense = solver.dense_output()
            event = self.event(solver, dense, due[(due > self.t) & (due < solver.t)]) if self.contact.eventful else None
            reached = solver.t if event is None else event.t
            for time in due[(due > self.t) & (due <= reached)]:
                stop = self.sample(time, solver.y if time == solver.t else dense(time))
                if stop is not None:
                    return stop
            short = reached - self.t < _CREEPING
            self.t, self.x = reached, solver.y if reached == solver.t else dense(reached)
            self.near = self.closed(self.x)[0]
            creeping = creeping + 1 if short and self.stuck(options["max_step"]) else 0
            if event is not None:
                self.begin(event.halted)
            if self.near.rcond < self.singular_rcond or creeping >= _MOST_CREEPING:
                return self.elsewhere(self.nearly_singular())
            if self.following.poor(self.near):
                return self.elsewhere("")
            if event is not None:
                return None
        return None

    def stuck(self, longest: float) -> bool:
        """Whether a step of less than a hundred nanoseconds may be an approach to a singularity."""
        return longest > _CREEPING if self.following.stated is None else self.near.rcond < _CREEPING_RCOND

    def elsewhere(self, reason: str) -> _Stop | None:
        """Go on in other coordinates; where there are none, or something is stated in these, stop for a reason."""
        found = self.following.change(self.near, self.x[self.model.nq :])
        if found is None and reason:
            return _Stop("singular", self.following.why(self.t, self.near, reason))
        if found is not None:
            self.near, v = found
            self.model = self.following.model
            self.x = np.concatenate([self.near.q, v])
            self.contact = self.contact.moved(self.model)
        return None

    def solver(self, until: float, solver_class: Any, options: dict[str, float], first_step: float | None) -> Any:
        first = None if first_step is None else min(first_step, until - self.t)
        return solver_class(self.derivative, self.t, self.x, until, first_step=first, **options)

    def event(self, solver: Any, dense: Callable[[float], Array], checks: Array) -> _Event | None:
        """The first moment of a step at which a joint halts or breaks loose, to 1e-10 s."""
        before = self.t
        for check in (*checks.tolist(), solver.t):
            halted = self.broken(check, dense(check))
            if halted is None:
                before = check
                continue
            after = check
            while after - before > _EVENT_WIDTH:
                middle = 0.5 * (before + after)
                there = self.broken(middle, dense(middle))
                before, after, halted = (middle, after, halted) if there is None else (before, middle, there)
            self.count_event(after)
            return _Event(after, halted)
        return None

    def count_event(self, t: float) -> None:
        self.recent_events = [*self.recent_events[1 - _MOST_EVENTS :], t]
        if len(self.recent_events) == _MOST_EVENTS and t - self.recent_events[0] < 1e-6:
            raise ConvergenceError(f"friction: joints halt and break loose without end at t = {t:.6g} s")

    def broken(self, t: float, x: Array) -> Mask | None:
        state, v = self.closed(x)
        return self.contact.broken(state, v, self.drive(t, state, v))

    def drive(self, t: float, state: State, v: Array) -> Drive:
        u = self.commands.effort(t, state, v)
        return Drive(u[: state.model.n_actuated], self.pushes(t, state, v))  # a sibling may have no motors: then u = 0

    def closed(self, x: Array) -> tuple[State, Array]:
        """The State at x's q, and q̇."""
        q, near = self.model.coordinates.normalize(x[: self.model.nq]), self.near
        return near if (q == near.q).all() else self.model.at(q, near), x[self.model.nq :]

    def derivative(self, t: float, x: Array) -> Array:
        """(q̇, q̈) at x."""
        self.evaluations += 1
        if not np.isfinite(x).all():
            raise ConvergenceError("the state is no longer finite")
        state, v = self.closed(x)
        a = self.contact.acceleration(state, v, self.drive(t, state, v))
        return np.concatenate([self.model.coordinates.rate(state.q, v), a])

    def sample(self, t: float, x: Array) -> _Stop | None:
        """Record one sample and judge the stop conditions there."""
        state, v = self.closed(x)
        self.near = state
        u = self.commands.effort(t, state, v)
        phi = self.model.parametrization.constraints.residual(state.q_free)
        q, v_home = self.home.reading(state, v)
        error = float(np.linalg.norm(phi))
        self.samples.append((float(t), q, v_home.copy(), u, state.q_free, error, state.v_free(v)))
        if state.rcond < self.singular_rcond and self.following.stated is not None:
            return _Stop("singular", self.following.why(t, state, self.nearly_singular()))
        if self.region is not None and not self.region(q):
            return _Stop("outside", f"at t = {t:.6g} s q left the region given")
        return self.settled(t, q, v_home)

    def nearly_singular(self) -> str:
        return f"ψ_q′ is nearly singular (rcond {self.near.rcond:.1e})"

    def settled(self, t: float, q: Array, v: Array) -> _Stop | None:
        if self.settling is None:
            return None
        error = self.home.coordinates.difference(q, np.asarray(self.settling.goal, dtype=np.float64))
        if np.abs(error).max() > self.settling.band or np.abs(v).max() > self.settling.speed:
            self.settled_since = None
            return None
        self.settled_since = t if self.settled_since is None else self.settled_since
        if t - self.settled_since < self.settling.hold * (1 - 1e-12):
            return None
        return _Stop("settled", f"settled since t = {self.settled_since:.6g} s")
