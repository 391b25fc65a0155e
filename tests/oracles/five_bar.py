"""Five-bars: their singular configurations in closed form, with NumPy alone.

Arms a₁, a₂ on a base of length c, distal links a₃ on the first and a₄ on the second; angles as in `rpdr`. With d the
vector from elbow to elbow the loop closes where a₃ e^{i(q1+q3)} − a₄ e^{i(q2+q4)} = d, and φ_y is singular where the
distal links are parallel: stretched, |d| = a₃ + a₄, or on one another, |d| = |a₃ − a₄|.
"""

from typing import NamedTuple

import numpy as np

from .geometry import wrap


class FiveBar(NamedTuple):
    """Lengths in metres."""

    a1: float
    a2: float
    a3: float
    a4: float
    c: float


def elbows(bar, q1, q2):
    """d as a complex number."""
    return bar.c + bar.a2 * np.exp(1j * q2) - bar.a1 * np.exp(1j * q1)


def closing_error(bar, q_free):
    """How far the loop is from closed at configurations (K, 4)."""
    q1, q2, q3, q4 = q_free.T
    return np.abs(bar.a3 * np.exp(1j * (q1 + q3)) - bar.a4 * np.exp(1j * (q2 + q4)) - elbows(bar, q1, q2))


def singular_configurations(bar, count, rng):
    """About `count` random ones, (q1, q2, q3, q4) of shape (K, 4): of every curve, each arm's angle drawn in turn."""
    found = []
    for reach in (bar.a3 + bar.a4, bar.a3 - bar.a4):
        for first in (True, False):
            q1, q2 = _on_circle(bar, abs(reach), rng.uniform(-np.pi, np.pi, count), first)
            if reach == 0.0:
                free = rng.uniform(-np.pi, np.pi, len(q1))
                alpha, beta = free, free
            else:
                alpha = np.angle(elbows(bar, q1, q2) * np.sign(reach))
                beta = alpha + (np.pi if reach == bar.a3 + bar.a4 else 0.0)
            found.append(wrap(np.column_stack([q1, q2, alpha - q1, beta - q2])))
    found = np.concatenate(found)
    return found[rng.permutation(len(found))[:count]]


def _on_circle(bar, reach, drawn, first):
    """(q1, q2) with |d| = reach, one of the two as drawn; where reach is 0, the two points that have it."""
    if reach == 0.0:
        far = np.arccos((bar.c**2 + bar.a1**2 - bar.a2**2) / (2.0 * bar.c * bar.a1)) * np.sign(drawn)
        return far, np.angle(bar.a1 * np.exp(1j * far) - bar.c)
    rest = bar.c - bar.a1 * np.exp(1j * drawn) if first else bar.c + bar.a2 * np.exp(1j * drawn)
    arm = bar.a2 if first else -bar.a1
    cosine = (reach**2 - np.abs(rest) ** 2 - arm**2) / (2.0 * arm * np.abs(rest))
    usable = np.abs(cosine) <= 1.0
    side = np.where(np.arange(usable.sum()) % 2, 1.0, -1.0)
    other = wrap(np.angle(rest[usable]) + side * np.arccos(cosine[usable]))
    return (drawn[usable], other) if first else (other, drawn[usable])
