"""The independent coordinates as plain numbers that a hand can turn, whatever manifold they live on."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, numbers
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import InvalidInputError
from ccpin.kinematics.coordinates import Coordinate

NO_LIMIT = 1.0
"""Half the range (m, about the reference) of a slide without limits."""


class Dial(NamedTuple):
    """One number: what it is called, whether it is an angle (rad) or a length (m), and the range it is shown on."""

    name: str
    angle: bool
    lower: float
    upper: float


class Dials:
    """q ↔ n plain numbers: scalar coordinates as they are, circles as angles, balls as turns from the reference.

    Args:
        model: The reduced model.

    Attributes:
        each: The dials, n of them, in the order of q̇.
    """

    def __init__(self, model: ReducedModel) -> None:
        self._model = model
        self._reference = model.alpha(model.mechanism.q_reference)
        limits = model.mechanism.position_limits
        self.each = tuple(dial for part in model.coordinates.parts for dial in self._dials(part, limits))

    def values(self, q: Array) -> Array:
        """The numbers of a q of shape (model.nq,), of shape (n,)."""
        parts = self._model.coordinates.parts
        return np.concatenate([np.zeros(0), *(self._read(part, q) for part in parts)])

    def q(self, values: object) -> Array:
        """The q of n numbers, of shape (model.nq,).

        Raises:
            InvalidInputError: They are not n finite numbers.
        """
        given = numbers(values, "q")  # type: ignore[arg-type]
        if given.shape != (len(self.each),) or not np.isfinite(given).all():
            names = ", ".join(dial.name for dial in self.each)
            raise InvalidInputError(f"q must be {len(self.each)} finite numbers ({names})")
        parts = self._model.coordinates.parts
        return np.concatenate([np.zeros(0), *(self._write(part, given[part.v]) for part in parts)])

    def _read(self, part: Coordinate, q: Array) -> Array:
        kind = part.whole
        if kind is None:
            return q[part.q]
        if kind.unit == 2:
            *slides, cosine, sine = q[part.q].tolist()
            return np.array([*slides, math.atan2(sine, cosine)])
        return np.asarray(kind.difference(self._reference[part.q], q[part.q]))

    def _write(self, part: Coordinate, values: Array) -> Array:
        kind = part.whole
        if kind is None:
            return values
        if kind.unit == 2:
            return np.array([*values[:-1], math.cos(values[-1]), math.sin(values[-1])])
        coordinates, step = self._model.coordinates, np.zeros(self._model.n)
        step[part.v] = values
        return np.asarray(coordinates.integrate(self._reference, step)[part.q])

    def _dials(self, part: Coordinate, limits: tuple[Array, Array]) -> list[Dial]:
        names, at = self._names(part), self._read(part, self._reference)
        single = part.whole is None and part.q_free.stop - part.q_free.start == 1 and part.component is None
        dials = []
        for name, slides, value in zip(names, part.slides, at.tolist(), strict=True):
            low, high = (float(limit[part.q_free.start]) for limit in limits) if single else (-math.inf, math.inf)
            if not slides:
                low, high = max(low, -math.pi), min(high, math.pi)
            low = low if math.isfinite(low) else value - NO_LIMIT
            high = high if math.isfinite(high) else value + NO_LIMIT
            if low > value or value > high or high - low < 1e-9:  # a reference outside of one turn, limits of no width
                low, high = min(low, value - NO_LIMIT), max(high, value + NO_LIMIT)
            dials.append(Dial(name, not slides, low, high))
        return dials

    @staticmethod
    def _names(part: Coordinate) -> list[str]:
        count = part.v.stop - part.v.start
        axes = part.kind.components if len(part.kind.components) == count else range(count)
        return [part.name] if count == 1 else [f"{part.name}:{axis}" for axis in axes]
