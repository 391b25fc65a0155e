"""Regions, trees of cells and what waits in them; what only proposes."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

_TESTS = ("covering/test_sharp_regions_cells.py",)
_TRIED = ("covering/test_sharp_tried_boxes.py",)
_CHUNKS = ("covering/test_sharp_chunks.py",)
_BEGUN = "where Newton's method begins and what is tried: `certify_boxes` proves it, who carries a branch on glues it"
ROOMS: tuple[Room, ...] = (
    Room(
        "covering/region",
        _TESTS,
        (
            ("found -= (found > 0.0)", "not asked: found > 0.0", "no point within is below the lower corner"),
            ("found -= (found > 0.0)", "0 let in", "no point within is below the lower corner"),
            ("f\"the region's lower corner", "", "words"),
        ),
    ),
    Room(
        "covering/cells",
        _TESTS,
        (
            ("leaves = np.flatnonzero(self.child < 0)", "0 let in", "no half is the region"),
            ("ended = child < 0", "0 let in", "no half is the region"),
            ("inner = child >= 0", "0 left out", "no half is the region"),
            ("if self._count > len(self._buffers[0])", "", "how much room a buffer has"),
        ),
    ),
    Room("covering/faces", _TESTS),
    Room("covering/pruning", _TESTS),
    Room(
        "covering/merging",
        ("covering/test_sharp_merging.py",),
        (
            ("exact = [k", "not asked: np.array_equal(places[k][0], lower)", "a part lies in the cells it is held for"),
            ("child=np.where(cells.child >= 0", "0 left out", "no half is the region"),
        ),
    ),
    Room(
        "covering/proposals/krawczyk",
        _TRIED,
        (
            ("if not retry.size", "not asked: not retry.size", "what is tried again may be nothing"),
            ("if not retry.size", "not asked: problem.system.m == 1", "`holds` checks what is tried again"),
            ("radius = np.maximum(radius + noise", "", "R of a box that is tried: `holds` checks it"),
            ("candidates = np.flatnonzero", "any instead of all", "R is found in all rows or in none"),
        ),
    ),
    Room("covering/proposals/solving", _TRIED),
    Room(
        "covering/proposals/tasks",
        _TRIED,
        (
            ("theta[:, system.dependent] += apply", "", _BEGUN),
            ("step = cells.centre - cells.start", "", _BEGUN),
            ("settled = at_face.settled & at_centre.settled", "", _BEGUN),
            ("movable & np.isfinite(turns)", "not asked: np.isfinite(turns)", "nothing is proved about no numbers"),
        ),
    ),
    Room("covering/runner", _CHUNKS),
    Room("covering/sources", _CHUNKS),
)

EXCUSED: tuple[Excused, ...] = (
    Excused("covering/region", ("Corners",), "a type"),
    Excused("covering/cells", ("_wider",), "how much room a buffer has: what is too little raises"),
    Excused(
        "covering/proposals/krawczyk",
        ("_INFLATION", "_SETTLED", "_LEAST", "_ROOM", "_LARGEST", "_parametrize", "_one_weak", "_radius"),
        "D, V, Ã and R of a box that is tried: `proof.newton.holds` checks it",
    ),
    Excused("covering/proposals/platforms", (), "which weights are tried: `proof.emptiness.empty_by` checks them"),
    Excused(
        "covering/proposals/solving",
        ("_LARGEST_STEP", "_SETTLED", "_LOST", "_LONGEST", "newton", "extrapolate", "solved"),
        "points near solutions, about which boxes are proved",
    ),
    Excused("covering/proposals/tasks", ("_NEAR",), _BEGUN),
    Excused(
        "covering/runner",
        ("_POLL", "_STALLED", "Runner.within", "Runner._submit", "Runner._result"),
        "how long others are waited for: what they do not give is computed here",
    ),
    Excused("covering/documents", (), "which arrays a file is to hold; what is missing raises when it is read"),
    Excused(
        "covering/claims", (), "`proof.facts.prove_some` checks the boxes, points, seams and zeros that it hands over"
    ),
)
