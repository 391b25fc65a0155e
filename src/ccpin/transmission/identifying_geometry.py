"""`identify_geometry`: lengths and anchor points of a linkage from measured pairs of motor and joint angles.

Let p be the unknown numbers of the geometry and q_m = σ_m(q_j; p) the motors' displacements where φ(q′; p) = 0. Pairs
are measured with errors on both sides, and encoders may be mounted off by o,

    q̂_m = σ_m(q_j; p) + o_m + ε_m,        q̂_j = q_j + o_j + ε_j.

What is minimised is |ε_m/s_m|² + |ε_j/s_j|² over p, o and the true q_j of every pair (maximum likelihood, errors in
both variables). About an estimate of them, to first order,

    r = (q̂_m − o_m − σ_m(q_j; p)) − J (q̂_j − o_j − q_j),    Cov r = Σ = diag(s_m²) + J diag(s_j²) Jᵀ,    J = ∂σ_m/∂q_j,

holds the unknown q_j no more: Gauss–Newton's step in p and o solves Σ Sᵀ Σ⁻¹ (r − S δ) = 0, S = ∂σ_m/∂p, 1 of o_m and
−J of o_j, and the joints' errors follow, ε_j = −s_j² Jᵀ Σ⁻¹ (r − S δ). It starts at the file's geometry and at q̂_j, and
no step is taken on which the sum of squares, of the weights where it starts, grows. What a prior states of a number is
one more row.

**What is observable.** Lengths count in the linkage's extent, angles in radians, and W = Σ^{-1/2} S in these units is
taken apart, W = U diag(s) Vᵀ: along V's columns p is known to 1/s. Where that is more than 0.05 (of the extent, or
rad), or s within rounding of 0, nothing is known: gauge freedoms, which change no angle at all (the size of a linkage
that only turns, the origin of a hinge along its axis), and what these pairs do not show. Such directions stay as the
file has them: every step is the shortest that solves the equations. The covariance is that of the others, V s⁻² Vᵀ, and
a number that unobservable directions change has none.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, instance, matrix_rows, numbers, positive
from ccpin.errors import CcpinError, ConvergenceError, InvalidInputError, UnsupportedMechanismError
from ccpin.programs.recording.constants import Parameter
from ccpin.transmission.geometry_equations import ClosedPairs, GeometryEquations
from ccpin.transmission.geometry_numbers import changed_mechanism, named_numbers, unknown_numbers
from ccpin.transmission.identified_geometry import ROUNDING, IdentifiedGeometry
from ccpin.transmission.transmission import Transmission

_KNOWN = 0.05  # of the extent, or rad: a standard deviation above says nothing that the file does not
_SETTLED = 1e-6  # of standard deviations: a step this short ends the iteration
_FAR = 0.25  # of the extent, or rad: a file whose numbers are farther off is of another linkage
_UNFIT = 10.0  # of the noise stated: larger residuals are no noise
_MOST_STEPS = 50
_MOST_HALVINGS = 12
_DEFAULT_NOISE = np.radians(0.02)
_OTHER = "are pairs and joints of this mechanism and branch, in the same order, units and signs?"


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
    priors: Mapping[str, float] | None = None,
) -> IdentifiedGeometry:
    """Lengths and anchor points of a linkage, of pairs q_m, q_j measured with errors on both sides.

    Numbers of the geometry are called as parameters of programs are: `"origin:JOINT/x"` (y, z; on the parent link, m)
    of joints on loops, `"origin:CLOSURE/A/x"` and `"origin:CLOSURE/B/x"`, a rod's `"distance:CLOSURE"`, and
    `"ratio:COUPLING/JOINT"` for all terms but the first. `"JOINT"`, `"CLOSURE/A"`, `"CLOSURE"` and `"COUPLING"` stand
    for all that are its own.

    Args:
        transmission: With the geometry that the file states, near which the true one is.
        motor_positions: q̂_m of the motors' joints, in the order of `transmission.motors`, rad or m, of shape (N, n).
        joint_positions: q̂_j likewise.
        motor_noise: Standard deviations s_m, one for all or of shape (n,); default 0.02°.
        joint_noise: s_j likewise.
        parameters: What is identified; default all.
        known: What of these is right in the file. Angles alone do not tell a linkage's size, so name a length.
        offsets: Joints and motors' joints whose encoders have an unknown offset.
        priors: Standard deviations of what the file states, by names of numbers, in their units.

    Raises:
        InvalidInputError: A wrong shape or name, a number that is not finite; no more equations than numbers that they
            determine; or pairs by which no number of these is determined.
        ConvergenceError: The iteration does not settle, or settles far from the file or with residuals far beyond the
            noise; or the linkage cannot be closed at a pair. So it is with pairs of another branch or mechanism.
        UnsupportedMechanismError: Rows of φ that are redundant: other geometry would not close.
    """
    transmission = instance(transmission, "transmission", Transmission)
    n, mechanism = transmission.n, transmission.joint_model.mechanism
    pairs = _Pairs(
        matrix_rows(motor_positions, "motor_positions", n), matrix_rows(joint_positions, "joint_positions", n),
        _deviations(motor_noise, "motor_noise", n), _deviations(joint_noise, "joint_noise", n),
    )  # fmt: skip
    if len(pairs.motors) != len(pairs.joints) or not len(pairs.motors):
        raise InvalidInputError(
            f"{len(pairs.motors)} motor_positions and {len(pairs.joints)} joint_positions make no pairs"
        )
    if mechanism.constraints().size != mechanism.n_free - mechanism.n:
        raise UnsupportedMechanismError(
            f"'{mechanism.name}' has more closure rows than it has dependent motions: with other lengths it would not "
            "close, so that single lengths cannot be identified; state closures that are not redundant (spherical)"
        )
    told = instance({} if priors is None else priors, "priors", Mapping, "a mapping of names to standard deviations")
    problem = _PairFit(transmission, unknown_numbers(transmission, parameters, known, offsets), pairs, told)
    return _identified(problem, *_solved(problem))


class _Pairs(NamedTuple):
    """What was measured, of shape (N, n) each, and its standard deviations (n,)."""

    motors: Array
    joints: Array
    motor_noise: Array
    joint_noise: Array


def _deviations(value: ArrayLike, name: str, n: int) -> Array:
    given = numbers(value, name)
    if given.shape not in ((), (n,)) or not (given > 0.0).all():
        raise InvalidInputError(f"{name} must be one positive number or {n}")
    return np.broadcast_to(given, (n,))


class _Fit(NamedTuple):
    """An estimate.

    Attributes:
        values: p and o, of shape (k,).
        pairs: The pairs at the estimate of q_j, closed.
        joints: What is left of the joints' displacements, q̂_j − o_j − q_j, of shape (N, n).
        residuals: r, of shape (N, n).
        whitening: L⁻¹ of Σ = L Lᵀ, of shape (N, n, n).
    """

    values: Array
    pairs: ClosedPairs
    joints: Array
    residuals: Array
    whitening: Array


class _PairFit:
    """What the iteration reads, and what it does at an estimate."""

    def __init__(
        self, transmission: Transmission, unknowns: tuple[Parameter, ...], pairs: _Pairs, priors: Mapping[str, float]
    ) -> None:
        self.transmission, self.unknowns, self.measured = transmission, unknowns, pairs
        extent = transmission.joint_model.mechanism.constraints().extent
        self.scales = np.array([extent if each.unit == "m" else 1.0 for each in unknowns])
        self.start = np.array([each.value for each in unknowns])
        self.geometry = [k for k, each in enumerate(unknowns) if each.kind != "offset"]
        self.equations = GeometryEquations(transmission, [unknowns[k] for k in self.geometry])
        places = {each.of: k for k, each in enumerate(unknowns) if each.kind == "offset"}
        sides = transmission.motors, transmission.joints
        self._offsets = [[(i, places[name]) for i, name in enumerate(side) if name in places] for side in sides]
        parts = transmission.motor_side.coordinates.parts
        self._circles = [part.whole is not None for part in parts]
        spreads = {
            each.name: positive(spread, f"priors[{name!r}]")
            for name, spread in priors.items()
            for each in named_numbers(unknowns, [name], "priors")
        }
        told = [k for k, each in enumerate(unknowns) if each.name in spreads]
        self._told = told, np.array([1.0 / spreads[unknowns[k].name] for k in told])

    def at(self, values: Array, x: Array, signs: Array | None = None) -> _Fit:
        """An estimate at configurations near by.

        Raises:
            ConvergenceError: The linkage does not close there.
        """
        pairs, measured = self.equations.closed(x, values[self.geometry], signs), self.measured
        motors, joints = measured.motors - pairs.motors, measured.joints - pairs.joints
        for left, offsets in zip((motors, joints), self._offsets, strict=True):
            for i, k in offsets:
                left[:, i] -= values[k]
        motors[:, self._circles] = np.remainder(motors[:, self._circles] + np.pi, 2.0 * np.pi) - np.pi
        J = pairs.by_joints
        covariance = np.diag(measured.motor_noise**2) + (J * measured.joint_noise**2) @ J.transpose(0, 2, 1)
        residuals = motors - np.einsum("Nij,Nj->Ni", J, joints)
        return _Fit(values, pairs, joints, residuals, np.linalg.inv(np.linalg.cholesky(covariance)))

    def sensitivity(self, fit: _Fit) -> Array:
        """S, of shape (N, n, k)."""
        S = np.zeros((*fit.residuals.shape, len(self.unknowns)))
        S[:, :, self.geometry] = fit.pairs.by_numbers
        motors, joints = self._offsets
        for i, k in motors:
            S[:, i, k] += 1.0
        for i, k in joints:
            S[:, :, k] -= fit.pairs.by_joints[:, :, i]
        return S

    def weighted(self, fit: _Fit) -> Array:
        """W, and below it the priors' rows, of shape (N n + priors, k)."""
        told, weights = self._told
        W = (fit.whitening @ self.sensitivity(fit)).reshape(-1, len(self.unknowns))
        return np.asarray(np.vstack([W, weights[:, None] * np.eye(len(self.unknowns))[told]]) * self.scales)

    def whitened(self, fit: _Fit, whitening: Array) -> Array:
        """Σ^{-1/2} r of some weights, and below it what is left of priors, of shape (N n + priors,)."""
        told, weights = self._told
        left = weights * (self.start - fit.values)[told]
        return np.concatenate([np.einsum("Nij,Nj->Ni", whitening, fit.residuals).ravel(), left])

    def stepped(self, here: _Fit, step: Array) -> _Fit:
        """The estimate after a step of p and o, or after a part of it on which the sum of squares does not grow.

        Raises:
            ConvergenceError: There is none.
        """
        before, blocked = np.linalg.norm(self.whitened(here, here.whitening)), ""
        left = here.residuals - self.sensitivity(here) @ step
        weighted = np.einsum("Nji,Njk,Nk->Ni", here.whitening, here.whitening, left)
        errors = -(self.measured.joint_noise**2) * np.einsum("Nji,Nj->Ni", here.pairs.by_joints, weighted)
        moves = here.joints - errors
        for i, k in self._offsets[1]:
            moves[:, i] -= step[k]
        along = np.einsum("Nij,Nj->Ni", here.pairs.x_by_joints, moves)
        along += here.pairs.x_by_numbers @ step[self.geometry]
        part = 1.0
        for _ in range(_MOST_HALVINGS):
            try:
                there = self.at(here.values + part * step, here.pairs.x + part * along, here.pairs.signs)
                if np.linalg.norm(self.whitened(there, here.whitening)) <= before * (1.0 + _SETTLED):
                    return there
            except ConvergenceError as error:
                blocked = f" ({error})"
            part *= 0.5
        raise ConvergenceError(f"no step from the geometry reached makes residuals smaller{blocked}; {_OTHER}")


def _solved(problem: _PairFit) -> tuple[_Fit, int, int]:
    """Where Gauss–Newton settles, how many directions are observable, and how many steps were taken."""
    here = problem.at(problem.start, problem.equations.start(problem.measured.joints))
    rank = len(problem.unknowns)
    for steps in range(_MOST_STEPS):
        U, s, Vt = np.linalg.svd(problem.weighted(here), full_matrices=False)
        rank = min(rank, _observable(problem, s, len(U)))
        along = U[:, :rank].T @ problem.whitened(here, here.whitening)
        if np.linalg.norm(along) <= _SETTLED * np.sqrt(len(U)):
            return here, rank, steps
        here = problem.stepped(here, Vt[:rank].T @ (along / s[:rank]) * problem.scales)
    raise ConvergenceError(f"the geometry did not settle in {_MOST_STEPS} steps; {_OTHER}")


def _observable(problem: _PairFit, s: Array, equations: int) -> int:
    """How many directions are observable.

    Raises:
        InvalidInputError: None is, or as many as there are equations.
    """
    rank, count = int((s > max(1.0 / _KNOWN, ROUNDING * s[0])).sum()), len(problem.measured.motors)
    if not rank:
        names = ", ".join(each.name for each in problem.unknowns)
        raise InvalidInputError(f"nothing of {names} is observable by these {count} pairs")
    if rank >= equations:
        raise InvalidInputError(
            f"{count} pairs give {equations} equations, and {rank} numbers would be determined by them: measure more "
            "pairs, or name what is known"
        )
    return rank


def _identified(problem: _PairFit, fit: _Fit, rank: int, steps: int) -> IdentifiedGeometry:
    """The result.

    Raises:
        ConvergenceError: It is no geometry that the pairs and the file speak for.
    """
    W = problem.weighted(fit)
    _, s, Vt = np.linalg.svd(W)
    V = Vt[:rank].T / s[:rank] * problem.scales[:, None]
    misfit = float(np.linalg.norm(problem.whitened(fit, fit.whitening)) / np.sqrt(len(W) - rank))
    moved = np.abs(fit.values - problem.start) / problem.scales
    if misfit > _UNFIT or moved.max() > _FAR:
        farthest = problem.unknowns[int(np.argmax(moved))].name
        raise ConvergenceError(
            f"no geometry near the file's explains the pairs: residuals are {misfit:.3g} times the noise stated, and "
            f"{farthest} is {moved.max():.2g} of the linkage's size (or rad) away; {_OTHER}"
        )
    told = {(each.kind, each.of): float(x) for each, x in zip(problem.unknowns, fit.values, strict=True)}
    try:
        changed = changed_mechanism(problem.transmission.joint_model.mechanism, told)
    except CcpinError as error:
        raise ConvergenceError(f"the identified linkage does not close at the reference: {error}") from error
    return IdentifiedGeometry(
        parameters=tuple(each.name for each in problem.unknowns),
        units=tuple(each.unit for each in problem.unknowns),
        stated=problem.start,
        values=fit.values,
        covariance=V @ V.T,
        singular_values=np.concatenate([s, np.zeros(len(problem.start) - len(s))]),
        directions=Vt[rank:] * problem.scales,
        residuals=fit.residuals,
        misfit=misfit,
        iterations=steps,
        description=changed.settled(),
    )
