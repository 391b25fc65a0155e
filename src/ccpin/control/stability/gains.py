"""Gains for a set point: K_p above ‖∂g/∂q‖ (Theorem 3), K_v for a damping ratio of the linearised loop.

About q_d the closed loop D q̈ + C q̇ + g(q) = K_p q̃ − K_v q̇ + g(q_d) is, to first order in x = q − q_d,

    D ẍ + K_v ẋ + (K_p + ∂g/∂q) x = 0        (D and ∂g/∂q at q_d; C q̇ is of second order).

With Φ the modes, (K_p + ∂g/∂q)Φ = DΦΩ², ΦᵀDΦ = I, the gain K_v = Φ⁻ᵀ 2ζΩ Φ⁻¹ turns it into z̈ + 2ζω_i ż + ω_i² z = 0
in x = Φz: every mode has the damping ratio ζ.
"""

from __future__ import annotations

import heapq
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg

from ccpin.arrays import Array, number, positive
from ccpin.control.laws import PDSimpleGravity
from ccpin.control.stability.cells import CellStore
from ccpin.control.stability.set_point_cells import cells_of_atlas
from ccpin.control.stability.well import checked_region, sample_region
from ccpin.domain.atlas.atlas import Atlas
from ccpin.domain.atlas.cells import Corners
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.errors import InvalidInputError, SingularConfigurationError
from ccpin.mechanism.mechanism import Mechanism

_CELLS = 2000
_ACCURACY = 0.05


class Gains(NamedTuple):
    """Suggested gains.

    Attributes:
        K_p: margin · β · I, N m/rad or N/m, of shape (n, n).
        K_v: Symmetric positive definite, N m s/rad or N s/m, of shape (n, n).
        beta: sup ‖∂g/∂q‖₂ over the domain.
        beta_seen: The largest ‖∂g/∂q‖₂ among the points looked at: β is between it and `beta`.
        frequencies: ω of the linearised loop's modes in rad/s, ascending, of shape (n,).
        rigorous: Whether β is an upper bound (else the largest of samples).
    """

    K_p: Array
    K_v: Array
    beta: float
    beta_seen: float
    frequencies: Array
    rigorous: bool


def suggest_gains(
    model: ReducedModel | Mechanism,
    q_d: ArrayLike,
    domain: Atlas | Corners,
    *,
    margin: float = 1.5,
    damping: float = 0.7,
    guess: ArrayLike | None = None,
) -> Gains:
    """The smallest K_p with a margin over β on a domain, and K_v for a damping ratio at q_d.

    Args:
        model: The reduced model, or a mechanism.
        q_d: The set point, of shape (n,).
        domain: An atlas (β is proved, to 5 % where 2000 cells suffice), or a region (lower, upper) over which β is
            sampled.
        margin: K_p over β, above 1.
        damping: ζ of every mode, above 0.
        guess: Chooses the assembly mode of σ(q_d).

    Raises:
        InvalidInputError: A bad margin or damping, q_d outside of the domain, or gravity does not act there (β = 0).
        SingularConfigurationError: β is not found with the work allowed: the atlas ends too near a singularity.
        UnreachableError: σ does not exist on all of a region.
    """
    number(margin, "margin", "a number above 1", 1.0), positive(damping, "damping")
    model = model_of(model)
    ones = np.ones(model.n)
    law = PDSimpleGravity(model, q_d, ones, ones, guess)
    if not isinstance(domain, Atlas):
        lower, upper = checked_region(model, domain, law.q_d)
        largest = float(sample_region(model, lower, upper, law.q_free_d).norm.max())
        slope = SlopeBound(largest, largest)
    else:
        slope = gravity_slope_over(cells_of_atlas(law, domain))
    beta = slope.bound
    if not beta > 1e-12:
        raise InvalidInputError("gravity has no slope on the domain (β = 0): any positive K_p satisfies Theorem 3")
    stiffness = margin * beta * np.eye(model.n)
    mass = model.terms(law.q_d, np.zeros(model.n), law.q_free_d).D
    total = stiffness + model.gravity_derivative(law.q_d, law.q_free_d)
    squares, modes = linalg.eigh(0.5 * (total + total.T), mass)
    frequencies = np.sqrt(squares)
    pulled = mass @ modes
    return Gains(
        K_p=stiffness,
        K_v=pulled @ np.diag(2.0 * damping * frequencies) @ pulled.T,
        beta=beta,
        beta_seen=slope.seen,
        frequencies=frequencies,
        rigorous=isinstance(domain, Atlas),
    )


class SlopeBound(NamedTuple):
    """The largest ‖∂g/∂q‖₂ seen at the centres of cells, and a bound of it over the cells."""

    seen: float
    bound: float


def gravity_slope_over(store: CellStore, cells: int = _CELLS) -> SlopeBound:
    """A bound of sup ‖∂g/∂q‖₂ over proved cells: the one with the largest is halved until its centre bears it out.

    Raises:
        SingularConfigurationError: With the number of cells allowed the bound is still more than twice what was seen.
    """
    heap = [(-cell.well.beta, k) for k, cell in enumerate(store.cells) if cell.well is not None]
    heapq.heapify(heap)
    seen, bound = 0.0, 0.0
    while heap:
        bound, number = -heap[0][0], heap[0][1]
        seen = max(seen, float(np.linalg.norm(store.well(number).hessian - store.law.K_p, 2)))
        if bound <= (1.0 + _ACCURACY) * seen + 1e-12 or store.proved >= cells:
            break
        children = store.halve_proved(number)
        if children is None:
            break
        heapq.heappop(heap)
        for child in children:
            heapq.heappush(heap, (-store.well(child).beta, child))
    if bound > 2.0 * seen + 1e-12:
        raise SingularConfigurationError(
            f"‖∂g/∂q‖ could not be bounded usefully with {cells} cells (it is between {seen:.4g} and {bound:.4g}); the "
            "atlas is large, or ends near a singularity: pass a smaller one",
            q_free=store.law.q_free_d,
            rcond=0.0,
        )
    return SlopeBound(seen, bound)
