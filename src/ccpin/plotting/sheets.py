"""The plane of two independent coordinates with the number of closed configurations that each q has."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import heading, matrix_rows, records
from ccpin.domain.closures.packing import require_about
from ccpin.domain.sheets.sheets import SheetAtlas
from ccpin.domain.singular.cusp_points import Cusp
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of
from ccpin.plotting.atlases import cells_drawn, check_plane
from ccpin.plotting.style import Figure, coordinate_labels, drawing

_OPEN = "#a7adb6"
_COUNTS = ("#f4f5f7", "#f3c6b0", "#56b4e9", "#fff3b0", "#009e73", "#f2d16b", "#f0e442")


def plot_sheets(
    mechanism: Mechanism | HasMechanism,
    atlas: SheetAtlas,
    cusps: Sequence[Cusp] = (),
    path: ArrayLike | None = None,
    title: str | None = None,
) -> Figure:
    """How many closed configurations each q has, for n = 2, with cusps and a path; not counted: along the folds.

    Angles are in degrees, slides in metres.

    Args:
        mechanism: The mechanism, or its model.
        atlas: From `ccpin.domain.certify_sheets`.
        cusps: From `ccpin.domain.cusps`.
        path: Waypoints of shape (K, 2), from `SheetAtlas.way` or `mode_change`.
        title: The figure's title.

    Raises:
        InvalidInputError: The atlas has not two coordinates.
    """
    from matplotlib.collections import PolyCollection
    from matplotlib.patches import Patch

    check_plane(atlas, SheetAtlas, "a SheetAtlas")
    system = atlas.problem.system
    turns = system.periodic[system.independent]
    scale = np.where(turns, np.degrees(1.0), 1.0)
    corners, count, handles = cells_drawn(atlas, scale), atlas.count[atlas.tree.leaves()], []
    require_about("a drawing of sheets", atlas, mechanism)
    with drawing(heading(title, f"{mechanism_of(mechanism).name}: assembly modes"), (7.2, 7.2)) as figure:
        axes = figure.add_subplot()
        for number in np.unique(count):
            colour = _OPEN if number < 0 else _COUNTS[number % len(_COUNTS)]
            chosen = list(corners[count == number])
            axes.add_collection(PolyCollection(chosen, facecolor=colour, edgecolor=colour, linewidth=0.2))
            handles.append(Patch(facecolor=colour, label="not counted" if number < 0 else f"{number} configurations"))
        if path is not None:
            axes.plot(*(scale * matrix_rows(path, "path", 2)).T, color="black", linewidth=1.3)
        for cusp in records(cusps, "cusps", Cusp):
            axes.plot(*(scale * cusp.q), "o", color="#d1541f", markersize=7)
        limits = np.column_stack([scale * atlas.region.lower, scale * atlas.region.upper])
        labels = coordinate_labels(atlas.names, ["°" if turn else "m" for turn in turns])
        axes.set(xlim=limits[0], ylim=limits[1], xlabel=labels[0], ylabel=labels[1])
        axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.09), ncols=3, frameon=False)
    return figure
