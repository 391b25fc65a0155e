"""A motion from a start for a duration: one `Simulator`, reset and run."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from ccpin.arrays import positive
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.dynamics.state import Near
from ccpin.mechanism.mechanism import Mechanism
from ccpin.simulation.events.settling import Settling
from ccpin.simulation.integration.budget import Budget
from ccpin.simulation.integration.simulator import Simulator
from ccpin.simulation.plant.commands import LawLike
from ccpin.simulation.results.trajectory import Trajectory


def simulate(
    model: ReducedModel | Mechanism,
    controller: LawLike,
    q0: ArrayLike,
    v0: ArrayLike | None = None,
    *,
    duration: float,
    near: Near = None,
    sample_period: float = 1e-3,
    settling: Settling | None = None,
    budget: Budget | None = None,
    **options: Any,
) -> Trajectory:
    """Integrate D q̈ + C q̇ + damping q̇ + g = ρᵀ(Sᵀu + Jᵀw + f) (22), q′ = σ(q) (27) under a law, f: dry friction.

    The motion does not depend on when it is sampled, and no torque is stepped over (`Simulator` tells how).

    Args:
        model: The reduced model, or a mechanism.
        controller: A `ControlLaw`, a function (t, q, v) → u, or ``None`` for no torque.
        q0: Start, of shape (model.nq,).
        v0: Velocity at the start, of shape (n,); default at rest.
        duration: Longest time in seconds.
        near: Chooses the assembly mode of σ(q0); default the mechanism's reference.
        sample_period: Time between samples in seconds (dense output of the integrator; q′ by σ at each).
        settling: Stop once settled.
        budget: Stop once so many evaluations or seconds are spent.
        options: As for `Simulator`: method, rtol, atol, max_step, region, singular_rcond, friction, wrenches,
            sampling, events, limits, contacts, motors.

    Returns:
        Trajectory: What was computed up to the stop, whatever its cause, with status, message and cause; the last
        sample is the state it stopped in. Ctrl-C gives status ``interrupted`` and a law's exception ``failed``: who
        wants them raised says ``if motion.cause: raise motion.cause``. Its u is what the motors get (at a sampled
        controller's instants, from there on), without friction and wrenches.

    Raises:
        InvalidInputError: A bad argument.
        UnsupportedMechanismError: The mechanism has mobility 0.
        UnreachableError, SingularConfigurationError: σ(q0) does not exist.
        Exception: What a law raised before the first sample. Nothing is raised once the motion has begun.
    """
    simulator = Simulator(model, controller, **options)
    simulator.reset(q0, v0, near=near)
    until = positive(duration, "duration")
    return simulator.run(until, sample_period=sample_period, settling=settling, budget=budget)
