"""Claims about what can be identified: `ccpin.identification`."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

_SEEN = tuple(f"identification/test_more_sensors.py::test_what_sensors_see[{name}]" for name in ("bar", "arm"))
_FRICTION = "identification/test_sharp_dependent_columns.py::test_where_friction_stands"
_CLAIMS = ("identification/test_sharp_combinations.py", "identification/test_rank_claims.py", *_SEEN, _FRICTION)
_ADAPTIVE = ("identification/test_adaptive_tube_claims.py",)
_EQUATIONS = tuple(
    f"{_ADAPTIVE[0]}::test_{name}"
    for name in (
        "equations_that_are_none",
        "what_may_just_be",
        "equations_cannot_be_written_to",
        "which_constants_only_add",
        "inertias_that_are_just_definite",
    )
)
_TOLD = tuple(
    f"{_ADAPTIVE[0]}::test_{name}"
    for name in (
        "dry_friction_is_named",
        "a_certificate_says_what_its_fact_does",
        "what_is_asked_of_motors_is_what_they_have",
        "a_fact_about_another_law_says_nothing_of_this",
    )
)
_LEVELS = ("identification/test_sharp_adaptive.py",)
_SPANS = ("identification/test_vanishing.py::test_spans",)
_STRUCTURE = (
    *_SPANS,
    "identification/test_vanishing.py::test_a_weight_is_a_constant_effort",
    *(
        f"identification/test_vanishing.py::test_combinations_are_without_effect[{name}]"
        for name in ("rpdr", "four_bar", "slider_crank")
    ),
    "identification/test_vanishing.py::test_combinations_of_others_are_without_effect[bennett]",
    *_SEEN,
)
_COLOURED = tuple(
    f"identification/test_coloured_noise.py::test_{name}"
    for name in (
        "it_is_the_sum_over_all_pairs_of_samples",
        "what_smoothing_brings_about_is_white",
        "it_is_no_smaller_than_either_in_any_direction",
        "noise_that_never_forgets_is_taken_to_forget_a_hundredth",
    )
)
_MOTION_ERRORS = "what_errors_of_motions_add_is_the_sum_over_all_pairs_of_samples"
_DEPENDENT = ("identification/test_dependent_columns.py", "identification/test_sharp_dependent_columns.py")

ROOMS = (
    Room("identification/combinations/exact_spaces", _SPANS),
    Room(
        "identification/combinations/vanishing",
        _STRUCTURE,
        places=(
            *(
                "identities",
                "_unseen",
                "_handed",
                "_steps",
                "_skew",
                "_across",
                "_to_frame",
                "_moved",
                "_unit_inertias",
            ),
            *("BodyMotions.level", "BodyMotions.felt", "BodyMotions.seen_from", "BodyMotions.moved", "MOVES", "_PAIRS"),
        ),
    ),
    Room(
        "identification/combinations/identification_equations",
        _CLAIMS,
        places=(
            "IdentificationEquations.__post_init__",
            "IdentificationEquations.sizes",
            "IdentificationEquations.identities",
            "IdentificationEquations.forms",
            "IdentificationEquations._form",
            *(f"IdentificationEquations.{name}" for name in ("pairs", "smooth_forms", "seen", "arranged", "stretched")),
            "IdentificationEquations.frictions",
            *("_stretched", "_masses", "_weights", "_cross", "_sign"),
        ),
    ),
    Room("identification/combinations/rank_claims", _CLAIMS),
    Room(
        "identification/combinations/dependent_columns",
        _DEPENDENT,
        (
            ("row[its[number]] = -other if", "0 let in", "either sign may be taken"),
            ("require(len({level > 0.0", "0 let in", "levels that are 0 are left out"),
        ),
        places=(
            *("reach", "branch_of", "everywhere", "fastest_of", "_sure", "rubbing_of"),
            *(f"DependentColumns.{name}" for name in ("examined", "_seen", "_left", "_by_size")),
        ),
    ),
    Room(
        "identification/adaptive/regressor_bounds",
        ("identification/test_regressor_bounds.py",),
        places=(
            *("TIPS", "TEN", "OF_A_JOINT", "pseudo_inertia", "frames_of", "Shares.of"),
            *(f"RegressorBounds.{name}" for name in ("__init__", "inertia", "columns", "rates")),
            *(f"RegressorBounds.{name}" for name in ("_along", "_bent", "_pulled", "_second", "_at_rest")),
            *(f"RegressorBounds.{name}" for name in ("_on_joints", "_on_bodies")),
        ),
    ),
    Room(
        "identification/adaptive/adaptive_equations",
        _EQUATIONS,
        (
            (
                "np.where(own > 0.0, own, 1.0)",
                "1 × ",
                "where there is a 0, or less, none is definite whatever the others are",
            ),
        ),
        places=(
            *("_ADDS", "_DEFINITE", "_definite", "AdaptiveEquations.__post_init__", "AdaptiveEquations.sizes"),
            *("AdaptiveEquations.digest", "AdaptiveEquations.shares", "AdaptiveEquations.adds"),
            *("AdaptiveEquations.masses", "AdaptiveEquations.bodies", "AdaptiveEquations.motion"),
            "AdaptiveEquations.__reduce__",
        ),
    ),
    Room("identification/adaptive/adaptive_states", _LEVELS),
    Room("identification/adaptive/adaptive_bounds", _LEVELS),
    Room(
        "identification/adaptive/adaptive_levels",
        _LEVELS,
        (
            (
                "held = np.all(above",
                "left × 2",
                "what is above a half proves ρ < 1 as well, and then W is what was solved for",
            ),
        ),
        places=(
            *("_CLEAR", "_ROOM", "AdaptiveLevels.bound", "AdaptiveLevels.needed", "AdaptiveLevels.held", "levels_of"),
            *("_squared", "grip_of", "delayed", "_lately", "decay_of", "carried"),
        ),
    ),
    Room("identification/adaptive/adaptive_tube_claim", _ADAPTIVE),
    Room(
        "identification/adaptive/adaptive_certificate",
        _TOLD,
        places=(
            *(f"AdaptiveCertificate.{name}" for name in ("verdict", "_known", "_beyond", "sliding", "efforts")),
            *("AdaptiveCertificate.mean_square", "certify_adaptive", "equations_of", "_motors_of", "_check"),
        ),
    ),
    Room("identification/estimates/motion_errors", (f"identification/test_motion_errors.py::test_{_MOTION_ERRORS}",)),
    Room(
        "identification/estimates/motor_constants",
        ("identification/test_sharp_motor_constants.py",),
        (
            ("_SETTLED, _ROUNDING =", "0.01 × ", "hundredths of a deviation that k may be off; a tenth is noticed"),
            ("_SETTLED, _ROUNDING =", "1e-09 × ", "what is left of steps is rounding well before"),
            ("if away @ away <=", "left × 0.5", "as the hundredth itself, and what is left then is rounding"),
        ),
    ),
    Room("identification/estimates/marginal_motors", ("identification/test_marginal_motors.py",)),
    Room(
        "identification/estimates/coloured_noise",
        _COLOURED,
        (
            ("_ROUNDING =", "1e-14 × ", "stands for a variance of 0 that is divided by: the other one is told there"),
            ("np.maximum(pairs, 1.0)", "1 × 0.", "where there is no pair the products are 0"),
        ),
    ),
)

EXCUSED = (
    Excused(
        "identification/combinations/dependent_columns", ("_OUT", "_LEAST"), "margins over roundings that no test meets"
    ),
    Excused("identification/combinations/dependent_search", (), "proposes; `dependent_columns` checks"),
    Excused("identification/combinations/identifiable", (), "proposes; `rank_claims` checks"),
    Excused("identification/combinations/base_combinations", (), "reads off facts what `rank_claims` checked"),
    Excused(
        "identification/adaptive/adaptive_bounds", ("_NUMBERS", "bounds_of"), "how many cells are bounded at a time"
    ),
    Excused("identification/adaptive/adaptive_certificate", ("AdaptiveCertificate.reason",), "words"),
    Excused("identification/adaptive/adaptive_reading", (), "reads a mechanism; claims are about what was read"),
    Excused("identification/adaptive/adaptive_search", (), "looks for a tube and proposes it: `AdaptiveTube` checks"),
    Excused(
        "identification/combinations/recorded_twists",
        (),
        "records; tests tell that it is the mechanism",
    ),
)
