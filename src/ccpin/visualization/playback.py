"""Trajectories given as plain arrays: checked, and sampled at the frames of an animation."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ccpin.arrays import Array, numbers, positive
from ccpin.errors import InvalidInputError
from ccpin.mechanism.mechanism import Mechanism


class HasForce(Protocol):
    """A force along a motion, as `ccpin.simulation.closure_forces` and `joint_forces` give them."""

    @property
    def name(self) -> str:
        """What it is called in the picture."""

    @property
    def t(self) -> Array:
        """Increasing times, s, of shape (T,)."""

    @property
    def point(self) -> Array:
        """Where it acts, m, of shape (T, 3), in the world."""

    @property
    def force(self) -> Array:
        """The force, N, of shape (T, 3), in world axes."""


MAX_FRAMES = 100_000  # of an animation: bounds its page's size
# From unit length: quaternions and (cosine, sine) pairs farther off are refused, nearer ones normalised.
NOT_UNIT = 1e-3


def checked_pose(mechanism: Mechanism, q_free: ArrayLike) -> Array:
    """q′ as a float64 array of shape (nq,).

    Raises:
        InvalidInputError: Wrong shape, not finite, or a part on a sphere (quaternion, cosine and sine) is off it.
    """
    pose: Array = checked_poses(mechanism, numbers(q_free, "q_free")[None])[0]
    return pose


def checked_poses(mechanism: Mechanism, q_free: ArrayLike) -> Array:
    """Configurations as a float64 array of shape (T, nq); errors as for `checked_pose`."""
    poses = numbers(q_free, "q_free").copy()
    if poses.ndim != 2 or poses.shape[1] != mechanism.nq:
        shape = poses.shape[1:] if poses.ndim and len(poses) == 1 else poses.shape
        raise InvalidInputError(
            f"q_free has shape {shape}; each configuration of {mechanism.name} has nq = {mechanism.nq} numbers"
        )
    model = mechanism.tree.model
    for index, pose in enumerate(poses):
        if not np.all(np.isfinite(pose)):
            raise InvalidInputError(f"q_free[{index}] is not finite")
        if not pin.isNormalized(model, pose, NOT_UNIT):
            raise InvalidInputError(f"q_free[{index}] has a quaternion or (cosine, sine) pair not of unit length")
    return np.array([pin.normalize(model, pose) for pose in poses]).reshape(poses.shape)


def checked_times(t: ArrayLike, count: int) -> Array:
    """Times as a float64 array of shape (count,).

    Raises:
        InvalidInputError: Wrong shape, fewer than two, not finite or not strictly increasing.
    """
    times = numbers(t, "t")
    if times.shape != (count,):
        raise InvalidInputError(f"t has shape {times.shape}; q_free holds {count} configurations: give ({count},)")
    if count < 2:
        raise InvalidInputError(f"an animation needs at least two samples, t has {count}; a pose is a snapshot")
    if not np.all(np.isfinite(times)):
        raise InvalidInputError("t is not finite")
    late = np.flatnonzero(np.diff(times) <= 0)
    if late.size:
        i = int(late[0])
        raise InvalidInputError(
            f"t must increase strictly; t[{i}] = {times[i]:.6g} s is followed by t[{i + 1}] = {times[i + 1]:.6g} s"
        )
    return times


def frame_times(t: Array, fps: float, speed: float) -> Array:
    """Times t₀ + k speed/fps of the frames, the last one at the end of `t`, of shape (frames,).

    Raises:
        InvalidInputError: `fps` or `speed` is not positive, or there would be too many frames.
    """
    for name, value in (("fps", fps), ("speed", speed)):
        positive(value, name)
    steps = math.ceil((t[-1] - t[0]) * fps / speed - 1e-9)
    if steps >= MAX_FRAMES:
        message = f"{steps + 1} frames are too many (at most {MAX_FRAMES}); take a larger speed or a smaller fps"
        raise InvalidInputError(message)
    return np.asarray(np.minimum(t[0] + np.arange(max(steps, 1) + 1) * speed / fps, t[-1]))


def finer(times: Array, every: int) -> Array:
    """Times with `every` − 1 more between each two, evenly: ``finer(times, every)[::every]`` are the old ones."""
    places = np.arange(every * (len(times) - 1) + 1) / every
    return np.asarray(np.interp(places, np.arange(len(times)), times))


def sample(mechanism: Mechanism, t: Array, q_free: Array, times: Array) -> Array:
    """Configurations (len(times), nq) at `times`, along the geodesics between the samples (t, q_free)."""
    model = mechanism.tree.model
    after = np.clip(np.searchsorted(t, times, side="right"), 1, len(t) - 1)
    before = after - 1
    fractions = (times - t[before]) / (t[after] - t[before])
    moments = zip(q_free[before], q_free[after], fractions.tolist(), strict=True)
    return np.array([a if u <= 0 else b if u >= 1 else pin.interpolate(model, a, b, u) for a, b, u in moments])


def resampled(arrow: HasForce, name: str, times: Array) -> Array:
    """A force's `point` or `force` at `times` (N,), of shape (N, 3), straight between its samples.

    Raises:
        InvalidInputError: It is not of shape (its times, 3), or not finite.
    """
    own, rows = numbers(arrow.t, "t"), numbers(getattr(arrow, name), name)
    if own.ndim != 1 or not own.size or rows.shape != (own.size, 3) or not np.isfinite(rows).all():
        raise InvalidInputError(f"force '{arrow.name}': its {name} must be finite, of shape ({own.size}, 3)")
    return np.column_stack([np.interp(times, own, column) for column in rows.T])
