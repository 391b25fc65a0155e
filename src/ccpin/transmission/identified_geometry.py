"""What `identify_geometry` returns: numbers of the geometry with their covariance, and what is not observable."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import qr
from scipy.stats import norm

from ccpin.arrays import Array, number
from ccpin.description.model import MechanismDescription
from ccpin.errors import InvalidInputError

_NOTHING = 1e-6  # of a direction's largest entry: less is rounding


class IdentifiedGeometry(NamedTuple):
    """A linkage's geometry of measured pairs, k numbers p of which r directions are observable.

    Attributes:
        parameters: Names of the numbers.
        lengths: Which of them are metres; others are ratios and offsets in rad (m of a slide).
        stated: As the file has them, of shape (k,).
        values: As identified, of shape (k,); along unobservable directions as near to the file as can be.
        covariance: Of the observable part, of the noise stated, of shape (k, k), of rank r.
        singular_values: Of the weighted sensitivity, lengths in extents: 1/s is what each direction is known to; of
            shape (k,), the first r those of observable ones.
        directions: A basis of what is not observable, of shape (k − r, k).
        residuals: q̂_m less those of the geometry, rad or m, of shape (N, n).
        misfit: √(χ²/(N n − r)): about 1 where noise is as stated and the model true.
        iterations: Steps of Gauss–Newton.
        description: The mechanism with this geometry, to load or to convert; encoders' offsets are not in it.
    """

    parameters: tuple[str, ...]
    lengths: tuple[bool, ...]
    stated: Array
    values: Array
    covariance: Array
    singular_values: Array
    directions: Array
    residuals: Array
    misfit: float
    iterations: int
    description: MechanismDescription

    @property
    def determined(self) -> Array:
        """Which numbers no unobservable direction changes, of shape (k,)."""
        if not len(self.directions):
            return np.ones(len(self.parameters), dtype=bool)
        sizes = np.abs(self.directions)
        shares: Array = (sizes / sizes.max(axis=1, keepdims=True)).max(axis=0)
        return shares < _NOTHING

    @property
    def standard_deviations(self) -> Array:
        """Of each number, of shape (k,); ∞ where it is not determined."""
        return np.where(self.determined, np.sqrt(np.diag(self.covariance)), np.inf)

    def intervals(self, level: float = 0.95) -> tuple[Array, Array]:
        """Lower and upper ends between which each number is at that confidence, of shape (k,).

        Raises:
            InvalidInputError: A level that is not between 0 and 1.
        """
        level = number(level, "level")
        if not 0.0 < level < 1.0:
            raise InvalidInputError(f"level = {level:g} must be between 0 and 1")
        half = norm.ppf(0.5 + 0.5 * level) * self.standard_deviations
        return self.values - half, self.values + half

    @property
    def unobservable(self) -> tuple[str, ...]:
        """What is not observable, in words: numbers that change nothing, alone or together."""
        return unobservable_in_words(self)

    def __str__(self) -> str:
        rows = zip(self.parameters, self.stated, self.values, self.standard_deviations, strict=True)
        told = [
            f"{name:28} {before:10.6f} → {now:10.6f}  " + (f"± {1.96 * spread:.6f}" if spread < np.inf else "as stated")
            for name, before, now, spread in rows
        ]
        lines = [*told, *(f"not observable: {each}" for each in self.unobservable), f"misfit {self.misfit:.2f}"]
        return "\n".join(lines)


def unobservable_in_words(found: IdentifiedGeometry) -> tuple[str, ...]:
    """A sentence a direction, of a basis with as few numbers in each as pivoting finds."""
    if not len(found.directions):
        return ()
    basis = found.directions
    _, _, order = qr(basis / np.linalg.norm(basis, axis=1, keepdims=True), pivoting=True, mode="economic")
    sparse = np.linalg.solve(basis[:, order[: len(basis)]], basis)
    told = []
    for row in sparse:
        names = [found.parameters[k] for k in np.flatnonzero(np.abs(row) > _NOTHING * np.abs(row).max())]
        told.append(f"{names[0]} alone" if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]} together")
    lengths = np.where(found.lengths, found.values, 0.0)
    kept = np.linalg.lstsq(basis.T, lengths, rcond=None)[0] @ basis
    if np.linalg.norm(kept - lengths) <= _NOTHING * np.linalg.norm(lengths) > 0.0:
        told.insert(0, "the size of the whole, to which all lengths are in proportion: name one as known")
    return tuple(told)
