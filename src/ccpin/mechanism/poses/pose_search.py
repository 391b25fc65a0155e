"""The search for a closed configuration within the joint limits: many starts, and loops assembled one after another."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array, Mask
from ccpin.errors import LoopNotClosedError
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.least_squares import Linearized
from ccpin.mechanism.poses.loop_closing import TOLERANCE, Attempt, close, close_from_afar, solve

_SEED = 20001  # any: the same starts each time
_MOST_OUTSIDE = 8  # more starts, once one has closed outside the joint limits
_TRIES = 8  # values of a stage's new joints
_ASSEMBLED = 12  # starts from which loops are assembled one by one: what closes so closes from one of the first
_INSET = 0.01  # of a joint's range, and no more than this in rad or m: the limits are kept with room
_NEARLY = 1e-2  # m or rad: loops open by less may be so by the rounding of a file


class ClosedPose(NamedTuple):
    """A closed configuration, how it was found, and whether it respects the joint limits."""

    q_free: Array
    start: str
    within_limits: bool


NamedPoses = Sequence[tuple[str, Array]]


def starts(model: pin.Model, reference: Array, poses: NamedPoses, count: int) -> Iterator[tuple[str, Array]]:
    """Deterministic starting configurations: the stated pose, the file's others, neutral, mid-range, then spread."""
    yield "the stated pose", reference
    yield from poses
    neutral = pin.neutral(model)
    yield "the neutral pose", neutral
    lower, upper = model.lowerPositionLimit, model.upperPositionLimit
    finite = np.isfinite(lower) & np.isfinite(upper) & (0.5 * upper - 0.5 * lower < 2 * np.pi)
    middle = neutral.copy()
    middle[finite] = 0.5 * (lower[finite] + upper[finite])
    yield "the middle of the joint ranges", pin.normalize(model, middle)
    generator = np.random.default_rng(_SEED)
    for k in range(count):
        step = (0.3 * 1.15**k if k < 14 else 2.0) * generator.standard_normal(model.nv)
        yield f"start {k + 1}", pin.integrate(model, reference if k % 2 == 0 else middle, step)


def within_limits(model: pin.Model, q_free: Array) -> bool:
    """Whether every scalar joint is inside its limits (to 1e-9)."""
    outside = np.maximum(model.lowerPositionLimit - q_free, q_free - model.upperPositionLimit)
    return not np.any(outside > 1e-9)


class Stage(NamedTuple):
    """A closure or coupling to satisfy next: its rows of φ, and the velocity components it is the first to involve."""

    name: str
    rows: slice
    new: Mask


def stages(constraints: Constraints) -> list[Stage]:
    """The closures and couplings in an order in which each brings in as few new velocity components as possible."""
    involved = {loop.closure.name: (loop.mask_a + loop.mask_b) > 0 for loop in constraints.loops}
    for coupling in constraints.couplings:
        mask = involved.setdefault(coupling.coupling.name, np.zeros(constraints.model.nv, dtype=bool))
        mask[[term.idx_v for term in coupling.terms]] = True
    rows, known = constraints.row_slices(), np.zeros(constraints.model.nv, dtype=bool)
    ordered = []
    while involved:
        name = min(involved, key=lambda name: int(np.count_nonzero(involved[name] & ~known)))
        new = involved.pop(name) & ~known
        ordered.append(Stage(name, rows[name], new))
        known |= new
    return ordered


def assemble(constraints: Constraints, start: Array, order: Sequence[Stage], tolerance: float) -> Attempt:
    """Close the loops one after another, those closed before held closed, each from several values of its new joints.

    A mechanism of many loops seldom closes all at once from afar; one loop more usually does.
    """
    model, here, held = constraints.model, start, np.zeros(constraints.size, dtype=bool)
    generator = np.random.default_rng(_SEED)
    for stage in order:
        held[stage.rows] = True

        def linearize(q_free: Array, rows: Mask = held) -> Linearized:
            point = constraints.value(q_free)
            return Linearized(point.phi[rows], point.jacobian[rows])

        for k in range(_TRIES):
            step = np.where(stage.new, min(k, 2) * generator.standard_normal(model.nv), 0.0)
            attempt = solve(model, linearize, pin.integrate(model, here, step), tolerance)
            if attempt.closed and stage.name not in constraints.turned(attempt.q_free):
                break
        else:
            return Attempt(attempt.q_free, False)
        here = attempt.q_free
    return close(constraints, here, tolerance)


def moved_within_limits(constraints: Constraints, q_free: Array, tolerance: float) -> Array | None:
    """A closed configuration within the joint limits that a closed one outside leads to, or ``None``.

    Levenberg–Marquardt on φ and on how far each limited joint is outside its range made smaller by a hundredth.
    """
    model = constraints.model
    inset = np.minimum(_INSET * (model.upperPositionLimit - model.lowerPositionLimit), _INSET)
    lower, upper = model.lowerPositionLimit + inset, model.upperPositionLimit - inset
    scalars = [(joint.idx_q, joint.idx_v) for joint in model.joints[1:] if joint.nq == joint.nv == 1]
    places = np.array([(q, v) for q, v in scalars if np.isfinite(lower[q]) or np.isfinite(upper[q])], dtype=np.intp)
    if not len(places):
        return None
    at_q, at_v = places.T

    def linearize(q_free: Array) -> Linearized:
        point, values = constraints.value(q_free), q_free[at_q]
        outside = np.maximum(values - upper[at_q], 0.0) - np.maximum(lower[at_q] - values, 0.0)
        slopes = np.zeros((len(places), model.nv))
        slopes[np.arange(len(places)), at_v] = outside != 0.0
        return Linearized(np.concatenate([point.phi, outside]), np.vstack([point.jacobian, slopes]))

    attempt = close(constraints, solve(model, linearize, q_free, tolerance).q_free, tolerance)
    inside = attempt.closed and constraints.aligned(attempt.q_free) and within_limits(model, attempt.q_free)
    return attempt.q_free if inside else None


def find_closed(
    constraints: Constraints, reference: Array, tolerance: float = TOLERANCE, count: int = 40, poses: NamedPoses = ()
) -> list[ClosedPose]:
    """Closed configurations from deterministic starts, until one within the limits is found.

    Each start is closed directly or, until one closes, loop by loop, and what is closed outside the limits is moved
    into them if it can be. After the first one that is closed at most eight more starts are tried.

    Args:
        constraints: φ.
        reference: The stated pose, of shape (nq,).
        tolerance: How far φ may be from zero, about, m and rad.
        count: Number of spread starts.
        poses: Further poses to start from, each with its name in words.

    Returns:
        At least one configuration, best first: the first one within the joint limits, then those outside.

    Raises:
        LoopNotClosedError: None was found; it carries the least open configuration and each loop's error.
    """
    found: list[ClosedPose] = []
    least, least_error, order = reference, np.inf, stages(constraints)
    left = count + 3 + len(poses)
    for name, start in starts(constraints.model, reference, poses, count):
        if not left:
            break
        q_free, is_closed = close_from_afar(constraints, start, tolerance)
        if not is_closed and not found and len(order) > 1 and count + 3 + len(poses) - left < _ASSEMBLED:
            assembled = assemble(constraints, start, order, tolerance)
            q_free, is_closed = assembled if assembled.closed else (q_free, False)
        left -= 1
        if not is_closed:
            error = float(np.linalg.norm(constraints.residual(q_free)))
            if error < least_error:
                least, least_error = q_free, error
            continue
        if within_limits(constraints.model, q_free):
            return [ClosedPose(q_free, name, True), *found]
        inside = moved_within_limits(constraints, q_free, tolerance)
        if inside is not None:
            return [ClosedPose(inside, f"{name}, moved into the joint limits", True), *found]
        found.append(ClosedPose(q_free, name, False))
        left = min(left, _MOST_OUTSIDE)
    if found:
        return found
    residual = constraints.residual(least)
    errors = {name: float(np.linalg.norm(residual[rows])) for name, rows in constraints.row_slices().items()}
    worst = max(errors, key=lambda name: errors[name])
    open_by = constraints.misfit(residual, constraints.row_slices()[worst])
    message = (
        f"no closed configuration was found from {count + 3 + len(poses)} starts; the least open one leaves loop "
        f"'{worst}' open by {open_by}. State a pose near a closed one (load(reference=…)), or "
        "check the loop's frames and lengths"
    )
    if errors[worst] < _NEARLY:
        message += "; if its numbers are rounded as much as that, pass a larger geometry_tolerance to load"
    if errors[worst] <= max(1e-9, 10 * tolerance) and not constraints.aligned(least):
        turned = ", ".join(f"loop '{name}'" for name in constraints.turned(least))
        message = (
            f"the loops close only with the axes of {turned} turned end for end ({count + 3} starts tried); "
            "turn one of its frames by half a turn"
        )
    raise LoopNotClosedError(message, q_free=least, errors=errors)
