"""Rigorous bounds of the potential V∘σ and of its Hessian ∂g/∂q over certified boxes: Lemma H.

`ccpin/proof/theorems/gravity.md` states and proves it; its names L, μ, W, Δ_L and η are used here, and `_variation`
assembles its bound of |∂g/∂q − H| term by term.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, apply, cross
from ccpin.proof.chains import Chain, ChainStack, gather, stack_chains
from ccpin.proof.equations import Problem, derivatives
from ccpin.proof.newton import Boxes
from ccpin.proof.reach_bounds import chain_reach
from ccpin.proof.rounding import SLACK, UNIT_ROUNDOFF, widened
from ccpin.proof.tips import move

_ROUNDING = 1e-12  # of V at a centre and its level: covers their difference's rounding
_SHARPENING = 6  # passes, each of which leaves a bound: more cost time, fewer sharpness


class GravityBounds(NamedTuple):
    """V∘σ and ∂g/∂q over B boxes, for every |δ| ≤ h.

    |V(σ(q_c + δ)) − value − gradient·δ − ½ δᵀ hessian δ| ≤ remainder (J), and |∂g/∂q − hessian| ≤ variation entrywise.

    Attributes:
        value: Of shape (B,).
        gradient: Of shape (B, n).
        hessian: Of shape (B, n, n).
        remainder: Of shape (B,).
        variation: Symmetric, nonnegative, of shape (B, n, n).
        turning: A bound of |ρ − D| entrywise, by chart rates, of shape (B, n′, n).
    """

    value: Array
    gradient: Array
    hessian: Array
    remainder: Array
    variation: Array
    turning: Array

    @property
    def norm(self) -> Array:
        """β ≥ ‖∂g/∂q‖₂ over each box, of shape (B,)."""
        centre = np.abs(np.linalg.eigvalsh(self.hessian)).max(axis=1)
        return np.asarray((centre + self.spread) * SLACK)

    @property
    def spread(self) -> Array:
        """ε ≥ ‖∂g/∂q − hessian‖₂ over each box, of shape (B,)."""
        return np.asarray(self.variation.sum(axis=2).max(axis=1) * SLACK)


class _Expansion(NamedTuple):
    """The rows (f, L) = (Ãφ, V′ + μf) about the centre; L is the last of the m + 1 rows.

    Attributes:
        boxes: Theorem N's data, h widened.
        modes: E, of shape (B, n′, m).
        moves: W, of shape (B, n′).
        value: L_c, of shape (B,).
        slope: First derivatives, of shape (B, m + 1, n′).
        curvature: Second derivatives, of shape (B, m + 1, n′, n′).
        drift: Bounds of their change over the tube, of shape (B, m + 1, n′, n′).
        margin: Rounding of the entries of the derivatives, of shape (B, m + 1).
    """

    boxes: Boxes
    modes: Array
    moves: Array
    value: Array
    slope: Array
    curvature: Array
    drift: Array
    margin: Array


def gravity_bounds(problem: Problem, potential: Potential, boxes: Boxes) -> GravityBounds:
    """Bounds over proved boxes of q-space (D's independent rows are I).

    They are for V′ + Σ t (V − level) of its spread, |t| ≤ 1: the value, gradient and Hessian are V′'s; what the others
    add is in the remainder and the variation.
    """
    found = _bounds_of_one(problem, potential, boxes)
    half = widened(boxes.centre[:, problem.system.independent], boxes.half)
    for part, level in zip(potential.spread, potential.levels, strict=True):
        own = _bounds_of_one(problem, part, boxes)
        bent = np.abs(own.hessian)
        rise = np.abs(own.value - level) + _ROUNDING * (np.abs(own.value) + abs(level)) + own.remainder
        rise += _dot(np.abs(own.gradient), half) + 0.5 * _dot(half, apply(bent, half))
        remainder, variation = (found.remainder + rise) * SLACK, (found.variation + bent + own.variation) * SLACK
        found = found._replace(remainder=remainder, variation=variation)
    return found


def _bounds_of_one(problem: Problem, potential: Potential, boxes: Boxes) -> GravityBounds:
    """Lemma H for one potential."""
    box = _expand(problem, potential, boxes)
    rows = np.swapaxes(boxes.directions, 1, 2)
    pull, eta = _slopes(box)
    return GravityBounds(
        value=box.value,
        gradient=apply(rows, box.slope[:, -1]),
        hessian=_symmetric(rows @ box.curvature[:, -1] @ boxes.directions),
        remainder=_remainder(box) * SLACK,
        variation=_symmetric(_variation(box, pull, eta)) * SLACK,
        turning=np.abs(box.modes) @ eta * SLACK,
    )


def _expand(problem: Problem, potential: Potential, boxes: Boxes) -> _Expansion:
    system, theta = problem.system, boxes.centre
    count, m, n_free = len(theta), system.m, system.n_free
    half = widened(theta[:, system.independent], boxes.half)
    modes = np.zeros((count, n_free, m))
    modes[:, system.dependent] = boxes.modes
    moves = apply(np.abs(boxes.directions), half) + apply(np.abs(modes), boxes.radius)
    reach = np.abs(theta) + moves
    closure, gravity = derivatives(problem, theta), potential_values(potential, theta)
    mu = -apply(np.swapaxes(modes, 1, 2), gravity.gradient)
    weights = np.concatenate([boxes.preconditioner, mu[:, None] @ boxes.preconditioner], axis=1)
    slope = weights @ closure.jacobian
    slope[:, m] += gravity.gradient
    curvature = (weights @ closure.hessian.reshape(count, m, -1)).reshape(count, m + 1, n_free, n_free)
    curvature[:, m] += gravity.hessian
    closure_rounding = system.rounding * system.magnitude(reach)
    margin = np.abs(boxes.preconditioner).sum(axis=2) * closure_rounding[:, None]
    lagrangian_margin = potential.rounding * potential.magnitude(reach) + np.sum(np.abs(mu) * margin, axis=1)
    gains = np.swapaxes(np.linalg.norm(weights[:, None] @ problem.stack.weights, axis=3), 1, 2)
    closing = _drift(problem.stack, closure.arms, theta, moves, closure_rounding)
    arm_rounding = potential.rounding * (1.0 + potential.lengths.max() + reach.sum(axis=1))
    falling = _drift(potential.stack, gravity.arms, theta, moves, arm_rounding)
    drift = (gains @ closing.reshape(count, len(problem.stack.tips), n_free * n_free)).reshape(curvature.shape)
    drift[:, m] += np.sum(potential.forces[:, None, None] * falling, axis=1)
    return _Expansion(
        boxes=boxes._replace(half=half),
        modes=modes,
        moves=moves,
        value=gravity.value + apply(weights, closure.phi)[:, m],
        slope=slope,
        curvature=curvature,
        drift=drift,
        margin=np.column_stack([margin, lagrangian_margin]),
    )


def _drift(stack: ChainStack, arms: Array, theta: Array, moves: Array, rounding: Array) -> Array:
    """Bound |∂²x_c(θ) − ∂²x_c(θ_c)| ≤ Σ_i |∂³x_c|_ijl W_i of the tips over the tube, of shape (B, C, n′, n′)."""
    k = stack.joints.shape[1]
    box = gather(stack, moves)
    reach = chain_reach(stack, arms, gather(stack, np.abs(theta)), box, rounding)
    first, second, deepest = np.sort(np.indices((k, k, k)), axis=0)
    turning = stack.turning[:, first] * stack.turning[:, second]
    contracted = np.sum(reach[:, :, deepest] * turning * box[..., None, None], axis=2)
    return spread(stack, contracted)


def _remainder(box: _Expansion) -> Array:
    half, radius, moves = box.boxes.half, box.boxes.radius, box.moves
    along = np.swapaxes(box.modes, 1, 2)
    bent = box.curvature[:, -1] @ box.modes
    total = _dot(np.abs(apply(along, box.slope[:, -1])), radius)
    total += _dot(half, apply(np.abs(np.swapaxes(box.boxes.directions, 1, 2) @ bent), radius))
    total += 0.5 * _dot(radius, apply(np.abs(along @ bent), radius))
    total += _dot(moves, apply(box.drift[:, -1], moves)) / 6.0
    return np.asarray(total + box.margin[:, -1] * (1.0 + moves.sum(axis=1)) ** 2)


def _slopes(box: _Expansion) -> tuple[Array, Array]:
    """|(f, L)_ζ − (I, 0)| on the tube, of shape (B, m + 1, m), and η ≥ |f_ζ⁻¹f_δ|, of shape (B, m, n)."""
    m = box.modes.shape[2]
    pull = _slope_bound(box, box.modes, np.eye(m + 1, m))
    return pull, _inverse_bound(box.boxes, pull[:, :m], _slope_bound(box, box.boxes.directions, 0.0)[:, :m])


def _variation(box: _Expansion, pull: Array, eta: Array) -> Array:
    """The entrywise bound of ∂g/∂q − H, of shape (B, n, n), from what `_slopes` gives.

    With P = |D| + |E|η ≥ |ρ| it is, term by term, the cross terms of ρᵀL_θθ(θ_c)ρ, PᵀΔ_L P, and
    |L_ζ||ζ″|.
    """
    m = box.modes.shape[2]
    defect = pull[:, :m]
    change = _curvature_change(box, eta)
    still = np.swapaxes(box.boxes.directions, 1, 2)[:, None] @ box.curvature[:, :m] @ box.boxes.directions[:, None]
    second = _inverse_bound(box.boxes, defect, np.abs(still) + change[:, :m])
    return np.asarray(change[:, m] + np.sum(pull[:, m, :, None, None] * second, axis=1))


def _slope_bound(box: _Expansion, columns: Array, target: Array | float) -> Array:
    """|(f, L)_θ columns − target| over the tube, of shape (B, m + 1, ·), for columns (B, n′, ·)."""
    frame = np.concatenate([box.boxes.directions, box.modes], axis=2)[:, None]
    sizes = np.concatenate([box.boxes.half, box.boxes.radius], axis=1)
    change = np.abs(np.swapaxes(columns, 1, 2)[:, None] @ box.curvature @ frame) @ sizes[:, None, :, None]
    third = 0.5 * (np.swapaxes(np.abs(columns), 1, 2)[:, None] @ box.drift @ box.moves[:, None, :, None])
    size = (1.0 + box.moves.sum(axis=1))[:, None] * np.abs(columns).sum(axis=1)
    rounding = box.margin[:, :, None] * size[:, None]
    return np.asarray(np.abs(box.slope @ columns - target) + (change + third)[..., 0] + rounding)


def _curvature_change(box: _Expansion, eta: Array) -> Array:
    """|ρ_kᵀ(f, L)_θθ ρ_l − D_kᵀ(f, L)_θθ(θ_c)D_l| over the tube, of shape (B, m + 1, n, n)."""
    rows, along = np.swapaxes(box.boxes.directions, 1, 2)[:, None], np.swapaxes(box.modes, 1, 2)[:, None]
    slopes = (np.abs(box.boxes.directions) + np.abs(box.modes) @ eta)[:, None]
    eta = eta[:, None]
    bent = box.curvature @ box.modes[:, None]
    crossed = np.abs(rows @ bent) @ eta
    total = crossed + np.swapaxes(crossed, 2, 3) + np.swapaxes(eta, 2, 3) @ np.abs(along @ bent) @ eta
    return np.asarray(total + np.swapaxes(slopes, 2, 3) @ (box.drift + box.margin[:, :, None, None]) @ slopes)


def _inverse_bound(boxes: Boxes, defect: Array, x: Array) -> Array:
    """|f_ζ⁻¹ x| over the tube for |x| of shape (B, m, …), with Z = `defect` (B, m, m)."""
    shape = x.shape
    x = x.reshape(*shape[:2], -1)
    weight = boxes.weight[:, :, None]
    bound = np.max(x / weight, axis=1, keepdims=True) * weight / (1.0 - boxes.kappa[:, None, None])
    for _ in range(_SHARPENING):
        bound = np.minimum(bound, (x + defect @ bound) * SLACK)
    return np.asarray(bound.reshape(shape))


def _dot(u: Array, v: Array) -> Array:
    return np.asarray(np.sum(u * v, axis=1))


def _symmetric(matrices: Array) -> Array:
    return np.asarray(0.5 * (matrices + np.swapaxes(matrices, 1, 2)))


# The free system's potential V′(θ) = −Σ_b m_b γ·c_b(θ) + Σ_j ½ k_j (θ_j − θ₀_j)² of bodies and springs, the bodies as
# chains, to be evaluated and bounded over many boxes at once.


class Potential(NamedTuple):
    """V′ of a mechanism in scalar coordinates θ (n′,).

    Attributes:
        stack: One chain of weights (1, 3) a body with mass, side by side.
        forces: |m_b γ| of the chains (N), of shape (C,).
        lengths: Σ |translations| + |tip| of the chains (m), of shape (C,).
        stiffness, rest: k and θ₀ of the springs, of shape (n′,); they have no third derivatives.
        rounding: |computed − exact| ≤ rounding · `magnitude` for V′ and every entry of its derivatives.
        spread: Potentials without springs: any multiples t of these, |t| ≤ 1, may be added to V′.
        levels: What is taken off each of them, J.
    """

    stack: ChainStack
    forces: Array
    lengths: Array
    stiffness: Array
    rest: Array
    rounding: float
    spread: tuple[Potential, ...] = ()
    levels: tuple[float, ...] = ()

    def magnitude(self, theta: Array) -> Array:
        """Σ_b |m_b γ| · (an upper bound of the chain's length), slides included, at θ (B, n′), of shape (B,).

        A spring adds k (1 + |θ| + |θ₀|)², more than any of its terms.
        """
        slides = np.sum(gather(self.stack, np.abs(theta)) * self.stack.sliding, axis=2)
        springs = (1.0 + np.abs(theta) + np.abs(self.rest)) ** 2 @ self.stiffness
        return np.asarray((slides + self.lengths) @ self.forces + springs)


class PotentialValues(NamedTuple):
    """V′ (B,), g′ = V′_θ (B, n′), V′_θθ (B, n′, n′) and |∂c_b/∂θ_j| of the chains (B, C, k)."""

    value: Array
    gradient: Array
    hessian: Array
    arms: Array


class BodiesAndSprings(NamedTuple):
    """What V′ is made of: a chain of weights (1, 3) a body, and k and θ₀ of the springs, of shape (n′,).

    The spread is chains that a robot of a set may have besides, all of a tuple t times, |t| ≤ 1.
    """

    chains: tuple[Chain, ...]
    stiffness: Array
    rest: Array
    spread: tuple[tuple[Chain, ...], ...] = ()


def potential_of(masses: BodiesAndSprings, theta: Array | None = None) -> Potential:
    """V′ of bodies and springs; what is spread is counted from θ, of shape (n′,)."""
    found, none = _potential(masses), np.zeros(len(masses.stiffness))
    spread = tuple(_potential(BodiesAndSprings(chains, none, none)) for chains in masses.spread)
    levels = tuple(float(potential_values(part, theta[None]).value[0]) for part in spread) if theta is not None else ()
    return found._replace(spread=spread, levels=levels)


def _potential(masses: BodiesAndSprings) -> Potential:
    chains, size = masses.chains, len(masses.stiffness)
    depth = max(len(chain.joints) for chain in chains)
    lengths = [np.linalg.norm(c.translations, axis=1).sum() + np.linalg.norm(c.tip) for c in chains]
    return Potential(
        stack=stack_chains(chains, size, 1),
        forces=np.array([np.linalg.norm(chain.weights) for chain in chains]),
        lengths=np.array(lengths),
        stiffness=masses.stiffness,
        rest=masses.rest,
        rounding=(128.0 * (depth + 2) + 4.0 * size) * UNIT_ROUNDOFF,
    )


def potential_values(potential: Potential, theta: Array) -> PotentialValues:
    """V′ and its first two derivatives at θ (B, n′); ∂²c/∂θ_i∂θ_j = a_i × b_j for i ≤ j along a chain."""
    stack, count = potential.stack, len(theta)
    motion = move(stack, theta)
    weights = stack.weights[:, 0]
    flat = np.sum(motion.b * weights[:, None], axis=3).reshape(count, -1)
    turned = cross(np.broadcast_to(weights[:, None], motion.a.shape), motion.a)
    second = np.triu(turned @ np.swapaxes(motion.b, 2, 3))
    second = second + np.swapaxes(np.triu(second, 1), 2, 3)
    stretch = theta - potential.rest
    return PotentialValues(
        value=np.sum(motion.x * weights, axis=(1, 2)) + 0.5 * stretch**2 @ potential.stiffness,
        gradient=flat @ stack.placement + potential.stiffness * stretch,
        hessian=np.sum(spread(stack, second), axis=1) + np.diag(potential.stiffness),
        arms=np.linalg.norm(motion.b, axis=3),
    )


def spread(stack: ChainStack, matrices: Array) -> Array:
    """Matrices by chain and joints (B, C, k, k) as matrices over θ, of shape (B, C, n′, n′)."""
    chains, k = stack.joints.shape
    place = stack.placement.reshape(chains, k, stack.placement.shape[1])
    return np.asarray(np.swapaxes(place, 1, 2) @ matrices @ place)
