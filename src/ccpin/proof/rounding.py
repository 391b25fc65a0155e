"""What rounding may do to a box and to a point that is asked about: one definition for all that is proved over boxes.

Cells of a region are halved in whole numbers, so as sets of real numbers they leave no gap. What is computed of one is
its centre c̃ and half width h̃ in doubles, and a theorem is about the box of all |q − c̃| ≤ `widened(c̃, h̃)`.

**Lemma (no gaps).** Let the real cell be [c − h, c + h], |c̃ − c| ≤ u|c| + u²s and h̃ = h(1 + ε), |ε| ≤ u, with the
region's size s < 1e17. Then the real cell lies in the widened box, by at least 1.9u(|c̃| + h̃) + 8e-15 on either side: so
cells that touch overlap, and a point within u|q| of the cell lies in the box.

*Proof.* The cell's ends are within |c̃ − c| + |h̃ − h| ≤ u(|c̃| + h̃)(1 + 2u) + u²s of the ends of [c̃ − h̃, c̃ + h̃], and
u²s < 1.3e-15. `widened` adds 4u(|c̃| + h̃) + 1e-14; its own roundings are u of the sum, which is u·h̃ and less than 5u²
of the rest. What remains of 4u(|c̃| + h̃) is above 2u|c̃| + 1.9u·h̃, of 1e-14 above 8e-15. ∎

`Region.position` computes c̃ so (`ccpin.covering.region`). The absolute 1e-14 lets points be asked about that carry a
rounding of numbers of order one, in cells about zero.
"""

from __future__ import annotations

import numpy as np

from ccpin.arrays import Array

UNIT_ROUNDOFF = 2.0**-53
"""u: what one operation on doubles is off by at most, relative to its result."""
TURN = 2.0 * np.pi
"""The double nearest to 2π, 2.21 unit roundoffs off."""
SLACK = 1.0 + 1e-10
"""Inequalities between sums and products of nonnegative doubles, whose errors are below 1e-12, are compared with it."""
LEAST = 1e-14
"""What a box is widened by at least (rad, m)."""
ROUNDINGS = 4.0
"""So many unit roundoffs of its centre and its half width a box is widened by."""


def widened(centre: Array, half: Array) -> Array:
    """h + 1e-14 + 4u(|c| + h): the half widths (…, p) of the box that a theorem is about; c (…, p) or (…, 1)."""
    return np.asarray(half + (LEAST + ROUNDINGS * UNIT_ROUNDOFF * (np.abs(centre) + half)))


def blur(point: Array) -> Array:
    """4u(1 + |x|): what a point at which a question is asked may be off by, having been turned or moved."""
    return np.asarray(ROUNDINGS * UNIT_ROUNDOFF * (1.0 + np.abs(point)))


def sum_of(a: Array, b: Array) -> tuple[Array, Array]:
    """A sum and its rounding error, a + b = s + e exactly (Knuth)."""
    s = np.asarray(a + b)
    back = s - a
    return s, np.asarray((a - (s - back)) + (b - back))


def product_of(a: Array, b: Array) -> tuple[Array, Array]:
    """A product and its rounding error, ab = p + e exactly (Dekker), where nothing over- or underflows."""
    p = np.asarray(a * b)
    (a_high, a_low), (b_high, b_low) = _halves(a), _halves(b)
    return p, np.asarray(((a_high * b_high - p) + a_high * b_low + a_low * b_high) + a_low * b_low)


def _halves(a: Array) -> tuple[Array, Array]:
    """A double as the sum of two with 26 bits each (Veltkamp)."""
    moved = a * 134217729.0  # 2²⁷ + 1
    high = np.asarray(moved - (moved - a))
    return high, np.asarray(a - high)
