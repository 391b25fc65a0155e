"""What pages are made of, as HTML: text with indices, tables, tabs, figures as vectors, pages within the page."""

from __future__ import annotations

import base64
import html
import io
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_BEFORE = r"(?:(?<=(?<![A-Za-z])[^\W_])|(?<=[\u0300-\u036f′)]))"  # one letter, an accent, a prime or a bracket
_LOW = r"_(?:\{([^}]*)\}|(q′|[0-9]+|[A-Za-z]+[0-9]*))"
_INDEX = re.compile(_BEFORE + _LOW + r"|\^(?:\{([^}]*)\}|(-?[0-9]+|T))")


def formula(text: str) -> str:
    """Plain text as HTML, escaped; ``x_i``, ``x_{ij}``, ``x^2`` and ``x^{-1}`` are lowered and raised.

    What stands before an index is one letter, or a bracket: `leg_1` stays a name. Names in `backticks` are set as code,
    and nothing within them is an index.
    """
    pieces = re.split(r"`([^`]*)`", text)
    return "".join(
        f"<code>{html.escape(piece)}</code>" if k % 2 else _INDEX.sub(_shifted, html.escape(piece, quote=False))
        for k, piece in enumerate(pieces)
    )


def _shifted(found: re.Match[str]) -> str:
    low = found[1] or found[2]
    return f"<sub>{low}</sub>" if low else f"<sup>{found[3] or found[4]}</sup>"


def paragraphs(*texts: str) -> str:
    """Paragraphs of `formula` text."""
    return "".join(f"<p>{formula(text)}</p>" for text in texts)


def bullets(texts: Sequence[str]) -> str:
    """A list of `formula` texts."""
    return f"<ul>{''.join(f'<li>{formula(text)}</li>' for text in texts)}</ul>"


def preformatted(text: str) -> str:
    """Text as it stands: commands, or what a terminal would show."""
    return f"<pre>{html.escape(text)}</pre>"


def table(head: Sequence[str], rows: Sequence[Sequence[str]], links: Sequence[str] = ()) -> str:
    """A table of `formula` texts; the first cell of row k leads to ``#links[k]`` where links are given."""

    def cell(row: int, column: int, text: str) -> str:
        inner = formula(text)
        if links and column == 0:
            inner = f'<a href="#{html.escape(links[row])}">{inner}</a>'
        return f"<td{' class=number' if _is_number(text) else ''}>{inner}</td>"

    body = "".join(f"<tr>{''.join(cell(r, c, text) for c, text in enumerate(row))}</tr>" for r, row in enumerate(rows))
    top = "".join(f"<th>{formula(text)}</th>" for text in head)
    return f'<div class="wide"><table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>'


def _is_number(text: str) -> bool:
    return re.fullmatch(r"[−+-]?[0-9][0-9.,]*(e[−+-]?[0-9]+)?\s?\S{0,6}", text) is not None


def tabs(name: str, parts: Sequence[tuple[str, str]], chosen: int = 0) -> str:
    """Panels of HTML of which one shows, chosen by its title; works without scripts.

    Args:
        name: Of the group, unique on the page.
        parts: (title, HTML) of each.
        chosen: Which shows at first.
    """
    group = html.escape(name)
    heads = "".join(
        f'<input type="radio" name="{group}" id="{group}-{k}" data-tab="{html.escape(title)}"'
        f'{" checked" if k == chosen else ""}><label for="{group}-{k}">{formula(title)}</label>'
        for k, (title, _) in enumerate(parts)
    )
    panels = "".join(f'<div class="panel">{inner}</div>' for _, inner in parts)
    return f'<div class="tabs">{heads}{panels}</div>'


def figure(drawn: Figure, caption: str, alt: str | None = None) -> str:
    """A matplotlib figure as vectors, embedded; letters are outlines, so that it looks the same everywhere."""
    from matplotlib import rc_context

    written = io.StringIO()
    with rc_context({"svg.fonttype": "path", "svg.hashsalt": "ccpin"}):
        drawn.savefig(written, format="svg", metadata={"Date": None})
    data = base64.b64encode(written.getvalue().encode("utf-8")).decode("ascii")
    words = html.escape(alt or caption)
    return (
        f'<figure><img src="data:image/svg+xml;base64,{data}" alt="{words}" '
        f'style="max-width: {drawn.get_figwidth() * 96:.0f}px"><figcaption>{formula(caption)}</figcaption></figure>'
    )


def embedded(page: str, title: str, height: int = 480) -> str:
    """A whole page within this one, such as an animation; it starts when it comes near the screen."""
    return (
        f'<iframe loading="lazy" title="{html.escape(title)}" style="height: {height}px" '
        f'srcdoc="{html.escape(page)}"></iframe>'
    )
