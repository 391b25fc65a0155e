"""A linkage's inertia and weight as masses on the serial robot's links and armatures of its joints.

What the linkage adds to mass matrix and gravity of the serial robot is

    L(q) = D(q) − D_s(q),    w(q) = g(q) − g_s(q),

and what may stand for it is linear in numbers x ≥ 0: a mass at a point p of a link adds m J_pᵀJ_p and −m J_pᵀ·gravity,
a second moment s uuᵀ along a direction u of a link adds s J_ωᵀ(1 − uuᵀ)J_ω and no weight, an armature adds to its own
joint. Links so made are those of bodies: their second moments of mass stay positive. All masses together are the
linkage's; what no moving link takes lies on the link that carries the first joint, and moves nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from ccpin.arrays import Array, skew
from ccpin.description.model import Inertia, Link
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.kinematics.points import LinkPoint
from ccpin.transmission.posture import Posture

_EXACT, _ALMOST = 1e4, 1e2  # weights of D and of g at a posture that is to be met, beside 1 of the range
_PLAIN = 0.1  # what a number that is no armature costs beside errors of its own size: armatures stand for rotors
_NOTHING = 1e-9  # of the whole: what is less is rounding
_BRISK = 10.0  # rad/s² (m/s²): an error of D counts as the effort that such an acceleration takes
_DIRECTIONS = np.array([
    [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, -1, 0], [1, 0, 1], [1, 0, -1], [0, 1, 1], [0, 1, -1],
    [1, 1, 1], [1, 1, -1], [1, -1, 1], [-1, 1, 1],
]) / np.sqrt([[1], [1], [1], [2], [2], [2], [2], [2], [2], [3], [3], [3], [3]])  # fmt: skip


class PointMass(NamedTuple):
    """A mass, kg, at a place in a link's frame, m."""

    link: str
    place: Array
    mass: float


class SecondMoment(NamedTuple):
    """∫ρr²dV, kg m², along a unit direction in a link's frame: of two equal masses far apart, as light as one likes."""

    link: str
    direction: Array
    size: float


def second_moments(link: str, inertia: Inertia, axes: Array) -> tuple[SecondMoment, ...]:
    """Those of a body about its centre, along its principal axes, on a link in whose frame its own axes are `axes`."""
    sizes, ways = np.linalg.eigh(0.5 * np.trace(inertia.rotational) * np.eye(3) - inertia.rotational)
    found = zip((axes @ ways).T, sizes.tolist(), strict=True)
    return tuple(SecondMoment(link, way, size) for way, size in found if size > 0.0)


class Additions(NamedTuple):
    """What stands for the linkage: masses, second moments, and armatures of the joints, kg m² or kg, of shape (n,)."""

    masses: tuple[PointMass, ...]
    moments: tuple[SecondMoment, ...]
    armatures: Array

    def on(self, link: Link) -> Link:
        """The link with what is added to it."""
        masses = [each for each in self.masses if each.link == link.name]
        moments = [each for each in self.moments if each.link == link.name]
        if not masses and not moments:
            return link
        own = link.inertia or Inertia(0.0, np.zeros(3), np.zeros((3, 3)))
        mass = own.mass + sum(each.mass for each in masses)
        first = own.mass * own.com + sum((each.mass * each.place for each in masses), np.zeros(3))
        second = 0.5 * np.trace(own.rotational) * np.eye(3) - own.rotational + own.mass * np.outer(own.com, own.com)
        for point in masses:
            second = second + point.mass * np.outer(point.place, point.place)
        for moment in moments:
            second = second + moment.size * np.outer(moment.direction, moment.direction)
        com = first / mass if mass > 0.0 else first
        central = second - mass * np.outer(com, com)
        return replace(link, inertia=Inertia(mass, com, np.trace(central) * np.eye(3) - central))


class _Column(NamedTuple):
    """Something that may be added, and what one unit of it adds to D and g at each posture."""

    what: PointMass | SecondMoment | int
    inertias: Array
    weights: Array


class Ground(NamedTuple):
    """What does not move, and what of the linkage may rest on it.

    Attributes:
        total: The linkage's mass.
        com: Its place at the reference, in the frame of the points.
        points: The linkage's bodies, on the link that carries the first joint; none where that is the world.
        moments: Second moments of each about its centre.
    """

    total: float
    com: Array
    points: tuple[PointMass, ...]
    moments: tuple[tuple[SecondMoment, ...], ...]


def equivalent(
    own: ReducedModel, postures: Sequence[Posture], at: Posture | None, places: Mapping[str, Array], ground: Ground
) -> Additions:
    """What stands for the linkage: least squares over postures, of numbers that are not negative.

    Args:
        own: The serial robot alone, in the mechanism's coordinates.
        postures: Over the range.
        at: Where D is to be met, and g as well as can be; default nowhere.
        places: A link with mass of each moving body, with points of it where masses may be.
        ground: What takes the rest.
    """
    every = [*postures, *([] if at is None else [at])]
    states = [own.at(posture.state.q, posture.state.q_free) for posture in every]
    inertias = np.array([posture.state.D - state.D for posture, state in zip(every, states, strict=True)])
    weights = np.array([posture.state.g - state.g for posture, state in zip(every, states, strict=True)])
    columns = list(_columns(own, every, places, inertias[-1]))
    unit = np.sqrt(np.mean([posture.state.D.diagonal() for posture in every], axis=0))
    first, second = entries = np.triu_indices(own.n)
    count = np.full(len(every), len(postures) ** -0.5)
    stress, care = count.copy(), count.copy()
    if at is not None:
        stress[-1], care[-1] = _EXACT, _ALMOST

    def rows(inertia: Array, weight: Array) -> Array:
        scaled = inertia[:, first, second] / np.outer(unit, unit)[entries] * stress[:, None]
        return np.concatenate([scaled.ravel(), (weight / (unit * _BRISK * unit.max()) * care[:, None]).ravel()])

    system = np.stack([rows(column.inertias, column.weights) for column in columns], axis=1)
    sizes = np.maximum(np.linalg.norm(system, axis=0), 1e-300)
    mass = np.array([float(isinstance(column.what, PointMass)) for column in columns])
    plain = np.diag([0.0 if isinstance(column.what, int) else _PLAIN for column in columns])
    balance, goal = _balance(mass / sizes, ground, own.mechanism.description.size)
    still = np.zeros((len(system) + len(columns), balance.shape[1] - len(columns)))
    matrix = np.concatenate([np.hstack([np.concatenate([system / sizes, plain]), still]), balance])
    wanted = np.concatenate([rows(inertias, weights), np.zeros(len(columns)), goal])
    found = nnls(matrix, wanted, maxiter=200 * matrix.shape[1])[0]
    x = np.where(found[: len(columns)] > _NOTHING, found[: len(columns)], 0.0) / sizes
    if at is not None:
        x = _met(x, np.stack([column.inertias[-1][entries] for column in columns], axis=1), inertias[-1][entries])
    return _additions([column.what for column in columns], x, own.n, ground, found[len(columns) :])


def _balance(mass: Array, ground: Ground, size: float) -> tuple[Array, Array]:
    """Rows of the masses' sum and, weakly, of their centre; with a column for each mass at rest."""
    points = len(ground.points)
    rows = np.zeros((4 if points else 1, len(mass) + max(points, 1)))
    if ground.total <= 0.0:
        rows[0, : len(mass)] = 1e3 * mass  # nothing may be added
        return rows, np.zeros(len(rows))
    rows[0, : len(mass)], rows[0, len(mass) :] = mass / ground.total, 1.0
    for k, point in enumerate(ground.points):
        rows[1:, len(mass) + k] = 1e-3 * (point.place - ground.com) / size
    return 10.0 * rows, 10.0 * np.eye(len(rows))[0]


def _met(x: Array, matrix: Array, wanted: Array) -> Array:
    """The numbers with their last digits changed so that the equation holds, each in proportion to itself."""
    for _ in range(3):
        relative = matrix * x
        change = np.linalg.lstsq(relative, wanted - matrix @ x, rcond=1e-12)[0]
        x = x * (1.0 + np.maximum(change, -0.5))
    return x


def _additions(
    what: Sequence[PointMass | SecondMoment | int], x: Array, n: int, ground: Ground, rest: Array
) -> Additions:
    masses, moments, armatures = list[PointMass](), list[SecondMoment](), np.zeros(n)
    for each, value in zip(what, x.tolist(), strict=True):
        if isinstance(each, int):
            armatures[each] += value
        elif value > 0.0 and isinstance(each, PointMass):
            masses.append(each._replace(mass=value))
        elif value > 0.0 and isinstance(each, SecondMoment):
            moments.append(each._replace(size=value))
    spare = ground.total - sum(each.mass for each in masses)
    if ground.points and spare > 0.0:
        shares = rest / rest.sum() if rest.sum() > 0.0 else np.full(len(rest), 1.0 / len(rest))
        for point, own, share in zip(ground.points, ground.moments, (spare * shares).tolist(), strict=True):
            if share > 0.0:
                masses.append(point._replace(mass=share))
                moments += [each._replace(size=each.size * share / point.mass) for each in own]
    return Additions(tuple(masses), tuple(moments), armatures)


def _columns(
    own: ReducedModel, every: Sequence[Posture], places: Mapping[str, Array], last: Array
) -> Iterator[_Column]:
    """All that may be added to links and joints; directions also those of what is lacking at the last posture."""
    n, none = own.n, np.zeros((len(every), own.n))
    for k in range(n):
        yield _Column(k, np.repeat(np.diag(np.eye(n)[k])[None], len(every), axis=0), none)
    for link, points in places.items():
        point = LinkPoint(own.mechanism.tree, link)
        turns = np.array([point.pose(posture.state.q_free)[:3, :3] for posture in every])
        twists = np.array([point.jacobian(posture.state.q_free) @ posture.state.rho for posture in every])
        moved, turned = twists[:, :3], turns.transpose(0, 2, 1) @ twists[:, 3:]  # the second in the link's frame
        for place in points:
            rates = moved - np.array(
                [skew(turn @ place) @ twist[3:] for turn, twist in zip(turns, twists, strict=True)]
            )
            inertia = rates.transpose(0, 2, 1) @ rates
            yield _Column(PointMass(link, place, 1.0), inertia, -own.gravity_vector @ rates)
        back = np.linalg.pinv(turned[-1])
        _, axes = np.linalg.eigh(back.T @ last @ back)
        for way in (*_DIRECTIONS, *axes.T):
            along = turned.transpose(0, 2, 1) @ way
            inertia = turned.transpose(0, 2, 1) @ turned - along[:, :, None] * along[:, None, :]
            if np.abs(inertia).max() > 0.0:
                yield _Column(SecondMoment(link, way, 1.0), inertia, none)
