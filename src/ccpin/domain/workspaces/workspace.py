"""The workspace of an end effector in its own coordinates, certified: what it can reach, hold and do there.

**What is claimed** of every x of a certified cell: the mechanism has a closed configuration θ(x) with its end effector
at x (the pose `task_space` gives x), it lies on the branch of the configuration started from, no joint exceeds its
limits, the motors determine the motion (ψ_q′ is nonsingular), and 1/κ(J) is at least the dexterity asked for. Each cell
is proved by Theorem N of `boxes` for Φ(x, θ) = 0 and by `demands`, and glued at a face to an earlier one; so through
certified cells the end effector moves from the start to x without passing a singularity of either kind or a limit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PPoly

from ccpin.arrays import Array, Mask, number, numbers, positive
from ccpin.covering.region import Corners, Region, corners_of
from ccpin.covering.runner import Progress, Work
from ccpin.domain.atlas.atlas import Atlas
from ccpin.domain.atlas.certifying import certify_region, effort_of
from ccpin.domain.atlas.cover import BUDGET
from ccpin.domain.closures.scalar_coordinates import independent_indices
from ccpin.domain.closures.seeds import checked_configuration
from ccpin.domain.closures.system import Reading, reading_of
from ccpin.domain.closures.task_coordinates import JointSpace, task_space
from ccpin.domain.paths.walker import Walker
from ccpin.dynamics.end_effector import EndEffector
from ccpin.errors import InvalidInputError, UnreachableError
from ccpin.mechanism.mechanism import Mechanism, mechanism_of
from ccpin.mechanism.other_coordinates.independent_sets import with_independent
from ccpin.proof.equations import BoundsName, Requirements, problem_of
from ccpin.proof.requirements import passable

Limits = bool | Mapping[str, tuple[float, float]]

_DEPTHS = {1: 12, 2: 9, 3: 6}  # halvings of each coordinate, by how many are free: 4,096 to 262,144 cells at most
_MANY_DEPTH = 4  # of four and more: 65,536 cells of four
_PARTS = (1, 8, 64)  # pieces of a way: a box proved to follow σ may be too long for limits


def certify_workspace(
    end_effector: EndEffector | JointSpace,
    region: Corners,
    near: ArrayLike | None = None,
    *,
    limits: Limits = True,
    dexterity: float = 0.0,
    length: float | None = None,
    max_depth: int | None = None,
    fraction: float | None = None,
    budget: int = BUDGET,
    seconds: float | None = None,
    bounds: BoundsName = "auto",
    workers: int | None = None,
    executor: Executor | None = None,
    checkpoint: str | Path | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Atlas:
    """Prove how much of a region of task space an end effector reaches, on one branch.

    Args:
        end_effector: The point of a link that is to get there, or joints in its place (`JointSpace`).
        region: (lower, upper) in the coordinates of `closures.task_coordinates`: positions in the world, metres,
            then turns from how the end effector is turned in `near`, radians. Where the two are equal a coordinate is
            held (a slice); turns left out are held at 0.
        near: A closed configuration on the branch wanted, of shape (nq,); default the reference.
        limits: Whether joints must keep the limits their file states; or limits (lower, upper) by joint that replace
            or narrow these.
        dexterity: The least 1/κ(J), J = ∂x/∂q the end effector's Jacobian by the independent coordinates.
        length: What a turn by one radian counts as in κ, metres; needed where dexterity is asked for and x has turns.
        max_depth: How often an edge of the region may be halved; default 12, 9, 6 for 1, 2, 3 coordinates that are not
            held, and 4 beyond.
        fraction: As for `ccpin.domain.certify`.
        budget: As for `ccpin.domain.certify`.
        seconds: As for `ccpin.domain.certify`.
        bounds: As for `ccpin.domain.certify`.
        workers: As for `ccpin.domain.certify`.
        executor: As for `ccpin.domain.certify`.
        checkpoint: As for `ccpin.domain.certify`.
        progress: As for `ccpin.domain.certify`.

    Returns:
        The atlas, over task coordinates: `Atlas.contains` and `Atlas.sigma` take x.

    Raises:
        UnsupportedMechanismError: The mechanism has no task space, or closures that cannot be certified.
        InvalidInputError: An argument is malformed.
        UnreachableError: No certified way leads from `near` into the region.
        SingularConfigurationError: `near` is singular.
    """
    start = task_problem(end_effector, near, limits, dexterity, length, bounds)
    area = _region(start, region)
    theta = start.moved_to(_first(start.x, area))
    free = int(np.count_nonzero(~area.held))
    effort = effort_of(_DEPTHS.get(free, _MANY_DEPTH), max_depth, fraction, budget, seconds, free)
    return certify_region(
        start.reading, theta, start.names, area, effort, Work(workers, executor, checkpoint, progress)
    )


class TaskProblem:
    """What is to be proved in a task space, and a closed configuration to start from.

    Attributes:
        names: The task coordinates, in order.
        slides: Whether each is a length, of shape (n,).
        reading: The closures, and what is asked besides.
        theta: θ of the start, of shape (n′,).
    """

    def __init__(self, names: tuple[str, ...], slides: Mask, reading: Reading, theta: Array) -> None:
        self.names, self.slides, self.reading, self.theta = names, slides, reading, theta

    @property
    def x(self) -> Array:
        """Task coordinates of the start, of shape (n,)."""
        return self.theta[self.reading.system.independent]

    def moved_to(self, x: Array) -> Array:
        """θ at other task coordinates, where a certified straight way leads there, within limits and not singular.

        Raises:
            UnreachableError: None was proved.
            SingularConfigurationError: The start is singular.
        """
        if np.array_equal(x, self.x):
            return self.theta
        for parts in _PARTS:
            knots = np.linspace(0.0, 1.0, parts + 1)
            step = np.tile(x - self.x, (parts, 1))
            walker = Walker(
                self.reading.problem,
                PPoly(np.stack([step, self.x + knots[:-1, None] * step]), knots),
                0.0 * x,
                self.theta,
            )
            whole = walker.walk() is None
            if whole and passable(self.reading.problem, walker.boxes).all():
                theta = walker.theta.copy()
                theta[self.reading.system.independent] = x
                return theta
            if not whole:
                break
        where = "it ends at" if not whole else "a limit or a singularity of the motors may lie before"
        place = walker.theta[self.reading.system.independent]
        raise UnreachableError(
            f"no certified way leads straight from x = {self.x.tolist()}, where `near` has the end effector, to "
            f"{x.tolist()}: {where} {place.tolist()}; give near= closer to the region",
            q=x,
            q_reached=place,
            fraction=walker.here,
            rcond=walker.rcond(),
        )


def task_problem(
    end_effector: EndEffector | JointSpace,
    near: ArrayLike | None,
    limits: Limits,
    dexterity: float,
    length: float | None,
    bounds: BoundsName,
) -> TaskProblem:
    """What `certify_workspace` is to prove, from its arguments."""
    if not isinstance(end_effector, EndEffector | JointSpace):
        raise InvalidInputError(f"end_effector must be an EndEffector or a JointSpace; it is {end_effector!r:.80}")
    mechanism = mechanism_of(end_effector.model)
    q_free = mechanism.q_reference if near is None else checked_configuration(mechanism, near)
    parametrization = mechanism.parametrization()
    q_free = parametrization.sigma(parametrization.coordinates.alpha(q_free), near=q_free).q_free
    names, slides, reading, theta = _closures(end_effector, mechanism, q_free)
    least = number(dexterity, "dexterity", "a number from 0 to below 1", -1e-300)
    if not least < 1.0:
        raise InvalidInputError(f"dexterity is 1/κ, a number from 0 to below 1; it is {dexterity!r}")
    if least and length is None and not slides.all() and slides.any():
        raise InvalidInputError(
            f"dexterity of {', '.join(names)} mixes metres and radians: give length=, the metres a radian counts as"
        )
    length = None if length is None else positive(length, "length")
    units = np.where(slides, 1.0, 1.0 if length is None else length)
    system = reading.system
    lower, upper = _limits(mechanism, limits, system.n_free)
    asked = Requirements(lower, upper, independent_indices(mechanism, reading.chart), units, least)
    # a joint with a limit is no circle: gluing modulo 2π would let it go round beyond its limit
    system = replace(system, periodic=system.periodic & ~np.isfinite(lower) & ~np.isfinite(upper))
    problem = problem_of(system, bounds)._replace(requirements=asked)
    return TaskProblem(names, slides, reading._replace(problem=problem), theta)


def _closures(
    end_effector: EndEffector | JointSpace, mechanism: Mechanism, q_free: Array
) -> tuple[tuple[str, ...], Mask, Reading, Array]:
    """The task coordinates, which of them are lengths, the closures over them, and θ at q′."""
    if isinstance(end_effector, EndEffector):
        task = task_space(end_effector, q_free)
        reading = reading_of(mechanism, q_free, task)
        return task.names, np.array(task.slides), reading, np.concatenate([reading.theta(q_free), task.x])
    sibling = with_independent(mechanism, tuple(end_effector.names), q_free)
    if sibling.parametrization().coordinates.n != mechanism.n:
        raise InvalidInputError(
            f"{mechanism.name} has {mechanism.n} independent coordinates; a joint space needs as many, "
            f"not {', '.join(end_effector.names)}"
        )
    reading = reading_of(sibling, q_free)
    slides = np.array([slide for joint in mechanism.tree.joints for slide in joint.kind.slides], dtype=np.bool_)
    return sibling.independent, slides[reading.system.independent], reading, reading.theta(q_free)


def _region(task: TaskProblem, region: Corners) -> Region:
    """The region asked for, turns left out held at 0."""
    given = numbers(region, "region")
    slides = np.count_nonzero(task.slides)
    turns = len(task.names) - slides
    if turns and slides and given.shape == (2, slides):
        given = np.concatenate([given, np.zeros((2, turns))], axis=1)
    lower, upper = corners_of(given, task.names, slices=True)
    return Region(lower, upper, np.zeros(len(lower), dtype=np.bool_))


def _first(x: Array, region: Region) -> Array:
    """Where the atlas starts: x itself where it lies in the region, its middle otherwise."""
    inside = np.all((x >= region.lower) & (x <= region.upper))
    return x if inside else 0.5 * (region.lower + region.upper)


def _limits(mechanism: Mechanism, limits: Limits, size: int) -> tuple[Array, Array]:
    """Limits of θ, of shape (size,) each.

    Raises:
        InvalidInputError: A name that is no joint with one displacement, or limits that are no interval.
    """
    if not isinstance(limits, bool | Mapping):
        raise InvalidInputError(f"limits must be True, False or (lower, upper) by joint; they are {limits!r:.80}")
    lower, upper = np.full(size, -np.inf), np.full(size, np.inf)
    plain = {joint.name: joint for joint in mechanism.tree.joints if joint.kind.nq == 1}
    if limits is not False:
        low, high = mechanism.position_limits
        for joint in plain.values():
            lower[joint.v], upper[joint.v] = low[joint.q], high[joint.q]
    for name, given in limits.items() if isinstance(limits, Mapping) else ():
        if name not in plain:
            raise InvalidInputError(f"limits: '{name}' is no joint with one displacement; these are {', '.join(plain)}")
        bounds = numbers(given, f"limits of '{name}'")
        if bounds.shape != (2,) or not bounds[0] < bounds[1]:
            raise InvalidInputError(f"limits of '{name}' must be (lower, upper); they are {given!r}")
        lower[plain[name].v], upper[plain[name].v] = bounds
    return lower, upper
