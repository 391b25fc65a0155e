"""Motions as the page is told them and as files, and the whole page as one file."""

from __future__ import annotations

import base64
import json
import math
import re
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from ccpin.arrays import choice
from ccpin.studio.driving_page import studio_page
from ccpin.studio.recorded_run import Recording
from ccpin.studio.subject import Subject, Tap
from ccpin.visualization.playing import play
from ccpin.visualization.scene import Scene

PLOTTED = 1500
"""Samples of a motion that a page is given, at most."""
FPS, FRAMES = 30.0, 900.0
"""Of a motion as it is played, at most."""
FORMATS = ("npz", "csv")


def told_motion(motion: Recording, subject: Subject) -> dict[str, Any]:
    """The samples that plots show, and MeshCat's commands that play them; ``sample`` counts the motion's own."""
    samples = motion.trajectory
    chosen = np.unique(np.linspace(0, len(samples.t) - 1, PLOTTED).astype(int))
    q = np.array([subject.dials.values(q) for q in samples.q[chosen]])
    goal = None if motion.goal is None else subject.dials.values(motion.goal).tolist()
    return {
        "kind": "motion",
        "title": motion.title,
        "status": samples.status,
        "words": samples.message,
        "sample": chosen.tolist(),
        "t": samples.t[chosen].tolist(),
        "q": q.T.tolist(),
        "v": samples.v[chosen].T.tolist(),
        "u": samples.u[chosen].T.tolist(),
        "lyapunov": [None if math.isnan(value) else value for value in motion.lyapunov[chosen].tolist()],
        "energy": motion.energy,
        "goal": goal,
        "closure": float(samples.closure_error.max()),
        "commands": encoded(_played(motion, subject)),
    }


def _played(motion: Recording, subject: Subject) -> list[bytes]:
    """MeshCat's commands that play a motion in a scene of the subject, with the path of its first handle."""
    tap, samples = Tap(), motion.trajectory
    scene = subject.scene(tap)
    tap.take()
    scene.stop()
    if len(samples.t) > 1:
        fps = min(FPS, FRAMES / max(float(samples.t[-1] - samples.t[0]), 1e-3))
        play(scene, samples.t, samples.q_free, fps=fps, loop=False, trace=next(iter(subject.handles), None))
    return tap.take()


def encoded(commands: list[bytes]) -> list[str]:
    """MeshCat's commands as text."""
    return [base64.b64encode(command).decode("ascii") for command in commands]


def saved(motion: Recording, form: object) -> dict[str, Any]:
    """A motion's file, as `Trajectory.save` writes it.

    Raises:
        InvalidInputError: Another format than npz and csv.
    """
    ending = choice(form, "format", FORMATS)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"motion.{ending}"
        motion.trajectory.save(path)
        return _file(path.name, path.read_bytes())


def exported(
    subject: Subject, scene: Scene, commands: tuple[bytes, ...], shown: list[dict[str, Any]]
) -> dict[str, Any]:
    """The page as one file: its scene, and all that it has been told, which it tells itself when it is opened."""
    text = studio_page(subject.title, commands, subject.told(scene), replay=json.loads(json.dumps(shown)))
    name = re.sub(r"[^\w.-]+", "_", subject.title) or "studio"
    return _file(f"{name}.html", text.encode())


def _file(name: str, content: bytes) -> dict[str, Any]:
    return {"kind": "file", "name": name, "content": base64.b64encode(content).decode("ascii")}
