"""Finding a closed configuration from an open one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array
from ccpin.errors import LoopNotClosedError
from ccpin.kinematics.constraints import Constraints, ConstraintValue
from ccpin.kinematics.loops import Loop

TOLERANCE = 1e-12
_LARGEST_STEP = 0.3
_MAX_ITERATIONS = 200
_PATIENCE = 20


class Closed(NamedTuple):
    """A closed configuration, how it was found, and whether it respects the joint limits."""

    q_free: Array
    start: str
    within_limits: bool


class Attempt(NamedTuple):
    """Where closing ended, and whether it is closed there."""

    q_free: Array
    closed: bool


def close(constraints: Constraints, start: Array) -> Attempt:
    """Close the loops from `start`: `descend` on φ."""
    return descend(constraints.model, constraints.value, start)


def descend(model: pin.Model, equations: Callable[[Array], tuple[Array, Array]], start: Array) -> Attempt:
    """Solve equations in q′ by damped Gauss–Newton steps of bounded length.

    Each step solves min ‖φ + φ_q′ Δ‖² + μ²‖Δ‖², the damping μ following the residual (Levenberg–Marquardt), and
    no step moves the joints by more than 0.3 in norm. Given up where 20 steps gain less than a fifth.

    Args:
        model: The free system.
        equations: q′ → (residual, Jacobian).
        start: Where to begin, of shape (nq,).
    """
    q_free, damping = start, 1e-2
    residual, jacobian = equations(start)
    best, earlier = float(residual @ residual), np.inf
    for iteration in range(_MAX_ITERATIONS):
        if iteration % _PATIENCE == 0:
            if best > 0.8 * earlier:
                break
            earlier = best
        if np.abs(residual).max(initial=0.0) <= TOLERANCE:
            return Attempt(q_free, True)
        step = _damped_step(jacobian, residual, damping)
        length = float(np.linalg.norm(step))
        if length > _LARGEST_STEP:
            step *= _LARGEST_STEP / length
        trial = pin.integrate(model, q_free, step)
        trial_residual, trial_jacobian = equations(trial)
        now = float(trial_residual @ trial_residual)
        if now < best:
            if now > 0.999999 * best and length < 1e-9:
                break
            q_free, residual, jacobian = trial, trial_residual, trial_jacobian
            best, damping = now, max(damping * 0.2, 1e-14)
        elif damping > 1e8:
            break
        else:
            damping = max(damping * 8.0, 1e-12)
    return Attempt(q_free, bool(np.abs(residual).max(initial=0.0) <= 10 * TOLERANCE))


def _damped_step(jacobian: Array, phi: Array, damping: float) -> Array:
    u, s, vt = np.linalg.svd(jacobian, full_matrices=False)
    if s.size == 0 or s[0] == 0.0:
        return np.zeros(jacobian.shape[1])
    keep = s > 1e-9 * s[0]
    gain = np.where(keep, s / (s**2 + (damping * s[0]) ** 2), 0.0)
    return np.asarray(-vt.T @ (gain * (u.T @ phi)))


def starts(model: pin.Model, reference: Array, count: int) -> Iterator[tuple[str, Array]]:
    """Deterministic starting configurations: the file's pose, the neutral pose, mid-range, then spread ones."""
    yield "the stated pose", reference
    neutral = pin.neutral(model)
    yield "the neutral pose", neutral
    lower, upper = model.lowerPositionLimit, model.upperPositionLimit
    finite = np.isfinite(lower) & np.isfinite(upper) & (0.5 * upper - 0.5 * lower < 2 * np.pi)
    middle = neutral.copy()
    middle[finite] = 0.5 * (lower[finite] + upper[finite])
    yield "the middle of the joint ranges", pin.normalize(model, middle)
    generator = np.random.default_rng(20001)
    for k in range(count):
        spread = 0.3 * 1.15**k if k < 14 else 2.0
        yield (
            f"start {k + 1}",
            pin.integrate(model, reference if k % 2 == 0 else middle, spread * generator.standard_normal(model.nv)),
        )


def within_limits(model: pin.Model, q_free: Array) -> bool:
    """Whether every scalar joint is inside its limits (to 1e-9)."""
    slack = 1e-9
    return bool(
        np.all(q_free >= model.lowerPositionLimit - slack) and np.all(q_free <= model.upperPositionLimit + slack)
    )


def close_from_afar(constraints: Constraints, start: Array) -> Attempt:
    """Close the loops from any pose, the right way round.

    Where the loops do not close directly, or close with axes turned end for end, they are closed in position
    first, then with rotation rows that vanish one way round only, then exactly.
    """
    attempt = close(constraints, start)
    if attempt.closed and constraints.aligned(attempt.q_free):
        return attempt
    if any(loop.rows.alignment for loop in constraints.loops):
        for stage in (PointConstraints(constraints).value, AligningConstraints(constraints).value):
            start = descend(constraints.model, stage, start).q_free
        staged = close(constraints, start)
        if staged.closed and constraints.aligned(staged.q_free):
            return staged
    return attempt._replace(closed=False)


def find_closed(constraints: Constraints, reference: Array, count: int = 40) -> list[Closed]:
    """Closed configurations from deterministic starts, the first found within the limits last to be looked for.

    Returns:
        At least one configuration, best first: the first one within the joint limits, then those outside.

    Raises:
        LoopNotClosedError: None was found; it carries the least open configuration and each loop's error.
    """
    found: list[Closed] = []
    least, least_error = reference, np.inf
    for name, start in starts(constraints.model, reference, count):
        q_free, is_closed = close_from_afar(constraints, start)
        if not is_closed:
            error = float(np.linalg.norm(constraints.residual(q_free)))
            if error < least_error:
                least, least_error = q_free, error
            continue
        closed = Closed(q_free, name, within_limits(constraints.model, q_free))
        if closed.within_limits:
            return [closed, *found]
        found.append(closed)
        if len(found) >= 8:
            break
    if found:
        return found
    residual = constraints.residual(least)
    errors = {name: float(np.linalg.norm(residual[rows])) for name, rows in constraints.row_slices().items()}
    worst = max(errors, key=lambda name: errors[name])
    if errors[worst] <= 1e-9 and not constraints.aligned(least):
        turned = ", ".join(f"loop '{name}'" for name in constraints.turned(least))
        raise LoopNotClosedError(
            f"the loops close only with the axes of {turned} turned end for end ({count + 3} starts tried); "
            "turn one of its frames by half a turn",
            q_free=least,
            errors=errors,
        )
    raise LoopNotClosedError(
        f"no closed configuration was found from {count + 3} starts; the least open one leaves loop '{worst}' open by "
        f'{errors[worst]:.4g} (m or rad). State a pose near a closed one (<group_state name="reference">), or check '
        "the loop's frames and lengths",
        q_free=least,
        errors=errors,
    )


# Residuals for closing loops from afar: positions alone, and rotations with a single zero.

_NEARLY_PARALLEL = 1e-6


class PointConstraints:
    """The rows of φ without its direction rows: loops closed in position, whatever way their ends are turned.

    Holds scratch memory: one instance a thread.
    """

    def __init__(self, constraints: Constraints) -> None:
        self.model = constraints.model
        self._constraints = constraints
        keep = np.ones(constraints.size, dtype=bool)
        for loop, window in zip(constraints.loops, constraints.row_slices().values(), strict=False):
            first = window.start + len(loop.basis)
            keep[first : first + len(loop.rows.directions)] = False
        self._keep = keep

    def value(self, q_free: Array) -> ConstraintValue:
        """The rows and their Jacobian."""
        phi, jacobian = self._constraints.value(q_free)
        return ConstraintValue(phi[self._keep], jacobian[self._keep])


class AligningConstraints:
    """The rows of `PointConstraints` followed by three rows θ n of every closure that asks for directions to coincide.

    Holds scratch memory: one instance a thread.
    """

    def __init__(self, constraints: Constraints) -> None:
        self.model = constraints.model
        self._constraints = PointConstraints(constraints)
        self._loops = tuple(loop for loop in constraints.loops if loop.rows.alignment)
        self._data = constraints.model.createData()

    def value(self, q_free: Array) -> ConstraintValue:
        """The rows and their Jacobian; a single direction's rows are in axes that turn with the common ancestor."""
        phi, jacobian = self._constraints.value(q_free)
        pin.computeJointJacobians(self.model, self._data, q_free)
        rows, derivatives = [phi], [jacobian]
        for loop in self._loops:
            row, derivative = self._rotation(loop)
            rows.append(row)
            derivatives.append(derivative)
        return ConstraintValue(np.concatenate(rows), np.vstack(derivatives))

    def _rotation(self, loop: Loop) -> tuple[Array, Array]:
        """The rows θ n of one closure and their derivative."""
        turn_a = self._data.oMi[loop.joint_a].rotation @ loop.frame_a[:3, :3]
        turn_b = self._data.oMi[loop.joint_b].rotation @ loop.frame_b[:3, :3]
        turning_a, turning_b = self._data.J[3:] * loop.path_a, self._data.J[3:] * loop.path_b
        if len(loop.rows.alignment) == 3:
            rotation = turn_b.T @ turn_a
            body_rate = turn_a.T @ turning_a - rotation.T @ (turn_b.T @ turning_b)
            return np.array(pin.log3(rotation)), pin.Jlog3(rotation) @ body_rate
        (a_local, b_local) = loop.rows.alignment[0]
        return _between(turn_a @ a_local, turn_b @ b_local, turning_a, turning_b)


def _between(a: Array, b: Array, turning_a: Array, turning_b: Array) -> tuple[Array, Array]:
    """θ n from the unit vector b to a, and its derivative: θ n = f k with k = b × a = sin θ n, f = θ / sin θ."""
    k, c = np.cross(b, a), float(a @ b)
    s = float(np.linalg.norm(k))
    theta = float(np.arctan2(s, c))
    if s < _NEARLY_PARALLEL and c < 0:
        axis = np.cross(a, np.eye(3)[int(np.argmin(np.abs(a)))])
        axis = axis / np.linalg.norm(axis)
        return theta * axis, np.outer(axis, axis) @ (turning_a - turning_b)
    da, db = -pin.skew(a) @ turning_a, -pin.skew(b) @ turning_b
    dk, dc = pin.skew(b) @ da - pin.skew(a) @ db, b @ da + a @ db
    if s < _NEARLY_PARALLEL:
        return k, dk
    return theta / s * k, theta / s * dk + np.outer(k, (theta * c - s) / s**3 * dc)
