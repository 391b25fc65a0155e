"""Task space: the pose of a link as the independent coordinates of a mechanism's closures.

A *carriage* is put beside the mechanism: slides x along axes of the world, then turns, whose values are the task
coordinates, and one closure more that holds the end effector to it. With p(θ) the end effector's pose the rows are

    Φ(x, θ) = (φ(θ), p(θ) − C(x)) = 0,

C(x) the carriage's pose, and all n′ joints of the mechanism depend on the n coordinates x. As rows and chains they are
like any others (`chains`), so Theorem N of `boxes` says of them: over a box of x the mechanism has one closed
configuration θ(x) in a tube with its end effector at C(x), Φ_θ is nonsingular there and θ(x) is smooth. What Φ_θ
nonsingular means for the motors is said, and proved, in `demands`.

| n | motion | task coordinates |
|---|---|---|
| 2, 3 | in a plane | position in the plane; and the turn about its normal |
| 3 | in space | position |
| 6 | in space | position and the turns about the end effector's own x, then y, then z axes |

Positions are the world's, in metres. Turns are counted from how the end effector is turned in the configuration that
the task space is made at, in radians: R = R₀ R_x(a) R_y(b) R_z(c).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.description.closure_kinds import PlaneNormal, X, Y, Z, plane_axes, rows_of
from ccpin.description.model import LoopClosure, frame
from ccpin.domain.closures.scalar_coordinates import Elementary
from ccpin.dynamics.end_effector import EndEffector
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import UnsupportedMechanismError
from ccpin.kinematics.loops import ResolvedClosure, plane_normal
from ccpin.kinematics.tree import rest_poses
from ccpin.mechanism.mechanism import Mechanism

_LETTERS = "xyz"


class JointSpace(NamedTuple):
    """Joints of a mechanism as its task space, in place of an end effector: a foot's pitch and roll, say.

    Attributes:
        model: The reduced model, or a mechanism; its independent coordinates are what its motors are taken to drive.
        names: As many joints with one displacement (or components of others) as it has independent coordinates.
    """

    model: ReducedModel | Mechanism
    names: tuple[str, ...]


class TaskSpace(NamedTuple):
    """The carriage of an end effector.

    Attributes:
        names: Its coordinates, in order.
        slides: Whether a coordinate is a position rather than a turn, of shape (n,).
        steps: Its joints, placed; their positions count from 0.
        loop: The closure that holds the end effector to it; its `path_b` is one joint numbered behind the tree's.
        x: Where it is at the configuration it was made at, of shape (n,).
    """

    names: tuple[str, ...]
    slides: tuple[bool, ...]
    steps: tuple[Elementary, ...]
    loop: ResolvedClosure
    x: Array

    def steps_from(self, first: int) -> list[Elementary]:
        """Its joints, the first at a place in θ."""
        return [step._replace(position=first + step.position) for step in self.steps]


def task_space(end_effector: EndEffector, q_free: Array) -> TaskSpace:
    """The task space of an end effector, its turns counted from a configuration q′ of shape (nq,).

    Raises:
        UnsupportedMechanismError: The mechanism has not as many coordinates as positions (and turns) of a link.
    """
    mechanism = end_effector.model.mechanism
    tree, pose = mechanism.tree, end_effector.point.pose(q_free)
    normal = plane_normal(tree, rest_poses(tree), [joint.number for joint in tree.joints])
    positions = 3 if normal is None else 2
    turns = mechanism.n - positions
    if turns not in (0, 3 if normal is None else 1):
        raise UnsupportedMechanismError(
            f"{mechanism.name} has {mechanism.n} independent coordinates: a task space needs 3 or 6 of a motion in "
            "space (positions, or positions and turns), 2 or 3 of a motion in a plane; certify is for other coordinates"
        )
    axes = plane_axes(normal)[:positions]
    around = np.eye(3) if normal is None else normal[None]
    own = (X, Y, Z) if normal is None else (np.asarray(pose[:3, :3].T @ normal),)
    names = [f"{_named(axis, 'uv'[k % 2])}" for k, axis in enumerate(axes)]
    names += [f"r{_named(axis, 'n')}" for axis in around[:turns]]
    offset = pose[:3, 3] - axes.T @ (axes @ pose[:3, 3])
    return TaskSpace(
        names=tuple(names),
        slides=positions * (True,) + turns * (False,),
        steps=_steps(axes, own[:turns], pose[:3, :3], offset),
        loop=_held(end_effector, "fixed" if turns else "spherical", normal, pose),
        x=np.concatenate([axes @ pose[:3, 3], np.zeros(turns)]),
    )


def _named(axis: Array, otherwise: str) -> str:
    """The world axis along a unit vector, or a letter of its own."""
    main = int(np.argmax(np.abs(axis)))
    return _LETTERS[main] if abs(axis[main]) == 1.0 else otherwise


def _steps(axes: Array, own: tuple[Array, ...], rotation: Array, offset: Array) -> tuple[Elementary, ...]:
    """Slides along axes of the world, then turns about the end effector's own."""
    before, steps = frame(offset), list[Elementary]()
    for axis in axes:
        steps.append(Elementary(before, axis, True, len(steps)))
        before = np.eye(4)
    before = before.copy()
    before[:3, :3] = rotation
    for axis in own:
        steps.append(Elementary(before, axis, False, len(steps)))
        before = np.eye(4)
    return tuple(steps)


def _held(end_effector: EndEffector, kind: str, normal: Array | None, pose: Array) -> ResolvedClosure:
    """The closure between the end effector (A) and the carriage (B), seen from the world (C)."""
    tree = end_effector.model.mechanism.tree
    attachment = tree.attachments[end_effector.link]
    own = None if normal is None else pose[:3, :3].T @ normal
    closure = LoopClosure("task space", kind, end_effector.link, "the carriage")
    support = tuple(int(joint) for joint in tree.model.supports[attachment.joint] if joint)
    return ResolvedClosure(
        closure=closure,
        joint_a=attachment.joint,
        joint_b=len(tree.joints) + 1,
        ancestor=0,
        frame_a=attachment.placement @ frame(end_effector.point.offset),
        frame_b=np.eye(4),
        path_a=support,
        path_b=(len(tree.joints) + 1,),
        mask_a=tree.support(attachment.joint),
        mask_b=np.zeros(tree.model.nv),
        rows=rows_of(closure, PlaneNormal(own, own, normal)),
        normal=normal,
    )
