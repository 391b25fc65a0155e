"""The page: a table of all items, the items with tabs "paper / ccpin / difference", the errata, how to repeat it."""

from __future__ import annotations

import re

from ccpin.pages.html_page import Section, render
from ccpin.pages.parts import bullets, figure, formula, paragraphs, preformatted, table, tabs
from ccpin.paper.item import Drawing, Erratum, Item
from ccpin.paper.reproduction import Reproduction

TITLE = "Modeling and Set Point Control of Closed-Chain Mechanisms, recomputed"
SOURCE = (
    "F. H. Ghorbel, O. Chételat, R. Gunawardana, R. Longchamp: Modeling and Set Point Control of Closed-Chain "
    "Mechanisms: Theory and Experiment. IEEE Transactions on Control Systems Technology 8(5), 2000."
)
ABSENT = "(1), (4)–(6), (8), (15), (16), (20), (21), (26), (29), (32), (34)"
_TABS = ("paper", "ccpin", "difference")


def page(found: Reproduction) -> str:
    """The whole page as HTML."""
    sections = [_summary(found)]
    for title, items in found.chapters:
        body = "".join(_item(item) for item in items)
        inner = tuple((anchor(item), f"{item.number} {item.title}") for item in items)
        sections.append(Section(_slug(title), title, _switch() + body, inner))
    sections += [_errata(found.errata), _repeat(found)]
    return render(TITLE, SOURCE, sections)


def anchor(item: Item) -> str:
    """The item's name in addresses."""
    return _slug(item.number)


def _slug(text: str) -> str:
    known = text.replace("𝒱", "V").replace("𝒟", "D").replace("ψ_q′", "psi")
    return re.sub(r"[^a-z0-9]+", "-", known.lower()).strip("-")


def size(value: float, unit: str) -> str:
    """A difference with its unit, in few digits."""
    if value == 0.0:
        return "0"
    digits = f"{value:.1e}" if value < 1e-3 else f"{value:.3g}"
    return f"{digits}{'' if unit == '°' else ' '}{unit}".strip()


def _summary(found: Reproduction) -> Section:
    items = found.items
    rows = [
        (item.number, item.title, size(item.difference, item.unit), size(item.bound, item.unit), item.reason)
        for item in items
    ]
    agreeing = sum(item.agrees for item in items)
    words = (
        f"{agreeing} of {len(items)} items agree with the paper within the bounds stated beside them. Each is "
        "computed anew when this page is made: nothing on it is a stored result. The printed side is written out from "
        "the paper's formulas with NumPy alone and imports nothing of what it is compared with.",
        f"ccpin cites the equations below by their numbers. The paper's other numbers, {ABSENT}, are not cited by it, "
        "and nothing is claimed about them here.",
    )
    head = ("item", "what", "largest difference", "bound", "why that bound")
    return Section(
        "summary", "All numbered items", paragraphs(*words) + table(head, rows, [anchor(item) for item in items])
    )


def _switch() -> str:
    buttons = "".join(f'<button type="button" data-all="{name}">{name}</button>' for name in _TABS)
    return f'<p class="switch">Show everywhere: {buttons}</p>'


def _item(item: Item) -> str:
    name = anchor(item)
    ours = paragraphs(item.ours) + "".join(_drawing(drawing) for drawing in item.drawings)
    if item.rows:
        ours += table(item.rows[0], item.rows[1:])
    verdict = "within" if item.agrees else "NOT within"
    rows = [
        ("compared", item.compared),
        ("largest difference", size(item.difference, item.unit)),
        ("bound", f"{size(item.bound, item.unit)}: {item.reason}"),
        ("verdict", f"{verdict} the bound"),
        *item.facts,
    ]
    panels = (paragraphs(item.paper), ours, table(("", ""), rows))
    return (
        f'<article id="{name}"><span class="badge">Δ {formula(size(item.difference, item.unit))}</span>'
        f"<h3>{formula(item.number)} · {formula(item.title)}</h3>"
        f"{tabs(name, tuple(zip(_TABS, panels, strict=True)), chosen=1)}</article>"
    )


def _drawing(drawing: Drawing) -> str:
    return figure(drawing.figure, drawing.caption)


def _errata(found: tuple[Erratum, ...]) -> Section:
    rows = [(one.place, one.printed, one.read, one.evidence) for one in found]
    words = "What must be read otherwise than it is printed, or is left unsaid, each with what was computed to show it."
    return Section(
        "errata", "Errata and readings", paragraphs(words) + table(("where", "printed", "read", "evidence"), rows)
    )


def _repeat(found: Reproduction) -> Section:
    body = preformatted("pip install 'ccpin[validated]'\nccpin paper -o paper.html\nccpin paper --json")
    body += bullets([f"{name}: `{value}`" for name, value in found.versions])
    body += paragraphs(f"Computed in {found.seconds:.0f} s, of which the slowest: {found.slowest}.")
    return Section("repeat", "To repeat this page", body)
