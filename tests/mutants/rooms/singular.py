"""Curves of singular configurations, folds and cusps."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

_TUBES = (
    ("(tangent @ forward)[:, None] < 0.0", "0 let in", "which way a tangent points that is across"),
    ("hull = np.minimum(", "maximum instead of minimum", "the curve is within a wider hull too"),
    ("np.abs(step) <= _CLOSE", "", "when a zero is close enough: its error is of what is left"),
    ("if not np.any(ahead", "", "whether more zeros are tried"),
)
ROOMS: tuple[Room, ...] = (
    Room(
        "proof/curves/tubes",
        (
            "proof/curves/test_sharp_tubes.py",
            "proof/curves/test_sharp_places.py",
            "proof/curves/test_sharp_settled_boxes.py",
        ),
        _TUBES,
    ),
    Room(
        "domain/singular/joining",
        ("domain/singular/test_sharp_joining.py",),
        (
            ("found[row[~nearby.hold(middle)]] = False", "", "such a piece is halved until there are no halves left"),
            ("meeting.turned == turned", "not asked: meeting.turned", "no curve is glued to itself turned round"),
            ("found.append(_Meeting(", "", "the order in which joints are tried"),
            ("other.closed >= chain.closed", "left × 2", "a truth is 0 or 1, and 2 is above 1 too"),
        ),
    ),
    Room(
        "domain/singular/following",
        ("domain/singular/test_sharp_following.py",),
        (
            ("if back.inside[0] and", "back", "a look before `glued` is asked, which proves it"),
            ("if back.inside[0] and", "0 let in", "a look before `glued` is asked, which proves it"),
            ("while len(tubes)", "MOST_TUBES", "how far curves are followed"),
            ("sizes = np.maximum(", "", "which lengths are tried"),
        ),
    ),
    Room(
        "domain/singular/merged",
        ("domain/singular/test_sharp_merged.py",),
        (
            ("row = int(", "", "which of the limits are named"),
            ("if covered[slab].any():", "", "which box that is left out is named"),
            ("if width >= TURN - _ALIGNED:", "without _ALIGNED", "what is so short a turn is so by `_between` too"),
            ("inside = (cuts[:-1, None] >=", "without _ALIGNED", "the tolerance of the other side is enough"),
        ),
    ),
    Room(
        "proof/curves/settled_boxes",
        ("proof/curves/test_sharp_settled_boxes.py",),
        (
            ("most = solve_many(", "", "any u > 0 will do: it is checked below"),
            ("(most > 0.0) &", "0 let in", "Du < u fails where an entry of u is 0"),
            ("worth = ~done & (wide", "", "which tubes are tried"),
            ("wide = extent.max", "", "which tubes are tried"),
            ("going = ~settled_now &", "", "how often a box is narrowed: only what is empty or inside is settled"),
        ),
    ),
    Room("proof/curves/tube_claims", ("proof/curves/test_sharp_tube_claims.py",)),
    Room("proof/curves/singular_covers", ("proof/curves/test_sharp_singular_covers.py",)),
    Room("domain/singular/box_tasks", ("domain/singular/test_sharp_box_tasks.py",)),
    Room("domain/singular/curve_claims", ("domain/singular/test_sharp_curve_claims.py",)),
    Room("domain/singular/cover", ("domain/singular/test_sharp_cover.py",)),
    Room(
        "domain/singular/marking",
        ("domain/singular/test_sharp_marking.py",),
        (
            ("size = max(1, ", "", "sizes of work"),
            ("region.position(tree.lower", "", "from where it is looked: `singular_points` proves what is found"),
            ("near = np.all(", "", "from where it is looked: `singular_points` proves what is found"),
            ("rows = np.flatnonzero(near &", "", "from where it is looked: `_marked` asks again what is undecided"),
            ("rows = first + ", "", "from where it is looked: `_marked` asks again what is undecided"),
            ("part = ", "", "sizes of work"),
        ),
    ),
    Room("domain/singular/sampled", ("domain/singular/test_sharp_marking.py",)),
    Room(
        "domain/singular/curve",
        ("domain/singular/test_sharp_curve_answers.py",),
        (("still = bool(", "", "what kind a curve is told to be: its class says that it is not proved"),),
    ),
    Room(
        "domain/singular/curves",
        ("domain/singular/test_sharp_curve_answers.py",),
        (
            ("if not self.curves or", "", "without curves, or configurations, there is nothing to look for"),
            ("half = np.maximum(boxes.upper", "1e-15 ×", "nine times what rounds, as fractions show"),
        ),
    ),
)

EXCUSED: tuple[Excused, ...] = (
    Excused(
        "domain/singular/following",
        ("_FIRST", "_NEXT", "_LEAST", "_ON", "_SAME", "_SETTLED", "_FAR", "longest", "onto_curves"),
        "which tubes are tried: `certify_tubes` and `glued` prove them, and `proof.facts.prove` once more",
    ),
    Excused("domain/singular/joining", ("_REACH", "_Pool.near"), "which tubes are tried: `glued` and `held` prove"),
    Excused(
        "proof/curves/tubes",
        ("frames_at",),
        "which tubes are tried: `certify_tubes` proves them, with any P",
    ),
    Excused("proof/curves/tubes", ("_CLOSE", "_BACK"), "when zeros are close enough, and which are tried"),
    Excused("proof/curves/tubes", ("no_tubes",), "arrays without rows"),
    Excused(
        "proof/curves/settled_boxes",
        ("_WORTH", "Nearby.of", "Nearby._folded", "Nearby.beside", "_may_hold"),
        "which tubes are tried: `settled` proves that one settles a box, `places_in` that it holds a point",
    ),
    Excused("proof/curves/settled_boxes", ("_ROOM", "_LEAST"), "which u of Lemma W is proposed: it is checked"),
    Excused("proof/curves/settled_boxes", ("_PASSES", "_GAIN"), "how often a box is narrowed"),
    Excused(
        "domain/singular/cover",
        (
            *("_MANY", "_SMALL", "_FAR", "_ON_CURVE", "SearchDomain.meets", "CurveSearch._settled"),
            *("CurveSearch._look_from", "CurveSearch._near", "CurveSearch._wanted"),
        ),
        "when and where curves are looked for, and how far followed: `certify_tubes` proves tubes, and boxes that none "
        "settles are listed",
    ),
    Excused(
        "domain/singular/marking",
        ("_REACH", "sigma_at"),
        "from where singular configurations are looked for: `singular_points` proves those found",
    ),
    Excused(
        "domain/singular/sampled",
        (
            "_SOLVED",
            "_all_curves",
            "_SingularEquations.__init__",
            "_SingularEquations.residual",
            "_SingularEquations.solve_from",
            "_SingularEquations.correct",
            "_SingularEquations.tangent",
            "_SingularEquations.follow",
            "_SingularEquations._one_way",
            "_SingularEquations.gap",
            "_SingularEquations.lies_on",
            "_SingularEquations._turned",
        ),
        "sampled curves claim nothing of themselves: `_proved_near` has each point proved, or says NaN",
    ),
    Excused(
        "domain/singular/sampled",
        ("singularity_distance", "characteristic_length"),
        "a measure along sampled points, in double precision, of which nothing is said to be proven",
    ),
    Excused("domain/singular/certifying", ("_reading",), "what an error says: that n is 2 is asked for by !="),
    Excused(
        "domain/singular/curve", ("_STILL",), "what kind a curve is told to be: its class says that it is not proved"
    ),
    Excused(
        "domain/singular/curves",
        ("SingularCover.__repr__", "SingularCover.reason", "SingularCover.save"),
        "words, and what is written: `load` proves it again",
    ),
)
