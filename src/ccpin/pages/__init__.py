"""Written pages: one self-contained HTML file with tables, figures and animations, read offline."""

from __future__ import annotations

from ccpin.pages.html_page import Section, render
from ccpin.pages.parts import bullets, embedded, figure, formula, paragraphs, preformatted, table, tabs
from ccpin.pages.provenance import versions

__all__ = [
    "Section",
    "bullets",
    "embedded",
    "figure",
    "formula",
    "paragraphs",
    "preformatted",
    "render",
    "table",
    "tabs",
    "versions",
]
