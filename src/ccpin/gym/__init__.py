"""Mechanisms as Gymnasium environments (extra ``gym``): one on a `Simulator`, or thousands at once in lanes."""

from __future__ import annotations

from ccpin.errors import CcpinError

try:
    import gymnasium as _gymnasium
except ImportError:
    raise CcpinError("ccpin.gym needs gymnasium: pip install 'ccpin[gym]'") from None

from ccpin.gym.environment import MechanismEnv
from ccpin.gym.vector import MechanismVectorEnv

del _gymnasium
__all__ = ["MechanismEnv", "MechanismVectorEnv"]
__dir__ = __all__.copy
