"""A motion at one instant: what is recorded of it, what happens, how it ends, and what all that is called."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.dynamics.state import State
from ccpin.kinematics.coordinates import component_names

Status = Literal["finished", "settled", "event", "singular", "outside", "exhausted", "failed", "interrupted"]
CHANGED = "measured by "
"""How the event begins in whose name a motion goes on in other independent coordinates."""


class Stop(NamedTuple):
    """How a motion ended: its status, that in a sentence, and the exception that ended it, if one did."""

    status: Status
    message: str
    cause: BaseException | None = None

    @classmethod
    def settled(cls, since: float) -> Stop:
        """It has settled."""
        return cls("settled", f"settled since t = {since:.6g} s")

    @classmethod
    def exhausted(cls, t: float, what: str) -> Stop:
        """The budget of evaluations or seconds is spent."""
        return cls("exhausted", f"at t = {t:.6g} s the budget of {what} was spent")

    @classmethod
    def broken_off(cls, t: float, cause: BaseException) -> Stop:
        """Ctrl-C, or an exception of whatever is called."""
        if isinstance(cause, KeyboardInterrupt):
            return cls("interrupted", f"interrupted at t = {t:.6g} s", cause)
        return cls("failed", f"at t = {t:.6g} s: {str(cause) or type(cause).__name__}", cause)


class EventRecord(NamedTuple):
    """Something that happened along a motion.

    Attributes:
        name: What.
        t: When, s.
        q: Independent coordinates, of shape (model.nq,). v: velocities, of shape (n,).
        q_free: The closed configuration, of shape (nq,).
    """

    name: str
    t: float
    q: Array
    v: Array
    q_free: Array

    @classmethod
    def at(cls, name: str, instant: tuple[float, State, Array]) -> EventRecord:
        """What happens at (t, State, v)."""
        t, state, v = instant
        return cls(name, float(t), state.q, np.array(v), state.q_free)


class StateSample(NamedTuple):
    """A motion at one instant; a `Trajectory` has a leading axis of samples on each of these.

    Attributes:
        t: Time, s.
        q: Independent coordinates, of shape (model.nq,).
        v: Velocities q̇, of shape (n,).
        a: Accelerations q̈, of shape (n,).
        u: Efforts of the actuated joints, of shape (motors,).
        q_free: The closed configuration σ(q), of shape (nq,).
        v_free: Velocities q̇′ of all joints, of shape (n′,): ρ q̇ where the coordinates measure the motion, and known
            where they do not.
        friction: Dry and viscous friction f on the free system's joints, N m or N, of shape (n′,).
        limits: What else acts on these joints: stops and contacts, N m or N, of shape (n′,).
        closure_error: ‖φ(q′)‖, metres (and radians).
    """

    t: float
    q: Array
    v: Array
    a: Array
    u: Array
    q_free: Array
    v_free: Array
    friction: Array
    limits: Array
    closure_error: float


SAMPLED = StateSample._fields
"""The quantities of a motion that have a value at every sample, in order."""


class ColumnNames(NamedTuple):
    """What the columns of each quantity are called."""

    q: tuple[str, ...]
    v: tuple[str, ...]
    u: tuple[str, ...]
    q_free: tuple[str, ...]
    v_free: tuple[str, ...]

    @classmethod
    def of(cls, model: ReducedModel) -> ColumnNames:
        """Of a model: joints by name, the numbers of a joint that has several by name and place."""
        mechanism, parts = model.mechanism, model.coordinates.parts
        sizes = [part.q.stop - part.q.start for part in parts]
        coordinates = [name for part, size in zip(parts, sizes, strict=True) for name in _numbered(part.name, size)]
        rates = [name for part in parts for name in _numbered(part.name, part.v.stop - part.v.start)]
        motors = mechanism.actuated if len(mechanism.actuated) == model.n_actuated else range(model.n_actuated)
        joints = [
            name for joint in mechanism.tree.joints for name in _numbered(joint.name, joint.q.stop - joint.q.start)
        ]
        components = component_names(mechanism.tree)
        return cls(tuple(coordinates), tuple(rates), tuple(map(str, motors)), tuple(joints), tuple(components))


def _numbered(name: str, count: int) -> list[str]:
    return [name] if count == 1 else [f"{name}.{k}" for k in range(count)]
