"""What all sessions of a studio share: the mechanism, its model, its dials and handles, the cache. Never written to."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ccpin.arrays import Array, heading
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.dynamics.state import State
from ccpin.errors import UnsupportedMechanismError
from ccpin.mechanism.mechanism import Mechanism
from ccpin.mechanism.poses.same_pose import Likeness
from ccpin.studio.cache import Cache
from ccpin.studio.dials import Dials
from ccpin.studio.handles import Handle, handles_of
from ccpin.studio.recorded_run import LAWS
from ccpin.visualization.camera import plane_normal
from ccpin.visualization.playing import standing_scene
from ccpin.visualization.scene import Scene
from ccpin.visualization.scene_page import CommandRecorder

SLACK = 1e-9
"""How far (rad, m) a joint may be beyond its limit without a word."""


class Tap(CommandRecorder):
    """A recorder of which the commands since the last look can be taken."""

    def __init__(self) -> None:
        super().__init__()
        self._new: list[bytes] = []

    def take(self) -> list[bytes]:
        """The commands since the last call."""
        taken, self._new = self._new, []
        return taken

    def _forward(self, packed: bytes) -> None:
        self._new.append(packed)


class Subject:
    """One mechanism in a studio.

    Args:
        mechanism: From `ccpin.load`.
        title: Heading; default the name of the mechanism's file.
        cache: Where atlases are kept.

    Raises:
        UnsupportedMechanismError: The mechanism has mobility 0.

    Attributes:
        mechanism, model, dials, cache: As given, and made of it.
        handles: What can be dragged, by name, the likeliest first.
        title: The heading.
        likeness: Tells whether two configurations are one pose.
        reference: The State at the mechanism's reference.
    """

    def __init__(self, mechanism: Mechanism, title: str | None = None, cache: Cache | None = None) -> None:
        if not mechanism.n:
            raise UnsupportedMechanismError(f"{mechanism.name} has mobility 0: there is nothing to drive")
        self.mechanism = mechanism
        self.model = ReducedModel(mechanism)
        self.dials = Dials(self.model)
        self.cache = Cache() if cache is None else cache
        self.title = heading(title, mechanism.title)
        self.reference = self.model.at(self.model.alpha(mechanism.q_reference), mechanism.q_reference)
        scene = self.scene(CommandRecorder())
        self.handles: dict[str, Handle] = {handle.name: handle for handle in handles_of(self.model, scene.size)}
        self.likeness = Likeness(mechanism.tree, mechanism.constraints())
        self._limits = self._limited()

    def scene(self, recorder: CommandRecorder) -> Scene:
        """A scene of its own at the reference, drawn into a recorder."""
        return standing_scene(self.mechanism, recorder)

    def told(self, scene: Scene) -> dict[str, Any]:
        """What a page is told once."""
        normal = plane_normal(self.mechanism)
        return {
            "title": self.title,
            "dials": [dial._asdict() for dial in self.dials.each],
            "bodies": [scene.path(body.name) for body in scene.bodies if body.joint > 0],
            "root": scene.path(),
            "size": scene.size,
            "handles": self._grips(scene),
            "normal": None if normal is None else normal.tolist(),
            "laws": LAWS,
            "motors": list(self.mechanism.actuated),
            "notes": [*self.mechanism.notes, *scene.notes],
        }

    def _grips(self, scene: Scene) -> list[dict[str, Any]]:
        """The handles as the page finds them: the path of a body that carries each, and the point in its frame."""
        q_free, carriers = self.mechanism.q_reference, {body.joint: body for body in reversed(scene.bodies)}
        frames = dict(zip((body.name for body in scene.bodies), scene.frames(q_free), strict=True))
        grips = []
        for handle in self.handles.values():
            body = carriers[self.mechanism.tree.attachments[handle.link].joint]
            point = np.linalg.inv(frames[body.name]) @ np.append(handle.at(q_free), 1.0)
            grips.append({"name": handle.name, "body": scene.path(body.name), "point": point[:3].tolist()})
        return grips

    def bodies(self, scene: Scene, q_free: Array) -> list[list[float]]:
        """World frames of the moving bodies, column by column, in the order told."""
        frames = scene.frames(q_free)
        moving = [frame for body, frame in zip(scene.bodies, frames, strict=True) if body.joint > 0]
        return [np.round(frame.T.ravel(), 9).tolist() for frame in moving]

    def facts(self, state: State) -> dict[str, Any]:
        """The live numbers: q, q′ by joint, ‖φ‖, 1/κ(ψ), D, g, and which joints are beyond their limits."""
        return {
            "q": self.dials.values(state.q).tolist(),
            "phi": float(np.linalg.norm(self.mechanism.constraints().value(state.q_free).phi)),
            "rcond": state.rcond,
            "D": state.D.tolist(),
            "g": state.g.tolist(),
            "q_free": [[joint.name, *state.q_free[joint.q].tolist()] for joint in self.mechanism.tree.joints],
            "beyond": [name for name, i, low, high in self._limits if not low <= state.q_free[i] <= high],
        }

    def _limited(self) -> list[tuple[str, int, float, float]]:
        lower, upper = self.mechanism.position_limits
        plain = [(joint.name, joint.q.start) for joint in self.mechanism.tree.joints if joint.kind.nq == 1]
        limited = [(name, i, float(lower[i]) - SLACK, float(upper[i]) + SLACK) for name, i in plain]
        return [joint for joint in limited if np.isfinite(joint[2:]).any()]


Told = Callable[[dict[str, Any]], None]
"""Takes a message for the page; may be called from any thread."""
