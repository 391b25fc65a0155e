"""The checker that stands alone."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

_LOOKS = ("auditing/test_sharp_looks.py",)
ROOMS: tuple[Room, ...] = (
    Room("auditing/reading", _LOOKS, places=("widened", "WIDEN")),
    Room(
        "auditing/boxes",
        ("auditing/test_sharp_cover_of_boxes.py",),
        (("if not np.all(part > 0)", "0 let in", "room is a rounding below what is left, and so not 0"),),
        places=("_ROOM", "box_proved", "unproved", "_misses", "holds", "_one_in_tube"),
    ),
    Room(
        "auditing/workspace",
        ("auditing/test_sharp_cover_of_boxes.py",),
        (
            ("if demands is None or found", "not asked: demands is None", "asked before"),
            ("max(b - x, x - a)", "min instead of max", "radii of balls are rounded up by more than a middle"),
            ("if not (u < 1 and v < 1)", "", "the root of a negative number is none, and bounds nothing"),
            ("np.all(np.isfinite(T))", "isfinite", "T ≥ F + MT fails where something is no number"),
            ("np.all(np.isfinite(T))", "T > 0.0", "T ≥ F + MT and M contracts: T is nowhere negative"),
            ("np.all(np.isfinite(T))", "any instead of all", "as for its parts"),
            ("np.all(np.isfinite(T))", "0 let in", "as for its parts"),
        ),
    ),
    Room("auditing/gluing", ("auditing/test_sharp_cover_of_boxes.py",)),
    Room(
        "auditing/boxes",
        (*_LOOKS, "proof/test_sharp_every.py", "auditing/test_sharp_every_row.py"),
        (
            ("np.isfinite(rough)", "any instead of all", "no weight is positive where an entry is infinite"),
            ("weight = np.linalg.solve", "", "any w > 0 will do: it is checked below"),
            ("np.all(weight > 0)", "0 let in", "Mw < w fails where an entry of w is 0"),
        ),
    ),
    Room(
        "auditing/structure",
        ("auditing/test_sharp_structure.py",),
        (("np.linalg.det(rotations) > 0.0", "0 let in", "of an orthogonal matrix it is 1 or −1"),),
    ),
    Room(
        "auditing/declared",
        ("auditing/test_sharp_declared.py",),
        (
            ("abs(value) < np.inf", "left × 0.5", "half of what is infinite is"),
            ("known = letter if", "letter.isdigit()", "nothing asks what a digit stands for"),
            ("m >= 1 and n >= 1", "left × 2", "they are whole numbers"),
            ("tubes are not of the", "", "words"),
        ),
    ),
    Room(
        "auditing/tiling",
        ("auditing/test_sharp_tiling.py",),
        (
            ("not np.any(reached[level]) and", "", "halves of disjoint cells are disjoint: none is reached twice"),
            ("child < 0", "0 let in", "the first cell is nobody's child"),
            ('["tree_child"] < 0', "0 let in", "the first cell is nobody's child"),
            ("np.flatnonzero(leaf & ", "not asked: leaf", "cells with children are called split, as was asked"),
            ("certified, empty = leaf", "not asked: leaf", "cells with children are called split, as was asked"),
            ("np.where(wrapped, width, 1.0)", "1 × ", "the remainder of what does not close on itself is not used"),
            ("np.where(width > 0.0, width, 1.0)", "1 × ", "nor are turns of it"),
        ),
    ),
    Room(
        "auditing/reading",
        ("auditing/test_sharp_tiling.py",),
        (
            ("rest |= _claimed(arrays)", "", "without either there is no document"),
            ('["tree_child"] < 0', "0 let in", "the first cell is nobody's child"),
            ("np.all(sizes >= 1)", "left × 2", "they are whole numbers"),
        ),
    ),
    Room(
        "auditing/empty_cells",
        ("auditing/test_sharp_searches.py",),
        (("phi[i, 0].contains(0) for i", "any instead of all", "rows are asked again when they are solved"),),
    ),
    Room(
        "auditing/singular_curves",
        ("auditing/test_sharp_curves.py",),
        (
            ("if abs(gap) > reach and", "not turning[k] or abs(gap) + reach", "follows where |gap| ≤ π"),
            ("if abs(gap) > reach and", "abs(gap) + reach < 2", "follows where |gap| ≤ π, but for a rounding"),
            ("if abs(gap) > reach and", "without reach", "follows where |gap| ≤ π, but for a rounding"),
            ("if abs(gap) > reach and", "without abs(gap)", "follows where |gap| ≤ π, but for a rounding"),
        ),
    ),
    Room(
        "auditing/slanted",
        ("auditing/test_sharp_curves.py",),
        (
            ("np.any((smaller.high - smaller.low)", "", "how often it is narrowed"),
            ("if not np.all(np.isfinite(rough))", "", "which u is proposed: it is checked below"),
            ("u = np.linalg.solve(", "", "any u will do: it is checked below"),
            ("if not np.all(u > 0.0)", "", "|p| + |1 − PA|u ≤ u fails where u is negative"),
            ("half[box.along] = 0.0", "", "half of nothing is the least number there is"),
            ("u = u * (1.0 + 1e-6)", "", "any u will do: it is checked below"),
        ),
    ),
    Room(
        "auditing/exclusion",
        ("auditing/test_sharp_curves.py",),
        (
            ("phi[i, 0].contains(0) for i", "any instead of all", "less is left out; rows are asked again below"),
            ("if low[j] > high[j]", "left × 2", "what a row that holds 0 is solved for meets the box"),
        ),
    ),
    Room(
        "auditing/legs",
        ("auditing/test_sharp_platform.py",),
        (
            ('b"".join(', "without bytes", "bytes of other numbers of rows and joints are not as many"),
            ("if not np.all(np.isfinite(T))", "any", "what is no number violates nothing below"),
            ("return bool(least > 0)", "0 let in", "lengths are uncertain: no ball is 0 alone"),
            ("total.union(least if least > 0", "0 let in", "0 either way"),
        ),
    ),
    Room("auditing/audit", ("auditing/test_sharp_audit.py",)),
    Room("auditing/findings", ("auditing/test_sharp_audit.py",)),
    Room(
        "auditing/looking",
        ("auditing/test_sharp_audit.py",),
        (("if found and seeded", "not asked: found", "nothing is the seed where nothing was found"),),
    ),
    Room(
        "auditing/wording",
        (
            "auditing/test_sharp_audit.py::test_what_is_claimed_in_words",
            "auditing/test_sharp_audit.py::test_what_is_not_looked_at_in_words",
        ),
    ),
    Room(
        "auditing/container",
        ("auditing/test_sharp_audit.py::test_numbers_of_a_file_are_finite",),
        (("not a readable certificate", "", "words"),),
    ),
    Room(
        "auditing/counts",
        ("auditing/test_sharp_searches.py",),
        (("if left <= 0", "0 left out", "how long is searched"),),
    ),
    Room(
        "auditing/singular_points",
        ("auditing/test_sharp_searches.py",),
        (
            ("inverse: Array = np.zeros", "", "overwritten"),
            ("theta[q] = start + along * direction", "", "proposed: what Newton's method found is checked below"),
            ("if not np.all(np.isfinite(step))", "any", "what is no number is within no radius below"),
            ("np.max(np.abs(step)) < 1e-12", "", "when Newton's method is ended: what it found is checked below"),
            ("for factor in (2.0, 16.0, 256.0)", "", "which balls are tried"),
            ("r = factor * max(size, 1e-15)", "1e-15", "which balls are tried"),
            ("max(float(np.linalg.norm(normal)), 1e-300)", "1e-300 ×", "along a normal of zeros there is no line"),
        ),
    ),
    Room("auditing/closures", ("auditing/test_sharp_closures.py",)),
    Room(
        "auditing/lengths",
        ("auditing/test_sharp_lengths.py",),
        (("if x > 0 else arb(0)", "0 let in", "the root of 0 is 0"),),
    ),
    Room(
        "auditing/reach",
        ("auditing/test_sharp_lengths.py",),
        (("turn.joint in self.unbounded", "not asked: turn.prismatic", "what has no bounds slides"),),
    ),
    Room(
        "auditing/stated_ranges",
        ("auditing/test_sharp_lengths.py",),
        (
            ("self._ours = ", "~free", "what turns freely is neither coupled nor slides"),
            ("self._ours = ", "not asked: np.isin", "the lemma holds for intervals of q too"),
            ("np.isfinite(self.low[others])", "", "the image of what has no end has none"),
            ("unknown = [", "", "which slides are bounded together: each bound is proved"),
            ("if not own or", "not asked: not own", "nothing asks of no slides"),
            ("if least > _LEAST", "least > _LEAST", "the minors prove λ, and a root that is no number bounds nothing"),
            ("if least > _LEAST", "0 let in", "axes are within their roundings: no minor is 0 alone"),
        ),
    ),
    Room(
        "auditing/gluing",
        (*_LOOKS, "auditing/test_sharp_audited_tubes.py", "auditing/test_sharp_every_row.py"),
        (
            ("np.isfinite(inverse)", "", "what is no number is within no radius below"),
            ("np.isfinite(theta)", "", "what is no number is within no radius below"),
            ("initial=0.0) < 1e-13", "", "when Newton's method is ended: what it found is checked below"),
            ("rest < 1.0 and", "rest < 1.0", "follows from size + rest radius < radius"),
            ("rest < 1.0 and", "1 × 1.1", "follows from size + rest radius < radius"),
            ("rest < 1.0 and", "1 × 2", "follows from size + rest radius < radius"),
        ),
        places=("near", "in_tube"),
    ),
)

EXCUSED: tuple[Excused, ...] = (
    Excused(
        "auditing/container",
        ("_listed", "_of_npz", "_of_npy"),
        "how arrays are read, and within which time and memory: of whatever is read every claim is checked",
    ),
    Excused(
        "auditing/legs", ("_spread", "_best", "_EndBalls.moves"), "proposes λ and T: the lemma holds whatever they are"
    ),
    Excused("auditing/singular_curves", ("_BACK",), "where the other zero of a gluing is sought: both are proved"),
    Excused("auditing/slanted", ("_PASSES", "_GAIN"), "how often a slanted box is narrowed"),
    Excused(
        "auditing/exclusion",
        (
            *("_FINE", "_CELL", "_BUDGET", "_LEAST", "_SLOPES", "_SLANTED", "_NEAR", "_FAR", "_BESIDE"),
            *("_SHRUNK", "_HELD", "Exclusion._steepest", "Exclusion._near", "Exclusion._face"),
        ),
        "in what order boxes are cut and where, and which tubes are tried: what is left out is proved",
    ),
    Excused(
        "auditing/empty_cells",
        (
            "_WIDE",
            "_SLOPES",
            "_SHRUNK",
            "_CUT",
            "_FINE",
            "Emptiness.steepest",
            "Emptiness._between",
            "Emptiness._moves",
        ),
        "in what order boxes are halved, and where something is tried: what is dropped and kept is proved",
    ),
    Excused("auditing/boxes", ("_PARTS", "_NEWTON", "_ROUNDS"), "how often something is tried"),
    Excused("auditing/boxes", ("_solution",), "proposes where a part is, which is in the tube and is proved"),
    Excused(
        "auditing/stated_ranges",
        ("_ROUNDS", "_GAIN", "_CoordinateIntervals.found"),
        "when narrowing ends: each step of it is proved, and none is taken back",
    ),
    Excused("auditing/stated_ranges", ("_LEAST", "_SLACK"), "which λ is proposed: that UᵀU − λ is positive is checked"),
)
