"""What all figures share: their looks, and writing them whole or not at all."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from ccpin.arrays import instance
from ccpin.displays import COLOURS as COLOURS
from ccpin.errors import InvalidInputError
from ccpin.files import writable_target, write_atomically

if TYPE_CHECKING:
    import matplotlib.figure

Figure: TypeAlias = "matplotlib.figure.Figure"
"""Matplotlib's, which is imported when a figure is drawn."""
STYLE = {
    "font.size": 10,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "figure.dpi": 300,  # kept by the figure, unlike savefig.dpi, so that it counts whenever and however it is saved
}


@contextmanager
def drawing(title: str, size: tuple[float, float], **style: Any) -> Iterator[Figure]:
    """A new figure in the common style, `style` added, of a size in inches, to draw into meanwhile."""
    logging.getLogger("matplotlib.font_manager").addFilter(_told)
    from matplotlib import rc_context

    from ccpin.plotting.shown_figure import ShownFigure

    with rc_context(STYLE | style):
        figure = ShownFigure(figsize=size, layout="constrained")
        figure.suptitle(title)
        yield figure


def _told(record: logging.LogRecord) -> bool:
    """Whether a user is to see it: not that the first figure ever drawn on a machine waits for a list of fonts."""
    return "building the font cache" not in record.getMessage()


def coordinate_labels(names: Sequence[str], units: Sequence[str]) -> list[str]:
    """What stands beside the axes of independent coordinates."""
    return [f"$q_{k}$ ({name}) [{unit}]" for k, (name, unit) in enumerate(zip(names, units, strict=True), start=1)]


def save(figure: Figure, path: str | Path) -> None:
    """Write a figure as PNG, PDF or SVG by the file's ending, atomically.

    Raises:
        InvalidInputError: The folder cannot be written to, or the ending names no format.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    instance(figure, "figure", Figure)
    target = writable_target(path)
    if figure.canvas is None:
        FigureCanvasAgg(figure)
    kind, known = target.suffix.lstrip(".").lower() or "png", figure.canvas.get_supported_filetypes()
    if kind not in known:
        raise InvalidInputError(f"'{target}': figures are written as {', '.join(known)}, by the file's ending")
    write_atomically(target, "wb", lambda file: figure.savefig(file, format=kind))
