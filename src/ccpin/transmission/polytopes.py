"""Images of the motors' box: what efforts, or velocities, all motors together give at the joints.

With as many motors as joints the image of a box under Jᵀ, or J⁻¹, is a parallelotope, a zonotope whose generators are
independent: its corners are images of the box's, and it is {x : lower ≤ A x ≤ upper} with A the inverse of the map.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize

from ccpin.arrays import Array, Record, vector
from ccpin.dynamics.end_effector import Ellipsoid
from ccpin.errors import InvalidInputError

_INSIDE = 1.0 + 1e-12  # of a bound: what a product is off by rounding


class FirstAtLimit(NamedTuple):
    """Where a ray from 0 leaves a polytope.

    Attributes:
        motor: The motor that is at a bound there.
        scale: How many times the direction given; ∞ where nothing stops it.
    """

    motor: str
    scale: float


@dataclass(frozen=True, eq=False)
class Polytope(Record):
    """{map · z : lower ≤ z ≤ upper}: what motors give at the joints, or joints ask of motors the other way round.

    Attributes:
        map: Jᵀ for efforts, J⁻¹ for velocities, of shape (n, n).
        inverse: Its inverse.
        lower, upper: Bounds of the motors' efforts (velocities), N m or N (rad/s, m/s), of shape (n,).
        joints, motors: Names.
    """

    map: Array
    inverse: Array
    lower: Array
    upper: Array
    joints: tuple[str, ...]
    motors: tuple[str, ...]

    @cached_property
    def vertices(self) -> Array:
        """The 2ⁿ corners, of shape (2ⁿ, n); of two joints in order round the polygon."""
        ends = list(zip(self.lower.tolist(), self.upper.tolist(), strict=True))
        corners = list(product(*ends))
        if len(ends) == 2:
            corners = [corners[k] for k in (0, 1, 3, 2)]
        return np.array(corners) @ self.map.T

    @property
    def volume(self) -> float:
        """Of two joints the polygon's area, N² m² (rad²/s²), and so on."""
        return float(abs(np.linalg.det(self.map)) * np.prod(self.upper - self.lower))

    def contains(self, point: ArrayLike) -> bool:
        """Whether the motors give it."""
        asked = self.inverse @ vector(point, "point", len(self.lower))
        room = (_INSIDE - 1.0) * np.abs(self.inverse) @ np.abs(np.asarray(point))
        return bool(np.all(asked >= self.lower - room) and np.all(asked <= self.upper + room))

    def support(self, direction: ArrayLike) -> float:
        """max direction · x over the polytope."""
        rates = self.map.T @ vector(direction, "direction", len(self.lower))
        return float(np.where(rates > 0.0, rates * self.upper, rates * self.lower).sum())

    @property
    def bounds(self) -> tuple[Array, Array]:
        """The smallest box around it: lower and upper, of shape (n,)."""
        axes = np.eye(len(self.lower))
        return np.array([-self.support(-axis) for axis in axes]), np.array([self.support(axis) for axis in axes])

    def first_at_limit(self, direction: ArrayLike) -> FirstAtLimit:
        """Which motor is the first at its bound along a direction, and how far.

        Raises:
            InvalidInputError: 0 is outside.
        """
        self._require_zero_inside()
        rates = self.inverse @ vector(direction, "direction", len(self.lower))
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = np.where(rates > 0.0, self.upper / rates, np.where(rates < 0.0, self.lower / rates, np.inf))
        first = int(np.argmin(scale))
        return FirstAtLimit(self.motors[first], float(scale[first]))

    def largest_box(self, shape: ArrayLike | None = None) -> Array:
        """Half-widths b of a box |x| ≤ b that lies inside, of shape (n,): honest limits of joints, each for itself.

        A box lies inside iff |A| b ≤ min(upper, −lower), A the map's inverse. Of a given shape the largest is a
        quotient; without one it is that of the largest volume.

        Args:
            shape: Half-widths up to a common factor, positive, of shape (n,).

        Raises:
            InvalidInputError: 0 is outside, or a shape that is none.
        """
        self._require_zero_inside()
        room, asked = np.minimum(self.upper, -self.lower), np.abs(self.inverse)
        if shape is not None:
            wanted = vector(shape, "shape", len(room))
            if not (wanted > 0.0).all():
                raise InvalidInputError(f"shape = {wanted} must be positive")
            return _scaled(wanted, asked, room)
        start = _scaled(np.maximum(np.abs(self.map) @ room, 1e-300), asked, room)
        if not (room > 0.0).all():
            return start

        def objective(x: Array) -> tuple[float, Array]:
            return -float(np.log(x).sum()), -1.0 / x

        relative = asked * start / room[:, None]  # in units of the start
        found = minimize(
            objective, np.full(len(room), 0.9), jac=True, method="SLSQP", bounds=[(1e-6, None)] * len(room),
            constraints={"type": "ineq", "fun": lambda x: 1.0 - relative @ x, "jac": lambda x: -relative},
            options={"ftol": 1e-14, "maxiter": 200},
        )  # fmt: skip
        better = _scaled(np.maximum(found.x, 1e-6) * start, asked, room)
        return better if np.prod(better / start) > 1.0 else start

    def largest_ellipsoid(self) -> Ellipsoid:
        """The ellipsoid of the largest volume, about the middle: the image of the one in the motors' box.

        An affine map keeps ratios of volumes, so the largest in the image is the image of the largest in the box,
        Σ (2zᵢ/(upperᵢ − lowerᵢ))² ≤ 1, z from the middle.
        """
        mapped = self.map * (0.5 * (self.upper - self.lower))
        axes, lengths, _ = np.linalg.svd(mapped)
        return Ellipsoid(mapped, axes, lengths)

    def _require_zero_inside(self) -> None:
        if (self.lower > 0.0).any() or (self.upper < 0.0).any():
            raise InvalidInputError(f"motors cannot give nothing: bounds {self.lower} … {self.upper}")


def _scaled(shape: Array, asked: Array, room: Array) -> Array:
    """The largest multiple of a box that lies inside."""
    return np.asarray(shape * float((room / (asked @ shape)).min()))
