"""Cells of a reference under an adaptive law, as affine forms of the time in them, the errors, and ṡ."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.control.stability.tracking.cell_forms import WIDEN, CellForms, TimeCells
from ccpin.control.stability.tracking.motion_bounds import Motion
from ccpin.proof.balls import Affine, affine
from ccpin.proof.chords import Chord, Polynomials, chords_of
from ccpin.proof.facts import require

_APART = 1e-9  # rad (m), and with 1/s and 1/s²: what pieces may jump by and count as one motion's rounding
_MENDED = 60.0  # |H‴| at most of the quintic Hermite polynomials H of [0, 1], and so |H|, |H′|, |H″|


class AdaptiveStates(NamedTuple):
    """States of K cells.

    Attributes:
        theta: θ at σ(q), of shape (K, n′).
        asked: (q̇, v_r, a_r), each of shape (K, n).
        rate: Their rates along motions.
        error: s, of shape (K, n).
    """

    theta: Affine
    asked: Motion
    rate: Motion
    error: Affine

    def chunk(self, rows: slice) -> AdaptiveStates:
        """Some of the cells."""
        asked, rate = (Motion(*(form[rows] for form in each)) for each in (self.asked, self.rate))
        return AdaptiveStates(self.theta[rows], asked, rate, self.error[rows])


class SmoothCells(NamedTuple):
    """Cells of a C² motion within what rounding leaves of a reference's pieces, and chords of its jerk."""

    cells: TimeCells
    jerk: Chord

    @classmethod
    def of(cls, motion: tuple[Polynomials, Polynomials, Polynomials], third: Polynomials, times: Array) -> SmoothCells:
        """Those of q_d, q̇_d and q̈_d, whose jumps at knots a quintic in the cell after makes good.

        Raises:
            NotProvedError: They jump by more than rounding: the reference is not C².
        """
        cells, jerk = TimeCells.of(motion, times), chords_of(third, times)
        chords = cells.place, cells.speed, cells.acceleration
        inside, long = np.isin(times[1:-1], motion[0].x), np.diff(times)[1:]
        jumps = [_jump(chord) * inside[:, None] for chord in chords]
        require([np.all(jump <= _APART) for jump in jumps], "a reference that jumps in speed or acceleration")
        mended = list[Chord]()
        for order, chord in enumerate((*chords, jerk)):
            more = np.zeros_like(chord.deviation)
            more[1:] = sum(_MENDED * jump * long[:, None] ** (k - order) for k, jump in enumerate(jumps))
            mended.append(chord._replace(deviation=chord.deviation + more))
        return cls(cells._replace(place=mended[0], speed=mended[1], acceleration=mended[2]), mended[3])


def _jump(chord: Chord) -> Array:
    """How far the beginning of a cell is from the end of the one before, at most: (K − 1, n)."""
    apart = np.abs(chord.start[1:] - chord.end[:-1]) + chord.rounding[1:, 0] + chord.rounding[:-1, 1]
    return np.asarray(apart * (1.0 + WIDEN))


def states_of(forms: CellForms, jerk: Chord, slope: Array, rates: Array) -> AdaptiveStates:
    """States with q_d − q and −s as the two errors of `forms`, and |ṡ| ≤ `rates` (K, n); Λ = `slope` (n,).

    q̇ = q̇_d + s − Λe, v_r = q̇_d − Λe, a_r = q̈_d − Λ(s − Λe), e = q − q_d, and their rates a_r + ṡ, a_r and
    q⃛_d − Λ(a_r + ṡ − q̈_d).
    """
    n = len(slope)
    theta, e, s, v_d, a_d = (
        _with_more(form, n) for form in (forms.theta, -forms.e, -forms.e_dot, forms.v_d, forms.a_d)
    )
    away = s - e * slope
    pushed = affine(np.zeros_like(s.mid))
    pushed = Affine(pushed.mid, np.zeros_like(s.lin), pushed.rad, s.boxed)
    pushed.lin[-n + np.arange(n), :, np.arange(n)] = rates.T
    third = Affine(jerk.middle, 0.0 * s.lin, jerk.deviation + WIDEN * (1.0 + np.abs(jerk.middle)), s.boxed)
    third.lin[0] = jerk.along
    v_r, a_r = v_d - e * slope, a_d - away * slope
    rate = a_r + pushed
    return AdaptiveStates(theta, Motion(v_d + away, v_r, a_r), Motion(rate, a_r, third - (rate - a_d) * slope), s)


def _with_more(form: Affine, more: int) -> Affine:
    """The same, with more parameters that it does not depend on."""
    lin = np.concatenate([form.lin, np.zeros((more, *form.mid.shape))])
    return Affine(form.mid, lin, form.rad, len(lin))
