"""Pictures of mechanisms: animations as web pages and films, snapshots, and a live viewer, all drawn by MeshCat.

Everything takes a `Mechanism` and plain arrays. MeshCat is imported when the first picture is drawn, not before.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import heading, whole
from ccpin.errors import InvalidInputError
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of
from ccpin.visualization.annotations import Tracked
from ccpin.visualization.embedded import Embedded
from ccpin.visualization.film import FILMS, PAGES, STILLS, Shot, write
from ccpin.visualization.live import LiveRecorder, Viewer, serve_scene
from ccpin.visualization.playback import HasForce
from ccpin.visualization.playing import named_scene, play, standing_scene
from ccpin.visualization.scene import Scene
from ccpin.visualization.scene_page import CommandRecorder, render_page

__all__ = ["animate", "embed", "snapshot", "view"]
__dir__ = __all__.copy


def animate(
    mechanism: Mechanism | HasMechanism,
    t: ArrayLike,
    q_free: ArrayLike,
    path: str | Path,
    *,
    title: str | None = None,
    fps: float = 30,
    trace: Tracked | None = None,
    forces: Sequence[HasForce] = (),
    speed: float = 1.0,
    size: tuple[int, int] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Write a trajectory as a self-contained web page or as a film; return its path.

    The ending decides: .html is a page that plays over and over and needs no network, .mp4 and .gif are films of the
    same picture, drawn by a headless Chromium (the extra ``video``). Frame k shows the time t₀ + k speed/fps, the last
    frame the end; between samples the configuration moves along the geodesic. The file is written whole or not at all.

    Args:
        mechanism: From `ccpin.load`, or a model of it.
        t: Strictly increasing times in seconds, of shape (T,), T ≥ 2.
        q_free: Configurations q′ of the free system, of shape (T, nq).
        path: The file to write, .html, .htm, .mp4 or .gif; an existing one is replaced.
        title: Heading; default the name of the mechanism's file.
        fps: Frames per second of playing time; a GIF has at most 50.
        trace: Whose path is drawn: a link's centre of mass (of a massless link its origin) or a loop by its name, or
            any point as (link, point in its frame).
        forces: Arrows to draw, such as `ccpin.simulation.closure_forces` and `joint_forces` return.
        speed: Seconds of the trajectory that pass in a second of playing time.
        size: Width and height of a film in pixels, both even; default 1280 × 720, of a GIF 800 × 450.
        progress: Called after each frame of a film with the frames drawn and their number.

    Raises:
        InvalidInputError: An array has the wrong shape or is not finite, `t` does not increase, `fps` or `speed` is
            not positive, `trace` names nothing, or `path` cannot be written or has another ending.
        CcpinError: A film's browser or encoder is missing.
    """
    mechanism = mechanism_of(mechanism)
    shot = Shot(path, (*PAGES, *FILMS), size, fps)
    recorder = CommandRecorder()
    frames = _play(mechanism, recorder, t, q_free, fps=fps, speed=speed, trace=trace, forces=forces, loop=True)[1]
    return write(shot, render_page(heading(title, mechanism.title), recorder.commands), frames, progress)


def embed(
    mechanism: Mechanism | HasMechanism,
    q_free: ArrayLike | None = None,
    t: ArrayLike | None = None,
    *,
    title: str | None = None,
    fps: float = 30,
    trace: Tracked | None = None,
    forces: Sequence[HasForce] = (),
    speed: float = 1.0,
    height: int = 480,
) -> Embedded:
    """The page of a pose or of a trajectory as the value of a notebook's cell; it needs no network and no server.

    Arguments and errors as for `view`; `height` is that of its frame in pixels.
    """
    mechanism, recorder = mechanism_of(mechanism), CommandRecorder()
    _show(mechanism, recorder, q_free, t, fps=fps, speed=speed, trace=trace, forces=forces, loop=True)
    return Embedded(render_page(heading(title, mechanism.title), recorder.commands), whole(height, "height"))


def snapshot(
    mechanism: Mechanism | HasMechanism,
    q_free: ArrayLike | None,
    path: str | Path,
    *,
    title: str | None = None,
    size: tuple[int, int] | None = None,
) -> Path:
    """Write one configuration q′ of shape (nq,) as a self-contained web page or as a picture; return its path.

    The ending decides: .html, .htm, or .png, which a headless Chromium draws (the extra ``video``) in pixels of `size`,
    1280 × 720 by default. ``None`` stands for the reference configuration. Errors as for `animate`.
    """
    mechanism = mechanism_of(mechanism)
    shot = Shot(path, (*PAGES, *STILLS), size)
    recorder = CommandRecorder()
    standing_scene(mechanism, recorder, q_free)
    return write(shot, render_page(heading(title, mechanism.title), recorder.commands), 1)


def view(
    mechanism: Mechanism | HasMechanism,
    q_free: ArrayLike | None = None,
    t: ArrayLike | None = None,
    *,
    title: str | None = None,
    fps: float = 30,
    trace: Tracked | None = None,
    forces: Sequence[HasForce] = (),
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
    mechanism = mechanism_of(mechanism)
    words = heading(title, mechanism.title)
    recorder = LiveRecorder()
    scene = _show(mechanism, recorder, q_free, t, fps=fps, speed=speed, trace=trace, forces=forces, loop=loop)
    return Viewer(scene, serve_scene(render_page(words, (), live=True), recorder), open_browser)


def _show(
    mechanism: Mechanism, recorder: CommandRecorder, q_free: ArrayLike | None, t: ArrayLike | None, **playing: Any
) -> Scene:
    """A scene that plays a trajectory where times are given, else shows one configuration."""
    if t is not None:
        if q_free is None:
            raise InvalidInputError("t is given without q_free; a trajectory needs both")
        return _play(mechanism, recorder, t, q_free, **playing)[0]
    if q_free is not None and np.ndim(q_free) == 2:
        raise InvalidInputError("q_free is a trajectory, of shape (T, nq); give its times t, of shape (T,), too")
    return standing_scene(mechanism, recorder, q_free)


def _play(
    mechanism: Mechanism,
    recorder: CommandRecorder,
    t: ArrayLike,
    q_free: ArrayLike,
    *,
    fps: float,
    speed: float,
    trace: Tracked | None,
    forces: Sequence[HasForce],
    loop: bool,
) -> tuple[Scene, int]:
    """A scene that plays a trajectory, and its number of frames."""
    scene = named_scene(mechanism, recorder)
    return scene, play(scene, t, q_free, fps=fps, speed=speed, trace=trace, forces=forces, loop=loop)
