"""Simulation of the reduced model under a control law, with SciPy's integrators.

The state is (q, q̇); q′ = σ(q) is found by Newton at every evaluation, started from the last accepted step, so
the loops are closed to solver tolerance at every sample and never drift.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import integrate

from ccpin.control.laws import ControlLaw, NoTorque, TorqueFunction
from ccpin.errors import CcpinError, ConvergenceError, InvalidInputError, SingularConfigurationError
from ccpin.parametrization import ClosedPoint
from ccpin.reduced_model import ReducedModel
from ccpin.trajectory import Status, Trajectory

Array = NDArray[np.float64]
METHODS = ("RK45", "DOP853", "RK23", "Radau", "BDF", "LSODA")
_SHORTEST_STEP = 1e-10


class Settling(NamedTuple):
    """When a motion counts as settled: |q − goal| ≤ band and |v| ≤ speed in every component, for `hold` seconds.

    band in radians (or metres), speed in rad/s (or m/s).
    """

    goal: Array
    band: float = 0.0017453292519943296
    speed: float = 0.01
    hold: float = 0.05


class _Stop(NamedTuple):
    status: Status
    message: str


def simulate(
    model: ReducedModel,
    controller: ControlLaw | Callable[[float, Array, Array], ArrayLike] | None,
    q0: ArrayLike,
    v0: ArrayLike | None = None,
    *,
    duration: float,
    guess: ArrayLike | None = None,
    method: str = "RK45",
    rtol: float = 1e-9,
    atol: float = 1e-11,
    sample_period: float = 1e-3,
    max_step: float = np.inf,
    settling: Settling | None = None,
    region: Callable[[Array], bool] | None = None,
    singular_rcond: float = 1e-7,
) -> Trajectory:
    """Integrate D q̈ + C q̇ + g = ρᵀSᵀu (22), q′ = σ(q) (27) under a control law.

    Args:
        model: The reduced model.
        controller: A `ControlLaw`, a function (t, q, v) → u, or ``None`` for no torque.
        q0: Start, of shape (nq_independent,).
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
        singular_rcond: Stop where ψ_q′'s reciprocal condition number falls below this.

    Returns:
        Trajectory: What was computed up to the stop, whatever its cause, with status and message.

    Raises:
        InvalidInputError: A bad argument.
        UnreachableError, SingularConfigurationError: σ(q0) does not exist. Nothing is raised once the motion has begun.
    """
    law = _law(model, controller)
    q_start = model.checked_q(q0)
    v_start = np.zeros(model.n) if v0 is None else model.checked(v0, "v0", model.n)
    for name, value in (("duration", duration), ("sample_period", sample_period), ("rtol", rtol), ("atol", atol)):
        if not (np.isfinite(value) and value > 0):
            raise InvalidInputError(f"{name} = {value} must be a positive number")
    if method not in METHODS:
        raise InvalidInputError(f"method '{method}' is not one of {', '.join(METHODS)}")
    run = _Run(model, law, model.closed_point(q_start, guess), settling, region, singular_rcond)
    count = int(np.floor(duration / sample_period * (1 + 1e-12))) + 1
    times = np.asarray(np.arange(count) * sample_period, dtype=np.float64)
    if times[-1] < duration * (1 - 1e-9):
        times = np.append(times, duration)
    options = {"rtol": rtol, "atol": atol, "max_step": max_step}
    return run.integrate(np.concatenate([q_start, v_start]), times, getattr(integrate, method), options)


def _law(model: ReducedModel, controller: ControlLaw | Callable[..., ArrayLike] | None) -> ControlLaw:
    if controller is None:
        return NoTorque(model)
    if isinstance(controller, ControlLaw):
        return controller
    if callable(controller):
        return TorqueFunction(controller)
    raise InvalidInputError("controller must be a ControlLaw, a function (t, q, v) → u, or None")


class _Run:
    """One integration: the right-hand side, the samples taken so far and the stop conditions."""

    def __init__(
        self,
        model: ReducedModel,
        law: ControlLaw,
        start: ClosedPoint,
        settling: Settling | None,
        region: Callable[[Array], bool] | None,
        singular_rcond: float,
    ) -> None:
        self.model, self.law, self.settling, self.region = model, law, settling, region
        self.singular_rcond = singular_rcond
        self.near = start.q_free
        self.settled_since: float | None = None
        self.evaluations = 0
        self.samples: list[tuple[float, Array, Array, Array, Array, float]] = []

    def integrate(self, state: Array, times: Array, solver_class: Any, options: dict[str, float]) -> Trajectory:
        stop: _Stop | None = None
        try:
            stop = self.sample(0.0, state) or self.march(state, times, solver_class, options)
        except KeyboardInterrupt:
            stop = _Stop(
                "interrupted", f"interrupted at t = {self.samples[-1][0]:.6g} s" if self.samples else "interrupted"
            )
        except CcpinError as error:
            stop = _Stop("failed", str(error))
        return self.trajectory(stop)

    def march(self, state: Array, times: Array, solver_class: Any, options: dict[str, float]) -> _Stop:
        """Step to the end; where σ fails inside a trial step, try again with a shorter one."""
        t, taken, shortened = 0.0, 1, None
        solver = solver_class(self.derivative, t, state, times[-1], **options)
        while taken < len(times):
            try:
                message = solver.step()
            except (ConvergenceError, SingularConfigurationError) as error:
                shortened = 0.25 * (shortened if shortened is not None else self.trial_step(solver, times[-1] - t))
                if shortened < _SHORTEST_STEP:
                    return _Stop("singular", f"stopped at t = {t:.6g} s: {error}")
                solver = solver_class(self.derivative, t, solver.y, times[-1], first_step=shortened, **options)
                continue
            if solver.status == "failed":
                return _Stop("failed", f"the integrator failed at t = {t:.6g} s: {message}")
            t, shortened = solver.t, None
            dense = solver.dense_output()
            while taken < len(times) and times[taken] <= t:
                stop = self.sample(times[taken], solver.y if times[taken] == t else dense(times[taken]))
                if stop is not None:
                    return stop
                taken += 1
            self.near = self.point(solver.y).q_free
        return _Stop("finished", f"simulated {times[-1]:.6g} s")

    def trial_step(self, solver: Any, remaining: float) -> float:
        step = getattr(solver, "h_abs", None)
        return float(min(step, remaining)) if step else float(remaining)

    def split(self, state: Array) -> tuple[Array, Array]:
        return self.model.coordinates.normalize(state[: self.model.nq]), state[self.model.nq :]

    def point(self, state: Array) -> ClosedPoint:
        return self.model.parametrization.sigma(self.split(state)[0], self.near)

    def derivative(self, t: float, state: Array) -> Array:
        """(q̇, q̈) at a state."""
        self.evaluations += 1
        q, v = self.split(state)
        if not np.isfinite(state).all():
            raise ConvergenceError("the state is no longer finite")
        point = self.model.parametrization.sigma(q, self.near)
        a = self.model.acceleration(point, v, self.law.torque(t, q, v, point.q_free))
        return np.concatenate([self.model.coordinates.rate(q, v), a])

    def sample(self, t: float, state: Array) -> _Stop | None:
        """Record one sample and judge the stop conditions there."""
        q, v = self.split(state)
        point = self.model.parametrization.sigma(q, self.near)
        self.near = point.q_free
        u = self.law.torque(t, q, v, point.q_free)
        phi = self.model.parametrization.constraints.residual(point.q_free)
        self.samples.append((float(t), q.copy(), v.copy(), u, point.q_free, float(np.linalg.norm(phi))))
        if point.factor.rcond < self.singular_rcond:
            return _Stop("singular", f"at t = {t:.6g} s ψ_q′ is nearly singular (rcond {point.factor.rcond:.1e})")
        if self.region is not None and not self.region(q):
            return _Stop("outside", f"at t = {t:.6g} s q left the region given")
        return self.settled(t, q, v)

    def settled(self, t: float, q: Array, v: Array) -> _Stop | None:
        if self.settling is None:
            return None
        error = self.model.coordinates.difference(q, np.asarray(self.settling.goal, dtype=np.float64))
        if np.abs(error).max() > self.settling.band or np.abs(v).max() > self.settling.speed:
            self.settled_since = None
            return None
        self.settled_since = t if self.settled_since is None else self.settled_since
        if t - self.settled_since < self.settling.hold * (1 - 1e-12):
            return None
        return _Stop("settled", f"settled since t = {self.settled_since:.6g} s")

    def trajectory(self, stop: _Stop) -> Trajectory:
        columns = [np.array(column) for column in zip(*self.samples, strict=True)]
        t, q, v, u, q_free, closure = columns
        return Trajectory(t, q, v, u, q_free, closure, stop.status, stop.message, self.evaluations)
