"""Boxes one behind the other along a path: each proved, and glued to the one before."""

from __future__ import annotations

from copy import copy
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PPoly

from ccpin.arrays import Array, joined
from ccpin.covering.claims import Seams, proved_glue, proved_points
from ccpin.covering.proposals.krawczyk import certify_boxes
from ccpin.covering.proposals.solving import extrapolate, glued, newton
from ccpin.errors import SingularConfigurationError
from ccpin.proof.chords import chord_of
from ccpin.proof.equations import Problem, closure_values, closures_of
from ccpin.proof.facts import Fact, NotProvedError, prove, prove_some
from ccpin.proof.newton import Boxes, encloses, solve_in_boxes
from ccpin.proof.paths import Followed
from ccpin.proof.solutions import Met, SolutionsInBoxes

TRIES = np.array([4.0, 2.0, 1.0, 0.5, 0.25])  # of the last stride
SHORTEST = 1e-7  # of the path: a stride that ends the walk
_NEWTON = 12  # steps
_WIDER = 1.0 + 1e-10  # for rounding


class Stretch(NamedTuple):
    """A box tried from the walker's place, and the parameter it leads to."""

    box: Boxes
    end: float


class Walker:
    """Follows σ along a path, as far as that can be proved.

    Args:
        problem: The closures.
        pieces: The path.
        tube: Half widths of the tube, of shape (n,).
        theta: The closed configuration at its start, of shape (n′,).

    Attributes:
        times: The parameters between the boxes.
        theta: σ at the last of them.
        tried: How many boxes were tried.
        start: The fact that there is one solution in a point's box at the start, `point`.

    Raises:
        SingularConfigurationError: The start cannot be enclosed.
    """

    def __init__(self, problem: Problem, pieces: PPoly, tube: Array, theta: Array) -> None:
        self.problem, self.pieces, self.tube, self.theta = problem, pieces, tube, theta
        self.times = [float(pieces.x[0])]
        self.tried = 0
        self._boxes: list[Boxes] = []
        self.start, near = proved_points(problem, theta[None])
        if not near.size:
            raise SingularConfigurationError(
                "the path starts too close to a singular configuration", q_free=theta, rcond=self.rcond()
            )
        self.point: Boxes = self.start.claim.boxes

    @property
    def boxes(self) -> Boxes:
        """The boxes proved, in order."""
        return joined([self.point.without_rows(1 + self.problem.system.n), *self._boxes])

    @property
    def here(self) -> float:
        """The parameter reached."""
        return self.times[-1]

    def walk(self, stride: float | None = None) -> float | None:
        """Step after step, each as long as can be proved, from a first stride; the knot not reached, if any."""
        knots = self.pieces.x
        span = float(knots[-1] - knots[0])
        stride = 0.25 * float(knots[1] - knots[0]) if stride is None else 0.25 * stride
        for knot in knots[1:]:
            while self.here < knot:
                step = self.step(knot, stride * TRIES, self.tube)
                if step is not None:
                    stride = max(step.end - self.here, 0.5 * stride)
                    self._accept(step)
                elif stride > SHORTEST * span:
                    stride *= 0.125
                else:
                    return float(knot)
        return None

    def back(self, steps: int) -> Walker:
        """A walker that has yet to go the last of its steps."""
        left = len(self._boxes) - steps
        other = copy(self)
        other._boxes, other.times = self._boxes[:left], self.times[: left + 1]
        other.theta = other._end(other._boxes[-1]) if left else self.point.centre[0].copy()
        return other

    def step(self, knot: float, strides: Array, tube: Array) -> Stretch | None:
        """The longest stretch from here, to the next knot at most, that can be proved and glued to what came before."""
        system, here = self.problem.system, self.here
        ends = np.unique(np.minimum(here + strides, knot))
        ends = ends[ends > here]
        if not ends.size:
            return None
        self.tried += len(ends)
        chords = [chord_of(self.pieces, here, end) for end in ends]
        seam = np.abs(chords[0].start - self._seam()) * _WIDER  # of rounding, or the path's own jump at a knot
        centre = np.array([0.5 * (chord.start + chord.end) for chord in chords])
        across = np.array([np.column_stack([0.5 * (chord.end - chord.start), np.eye(system.n)]) for chord in chords])
        half = np.array([np.concatenate([[1.0], tube + chord.deviation + seam]) for chord in chords])
        with np.errstate(all="ignore"):
            found = newton(
                self.problem, extrapolate(self.problem, self.theta, centre - self.theta[system.independent]), _NEWTON
            )
        attempt = certify_boxes(self.problem, found.theta, half, across)
        proved = np.flatnonzero(attempt.proved & found.settled)
        for k in proved[::-1]:
            box = attempt.boxes.take(np.array([k]))
            if self._continues(box):
                return Stretch(box, float(ends[k]))
        return None

    def carries(self, box: Boxes, delta: Array) -> bool:
        """Whether a box carries, at its parameters δ (1, p), the solution here."""
        if not self._boxes:
            ball = self.point.centre, self.point.radius, self.point.modes
            return bool(encloses(self.problem, box, delta, *ball)[0])
        last = self._boxes[-1]
        return bool(glued(self.problem, last, np.eye(1, last.half.shape[1]), box, delta)[0])

    def proved(self) -> Fact | None:
        """The fact that the boxes follow σ along the tube from where the walk began to here."""
        boxes, problem = self.boxes, self.problem
        count, n, equations = len(boxes.kappa), problem.system.n, closures_of(problem)
        if not count:
            return None
        q, along = boxes.centre[:, problem.system.independent], boxes.directions[:, problem.system.independent, 0]
        before = np.concatenate([self.point.centre[:, problem.system.independent], (q + along)[:-1]])
        ends, begins = np.tile(np.eye(1, 1 + n), (count, 1)), np.column_stack([-np.ones(count), before - (q - along)])
        number = np.arange(count)
        try:
            solutions = prove(SolutionsInBoxes(equations, *boxes))
            first = number[:1], number[:1], begins[:1], begins[:1], number[:1]
            start = prove(Met(equations, *first), self.start, solutions)
            glue = proved_glue(problem, Seams(number[:-1], number[1:], ends[:-1], begins[1:]), (solutions,))
            path = self.pieces.c, self.pieces.x, np.array(self.times), self.tube
            return prove(Followed(equations, *path), solutions, start, *glue)
        except NotProvedError:
            return None

    def point_here(self) -> Fact | None:
        """The fact that there is one solution in a point's box about σ here."""
        if not self._boxes:
            return self.start
        point, near = proved_points(self.problem, self.theta[None])
        return point if near.size else None

    def leads_to(self, point: Fact) -> bool:
        """Whether that is proved to be the one to which σ was followed from the start."""
        path, last, number = self.proved(), np.array([len(self._boxes) - 1]), np.zeros(1, dtype=np.int64)
        if path is None:
            return point is self.start
        ends = np.eye(1, 1 + self.problem.system.n)
        met = Met(closures_of(self.problem), last, last, ends, ends, number)
        return bool(prove_some(met, point, path.premises[0])[1][0])

    def rcond(self) -> float:
        """Reciprocal condition number (2-norm) of φ_y here."""
        jacobian = closure_values(self.problem, self.theta[None])[1][0][:, self.problem.system.dependent]
        singular = np.linalg.svd(jacobian, compute_uv=False)
        return float(singular[-1] / singular[0])

    def _seam(self) -> Array:
        """q where what is proved ends, as the last box (or the start) has it, of shape (n,)."""
        independent = self.problem.system.independent
        if not self._boxes:
            return np.asarray(self.point.centre[0, independent])
        last = self._boxes[-1]
        return np.asarray((last.centre[0] + last.directions[0, :, 0])[independent])

    def _continues(self, box: Boxes) -> bool:
        """Whether a box carries the solution of the last one (or of the start) at the place where that ends.

        Both cross-sections at the common parameter are convex and hold this place, so they carry one solution on all
        that they have in common.
        """
        offset = self._seam() - (box.centre[0] - box.directions[0, :, 0])[self.problem.system.independent]
        inside = bool(np.all(np.abs(offset) <= box.half[0, 1:]))
        return inside and self.carries(box, np.append(-1.0, offset)[None])

    def _accept(self, step: Stretch) -> None:
        """Go to the end of a proved stretch."""
        self._boxes.append(step.box)
        self.times.append(step.end)
        self.theta = self._end(step.box)

    def _end(self, box: Boxes) -> Array:
        """σ at the end of a stretch."""
        return np.asarray(solve_in_boxes(self.problem, box, np.eye(1, 1 + len(self.tube))).theta[0])
