"""The Lyapunov function of a set point along a motion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccpin.control.laws import PDFullGravity, PDSimpleGravity
from ccpin.trajectory import Trajectory

Array = NDArray[np.float64]


class LyapunovHistory(NamedTuple):
    """𝒱 and its rate at the samples of a motion.

    Attributes:
        V: 𝒱 in joules, of shape (T,).
        V_dot: 𝒱̇ in watts, from the power of the efforts that acted, of shape (T,).
        dissipation: −q̇ᵀK_v q̇ in watts, what Theorem 3 says 𝒱̇ is, of shape (T,).
    """

    V: Array
    V_dot: Array
    dissipation: Array


def lyapunov_along(law: PDSimpleGravity | PDFullGravity, trajectory: Trajectory) -> LyapunovHistory:
    """𝒱 of a law along a motion under it.

    The energy balance d/dt(½q̇ᵀDq̇ + V) = q̇ᵀρᵀSᵀu makes 𝒱̇ = q̇ᵀ(ρᵀSᵀu − K_p q̃ − g(q_d)) with simple compensation
    (28) and q̇ᵀ(ρᵀSᵀu − K_p q̃ − g(q)) with full compensation (30), whatever u was. Under the law itself this is
    −q̇ᵀK_v q̇; a saturated or sampled controller departs from it.
    """
    model, full = law.model, isinstance(law, PDFullGravity)
    values, rates, losses = [], [], []
    for q, v, u, q_free in zip(trajectory.q, trajectory.v, trajectory.u, trajectory.q_free, strict=True):
        point = model.closed_point(q, q_free)
        gravity = model.gravity(q, point.q_free) if full else law.gravity_d
        force = model.generalized_force(point, u) - law.K_p @ law.error(q) - gravity
        values.append(law.lyapunov(q, v, point.q_free))
        rates.append(float(v @ force))
        losses.append(-float(v @ law.K_v @ v))
    return LyapunovHistory(np.array(values), np.array(rates), np.array(losses))
