"""One numbered thing of the paper beside what ccpin makes of it."""

from __future__ import annotations

from typing import Any, NamedTuple

from ccpin.arrays import Array
from ccpin.plotting.style import Figure

ROUNDING = "an identity: rounding, times the conditioning of ψ_q′ at the samples"


class Drawing(NamedTuple):
    """A figure.

    Attributes:
        name: Of its file, without an ending.
        caption: What it shows.
        figure: The figure.
    """

    name: str
    caption: str
    figure: Figure


class Item(NamedTuple):
    """A numbered equation, figure, table or theorem: the paper's, ours, and how far they are apart.

    Texts are plain, with ``x_i`` and ``x^2`` for indices and powers, as `ccpin.pages.parts.formula` takes them.

    Attributes:
        number: As the paper numbers it: ``Eq. (14)``, ``Fig. 6``, ``Table I``.
        title: What it is.
        paper: What the paper states, in our words.
        ours: How ccpin computes it, and by which functions.
        compared: What the difference is the difference of.
        difference: The largest found.
        unit: Its unit; empty for numbers.
        bound: What it must not exceed.
        reason: Why that bound: an identity, or the digits the paper prints.
        facts: (name, value) of further numbers, shown with the difference.
        drawings: ccpin's figures.
        rows: A table, the head first.
    """

    number: str
    title: str
    paper: str
    ours: str
    compared: str
    difference: float
    unit: str
    bound: float
    reason: str
    facts: tuple[tuple[str, str], ...] = ()
    drawings: tuple[Drawing, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()

    @property
    def agrees(self) -> bool:
        """Whether the difference is within its bound."""
        return bool(self.difference <= self.bound)

    def as_json(self) -> dict[str, Any]:
        """All but the figures, which are named."""
        plain = {name: value for name, value in self._asdict().items() if name != "drawings"}
        return plain | {"agrees": self.agrees, "drawings": [drawing.name for drawing in self.drawings]}


class Erratum(NamedTuple):
    """What must be read otherwise than it is printed, or was left unsaid.

    Attributes:
        place: Where in the paper.
        printed: What stands there.
        read: How it must be read.
        evidence: What shows it, with numbers computed for the page.
        value: The number the evidence rests on.
    """

    place: str
    printed: str
    read: str
    evidence: str
    value: float


def apart(ours: Array, papers: Array) -> float:
    """The largest |ours − papers|."""
    return float(abs(ours - papers).max(initial=0.0))


def place(degrees: Array | tuple[float, ...], digits: int = 0) -> str:
    """A point of the plane of (q1, q2), in words."""
    return f"({', '.join(f'{angle:.{digits}f}°' for angle in degrees)})".replace("-", "−")
