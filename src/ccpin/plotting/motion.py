"""Motions against time, and configurations in their plane or in space."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, heading, instance, matrix_rows, numbers, records
from ccpin.errors import InvalidInputError
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of
from ccpin.mechanism.wireframe import outline, plane_of_motion
from ccpin.plotting.style import COLOURS, Figure, drawing
from ccpin.proof.digests import require_same
from ccpin.simulation.results.trajectory import Trajectory

_ABREAST = 3
"""Columns of a motion's panels in a row."""
_LONG = 12
"""Letters from which on a name has a line of its own beside a panel."""
_TICKS = 5
"""Along the longest axis of a picture in space."""
_ROOM = 0.82
"""Of a box in space, so that its labels are within the figure."""


def plot_motion(
    trajectory: Trajectory, mechanism: Mechanism | HasMechanism, goal: ArrayLike | None = None, title: str | None = None
) -> Figure:
    """Coordinates, velocities and efforts against time, one column a coordinate (the panels of Figs. 9 and 10).

    Angles are drawn in degrees. More than three coordinates stand in groups below one another.

    Args:
        trajectory: The motion.
        mechanism: What moves.
        goal: q_d to draw dashed: (model.nq,), or (T, model.nq) where it changes.
        title: The figure's title.

    Raises:
        InvalidInputError: An argument of another kind or shape.
        DifferentSubjectsError: It is a motion of another mechanism.
    """
    instance(trajectory, "trajectory", Trajectory)
    mechanism = mechanism_of(mechanism)
    require_same("a drawing of a motion", mechanism.digests, trajectory.origin, "closures")
    columns = max(trajectory.q.shape[1], trajectory.u.shape[1])
    title = heading(title, f"{mechanism.title}: {trajectory.message}")
    goals = None if goal is None else _goals(goal, trajectory)
    groups = -(-columns // _ABREAST)
    wide = -(-columns // groups)
    with drawing(title, (max(7.0, 3.6 * wide), 7.2 * groups)) as figure:
        axes = figure.subplots(3 * groups, wide, sharex=True, squeeze=False)
        rows: tuple[tuple[str, Array, tuple[str, ...], bool], ...] = (
            ("position", trajectory.q, mechanism.independent, False),
            ("velocity", trajectory.v, mechanism.independent, False),
            ("effort", trajectory.u, mechanism.actuated, True),
        )
        for row, (quantity, values, names, effort) in enumerate(rows):
            for k in range(groups * wide):
                panel = axes[3 * (k // wide) + row, k % wide]
                if k >= values.shape[1]:
                    panel.set_visible(False)
                    continue
                name = names[k] if k < len(names) and len(names) == values.shape[1] else str(k + 1)
                scale, unit = _scale(mechanism, name, quantity)
                panel.plot(trajectory.t, scale * values[:, k], color=COLOURS[k % len(COLOURS)], linewidth=1.6)
                if row == 0 and goals is not None:
                    panel.plot(trajectory.t, scale * goals[:, k], "--", color="0.35", linewidth=1.0, label="set point")
                    if k == 0:
                        panel.legend(loc="best", framealpha=0.85, edgecolor="none")
                where = "at" if effort else "of"
                panel.set_ylabel(f"{quantity} {where}{' ' if len(name) < _LONG else chr(10)}{name} [{unit}]")
                if row == 2:
                    panel.set_xlabel("time [s]")
                    panel.tick_params(labelbottom=True)
        figure.align_ylabels(axes)
    return figure


def _goals(goal: ArrayLike, trajectory: Trajectory) -> Array:
    shape, goals = trajectory.q.shape, numbers(goal, "goal")
    if goals.shape not in (shape, shape[1:]):
        raise InvalidInputError(f"goal has shape {goals.shape}; it must be {shape[1:]}, or {shape} where it changes")
    return np.broadcast_to(goals, shape)


def _scale(mechanism: Mechanism, name: str, quantity: str) -> tuple[float, str]:
    """Factor and unit for drawing: degrees for angles, millimetres never."""
    joint, component = mechanism.tree.split(name)
    kind = mechanism.tree.joint(joint).kind if joint in mechanism.tree.names else None
    linear = (kind is not None and kind.sliding) or component.startswith("t")
    if quantity == "effort":
        return 1.0, "N" if linear else "N m"
    if linear:
        return 1.0, "m" if quantity == "position" else "m/s"
    if (kind is None or kind.nv > 1) and not component.startswith("r"):
        return 1.0, "–" if quantity == "position" else "rad/s"
    return float(np.degrees(1.0)), "°" if quantity == "position" else "°/s"


def plot_configurations(
    mechanism: Mechanism | HasMechanism,
    configurations: Sequence[ArrayLike],
    labels: Sequence[str],
    title: str | None = None,
) -> Figure:
    """The mechanism's lines at several configurations (Fig. 8), in its plane of motion or in space.

    Arguments and errors as for `plot_configuration_panels`.
    """
    return plot_configuration_panels(mechanism, [("", configurations)], labels, title)


def plot_configuration_panels(
    mechanism: Mechanism | HasMechanism,
    panels: Sequence[tuple[str, Sequence[ArrayLike]]],
    labels: Sequence[str],
    title: str | None = None,
) -> Figure:
    """Several drawings as in `plot_configurations` side by side (Fig. 7).

    Args:
        mechanism: What is drawn.
        panels: A heading and the configurations q′ of each drawing.
        labels: What each configuration of a drawing is called; one alone gets no legend.
        title: The figure's title.

    Raises:
        InvalidInputError: An argument of another kind, or not a label a configuration.
    """
    mechanism, drawings = mechanism_of(mechanism), _checked_panels(mechanism_of(mechanism), panels, labels)
    plane = plane_of_motion(mechanism)
    columns = min(2, len(drawings))
    rows = -(-len(drawings) // columns)
    size = (7.0 if columns == 1 else 5.2 * columns, 6.4 if rows == 1 else 4.4 * rows)
    with drawing(heading(title, mechanism.title), size) as figure:
        for k, (above, configurations) in enumerate(drawings):
            projection = {} if plane is not None else {"projection": "3d"}
            axes: Any = figure.add_subplot(rows, columns, k + 1, **projection)
            for i, (q_free, label) in enumerate(zip(configurations, labels, strict=True)):
                colour = COLOURS[i % len(COLOURS)]
                _draw(axes, mechanism, q_free, plane, colour, label)
            axes.set_aspect("equal", adjustable="datalim" if plane is not None else "box")
            if plane is None:
                extents = np.ptp(np.reshape(axes.get_w_lims(), (3, 2)), axis=1)
                axes.set_box_aspect(extents, zoom=_ROOM)
                for axis, share in zip("xyz", extents / extents.max(), strict=True):
                    axes.locator_params(axis, nbins=max(1, round(_TICKS * share)))
            labelled = zip("xyz", _axis_names(plane), strict=False)
            pad = 4.0 if plane is not None else 9.0
            for axis, name in labelled:
                getattr(axes, f"set_{axis}label")(f"{name} [m]", labelpad=pad)
            axes.set_title(above, fontsize=11)
            if k == 0 and len(labels) > 1:
                axes.legend(loc="best", framealpha=0.85, edgecolor="none")
    return figure


def _checked_panels(mechanism: Mechanism, panels: object, labels: object) -> list[tuple[str, Array]]:
    """Headings and configurations (K, nq), each with as many as there are labels.

    Raises:
        InvalidInputError: They are not that.
    """
    count = len(records(labels, "labels", str))
    checked = []
    for panel in instance(panels, "panels", Sequence, "a sequence of (heading, configurations)"):
        if not isinstance(panel, tuple) or len(panel) != 2:
            raise InvalidInputError(f"a panel is (heading, configurations), not {panel!r:.80}")
        rows = matrix_rows(panel[1], "configurations", mechanism.nq)
        if len(rows) != count:
            raise InvalidInputError(f"there are {len(rows)} configurations and {count} labels")
        checked.append((instance(panel[0], "a panel's heading", str, "a text"), rows))
    if not checked:
        raise InvalidInputError("panels is empty: there is nothing to draw")
    return checked


def _axis_names(plane: Array | None) -> list[str]:
    if plane is None:
        return ["x", "y", "z"]
    names = []
    for axis, fallback in zip(plane, ("right", "up"), strict=True):
        main = int(np.argmax(np.abs(axis)))
        names.append("xyz"[main] if abs(axis[main]) > 1 - 1e-9 else fallback)
    return names


def _draw(axes: Any, mechanism: Mechanism, q_free: Array, plane: Array | None, colour: str, label: str) -> None:
    shape = outline(mechanism, q_free)

    def project(points: Array) -> Array:
        return points if plane is None else points @ plane.T

    for k, segment in enumerate(project(shape.segments)):
        axes.plot(*segment.T, "-", color=colour, linewidth=3.0, solid_capstyle="round", label=label if k == 0 else None)
    axes.plot(*project(shape.joints).T, "o", color="white", markeredgecolor=colour, markersize=7, zorder=3)
    if len(shape.loops):
        axes.plot(*project(shape.loops).T, "D", color=colour, markersize=7, zorder=4)
    model = mechanism.tree.model
    grounded = np.array([model.parents[j] == 0 for j in range(1, model.njoints)])
    axes.plot(*project(shape.joints[grounded]).T, "s", color="0.2", markersize=9, zorder=5)
