"""Enclosures of motions."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

_POLYDISC = ("validated/arithmetic/test_polydisc.py", "validated/flow/test_analytic_branch.py")
_WIDE = ("validated/arithmetic/test_sharp_ball_arrays.py",)
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
    "validated/model/test_sharp_recorded.py",
    "validated/model/test_recorded_loop.py::test_recorded_dynamics[slider_crank-stated1]",
    "validated/model/test_recorded_loop.py::test_whose_free_motion_it_is",
)
_RANDOM = "validated/test_joints.py::test_random_mechanisms_of_every_kind[6]"
_MOTIONS = ("validated/flow/test_sharp_motions.py",)
_TUBES = ("validated/sets/test_sharp_state_tubes.py",)
_STEP = ("validated/flow/test_sharp_step.py",)
_SETS = ("validated/sets/test_motion_tube_claims.py",)
_FALSE_SETS = tuple(
    f"validated/sets/test_false_sets.py::{name}"
    for name in (
        "test_tubes_are_about_what_was_asked",
        "test_sets_are_about_what_was_asked",
        "test_a_covering_with_a_tube_left_out",
    )
)
_BOXES = ("validated/sets/test_sharp_state_boxes.py",)
_SMALLER = ("0.001", "0.0001", "1e-06", "1e-08", "1e-10")
_EXACT = "validated/arithmetic/test_exact_numbers.py"
_CLAIMS = ("validated/flow/test_motion_claims.py",)
_FALSE = tuple(
    f"validated/flow/test_false_enclosures.py::{name}"
    for name in (
        "test_enclosures_are_about_what_was_asked",
        "test_singularities_are_met_by_this_motion",
        "test_false_crossings",
        "test_steps_of_another_loop",
        "test_chains_with_a_gap[the first step]",
    )
)
_ARRIVALS = ("validated/sets/test_arrival_claims.py",)
_FALSE_ARRIVALS = "validated/sets/test_false_arrivals.py"
_LEVELS = (f"{_FALSE_ARRIVALS}::test_levels_of_other_set_points",)
_TOLD_OF_MOVES = (
    f"{_FALSE_ARRIVALS}::test_what_is_told_of_an_arrival",
    f"{_FALSE_ARRIVALS}::test_moves_are_about_what_was_asked",
    f"{_FALSE_ARRIVALS}::test_sets_of_moves_are_about_what_was_asked",
    "validated/sets/test_move.py::test_a_move_whose_energy_is_too_low_is_refuted",
)
_MOVES = (
    f"{_FALSE_ARRIVALS}::test_what_is_told_of_an_arrival",
    f"{_FALSE_ARRIVALS}::test_levels_are_facts_or_the_caller_s",
    f"{_FALSE_ARRIVALS}::test_moves_are_about_what_was_asked",
    f"{_FALSE_ARRIVALS}::test_levels_that_are_told_too_high",
    "validated/sets/test_move.py::test_a_move_whose_energy_is_too_low_is_refuted",
    "validated/sets/test_move.py::test_bad_arrivals",
)
_DEFECT = ("validated/flow/test_sharp_defect.py",)
_TREES = ("programs/test_recorded_trees.py",)
_TAPES = "programs/test_tape.py"
_BRANCHES = tuple(
    f"validated/programs/test_{name}.py" for name in ("sharp_branches_of_lines", "program_claims", "false_programs")
)
_CONSTANTS = "validated/programs/test_sharp_program_constants.py"
_GUARDED = "validated/programs/test_guarded_programs.py"
_PROGRAMS = ("validated/arithmetic/test_sharp_programs.py",)
ROOMS: tuple[Room, ...] = (
    Room(
        "validated/arithmetic/polydisc",
        _POLYDISC,
        (
            *(
                ("while count < _TERMS", change, "where the series stops: what is left is counted")
                for change in ("not asked: not bound", "bound < _UNIT: left × 0.5")
            ),
            ("*[None] * (program.size - program.inputs)", "without program.inputs", "values that no one asks for"),
            ("waves.get(a) or", "not asked: waves.get(a)", "the same is computed again"),
        ),
        places=(
            *("_TERMS", "_UNIT", "ring", "constants", "stacked", "sine_and_cosine"),
            *("inverse", "unit", "solution", "evaluated", "_double"),
            *(f"Analytic.{name}" for name in ("size", "__add__", "__sub__", "__mul__", "__matmul__", "scaled", "at")),
            *(f"Analytic.{name}" for name in ("polynomials", "_by_degree", "_beyond")),
        ),
    ),
    Room(
        "validated/arithmetic/chebyshev",
        _POLYDISC,
        (("while len(rows) <= degree", "left × 0.5", "more rows than are used"),),
    ),
    Room(
        "validated/flow/analytic_branch",
        ("validated/flow/test_analytic_branch.py",),
        (("size = np.abs", "without _ROUGH * self.near.size", "a margin over roundings that no test meets"),),
    ),
    Room(
        "validated/arithmetic/ball_arrays",
        _WIDE,
        (("reach = np.maximum(", "minimum instead", "they differ by the middle's rounding, which is counted below"),),
    ),
    Room(
        "validated/arithmetic/first_order",
        ("validated/arithmetic/test_first_order.py",),
        (
            ("positive = (x.mid > 0.0)", "not asked: x.least > 0.0", "what is divided by is then below 0, or 0"),
            ("positive = (x.mid > 0.0)", "0 let in", "what is divided by 0 is ∞ too"),
            ("rest = np.where(x.least > 0.0", "0 let in", "what is divided by 0 is ∞ too"),
            ("np.where(positive, x.mid, 1.0)", "1 ×", "where nothing is rooted the radius is ∞"),
        ),
    ),
    Room("validated/programs/error_sweeps", ("validated/programs/test_error_sweeps.py",)),
    Room(
        "validated/programs/program_equations",
        (
            _CONSTANTS,
            "validated/programs/test_error_sweeps.py",
            "validated/programs/test_sharp_certificates.py",
            "validated/programs/test_false_programs.py",
        ),
    ),
    Room("validated/programs/branch_claim", _BRANCHES),
    Room(
        "validated/programs/steps_claim",
        _BRANCHES,
        (
            (
                "-m + np.arange(m)",
                "without -m",
                "terms of η have 0 in the middle: of which axes they are, no product knows",
            ),
        ),
    ),
    Room(
        "validated/programs/rounding_claim",
        ("validated/programs/test_sharp_program_values.py", *_BRANCHES),
        (
            ("count = max(1, int(_MEMORY", "", "how many cells are looked at at once"),
            ("pivot > 0.0 for pivot", "0 let in", "what is divided by 0 is ∞, and refused before"),
        ),
    ),
    Room(
        "validated/programs/program_certificate",
        ("validated/programs/test_sharp_certificates.py", _CONSTANTS, _GUARDED),
    ),
    Room(
        "validated/programs/certificate_documents",
        ("validated/programs/test_certificate_documents.py", _CONSTANTS),
        (("> _MANY", "left × 2", "how many steps are too many for a file"),),
    ),
    Room(
        "programs/written_numbers",
        ("programs/test_damaged_programs.py", "validated/programs/test_certificate_documents.py"),
    ),
    Room(
        "programs/certified_region", (_GUARDED,), places=("CertifiedRegion.ends", "CertifiedRegion.holds", "_is_region")
    ),
    Room(
        "validated/arithmetic/balls",
        (*_WIDE, _EXACT),
        (("if not z < 1", "left × 0.5", "from half a turn on the function is no number, nor is a hull of it"),),
    ),
    Room("validated/arithmetic/exact_numbers", (_EXACT,)),
    Room("validated/arithmetic/programs", ("validated/test_loop_equations.py",)),
    Room("validated/loop_equations", ("validated/test_loop_equations.py", *_TUBES)),
    Room("validated/loop_equations", _BOXES, places=("ClosedLoopEquations.at_rest",)),
    Room("validated/loop_equations", _RECORDED, places=("too_far_turned", "_is_upright")),
    Room(
        "programs/tape",
        (*_PROGRAMS, _TAPES),
        (
            ("if shareable and key", "not asked: shareable", "what is not shared is not kept"),
            ("(item.kind != Kind.ANGLE or is_zero", "not asked: is_zero(slopes[item.b])", "0 all the same, only later"),
            ("not isinstance(value, Node) and", "not asked: not isinstance", "a node equals no number"),
        ),
    ),
    Room(
        "validated/arithmetic/series",
        (*_PROGRAMS, *_DEFECT),
        (
            ("[None] * (program.size - size)", "without size", "values that no one asks for"),
            ("slopes[:size] = zero + np.eye", "without zero", "0 and 1 as numbers do as well"),
            ("found[k] = [narrowed(*entry)", "left out", "narrows what holds as it is"),
            (
                "elif item.kind != Kind.PART and",
                "not asked: item.kind != Kind.PART",
                "narrowed again, from the same",
            ),
            ("inverses[matrix] = known", "left out", "found again where it is needed"),
        ),
    ),
    Room(
        "validated/arithmetic/jets",
        _PROGRAMS,
        (
            ("[None] * (size - len(inputs))", "without len(inputs)", "values that no one asks for"),
            ("if self.order >= 1", "left × 2", "the same of whole numbers"),
            ("list[BallArray | None](jet)", "not asked", "a type, which says nothing"),
            ("if x is None or rate is None", "not asked: x is None", "where a derivative is zero, so are the next"),
            ("better = found.rad < x.rad[half:]", "left × 0.5", "the value is in both"),
        ),
    ),
    Room(
        "programs/recording/recorded_tree",
        (*_TREES, *_RECORDED),
        (("return self.kind.unit == 4 or", "not asked: self.kind.unit == 2", "several freedoms: a unit length"),),
    ),
    Room(
        "programs/recording/recorded_forces",
        (*_TREES, *_RECORDED),
        (
            ("right[row, entries] = -psi[row, known]", "left out", "zeros: such a row is of other velocities"),
            ("x_rate[list(q.places)] = v", "left out", "the same by what ρ is, only in wider balls"),
        ),
    ),
    Room("programs/recording/recorded_bodies", _TREES),
    Room("programs/recording/recorded_closures", _TREES),
    Room(
        "validated/model/closed_loop",
        _RECORDED,
        (
            ("if told is not None and not told.idle", "not asked: not", "asks for more than is needed"),
            ("if told is not None and not told.idle", "not asked: told", "a law that says nothing is refused before"),
        ),
    ),
    Room("programs/recording/recorded_laws", _RECORDED),
    Room(
        "programs/recording/recorded_laws",
        ("programs/test_moving_references.py",),
        places=("reference_force", "recorded_law"),
    ),
    Room("programs/recording/recorded_coordinates", (*_RECORDED, _RANDOM)),
    Room("validated/model/configurations", (*_RECORDED, _RANDOM)),
    Room(
        "programs/recording/recorded_mechanism",
        _RECORDED,
        (("np.array([0.0, 0.0, 0.0, 1.0])", "1 × ", "a quaternion of any length is made one of unit length"),),
    ),
    Room(
        "programs/recording/constants",
        ("programs/test_parameters.py", "validated/test_joints.py::test_recorded_dynamics[rod]"),
        (
            (
                "if len(links) == 1 and",
                "not asked: len(links) == 1",
                "of several links with masses none weighs what all of them do",
            ),
            (
                "or link.inertia is None:",
                "not asked: link.inertia is None",
                "the mass of a link that has none is no parameter",
            ),
        ),
    ),
    Room("programs/folding", (*_PROGRAMS, _TAPES)),
    Room(
        "programs/recording/ball_joints",
        (*_RECORDED, _RANDOM),
        (("sign = 1.0 if float(near", "0 left out", "half a turn away either sign is as near"),),
    ),
    Room(
        "validated/flow/step",
        _STEP,
        (
            ("box = [around(x, x.rad() * 1e-4", "", "a box that is tried: that it holds its image is asked"),
            ("if keep_negative or bound > 0", "0 let in", "the same number"),
            ("SINGULAR + ", "", "words"),
        ),
    ),
    Room(
        "validated/flow/marching", _STEP, (("boldness", "", "how long a step is tried"), ("SINGULAR + ", "", "words"))
    ),
    Room("validated/flow/start_claim", _CLAIMS),
    Room("validated/flow/step_claim", _CLAIMS),
    Room("validated/flow/motion_claim", (*_CLAIMS, _MOTIONS[0] + "::test_rows_left_out_are_bounded")),
    Room(
        "validated/flow/crossing_claim",
        (*_CLAIMS, _STEP[0] + "::test_determinants_and_their_signs"),
        (("return int(lower(value)", "0 let in", "`lower` is below what it bounds"),),
    ),
    Room("validated/flow/motion_task", _FALSE),
    Room("validated/sets/instants", (*_STEP, *_SETS, *_TUBES)),
    Room("validated/sets/slices_claim", _SETS),
    Room(
        "validated/sets/motion_tube_claim",
        (*_SETS, *_TUBES),
        (
            (
                "require(len(premises) > 1 and type(premises[0].claim)",
                "not asked: type(premises[0].claim)",
                "the only kind of fact that has steps, times and samples",
            ),
        ),
    ),
    Room("validated/sets/set_claim", _SETS),
    Room("validated/flow/closing", _BOXES),
    Room(
        "validated/flow/start_search",
        _BOXES,
        (
            ("_UNIQUE =", "0.01 × 0.", "smaller is asking for more"),
            *(("_UNIQUE =", f"{x} × ", "any radius does for which Krawczyk's condition holds") for x in _SMALLER),
        ),
    ),
    Room(
        "validated/sets/branch",
        (*_BOXES, _TUBES[0] + "::test_tubes_of_linear_flows_reach_their_corners"),
        (
            ("floor = open_by + _SMALLEST", "", "radii that are tried: Krawczyk's condition is asked of each"),
            ("radius[:, dependent] = floor", "left out", "radii that are tried: Krawczyk's condition is asked of each"),
            ("[still] * (loop.field.inputs", "without loop.n_x", "inputs that no one asks for"),
        ),
    ),
    Room(
        "validated/sets/curvature",
        (*_BOXES, _TUBES[0] + "::test_tubes_of_linear_flows_reach_their_corners"),
        (
            ("[:, list(loop.independent)] + _POINT", "without _POINT", "a box of any size that is proved holds σ"),
            ("reach = raised(large.rad", "1e-15 × ", "the middle's own rounding is a tenth of it"),
            ("reach = raised(large.rad", "1e-12 × ", "`raised` is above these roundings too"),
            ("reach = raised(large.rad", "without 1e-12", "`raised` is above these roundings too"),
        ),
    ),
    Room(
        "validated/flow/crossing",
        (*_MOTIONS, "validated/flow/test_crossing_signs.py", *_FALSE),
        (
            ("if found == 0 or not first < middle", "not asked: not first", "where halving ends"),
            ("middle = 0.5 * (first + last)", "0.5 × ", "where halving looks"),
        ),
    ),
    Room("validated/sets/arrival_claim", (*_ARRIVALS, *_LEVELS)),
    Room("validated/sets/lyapunov", _ARRIVALS),
    Room("validated/sets/arrival_equations", (*_ARRIVALS, *_LEVELS)),
    Room(
        "validated/sets/arrival_reading",
        (
            "validated/sets/test_arrival_level.py",
            "validated/sets/test_one_turn_on.py::test_where_the_lyapunov_function_is_one_function",
            "validated/sets/test_one_turn_on.py::test_springs_that_make_another_energy_one_turn_on",
            "validated/sets/test_one_turn_on.py::test_angles_whose_errors_jump_half_a_turn_away",
        ),
    ),
    Room(
        "validated/sets/move",
        _MOVES,
        (('if move.verdict == "proven" and sublevel is None', "not asked: move.verdict", "costs a refutation"),),
    ),
    Room(
        "validated/sets/proved_move",
        _TOLD_OF_MOVES,
        (
            ("if proved is None or not any(", "not asked: proved is None", "nothing is a fact of no kind"),
            ("return max([tube.duration", "min instead of max", "where nothing is decided nothing is claimed"),
        ),
    ),
    Room(
        "validated/flow/enclosure",
        _MOTIONS,
        places=(
            "Enclosure.smallest_determinant",
            "Enclosure.inputs",
            "Enclosure.contains",
            "Enclosure._nearest",
            "Enclosure.energy",
            "collect",
            "_bounds",
        ),
    ),
    Room(
        "validated/flow/enclosure",
        _FALSE,
        (("if self.asked is None or self.motion is None", "not asked: self.motion", "nothing is about a motion"),),
    ),
    Room("validated/flow/enclosing", _MOTIONS),
    Room("validated/flow/motion_task", _MOTIONS, places=("exact_q",)),
    Room("validated/sets/set_enclosure", _MOTIONS, places=("SetEnclosure.contains", "enclose_set", "starts_of")),
    Room("validated/sets/set_enclosure", (_MOTIONS[0] + "::test_a_set_of_starts_as_asked", *_FALSE_SETS)),
    Room(
        "validated/sets/tube_theorem",
        (*_TUBES, *_SETS),
        (
            ("if not np.all(kept < room)", "any", "u ≤ room, and so kept < u fails where kept < room does"),
            ("if not np.all(kept < room)", "left × 0.5", "u ≤ room, and so kept < u fails where kept < room does"),
            ("inside = np.minimum(kept", "1e-300", "which u is tried: kept < u is asked of it"),
            ("delta = off.sum(axis=2)", "1e-12", "`raised` is above these roundings too"),
        ),
    ),
    Room("validated/sets/subdivision", (*_TUBES, *_SETS, *_FALSE_SETS)),
    Room(
        "validated/flow/defect",
        _DEFECT,
        (
            ("for _ in range(program.size - program.inputs)", "without program.inputs", "values that no one asks for"),
            ("low, tail, total = [ball(1)", "without 1", "a coefficient that no one asks for"),
        ),
    ),
)

_CHOSEN = "chooses the length of a step, which `attempt` proves"
EXCUSED: tuple[Excused, ...] = (
    Excused("validated/arithmetic/chebyshev", ("_OUT",), "a margin over roundings that no test meets"),
    Excused(
        "validated/arithmetic/polydisc",
        ("_BITS", "_OUT", "_LEAST", "_TRIGONOMETRIC"),
        "margins over roundings that no test meets",
    ),
    Excused(
        "validated/flow/analytic_branch",
        ("_OUT", "_ROUGH", "followed"),
        "margins over roundings that no test meets; `followed` proposes",
    ),
    Excused("validated/programs/proposals", (), "proposes cells and tubes: `BranchOverCells` says what is proved"),
    Excused("validated/programs/program_equations", ("ProgramEquations.apart",), "where the search begins"),
    Excused("validated/programs/certifying", (), "proposes starts and cuts: the claims say what is proved"),
    Excused(
        "validated/programs/certificate_documents",
        ("CERTIFIED_PROGRAM", "_MANY", "_DIGITS", "write_certificate", "_source_text", "_written", "_counts"),
        "what files look like, and from which sizes on they are refused: what is read is proved again",
    ),
    Excused(
        "validated/programs/guarding",
        (),
        "from where on y is refused: the statement says how near it must be, whatever is let in",
    ),
    Excused("validated/programs/rounding_claim", ("_MEMORY",), "how many cells are looked at at once"),
    Excused(
        "validated/programs/rounding_claim", ("_AXES",), "a sum of so many numbers rounds by half of what is allowed"
    ),
    Excused(
        "validated/programs/program_certificate",
        (
            "bounded",
            "bounds_of",
            "ProgramCertificate.verdict",
            "ProgramCertificate.reason",
            "ProgramCertificate.off",
            "ProgramCertificate._share",
            "ProgramCertificate._off",
            "ProgramCertificate._fact",
            "ProgramCertificate._status",
            "ProgramCertificate.statement",
            "ProgramCertificate.replay",
            "ProgramCertificate.save",
            "ProgramCertificate.load",
            "ProgramCertificate.is_about",
            "ProgramCertificate.bits",
            "ProgramCertificate.ranges",
            "_numbers",
            "_box",
        ),
        "words, which arguments are refused, and what the search compares",
    ),
    Excused("validated/sets/arrival", (), "proposes lines and boxes: `Arrived` says what is proved of them"),
    Excused(
        "validated/sets/move", ("_run", "_of_one", "_proved", "_of_a_set"), "propose: the claims say what is proved"
    ),
    Excused(
        "validated/flow/marching", ("SHORTEST_STEP", "rounded_up"), "how far a step is shortened before it is given up"
    ),
    Excused(
        "validated/flow/motion_task",
        ("_check_options",),
        "which arguments are refused: those let in are only slow or useless",
    ),
    Excused("validated/sets/set_enclosure", ("checked_cut", "told"), "which arguments are refused, and words"),
    Excused(
        "validated/sets/tube_theorem",
        ("_TIGHT",),
        "bounds that are tried: `_fitting` asks what is proved",
    ),
    Excused(
        "validated/sets/propagation",
        (),
        "proposes slices, frames, room and cross-sections: `SlicesHeld` and `TubeHeld` say what is proved of them",
    ),
    Excused(
        "validated/sets/subdivision",
        ("_COVERING", "Starts.halves", "cover", "_motion", "_widest", "_held"),
        "proposes parts and tubes: `TubeHeld` and `SetEnclosed` say what is proved of them",
    ),
    Excused("validated/flow/marching", ("_GROWTH", "_longest", "_blown_up", "_correction", "_affordable"), _CHOSEN),
    Excused(
        "validated/flow/start_search", ("_newton", "_sharpened"), "looks for numbers with which `krawczyk` may hold"
    ),
    Excused("validated/flow/proved_steps", (), "proposes steps: `StepEnclosed` says what is proved of them"),
    Excused(
        "validated/sets/branch",
        ("_INFLATION", "_SMALLEST"),
        "radii that are tried: Krawczyk's condition is asked of each",
    ),
    Excused(
        "validated/sets/branch",
        ("nearly_closed",),
        "Newton's method proposes centres; `closed_boxes` proves boxes there",
    ),
    Excused(
        "validated/sets/curvature", ("_POINT", "_LARGER"), "sizes of boxes that are tried: each is proved to hold σ"
    ),
    Excused(
        "validated/arithmetic/balls", ("flint",), "python-flint is imported, with what copies a ball: found or not"
    ),
)
