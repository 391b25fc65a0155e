"""How many configurations planar linkages of pins, slides and gears have, in closed form or by a search of intervals.

A function a family: what depends, for points q (K, n), as (K, s) values of the coordinate that may be limited, one
column an assembly mode, nan where the mode does not close; and how far each point is from closing otherwise (K,).
NumPy alone.
"""

import numpy as np

TURN = 2.0 * np.pi


def dyad(gap, near, far):
    """Two links from a point to another, `gap` away as a complex number: both angles of the first, (2, K), and margin.

    near · e^{iα} + far · e^{iβ} = gap, cos(α − arg gap) = (|gap|² + near² − far²)/(2 near |gap|).
    """
    length = np.abs(gap)
    cosine = (length**2 + near**2 - far**2) / (2.0 * near * length)
    margin = np.abs(1.0 - np.abs(cosine))
    turn = np.arccos(np.where(np.abs(cosine) <= 1.0, cosine, np.nan))
    return np.angle(gap) + np.array([1.0, -1.0])[:, None] * turn, margin


def on_line(height, rod):
    """Where a rod from (0, height) ends on the x axis: ±√(rod² − height²), (K, 2), and the margin."""
    square = rod**2 - height**2
    root = np.sqrt(np.where(square >= 0.0, square, np.nan))
    return root[:, None] * [-1.0, 1.0], np.abs(square)


def within(values, lower, upper):
    """How many values (K, s) lie between limits, (K,), and how near to one of them the nearest is, (K,)."""
    with np.errstate(invalid="ignore"):
        counts = np.sum((values >= lower) & (values <= upper), axis=1)
    ends = np.concatenate([np.abs(values - lower), np.abs(values - upper)], axis=1)
    return counts, np.where(np.isnan(ends), np.inf, ends).min(axis=1, initial=np.inf)


def turned_within(angles, lower, upper):
    """The same for angles (K, s), each of which counts as often as it is between the limits with whole turns."""
    turns = np.arange(np.floor((lower - np.pi) / TURN) - 1, np.ceil((upper + np.pi) / TURN) + 2)
    angles = np.mod(angles, TURN)
    return within((angles[:, :, None] + TURN * turns).reshape(len(angles), -1), lower, upper)


def zeros_between(function, slope, bend, lower, upper, least=1e-7):
    """How many zeros a function of one number has between limits, by halving; −1 where that is not told.

    An interval |x − c| ≤ h holds none where |f(c)| > |f′(c)| h + bend h²/2, and one at most where |f′(c)| > bend h,
    which is one if f has another sign at its other end. `bend` bounds |f″|.
    """
    waiting, found = [(lower, upper)], 0
    while waiting:
        a, b = waiting.pop()
        c, h = 0.5 * (a + b), 0.5 * (b - a)
        if abs(function(c)) > abs(slope(c)) * h + 0.5 * bend * h * h + 1e-13:
            continue
        if abs(slope(c)) > bend * h + 1e-13:
            ends = function(a), function(b)
            if min(map(abs, ends)) < 1e-12:
                return -1
            found += ends[0] * ends[1] < 0.0
        elif h < least:
            return -1
        else:
            waiting += [(a, c), (c, b)]
    return found
