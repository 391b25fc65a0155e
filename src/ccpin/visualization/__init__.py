"""Pictures of mechanisms: animations as web pages, snapshots, and a live viewer, all drawn by MeshCat.

Everything takes a `Mechanism` and plain arrays. MeshCat is imported when the first picture is drawn, not before.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import heading
from ccpin.errors import InvalidInputError
from ccpin.files import writable_target, write_atomically
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of
from ccpin.visualization.live import LiveRecorder, Server, Viewer
from ccpin.visualization.page import Clock, Recorder, render_page
from ccpin.visualization.playback import checked_pose, checked_poses, checked_times, frame_times, sample
from ccpin.visualization.scene import Scene

PAGES = (".html", ".htm")

__all__ = ["PAGES", "Scene", "Viewer", "animate", "snapshot_html", "view"]


def animate(
    mechanism: Mechanism | HasMechanism,
    t: ArrayLike,
    q_free: ArrayLike,
    path: str | Path,
    *,
    title: str | None = None,
    fps: float = 30,
    trace: str | None = None,
    speed: float = 1.0,
) -> Path:
    """Write a trajectory as a self-contained web page that plays over and over; return its path.

    Frame k shows the time t₀ + k speed/fps, the last frame the end; between samples the configuration moves along
    the geodesic. The page needs no network, and is written whole or not at all.

    Args:
        mechanism: From `ccpin.load`, or a model of it.
        t: Strictly increasing times in seconds, of shape (T,), T ≥ 2.
        q_free: Configurations q′ of the free system, of shape (T, nq).
        path: The web page to write, .html or .htm; an existing one is replaced.
        title: Heading; default the mechanism's name.
        fps: Frames per second of playing time.
        trace: A link or loop whose path is drawn.
        speed: Seconds of the trajectory that pass in a second of playing time.

    Raises:
        InvalidInputError: An array has the wrong shape or is not finite, `t` does not increase, `fps` or `speed` is
            not positive, `trace` names nothing, or `path` cannot be written or has another ending.
    """
    mechanism, target = mechanism_of(mechanism), _page(path)
    recorder = Recorder()
    _, clock = _play(mechanism, recorder, t, q_free, fps=fps, speed=speed, trace=trace, loop=True)
    return _written(target, render_page(heading(title, mechanism.name), recorder.commands, clock))


def snapshot_html(
    mechanism: Mechanism | HasMechanism, q_free: ArrayLike | None, path: str | Path, *, title: str | None = None
) -> Path:
    """Write one configuration q′ of shape (nq,) as a self-contained web page; return its path.

    ``None`` stands for the reference configuration. Errors as for `animate`.
    """
    mechanism, target = mechanism_of(mechanism), _page(path)
    recorder = Recorder()
    _pose(mechanism, recorder, q_free)
    return _written(target, render_page(heading(title, mechanism.name), recorder.commands, Clock()))


def view(
    mechanism: Mechanism | HasMechanism,
    q_free: ArrayLike | None = None,
    t: ArrayLike | None = None,
    *,
    title: str | None = None,
    fps: float = 30,
    trace: str | None = None,
    speed: float = 1.0,
    open_browser: bool = True,
    loop: bool = True,
) -> Viewer:
    """Open a live viewer on the loopback interface; it serves from a thread until it is closed.

    Without arrays it shows the reference configuration; with `q_free` of shape (nq,) that one; with `q_free` of shape
    (T, nq) and `t` of shape (T,) it plays the trajectory, over and over if `loop`. `Viewer.draw` moves it from then on.

    Raises:
        InvalidInputError: As for `animate`, or a trajectory comes without times, or times without one.
        CcpinError: No loopback port can be opened.
    """
    mechanism, words = mechanism_of(mechanism), heading(title, mechanism_of(mechanism).name)
    recorder = LiveRecorder()
    clock = Clock()
    if t is not None:
        if q_free is None:
            raise InvalidInputError("t is given without q_free; a trajectory needs both")
        scene, clock = _play(mechanism, recorder, t, q_free, fps=fps, speed=speed, trace=trace, loop=loop)
    else:
        if q_free is not None and np.ndim(q_free) == 2:
            raise InvalidInputError("q_free is a trajectory, of shape (T, nq); give its times t, of shape (T,), too")
        scene = _pose(mechanism, recorder, q_free)
    return Viewer(scene, Server(render_page(words, (), clock, live=True), recorder), open_browser)


def _page(path: str | Path) -> Path:
    """Where a page is to be written.

    Raises:
        InvalidInputError: The file's ending is not that of a page, or it cannot be written.
    """
    target = writable_target(path)
    if target.suffix.lower() not in PAGES:
        raise InvalidInputError(f"'{target}': what is drawn is written as a web page, {' or '.join(PAGES)}")
    return target


def _written(target: Path, document: str) -> Path:
    write_atomically(target, "w", lambda file: file.write(document))
    return target


def _scene(mechanism: Mechanism, recorder: Recorder) -> Scene:
    import meshcat

    return Scene(mechanism, meshcat.Visualizer(window=recorder))


def _pose(mechanism: Mechanism, recorder: Recorder, q_free: ArrayLike | None) -> Scene:
    """A scene that shows one configuration (default: the reference)."""
    pose = checked_pose(mechanism, mechanism.q_reference if q_free is None else q_free)
    scene = _scene(mechanism, recorder)
    scene.frame_camera(pose[None])
    scene.place(pose)
    return scene


def _play(
    mechanism: Mechanism,
    recorder: Recorder,
    t: ArrayLike,
    q_free: ArrayLike,
    *,
    fps: float,
    speed: float,
    trace: str | None,
    loop: bool,
) -> tuple[Scene, Clock]:
    """A scene that plays a trajectory, and what its time display needs."""
    poses = checked_poses(mechanism, q_free)
    times = checked_times(t, len(poses))
    moments = frame_times(times, fps, speed)
    frames = sample(mechanism, times, poses, moments)
    scene = _scene(mechanism, recorder)
    scene.frame_camera(frames)
    if trace is not None:
        scene.trace(trace, frames)
    scene.place(frames[0])
    scene.animate(frames, fps, loop)
    return scene, Clock(float(times[0]), speed)
