"""The plain mechanism description every reader returns; it knows nothing of dynamics.

Frames are 4×4 homogeneous transforms, lengths in metres, angles in radians, masses in kilograms. Nothing in a
description can be written to: arrays (or lists) given are copied into read-only arrays, lists become tuples.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, FrozenMapping, Placement, Record, cross, frozen, numbers, skew
from ccpin.errors import InvalidInputError

IDENTITY: Array = frozen(np.eye(4))  # no turn and no move
X_AXIS: Array = frozen([1.0, 0.0, 0.0])  # a joint's, where none is stated


def frame(position: ArrayLike, rotation: ArrayLike = IDENTITY[:3, :3]) -> Array:
    """The 4×4 transform that turns by `rotation` (3, 3) and moves to `position` (3,)."""
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = rotation, position
    return transform


def frame_from_rpy(xyz: Sequence[float], rpy: Sequence[float]) -> Array:
    """The 4×4 transform of URDF's ``xyz`` (m) and ``rpy`` (rad, fixed axes): R = R_z(yaw) R_y(pitch) R_x(roll)."""
    (sr, sp, sy), (cr, cp, cy) = map(math.sin, rpy), map(math.cos, rpy)
    rows: list[list[float]] = [
        [cp * cy, sp * (sr * cy) - cr * sy, sp * (cr * cy) + sr * sy, xyz[0]],
        [cp * sy, sp * (sr * sy) + cr * cy, sp * (cr * sy) - sr * cy, xyz[1]],
        [-sp, cp * sr, cp * cr, xyz[2]],
        [0, 0, 0, 1],
    ]
    return np.add(rows, 0.0)  # no negative zeros


def inverse(transform: Array) -> Array:
    """The inverse of a rigid 4×4 transform."""
    turn = transform[:3, :3].T
    return frame(-turn @ transform[:3, 3], turn)


def skewness(turns: Array) -> Array:
    """How far 3×3 blocks (…, 3, 3) are from rotations: the largest entry of |RᵀR − 1|, infinite where mirrored."""
    off = np.abs(np.swapaxes(turns, -1, -2) @ turns - np.eye(3)).max(axis=(-2, -1))
    handed = np.sum(cross(turns[..., 0, :], turns[..., 1, :]) * turns[..., 2, :], axis=-1)
    return np.where(handed < 0.0, np.inf, off)


def rotation_to(axis: Array) -> Array:
    """The smallest rotation whose z column is the unit vector `axis` (a half turn about x for −z)."""
    z = np.array([0.0, 0.0, 1.0])
    cosine, v = float(axis @ z), cross(z, axis)
    if cosine < 0 and v @ v < 1e-30:
        return np.diag([1.0, -1.0, -1.0])
    gain = 1 / (1 + cosine) if cosine >= 0 else (1 - cosine) / (v @ v)
    return np.asarray(np.eye(3) + skew(v) + gain * skew(v) @ skew(v))


class _WithPlacement(Record):
    """A record whose fields annotated ``Placement`` may be given in any of a frame's spellings."""

    def __post_init__(self) -> None:
        for each in fields(self):  # type: ignore[arg-type]
            if each.type == "Placement":
                value = getattr(self, each.name)
                if not isinstance(value, np.ndarray) or value.shape != (4, 4):
                    object.__setattr__(self, each.name, placement(value, f"{type(self).__name__}.{each.name}"))
        super().__post_init__()


def placement(value: object, name: str = "placement") -> Array:
    """A frame as its 4×4 matrix.

    Args:
        value: A 4×4 matrix, a `pinocchio.SE3` (whatever has a ``homogeneous`` matrix), or (xyz, rpy) as in URDF:
            metres, and angles about the fixed x, y and z axes in this order.
        name: Whose it is.

    Raises:
        InvalidInputError: It is none of them. What the matrix must be is checked with the description.
    """
    spelt = getattr(value, "homogeneous", value)
    try:
        array = numbers(spelt, name)
    except InvalidInputError:
        array = np.empty(0)
    if array.shape == (2, 3):
        return frame_from_rpy(*array.tolist())
    if array.shape != (4, 4):
        raise InvalidInputError(f"{name} must be a 4×4 matrix, a pinocchio.SE3 or (xyz, rpy), not {value!r:.80}")
    return array


@dataclass(frozen=True, eq=False)
class Inertia(Record):
    """Mass (kg), centre of mass (3,) and rotational inertia (3, 3) about it, both in link axes."""

    mass: float
    com: Array
    rotational: Array


@dataclass(frozen=True, eq=False)
class Shape(Record):
    """A drawable shape.

    ``kind`` and ``size``: box (x, y, z edge lengths), cylinder (radius, length; along z), capsule (radius,
    length of the cylindrical part; along z), sphere (radius,), ellipsoid (three semi-axes), mesh (scale x, y, z; `mesh`
    names the file, absolute where it was found and as written where it was not).
    """

    kind: Literal["box", "cylinder", "capsule", "sphere", "ellipsoid", "mesh"]
    size: tuple[float, ...]
    mesh: str | None = None


@dataclass(frozen=True, eq=False)
class Visual(_WithPlacement):
    """A shape placed in its link's frame, with its colour (red, green, blue, alpha in [0, 1])."""

    shape: Shape
    placement: Placement = field(default_factory=lambda: IDENTITY)
    rgba: tuple[float, float, float, float] = (0.62, 0.66, 0.70, 1.0)


@dataclass(frozen=True, eq=False)
class Link(Record):
    """A rigid body; `inertia` is ``None`` for a massless frame."""

    name: str
    inertia: Inertia | None = None
    visuals: tuple[Visual, ...] = ()


@dataclass(frozen=True, eq=False)
class Joint(_WithPlacement):
    """A tree joint.

    `kind` is one of `ccpin.description.joint_kinds.JOINT_KINDS`, or ``fixed``.
    `placement` is the joint frame in the parent link's frame at zero displacement; the child link's frame
    coincides with the moving joint frame. `axis` is a unit vector in that frame (the normal for planar).
    `effort` (N m, N) and `velocity` (rad/s, m/s) are limits of the joint itself, whatever its motor.
    `armature` is the reflected rotor inertia (gear ratio squared times rotor inertia), kg m² or kg.
    `damping` b and `friction` (a Coulomb level c) oppose each of its velocities: b θ̇ in N m or N, and when sliding
    `friction`, or with a Stribeck effect c + (s − c) exp(−(θ̇/v_s)²): `breakaway` is s, which holds the joint at rest at
    most (0: c), and `stribeck_speed` v_s, rad/s or m/s. `stiffness` k pulls a joint with one displacement to
    `spring_reference`: k (θ − θ₀), and a spherical joint to its zero: k log R.
    """

    name: str
    kind: str
    parent: str
    child: str
    placement: Placement = field(default_factory=lambda: IDENTITY)
    axis: Array = field(default_factory=lambda: X_AXIS)
    lower: float = -np.inf
    upper: float = np.inf
    effort: float = np.inf
    velocity: float = np.inf
    armature: float = 0.0
    damping: float = 0.0
    friction: float = 0.0
    stiffness: float = 0.0
    spring_reference: float = 0.0
    breakaway: float = 0.0
    stribeck_speed: float = 0.0

    @property
    def breakaway_level(self) -> float:
        """The most dry friction that the joint has, which is that at rest: `breakaway`, or `friction` without one."""
        return self.breakaway or self.friction


@dataclass(frozen=True)
class Motor(Record):
    """What drives a joint: its own input is an entry of u.

    One unit of u is an effort of `gear` N m (or N) on the joint, and u keeps within `lower` and `upper`. What a file
    closes around the motor (a servo, a muscle) is not simulated: u is then the force that it would exert before the
    gear, `kind` and `gains` tell the loop, and a law plays its part. Of MJCF's actuators ``gains["gain"]`` is g and
    ``gains["bias"]`` b of force = g·input + b₀ + b₁·gear·θ + b₂·gear·θ̇ (a position servo: k_p and (0, −k_p, −k_v));
    ``gains["inputs"]`` are its bounds; ``gains["dynprm"]`` are there where the actuator has a state.
    `ccpin.control.Servos` plays those without.

    Attributes:
        name: The motor's own.
        joint: Whom it drives. A joint of several velocities has an entry of u for each, all of this gear.
        gear: Effort on the joint per unit of u, of either sign, not zero.
        lower, upper: Bounds of u.
        kind: ``motor`` where u is all its input; else the file's word (position, velocity, general, …).
        gains: The numbers of its loop, by name.
    """

    name: str
    joint: str
    gear: float = 1.0
    lower: float = -np.inf
    upper: float = np.inf
    kind: str = "motor"
    gains: Mapping[str, tuple[float, ...]] = FrozenMapping()


@dataclass(frozen=True, eq=False)
class LoopClosure(_WithPlacement):
    """A closed loop: frame A on `link_a` and frame B on `link_b` are joined by a joint of `kind`.

    The kind names the relative motion left free (number of constraint rows): spherical (3), revolute about
    the common z axes (5), fixed (6), prismatic along z (5), cylindrical about and along z (4), universal with
    the x axis of A perpendicular to the y axis of B (4), planar with common normal z (3), perpendicular: the
    x axis of A to the y axis of B (1), in_plane: the origin of B in the yz plane of A (1), distance: the origins stay
    `length` metres apart (1). A frame may be given as a 4×4 matrix, a `pinocchio.SE3` or (xyz, rpy).
    `ccpin.description.closure_kinds` says exactly what each asks for.
    """

    name: str
    kind: str
    link_a: str
    link_b: str
    placement_a: Placement = field(default_factory=lambda: IDENTITY)
    placement_b: Placement = field(default_factory=lambda: IDENTITY)
    length: float | None = None

    @property
    def ends(self) -> tuple[tuple[str, Array], tuple[str, Array]]:
        """Link and frame of A and of B."""
        return (self.link_a, self.placement_a), (self.link_b, self.placement_b)


@dataclass(frozen=True)
class CouplingTerm(Record):
    """The polynomial Σₖ coefficients[k] (θ − reference)ᵏ in the displacement θ of one 1-dof joint."""

    joint: str
    coefficients: tuple[float, ...]
    reference: float = 0.0


@dataclass(frozen=True)
class Coupling(Record):
    """A holonomic relation Σ terms = 0 between joint displacements (gears, mimic joints, belts)."""

    name: str
    terms: tuple[CouplingTerm, ...]


@dataclass(frozen=True)
class SolverWords(Record):
    """What an MJCF file tells MuJoCo's solver beside the mechanism, as written, for files that are written as MJCF.

    Nothing here counts in ccpin, where closures hold exactly.

    Attributes:
        options: Attributes of ``<option>`` but gravity: time step, integrator, solver, tolerances, …
        flags: Those of its ``<flag>`` that say nothing about the mechanism itself.
        equalities: How soft a closure or coupling is (solref, solimp), by its name.
        joints: How soft a joint's limits and dry friction are, by its name.
    """

    options: Mapping[str, str] = FrozenMapping()
    flags: Mapping[str, str] = FrozenMapping()
    equalities: Mapping[str, Mapping[str, str]] = FrozenMapping()
    joints: Mapping[str, Mapping[str, str]] = FrozenMapping()


@dataclass(frozen=True, eq=False)
class MechanismDescription(Record):
    """All that a file says about a mechanism.

    Attributes:
        independent: The joints the file marks as independent, or ``None`` where it says nothing.
        independent_is_default: True where the marks come from a format's default rather than from the author.
        dependent_hint: Joints to give up first if the independent set is too large (successors of couplings).
        actuated: The joints the file gives motors, or ``None`` where it says nothing.
        motors: What the file says of those motors, one a joint at most; a joint without an entry has a plain one.
        reference: Joint displacements of a pose near which the loops close, by joint name: one number for a
            1-dof joint, a unit quaternion (x, y, z, w) for a spherical joint, (x, y, angle) for a planar one,
            position then quaternion for a floating one. Joints left out are at zero.
        poses: Further poses the file names, each like `reference`.
        solver: What the file tells MuJoCo's solver.
        notes: What a reader had to assume or leave out, in sentences.
    """

    name: str
    root: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    closures: tuple[LoopClosure, ...] = ()
    couplings: tuple[Coupling, ...] = ()
    independent: tuple[str, ...] | None = None
    independent_is_default: bool = False
    dependent_hint: tuple[str, ...] = ()
    actuated: tuple[str, ...] | None = None
    motors: tuple[Motor, ...] = ()
    reference: Mapping[str, tuple[float, ...]] = FrozenMapping()
    poses: Mapping[str, Mapping[str, tuple[float, ...]]] = FrozenMapping()
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    source: str | None = None
    notes: tuple[str, ...] = ()
    solver: SolverWords = SolverWords()

    @property
    def size(self) -> float:
        """A length of the mechanism's own size, m: the longest way from joint to joint, or 1."""
        return max((float(np.linalg.norm(joint.placement[:3, 3])) for joint in self.joints), default=0.0) or 1.0

    @property
    def named_poses(self) -> dict[str, Mapping[str, tuple[float, ...]]]:
        """The reference, called "reference", and the other poses after it."""
        return {"reference": self.reference, **{name: at for name, at in self.poses.items() if name != "reference"}}

    def __repr__(self) -> str:
        return (
            f"MechanismDescription({self.name!r}, {len(self.links)} links, {len(self.joints)} joints, "
            f"{len(self.closures)} closures, {len(self.couplings)} couplings)"
        )
