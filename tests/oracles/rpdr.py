"""The Rice Planar Delta Robot: the paper's closed forms (31)-(40), with NumPy alone.

Vectors of the free system are in the paper's order q′ = (q1, q2, q3, q4); q = (q1, q2). The plane is the paper's
(x, y) with gravity along −y.
"""

import numpy as np

from .geometry import wrap

FREE = ("joint1", "joint2", "joint3", "joint4")  # the order of q′ here
C = 0.3048
A1, A2, A3, A4 = 0.2794, 0.2794, 0.3048, 0.3048
M1, M2, M3, M4 = 0.2451, 0.2352, 0.2611, 0.2611
LC1, LC2, LC3, LC4 = 0.1466, 0.1410, 0.1581, 0.1467
I1, I2, I3, I4 = 2.779e-3, 2.607e-3, 3.476e-3, 3.476e-3
MOTOR = 3.3263e-3
GRAVITY = 9.81


def elbow_offset(q):
    """(λ, μ): from elbow 1 to elbow 2."""
    q1, q2 = q
    return A2 * np.cos(q2) - A1 * np.cos(q1) + C, A2 * np.sin(q2) - A1 * np.sin(q1)


def phi(q_free):
    """φ (31): tip of link 3 minus tip of link 4."""
    q1, q2, q3, q4 = q_free
    return np.array(
        [
            A1 * np.cos(q1) + A3 * np.cos(q1 + q3) - C - A2 * np.cos(q2) - A4 * np.cos(q2 + q4),
            A1 * np.sin(q1) + A3 * np.sin(q1 + q3) - A2 * np.sin(q2) - A4 * np.sin(q2 + q4),
        ]
    )


def psi_jacobian(q_free):
    """ψ_q′ (33)."""
    q1, q2, q3, q4 = q_free
    s13, c13, s24, c24 = np.sin(q1 + q3), np.cos(q1 + q3), np.sin(q2 + q4), np.cos(q2 + q4)
    return np.array(
        [
            [-A1 * np.sin(q1) - A3 * s13, A2 * np.sin(q2) + A4 * s24, -A3 * s13, A4 * s24],
            [A1 * np.cos(q1) + A3 * c13, -A2 * np.cos(q2) - A4 * c24, A3 * c13, -A4 * c24],
            [1.0, 0.0, 0.0, 0.0],
            [0.0, 1.0, 0.0, 0.0],
        ]
    )


def psi_jacobian_rate(q_free, v_free):
    """ψ̇_q′, (33) differentiated by hand."""
    q1, q2, q3, q4 = q_free
    w1, w2, w13, w24 = v_free[0], v_free[1], v_free[0] + v_free[2], v_free[1] + v_free[3]
    s13, c13, s24, c24 = np.sin(q1 + q3), np.cos(q1 + q3), np.sin(q2 + q4), np.cos(q2 + q4)
    rate = np.zeros((4, 4))
    rate[0] = (
        -A1 * np.cos(q1) * w1 - A3 * c13 * w13,
        A2 * np.cos(q2) * w2 + A4 * c24 * w24,
        -A3 * c13 * w13,
        A4 * c24 * w24,
    )
    rate[1] = (
        -A1 * np.sin(q1) * w1 - A3 * s13 * w13,
        A2 * np.sin(q2) * w2 + A4 * s24 * w24,
        -A3 * s13 * w13,
        A4 * s24 * w24,
    )
    return rate


def rho(q_free):
    """ρ = ψ_q′⁻¹ [0; I] (14)."""
    return np.linalg.solve(psi_jacobian(q_free), np.vstack([np.zeros((2, 2)), np.eye(2)]))


def rho_dot(q_free, v):
    """ρ̇ = −ψ_q′⁻¹ ψ̇_q′ ρ (35) for q̇′ = ρ q̇."""
    r = rho(q_free)
    return -np.linalg.solve(psi_jacobian(q_free), psi_jacobian_rate(q_free, r @ v) @ r)


def mass_matrix(q_free):
    """D′ (36), with the motors' inertia."""
    q3, q4 = q_free[2:]
    d = np.zeros((4, 4))
    for i, k, angle, (m, big, a, lc, l_big, inertia, i_big) in (
        (0, 2, q3, (M1, M3, A1, LC1, LC3, I1, I3)),
        (1, 3, q4, (M2, M4, A2, LC2, LC4, I2, I4)),
    ):
        d[i, i] = m * lc**2 + big * (a**2 + l_big**2 + 2 * a * l_big * np.cos(angle)) + inertia + i_big + MOTOR
        d[i, k] = d[k, i] = big * (l_big**2 + a * l_big * np.cos(angle)) + i_big
        d[k, k] = big * l_big**2 + i_big
    return d


def coriolis_matrix(q_free, v_free):
    """C′ (37)."""
    h1, h2 = -M3 * A1 * LC3 * np.sin(q_free[2]), -M4 * A2 * LC4 * np.sin(q_free[3])
    c = np.zeros((4, 4))
    for i, k, h in ((0, 2, h1), (1, 3, h2)):
        c[i, i] = h * v_free[k]
        c[i, k] = h * (v_free[i] + v_free[k])
        c[k, i] = -h * v_free[i]
    return c


def gravity(q_free):
    """g′ (38)."""
    q1, q2, q3, q4 = q_free
    distal3, distal4 = M3 * LC3 * np.cos(q1 + q3), M4 * LC4 * np.cos(q2 + q4)
    return GRAVITY * np.array(
        [
            (M1 * LC1 + M3 * A1) * np.cos(q1) + distal3,
            (M2 * LC2 + M4 * A2) * np.cos(q2) + distal4,
            distal3,
            distal4,
        ]
    )


def sigma(q, mode):
    """σ (39)-(40) with sign sin(q1 + q3 − q2 − q4) = mode; NaN where the mechanism cannot be assembled."""
    lam, mu = elbow_offset(q)
    a, b, c = 2 * A4 * lam, 2 * A4 * mu, A3**2 - A4**2 - lam**2 - mu**2
    with np.errstate(invalid="ignore"):
        root = np.sqrt(a * a + b * b - c * c)
    for sign in (1.0, -1.0):
        q4 = np.arctan2(b, a) + np.arctan2(sign * root, c) - q[1]
        q3 = np.arctan2(mu + A4 * np.sin(q[1] + q4), lam + A4 * np.cos(q[1] + q4)) - q[0]
        q_free = np.array([q[0], q[1], wrap(q3), wrap(q4)])
        if not np.sin(fold(q_free)) * mode <= 0:
            return q_free
    raise AssertionError("neither root of (40) is in the assembly mode asked for")


def fold(q_free):
    """q1 + q3 − q2 − q4: the angle between links 3 and 4; its sine's sign is the assembly mode."""
    return q_free[0] + q_free[2] - q_free[1] - q_free[3]


def elongation(q):
    """√(λ² + μ²)/(a₃ + a₄), q of shape (2, …): σ exists strictly between 0 and 1."""
    return np.hypot(*elbow_offset(q)) / (A3 + A4)


def coincident_elbows():
    """The isolated singularity (56.944°, 123.056°), exact: both elbows above the middle of the base."""
    q1 = np.arccos(0.5 * C / A1)
    return np.array([q1, np.pi - q1])


def reduced_terms(q_free, v):
    """(D, C, g) of (23)-(25)."""
    r, r_dot = rho(q_free), rho_dot(q_free, v)
    mass, coriolis = mass_matrix(q_free), coriolis_matrix(q_free, r @ v)
    return r.T @ mass @ r, r.T @ coriolis @ r + r.T @ mass @ r_dot, r.T @ gravity(q_free)


def random_configurations(rng, count, mode, away=0.05):
    """Closed configurations of one mode, q uniform on the torus, with |sin(q1 + q3 − q2 − q4)| > `away`."""
    found = []
    while len(found) < count:
        q = rng.uniform(-np.pi, np.pi, 2)
        if 0.0 < elongation(q) < 1.0:
            q_free = sigma(q, mode)
            if abs(np.sin(fold(q_free))) > away:
                found.append(q_free)
    return found
