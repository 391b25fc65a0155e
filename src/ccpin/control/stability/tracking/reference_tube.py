"""A reference cut into cells of time, and boxes about them in which σ is to be proved.

The last cell is of all times at which the reference has come to rest; a reference that begins late has a cell of rest
before it. What is proposed here the kernel proves: boxes about the cells, glued at their middles to those of
`certify_path` along q_d, and of these what `TubeKept` says.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import PPoly

from ccpin.arrays import Array, Indices, Mask
from ccpin.control.control_law import kind_of
from ccpin.control.references import Reference
from ccpin.control.stability.tracking.cell_forms import WIDEN, TimeCells
from ccpin.control.stability.tracking.error_equations import ERROR_EQUATIONS, Feedback
from ccpin.control.stability.tracking.mass_reading import bodies_on_joints_of
from ccpin.control.stability.tracking.tracking_equations import ReferencePieces, TrackingEquations
from ccpin.control.tracking import TrackingLaw
from ccpin.covering.claims import Seams, proved_boxes, proved_glue
from ccpin.covering.proposals.krawczyk import Tried, certify_boxes
from ccpin.domain.closures.system import Reading
from ccpin.domain.paths.path import CertifiedPath, certify_path
from ccpin.domain.paths.pieces import pieces_of
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.proof.chords import points_of
from ccpin.proof.equations import closures_of
from ccpin.proof.facts import Fact, require
from ccpin.proof.newton import Boxes, solve_in_boxes

_REST = 1.0  # s, of the rest after the reference's end
_SAME = 1e-9  # relative: what tells two motions from one motion's rounding


class ReferenceTube(NamedTuple):
    """A reference's cells.

    Attributes:
        equations: What is claimed of, whose `motion` is the reference's.
        path: What was proved of the reference itself.
        cells: Its cells.
        centre: σ in the middle of each chord, of shape (K, n′).
        at: The path's boxes that hold these, and where in them: numbers (K,), δ (K, 1 + n).
    """

    equations: Any
    path: CertifiedPath
    cells: TimeCells
    centre: Array
    at: tuple[Indices, Array]

    def boxes(self, room: Array) -> Tried:
        """Boxes about the cells with |e| ≤ `room` (K, n), and which of them seem proved."""
        count, n = room.shape
        across = np.tile(np.eye(n), (count, 1, 1))
        directions = np.concatenate([self.cells.place.along[:, :, None], across], axis=2)
        half = np.concatenate([np.ones((count, 1)), (room + self.cells.place.deviation) * (1.0 + WIDEN)], axis=1)
        return certify_boxes(self.path.problem, self.centre, half, directions)

    def proved(self, boxes: Boxes) -> tuple[Fact, ...]:
        """The facts that boxes are proved, all of them, and that they are glued to the path's, as far as they are.

        Raises:
            NotProvedError: A box is not.
        """
        assert self.path.proved is not None
        solutions, kept = proved_boxes(self.path.problem, boxes)
        require(kept, "a cell's box is not proved")
        along, (number, delta) = self.path.proved.premises[0], self.at
        seams = Seams(number, len(along.claim.kappa) + np.arange(len(number)), delta, np.zeros_like(delta))
        return solutions, *proved_glue(self.path.problem, seams, (along, solutions))


def tube_of(law: TrackingLaw, cells: int) -> ReferenceTube:
    """A tracking law's reference cut into cells; errors as for `cut_along`."""
    return cut_along(law, cells, equations_of)


def cut_along(law: Any, cells: int, told_of: Callable[[Any, Reading, ReferencePieces], Any]) -> ReferenceTube:
    """Cut a law's reference into cells, and prove σ along it as far as that goes (`ReferenceTube.path` says how far).

    Args:
        law: The law: its model, its reference, and its configuration `near` q_d(0).
        cells: How many, about.
        told_of: What is claimed of a law over closures that are read off its mechanism.

    Raises:
        UnsupportedMechanismError: The reference is no piecewise polynomial, or the closures cannot be certified.
        InvalidInputError: Its polynomials are malformed, begin before t = 0, jump, or are not the motion that it tells.
    """
    pieces, rests = _pieces(law.reference)
    times = _cut(pieces.x, rests, cells)
    motion = [pieces, pieces.derivative(1), pieces.derivative(2)]
    first = TimeCells.of(motion, times).place
    path = certify_path(law.model.mechanism, pieces, first.deviation.max(axis=0), law.near.q_free)
    equations = told_of(law, path.reading, ReferencePieces(pieces.c, pieces.x))
    own, middle = TimeCells.of(equations.motion, times), 0.5 * (times[1:] + times[:-1])
    _check_told(law.reference, pieces, middle)
    if path.verdict != "proven":
        return ReferenceTube(equations, path, own, np.zeros((0, 0)), (np.zeros(0, dtype=np.int64), np.zeros((0, 0))))
    number = np.clip(np.searchsorted(path.times, middle, side="right") - 1, 0, len(path.boxes.kappa) - 1)
    boxes, system = path.boxes.take(number), path.problem.system
    start, end = path.times[number], path.times[number + 1]
    s, q = 2.0 * (middle - start) / (end - start) - 1.0, own.place.middle
    across = q - boxes.centre[:, system.independent] - s[:, None] * boxes.directions[:, system.independent, 0]
    delta = np.concatenate([s[:, None], across], axis=1)
    centre = solve_in_boxes(path.problem, boxes, delta).theta
    centre[:, system.independent] = q
    return ReferenceTube(equations, path, own, centre, (number, delta))


def reference_of(law: Any) -> ReferencePieces:
    """q_d as a law has it now; errors as for `cut_along`."""
    pieces, _ = _pieces(law.reference)
    return ReferencePieces(pieces.c, pieces.x)


def equations_of(law: TrackingLaw, reading: Reading, reference: ReferencePieces) -> TrackingEquations:
    """What is claimed of a law's error, over closures that are read off its mechanism.

    Raises:
        UnsupportedMechanismError: A joint of several freedoms, no closures, or one that keeps a distance; another law.
    """
    model, theta = law.model, theta_at_start(law, reading)
    free = bodies_on_joints_of(model.mechanism, reading, model.gravity_vector)
    return TrackingEquations(closures_of(reading.problem), free, feedback_of(law), reference, theta)


def theta_at_start(law: Any, reading: Reading) -> Array:
    """θ of q_d(0), with just its own q."""
    theta = reading.theta(law.near.q_free)
    theta[reading.system.independent] = law.near.q
    return theta


def feedback_of(law: TrackingLaw) -> Feedback:
    """A law's feedback.

    Raises:
        UnsupportedMechanismError: The theorem is not about laws of its kind.
    """
    kind = kind_of(law)
    if kind is None or kind not in ERROR_EQUATIONS:
        raise UnsupportedMechanismError(
            f"a {type(law).__name__} does not cancel what it tracks against, so its error is no matter of σ alone: "
            "certify a ComputedTorque or PDPlus law"
        )
    return Feedback(kind, law.K_p, law.K_v)


def _pieces(reference: Reference) -> tuple[PPoly, Mask]:
    """q_d(t) from t = 0, with the rest before it and a second of the rest after it; which of the pieces are rests."""
    polynomial = reference.as_polynomial()
    if polynomial is None:
        raise UnsupportedMechanismError(
            f"a {type(reference).__name__} is no piecewise polynomial, so its cells cannot be enclosed: track a "
            "PointToPoint, Hold or Waypoints reference, or give it as_polynomial()"
        )
    if np.ndim(polynomial.coefficients) != 3 or not np.size(polynomial.coefficients, 1):
        raise InvalidInputError(
            f"a {type(reference).__name__}'s coefficients must have shape (pieces, degree + 1, n); theirs is "
            f"{np.shape(polynomial.coefficients)}"
        )
    coefficients = np.moveaxis(polynomial.coefficients, 1, 0).copy()
    coefficients[-1] += polynomial.start
    knots, n = np.asarray(polynomial.breaks, dtype=np.float64), coefficients.shape[2]
    rest = np.zeros((len(coefficients), 1, n))
    if not len(knots):
        rest[-1] = polynomial.start
        return PPoly(rest, np.array([0.0, _REST])), np.ones(1, dtype=np.bool_)
    if knots.shape != (coefficients.shape[1] + 1,) or not (np.all(np.diff(knots) > 0.0) and knots[0] >= 0.0):
        raise InvalidInputError(
            f"a {type(reference).__name__} of {coefficients.shape[1]} polynomials needs one break more, that increase "
            f"from t ≥ 0; its breaks are {np.array2string(knots, threshold=8)}"
        )
    moving = pieces_of(PPoly(coefficients, knots), n)
    before, after = rest.copy(), rest
    before[-1], after[-1] = moving.c[-1, 0], points_of(moving, knots[-1:])[0]
    late = int(knots[0] > 0.0)
    knots = np.concatenate([np.zeros(late), knots, [knots[-1] + _REST]])
    rests = np.zeros(len(knots) - 1, dtype=np.bool_)
    rests[:late] = rests[-1] = True
    return PPoly(np.concatenate([before[:, :late], moving.c, after], axis=1), knots), rests


def _cut(knots: Array, rests: Mask, cells: int) -> Array:
    """Times between which a piece is cut into equal cells, `cells` of them or a few more in all, and one a rest."""
    moving = float(np.diff(knots)[~rests].sum())
    parts = [
        np.linspace(start, end, 2 if rest else 1 + int(np.ceil(cells * (end - start) / moving)))[:-1]
        for (start, end), rest in zip(pairwise(knots), rests, strict=True)
    ]
    return np.concatenate([*parts, knots[-1:]])


def _check_told(reference: Reference, pieces: PPoly, times: Array) -> None:
    """That `Reference.at`, which the law reads, tells the motion that is certified, at the middle of every cell.

    Raises:
        InvalidInputError: It tells another.
    """
    told = [np.array(values) for values in zip(*(reference.at(float(t)) for t in times), strict=True)]
    for order, (name, values) in enumerate(zip(("q_d", "q̇_d", "q̈_d"), told, strict=True)):
        expected = pieces.derivative(order)(times) if order else pieces(times)
        apart = np.abs(values - expected).max(axis=1)
        if not np.all(apart <= _SAME * (1.0 + np.abs(expected).max())):
            raise InvalidInputError(
                f"a {type(reference).__name__}'s at() and as_polynomial() are two motions: at t = "
                f"{times[np.argmax(apart)]:.6g} s their {name} is {np.max(apart):.3g} apart"
            )
