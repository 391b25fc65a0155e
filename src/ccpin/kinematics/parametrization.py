"""ψ, and what it defines: q′ = σ(q) (12), q̇′ = ρ q̇ (13), (14), and ρ̇ (35).

ψ(q′) = [φ(q′); α(q′)] (9) has φ's rows and n more. Where φ holds redundant rows ψ_q′ is taller than wide; every
statement below is then about its column rank, and ψ_q′⁻¹ is its pseudo-inverse, which on closed configurations
solves the same equations exactly.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array, Indices
from ccpin.errors import InvalidInputError, SingularConfigurationError, UnreachableError
from ccpin.kinematics.clusters import find_clusters
from ccpin.kinematics.constraints import Constraints, ConstraintValue
from ccpin.kinematics.continuation import Continuation
from ccpin.kinematics.coordinates import IndependentCoordinates
from ccpin.kinematics.dead_ends import SHORTEST_STEP, SINGULAR_WITHIN, DeadEnds
from ccpin.kinematics.least_squares import Linearized
from ccpin.kinematics.linear import Factor, factorize
from ccpin.kinematics.points import moved
from ccpin.kinematics.tree import Tree

SINGULAR_RCOND = 1e-10  # of ψ_q′: below it a configuration is called singular
_CONTRACTION = 0.125  # of the correction before: Newton's next one, or the step is not trusted
_TURN = 0.5  # relative change of ψ_q′⁻¹ over a step (`turn_between`): with more it is not trusted
_ROUNDED = 2.0  # |Y|² times rounding (`turn_between`): above it branches are not told apart
_FAR_FROM_SINGULAR = 2e-7  # the same: above it a step is taken to be near a singularity
_NEAR_SINGULAR = 0.25  # of _CONTRACTION and _TURN: kept to near a singularity, or the step is to be proved
_NARROW = 0.5  # of _TURN: kept to elsewhere
_NOISE = 1e-9  # rad or m: a correction below is rounding
_LARGEST_MOVE = 1.0  # rad or m, of one correction of Newton's
_MOST_STEPS = 11  # of Newton: a hard cap, which steps that contract do not meet


class ClosedPoint(NamedTuple):
    """A closed, nonsingular configuration.

    Attributes:
        q_free: q′, of shape (nq,).
        factor: The factorised ψ_q′(q′).
        rho: ρ(q′), of shape (n′, n).
        probe: ψ_q′⁻¹ B for the B of `Parametrization.turn_between`, of shape (n′, 2).
        constraints: φ and φ_q′ there.
    """

    q_free: Array
    factor: Factor
    rho: Array
    probe: Array
    constraints: ConstraintValue


class NewtonRules(NamedTuple):
    """When Newton's method on ψ̄ is trusted, and when it is done.

    Attributes:
        tolerance: Largest |ψ̄| of a solution, metres and radians.
        most_steps: Hard cap on linear solves.
        contraction: A correction may be at most this part of the one before (or `noise`).
        noise: Corrections below this length are rounding.
        stalled: Largest |ψ̄| of a solution whose last correction was rounding.
    """

    tolerance: float
    most_steps: int
    contraction: float = _CONTRACTION
    noise: float = _NOISE
    stalled: float = 0.0


class NewtonSolve(NamedTuple):
    """How Newton's method ended.

    Attributes:
        point: σ(q), or ``None`` where an iteration was not trusted, did not converge or met a singularity.
        steps: Newton steps taken.
        residual: Largest |ψ̄| at the last iterate, metres and radians.
        started_open: Whether the start was not closed.
        change: By how much of itself ψ_q′⁻¹ B changed on the way.
        contraction: The largest part that a correction was of the one before.
        near_singular: Whether ψ_q′⁻¹ is so large somewhere on the way that estimates are to hold by a wider margin.
    """

    point: ClosedPoint | None
    steps: int
    residual: float
    started_open: bool
    change: float = 0.0
    contraction: float = 0.0
    near_singular: bool = False


class Parametrization:
    """σ, ρ and ρ̇ of a mechanism's constraints φ and independent coordinates α; a pure function of them.

    Attributes:
        rules: When σ's Newton steps are trusted and done.
        continuation: What proves a step where these tests are not passed by a wide margin.
        turnable: Whether some closure's rows vanish with its axes turned end for end too.
    """

    def __init__(self, constraints: Constraints, coordinates: IndependentCoordinates, q_reference: Array) -> None:
        self.constraints = constraints
        self.coordinates = coordinates
        self.q_reference = q_reference
        self.model = constraints.model
        self._unit = np.vstack([np.zeros((constraints.size, coordinates.n)), np.eye(coordinates.n)])
        tolerance = 1e-14 * max(1.0, _reach(self.model))
        self.rules = NewtonRules(tolerance, _MOST_STEPS, stalled=100 * tolerance)
        self.turnable = any(loop.turnable for loop in constraints.loops)
        self._cluster_of = _clusters_of(coordinates.tree, constraints)
        self.continuation = Continuation(constraints, coordinates, tolerance)

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

    def sigma(self, q: Array, near: Array | ClosedPoint | None = None, proved: bool = False) -> ClosedPoint:
        """q′ = σ(q) (12), on the branch of `near`.

        Newton's method on ψ̄(q′, q) = ψ(q′) − [0; q] (11) from `near`. A step is taken if it is safe by a wide
        margin: its second Newton correction is at most an eighth of the first, det ψ_q′ keeps its sign, and ψ_q′⁻¹ B
        changes by a quarter of itself at most (`turn_between`). With ω the affine-covariant Lipschitz constant of
        ψ_q′, half of ω‖Δ₁‖ is estimated by ‖Δ₂‖/‖Δ₁‖, so the first is a quarter of the largest value for which the
        Newton–Kantorovich theorem gives one solution, continuously connected to `near`; the last sees what the
        correction, by a symmetry, does not. These are estimates. Where ψ_q′⁻¹ is large, so near singular
        configurations, a thirty-second and an eighth are asked. A bolder step there, of up to an eighth and a
        half, and every step if `proved` is asked for, is taken only if the theorem of `continuation` proves it.
        Otherwise σ walks along the straight line from α(near) to q in shorter steps; what is open is closed first,
        likewise, by letting φ vanish along a straight line. The path depends on q, `near` and `proved` only.

        Args:
            q: Independent coordinates, of shape (model.nq,).
            near: A configuration (closed or nearly so) on the branch wanted; default the reference. A closed point
                spares the first evaluation.
            proved: Take no step on an estimate. The point is then that which `near` is continued to along the
                straight lines, by proof, and no singular configuration is on the way.

        Raises:
            UnreachableError: The line is blocked by a singularity before q.
            SingularConfigurationError: q itself is singular.
            InvalidInputError: `near` cannot be closed, or only with a closure's axes turned end for end.
        """
        start = self.q_reference if near is None else near
        solve = self._step(start, q, proved)
        point = solve.point
        if point is None:
            point = self._walk(self._closed_start(start, proved) if solve.started_open else start, q, proved)
        if isinstance(near, np.ndarray) and self.turnable and not self.constraints.aligned(point.q_free):
            raise InvalidInputError(
                "near satisfies φ = 0 with a closure's axes turned end for end; pass a configuration closed the "
                "right way round"
            )
        return point

    def _step(self, here: Array | ClosedPoint, q: Array, proved: bool, open_by: Array | float = 0.0) -> NewtonSolve:
        """Newton's method from a configuration, as far as it is trusted by a wide margin or proved."""
        solve = self.newton(here, q, self.rules, open_by)
        if solve.point is None or not solve.steps:
            return solve
        contraction, turn = (_NEAR_SINGULAR, _NEAR_SINGULAR) if solve.near_singular else (1.0, _NARROW)
        clear = solve.contraction <= contraction * _CONTRACTION and solve.change <= turn * _TURN
        asks = proved or (solve.near_singular and not clear)
        sure = self._proves(here, solve) if asks else clear
        return solve if sure else solve._replace(point=None)

    def _proves(self, here: Array | ClosedPoint, solve: NewtonSolve) -> bool:
        """Whether the solution is proved to be what a configuration is continued to."""
        end, begin = solve.point, here.constraints if isinstance(here, ClosedPoint) else self.constraints.value(here)
        return end is not None and self.continuation.proved(begin, end.constraints, end.factor, solve.residual)

    def _walk(self, start: Array | ClosedPoint, q: Array, proved: bool) -> ClosedPoint:
        """σ(q) along the straight line from α(start), step by step."""
        coordinates = self.coordinates
        q_start = coordinates.alpha(_configuration(start))
        line = coordinates.difference(q_start, q)

        def step(here: Array | ClosedPoint, ahead: float) -> ClosedPoint | None:
            target = q if ahead == 1.0 else coordinates.integrate(q_start, ahead * line)
            return self._step(here, target, proved).point

        here, done = _follow(step, start, DeadEnds(self, q_start, q))
        if done == 1.0:
            assert isinstance(here, ClosedPoint)
            return here
        reached = _configuration(here)
        raise self.blocked(start, q, done, reached, self.rcond(reached))

    def blocked(
        self, start: Array | ClosedPoint, q: Array, done: float, reached: Array, rcond: float
    ) -> SingularConfigurationError | UnreachableError:
        """What is raised where the straight line from α(start) to q is walked no farther.

        Args:
            start: The configuration begun at.
            q: Independent coordinates asked for.
            done: How much of the line is.
            reached: q′ there.
            rcond: Reciprocal condition number of ψ_q′ there.
        """
        q_start = self.coordinates.alpha(_configuration(start))
        left = (1.0 - done) * float(np.linalg.norm(self.coordinates.difference(q_start, q)))
        if left <= SINGULAR_WITHIN:
            return SingularConfigurationError(
                f"q = {_show(q)} is a singular configuration: the independent coordinates do not fix the motion "
                f"there (reciprocal condition number of ψ_q′ {rcond:.1e} at a distance of {left:.1e})",
                q_free=reached,
                rcond=rcond,
            )
        q_reached = self.coordinates.alpha(reached)
        return UnreachableError(
            f"q = {_show(q)} cannot be reached from q = {_show(q_start)} along a straight line: it is blocked by a "
            f"singularity or the end of the workspace after {100 * done:.2f} % of the way, at q = {_show(q_reached)} "
            f"(reciprocal condition number of ψ_q′ {rcond:.1e}); pass near= closer to it if another way exists; "
            "ccpin.dynamics.assembly_modes(model, q) looks whether the loops close there at all",
            q=q,
            q_reached=q_reached,
            fraction=done,
            rcond=rcond,
        )

    def _closed_start(self, start: Array | ClosedPoint, proved: bool) -> ClosedPoint:
        """Close an open configuration at its own q: φ goes to zero along a straight line, step by step.

        Raises:
            InvalidInputError: It is too far open for that.
        """
        q_free = _configuration(start)
        q, phi = self.coordinates.alpha(q_free), self.constraints.residual(q_free)

        def step(here: Array | ClosedPoint, ahead: float) -> ClosedPoint | None:
            return self._step(here, q, proved, (1.0 - ahead) * phi).point

        here, done = _follow(step, start)
        if done == 1.0:
            assert isinstance(here, ClosedPoint)
            return here
        raise InvalidInputError(
            f"near is open by {self.constraints.misfit(phi)} and cannot be closed at its own q = {_show(q)}; "
            "pass a closed configuration of the branch wanted"
        )

    def turn_between(self, before: Array, after: Array) -> tuple[float, float]:
        """How much ψ_q′⁻¹ changes between two near configurations, and how large it is, by Y = ψ_q′⁻¹ B.

        Where ψ_q′ becomes singular Y grows beyond all bounds and comes back with the other sign, for every B that is
        not orthogonal to a left null vector there; B has no structure, so that none is, and two columns, so that such a
        vector may turn past one on the way. And |Y| tells ‖ψ_q′⁻¹‖: where its square times the rounding of closed
        configurations is not small, they are known no better than the distance to the next branch.

        Returns:
            The largest change of a cluster's Y relative to itself, and the largest |Y|² times that rounding.
        """
        sizes, here, changes = (
            np.bincount(self._cluster_of, np.einsum("ij,ij->i", x, x)) for x in (before, after, after - before)
        )
        change = max((c / s for c, s in zip(changes.tolist(), sizes.tolist(), strict=True) if c), default=0.0)
        rounded = float(max(sizes.max(initial=0.0), here.max(initial=0.0))) * self.rules.tolerance
        return float(np.sqrt(change)), rounded

    def newton(
        self, start: Array | ClosedPoint, q: Array, rules: NewtonRules, open_by: Array | float = 0.0
    ) -> NewtonSolve:
        """Newton's method on ψ̄(q′, q) = [φ; 0] (11), φ being `open_by`, given up where it is not to be trusted.

        Pure: the same arguments give the same answer. The time it takes is bounded by `most_steps` + 1 evaluations and
        factorisations of ψ_q′. A closed point spares the first.
        """
        known = start if isinstance(start, ClosedPoint) else None
        q_free: Array = start.q_free if isinstance(start, ClosedPoint) else start.copy()
        sign, last, residual, started_open, probe, shrank = 0, np.inf, np.inf, False, np.zeros((0, 2)), 0.0
        for steps in range(rules.most_steps + 1):
            if known is not None and not steps:
                point, factor = known.constraints, known.factor
            else:
                point = self.constraints.value(q_free)
                factor = factorize(self._stacked(point))
            gap = self._gap(point, q, open_by)
            residual = float(np.abs(gap).max(initial=0.0))
            if not steps:
                sign, started_open = factor.sign, bool(np.abs(point.phi).max(initial=0.0) > 1e-6)
                probe = factor.solve(self.continuation.unstructured) if known is None else known.probe
            if factor.rcond < SINGULAR_RCOND or factor.sign != sign:
                break
            if residual <= rules.tolerance or (last <= rules.noise and residual <= rules.stalled):
                found = self._closed_point(point, factor)
                change, rounded = self.turn_between(probe, found.probe)
                trusted = found if change <= _TURN and rounded <= _ROUNDED else None
                return NewtonSolve(trusted, steps, residual, started_open, change, shrank, rounded > _FAR_FROM_SINGULAR)
            if steps == rules.most_steps:
                break
            step = factor.solve(gap)
            length = float(np.linalg.norm(step))
            if not length <= _LARGEST_MOVE or length > max(rules.contraction * last, rules.noise):
                return NewtonSolve(None, steps + 1, residual, started_open)
            if length > rules.noise:
                shrank = max(shrank, length / last)
            q_free, last = moved(self.model, q_free, step), length
        return NewtonSolve(None, steps, residual, started_open)

    def equations(self, q: Array) -> Callable[[Array], Linearized]:
        """ψ̄(q′, q) = ψ(q′) − [0; q] (11) and ψ_q′, of q′."""

        def linearize(q_free: Array) -> Linearized:
            point = self.constraints.value(q_free)
            return Linearized(-self._gap(point, q, 0.0), self._stacked(point))

        return linearize

    def _stacked(self, point: ConstraintValue) -> Array:
        """ψ_q′ (10), of shape (m + n, n′)."""
        return np.concatenate([point.jacobian, self.coordinates.jacobian(point.q_free)])

    def _gap(self, point: ConstraintValue, q: Array, open_by: Array | float) -> Array:
        """−ψ̄(q′, q) = [open_by − φ; q − α(q′)] (11)."""
        missing = self.coordinates.difference(self.coordinates.alpha(point.q_free), q)
        return np.concatenate([open_by - point.phi, missing])

    def _closed_point(self, point: ConstraintValue, factor: Factor) -> ClosedPoint:
        if factor.rcond < SINGULAR_RCOND:
            raise SingularConfigurationError(
                f"q′ = {_show(point.q_free)} is a singular configuration: ψ_q′ has a reciprocal condition number of "
                f"{factor.rcond:.1e}, so the independent coordinates do not fix the motion there",
                q_free=point.q_free,
                rcond=factor.rcond,
            )
        probe = factor.solve(self.continuation.unstructured)
        return ClosedPoint(point.q_free, factor, factor.solve(self._unit), probe, point)


def _follow(
    step: Callable[[Array | ClosedPoint, float], ClosedPoint | None],
    start: Array | ClosedPoint,
    ends: Callable[[ClosedPoint, float], tuple[Array, float] | None] | None = None,
) -> tuple[Array | ClosedPoint, float]:
    """Where a path leads, and how much of it: 1, all. Steps are halved where not trusted, doubled after two taken.

    `ends` says of a place on the path whether it ends before 1 for certain, and where.
    """
    here, done, stride, grows = start, 0.0, 0.5, True
    while stride >= SHORTEST_STEP:
        ahead = min(1.0, done + stride)
        point = step(here, ahead)
        if point is None:
            stride, grows = 0.5 * stride, False
            continue
        here, done, stride, grows = point, ahead, 2.0 * stride if grows else stride, True
        if ahead == 1.0:
            break
        end = None if ends is None else ends(point, done)
        if end is not None:
            return end
    return here, done


def _configuration(start: Array | ClosedPoint) -> Array:
    return start.q_free if isinstance(start, ClosedPoint) else start


def _clusters_of(tree: Tree, constraints: Constraints) -> Indices:
    """The cluster of each component of q̇′."""
    owner = [joint.number for joint in tree.joints for _ in range(joint.v.start, joint.v.stop)]
    ties = [[*loop.path_a, *loop.path_b] for loop in constraints.loops]
    ties += [[owner[term.idx_v] for term in coupling.terms] for coupling in constraints.couplings]
    found = find_clusters([0, *(joint.parent for joint in tree.joints)], ties)
    number = {joint: k for k, cluster in enumerate(found) for joint in cluster.joints}
    return np.array([number[joint] for joint in owner], dtype=np.intp)


def _reach(model: pin.Model) -> float:
    return float(sum(np.linalg.norm(placement.translation) for placement in model.jointPlacements))


def _show(q: Array) -> str:
    """Seven digits of each, of many the first and last: NumPy's own way takes longer than many a refusal."""
    shown = [f"{x:.7g}" for x in np.asarray(q).tolist()]
    return f"[{', '.join(shown if len(shown) <= 12 else [*shown[:3], '...', *shown[-3:]])}]"
