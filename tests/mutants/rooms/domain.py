"""Paths and their refutations, closures, workspaces; bounds of the dynamics."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

_GRAVITY = "control/stability/set_point/test_gravity_bounds.py"
_SPACES = ("domain/workspaces/test_sharp_workspaces.py",)
_READING = ("domain/closures/test_sharp_reading.py",)
_SEARCHED = ("domain/closures/test_sharp_searchable.py",)
_CURVE = "which lines and curves are tried: `proof.facts.prove` checks what they meet"
_LINES = "which lines are tried, and how far: what is found on one is proved of itself"
_MOTION = "control/stability/tracking/test_motion_bounds.py"
ROOMS: tuple[Room, ...] = (
    Room(
        "control/stability/set_point/potential",
        ("control/stability/set_point/test_sharp_gravity.py",),
        places=("_remainder", "_slope_bound", "_curvature_change", "_inverse_bound", "_variation", "_symmetric"),
    ),
    Room(
        "control/stability/set_point/potential",
        (
            "control/stability/set_point/test_sharp_gravity.py",
            "control/stability/set_point/test_sharp_potential.py",
            f"{_GRAVITY}::test_centre_is_exact",
            f"{_GRAVITY}::test_the_bounds_are_attained_by_a_lone_arm",
            f"{_GRAVITY}::test_norm_bounds_the_variation",
        ),
    ),
    Room(
        "control/stability/set_point/set_point_reading",
        ("control/stability/set_point/test_sharp_potential.py", "control/stability/set_point/test_sharp_sets.py"),
        (
            ("if number == 0 or inertia.mass", "not asked: inertia.mass", "what has no mass weighs nothing"),
            ("if number == 0 or inertia.mass", "not asked: number == 0", "the tree keeps no mass of its base"),
        ),
        places=("masses_of", "_padded"),
    ),
    Room(
        "domain/paths/pieces",
        ("domain/paths/test_sharp_pieces.py",),
        (
            ('raise InvalidInputError(f"the path', "", "words"),
            ("if coefficients.ndim != 3 or", "not asked: coefficients.ndim", "the shape asked for next has three axes"),
            ('f"(degree + 1, {len(knots)', "", "words"),
        ),
    ),
    Room(
        "domain/workspaces/largest",
        _SPACES,
        (("(edges[across] < np.inf)", "left × 0.5", "half of what is not finite is not either"),)
        + tuple(
            (line, "", "how long is searched, and which of two certified sets is told")
            for line in (
                "if stop.is_set() and first",
                "flat, seconds = goal._replace(",
                "until = None if",
                "left = None if",
            )
        ),
    ),
    Room(
        "domain/workspaces/workspace",
        _SPACES,
        (
            ("least = number(", "", "any number below 0 lets 0 in and keeps others out"),
            ("if turns and slides and", "not asked: turns", "without turns none are added"),
            ("if turns and slides and", "not asked: slides", "without positions all would be held, which is refused"),
        ),
    ),
    Room("domain/closures/system", _READING),
    Room("domain/closures/rods", _READING),
    Room("domain/closures/scalar_coordinates", _READING),
    Room(
        "domain/closures/task_coordinates",
        _READING,
        (("joint_b=len(tree.joints) + 1", "", "closures are read along their paths alone"),),
    ),
    Room("domain/closures/packing", _READING),
    Room("domain/closures/searchable", _SEARCHED),
    Room("domain/closures/seeds", _SEARCHED),
    Room(
        "domain/paths/refutation",
        ("domain/paths/test_sharp_refutation.py",),
        (
            ("directions = directions[np.any(", "", _CURVE),
            ("if join is None or not len(", "not asked: not len", "nothing is found on no lines"),
            ("inside = found.proved", "", _CURVE),
        ),
    ),
    Room(
        "domain/paths/obstacles",
        ("domain/paths/test_sharp_obstacles.py",),
        (
            ("if last is None or kind", "not asked: last", "nothing fails where there is no place"),
            ("if here is None or place", "not asked: place", "nothing fails where there is no place"),
            *(("_SHARES = (", f"{share} ×", _LINES) for share in ("0.3", "0.45", "0.65")),
            *(("_SHARES = (", f"1 × {factor}", _LINES) for factor in ("0.5", "0.9")),
            *(
                (line, "", _LINES)
                for line in (
                    "if walker is None or len(",
                    "if found is None and walker.here",
                    "if found is None and stuck <",
                    "found, stuck = _singular(",
                    "if found is not None or walker.here",
                    "walker.walk(1.0)",
                    "middle = 0.5 *",
                )
            ),
        ),
    ),
    Room(
        "domain/paths/path",
        ("domain/paths/test_sharp_path.py",),
        (
            ("shares = np.max(", "1e-300", "what is divided where the tube has no width is not looked at"),
            ("shares = np.max(", "0 let in", "then there is less room for corners"),
        ),
    ),
    Room(
        "domain/paths/path",
        (
            "domain/test_pickled_certificates.py",
            "domain/paths/test_sharp_path.py",
        ),
        places=("CertifiedPath.reason", "CertifiedPath.replay"),
    ),
    Room(
        "domain/paths/walker",
        ("domain/paths/test_sharp_walker.py",),
        (("ends = ends[ends > here]", "left × 2", "strides lead ahead, or nowhere"),),
    ),
    Room(
        "domain/paths/walker",
        ("domain/paths/test_sharp_refutation.py",),
        places=("Walker.point_here", "Walker.leads_to"),
    ),
    Room(
        "proof/chords",
        ("domain/paths/test_sharp_pieces.py", "control/stability/tracking/test_sharp_cell_forms.py"),
        (("deviation = away.max(axis=0)", "4 × ", "more than the roundings of the sum above it"),),
    ),
    Room(
        "control/stability/tracking/motion_bounds",
        (
            *(
                f"{_MOTION}::{test}[{name}]"
                for name in ("sprung", "slider_crank", "rpdr")
                for test in ("test_at_one_configuration_they_are_the_model", "test_over_sets_they_hold_their_members")
            ),
            "control/stability/tracking/test_sharp_masses.py",
            f"{_MOTION}::test_at_one_configuration_they_are_the_model[delta]",
        ),
        places=(
            "Tips.third_along",
            *("tips_of", "gathered"),
            "Reduced.__init__",
            "Reduced.free_inertia",
            "Reduced.coriolis",
            "Reduced.force_slope",
            "Reduced._third",
            "Reduced.rho_dot",
            "Reduced.pairs",
            "Reduced.whole",
            "_FreeForce.__init__",
            "placed",
        ),
    ),
    Room(
        "control/stability/tracking/mass_reading",
        (
            *(
                f"{_MOTION}::test_at_one_configuration_they_are_the_model[{name}]"
                for name in ("sprung", "slider_crank")
            ),
            "control/stability/tracking/test_sharp_masses.py",
        ),
        (
            ("if inertia.mass and path", "not asked: inertia.mass", "a tip of no mass weighs nothing"),
            ("if inertia.mass and path", "not asked: path", "the tree keeps no mass of its base"),
            ("if np.any(inertia.inertia)", "not asked: np.any(inertia", "directions of no moments weigh nothing"),
        ),
    ),
)

EXCUSED: tuple[Excused, ...] = (
    Excused(
        "domain/workspaces/largest",
        (
            "_PUSHED",
            "_GROWN",
            "_GROWTHS",
            "_EDGE",
            "_FIRST",
            "_AROUND",
            "_MAP_SECONDS",
            "_BETTER",
            "LargestWorkspace._suspects",
            "_sides",
            "_reach",
            "_SearchScope.about",
            "_SearchScope.moved",
        ),
        "where is searched and how far: each set found is an atlas's own, each obstacle a witness's",
    ),
    Excused("domain/workspaces/inscribed", (), "where a centre is sought: what is told of it is certified anew"),
    Excused("domain/workspaces/synthesis", (), "which designs are tried: the best is told with its own certificate"),
    Excused("domain/workspaces/workspace", ("Limits",), "a type"),
    Excused(
        "domain/paths/path", ("_AHEAD",), "how far ahead is looked: `_targets` asks of each that it lies in the tube"
    ),
    Excused("domain/paths/walker", ("Walker.proved",), "what is claimed of a walk: `proof.facts.prove` checks it"),
    Excused("domain/paths/path", ("_reason",), "words"),
    Excused("domain/paths/obstacles", ("_singular",), _LINES),
    Excused(
        "domain/paths/walker",
        ("TRIES", "SHORTEST", "_WIDER", "Walker.walk"),
        "by which steps one walks: each box is proved, and glued to the one before, whatever its size",
    ),
    Excused(
        "domain/paths/refutation",
        ("_JOINS", "_BEYOND", "_join", "_on_branch", "line_problem"),
        "which boxes and curves are tried: `proof.facts.prove` checks them",
    ),
)
