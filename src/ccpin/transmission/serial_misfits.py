"""How far a serial robot is from the mechanism, over a grid of postures and, by differences, between them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.dynamics.state import State
from ccpin.transmission.posture import Posture

_BETWEEN = 0.25  # of a second difference: twice what a parabola rises between the points of a grid


class SerialErrors(NamedTuple):
    """Largest differences of serial robot and mechanism over the range, D_s − D and so on.

    Of sampled postures, with twice what second differences along the axes say of the places between them: an estimate
    with a margin, not a proof.

    Attributes:
        mass: Of the entries of D, kg m² (kg, kg m), of shape (n, n).
        share: Of D itself: |vᵀ(D_s − D)v| ≤ share · vᵀDv for all v.
        velocity: Of C q̇, each joint's for the worst |q̇| = 1, N m or N, of shape (n,); it grows with the square.
        gravity: Of g, N m or N, of shape (n,); springs are in it.
        damping: Of the entries of the damping matrix, of shape (n, n).
    """

    mass: Array
    share: float
    velocity: Array
    gravity: Array
    damping: Array


def serial_errors(serial: ReducedModel, grid: Sequence[Posture], count: int) -> SerialErrors:
    """The differences over a grid of `count` postures along each joint, in order.

    Args:
        serial: The serial robot in the mechanism's coordinates.
        grid: The postures.
        count: How many along each joint.
    """
    mass, share, velocity, gravity, damping = [], [], [], [], []
    for posture in grid:
        whole, own = posture.state, serial.at(posture.state.q, posture.state.q_free)
        mass.append(own.D - whole.D)
        root = np.linalg.inv(np.linalg.cholesky(whole.D))
        share.append(np.linalg.norm(root @ mass[-1] @ root.T, 2))
        velocity.append(_largest(own, whole))
        gravity.append(own.g - whole.g)
        damping.append(own.damping - whole.damping)
    axes = len(grid[0].q_joint)
    found = [most(np.array(each), count, axes) for each in (mass, share, velocity, gravity, damping)]
    return SerialErrors(found[0], float(found[1]), *found[2:])


def most(values: Array, count: int, axes: int) -> Array:
    """The largest absolute values over a grid, and what second differences add between its points."""
    grid = np.asarray(values).reshape((count,) * axes + values.shape[1:])
    over = tuple(range(axes))
    bend = [np.abs(np.diff(grid, 2, axis=k)).max(axis=over) for k in over]
    return np.asarray(np.abs(grid).max(axis=over) + _BETWEEN * np.sum(bend, axis=0))


def _largest(own: State, whole: State) -> Array:
    """max |e_i(q̇)| over |q̇| = 1 of the quadratic forms e = C_s q̇ − C q̇."""
    n = len(own.D)
    unit = np.eye(n)

    def form(v: Array) -> Array:
        return np.asarray(own.C(v) @ v - whole.C(v) @ v)

    single = [form(v) for v in unit]
    table = np.empty((n, n, n))
    for j in range(n):
        for k in range(n):
            table[:, j, k] = single[j] if j == k else 0.5 * (form(unit[j] + unit[k]) - single[j] - single[k])
    return np.asarray(np.abs(np.linalg.eigvalsh(table)).max(axis=1))
