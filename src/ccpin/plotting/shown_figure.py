"""A figure that a notebook shows where it is a cell's value, without pyplot and without a magic command."""

from __future__ import annotations

from io import BytesIO

from matplotlib.figure import Figure

_DOTS = 100  # an inch on a screen; files have the figure's own


class ShownFigure(Figure):
    """Matplotlib's, shown by notebooks as a picture."""

    def _repr_png_(self) -> bytes:
        buffer = BytesIO()
        self.savefig(buffer, format="png", dpi=_DOTS)
        return buffer.getvalue()
