"""A region of q-space: an axis-parallel box, and whole-number coordinates in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, Mask, numbers
from ccpin.errors import InvalidInputError
from ccpin.proof.cell_tree import WHOLE, CellRegion, Integers

Corners = Sequence[ArrayLike] | Array  # (lower, upper)


@dataclass(frozen=True, eq=False)
class Region:
    """An axis-parallel box of q-space; a full turn of a periodic coordinate closes on itself.

    A coordinate whose two bounds are the same is held: the region is a slice.

    Attributes:
        lower, upper: Corners, of shape (n,).
        wrapped: Whether a coordinate is a full turn, of shape (n,).
    """

    lower: Array
    upper: Array
    wrapped: Mask

    @property
    def corners(self) -> CellRegion:
        """The same, as the kernel has it."""
        return CellRegion(self.lower, self.upper, self.wrapped)

    @property
    def width(self) -> Array:
        """Edge lengths, of shape (n,)."""
        return self.upper - self.lower

    @property
    def held(self) -> Mask:
        """Whether a coordinate has one value only, of shape (n,)."""
        return np.asarray(self.upper == self.lower)

    @property
    def span(self) -> Array:
        """Edge lengths, 1 of coordinates that are held, of shape (n,)."""
        return np.where(self.held, 1.0, self.width)

    @property
    def volume(self) -> float:
        """Length, area or volume, in the coordinates that are not held."""
        return float(np.prod(self.span))

    def position(self, corner: Integers | Array) -> Array:
        """Whole-number coordinates as points of q-space, each the nearest double or next to it.

        lower + (upper − lower)·t with the errors of difference, product and sum carried along: what is left is within
        u of the point and u² of the region's size, as the lemma of `ccpin.proof.rounding` asks.
        """
        point, rest = self.corners.position(corner)
        return np.asarray(point + rest)

    def cell_coordinates(self, q: Array) -> Integers:
        """The whole-number coordinates of points (K, n), turned into the region where it wraps; −1 outside of it."""
        turned = self.reduce(q)
        inside = np.all((turned >= self.lower) & (turned <= self.upper), axis=1)
        scaled = np.where(inside[:, None], (turned - self.lower) / self.span, 0.0)
        found = np.clip(np.floor(scaled * WHOLE), 0, WHOLE - 1)
        found -= (found > 0.0) & (turned < self.position(found))  # the quotient is rounded, a border is not
        found += (found < WHOLE - 1) & (turned >= self.position(found + 1.0))
        return np.where(inside[:, None], np.where(self.held, 0.0, found), -1).astype(np.int64)

    def reduce(self, q: Array) -> Array:
        """Points with their periodic coordinates turned into the region."""
        turns = np.where(self.wrapped, np.floor((q - self.lower) / self.span), 0.0)
        reduced = np.clip(q - turns * self.width, self.lower, self.upper)  # rounding must not pass the edge
        return np.where(self.wrapped, reduced, q)


def corners_of(region: Corners, names: Sequence[str], slices: bool = False) -> tuple[Array, Array]:
    """The corners (lower, upper) of a region over named coordinates, n finite numbers each, lower below upper.

    With `slices` the bounds of some may be equal.

    Raises:
        InvalidInputError: They are not.
    """
    n = len(names)
    try:
        corners = numbers(region, "region").copy()
    except InvalidInputError:
        corners = np.empty(0)
    if corners.shape != (2, n) or not np.all(np.isfinite(corners)):
        raise InvalidInputError(
            f"a region is (lower, upper), each of shape ({n},) and finite: one bound a coordinate ({', '.join(names)})"
        )
    held = corners[1] == corners[0]
    if np.any(corners[1] < corners[0]) or (np.any(held) and not slices) or np.all(held):
        raise InvalidInputError(
            f"the region's lower corner {corners[0].tolist()} must be below its upper corner {corners[1].tolist()}"
            + (" in one coordinate at least, and above it in none" if slices else "")
        )
    return corners[0], corners[1]


def points_of(q: ArrayLike, names: Sequence[str]) -> Array:
    """Points of q-space as an array (K, n), of one point too.

    Raises:
        InvalidInputError: They have not a finite number for each of the coordinates (n names).
    """
    points = np.atleast_2d(numbers(q, "q"))
    if points.ndim != 2 or points.shape[1] != len(names) or not np.all(np.isfinite(points)):
        raise InvalidInputError(f"q must have {len(names)} finite columns ({', '.join(names)})")
    return points
