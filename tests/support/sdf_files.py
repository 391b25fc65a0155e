"""Small SDFormat models, and the same mechanisms as URDF+."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from tests.support.reading import read_sdf


def inertial(mass=1.0, com=(0.0, 0.0, 0.0), moments=(0.01, 0.02, 0.03), rpy=(0.0, 0.0, 0.0)):
    """An <inertial> with a diagonal matrix in turned axes."""
    pose = " ".join(map(repr, map(float, (*com, *rpy))))
    ixx, iyy, izz = moments
    return (
        f"<inertial><pose>{pose}</pose><mass>{mass}</mass>"
        f"<inertia><ixx>{ixx}</ixx><iyy>{iyy}</iyy><izz>{izz}</izz></inertia></inertial>"
    )


def link(name, pose="", **said):
    """A <link> with an inertial; `pose` is the whole element."""
    return f'<link name="{name}">{pose}{inertial(**said)}</link>'


def joint(name, kind, parent, child, *, pose="", axis="0 1 0", extra="", more=""):
    """A <joint>; `extra` goes into its axis, `more` beside it."""
    along = f"<axis><xyz>{axis}</xyz>{extra}</axis>" if axis else ""
    return (
        f'<joint name="{name}" type="{kind}">{pose}<parent>{parent}</parent><child>{child}</child>{along}{more}</joint>'
    )


def model(*parts, name="m", version="1.9", attributes=""):
    """A file of one <model>."""
    return f'<sdf version="{version}"><model name="{name}" {attributes}>{"".join(parts)}</model></sdf>'


def read(text, **options):
    """The description of a text."""
    return read_sdf(text.encode(), None, **options)


# A four-bar as exporters write it: the rocker hangs on the ground, and a second joint leads from the coupler to it.
GROUND, CRANK, COUPLER, ROCKER = 0.3, 0.2, 0.35, 0.25
CRANK_ANGLE = 0.9  # rad: any, at which the loop closes with its links apart


def four_bar_points():
    """A, B, C, D in the plane y = 0 with the crank at its angle."""
    a, d = np.zeros(2), np.array([GROUND, 0.0])
    b = CRANK * np.array([np.cos(CRANK_ANGLE), np.sin(CRANK_ANGLE)])
    span = d - b
    reach = np.linalg.norm(span)
    along = (COUPLER**2 - ROCKER**2 + reach**2) / (2 * reach)
    across = np.sqrt(COUPLER**2 - along**2)
    c = b + along * span / reach + across * np.array([-span[1], span[0]]) / reach
    return a, b, c, d


def angle(start, end):
    """The pitch (about +y, which turns x towards −z) of a line in the plane."""
    return -float(np.arctan2(end[1] - start[1], end[0] - start[0]))


def pose(point, pitch, relative_to=""):
    """A <pose> in the plane y = 0."""
    said = f' relative_to="{relative_to}"' if relative_to else ""
    return f"<pose{said}>{float(point[0])!r} 0 {float(point[1])!r} 0 {pitch!r} 0</pose>"


BARS = {
    "crank": {"mass": 0.7, "com": (0.1, 0.01, 0.02), "moments": (0.001, 0.004, 0.004), "rpy": (0.1, 0.2, 0.3)},
    "coupler": {"mass": 0.9, "com": (0.17, 0.0, -0.03), "moments": (0.002, 0.007, 0.006)},
    "rocker": {"mass": 0.8, "com": (0.12, -0.02, 0.0), "moments": (0.001, 0.005, 0.005)},
}


def four_bar_links():
    """The links of the four-bar with their poses, each frame at the bar's first end."""
    a, b, c, d = four_bar_points()
    poses = {"crank": pose(a, angle(a, b)), "coupler": pose(b, angle(b, c)), "rocker": pose(d, angle(d, c))}
    return "".join(link(name, poses[name], **said) for name, said in BARS.items()) + link("ground")


FOUR_BAR_JOINTS = (
    joint("A", "revolute", "ground", "crank"),
    joint("B", "revolute", "crank", "coupler"),
    joint("D", "revolute", "ground", "rocker"),
    joint("C", "revolute", "coupler", "rocker", pose=f"<pose>{ROCKER} 0 0 0 0 0</pose>"),
)


def four_bar(joints=FOUR_BAR_JOINTS, **options):
    """The whole file."""
    return model(four_bar_links(), *joints, name="four_bar", **options)


def four_bar_urdf():
    """The same mechanism with the same zero pose as URDF+."""
    a, b, c, d = four_bar_points()
    pitch = {"crank": angle(a, b), "coupler": angle(b, c), "rocker": angle(d, c)}
    links = '<link name="ground"/>' + "".join(_urdf_link(name, **said) for name, said in BARS.items())

    def tree(name, parent, child, x, z, turn):
        return (
            f'<joint name="{name}" type="revolute"><origin xyz="{x!r} 0 {z!r}" rpy="0 {turn!r} 0"/>'
            f'<parent link="{parent}"/><child link="{child}"/><axis xyz="0 1 0"/>'
            '<limit effort="1" velocity="1"/></joint>'
        )

    joints = (
        tree("A", "ground", "crank", 0.0, 0.0, pitch["crank"])
        + tree("B", "crank", "coupler", CRANK, 0.0, pitch["coupler"] - pitch["crank"])
        + tree("D", "ground", "rocker", GROUND, 0.0, pitch["rocker"])
    )
    loop = (
        '<loop name="C" type="revolute">'
        f'<predecessor link="coupler"><origin xyz="{COUPLER} 0 0"/></predecessor>'
        f'<successor link="rocker"><origin xyz="{ROCKER} 0 0"/></successor><axis xyz="0 1 0"/></loop>'
    )
    return f'<robot name="four_bar">{links}{joints}{loop}</robot>'


def _urdf_link(name, mass=1.0, com=(0.0, 0.0, 0.0), moments=(0.01, 0.02, 0.03), rpy=(0.0, 0.0, 0.0)):
    turn = Rotation.from_euler("xyz", rpy).as_matrix()
    matrix = turn @ np.diag(moments) @ turn.T
    entries = " ".join(
        f'i{"xyz"[i]}{"xyz"[j]}="{matrix[i, j]!r}"'.replace("np.float64(", "").replace(")", "")
        for i in range(3)
        for j in range(i, 3)
    )
    x, y, z = com
    return (
        f'<link name="{name}"><inertial><origin xyz="{x} {y} {z}"/><mass value="{mass}"/>'
        f"<inertia {entries}/></inertial></link>"
    )
