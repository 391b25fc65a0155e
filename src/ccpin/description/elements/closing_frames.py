"""onshape-to-robot's closing frames: two frames closing_<name>_1 and _2 that are to coincide, on two links.

The tool writes them as massless links (URDF), frames (SDFormat) or sites (MJCF), from a mate whose kind only its MJCF
tells: a weld for a fastened mate, two connects for a revolute one, one connect for a ball. Elsewhere the points are
joined (a spherical closure), which in a planar loop is a hinge.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from ccpin.arrays import Array
from ccpin.description.model import LoopClosure

_NAME = re.compile(r"(?P<stem>(?:.*::)?closing_.+)_(?P<side>[12])(?P<frame>_frame)?$")


def closing_pairs(frames: Mapping[str, tuple[str, Array]], notes: list[str]) -> tuple[LoopClosure, ...]:
    """Closures of every pair among named frames, each a link and a 4×4 frame in it; what was assumed is noted.

    A closing frame without its twin is noted and closes nothing.
    """
    sides: dict[str, dict[str, tuple[str, Array]]] = {}
    for name, placed in frames.items():
        found = _NAME.match(name)
        if found is not None:
            sides.setdefault(found["stem"], {})[found["side"]] = placed
    closures = []
    for stem, ends in sides.items():
        if len(ends) < 2:
            notes.append(f"the closing frame {stem}_{min(ends)} has no twin: it closes nothing")
            continue
        (link_a, a), (link_b, b) = ends["1"], ends["2"]
        closures.append(LoopClosure(stem, "spherical", link_a, link_b, a, b))
        notes.append(
            f"the frames {stem}_1 and {stem}_2 (onshape-to-robot) close a loop; the file does not say by what joint: "
            "their origins are joined (spherical)"
        )
    return tuple(closures)
