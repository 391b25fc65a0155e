"""What sensors of a calibration see: displacements, positions and poses, heights above a plane, distances.

Each kind compares what it said with what a geometry makes of it, ε = m ⊖ h(s; b), s being what it sees of a
configuration and b numbers of its own that are not known (offsets, where it stands, where its target is):

    encoders     h = q_k + o_k                       (angles on circles up to whole turns)
    tracker      h = t + R (x + A a)                 (x, A: a point of a link and its axes; of poses also R A)
    plane        h = nᵀ x − d, which is said to be 0
    bar          h = |x − c|

with R = R_z R_y R_x(δ) R₀, t₀ and R₀ fitted to the file's geometry (Kabsch).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, Record, numbers
from ccpin.description.model import skewness
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import InvalidInputError
from ccpin.identification.calibration.geometry_equations import OpenGeometry
from ccpin.identification.calibration.geometry_numbers import offset_of
from ccpin.identification.calibration.sensor_frames import best_frame, turn_between, turn_slopes, turned
from ccpin.programs.recording.constants import Parameter
from ccpin.programs.tape import Expression

_SKEWED = 1e-3  # of RᵀR − 1: what is more is no rotation that was rounded


class LeftOver(NamedTuple):
    """What a sensor leaves, and what it is to first order.

    Attributes:
        left: ε, of shape (N, d).
        by_seen: −∂ε/∂s, of shape (N, d, w).
        by_own: −∂ε/∂b, of shape (N, d, e).
    """

    left: Array
    by_seen: Array
    by_own: Array


@dataclass(frozen=True)
class SensorKind(Record):
    """What a sensor sees, and what it leaves of what it said.

    Attributes:
        name: What its own numbers are called by.
        noise: Standard deviations of what it says, of shape (d,).
    """

    name: str
    noise: Array

    @property
    def links(self) -> tuple[str, ...]:
        """The links that it sees."""
        return ()

    def values(self, measured: ArrayLike) -> Array:
        """What it said, a row a pose, NaN where it said nothing.

        Raises:
            InvalidInputError: A wrong shape, what is not finite but not a whole row of NaN, a pose that is none.
        """
        return _rows(measured, self.name, len(self.noise))

    def bound(self, model: ReducedModel) -> SensorKind:
        """The sensor at a mechanism.

        Raises:
            InvalidInputError: It has no such link or joint.
        """
        attachments = model.mechanism.tree.attachments
        for link in self.links:
            if link not in attachments or not attachments[link].joint:
                moving = ", ".join(name for name, at in attachments.items() if at.joint)
                raise InvalidInputError(f"{self.name}: '{link}' is no link that moves; these do: {moving}")
        return self

    def unknowns(self, model: ReducedModel) -> tuple[Parameter, ...]:
        """b."""
        return ()

    def watched(self, recorded: OpenGeometry) -> list[Expression]:
        """s."""
        raise NotImplementedError

    def shown(self, seen: Array) -> Array:
        """What it would say of s of shape (N, w), its own numbers as stated."""
        return seen

    def placed(self, seen: Array, values: Array) -> SensorKind:
        """The sensor where it stands as far as the file's geometry says, of s of shape (N, w)."""
        return self

    def compared(self, values: Array, seen: Array, own: Array) -> LeftOver:
        """ε at s of shape (N, w) and b of shape (e,)."""
        raise NotImplementedError


@dataclass(frozen=True)
class Encoders(SensorKind):
    """Displacements of joints; offsets of some of them are unknown."""

    joints: tuple[str, ...]
    offsets: tuple[str, ...]
    circles: tuple[bool, ...] = ()

    def bound(self, model: ReducedModel) -> SensorKind:
        """The encoders; which joints turn on circles."""
        there = {joint.name: joint for joint in model.mechanism.tree.joints if joint.kind.nv == 1}
        for name in self.joints:
            if name not in there:
                raise InvalidInputError(f"joints: '{name}' is no joint of one freedom; there are {', '.join(there)}")
        return replace(self, circles=tuple(there[name].kind.unit == 2 for name in self.joints))

    def unknowns(self, model: ReducedModel) -> tuple[Parameter, ...]:
        """Offsets."""
        units = {joint.name: "m" if joint.kind.slides[0] else "rad" for joint in model.mechanism.tree.joints}
        return tuple(offset_of(name, units[name]) for name in self.offsets)

    def watched(self, recorded: OpenGeometry) -> list[Expression]:
        """The displacements."""
        return [recorded.displacement(name) for name in self.joints]

    def compared(self, values: Array, seen: Array, own: Array) -> LeftOver:
        """q̂ − q − o."""
        d, by_own = len(self.joints), np.zeros((len(self.joints), len(self.offsets)))
        for k, name in enumerate(self.offsets):
            by_own[self.joints.index(name), k] = 1.0
        left = values - seen - by_own @ own
        round_one = left[:, list(self.circles)]
        left[:, list(self.circles)] = np.remainder(round_one + np.pi, 2.0 * np.pi) - np.pi
        same = np.broadcast_to(np.eye(d), (len(seen), d, d))
        return LeftOver(left, same, np.broadcast_to(by_own, (len(seen), *by_own.shape)))


@dataclass(frozen=True)
class OnLink(SensorKind):
    """What sees a point of a link, of shape (3,) in its frame."""

    link: str
    point: Array

    @property
    def links(self) -> tuple[str, ...]:
        """The link."""
        return (self.link,)

    def watched(self, recorded: OpenGeometry) -> list[Expression]:
        """The point."""
        return list(recorded.pose(self.link, self.point)[0])


@dataclass(frozen=True)
class Tracker(OnLink):
    """Positions or poses of a link's point, from a frame that is free or the world's."""

    free: bool
    target: bool
    base: Array

    @property
    def _turns(self) -> bool:
        return len(self.noise) == 6

    @property
    def _own(self) -> int:
        return 6 * self.free + 3 * self.target

    def values(self, measured: ArrayLike) -> Array:
        """Positions; of poses position and axes, of shape (N, 12)."""
        if not self._turns:
            return super().values(measured)
        given = numbers(measured, self.name)
        if given.ndim != 3 or given.shape[1:] != (4, 4):
            raise InvalidInputError(f"{self.name}: poses must be of shape (N, 4, 4), not {given.shape}")
        rows = _rows(np.concatenate([given[:, :3, 3], given[:, :3, :3].reshape(-1, 9)], axis=1), self.name, 12)
        wrong = skewness(rows[:, 3:].reshape(-1, 3, 3)) > _SKEWED
        if wrong.any():
            pose = int(np.argmax(wrong))
            raise InvalidInputError(f"{self.name}: the upper left 3×3 block of pose {pose} is no rotation matrix")
        return rows

    def unknowns(self, model: ReducedModel) -> tuple[Parameter, ...]:
        """Where it stands, and where the target is."""
        found = list[Parameter]()
        if self.free:
            found += [_origin(f"{self.name}/{axis}", self.base[k, 3]) for k, axis in enumerate("xyz")]
            found += [
                Parameter(f"turn:{self.name}/{axis}", "turn", f"{self.name}/{axis}", 0.0, "rad") for axis in "xyz"
            ]
        if self.target:
            found += [_origin(f"{self.name}/target/{axis}", self.point[k]) for k, axis in enumerate("xyz")]
        return tuple(found)

    def watched(self, recorded: OpenGeometry) -> list[Expression]:
        """The point (of an unknown target the link's origin), and where they count its axes."""
        x, axes = recorded.pose(self.link, (0.0, 0.0, 0.0) if self.target else self.point)
        return [*x, *(axes.ravel() if self._turns or self.target else ())]

    def placed(self, seen: Array, values: Array) -> SensorKind:
        """Standing where the squares of distances are least."""
        if not self.free:
            return self
        said = np.isfinite(values).all(axis=1)
        if not said.any():
            return self
        axes, measured = seen[said, 3:], values[said, 3:]
        shown = (axes.reshape(-1, 3, 3), measured.reshape(-1, 3, 3)) if self._turns else (np.empty((0, 3, 3)),) * 2
        return replace(self, base=best_frame(self._points(seen[said], self.point), values[said, :3], *shown))

    def shown(self, seen: Array) -> Array:
        """Positions, and axes."""
        points = self._points(seen, self.point)
        return np.concatenate([points, seen[:, 3:12]], axis=1) if self._turns else points

    def frame(self, own: Array) -> Array:
        """The world in the sensor's axes, of shape (4, 4)."""
        found = np.array(self.base)
        if self.free:
            found[:3, :3], found[:3, 3] = turned(own[3:6])[0] @ self.base[:3, :3], own[:3]
        return found

    def compared(self, values: Array, seen: Array, own: Array) -> LeftOver:
        """Positions, then turns."""
        count, w, d = len(seen), seen.shape[1], len(self.noise)
        a = own[6 * self.free :] if self.target else self.point
        frame, points = self.frame(own), self._points(seen, a)
        B, t = frame[:3, :3], frame[:3, 3]
        left, by_seen, by_own = np.empty((count, d)), np.zeros((count, d, w)), np.zeros((count, d, self._own))
        left[:, :3] = values[:, :3] - t - points @ B.T
        by_seen[:, :3, :3] = B
        if self.target:
            by_seen[:, :3, 3:12] = np.einsum("ik,j->ikj", B, a).reshape(3, 9)
            by_own[:, :3, 6 * self.free :] = B @ seen[:, 3:12].reshape(-1, 3, 3)
        slopes = [slope @ self.base[:3, :3] for slope in turned(own[3:6])[1]] if self.free else []
        if self.free:
            by_own[:, :3, :3] = np.eye(3)
        for k, slope in enumerate(slopes):
            by_own[:, :3, 3 + k] = points @ slope.T
        if self._turns:
            axes, measured = seen[:, 3:12].reshape(-1, 3, 3), values[:, 3:12].reshape(-1, 3, 3)
            left[:, 3:] = turn_between(axes, B.T @ measured)
            by_seen[:, 3:, 3:12] = -turn_slopes(B.T @ measured)
            for k, slope in enumerate(slopes):
                by_own[:, 3:, 3 + k] = -turn_between(axes, slope.T @ measured)
        return LeftOver(left, by_seen, by_own)

    def _points(self, seen: Array, a: Array) -> Array:
        return seen[:, :3] + seen[:, 3:12].reshape(-1, 3, 3) @ a if self.target else seen[:, :3]


@dataclass(frozen=True)
class Plane(OnLink):
    """Heights of a link's point above a plane."""

    normal: Array
    distance: float

    def shown(self, seen: Array) -> Array:
        """Heights."""
        return (seen @ self.normal - self.distance)[:, None]

    def compared(self, values: Array, seen: Array, own: Array) -> LeftOver:
        """m − nᵀx + d."""
        return LeftOver(
            values - self.shown(seen), np.broadcast_to(self.normal, (len(seen), 1, 3)), np.zeros((len(seen), 1, 0))
        )


@dataclass(frozen=True)
class Bar(OnLink):
    """Distances of a link's point from a ball."""

    centre: Array

    def unknowns(self, model: ReducedModel) -> tuple[Parameter, ...]:
        """Where the ball is."""
        return tuple(_origin(f"{self.name}/{axis}", self.centre[k]) for k, axis in enumerate("xyz"))

    def shown(self, seen: Array) -> Array:
        """Distances."""
        return np.asarray(np.linalg.norm(seen - self.centre, axis=1, keepdims=True))

    def compared(self, values: Array, seen: Array, own: Array) -> LeftOver:
        """m − |x − c|."""
        away = seen - own
        size = np.linalg.norm(away, axis=1, keepdims=True)
        way = (away / size)[:, None, :]
        return LeftOver(values - size, way, -way)


def _rows(measured: object, name: str, columns: int) -> Array:
    given = numbers(measured, name)
    if columns == 1 and given.ndim == 1:
        given = given[:, None]
    if given.ndim != 2 or given.shape[1] != columns:
        raise InvalidInputError(f"{name}: what was measured must be of shape (N, {columns}), not {given.shape}")
    finite = np.isfinite(given)
    if np.isinf(given).any() or (finite.any(axis=1) != finite.all(axis=1)).any():
        raise InvalidInputError(f"{name}: a row that was measured must be of finite numbers, one that was not, of NaN")
    return given


def _origin(of: str, value: float) -> Parameter:
    return Parameter(f"origin:{of}", "origin", of, float(value), "m")
