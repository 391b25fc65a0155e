"""What a control law is, how it is asked, and laws that know no model: constant efforts, functions, later clocks."""

from __future__ import annotations

import abc
import inspect
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, numbers
from ccpin.control.statements import LawKind, Statement, speaks_for
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.dynamics.state import Near, State
from ccpin.errors import InvalidInputError
from ccpin.mechanism.mechanism import Mechanism
from ccpin.proof.digests import Digests, digest_or_none


class Measurement(NamedTuple):
    """What a law is given in place of a State where q is only measured: nobody has closed a configuration there.

    Attributes:
        q: Independent coordinates, of shape (model.nq,).
        near: A configuration near σ(q) where one is known, or ``None``; it may be a plant's. It only shortens the law's
            own σ.
    """

    q: Array
    near: Near = None


class ControlLaw(abc.ABC):
    """A law u = torque(t, state, v) for the actuated joints.

    What a law needs of a model it asks of its own: the State it is given may be of another, a plant's (`of_own`).

    Attributes:
        everywhere: Whether u is defined also where the coordinates q are singular, because the law reads t, q and q̇ as
            numbers only. A simulation then goes on there; under any other law it ends.
        period: T of a law that remembers, s: a simulation asks it once a period, in order (`begin`); ``None``: it is a
            function of its arguments, and may be asked at any time.
    """

    everywhere: bool = False
    period: float | None = None

    @abc.abstractmethod
    def torque(self, t: float, state: State | Measurement, v: Array) -> Array:
        """The efforts of the actuated joints, of shape (motors,).

        Args:
            t: Time in seconds.
            state: Where the mechanism is: the State at q, or a Measurement where q comes from sensors.
            v: Velocities of the independent coordinates, of shape (n,).
        """

    @property
    def digests(self) -> Digests:
        """What it is about: its model, and its kind and constants, of which a function's numbers tell nothing."""
        model = getattr(self, "model", None)
        own = model.digests if isinstance(model, ReducedModel) else Digests("")
        name = f"{type(self).__name__} of {own.name}" if own.name else type(self).__name__
        return own._replace(name=name, law=digest_or_none((type(self).__qualname__, own, vars(self))))

    def next_switch(self, t: float) -> float | None:
        """The first time after t at which u jumps or kinks as a function of time.

        Infinite where it never does, ``None`` where the law does not say (`ccpin.simulate` then takes short steps).
        """
        return None

    def begin(self) -> ControlLaw:
        """What a run asks, made anew as it begins: of a law that remembers, one with nothing to remember yet."""
        return self

    def statement(self) -> Statement | None:
        """The law in constants, ``None`` where it has none. `stated` is what asks for it."""
        return None

    def adopt(self, t: float, u: Array, learnt: Array) -> None:  # noqa: B027  (a law that remembers nothing need not)
        """Go on from the compiled core's run of what it states.

        Args:
            t: When the core asked last, s.
            u: What the law gave then, of shape (motors,).
            learnt: What it remembers from there on.
        """


def stated(law: ControlLaw | None) -> Statement | None:
    """What a law is in constants, unless it or a class of its own does otherwise; no law at all is no torque."""
    if law is None:
        return Statement("constant")
    return law.statement() if speaks_for(law, "statement") else None


def idle(law: ControlLaw | None) -> bool:
    """Whether a law is no torque, by its own word."""
    found = stated(law)
    return found is not None and found.idle


def kind_of(law: ControlLaw | None) -> LawKind | None:
    """The kind a law states of itself, if it does."""
    found = stated(law)
    return None if found is None else found.kind


def of_own(model: ReducedModel, state: State | Measurement, near: Near) -> State:
    """The State of a law's own model at the q of another's, or at a q that was measured.

    A State of the same mechanism stands for itself. σ starts from the configuration given where both mechanisms have as
    many coordinates, and from `near` where none is given or it is too far from closed for the law's own loops.

    Raises:
        InvalidInputError: It is neither a State nor a Measurement; else errors as for `ReducedModel.at`.
    """
    if isinstance(state, State):
        if state.model.mechanism is model.mechanism:
            return model.at(state)
        state = Measurement(state.q, state.q_free if len(state.q_free) == model.mechanism.nq else None)
    q = q_of(state)
    if state.near is not None:
        with suppress(InvalidInputError):
            return model.at(q, state.near)
    return model.at(q, near)


def q_of(state: State | Measurement) -> Array:
    """The independent coordinates at which a law is asked.

    Raises:
        InvalidInputError: It is neither a State nor a Measurement.
    """
    if not isinstance(state, State | Measurement):
        raise InvalidInputError(
            "a law takes the State model.at(q), or Measurement(q, near) where q comes from sensors, not "
            f"{type(state).__name__}"
        )
    return state.q


def require_called_as(call: str, function: Callable[..., object]) -> None:
    """Check that what a law is can be called with three arguments, as far as its signature is known.

    Args:
        call: How it is called, as in ``law(t, q, v)``.
        function: It.

    Raises:
        InvalidInputError: It takes fewer or more, or cannot be called at all.
    """
    if not callable(function):
        raise InvalidInputError(f"a law is called as {call}; {type(function).__name__} cannot be called")
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):  # compiled code need not have one
        return
    try:
        signature.bind(0.0, None, None)
    except TypeError as error:
        raise InvalidInputError(f"a law is called as {call}, which this one does not take: {error}") from error


class HeldEffort(ControlLaw):
    """A constant u.

    Args:
        effort: It, of shape (motors,).
    """

    everywhere = True

    def __init__(self, effort: Array) -> None:
        self.effort = effort

    def torque(self, t: float, state: State | Measurement, v: Array) -> Array:
        """The effort."""
        return self.effort

    def next_switch(self, t: float) -> float:
        """Never."""
        return np.inf

    def statement(self) -> Statement:
        """The effort."""
        return Statement("constant", constant=self.effort)


class NoTorque(HeldEffort):
    """u = 0: the mechanism swings freely."""

    def __init__(self, model: ReducedModel | Mechanism) -> None:
        super().__init__(np.zeros(model_of(model).n_actuated))


class TorqueFunction(ControlLaw):
    """Any function (t, q, v) → u as a law.

    Args:
        function: The function.
        switching_times: The times at which u jumps or kinks, s; none at all where it never does. ``None``: not known.

    Raises:
        InvalidInputError: It is no function of three arguments, or times that are not finite numbers.
    """

    everywhere = True

    def __init__(
        self, function: Callable[[float, Array, Array], ArrayLike], switching_times: Sequence[float] | None = None
    ) -> None:
        require_called_as("law(t, q, v)", function)
        self._function = function
        self._times = None if switching_times is None else np.sort(np.asarray(switching_times, dtype=np.float64))
        if self._times is not None and not (self._times.ndim == 1 and np.isfinite(self._times).all()):
            raise InvalidInputError(f"switching_times must be finite numbers of seconds, not {switching_times!r}")

    def torque(self, t: float, state: State | Measurement, v: Array) -> Array:
        """What the function returns, as a float64 vector; one number stands for the effort of an only motor."""
        return np.atleast_1d(numbers(self._function(t, q_of(state), v), "what the law returned"))

    def next_switch(self, t: float) -> float | None:
        """The next of the times given."""
        return None if self._times is None else next_of(self._times, t)


class Delayed(ControlLaw):
    """A law whose clock starts at a time: its t is the time since then.

    Args:
        law: The law.
        start: When its clock shows zero, s.

    Attributes:
        law, start: As given.
    """

    def __init__(self, law: ControlLaw, start: float) -> None:
        self.law, self.start, self.everywhere, self.period = law, start, law.everywhere, law.period

    def begin(self) -> Delayed:
        """The law as it begins, on the same clock."""
        return Delayed(self.law.begin(), self.start)

    def torque(self, t: float, state: State | Measurement, v: Array) -> Array:
        """The law's efforts at t − start."""
        return self.law.torque(self._clock(t), state, v)

    def next_switch(self, t: float) -> float | None:
        """The law's next switch, on the clock outside."""
        switch = self.law.next_switch(self._clock(t))
        return None if switch is None else switch + self.start

    def statement(self) -> Statement | None:
        """The law's, on a clock that starts later."""
        found = stated(self.law)
        return None if found is None else found._replace(start=found.start + self.start)

    def adopt(self, t: float, u: Array, learnt: Array) -> None:
        """The law does, on its clock."""
        self.law.adopt(self._clock(t), u, learnt)

    def _clock(self, t: float) -> float:
        """t − start; a switch that is not later than t on the clock outside is not later on the law's own."""
        inside = t - self.start
        switch = self.law.next_switch(inside)
        return switch if switch is not None and switch + self.start <= t else inside


def undelayed(law: ControlLaw) -> ControlLaw:
    """A law itself, whatever clock it is on."""
    return law.law if isinstance(law, Delayed) else law


def next_of(times: Array, t: float) -> float:
    """The first of increasing times that is later than t, infinite where none is."""
    k = int(np.searchsorted(times, t, side="right"))
    return float(times[k]) if k < len(times) else np.inf
