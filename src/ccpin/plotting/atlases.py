"""The plane of two independent coordinates: singular curves, regions, certified boxes and radii."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, heading, instance, whole
from ccpin.covering.cells import CellStatus
from ccpin.covering.region import corners_of
from ccpin.domain.atlas.atlas import Atlas
from ccpin.domain.atlas.radius_map import certified_radius
from ccpin.domain.closures.packing import require_about
from ccpin.domain.sheets.sheets import SheetAtlas
from ccpin.domain.singular.sampled import SingularCurve
from ccpin.errors import InvalidInputError
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of
from ccpin.plotting.style import COLOURS, Figure, coordinate_labels, drawing

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
    mechanism = mechanism_of(mechanism)
    with drawing(heading(title, f"{mechanism.title}: singular configurations"), (6.8, 6.6)) as figure:
        axes = figure.add_subplot()
        _curves(axes, curves, markersize=8)
        for region in instance(regions, "regions", Sequence, "a sequence of (lower, upper, name)"):
            if not isinstance(region, tuple) or len(region) != 3:
                raise InvalidInputError(f"a region is (lower, upper, name), not {region!r:.80}")
            lower, upper = np.degrees(corners_of(region[:2], mechanism.independent))
            _rectangle(axes, lower, upper, instance(region[2], "a region's name", str, "a text"))
        _window(axes, mechanism.independent, [-180.0, -180.0], [180.0, 180.0])
        axes.set(xticks=range(-180, 181, 60), yticks=range(-180, 181, 60))
        if axes.get_legend_handles_labels()[0]:
            axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=2, frameon=False)
    return figure


def plot_atlas(
    mechanism: Mechanism | HasMechanism, atlas: Atlas, curves: Sequence[SingularCurve] = (), title: str | None = None
) -> Figure:
    """An atlas for n = 2: what is certified, undecided, singular, unreached and empty, under singular curves."""
    from matplotlib.collections import PolyCollection
    from matplotlib.patches import Patch

    check_plane(atlas, Atlas, "an Atlas")
    corners, status = cells_drawn(atlas, np.degrees(1.0)), atlas.tree.status[atlas.tree.leaves()]
    require_about("a drawing of an atlas", atlas, mechanism)
    title = heading(title, f"{mechanism_of(mechanism).title}: {len(atlas.lower)} certified boxes")
    with drawing(title, (7.2, 7.2), **{"axes.grid": False}) as figure:
        axes = figure.add_subplot()
        handles = []
        for name, members, colour in _STATUS_COLOURS:
            chosen = corners[np.isin(status, members)]
            share = 100.0 * atlas.fraction(*members)
            axes.add_collection(PolyCollection(list(chosen), facecolor=colour, edgecolor="white", linewidth=0.15))
            handles.append(Patch(facecolor=colour, label=f"{name} {share:.2f} %"))
        _curves(axes, curves, linewidth=1.2, markersize=6)
        axes.plot(*np.degrees(atlas.region.reduce(atlas.q0[None])[0]), "+", color="black", markersize=10)
        _window(axes, atlas.names, *np.degrees([atlas.region.lower, atlas.region.upper]))
        axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.09), ncols=2, frameon=False)
    return figure


def plot_radius_map(
    mechanism: Mechanism | HasMechanism,
    atlas: Atlas,
    curves: Sequence[SingularCurve] = (),
    resolution: int = 160,
    title: str | None = None,
) -> Figure:
    """A heat map of the certified radius for n = 2: the largest certified square about each q, in degrees."""
    check_plane(atlas, Atlas, "an Atlas")
    region, resolution = atlas.region, whole(resolution, "resolution")
    grids = [region.lower[k] + (np.arange(resolution) + 0.5) * region.width[k] / resolution for k in range(2)]
    first, second = np.meshgrid(*grids, indexing="ij")
    radius = np.degrees(certified_radius(atlas, np.column_stack([first.ravel(), second.ravel()]))).reshape(first.shape)
    lower, upper = np.degrees([region.lower, region.upper])
    require_about("a map of radii", atlas, mechanism)
    title = heading(title, f"{mechanism_of(mechanism).title}: radius of the certified square about each q")
    with drawing(title, (7.6, 6.6), **{"axes.grid": False}) as figure:
        axes = figure.add_subplot()
        extent = (lower[0], upper[0], lower[1], upper[1])
        shown = np.ma.masked_less_equal(radius.T, 0.0)
        image = axes.imshow(shown, origin="lower", extent=extent, cmap="viridis", aspect="equal")
        figure.colorbar(image, ax=axes, label="certified radius [°]", shrink=0.85)
        _curves(axes, curves, linewidth=1.2, markersize=6)
        _window(axes, atlas.names, lower, upper)
    return figure


_STATUS_COLOURS = (
    ("certified", (CellStatus.CERTIFIED,), "#9ccb9f"),
    ("undecided", (CellStatus.UNDECIDED, CellStatus.CANDIDATE), "#d1541f"),
    ("singular", (CellStatus.SINGULAR,), "#7a3b8f"),
    ("unreached", (CellStatus.UNREACHED,), "#f2d16b"),
    ("empty", (CellStatus.EMPTY,), "#e4e7eb"),
)


def check_plane(atlas: object, kind: type[Atlas] | type[SheetAtlas], what: str) -> None:
    """Check that an atlas is of a kind (`what` in words), and of two coordinates.

    Raises:
        InvalidInputError: It is not.
    """
    names = instance(atlas, "atlas", kind, what).names
    if len(names) != 2:
        raise InvalidInputError(f"the atlas has {len(names)} coordinates; maps are drawn for two")


def cells_drawn(atlas: Atlas | SheetAtlas, scale: ArrayLike) -> Array:
    """The corners of an atlas's cells in turn, of shape (K, 4, 2), the coordinates times their scales."""
    leaves = atlas.tree.leaves()
    ends = atlas.tree.lower[leaves], atlas.tree.lower[leaves] + atlas.tree.size[leaves]
    (x0, y0), (x1, y1) = (np.multiply(scale, atlas.region.position(end)).T for end in ends)
    return np.stack([np.column_stack(corner) for corner in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))], 1)


def _curves(axes: Any, curves: Sequence[SingularCurve], **style: float) -> None:
    """Singular curves in ±180°, each kind with one entry in the legend."""
    labelled: set[str | None] = set()
    for curve in instance(curves, "curves", Sequence, "a sequence of SingularCurve"):
        instance(curve, "each of curves", SingularCurve)
        label, line, colour = KINDS[curve.kind]
        for piece in _wrapped(np.degrees(curve.q)):
            axes.plot(*piece.T, line, color=colour, label=None if label in labelled else label, **style)
            labelled.add(label)


def _window(axes: Any, names: Sequence[str], lower: ArrayLike, upper: ArrayLike) -> None:
    limits = dict(zip(("xlim", "ylim"), np.column_stack([lower, upper]), strict=True))
    words = dict(zip(("xlabel", "ylabel"), coordinate_labels(names, "°°"), strict=True))
    axes.set(aspect="equal", **words, **limits)


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
