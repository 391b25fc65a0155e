"""Scenes kept by a recorder: one configuration standing, or a trajectory played with all that is drawn of it."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence

from numpy.typing import ArrayLike

from ccpin.mechanism.mechanism import Mechanism
from ccpin.visualization.annotations import Tracked, draw_forces, draw_ghosts, draw_trace, name_joints
from ccpin.visualization.playback import (
    HasForce,
    checked_pose,
    checked_poses,
    checked_times,
    finer,
    frame_times,
    sample,
)
from ccpin.visualization.scene import Scene
from ccpin.visualization.scene_page import CommandRecorder

TRACED_SAMPLES = 400
"""A path is drawn through at least so many points, however few the frames."""


def named_scene(mechanism: Mechanism, recorder: CommandRecorder) -> Scene:
    """A scene, drawn into a recorder, with the names of its joints."""
    with warnings.catch_warnings():  # PyZMQ's, of what MeshCat imports
        warnings.simplefilter("ignore", DeprecationWarning)
        import meshcat

    scene = Scene(mechanism, meshcat.Visualizer(window=recorder))
    name_joints(scene)
    return scene


def standing_scene(mechanism: Mechanism, recorder: CommandRecorder, q_free: ArrayLike | None = None) -> Scene:
    """Such a scene that shows one configuration (default: the reference); errors as for `checked_pose`."""
    pose = checked_pose(mechanism, mechanism.q_reference if q_free is None else q_free)
    scene = named_scene(mechanism, recorder)
    scene.frame_camera(pose[None])
    scene.place(pose)
    return scene


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
