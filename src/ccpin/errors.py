"""Every error that ccpin raises on purpose.

All of them descend from `CcpinError`, so ``except ccpin.CcpinError`` catches whatever a user's file or a
user's numbers can provoke. Messages name the file, the element and what would be right; where numbers are
involved the exception carries them as attributes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "AmbiguousFormatError",
    "ConvergenceError",
    "DescriptionError",
    "DescriptionNotFoundError",
    "DifferentSubjectsError",
    "IndependentSetError",
    "InvalidInputError",
    "InvalidXmlError",
    "LoopNotClosedError",
    "NoLoopError",
    "SingularConfigurationError",
    "SlowRunWarning",
    "UnattainableGainsError",
    "UnderactuatedError",
    "UnreachableError",
    "UnreachableTargetError",
    "UnsupportedMechanismError",
]
__dir__ = __all__.copy


class CcpinError(Exception):
    """The root of all errors ccpin raises deliberately."""


class DescriptionError(CcpinError):
    """A description file states something that is wrong, contradictory or not supported.

    Attributes:
        source: The file, or ``None`` when the description was built in Python.
        element: The offending element as a reader would look for it, e.g. ``joint 'elbow'``.
    """

    def __init__(self, message: str, *, source: str | None = None, element: str | None = None) -> None:
        self.source = source
        self.element = element
        where = ": ".join(part for part in (source, element) if part)
        super().__init__(f"{where}: {message}" if where else message)


class DescriptionNotFoundError(DescriptionError):
    """The file does not exist and no model of that name is installed."""


class InvalidXmlError(DescriptionError):
    """The file is not well-formed XML (or YAML), or uses constructs that are refused for safety."""


class AmbiguousFormatError(DescriptionError):
    """The content matches none of the formats ccpin reads, or more than one."""


class NoLoopError(DescriptionError):
    """The description declares no loop closure and no coupling, so there is nothing to reduce."""


class UnsupportedMechanismError(CcpinError):
    """A method's hypotheses do not hold for this mechanism (said with the reason)."""


class IndependentSetError(CcpinError):
    """The independent (or actuated) joints named cannot be used as such."""


class LoopNotClosedError(CcpinError):
    """No closed configuration was found.

    Attributes:
        q_free: The least open configuration found, of shape (nq,).
        errors: Residual norm of each loop of its cluster at ``q_free`` by name.
        never: Whether it is certain that there is none, not merely that the search found none.
    """

    def __init__(
        self, message: str, *, q_free: NDArray[np.float64], errors: dict[str, float], never: bool = False
    ) -> None:
        self.q_free = q_free
        self.errors = errors
        self.never = never
        super().__init__(message)


class InvalidInputError(CcpinError, ValueError):
    """An argument has the wrong shape, is not finite, or is out of its range."""


class DifferentSubjectsError(InvalidInputError):
    """Objects that a claim combines are of two mechanisms, plants or laws."""


class ConvergenceError(CcpinError):
    """An iteration did not converge; nothing unconverged is ever returned."""


class UnreachableError(ConvergenceError):
    """σ(q) cannot be reached from `near` along the straight line in q.

    Attributes:
        q: The q asked for, of shape (model.nq,).
        q_reached: The last q on the line at which σ was found.
        fraction: How far along the line that is, in [0, 1).
        rcond: Reciprocal condition number of ψ_q′ there.
    """

    def __init__(self, message: str, **found: Any) -> None:
        self.q: NDArray[np.float64] = found["q"]
        self.q_reached: NDArray[np.float64] = found["q_reached"]
        self.fraction: float = found["fraction"]
        self.rcond: float = found["rcond"]
        super().__init__(message)


class UnreachableTargetError(ConvergenceError):
    """No configuration was found, on the branch asked for, that brings the point to the target.

    Attributes:
        q: The q that came nearest, of shape (model.nq,).
        q_free: σ(q) there, of shape (nq,).
        distance: How far from the target the point is there, m.
        angle: How far its axes are turned, rad.
    """

    def __init__(
        self, message: str, *, q: NDArray[np.float64], q_free: NDArray[np.float64], distance: float, angle: float
    ) -> None:
        self.q = q
        self.q_free = q_free
        self.distance = distance
        self.angle = angle
        super().__init__(message)


class SingularConfigurationError(CcpinError):
    """ψ_q′ is singular to working precision: the independent coordinates do not fix the mechanism's motion.

    Attributes:
        q_free: The configuration, of shape (nq,).
        rcond: Reciprocal condition number of ψ_q′ there.
    """

    def __init__(self, message: str, *, q_free: NDArray[np.float64], rcond: float) -> None:
        self.q_free = q_free
        self.rcond = rcond
        super().__init__(message)


class UnattainableGainsError(CcpinError):
    """Gains that a theorem asks for are more than motors can give, or than any loop could be closed with.

    Attributes:
        gains: What was asked for, the `Gains` of `ccpin.control.suggest_gains`.
    """

    def __init__(self, message: str, gains: Any) -> None:
        self.gains = gains
        super().__init__(message)


class UnderactuatedError(CcpinError):
    """No torque of the actuated joints produces the acceleration asked for."""


class SlowRunWarning(UserWarning):
    """A long run went step by step in Python where the compiled core is there for others; the message says why."""
