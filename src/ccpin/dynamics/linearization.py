"""Linear models of a reduced model about a state, for linear control and stability analysis."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ccpin.arrays import Array
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import InvalidInputError
from ccpin.kinematics.coordinates import IndependentCoordinates


class Linearization(NamedTuple):
    """ẋ = A x + B δu for x = (δq, δq̇), the first-order departure from a motion through the state.

    Attributes:
        A: Of shape (2n, 2n).
        B: Of shape (2n, motors).
    """

    A: Array
    B: Array


def linearize(
    model: ReducedModel, q: ArrayLike, u: ArrayLike, v: ArrayLike | None = None, guess: ArrayLike | None = None
) -> Linearization:
    """A = [−ad_q̇ I; ∂q̈/∂q ∂q̈/∂q̇], B = [0; ∂q̈/∂u] at the state (q, v) and effort u, exact.

    At an equilibrium (v = 0, g = ρᵀSᵀu) this is the linear time-invariant model about it; elsewhere it is the model
    along the motion at the instant it passes through (q, v). δq is a tangent step of q; ad_q̇ is zero but for
    spherical, planar and floating independent joints that move.

    Args:
        model: The reduced model.
        q: Independent coordinates, of shape (model.nq,).
        u: Actuated joints' efforts, of shape (motors,).
        v: Velocity, of shape (n,); default at rest.
        guess: As for `ReducedModel.sigma`.

    Raises:
        CcpinError: As `ReducedModel.forward_dynamics_derivatives` does.
    """
    velocity = np.zeros(model.n) if v is None else model.checked(v, "v", model.n)
    slopes = model.forward_dynamics_derivatives(q, velocity, u, guess)
    n = model.n
    top = np.hstack([-_bracket(model.coordinates, velocity), np.eye(n)])
    return Linearization(
        A=np.vstack([top, np.hstack([slopes.da_dq, slopes.da_dv])]),
        B=np.vstack([np.zeros((n, slopes.da_du.shape[1])), slopes.da_du]),
    )


def closed_loop_derivative(linearization: Linearization, du_dq: ArrayLike, du_dv: ArrayLike) -> Array:
    """A + B [∂u/∂q ∂u/∂q̇], of shape (2n, 2n): the linear model under a law u(q, q̇).

    Args:
        linearization: About the state at which the law's derivatives were taken.
        du_dq: ∂u/∂q along tangent steps of q, of shape (motors, n); −K_p for PD control.
        du_dv: ∂u/∂q̇, of shape (motors, n); −K_v for PD control.

    Raises:
        InvalidInputError: Wrong shapes.
    """
    states, motors = linearization.B.shape
    gains = []
    for name, value in (("du_dq", du_dq), ("du_dv", du_dv)):
        gain = np.asarray(value, dtype=np.float64)
        if gain.shape != (motors, states // 2):
            raise InvalidInputError(f"{name} has shape {gain.shape}; it must be {(motors, states // 2)}")
        gains.append(gain)
    return np.asarray(linearization.A + linearization.B @ np.hstack(gains))


def _bracket(coordinates: IndependentCoordinates, v: Array) -> Array:
    """ad_v, of shape (n, n): how fast a fixed tangent step turns as seen from the moving frames."""
    bracket = np.zeros((coordinates.n, coordinates.n))
    for part in coordinates.parts:
        if part.whole is not None:
            action, entries = pin.Motion(part.whole.twist(v[part.v])).action, part.whole.entries
            bracket[part.v, part.v] = action[np.ix_(entries, entries)]
    return bracket
