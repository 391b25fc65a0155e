"""The plane of two independent coordinates with the number of closed configurations that each q has."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import heading, instance, matrix_rows, records
from ccpin.domain.closures.packing import require_about
from ccpin.domain.sheets.sheets import SheetAtlas
from ccpin.domain.singular.cusp_points import Cusp
from ccpin.errors import InvalidInputError
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of
from ccpin.plotting.style import drawing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_OPEN = "#b9bec6"
_COUNTS = ("#f4f5f7", "#cfe3f5", "#9ecae1", "#9ccb9f", "#6bae8d", "#f2d16b", "#e9a15b")


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

    if len(instance(atlas, "atlas", SheetAtlas, "a SheetAtlas").names) != 2:
        raise InvalidInputError(f"the atlas has {len(atlas.names)} coordinates; maps are drawn for two")
    system, leaves = atlas.problem.system, atlas.tree.leaves()
    turns = system.periodic[system.independent]
    scale = np.where(turns, np.degrees(1.0), 1.0)
    lower = scale * atlas.region.position(atlas.tree.lower[leaves])
    upper = scale * atlas.region.position(atlas.tree.lower[leaves] + atlas.tree.size[leaves])
    corners = np.stack(
        [lower, np.column_stack([upper[:, 0], lower[:, 1]]), upper, np.column_stack([lower[:, 0], upper[:, 1]])], 1
    )
    count, handles = atlas.count[leaves], []
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
        labels = [
            f"$q_{k + 1}$ ({name}) [{'°' if turn else 'm'}]"
            for k, (name, turn) in enumerate(zip(atlas.names, turns, strict=True))
        ]
        axes.set(xlim=limits[0], ylim=limits[1], xlabel=labels[0], ylabel=labels[1])
        axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.09), ncols=3, frameon=False)
    return figure
