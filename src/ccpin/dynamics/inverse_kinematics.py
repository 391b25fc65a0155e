"""Inverse kinematics of a closed chain: q with a link's point at a target, without leaving the assembly mode."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, numbers
from ccpin.description.model import skewness
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.dynamics.state import Near, State
from ccpin.errors import ConvergenceError, InvalidInputError, SingularConfigurationError, UnreachableTargetError
from ccpin.kinematics.least_squares import Linearized, levenberg_marquardt
from ccpin.kinematics.points import LinkPoint, rotation_error

TOLERANCE = 1e-11  # of the gap to the target, m and rad
_FAR = 0.1  # of half the way round the largest loop: a target left by more is out of reach, not missed
_NEXT_TO_SINGULAR = 1e-4  # of rcond: the loops are what stopped the approach


class Solution(NamedTuple):
    """A solved inverse kinematics problem.

    Attributes:
        q: Independent coordinates, of shape (model.nq,).
        q_free: q′ = σ(q), of shape (nq,).
        error: What is left between point and target: the largest entry in metres and radians.
        iterations: Newton steps tried.
    """

    q: Array
    q_free: Array
    error: float
    iterations: int


class _Target(NamedTuple):
    position: Array
    rotation: Array | None

    def error(self, pose: Array) -> Array:
        """What leads from the point to the target: metres, then radians, in world axes."""
        gap = self.position - pose[:3, 3]
        return gap if self.rotation is None else np.concatenate([gap, rotation_error(pose[:3, :3], self.rotation)])


def solve(model: ReducedModel, point: LinkPoint, target: ArrayLike, near: Near = None) -> Solution:
    """Find q with the point at the target.

    Damped Newton (Levenberg–Marquardt) on q, the residual being the gap to the target at σ(q) and its derivative
    −J ρ. Every trial goes through σ from the configuration before it, so the assembly mode is that of `near`; a
    step on which σ is blocked is shortened like one that does not help. Arguments and errors as for
    `ccpin.dynamics.end_effector.EndEffector.solve`.
    """
    wanted = _checked(target)
    rows = 3 if wanted.rotation is None else 6

    def linearize(state: State) -> Linearized:
        gap = wanted.error(point.pose(state.q_free))
        return Linearized(-gap, (point.jacobian(state.q_free) @ state.rho)[:rows])

    found = levenberg_marquardt(_start(model, near), linearize, _moved, TOLERANCE)
    if found.error > TOLERANCE:
        raise _unreachable(wanted, found.place, -found.residual)
    return Solution(found.place.q, found.place.q_free, found.error, found.iterations)


def _checked(target: ArrayLike) -> _Target:
    """Read a target.

    Raises:
        InvalidInputError: It is neither a position nor a pose.
    """
    array = numbers(target, "target")
    if not np.isfinite(array).all():
        raise InvalidInputError("the target has entries that are not finite")
    if array.shape == (3,):
        return _Target(array, None)
    if array.shape != (4, 4):
        raise InvalidInputError(f"the target has shape {array.shape}; it must be a position (3,) or a pose (4, 4)")
    if skewness(array[:3, :3]) > 1e-6:
        raise InvalidInputError("the target's upper left 3×3 block is not a rotation matrix")
    return _Target(array[:3, 3], array[:3, :3])


def _start(model: ReducedModel, near: Near) -> State:
    if isinstance(near, State):
        return model.at(near)
    configuration = model.mechanism.q_reference if near is None else near
    return model.at(model.alpha(configuration), configuration)


def _moved(here: State, step: Array) -> State | None:
    try:
        return here.model.at(here.model.coordinates.integrate(here.q, step), here)
    except (ConvergenceError, SingularConfigurationError):
        return None


def _unreachable(target: _Target, here: State, error: Array) -> UnreachableTargetError:
    distance = float(np.linalg.norm(error[:3]))
    angle = float(np.linalg.norm(error[3:]))
    turned = f" and {np.degrees(angle):.4g}° of turning" if target.rotation is not None else ""
    shown = (target.position, target.position - error[:3], here.q)
    wanted, came, q = (np.array2string(array, precision=6, suppress_small=True) for array in shown)
    stopped = (
        "the loops are next to a singular configuration or the end of their workspace there"
        if here.rcond < _NEXT_TO_SINGULAR
        else "the loops are not singular there, but no step brought the point much nearer"
    )
    if distance > _FAR * 0.5 * here.model.parametrization.constraints.extent:
        told = (
            f"the target at {wanted} m is farther than the mechanism reaches on the way it went: the point stopped at "
            f"{came} m, {distance:.4g} m{turned} short, at q = {q}; {stopped}"
        )
        advice = ""
    else:
        told = (
            f"the target at {wanted} m was not reached on this branch: the nearest the iteration came, {came} m, "
            f"leaves {distance:.4g} m{turned}, at q = {q}; {stopped}"
        )
        advice = "; pass near= closer to it, or on the other branch"
    return UnreachableTargetError(
        f"{told} (reciprocal condition number of ψ_q′ {here.rcond:.1e}); the mechanism moves in {here.model.n} "
        f"direction{'s' if here.model.n != 1 else ''}{advice}",
        q=here.q,
        q_free=here.q_free,
        distance=distance,
        angle=angle,
    )
