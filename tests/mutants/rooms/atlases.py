"""Atlases of σ's domain: what they say beside what `proof.facts.prove` has checked; documents and merged ones."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

_RADII = ("domain/atlas/test_sharp_radii.py",)
_ANSWERS = ("domain/atlas/test_sharp_answers_of_atlases.py",)
_FILES = ("domain/documents/test_sharp_documents.py",)
_HALVED = "which cells are tried, how often they are halved, and when a search ends"
_PROPOSED = "boxes and cells that are tried: `proof.facts.prove` checks them, where they lie and how they are glued"
ROOMS: tuple[Room, ...] = (
    Room(
        "domain/atlas/refuting",
        ("domain/atlas/test_sharp_refuting.py",),
        (("still = PPoly(", "", "a walker that stays where it is"),),
    ),
    Room("domain/atlas/cover", _RADII),
    Room(
        "domain/atlas/cover",
        _ANSWERS,
        (
            ("if len(self.boxes.kappa) >= self._budget", "", _HALVED),
            ("stretch[tried] = found.stretch", "", _HALVED),
            ("if not len(self.boxes.kappa) and children.size", "", _HALVED),
        ),
        places=("AtlasBuilder.wave",),
    ),
    Room("domain/atlas/certifying", _ANSWERS, (("if not kept.all()", "", _PROPOSED),)),
    Room("domain/atlas/radius_map", _RADII),
    Room("domain/atlas/square", _RADII),
    Room(
        "domain/atlas/emptying",
        ("domain/atlas/test_sharp_emptying.py",),
        (
            (
                "while searched.size and not search.over",
                "not asked: not search.over",
                "what is over drops nothing more",
            ),
            ("cells = cells[~(leaf & small)]", "not asked: leaf", "what is searched no further stays unreached"),
            ("leaf = tree.child[cells] < 0", "0 let in", "the first cell is nobody's child"),
        ),
    ),
    Room(
        "domain/atlas/atlas",
        _ANSWERS,
        (("if self.single_valued or not count", "not asked: not count", "where no box is none is unglued"),),
    ),
    Room(
        "domain/atlas/atlas",
        ("domain/test_pickled_certificates.py",),
        (
            ("is_fact(fact, SolutionsInBoxes)", "any instead of all", "they are pickled together"),
            ("if self._whole or not", "not asked: self._whole", "where all is certified nothing refutes it"),
        ),
        places=("Atlas.__getstate__", "Atlas._known", "Atlas._boxes_known", "Atlas.witness"),
    ),
    Room("domain/atlas/merged", _ANSWERS),
    Room(
        "domain/documents/checked",
        _FILES,
        (
            (
                "split = np.flatnonzero(child >= 0)",
                "0 left out",
                "the first cell is nobody's child: `halved` refuses it",
            ),
            ("CellStatus.SPLIT, child >= 0", "0 left out", "the first cell is nobody's child: `halved` refuses it"),
        ),
    ),
    Room("domain/documents/kinds", _FILES),
    Room("domain/documents/store", _FILES),
    Room("domain/merging", _FILES),
)

EXCUSED: tuple[Excused, ...] = (
    Excused("domain/atlas/emptying", ("_weights",), "which weights are tried: `Unreachable` asks what they prove"),
    Excused("domain/atlas/atlas", ("Atlas.__repr__", "Atlas._repr_html_", "Atlas.reason", "Atlas._reason"), "words"),
    Excused("domain/atlas/square", ("_SMALLEST", "_LARGEST"), "which widths are tried: each that is told was proved"),
    Excused(
        "domain/atlas/cover",
        (
            "AtlasBuilder.__init__",
            "AtlasBuilder._reach_seed",
            "AtlasBuilder.certify_square",
            "AtlasBuilder.certify_region",
            "AtlasBuilder._halve_undecided",
            "AtlasBuilder._shortest",
            "AtlasBuilder._hopeless",
            "AtlasBuilder._stretch",
            "AtlasBuilder._prove",
            "AtlasBuilder._delta",
            "AtlasBuilder._glued_to_origin",
            "AtlasBuilder._split",
            "AtlasBuilder._spread",
            "AtlasBuilder._propose",
        ),
        _PROPOSED,
    ),
    Excused("domain/atlas/cover_claims", ("seams_of", "_started"), _PROPOSED),
    Excused(
        "domain/atlas/certifying",
        ("_TOLERANCES", "_MANY_DEPTH", "_MANY_TOLERANCE", "certify", "effort_of", "_cover"),
        _HALVED,
    ),
    Excused(
        "domain/documents/kinds",
        ("_CELLS",),
        "how large a whole number of a file may be: `checked_cells` compares each with the halves of the region",
    ),
    Excused("domain/atlas/merged", ("split_region", "_halves"), "how a region is parted"),
    Excused("domain/atlas/merged", ("_between",), _PROPOSED),
    Excused("domain/atlas/merged", ("_refuse_strangers",), "words"),
)
