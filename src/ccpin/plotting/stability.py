"""Theorem 3 in pictures: 𝒱 and its rate along a motion, and the sublevel sets of U over the plane of q."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, heading, instance, matrix_rows, positive, vector
from ccpin.control.laws import PDSimpleGravity
from ccpin.control.stability.set_point.set_point_certificate import SetPointCertificate
from ccpin.covering.region import Corners, corners_of
from ccpin.errors import CcpinError, UnsupportedMechanismError
from ccpin.plotting.style import COLOURS, Figure, coordinate_labels, drawing
from ccpin.simulation.results.metrics import LyapunovHistory

_GRID = 64  # points of U along an edge of the window
_MARGIN = 0.35  # of half the window's longer edge, about the cells


def plot_lyapunov(
    t: ArrayLike, history: LyapunovHistory, level: float | None = None, title: str | None = None
) -> Figure:
    """𝒱 above its rate against time, with −q̇ᵀK_v q̇ dashed and the certified level c.

    Args:
        t: Times in seconds, of shape (T,).
        history: From `lyapunov_along`.
        level: c in joules.
        title: The figure's title.
    """
    times = vector(t, "t", len(instance(history, "history", LyapunovHistory).V))
    level = None if level is None else positive(level, "level")
    with drawing(heading(title, "Lyapunov function along the motion"), (7.0, 5.6)) as figure:
        above, below = figure.subplots(2, 1, sharex=True)
        above.plot(times, history.V, color=COLOURS[1], linewidth=1.8, label=r"$\mathcal{V}$")
        if level is not None:
            above.axhline(level, color=COLOURS[2], linestyle="--", linewidth=1.2, label=f"c = {level:.4g} J")
        above.set_ylabel("Lyapunov function [J]")
        above.legend(loc="best", framealpha=0.85, edgecolor="none")
        below.plot(times, history.V_dot, color=COLOURS[0], linewidth=1.8, label=r"$\dot{\mathcal{V}}$ from the efforts")
        below.plot(times, history.dissipation, "--", color="0.2", linewidth=1.1, label=r"$-\dot q^T K_v \dot q$")
        below.set_ylabel("rate [W]")
        below.set_xlabel("time [s]")
        below.legend(loc="best", framealpha=0.85, edgecolor="none")
    return figure


def plot_sublevel(
    certificate: SetPointCertificate,
    starts: Sequence[ArrayLike] = (),
    window: Corners | None = None,
    title: str | None = None,
) -> Figure:
    """U over the plane of two coordinates: the certified cells and {U < c}, the set point and starts.

    Args:
        certificate: Of a mechanism with two independent coordinates.
        starts: Initial positions to mark, each of shape (2,).
        window: (lower, upper) corners of the picture; default about the certified cells and the starts.
        title: The figure's title.

    Raises:
        UnsupportedMechanismError: Other than two coordinates.
    """
    instance(certificate, "certificate", SetPointCertificate)
    law, mechanism = certificate.law, certificate.law.model.mechanism
    if mechanism.n != 2:
        raise UnsupportedMechanismError(f"{mechanism.name} has {mechanism.n} coordinates; the picture is of two")
    points = list(matrix_rows(starts, "starts", 2)) if np.size(starts) else []  # type: ignore[arg-type]
    lower, upper = corners_of(_window(certificate, points) if window is None else window, mechanism.independent)
    scale = np.where([mechanism.tree.joint(name).kind.sliding for name in mechanism.independent], 1.0, np.degrees(1.0))
    title = heading(title, f"{mechanism.title}: the potential well U and the set that Theorem 3 covers")
    with drawing(title, (7.2, 6.4)) as figure:
        axes = figure.add_subplot()
        _cells(axes, certificate, scale)
        x, y, well = _well_over(law, lower, upper)
        x, y = x * scale[0], y * scale[1]
        lines = axes.contour(x, y, well, levels=12, linewidths=0.7, colors="0.45")
        axes.clabel(lines, fmt="%g J", fontsize=8)
        if certificate.level > 0.0:
            axes.contour(x, y, well, levels=[certificate.level], colors=COLOURS[2], linewidths=2.2)
            axes.plot([], [], color=COLOURS[2], linewidth=2.2, label=f"U = c = {certificate.level:.4g} J")
            axes.plot(*(certificate.touch * scale), "x", color=COLOURS[3], markersize=9, label="what limits c")
        axes.plot(*(law.q_d * scale), "o", color=COLOURS[0], markersize=8, label="set point")
        for k, point in enumerate(points):
            mark, word = ("s", "in B₂") if certificate.contains(point) else ("D", "outside of B₂")
            axes.plot(*(point * scale), mark, color="0.15", label=f"start {k + 1}: {word}")
        xlabel, ylabel = coordinate_labels(mechanism.independent, ["m" if value == 1.0 else "°" for value in scale])
        axes.set(xlabel=xlabel, ylabel=ylabel)
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=2, frameon=False)
    return figure


def _window(certificate: SetPointCertificate, points: list[Array]) -> tuple[Array, Array]:
    corners = np.vstack([*certificate.cells, certificate.law.q_d[None], *(point[None] for point in points)])
    low, high = corners.min(axis=0), corners.max(axis=0)
    margin = _MARGIN * np.max(high - low) / 2.0 + 1e-3
    return low - margin, high + margin


def _cells(axes: Any, certificate: SetPointCertificate, scale: Array) -> None:
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Rectangle

    cells = zip(*certificate.cells, strict=True)
    patches = [Rectangle(tuple(low * scale), *((high - low) * scale)) for low, high in cells]
    axes.add_collection(PatchCollection(patches, facecolor=COLOURS[2], alpha=0.18, edgecolor=COLOURS[2], linewidth=0.3))


def _well_over(law: PDSimpleGravity, lower: Array, upper: Array) -> tuple[Array, Array, Array]:
    """U on a grid, followed row by row from q_d; NaN where σ is not found."""
    x, y = (np.linspace(low, high, _GRID) for low, high in zip(lower, upper, strict=True))
    well = np.full((_GRID, _GRID), np.nan)
    rest = np.zeros(2)
    for row in range(_GRID):
        near = law.q_free_d
        for column in range(_GRID):
            q = np.array([x[column], y[row]])
            try:
                near = law.model.sigma(q, near)
            except CcpinError:
                near = law.q_free_d
                continue
            well[row, column] = law.lyapunov(q, rest, near)
    return x, y, well
