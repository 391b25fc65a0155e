"""The plane of two independent coordinates: singular curves, regions, certified boxes and radii."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array
from ccpin.domain.atlas.atlas import Atlas
from ccpin.domain.atlas.cells import CellStatus
from ccpin.domain.atlas.radius_map import certified_radius
from ccpin.domain.singularities import SingularCurve
from ccpin.errors import InvalidInputError
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of
from ccpin.plotting.style import COLOURS, STYLE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KINDS = {
    "fold": ("loop stretched or folded", "-", COLOURS[1]),
    "self-motion": ("passive links out of control", "o", COLOURS[0]),
    "serial": ("end effector at the edge of its reach, either mode", "--", COLOURS[3]),
}


def plot_singularities(
    mechanism: Mechanism | HasMechanism,
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

    mechanism = mechanism_of(mechanism)
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


def plot_atlas(
    mechanism: Mechanism | HasMechanism, atlas: Atlas, curves: Sequence[SingularCurve] = (), title: str | None = None
) -> Figure:
    """The certified boxes of an atlas for n = 2 with what is undecided, unreached and empty, under singular curves."""
    from matplotlib import rc_context
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    _two_coordinates(atlas)
    leaves = atlas.tree.leaves()
    lower = np.degrees(atlas.region.position(atlas.tree.lower[leaves]))
    upper = np.degrees(atlas.region.position(atlas.tree.lower[leaves] + atlas.tree.size[leaves]))
    corners = np.stack(
        [lower, np.column_stack([upper[:, 0], lower[:, 1]]), upper, np.column_stack([lower[:, 0], upper[:, 1]])], 1
    )
    status = atlas.tree.status[leaves]
    with rc_context(STYLE | {"axes.grid": False}):
        figure = Figure(figsize=(7.2, 7.2), layout="constrained")
        axes = figure.add_subplot()
        handles = []
        for name, members, colour in _STATUS_COLOURS:
            chosen = corners[np.isin(status, members)]
            share = 100.0 * atlas.fraction(*members)
            axes.add_collection(PolyCollection(list(chosen), facecolor=colour, edgecolor="white", linewidth=0.15))
            handles.append(Patch(facecolor=colour, label=f"{name} {share:.2f} %"))
        _overlay(axes, curves)
        axes.plot(*np.degrees(atlas.region.reduce(atlas.q0[None])[0]), "+", color="black", markersize=10)
        _window(axes, atlas)
        axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.09), ncols=2, frameon=False)
        figure.suptitle(title or f"{mechanism_of(mechanism).name}: {len(atlas.lower)} certified boxes")
    return figure


def plot_radius_map(
    mechanism: Mechanism | HasMechanism,
    atlas: Atlas,
    curves: Sequence[SingularCurve] = (),
    resolution: int = 160,
    title: str | None = None,
) -> Figure:
    """A heat map of the certified radius for n = 2: the largest certified square about each q, in degrees."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    _two_coordinates(atlas)
    region = atlas.region
    grids = [region.lower[k] + (np.arange(resolution) + 0.5) * region.width[k] / resolution for k in range(2)]
    first, second = np.meshgrid(*grids, indexing="ij")
    radius = np.degrees(certified_radius(atlas, np.column_stack([first.ravel(), second.ravel()]))).reshape(first.shape)
    with rc_context(STYLE | {"axes.grid": False}):
        figure = Figure(figsize=(7.6, 6.6), layout="constrained")
        axes = figure.add_subplot()
        extent = np.degrees([region.lower[0], region.upper[0], region.lower[1], region.upper[1]])
        shown = np.ma.masked_less_equal(radius.T, 0.0)
        image = axes.imshow(shown, origin="lower", extent=tuple(extent), cmap="viridis", aspect="equal")
        figure.colorbar(image, ax=axes, label="certified radius [°]", shrink=0.85)
        _overlay(axes, curves)
        _window(axes, atlas)
        figure.suptitle(title or f"{mechanism_of(mechanism).name}: radius of the certified square about each q")
    return figure


_STATUS_COLOURS = (
    ("certified", (CellStatus.CERTIFIED,), "#9ccb9f"),
    ("undecided", (CellStatus.UNDECIDED, CellStatus.CANDIDATE), "#d1541f"),
    ("unreached", (CellStatus.UNREACHED,), "#f2d16b"),
    ("empty", (CellStatus.EMPTY,), "#e4e7eb"),
)


def _two_coordinates(atlas: Atlas) -> None:
    if len(atlas.names) != 2:
        raise InvalidInputError(f"the atlas has {len(atlas.names)} coordinates; maps are drawn for two")


def _overlay(axes: Any, curves: Sequence[SingularCurve]) -> None:
    for curve in curves:
        _, style, colour = KINDS[curve.kind]
        for piece in _wrapped(np.degrees(curve.q)):
            axes.plot(*piece.T, style, color=colour, linewidth=1.2, markersize=6)


def _window(axes: Any, atlas: Atlas) -> None:
    lower, upper = np.degrees(atlas.region.lower), np.degrees(atlas.region.upper)
    axes.set_xlim(lower[0], upper[0])
    axes.set_ylim(lower[1], upper[1])
    axes.set_aspect("equal")
    axes.set_xlabel(f"{atlas.names[0]} [°]")
    axes.set_ylabel(f"{atlas.names[1]} [°]")


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
