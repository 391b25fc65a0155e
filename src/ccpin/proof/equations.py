"""The equations φ(θ) = 0 of closures: their values, and what bounds of them are formed from."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, choice
from ccpin.errors import UnsupportedMechanismError
from ccpin.proof.bounds import chain_reach
from ccpin.proof.chains import ChainStack, ClosureSystem, first_order, gather, stack_chains
from ccpin.proof.phasors import Phasors, phasor_values, phasors_of

BoundsName = Literal["auto", "reach", "planar"]


class Requirements(NamedTuple):
    """What boxes are to meet besides Theorem K (`ccpin.proof.requirements`).

    Attributes:
        lower, upper: Limits of θ, of shape (n′,) each, ±∞ where there is none.
        driven: Indices in θ of the coordinates that motors drive; none: they are not looked at.
        units: What a unit of each parameter counts as where dexterity is measured: 1, or a length for turns, (n,).
        dexterity: The least 1/κ; 0: that the motors determine the motion is all that is asked.
    """

    lower: Array
    upper: Array
    driven: Indices
    units: Array
    dexterity: float


class Problem(NamedTuple):
    """What is to be proved, picklable.

    Attributes:
        system: The closures.
        stack: Their chains side by side.
        phasors: Their phasor form, where planar bounds are used.
        requirements: What is asked besides, if anything.
    """

    system: ClosureSystem
    stack: ChainStack
    phasors: Phasors | None
    requirements: Requirements | None = None


def problem_of(system: ClosureSystem, bounds: BoundsName = "auto") -> Problem:
    """Choose the bounds: planar where every chain is planar (``"auto"``), or as told.

    Raises:
        UnsupportedMechanismError: Planar bounds were asked for and the mechanism is not planar.
    """
    choice(bounds, "bounds", ("auto", "reach", "planar"))
    phasors = None if bounds == "reach" else phasors_of(system)
    if bounds == "planar" and phasors is None:
        raise UnsupportedMechanismError(
            "planar bounds need closures whose turning axes are parallel, with slides before the turns; "
            'use bounds="reach"'
        )
    return Problem(system, stack_chains(system.chains, system.n_free, system.m), phasors)


def closure_values(problem: Problem, theta: Array) -> tuple[Array, Array]:
    """φ (B, m) and φ_θ (B, m, n′) at θ (B, n′)."""
    if problem.phasors is not None:
        found = phasor_values(problem.phasors, theta)
        return found.phi, found.jacobian
    return first_order(problem.system, problem.stack, theta)[:2]


def third_bound(problem: Problem, theta: Array, arms: Array, box: Array) -> Array:
    """τ ≥ every third and fourth derivative of φ_i over |θ − θ₀| ≤ box (B, n′), of shape (B, m).

    τ_i = Σ_c ‖(B_c)_i‖ max_j ρ_cj with ρ of `chain_reach`, `arms` (B, C, k) being |∂x_c/∂θ_j| at θ₀ (B, n′).
    """
    system, stack = problem.system, problem.stack
    margin = system.rounding * system.magnitude(np.abs(theta) + box)
    reach = chain_reach(stack, arms, gather(stack, np.abs(theta)), gather(stack, box), margin)
    gains = np.swapaxes(np.linalg.norm(stack.weights, axis=2), 0, 1)
    return np.asarray(reach.max(axis=2, initial=0.0) @ gains.T)
