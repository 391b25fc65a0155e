"""The paper's robot under its law as an ordinary differential equation for Codac's Lohner contractor.

States are (q1, q2, ϑ3, ϑ4, q̇1, q̇2), ϑ3 = q1 + q3 and ϑ4 = q2 + q4 the distal links' angles. The loop's derivative gives
their rates, a sin(ϑ3 − ϑ4) below the line; what the links' forces do along those rates makes D q̈ = e.
"""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import numpy as np

from benchmarks.peers import NotForThisError
from tests.oracles import rpdr as paper

try:
    import codac
except ImportError:
    codac = None

ABSENT = "Codac is not installed (pip install codac)"


class Law(NamedTuple):
    """PD with simple gravity compensation (28): gains, set point and g(q_d), of shape (2,) each."""

    K_p: np.ndarray
    K_v: np.ndarray
    q_d: np.ndarray
    g_d: np.ndarray


class Enclosed(NamedTuple):
    """How far a set of starts was enclosed (s), and CPU seconds."""

    until: float
    cost: float


def closed_loop(law: Law) -> Any:
    """ẋ = f(x).

    Raises:
        NotForThisError: Codac is not installed.
    """
    if codac is None:
        raise NotForThisError(ABSENT)
    x = codac.VectorVar(6)
    q, far, v = (x[0], x[1]), (x[2], x[3]), (x[4], x[5])
    sin, cos, sqr = codac.sin, codac.cos, codac.sqr
    near_length, far_length, sign = (paper.A1, paper.A2), (paper.A3, paper.A4), (1.0, -1.0)
    below = sin(far[0] - far[1])
    rho = [
        [sign[k] * near_length[k] * sin(far[1 - i] - q[k]) / (far_length[i] * below) for k in (0, 1)] for i in (0, 1)
    ]
    w = [rho[i][0] * v[0] + rho[i][1] * v[1] for i in (0, 1)]
    masses = ((paper.M1, paper.M3), (paper.M2, paper.M4))
    middles = ((paper.LC1, paper.LC3), (paper.LC2, paper.LC4))
    inertias = ((paper.I1, paper.I3), (paper.I2, paper.I4))
    near_force, far_force, across = [], [], []
    for i, ((m, far_m), (l_c, far_l)) in enumerate(zip(masses, middles, strict=True)):
        near_pull = [near_length[k] * sqr(v[k]) * cos(far[1 - i] - q[k]) for k in (0, 1)]
        far_pull = [far_length[k] * sqr(w[k]) * cos(far[1 - i] - far[k]) for k in (0, 1)]
        bias = -(near_pull[0] + far_pull[0] - near_pull[1] - far_pull[1]) / (far_length[i] * below)
        coupled = far_m * near_length[i] * far_l
        across.append(coupled * cos(q[i] - far[i]))
        weight = paper.GRAVITY * (m * l_c + far_m * near_length[i])
        near_force.append(across[i] * bias + coupled * sin(q[i] - far[i]) * sqr(w[i]) + weight * cos(q[i]))
        swung = (far_m * far_l**2 + inertias[i][1]) * bias - coupled * sin(q[i] - far[i]) * sqr(v[i])
        far_force.append(swung + paper.GRAVITY * far_m * far_l * cos(far[i]))
    far_mass = [masses[i][1] * middles[i][1] ** 2 + inertias[i][1] for i in (0, 1)]
    own = [
        masses[i][0] * middles[i][0] ** 2 + inertias[i][0] + paper.MOTOR + masses[i][1] * near_length[i] ** 2
        for i in (0, 1)
    ]
    pairs = ((0, 0), (1, 1), (0, 1))
    carried = [far_mass[0] * rho[0][j] * rho[0][k] + far_mass[1] * rho[1][j] * rho[1][k] for j, k in pairs]
    dragged = [across[j] * rho[j][k] + across[k] * rho[k][j] for j, k in pairs]
    first, second, mixed = (carried[i] + dragged[i] + (own[i] if i < 2 else 0.0) for i in range(3))
    u = [float(law.K_p[k]) * (float(law.q_d[k]) - q[k]) - float(law.K_v[k]) * v[k] + float(law.g_d[k]) for k in (0, 1)]
    e = [u[k] - near_force[k] - rho[0][k] * far_force[0] - rho[1][k] * far_force[1] for k in (0, 1)]
    determinant = first * second - sqr(mixed)
    a = (second * e[0] - mixed * e[1]) / determinant, (first * e[1] - mixed * e[0]) / determinant
    return codac.AnalyticFunction([x], codac.vec(v[0], v[1], w[0], w[1], *a))


def enclosed(law: Law, start: np.ndarray, spread: np.ndarray, duration: float, step: float) -> Enclosed:
    """Enclose all starts |x − start| ≤ spread with Codac's own settings and slices of `step` seconds.

    Raises:
        NotForThisError: Codac is not installed.
    """
    f = closed_loop(law)
    tube = codac.SlicedTube(codac.create_tdomain([0.0, duration], step, True), codac.IntervalVector(6))
    box = [[float(x - r), float(x + r)] for x, r in zip(start, spread, strict=True)]
    tube.set(codac.IntervalVector(box), 0.0)
    began = time.process_time()
    tube = codac.CtcLohner(f).contract(tube, codac.TimePropag.FWD)
    cost = time.process_time() - began
    until = 0.0
    for k in range(1, round(duration / step)):
        if not np.isfinite(tube(k * step).max_diam()):
            break
        until = k * step
    return Enclosed(until, cost)
