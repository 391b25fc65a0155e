"""The largest cube or ball of task space about a centre that is certified whole, and what stops a larger one.

Cells are proved nearest to the centre first, as in `atlas.build`, until the nearest that is not proved is nearer than
all that are left; its distance is the half width. Every cell nearer is certified, with all that `workspace` claims, so
the cube is, whatever was tried and whenever the work was stopped. `obstacle` is a place outside of it at which a
straight move from the centre is proved to fail: no cube about this centre (with these turns) that holds it is all
workspace, so the true largest half width lies between `half` and `upper`.

Where no centre is given one is sought first (`inscribed`): on a map about the start, some times as wide as what is
certified there, made again twice as wide while that finds more room or what is found touches its border. Turns are held
on it.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, Mask, instance, numbers, positive, vector
from ccpin.covering.cells import CellStatus
from ccpin.covering.region import Region
from ccpin.covering.runner import Work
from ccpin.displays import table
from ccpin.domain.atlas.atlas import Atlas
from ccpin.domain.atlas.certifying import Effort, certify_region
from ccpin.domain.atlas.cover import SquareNorm
from ccpin.domain.closures.task_coordinates import JointSpace
from ccpin.domain.paths.obstacles import demand_witnesses
from ccpin.domain.workspaces.inscribed import roomiest
from ccpin.domain.workspaces.workspace import Limits, TaskProblem, task_problem
from ccpin.dynamics.end_effector import EndEffector
from ccpin.errors import InvalidInputError
from ccpin.mechanism.mechanism import mechanism_of
from ccpin.proof.equations import BoundsName
from ccpin.proof.rounding import SLACK
from ccpin.proof.verdict import Witness
from ccpin.work import stoppable

_CELLS, _TRIED = 6, 24  # the nearest undecided cells, and lines through their corners
_PUSHED = 4.0  # how far such a line goes, in distances of the corner
_GROWN, _GROWTHS, _EDGE = 2.0, 6, 1e-6  # factor, how often at most, and how near to its end a ball is grown
_FIRST, _AROUND = 0.5, 4.0  # a first cube's tolerance, and how many times as wide a map about it is
_MAP_DEPTHS, _MANY_MAP_DEPTH = {1: 10, 2: 8, 3: 5}, 4  # halvings of the map on which centres are looked for
_MAP_SECONDS, _BETTER = 0.5, 1.02  # share of the time for that map; what a centre is worth leaving another for


@dataclass(frozen=True, eq=False)
class LargestWorkspace:
    """A cube or ball of task space that is certified whole.

    Attributes:
        centre: Task coordinates, of shape (n,).
        half: Half width of the cube, or radius of the ball, metres; 0 where nothing is certified.
        round: Whether it is a ball.
        tilt: How far the turns reach to both sides of the centre's, of shape (turns,), radians.
        atlas: The certified cells; `complete` is False where Ctrl-C ended the search.
        shape: How distances from the centre are measured.
    """

    centre: Array
    half: float
    round: bool
    tilt: Array
    atlas: Atlas
    shape: SquareNorm

    def __repr__(self) -> str:
        what = f"ball of radius {self.half:.6g} m" if self.round else f"cube of half width {self.half:.6g} m"
        return f"LargestWorkspace({what} about {self.centre.tolist()} in {len(self.atlas.boxes.kappa)} boxes)"

    def _repr_html_(self) -> str:
        """A small table for notebooks."""
        return table(
            [
                ("ball" if self.round else "cube", f"{'radius' if self.round else 'half width'} {self.half:.6g} m"),
                ("centre", np.array2string(self.centre, precision=6)),
                ("boxes", str(len(self.atlas.boxes.kappa))),
            ]
        )

    @cached_property
    def obstacle(self) -> Witness | None:
        """A place outside, as near as was found, at which a straight move from the centre is proved to fail."""
        found = demand_witnesses(self.atlas.reading, self.atlas.seed, self._suspects())
        outside = (witness for witness in found if self._distance(witness.q) >= self.half)
        return min(outside, key=lambda witness: self._distance(witness.q), default=None)

    @property
    def upper(self) -> float:
        """A half width (or radius) proved to be too large; ∞ where no obstacle was found."""
        if self.obstacle is None:
            return np.inf
        spread = self.obstacle.error * np.ones_like(self.centre)  # in every coordinate: its length, for a ball
        return (self._distance(self.obstacle.q) + float(self.shape.of(spread[None])[0])) * SLACK

    def contains(self, x: ArrayLike) -> bool | Mask:
        """Whether x (n,) lies in the certified cube or ball; for x of shape (K, n) an array (K,)."""
        points = np.atleast_2d(np.asarray(x, dtype=np.float64))
        region = self.atlas.region
        inside = np.all((points >= region.lower) & (points <= region.upper), axis=1)
        inside &= self.shape.of(np.abs(points - self.centre)) < self.half
        return bool(inside[0]) if np.ndim(x) == 1 else inside

    def _distance(self, x: Array) -> float:
        return float(self.shape.of(np.abs(x - self.centre)[None])[0])

    def _suspects(self) -> list[Array]:
        """Ends of lines from the centre through corners of the nearest cells that were not proved, some way beyond."""
        tree, region = self.atlas.tree, self.atlas.region
        cells = tree.leaves(CellStatus.UNDECIDED)
        low, high = region.position(tree.lower[cells]), region.position(tree.lower[cells] + tree.size[cells])
        away = self.shape.of(np.maximum(np.maximum(low - self.centre, self.centre - high), 0.0))
        order = np.argsort(away, kind="stable")[:_CELLS]
        corners = np.array([np.where(side, high[k], low[k]) for side in _sides(region) for k in order])
        if not len(corners):
            return []
        pushed = self.centre + np.where(self.shape.weights > 0.0, _PUSHED, 1.0) * (corners - self.centre)
        distance = self.shape.of(np.abs(pushed - self.centre))
        return list(pushed[np.argsort(distance, kind="stable")[:: max(1, len(pushed) // _TRIED)]])


def _sides(region: Region) -> list[Mask]:
    """Every choice of lower or upper bounds of the coordinates that are not held."""
    free = np.flatnonzero(~region.held)
    sides = []
    for bits in product((False, True), repeat=len(free)):
        side = np.zeros(len(region.lower), dtype=np.bool_)
        side[free] = bits
        sides.append(side)
    return sides


def largest_cube(
    end_effector: EndEffector | JointSpace,
    centre: ArrayLike | None = None,
    near: ArrayLike | None = None,
    *,
    proportions: ArrayLike = 1.0,
    tilt: ArrayLike = 0.0,
    within: float | None = None,
    tolerance: float = 0.02,
    limits: Limits = True,
    dexterity: float = 0.0,
    length: float | None = None,
    seconds: float | None = None,
    bounds: BoundsName = "auto",
    work: Work | None = None,
) -> LargestWorkspace:
    """The largest certified cube of positions, about a centre or where there is most room, turns up to `tilt` included.

    Args:
        end_effector: The point of a link that is to get everywhere in it.
        centre: Its position in the middle (metres, in the world; two coordinates in a plane), or all task coordinates
            (`closures.task_coordinates`); default the roomiest place of a map about where `near` has it (a
            search first that takes some times as long, and finds it to a thirty-second of the map).
        near: A closed configuration on the branch wanted, of shape (nq,); default the reference.
        proportions: What the edges (or the ball's axes) are to one another, one number or one for each: the half
            width found, times these.
        tilt: How far each turn is to reach to both sides of the centre's, one number or (turns,), radians; 0: held.
        within: A half width beyond which is not looked, metres; default beyond what the mechanism's lengths allow.
        tolerance: Cells are halved to this share of their distance from the centre: a smaller one comes nearer to the
            true largest and costs more, by about 1/tolerance for every coordinate but one.
        limits: As for `certify_workspace`.
        dexterity: As for `certify_workspace`.
        length: As for `certify_workspace`.
        seconds: When to stop, by the clock; the cube is then the largest found.
        bounds: As for `certify_workspace`.
        work: Workers, executor, checkpoint folder and progress, as in `certify_workspace`.

    Returns:
        The cube, what stops a larger one and the cells; after Ctrl-C the largest found so far, which may be about the
        start with turns held, where the centre was still sought.

    Raises:
        UnsupportedMechanismError, InvalidInputError, UnreachableError, SingularConfigurationError: As for
            `certify_workspace`; the centre must be reached.
    """
    start = task_problem(end_effector, near, limits, dexterity, length, bounds)
    return _largest(start, _Asked(centre, proportions, tilt, within, tolerance, seconds, False), end_effector, work)


def largest_ball(
    end_effector: EndEffector | JointSpace,
    centre: ArrayLike | None = None,
    near: ArrayLike | None = None,
    *,
    proportions: ArrayLike = 1.0,
    tilt: ArrayLike = 0.0,
    within: float | None = None,
    tolerance: float = 0.02,
    limits: Limits = True,
    dexterity: float = 0.0,
    length: float | None = None,
    seconds: float | None = None,
    bounds: BoundsName = "auto",
    work: Work | None = None,
) -> LargestWorkspace:
    """The largest certified ball (disc, in a plane) of positions; see `largest_cube`, of which `within` is a radius."""
    start = task_problem(end_effector, near, limits, dexterity, length, bounds)
    return _largest(start, _Asked(centre, proportions, tilt, within, tolerance, seconds, True), end_effector, work)


class _Asked(NamedTuple):
    """What was asked for, as it was given."""

    centre: ArrayLike | None
    proportions: ArrayLike
    tilt: ArrayLike
    within: float | None
    tolerance: float
    seconds: float | None
    round: bool


def _each(given: ArrayLike, name: str, count: int) -> Array:
    """One number for each of some coordinates, from as many or from one for all."""
    values = numbers(given, name)
    return np.full(count, values) if not values.ndim else vector(values, name, count).copy()


def _reach(start: TaskProblem, end_effector: EndEffector | JointSpace) -> float:
    """Where the search for the largest half width begins: half the loops' length, or a quarter turn."""
    return 0.5 * mechanism_of(end_effector.model).constraints().extent if start.slides.any() else 0.5 * np.pi


class _LargestProblem(NamedTuple):
    """What was asked for, checked: the centre, the edges of a cube of half width 1, how far turns reach, (n,) each."""

    centre: Array
    edges: Array
    tilt: Array

    def region(self, half: float) -> Region:
        reach = half * self.edges + self.tilt
        return Region(self.centre - reach, self.centre + reach, np.zeros(len(reach), dtype=np.bool_))


def _goal(start: TaskProblem, asked: _Asked) -> _LargestProblem:
    """Lengths make the cube, turns are tilt; in a space of turns alone they make the cube."""
    across = start.slides if start.slides.any() else np.ones(len(start.names), dtype=np.bool_)
    turns = int(np.count_nonzero(~across))
    given = start.x if asked.centre is None else numbers(asked.centre, "centre")
    if given.shape == (len(across) - turns,):
        given = np.concatenate([given, np.zeros(turns)])
    edges, tilt = np.zeros(len(across)), np.zeros(len(across))
    edges[across] = _each(asked.proportions, "proportions", len(across) - turns)
    tilt[~across] = _each(asked.tilt, "tilt", turns)
    if not np.all((edges[across] > 0.0) & (edges[across] < np.inf)):
        raise InvalidInputError(f"proportions must be positive numbers; they are {asked.proportions!r:.80}")
    if not np.all((tilt >= 0.0) & (tilt < np.pi / 2)):
        raise InvalidInputError(f"tilt must be from 0 to below π/2 rad; it is {asked.tilt!r:.80}")
    return _LargestProblem(vector(given, f"centre ({', '.join(start.names)})", len(across)), edges, tilt)


def _largest(
    start: TaskProblem, asked: _Asked, end_effector: EndEffector | JointSpace, work: Work | None
) -> LargestWorkspace:
    goal, tolerance, began = _goal(start, asked), positive(asked.tolerance, "tolerance"), time.monotonic()
    if asked.seconds is not None:
        positive(asked.seconds, "seconds")
    work = Work() if work is None else instance(work, "work", Work)
    grows = asked.within is None
    reach = _reach(start, end_effector) / float(goal.edges.max())
    most = reach if grows else positive(asked.within, "within")
    weights = np.divide(1.0, goal.edges, out=np.zeros_like(goal.edges), where=goal.edges > 0.0)
    search = _SearchScope(SquareNorm(weights, asked.round), most, _GROWN * reach, grows, work)
    first = None
    with stoppable() as stop:
        if asked.centre is None:
            flat, seconds = goal._replace(tilt=0.0 * goal.tilt), asked.seconds and _MAP_SECONDS * asked.seconds
            until = None if seconds is None else time.monotonic() + seconds
            first = flat, search.about(start, flat, _FIRST, seconds)
            start, goal = search.moved(start, goal, flat, first[1].radius, until)
        left = None if asked.seconds is None else max(began + asked.seconds - time.monotonic(), 1e-3)
        atlas = search.about(start, goal, tolerance, left)
        if stop.is_set() and first is not None and first[1].radius > atlas.radius:
            goal, atlas = first[0], replace(first[1], complete=False)
    return LargestWorkspace(goal.centre, atlas.radius, asked.round, goal.tilt[goal.edges == 0.0], atlas, search.shape)


class _SearchScope(NamedTuple):
    """How distances are measured, where searches begin, how far a map goes, and whether searches go on beyond."""

    shape: SquareNorm
    most: float
    reach: float
    grows: bool
    work: Work

    def about(self, start: TaskProblem, goal: _LargestProblem, tolerance: float, seconds: float | None) -> Atlas:
        """The largest about a centre."""
        theta, most, effort = start.moved_to(goal.centre), self.most, Effort(0, tolerance, seconds=seconds)
        for _ in range(_GROWTHS if self.grows else 1):
            atlas = certify_region(start.reading, theta, start.names, goal.region(most), effort, self.work, self.shape)
            if not atlas.complete or atlas.radius < most * (1.0 - _EDGE):
                break
            most *= _GROWN
        return atlas

    def moved(
        self, start: TaskProblem, goal: _LargestProblem, flat: _LargestProblem, first: float, until: float | None
    ) -> tuple[TaskProblem, _LargestProblem]:
        """The start and the goal, moved to the roomiest place of a map about the start.

        Args:
            start: The start.
            goal: The goal.
            flat: The same with turns held.
            first: What was found about the start with these.
            until: When to stop (`time.monotonic`).
        """
        half = min(_AROUND * first, self.reach) if first > 0.0 else self.reach
        free = int(np.count_nonzero(goal.edges))
        depth = _MAP_DEPTHS.get(free, _MANY_MAP_DEPTH)
        theta, best, found = start.moved_to(goal.centre), first, None
        while True:
            left = None if until is None else max(until - time.monotonic(), 1e-3)
            effort = Effort(depth, seconds=left)
            atlas = certify_region(start.reading, theta, start.names, flat.region(half), effort, self.work)
            room = roomiest(atlas, self.shape.round)
            better = room.share * half > best * _BETTER
            if better:
                best, found = room.share * half, room
            if not atlas.complete or half >= self.reach or (room.enclosed and not better):
                break
            half = min(_GROWN * half, self.reach)
        if found is None:
            return start, goal
        there = TaskProblem(start.names, start.slides, start.reading, found.theta)
        return there, goal._replace(centre=found.centre)
