"""Claims about what can be identified: `ccpin.identification`."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

_CLAIMS = ("identification/test_rank_claims.py", "identification/test_more_sensors.py")
_STRUCTURE = ("identification/test_vanishing.py", "identification/test_more_sensors.py")

ROOMS = (
    Room("identification/exact_spaces", ("reduced", "null_space", "invariant_span"), (*_STRUCTURE, *_CLAIMS)),
    Room(
        "identification/vanishing",
        (
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
        _STRUCTURE,
    ),
    Room(
        "identification/identification_equations",
        (
            "IdentificationEquations.__post_init__",
            "IdentificationEquations.sizes",
            "IdentificationEquations.identities",
            "IdentificationEquations.forms",
            "IdentificationEquations._form",
            "IdentificationEquations._seen",
            *("_stretched", "_masses", "_weights", "_cross", "_sign"),
        ),
        _CLAIMS,
    ),
    Room(
        "identification/rank_claims",
        ("IndependentColumns.examined", "VanishingCombinations.examined"),
        _CLAIMS,
    ),
)

EXCUSED = (
    Excused("identification/identifiable", (), "proposes; `rank_claims` checks"),
    Excused("identification/recorded_twists", (), "records; claims are about what was recorded, as told in tests"),
)
