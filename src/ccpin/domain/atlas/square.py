"""One box about a configuration: the largest certified square, and how many Newton steps suffice in it.

**Newton steps.** Let Theorem N (`boxes`) hold for a box with radius R and weights w, and let e₀ = max R_i/w_i,
R₂ = R + e₀w, Z(R₂)w ≤ κ₂w with κ₂ < 1, and ‖f_ζ(δ, ζ) − f_ζ(δ, ζ′)‖ ≤ ω‖ζ − ζ′‖ on |ζ|, |ζ′| ≤ R₂ in the weighted
maximum norm ‖ζ‖ = max |ζ_i|/w_i. Put c = ω/(2(1 − κ₂)). If c e₀ < 1, Newton's method at fixed q, started at the
predictor θ_c + Dδ, converges to σ(q) for every |δ| ≤ h, and after k steps ‖ζ_k − ζ*‖ ≤ (c e₀)^(2ᵏ)/c.

*Proof.* ζ₀ = 0 and |ζ*| ≤ R, so e₀ bounds the first error. If ‖ζ_k − ζ*‖ ≤ e ≤ e₀ then |ζ_k| ≤ R₂, f_ζ(ζ_k) is
nonsingular with ‖f_ζ⁻¹‖ ≤ 1/(1 − κ₂), and the next error,
f_ζ(ζ_k)⁻¹ ∫₀¹ [f_ζ(ζ_k) − f_ζ(ζ_k + τ(ζ* − ζ_k))] dτ (ζ_k − ζ*), is at most ωe²/(2(1 − κ₂)) = ce². Newton's iterates do
not depend on Ã and V, so they are those of φ itself. ∎
"""

from __future__ import annotations

import numpy as np

from ccpin.arrays import Array, apply, positive
from ccpin.covering.claims import proved_boxes
from ccpin.covering.proposals.krawczyk import Tried, certify_boxes
from ccpin.domain.closures.seeds import seed_at_configuration
from ccpin.errors import ConvergenceError
from ccpin.mechanism.mechanism import HasMechanism, Mechanism
from ccpin.proof.equations import BoundsName, Problem
from ccpin.proof.newton import Boxes, bounds_of
from ccpin.proof.rounding import SLACK

_TRIES = 64  # widths a round
_SMALLEST, _LARGEST = 1e-9, 10.0  # rad, m


def kantorovich_radius(mechanism: Mechanism | HasMechanism, q_free: Array, bounds: BoundsName = "reach") -> float:
    """The half width of the largest square about α(q′) on which one box proves σ.

    For every q with max |q − α(q′)| ≤ r there is exactly one solution in a tube about the linear predictor, ψ_q′ is
    nonsingular on it and σ is smooth (Theorem N of `boxes`). Every half width tried and proved is a certificate
    for its whole square, so the search need not be complete to be sound.

    Args:
        mechanism: The mechanism, or its model.
        q_free: A closed configuration, of shape (nq,).
        bounds: ``"reach"`` (any tree), ``"planar"`` (sharper, planar loops only) or ``"auto"``.

    Returns:
        r in the units of q: radians, metres where a sliding joint is independent. 0.0 where not even 1e-9 is proved.

    Raises:
        InvalidInputError, SingularConfigurationError: The configuration cannot be closed, or is singular.
        UnsupportedMechanismError: The closures are of a kind that cannot be certified.
    """
    seed = seed_at_configuration(mechanism, q_free)
    return largest_square(seed.reading.bounded(bounds).problem, seed.theta)


def largest_square(problem: Problem, theta: Array) -> float:
    """See `kantorovich_radius`; θ (n′,) is the closed centre."""
    tried = np.geomspace(_SMALLEST, _LARGEST, _TRIES)
    best = 0.0
    for _ in range(3):
        proved = np.flatnonzero(_squares(problem, theta, tried).proved)
        if not proved.size:
            break
        last = int(proved[-1])
        best = max(best, float(tried[last]))
        if last + 1 == len(tried):
            break
        tried = np.linspace(tried[last], tried[last + 1], _TRIES)
    return best


def _squares(problem: Problem, theta: Array, widths: Array) -> Tried:
    n = problem.system.n
    centre = np.tile(theta, (len(widths), 1))
    tried = certify_boxes(problem, centre, np.repeat(widths[:, None], n, axis=1), np.eye(n))
    rows, proved = np.flatnonzero(tried.proved), np.zeros(len(widths), dtype=np.bool_)
    proved[rows] = proved_boxes(problem, tried.boxes.take(rows))[1]
    return Tried(tried.boxes, proved)


def newton_steps(
    mechanism: Mechanism | HasMechanism,
    q_free: Array,
    radius: float,
    accuracy: float = 1e-12,
    bounds: BoundsName = "auto",
) -> int:
    """How many Newton steps suffice for σ(q) from the predictor, for every q with max |q − α(q′)| ≤ radius.

    After that many steps in exact arithmetic every dependent coordinate is within `accuracy` of σ(q).

    Args:
        mechanism: The mechanism, or its model.
        q_free: A closed configuration, of shape (nq,), centre of the square.
        radius: Half width of the square (rad, or m for sliding joints).
        accuracy: The error allowed (rad or m).
        bounds: As for `kantorovich_radius`.

    Raises:
        InvalidInputError: Radius or accuracy is not positive.
        ConvergenceError: Newton's convergence is not guaranteed on so large a square.
        UnsupportedMechanismError: The closures are of a kind that cannot be certified.
    """
    radius, accuracy = positive(radius, "radius"), positive(accuracy, "accuracy")
    seed = seed_at_configuration(mechanism, q_free)
    problem = seed.reading.bounded(bounds).problem
    attempt = _squares(problem, seed.theta, np.array([radius]))
    steps = newton_bound(problem, attempt.boxes, accuracy) if attempt.proved[0] else np.array([np.inf])
    if not np.isfinite(steps[0]):
        raise ConvergenceError(
            f"a square of half width {radius:.6g} is too large to guarantee Newton's convergence from its linear "
            f"predictor; the largest on which one box proves σ is {largest_square(problem, seed.theta):.6g}"
        )
    return int(steps[0])


def newton_bound(problem: Problem, boxes: Boxes, accuracy: float) -> Array:
    """The number of Newton steps that suffices in each of B proved boxes, of shape (B,); inf where none is known."""
    with np.errstate(all="ignore"):
        bounds, weight = bounds_of(problem, boxes), boxes.weight
        start = np.max(boxes.radius / weight, axis=1)
        reach = boxes.radius + start[:, None] * weight
        kappa = np.max(bounds.contraction(reach).of(weight) / weight, axis=1) * SLACK
        omega = np.max(bounds.curvature(reach, weight) / weight, axis=1) * SLACK
        c = omega / (2.0 * (1.0 - kappa))
        unit = np.max(apply(np.abs(boxes.modes), weight), axis=1)
        target = np.minimum(accuracy / unit, start)
        steps = np.ceil(np.log2(np.log(c * target) / np.log(c * start)))
    sure = (kappa < 1.0) & (c * start * SLACK < 1.0)
    return np.where(sure, np.where(c * target > 0.0, np.maximum(steps, 0.0), 1.0), np.inf)
