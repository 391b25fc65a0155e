"""Certified paths: σ stays on its branch along a tube about a path, or where that cannot be proved and why.

A stretch of the path between two parameters is covered by one box of Theorem K (`boxes`) with p = 1 + n parameters,

    q = q_c + s d + w,  |s| ≤ 1,  |w| ≤ tube + deviation of the path from its chord,

d half the chord. Consecutive boxes contain the tube's cross section at their common parameter, a connected set, and
are glued at its middle; the first is glued to the closed configuration at the start. So along the tube σ continues from
the start in one way only, meets no singularity and is smooth. Should the path cross itself the tube is to
be thought of as not meeting itself there: σ may be different the second time round.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import reduce
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BPoly, BSpline, PPoly

from ccpin.arrays import Array, joined, numbers
from ccpin.domain.boxes import BoundsName, Boxes, Problem, certify_boxes, certify_points, closure_values, problem_of
from ccpin.domain.chains import seed_at_coordinates
from ccpin.domain.newton import encloses, extrapolate, glued, newton, solve_in_boxes
from ccpin.errors import InvalidInputError, SingularConfigurationError
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of

_TRIES = np.array([4.0, 2.0, 1.0, 0.5, 0.25])
_SHORTEST = 1e-7
_NEWTON = 12


@dataclass(frozen=True, eq=False)
class CertifiedPath:
    """What was proved of a path.

    Attributes:
        complete: Whether the whole path is certified.
        reached: The parameter up to which it is.
        reason: Why it ends there; empty where complete.
        rcond: Reciprocal condition number of φ_y at `reached`.
        times: Parameters between the boxes, of shape (B + 1,).
        tube: Half widths of the tube, of shape (n,).
        boxes: The boxes, in order.
        pieces: The path, a polynomial between two knots.
        problem: The closures.
    """

    complete: bool
    reached: float
    reason: str
    rcond: float
    times: Array
    tube: Array
    boxes: Boxes
    pieces: PPoly
    problem: Problem

    def sigma(self, t: ArrayLike) -> Array:
        """q′ = σ(q(t)) along the certified part: (nq,) for a number, (K, nq) for an array (K,).

        Raises:
            InvalidInputError: A parameter lies outside of the certified part.
        """
        at = np.atleast_1d(numbers(t, "t"))
        if not np.all((at >= self.times[0]) & (at <= self.reached)) or not len(self.boxes.kappa):
            raise InvalidInputError(
                f"the path is certified for parameters from {self.times[0]:.9g} to {self.reached:.9g}"
            )
        number = np.clip(np.searchsorted(self.times, at, side="right") - 1, 0, len(self.boxes.kappa) - 1)
        boxes, system = self.boxes.take(number), self.problem.system
        q = self.pieces(at)
        start, end = self.times[number], self.times[number + 1]
        s = 2.0 * (at - start) / (end - start) - 1.0
        along = boxes.directions[:, system.independent, 0]
        across = q - boxes.centre[:, system.independent] - s[:, None] * along
        delta = np.concatenate([s[:, None], across], axis=1)
        theta = newton(self.problem, solve_in_boxes(self.problem, boxes, delta).theta, 1).theta
        q_free = system.chart.configuration(theta)
        return np.asarray(q_free[0] if np.ndim(t) == 0 else q_free)


def certify_path(
    mechanism: Mechanism | HasMechanism,
    path: ArrayLike | PPoly | BSpline,
    tube: ArrayLike = 1e-3,
    guess: Array | None = None,
    *,
    bounds: BoundsName = "auto",
) -> CertifiedPath:
    """Prove that σ stays on its branch along a tube about a path.

    Args:
        mechanism: A mechanism (or its model) with scalar independent coordinates, any number of them.
        path: Waypoints of shape (K, n), parameter 0 … K − 1, or a SciPy `PPoly` (`CubicSpline` …) or `BSpline` with
            values of shape (n,); rad and m.
        tube: Half width of the tube in each coordinate: a number or shape (n,).
        guess: A closed configuration on the branch wanted near the path's start, of shape (nq,); default the
            reference.
        bounds: ``"auto"``, ``"reach"`` or ``"planar"``.

    Returns:
        The proof, or where it ends and why.

    Raises:
        InvalidInputError: Path or tube is malformed.
        UnreachableError, SingularConfigurationError: σ at the path's start does not exist, or is singular.
        UnsupportedMechanismError: The closures are of a kind that cannot be certified.
    """
    mechanism = mechanism_of(mechanism)
    pieces = pieces_of(path, mechanism.n)
    try:
        widths = np.broadcast_to(numbers(tube, "tube"), (mechanism.n,)).copy()
    except ValueError:
        widths = np.array([np.nan])
    if not (np.all(np.isfinite(widths)) and np.all(widths >= 0.0)):
        raise InvalidInputError(f"tube must be a nonnegative number or {mechanism.n} of them; it is {tube!r}")
    seed = seed_at_coordinates(mechanism, pieces(pieces.x[0]), guess)
    return _Walker(problem_of(seed.system, bounds), pieces, widths, seed.theta).walk()


class _Stretch(NamedTuple):
    """A box tried from the walker's place, and the parameter it leads to."""

    box: Boxes
    end: float


class _Walker:
    def __init__(self, problem: Problem, pieces: PPoly, tube: Array, theta: Array) -> None:
        self.problem, self.pieces, self.tube, self.theta = problem, pieces, tube, theta
        self.boxes: list[Boxes] = []
        self.times = [float(pieces.x[0])]
        point = certify_points(problem, theta[None])
        if not point.proved[0]:
            raise SingularConfigurationError(
                "the path starts too close to a singular configuration", q_free=theta, rcond=self.rcond()
            )
        self.point = point.boxes

    def walk(self) -> CertifiedPath:
        """Step after step, each as long as can be proved, until the end or until no step can."""
        knots = self.pieces.x
        span = float(knots[-1] - knots[0])
        stride, reason = 0.25 * float(knots[1] - knots[0]), ""
        for knot in knots[1:]:
            while self.times[-1] < knot:
                step = self.step(knot, stride * _TRIES, self.tube)
                if step is not None:
                    stride = max(step.end - self.times[-1], 0.5 * stride)
                    self.accept(step)
                elif stride > _SHORTEST * span:
                    stride *= 0.125
                else:
                    reason = self.explain(knot, stride)
                    break
            if reason:
                break
        return self.result(reason)

    def step(self, knot: float, strides: Array, tube: Array) -> _Stretch | None:
        """The longest stretch from here, to the next knot at most, that can be proved and glued to what came before."""
        system, here = self.problem.system, self.times[-1]
        ends = np.unique(np.minimum(here + strides, knot))
        ends = ends[ends > here]
        if not ends.size:
            return None
        chords = [chord_of(self.pieces, here, end) for end in ends]
        centre = np.array([0.5 * (chord.start + chord.end) for chord in chords])
        across = np.array([np.column_stack([0.5 * (chord.end - chord.start), np.eye(system.n)]) for chord in chords])
        half = np.array([np.concatenate([[1.0], tube + chord.deviation]) for chord in chords])
        with np.errstate(all="ignore"):
            found = newton(
                self.problem, extrapolate(self.problem, self.theta, centre - self.theta[system.independent]), _NEWTON
            )
        attempt = certify_boxes(self.problem, found.theta, half, across)
        proved = np.flatnonzero(attempt.proved & found.settled)
        for k in proved[::-1]:
            box = attempt.boxes.take(np.array([k]))
            if self.continues(box, chords[k]):
                return _Stretch(box, float(ends[k]))
        return None

    def continues(self, box: Boxes, chord: Chord) -> bool:
        """Whether a box carries the solution of the last one (or of the start) at their common parameter."""
        offset = chord.start - (box.centre[0] - box.directions[0, :, 0])[self.problem.system.independent]
        delta = np.append(-1.0, offset)[None]
        if not self.boxes:
            ball = self.point.centre, self.point.radius, self.point.modes
            return bool(encloses(self.problem, box, delta, *ball)[0])
        return bool(glued(self.problem, self.boxes[-1], np.eye(1, delta.size), box, delta)[0])

    def accept(self, step: _Stretch) -> None:
        """Go to the end of a proved stretch."""
        self.boxes.append(step.box)
        self.times.append(step.end)
        self.theta = solve_in_boxes(self.problem, step.box, np.eye(1, 1 + len(self.tube))).theta[0]

    def explain(self, knot: float, stride: float) -> str:
        """Why no step is possible here."""
        place = f"at parameter {self.times[-1]:.9g}, q = {self.theta[self.problem.system.independent].tolist()}"
        narrow = self.step(knot, stride * _TRIES, np.zeros_like(self.tube))
        condition = f"the reciprocal condition number of φ_y is {self.rcond():.1e}"
        if narrow is not None:
            return (
                f"a tube of half width {self.tube.max():.3g} meets a singularity (or is too wide) {place}: {condition}"
            )
        return f"the path runs into a singularity or the end of the workspace {place}: {condition}"

    def rcond(self) -> float:
        """Reciprocal condition number (2-norm) of φ_y here."""
        jacobian = closure_values(self.problem, self.theta[None])[1][0][:, self.problem.system.dependent]
        singular = np.linalg.svd(jacobian, compute_uv=False)
        return float(singular[-1] / singular[0])

    def result(self, reason: str) -> CertifiedPath:
        """What was proved."""
        return CertifiedPath(
            complete=not reason,
            reached=self.times[-1],
            reason=reason,
            rcond=self.rcond(),
            times=np.array(self.times),
            tube=self.tube,
            boxes=joined([self.point.without_rows(1 + self.problem.system.n), *self.boxes]),
            pieces=self.pieces,
            problem=self.problem,
        )


# Paths in q-space as polynomial pieces, with bounds of how far a piece strays from its chord.

_CONTINUOUS = 1e-9


class Chord(NamedTuple):
    """A stretch of one piece: end points (n,), and how far it strays from the straight line between them, (n,)."""

    start: Array
    end: Array
    deviation: Array


def pieces_of(path: ArrayLike | PPoly | BSpline, n: int) -> PPoly:
    """Read a polyline (waypoints of shape (K, n), parameter 0 … K − 1) or a SciPy spline with values of shape (n,).

    Raises:
        InvalidInputError: It has the wrong shape, is not finite, or jumps.
    """
    if isinstance(path, BSpline):
        path = _polynomials(path, path.k, np.unique(path.t[path.k : len(path.t) - path.k]))
    if isinstance(path, PPoly):
        knots, coefficients = np.asarray(path.x, dtype=np.float64), np.asarray(path.c, dtype=np.float64)
        if coefficients.ndim != 3 or coefficients.shape[2] != n:
            raise InvalidInputError(f"the spline's values must have shape ({n},); its coefficients have {path.c.shape}")
        long = np.flatnonzero(np.diff(knots) > 0.0)
        knots, coefficients = np.append(knots[long], knots[long[-1] + 1]), coefficients[:, long]
    else:
        points = numbers(path, "path")
        if points.ndim != 2 or points.shape[1] != n or len(points) < 2:
            raise InvalidInputError(f"a path is at least two waypoints of shape (K, {n}); it has shape {points.shape}")
        knots, coefficients = np.arange(len(points), dtype=np.float64), np.stack([np.diff(points, axis=0), points[:-1]])
    if not (np.all(np.isfinite(coefficients)) and np.all(np.isfinite(knots))):
        raise InvalidInputError("the path is not finite")
    ends = reduce(lambda total, c: total * np.diff(knots)[:-1, None] + c, coefficients[:, :-1])
    jumps = np.abs(ends - coefficients[-1, 1:]).max(axis=1, initial=0.0)
    if np.any(jumps > _CONTINUOUS):
        worst = int(np.argmax(jumps))
        raise InvalidInputError(f"the path jumps by {jumps[worst]:.3g} at parameter {knots[worst + 1]:.6g}")
    return PPoly(coefficients, knots)


def _polynomials(spline: BSpline | PPoly, degree: int, knots: Array) -> PPoly:
    """A spline by its Taylor coefficients at each knot, one polynomial between two distinct knots."""
    coefficients = [spline(knots[:-1], nu=k) / math.factorial(k) for k in reversed(range(degree + 1))]
    return PPoly(np.array(coefficients), knots)


def chord_of(pieces: PPoly, start: float, end: float) -> Chord:
    """The stretch from parameter `start` to `end`, both of one piece.

    In Bernstein form the polynomial is a convex combination of its coefficients b_i, and the chord of the
    coefficients of the line, b_0 + (i/d)(b_d − b_0): their largest difference bounds the deviation.
    """
    degree = len(pieces.c) - 1
    bernstein = BPoly.from_power_basis(_polynomials(pieces, degree, np.array([start, end]))).c[:, 0]
    line = np.linspace(bernstein[0], bernstein[-1], degree + 1)
    rounding = 1e-14 * (1.0 + np.abs(bernstein).max(axis=0))
    return Chord(bernstein[0], bernstein[-1], np.abs(bernstein - line).max(axis=0) + rounding)
