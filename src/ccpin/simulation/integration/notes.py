"""What a trajectory tells without being asked: what took its steps, and why not the compiled core."""

from __future__ import annotations

import warnings
from collections.abc import Iterator

from ccpin.control.control_law import ControlLaw, stated, undelayed
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import SlowRunWarning
from ccpin.native import backend
from ccpin.simulation.integration.coordinate_switching import CoordinateSwitching
from ccpin.simulation.integration.core_numbers import TABLEAUX, law_numbers

_LONG = 10.0  # s in Python: whoever waits longer is warned


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
        return "friction, events, a region, limits, contacts, motors or wrenches that change are looked at every step"
    if method not in TABLEAUX:
        return f"the core steps {' and '.join(TABLEAUX)}, not {method}"
    if law_numbers(model, stated(law)) is None:
        return f"the core does not know {type(law).__name__}"
    return "the core left the motion to it, as σ fails, motors saturate or coordinates are changed on the way"


def on_balls(switching: CoordinateSwitching) -> Iterator[str]:
    """What tells that revolutes are integrated as balls."""
    for name in switching.balls:
        yield f"integrated as a ball joint, as its axes meet with no mass between them: {name}"
