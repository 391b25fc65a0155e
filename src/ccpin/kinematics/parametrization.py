"""ψ, and what it defines: q′ = σ(q) (12), q̇′ = ρ q̇ (13), (14), and ρ̇ (35).

ψ(q′) = [φ(q′); α(q′)] (9) has φ's rows and n more. Where φ holds redundant rows ψ_q′ is taller than wide; every
statement below is then about its column rank, and ψ_q′⁻¹ is its pseudo-inverse, which on closed configurations
solves the same equations exactly.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array
from ccpin.errors import InvalidInputError, SingularConfigurationError, UnreachableError
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.coordinates import IndependentCoordinates
from ccpin.kinematics.linear import Factor, factorize

SINGULAR_RCOND = 1e-10
CLOSED = 1e-10
_CONTRACTION = 0.125
_SHORTEST_STEP = 2.0**-30
_LARGEST_MOVE = 1.0
_MAX_NEWTON = 12


class ClosedPoint(NamedTuple):
    """A closed, nonsingular configuration.

    Attributes:
        q_free: q′, of shape (nq,).
        factor: The factorised ψ_q′(q′).
        rho: ρ(q′), of shape (n′, n).
    """

    q_free: Array
    factor: Factor
    rho: Array


class Parametrization:
    """σ, ρ and ρ̇ of a mechanism's constraints φ and independent coordinates α.

    Holds scratch memory: one instance a thread.
    """

    def __init__(self, constraints: Constraints, coordinates: IndependentCoordinates, q_reference: Array) -> None:
        self.constraints = constraints
        self.coordinates = coordinates
        self.q_reference = q_reference
        self.model = constraints.model
        rows = constraints.size + coordinates.n
        self._unit = np.vstack([np.zeros((constraints.size, coordinates.n)), np.eye(coordinates.n)])
        self.tolerance = 1e-14 * max(1.0, _reach(self.model))
        self._psi = np.empty((rows, self.model.nv))
        self.turnable = any(loop.rows.directions and loop.rows.alignment for loop in constraints.loops)

    def psi_jacobian(self, q_free: Array) -> Array:
        """ψ_q′ = [φ_q′; α_q′] (10), of shape (m + n, n′)."""
        return np.vstack([self.constraints.value(q_free).jacobian, self.coordinates.jacobian(q_free)])

    def rcond(self, q_free: Array) -> float:
        """Reciprocal condition number of ψ_q′: 0 at a singular configuration."""
        return factorize(self.psi_jacobian(q_free)).rcond

    def at(self, q_free: Array) -> ClosedPoint:
        """ρ = ψ_q′⁻¹ [0; I] (14) at a configuration.

        Raises:
            SingularConfigurationError: ψ_q′ has not full column rank there.
        """
        return self._closed_point(q_free, factorize(self.psi_jacobian(q_free)))

    def rho_dot(self, point: ClosedPoint, v_free: Array) -> Array:
        """ρ̇ = −ψ_q′⁻¹ ψ̇_q′ ρ (35), of shape (n′, n)."""
        return -point.factor.solve(self._psi_rate(point.q_free, v_free) @ point.rho)

    def bias(self, point: ClosedPoint, v_free: Array) -> Array:
        """ρ̇ q̇ = −ψ_q′⁻¹ ψ̇_q′ q̇′, of shape (n′,), for q̇′ = ρ q̇."""
        return -point.factor.solve(self._psi_rate(point.q_free, v_free) @ v_free)

    def sigma(self, q: Array, guess: Array | ClosedPoint | None = None) -> ClosedPoint:
        """q′ = σ(q) (12), on the branch of `guess`.

        Newton's method on ψ̄(q′, q) = ψ(q′) − [0; q] (11) from the guess. A step is trusted only if its second
        Newton correction is at most an eighth of the first and det ψ_q′ keeps its sign: with ω the affine-covariant
        Lipschitz constant of ψ_q′, half of ω‖Δ₁‖ is estimated by ‖Δ₂‖/‖Δ₁‖, so this is a quarter of the largest
        value for which the Newton–Kantorovich theorem gives one solution, continuously connected to the guess.
        Where it does not hold, σ walks along the straight line from α(guess) to q in shorter steps. The path
        depends on q and guess only.

        Args:
            q: Independent coordinates, of shape (nq_independent,).
            guess: A configuration (closed or nearly so) on the branch wanted; default the reference. A closed point
                spares the first evaluation.

        Raises:
            UnreachableError: The line is blocked by a singularity before q.
            SingularConfigurationError: q itself is singular.
            InvalidInputError: The guess cannot be closed, or only with a closure's axes turned end for end.
        """
        point, blocked = self._step(self.q_reference if guess is None else guess, q)
        if point is None:
            start = guess.q_free if isinstance(guess, ClosedPoint) else self.q_reference if guess is None else guess
            point = self._walk(self._closed_start(start) if blocked else start, q)
        if isinstance(guess, np.ndarray) and self.turnable and not self.constraints.aligned(point.q_free):
            raise InvalidInputError(
                "the guess satisfies φ = 0 with a closure's axes turned end for end; pass a configuration closed the "
                "right way round"
            )
        return point

    def _walk(self, start: Array, q: Array) -> ClosedPoint:
        coordinates = self.coordinates
        q_start = coordinates.alpha(start)
        line = coordinates.difference(q_start, q)
        here, done, stride = start, 0.0, 0.5
        while stride >= _SHORTEST_STEP:
            ahead = min(1.0, done + stride)
            target = q if ahead == 1.0 else coordinates.integrate(q_start, ahead * line)
            point, _ = self._step(here, target)
            if point is None:
                stride *= 0.5
                continue
            if ahead == 1.0:
                return point
            here, done, stride = point.q_free, ahead, 2.0 * stride
        rcond = self.rcond(here)
        left = float(np.linalg.norm((1.0 - done) * line))
        if left <= 1e-6:
            raise SingularConfigurationError(
                f"q = {_show(q)} is a singular configuration: the independent coordinates do not fix the motion "
                f"there (reciprocal condition number of ψ_q′ {rcond:.1e} at a distance of {left:.1e})",
                q_free=here,
                rcond=rcond,
            )
        reached = coordinates.alpha(here)
        raise UnreachableError(
            f"q = {_show(q)} cannot be reached from q = {_show(q_start)} along a straight line: it is blocked by a "
            f"singularity or the end of the workspace after {100 * done:.2f} % of the way, at q = {_show(reached)} "
            f"(reciprocal condition number of ψ_q′ {rcond:.1e}); pass a guess nearer to it if another way exists",
            q=q,
            q_reached=reached,
            fraction=done,
            rcond=rcond,
        )

    def _step(self, start: Array | ClosedPoint, q: Array) -> tuple[ClosedPoint | None, bool]:
        """One trusted Newton solve from a start; (``None``, whether the start was open) where it is not trusted."""
        known = start if isinstance(start, ClosedPoint) else None
        q_free: Array = start.q_free if isinstance(start, ClosedPoint) else start
        first, sign, last, trusted, start_open = q_free, 0, 0.0, False, False
        for iteration in range(_MAX_NEWTON):
            if known is not None and iteration == 0:
                gap, factor = self._gap(np.zeros(self.constraints.size), q_free, q), known.factor
            else:
                gap, factor = self._linearized(q_free, q)
            if iteration == 0:
                sign = factor.sign
                start_open = bool(np.abs(gap[: self.constraints.size]).max(initial=0.0) > 1e-6)
            if factor.rcond < SINGULAR_RCOND:
                return None, start_open
            size = float(np.abs(gap).max()) if gap.size else 0.0
            if size <= self.tolerance or (trusted and last <= 1e-9 and size <= 100 * self.tolerance):
                if factor.sign != sign:
                    return None, start_open
                return self._closed_point(q_free if iteration else first.copy(), factor), start_open
            step = factor.solve(gap)
            length = float(np.linalg.norm(step))
            if not length <= _LARGEST_MOVE:
                return None, start_open
            if iteration and length > _CONTRACTION * last and length > 1e-9:
                return None, start_open
            trusted, last = True, length
            q_free = q_free + step if self.model.nq == self.model.nv else pin.integrate(self.model, q_free, step)
        return None, start_open

    def _linearized(self, q_free: Array, q: Array) -> tuple[Array, Factor]:
        """−ψ̄(q′, q) and the factorised ψ_q′."""
        value = self.constraints.value(q_free)
        m = self.constraints.size
        self._psi[:m] = value.jacobian
        self._psi[m:] = self.coordinates.jacobian(q_free)
        return self._gap(value.phi, q_free, q), factorize(self._psi)

    def _gap(self, phi: Array, q_free: Array, q: Array) -> Array:
        """−ψ̄(q′, q) = [−φ; q − α(q′)] (11)."""
        gap = np.empty(len(self._psi))
        gap[: len(phi)] = -phi
        gap[len(phi) :] = self.coordinates.difference(self.coordinates.alpha(q_free), q)
        return gap

    def _closed_start(self, start: Array) -> Array:
        """Close an open guess at its own q.

        Raises:
            InvalidInputError: It is too far open for that.
        """
        q = self.coordinates.alpha(start)
        q_free = start
        for _ in range(_MAX_NEWTON):
            gap, factor = self._linearized(q_free, q)
            if float(np.abs(gap).max()) <= self.tolerance:
                return q_free
            step = factor.solve(gap) if factor.rcond >= SINGULAR_RCOND else np.full(self.model.nv, np.inf)
            if not float(np.linalg.norm(step)) <= _LARGEST_MOVE:
                break
            q_free = pin.integrate(self.model, q_free, step)
        error = float(np.abs(self.constraints.residual(start)).max())
        raise InvalidInputError(
            f"the guess is open by {error:.3g} (m or rad) and cannot be closed at its own q = {_show(q)}; "
            "pass a closed configuration of the branch wanted"
        )

    def _closed_point(self, q_free: Array, factor: Factor) -> ClosedPoint:
        if factor.rcond < SINGULAR_RCOND:
            raise SingularConfigurationError(
                f"q′ = {_show(q_free)} is a singular configuration: ψ_q′ has a reciprocal condition number of "
                f"{factor.rcond:.1e}, so the independent coordinates do not fix the motion there",
                q_free=q_free,
                rcond=factor.rcond,
            )
        return ClosedPoint(q_free, factor, factor.solve(self._unit))

    def _psi_rate(self, q_free: Array, v_free: Array) -> Array:
        """ψ̇_q′ along q̇′, of shape (m + n, n′)."""
        rate = np.zeros_like(self._psi)
        rate[: self.constraints.size] = self.constraints.rate(q_free, v_free).jacobian_rate
        alpha_rate = self.coordinates.jacobian_rate(q_free, v_free)
        if alpha_rate is not None:
            rate[self.constraints.size :] = alpha_rate
        return rate


def _reach(model: pin.Model) -> float:
    return float(sum(np.linalg.norm(placement.translation) for placement in model.jointPlacements))


def _show(q: Array) -> str:
    return np.array2string(np.asarray(q), precision=6, separator=", ", max_line_width=200, threshold=12)
