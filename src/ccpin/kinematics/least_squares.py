"""Damped Gauss–Newton steps of bounded length on a manifold: closing loops from afar, inverse kinematics."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from scipy.linalg import lapack

from ccpin.arrays import Array

P = TypeVar("P")
_LARGEST_STEP = 0.3  # rad and m: longer ones leave where φ is about linear
_MOST_ITERATIONS = 200  # from one start
_PATIENCE = 20  # iterations in which |r|² must lose a fifth, or it ends
_LEAST_DAMPING = 1e-6  # of μ: keeps JJᵀ + (μ s)² I positive definite where rows are redundant


class Linearized(NamedTuple):
    """A residual (m,) and its Jacobian (m, n)."""

    residual: Array
    jacobian: Array


class Descent(NamedTuple, Generic[P]):
    """Where a descent ended.

    Attributes:
        place: The best place found.
        residual: The residual there.
        iterations: Steps tried.
    """

    place: P
    residual: Array
    iterations: int

    @property
    def error(self) -> float:
        """The residual's largest entry."""
        return float(np.abs(self.residual).max(initial=0.0))


def levenberg_marquardt(
    start: P, linearize: Callable[[P], Linearized], move: Callable[[P, Array], P | None], tolerance: float
) -> Descent[P]:
    """Solve r = 0 by steps min ‖r + J Δ‖² + (μ s)²‖Δ‖², s the root mean square of J's singular values.

    The damping μ follows the residual; no step is longer than 0.3. Ended at |r| ≤ tolerance, where steps no longer
    help, or where 20 of them gain less than a fifth.

    Args:
        start: Where to begin.
        linearize: r and J at a place.
        move: The place a step leads to, ``None`` where there is none (the step is then shortened).
        tolerance: Largest |r| of a solution.
    """
    place, damping = start, 1e-2
    here = linearize(start)
    best, earlier, iteration = float(here.residual @ here.residual), np.inf, 0
    for iteration in range(_MOST_ITERATIONS):
        if np.abs(here.residual).max(initial=0.0) <= tolerance:
            break
        if iteration % _PATIENCE == 0:
            if best > 0.8 * earlier:
                break
            earlier = best
        step = _damped_step(here, damping)
        trial = move(place, step) if np.isfinite(step).all() else None
        there = None if trial is None else linearize(trial)
        now = np.inf if there is None else float(there.residual @ there.residual)
        if trial is not None and there is not None and now < best:
            settled = now > 0.999999 * best and float(np.linalg.norm(step)) < 1e-9
            place, here, best, damping = trial, there, now, max(damping * 0.2, _LEAST_DAMPING)
            if settled:
                break
        elif damping > 1e8:
            break
        else:
            damping = damping * 8.0
    return Descent(place, here.residual, iteration)


def _damped_step(here: Linearized, damping: float) -> Array:
    """−Jᵀ (JJᵀ + (μ s)² I)⁻¹ r by Cholesky, no longer than the largest step; NaN where rounding forbids it.

    Written so it is a combination of J's rows: rounding does not move the place along directions that change nothing.
    """
    jacobian = here.jacobian
    rows, columns = jacobian.shape
    size = float(np.linalg.norm(jacobian))
    if size == 0.0:
        return np.zeros(columns)
    gram = jacobian @ jacobian.T
    gram.flat[:: rows + 1] += (damping * size) ** 2 / min(rows, columns)
    _, weights, failed = lapack.dposv(gram, here.residual)
    if failed:
        return np.full(columns, np.nan)
    step = -(jacobian.T @ weights)
    length = float(np.linalg.norm(step))
    return np.asarray(step if length <= _LARGEST_STEP else step * (_LARGEST_STEP / length))
