"""Ball arithmetic: python-flint, imported on first use, and the few conversions the package needs.

An `arb` is a real number known to lie in a ball mid ± rad; every operation encloses its rounding.
"""

from __future__ import annotations

import copyreg
import importlib
import math
import sys
from collections.abc import Iterable, Sequence
from fractions import Fraction
from functools import reduce
from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.errors import CcpinError

Ball = Any  # flint.arb: python-flint carries no types
_RADIUS_BITS = 30  # of a ball's radius


def flint() -> Any:
    """The python-flint module.

    Raises:
        CcpinError: It is not installed.
    """
    known = sys.modules.get("flint")  # asked for at every operation
    if known is not None and known.arb in copyreg.dispatch_table:
        return known
    try:
        known = importlib.import_module("flint")
        copyreg.pickle(known.arb, _taken_apart)
        return known
    except ImportError as error:
        raise CcpinError(
            f"validated integration needs python-flint ({error}): install ccpin with the extra 'validated' "
            "(pip install 'ccpin[validated]')"
        ) from None


def _taken_apart(x: Ball) -> tuple[Any, ...]:
    """How a ball is pickled and copied, which python-flint leaves open: by its middle and radius."""
    if not x.is_finite():
        return _put_together, ()
    numbers = [(int(man), int(exp)) for man, exp in (x.mid().man_exp(), x.rad().man_exp())]
    return _put_together, tuple(numbers)


def _put_together(*numbers: tuple[int, int]) -> Ball:
    """The ball of a middle and a radius, man·2^exp each; all for none."""
    if not numbers:
        return flint().arb("nan")
    bits = max(64, *(abs(man).bit_length() for man, _ in numbers))
    with flint().ctx.workprec(bits):
        return with_radius(*map(flint().arb, numbers))


def with_radius(centre: Ball, radius: Ball) -> Ball:
    """The ball of a middle and a radius, balls of radius 0.

    Flint makes of a radius the next one of 30 bits that is larger, so it is given the one before.
    """
    man, exp = radius.man_exp()
    before = flint().arb(((int(man) << _RADIUS_BITS) - (1 << (int(man) - 1).bit_length()), int(exp) - _RADIUS_BITS))
    found = flint().arb(centre, before) if man else centre
    return found if found.rad() >= radius else flint().arb(centre, radius)


def ball(value: Any) -> Ball:
    """A number (double, rational or ball) as a ball at the current precision."""
    if isinstance(value, Fraction):
        value = flint().fmpq(value.numerator, value.denominator)
    return flint().arb(value)


def around(centre: Ball, radius: Ball) -> Ball:
    """The ball of the given radius (an upper bound; its own uncertainty is included) about a ball."""
    return centre + flint().arb(0, abs(radius).upper())


def magnitude(x: Ball) -> Ball:
    """An upper bound of |x|, as an exact ball."""
    return flint().arb(x.abs_upper())


def hull(boxes: Sequence[Sequence[Ball]]) -> list[Ball]:
    """A box around several boxes."""
    return [reduce(lambda a, b: a.union(b), sides) for sides in zip(*boxes, strict=True)]


def finite(box: Iterable[Ball]) -> bool:
    """Whether every ball of a box is finite."""
    return all(x.is_finite() for x in box)


def lower(x: Ball) -> float:
    """A double not above any number of the ball."""
    return math.nextafter(float(x.lower()), -math.inf)


def upper(x: Ball) -> float:
    """A double not below any number of the ball."""
    return math.nextafter(float(x.upper()), math.inf)


def centre_of(box: Iterable[Ball]) -> Array:
    """The middle of a box in doubles, of shape (len(box),)."""
    return np.array([float(x.mid()) for x in box], dtype=np.float64)


def bounds(box: Sequence[Ball]) -> tuple[Array, Array]:
    """Lower and upper ends of a box, each of shape (len(box),), rounded outwards."""
    return np.array([lower(x) for x in box]), np.array([upper(x) for x in box])


def gain(cosine: Ball, order: int) -> Ball:
    """The range of a derivative of g(w) = 2 arccos(w)/√(1 − w²) = 2 ₂F₁(1, 1; 3/2; (1 − w)/2), w > −1.

    The k-th is (−½)ᵏ times a positive, increasing function of z = (1 − w)/2: its derivatives are, by Euler's integral.
    """
    fraction = flint().fmpq
    factor = fraction(2)
    for k in range(order):
        factor = factor * fraction(-1, 2) * (1 + k) * (1 + k) / (fraction(3, 2) + k)
    z = (1 - cosine) / 2
    if not z < 1:
        return flint().arb(0, math.inf)
    ends = (ball(x).hypgeom_2f1(1 + order, 1 + order, fraction(3, 2) + order) for x in (z.lower(), z.upper()))
    return factor * hull([[end] for end in ends])[0]


class BallInverse(NamedTuple):
    """The inverses A⁻¹ = (CA)⁻¹C of all matrices A in a matrix of balls.

    Attributes:
        near: C, an approximate inverse of the midpoint.
        rest: Balls around (CA)⁻¹.
    """

    near: Any
    rest: Any

    def times(self, right: Any) -> Any:
        """Balls around A⁻¹B: what cancels in CB does so before the radii of (CA)⁻¹ come in."""
        return self.rest * (self.near * right)

    @property
    def matrix(self) -> Any:
        """Balls around A⁻¹."""
        return self.rest * self.near


def inverse(matrix: Any) -> BallInverse | None:
    """The inverse of every matrix in `matrix`, or ``None`` where none was proven; elimination meets CA, nearly I."""
    try:
        near = matrix.mid().inv().mid()
        return BallInverse(near, (near * matrix).inv())
    except ZeroDivisionError:
        return None


def determinant(matrix: Any) -> Ball:
    """A ball around the determinants of a matrix of balls (which contains 0 where the inverse was not found)."""
    try:
        near = matrix.mid().inv().mid()
    except ZeroDivisionError:
        return matrix.det()
    return (near * matrix).det() / near.det()
