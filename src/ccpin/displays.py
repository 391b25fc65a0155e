"""What notebooks show of a result: small tables, curves and maps as HTML without scripts."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

import numpy as np

from ccpin.arrays import Array

COLOURS = ("#d55e00", "#0072b2", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Okabe and Ito's, which eyes without red or green cones tell apart too."""
POINTS = 300
"""A curve is drawn through at most so many of its samples."""
BOXES = 4000
"""A map shows at most so many boxes, the largest."""


def table(rows: Iterable[tuple[str, str]]) -> str:
    """Rows of a name and a text."""
    cells = (f"<tr><th>{escape(key)}</th><td>{escape(value)}</td></tr>" for key, value in rows)
    return f"<table>{''.join(cells)}</table>"


def curves(x: Array, ys: Array, names: Sequence[str], width: int = 360, height: int = 120) -> str:
    """Columns of ys (T, k) over x (T,), each with its name in its colour; ys share one scale."""
    every = max(1, len(x) // POINTS)
    x, ys = np.append(x[::every], x[-1]), np.vstack([ys[::every], ys[-1]])
    low, high = float(ys.min(initial=np.inf)), float(ys.max(initial=-np.inf))
    across = (x - x[0]) / ((x[-1] - x[0]) or 1.0) * width
    up = height * (1.0 - (ys - low) / ((high - low) or 1.0))
    lines, words = [], []
    for k, name in enumerate(names):
        colour = COLOURS[k % len(COLOURS)]
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(across, up[:, k], strict=True))
        lines.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.5"/>')
        words.append(f'<span style="color:{colour}">&#9632;</span> {escape(name)}')
    words.append(f"{low:.4g} … {high:.4g}")
    return f"<div>{_svg(lines, width, height)}<br/><small>{', '.join(words)}</small></div>"


def boxes(lower: Array, upper: Array, region: tuple[Array, Array], mark: Array, size: int = 240) -> str:
    """Boxes of two coordinates in their region, (B, 2) each; the second coordinate goes up; a dot marks a point."""
    largest = np.argsort(-np.prod(upper - lower, axis=1), kind="stable")[:BOXES]
    width = region[1] - region[0]
    scale = size / float(width.max())
    place = np.stack([lower[largest, 0] - region[0][0], region[1][1] - upper[largest, 1]], axis=1) * scale
    extent = (upper - lower)[largest] * scale
    drawn = [
        f'<rect x="{x:.2f}" y="{y:.2f}" width="{w:.2f}" height="{h:.2f}" fill="#cfe6d8" stroke="#009e73"'
        ' stroke-width="0.3"/>'
        for (x, y), (w, h) in zip(place, extent, strict=True)
    ]
    dot = (mark - region[0]) * scale
    drawn.append(f'<circle cx="{dot[0]:.2f}" cy="{width[1] * scale - dot[1]:.2f}" r="3" fill="#d55e00"/>')
    return _svg(drawn, float(width[0]) * scale, float(width[1]) * scale)


def _svg(parts: Sequence[str], width: float, height: float) -> str:
    frame = f'<rect width="{width:g}" height="{height:g}" fill="none" stroke="#999"/>'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}" height="{height:g}">{frame}{"".join(parts)}</svg>'
    )
