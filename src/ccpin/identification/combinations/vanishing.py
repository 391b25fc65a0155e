"""Combinations of constants that no motion shows, as a mechanism's structure has them, in exact numbers.

`ccpin/proof/theorems/identifiable.md` proves both kinds: (1) what a body's motions do not show; (2) what is the same on
either side of a joint or a closure, with a rotor and a constant effort between them; both, too, where the wrench that
holds the world is measured. Twists are (linear, angular) about a body's origin in its axes; a body's ten numbers are in
Pinocchio's order.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from ccpin.dynamics.parameters import BODY
from ccpin.identification.combinations.exact_spaces import invariant_span, null_space, rational, reduced
from ccpin.programs.recording.recorded_tree import Table

Numbers = tuple[tuple[Fraction, ...], ...]
_PAIRS = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))  # of Ixx, Ixy, Iyy, Ixz, Iyz, Izz
MOVES = {
    "spherical": (3, 4, 5), "revolute": (5,), "fixed": (), "prismatic": (2,), "cylindrical": (2, 5),
    "universal": (3, 4, 5), "planar": (0, 1, 5),
}  # fmt: skip
"""Twists of frame B in A that closures leave free, (x, y, z, about x, y, z), and that generate a group; others none."""


class JoinedBody(NamedTuple):
    """A body and the joint that carries it, in exact numbers.

    Attributes:
        parent: Number of the body that carries it, of those from 1 on; 0: the world.
        directions: Of its steps' axes, of about unit length, in its own axes.
        slides: Which of them are slides.
        placement: The joint's frame in the parent's at no displacement.
        kinds: Of the joint's own constants (`ccpin.dynamics.parameters`).
    """

    parent: int
    directions: Numbers
    slides: tuple[bool, ...]
    placement: Numbers
    kinds: tuple[str, ...]


class ClosedEnds(NamedTuple):
    """A closure: bodies a and b (0: the world), frames on them, and which twists of B in A it leaves free."""

    a: int
    b: int
    frame_a: Numbers
    frame_b: Numbers
    moves: tuple[int, ...]


class BodyMotions(NamedTuple):
    """What a body does, in axes of a frame on it.

    Attributes:
        twists: Rows that span its twists, wherever it is.
        pulls: Rows that span gravity.
        gravity: At no displacement.
        held: Whether the wrench that holds the world is measured: then momentum and weight count in all directions.
    """

    twists: Table
    pulls: Table
    gravity: Table
    held: bool

    @property
    def level(self) -> Table:
        """Gravity as twists without turn."""
        return np.hstack([self.pulls, np.zeros_like(self.pulls)])

    @property
    def felt(self) -> tuple[Table, Table]:
        """Rows a and w such that what a body does to the equations is aᵀM w."""
        both = np.vstack([self.twists, self.level])
        return (_EVERY, both) if self.held else (both, self.twists)

    def seen_from(self, frame: Table) -> BodyMotions:
        """In another frame on it."""
        turned, pulls = self.twists @ _to_frame(frame).T, self.pulls @ frame[:3, :3]
        return BodyMotions(turned, pulls, self.gravity @ frame[:3, :3], self.held)

    def moved(self, steps: Sequence[Table]) -> BodyMotions:
        """In a frame that a joint's steps move, wherever they have moved it."""
        turns = [step[3:] for step in steps if any(step[3:])]
        twists = invariant_span(self.twists, map(_across, steps))
        return BodyMotions(twists, invariant_span(self.pulls, map(_skew, turns)), self.gravity, self.held)


def identities(
    bodies: Sequence[JoinedBody], ends: Sequence[ClosedEnds], gravity: Sequence[Fraction], held: bool = False
) -> Table:
    """Vectors z with Y z = 0 at every closed configuration, of shape (K, p); they may depend on each other.

    Args:
        bodies: The bodies and joints.
        ends: Closures over which inertia may be handed: those whose forces are not measured.
        gravity: In world axes.
        held: Whether Y has the rows of the wrench that holds the world, too.
    """
    count = BODY * len(bodies)
    width, found = count + sum(len(body.kinds) for body in bodies), list[Table]()
    pull = np.array([rational(g) for g in gravity], dtype=object)
    moving = {0: BodyMotions(np.zeros((0, 6), dtype=object), pull[None], pull, held)}
    fallen = np.array([(M @ [*pull, 0, 0, 0]) for M in _UNIT_INERTIAS], dtype=object)

    def handed(b: int, at_b: Table, a: int, at_a: Table) -> Table:
        z = np.zeros(width + 6, dtype=object)
        for body, part in ((b, at_b), (a, -at_a)):
            if body:
                z[BODY * (body - 1) : BODY * body] += part
            elif held:
                z[width:] += part @ fallen
        found.append(z)
        return z

    for number, body in enumerate(bodies, start=1):
        steps, frame = _steps(body), _table(body.placement)
        before = moving[body.parent].seen_from(frame).moved(steps)
        moving[number] = before._replace(twists=reduced([*before.twists, *steps], 6).rows)
        for z in _unseen(moving[number]):
            handed(number, z, 0, z)
        for z in _handed(before, steps, rotor=True, effort="offset" in body.kinds):
            whole = handed(number, z[:BODY], body.parent, _moved(z[:BODY], frame))
            whole[count] = z[BODY]
            if "offset" in body.kinds:
                whole[count + body.kinds.index("offset")] = z[BODY + 1]
        count += len(body.kinds)
    for closure in ends:
        frames = _table(closure.frame_a), _table(closure.frame_b)
        steps = [_EVERY[k] for k in closure.moves]
        before = moving[closure.a].seen_from(frames[0]).moved(steps)
        for z in _handed(before, steps, rotor=False, effort=False)[:, :BODY]:
            handed(closure.b, _moved(z, frames[1]), closure.a, _moved(z, frames[0]))
    rows = np.array([[rational(x) for x in row] for row in found], dtype=object).reshape(-1, width + 6)
    return null_space(rows[:, width:].T, len(rows)) @ rows[:, :width] if held else rows[:, :width]


def _unseen(moving: BodyMotions) -> Table:
    """(1) Ten numbers without energy at any twist, and without weight along it."""
    a, w = moving.felt
    columns = [(a @ M @ w.T).ravel() for M in _UNIT_INERTIAS]
    return null_space(np.array(columns, dtype=object).T, BODY)


def _handed(before: BodyMotions, steps: Sequence[Table], rotor: bool, effort: bool) -> Table:
    """(2) Ten numbers of a body that are the same on the one before, with a rotor and a constant effort between them.

    Args:
        before: Of that one, in axes of this one, whatever the joint's displacement.
        steps: Twists of the joint.
        rotor: Whether there can be one, else it is 0.
        effort: Whether there can be one; it enters where gravity is constant in these axes.

    Returns:
        Rows of 12 numbers.
    """
    u, s = before.twists, np.array(steps, dtype=object).reshape(-1, 6)
    (a, w), size = before.felt, s @ s.T
    effort = effort and len(before.pulls) <= 1 and size[0, 0] == 1
    down = np.concatenate([before.gravity, [0, 0, 0]])[None] if effort else before.level
    columns = []
    for M in _UNIT_INERTIAS:
        turned = [(a @ (across.T @ M + M @ across) @ w.T).ravel() for across in map(_across, steps)]
        pairs = [*[(_EVERY, s)] * before.held, (s, u), (s, s), (down, s)]
        columns.append(np.concatenate([*turned, *((x @ M @ y.T).ravel() for x, y in pairs)]))
    rows = len(down) * len(s)
    ahead = [0] * (len(columns[0]) - size.size - rows)
    turning = np.array([*ahead, *(size * np.eye(len(s), dtype=int)).ravel(), *[0] * rows], dtype=object)
    pulling = np.array([*ahead, *[0] * size.size, *[1] * rows], dtype=object)
    held = [*range(BODY), *[BODY] * rotor, *[BODY + 1] * effort]
    columns += [*[turning] * rotor, *[pulling] * effort]
    found = null_space(np.array(columns, dtype=object).T, len(columns))
    whole = np.zeros((len(found), BODY + 2), dtype=object)
    whole[:, held] = found
    return whole


def _steps(body: JoinedBody) -> list[Table]:
    """The twists of a joint's steps."""
    return [
        np.array([*map(rational, axis), 0, 0, 0] if slides else [0, 0, 0, *map(rational, axis)], dtype=object)
        for axis, slides in zip(body.directions, body.slides, strict=True)
    ]


def _table(numbers: Numbers) -> Table:
    return np.array([[rational(x) for x in row] for row in numbers], dtype=object)


def _skew(vector: Table) -> Table:
    x, y, z = vector
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]], dtype=object)


def _across(twist: Table) -> Table:
    """Ad with ad_s w = s × w, of shape (6, 6)."""
    turn, nothing = _skew(twist[3:]), np.zeros((3, 3), dtype=object)
    return np.block([[turn, _skew(twist[:3])], [nothing, turn]])


def _to_frame(frame: Table) -> Table:
    """What takes twists about a body's origin to those about a frame's on it, in its axes, of shape (6, 6)."""
    turned, nothing = frame[:3, :3].T, np.zeros((3, 3), dtype=object)
    return np.block([[turned, -(turned @ _skew(frame[:3, 3]))], [nothing, turned]])


def _moved(numbers: Table, frame: Table) -> Table:
    """Ten numbers in a frame on a body as those of the body."""
    to = _to_frame(frame)
    M = to.T @ sum(unit * x for unit, x in zip(_UNIT_INERTIAS, numbers, strict=True)) @ to
    return np.array([M[0, 0], M[5, 1], M[3, 2], M[4, 0], *(M[3 + i, 3 + j] for i, j in _PAIRS)], dtype=object)


def _unit_inertias() -> Iterator[Table]:
    """The 6×6 inertia of each of the ten numbers alone: momentum (linear, angular) of a twist."""
    for k in range(BODY):
        M, numbers = np.zeros((6, 6), dtype=object), [int(i == k) for i in range(BODY)]
        M[:3, :3] = np.eye(3, dtype=int).astype(object) * numbers[0]
        M[3:, :3] = _skew(np.array(numbers[1:4], dtype=object))
        M[:3, 3:] = -M[3:, :3]
        for x, (i, j) in zip(numbers[4:], _PAIRS, strict=True):
            M[3 + i, 3 + j] = M[3 + j, 3 + i] = x
        yield M


_UNIT_INERTIAS = tuple(_unit_inertias())
_EVERY = np.eye(6, dtype=int).astype(object)
