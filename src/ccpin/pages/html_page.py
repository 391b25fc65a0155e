"""A whole page: its head, its list of contents and its sections, in one file that asks the network for nothing."""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from ccpin.pages.parts import formula

ASSETS = Path(__file__).parent / "assets"
POLICY = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline' blob: data:; " + (
    "img-src data: blob:; font-src data:; worker-src blob:; connect-src data: blob:; frame-src 'self'"
)
"""The page's content security policy: nothing is loaded that is not in the file."""


class Section(NamedTuple):
    """A part of a page.

    Attributes:
        anchor: Its name in addresses: ``#anchor``.
        title: Its heading, as plain text.
        body: HTML, made of `ccpin.pages.parts`.
        inner: (anchor, title) of what the list of contents shows below it.
    """

    anchor: str
    title: str
    body: str
    inner: tuple[tuple[str, str], ...] = ()


def render(title: str, subtitle: str, sections: Sequence[Section]) -> str:
    """The page as HTML.

    Args:
        title: Of the page and its window, as plain text.
        subtitle: A sentence below it.
        sections: In their order.
    """
    contents = "".join(f"<li>{_link(part.anchor, part.title)}{_nested(part.inner)}</li>" for part in sections)
    body = "".join(
        f'<section id="{html.escape(part.anchor)}"><h2>{formula(part.title)}</h2>{part.body}</section>'
        for part in sections
    )
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1"><link rel="icon" href="data:,">'
        f"<title>{html.escape(title)}</title><style>{_asset('page.css')}</style></head>\n"
        f'<body><nav aria-label="Contents"><ul>{contents}</ul></nav><main><header><h1>{html.escape(title)}</h1>'
        f"<p>{formula(subtitle)}</p></header>{body}</main><script>{_asset('page.js')}</script></body></html>\n"
    )


def _link(anchor: str, title: str) -> str:
    return f'<a href="#{html.escape(anchor)}">{formula(title)}</a>'


def _nested(inner: Sequence[tuple[str, str]]) -> str:
    return f"<ul>{''.join(f'<li>{_link(*entry)}</li>' for entry in inner)}</ul>" if inner else ""


def _asset(name: str) -> str:
    return (ASSETS / name).read_text(encoding="utf-8")
