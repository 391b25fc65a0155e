"""`identify_geometry`: lengths and anchor points of a linkage from measured pairs of motor and joint angles.

Let p be the unknown numbers of the geometry and q_m = σ_m(q_j; p) the motors' displacements where φ(q′; p) = 0. Pairs
are measured with errors on both sides, and encoders may be mounted off by o,

    q̂_m = σ_m(q_j; p) + o_m + ε_m,        q̂_j = q_j + o_j + ε_j,

so that to first order in the errors the residual has the covariance of what both sides bring (errors in variables),

    r = q̂_m − o_m − σ_m(q̂_j − o_j; p),    Cov r = Σ = diag(s_m²) + J diag(s_j²) Jᵀ,        J = ∂σ_m/∂q_j.

Passive coordinates follow p as φ_q′ ∂q′/∂p = −φ_p with q_j held (implicit differentiation), that is

    ∂σ/∂p = −ψ_q′⁻¹ [φ_p; 0],        ∂r/∂o_m = −I,        ∂r/∂o_j = J.

Gauss–Newton solves the normal equations Σ Sᵀ Σ⁻¹ r = 0, S = −∂r/∂p, the weights those of the place where the step
starts: no determinant of Σ has to be added, and what S itself, evaluated at measured angles, adds to the estimate is of
the order of the errors' squares. It starts at the file's geometry, and no step is taken on which the sum of squares, of
these weights, grows.

**What is observable.** Lengths count in the linkage's extent, angles in radians, and W = Σ^{-1/2} S in these units is
taken apart, W = U diag(s) Vᵀ: along V's columns p is known to 1/s. Where that is more than 0.05 (of the extent, or
rad), or s within rounding of 0, nothing is known: gauge freedoms, which change no angle at all (the size of a linkage
that only turns, the origin of a hinge along its axis), and what these pairs do not show. Such directions stay as the
file has them: every step is the shortest that solves the equations. The covariance is that of the others, V s⁻² Vᵀ, and
a number that unobservable directions change has none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, instance, matrix_rows, numbers
from ccpin.errors import (
    CcpinError,
    ConvergenceError,
    InvalidInputError,
    SingularConfigurationError,
    UnreachableError,
    UnsupportedMechanismError,
)
from ccpin.kinematics.parametrization import ClosedPoint
from ccpin.kinematics.tree import ROOT_JOINT, build_tree
from ccpin.mechanism.mechanism import Mechanism
from ccpin.transmission.geometry_unknowns import GeometrySlopes, Unknown, unknowns_of, with_geometry
from ccpin.transmission.identified_geometry import IdentifiedGeometry
from ccpin.transmission.transmission import Transmission

_KNOWN = 0.05  # of the extent, or rad: a standard deviation above says nothing that the file does not
_ROUNDING = 1e-10  # of the largest singular value: what is below is 0
_SETTLED = 1e-6  # of standard deviations: a step this short ends the iteration
_MOST_STEPS = 50
_MOST_HALVINGS = 12
_DEFAULT_NOISE = np.radians(0.02)


def identify_geometry(
    transmission: Transmission,
    motor_positions: ArrayLike,
    joint_positions: ArrayLike,
    *,
    motor_noise: ArrayLike = _DEFAULT_NOISE,
    joint_noise: ArrayLike = _DEFAULT_NOISE,
    parameters: Sequence[str] | None = None,
    known: Sequence[str] = (),
    offsets: Sequence[str] = (),
) -> IdentifiedGeometry:
    """Lengths and anchor points of a linkage, of pairs q_m, q_j measured with errors on both sides.

    Numbers of the geometry are origins of joints on loops, `"JOINT:x"` (y, z; on the parent link, m), of closures'
    frames, `"CLOSURE/A:x"` and `"CLOSURE/B:x"`, a rod's `"CLOSURE:length"`, and of couplings `"COUPLING/JOINT:ratio"`
    for all terms but the first. `"JOINT"`, `"CLOSURE/A"` and `"CLOSURE"` stand for all that are its own.

    Args:
        transmission: With the geometry that the file states, near which the true one is.
        motor_positions: q̂_m of the motors' joints, in the order of `transmission.motors`, rad or m, of shape (N, n).
        joint_positions: q̂_j likewise.
        motor_noise: Standard deviations s_m, one for all or of shape (n,); default 0.02°. 0 where exact.
        joint_noise: s_j likewise. Not both may be 0.
        parameters: What is identified; default all.
        known: What of these is right in the file. Angles alone do not tell a linkage's size, so name a length.
        offsets: Joints and motors' joints whose encoders have an unknown offset.

    Raises:
        InvalidInputError: A wrong shape or name; no more equations than numbers that they determine; or pairs by which
            no number of these is determined.
        ConvergenceError: The iteration does not settle, or the linkage cannot be closed at a pair.
        UnsupportedMechanismError: Rows of φ that are redundant: other geometry would not close.
    """
    transmission = instance(transmission, "transmission", Transmission)
    n, mechanism = transmission.n, transmission.joint_model.mechanism
    pairs = _Pairs(
        matrix_rows(motor_positions, "motor_positions", n), matrix_rows(joint_positions, "joint_positions", n),
        _deviations(motor_noise, "motor_noise", n), _deviations(joint_noise, "joint_noise", n),
    )  # fmt: skip
    if len(pairs.motors) != len(pairs.joints):
        raise InvalidInputError(
            f"{len(pairs.motors)} motor_positions are no pairs with {len(pairs.joints)} joint_positions"
        )
    if not (pairs.motor_noise + pairs.joint_noise > 0.0).all() or not len(pairs.motors):
        raise InvalidInputError("motor_noise and joint_noise must not both be 0, and there must be pairs")
    if mechanism.constraints().size != mechanism.n_free - mechanism.n:
        raise UnsupportedMechanismError(
            f"'{mechanism.name}' has more closure rows than it has dependent motions: with other lengths it would not "
            "close, so that single lengths cannot be identified; state closures that are not redundant (spherical)"
        )
    sides = (*transmission.motors, *transmission.joints)
    unknowns = unknowns_of(mechanism, parameters, known, offsets, sides)
    problem = _Problem(transmission, unknowns, pairs)
    return _identified(problem, *_solved(problem))


class _Pairs(NamedTuple):
    """What was measured, of shape (N, n) each, and its standard deviations (n,)."""

    motors: Array
    joints: Array
    motor_noise: Array
    joint_noise: Array


def _deviations(value: ArrayLike, name: str, n: int) -> Array:
    given = numbers(value, name)
    if given.shape not in ((), (n,)) or not (given >= 0.0).all():
        raise InvalidInputError(f"{name} must be one number or {n}, none below 0")
    return np.broadcast_to(given, (n,))


class _Problem:
    """What the iteration reads: pairs, unknowns, and the scale of each."""

    def __init__(self, transmission: Transmission, unknowns: tuple[Unknown, ...], pairs: _Pairs) -> None:
        self.transmission, self.unknowns, self.pairs = transmission, unknowns, pairs
        self.mechanism = transmission.joint_model.mechanism
        extent = self.mechanism.constraints().extent
        sides = (*transmission.motors, *transmission.joints)
        units = dict(zip(sides, (*transmission.motor_side.units, *transmission.joint_side.units), strict=True))
        metres = [each.is_length or units.get(each.of) == "m" for each in unknowns]
        self.scales = np.where(metres, extent, 1.0)
        self.start = np.array([each.value for each in unknowns])

    def changed(self, values: Array) -> Mechanism:
        """The mechanism of another geometry; its reference is not closed."""
        own = self.mechanism
        held = None if own.held is None else with_geometry(own.held, self.unknowns, values)
        told = with_geometry(own.description, self.unknowns, values)
        tree = build_tree(held or told, ROOT_JOINT in own.tree.names)
        return replace(own, description=told, held=held, tree=tree)


class _Fit:
    """Residuals at a geometry, and their slopes.

    Args:
        problem: The problem.
        values: p.
        near: q′ at each pair, or near it.

    Raises:
        CcpinError: The linkage does not close at a pair.
    """

    def __init__(self, problem: _Problem, values: Array, near: Sequence[Array | None]) -> None:
        self.values, self._problem = values, problem
        self.mechanism = problem.changed(values)
        transmission, pairs = problem.transmission, problem.pairs
        places = {each.of: value for each, value in zip(problem.unknowns, values, strict=True) if each.kind == "offset"}
        off_motors, off_joints = (
            np.array([places.get(name, 0.0) for name in names]) for names in (transmission.motors, transmission.joints)
        )
        sigma, side = self.mechanism.parametrization().sigma, transmission.motor_side
        self.points = list[ClosedPoint]()
        for q, start in zip(pairs.joints - off_joints, near, strict=True):
            here = start if start is not None else self.points[-1].q_free if self.points else None
            self.points.append(sigma(transmission.joint_side.configuration(q), here))
        found = [side.positions(side.coordinates.alpha(point.q_free)) for point in self.points]
        residuals = pairs.motors - off_motors - np.array(found)
        circles = [part.whole is not None for part in side.coordinates.parts]
        residuals[:, circles] = np.remainder(residuals[:, circles] + np.pi, 2.0 * np.pi) - np.pi
        self.residuals = residuals

    @cached_property
    def jacobians(self) -> Array:
        """J of each pair, of shape (N, n, n)."""
        return np.array([point.rho[self._problem.transmission.motor_side.rows] for point in self.points])

    @cached_property
    def whitening(self) -> Array:
        """L⁻¹ of Σ = L Lᵀ, of shape (N, n, n)."""
        pairs, J = self._problem.pairs, self.jacobians
        covariance = np.diag(pairs.motor_noise**2) + (J * pairs.joint_noise**2) @ J.transpose(0, 2, 1)
        return np.linalg.inv(np.linalg.cholesky(covariance))

    @cached_property
    def sensitivity(self) -> Array:
        """W, of shape (N n, k)."""
        problem = self._problem
        transmission, slopes = problem.transmission, GeometrySlopes(self.mechanism, problem.unknowns)
        S = np.empty((*self.residuals.shape, len(problem.unknowns)))
        for each, point in zip(S, self.points, strict=True):
            right = slopes.at(point.constraints)
            still = np.zeros((transmission.n, right.shape[1]))
            each[:] = -point.factor.solve(np.vstack([right, still]))[transmission.motor_side.rows]
        for k, unknown in enumerate(problem.unknowns):
            if unknown.kind == "offset" and unknown.of in transmission.motors:
                S[:, transmission.motors.index(unknown.of), k] += 1.0
            if unknown.kind == "offset" and unknown.of in transmission.joints:
                S[:, :, k] -= self.jacobians[:, :, transmission.joints.index(unknown.of)]
        return np.asarray((self.whitening @ (S * problem.scales)).reshape(-1, len(problem.unknowns)))

    def cost(self, whitening: Array) -> float:
        """Σ rᵀ Σ⁻¹ r with weights of some place."""
        return float((self.whitened(whitening) ** 2).sum())

    def whitened(self, whitening: Array) -> Array:
        """Σ^{-1/2} r, of shape (N n,)."""
        return np.einsum("Nij,Nj->Ni", whitening, self.residuals).ravel()


def _solved(problem: _Problem) -> tuple[_Fit, int, int]:
    """Where Gauss–Newton settles, how many directions are observable, and how many steps were taken."""
    joints = problem.pairs.joints
    order = np.argsort(np.linalg.norm(joints - problem.transmission.reference.q_joint, axis=1))
    near: list[Array | None] = [None] * len(joints)
    try:
        for k in order:  # on the branch of the reference
            near[k] = problem.transmission.at(joints[k]).state.q_free
        here = _Fit(problem, problem.start, near)
    except (UnreachableError, SingularConfigurationError) as error:
        raise ConvergenceError(f"the stated linkage cannot be closed at a pair: {error}") from error
    rank = _rank(problem, here)
    for steps in range(_MOST_STEPS):
        U, s, Vt = np.linalg.svd(here.sensitivity, full_matrices=False)
        along = U[:, :rank].T @ here.whitened(here.whitening)
        if np.linalg.norm(along) <= _SETTLED * np.sqrt(len(U)):
            left = _rank(problem, here)
            if left >= rank:
                return here, rank, steps
            rank = left
            continue
        here = _stepped(problem, here, Vt[:rank].T @ (along / s[:rank]) * problem.scales)
    raise ConvergenceError(
        f"the geometry did not settle in {_MOST_STEPS} steps: are pairs and joints in the same order, units and signs?"
    )


def _rank(problem: _Problem, fit: _Fit) -> int:
    """How many directions are observable.

    Raises:
        InvalidInputError: None is, or as many as there are equations.
    """
    s = np.linalg.svd(fit.sensitivity, compute_uv=False)
    rank = int((s > max(1.0 / _KNOWN, _ROUNDING * s[0])).sum())
    names, equations = ", ".join(each.name for each in problem.unknowns), fit.residuals.size
    if not rank:
        raise InvalidInputError(f"nothing of {names} is observable by these {len(fit.points)} pairs")
    if rank >= equations:
        raise InvalidInputError(
            f"{len(fit.points)} pairs give {equations} equations, and {rank} numbers would be determined by them: "
            "measure more pairs, or name what is known"
        )
    return rank


def _stepped(problem: _Problem, here: _Fit, step: Array) -> _Fit:
    """The place of the step, or of a part of it, where the sum of squares is less."""
    before, near = here.cost(here.whitening), [point.q_free for point in here.points]
    part, blocked = 1.0, ""
    for _ in range(_MOST_HALVINGS):
        try:
            there = _Fit(problem, here.values + part * step, near)
            if there.cost(here.whitening) <= before * (1.0 + _SETTLED):
                return there
        except CcpinError as error:
            blocked = f" ({error})"
        part *= 0.5
    raise ConvergenceError(f"no step from the geometry reached makes residuals smaller{blocked}")


def _identified(problem: _Problem, fit: _Fit, rank: int, steps: int) -> IdentifiedGeometry:
    _, s, Vt = np.linalg.svd(fit.sensitivity)
    V = Vt[:rank].T / s[:rank] * problem.scales[:, None]
    freedoms = fit.residuals.size - rank
    own = problem.mechanism
    sigma, alpha = fit.mechanism.parametrization().sigma, problem.transmission.joint_model.alpha
    try:
        closed = sigma(alpha(own.q_reference), own.q_reference).q_free
    except CcpinError as error:
        raise ConvergenceError(f"the identified linkage does not close at the reference: {error}") from error
    return IdentifiedGeometry(
        parameters=tuple(each.name for each in problem.unknowns),
        lengths=tuple(each.is_length for each in problem.unknowns),
        stated=problem.start,
        values=fit.values,
        covariance=V @ V.T,
        singular_values=np.concatenate([s, np.zeros(len(problem.start) - len(s))]),
        directions=Vt[rank:] * problem.scales,
        residuals=fit.residuals,
        misfit=float(np.sqrt(fit.cost(fit.whitening) / freedoms)),
        iterations=steps,
        description=replace(fit.mechanism, q_reference=closed).settled(),
    )
