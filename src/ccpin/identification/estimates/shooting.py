"""Motions under measured efforts from many starts at once, and how they change with starts, constants and geometry.

With F = Y(q, q̇, q̈) π − ρᵀSᵀu, affine in q̈, a motion has F = 0, so that q̈ = −D⁻¹ F|₀, and along it

    ∂q̈/∂π = −D⁻¹ Y(q, q̇, q̈),    ∂q̈/∂x = −D⁻¹ ∂F/∂x

for q, q̇ and numbers of the geometry, of which ∂F is taken by central differences at the same q̈. The variational
equations are integrated beside the motion by the same steps of Runge and Kutta's fourth order: what comes out are
derivatives of the steps taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.dynamics.reduced_model import ReducedModel

_STEP = 1e-5  # rad, m, and per s or s²: of central differences in q, q̇ and q̈
Motion = tuple[Array, Array, Array]
"""q, q̇ and q̈ of N states, of shape (N, n) each."""


class VariedPlant(NamedTuple):
    """What moves, and what of it may change.

    Attributes:
        model: The mechanism.
        constants: π, of shape (p,).
        tangent: ∂π/∂θ of the first numbers θ, of shape (p, k).
        varied: The mechanism with each of the other numbers a little larger and a little smaller.
        steps: By how much, of each.
    """

    model: ReducedModel
    constants: Array
    tangent: Array
    varied: tuple[tuple[ReducedModel, ReducedModel], ...]
    steps: tuple[float, ...]


class MotionShot(NamedTuple):
    """Some samples of a log, one after the other without a reversal.

    Attributes:
        t: Their times, s, of shape (K,).
        q: Measured coordinates, NaN where there is none, of shape (K, n).
        u: Efforts at the times and in their middles, of shapes (K, motors) and (K − 1, motors).
    """

    t: Array
    q: Array
    u: Array
    between: Array


class FollowedShots(NamedTuple):
    """Motions of several shots.

    Attributes:
        q: At each shot's times, of shape (K, n) each.
        by_start: ∂q/∂(q, q̇ at its start), of shape (K, n, 2n) each. by_numbers: ∂q/∂θ, of shape (K, n, k) each.
    """

    q: list[Array]
    by_start: list[Array]
    by_numbers: list[Array]


def followed(plant: VariedPlant, shots: Sequence[MotionShot], starts: Array) -> FollowedShots:
    """The motions of shots from starts (q, q̇), of shape (shots, 2n).

    Raises:
        CcpinError: One leaves the configurations at which the mechanism closes.
    """
    n, count = plant.model.n, plant.tangent.shape[1] + len(plant.varied)
    x, S = starts.copy(), np.zeros((len(shots), 2 * n, 2 * n + count))
    S[:, :, : 2 * n] = np.eye(2 * n)
    told = [(np.zeros((len(each.t), n)), np.zeros((len(each.t), n, 2 * n + count))) for each in shots]
    for k in range(max(len(each.t) for each in shots)):
        for (q, slopes), x_s, S_s in zip(told, x, S, strict=True):
            if k < len(q):
                q[k], slopes[k] = x_s[:n], S_s[:n]
        on = [i for i, each in enumerate(shots) if k + 1 < len(each.t)]
        if on:
            u = np.array([[shots[i].u[k], shots[i].between[k], shots[i].u[k + 1]] for i in on])
            h = np.array([shots[i].t[k + 1] - shots[i].t[k] for i in on])
            x[on], S[on] = _stepped(plant, x[on], S[on], u, h)
    S_all = [each for _, each in told]
    return FollowedShots([q for q, _ in told], [s[..., : 2 * n] for s in S_all], [s[..., 2 * n :] for s in S_all])


def _stepped(plant: VariedPlant, x: Array, S: Array, u: Array, h: Array) -> tuple[Array, Array]:
    """A step of each, with efforts (N, 3, motors) at its begin, middle and end."""
    xs, Ss = list[Array](), list[Array]()
    for stage, share in ((0, 0.0), (1, 0.5), (1, 0.5), (2, 1.0)):
        y, T = (x, S) if not xs else (x + (share * h)[:, None] * xs[-1], S + (share * h)[:, None, None] * Ss[-1])
        rate, slopes = _rates(plant, y, T, u[:, stage])
        xs.append(rate)
        Ss.append(slopes)
    weights = np.array([1.0, 2.0, 2.0, 1.0]) / 6.0
    ahead = x + h[:, None] * np.einsum("k,kni->ni", weights, np.array(xs))
    return ahead, S + h[:, None, None] * np.einsum("k,knij->nij", weights, np.array(Ss))


def _rates(plant: VariedPlant, x: Array, S: Array, u: Array) -> tuple[Array, Array]:
    """ẋ and Ṡ."""
    n = plant.model.n
    a, by_state, by_numbers = accelerations(plant, x[:, :n], x[:, n:], u)
    below = by_state @ S
    below[:, :, 2 * n :] += by_numbers
    return np.hstack([x[:, n:], a]), np.concatenate([S[:, n:], below], axis=1)


def accelerations(plant: VariedPlant, Q: Array, V: Array, U: Array) -> tuple[Array, Array, Array]:
    """q̈ (N, n), its derivatives by (q, q̇) (N, n, 2n), and by all numbers (N, n, k)."""
    model, (count, n) = plant.model, Q.shape
    units = np.concatenate([np.zeros((1, n)), np.eye(n)])
    Y = model.regressor_many(np.tile(Q, (n + 1, 1)), np.tile(V, (n + 1, 1)), np.repeat(units, count, axis=0))
    Y = Y.reshape(n + 1, count, n, -1)
    rising = Y[1:] - Y[0]
    D = np.einsum("jNip,p->Nij", rising, plant.constants)
    a = np.linalg.solve(D, (_felt(model, Q, V, U) - Y[0] @ plant.constants)[..., None])[..., 0]
    along = Y[0] + np.einsum("Nj,jNip->Nip", a, rising)
    by_state = force_slopes(model, plant.constants, (Q, V, a), U, 2)
    geometry = [
        (_missing(more, plant.constants, (Q, V, a), U) - _missing(less, plant.constants, (Q, V, a), U)) / (2.0 * h)
        for (more, less), h in zip(plant.varied, plant.steps, strict=True)
    ]
    numbers = np.concatenate([along @ plant.tangent, *(each[..., None] for each in geometry)], axis=2)
    return a, -np.linalg.solve(D, by_state), -np.linalg.solve(D, numbers)


def force_slopes(model: ReducedModel, constants: Array, motion: Motion, U: Array, orders: int = 3) -> Array:
    """∂F/∂(q, q̇, q̈) of N states, or of the first orders of these, of shape (N, n, orders · n)."""
    n, count = model.n, orders * model.n
    away = _STEP * np.array([1.0, -1.0])[:, None, None, None] * np.eye(count, 3 * n).reshape(count, 1, 3, 1, n)
    ends = (np.stack(motion) + away).transpose(2, 0, 1, 3, 4).reshape(3, -1, n)
    F = _missing(model, constants, (ends[0], ends[1], ends[2]), np.tile(U, (2 * count, 1)))
    F = F.reshape(count, 2, len(U), n)
    return np.asarray((F[:, 0] - F[:, 1]).transpose(1, 2, 0) / (2.0 * _STEP))


def _missing(model: ReducedModel, constants: Array, motion: Motion, U: Array) -> Array:
    """F, of shape (N, n)."""
    return np.asarray(model.regressor_many(*motion) @ constants - _felt(model, *motion[:2], U))


def _felt(model: ReducedModel, Q: Array, V: Array, U: Array) -> Array:
    """ρᵀSᵀu, of shape (N, n)."""
    if model.actuation is None:
        return U
    return np.asarray(np.einsum("Nij,Ni->Nj", model.terms_many(Q, V).rho, U @ model.actuation))
