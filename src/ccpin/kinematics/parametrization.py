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
from ccpin.kinematics.branches import TRUSTED, Branches
from ccpin.kinematics.constraints import Constraints, ConstraintValue
from ccpin.kinematics.coordinates import IndependentCoordinates
from ccpin.kinematics.linear import Factor, factorize
from ccpin.kinematics.points import moved

SINGULAR_RCOND = 1e-10
_CONTRACTION = 0.125
_NOISE = 1e-9
_TRUSTED = 1 / 64
_SHORTEST_STEP = 2.0**-30
_MOST_STEPS = 11
_MOST_CLOSING = 100
_MOST_WALKING = 1000


class ClosedPoint(NamedTuple):
    """A closed, nonsingular configuration.

    Attributes:
        q_free: q′, of shape (nq,).
        factor: The factorised ψ_q′(q′).
        rho: ρ(q′), of shape (n′, n).
        constraints: φ and φ_q′ there.
    """

    q_free: Array
    factor: Factor
    rho: Array
    constraints: ConstraintValue


class NewtonRules(NamedTuple):
    """When Newton's method on ψ̄ is trusted, and when it is done.

    Attributes:
        tolerance: Largest |ψ̄| of a solution, metres and radians.
        most_steps: Hard cap on linear solves.
        contraction: A correction may be at most this part of the one before (or `noise`).
        noise: Corrections below this length are rounding.
        stalled: Largest |ψ̄| of a solution whose last correction was rounding.
        partly: Whether to go the part of the way that is proven where not all of it is.
    """

    tolerance: float
    most_steps: int
    contraction: float = _CONTRACTION
    noise: float = _NOISE
    stalled: float = 0.0
    partly: bool = False


class NewtonSolve(NamedTuple):
    """How Newton's method ended.

    Attributes:
        point: σ(q), or ``None`` where an iteration was not trusted, did not converge or met a singularity.
        steps: Newton steps taken.
        residual: Largest |ψ̄| at the last iterate, metres and radians.
        started_open: Whether the start was not closed.
        part: Which part of the way to q is proven to stay on the start's branch; the solution is that far.
    """

    point: ClosedPoint | None
    steps: int
    residual: float
    started_open: bool
    part: float


class Parametrization:
    """σ, ρ and ρ̇ of a mechanism's constraints φ and independent coordinates α; a pure function of them.

    Attributes:
        rules: When σ's Newton steps are trusted and done.
        turnable: Whether some closure's rows vanish with its axes turned end for end too.
    """

    def __init__(self, constraints: Constraints, coordinates: IndependentCoordinates, q_reference: Array) -> None:
        self.constraints = constraints
        self.coordinates = coordinates
        self.q_reference = q_reference
        self.model = constraints.model
        self._unit = np.vstack([np.zeros((constraints.size, coordinates.n)), np.eye(coordinates.n)])
        tolerance = 1e-14 * max(1.0, _reach(self.model))
        self.rules = NewtonRules(tolerance, _MOST_STEPS, stalled=100 * tolerance, partly=True)
        self._branches = Branches(constraints, coordinates, tolerance)
        self.turnable = any(loop.turnable for loop in constraints.loops)

    def psi_jacobian(self, q_free: Array) -> Array:
        """ψ_q′ = [φ_q′; α_q′] (10), of shape (m + n, n′)."""
        return self._stacked(self.constraints.value(q_free))

    def rcond(self, q_free: Array) -> float:
        """Reciprocal condition number of ψ_q′: 0 at a singular configuration."""
        return factorize(self.psi_jacobian(q_free)).rcond

    def at(self, q_free: Array) -> ClosedPoint:
        """ρ = ψ_q′⁻¹ [0; I] (14) at a configuration.

        Raises:
            SingularConfigurationError: ψ_q′ has not full column rank there.
        """
        point = self.constraints.value(q_free)
        return self._closed_point(point, factorize(self._stacked(point)))

    def rho_dot(self, point: ClosedPoint, v_free: Array) -> Array:
        """ρ̇ = −ψ_q′⁻¹ ψ̇_q′ ρ (35), of shape (n′, n)."""
        rows = self.constraints.rate(point.constraints, v_free) @ point.rho
        return self._against(rows, point, v_free, point.rho)

    def bias(self, point: ClosedPoint, v_free: Array) -> Array:
        """ρ̇ q̇ = −ψ_q′⁻¹ ψ̇_q′ q̇′, of shape (n′,), for q̇′ = ρ q̇."""
        return self._against(self.constraints.bias(point.constraints, v_free), point, v_free, v_free)

    def _against(self, rows: Array, point: ClosedPoint, v_free: Array, w: Array) -> Array:
        """−ψ_q′⁻¹ [rows; α̇_q′ w]: `rows` is φ̇_q′ w."""
        m = len(rows)
        right = np.zeros((m + self.coordinates.n, *rows.shape[1:]))
        right[:m] = rows
        alpha_rate = self.coordinates.jacobian_rate(point.q_free, v_free)
        if alpha_rate is not None:
            right[m:] = alpha_rate @ w
        return -point.factor.solve(right)

    def sigma(self, q: Array, guess: Array | ClosedPoint | None = None) -> ClosedPoint:
        """q′ = σ(q) (12), on the branch of `guess`.

        Newton's method on ψ̄(q′, q) = ψ(q′) − [0; q] (11) from the guess. Where the step is short and its second
        correction at most a 64th of the first (`Branches.short`), the solution is trusted by these estimates. Any other
        must be proven to lie on the guess's branch: by the theorem in `ccpin.kinematics.branches` ψ_q′ is regular along
        the whole path of solutions over the straight line from α(guess) to q, and the solution is its end. Where that
        fails σ walks along the line, as far at a time as is proven; an open guess is closed first, along a path with
        ψ_q′ regular. The path depends on q and guess only.

        Args:
            q: Independent coordinates, of shape (model.nq,).
            guess: A configuration (closed or nearly so) on the branch wanted; default the reference. A closed point
                spares the first evaluation.

        Raises:
            UnreachableError: The line is blocked by a singularity before q.
            SingularConfigurationError: q itself is singular.
            InvalidInputError: The guess cannot be closed, or only with a closure's axes turned end for end.
        """
        start = self.q_reference if guess is None else guess
        solve = self.newton(start, q, self.rules)
        point = solve.point
        if point is None or solve.part < 1.0:
            point = self._walk(start, q, solve)
        if isinstance(guess, np.ndarray) and self.turnable and not self.constraints.aligned(point.q_free):
            raise InvalidInputError(
                "the guess satisfies φ = 0 with a closure's axes turned end for end; pass a configuration closed the "
                "right way round"
            )
        return point

    def _walk(self, start: Array | ClosedPoint, q: Array, solve: NewtonSolve) -> ClosedPoint:
        """σ(q) along the straight line, each step as long as it is proven; `solve` is the first."""
        coordinates, here, left, most = self.coordinates, start, 1.0, 1.0
        if solve.started_open:
            here = self._closed_start(start.q_free if isinstance(start, ClosedPoint) else start)
            solve = self.newton(here, q, self.rules)
        q_start = coordinates.alpha(here.q_free if isinstance(here, ClosedPoint) else here)
        line = coordinates.difference(q_start, q)
        for _ in range(_MOST_WALKING):
            if solve.point is not None:
                if solve.part == 1.0:
                    return solve.point
                here, left, most = solve.point, left * (1.0 - solve.part), 1.0
            else:
                most = 0.5 * solve.part
            if left * most < _SHORTEST_STEP:
                break
            solve = self.newton(here, q, self.rules, most)
        done = 1.0 - left
        if isinstance(here, ClosedPoint):
            here = here.q_free
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

    def newton(
        self, start: Array | ClosedPoint, q: Array, rules: NewtonRules, most: float = 1.0, *, trusting: bool = True
    ) -> NewtonSolve:
        """Newton's method on ψ̄(q′, q) = 0 (11) from a start, given up where it is not proven to stay on its branch.

        Pure: the same arguments give the same answer. The time it takes is bounded by `most_steps` + 1 evaluations and
        factorisations of ψ_q′ and one proof. A closed point spares the first. `most` is the largest part of the way.
        """
        known, trusting = start if isinstance(start, ClosedPoint) else None, trusting and most == 1.0
        q_free: Array = start.q_free if isinstance(start, ClosedPoint) else start.copy()
        first, proof, part, sign, last, residual, started_open = q_free, TRUSTED, 1.0, 0, np.inf, np.inf, False
        for steps in range(rules.most_steps + 1):
            if known is not None and not steps:
                point, factor = known.constraints, known.factor
            else:
                point = self.constraints.value(q_free)
                factor = factorize(self._stacked(point))
            gap = self._gap(point, q)
            residual = float(np.abs(gap).max(initial=0.0))
            if not steps:
                sign, started_open = factor.sign, bool(np.abs(point.phi).max(initial=0.0) > 1e-6)
            if factor.rcond < SINGULAR_RCOND or factor.sign != sign:
                break
            if residual <= rules.tolerance or (last <= rules.noise and residual <= rules.stalled):
                if steps and not proof.holds(self._displacement(first, q_free)):
                    break
                found = self._closed_point(point, factor)
                return NewtonSolve(found, steps, residual, started_open, part)
            if steps == rules.most_steps:
                break
            step = factor.solve(gap)
            if not steps and not (trusting := trusting and not started_open and self._branches.short(factor, step)):
                proof = self._branches.prove(point, self._stacked(point), gap).within(most)
                part = proof.part
                if part < 1.0:
                    if started_open or not rules.partly or not part > 0.0:
                        return NewtonSolve(None, 1, residual, started_open, part)
                    away = gap[self.constraints.size :]
                    q, step = self.coordinates.integrate(self.coordinates.alpha(q_free), part * away), part * step
            length = float(np.linalg.norm(step))
            if trusting and steps == 1 and not length <= max(_TRUSTED * last, rules.noise):
                if not rules.partly:
                    break
                return self.newton(start, q, rules, most, trusting=False)
            if not length <= max(rules.contraction * last, rules.noise):
                break
            q_free, last = moved(self.model, q_free, step), length
        return NewtonSolve(None, steps, residual, started_open, part)

    def _displacement(self, q_from: Array, q_to: Array) -> Array:
        """e with q_from ⊕ e = q_to, of shape (n′,)."""
        plain = self.model.nq == self.model.nv
        return q_to - q_from if plain else np.asarray(pin.difference(self.model, q_from, q_to))

    def _stacked(self, point: ConstraintValue) -> Array:
        """ψ_q′ (10), of shape (m + n, n′)."""
        return np.concatenate([point.jacobian, self.coordinates.jacobian(point.q_free)])

    def _gap(self, point: ConstraintValue, q: Array) -> Array:
        """−ψ̄(q′, q) = [−φ; q − α(q′)] (11)."""
        missing = self.coordinates.difference(self.coordinates.alpha(point.q_free), q)
        return np.concatenate([-point.phi, missing])

    def _closed_start(self, start: Array) -> Array:
        """Close an open guess at its own q, by parts of Newton steps along which ψ_q′ is proven regular.

        Raises:
            InvalidInputError: It is too far open for that.
        """
        q, q_free, rules = self.coordinates.alpha(start), start, self.rules._replace(contraction=1.0, partly=False)
        for _ in range(_MOST_CLOSING):
            solve = self.newton(q_free, q, rules)
            if solve.point is not None:
                return solve.point.q_free
            point = self.constraints.value(q_free)
            factor = factorize(self._stacked(point))
            part = solve.part if solve.part < 1.0 else 0.5
            if factor.rcond < SINGULAR_RCOND or not part > 0.0:
                break
            q_free = moved(self.model, q_free, part * factor.solve(self._gap(point, q)))
        error = float(np.abs(self.constraints.residual(start)).max())
        raise InvalidInputError(
            f"the guess is open by {error:.3g} (m or rad) and cannot be closed at its own q = {_show(q)}; "
            "pass a closed configuration of the branch wanted"
        )

    def _closed_point(self, point: ConstraintValue, factor: Factor) -> ClosedPoint:
        if factor.rcond < SINGULAR_RCOND:
            raise SingularConfigurationError(
                f"q′ = {_show(point.q_free)} is a singular configuration: ψ_q′ has a reciprocal condition number of "
                f"{factor.rcond:.1e}, so the independent coordinates do not fix the motion there",
                q_free=point.q_free,
                rcond=factor.rcond,
            )
        return ClosedPoint(point.q_free, factor, factor.solve(self._unit), point)


def _reach(model: pin.Model) -> float:
    return float(sum(np.linalg.norm(placement.translation) for placement in model.jointPlacements))


def _show(q: Array) -> str:
    return np.array2string(np.asarray(q), precision=6, separator=", ", max_line_width=200, threshold=12)
