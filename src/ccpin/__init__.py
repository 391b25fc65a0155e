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
        auditing,
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
    from ccpin import gym as gym
    from ccpin.description.model import LoopClosure, MechanismDescription
    from ccpin.dynamics.end_effector import EndEffector
    from ccpin.dynamics.reduced_model import ReducedModel
    from ccpin.dynamics.state import State
    from ccpin.errors import CcpinError
    from ccpin.mechanism.loading.loader import load
    from ccpin.mechanism.mechanism import Mechanism
    from ccpin.native import backend
    from ccpin.simulation.integration.simulator import Simulator
    from ccpin.simulation.integration.single_run import simulate
    from ccpin.simulation.results.trajectory import Trajectory
    from ccpin.simulation.studies.sweeps import sweep

__version__ = "0.2.0"

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
    "auditing",
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
__dir__ = __all__.copy

_HOMES = {
    "CcpinError": "errors",
    "EndEffector": "dynamics.end_effector",
    "LoopClosure": "description.model",
    "Mechanism": "mechanism.mechanism",
    "MechanismDescription": "description.model",
    "ReducedModel": "dynamics.reduced_model",
    "Simulator": "simulation.integration.simulator",
    "State": "dynamics.state",
    "Trajectory": "simulation.results.trajectory",
    "backend": "native",
    "load": "mechanism.loading.loader",
    "simulate": "simulation.integration.single_run",
    "sweep": "simulation.studies.sweeps",
}


def __getattr__(name: str) -> object:
    if name not in (*__all__, "gym"):  # gym needs an extra, so that a star takes it for nobody
        raise AttributeError(f"module 'ccpin' has no attribute '{name}'")
    home = import_module(f"ccpin.{_HOMES.get(name, name)}")
    value = globals()[name] = getattr(home, name) if name in _HOMES else home
    return value
