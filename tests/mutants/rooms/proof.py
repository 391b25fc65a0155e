"""The kernel: rounding, bounds over boxes, one interval Newton, narrowing."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

_EVERY = "proof/test_sharp_every.py"
_ROOT = "no part is the region: its cell would have two parents"
_CHAINS = ("proof/test_sharp_chains.py",)
_BOUNDS = ("proof/test_sharp_bounds.py", _EVERY)
ROOMS: tuple[Room, ...] = (
    Room("proof/facts", ("proof/test_sharp_facts.py",)),
    Room(
        "proof/solutions",
        ("proof/test_sharp_solutions.py",),
        (
            ("_PI_OFF = ", "8.5 × 1.1", "more room for rounding"),
            ("_PI_OFF = ", "8.5 × 2", "more room for rounding"),
            ("plain = tubes.plain[self.first] &", "", "which pairs are computed together: `_agree` looks at each"),
        ),
    ),
    Room(
        "proof/covers",
        ("proof/test_sharp_regions.py",),
        (
            ("tree.reached & (self.child < 0)", "0 let in", _ROOT),
            (
                'not len(found["unglued"]) and len(found["seed"])',
                "not asked: len(found['seed'])",
                "without one no box is reached",
            ),
            ("np.minimum(ahead, back)", "", "either tells the pair"),
            ("require(count**2 < 2**62", "left × 0.5", "a number of 64 bits has room for twice as many"),
        ),
    ),
    Room(
        "proof/exhausted",
        ("proof/test_sharp_unreachable.py",),
        (("require((self.cell < len(self.child))", "0 let in", "no half is the region"),),
        places=("Unreachable.examined",),
    ),
    Room("proof/candidates", ("proof/test_sharp_waiting.py",)),
    Room(
        "proof/exhausted",
        ("proof/test_sharp_exhausted.py",),
        (
            ("leaves = self.child[waiting.cell] < 0", "0 let in", _ROOT),
            ("empty = tree.reached & (self.child < 0)", "0 let in", _ROOT),
            ("np.flatnonzero(reached & (child >= 0))", "0 left out", _ROOT),
            ("np.flatnonzero(reached & (child < 0) & leaves)", "0 let in", _ROOT),
            ("cells = above[(above >= 0)", "not asked: ~asked", "cells above are gone through once more"),
        ),
    ),
    Room(
        "proof/solution_counts",
        ("proof/test_sharp_counts.py",),
        (
            ("near = np.all(", "", "which boxes are tried for a candidate: `alone_in` proves what is said of them"),
            ("gap = np.abs(waiting.centre", "", "as for `near`"),
            ("rows = np.flatnonzero(near & ~done)", "not asked: near", "as for `near`"),
            ("self.child[self.cell] < 0", "0 let in", _ROOT),
            ("inner = np.flatnonzero(child >= 0)", "0 left out", _ROOT),
            ("cells = np.flatnonzero((child < 0)", "0 let in", _ROOT),
            ("cells = np.flatnonzero((child < 0)", "0 left out", _ROOT),
            ("cells = cells[self.child[cells] >= 0]", "0 left out", _ROOT),
        ),
    ),
    Room("proof/covers", ("proof/test_sharp_covers.py",), places=("one_function",)),
    Room("proof/cell_tree", ("proof/test_sharp_regions.py",)),
    Room(
        "proof/paths",
        ("proof/test_sharp_paths.py",),
        (
            ("len(times) > 1 and", "not asked: len(times) > 1", "no stretch has no box that carries the start"),
            ("len(times) > 1 and", "len(times) > 1: left", "no stretch has no box that carries the start"),
            ("(1.0 + 8.0 * UNIT_ROUNDOFF)", "8 × 0.9", "1 + 7.2u is 1 + 8u as a double"),
            ("(1.0 + 8.0 * UNIT_ROUNDOFF)", "8 × 1.1", "1 + 8.8u is 1 + 8u as a double"),
        ),
    ),
    Room("proof/demanded", ("proof/test_sharp_demands.py",)),
    Room(
        "proof/requirements",
        ("proof/test_sharp_demands.py",),
        (
            ("rows.size and demands.driven.size", "rows.size", "of no boxes nothing is asked"),
            ("spread = np.linalg.solve(", "", "any T > 0 will do: it is checked below"),
        ),
    ),
    Room(
        "proof/newton",
        ("proof/test_sharp_newton.py",),
        (
            ("_ROUNDED = ", "", "room in the κ of proposals, beside the factors that are checked"),
            ("SLACK * SLACK + _ROUNDED", "without _ROUNDED", "as for the number"),
            ("plain = np.all(boxes.modes", "", "which boxes are bounded together"),
            ("np.flatnonzero(alike & ~found.proved)", "not asked: alike", "which boxes are bounded together"),
            ("weight = np.abs(solve_many(", "", "any w > 0 will do: κ is what it shows"),
            ("weight[going] /= weight", "", "any w > 0 will do: κ is what it shows"),
            ("0.5 * (weight + shrunk)", "", "any w > 0 will do: κ is what it shows"),
            ("going = ~(kappa", "", "when a search for a better w ends"),
            ("if not going.any()", "", "when a search for a better w ends"),
            ("worse = np.flatnonzero(inside &", "not asked: inside", "elsewhere the step is K's already"),
        ),
    ),
    Room("proof/chains", _CHAINS),
    Room("proof/tips", _CHAINS),
    Room("proof/equations", _CHAINS),
    Room(
        "proof/phasors",
        _CHAINS,
        (
            ("if normal is None or not np.any(signs)", "not asked: normal is None", "before a turn no sign is set"),
            (
                "if normal is None or not np.any(signs)",
                "not asked: not np.any(signs)",
                "a link that no joint turns is still",
            ),
        ),
        places=("_PARALLEL", "phasors_of", "_resolve", "_add_link", "phasor_values"),
    ),
    Room("proof/balls", _CHAINS, places=("Affine.__sub__", "stacked", "cross")),
    Room(
        "proof/narrowing",
        ("proof/test_sharp_candidates.py",),
        (
            ("better = _size(", "", "which of two boxes that hold the same is kept"),
            ("useful = np.flatnonzero(", "", "which slope is taken: the box is as wide as that asks"),
            ("np.flatnonzero(regular & ~gone)", "not asked: ~gone", "what is empty stays where it may be singular"),
        ),
    ),
    Room("proof/emptiness", ("proof/test_sharp_emptiness.py",)),
    Room("proof/rounding", _BOUNDS, (("SLACK = ", "1e-10 × 1.1", "more room for rounding"),)),
    Room("proof/bounds", _BOUNDS),
    Room("proof/taylor", ("proof/test_sharp_taylor.py", *_BOUNDS)),
    Room("proof/reach_bounds", _BOUNDS),
    Room(
        "proof/newton",
        _BOUNDS,
        (
            ("np.isfinite(bounds.y + image + shrunk)", "without image", "a Z̄ that is no number fails (N1) too"),
            ("np.isfinite(bounds.y + image + shrunk)", "without shrunk", "a Z that is no number fails (N2) too"),
            (
                "np.isfinite(bounds.y + image + shrunk)",
                "any instead of all",
                "what is no number fails (N1) or (N2) too",
            ),
        ),
        places=("holds", "frame_of", "reached", "noise_of"),
    ),
    Room(
        "proof/newton",
        ("proof/test_sharp_newton.py", *_BOUNDS),
        (("+ roundings * (unit + size", "without unit", "u of the tube's radius: far below `SLACK`"),),
        places=("in_tubes", "encloses", "without_turns"),
    ),
    Room("proof/phasors", ("proof/test_sharp_phasors.py",)),
    Room(
        "proof/balls",
        ("proof/test_sharp_balls.py", _EVERY),
        (
            ("self.defect) @ (size + _TINY)", "without _TINY", "any bound will do: it is checked below"),
            ("weight = solve_many(identity - defect", "", "any w > 0 will do: it is checked below"),
            ("(weight > 0.0) & (shrunk < weight)", "0 let in", "Ew < w fails where an entry of w is 0"),
            ("np.isfinite(defect)", "not asked: np.isfinite", "Ew < w fails where E is no number"),
            ("np.isfinite(defect)", "any instead of all", "Ew < w fails where E is no number"),
            (
                "held = self.regular & np.all(",
                "any instead of all",
                "the bound solves it, to rounding",
            ),
            ("if len(a.lin) and len(b.lin)", "not asked", "the sum over no parameters is zero"),
        ),
    ),
    Room("proof/equations", _BOUNDS, places=("third_bound",)),
    Room(
        "proof/narrowing",
        ("proof/test_sharp_narrowing.py", _EVERY),
        (
            ("weight = 0.5 * (weight", "", "any w > 0 will do: it is checked below"),
            ("alone & np.isfinite", "not asked: np.isfinite", "Zw < w fails where Z is no number"),
            ("alone & np.isfinite", "any instead of all", "Zw < w fails where Z is no number"),
        ),
        places=("alone_in",),
    ),
    Room("proof/rounding", ("proof/test_sharp_solutions.py",), places=("TURN",)),
    Room(
        "proof/rounding",
        ("proof/test_rounding.py::test_sums_and_products_are_exact",),
        (("moved = a * 134217729.0", "× 0.9", "halves of 26 bits and 27 have exact products too"),),
        places=("sum_of", "product_of", "_halves"),
    ),
    Room(
        "proof/cell_tree",
        ("proof/test_sharp_covers.py",),
        (
            ("ended = (child[pairs.upper] < 0)", "0 let in", _ROOT),
            ("tree.reached & (child >= 0)", "0 left out", _ROOT),
            ("first = child[pairs.upper] >= 0", "0 left out", _ROOT),
        ),
        places=("tree_of", "LeafFaces.turns", "faces_of", "_parted"),
    ),
    Room(
        "proof/digests",
        ("proof/test_sharp_digests.py",),
        (
            ("bool | int | str", "not asked: bool", "a bool is an int"),
            ("elif not callable(value) or", "not asked: not callable", "what has no attributes is refused below"),
            ("if ours and theirs and", "not asked: ours", "follows from the other two"),
            ("if ours and theirs and", "not asked: theirs", "follows from the other two"),
        ),
    ),
    Room(
        "proof/ranges",
        ("proof/test_lemma_r.py", "proof/test_sharp_exhausted.py"),
        (
            ("_ORTHONORMAL", "1e-09 × ", "what is so far from I changes lengths by less than ranges are widened"),
            ("<= _ORTHONORMAL", "left × 0.5", "as for the number"),
            ("self._dependent = ", "~self.turning", "what turns is neither coupled nor slides"),
            ("self._dependent = ", "not asked: np.isin", "the lemma holds for intervals of q too"),
            ("if least < _LEAST_SEEN", "left", "any σ > 0 bounds; which bounds are worth a search"),
            ("if not own or", "not asked: not own", "nothing asks of no slides"),
            ("[*exact, whole or", "not asked: whole", "W = 1 sees vectors as long as ‖W‖ times them"),
            ("seen > 0.0", "", "0 · ∞ is no number, which bounds nothing"),
        ),
    ),
)

EXCUSED: tuple[Excused, ...] = (
    Excused("proof/exhausted", ("_AT_ONCE",), "sizes of work"),
    Excused(
        "proof/candidates",
        ("_RATIO", "_CURVED", "_FLOOR", "_LEAST", "to_halve", "steepness", "rows_to_halve_for"),
        "which candidates are halved, and where: both halves are kept",
    ),
    Excused(
        "proof/ranges", ("_ROUNDS", "_GAIN", "_Intervals.narrow"), "when narrowing ends: each step of it is proved"
    ),
    Excused(
        "proof/solution_counts",
        ("_NEAR",),
        "which boxes are tried for a candidate: `alone_in` proves what is said of them",
    ),
    Excused("proof/bounds", ("Rows",), "a type"),
    Excused("proof/emptiness", ("_LEAST_VALUE",), "any positive S makes a true bound"),
    Excused("proof/narrowing", ("_WIDER", "_SMALLER"), "which of two boxes that hold the same is kept"),
    Excused("proof/balls", ("_ROOMIER",), "any bound will do: `FormInverse.solve` checks it"),
    Excused("proof/ranges", ("_LEAST_SEEN",), "which slides have a bound worth a search: any σ > 0 bounds"),
)
