"""Ball arithmetic: python-flint, imported on first use, and the few conversions the package needs.

An `arb` is a real number known to lie in a ball mid ± rad; every operation encloses its rounding. An `fmpq` is an
exact rational; a double becomes one without rounding.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.errors import CcpinError

Ball = Any  # flint.arb: python-flint carries no types
Rational = Any  # flint.fmpq


def flint() -> Any:
    """The python-flint module.

    Raises:
        CcpinError: It is not installed.
    """
    try:
        return importlib.import_module("flint")
    except ImportError:
        raise CcpinError(
            "validated integration needs python-flint: install ccpin with the extra 'validated' "
            "(pip install 'ccpin[validated]')"
        ) from None


def rational(value: float) -> Rational:
    """The exact rational value of a finite double."""
    return flint().fmpq(*float(value).as_integer_ratio())


def ball(value: Any) -> Ball:
    """A number (double, rational or ball) as a ball at the current precision."""
    return flint().arb(value)


def around(centre: Ball, radius: Ball) -> Ball:
    """The ball of the given radius (an upper bound; its own uncertainty is included) about a ball."""
    return centre + flint().arb(0, abs(radius).upper())


def magnitude(x: Ball) -> Ball:
    """An upper bound of |x|, as an exact ball."""
    return flint().arb(x.abs_upper())


def midpoints(box: Sequence[Ball]) -> list[Ball]:
    """The centres of a box, as exact balls."""
    return [x.mid() for x in box]


def hull(boxes: Sequence[Sequence[Ball]]) -> list[Ball]:
    """A box around several boxes."""
    found = list(boxes[0])
    for box in boxes[1:]:
        found = [a.union(b) for a, b in zip(found, box, strict=True)]
    return found


def finite(box: Iterable[Ball]) -> bool:
    """Whether every ball of a box is finite."""
    return all(x.is_finite() for x in box)


class Interval(NamedTuple):
    """An interval of doubles."""

    lower: float
    upper: float


def interval(x: Ball) -> Interval:
    """The ball as an interval of doubles, rounded outwards."""
    return Interval(
        math.nextafter(float(x.lower()), -math.inf),
        math.nextafter(float(x.upper()), math.inf),
    )


def upper(x: Ball) -> float:
    """A double not below any number of the ball."""
    return interval(x).upper


def lower(x: Ball) -> float:
    """A double not above any number of the ball."""
    return interval(x).lower


def bounds(box: Sequence[Ball]) -> tuple[Array, Array]:
    """Lower and upper ends of a box, each of shape (len(box),), rounded outwards."""
    ends = [interval(x) for x in box]
    return np.array([end.lower for end in ends]), np.array([end.upper for end in ends])


def inverse(matrix: Any) -> Any:
    """A matrix of balls that encloses the inverse of every matrix in `matrix`, or ``None`` where none was proven.

    With C an approximate inverse of the midpoint, A⁻¹ = (CA)⁻¹C: elimination meets a matrix near the identity.
    """
    try:
        near = matrix.mid().inv().mid()
        return (near * matrix).inv() * near
    except ZeroDivisionError:
        return None


def determinant(matrix: Any) -> Ball:
    """A ball around the determinants of a matrix of balls (which contains 0 where the inverse was not found)."""
    try:
        near = matrix.mid().inv().mid()
    except ZeroDivisionError:
        return matrix.det()
    return (near * matrix).det() / near.det()
