"""A sampled control loop: encoders, differentiated and filtered velocity, zero-order hold, saturation, delay."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ccpin.arrays import Array, numbers
from ccpin.control.control_law import ControlLaw, Measurement
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.dynamics.state import State
from ccpin.errors import InvalidInputError

Numbers = float | tuple[float, ...]


@dataclass(frozen=True)
class Sampling:
    """How a digital controller sees and drives the mechanism; everything but the period is off by default.

    At t_k = kT the coordinates are measured, the law computes u_k = law(t_k, q̂_k, v̂_k), and the motors get
    sat(u_{k−d}) from t_k until t_{k+1}.

    Attributes:
        period: T in seconds.
        encoder_counts: Counts a revolution (after any quadrature) of the encoders on the independent joints, counts
            a metre on sliding ones: q̂ is q rounded to the nearest count. ``None``: q̂ = q.
        velocity_cutoff: Cut-off frequency f_c in Hz of the first-order low-pass filter in software,
            v̂_k = v̂_{k−1} + (1 − e^{−2πf_cT})((q̂_k − q̂_{k−1})/T − v̂_{k−1}). ``None``: no filter.
            With neither encoder (nor noise) nor filter v̂ = q̇ (an ideal tachometer); else q̂ is differentiated.
        saturation: Largest |u| of each motor, N m or N. ``None``: none.
        delay: d, whole periods from measurement to torque.
        effort_before: What the motors get until the first command arrives, where there is a delay; default nothing.
        encoder_noise: Standard deviation of normal noise on each coordinate measured, rad or m, before it is rounded.
        seed: Of the noise, which belongs to the seed and the sample's number: the same in every run.

    One number stands for all joints or motors; a sequence gives one each.

    Raises:
        InvalidInputError: A value out of its range.
    """

    period: float
    encoder_counts: Numbers | None = None
    velocity_cutoff: float | None = None
    saturation: Numbers | None = None
    delay: int = 0
    effort_before: Numbers = 0.0
    encoder_noise: Numbers = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value is None and field.name in ("encoder_counts", "velocity_cutoff", "saturation"):
                continue
            object.__setattr__(self, field.name, _checked_value(field.name, value))


def _checked_value(name: str, value: object) -> Numbers | int:
    if name in ("delay", "seed"):
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 0:
            what = "whole number of periods" if name == "delay" else "whole number"
            raise InvalidInputError(f"sampling: {name} = {value!r} must be a {what}, 0 or more")
        return int(value)
    try:
        array = numbers(value, name)
    except InvalidInputError:
        array = np.empty(0)
    several = name in ("encoder_counts", "saturation", "effort_before", "encoder_noise")
    if array.ndim > several or not array.size or not np.isfinite(array).all():
        raise InvalidInputError(
            f"sampling: {name} = {value!r} must be a finite number" + (" or one each" if several else "")
        )
    if name == "encoder_noise" and array.min() < 0:
        raise InvalidInputError(f"sampling: {name} = {value!r} must be 0 or more")
    if name not in ("effort_before", "encoder_noise") and array.min() <= 0:
        raise InvalidInputError(f"sampling: {name} = {value!r} must be positive")
    return tuple(array.tolist()) if array.ndim else float(array)


class ContinuousCommands:
    """Who commands the motors' efforts during a run: the law itself, at every moment.

    Attributes:
        law: The law; it may be replaced while the run goes on.
    """

    def __init__(self, law: ControlLaw) -> None:
        self.law = law

    def numbers(self) -> None:
        """Nothing is sampled."""

    def instant(self, t: float, state: State, v: Array) -> float:
        """When the next command is due: never."""
        return np.inf

    def effort(self, t: float, state: State, v: Array) -> Array:
        """u = law(t, q, q̇)."""
        return self.law.torque(t, state, v)

    def next_switch(self, t: float) -> float | None:
        """The law's."""
        return self.law.next_switch(t)

    def adopt(self, memory: None) -> None:
        """Nothing is remembered."""

    def memory(self) -> dict[str, Array]:
        """Nothing is remembered."""
        return {}

    def recall(self, memory: Mapping[str, Array]) -> None:
        """Nothing is remembered."""


class SampledCommands:
    """One run of a sampled loop: the encoder's last reading, the filter's state and the commands on their way.

    Before it begins the mechanism is taken to have moved steadily at v0, so the filter starts settled.

    Args:
        model: The reduced model.
        law: The law.
        sampling: How it is run.
        q0: q at the start.
        v0: q̇ at the start.
        start: The time of the first sample, s.
        place: Tells q, q̇ and q′ at a State in other coordinates than the model's; default by `ReducedModel.reading`.

    Attributes:
        law: The law; it may be replaced while the run goes on, and is asked at the next sample.

    Raises:
        InvalidInputError: A value for each joint or motor with another number of them, or an encoder on a coordinate
            that is not a plain number.
    """

    def __init__(
        self,
        model: ReducedModel,
        law: ControlLaw,
        sampling: Sampling,
        q0: Array,
        v0: Array,
        start: float = 0.0,
        place: Callable[[State, Array], tuple[Array, Array, Array]] | None = None,
    ) -> None:
        self.law = law
        self._model, self._sampling, self._start = model, sampling, start
        self._place = place or (lambda state, v: (*model.reading(state, v), state.q_free))
        self._coordinates = model.coordinates
        most = np.inf if sampling.saturation is None else sampling.saturation
        self._limit = _each(most, model.n_actuated, "saturation", "motor")
        self._resolution = None if sampling.encoder_counts is None else _resolution(model, sampling.encoder_counts)
        self._noise = _noise(model, sampling.encoder_noise)
        self._encodes = self._resolution is not None or self._noise is not None
        self._differentiates = self._encodes or sampling.velocity_cutoff is not None
        cutoff = np.inf if sampling.velocity_cutoff is None else sampling.velocity_cutoff
        self._gain = -np.expm1(-2 * np.pi * cutoff * sampling.period)
        self._reading = self._measured(self._coordinates.integrate(q0, -sampling.period * v0), 0)
        self._velocity = v0.copy()
        before = _each(sampling.effort_before, model.n_actuated, "effort_before", "motor")
        self._pending = deque([before] * sampling.delay)
        self._held = before
        self._count = 0

    def numbers(self) -> dict[str, Any]:
        """The loop in plain numbers, as the compiled core takes it."""
        return {
            "period": self._sampling.period,
            "gain": self._gain,
            "differentiates": self._differentiates,
            "resolution": [] if self._resolution is None else self._resolution.tolist(),
            "limit": self._limit.tolist(),
            "start": self._start,
            "reading": self._reading.tolist(),
            "velocity": self._velocity.tolist(),
            "held": self._held.tolist(),
            "pending": np.ravel(list(self._pending)).tolist(),
            "count": self._count,
        }

    def adopt(self, memory: tuple[Array, Array, Array, Array, float, Array]) -> None:
        """Go on from what the compiled core's loop remembers: reading, velocity, held, pending, count, and learnt."""
        self._reading, self._velocity, self._held, pending, count, learnt = memory
        self._pending, self._count = deque(np.reshape(pending, (-1, len(self._held)))), int(count)
        last = self._start + (self._count - 1) * self._sampling.period
        self.law.adopt(last, [self._held, *self._pending][-1], learnt)

    def instant(self, t: float, state: State, v: Array) -> float:
        """Where a sample is due: measure, filter, compute the command, hold the one due. When the next one is."""
        due = self._due()
        if t < due - 16 * np.spacing(abs(due)):
            return due
        q, velocity, q_free = self._place(state, v)
        reading = self._measured(q, self._count + 1)
        if self._differentiates:
            slope = self._coordinates.difference(self._reading, reading) / self._sampling.period
            velocity = self._velocity + self._gain * (slope - self._velocity)
        seen = not self._encodes and state.model is self._model
        u = np.array(self.law.torque(t, state if seen else Measurement(reading, q_free), velocity))
        self._reading, self._velocity = reading, velocity
        self._pending.append(np.clip(u, -self._limit, self._limit))
        self._held = self._pending.popleft()
        self._count += 1
        return self._due()

    def effort(self, t: float, state: State, v: Array) -> Array:
        """The command held."""
        return self._held

    def next_switch(self, t: float) -> float:
        """Never between samples."""
        return np.inf

    def memory(self) -> dict[str, Array]:
        """What is remembered from sample to sample, as arrays; `recall` brings it back."""
        return {
            "reading": self._reading,
            "velocity": self._velocity,
            "held": self._held,
            "pending": np.reshape(list(self._pending), (-1, len(self._held))),
            "clock": np.array([self._start, self._count]),
        }

    def recall(self, memory: Mapping[str, Array]) -> None:
        """Go on from what another run of the same loop remembered."""
        self._reading, self._velocity, self._held = (memory[name] for name in ("reading", "velocity", "held"))
        self._pending = deque(memory["pending"])
        self._start, self._count = float(memory["clock"][0]), int(memory["clock"][1])

    def _due(self) -> float:
        return self._start + self._count * self._sampling.period

    def _measured(self, q: Array, number: int) -> Array:
        """The reading of that number."""
        if self._noise is not None:
            q = q + self._noise * np.random.default_rng([self._sampling.seed, number]).standard_normal(len(q))
        if self._resolution is None:
            return q
        return np.asarray(np.round(q / self._resolution) * self._resolution)


def _each(value: Numbers, count: int, name: str, what: str) -> Array:
    array = np.asarray(value, dtype=np.float64)
    if array.shape not in ((), (count,)):
        raise InvalidInputError(
            f"sampling: {name} has {array.size} values; it must be one number or {count}, one a {what}"
        )
    return np.array(np.broadcast_to(array, (count,)))


def _noise(model: ReducedModel, deviation: Numbers) -> Array | None:
    """The noise of each encoder in radians or metres, of shape (n,); ``None`` where there is none."""
    if not np.any(deviation):
        return None
    _require_plain(model, "encoder_noise")
    return _each(deviation, model.n, "encoder_noise", "independent joint")


def _require_plain(model: ReducedModel, name: str) -> None:
    if not model.coordinates.scalar:
        raise InvalidInputError(
            f"sampling: {name} needs independent coordinates that are plain angles or lengths; leave it out, or "
            "name single components (joint:axis) as independent"
        )


def _resolution(model: ReducedModel, counts: Numbers) -> Array:
    """One count of each encoder in radians or metres, of shape (n,)."""
    _require_plain(model, "encoder_counts")
    each = _each(counts, model.n, "encoder_counts", "independent joint")
    lengths = [slides for part in model.coordinates.parts for slides in part.slides]
    return np.asarray(np.where(lengths, 1.0, 2 * np.pi) / each)
