"""The joint kinds: what each moves, how q′ holds it, and which joint of Pinocchio it is. A new kind is one entry.

A kind stands for a sequence of elementary steps, slides first, root side first, and its nv velocity components are
these steps in this order. Its configuration q holds the slides as plain numbers (m) and after them the turns: as plain
numbers too (rad), as a point (cosine, sine) of the unit circle, or as a unit quaternion (x, y, z, w).
Velocities are rates of the plain numbers; where turns lie on a circle or a quaternion they are the linear and angular
velocity of the moving frame in its own axes.
"""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from ccpin.arrays import Array
from ccpin.description.rotations import log_jacobian, quaternion_difference, quaternion_matrix, quaternion_rate

FIXED = "fixed"


@dataclass(frozen=True)
class JointKind:
    """A kind of movable joint.

    Attributes:
        name: Its name in a description.
        steps: The elementary steps: ``t`` slides and ``r`` turns, each along the fixed axis ``x``, ``y`` or ``z`` of
            the joint's frame, or along the joint's own axis where no axis is named.
        models: Names of Pinocchio's joint models less ``JointModel``: one, or those for an own axis along x, y, z and
            any other; empty: composed of the steps. Pinocchio's rates hold where the velocity's axes are constant in
            the moving frame, so composed steps must commute (a universal joint is two revolute ones).
        unit: How many numbers at the end of q form the unit circle (2) or quaternion (4); 0: all are plain.
        turned: Whether the joint's frame is turned so that its z axis is the joint's own axis.
    """

    name: str
    steps: tuple[str, ...]
    models: tuple[str, ...] = ()
    unit: Literal[0, 2, 4] = 0
    turned: bool = False

    @property
    def nv(self) -> int:
        """Number of velocity components."""
        return len(self.steps)

    @property
    def nq(self) -> int:
        """Number of configuration numbers: one more than nv with a circle or a quaternion."""
        return self.nv + (self.unit > 0)

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the velocity components, of a 1-dof joint none."""
        return self.steps if self.nv > 1 else ()

    @cached_property
    def slides(self) -> tuple[bool, ...]:
        """Whether each velocity component is a slide (m/s) rather than a turn (rad/s)."""
        return tuple(step[0] == "t" for step in self.steps)

    @property
    def springs(self) -> bool:
        """Whether a spring has one displacement to pull back: a plain number, or the rotation vector of a ball.

        An angle on the circle is known up to whole turns only.
        """
        return self.nq == 1 or (self.unit == 4 and self.nv == 3)

    @property
    def sliding(self) -> bool:
        """Whether it only slides: a displacement in metres."""
        return all(self.slides)

    @property
    def angle(self) -> bool:
        """Whether its configuration is one plain angle in radians."""
        return self.nq == 1 and not self.sliding

    @property
    def axial(self) -> bool:
        """Whether the axis stated in a description means anything to it."""
        return self.turned or any(len(step) == 1 for step in self.steps)

    @cached_property
    def entries(self) -> list[int]:
        """Where the velocity components stand in a (linear, angular) velocity; of steps along fixed axes only."""
        return [3 * ("tr".index(step[0])) + "xyz".index(step[1]) for step in self.steps if len(step) > 1]

    def own_axis(self, axis: Array) -> Array:
        """The joint's axis, of shape (3,), in its frame as Pinocchio has it: z unless a step names no other."""
        return axis if any(len(step) == 1 for step in self.steps) else np.array([0.0, 0.0, 1.0])

    def directions(self, axis: Array) -> Array:
        """Unit axes of the steps in the joint's frame, of shape (nv, 3), `axis` being its own."""
        return np.array([axis if len(step) == 1 else np.eye(3)["xyz".index(step[1])] for step in self.steps])

    # Configurations: the chart θ (one number for each step), and the manifold.

    def stated(self, values: Array) -> Array:
        """A configuration as a description states it: an angle may stand for a point on the circle."""
        return self.configuration(values, np.eye(3)) if self.unit == 2 and values.shape == (self.nv,) else values

    def told(self, q: Array) -> tuple[float, ...]:
        """A configuration as a description states it, a point on the circle as its angle."""
        values = self.theta(q, np.eye(3)) if self.unit == 2 else q
        return tuple(float(value) for value in values)

    def reference(self, q: Array) -> Array:
        """The rotation (3, 3) that the turns of a chart centred at q are measured from: of a circle none."""
        return self.rotation(q) if self.unit == 4 else np.eye(3)

    def theta(self, q: Array, reference: Array) -> Array:
        """θ of a configuration, of shape (nv,): turns of a circle or quaternion in (−π, π], plain numbers as they are.

        A rotation is R = R_ref · R_x(θ₁) R_y(θ₂) R_z(θ₃).
        """
        if self.unit == 4:
            from scipy.spatial.transform import Rotation  # here: importing it takes longer than loading a mechanism

            turns = Rotation.from_matrix(reference.T @ self.rotation(q)).as_euler("XYZ")
        else:
            turns = np.array([np.arctan2(q[-1], q[-2])]) if self.unit else q[:0]
        return np.concatenate([q[: self.nq - self.unit], turns])

    def configuration(self, theta: Array, reference: Array) -> Array:
        """q of θ, over any leading axes: shape (…, nv) → (…, nq)."""
        if self.unit == 4:
            from scipy.spatial.transform import Rotation

            turns = Rotation.from_matrix(reference) * Rotation.from_euler("XYZ", theta[..., -3:].reshape(-1, 3))
            return np.concatenate([theta[..., :-3], turns.as_quat().reshape(*theta.shape[:-1], 4)], axis=-1)
        if self.unit == 2:
            return np.concatenate([theta[..., :-1], np.cos(theta[..., -1:]), np.sin(theta[..., -1:])], axis=-1)
        return theta

    def rotation(self, q: Array) -> Array:
        """The rotation (3, 3) of the circle or quaternion in q."""
        if self.unit == 4:
            return quaternion_matrix(q[-4:])
        cosine, sine = q[-2:] if self.unit else (1.0, 0.0)
        return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])

    def rotation_vector(self, q: Array, q_from: Array | None = None) -> Array:
        """log(R_fromᵀ R), of shape (3,), of the circle or quaternion in q; by default from no rotation.

        Circles are done here: Pinocchio's logarithm of a plane rotation returns exactly 0 for angles below 1.5e-8
        where rounding has made cos² + sin² exceed one.
        """
        if self.unit == 4:
            return quaternion_difference(np.array([0.0, 0.0, 0.0, 1.0]) if q_from is None else q_from[-4:], q[-4:])
        (c0, s0), (c1, s1) = (1.0, 0.0) if q_from is None else q_from[-2:], q[-2:]
        return np.array([0.0, 0.0, np.arctan2(c0 * s1 - s0 * c1, c0 * c1 + s0 * s1)])

    def twist(self, v: Array) -> Array:
        """Velocities (nv, …) as (linear, angular) velocities of the moving frame in its own axes, of shape (6, …)."""
        whole = np.zeros((6, *v.shape[1:]))
        whole[self.entries] = v
        return whole

    def difference(self, q_from: Array, q_to: Array) -> Array:
        """The velocity, of shape (nv,), that leads from one configuration to another in unit time."""
        if not self.unit:
            return np.asarray(q_to - q_from)
        turn, slides = self.rotation_vector(q_to, q_from), self.nq - self.unit
        if not slides:
            return turn[-self.nv :]
        gap = np.zeros(3)
        gap[self.entries[:slides]] = q_to[:slides] - q_from[:slides]
        return np.concatenate([log_jacobian(-turn) @ self.rotation(q_from).T @ gap, turn])[self.entries]

    def rate(self, q: Array, v: Array) -> Array:
        """d/dt q, of shape (nq,), for a velocity v of shape (nv,)."""
        if not self.unit:
            return v
        turns = quaternion_rate(q[-4:], v[-3:]) if self.unit == 4 else v[-1] * np.array([-q[-1], q[-2]])
        if self.nq == self.unit:
            return np.asarray(turns)
        linear = self.rotation(q) @ self.twist(v)[:3]
        return np.concatenate([linear[self.entries[: self.nq - self.unit]], turns])


JOINT_KINDS: dict[str, JointKind] = {
    kind.name: kind
    for kind in (
        JointKind("revolute", ("r",), ("RX", "RY", "RZ", "RevoluteUnaligned")),
        JointKind("continuous", ("rz",), ("RUBZ",), unit=2, turned=True),
        JointKind("prismatic", ("t",), ("PX", "PY", "PZ", "PrismaticUnaligned")),
        JointKind("spherical", ("rx", "ry", "rz"), ("Spherical",), unit=4),
        JointKind("planar", ("tx", "ty", "rz"), ("Planar",), unit=2, turned=True),
        JointKind("floating", ("tx", "ty", "tz", "rx", "ry", "rz"), ("FreeFlyer",), unit=4),
    )
}
"""The movable kinds by name; a description knows one more, "fixed", which moves nothing."""


def split_component(name: str, joints: Container[str]) -> tuple[str, str]:
    """The joint and the component a name stands for: ``joint:axis``, or the joint alone with an empty component.

    Joints' own names may hold colons: the longest known joint is taken first. Of an unknown name the part before the
    last colon is taken for the joint.
    """
    joint, _, component = name.rpartition(":")
    if name in joints or not joint:
        return name, ""
    return joint, component
