"""The same mechanism in other independent coordinates: those that measure its motion best at a configuration.

ψ_q′ is singular where φ_q′ loses rank, and there the mechanism is singular, or where the independent coordinates do not
measure its motion, and there others do. Which others is a strong rank-revealing factorisation (M. Gu and S. C.
Eisenstat, Efficient algorithms for computing a strong rank-revealing QR factorization, SIAM J. Sci. Comput. 17, 1996):

Let N (n′, n) have the velocities that φ_q′ allows as its columns, N_I the rows of n components I, and X = N N_I⁻¹,
which is ρ for those coordinates. As long as some |X_ij| > f > 1, taking component i into I in place of the j-th
multiplies |det N_I| by |X_ij|, and |det N_I| ≤ 1 where N's columns are orthonormal. So this ends, and then

    |X_ij| ≤ f and ‖X‖₂ ≤ √(1 + f² n (n′ − n)) at every configuration at which φ_q′ has its rank.

As ψ_q′⁻¹ = [(1 − X α_q′) φ_q′⁺, X], no singularity is left but those of φ_q′. Lengths count in extents of the largest
loop; a component of a joint with several freedoms counts as the coordinate it is (`kinematics.coordinates`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from ccpin.arrays import Array
from ccpin.kinematics.coordinates import IndependentCoordinates, component_names
from ccpin.mechanism.mechanism import Mechanism
from ccpin.mechanism.motion.independence import MotionSpace, all_components, complete_independent, components_of, merged

LEVERAGE = 2.0
"""f: no joint moves faster than this per unit of an independent coordinate's rate, where coordinates are chosen."""


class Measure:
    """How well a mechanism's independent coordinates measure its motion.

    Attributes:
        rows: What makes velocities of the free system comparable, of shape (n′,): 1 of turns, 1/extent of slides.
        columns: Likewise for the independent velocities, of shape (n,).
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self._coordinates = mechanism.parametrization().coordinates
        per_metre = 1.0 / mechanism.constraints().extent
        slides = [slide for joint in mechanism.tree.joints for slide in joint.kind.slides]
        own = [slide for part in self._coordinates.parts for slide in part.slides]
        self.rows = np.where(np.array(slides, dtype=bool), per_metre, 1.0)
        self.columns = np.where(np.array(own, dtype=bool), per_metre, 1.0)

    def numbers(self) -> dict[str, list[float]]:
        """The weights as the compiled core takes them."""
        return {"rows": self.rows.tolist(), "columns": self.columns.tolist()}

    def leverage(self, rho: Array) -> float:
        """The largest |X_ij|: how fast any joint moves per unit of an independent coordinate's rate."""
        return float((np.abs(rho) * self.rows[:, None] / self.columns).max(initial=0.0))

    def turned(self, q_free: Array) -> float:
        """How far, in radians, ball joints whose single components are independent are from their charts' centres."""
        return self._coordinates.turned(q_free)


def best_independent(mechanism: Mechanism, q_free: Array, rho: Array) -> tuple[str, ...]:
    """The joints and components that measure the motion best at a configuration, as the theorem above has it.

    Args:
        mechanism: The mechanism.
        q_free: The configuration, closed, of shape (nq,).
        rho: ρ there in coordinates that are not singular, of shape (n′, n).
    """
    tree = mechanism.tree
    names = tuple(component_names(tree))
    every = IndependentCoordinates(tree, names, q_free)
    allowed = Measure(mechanism).rows[:, None] * (every.jacobian(q_free) @ rho)
    joints = tuple(tree.split(name)[0] for name in names)
    plain = tuple(tree.joint(joint).kind.unit != 4 for joint in joints)
    motion = MotionSpace(names, joints, tuple(range(len(names))), np.linalg.qr(allowed)[0], plain)
    components = all_components([motion])
    chosen = components_of(components, complete_independent([motion], (), ()))
    rows = _swapped(motion.basis, [names.index(name) for name in chosen])
    return merged(components, [names[row] for row in sorted(rows)])


def _swapped(basis: Array, rows: list[int]) -> list[int]:
    """Rows I with |X_ij| ≤ f for X = N N_I⁻¹, by swaps from rows that are independent."""
    while True:
        X = lu_solve(lu_factor(basis[rows].T), basis.T).T
        X[rows] = 0.0
        i, j = np.unravel_index(int(np.argmax(np.abs(X))), X.shape)
        if not rows or abs(X[i, j]) <= LEVERAGE:
            return rows
        rows[int(j)] = int(i)


def with_independent(mechanism: Mechanism, independent: tuple[str, ...], q_free: Array) -> Mechanism:
    """The mechanism with other independent coordinates, and a configuration as its reference and its charts' centre.

    Its motors are the same; where one drives a component of a joint, so that S is not constant, it has none.
    """
    motors = IndependentCoordinates(mechanism.tree, mechanism.actuated, mechanism.q_reference)
    actuated = mechanism.actuated if motors.constant else ()
    return replace(mechanism, independent=independent, actuated=actuated, q_reference=q_free)
