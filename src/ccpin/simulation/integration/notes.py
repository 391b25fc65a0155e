"""What a trajectory tells without being asked: what took its steps, and why not the compiled core."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import suppress

import numpy as np

from ccpin.arrays import Array
from ccpin.control.control_law import ControlLaw, stated, undelayed
from ccpin.dynamics.drives import too_weak
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import CcpinError, SlowRunWarning
from ccpin.native import backend
from ccpin.simulation.integration.coordinate_switching import CoordinateSwitching
from ccpin.simulation.integration.core_numbers import TABLEAUX, law_numbers
from ccpin.simulation.results.limit_violations import at_effort_limits

KNOWN = "PDSimpleGravity, PDFullGravity, PDOnlineGravity, PDPlus, ComputedTorque, AdaptiveTracking and HeldEffort"
_LONG = 10.0  # s in Python: whoever waits longer is warned
AT_LIMITS = "efforts at their limits"
"""What a note begins with that tells which motors gave all they have, though they can hold start and goal."""


def stepped_in_python(model: ReducedModel, law: ControlLaw, method: str, plain: bool, spent: float) -> str:
    """That the core did not take the steps, and why; a long run is warned of it.

    Args:
        model: The reduced model.
        law: The law.
        method: The integrator.
        plain: Whether nothing is looked at every step.
        spent: Seconds of wall time.
    """
    used = model.backend
    why = used.reason if used.name == "numpy" else _outside_the_core(model, undelayed(law), method, plain)
    if spent > _LONG and backend().name == "native":
        warnings.warn(f"{spent:.0f} s of simulation went step by step in Python: {why}", SlowRunWarning, stacklevel=3)
    return f"stepped in Python: {why}"


def _outside_the_core(model: ReducedModel, law: ControlLaw, method: str, plain: bool) -> str:
    """What the core does not step, of what a simulator was given."""
    if not plain:
        looked = "events, a region, limits, contacts, motors or wrenches that change are looked at every step"
        return f"{looked}; without any of them the core steps"
    if method not in TABLEAUX:
        return f"the core steps {' and '.join(TABLEAUX)}, not {method}"
    if law_numbers(model, stated(law)) is None:
        told = stated(law)
        if told is not None and told.model is not None and told.model.actuation is not None:
            own = told.model.mechanism
            sit = f"{', '.join(own.actuated)} with gears {', '.join(f'{gear:g}' for gear in own.motors.gears)}"
            name, joints = type(law).__name__, ", ".join(own.independent)
            return f"the core steps {name} of motors on {joints}, in this order and of gear 1: they are on {sit}"
        return f"the core does not know {type(law).__name__}: it steps {KNOWN}"
    left = "the core left the motion to it, as σ fails, motors saturate or coordinates are changed on the way"
    return f"{left}; a motion on which they do not is stepped by the core"


def on_balls(switching: CoordinateSwitching) -> Iterator[str]:
    """What tells that revolutes are integrated as balls."""
    for name in switching.balls:
        yield f"integrated as a ball joint, as its axes meet with no mass between them: {name}"


def of_efforts(model: ReducedModel, law: ControlLaw, q_free: Array, u: Array) -> Iterator[str]:
    """Of a motion along which motors gave all they have: whether they can hold its start and goal, or which these are.

    Args:
        model: The reduced model.
        law: The law.
        q_free: Configurations, of shape (T, nq).
        u: What the motors gave, of shape (T, motors).
    """
    at = at_effort_limits(model.mechanism, u)
    if not at:
        return
    goal = _goal(model, undelayed(law))
    poses = {"at the start": q_free[0]} | ({} if goal is None else {"at the goal": goal})
    weak = too_weak(model.mechanism, poses, model.free_system)
    yield weak or f"{AT_LIMITS}: {', '.join(at)}"


def _goal(model: ReducedModel, law: ControlLaw) -> Array | None:
    """Where a law leads to by its own word, as q′ of shape (nq,), if it gives it and σ is there."""
    told = stated(law)
    if told is None or told.near is None or told.reference is None:
        return None
    path, moved = told.reference, np.zeros(model.n)
    if path.breaks.size:
        last = path.coefficients[-1]
        moved = np.vander(np.diff(path.breaks[-2:]), len(last))[0] @ last
    with suppress(CcpinError):
        return model.at(model.coordinates.integrate(path.start, moved), told.near.q_free).q_free
    return None
