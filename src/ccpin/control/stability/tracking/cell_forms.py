"""Cells of a reference's motion as affine forms.

Cell k holds the states of the times T_k = [t_k, t_{k+1}] whose errors are small, |e_i| ≤ E_i and |ė_i| ≤ Ė_i:

    q = q_d(t) − e,        q̇ = q̇_d(t) − ė,        t ∈ T_k.

As affine forms the parameters s, e and ė are common to q, q̇ and whatever a law computes of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Mask
from ccpin.proof.balls import Affine
from ccpin.proof.chains import ClosureSystem
from ccpin.proof.chords import Chord, Polynomials, chords_of
from ccpin.proof.newton import Boxes
from ccpin.proof.rounding import SLACK

WIDEN = 1e-13  # relative: covers the rounding of half widths and centres


class TimeCells(NamedTuple):
    """A reference cut into K cells of time.

    Attributes:
        times: From 0, of shape (K + 1,); the last cell has no end but counts as what it has of the last piece.
        place, speed, acceleration: Chords of q_d, q̇_d and q̈_d over the cells, of shapes (K, n).
        kicks: How far (q_d, q̇_d) jumps at the beginning of each cell at most, of shape (K, 2n), from rest at q_d(0).
    """

    times: Array
    place: Chord
    speed: Chord
    acceleration: Chord
    kicks: Array

    @classmethod
    def of(cls, motion: Sequence[Polynomials], times: Array) -> TimeCells:
        """Those of q_d, q̇_d and q̈_d between times, no two of which lie across a knot."""
        place, speed, acceleration = (chords_of(pieces, times) for pieces in motion)
        return cls(times, place, speed, acceleration, _kicks(place, speed, np.isin(times[:-1], motion[0].x)))


def _kicks(place: Chord, speed: Chord, at_knots: Mask) -> Array:
    """How far (q_d, q̇_d) jumps at knots: from what is known of both sides."""
    kicks = []
    for chord in (place, speed):
        jump = np.abs(chord.start) + chord.rounding[:, 0]
        jump[1:] = np.abs(chord.start[1:] - chord.end[:-1]) + chord.rounding[1:, 0] + chord.rounding[:-1, 1]
        kicks.append(jump * SLACK)
    kicks[0][0] = 0.0
    return np.asarray(np.where(at_knots[:, None], np.concatenate(kicks, axis=1), 0.0))


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

    def thickened(self, system: ClosureSystem, sigma_error: float) -> CellForms:
        """The same cells with θ + δ: δ, in the dependent coordinates, adds its m entries to the parameters."""
        wider = []
        for form in self:
            lin = np.concatenate([form.lin, np.zeros((system.m, *form.mid.shape))])
            wider.append(Affine(form.mid, lin, form.rad, form.boxed))
        wider[0].lin[-system.m + np.arange(system.m), :, system.dependent] = sigma_error
        return CellForms(*wider)


def forms_of(system: ClosureSystem, boxes: Boxes, cells: TimeCells, room: Array) -> CellForms:
    """Cells with |e| ≤ E and |ė| ≤ Ė, `room` (K, 2n), in boxes with the parameters (s, w) about their chords."""
    n = system.n
    lin = np.zeros((1 + 2 * n, len(room), system.n_free))
    lin[0], across = boxes.directions[:, :, 0], boxes.directions[:, :, 1:]  # along the chord, and off it
    lin[1 : n + 1] = np.moveaxis(-across * room[:, None, :n], 2, 0)
    rad = np.einsum("kpi,ki->kp", np.abs(across), cells.place.deviation) + WIDEN * (1.0 + np.abs(boxes.centre))
    rad[:, system.dependent] += np.einsum("kij,kj->ki", np.abs(boxes.modes), boxes.radius)
    e, e_dot = _errors(room[:, :n], 1), _errors(room[:, n:], 1 + n)
    v_d, a_d = _chord_form(cells.speed, 1 + 2 * n), _chord_form(cells.acceleration, 1 + 2 * n)
    theta = Affine(boxes.centre, lin, rad * (1.0 + WIDEN), 1 + 2 * n)
    return CellForms(theta, e, e_dot, v_d - e_dot, v_d, a_d)


def _errors(room: Array, first: int) -> Affine:
    """The parameters `first`, … times their sizes (K, n), of 1 + 2n in all."""
    count, n = room.shape
    lin = np.zeros((1 + 2 * n, count, n))
    lin[first + np.arange(n), :, np.arange(n)] = room.T
    return Affine(np.zeros((count, n)), lin, np.zeros((count, n)), 1 + 2 * n)


def _chord_form(chord: Chord, parameters: int) -> Affine:
    """A chord as a form of s."""
    lin = np.zeros((parameters, *chord.start.shape))
    lin[0] = chord.along
    return Affine(chord.middle, lin, chord.deviation + WIDEN * (1.0 + np.abs(chord.middle)), parameters)
