"""Singular configurations of a mechanism with two independent coordinates, as curves.

*Parallel kind* (the paper's): some w ≠ 0 has φ_q′ w = 0 and α_q′ w = 0, that is det ψ_q′ = 0: the dependent joints can
move while the independent ones stand still. *Serial kind* (of the inverse kinematics): some w ≠ 0 has φ_q′ w = 0 and
J w = 0 with J the in-plane velocity rows of an end-effector point: the mechanism can move while that point stands
still. With B for α_q′ or J the singular configurations are the solutions (q′, w) of

    φ(q′) = 0,   φ_q′(q′) w = 0,   B(q′) w = 0,   ½(wᵀw − 1) = 0,

2n′ − 1 equations in 2n′ unknowns for n = 2: curves. They are followed by pseudo-arclength continuation of this
system, which is regular at simple folds although ψ_q′ is singular there (Moore and Spence, "The calculation of
turning points of nonlinear equations", SIAM J. Numer. Anal. 17, 1980). The derivative of φ_q′ w along q′ is φ̇_q′ at
q̇′ = w, because second derivatives commute in plain joint coordinates; that of J w is J̇ at q̇′ = w likewise.

A parallel curve is a *fold*, whose image in q is a curve (the loop stretched or folded: the edge of Ω), or a
*self-motion*, whose image in q is a single point over which the dependent joints move freely (the passive links out
of control: for a five-bar, its two distal links lie on one another).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize

from ccpin.arrays import Array, listener, numbers, positive, whole
from ccpin.domain.closures.system import reading_of
from ccpin.domain.singular.folds import Folds, singular_points
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.dynamics.state import Near
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.kinematics.points import LinkPoint
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of
from ccpin.mechanism.wireframe import plane_of_motion
from ccpin.proof.verdict import Verdict

RowFunction = Callable[[Array, Array], tuple[Array, Array]]
_SOLVED = 1e-11  # largest residual (m, 1) of a point on a curve: above what rounding leaves
_NEAR = 1e-6  # rad, m: a proved singular configuration as near a sampled point is taken for it


CurveKind = Literal["fold", "self-motion", "serial"]


class SingularCurve(NamedTuple):
    """One connected curve of singular configurations.

    Attributes:
        kind: ``fold`` (the loop stretched or folded), ``self-motion`` (passive links out of control) or ``serial``
            (the mechanism moves while the end effector stands still).
        q: Image in the independent coordinates, of shape (k, 2); one row for a self-motion.
        q_free: Configurations, of shape (k, nq).
        closed: Whether the curve returns to its start (turns of 2π of a joint not counted).
        error: How near each point is to a configuration proved to be singular (Theorem S), rad or
            m; NaN where none is proved: on serial curves, self-motions, and where a fold is not simple. Of shape
            (k,).
    """

    kind: CurveKind
    q: Array
    q_free: Array
    closed: bool
    error: Array

    @property
    def verdict(self) -> Verdict:
        """``"proven"`` where every point is next to a configuration proved to be singular, else ``"undecided"``.

        That there are no other curves is never claimed, and no point is a claim that could be refuted.
        """
        return "proven" if bool(np.isfinite(self.error).all()) else "undecided"


class SingularityDistance(NamedTuple):
    """How far a path stays from singularity.

    Attributes:
        q_free: σ along the path, of shape (k, nq).
        measure: Smallest singular value of φ_y with lengths divided by the mechanism's reach, of shape (k,).
    """

    q_free: Array
    measure: Array


def singularities(
    mechanism: Mechanism | HasMechanism,
    *,
    starts: int = 120,
    step: float = 0.02,
    limit: int = 4000,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[SingularCurve, ...]:
    """All singular curves met from deterministic starts, folds first.

    The search is sampled: a curve that no start leads to is missed (`certify_singularities` misses none). Every curve
    returned satisfies the equations above to 1e-11 at each point, and `error` says how near that is to a configuration
    proved to be singular.

    Args:
        mechanism: With n = 2, plain scalar joints (revolute, prismatic) and no redundant rows.
        starts: Number of starts spread over the joints' circles and ranges.
        step: Arclength between points, rad or m.
        limit: Largest number of points of one curve.
        progress: Called before each start with the starts done and their number; what it raises ends the search.

    Raises:
        UnsupportedMechanismError: n ≠ 2, joints with nq ≠ nv, components as coordinates, or redundant rows.
    """
    mechanism = mechanism_of(mechanism)
    selection = mechanism.parametrization().coordinates.jacobian(mechanism.q_reference)
    rows = selection, np.zeros_like(selection)
    curves = _all_curves(_SingularEquations(mechanism, lambda q_free, w: rows), starts, step, limit, listener(progress))
    return tuple(curve._replace(error=_proved_near(mechanism, curve)) for curve in curves)


def _proved_near(mechanism: Mechanism, curve: SingularCurve) -> Array:
    """The distances from a curve's points to configurations proved to be singular, of shape (k,)."""
    reading = reading_of(mechanism, mechanism.q_reference).bounded("reach")
    problem, theta = reading.problem, np.array([reading.theta(q_free) for q_free in curve.q_free])
    best = np.full(len(theta), np.nan)
    for directions in Folds.near(problem, theta).directions():
        found = singular_points(problem, theta, directions)
        distance = np.abs(found.theta - theta).max(axis=1) + found.error
        best = np.fmin(best, np.where(found.proved & (distance <= _NEAR), distance, np.nan))
    return best


def serial_singularities(
    mechanism: Mechanism | HasMechanism,
    link: str,
    point: ArrayLike = (0.0, 0.0, 0.0),
    *,
    starts: int = 120,
    step: float = 0.02,
    limit: int = 4000,
) -> tuple[SingularCurve, ...]:
    """The curves on which an end-effector point cannot move in every direction of the mechanism's plane.

    There the inverse kinematics lose a solution pair: for a five-bar, one arm is stretched or folded.

    Args:
        mechanism: Planar, with n = 2, plain scalar joints and no redundant rows.
        link: The end effector's link.
        point: The point on it, in the link's frame, metres.
        starts: As for `singularities`.
        step: As for `singularities`.
        limit: As for `singularities`.

    Raises:
        UnsupportedMechanismError: As for `singularities`, or the mechanism is not planar.
        InvalidInputError: No such moving link, or a point that is not three numbers.
    """
    mechanism = mechanism_of(mechanism)
    plane = plane_of_motion(mechanism)
    if plane is None:
        raise UnsupportedMechanismError(f"'{mechanism.name}' is not planar: its serial singularities are not curves")
    effector = LinkPoint(mechanism.tree, link, point)

    def rows(q_free: Array, w: Array) -> tuple[Array, Array]:
        motion = effector.motion(q_free, w)
        return plane @ motion.jacobian[:3], plane @ motion.jacobian_rate[:3]

    return _all_curves(_SingularEquations(mechanism, rows, "serial"), starts, step, limit, listener(None))


def _all_curves(
    equations: _SingularEquations,
    starts: int,
    step: float,
    limit: int,
    told: Callable[[int, int], object],
) -> tuple[SingularCurve, ...]:
    starts, step, limit = whole(starts, "starts"), positive(step, "step"), whole(limit, "limit")
    generator = np.random.default_rng(20004)
    curves: list[SingularCurve] = []
    for done in range(starts):
        told(done, starts)
        found = equations.solve_from(generator)
        if found is None or any(equations.lies_on(found, curve) for curve in curves):
            continue
        curve = equations.follow(found, step, limit)
        if curve is None:
            continue
        middle = curve.q_free[len(curve.q_free) // 2]
        if not any(known.kind == curve.kind and equations.lies_on(middle, known) for known in curves):
            curves.append(curve)
    return tuple(sorted(curves, key=lambda curve: curve.kind))


def singularity_distance(
    mechanism: Mechanism | HasMechanism, path: ArrayLike, near: Near = None
) -> SingularityDistance:
    """The smallest singular value of the scaled φ_y along a path in q, any n; zero means singular.

    Args:
        mechanism: The mechanism, or its model.
        path: Points of shape (k, size of q), followed in order on one branch.
        near: Chooses the branch at the first point.

    Raises:
        UnreachableError, SingularConfigurationError: The path cannot be followed.
    """
    model = ReducedModel(mechanism_of(mechanism))
    points = np.atleast_2d(numbers(path, "path"))
    if points.ndim != 2 or points.shape[1] != model.nq:
        raise InvalidInputError(f"path has shape {np.shape(path)}; it must be (k, {model.nq})")
    reach = characteristic_length(model.mechanism)
    configurations, measures = [], []
    for q in points:
        near = model.at(q, near)
        configurations.append(near.q_free)
        measures.append(_smallest(model, near.q_free, reach))
    return SingularityDistance(np.array(configurations), np.array(measures))


def characteristic_length(mechanism: Mechanism) -> float:
    """The mean norm of the constraint rows at the reference, in metres per radian: what lengths are divided by."""
    norms = np.linalg.norm(mechanism.constraints().value(mechanism.q_reference).jacobian, axis=1)
    return float(norms.mean()) if norms.size and norms.mean() > 0 else 1.0


def _smallest(model: ReducedModel, q_free: Array, reach: float) -> float:
    """Smallest singular value of φ_q′ on the kernel of α_q′, rows divided by the reach."""
    jacobian = model.parametrization.constraints.value(q_free).jacobian / reach
    selection = model.coordinates.jacobian(q_free)
    kernel = np.linalg.svd(selection)[2][len(selection) :].T
    return float(np.linalg.svd(jacobian @ kernel, compute_uv=False)[-1])


class _SingularEquations:
    """The system in x = (q′, w), its Jacobian, and continuation along its solution curves.

    Args:
        mechanism: The mechanism.
        rows: (q′, w) → B(q′) and its rate at q̇′ = w, both of shape (2, n′).
        kind: What the curves are called; by default told from their image in q.
    """

    def __init__(self, mechanism: Mechanism, rows: RowFunction, kind: CurveKind | None = None) -> None:
        self.mechanism, self.rows, self.kind = mechanism, rows, kind
        self.constraints = mechanism.constraints()
        coordinates = mechanism.parametrization().coordinates
        n, n_free = mechanism.n, mechanism.n_free
        if n != 2 or mechanism.nq != n_free or not coordinates.constant:
            raise UnsupportedMechanismError(
                "singular curves are followed for two independent coordinates and plain revolute or prismatic joints; "
                f"'{mechanism.name}' has n = {n}, nq = {mechanism.nq}, n′ = {n_free}"
            )
        if self.constraints.size != n_free - n:
            raise UnsupportedMechanismError(
                f"'{mechanism.name}' keeps {self.constraints.size} constraint rows of rank {n_free - n}: with "
                "redundant rows there is no det ψ_q′"
            )
        selection = coordinates.jacobian(mechanism.q_reference)
        self.independent = np.array([int(np.argmax(row)) for row in selection])
        self.angular = np.array([not slides for joint in mechanism.tree.joints for slides in joint.kind.slides])
        self.n_free = n_free

    def residual(self, x: Array) -> Array:
        q_free, w = x[: self.n_free], x[self.n_free :]
        value = self.constraints.value(q_free)
        return np.concatenate([value.phi, value.jacobian @ w, self.rows(q_free, w)[0] @ w, [0.5 * (w @ w - 1.0)]])

    def jacobian(self, x: Array) -> Array:
        q_free, w = x[: self.n_free], x[self.n_free :]
        value, (rows, rows_rate) = self.constraints.value(q_free), self.rows(q_free, w)
        zero = np.zeros_like(value.jacobian)
        return np.block(
            [
                [value.jacobian, zero],
                [self.constraints.rate(value, w), value.jacobian],
                [rows_rate, rows],
                [np.zeros((1, self.n_free)), w[None]],
            ]
        )

    def solve_from(self, generator: np.random.Generator) -> Array | None:
        """A solution from a random start, its loops closed the right way round, or ``None``."""
        spread = np.where(self.angular, np.pi, 0.5)
        start = self.mechanism.q_reference + spread * generator.uniform(-1.0, 1.0, self.n_free)
        jacobian = np.vstack([self.constraints.value(start).jacobian, self.rows(start, np.zeros(self.n_free))[0]])
        x = np.concatenate([start, np.linalg.svd(jacobian)[2][-1]])
        found = optimize.least_squares(self.residual, x, jac=self.jacobian, xtol=1e-15, ftol=1e-15, gtol=1e-8)
        settled = self.correct(found.x)
        return None if settled is None or not self.constraints.aligned(settled[: self.n_free]) else settled

    def correct(self, x: Array) -> Array | None:
        """Gauss–Newton steps of least norm onto the curve, or ``None`` where they do not converge."""
        for _ in range(8):
            residual = self.residual(x)
            if np.abs(residual).max() <= _SOLVED:
                return x
            x = x - np.linalg.lstsq(self.jacobian(x), residual, rcond=None)[0]
        return x if np.abs(self.residual(x)).max() <= _SOLVED else None

    def tangent(self, x: Array, along: Array | None) -> Array:
        """The unit tangent, turned along a previous one."""
        direction = np.linalg.svd(self.jacobian(x))[2][-1]
        return np.asarray(-direction if along is not None and direction @ along < 0 else direction)

    def follow(self, start: Array, step: float, limit: int) -> SingularCurve | None:
        """Continue a curve both ways until it returns or ends."""
        forward, closed = self._one_way(start, self.tangent(start, None), step, limit)
        points = forward
        if not closed:
            backward, _ = self._one_way(start, -self.tangent(start, None), step, limit)
            points = backward[:0:-1] + forward
        if len(points) < 3:
            return None
        configurations = np.array(points)[:, : self.n_free]
        q, unknown = configurations[:, self.independent], np.full(len(points), np.nan)
        if self.kind is not None:
            return SingularCurve(self.kind, q, configurations, closed, unknown)
        if np.ptp(q, axis=0).max() < 1e-7:
            turned = self._turned(configurations[:1])[:, self.independent]
            return SingularCurve("self-motion", turned, configurations, closed, unknown)
        return SingularCurve("fold", q, configurations, closed, unknown)

    def _one_way(self, start: Array, tangent: Array, step: float, limit: int) -> tuple[list[Array], bool]:
        points, here, h = [start], start, step
        while len(points) < limit:
            ahead = self.correct(here + h * tangent)
            if ahead is None or np.linalg.norm(ahead - here) > 2 * h:
                h *= 0.5
                if h < 1e-3 * step:
                    return points, False
                continue
            new_tangent = self.tangent(ahead, tangent)
            if new_tangent @ tangent < 0.9 and h > 0.01 * step:
                h *= 0.5
                continue
            here, tangent, h = ahead, new_tangent, min(step, 1.5 * h)
            points.append(here)
            if len(points) > 3 and self.gap(here, start) < 0.75 * step:
                points.append(start)
                return points, True
        return points, False

    def gap(self, x: Array, other: Array) -> float:
        """Distance of two points, angles modulo 2π and w up to its sign."""
        turned = self._turned(x[: self.n_free] - other[: self.n_free])
        w, v = x[self.n_free :], other[self.n_free :]
        return float(np.linalg.norm(np.append(turned, min(np.linalg.norm(w - v), np.linalg.norm(w + v)))))

    def lies_on(self, x: Array, curve: SingularCurve) -> bool:
        """Whether a solution (or its q′) is within a step of a curve already found."""
        return bool(np.linalg.norm(self._turned(curve.q_free - x[: self.n_free]), axis=1).min() < 0.03)

    def _turned(self, q_free: Array) -> Array:
        """Angles to within half a turn of zero."""
        return np.where(self.angular, np.remainder(q_free + np.pi, 2 * np.pi) - np.pi, q_free)
