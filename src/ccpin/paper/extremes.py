"""Fig. 6, singular configurations over the plane of (q1, q2), and Fig. 7, the extreme configurations of Ω."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ccpin.arrays import Array
from ccpin.domain.singular.sampled import SingularCurve
from ccpin.mechanism.mechanism import Mechanism
from ccpin.paper import printed
from ccpin.paper.item import place
from ccpin.plotting import plot_singularities
from ccpin.plotting.style import COLOURS, Figure, drawing

Panel = tuple[Array, float, float, Array, Array, Array]
"""Centre (rad), the paper's and our radius (degrees), q′ at the centre, at the paper's corners and at ours."""
_GRID = 721  # points an edge: one every half degree
_SHADE = "#d9dee3"


def singular_figure(
    mechanism: Mechanism, curves: Sequence[SingularCurve], region: tuple[Array, Array], centres: Array
) -> Figure:
    """Fig. 6 with what cannot be assembled shaded, the region and Table I's centres numbered."""
    figure = plot_singularities(mechanism, curves, [(*region, r"$\mathcal{D}$")], "Singular configurations of the RPDR")
    axes = figure.axes[0]
    angle = np.linspace(-180.0, 180.0, _GRID)
    first, second = np.meshgrid(angle, angle)
    slack = printed.elbow_distance(np.radians(np.stack([first, second], -1))) - printed.A[2] - printed.A[3]
    axes.contourf(first, second, slack, levels=[0.0, 1.0], colors=[_SHADE], zorder=0)
    for k, (x, y) in enumerate(np.degrees(centres)):
        axes.plot(x, y, "^", color="0.15", markersize=7, zorder=5)
        axes.annotate(str(k + 1), (x, y), (6, 4), textcoords="offset points", fontsize=10)
    for x, y in ((-125.0, 20.0), (140.0, -20.0)):
        axes.text(x, y, "cannot be\nassembled", ha="center", va="center", color="0.35", fontsize=9)
    axes.set(xlabel="$q_1$ [°]", ylabel="$q_2$ [°]")
    _legend(axes)
    return figure


def _legend(axes: Any) -> None:
    """The paper's words for the two kinds, and for what was added."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles = [
        Line2D([], [], color=COLOURS[1], label="n odd: links 3 and 4 stretched"),
        Line2D([], [], color=COLOURS[0], marker="o", linestyle="", label="n even: links 3 and 4 on one another"),
        Line2D([], [], color="0.15", marker="^", linestyle="", label="centres of Table I"),
        Patch(facecolor=_SHADE, label="no σ: the elbows are too far apart"),
    ]
    axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=2, frameon=False)


def extremes_figure(panels: Sequence[Panel]) -> Figure:
    """Fig. 7: at each centre the corners of our square and of the paper's, the latter's end effector enlarged."""
    with drawing("Extreme configurations of Ω about the centres of Table I", (10.4, 9.6)) as figure:
        for axes, panel in zip(figure.subplots(2, 2).flat, panels, strict=True):
            _panel(axes, *panel)
        handles, labels = figure.axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
    return figure


def _panel(axes: Any, centre: Array, paper: float, ours: float, pose: Array, papers: Array, corners: Array) -> None:
    axes.set_title(f"{place(np.degrees(centre))}: r = {ours:.2f}° ours, {paper:g}° the paper's", fontsize=11)
    for k, corner in enumerate(corners):
        _robot(axes, corner, COLOURS[1], "-", 1.6, "corners, our radius" if k == 0 else None)
    for k, corner in enumerate(papers):
        _robot(axes, corner, COLOURS[0], "--", 1.2, "corners, the paper's radius" if k == 0 else None)
    _robot(axes, pose, "0.1", "-", 2.6, "centre")
    axes.plot([0.0, printed.BASE], [0.0, 0.0], "s", color="0.2", markersize=9, zorder=5)
    axes.set(xlim=(-0.4, 0.58), ylim=(-0.62, 0.06), aspect="equal", xlabel="x [m]", ylabel="y [m]")
    _inset(axes, pose, papers)


def _robot(axes: Any, q: Array, colour: str, line: str, width: float, label: str | None) -> None:
    left, right = printed.arms(q)
    axes.plot(*np.vstack([left, right[::-1]]).T, line, color=colour, linewidth=width, label=label)
    axes.plot(*left[-1], "D", color=colour, markersize=3.5)


def _inset(axes: Any, pose: Array, papers: Array) -> None:
    """The end effector at the centre and at the paper's corners, enlarged, with its scale."""
    tips = 1e3 * (np.array([printed.arms(q)[0][-1] for q in papers]) - printed.arms(pose)[0][-1])
    inset = axes.inset_axes((0.07, 0.08, 0.22, 0.31))
    inset.plot(*tips.T, "D", color=COLOURS[0], markersize=4)
    inset.plot(0.0, 0.0, "D", color="0.1", markersize=4)
    reach = 1.35 * float(np.abs(tips).max())
    inset.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    inset.tick_params(labelsize=7)
    inset.set_title("tip [mm]", fontsize=8, pad=2)
