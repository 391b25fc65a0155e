"""What the documents of this room hold: atlases (workspaces too), sheets and covers of singular curves.

Sizes: p scalar coordinates θ, of which n are independent and m = p − n depend; B boxes, N cells of a tree, T tubes. The
unit ``θ`` is that of the coordinate: rad of one that turns, m of one that slides.
"""

from __future__ import annotations

from ccpin.covering.cells import CellStatus
from ccpin.covering.documents import Document
from ccpin.proof.cell_tree import WHOLE
from ccpin.schemas import Choice, Field, Parts, Schema

_HEADER = {
    "theorem": str,
    "fingerprint": str,
    "names": [str],
    "nq": int,
    "n_free": int,
    "joints": [(str, str, int, int, int, int)],
    "chains": int,
    "rods": [{"place": (int, int), "length": float, "steps_a": [(bool, int)], "steps_b": [(bool, int)]}],
    "planar": bool,
}
_CLOSURES = {
    "system_couplings": Field("f", "m p"),
    "system_offset": Field("f", "m", "θ"),
    "system_moduli": Field("f", "m", "rad", 0),
    "system_independent": Field("i", "n", "", 0, "p"),
    "system_dependent": Field("i", "m", "", 0, "p"),
    "system_periodic": Field("b", "p"),
    "lower": Field("f", "n", "θ"),
    "upper": Field("f", "n", "θ"),
    "wrapped": Field("b", "n"),
}
_CHAIN = {
    "joints": Field("i", "κ", "", 0, "p"),
    "rotations": Field("f", "κ 3 3"),
    "translations": Field("f", "κ 3", "m"),
    "axes": Field("f", "κ 3"),
    "prismatic": Field("b", "κ"),
    "tip": Field("f", "3", "m, or a direction"),
    "direction": Field("b"),
    "weights": Field("f", "m 3"),
}
_JOINT = {"reference": Field("f", "3 3")}
_ROD = {
    "reference": Field("f", "3 3"),
    "frame_a": Field("f", "4 4", "m"),
    "frame_b": Field("f", "4 4", "m"),
    "placements_a": Field("f", "α 4 4", "m"),
    "axes_a": Field("f", "α 3"),
    "placements_b": Field("f", "β 4 4", "m"),
    "axes_b": Field("f", "β 3"),
}
_PARTS = {
    "chain": Parts(lambda header: int(header["chains"]), _CHAIN),
    "joint": Parts(lambda header: len(header["joints"]), _JOINT),
    "rod": Parts(lambda header: len(header["rods"]), _ROD),
}
_DEMANDS = {
    "demand_lower": Field("f", "p", "θ"),
    "demand_upper": Field("f", "p", "θ"),
    "demand_driven": Field("i", "d", "", 0, "p"),
    "demand_units": Field("f", "n", "1 or m", 0),
    "demand_dexterity": Field("f", "", "", 0, 1),
}
_CELLS = {
    "box_centre": Field("f", "B p", "θ"),
    "box_half": Field("f", "B n", "θ", 0),
    "box_directions": Field("f", "B p n"),
    "box_modes": Field("f", "B m m"),
    "box_preconditioner": Field("f", "B m m"),
    "box_radius": Field("f", "B m", "θ", 0),
    "box_weight": Field("f", "B m", "", 0),
    "box_kappa": Field("f", "B", "", 0, 1),
    "tree_lower": Field("i", "N n", "2⁻³² of the region", 0, WHOLE + 1),
    "tree_size": Field("i", "N n", "2⁻³² of the region", 1, WHOLE + 1),
    "tree_cut": Field("i", "N", "", 0, "n"),
    "tree_child": Field("i", "N", "", -1, "N"),
    "tree_status": Field("s", "N", "", 0, len(CellStatus)),
    "tree_box": Field("i", "N", "", -1, "B"),
    "singular_cell": Field("i", "S", "", 0, "N"),
    "singular_theta": Field("f", "S p", "θ"),
}


def _ranges(part: str) -> dict[str, Field]:
    return {
        f"{part}_lower": Field("f", "m", "θ"),
        f"{part}_upper": Field("f", "m", "θ"),
        f"{part}_reasons": Field("s", "m 2", "", 0),
        f"{part}_limits": Field("f", "m 2", "θ"),
    }


ATLAS = Document(
    Schema(
        "an atlas",
        "ccpin-atlas-5",
        _HEADER | {"radius": float, "complete": bool},
        _CLOSURES
        | _CELLS
        | {
            "q0": Field("f", "n", "θ"),
            "seed": Field("f", "p", "θ"),
            "unglued": Field("i", "U 2", "", 0, "B"),
        },
        _PARTS,
        (_DEMANDS,),
    ),
    ("theorem_n", "extended", "folds", "reach", "platform"),
    (("demands", frozenset(_DEMANDS)),),
)
"""Theorems N and S, the triangle inequality and Theorem E; of a workspace Theorem D besides."""

SHEETS = Document(
    Schema(
        "sheets",
        "ccpin-sheets-2",
        _HEADER | {"complete": bool},
        _CLOSURES
        | _CELLS
        | {
            "count": Field("i", "N", "", -1),
            "members_cell": Field("i", "M", "", 0, "N"),
            "members_box": Field("i", "M", "", 0, "B"),
            "glued_first": Field("i", "G", "", 0, "B"),
            "glued_second": Field("i", "G", "", 0, "B"),
            "glued_at_first": Field("f", "G n", "θ"),
            "glued_at_second": Field("f", "G n", "θ"),
            "left_cell": Field("i", "L", "", 0, "N"),
            "left_centre": Field("f", "L p", "θ"),
            "left_half": Field("f", "L p", "θ", 0),
            "left_slopes": Field("f", "L m n"),
        }
        | _ranges("ranges"),
        _PARTS,
    ),
    ("theorem_n", "extended", "folds", "ranges", "narrowing", "counting"),
)
"""Theorems N and S, Lemma R, Propositions N, U and C."""

CURVES = Document(
    Schema(
        "a cover of singular curves",
        "ccpin-curves-2",
        _HEADER | {"tried": int, "limit": Choice((None, "interrupted", "budget")), "resolution": float},
        _CLOSURES
        | {
            "tube_theta": Field("f", "T p", "θ"),
            "tube_kernel": Field("f", "T m"),
            "tube_pairing": Field("f", "T m"),
            "tube_along": Field("i", "T", "", 0, "x"),
            "tube_tangent": Field("f", "T x"),
            "tube_half": Field("f", "T", "", 0),
            "tube_radius": Field("f", "T x", "", 0),
            "uncovered_lower": Field("f", "V p", "θ"),
            "uncovered_upper": Field("f", "V p", "θ"),
            "curve_tubes": Field("i", "C", "", 1),
            "curve_closed": Field("b", "C"),
        }
        | _ranges("range"),
        _PARTS,
    ),
    ("singular_system", "extended", "tubes", "joining", "ranges", "narrowing", "covering"),
)
"""G, Theorem R, Lemmas J and R, Propositions N and U, Lemma W and Proposition B."""
