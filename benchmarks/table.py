"""Figures as one table of text: a block a part, a row a subject and quantity, a column for each who computed it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from benchmarks.measured import Measured


def table(figures: Sequence[Measured]) -> str:
    """The whole table; the ratio to the peer stands in brackets, an absent figure is a dash."""
    parts = dict.fromkeys(each.part for each in figures)
    return "\n\n".join(_block(part, [each for each in figures if each.part == part]) for part in parts)


def markdown(figures: Sequence[Measured]) -> str:
    """One part's figures as a Markdown table."""
    head, rows = _cells(figures)
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def notes(figures: Iterable[Measured]) -> list[str]:
    """What is to be said of single figures, once each."""
    said = (f"{each.subject}, {each.quantity}, {each.who}: {each.note}" for each in figures if each.note)
    return list(dict.fromkeys(said))


def amount(value: float | None, unit: str) -> str:
    """A figure with its unit, seconds in the unit that suits."""
    if value is None:
        return "–"
    if unit == "s":
        scale, name = next(
            (pair for pair in ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs")) if value >= pair[0]), (1e-6, "µs")
        )
        return f"{value / scale:.3g} {name}"
    if unit in ("rad", "m") or (unit == "" and 0 < abs(value) < 1e-3):
        return f"{value:.1e} {unit}".rstrip()
    text = f"{value:.0f}" if abs(value) >= 100 or value == int(value) else f"{value:.3g}"
    return f"{text} {unit}".rstrip()


def _cell(figure: Measured | None) -> str:
    if figure is None:
        return ""
    text = amount(figure.value, figure.unit)
    return text if figure.ratio is None else f"{text} ({figure.ratio:.2f})"


def _cells(figures: Sequence[Measured]) -> tuple[list[str], list[list[str]]]:
    """Head and rows: a column for each who, or for each quantity where that is the narrower table."""
    who, quantities = (list(dict.fromkeys(each[k] for each in figures)) for k in (3, 2))
    across, down = ("who", "quantity") if len(quantities) < len(who) else ("quantity", "who")
    columns = quantities if across == "who" else who
    found = {(each.subject, getattr(each, across), getattr(each, down)): each for each in figures}
    keys = list(dict.fromkeys(key[:2] for key in found))
    rows = [[*key, *(_cell(found.get((*key, column))) for column in columns)] for key in keys]
    return ["of", "who" if across == "who" else "what", *columns], rows


def _block(part: str, figures: Sequence[Measured]) -> str:
    head, rows = _cells(figures)
    widths = [max(len(line[k]) for line in (head, *rows)) for k in range(len(head))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)) for line in (head, *rows)]
    said = [f"  {note}" for note in notes(figures)]
    return "\n".join([f"== {part}", *(line.rstrip() for line in lines), *said])
