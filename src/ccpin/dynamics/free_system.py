"""The free system Σ′: D′q̈′ + C′q̇′ + g′ (2). The only caller of CRBA, RNEA and the Coriolis algorithm."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array
from ccpin.kinematics.tree import Tree


class Energy(NamedTuple):
    """Kinetic and potential energy in joules."""

    kinetic: float
    potential: float


class InverseDynamicsSlopes(NamedTuple):
    """τ′ = D′q̈′ + C′q̇′ + g′ and its derivatives, those by q′ along tangent steps (right increments).

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
    """D′, C′, g′ and energies of the tree cut open; rotor inertias are part of D′.

    Holds scratch memory: one instance a thread.
    """

    def __init__(self, tree: Tree) -> None:
        self.model = tree.model
        self._data = tree.model.createData()

    def on_manifold(self, q_free: Array) -> bool:
        """Whether the circles and quaternions of q′ are of unit length (to 1e-6)."""
        return self.model.nq == self.model.nv or bool(pin.isNormalized(self.model, q_free, 1e-6))

    def mass_matrix(self, q_free: Array) -> Array:
        """D′(q′), symmetric, of shape (n′, n′)."""
        return np.asarray(pin.crba(self.model, self._data, q_free))

    def coriolis_matrix(self, q_free: Array, v_free: Array) -> Array:
        """C′(q′, q̇′) from Christoffel symbols, of shape (n′, n′): d/dt D′ − 2C′ is skew symmetric."""
        return np.array(pin.computeCoriolisMatrix(self.model, self._data, q_free, v_free))

    def gravity(self, q_free: Array) -> Array:
        """g′(q′), of shape (n′,)."""
        return np.array(pin.computeGeneralizedGravity(self.model, self._data, q_free))

    def inverse_dynamics(self, q_free: Array, v_free: Array, a_free: Array) -> Array:
        """D′ q̈′ + C′ q̇′ + g′ (2), of shape (n′,)."""
        return np.array(pin.rnea(self.model, self._data, q_free, v_free, a_free))

    def inverse_dynamics_derivatives(self, q_free: Array, v_free: Array, a_free: Array) -> InverseDynamicsSlopes:
        """τ′ = D′q̈′ + C′q̇′ + g′ (2) with ∂τ′/∂q′, ∂τ′/∂q̇′ and ∂τ′/∂q̈′ = D′, exact."""
        slopes = pin.computeRNEADerivatives(self.model, self._data, q_free, v_free, a_free)
        return InverseDynamicsSlopes(np.array(self._data.tau), *(np.array(slope) for slope in slopes))

    def gravity_derivative(self, q_free: Array) -> Array:
        """∂g′/∂q′ along tangent steps of q′, of shape (n′, n′)."""
        return np.array(pin.computeGeneralizedGravityDerivatives(self.model, self._data, q_free))

    def energy(self, q_free: Array, v_free: Array) -> Energy:
        """½ q̇′ᵀ D′ q̇′ and the potential V with ∂V/∂q′ = g′ (zero at the world origin)."""
        kinetic = 0.5 * v_free @ self.mass_matrix(q_free) @ v_free  # Pinocchio's own leaves rotor inertias out
        potential = pin.computePotentialEnergy(self.model, self._data, q_free)
        return Energy(float(kinetic), float(potential))
