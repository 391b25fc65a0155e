"""Experiments from here to there under (28), (30) or computed torque, and motions driven by hand, for plots."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from ccpin.arrays import Array, choice, positive, vector
from ccpin.control.laws import PDFullGravity, PDSimpleGravity
from ccpin.control.references import PointToPoint
from ccpin.control.stability.set_point.gains import local_gains
from ccpin.control.tracking import ComputedTorque
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.dynamics.state import State
from ccpin.errors import CcpinError, InvalidInputError
from ccpin.simulation.events.samples import ColumnNames
from ccpin.simulation.integration.simulator import Simulator
from ccpin.simulation.results.trajectory import Trajectory, joined
from ccpin.studio.jobs import Job

LawName = Literal["simple", "full", "computed"]
LAWS: dict[LawName, str] = {"simple": "(28) simple gravity", "full": "(30) full gravity", "computed": "computed torque"}
SAMPLES = 1500  # of a recording, at most: no more than one a millisecond
PIECES = 25
"""Stretches of a run between two looks at whether it is still wanted."""
MOVING = 0.6
"""Share of an experiment's time in which computed torque's reference goes from start to goal."""
LONGEST = 60.0  # s, of an experiment
BANDWIDTH = 10.0
"""ω of the gains that are offered, rad/s."""


class RunPlan(NamedTuple):
    """An experiment: the law, where to, its gains (n,), its duration in s."""

    law: LawName
    goal: State
    K_p: Array
    K_v: Array
    duration: float

    @classmethod
    def of(cls, asked: Mapping[str, Any], goal: State) -> RunPlan:
        """What a message asks for.

        Raises:
            InvalidInputError: An unknown law, gains that are not positive, or a duration out of range.
        """
        choice(asked.get("law"), "law", get_args(LawName))
        n = goal.model.n
        words = f"a number of seconds up to {LONGEST:g}"
        duration = positive(asked.get("duration"), "duration", words)
        if duration > LONGEST:
            raise InvalidInputError(f"duration = {duration:g} must be {words}")
        K_p, K_v = (vector(asked.get(name), name, n) for name in ("K_p", "K_v"))  # type: ignore[arg-type]
        return cls(asked["law"], goal, K_p, K_v, duration)


def offered_gains(model: ReducedModel, goal: State, law: LawName) -> tuple[Array, Array]:
    """Diagonal gains for `BANDWIDTH` at a goal, of shape (n,) each."""
    n = model.n
    if law == "computed":
        return np.full(n, BANDWIDTH**2), np.full(n, 2 * BANDWIDTH)
    K_p, K_v = local_gains(model, goal.q, frequency=BANDWIDTH, near=goal.q_free)
    return np.diag(K_p).copy(), np.diag(K_v).copy()


class Recording(NamedTuple):
    """What is plotted, scrubbed and saved.

    Attributes:
        title: What it is.
        trajectory: The samples.
        lyapunov: 𝒱 at each, of shape (T,); NaN where there is none.
        energy: What 𝒱 is measured in.
        goal: The dials' numbers at the goal, ``None`` where there is none.
    """

    title: str
    trajectory: Trajectory
    lyapunov: Array
    energy: str
    goal: Array | None


def run(model: ReducedModel, plan: RunPlan, start: State, job: Job) -> Recording:
    """Simulate from rest at `start`.

    Raises:
        CcpinError: The law cannot be used here, or it ended before its first sample.
        Cancelled: Nobody waits any more.
    """
    law = law_of(model, plan, start)
    simulator = Simulator(model, law)
    simulator.reset(start)
    period = max(1e-3, plan.duration / SAMPLES)
    parts: list[Trajectory] = []
    steps = max(1, min(PIECES, int(plan.duration / period)))
    for k in range(1, steps + 1):
        job.progress((k - 1) / steps, f"simulating: {plan.duration * (k - 1) / steps:.2f} of {plan.duration:g} s")
        parts.append(simulator.run(plan.duration * k / steps, sample_period=period))
        if parts[-1].status != "finished":
            break
    trajectory = joined(parts)
    if trajectory.status == "finished":
        trajectory = trajectory._replace(message=f"simulated {trajectory.t[-1]:.6g} s")
    energy = "1/s²" if plan.law == "computed" else "J"
    return Recording(LAWS[plan.law], trajectory, _lyapunov(law, trajectory), energy, plan.goal.q)


def law_of(model: ReducedModel, plan: RunPlan, start: State) -> PDSimpleGravity | PDFullGravity | ComputedTorque:
    """The law that a plan names."""
    if plan.law == "computed":
        reference = PointToPoint(model, start.q, plan.goal.q, MOVING * plan.duration)
        return ComputedTorque(model, reference, plan.K_p, plan.K_v, start)
    made = PDSimpleGravity if plan.law == "simple" else PDFullGravity
    return made(model, plan.goal, plan.K_p, plan.K_v)


def _lyapunov(law: PDSimpleGravity | PDFullGravity | ComputedTorque, motion: Trajectory) -> Array:
    """𝒱 along the motion; under computed torque ½ėᵀė + ½eᵀK_p e, which its linear error dynamics let fall."""
    if isinstance(law, ComputedTorque):
        wanted = [law.reference.at(t) for t in motion.t.tolist()]
        e = np.array([law.error(t, q) for t, q in zip(motion.t.tolist(), motion.q, strict=True)])
        rate = np.array([one.v for one in wanted]) - motion.v
        return np.asarray(0.5 * np.sum(rate**2, axis=1) + 0.5 * np.sum((e @ law.K_p) * e, axis=1))
    return np.array([law.lyapunov(state, v) for state, v, _ in motion.states(law.model)])


def recorded(model: ReducedModel, times: list[float], states: list[State]) -> Recording:
    """A motion driven by hand: q̇ and q̈ by differences, u by inverse dynamics (zero where no u moves it so).

    Raises:
        CcpinError: Fewer than three poses were recorded.
    """
    if len(times) < 3:
        raise CcpinError("fewer than three poses were recorded: drive while it records")
    t = np.array(times) - times[0]
    t = np.maximum.accumulate(t + 1e-6 * np.arange(len(t)))
    path = np.array([model.coordinates.difference(states[0].q, state.q) for state in states])
    v = np.gradient(path, t, axis=0)
    a = np.gradient(v, t, axis=0)
    closure = [np.linalg.norm(state.point.constraints.phi) for state in states]
    zero = np.zeros((len(t), model.mechanism.n_free))
    trajectory = Trajectory(
        t=t,
        q=np.array([state.q for state in states]),
        v=v,
        a=a,
        u=np.array([_effort(*sample) for sample in zip(states, v, a, strict=True)]),
        q_free=np.array([state.q_free for state in states]),
        v_free=np.array([state.v_free(rate) for state, rate in zip(states, v, strict=True)]),
        friction=zero,
        limits=zero,
        closure_error=np.array(closure),
        status="finished",
        message=f"driven by hand for {t[-1]:.2f} s",
        cause=None,
        events=(),
        evaluations=0,
        wall_time=float(t[-1]),
        names=ColumnNames.of(model),
        origin=model.digests,
    )
    return Recording("driven by hand", trajectory, np.full(len(t), np.nan), "", None)


def _effort(state: State, v: Array, a: Array) -> Array:
    try:
        return state.inverse_dynamics(v, a)
    except CcpinError:
        return np.zeros(state.model.n_actuated)
