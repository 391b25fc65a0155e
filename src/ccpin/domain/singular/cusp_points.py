"""Cusps: closed configurations proved to exist about which three solutions y over one q come together.

They are looked for where curves of folds turn their curvature over; that one is there is Theorem C of
`ccpin/proof/theorems/cusps.md`, of which the kernel makes facts (`ccpin.proof.zeros`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, apply, records
from ccpin.covering.claims import proved_zeros
from ccpin.covering.proposals.solving import closure_derivatives
from ccpin.covering.region import Corners, corners_of
from ccpin.domain.closures.system import Reading, reading_of
from ccpin.domain.singular.sampled import SingularCurve, singularities
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of
from ccpin.proof.equations import Problem, closures_of
from ccpin.proof.newton import without_turns
from ccpin.proof.prolongations import Prolongation
from ccpin.proof.zeros import Cusps

_STEPS = 40  # of Newton's method: it starts at a point of a curve that is sampled coarsely
_SAME = 1e-6  # rad, m: cusps as near are one found twice, whose errors are far below


class Cusp(NamedTuple):
    """A cusp that is proved (Theorem C of `proof/theorems/cusps.md`).

    Attributes:
        q: The independent coordinates, of shape (2,), in the scalar coordinates of certificates.
        q_free: The configuration, of shape (nq,).
        kernel: v: how the dependent coordinates move where q stands still, of shape (m,).
        error: The exact one is this near in every coordinate (rad, m).
    """

    q: Array
    q_free: Array
    kernel: Array
    error: float


def cusps(
    mechanism: Mechanism | HasMechanism,
    region: Corners | None = None,
    *,
    curves: Sequence[SingularCurve] | None = None,
) -> tuple[Cusp, ...]:
    """The cusps on curves of folds, each proved to exist.

    That there are no others is not claimed: a curve that is not given has cusps of its own.

    Args:
        mechanism: With n = 2, plain scalar joints and no redundant rows; hold joints still with ``load(locked=…)`` for
            a slice of a mechanism with more.
        region: (lower, upper), bounds of the coordinates within which they are wanted, each of shape (2,).
        curves: From `singularities`; by default all that it finds.

    Raises:
        UnsupportedMechanismError: As for `singularities`.
        InvalidInputError: The region is malformed.
    """
    mechanism = mechanism_of(mechanism)
    given = singularities(mechanism) if curves is None else records(curves, "curves", SingularCurve)
    folds = [curve for curve in given if curve.kind == "fold"]
    reading = reading_of(mechanism, mechanism.q_reference).bounded("reach")
    found: list[Cusp] = []
    for curve in folds:
        theta = np.array([reading.theta(q_free) for q_free in curve.q_free])
        found += proved_cusps(reading, theta[_turning(reading.problem, theta, curve.closed)])
    low, high = (
        (np.full(2, -np.inf), np.full(2, np.inf)) if region is None else corners_of(region, mechanism.independent)
    )
    return distinct(reading, [cusp for cusp in found if np.all((cusp.q >= low) & (cusp.q <= high))])


def distinct(reading: Reading, found: Sequence[Cusp]) -> tuple[Cusp, ...]:
    """Each cusp once: those that agree modulo 2π, or may by what they are off by, are the same."""
    kept: list[Cusp] = []
    for cusp in found:
        if not any(_same(reading, cusp, other) for other in kept):
            kept.append(cusp)
    return tuple(kept)


def _same(reading: Reading, one: Cusp, other: Cusp) -> bool:
    gap = reading.theta(one.q_free) - reading.theta(other.q_free)
    gap = without_turns(gap, reading.system.periodic)
    return bool(np.abs(gap).max() < max(_SAME, one.error + other.error))


def _turning(problem: Problem, theta: Array, closed: bool) -> Array:
    """Where along a curve of folds the second-order term uᵀφ_yy v v changes its sign, beside both points."""
    values = closure_derivatives(problem, theta)
    dependent = problem.system.dependent
    left, _, right = np.linalg.svd(values.jacobian[:, :, dependent])
    u, v = left[:, :, -1], right[:, -1]
    bent = np.einsum("bm,bmij,bi,bj->b", u, values.hessian[:, :, dependent][..., dependent], v, v)
    following = np.roll(np.arange(len(theta)), -1)
    # u and v are known up to their signs: turn each pair along the one before; bent changes with u only
    kept = np.sign(np.sum(u * u[following], axis=1))
    changes = bent * bent[following] * kept < 0.0
    if not closed:
        changes[-1] = False
    at = np.flatnonzero(changes)
    return np.unique(np.concatenate([at, following[at]]))


def proved_cusps(reading: Reading, theta: Array) -> list[Cusp]:
    """The cusps that Newton's method finds from singular configurations θ (B, n′) and the kernel proves."""
    if not len(theta):
        return []
    problem, system = reading.problem, reading.system
    values = closure_derivatives(problem, theta)
    inner = values.jacobian[:, :, system.dependent]
    weak = np.linalg.svd(inner)[2][:, -1]
    curved = np.einsum("bmij,bi,bj->bm", values.hessian[:, :, system.dependent][..., system.dependent], weak, weak)
    tall = np.concatenate([inner, weak[:, None]], axis=1)
    curl = apply(np.linalg.pinv(tall), np.concatenate([-curved, np.zeros((len(theta), 1))], axis=1))  # fits best
    none, plane = np.zeros((len(theta), 2)), np.tile(np.eye(2), (len(theta), 1, 1))
    planes = Prolongation(closures_of(problem), theta[:, system.independent], plane, weak)
    start = np.concatenate([none, theta[:, system.dependent], weak, curl], axis=1)
    x, error, _ = proved_zeros(problem, Cusps, planes, start, _STEPS)
    ended, kernel = planes.theta(x), x[:, 2 + system.m : 2 + 2 * system.m]
    return [
        Cusp(ended[k, system.independent], reading.configuration(ended[k]), kernel[k], float(error[k]))
        for k in np.flatnonzero(np.isfinite(error))
    ]
