"""What is drawn of a mechanism: links as their file draws them, solid ones where it draws nothing, and rods."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.description.model import Visual, frame, rotation_to
from ccpin.mechanism.mechanism import Mechanism
from ccpin.visualization.shapes import corners, missing
from ccpin.visualization.stick_figure import Limb, rods, skeleton


class Body(NamedTuple):
    """Something drawn that moves as one: its name, the joint that carries it, its 4×4 frame there, what it shows.

    What stands between two bodies has its z axis `towards` a point (4,) in another joint's frame.
    """

    name: str
    joint: int
    placement: Array
    visuals: tuple[Visual | Limb, ...]
    towards: tuple[int, Array] | None = None

    def frame(self, poses: Array) -> Array:
        """Its 4×4 frame in the world, where the joints' are (njoints, 4, 4)."""
        own = np.asarray(poses[self.joint] @ self.placement)
        if self.towards is None:
            return own
        joint, point = self.towards
        span = (poses[joint] @ point - own[:, 3])[:3]
        return frame(own[:3, 3], rotation_to(span / np.linalg.norm(span))) if np.any(span) else own

    @property
    def corners(self) -> Array:
        """Corners (N, 3) of boxes around all it shows, in its own frame."""
        boxes = [
            corners(visual.shape) @ visual.placement[:3, :3].T + visual.placement[:3, 3] for visual in self.visuals
        ]
        return np.concatenate([*boxes, np.zeros((0, 3))])


def drawn_bodies(mechanism: Mechanism) -> tuple[tuple[Body, ...], tuple[str, ...]]:
    """The bodies, and notes on what could not be drawn as the file wants it.

    Each link with something to draw is a body. Each joint whose links draw nothing, or miss a mesh, has a solid link
    made from where its joints and loops are (in a file that draws others, only if they have mass); a joint left
    without either is a body that shows nothing. Each distance closure is a rod.
    """
    bodies, notes = [], []
    drawing: set[int] = set()
    lacking: set[int] = set()
    for link in mechanism.description.links:
        carrier = mechanism.tree.attachments[link.name]
        reasons = [missing(visual.shape) for visual in link.visuals]
        notes += [f"link '{link.name}': {reason}" for reason in reasons if reason is not None]
        drawn = tuple(visual for visual, reason in zip(link.visuals, reasons, strict=True) if reason is None)
        if drawn:
            bodies.append(Body(link.name, carrier.joint, carrier.placement, drawn))
            drawing.add(carrier.joint)
        if any(reasons):
            lacking.add(carrier.joint)
    model = mechanism.tree.model
    joints = range(model.njoints)
    solid = {j for j in joints if j not in drawing and (j == 0 or not drawing or model.inertias[j].mass > 0)}
    made = skeleton(mechanism, tuple(sorted(solid | lacking)))
    if not drawing:
        notes.append("the file has nothing to draw: solid links between its joints and loops are shown")
    for joint in joints:
        if joint in made or (joint > 0 and joint not in drawing):
            bodies.append(Body(_carried(mechanism, joint), joint, np.eye(4), made.get(joint, ())))
    for rod in rods(mechanism):
        bodies.append(Body(f"{rod.name} (rod)", rod.joint, rod.placement, rod.pieces, rod.towards))
    return tuple(bodies), tuple(dict.fromkeys(notes))


def _carried(mechanism: Mechanism, joint: int) -> str:
    """A name for what is made for a joint: no link's, so that it never stands in a drawn link's place."""
    stated = mechanism.description.root if joint == 0 else mechanism.tree.joints[joint - 1].stated.child
    return f"{stated} (solid)"
