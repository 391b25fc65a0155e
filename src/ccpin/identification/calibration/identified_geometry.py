"""What is known of a geometry that was measured: its numbers with their covariance, and what is not observable."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.linalg import qr
from scipy.special import ndtri

from ccpin.arrays import Array, Mask, number
from ccpin.description.model import MechanismDescription
from ccpin.errors import InvalidInputError

ROUNDING = 1e-10  # of the largest singular value: what is below is 0
_NOTHING = 1e-6  # of a direction's largest entry: less is rounding


class IdentifiedGeometry(NamedTuple):
    """A mechanism's geometry as N poses show it, k numbers p of which r directions are observable.

    Attributes:
        parameters: Names of the numbers.
        units: Their units.
        stated: As the file has them, of shape (k,).
        values: As identified, of shape (k,); along unobservable directions as near to the file as can be.
        covariance: Of the observable part, of the noise stated, of shape (k, k), of rank r.
        singular_values: Of the weighted sensitivity, lengths in extents: 1/s is what each direction is known to; of
            shape (k,), the first r those of observable ones.
        directions: A basis of what is not observable, of shape (k − r, k).
        residuals: What is left of what was measured, rad or m, a row a pose, NaN where nothing was: of `calibrate`
            sensor after sensor; of `identify_geometry` of q̂_m, the joints' errors taken over to it, of shape (N, n).
        off: Of each pose the largest residual over its noise, of shape (N,): a pose that was misread stands out.
        misfit: √(S/ν), S the weighted sum of squares and ν the equations less N n and r: about 1 where noise is as
            stated and the model true.
        iterations: Steps of Gauss–Newton.
        description: The mechanism with this geometry, to load or to convert; encoders' offsets are not in it.
        frames: The world's frame in the axes of each tracker, 4×4, by the sensor's name.
    """

    parameters: tuple[str, ...]
    units: tuple[str, ...]
    stated: Array
    values: Array
    covariance: Array
    singular_values: Array
    directions: Array
    residuals: Array
    off: Array
    misfit: float
    iterations: int
    description: MechanismDescription
    frames: Mapping[str, Array]

    @property
    def rank(self) -> int:
        """r."""
        return len(self.parameters) - len(self.directions)

    @property
    def condition(self) -> float:
        """The largest singular value over the least of an observable direction."""
        return float(self.singular_values[0] / self.singular_values[self.rank - 1])

    @property
    def observability(self) -> float:
        """Borm and Menq's O₁ = (σ₁ … σ_r)^{1/r}/√N, σ the singular values of observable directions."""
        return float(np.exp(np.log(self.singular_values[: self.rank]).mean()) / np.sqrt(len(self.residuals)))

    @property
    def residual_rms(self) -> Array:
        """Of each column of the residuals, rad or m."""
        return np.asarray(np.sqrt(np.nanmean(self.residuals**2, axis=0)))

    @property
    def determined(self) -> Mask:
        """Which numbers no unobservable direction changes, of shape (k,)."""
        sizes = np.abs(self.directions)
        shares = (sizes / sizes.max(axis=1, keepdims=True, initial=0.0)).max(axis=0, initial=0.0)
        return np.asarray(shares < _NOTHING)

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
        half = ndtri(0.5 + 0.5 * level) * self.standard_deviations
        return self.values - half, self.values + half

    @property
    def unobservable(self) -> tuple[str, ...]:
        """What is not observable, in words: gauge freedoms (nothing measured changes), and what poses hardly show."""
        hardly = self.singular_values[self.rank :] > ROUNDING * self.singular_values[0]
        gauges, lengths = self.directions[~hardly], np.where([unit == "m" for unit in self.units], self.values, 0.0)
        told = [f"{self._in_words(row)} (nothing measured changes)" for row in _sparse(gauges)]
        told += [f"{self._in_words(row)} (these poses hardly show it)" for row in _sparse(self.directions[hardly])]
        kept = np.linalg.lstsq(gauges.T, lengths, rcond=None)[0] @ gauges
        if np.linalg.norm(kept - lengths) <= _NOTHING * np.linalg.norm(lengths) > 0.0:
            told.insert(0, "the size of the whole, to which all lengths are in proportion: name one as known")
        return tuple(told)

    def _in_words(self, direction: Array) -> str:
        names = [self.parameters[k] for k in np.flatnonzero(np.abs(direction) > _NOTHING * np.abs(direction).max())]
        return f"{names[0]} alone" if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]} together"

    def __str__(self) -> str:
        rows = zip(self.parameters, self.units, self.stated, self.values, self.standard_deviations, strict=True)
        lines = [
            f"{name:28} {before:10.6f} → {now:10.6f} "
            + (f"± {1.96 * spread:.6f} {unit}" if spread < np.inf else f"{unit}, not determined")
            for name, unit, before, now, spread in rows
        ]
        rms = ", ".join(f"{x:.3g}" for x in self.residual_rms)
        lines += [f"not observable: {each}" for each in self.unobservable]
        pose = int(np.argmax(self.off))
        worst = f"{self.misfit:.2f} of the noise stated, most at pose {pose} ({self.off[pose]:.1f})"
        return "\n".join([*lines, f"residuals {rms} RMS, {worst}"])


def _sparse(basis: Array) -> Array:
    """Another basis of the same directions, with as few numbers in each as pivoting finds."""
    if not len(basis):
        return basis
    _, _, order = qr(basis / np.linalg.norm(basis, axis=1, keepdims=True), pivoting=True, mode="economic")
    return np.asarray(np.linalg.solve(basis[:, order[: len(basis)]], basis))
