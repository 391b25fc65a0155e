"""Theorem 2: quadratic forms of closures, and the radius about a configuration."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

_QUADRATIC = "domain/theorem2/test_quadratic.py"
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
            "Polynomial.unknown",
            "Polynomial.degree",
            "Polynomial.__add__",
            "Polynomial.__sub__",
            "Polynomial.__mul__",
            "Polynomial.cleaned",
            "combine",
            "QuadraticSystem.from_polynomials",
            "QuadraticSystem.value",
            "QuadraticSystem.magnitude",
            "QuadraticSystem.v",
            "QuadraticSystem.c",
            "QuadraticSystem.radius",
        ),
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
    ),
    Room(
        "domain/theorem2/radius",
        (
            "_CLOSED",
            "_NEAR",
            "_INFLATE",
            "CentreBounds.radius",
            "theorem2",
            "_singular_at",
            "bounds_at",
            "_checked",
            "_apply",
        ),
        ("domain/theorem2/test_sharp_radius.py",),
    ),
    Room(
        "domain/theorem2/couplings",
        ("coupling_row", "_displacement_row", "_angle_row", "_whole_ratios", "_times"),
        _FORMS,
    ),
    Room(
        "domain/theorem2/form",
        (
            "COEFFICIENT_ERROR",
            "quadratic_form",
            "_check_square",
            "_rigidity_defect",
            "_closure_rows",
            "_last_rows",
        ),
        _FORMS,
    ),
    Room(
        "domain/theorem2/unknowns",
        (
            "NOISE",
            "AngleTerm.at",
            "Circle.values",
            "Slide.values",
            "Ball.values",
            "Unknowns.affine",
            "Unknowns.affine_vector",
            "Unknowns.product",
            "Unknowns.dot",
            "Unknowns.lift",
            "Unknowns.identities",
            "Unknowns._add",
            "plus",
            "without_noise",
        ),
        _FORMS,
    ),
    Room(
        "domain/theorem2/trees",
        (
            "PARALLEL",
            "simple_tree",
            "_parts",
            "_angular",
            "find_runs",
            "Kinematics._introduce",
            "Kinematics.angle_term",
            "Kinematics.turn",
            "Kinematics._groups",
            "Kinematics._through",
            "Kinematics._rotate",
            "_circle_rotation",
            "_ball_rotation",
        ),
        _FORMS,
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
