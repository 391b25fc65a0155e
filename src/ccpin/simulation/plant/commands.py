"""What a simulator takes for a law: what users give, and a law whose efforts are looked at."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, frozen, numbers
from ccpin.control.control_law import ControlLaw, Measurement, NoTorque, TorqueFunction, require_called_as, stated
from ccpin.control.statements import Statement
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.dynamics.state import State
from ccpin.errors import InvalidInputError

LawLike = ControlLaw | Callable[[float, Array, Array], ArrayLike] | None
_AS_NUMBERS = re.compile(r"'(State|Measurement)'|of type (State|Measurement)\b")  # Python's words, and NumPy's


def law_of(model: ReducedModel, law: LawLike) -> ControlLaw:
    """A law itself, a function (t, q, v) → u as one, or no torque.

    Raises:
        InvalidInputError: It is none of these, or does not take three arguments.
    """
    if law is None:
        return NoTorque(model)
    if isinstance(law, ControlLaw):
        require_called_as("torque(t, state, v)", law.torque)
        return law
    if callable(law):
        return TorqueFunction(law)
    raise InvalidInputError("controller must be a ControlLaw, a function (t, q, v) → u, or None")


class CheckedLaw(ControlLaw):
    """A law whose u is looked at, so that one of the wrong size or none is told as the law's mistake.

    What it is given it can only read, and what it returns is copied, so a law that uses an array again changes nothing.
    At a State in other coordinates than its model's it is given q, q̇ and q′ as they are reported.

    Args:
        law: The law.
        model: Whose q, q̇ and u are the law's.
        reported: q, q̇ of this model and q′ at a State of another one, which the motion is in.
    """

    def __init__(
        self, law: ControlLaw, model: ReducedModel, reported: Callable[[State, Array], tuple[Array, Array, Array]]
    ) -> None:
        self._law, self._model, self._reported = law, model, reported
        self._motors, self._size = model.mechanism.actuated, model.n_actuated

    def torque(self, t: float, state: State | Measurement, v: Array) -> Array:
        """The law's, if it is of the motors' number.

        Raises:
            InvalidInputError: It is not, or the law took the State for an array.
        """
        if isinstance(state, State) and state.model is not self._model:
            q, v, q_free = self._reported(state, v)
            state = Measurement(q, q_free)
        if isinstance(state, Measurement):
            state = state._replace(q=frozen(state.q))
        try:
            u = self._law.torque(t, state, frozen(v))
        except TypeError as error:
            if not _AS_NUMBERS.search(str(error)):
                raise
            name, given = type(self._law).__name__, type(state).__name__
            told = f"torque(t, state, v) is given a {given}: state.q is q ({type(error).__name__}: {error})"
            raise InvalidInputError(f"{name}: {told}") from error
        return self._sized(u)

    def next_switch(self, t: float) -> float | None:
        """The law's."""
        return self._law.next_switch(t)

    def statement(self) -> Statement | None:
        """The law's."""
        return stated(self._law)

    def adopt(self, t: float, u: Array, learnt: Array) -> None:
        """The law does."""
        self._law.adopt(t, u, learnt)

    def _sized(self, u: ArrayLike) -> Array:
        found = frozen(numbers(u, "what the law returned"))  # a law may write into its own again
        if found.shape != (self._size,):
            raise InvalidInputError(
                f"the law returned u of shape {found.shape}; it must be ({self._size},), efforts of "
                f"{', '.join(self._motors) or 'no motor'}"
            )
        if not np.isfinite(found).all():
            raise InvalidInputError(f"the law returned u = {found.tolist()}, which is not finite")
        return found
