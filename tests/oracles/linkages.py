"""Closed forms of linkages between motors and joints: rods' length equations, their derivatives by hand, teeth.

A crank of length r about y, its pin at r(−cos θ, 0, sin θ) from its pivot, is joined by a rod of length L to a point
that is at d from the pivot: r² + |d|² + 2r(d_x cos θ − d_z sin θ) = L², so that with A = −d_x, B = d_z and
k = (r² + |d|² − L²)/2r

    A cos θ + B sin θ = k,        θ = atan2(B, A) + acos(k/√(A² + B²)),
    (B cos θ − A sin θ) θ̇ = k̇ − Ȧ cos θ − Ḃ sin θ,        k̇ = d·ḋ/r.
"""

import numpy as np


def crank_angle(r, L, d):
    """θ for places of the rod's other end, of shape (3, …), the elbow bent as at the reference."""
    A, B, k = -d[0], d[2], (r * r + (d * d).sum(axis=0) - L * L) / (2 * r)
    return np.arctan2(B, A) + np.arccos(k / np.hypot(A, B))


def crank_rate(r, L, d, d_dot):
    """θ̇ for the rate of that place."""
    theta = crank_angle(r, L, d)
    c, s = np.cos(theta), np.sin(theta)
    return (d @ d_dot / r + d_dot[0] * c - d_dot[2] * s) / (d[2] * c + d[0] * s)


def about_y(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def about_x(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


class Ankle:
    """docs/howto/ankle.urdf: pitch about y, then roll about x; cranks of 50 mm, 250 mm up, rods of 260 mm."""

    CRANK, ROD = 0.05, 0.26
    PIVOTS = np.array([[0, 0.04, 0.25], [0, -0.04, 0.25]])
    HEELS = np.array([[-0.05, 0.04, -0.01], [-0.05, -0.04, -0.01]])
    RANGE = np.array([[-0.5, 0.5], [-0.3, 0.3]])

    def motors(self, q):
        turned = about_y(q[0]) @ about_x(q[1])
        ends = zip(self.HEELS, self.PIVOTS, strict=True)
        return np.array([crank_angle(self.CRANK, self.ROD, turned @ heel - pivot) for heel, pivot in ends])

    def jacobian(self, q):
        pitch, roll = about_y(q[0]), about_x(q[1])
        turned = pitch @ roll
        by_pitch = about_y(q[0] + np.pi / 2) @ roll  # a rotation's derivative, but for its axis, is a quarter turn on
        by_roll = pitch @ about_x(q[1] + np.pi / 2)
        y, x = np.diag([0.0, 1.0, 0.0]) @ roll, pitch @ np.diag([1.0, 0.0, 0.0])
        rates = (by_pitch - y, by_roll - x)
        return np.array(
            [
                [crank_rate(self.CRANK, self.ROD, turned @ heel - pivot, rate @ heel) for rate in rates]
                for heel, pivot in zip(self.HEELS, self.PIVOTS, strict=True)
            ]
        )


class Knee:
    """`ccpin new knee`: crank 60 mm at the hip, lever 50 mm behind the knee, 350 mm below."""

    CRANK, LEVER, THIGH = 0.06, 0.05, 0.35
    ROD = np.hypot(CRANK - LEVER, THIGH)
    RANGE = np.array([[-0.7, 0.7]])

    def motors(self, q):
        return np.array([crank_angle(self.CRANK, self.ROD, self._pin(q[0]))])

    def jacobian(self, q):
        rate = self.LEVER * np.array([np.sin(q[0]), 0.0, np.cos(q[0])])
        return np.array([[crank_rate(self.CRANK, self.ROD, self._pin(q[0]), rate)]])

    def _pin(self, angle):
        return np.array([-self.LEVER * np.cos(angle), 0.0, self.LEVER * np.sin(angle) - self.THIGH])


class Neck:
    """docs/howto/neck.xml: bevel wheels of 30 mm on the pitch axis, the head's gear of 25 mm about the roll axis."""

    RATIO = 0.025 / 0.03
    RANGE = np.array([[-0.5, 0.5], [-0.4, 0.4]])

    def motors(self, q):
        return self.jacobian(q) @ q

    def jacobian(self, q):
        return np.array([[1.0, -self.RATIO], [1.0, self.RATIO]])
