"""Hypothesis strategies for random mechanisms that close by construction.

A tree is grown joint by joint at a random displacement, its links' poses followed with NumPy alone; each closure's
frames are then placed where those poses ask for, after a random displacement of the kind the closure leaves free.
The pose is the description's reference, so every drawn mechanism closes. Structure (kinds, lengths, loops) is drawn
by Hypothesis and shrinks; the numbers come from a drawn seed.
"""

from typing import NamedTuple

import numpy as np
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ccpin import LoopClosure, MechanismDescription
from ccpin.description import CLOSURE_KINDS, Inertia, Joint, Link

DOF = {"revolute": 1, "continuous": 1, "prismatic": 1, "spherical": 3, "planar": 3, "floating": 6}
ROWS = {
    "spherical": 3,
    "revolute": 5,
    "fixed": 6,
    "prismatic": 5,
    "cylindrical": 4,
    "universal": 4,
    "planar": 3,
    "perpendicular": 1,
    "in_plane": 1,
    "distance": 1,
}
JOINING = tuple(kind for kind in CLOSURE_KINDS if kind not in ("perpendicular", "in_plane"))
"""The kinds that hold bodies together; the two others, of one row, may ask for what no joint of a chain changes."""
PLANAR_JOINTS = ("revolute", "continuous", "prismatic", "planar")


def rigid(rotation, translation):
    """A 4×4 homogeneous transform."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, translation
    return pose


def turn(axis, angle):
    """The 4×4 rotation by an angle about a unit axis."""
    return rigid(Rotation.from_rotvec(angle * np.asarray(axis)).as_matrix(), np.zeros(3))


def tilt(axis):
    """The 4×4 smallest rotation that takes z to a unit axis."""
    normal = np.cross([0.0, 0.0, 1.0], axis)
    length = np.linalg.norm(normal)
    return turn(normal / length if length > 0 else [1.0, 0.0, 0.0], np.arctan2(length, axis[2]))


def moved(kind, axis, value):
    """The displacement of a joint, as a 4×4 transform from its fixed to its moving frame."""
    if kind in ("revolute", "continuous"):
        return turn(axis, value[0])
    if kind == "prismatic":
        return rigid(np.eye(3), value[0] * np.asarray(axis))
    if kind == "planar":
        flat = rigid(np.eye(3), [value[0], value[1], 0.0]) @ turn([0.0, 0.0, 1.0], value[2])
        return tilt(axis) @ flat @ tilt(axis).T
    if kind == "spherical":
        return rigid(Rotation.from_quat(value).as_matrix(), np.zeros(3))
    if kind == "floating":
        return rigid(Rotation.from_quat(value[3:]).as_matrix(), value[:3])
    return np.eye(4)


class Drawn(NamedTuple):
    """A random description and the world pose of each link at its reference."""

    description: MechanismDescription
    poses: dict

    def __repr__(self):
        joints = ", ".join(f"{j.name}: {j.parent} -{j.kind}-> {j.child}" for j in self.description.joints)
        loops = ", ".join(f"{c.link_a} -{c.kind}- {c.link_b}" for c in self.description.closures)
        return f"Drawn({joints}; {loops})"


class Growth:
    """A tree grown at one configuration; `normal` (world) makes every motion parallel to a plane."""

    def __init__(self, rng, planar=False):
        self.rng = rng
        self.normal = self.unit() if planar else None
        self.links = [Link("base", self.inertia())]
        self.joints, self.closures, self.reference = [], [], {}
        self.poses = {"base": np.eye(4)}

    def unit(self):
        vector = self.rng.normal(size=3)
        return vector / np.linalg.norm(vector)

    def rotation(self):
        return Rotation.random(random_state=int(self.rng.integers(2**31))).as_matrix()

    def placement(self):
        return rigid(self.rotation(), self.rng.uniform(-0.6, 0.6, 3))

    def inertia(self):
        x, y, z = self.rng.uniform(0.02, 0.2, 3)
        turned = self.rotation()
        rotational = turned @ np.diag([y + z, z + x, x + y]) @ turned.T
        return Inertia(float(self.rng.uniform(0.3, 3.0)), self.rng.uniform(-0.2, 0.2, 3), rotational)

    def axis(self, kind, frame):
        """A unit axis in a joint's frame, in keeping with the plane if there is one."""
        if self.normal is None:
            return self.unit()
        direction = self.normal * self.rng.choice([-1.0, 1.0])
        if kind == "prismatic":
            direction = self.in_plane()
        local = frame[:3, :3].T @ direction
        return local / np.linalg.norm(local)

    def in_plane(self):
        direction = np.cross(self.normal, self.unit())
        return direction / np.linalg.norm(direction)

    def value(self, kind):
        angle, shift = self.rng.uniform(-2.0, 2.0), self.rng.uniform(-0.4, 0.4, 3)
        quaternion = Rotation.random(random_state=int(self.rng.integers(2**31))).as_quat()
        return {
            "revolute": (angle,),
            "continuous": (angle,),
            "prismatic": (shift[0],),
            "spherical": tuple(quaternion),
            "planar": (shift[0], shift[1], angle),
            "floating": (*shift, *quaternion),
            "fixed": (),
        }[kind]

    def add(self, parent, kind):
        """Grow a joint and its link; returns the link's name."""
        k = len(self.joints)
        name, child, placement = f"j{k}", f"l{k}", self.placement()
        axis, value = self.axis(kind, self.poses[parent] @ placement), self.value(kind)
        armature = float(self.rng.choice([0.0, 0.03])) if kind in ("revolute", "prismatic") else 0.0
        self.joints.append(Joint(name, kind, parent, child, placement, axis, armature=armature))
        self.links.append(Link(child, self.inertia()))
        self.poses[child] = self.poses[parent] @ placement @ moved(kind, axis, value)
        if value:
            self.reference[name] = value
        return child

    def grow(self, parent, kinds):
        """A chain of joints; returns its last link."""
        for kind in kinds:
            parent = self.add(parent, kind)
        return parent

    def close(self, kind, link_a, link_b):
        """Join two links by a closure of a kind that holds at the poses they have."""
        placement_a = self.placement()
        frame_a = self.poses[link_a] @ placement_a
        if self.normal is not None:
            frame_a = rigid(self.aligned_frame(kind), frame_a[:3, 3])
            placement_a = np.linalg.inv(self.poses[link_a]) @ frame_a
        free = self.freedom(kind)
        placement_b = np.linalg.inv(self.poses[link_b]) @ frame_a @ free
        length = float(np.linalg.norm(free[:3, 3])) if kind == "distance" else None
        name = f"loop{len(self.closures)}"
        self.closures.append(LoopClosure(name, kind, link_a, link_b, placement_a, placement_b, length))

    def aligned_frame(self, kind):
        """Axes of a planar loop's closure: z normal to the plane, in it, or (once in five) neither."""
        choice = self.rng.integers(5)
        if choice == 0:
            return self.rotation()
        z = self.in_plane() if kind in ("prismatic", "universal") or choice == 1 else self.normal
        x = np.cross(self.unit(), z)
        x = x / np.linalg.norm(x)
        return np.column_stack([x, np.cross(z, x), z])

    def freedom(self, kind):
        """A random relative placement of B in A that the closure kind allows."""
        x, y, z = np.eye(3)
        a, b = self.rng.uniform(-2.0, 2.0, 2)
        shift = self.rng.uniform(-0.5, 0.5, 3)
        if self.normal is not None and kind in ("spherical", "distance"):
            kind = {"spherical": "revolute"}.get(kind, kind)
        return {
            "spherical": lambda: rigid(self.rotation(), np.zeros(3)),
            "revolute": lambda: turn(z, a),
            "fixed": lambda: np.eye(4),
            "prismatic": lambda: rigid(np.eye(3), [0.0, 0.0, shift[2]]),
            "cylindrical": lambda: rigid(np.eye(3), [0.0, 0.0, shift[2]]) @ turn(z, a),
            "universal": lambda: turn(x, a) @ turn(y, b),
            "planar": lambda: rigid(np.eye(3), [shift[0], shift[1], 0.0]) @ turn(z, a),
            "perpendicular": lambda: rigid((turn(x, a) @ turn(y, b))[:3, :3], shift),
            "in_plane": lambda: rigid(self.rotation(), [0.0, shift[1], shift[2]]),
            "distance": lambda: rigid(self.rotation(), shift + 0.3 * np.sign(shift)),
        }[kind]()

    def drawn(self):
        """The mechanism grown so far."""
        description = MechanismDescription(
            "random",
            "base",
            tuple(self.links),
            tuple(self.joints),
            closures=tuple(self.closures),
            reference=dict(self.reference),
            gravity=tuple(self.rng.normal(scale=6.0, size=3)),
        )
        return Drawn(description, self.poses)


def _joint_kinds(draw, planar, least):
    """Kinds of the joints on a new loop, `least` degrees of freedom or just above."""
    pool = PLANAR_JOINTS[:3] if planar else tuple(DOF)[:4]
    kinds = list(draw(st.lists(st.sampled_from(PLANAR_JOINTS if planar else tuple(DOF)), max_size=2)))
    while sum(DOF[kind] for kind in kinds) < least:
        kinds.append(draw(st.sampled_from(pool)))
    kinds += ["fixed"] * draw(st.integers(0, 1))
    return draw(st.permutations(kinds))


@st.composite
def mechanisms(draw, planar=None, kinds=JOINING, max_loops=2):
    """A random mechanism with one or two loops, each with at least one freedom more than its closure takes.

    Args:
        draw: Hypothesis' draw.
        planar: Planar, spatial, or either (``None``).
        kinds: Closure kinds to choose from.
        max_loops: Loops at most.
    """
    flat = draw(st.booleans()) if planar is None else planar
    growth = Growth(np.random.default_rng(draw(st.integers(0, 2**32 - 1))), flat)
    if draw(st.booleans()):
        growth.grow("base", [draw(st.sampled_from(("revolute", "prismatic") if flat else ("revolute", "floating")))])
    for _ in range(draw(st.integers(1, max_loops))):
        kind = draw(st.sampled_from(kinds))
        chain = _joint_kinds(draw, flat, 1 + (min(3, ROWS[kind]) if flat else ROWS[kind]))
        links = list(growth.poses)
        roots = [draw(st.sampled_from(links)) for _ in range(2)] if draw(st.booleans()) else [links[-1]] * 2
        cut = draw(st.integers(0, len(chain)))
        ends = [growth.grow(root, part) for root, part in zip(roots, (chain[:cut], chain[cut:]), strict=True)]
        growth.close(kind, *ends)
    return growth.drawn()
