"""Linear models of a reduced model about a state, for linear control and stability analysis."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ccpin.arrays import Array, matrix, vector
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.dynamics.state import Near, State
from ccpin.dynamics.wrenches import Wrenches
from ccpin.kinematics.coordinates import IndependentCoordinates
from ccpin.mechanism.mechanism import Mechanism


class Linearization(NamedTuple):
    """ẋ = A x + B δu for x = (δq, δq̇), the first-order departure from a motion through the state.

    Attributes:
        A: Of shape (2n, 2n).
        B: Of shape (2n, motors).
    """

    A: Array
    B: Array

    def closed_loop(self, du_dq: ArrayLike, du_dv: ArrayLike) -> Array:
        """A + B [∂u/∂q ∂u/∂q̇], of shape (2n, 2n): the linear model under a law u(q, q̇).

        Args:
            du_dq: ∂u/∂q at the same state, along tangent steps of q, of shape (motors, n); −K_p for PD control.
            du_dv: ∂u/∂q̇, of shape (motors, n); −K_v for PD control.

        Raises:
            InvalidInputError: Wrong shapes, or entries that are not finite.
        """
        states, motors = self.B.shape
        shape = (motors, states // 2)
        gains = [matrix(du_dq, "du_dq", shape), matrix(du_dv, "du_dv", shape)]
        return np.asarray(self.A + self.B @ np.hstack(gains))


def linearize(
    model: ReducedModel | Mechanism,
    q: ArrayLike | State,
    u: ArrayLike,
    v: ArrayLike | None = None,
    near: Near = None,
    wrenches: Wrenches | None = None,
) -> Linearization:
    """A = [−ad_q̇ I; ∂q̈/∂q ∂q̈/∂q̇], B = [0; ∂q̈/∂u] at the state (q, v) and effort u, exact.

    At an equilibrium (v = 0, g = ρᵀSᵀu) this is the linear time-invariant model about it; elsewhere it is the model
    along the motion at the instant it passes through (q, v). δq is a tangent step of q; ad_q̇ is zero but for
    spherical, planar and floating independent joints that move.

    Args:
        model: The reduced model, or a mechanism.
        q: Independent coordinates, of shape (model.nq,), or a State.
        u: Actuated joints' efforts, of shape (motors,).
        v: Velocity, of shape (n,); default at rest.
        near: Chooses the assembly mode, as `near` of `ReducedModel.at`.
        wrenches: On links, constant in world axes, as for `State.forward_dynamics`.

    Raises:
        CcpinError: As `ReducedModel.forward_dynamics_derivatives` does.
    """
    state = model_of(model).at(q, near)
    n = state.model.n
    velocity = np.zeros(n) if v is None else vector(v, "v", n)
    slopes = state.forward_dynamics_derivatives(velocity, u, wrenches)
    top = np.hstack([-_bracket(state.model.coordinates, velocity), np.eye(n)])
    return Linearization(
        A=np.vstack([top, np.hstack([slopes.da_dq, slopes.da_dv])]),
        B=np.vstack([np.zeros((n, slopes.da_du.shape[1])), slopes.da_du]),
    )


def _bracket(coordinates: IndependentCoordinates, v: Array) -> Array:
    """ad_v, of shape (n, n): how fast a fixed tangent step turns as seen from the moving frames."""
    bracket = np.zeros((coordinates.n, coordinates.n))
    for part in coordinates.parts:
        if part.whole is not None:
            action, entries = pin.Motion(part.whole.twist(v[part.v])).action, part.whole.entries
            bracket[part.v, part.v] = action[np.ix_(entries, entries)]
    return bracket
