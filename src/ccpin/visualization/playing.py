"""A trajectory played in a scene, with all that is drawn of its course."""

from __future__ import annotations

import math
from collections.abc import Sequence

from numpy.typing import ArrayLike

from ccpin.visualization.annotations import Tracked, draw_forces, draw_ghosts, draw_trace
from ccpin.visualization.playback import HasForce, checked_poses, checked_times, finer, frame_times, sample
from ccpin.visualization.scene import Scene

TRACED_SAMPLES = 400
"""A path is drawn through at least so many points, however few the frames."""


def play(
    scene: Scene,
    t: ArrayLike,
    q_free: ArrayLike,
    *,
    fps: float = 30,
    speed: float = 1.0,
    trace: Tracked | None = None,
    forces: Sequence[HasForce] = (),
    loop: bool = True,
) -> int:
    """Play a trajectory in a scene, with its path, ghosts of its ends and forces; return its number of frames.

    Arguments and errors as for `animate`.
    """
    mechanism = scene.mechanism
    poses = checked_poses(mechanism, q_free)
    times = checked_times(t, len(poses))
    moments = frame_times(times, fps, speed)
    frames = sample(mechanism, times, poses, moments)
    scene.frame_camera(frames)
    if trace is not None:
        every = math.ceil(TRACED_SAMPLES / len(moments))
        between = finer(moments, every)
        draw_trace(scene, trace, sample(mechanism, times, poses, between), every)
    draw_forces(scene, forces, moments)
    scene.place(frames[0])
    draw_ghosts(scene, {"start": frames[0], "goal": frames[-1]})
    scene.animate(frames, fps, loop)
    scene.tell("clock", {"start": float(times[0]), "end": float(times[-1]), "speed": speed, "fps": fps})
    return len(frames)
