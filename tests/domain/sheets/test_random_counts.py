"""How many configurations random linkages are said to have: never a number that closed forms or intervals refute.

The campaign: 300 mechanisms, 100,000 points each where there is a closed form and 200 where intervals are searched,

    CCPIN_LINKAGES=300 pytest -m slow -s tests/domain/sheets/test_random_counts.py
"""

import os
from collections import Counter

import numpy as np
import pytest

from ccpin.domain import certify_sheets
from ccpin.errors import CcpinError, UnsupportedMechanismError
from tests.support import random_linkages, spatial_linkages
from tests.support.long_cases import later

FAMILIES = random_linkages.FAMILIES + spatial_linkages.FAMILIES
_POINTS = 2000
_MANY = int(os.environ.get("CCPIN_LINKAGES", "300"))
_DEPTHS = {1: 9, 2: 5, 3: 3}


def decided(seed, points):
    """What became of one mechanism: a word, its family, false counts, and the share of its region that is counted."""
    rng = np.random.default_rng(seed)
    family = FAMILIES[seed % len(FAMILIES)]
    try:
        case = family(rng)
    except CcpinError:
        return "does not close", family.__name__, 0, 0.0
    try:
        sheets = certify_sheets(case.mechanism, case.region, max_depth=_DEPTHS[len(case.region[0])], seconds=20.0)
    except UnsupportedMechanismError:
        return "refused", family.__name__, 0, 0.0
    q = rng.uniform(*case.region, (min(200, points) if case.searched else points, len(case.region[0])))
    true, said = case.counts(q), sheets.number_of_solutions(q)
    wrong = int(np.sum((true >= 0) & (said >= 0) & (said != true)))
    return "counted", family.__name__, wrong, sheets.counted_fraction


@pytest.mark.parametrize("every", later(4, 2))
def test_no_count_is_false(every):
    """One of every fourth family, or of every second."""
    found = [decided(seed, _POINTS) for seed in range(0, len(FAMILIES), every)]
    assert not any(wrong for _, _, wrong, _ in found), found
    assert sum(word == "counted" for word, *_ in found) > 0.6 * len(found), found
    assert np.mean([share for word, _, _, share in found if word == "counted"]) > 0.8, found


@pytest.mark.parametrize("family", [spatial_linkages.cut_in_a_body, spatial_linkages.cut_at_a_slide])
def test_ends_turned_over_are_not_counted(family):
    """φ of such a closure vanishes there too: four were counted where two close, by the families' closed forms."""
    case = family(np.random.default_rng(12))
    with pytest.raises(UnsupportedMechanismError, match=r"closure '(cut|slide)' .* turned over"):
        certify_sheets(case.mechanism, case.region)


@pytest.mark.slow
def test_no_count_of_many_is_false():
    """The campaign; what is decided, refused and does not close is printed."""
    found = [decided(seed, 100_000) for seed in range(_MANY)]
    print(Counter(word for word, *_ in found))  # noqa: T201
    for family in dict.fromkeys(FAMILIES):
        ours = [(word, share) for word, name, _, share in found if name == family.__name__]
        shares = [share for word, share in ours if word == "counted"]
        print(f"{family.__name__}: {len(shares)} of {len(ours)} counted, over {np.mean(shares or [0.0]):.4f}")  # noqa: T201
    assert not any(wrong for _, _, wrong, _ in found), [row for row in found if row[2]]
