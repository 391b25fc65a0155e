"""Figures of transmissions: polygons of effort and speed, ratios over a range, and what shortcuts miss."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import heading, instance, records
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.plotting.style import COLOURS, Figure, drawing
from ccpin.transmission.motor_limits import LimitsCertificate
from ccpin.transmission.polytopes import Polytope
from ccpin.transmission.shortcuts import Comparison
from ccpin.transmission.surveys import Survey, survey
from ccpin.transmission.transmission import Transmission

UNITS = {"rad": ("N m", "rad/s"), "m": ("N", "m/s")}


def plot_limits(
    transmission: Transmission,
    *,
    effort: ArrayLike | None = None,
    speed: ArrayLike | None = None,
    proved: Sequence[LimitsCertificate] = (),
    title: str | None = None,
) -> Figure:
    """What the motors give at the joints over their range: of two joints polygons, of one curves over its angle.

    Args:
        transmission: Of one joint or two.
        effort: Largest efforts of the motors behind their gears; default the mechanism's.
        speed: Largest speeds of their joints; default the file's.
        proved: Boxes and ellipsoids that are proved, of `certify_limits`: drawn over them.
        title: The figure's title.

    Raises:
        UnsupportedMechanismError: More joints than two.
        InvalidInputError: No limits are given and none stated.
    """
    instance(transmission, "transmission", Transmission)
    if transmission.n not in (1, 2):
        raise UnsupportedMechanismError(f"{transmission!r} has {transmission.n} joints; the picture is of one or two")
    told = [each for each in records(proved, "proved", LimitsCertificate) if each.verdict == "proven"]
    found = survey(transmission, count=41 if transmission.n == 1 else 3)
    name = transmission.joint_model.mechanism.title
    with drawing(heading(title, f"{name}: what the motors give at the joints"), (9.0, 4.4)) as figure:
        left, right = figure.subplots(1, 2)
        draw = _curves if transmission.n == 1 else _polygons
        draw(left, found, [posture.torque_polytope(effort=effort) for posture in found.postures], 0)
        draw(right, found, [posture.speed_polytope(speed=speed) for posture in found.postures], 1)
        for axes, of in ((left, "effort"), (right, "speed")):
            _proved(axes, [each for each in told if each.of == of])
    return figure


def _polygons(axes: Any, found: Survey, polytopes: Sequence[Polytope], which: int) -> None:
    """Polygons over the range, and the largest box in that of the posture nearest to the reference, drawn bold."""
    joints, units = found.transmission.joints, found.transmission.joint_side.units
    for k, polytope in enumerate(polytopes):
        corners = np.vstack([polytope.vertices, polytope.vertices[:1]])
        at = ", ".join(f"{q:.2g}" for q in found.postures[k].q_joint)
        style = {"color": COLOURS[0], "linewidth": 2.0} if not k else {"color": COLOURS[1], "alpha": 0.45}
        axes.plot(*corners.T, label=f"at {at}" if not k else None, **style)
    box = polytopes[0].largest_box()
    axes.plot(
        *(box[:, None] * [[1, 1, -1, -1, 1], [1, -1, -1, 1, 1]]), "--", color=COLOURS[2], label="largest box there"
    )
    labels = [f"{name} [{UNITS[unit][which]}]" for name, unit in zip(joints, units, strict=True)]
    axes.set(xlabel=labels[0], ylabel=labels[1], title=("effort", "speed")[which])
    _legend(axes)


def _proved(axes: Any, certificates: Sequence[LimitsCertificate]) -> None:
    """What is proved over a region: of two joints edges, of one its bounds over the region."""
    turn = np.linspace(0.0, 2.0 * np.pi, 129)
    box = np.array([[1, 1, -1, -1, 1], [1, -1, -1, 1, 1]])
    edges = {"box": box, "ellipsoid": np.array([np.cos(turn), np.sin(turn)])}
    for one in certificates:
        style = {"color": COLOURS[3], "linestyle": "-" if one.form == "box" else ":", "linewidth": 2.0}
        if one.transmission.n == 2:
            axes.plot(*(one.size @ edges[one.form]), label=f"{one.form} proved in its region", **style)
        else:
            ends, (width,) = np.array([one.lower[0], one.upper[0]]), one.half_widths
            axes.plot(ends, np.array([width, width]), label=f"{one.form} proved in its region", **style)
            axes.plot(ends, np.array([-width, -width]), **style)
    if certificates:  # between the two curves of one joint nothing is drawn
        _legend(axes, "center" if certificates[0].transmission.n == 1 else "upper right")


def _legend(axes: Any, place: str = "upper right") -> None:
    axes.legend(loc=place, fontsize=8, framealpha=0.85, edgecolor="none")


def _curves(axes: Any, found: Survey, polytopes: Sequence[Polytope], which: int) -> None:
    """Least and largest over the joint's displacement."""
    (joint,), (unit,) = found.transmission.joints, found.transmission.joint_side.units
    order = np.argsort([posture.q_joint[0] for posture in found.postures])
    q = np.array([found.postures[k].q_joint[0] for k in order])
    low, high = (np.array([polytopes[k].bounds[end][0] for k in order]) for end in (0, 1))
    axes.fill_between(q, low, high, color=COLOURS[1], alpha=0.2)
    axes.plot(q, low, q, high, color=COLOURS[1])
    axes.locator_params(axis="x", nbins=5)
    axes.set(xlabel=f"{joint} [{unit}]", ylabel=f"{joint} [{UNITS[unit][which]}]", title=("effort", "speed")[which])


def plot_shortcuts(comparisons: Sequence[Comparison], title: str | None = None) -> Figure:
    """What the joints lack by each shortcut along one motion, beside what they want.

    Args:
        comparisons: From `compare`, of one motion.
        title: The figure's title.

    Raises:
        InvalidInputError: There are none.
    """
    given = records(comparisons, "comparisons", Comparison)
    if not given:
        raise InvalidInputError("comparisons are none: give those of `compare`")
    first = given[0]
    with drawing(heading(title, "What shortcuts miss at the joints"), (7.5, 2.6 * len(first.joints) + 0.6)) as figure:
        panels = np.atleast_1d(figure.subplots(len(first.joints), 1, sharex=True))
        for j, (axes, joint) in enumerate(zip(panels, first.joints, strict=True)):
            axes.plot(first.t, first.wanted[:, j], color="0.3", linewidth=1.2, label="whole effort")
            for k, each in enumerate(given):
                axes.plot(
                    each.t, each.missing[:, j], color=COLOURS[k % len(COLOURS)], label=f"missing by {each.shortcut}"
                )
            axes.set_ylabel(joint)
        panels[0].legend(loc="best", fontsize=8, framealpha=0.85, edgecolor="none")
        panels[-1].set_xlabel("time [s]")
    return figure
