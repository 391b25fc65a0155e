"""Enclosures of motions."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

_WIDE = ("validated/test_sharp_wide.py",)
_DEFECT = ("validated/test_sharp_defect.py",)
_PROGRAMS = ("validated/test_sharp_programs.py",)
ROOMS: tuple[Room, ...] = (
    Room(
        "validated/wide",
        (
            "_UNIT",
            "_LEAST",
            "_OUT",
            "_TRIGONOMETRIC",
            "Wide.__add__",
            "Wide.__sub__",
            "Wide.__mul__",
            "Wide.__matmul__",
            "Wide.size",
            "raised",
            "hull",
            "of_balls",
            "sine_and_cosine",
            "inverse",
        ),
        _WIDE,
        (("reach = np.maximum(", "minimum instead", "they differ by the middle's rounding, which is counted below"),),
    ),
    Room(
        "validated/balls",
        ("_put_together", "around", "finite", "gain"),
        _WIDE,
        (("if not z < 1", "left × 0.5", "from half a turn on the function is no number, nor is a hull of it"),),
    ),
    Room(
        "validated/tape",
        ("Tape.sincos", "Tape.derivative", "Tape.program", "Tape._slope", "Tape._record", "is_zero"),
        _PROGRAMS,
        (
            ("shareable = kind not in", "not asked: kind not in", "what is recorded twice is one value all the same"),
            ("not isinstance(value, Node) and", "not asked: not isinstance", "a node equals no number"),
        ),
    ),
    Room(
        "validated/series",
        (
            "_values",
            "_value",
            "gradients",
            "_gradient",
            "_solution_gradient",
            "all_series",
            "extend",
            "_advance",
            "_trigonometric",
            "_composed",
            "_solution",
            "_inverse",
        ),
        (*_PROGRAMS, *_DEFECT),
        (
            ("[None] * (program.size - size)", "without size", "values that no one asks for"),
            ("slopes[:size] = zero + np.eye", "without zero", "0 and 1 as numbers do as well"),
            ("found[k] = [narrowed(*entry)", "left out", "narrows what holds as it is"),
            ("elif item.kind != PART and", "not asked: item.kind != PART", "narrowed again, from the same"),
            ("inverses[matrix] = known", "left out", "found again where it is needed"),
        ),
    ),
    Room(
        "validated/jets",
        (
            "_Run.__init__",
            "_Run.visit",
            "_Run.product",
            "_Run.composed",
            "_Run.trigonometric",
            "_Run.solution",
            "_Run.table",
            "narrowed",
            "_narrower",
            "_shared",
            "_sum",
            "_spread",
            "_outer",
        ),
        _PROGRAMS,
        (
            ("[None] * (size - len(inputs))", "without len(inputs)", "values that no one asks for"),
            ("if self.order >= 1", "left × 2", "the same of whole numbers"),
            ("if x is None or rate is None", "not asked: x is None", "where a derivative is zero, so are the next"),
            ("better = found.rad < x.rad[half:]", "left × 0.5", "the value is in both"),
        ),
    ),
    Room(
        "validated/defect",
        (
            "sizes_along",
            "_AlongPolynomial.over",
            "_AlongPolynomial.bound",
            "_AlongPolynomial.visit",
            "_AlongPolynomial.rest",
            "_AlongPolynomial.composed",
            "_AlongPolynomial.solution",
            "_AlongPolynomial.range",
        ),
        _DEFECT,
        (
            ("for _ in range(program.size - program.inputs)", "without program.inputs", "values that no one asks for"),
            ("low, tail, total = [ball(1)", "without 1", "a coefficient that no one asks for"),
        ),
    ),
)

EXCUSED: tuple[Excused, ...] = (
    Excused("validated/balls", ("flint",), "python-flint is imported, with what copies a ball: found or not"),
)
