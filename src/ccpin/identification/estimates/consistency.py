"""Constants that bodies can have: the nearest to an estimate whose pseudo-inertias are positive.

A body's ten numbers belong to some distribution of mass if and only if its pseudo-inertia

    P = [[½ tr(I) 1 − I, h], [hᵀ, m]]

is positive semidefinite (P. Wensing, S. Kim and J.-J. Slotine, Linear matrix inequalities for physically consistent
inertial parameter identification, IEEE Robotics and Automation Letters 3, 2018). Of all such π, with friction, dampers,
springs and armatures at least zero, the one is taken that makes

    (β(π) − β̂)ᵀ C⁻¹ (β(π) − β̂) + ‖S (π − π₀)‖² / (d ‖S π₀‖)²

least, C the covariance of β̂ and π₀ what the model states, d how far it may be off; a semidefinite programme (CVXPY,
Clarabel).
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np

from ccpin.arrays import Array, instance, positive
from ccpin.dynamics.changed_constants import bodies
from ccpin.dynamics.parameters import BODY, INERTIAL, DynamicParameters
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.errors import ConvergenceError, InvalidInputError
from ccpin.identification.estimates.estimate import Estimate
from ccpin.mechanism.mechanism import Mechanism

_LEAST = 1e-6  # of what is stated: no body that has mass is without


def consistent(model: ReducedModel | Mechanism, estimate: Estimate, *, doubt: float = 10.0) -> DynamicParameters:
    """The physically consistent constants nearest to an estimate.

    Args:
        model: The mechanism as it is described.
        estimate: What logs tell of it.
        doubt: By which share of itself what the model states may be off (d above): it decides only where logs do not.

    Raises:
        InvalidInputError: CVXPY or Clarabel is not installed, or the estimate is of other constants.
        ConvergenceError: The solver did not converge.
    """
    model = model_of(model)
    stated = model.parameters
    if instance(estimate, "estimate", Estimate).parameters.names != stated.names:
        raise InvalidInputError("the estimate is of a mechanism with other constants")
    try:
        cp: Any = import_module("cvxpy")
    except ImportError as error:
        raise InvalidInputError(f"consistent constants need cvxpy ({error}); pip install 'ccpin[cvxpy]'") from None
    free = np.isin(np.arange(len(stated)), estimate.effects.columns)
    scale = np.zeros(len(stated))
    scale[free] = estimate.effects.scale
    scale /= positive(doubt, "doubt") * max(float(np.linalg.norm(scale * stated.values)), np.finfo(float).tiny)
    unit = _units(stated)
    x = cp.Variable(len(stated))
    pi = cp.multiply(unit, x)
    whitened = np.linalg.inv(np.linalg.cholesky(estimate.covariance))
    misfit = (whitened @ estimate.multiples * unit) @ x - whitened @ estimate.values
    objective = cp.sum_squares(misfit) + cp.sum_squares(cp.multiply(scale * unit, x) - scale * stated.values)
    holds: list[Any] = [pi[~free] == stated.values[~free]] if not free.all() else []
    holds += [
        _pseudo_inertia(cp, pi[body]) >> _floor(stated.values[body]) for body in bodies(stated) if free[body].all()
    ]
    at_least_zero = [k for k, kind in enumerate(stated.kinds) if kind not in (*INERTIAL, "offset") and free[k]]
    holds += [x[at_least_zero] >= 0.0] if at_least_zero else []
    problem = cp.Problem(cp.Minimize(objective), holds)
    try:
        problem.solve(solver=cp.CLARABEL)
    except cp.error.SolverError as error:
        raise ConvergenceError(f"no consistent constants were found: {error}") from error
    if problem.status != "optimal":
        raise ConvergenceError(f"no consistent constants were found: the solver says {problem.status}")
    return DynamicParameters(stated.names, stated.kinds, stated.units, unit * np.asarray(x.value))


def _units(parameters: DynamicParameters) -> Array:
    """What a constant is measured in: its stated size, or the usual one of its kind where that is small."""
    usual = {
        kind: float(np.abs(parameters.values[parameters.of(kind)]).max(initial=0.0)) for kind in set(parameters.kinds)
    }
    moments = max(usual.get(kind, 0.0) for kind in INERTIAL[4:])
    firsts = max(usual.get(kind, 0.0) for kind in INERTIAL[1:4])
    usual |= dict.fromkeys(INERTIAL[4:], moments) | dict.fromkeys(INERTIAL[1:4], firsts)
    sizes = np.array([usual[kind] or 1.0 for kind in parameters.kinds])
    return np.maximum(np.abs(parameters.values), 1e-2 * sizes)


def _pseudo_inertia(cp: Any, body: Any) -> Any:
    """P of a body's ten numbers, (4, 4)."""
    m, hx, hy, hz, xx, xy, yy, xz, yz, zz = (body[k] for k in range(BODY))
    half = 0.5 * (xx + yy + zz)
    rows = [[half - xx, -xy, -xz, hx], [-xy, half - yy, -yz, hy], [-xz, -yz, half - zz, hz], [hx, hy, hz, m]]
    return cp.bmat(rows)


def _floor(stated: Array) -> Array:
    """A least pseudo-inertia of a body that is stated to have mass: a millionth of its own."""
    spin = max(float(stated[4] + stated[6] + stated[9]) / 2.0, 0.0)
    return _LEAST * np.diag([spin, spin, spin, max(float(stated[0]), 0.0)])
