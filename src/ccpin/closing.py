"""Finding a closed configuration from an open one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ccpin.constraints import Constraints
from ccpin.errors import LoopNotClosedError

Array = NDArray[np.float64]

TOLERANCE = 1e-12
_LARGEST_STEP = 0.3
_MAX_ITERATIONS = 200


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
    """Close the loops from `start` by damped Gauss–Newton steps of bounded length.

    Each step solves min ‖φ + φ_q′ Δ‖² + μ²‖Δ‖², the damping μ following the residual (Levenberg–Marquardt), and
    no step moves the joints by more than 0.3 in norm.
    """
    q_free, error, damping = start, constraints.residual(start), 1e-2
    best = float(error @ error)
    for _ in range(_MAX_ITERATIONS):
        value = constraints.value(q_free)
        if np.abs(value.phi).max(initial=0.0) <= TOLERANCE:
            return Attempt(q_free, True)
        step = _damped_step(value.jacobian, value.phi, damping)
        length = float(np.linalg.norm(step))
        if length > _LARGEST_STEP:
            step *= _LARGEST_STEP / length
        trial = pin.integrate(constraints.model, q_free, step)
        error = constraints.residual(trial)
        now = float(error @ error)
        if now < best:
            if now > 0.999999 * best and length < 1e-9:
                break
            q_free, best, damping = trial, now, max(damping * 0.2, 1e-14)
        elif damping > 1e8:
            break
        else:
            damping = max(damping * 8.0, 1e-12)
    return Attempt(q_free, bool(np.abs(constraints.residual(q_free)).max(initial=0.0) <= 10 * TOLERANCE))


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
    finite = np.isfinite(lower) & np.isfinite(upper) & (upper - lower < 4 * np.pi)
    middle = neutral.copy()
    middle[finite] = 0.5 * (lower + upper)[finite]
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
        q_free, is_closed = close(constraints, start)
        if not is_closed or not constraints.aligned(q_free):
            error = float(np.linalg.norm(constraints.residual(q_free)))
            if not is_closed and error < least_error:
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
    raise LoopNotClosedError(
        f"no closed configuration was found from {count + 3} starts; the least open one leaves loop '{worst}' open by "
        f'{errors[worst]:.4g} (m or rad). State a pose near a closed one (<group_state name="reference">), or check '
        "the loop's frames and lengths",
        q_free=least,
        errors=errors,
    )
