"""Which combinations of the constants π move the motors at all, and by how much, over a box of motions.

Columns of the regressor Y are scaled by what their parameter does on the average: with S the diagonal of the columns'
root mean squares over random states, β = Vᵀ S π are combinations without a unit, V (p, r) orthonormal, and
Y π = (Y S⁻¹ V) β over the box. Combinations that do less than a ten-thousandth of the most effective one are left out:
r says what can be told apart within the box, not what is identifiable in principle.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import qr, svd

from ccpin.arrays import Array, Indices, records
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import InvalidInputError

_STATES, _FELT, _ZERO = 300, 1e-4, 1e-9


class Motions(NamedTuple):
    """A box of motions: |q − middle| ≤ reach, |q̇| ≤ speed, |q̈| ≤ acceleration, of shape (n,) each."""

    middle: Array
    reach: Array
    speed: Array
    acceleration: Array


class Effects(NamedTuple):
    """What can be told apart.

    Attributes:
        columns: Which of the model's parameters are looked at, of shape (p,).
        scale: The root mean square of each of their columns of Y, N m or N a unit; 1 where a column is zero.
        basis: V, of shape (p, r).
    """

    columns: Indices
    scale: Array
    basis: Array

    @property
    def pivots(self) -> Indices:
        """Which of the columns combinations are written on, of shape (r,)."""
        return np.sort(qr(self.basis.T, pivoting=True, mode="r")[1][: self.basis.shape[1]])

    def reduced(self, Y: Array) -> Array:
        """Y S⁻¹ V, stacked: (N, n, p) → (N n, r)."""
        return np.asarray((Y[..., self.columns] / self.scale).reshape(-1, len(self.scale)) @ self.basis)


def kinds_of(model: ReducedModel) -> tuple[str, ...]:
    """What is looked at where nobody says: inertias, motors', dampers, friction, and springs where there are any."""
    springs = np.any(model.parameters.values[model.parameters.of("stiffness", "offset")])
    further = (
        *(("stiffness", "offset") if springs else ()),
        *(("stribeck",) if len(model.parameters.of("stribeck")) else ()),
    )
    return ("inertia", "armature", "damping", "friction", *further)


def checked_kinds(kinds: object, model: ReducedModel) -> tuple[str, ...]:
    """Kinds of parameters, at least one; ``None``: `kinds_of`.

    Raises:
        InvalidInputError: They are no words.
    """
    if kinds is None:
        return kinds_of(model)
    found = records(kinds, "kinds", str) if not isinstance(kinds, str) else (kinds,)
    if not found:
        raise InvalidInputError("kinds: there is none")
    return found


def effects(model: ReducedModel, box: Motions, kinds: Sequence[str], seed: int = 0) -> Effects:
    """Scales and basis from random states within a box, those that do not exist left out.

    Raises:
        InvalidInputError: Fewer than a quarter of the states exist.
    """
    draw = np.random.default_rng(seed).uniform(-1.0, 1.0, (3, _STATES, model.n))
    failures: dict[int, str] = {}
    Q, V, A = box.middle + box.reach * draw[0], box.speed * draw[1], box.acceleration * draw[2]
    Y = model.regressor_many(Q, V, A, failures=failures)
    there = np.setdiff1d(np.arange(_STATES), list(failures))
    if len(there) < _STATES // 4:
        raise InvalidInputError(f"of {_STATES} configurations within the limits {len(there)} exist: narrow them")
    columns = model.parameters.of(*kinds)
    rows = Y[there][..., columns].reshape(-1, len(columns))
    scale = np.sqrt(np.mean(rows**2, axis=0))
    scale[scale <= _ZERO * scale.max()] = 1.0
    triangle = np.linalg.qr(rows / scale, mode="r")
    _, size, turned = svd(triangle, full_matrices=False, lapack_driver="gesvd")  # the other one may not converge
    return Effects(columns, scale, turned[size > _FELT * size[0]].T)
