"""ccpin: from a cut-open URDF and its loop closures to the reduced model of a closed-chain mechanism.

The equations implemented are those of Ghorbel, Chételat, Gunawardana and Longchamp, "Modeling and Set Point Control
of Closed-Chain Mechanisms: Theory and Experiment" (IEEE Transactions on Control Systems Technology, 2000);
docstrings cite them by number. Names and sub-packages are imported when they are first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ccpin import (
        control,
        description,
        domain,
        dynamics,
        errors,
        paper,
        plotting,
        report,
        simulation,
        validated,
        visualization,
    )
    from ccpin.description import LoopClosure, MechanismDescription
    from ccpin.dynamics import EndEffector, ReducedModel, State
    from ccpin.errors import CcpinError
    from ccpin.mechanism import Mechanism, load
    from ccpin.native import backend
    from ccpin.simulation import Simulator, Trajectory
    from ccpin.simulation.integration.single_run import simulate
    from ccpin.simulation.studies.sweeps import sweep

__version__ = "0.1.0"

__all__ = [
    "CcpinError",
    "EndEffector",
    "LoopClosure",
    "Mechanism",
    "MechanismDescription",
    "ReducedModel",
    "Simulator",
    "State",
    "Trajectory",
    "backend",
    "control",
    "description",
    "domain",
    "dynamics",
    "errors",
    "load",
    "paper",
    "plotting",
    "report",
    "simulate",
    "simulation",
    "sweep",
    "validated",
    "visualization",
]

_HOMES = {
    "CcpinError": "errors",
    "EndEffector": "dynamics",
    "LoopClosure": "description",
    "Mechanism": "mechanism",
    "MechanismDescription": "description",
    "ReducedModel": "dynamics",
    "Simulator": "simulation",
    "State": "dynamics",
    "Trajectory": "simulation",
    "backend": "native",
    "load": "mechanism",
    "simulate": "simulation",
    "sweep": "simulation",
}


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module 'ccpin' has no attribute '{name}'")
    home = import_module(f"ccpin.{_HOMES.get(name, name)}")
    value = globals()[name] = getattr(home, name) if name in _HOMES else home
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
