"""What a report may cost and which motion it shows; and how numbers of a mechanism are written in it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.mechanism.mechanism import Mechanism


class ReportSettings(NamedTuple):
    """What a report is made with; all of it is printed on the page.

    Attributes:
        start, goal: Of the experiment, of shape (model.nq,) in rad and m; default the reference, and a goal beside it.
        duration: Of the experiment, s; default 1, and 0.4 where the mechanism is only released.
        frequency: ω of the law's gains, rad/s.
        depth: How often an edge of the atlas's region may be halved (n ≤ 2).
        modes_budget: Seconds spent on looking for assembly modes.
        grid: Points along each side of a slice.
    """

    start: ArrayLike | None = None
    goal: ArrayLike | None = None
    duration: float | None = None
    frequency: float = 10.0
    depth: int = 8
    modes_budget: float = 8.0
    grid: int = 25


def sliding(mechanism: Mechanism, name: str) -> bool:
    """Whether a coordinate is a length."""
    joint, component = mechanism.tree.split(name)
    return mechanism.tree.joint(joint).kind.sliding if not component else component.startswith("t")


def value(mechanism: Mechanism, name: str, number: float) -> str:
    """A coordinate's value with its unit: degrees or metres."""
    digits, unit, scale = (4, " m", 1.0) if sliding(mechanism, name) else (2, "°", float(np.degrees(1.0)))
    return f"{round(scale * number, digits) + 0.0:.{digits}f}{unit}".replace("-", "−")


def scalar(mechanism: Mechanism) -> bool:
    """Whether every independent coordinate is stored as one plain number."""
    joints = [mechanism.tree.split(name) for name in mechanism.independent]
    return all(component or mechanism.tree.joint(joint).kind.nq == 1 for joint, component in joints)
