"""The picture of the rooms: who stands on whom, as the imports have it.

``python -m tests.support.house docs/house.svg`` draws it again after rooms have changed; a test holds that it is true.
"""

import sys
from pathlib import Path
from typing import NamedTuple

from matplotlib.patches import FancyArrowPatch

from ccpin.plotting import save
from ccpin.plotting.style import COLOURS, drawing
from tests.support.imports import MODULES, graph, room

FOUNDATIONS = "foundations"
BASE = {"errors", "arrays", "files", "containers", "schemas", "displays", "work"}
FILES, MODEL, PROOFS, MOTION, PEOPLE = range(5)


class Place(NamedTuple):
    """Where a room stands, what lives in it in a few words, and its colour."""

    x: float
    words: str
    colour: int


PLACES = {
    FOUNDATIONS: Place(0.0, "errors, arrays, files, schemas, work", FILES),
    "description": Place(0.0, "what a file says; two tables", FILES),
    "kinematics": Place(0.0, "φ, α, σ, ρ", MODEL),
    "mechanism": Place(0.0, "closed, analysed, frozen", MODEL),
    "native": Place(0.0, "the same numbers, compiled", MODEL),
    "dynamics": Place(0.0, "D, C, g of the reduced model; State", MODEL),
    "proof": Place(-1.05, "the kernel: theorems, checked", PROOFS),
    "covering": Place(-1.0, "cells, runner, proposals", PROOFS),
    "domain": Place(-0.5, "atlas, sheets, curves, paths", PROOFS),
    "control": Place(0.0, "laws, references, stability", MOTION),
    "programs": Place(-0.85, "recorded once, evaluated anywhere", MODEL),
    "validated": Place(-1.3, "enclosures of motions and programs", PROOFS),
    "identification": Place(-2.1, "from logs to constants", MODEL),
    "auditing": Place(-2.05, "certificates checked anew", PROOFS),
    "simulation": Place(0.0, "events, plant, integration", MOTION),
    "plotting": Place(0.0, "figures", PEOPLE),
    "visualization": Place(1.1, "MeshCat pages, films", PEOPLE),
    "pages": Place(-2.0, "offline HTML", PEOPLE),
    "studio": Place(0.65, "driven by hand", PEOPLE),
    "transmission": Place(-2.1, "from motors to joints", MODEL),
    "paper": Place(-1.4, "the paper recomputed", PEOPLE),
    "report": Place(0.0, "a page about a mechanism", PEOPLE),
    "gym": Place(1.1, "Gymnasium environments", PEOPLE),
}


def imports():
    """Which room imports which, in pairs; the smallest rooms are one."""
    pairs = {(_placed(room(module)), _placed(room(name))) for module in MODULES for name in graph()[module]}
    return {(above, below) for above, below in pairs if above != below and {above, below} <= {*PLACES}}


def needed(pairs):
    """The pairs without those that follow from others: a room stands on what it imports, and on what that stands on."""
    under: dict[str, set[str]] = {}
    for name in sorted(PLACES, key=floors(pairs).__getitem__):
        own = {below for above, below in pairs if above == name}
        under[name] = own.union(*(under[below] for below in own))
    return {
        (above, below)
        for above, below in pairs
        if not any(below in under[other] for top, other in pairs if top == above)
    }


def floors(pairs):
    """How high each room stands: one more than the highest it imports."""
    below = {name: {b for a, b in pairs if a == name} for name in PLACES}
    heights: dict[str, int] = {}
    while len(heights) < len(below):
        ready = [name for name in below if name not in heights and below[name] <= {*heights}]
        heights |= {name: 1 + max((heights[b] for b in below[name]), default=-1) for name in ready}
    return heights


def draw(path):
    """Write the picture; its arrows carry their names as ids."""
    pairs = needed(imports())
    height = floors(pairs)
    with drawing("", (10.0, 9.0)) as figure:
        axes = figure.add_subplot()
        axes.set_axis_off()
        axes.set_xlim(-2.5, 1.6)
        axes.set_ylim(-0.6, max(height.values()) + 0.6)
        boxes = {}
        for name, place in PLACES.items():
            frame = {
                "boxstyle": "round,pad=0.45",
                "facecolor": "white",
                "edgecolor": COLOURS[place.colour],
                "linewidth": 1.6,
            }
            text = f"{name}\n{place.words}"
            at = place.x, height[name]
            boxes[name] = axes.text(*at, text, ha="center", va="center", fontsize=8.5, linespacing=1.35, bbox=frame)
        figure.canvas.draw()  # the boxes have their sizes then
        for above, below in sorted(pairs):
            ends = [(PLACES[name].x, height[name]) for name in (above, below)]
            patches = [boxes[name].get_bbox_patch() for name in (above, below)]
            arrow = FancyArrowPatch(*ends, patchA=patches[0], patchB=patches[1], shrinkA=1, shrinkB=2, zorder=0,
                                    arrowstyle="-|>", mutation_scale=11, color="#8a939c")  # fmt: skip
            arrow.set_gid(arrow_id(above, below))
            axes.add_patch(arrow)
    save(figure, path)


def arrow_id(above, below):
    """What an arrow is called in the picture."""
    return f"{above}-on-{below}"


def _placed(name):
    return FOUNDATIONS if name in BASE else name


if __name__ == "__main__":
    draw(Path(sys.argv[1]))
