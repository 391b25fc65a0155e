"""What a simulation does where joints reach the limits their file states: stops, saturation, or the end.

A stop is a spring that only pushes, with Hunt and Crossley's damper (Coefficient of restitution interpreted as damping
in vibroimpact, J. Appl. Mech. 42, 1975): δ metres or radians beyond the limit a joint feels

    f = k δ max(0, 1 + c δ̇)

back towards its range. The force is continuous, never pulls, and gives back at most what it took: ½kδ² is its
potential, k δ c δ̇² the power it loses. A mass that arrives at speed v leaves at speed w with

    c w + ln(1 − c w) = ln(1 + c v) − c v,

whatever k and the mass: the restitution is w/v ≈ 1 − ⅔ c v.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ccpin.arrays import Array, choice, number, positive
from ccpin.description.names import choices
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.dynamics.state import State
from ccpin.errors import InvalidInputError
from ccpin.mechanism.joint_limits import position_bounds
from ccpin.mechanism.mechanism import Mechanism

Position = Literal["ignore", "stop", "end"]
Velocity = Literal["ignore", "saturate", "end"]
Effort = Literal["saturate", "ignore", "end"]

_STOP_FREQUENCY = 50.0  # Hz, of the mass felt at a stop that swings on it
_TAPER = 0.05  # of the speed limit: over its last part a motor's effort fades out


@dataclass(frozen=True)
class Limits:
    """How a simulation treats the limits that joints and motors state; it never alters the mechanism.

    Attributes:
        position: ``ignore`` (default): joints move beyond their limits; ``stop``: they hit a stop; ``end``: the motion
            ends there. Joints with one displacement have stops, dependent ones as well as independent ones.
        velocity: ``ignore`` (default); ``saturate``: over the last 5 % of the speed that a motor's joint may have,
            what the motor can exert in that direction falls to nothing; ``end``: any joint faster than its limit ends
            the motion.
        effort: ``saturate`` (default): motors give what they can, u within `mechanism.motors.limits`; ``ignore``: they
            give whatever is asked; ``end``: a law that asks for more ends the motion.
        stiffness: k of the stops, N m/rad or N/m: a number or ``{joint: number}``. Default (2π 50 Hz)² times the
            inertia that each joint feels at the reference, so that a contact takes about 10 ms.
        dissipation: c of the stops, s/rad or s/m.

    Raises:
        InvalidInputError: An unknown word, or numbers out of their range.
    """

    position: Position = "ignore"
    velocity: Velocity = "ignore"
    effort: Effort = "saturate"
    stiffness: float | Mapping[str, float] | None = None
    dissipation: float = 0.5

    def __post_init__(self) -> None:
        for name, words in (("position", Position), ("velocity", Velocity), ("effort", Effort)):
            choice(getattr(self, name), f"limits: {name}", get_args(words))
        stiffness = self.stiffness
        each = stiffness if isinstance(stiffness, Mapping) else {} if stiffness is None else {"stiffness": stiffness}
        for name, value in each.items():
            positive(value, f"limits: {name}")
        number(self.dissipation, "limits: dissipation", "a number, 0 or more", -1e-300)


class Stops:
    """The stops of a mechanism's joints, as forces on the free system.

    Args:
        model: The reduced model.
        limits: k and c.

    Attributes:
        names: Each stop's joint and side.

    Raises:
        InvalidInputError: A stiffness for what is no joint with a limit.
    """

    def __init__(self, model: ReducedModel, limits: Limits) -> None:
        bounds = position_bounds(model.mechanism)
        self.names = tuple(f"{bound.joint} at its {bound.side} limit" for bound in bounds)
        self._q = np.array([bound.q for bound in bounds], dtype=np.intp)
        self._v = np.array([bound.v for bound in bounds], dtype=np.intp)
        self._sign = np.array([bound.sign for bound in bounds], dtype=np.float64)
        self._limit = np.array([bound.limit for bound in bounds], dtype=np.float64)
        self._size = model.mechanism.n_free
        self._stiffness = _stiffness(model, limits, [bound.joint for bound in bounds], self._v)
        self._dissipation = limits.dissipation

    def gaps(self, t: float, state: State, v: Array) -> Array:
        """How far each joint is from each of its limits, negative beyond, rad or m, of shape (stops,)."""
        return np.asarray(self._sign * (self._limit - state.q_free[self._q]))

    def loads(self, t: float, state: State, v: Array) -> Array:
        """The stops' forces on the free system's joints, N m or N, of shape (n′,)."""
        depth = np.maximum(0.0, -self.gaps(t, state, v))
        loads = np.zeros(self._size)
        if depth.any():
            sinking = self._sign * state.v_free(v)[self._v]
            force = self._stiffness * depth * np.maximum(0.0, 1.0 + self._dissipation * sinking)
            np.add.at(loads, self._v, -self._sign * force)
        return loads

    def potential(self, state: State) -> float:
        """½ Σ k δ², J."""
        depth = np.maximum(0.0, -self.gaps(0.0, state, np.empty(0)))
        return float(0.5 * self._stiffness @ depth**2)


class Saturation:
    """What motors can give: bounds of u by their efforts' limits, narrowed near their joints' speed limits.

    Args:
        model: The reduced model.
        limits: What to keep to.

    Attributes:
        lower: Of u, of shape (motors,). upper: alike.
        by_speed: Whether these fade out with speed. acts: Whether there is any bound.
    """

    def __init__(self, model: ReducedModel, limits: Limits) -> None:
        mechanism = model.mechanism
        motors = mechanism.motors
        endless = np.tile([-np.inf, np.inf], (len(motors.gears), 1))
        self.lower, self.upper = (motors.limits if limits.effort == "saturate" else endless).T
        self._v = motor_velocities(mechanism)
        speeds = mechanism.joints.velocity[self._v]
        self._speeds = np.where((speeds > 0) & (limits.velocity == "saturate"), speeds, np.inf)
        self._gears = motors.gears
        self.by_speed = bool(np.isfinite(self._speeds).any())
        if self.by_speed and not np.isfinite(np.concatenate([self.lower, self.upper])).all():
            self._check_bounded(mechanism)
        self.acts = self.by_speed or bool(np.isfinite([self.lower, self.upper]).any())

    def bounds(self, state: State, v: Array) -> tuple[Array, Array]:
        """The least and largest u there, of shape (motors,) each."""
        if not self.by_speed:
            return self.lower, self.upper
        ahead = state.v_free(v)[self._v] / self._speeds * np.sign(self._gears)
        upper = self.upper * np.clip((1.0 - ahead) / _TAPER, 0.0, 1.0)
        return self.lower * np.clip((1.0 + ahead) / _TAPER, 0.0, 1.0), upper

    def headroom(self, t: float, state: State, v: Array) -> Array:
        """How far each motor's joint is from where its efforts begin to fade, rad/s or m/s, of shape (motors,)."""
        return np.asarray((1.0 - _TAPER) * self._speeds - np.abs(state.v_free(v)[self._v]))

    def _check_bounded(self, mechanism: Mechanism) -> None:
        endless = ~np.isfinite([self.lower, self.upper]).all(axis=0) & np.isfinite(self._speeds)
        if endless.any():
            name = mechanism.motors.each[int(np.flatnonzero(endless)[0])].joint
            raise InvalidInputError(
                f"limits: velocity = 'saturate' needs the motor of '{name}' to have a limit of effort to fade out; "
                'state one (motors={"' + name + '": {"lower": …, "upper": …}})'
            )


def motor_velocities(mechanism: Mechanism) -> NDArray[np.intp]:
    """Where the velocity of each motor's joint stands in q̇′, of shape (motors,)."""
    places: list[int] = []
    for name in mechanism.actuated:
        joint, component = mechanism.tree.split(name)
        window = mechanism.tree.joint(joint).v
        own = list(range(window.start, window.stop))
        places += own if not component else [own[mechanism.tree.joint(joint).kind.components.index(component)]]
    return np.array(places, dtype=np.intp)


def _stiffness(model: ReducedModel, limits: Limits, names: list[str], v: NDArray[np.intp]) -> Array:
    """k of each stop, of shape (stops,)."""
    if isinstance(limits.stiffness, Mapping):
        for name in limits.stiffness:
            if name not in names:
                raise InvalidInputError(f"limits: '{name}' has no stop; {choices(str(name), dict.fromkeys(names))}")
    elif limits.stiffness is not None:
        return np.full(len(names), float(limits.stiffness))
    state = model.at(model.alpha(model.mechanism.q_reference))
    compliance = np.einsum("ij,ij->i", state.rho[v], np.linalg.solve(state.D, state.rho[v].T).T)
    felt = 1.0 / np.maximum(compliance, 1e-12 / np.diag(state.D).max())
    stated = limits.stiffness or {}
    return np.array(
        [stated.get(name, k) for name, k in zip(names, (2 * np.pi * _STOP_FREQUENCY) ** 2 * felt, strict=True)]
    )
