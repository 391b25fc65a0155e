"""The kernel: rounding, bounds over boxes, one interval Newton, narrowing."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

_EVERY = "proof/test_sharp_every.py"
_BOUNDS = ("proof/test_sharp_bounds.py", _EVERY)
ROOMS: tuple[Room, ...] = (
    Room(
        "proof/facts",
        (
            "sealed",
            "ProvableClaim.well_formed",
            "ProvableClaim._count",
            "require",
            "_replayed",
            "prove_some",
            "_examined",
        ),
        ("proof/test_sharp_facts.py",),
    ),
    Room(
        "proof/solutions",
        (
            "TURN",
            "_PI_OFF",
            "boxes_of",
            "_tubes_of",
            "GluedBoxes.examined",
            "Met.examined",
            "_exact",
            "_placed",
            "_agree",
            "_inside",
        ),
        ("proof/test_sharp_solutions.py",),
        (
            ("_PI_OFF = ", "8.5 × 1.1", "more room for rounding"),
            ("_PI_OFF = ", "8.5 × 2", "more room for rounding"),
            ("plain = tubes.plain[self.first] &", "", "which pairs are computed together: `_agree` looks at each"),
        ),
    ),
    Room(
        "proof/rounding",
        ("SLACK", "LEAST", "ROUNDINGS", "UNIT_ROUNDOFF", "widened", "blur"),
        _BOUNDS,
        (("SLACK = ", "1e-10 × 1.1", "more room for rounding"),),
    ),
    Room(
        "proof/bounds",
        ("linear_part", "LinearPart.affine", "LinearPart.widths", "LinearPart.curvature_margin", "Image.of"),
        _BOUNDS,
    ),
    Room(
        "proof/taylor",
        (
            "taylor_bounds",
            "_mixed",
            "_selected",
            "selected",
            "Pattern.along",
            "Pattern.dense",
            "TaylorBounds.mean",
            "TaylorBounds.contraction",
            "TaylorBounds.curvature",
            "TaylorBounds._matrix",
            "_Selected.times",
            "_Mixed.times",
        ),
        ("proof/test_sharp_taylor.py", *_BOUNDS),
    ),
    Room("proof/reach_bounds", ("ChainLengths.of", "ChainLengths.reach", "trilinear", "ReachDrift.over"), _BOUNDS),
    Room(
        "proof/newton",
        ("holds", "frame_of", "reached", "noise_of"),
        _BOUNDS,
        (
            ("np.isfinite(bounds.y + image + shrunk)", "without shrunk", "a Z that is no number fails (N2) too"),
            (
                "np.isfinite(bounds.y + image + shrunk)",
                "any instead of all",
                "what is no number fails (N1) or (N2) too",
            ),
        ),
    ),
    Room("proof/newton", ("in_tubes", "encloses", "without_turns"), _BOUNDS),
    Room(
        "proof/phasors",
        (
            "planar_bounds",
            "_expanded",
            "_versine",
            "_one_signed",
            "PlanarBounds.mean",
            "PlanarBounds.contraction",
            "PlanarBounds.curvature",
            "PlanarBounds._widths",
            "PlanarBounds._image",
        ),
        ("proof/test_sharp_phasors.py",),
    ),
    Room(
        "proof/balls",
        (
            "_GROWN",
            "_TINY",
            "Affine.magnitude",
            "Affine.spread",
            "Affine.swing",
            "Affine.__add__",
            "Affine.__mul__",
            "_lengths",
            "_sum",
            "summed",
            "product",
            "sine_versine",
            "FormInverse.solve",
            "inverse",
        ),
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
    Room("proof/equations", ("third_bound",), _BOUNDS),
    Room(
        "proof/newton",
        ("proved_within",),
        ("proof/test_sharp_extended.py", _EVERY),
        (
            ("(kappa * SLACK < 1.0)", "not asked: kappa * SLACK < 1.0", "follows from the first"),
            ("(kappa * SLACK < 1.0)", "kappa * SLACK < 1.0: left", "follows from the first"),
            ("(kappa * SLACK < 1.0)", "1 × 1.1", "follows from the first"),
            ("(kappa * SLACK < 1.0)", "1 × 2", "follows from the first"),
        ),
    ),
    Room(
        "proof/narrowing",
        ("alone_in",),
        ("proof/test_sharp_narrowing.py", _EVERY),
        (
            ("weight = 0.5 * (weight", "", "any w > 0 will do: it is checked below"),
            ("alone & np.isfinite", "not asked: np.isfinite", "Zw < w fails where Z is no number"),
            ("alone & np.isfinite", "any instead of all", "Zw < w fails where Z is no number"),
        ),
    ),
    Room(
        "proof/rounding",
        ("sum_of", "product_of", "_halves"),
        ("proof/test_rounding.py::test_sums_and_products_are_exact",),
        (("moved = a * 134217729.0", "× 0.9", "halves of 26 bits and 27 have exact products too"),),
    ),
    Room(
        "proof/covers",
        ("halved", "LeafFaces.turns", "faces_of", "_parted", "one_function"),
        ("proof/test_sharp_covers.py",),
        (
            ("ended = (child[pairs.upper] < 0)", "0 let in", "no part is the region: its cell would have two parents"),
            ("tree.reached & (child >= 0)", "0 left out", "no part is the region: its cell would have two parents"),
            ("first = child[pairs.upper] >= 0", "0 left out", "no part is the region: its cell would have two parents"),
        ),
    ),
    Room(
        "proof/digests",
        ("digest", "_pieces", "_of_attributes", "require_same"),
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
        (
            "_WIDER",
            "_ORTHONORMAL",
            "NO_LIMIT",
            "Ranges.edge",
            "Ranges.at_limit",
            "ranges_of",
            "ranges_over",
            "_Intervals.__init__",
            "_Intervals._by_couplings",
            "_Intervals._by_lengths",
            "_Intervals._are_points",
            "_Intervals._bound",
            "_Intervals._meet",
            "_Sight.__init__",
            "_Sight.least",
            "_Sight.longest",
            "_is_identity",
        ),
        ("proof/test_lemma_r.py",),
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
    Excused(
        "proof/ranges", ("_ROUNDS", "_GAIN", "_Intervals.narrow"), "when narrowing ends: each step of it is proved"
    ),
    Excused("proof/ranges", ("_LEAST_SEEN",), "which slides have a bound worth a search: any σ > 0 bounds"),
)
