"""What is asked of a box of task space besides Theorem K: limits, motors that can hold and move the mechanism, dexterity.

Setting. A box of `boxes` in the task space of `task_space`: θ(δ) = θ_c + Dδ + Eζ*(δ), |δ| ≤ h, |ζ*| ≤ R, with weights w
and κ of Theorem K. Let F ≥ |f_δ(δ, ζ)| componentwise on the tube, f = ÃΦ(θ_c + Dδ + Eζ).

**Theorem D.** With a = |E|w and t_j = max_i (F_ij/w_i)/(1 − κ), |θ_δ(δ) − D| ≤ a tᵀ everywhere in the box.

*Proof.* f(δ, ζ*(δ)) = 0 gives f_ζ ζ*_δ = −f_δ. As ‖I − f_ζ‖ ≤ κ in the norm ‖ζ‖ = max |ζ_i|/w_i, ‖f_ζ⁻¹‖ ≤ 1/(1 − κ), so
the columns of ζ*_δ have norms of at most t_j, and θ_δ = D + Eζ*_δ. ∎

**Motors.** Let q_d be coordinates of θ that motors drive and K = ∂q_d/∂x their rows of θ_δ. As Φ_θ is nonsingular the
mechanism's velocities are those of θ_δ ẋ, so the motors determine them, that is ψ_q′ is nonsingular for q = q_d, exactly
where K has full column rank. With a matrix G ≈ K_c⁺ it has, if (|I − GK_c| + |G|a tᵀ)v < v for some v > 0: the matrix
bounds |I − GK|, so that GK is nonsingular. The dexterity 1/κ(J) of J = ∂x/∂q_d is that of K; by Weyl's inequality it is
at least (σ_min(K_c) − e)/(σ_max(K_c) + e), e = ‖a‖‖t‖ ≥ ‖K − K_c‖₂. Turns count times a length.

**Limits.** |θ − θ_c| ≤ |D|h + |E|R.

F needs no bounds of its own: those of Theorem K for a matrix E′ give Z′ ≥ |I − Ãφ_θE′| over whatever tube is put in as
parameters. With D's columns in E′, the tube |δ| ≤ h, |ζ| ≤ R as parameters and R′ = 0, the entries of Z′ off the diagonal
bound those of f_δ; two placings of the columns give them all.
"""

from __future__ import annotations

import numpy as np

from ccpin.arrays import Array, Mask, apply
from ccpin.domain.boxes import SLACK, Boxes, Demands, Problem, bounds_of

_ROUNDING = 1e-12


def meets(problem: Problem, boxes: Boxes) -> Mask:
    """Which of B proved boxes are proved to meet the problem's demands as well, of shape (B,)."""
    demands = problem.demands
    if demands is None or not len(boxes.kappa):
        return np.ones(len(boxes.kappa), dtype=np.bool_)
    low, high = reach(problem, boxes)
    within = np.all((low >= demands.lower) & (high <= demands.upper), axis=1)
    rows = np.flatnonzero(within)
    if rows.size and demands.driven.size:
        within[rows] = dexterity(problem, boxes.take(rows)) >= max(demands.dexterity, np.nextafter(0.0, 1.0))
    return np.asarray(within)


def reach(problem: Problem, boxes: Boxes) -> tuple[Array, Array]:
    """Bounds of θ over proved boxes, of shape (B, n′) each."""
    spread = apply(np.abs(boxes.directions), boxes.half)
    spread[:, problem.system.dependent] += apply(np.abs(boxes.modes), boxes.radius)
    spread = spread * SLACK + _ROUNDING * (1.0 + np.abs(boxes.centre))
    return boxes.centre - spread, boxes.centre + spread


def dexterity(problem: Problem, boxes: Boxes) -> Array:
    """A lower bound of 1/κ(J) over proved boxes, of shape (B,); 0 where the motors are not proved to hold it.

    It is at least the smallest positive number wherever ψ_q′ is proved to be nonsingular.
    """
    demands = problem.demands
    assert demands is not None
    with np.errstate(all="ignore"):
        slope, across, along = _slopes(problem, boxes, demands)
        inverse = np.linalg.pinv(slope)
        gain = apply(np.abs(inverse), across)
        vector = gain / gain.max(axis=1, keepdims=True) + 1e-3
        left = np.abs(np.eye(slope.shape[2]) - inverse @ slope) + _ROUNDING
        image = apply(left, vector) + gain * np.sum(along * vector, axis=1, keepdims=True)
        regular = np.all(image * SLACK < vector, axis=1)
        error = np.linalg.norm(across, axis=1) * np.linalg.norm(along, axis=1) * SLACK
        sizes = np.linalg.svd(slope, compute_uv=False)
        error = error + _ROUNDING * sizes[:, 0]
        bound = (sizes[:, -1] - error) / (sizes[:, 0] + error) / SLACK
    return np.where(regular, np.maximum(bound, np.nextafter(0.0, 1.0)), 0.0)


def _slopes(problem: Problem, boxes: Boxes, demands: Demands) -> tuple[Array, Array, Array]:
    """K_c (B, k, n), a (B, k) and t (B, n) of Theorem D, turns counted times a length."""
    system = problem.system
    spread = np.zeros((len(boxes.kappa), system.n_free))
    spread[:, system.dependent] = apply(np.abs(boxes.modes), boxes.weight)
    norms = np.max(_first(problem, boxes) / boxes.weight[:, :, None], axis=1)
    along = SLACK * norms / (1.0 - boxes.kappa[:, None]) / demands.units
    return boxes.directions[:, demands.driven] / demands.units, SLACK * spread[:, demands.driven], along


def _first(problem: Problem, boxes: Boxes) -> Array:
    """F ≥ |f_δ| on the boxes' tubes, of shape (B, m, n)."""
    system = problem.system
    count, n, m = len(boxes.kappa), system.n, system.m
    modes = np.zeros((count, system.n_free, m))
    modes[:, system.dependent] = boxes.modes
    tube = boxes._replace(
        directions=np.concatenate([boxes.directions, modes], axis=2),
        half=np.concatenate([boxes.half, boxes.radius * SLACK], axis=1),
        radius=np.zeros((count, m)),
    )
    found = np.full((count, m, n), np.inf)
    for shift in (0, 1):
        places = (np.arange(n) + shift) % m
        columns = np.zeros((count, system.n_free, m))
        columns[:, :, places] = boxes.directions
        bounds = bounds_of(problem, tube, columns)
        for j, place in enumerate(places):
            image = bounds.contraction(tube.radius, np.broadcast_to(np.eye(m)[place], (count, m)))
            bound = image.matrix[:, :, place] + image.rest
            bound[:, place] = np.inf
            found[:, :, j] = np.minimum(found[:, :, j], bound)
    return found * SLACK
