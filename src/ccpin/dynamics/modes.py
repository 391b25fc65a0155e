"""Assembly modes: the configurations q′ that share one q, one for each branch of σ."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ccpin.arrays import Array, whole
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.errors import CcpinError
from ccpin.kinematics.checked import checked_q
from ccpin.kinematics.levenberg_marquardt import Linearized
from ccpin.kinematics.linear import factorize
from ccpin.kinematics.parametrization import SINGULAR_RCOND, Parametrization
from ccpin.kinematics.points import joint_poses
from ccpin.mechanism.closing import solve
from ccpin.mechanism.mechanism import Mechanism

_SAME = 1e-6


class AssemblyMode(NamedTuple):
    """One branch of σ over a given q.

    Attributes:
        q_free: The configuration, of shape (nq,).
        sign: Sign of det ψ_q′ (0 where redundant rows make ψ_q′ tall); constant along a branch.
        rcond: Reciprocal condition number of ψ_q′: 0 at a singular configuration.
        is_reference: Whether σ(q) from the mechanism's reference gives this one.
    """

    q_free: Array
    sign: int
    rcond: float
    is_reference: bool


class AssemblyModes(NamedTuple):
    """The modes found, the reference's first, then the best conditioned.

    They are sampled, not proved complete: the search ends once `patience` starts in a row add nothing.

    Attributes:
        modes: The branches of σ over q.
        starts: The number of starts they were found from.
        singular: How many starts ended at singular configurations, which belong to no branch.
    """

    modes: tuple[AssemblyMode, ...]
    starts: int
    singular: int


def assembly_modes(
    model: ReducedModel | Mechanism, q: ArrayLike, *, patience: int = 60, limit: int = 2000
) -> AssemblyModes:
    """Enumerate the σ branches over q from deterministic starts spread over the free system's configurations.

    Args:
        model: The reduced model, or a mechanism.
        q: Independent coordinates, of shape (model.nq,).
        patience: End after this many starts in a row that find nothing new.
        limit: Largest number of starts.

    Raises:
        InvalidInputError: q has the wrong shape or is not finite.
    """
    model, patience, limit = model_of(model), whole(patience, "patience"), whole(limit, "limit")
    target = checked_q(model.coordinates, q)
    parametrization = model.parametrization
    generator = np.random.default_rng(20003)
    found: list[AssemblyMode] = []
    idle = starts = singular = 0
    reference = None
    with suppress(CcpinError):
        reference = model.sigma(target)
    while idle < patience and starts < limit:
        start = _start(model, target, starts, generator)
        starts, idle = starts + 1, idle + 1
        attempt = solve(model.mechanism.tree.model, _equations(parametrization, target), start)
        if not attempt.closed or not parametrization.constraints.aligned(attempt.q_free):
            continue
        factor = factorize(parametrization.psi_jacobian(attempt.q_free))
        if factor.rcond < SINGULAR_RCOND**0.5:
            singular += 1
        elif all(_distance(model, attempt.q_free, known.q_free) > _SAME for known in found):
            q_free = _unwound(model, attempt.q_free)
            same = reference is not None and _distance(model, q_free, reference) < _SAME
            found.append(AssemblyMode(q_free, factor.sign, factor.rcond, same))
            idle = 0
    found.sort(key=lambda mode: (not mode.is_reference, -mode.rcond))
    return AssemblyModes(tuple(found), starts, singular)


def _equations(parametrization: Parametrization, q: Array) -> Callable[[Array], Linearized]:
    """ψ̄(q′, q) = ψ(q′) − [0; q] (11) and ψ_q′."""
    constraints, coordinates = parametrization.constraints, parametrization.coordinates

    def equations(q_free: Array) -> Linearized:
        value = constraints.value(q_free)
        gap = -coordinates.difference(coordinates.alpha(q_free), q)
        jacobian = np.vstack([value.jacobian, coordinates.jacobian(q_free)])
        return Linearized(np.concatenate([value.phi, gap]), jacobian)

    return equations


def _start(model: ReducedModel, q: Array, number: int, generator: np.random.Generator) -> Array:
    """The reference first, then configurations spread over circles, spheres and ranges, with q put in."""
    pin_model, reference = model.mechanism.tree.model, model.mechanism.q_reference
    start = reference
    if number > 0:
        spread = np.full(pin_model.nv, np.pi)
        for joint in model.mechanism.tree.joints:
            if joint.kind.sliding and joint.kind.nq == 1:
                i = joint.q.start
                low, high = pin_model.lowerPositionLimit[i], pin_model.upperPositionLimit[i]
                bounded = np.isfinite(low) and np.isfinite(high) and high > low
                spread[joint.v] = 0.5 * (high - low) if bounded else 1.0
        start = pin.integrate(pin_model, reference, spread * generator.uniform(-1.0, 1.0, pin_model.nv))
    return model.coordinates.embed(q, start)


def _unwound(model: ReducedModel, q_free: Array) -> Array:
    """Turn dependent revolute joints by whole turns to lie nearest the reference."""
    mechanism, unwound = model.mechanism, q_free.copy()
    for joint in mechanism.tree.joints:
        if joint.kind.angle and joint.name not in mechanism.independent and not mechanism.couplings:
            i = joint.q.start
            unwound[i] -= 2 * np.pi * np.round((q_free[i] - mechanism.q_reference[i]) / (2 * np.pi))
    return unwound


def _distance(model: ReducedModel, a: Array, b: Array) -> float:
    """Largest displacement between the joints' placements: turns of a revolute joint by 2π do not count."""
    scratch = model.free_system.scratch
    return float(np.abs(joint_poses(scratch, a) - joint_poses(scratch, b)).max())
