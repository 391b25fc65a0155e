"""Line drawings of the RPDR: a closed chain beside an open one, cut open, and with the paper's letters (Figs. 1–5)."""

from __future__ import annotations

from typing import Any

import numpy as np

from ccpin.arrays import Array
from ccpin.paper import printed
from ccpin.plotting.style import COLOURS, Figure, drawing

_BARE = {"axes.grid": False, "axes.spines.left": False, "axes.spines.bottom": False}
_LINK = {"linewidth": 4.0, "solid_capstyle": "round", "zorder": 2}
_OFFSET = 0.032  # m, of a dimension line from its link


def mechanism_drawings(q: Array, opened: Array) -> tuple[tuple[str, str, Figure], ...]:
    """(name, caption, figure): two chains, the loop closed and cut open, and the annotated robot.

    Args:
        q: A closed configuration in the paper's order.
        opened: An open one, for the cut.
    """
    return (
        ("fig1", "An open chain and a closed one with as many motors (squares).", _chains(q)),
        ("fig2", "The loop closed, and cut open at the end effector: E and F come apart by φ(q′).", _cut(q, opened)),
        ("fig5", "Joint angles q_i, lengths a_i and centres of mass l_ci of links 1 to 4.", _annotated(q)),
    )


def _bare(axes: Any, title: str) -> None:
    axes.set(aspect="equal", xticks=[], yticks=[])
    axes.set_title(title, fontsize=11)
    axes.margins(0.12)


def _draw_arm(axes: Any, points: Array, colours: tuple[str, str], motors: tuple[int, ...] = (0,)) -> None:
    for k in range(2):
        axes.plot(*points[k : k + 2].T, color=colours[k], **_LINK)
    for k, point in enumerate(points[:2]):
        _joint(axes, point, k in motors)


def _joint(axes: Any, point: Array, motor: bool) -> None:
    shape, size = ("s", 12) if motor else ("o", 9)
    axes.plot(*point, shape, color="0.25" if motor else "white", markeredgecolor="0.2", markersize=size, zorder=4)


def _chains(q: Array) -> Figure:
    with drawing("An open and a closed kinematic chain", (9.6, 4.4), **_BARE) as figure:
        serial, parallel = figure.subplots(1, 2)
        first, second = printed.arms(q)
        _draw_arm(serial, first, (COLOURS[0], COLOURS[1]), motors=(0, 1))
        serial.plot(*first[2], "o", color=COLOURS[3], markersize=9, zorder=4)
        serial.set_xlim(-0.2, 0.3)
        _bare(serial, "serial: a motor on each joint")
        for arm in (first, second):
            _draw_arm(parallel, arm, (COLOURS[0], COLOURS[1]))
        parallel.plot(*first[2], "o", color=COLOURS[3], markersize=9, zorder=4)
        _bare(parallel, "parallel: both motors on the base")
    return figure


def _cut(q: Array, opened: Array) -> Figure:
    with drawing("The loop closed, and cut open: the free system Σ′", (9.6, 4.8), **_BARE) as figure:
        for axes, pose, title in zip(
            figure.subplots(1, 2), (q, opened), ("φ(q′) = 0", "φ(q′) = E − F ≠ 0"), strict=True
        ):
            first, second = printed.arms(pose)
            for arm in (first, second):
                _draw_arm(axes, arm, (COLOURS[0], COLOURS[1]))
            _tips(axes, first[2], second[2])
            _bare(axes, title)
    return figure


def _tips(axes: Any, e: Array, f: Array) -> None:
    closed = np.linalg.norm(e - f) < 1e-6
    axes.plot(*e, "D", color=COLOURS[3], markersize=9, zorder=5)
    if closed:
        axes.annotate("E = F", e, (0, -20), textcoords="offset points", ha="center", fontsize=12)
        return
    axes.plot(*f, "D", color=COLOURS[3], markersize=9, zorder=5)
    axes.annotate(
        "", e, f, arrowprops={"arrowstyle": "->", "color": COLOURS[3], "shrinkA": 6, "shrinkB": 6, "linewidth": 1.6}
    )
    for point, name in ((e, "E"), (f, "F")):
        side = -14 if point[0] < (e[0] + f[0]) / 2 else 14
        axes.annotate(name, point, (side, -16), textcoords="offset points", ha="center", fontsize=12)


def _annotated(q: Array) -> Figure:
    with drawing("The Rice Planar Delta Robot", (8.4, 7.6), **_BARE) as figure:
        axes = figure.add_subplot()
        arms = printed.arms(q)
        axes.plot([-0.07, printed.BASE + 0.07], [0.0, 0.0], color="0.6", linewidth=1.0, zorder=1)
        for arm, (near, far), outward in zip(arms, ((0, 2), (1, 3)), (-1.0, 1.0), strict=True):
            _draw_arm(axes, arm, (COLOURS[0], COLOURS[1]))
            for k, link in enumerate((near, far)):
                _length(axes, arm[k], arm[k + 1], rf"$a_{link + 1}$", outward)
                _mass(axes, arm[k], arm[k + 1], link, outward)
            _angle(axes, arm[0], 0.0, q[near], rf"$q_{near + 1}$", 0.065)
            _angle(axes, arm[1], q[near], q[near] + q[far], rf"$q_{far + 1}$", 0.06)
        axes.plot(*arms[0][2], "D", color=COLOURS[3], markersize=9, zorder=5)
        axes.annotate("E = F", arms[0][2], (0, -36), textcoords="offset points", ha="center", fontsize=12)
        _length(axes, arms[0][0], arms[1][0], "$c$", -1.0, 0.07)
        axes.annotate(
            "", (0.47, -0.12), (0.47, -0.02), arrowprops={"arrowstyle": "-|>", "color": "0.3", "linewidth": 1.6}
        )
        axes.text(0.485, -0.075, "$g$", fontsize=13)
        axes.annotate("", (-0.10, 0.05), (-0.18, 0.05), arrowprops={"arrowstyle": "-|>", "color": "0.3", "shrinkA": 0})
        axes.annotate("", (-0.18, 0.13), (-0.18, 0.05), arrowprops={"arrowstyle": "-|>", "color": "0.3", "shrinkA": 0})
        axes.text(-0.095, 0.044, "$x$", fontsize=12)
        axes.text(-0.186, 0.138, "$y$", fontsize=12)
        axes.plot([-0.18, 0.5], [0.155, -0.12], alpha=0.0)  # room for what stands beside the robot
        _bare(axes, "")
    return figure


def _length(axes: Any, begin: Array, end: Array, name: str, side: float, away: float = _OFFSET) -> None:
    """A dimension line beside a link, on its outer side."""
    along = (end - begin) / np.linalg.norm(end - begin)
    normal = side * np.array([-along[1], along[0]]) * (1.0 if along[1] < 0 else -1.0)
    normal = normal if side * normal[0] > 0 or abs(along[1]) < 0.2 else -normal
    shift = away * (normal if abs(along[1]) > 0.2 else np.array([0.0, 1.0]))
    arrow = {"arrowstyle": "<->", "color": "0.45", "linewidth": 1.0, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", end + shift, begin + shift, arrowprops=arrow)
    for point in (begin, end):
        axes.plot(*np.array([point, point + shift]).T, color="0.75", linewidth=0.8, zorder=1)
    middle = (begin + end) / 2 + 1.75 * shift
    axes.text(*middle, name, ha="center", va="center", fontsize=13)


def _mass(axes: Any, begin: Array, end: Array, link: int, side: float) -> None:
    """The centre of mass at l_c along the link."""
    along = (end - begin) / np.linalg.norm(end - begin)
    place = begin + printed.LC[link] * along
    axes.plot(*place, "o", color="0.1", markersize=6, zorder=5)
    inner = np.array([-side * 0.02, 0.0])
    axes.text(*(place + inner), rf"$l_{{c{link + 1}}}$", fontsize=12, ha="left" if side < 0 else "right", va="center")


def _angle(axes: Any, centre: Array, begin: float, end: float, name: str, radius: float) -> None:
    """An arc with its arrow, from a dashed line that prolongs what it is measured from."""
    turn = np.linspace(begin, end, 40)
    arc = centre + radius * np.column_stack([np.cos(turn), np.sin(turn)])
    axes.plot(*arc.T, color=COLOURS[2], linewidth=1.4, zorder=3)
    axes.annotate("", arc[-1], arc[-4], arrowprops={"arrowstyle": "-|>", "color": COLOURS[2], "linewidth": 1.2})
    ray = centre + np.array([[0.0], [1.5 * radius]]) * [np.cos(begin), np.sin(begin)]
    axes.plot(*ray.T, "--", color=COLOURS[2], linewidth=1.0, zorder=1)
    middle = 0.5 * (begin + end)
    label = centre + 1.45 * radius * np.array([np.cos(middle), np.sin(middle)])
    axes.text(*label, name, color=COLOURS[2], fontsize=13, ha="center", va="center")
