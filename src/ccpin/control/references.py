"""Smooth references q_d(t) for tracking, with exact velocity and acceleration, at rest before and after.

References live on the manifold of q: between two points along the geodesic (the straight line, for plain
coordinates), through waypoints along a spline of plain and circular coordinates.
"""

from __future__ import annotations

import abc
import itertools
import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline, make_interp_spline

from ccpin.arrays import Array, frozen, instance, matrix_rows, numbers, positive, whole
from ccpin.dynamics.end_effector import EndEffector
from ccpin.dynamics.reduced_model import ReducedModel, coordinates_of
from ccpin.dynamics.state import Near
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.kinematics.coordinates import IndependentCoordinates, checked_q
from ccpin.mechanism.mechanism import Mechanism


class ReferenceState(NamedTuple):
    """A reference at one time.

    Attributes:
        q: q_d, of shape (model.nq,).
        v: q̇_d, of shape (n,).
        a: q̈_d, of shape (n,).
    """

    q: Array
    v: Array
    a: Array


class PiecewisePolynomial(NamedTuple):
    """A reference as q_d(t) = start ⊕ p(t), p polynomial between the breaks, at rest before and after.

    Attributes:
        start: A q, of shape (nq_independent,).
        breaks: Times, of shape (k + 1,), or none for a set point.
        coefficients: p's of t − break, the highest power first, of shape (k, degree + 1, n).
    """

    start: Array
    breaks: Array
    coefficients: Array


class Reference(abc.ABC):
    """A motion q_d(t) for t in [0, duration], held at rest outside.

    Attributes:
        duration: Seconds.
    """

    duration: float

    @abc.abstractmethod
    def at(self, t: float) -> ReferenceState:
        """q_d, q̇_d and q̈_d at time t."""

    def as_polynomial(self) -> PiecewisePolynomial | None:
        """The same motion as a piecewise polynomial, or ``None`` where it is none.

        Whoever overrides `at` says this anew: simulations may read it in place of `at`.
        """
        return None

    def next_switch(self, t: float) -> float | None:
        """The first time after t at which q̈_d or one of its rates jumps; infinite: never; ``None``: not known."""
        return None


class PointToPoint(Reference):
    """From one q to another at rest, along the geodesic with the quintic time law of least mean square jerk.

    q_d(t) = q₀ ⊕ s(t/T) Δ with s(x) = 10x³ − 15x⁴ + 6x⁵ and Δ = q₁ ⊖ q₀; q̇_d = ṡ Δ and q̈_d = s̈ Δ exactly, also on
    circles and quaternions. The largest |q̇_d| is 15|Δ|/8T, at T/2; the largest |q̈_d| is 10|Δ|/(√3 T²).

    Args:
        model: A mechanism or model, for the manifold of q.
        q_start: Start, of shape (model.nq,).
        q_goal: Goal, alike.
        duration: T in seconds.

    Raises:
        InvalidInputError: Bad coordinates, or a duration that is not positive.

    Example:
        Half a second from the reference to a goal, and what the motors give on the way::

            reference = PointToPoint(model, model.alpha(model.mechanism.q_reference), [-1.57, -1.75], 0.5)
            wanted = reference.at(0.2)
            u = model.at(wanted.q).inverse_dynamics(wanted.v, wanted.a)
    """

    def __init__(self, model: Mechanism | ReducedModel, q_start: ArrayLike, q_goal: ArrayLike, duration: float) -> None:
        if not isinstance(getattr(model, "mechanism", model), Mechanism):
            raise InvalidInputError(
                f"PointToPoint(model, q_start, q_goal, duration) begins with the model, not {type(model).__name__}"
            )
        self.duration = positive(duration, "duration", "a positive number of seconds")
        self._coordinates = coordinates_of(model)
        self._q_start, self._q_goal = (np.array(checked_q(self._coordinates, q)) for q in (q_start, q_goal))
        self._line = self._coordinates.difference(self._q_start, self._q_goal)

    def at(self, t: float) -> ReferenceState:
        """q_d, q̇_d and q̈_d at time t."""
        x = min(max(t / self.duration, 0.0), 1.0)
        y = 1.0 - x
        q = self._q_goal.copy()
        if x < 1.0:
            q = self._coordinates.integrate(self._q_start, x**3 * (10.0 - 15.0 * x + 6.0 * x * x) * self._line)
        rate, acceleration = 30.0 * (x * y) ** 2 / self.duration, 60.0 * x * y * (y - x) / self.duration**2
        return ReferenceState(q, rate * self._line, acceleration * self._line)

    def as_polynomial(self) -> PiecewisePolynomial:
        """q₀ ⊕ s(t/T) Δ, one piece of degree 5."""
        powers = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0]) / self.duration ** np.arange(5, -1, -1)
        coefficients = powers[None, :, None] * self._line
        return PiecewisePolynomial(self._q_start, np.array([0.0, self.duration]), coefficients)

    def next_switch(self, t: float) -> float:
        """The start, then the end."""
        return 0.0 if t < 0.0 else self.duration if t < self.duration else np.inf


class Hold(Reference):
    """A set point as a reference: q_d constant.

    Args:
        model: A mechanism or model.
        q: The set point, of shape (model.nq,).
    """

    def __init__(self, model: Mechanism | ReducedModel, q: ArrayLike) -> None:
        self.duration = 0.0
        coordinates = coordinates_of(model)
        rest = np.zeros(coordinates.n)
        self._state = ReferenceState(frozen(checked_q(coordinates, q)), frozen(rest), frozen(rest))

    def at(self, t: float) -> ReferenceState:
        """q_d, zero and zero."""
        return self._state

    def as_polynomial(self) -> PiecewisePolynomial:
        """No piece at all."""
        return PiecewisePolynomial(self._state.q, np.empty(0), np.empty((0, 1, len(self._state.v))))

    def next_switch(self, t: float) -> float:
        """Never."""
        return np.inf


class Waypoints(Reference):
    """Through waypoints at given times, by an interpolating spline that starts and ends at rest.

    Degree 5 (four times continuously differentiable) also starts and ends with zero acceleration; degree 3 (twice)
    swings out less, and its acceleration jumps at the two ends. A continuous joint takes the shorter way from each
    waypoint to the next.

    Args:
        model: A mechanism or model.
        times: Increasing times from 0, seconds, of shape (k,) with k ≥ 2.
        waypoints: One q a row, of shape (k, model.nq).
        degree: 3 or 5.

    Raises:
        InvalidInputError: Bad times, shapes or degree.
        UnsupportedMechanismError: A spherical, planar or floating joint is independent as a whole.
    """

    def __init__(
        self, model: Mechanism | ReducedModel, times: ArrayLike, waypoints: ArrayLike, degree: int = 5
    ) -> None:
        coordinates = coordinates_of(model)
        require_commuting(coordinates, "a spline through waypoints")
        stamps = _increasing(times)
        rows = [checked_q(coordinates, q) for q in matrix_rows(waypoints, "waypoints", coordinates.nq)]
        if len(rows) != len(stamps):
            raise InvalidInputError(f"there are {len(stamps)} times and {len(rows)} waypoints")
        if whole(degree, "degree") not in (3, 5):
            raise InvalidInputError(f"degree = {degree} must be 3 or 5")
        self.duration = float(stamps[-1])
        self._coordinates, self._q_start, self._q_goal = coordinates, rows[0], rows[-1]
        steps = [coordinates.difference(a, b) for a, b in itertools.pairwise(rows)]
        way = np.vstack([np.zeros(coordinates.n), np.cumsum(steps, axis=0)])
        spline = from_rest_to_rest(stamps, way, degree)
        self._spline, self._rate, self._second = spline, spline.derivative(), spline.derivative(2)

    def at(self, t: float) -> ReferenceState:
        """q_d, q̇_d and q̈_d at time t."""
        zero = np.zeros(len(self._spline.c[0]))
        if t >= self.duration:
            return ReferenceState(self._q_goal.copy(), zero, zero)
        if t < 0.0:
            return ReferenceState(self._q_start.copy(), zero, zero)
        q = self._coordinates.integrate(self._q_start, np.asarray(self._spline(t)))
        return ReferenceState(q, np.asarray(self._rate(t)), np.asarray(self._second(t)))

    def as_polynomial(self) -> PiecewisePolynomial:
        """The spline's pieces, by their derivatives at the breaks."""
        degree, breaks = self._spline.k, np.unique(self._spline.t)
        orders = range(degree, -1, -1)
        parts = [self._spline.derivative(order)(breaks[:-1]) / math.factorial(order) for order in orders]
        return PiecewisePolynomial(self._q_start, breaks, np.stack(parts, axis=1))

    def next_switch(self, t: float) -> float:
        """The next knot of the spline."""
        k = int(np.searchsorted(self._spline.t, t, side="right"))
        return float(self._spline.t[k]) if k < len(self._spline.t) else np.inf


def from_rest_to_rest(times: Array, way: Array, degree: int = 5) -> BSpline:
    """The interpolating spline of degree 3 or 5 whose velocity (of degree 5, acceleration too) is zero at both ends."""
    rest = [(order, np.zeros(way.shape[1])) for order in ((1,) if degree == 3 else (1, 2))]
    return make_interp_spline(times, way, k=degree, bc_type=(rest, rest))


def through_points(
    end_effector: EndEffector, times: ArrayLike, targets: Sequence[ArrayLike], *, degree: int = 5, near: Near = None
) -> Waypoints:
    """A spline in q through positions or poses of the end effector, each reached from the one before it.

    Between the targets the end effector follows the spline's image, not a straight line: give more targets where
    its path matters.

    Args:
        end_effector: The point to move.
        times: Increasing times from 0, seconds, of shape (k,).
        targets: k positions (3,) or poses (4, 4) in the world.
        degree: 3 or 5, as for `Waypoints`.
        near: A State or configuration q′ that chooses the assembly mode; default the mechanism's reference.

    Raises:
        UnreachableTargetError: A target is out of reach.
        InvalidInputError, UnsupportedMechanismError: As for `Waypoints`.
    """
    instance(end_effector, "end_effector", EndEffector)
    rows = list[Array]()
    for target in instance(targets, "targets", Iterable, "positions or poses"):
        solution = end_effector.solve(target, near)
        near = solution.q_free
        rows.append(solution.q)
    return Waypoints(end_effector.model, times, np.array(rows), degree)


def require_commuting(coordinates: IndependentCoordinates, purpose: str) -> None:
    """Check that every coordinate is a plain number or an angle on a circle.

    Raises:
        UnsupportedMechanismError: A joint with rotations in space or motions in a plane is independent as a whole.
    """
    for part in coordinates.parts:
        if part.whole is not None and part.kind.nv > 1:
            raise UnsupportedMechanismError(
                f"{purpose} needs plain coordinates; the independent {part.kind.name} joint '{part.name}' has none: "
                f"name its components ('{part.name}:rx', …) as independent instead"
            )


def _increasing(times: ArrayLike) -> Array:
    stamps = numbers(times, "times")
    if stamps.ndim != 1 or len(stamps) < 2 or not np.isfinite(stamps).all():
        raise InvalidInputError("times must be at least two finite numbers")
    if stamps[0] != 0.0 or np.any(np.diff(stamps) <= 0):
        raise InvalidInputError(f"times must begin at 0 and increase; they are {np.array2string(stamps)}")
    return stamps
