"""What every proof stands on: rounding, ranges, digests."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

_BOUNDS = ("domain/test_sharp_bounds.py",)
ROOMS: tuple[Room, ...] = (
    Room(
        "proof/rounding",
        ("SLACK", "LEAST", "ROUNDINGS", "UNIT_ROUNDOFF", "widened", "blur"),
        _BOUNDS,
        (("SLACK = ", "1e-10 × 1.1", "more room for rounding"),),
    ),
    Room(
        "proof/rounding",
        ("sum_of", "product_of", "_halves"),
        ("proof/test_rounding.py::test_sums_and_products_are_exact",),
        (("moved = a * 134217729.0", "× 0.9", "halves of 26 bits and 27 have exact products too"),),
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
