"""The squares of Table I that belong to Ω: by every certificate there is, and the exact ones."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from ccpin.arrays import Array
from ccpin.domain import certify, kantorovich_radius, theorem2
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.paper import printed

_EDGE = np.linspace(-1.0, 1.0, 2001)  # of a square, as points at which its slack is looked at


class Radii(NamedTuple):
    """Radii about one of Table I's centres, degrees.

    Attributes:
        centre: (q1, q2).
        paper: As printed.
        closest: Theorem 2 in the form that comes closest to the printed ones: absolute angles, unit scales.
        theorem2: Theorem 2 in the better form, its unknowns scaled for the largest radius.
        reach: One box in joint space, bounds by reach.
        planar: One box in joint space, bounds for planar loops.
        atlas: By an atlas of many boxes.
        exact: Of the largest square on which the closed-form σ exists and is nonsingular.
    """

    centre: tuple[float, float]
    paper: float
    closest: float
    theorem2: float
    reach: float
    planar: float
    atlas: float
    exact: float


def radii_about(model: ReducedModel, centre: Array, paper: float) -> Radii:
    """The radii about a centre, of shape (2,) in rad, whose printed one is `paper`."""
    q_free = model.sigma(centre)
    measured = [
        theorem2(model, q_free, form="absolute", scaling="unit").radius,
        theorem2(model, q_free).radius,
        kantorovich_radius(model, q_free),
        kantorovich_radius(model, q_free, bounds="planar"),
        certify(model, centre, near=q_free, max_depth=0).radius,
        exact_radius(centre),
    ]
    first, second = np.degrees(centre).round(9).tolist()
    return Radii((first, second), paper, *np.degrees(measured).tolist())


def exact_radius(centre: Array) -> float:
    """Half width of the largest square on which σ exists and is nonsingular, by bisection on its edges (rad)."""

    def slack(radius: float) -> float:
        sides = [np.column_stack([_EDGE, np.full(len(_EDGE), side)]) for side in (-1.0, 1.0)]
        edges = np.concatenate([*sides, *(side[:, ::-1] for side in sides)])
        reach = float(printed.A[2] + printed.A[3])
        return reach - float(printed.elbow_distance(centre + radius * edges).max())

    isolated = printed.coincident_elbows() * [[1.0], [-1.0]]
    away = np.remainder(isolated - centre + np.pi, 2 * np.pi) - np.pi
    stretched = brentq(slack, 1e-6, np.pi) if slack(np.pi) < 0 else np.pi
    return float(min(stretched, np.abs(away).max(axis=1).min()))
