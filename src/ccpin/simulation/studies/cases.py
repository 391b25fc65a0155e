"""The cases of a parameter study: grids, Latin hypercubes and Sobol points between bounds."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ccpin.arrays import numbers, whole
from ccpin.errors import InvalidInputError

if TYPE_CHECKING:
    from scipy.stats.qmc import QMCEngine

Case = dict[str, Any]
"""One case: values by name."""

Ranges = Mapping[str, tuple[float, float]]
"""Lower and upper bound by name."""


def grid(values: Mapping[str, Sequence[Any]]) -> list[Case]:
    """Every combination of the values of each name, the last name's changing fastest.

    Raises:
        InvalidInputError: There is no name, or one without values.
    """
    lists = isinstance(values, Mapping) and all(isinstance(each, Sequence) and len(each) for each in values.values())
    if not lists or not len(values):
        raise InvalidInputError('a grid needs at least one value each, like {"K_p": [10.0, 20.0]}')
    return [dict(zip(values, chosen, strict=True)) for chosen in itertools.product(*values.values())]


def latin_hypercube(ranges: Ranges, count: int, seed: int = 0) -> list[Case]:
    """`count` points between bounds, each name's range cut into `count` slices with one point each (SciPy's qmc).

    Args:
        ranges: (lower, upper) by name.
        count: How many.
        seed: The same seed gives the same points.

    Raises:
        InvalidInputError: Bounds that are not two finite increasing numbers, or a count below 1.
    """
    from scipy.stats.qmc import LatinHypercube

    return _between(ranges, count, lambda d: LatinHypercube(d, seed=whole(seed, "seed", 0)))


def sobol(ranges: Ranges, count: int, seed: int = 0) -> list[Case]:
    """`count` points of a scrambled Sobol sequence between bounds; even where the count is a power of two.

    Arguments and errors as for `latin_hypercube`.
    """
    from scipy.stats.qmc import Sobol

    return _between(ranges, count, lambda d: Sobol(d, seed=whole(seed, "seed", 0)))


def _between(ranges: Ranges, count: int, engine: Callable[[int], QMCEngine]) -> list[Case]:
    count = whole(count, "count")
    bounds = numbers(list(ranges.values()), "ranges") if isinstance(ranges, Mapping) else np.empty(0)
    if (
        bounds.shape != (len(bounds) or 1, 2)
        or not np.isfinite(bounds).all()
        or not (bounds[:, 0] < bounds[:, 1]).all()
    ):
        raise InvalidInputError(f'ranges must be (lower, upper) by name, like {{"mass": (0.8, 1.2)}}: {ranges!r:.80}')
    places = _points(engine(len(ranges)), count)
    points = bounds[:, 0] + places * (bounds[:, 1] - bounds[:, 0])
    return [dict(zip(ranges, point, strict=True)) for point in points.tolist()]


def _points(engine: QMCEngine, count: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    """`count` points in the unit cube; of a Sobol sequence the first ones of the next power of two."""
    if hasattr(engine, "random_base2"):
        return np.asarray(engine.random_base2(max(0, (count - 1).bit_length())))[:count]
    return np.asarray(engine.random(count))
