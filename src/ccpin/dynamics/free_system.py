"""The free system Σ′: D′q̈′ + C′q̇′ + B′q̇′ + g′ (2). The only caller of CRBA, RNEA and the Coriolis algorithm.

B′ = diag(b) ≥ 0 are the joints' dampers, constant; g′ is the gradient of the whole potential, gravity's and the joints'
springs'. So all that the paper builds on g = ∂V/∂q holds with springs as it does without.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array
from ccpin.dynamics.springs import Springs
from ccpin.kinematics.scratch import Scratch
from ccpin.kinematics.tree import Tree
from ccpin.mechanism.physics import joint_physics


class Energy(NamedTuple):
    """Kinetic and potential energy (of gravity and springs) in joules."""

    kinetic: float
    potential: float


class InverseDynamicsSlopes(NamedTuple):
    """τ′ = D′q̈′ + C′q̇′ + B′q̇′ + g′ and its derivatives, those by q′ along tangent steps (right increments).

    Attributes:
        tau: Of shape (n′,).
        dtau_dq, dtau_dv: Of shape (n′, n′).
        dtau_da: D′, of shape (n′, n′).
    """

    tau: Array
    dtau_dq: Array
    dtau_dv: Array
    dtau_da: Array


class FreeSystem:
    """D′, C′, B′, g′ and energies of the tree cut open; rotor inertias are part of D′. Threads may share one.

    Args:
        tree: The free system; its Pinocchio model is copied.
        gravity: In world axes, m/s², of shape (3,); default the tree's.

    Attributes:
        model: The copy, with that gravity; not to be changed.
        scratch: Scratch memory for it.
        damping: b, the diagonal of B′, of shape (n′,).
        springs: The joints' springs.
    """

    def __init__(self, tree: Tree, gravity: Array | None = None) -> None:
        self.model = pin.Model(tree.model)
        if gravity is not None:
            self.model.gravity = pin.Motion(gravity, np.zeros(3))
        self.scratch = Scratch(self.model)
        self.damping, self.springs = joint_physics(tree).damping, Springs(tree)
        self._damped = bool(self.damping.any())

    def mass_matrix(self, q_free: Array) -> Array:
        """D′(q′), symmetric, of shape (n′, n′)."""
        return self._computed(pin.crba, q_free)

    def coriolis_matrix(self, q_free: Array, v_free: Array) -> Array:
        """C′(q′, q̇′) from Christoffel symbols, of shape (n′, n′): d/dt D′ − 2C′ is skew symmetric."""
        return self._computed(pin.computeCoriolisMatrix, q_free, v_free)

    def gravity(self, q_free: Array) -> Array:
        """g′(q′) = ∂V/∂q′ of gravity and springs, of shape (n′,)."""
        gravity = self.weight(q_free)
        return gravity + self.springs.force(q_free) if self.springs else gravity

    def weight(self, q_free: Array) -> Array:
        """What gravity alone adds to g′, of shape (n′,)."""
        return self._computed(pin.computeGeneralizedGravity, q_free)

    def inverse_dynamics(self, q_free: Array, v_free: Array, a_free: Array) -> Array:
        """D′ q̈′ + C′ q̇′ + B′ q̇′ + g′ (2), of shape (n′,)."""
        force = self._computed(pin.rnea, q_free, v_free, a_free)
        if self._damped:
            force += self.damping * v_free
        return force + self.springs.force(q_free) if self.springs else force

    def inverse_dynamics_derivatives(self, q_free: Array, v_free: Array, a_free: Array) -> InverseDynamicsSlopes:
        """τ′ = D′q̈′ + C′q̇′ + B′q̇′ + g′ (2) with ∂τ′/∂q′, ∂τ′/∂q̇′ and ∂τ′/∂q̈′ = D′, exact."""
        with self.scratch.lent() as data:
            slopes = pin.computeRNEADerivatives(self.model, data, q_free, v_free, a_free)
            tau, (by_q, by_v, by_a) = np.array(data.tau), map(np.array, slopes)
        if self._damped:
            tau, by_v = tau + self.damping * v_free, by_v + np.diag(self.damping)
        if self.springs:
            tau, by_q = tau + self.springs.force(q_free), by_q + self.springs.derivative(q_free)
        return InverseDynamicsSlopes(tau, by_q, by_v, by_a)

    def gravity_derivative(self, q_free: Array) -> Array:
        """∂g′/∂q′ along tangent steps of q′, of shape (n′, n′)."""
        derivative = self._computed(pin.computeGeneralizedGravityDerivatives, q_free)
        return derivative + self.springs.derivative(q_free) if self.springs else derivative

    def energy(self, q_free: Array, v_free: Array) -> Energy:
        """½ q̇′ᵀ D′ q̇′ and the potential V with ∂V/∂q′ = g′ (zero at the world origin and slack springs)."""
        kinetic = 0.5 * v_free @ self.mass_matrix(q_free) @ v_free  # Pinocchio's own leaves rotor inertias out
        potential = float(self._computed(pin.computePotentialEnergy, q_free))
        return Energy(float(kinetic), potential + self.springs.energy(q_free) if self.springs else potential)

    def _computed(self, algorithm: Callable[..., Any], *state: Array) -> Array:
        """What one of Pinocchio's algorithms returns, copied out of its scratch memory."""
        with self.scratch.lent() as data:
            return np.array(algorithm(self.model, data, *state))
