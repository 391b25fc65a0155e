"""Where a point of a link is and how it moves with q̇′: pose, twist Jacobian and its rate, in world axes.

Twists are (linear, angular): the velocity of the point and the link's angular velocity, both in world axes
(Pinocchio's LOCAL_WORLD_ALIGNED), in m/s and rad/s.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ccpin.arrays import Array, cross, frozen, numbers, skew
from ccpin.description.model import frame
from ccpin.errors import InvalidInputError
from ccpin.kinematics.scratch import Scratch, six_rows
from ccpin.kinematics.tree import Tree


class PointMotion(NamedTuple):
    """A link's point at one state of the free system.

    Attributes:
        pose: The link's axes at the point, 4×4, in the world.
        jacobian: J with twist = J q̇′, of shape (6, n′).
        jacobian_rate: J̇ along q̇′, of shape (6, n′).
    """

    pose: Array
    jacobian: Array
    jacobian_rate: Array


class LinkPoint:
    """A point fixed on a link of the free system; any number of threads may share one.

    Args:
        tree: The free system.
        link: The link's name.
        point: The point in the link's frame, metres, of shape (3,).

    Attributes:
        offset: The point.

    Raises:
        InvalidInputError: No such link, a link that never moves, or a point that is not three finite numbers.
    """

    def __init__(self, tree: Tree, link: str, point: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        if not isinstance(link, str) or link not in tree.attachments:
            raise InvalidInputError(f"there is no link {link!r:.80}; the links are {', '.join(tree.attachments)}")
        offset = numbers(point, "point")
        if offset.shape != (3,) or not np.isfinite(offset).all():
            raise InvalidInputError(f"the point on link '{link}' must be three finite numbers (metres)")
        attachment = tree.attachments[link]
        if attachment.joint == 0:
            raise InvalidInputError(f"link '{link}' is fixed to the world; the end effector must be on a moving link")
        self.offset = frozen(offset)
        self._scratch = tree.scratch
        self._joint = attachment.joint
        self._frame = attachment.placement @ frame(offset)
        self._path = tree.support(attachment.joint)

    def pose(self, q_free: Array) -> Array:
        """The link's axes at the point, 4×4, in the world."""
        return np.asarray(joint_poses(self._scratch, q_free)[self._joint] @ self._frame)

    def jacobian(self, q_free: Array) -> Array:
        """J with twist = J q̇′, of shape (6, n′)."""
        with self._scratch.lent() as data:
            columns = six_rows(pin.computeJointJacobians(self._scratch.model, data, q_free)) * self._path
            return _shifted(columns, self._placed(data)[:3, 3])

    def motion(self, q_free: Array, v_free: Array) -> PointMotion:
        """Pose, J and J̇ along q̇′."""
        with self._scratch.lent() as data:
            pin.computeJointJacobiansTimeVariation(self._scratch.model, data, q_free, v_free)
            columns, rates, pose = six_rows(data.J) * self._path, six_rows(data.dJ) * self._path, self._placed(data)
        jacobian, rate = _shifted(columns, pose[:3, 3]), _shifted(rates, pose[:3, 3])
        rate[:3] -= skew(jacobian[:3] @ v_free) @ columns[3:]
        return PointMotion(pose, jacobian, rate)

    def _placed(self, data: pin.Data) -> Array:
        return np.asarray(data.oMi[self._joint].homogeneous @ self._frame)


def rotation_error(turned: Array, wanted: Array) -> Array:
    """The rotation vector, in world axes and radians, that leads from one rotation matrix to another."""
    return np.asarray(pin.log3(wanted @ turned.T))


def joint_poses(scratch: Scratch, q_free: Array) -> Array:
    """Where the moving joint frames are in the world, of shape (joints, 4, 4); entry 0 is the world itself."""
    with scratch.lent() as data:
        pin.forwardKinematics(scratch.model, data, q_free)
        return _joint_frames(data)


class BodyMotion(NamedTuple):
    """How the bodies move, in world axes; entry 0 is the world, at rest.

    Attributes:
        poses: World poses of the moving joint frames, of shape (joints, 4, 4).
        centres: Centres of mass of what each joint carries up to the next joints, m, of shape (joints, 3).
        accelerations: The centres' accelerations, m/s², of shape (joints, 3).
        omega, alpha: Angular velocities and accelerations, rad/s and rad/s², of shape (joints, 3).
    """

    poses: Array
    centres: Array
    accelerations: Array
    omega: Array
    alpha: Array


def body_motion(scratch: Scratch, q_free: Array, v_free: Array, a_free: Array) -> BodyMotion:
    """The bodies' motion at (q′, q̇′, q̈′)."""
    model = scratch.model
    with scratch.lent() as data:
        pin.forwardKinematics(model, data, q_free, v_free, a_free)
        found = BodyMotion(_joint_frames(data), *(np.zeros((model.njoints, 3)) for _ in range(4)))
        for j in range(1, model.njoints):
            turn, lever = data.oMi[j].rotation, np.array(model.inertias[j].lever)
            v, a = data.v[j], data.a[j]
            swing = cross(a.angular, lever) + cross(v.angular, v.linear + cross(v.angular, lever))
            found.centres[j] = data.oMi[j].act(lever)
            found.accelerations[j] = turn @ (a.linear + swing)
            found.omega[j], found.alpha[j] = turn @ v.angular, turn @ a.angular
    return found


def _joint_frames(data: pin.Data) -> Array:
    return np.array([placement.homogeneous for placement in data.oMi])


def moved(model: pin.Model, q_free: Array, step: Array) -> Array:
    """The configuration q′ ⊕ step, of shape (nq,), for a tangent step of shape (n′,)."""
    return q_free + step if model.nq == model.nv else np.asarray(pin.integrate(model, q_free, step))


def _shifted(columns: Array, point: Array) -> Array:
    """Spatial velocities at the world's origin, as columns of a 6×n′ matrix, seen at a point."""
    shifted = np.array(columns)
    shifted[:3] -= skew(point) @ columns[3:]
    return shifted
