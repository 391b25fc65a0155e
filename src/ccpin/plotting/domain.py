"""The plane of two independent coordinates: singular curves, regions, certified boxes and radii."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ccpin.domain.singularities import SingularCurve
from ccpin.mechanism import Mechanism
from ccpin.plotting.style import COLOURS, STYLE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
KINDS = {
    "fold": ("loop stretched or folded", "-", COLOURS[1]),
    "self-motion": ("passive links out of control", "o", COLOURS[0]),
}


def plot_singularities(
    mechanism: Mechanism,
    curves: Sequence[SingularCurve],
    regions: Sequence[tuple[ArrayLike, ArrayLike, str]] = (),
    title: str | None = None,
) -> Figure:
    """Singular curves over the (q1, q2) square of ±180° with named rectangular regions (Fig. 6).

    Args:
        mechanism: With two independent revolute joints.
        curves: From `ccpin.domain.singularities`.
        regions: (lower corner, upper corner, name), in radians.
        title: The figure's title.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(STYLE):
        figure = Figure(figsize=(6.8, 6.6), layout="constrained")
        axes = figure.add_subplot()
        labelled: set[str] = set()
        for curve in curves:
            label, style, colour = KINDS[curve.kind]
            for piece in _wrapped(np.degrees(curve.q)):
                axes.plot(*piece.T, style, color=colour, label=None if label in labelled else label, markersize=8)
                labelled.add(label)
        for lower, upper, name in regions:
            _rectangle(axes, np.degrees(lower), np.degrees(upper), name)
        _square(axes, mechanism)
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=2, frameon=False)
        figure.suptitle(title or f"{mechanism.name}: singular configurations")
    return figure


def _square(axes: Any, mechanism: Mechanism) -> None:
    axes.set_xlim(-180, 180)
    axes.set_ylim(-180, 180)
    axes.set_xticks(range(-180, 181, 60))
    axes.set_yticks(range(-180, 181, 60))
    axes.set_aspect("equal")
    axes.set_xlabel(f"{mechanism.independent[0]} [°]")
    axes.set_ylabel(f"{mechanism.independent[1]} [°]")


def _rectangle(axes: Any, lower: Array, upper: Array, name: str) -> None:
    from matplotlib.patches import Rectangle

    size = upper - lower
    axes.add_patch(Rectangle(tuple(lower), *size, facecolor=COLOURS[2], edgecolor=COLOURS[2], alpha=0.3))
    axes.annotate(name, lower + size / 2, ha="center", va="center", fontsize=12)


def _wrapped(points: Array) -> list[Array]:
    """Bring points in degrees into ±180° and cut the line where it leaves the square."""
    inside = np.remainder(points + 180.0, 360.0) - 180.0
    cuts = np.flatnonzero(np.abs(np.diff(inside, axis=0)).max(axis=1) > 180.0) + 1
    return [piece for piece in np.split(inside, cuts) if len(piece)]
