"""`Sensor`: what a calibration reads beside the motors' encoders, or in their place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, Record, instance, number, one_each, records, vector
from ccpin.errors import InvalidInputError
from ccpin.identification.calibration.sensor_kinds import Bar, Encoders, Plane, SensorKind, Tracker


@dataclass(frozen=True)
class Sensor(Record):
    """A sensor of a calibration, made by `encoders`, `tracker`, `touch`, `plane` or `bar`.

    Attributes:
        kind: What it sees, its name and its noise.
    """

    kind: SensorKind

    @staticmethod
    def encoders(joints: Sequence[str], noise: ArrayLike = 1e-4, *, offsets: Sequence[str] | None = None) -> Sensor:
        """Displacements of joints of one freedom each, driven or not; measured (N, d).

        Args:
            joints: Their names.
            noise: Standard deviations, rad or m, one for all or of shape (d,).
            offsets: Whose zero is not known (`"offset:JOINT"`); default all.

        Raises:
            InvalidInputError: Joints without names, a deviation that is not positive, an offset of none of the joints.
        """
        names = records(joints, "joints", str)
        off = names if offsets is None else tuple(dict.fromkeys(records(offsets, "offsets", str)))
        if not names or len(set(names)) != len(names):
            raise InvalidInputError("joints must be names of joints, each once")
        for name in off:
            if name not in names:
                raise InvalidInputError(f"offsets: '{name}' is none of {', '.join(names)}")
        return Sensor(Encoders("encoders", one_each(noise, "noise", len(names), positive=True), names, off))

    @staticmethod
    def tracker(
        link: str,
        noise: ArrayLike = 5e-5,
        *,
        point: ArrayLike = (0.0, 0.0, 0.0),
        turn_noise: ArrayLike | None = None,
        target: bool = False,
        name: str = "tracker",
    ) -> Sensor:
        """Where a point of a link is, seen from where nobody knows; measured (N, 3), or poses (N, 4, 4).

        Args:
            link: The link.
            noise: Standard deviation of positions, m, one for all or of shape (3,).
            point: The target, in the link's frame, m.
            turn_noise: That of the axes' turns, rad, for a sensor of poses (a camera); default: positions alone.
            target: Whether the target's place on the link is not known either (`"origin:NAME/target/x"`).
            name: What its place (`"origin:NAME/x"`) and turn (`"turn:NAME/x"`) are called by.

        Raises:
            InvalidInputError: A point or deviation that is none.
        """
        return _tracker(link, noise, point, turn_noise, target, name, free=True)

    @staticmethod
    def touch(link: str, noise: ArrayLike = 5e-5, *, point: ArrayLike = (0.0, 0.0, 0.0), name: str = "touch") -> Sensor:
        """Known points, in the world, that a point of a link was brought to; measured (N, 3).

        Args and errors as of `tracker`.
        """
        return _tracker(link, noise, point, None, False, name, free=False)

    @staticmethod
    def plane(
        link: str,
        normal: ArrayLike,
        distance: float = 0.0,
        noise: float = 5e-5,
        *,
        point: ArrayLike = (0.0, 0.0, 0.0),
        name: str = "plane",
    ) -> Sensor:
        """How far a point of a link is above a known plane of the world, nᵀx = d: 0 where it touches; measured (N, 1).

        Args:
            link: The link.
            normal: n, of any length but 0.
            distance: d, m, of the unit normal.
            noise: A standard deviation, m.
            point: The point in the link's frame, m.
            name: What it is called.

        Raises:
            InvalidInputError: A normal, distance, point or deviation that is none.
        """
        n = vector(normal, "normal", 3)
        if not np.linalg.norm(n) > 0.0:
            raise InvalidInputError("normal must not be zero")
        n = n / np.linalg.norm(n)
        return Sensor(Plane(*_on_link(name, noise, 1, link, point), n, number(distance, "distance")))

    @staticmethod
    def bar(
        link: str,
        centre: ArrayLike,
        noise: float = 5e-6,
        *,
        point: ArrayLike = (0.0, 0.0, 0.0),
        name: str = "bar",
    ) -> Sensor:
        """How far a point of a link is from a ball whose place is about known (a ball-bar); measured (N, 1), m.

        Args:
            link: The link.
            centre: About where the ball is, in the world, m; it is found too (`"origin:NAME/x"`).
            noise: A standard deviation, m.
            point: The point in the link's frame, m.
            name: What it is called.

        Raises:
            InvalidInputError: A centre, point or deviation that is none.
        """
        return Sensor(Bar(*_on_link(name, noise, 1, link, point), vector(centre, "centre", 3)))


def _tracker(
    link: str, noise: ArrayLike, point: ArrayLike, turn_noise: ArrayLike | None, target: bool, name: str, *, free: bool
) -> Sensor:
    called, spreads, seen, at = _on_link(name, noise, 3, link, point)
    if turn_noise is not None:
        spreads = np.concatenate([spreads, one_each(turn_noise, "turn_noise", 3, positive=True)])
    return Sensor(Tracker(called, spreads, seen, at, free, instance(target, "target", bool), np.eye(4)))


def _on_link(name: str, noise: ArrayLike, d: int, link: str, point: ArrayLike) -> tuple[str, Array, str, Array]:
    """The fields of `OnLink`, checked."""
    spreads = one_each(noise, "noise", d, positive=True)
    return instance(name, "name", str), spreads, instance(link, "link", str), vector(point, "point", 3)
