"""Theorem 2: quadratic forms of closures, and the radius about a configuration."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

_QUADRATIC = "domain/theorem2/test_quadratic.py"
_NAMED = "which products are unknowns of their own: any choice is a form"
_FORMS = (
    "domain/theorem2/test_sharp_forms.py",
    *(
        f"{_QUADRATIC}::{test}"
        for test in (
            "test_gear_rows_are_sines",
            "test_racks_are_linear",
            "test_closure_rows_are_phi",
            "test_rows_that_lock_a_spin",
            "test_couplings_without_a_quadratic_form",
            "test_planar_loops_are_affine_in_absolute_directions",
            "test_forms_vanish_on_closed_configurations",
            "test_redundant_rows_are_refused",
            "test_every_closure_kind",
        )
    ),
    "domain/theorem2/test_theorem2.py::test_spherical_joint_as_coordinate",
    f"{_QUADRATIC}::test_floating_joints_and_distances",
)
ROOMS: tuple[Room, ...] = (
    Room(
        "domain/theorem2/polynomials",
        (
            "domain/theorem2/test_sharp_radius.py",
            *(
                f"{_QUADRATIC}::{test}"
                for test in (
                    "test_the_papers_worked_example",
                    "test_system_against_sympy",
                    "test_radius_is_sharp_for_a_square_root",
                    "test_singular_centre",
                    "test_what_is_not_a_quadratic_system",
                )
            ),
        ),
        (
            ('f"equation {i + 1}', "", "words"),
            *(
                (line, "", "when a Jacobian is called singular: nothing is claimed of the formula's rounding")
                for line in ("rcond = 1.0 / float(", "if rcond < np.finfo")
            ),
        ),
    ),
    Room("domain/theorem2/radius", ("domain/theorem2/test_sharp_radius.py",)),
    Room(
        "domain/theorem2/couplings",
        _FORMS,
        (("sides[m > 0] = ", "0 let in", "ratios are of terms that have one, or are refused"),),
    ),
    Room(
        "domain/theorem2/form",
        _FORMS,
        (("kind.nv == 1 and kind.sliding", "not asked: kind.nv", "parts that slide are one slide"),),
    ),
    Room(
        "domain/theorem2/unknowns",
        _FORMS,
        (
            ("(1.0 if w >= 0 else", "0 left out", "at half a turn both quaternions are the rotation's"),
            *((line, "", _NAMED) for line in ("if new > 2 *", "components = sum(", "new = sum(")),
            ("if left.degree + right.degree > 2", "left × 2", _NAMED),
        ),
    ),
    Room(
        "domain/theorem2/trees",
        _FORMS,
        (
            ("kind.steps == _TURNS", "not asked: kind.steps", "a ball is its own only part either way"),
            ("placement[:3, :3] = without_noise(", "", "1e-15 of a placement is within what coefficients are off by"),
            ("while merge and k and", "not asked: k", "on a loop one comes to where the loop begins before the world"),
            ("if any(p.degree for", "", _NAMED),
        ),
    ),
)

EXCUSED: tuple[Excused, ...] = (
    Excused(
        "domain/theorem2/radius",
        ("_SETTLED", "_LEAST", "best_weights", "_least_fixed_point"),
        "scales of unknowns that are tried: the radius of any positive ones is one, and `bounds_at` bounds it",
    ),
    Excused("domain/theorem2/radius", ("_reason",), "words"),
    Excused("domain/theorem2/unknowns", ("JointVariable",), "a type"),
)
