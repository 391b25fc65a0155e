"""Enclosures of motions."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

_WIDE = ("validated/test_sharp_wide.py",)
_RECORDED = (
    *(
        f"validated/test_joints.py::test_recorded_dynamics[{name}]"
        for name in (
            "ball, independent",
            "ball and universal",
            "ball with a spring",
            "ball, dependent",
            "continuous",
            "geared",
            "floating",
            "planar",
            "rod",
            "redundant",
        )
    ),
    "validated/test_sharp_recorded.py",
    "validated/test_validated.py::test_recorded_dynamics[slider_crank-stated1]",
)
_RANDOM = "validated/test_joints.py::test_random_mechanisms_of_every_kind[6]"
_MOTIONS = ("validated/test_sharp_motions.py",)
_TUBES = ("validated/test_sharp_tubes.py",)
_STEP = ("validated/test_sharp_step.py",)
_BOXES = ("validated/test_sharp_boxes.py",)
_SMALLER = ("0.001", "0.0001", "1e-06", "1e-08", "1e-10")
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
            ("list[Wide | None](jet)", "not asked", "a type, which says nothing"),
            ("if x is None or rate is None", "not asked: x is None", "where a derivative is zero, so are the next"),
            ("better = found.rad < x.rad[half:]", "left × 0.5", "the value is in both"),
        ),
    ),
    Room(
        "validated/chains",
        (
            "ExactJoint.turning_axes",
            "exact_joints",
            "exact_placement",
            "_exact_rotation",
            "_rotation",
            "poses",
            "_motion",
            "_turn",
            "rates",
            "closure_rows",
            "_coupling_row",
            "_loop_rows",
            "_SNAP",
        ),
        _RECORDED,
        (
            ("return self.kind.unit == 4 or", "not asked: self.kind.unit == 2", "several freedoms: a unit length"),
            ("if joint.parent in found and", "not asked: joint.number != root", "a root's parent is not beyond it"),
        ),
    ),
    Room(
        "validated/mechanics",
        ("closed", "dynamic_terms", "with_springs", "_motions"),
        _RECORDED,
        (
            ("k in q.velocities if k >= 0]", "k >= 0: left × 2", "of the same sign"),
            ("in enumerate(q.velocities) if k", "left ×", "of the same sign"),
            ("right[row, entries] = -psi[row, known]", "left out", "zeros: such a row is of other velocities"),
            ("x_rate[list(q.places)] = v", "left out", "the same by what ρ is, only in wider balls"),
        ),
    ),
    Room(
        "validated/dynamics",
        ("closed_loop", "too_far_turned", "_independent_rows", "_sprung", "_unit_lengths"),
        _RECORDED,
        (
            ("if law is not None and not isinstance(law, NoTorque)", "not asked: not", "asks for more than is needed"),
            ("np.array([0.0, 0.0, 0.0, 1.0])", "1 × ", "a quaternion of any length is made one of unit length"),
        ),
    ),
    Room("validated/laws", ("acting", "_goal", "efforts"), _RECORDED),
    Room(
        "validated/places",
        ("chosen", "_windows", "numbers_of", "on_manifold", "unwound", "configuration"),
        (*_RECORDED, _RANDOM),
    ),
    Room(
        "validated/turns",
        ("BallTurn.relative", "ball_at", "turns_of", "turn_rows", "turn_rates", "upright"),
        (*_RECORDED, _RANDOM),
        (("sign = 1 if float(near", "left × 2", "of the same sign"),),
    ),
    Room(
        "validated/step",
        ("QUANTUM", "evaluate", "attempt", "_piece", "_exponential", "march"),
        _STEP,
        (
            ("box = [around(x, x.rad() * 1e-4", "", "a box that is tried: that it holds its image is asked"),
            ("if keep_negative or bound > 0", "0 let in", "the same number"),
            ("boldness", "", "how long a step is tried"),
            ("_SINGULAR + ", "", "words"),
        ),
    ),
    Room("validated/slices", ("instants_of",), _STEP),
    Room(
        "validated/closing",
        ("_UNIQUE", "closed_start", "unique_there", "krawczyk", "_assemble", "at_rest"),
        _BOXES,
        (
            ("_UNIQUE =", "0.01 × 0.", "smaller is asking for more"),
            *(("_UNIQUE =", f"{x} × ", "any radius does for which Krawczyk's condition holds") for x in _SMALLER),
        ),
    ),
    Room(
        "validated/branch",
        ("closed_boxes", "states_of", "_write", "jets_of", "_inputs"),
        (*_BOXES, _TUBES[0] + "::test_tubes_of_linear_flows_reach_their_corners"),
        (
            ("floor = open_by + _SMALLEST", "", "radii that are tried: Krawczyk's condition is asked of each"),
            ("radius[:, dependent] = floor", "left out", "radii that are tried: Krawczyk's condition is asked of each"),
            ("[still] * (loop.field.inputs", "without loop.n_x", "inputs that no one asks for"),
        ),
    ),
    Room(
        "validated/curvature",
        ("_middles", "boxes", "_in_pieces", "curvature", "feedback", "_flow", "_flow_jets"),
        (*_BOXES, _TUBES[0] + "::test_tubes_of_linear_flows_reach_their_corners"),
        (
            ("[:, list(loop.independent)] + _POINT", "without _POINT", "a box of any size that is proved holds σ"),
            ("reach = raised(large.rad", "1e-15 × ", "the middle's own rounding is a tenth of it"),
            ("reach = raised(large.rad", "1e-12 × ", "`raised` is above these roundings too"),
            ("reach = raised(large.rad", "without 1e-12", "`raised` is above these roundings too"),
        ),
    ),
    Room(
        "validated/crossing",
        ("signed_determinant", "sign_of", "crossing", "_other_coordinates", "_state", "_located", "witness_of"),
        (*_MOTIONS, "validated/test_crossing_signs.py"),
        (
            ("at_rest = [*box[: loop.n_x]", "without loop.n_x", "inputs that no one asks for"),
            ("return int(lower(value)", "0 let in", "`lower` is below what it bounds"),
            ("return int(lower(value)", "left × 0.5", "of the same sign"),
            ("lambda box: max(0.0", "min instead of max", "proves no step"),
            ("if found == 0 or not first < middle", "not asked: not first", "where halving ends"),
            ("middle = 0.5 * (first + last)", "0.5 × ", "where halving looks"),
        ),
    ),
    Room(
        "validated/arrival",
        (
            "_MARGIN",
            "unconnected",
            "lyapunov",
            "single_valued",
            "goal_of",
            "SetArrival.__call__",
            "SetArrival._highest",
        ),
        (*_MOTIONS, "validated/test_one_turn_on.py::test_where_the_lyapunov_function_is_one_function"),
        (
            ("if regularity > 0 and room_left > 0", "0 let in", "0 either way"),
            ("options._replace(shortest=2.0**-12)", "2 × ", "how far a step is shortened before it is given up"),
        ),
    ),
    Room(
        "validated/certificate",
        ("certify_move", "_of_a_set", "_run", "_level"),
        _MOTIONS,
        (
            ("< 0.0 and never", "left × 0.5", "of the same sign"),
            ("assert not isinstance(arrival", "", "what holds of any that is told apart before"),
        ),
    ),
    Room(
        "validated/enclose",
        (
            "Enclosure.smallest_determinant",
            "Enclosure.inputs",
            "Enclosure.contains",
            "Enclosure._nearest",
            "Enclosure.energy",
            "enclose",
            "exact_q",
            "collect",
            "left_open",
            "_bounds",
        ),
        _MOTIONS,
        (("if k < 0", "left × 0.5", "of the same sign"),),
    ),
    Room(
        "validated/sets",
        ("SetEnclosure.contains", "enclose_set", "starts_of"),
        _MOTIONS,
        (("np.all((width >= 0.0)", "width >= 0.0: left × 2", "of the same sign"),),
    ),
    Room("validated/tube", ("advance", "_fitting", "_stretch", "_terms"), _TUBES),
    Room("validated/growing", ("first_section", "fastest_rate", "sampled_section", "grow"), _TUBES),
    Room(
        "validated/tubes",
        (
            "_COVERING",
            "Starts.halves",
            "Tube.duration",
            "Tube.coordinates",
            "Tube._slice",
            "cover",
            "_grown",
            "_motion",
            "_at_a_sample",
            "_widest",
        ),
        _TUBES,
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

_CHOSEN = "chooses the length of a step, which `attempt` proves"
EXCUSED: tuple[Excused, ...] = (
    Excused("validated/arrival", ("_RETRY",), "when `unconnected` is asked again"),
    Excused("validated/certificate", ("_RETRY",), "when `unconnected` is asked again"),
    Excused("validated/enclose", ("SHORTEST_STEP",), "how far a step is shortened before it is given up"),
    Excused("validated/enclose", ("checked_options",), "which arguments are refused: those let in are only slow or useless"),
    Excused("validated/sets", ("checked_cut", "told"), "which arguments are refused, and words"),
    Excused("validated/tube", ("_TIGHT", "frames"), "frames and bounds that are tried: `_fitting` asks what is proved"),
    Excused(
        "validated/growing",
        ("_FINE", "_STRIDE", "_ROOM", "_AIR", "_THINNEST", "_GROWTH", "_PARALLEL", "_turned", "growth"),
        "how slices, frames and room are chosen; `advance` proves the tube with any",
    ),
    Excused("validated/tubes", ("_tube",), "words, and the numbers in them"),
    Excused("validated/step", ("_GROWTH", "_longest", "_blown_up", "_correction", "_affordable"), _CHOSEN),
    Excused("validated/closing", ("_newton", "_sharpened"), "looks for numbers with which `krawczyk` may hold"),
    Excused("validated/branch", ("_INFLATION", "_SMALLEST"), "radii that are tried: Krawczyk's condition is asked of each"),
    Excused("validated/branch", ("nearly_closed",), "Newton's method proposes centres; `closed_boxes` proves boxes there"),
    Excused("validated/curvature", ("_POINT", "_LARGER"), "sizes of boxes that are tried: each is proved to hold σ"),
    Excused("validated/laws", ("SetPointLaw",), "a type"),
    Excused("validated/balls", ("flint",), "python-flint is imported, with what copies a ball: found or not"),
)
