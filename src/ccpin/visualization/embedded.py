"""A page as a notebook shows it: in a frame of its own, with everything it needs inside."""

from __future__ import annotations

from html import escape
from typing import NamedTuple


class Embedded(NamedTuple):
    """A self-contained page that a notebook shows as the value of a cell.

    Attributes:
        page: The page itself, HTML.
        height: Of its frame, pixels.
    """

    page: str
    height: int

    def __repr__(self) -> str:
        return f"Embedded(a page of {len(self.page) / 1e6:.1f} MB)"

    def _repr_html_(self) -> str:
        """The page in a frame."""
        return frame(f'srcdoc="{escape(self.page)}"', self.height)


def frame(source: str, height: int) -> str:
    """A frame over the whole width of a notebook's cell, of a source given as an attribute."""
    return f'<iframe {source} style="width: 100%; height: {height}px; border: 0" allowfullscreen></iframe>'
