"""`enclose`: a trajectory of the closed loop with a proof, and σ certified along it.

Theorem M of `ccpin/proof/theorems/enclosure.md`; it also says which numbers the mechanism's and the law's are taken to
be. Its 1 is the fact `ClosedStart`, its 2 and 3 are facts `StepEnclosed`, that they make a motion is `MotionEnclosed`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ccpin.control.control_law import ControlLaw
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.mechanism.assumptions import without_dry_friction
from ccpin.mechanism.mechanism import Mechanism
from ccpin.validated.arithmetic.balls import flint
from ccpin.validated.flow.crossing import find_crossing
from ccpin.validated.flow.enclosure import Enclosure, proved_motion, told_of
from ccpin.validated.flow.marching import SHORTEST_STEP, StepOptions, march
from ccpin.validated.flow.motion_task import task_of
from ccpin.validated.flow.proved_steps import ProvedSteps
from ccpin.validated.flow.start_claim import state_of
from ccpin.validated.flow.step import ProvenStep


def enclose(
    model: ReducedModel | Mechanism,
    law: ControlLaw | None,
    q0: ArrayLike,
    v0: ArrayLike | None,
    duration: float,
    *,
    near: ArrayLike | None = None,
    precision: int = 128,
    order: int = 30,
    tolerance: float = 1e-18,
    pieces: int = 16,
    shortest_step: float = SHORTEST_STEP,
    longest_step: float = np.inf,
) -> Enclosure:
    """Enclose the closed loop's exact trajectory, or say where the proof stops.

    Args:
        model: The reduced model (or a mechanism).
        law: `PDSimpleGravity`, `PDFullGravity`, `NoTorque` or ``None`` for no torque.
        q0: Start, of shape (model.nq,): the exact doubles.
        v0: Velocity at the start, of shape (n,), exact; default at rest.
        duration: Time in seconds (rounded up to a multiple of 2⁻⁴⁰ s).
        near: Chooses the branch of σ(q0); default the mechanism's reference.
        precision: Working precision in bits.
        order: Order N of the Taylor steps.
        tolerance: Remainder allowed to one step, in rad, m and per second; keep it well above 2^−precision.
        pieces: Boxes per step. More are slower and let errors grow less.
        shortest_step: Where no step of this length (s) can be proven the enclosure stops.
        longest_step: Longest step in seconds.

    Raises:
        CcpinError: python-flint is not installed.
        InvalidInputError: A bad argument.
        UnsupportedMechanismError: A mechanism or law outside the scope.
        ConvergenceError: The exact closed start is not proven to exist.
    """
    model = model_of(model)
    options = StepOptions(order, tolerance, pieces, shortest_step, longest_step)
    task = task_of(model, law, q0, near, duration, options, precision)
    with flint().ctx.workprec(precision):
        loop, asked = task.loop, task.from_doubles(q0, v0)
        start = task.start(asked)
        steps, stopped = list[ProvenStep](), ""
        for step in march(ProvedSteps(loop.equations, precision), state_of(start).balls(), duration, options):
            if not isinstance(step, ProvenStep):
                stopped = step.reason
                break
            steps.append(step)
        motion, refused = proved_motion(loop.equations, start, steps, [], precision)
        met = None
        if stopped and not refused and steps and loop.equations.free:
            since = float(motion.found["times"][-1])
            met = find_crossing(model, loop, motion, duration - since, options, precision)
    found = told_of(loop, asked, motion, refused or stopped, met)
    return replace(found, assumes=without_dry_friction(model.mechanism))
