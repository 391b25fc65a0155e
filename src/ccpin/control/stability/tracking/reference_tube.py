"""A reference cut into cells of time, and the tube about it in which σ is proved on each.

Cell k holds the states of the times T_k = [t_k, t_{k+1}] whose errors are small, |e_i| ≤ E_i and |ė_i| ≤ Ė_i:

    q = q_d(t) − e,        q̇ = q̇_d(t) − ė,        t ∈ T_k,

the last one those of all times at which the reference has come to rest; a reference that begins late has a cell of rest
before it. That σ is one along them is Lemma T of `ccpin/proof/theorems/tracking.md`: σ is proved on each cell by a box
of Theorem K (`ccpin.proof.newton`) with the parameters (s, e), and glued at its middle to the σ that `certify_path`
continued along q_d from the law's start.

How far q_d and q̇_d jump at most at each t_k is bounded from the polynomials of both sides, rounding included (`kicks`).
Inside a piece nothing jumps. As the reference rests before its first break, one that begins with a speed jumps there.

As affine forms the parameters s, e and ė are common to q, q̇ and whatever a law computes of them.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PPoly

from ccpin.arrays import Array, Mask
from ccpin.control.references import Reference
from ccpin.control.stability.tracking.masses import Masses, masses_of
from ccpin.control.tracking import TrackingLaw
from ccpin.covering.proposals.krawczyk import certify_boxes
from ccpin.covering.proposals.solving import glued
from ccpin.domain.paths.path import CertifiedPath, certify_path
from ccpin.domain.paths.pieces import Chord, chords_of, pieces_of, points_of
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.proof.balls import Affine
from ccpin.proof.equations import Problem
from ccpin.proof.newton import Boxes, solve_in_boxes
from ccpin.proof.rounding import SLACK

_REST = 1.0  # s, of the rest after the reference's end
_WIDEN = 1e-13  # relative: covers the rounding of half widths and centres
_SAME = 1e-9  # relative: what tells two motions from one motion's rounding


class CellForms(NamedTuple):
    """Cells as affine forms of (s, e, ė).

    Attributes:
        theta: θ at σ(q), of shape (K, n′).
        e, e_dot: Of shape (K, n).
        v, v_d, a_d: q̇, q̇_d and q̈_d, of shape (K, n).
    """

    theta: Affine
    e: Affine
    e_dot: Affine
    v: Affine
    v_d: Affine
    a_d: Affine

    def chunk(self, rows: slice) -> CellForms:
        """Some of the cells."""
        return CellForms(*(form[rows] for form in self))

    def middles(self) -> CellForms:
        """The cells' middles alone, as if they were exact: what plans are made from."""
        return CellForms(*(Affine(form.mid, form.lin[:0], 0.0 * form.rad) for form in self))


class ReferenceTube(NamedTuple):
    """A reference's cells.

    Attributes:
        problem: The closures. masses: The masses.
        path: What was proved of the reference itself.
        times: From 0, of shape (K + 1,); the last cell, of rest, has no end but counts as one second.
        kicks: How far (q_d, q̇_d) jumps at the beginning of each cell at most, of shape (K, 2n).
        motion: Chords of q_d, q̇_d and q̈_d over the cells, of shapes (K, n).
        centre: σ in the middle of each chord, of shape (K, n′).
        at: The path's boxes that hold these, and where in them: (boxes, δ).
    """

    problem: Problem
    masses: Masses
    path: CertifiedPath
    times: Array
    kicks: Array
    motion: tuple[Chord, Chord, Chord]
    centre: Array
    at: tuple[Boxes, Array]

    def states(self, room: Array, speed_room: Array) -> tuple[CellForms, Mask]:
        """The cells with |e| ≤ `room`, |ė| ≤ `speed_room` (K, n), and on which of them σ is proved, of shape (K,)."""
        system, chord = self.problem.system, self.motion[0]
        count, n = room.shape
        directions = np.concatenate(
            [0.5 * (chord.end - chord.start)[:, :, None], np.tile(np.eye(n), (count, 1, 1))], axis=2
        )
        half = np.concatenate([np.ones((count, 1)), (room + chord.deviation) * (1.0 + _WIDEN)], axis=1)
        tried = certify_boxes(self.problem, self.centre, half, directions)
        proved, boxes = tried.proved.copy(), tried.boxes
        rows = np.flatnonzero(proved)
        if rows.size:
            inside, delta = self.at
            middle = np.zeros((len(rows), 1 + n))
            proved[rows] = glued(self.problem, inside.take(rows), delta[rows], boxes.take(rows), middle)
        lin = np.zeros((1 + 2 * n, count, system.n_free))
        lin[0], across = boxes.directions[:, :, 0], boxes.directions[:, :, 1:]  # along the chord, and off it
        lin[1 : n + 1] = np.moveaxis(-across * room[:, None], 2, 0)
        rad = np.einsum("kpi,ki->kp", np.abs(across), chord.deviation) + _WIDEN * (1.0 + np.abs(self.centre))
        rad[:, system.dependent] += np.einsum("kij,kj->ki", np.abs(boxes.modes), boxes.radius)
        e, e_dot = _errors(room, 1), _errors(speed_room, 1 + n)
        v_d, a_d = _chord_form(self.motion[1], 1 + 2 * n), _chord_form(self.motion[2], 1 + 2 * n)
        theta = Affine(self.centre, lin, rad * (1.0 + _WIDEN), 1 + 2 * n)
        return CellForms(theta, e, e_dot, v_d - e_dot, v_d, a_d), proved


def tube_of(law: TrackingLaw, cells: int) -> ReferenceTube:
    """Cut a law's reference into cells, and prove σ along it as far as that goes (`Tube.path` says how far).

    Raises:
        UnsupportedMechanismError: The reference is no piecewise polynomial, or the closures cannot be certified.
        InvalidInputError: Its polynomials are malformed, begin before t = 0, jump, or are not the motion that it tells.
    """
    pieces, rests = _pieces(law.reference)
    times = _cut(pieces.x, rests, cells)
    first = chords_of(pieces, times)
    path = certify_path(law.model.mechanism, pieces, first.deviation.max(axis=0), law.near.q_free)
    masses = masses_of(law.model.mechanism, path.reading, law.model.gravity_vector)
    chords = first, chords_of(pieces.derivative(1), times), chords_of(pieces.derivative(2), times)
    middle = 0.5 * (times[1:] + times[:-1])
    _check_told(law.reference, pieces, middle)
    kicks = _kicks(chords, np.isin(times[:-1], pieces.x))
    if path.verdict != "proven":
        return ReferenceTube(
            path.problem, masses, path, times, kicks, chords, np.zeros((0, 0)), (path.boxes, np.zeros((0, 0)))
        )
    number = np.clip(np.searchsorted(path.times, middle, side="right") - 1, 0, len(path.boxes.kappa) - 1)
    boxes, system = path.boxes.take(number), path.problem.system
    start, end = path.times[number], path.times[number + 1]
    s = 2.0 * (middle - start) / (end - start) - 1.0
    q = 0.5 * (first.start + first.end)
    across = q - boxes.centre[:, system.independent] - s[:, None] * boxes.directions[:, system.independent, 0]
    delta = np.concatenate([s[:, None], across], axis=1)
    centre = solve_in_boxes(path.problem, boxes, delta).theta
    centre[:, system.independent] = q
    return ReferenceTube(path.problem, masses, path, times, kicks, chords, centre, (boxes, delta))


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


def _kicks(motion: tuple[Chord, Chord, Chord], at_knots: Mask) -> Array:
    """How far (q_d, q̇_d) jumps at most at the beginning of each cell, from rest at q_d(0), of shape (K, 2n)."""
    kicks = []
    for chord in motion[:2]:
        jump = np.abs(chord.start) + chord.rounding[:, 0]
        jump[1:] = np.abs(chord.start[1:] - chord.end[:-1]) + chord.rounding[1:, 0] + chord.rounding[:-1, 1]
        kicks.append(jump * SLACK)
    kicks[0][0] = 0.0
    return np.asarray(np.where(at_knots[:, None], np.concatenate(kicks, axis=1), 0.0))


def _errors(room: Array, first: int) -> Affine:
    """The parameters `first`, … times their sizes (K, n), of 1 + 2n in all."""
    count, n = room.shape
    lin = np.zeros((1 + 2 * n, count, n))
    lin[first + np.arange(n), :, np.arange(n)] = room.T
    return Affine(np.zeros((count, n)), lin, np.zeros((count, n)), 1 + 2 * n)


def _chord_form(chord: Chord, parameters: int) -> Affine:
    """A chord as a form of s."""
    lin = np.zeros((parameters, *chord.start.shape))
    lin[0] = 0.5 * (chord.end - chord.start)
    mid = 0.5 * (chord.start + chord.end)
    return Affine(mid, lin, chord.deviation + _WIDEN * (1.0 + np.abs(mid)), parameters)
