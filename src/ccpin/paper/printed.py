"""The paper's case study as it is printed: Table II and the closed forms (31)–(40), with NumPy alone.

Vectors of the free system are in the paper's order q′ = (q1, q2, q3, q4), q = (q1, q2); x points right, y up. What must
be read otherwise than it is printed says so. Nothing of ccpin enters, so that the page's differences mean something.
"""

from __future__ import annotations

import numpy as np

from ccpin.arrays import Array

BASE = 0.3048
"""c, the distance of joints 1 and 2 (m)."""
TABLE_II = np.array(
    [
        [0.2451, 0.2794, 0.1466, 2.779e-3],
        [0.2352, 0.2794, 0.1410, 2.607e-3],
        [0.2611, 0.3048, 0.1581, 3.476e-3],
        [0.2611, 0.3048, 0.1467, 3.476e-3],
    ]
)
"""Links 1–4 by row: m (kg), a (m), l_c (m), I about the centre of mass (kg m²)."""
TABLE_II.setflags(write=False)
M, A, LC, INERTIA = TABLE_II.T
MOTOR = 3.3263e-3
"""What motor and transmission add on joints 1 and 2 (kg m²)."""
GRAVITY = 9.81  # m/s²


def phi(q: Array) -> Array:
    """φ (31): tip E of link 3 minus tip F of link 4, of shape (2,); takes complex q′ too."""
    q1, q2, q3, q4 = q
    return np.array(
        [
            A[0] * np.cos(q1) + A[2] * np.cos(q1 + q3) - BASE - A[1] * np.cos(q2) - A[3] * np.cos(q2 + q4),
            A[0] * np.sin(q1) + A[2] * np.sin(q1 + q3) - A[1] * np.sin(q2) - A[3] * np.sin(q2 + q4),
        ]
    )


def psi_jacobian(q: Array) -> Array:
    """ψ_q′ (33), of shape (4, 4)."""
    q1, q2, q3, q4 = q
    s13, c13, s24, c24 = np.sin(q1 + q3), np.cos(q1 + q3), np.sin(q2 + q4), np.cos(q2 + q4)
    return np.array(
        [
            [-A[0] * np.sin(q1) - A[2] * s13, A[1] * np.sin(q2) + A[3] * s24, -A[2] * s13, A[3] * s24],
            [A[0] * np.cos(q1) + A[2] * c13, -A[1] * np.cos(q2) - A[3] * c24, A[2] * c13, -A[3] * c24],
            [1.0, 0.0, 0.0, 0.0],
            [0.0, 1.0, 0.0, 0.0],
        ]
    )


def rho(q: Array) -> Array:
    """ρ = ψ_q′⁻¹ [0; I] (14), of shape (4, 2)."""
    return np.asarray(np.linalg.solve(psi_jacobian(q), np.eye(4)[:, 2:]))


def mass_matrix(q: Array) -> Array:
    """D′ (36), the motors' inertia on its first two diagonal entries, of shape (4, 4)."""
    d = np.zeros((4, 4))
    for i, k in ((0, 2), (1, 3)):
        coupling = A[i] * LC[k] * np.cos(q[k])
        d[i, i] = M[i] * LC[i] ** 2 + M[k] * (A[i] ** 2 + LC[k] ** 2 + 2.0 * coupling) + INERTIA[i] + INERTIA[k] + MOTOR
        d[i, k] = d[k, i] = M[k] * (LC[k] ** 2 + coupling) + INERTIA[k]
        d[k, k] = M[k] * LC[k] ** 2 + INERTIA[k]
    return d


def coriolis_matrix(q: Array, v: Array) -> Array:
    """C′ (37), of shape (4, 4)."""
    c = np.zeros((4, 4))
    for i, k in ((0, 2), (1, 3)):
        h = -M[k] * A[i] * LC[k] * np.sin(q[k])
        c[i, i], c[i, k], c[k, i] = h * v[k], h * (v[i] + v[k]), -h * v[i]
    return c


def gravity(q: Array) -> Array:
    """g′ (38), of shape (4,)."""
    force = np.zeros(4)
    for i, k in ((0, 2), (1, 3)):
        force[k] = M[k] * LC[k] * np.cos(q[i] + q[k])
        force[i] = (M[i] * LC[i] + M[k] * A[i]) * np.cos(q[i]) + force[k]
    return GRAVITY * force


def potential(q: Array) -> float:
    """V(q′) in joules, zero at the height of the base joints; its gradient is (38)."""
    height = 0.0
    for i, k in ((0, 2), (1, 3)):
        height += (M[i] * LC[i] + M[k] * A[i]) * np.sin(q[i]) + M[k] * LC[k] * np.sin(q[i] + q[k])
    return float(GRAVITY * height)


def arms(q: Array) -> tuple[Array, Array]:
    """Joint, elbow and tip of either arm in the plane (m), of shape (3, 2) each; the tips meet where φ = 0."""
    found = []
    for first, second, base in ((0, 2, 0.0), (1, 3, BASE)):
        turn = np.array([q[first], q[first] + q[second]])
        steps = A[[first, second], None] * np.column_stack([np.cos(turn), np.sin(turn)])
        found.append(np.cumsum(np.vstack([[base, 0.0], steps]), axis=0))
    return found[0], found[1]


def elbow_offset(q: Array) -> tuple[Array, Array]:
    """(λ, μ): from elbow 1 to elbow 2 (m), for q of shape (..., 2)."""
    q1, q2 = np.moveaxis(np.asarray(q), -1, 0)
    return A[1] * np.cos(q2) - A[0] * np.cos(q1) + BASE, A[1] * np.sin(q2) - A[0] * np.sin(q1)


def elbow_distance(q: Array) -> Array:
    """√(λ² + μ²) (m), of shape (...): σ exists on a branch where it lies strictly between 0 and a₃ + a₄."""
    return np.asarray(np.hypot(*elbow_offset(q)))


def sigma(q: Array, mode: int = 1, two_quadrants: bool = False) -> Array:
    """σ (39)–(40), of shape (4,), with sign sin(q1 + q3 − q2 − q4) = mode.

    Args:
        q: (q1, q2), of shape (2,).
        mode: +1: with elbow 1 left of elbow 2 the end effector hangs below them.
        two_quadrants: Read the arctangents of quotients as they are printed, not as four-quadrant ones.
    """
    lam, mu = elbow_offset(q)
    a, b, c = 2 * A[3] * lam, 2 * A[3] * mu, A[2] ** 2 - A[3] ** 2 - lam**2 - mu**2
    root = np.sqrt(a * a + b * b - c * c)
    angle = (lambda y, x: np.arctan(y / x)) if two_quadrants else np.arctan2
    candidates = []
    for sign in (1.0, -1.0):
        q4 = angle(b, a) + angle(sign * root, c) - q[1]
        q3 = angle(mu + A[3] * np.sin(q[1] + q4), lam + A[3] * np.cos(q[1] + q4)) - q[0]
        candidates.append(np.array([q[0], q[1], *(np.remainder([q3 + np.pi, q4 + np.pi], 2 * np.pi) - np.pi)]))
    return max(candidates, key=lambda one: mode * np.sin(fold(one)))


def fold(q: Array) -> float:
    """q1 + q3 − q2 − q4: the angle between links 3 and 4; singular where it is a multiple of π."""
    return float(q[0] + q[2] - q[1] - q[3])


def coincident_elbows() -> Array:
    """(q1, q2) = (56.944°, 123.056°) in radians, exact: both elbows above the middle of the base. Minus it too."""
    first = float(np.arccos(0.5 * BASE / A[0]))
    return np.array([first, np.pi - first])
