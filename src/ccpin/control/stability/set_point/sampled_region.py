"""U and ‖∂g/∂q‖ on a grid over a region: estimates, where nothing is proved."""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Mask, whole
from ccpin.covering.region import Corners, corners_of
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.errors import InvalidInputError
from ccpin.mechanism.mechanism import Mechanism

_POINTS = 2500  # of a grid, about; a choice: it is looked at, nothing is proved by it


class RegionSamples(NamedTuple):
    """A grid over [lower, upper], corners and faces included.

    Attributes:
        q: Of shape (N, n).
        potential: V(σ(q)) in joules, of shape (N,).
        norm: ‖∂g/∂q‖₂, of shape (N,).
        edge: Whether a point lies on the region's boundary, of shape (N,).
    """

    q: Array
    potential: Array
    norm: Array
    edge: Mask


def checked_region(model: ReducedModel, region: Corners, q_d: Array) -> tuple[Array, Array]:
    """The corners of a region that holds q_d.

    Raises:
        InvalidInputError: Corners of the wrong shape or order, or q_d outside.
    """
    lower, upper = corners_of(region, model.mechanism.independent)
    if not np.all((lower <= q_d) & (q_d <= upper)):
        raise InvalidInputError(f"the set point {q_d} lies outside of the region from {lower} to {upper}")
    return lower, upper


def sample_region(
    model: ReducedModel | Mechanism, lower: Array, upper: Array, q_free_d: Array, points: int = _POINTS
) -> RegionSamples:
    """Evaluate on a grid of about `points` points (at least 3 a coordinate), on the branch of q′_d.

    Raises:
        UnreachableError, SingularConfigurationError: σ does not exist on all of the region.
    """
    model = model_of(model)
    lower, upper = corners_of((lower, upper), model.mechanism.independent)
    count = max(3, int(whole(points, "points") ** (1.0 / model.n)))
    indices = np.array(list(product(range(count), repeat=model.n)))
    q = lower + (upper - lower) * indices / (count - 1)
    potential, norm, near = np.empty(len(q)), np.empty(len(q)), q_free_d
    rest = np.zeros(model.n)
    for k, point in enumerate(q):
        near = model.sigma(point, q_free_d if indices[k, -1] == 0 else near)
        potential[k] = model.energy(point, rest, near).potential
        norm[k] = np.linalg.norm(model.gravity_derivative(point, near), 2)
    edge = np.any((indices == 0) | (indices == count - 1), axis=1)
    return RegionSamples(q, potential, norm, np.asarray(edge))
