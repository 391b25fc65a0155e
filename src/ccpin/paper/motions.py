"""Figs. 8–10 drawn: start, goal and path; q, q̇ and u against time; cycles and a closer look at one move."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ccpin.arrays import Array
from ccpin.paper import printed
from ccpin.paper.study import BAND, GOAL, START, Study
from ccpin.plotting import plot_configurations
from ccpin.plotting.style import COLOURS, Figure, drawing
from ccpin.simulation.results.trajectory import Trajectory

_EVERY = 40  # samples between two drawn configurations
_MOVE = 0.36  # s, of the motion that is drawn
_ZOOM = 0.7  # s, of the closer look
_ROWS = (("q", "[°]", True), ("\\dot{q}", "[°/s]", True), ("u", "[N m]", False))


def path_figure(study: Study) -> Figure:
    """Fig. 8: both ends, the way of the end effector and the configurations every 40 ms."""
    motion = study.ideal
    ends = [study.model.sigma(START), study.model.sigma(GOAL, motion.q_free[-1])]
    title = "Experiment 1: start, goal and path"
    figure = plot_configurations(study.mechanism, ends, ["start (−150°, −160°)", "goal (−90°, −100°)"], title)
    axes = figure.axes[0]
    moving = motion.t <= _MOVE
    poses = study.to_paper(motion.q_free[moving])
    both = [printed.arms(q) for q in poses]
    lines = [np.vstack([left, right[1::-1]]) for left, right in both]
    for line in lines[_EVERY::_EVERY]:
        axes.plot(*line.T, color="0.8", linewidth=1.0, zorder=1)
    axes.plot(*np.array([line[2] for line in lines]).T, color=COLOURS[3], linewidth=1.8, zorder=6, label="end effector")
    axes.set(xlabel="x [m]", ylabel="y [m]")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=3, frameon=False)
    return figure


def panels_figure(ideal: Trajectory, bench: Trajectory, goal: Array) -> Figure:
    """Fig. 9: (a)–(f), the ideal robot dashed and the bench solid."""
    with drawing("Experiment 1 under PD with simple gravity compensation (28)", (9.6, 8.4)) as figure:
        axes = figure.subplots(3, 2, sharex=True)
        for row, (symbol, unit, angular) in enumerate(_ROWS):
            for k in range(2):
                panel = axes[row, k]
                _curves(panel, [ideal, bench], row, k, angular)
                if row == 0:
                    panel.axhline(np.degrees(goal[k]), color="0.5", linewidth=0.9, zorder=1, label="$q_d$")
                panel.set_ylabel(f"${symbol}_{k + 1}$ {unit}")
                panel.set_title(f"({'abcdef'[2 * row + k]})", fontsize=11, loc="left")
        for panel in axes[-1]:
            panel.set(xlabel="time [s]", xlim=(0.0, 0.6))
        axes[0, 0].legend(loc="lower right", framealpha=0.85, edgecolor="none")
        figure.align_ylabels(axes)
    return figure


def _curves(panel: Any, motions: Sequence[Trajectory], row: int, k: int, angular: bool) -> None:
    """One quantity of the ideal motion, dashed, and of the bench's, solid."""
    looks = (("ideal", "--", "0.25", 1.3), ("bench", "-", COLOURS[k], 1.7))
    for motion, (name, line, colour, width) in zip(motions, looks, strict=True):
        values = (motion.q, motion.v, motion.u)[row][:, k]
        panel.plot(motion.t, np.degrees(values) if angular else values, line, color=colour, linewidth=width, label=name)


def cycles_figure(ideal: Trajectory, bench: Trajectory, goals: Sequence[tuple[float, float, Array]]) -> Figure:
    """Fig. 10: q of all cycles above, u below, and the error of the first way back enlarged with its band."""
    with drawing("Experiment 2: repetitive motion", (10.4, 9.4)) as figure:
        axes = figure.subplots(3, 2)
        for k in range(2):
            _curves(axes[0, k], [ideal, bench], 0, k, True)
            for begin, end, goal in goals:
                axes[0, k].plot([begin, end], np.degrees([goal[k]] * 2), color="0.5", linewidth=0.9, zorder=1)
            axes[0, k].set(ylabel=f"$q_{k + 1}$ [°]", xlabel="time [s]")
            _curves(axes[1, k], [ideal, bench], 2, k, False)
            axes[1, k].set(ylabel=f"$u_{k + 1}$ [N m]", xlabel="time [s]")
            _closer(axes[2, k], ideal, bench, goals, k)
        axes[0, 0].legend(loc="upper right", framealpha=0.85, edgecolor="none")
        figure.align_ylabels(axes)
    return figure


def _closer(
    panel: Any, ideal: Trajectory, bench: Trajectory, goals: Sequence[tuple[float, float, Array]], k: int
) -> None:
    """The first move back to the start: q − q_d from when its goal was set."""
    looks = ((ideal, "--", "0.25", 1.3), (bench, "-", COLOURS[k], 1.7))
    goal = goals[1][2]
    for motion, line, colour, width in looks:
        begin = _departure(motion, goals[0][2])
        shown = (motion.t >= begin) & (motion.t <= begin + _ZOOM)
        error = np.degrees(motion.q[shown, k] - goal[k])
        panel.plot(motion.t[shown] - begin, error, line, color=colour, linewidth=width)
    panel.axhspan(-np.degrees(BAND), np.degrees(BAND), color=COLOURS[2], alpha=0.15, linewidth=0)
    panel.axvline(0.3, color="0.5", linewidth=0.9)
    panel.annotate("0.3 s", (0.3, 11.0), (4, 0), textcoords="offset points", color="0.35", fontsize=9)
    panel.set(xlim=(0.0, _ZOOM), ylim=(-15.0, 15.0), ylabel=f"$q_{k + 1} - q_{{d{k + 1}}}$ [°]")
    panel.set_xlabel("time since the goal was set [s]")


def _departure(motion: Trajectory, first: Array) -> float:
    """When the motion leaves its first goal for the second, s: the last sample near it before the way back."""
    near = np.abs(motion.q - first).max(axis=1) < 0.5 * BAND
    begun = int(np.argmax(near))
    away = np.flatnonzero(~near[begun:] & (motion.t[begun:] > motion.t[begun] + 1.0))
    return float(motion.t[begun + int(away[0]) - 1])
