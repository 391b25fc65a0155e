"""Chains as facts have them: each tube proved and glued to the next, closed if the last is to the first, else apart."""

from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.covering.region import Region
from ccpin.domain.singular import curve_claims as module
from ccpin.domain.singular.curve_claims import SearchEffort, proved_chains, proved_cover, proved_tubes
from ccpin.domain.singular.following import TubeChain
from ccpin.proof.curves import tube_claims
from ccpin.proof.curves.tubes import stated
from ccpin.proof.ranges import NO_LIMIT, Ranges
from tests.support.made_up import made_up
from tests.support.straight_curves import PROBLEM, is_chain, straighten, tubes

EQUATIONS = SimpleNamespace(system=SimpleNamespace(**vars(PROBLEM.system), n=2), problem=PROBLEM)
RING = np.arange(0.0, 2 * np.pi - 0.1, 0.25)


@pytest.fixture(autouse=True)
def _straight(monkeypatch):
    """Facts about straight curves are those of what is examined."""

    def prove_some(claim, *premises):
        examined = claim.examined(*premises)
        found = {name: array[examined.proved] for name, array in examined.found.items()}
        return SimpleNamespace(claim=claim.take(examined.proved), found=found), examined.proved

    straighten(monkeypatch)
    monkeypatch.setattr(module, "prove_some", prove_some)
    monkeypatch.setattr(module, "closures_of", lambda problem: EQUATIONS)
    for place in (module, tube_claims):
        monkeypatch.setattr(place, "no_tubes", lambda problem: tubes((0.0, 0.4)).take(slice(0)))


def chain_of(*middles, closed=False, broken=()):
    """Tubes about middles; those that are broken are not proved."""
    made = tubes(*((c, 0.4) for c in middles))
    theta = made.theta.copy()
    theta[list(broken), 1] += 0.2
    return TubeChain(made._replace(theta=theta), closed)


def found(*chains):
    """Middles and ends of the chains that are proved, and the facts."""
    facts, parts = proved_chains(PROBLEM, chains)
    assert facts.covered is None
    assert all(is_chain(part) for part in parts)
    return [(part.tubes.theta[:, 0].tolist(), part.closed) for part in parts], facts


def test_chains_that_are_proved_stay():
    """Open and closed ones, none, and of one tube; the facts are about all of them, one behind the other."""
    parts, facts = found(chain_of(2.0, 2.25, 2.5), chain_of(*RING, closed=True), chain_of(1.0))
    assert parts == [([2.0, 2.25, 2.5], False), (RING.tolist(), True), ([1.0], False)]
    np.testing.assert_array_equal(facts.tubes.claim.theta[:, 0], [2.0, 2.25, 2.5, *RING, 1.0])
    pairs = list(zip(facts.glue.claim.first.tolist(), facts.glue.claim.second.tolist(), strict=True))
    count = len(RING)
    assert pairs == [(0, 1), (1, 2), *((3 + k, 3 + (k + 1) % count) for k in range(count))]
    assert found()[0] == []


def test_chains_that_are_not_glued_are_apart():
    """Where a tube is missing, or not proved, or is said to close what it does not."""
    assert found(chain_of(0.0, 0.25, 1.5, 1.75))[0] == [([0.0, 0.25], False), ([1.5, 1.75], False)]
    assert found(chain_of(0.0, 0.25, 0.5, closed=True))[0] == [([0.0, 0.25, 0.5], False)]
    gap = found(chain_of(*RING, closed=True, broken=[4, 5, 6, 7]))[0]
    assert gap == [(RING[:4].tolist(), False), (RING[8:].tolist(), False)]
    first = found(chain_of(*RING, closed=True, broken=[0, 1, 2, 3]))[0]
    assert first == [(RING[4:].tolist(), False)]
    whole = found(chain_of(*RING, closed=True, broken=[5]))[0]
    assert [(len(middles), closed) for middles, closed in whole] in (
        [(len(RING) - 1, True)],
        [(5, False), (len(RING) - 6, False)],
    )
    assert found(chain_of(0.0, 0.25, broken=[0, 1]), chain_of(1.0))[0] == [([1.0], False)]
    assert found(chain_of(0.0, closed=True))[0] == [([0.0], False)]
    one, facts = found(chain_of(0.0, 0.25, broken=[0]), chain_of(0.0, 0.25, 0.5))
    assert one == [([0.25], False), ([0.0, 0.25, 0.5], False)]
    assert facts.glue.claim.first.tolist() == [1, 2]


def test_tubes_that_are_proved_are_told():
    made = chain_of(0.0, 0.25, 0.5, broken=[1]).tubes
    given = stated(made)._replace(along=made.along.astype(np.int32))
    fact, kept = proved_tubes(PROBLEM, given)
    assert kept.tolist() == [0, 2]
    assert fact.claim.along.dtype == np.int64


def test_what_is_asked_of_a_region(monkeypatch):
    """Its corners, limits, the middles of ranges; more boxes than a search tried, or as many if it had to end."""
    asked = []
    monkeypatch.setattr(module, "prove", lambda *given: asked.append(given))
    region = Region(np.array([1.0, 2.0]), np.array([3.0, 4.0]), np.zeros(2, dtype=bool))
    reasons, limits = np.zeros((2, 2), dtype=np.int8), np.array([[-NO_LIMIT, NO_LIMIT], [-1.0, 5.0]])
    ranges = Ranges(np.array([-NO_LIMIT, -1.0]), np.array([NO_LIMIT, 5.0]), reasons, limits)
    for ended, most in ((True, 4 * 100 + 10_000), (False, 100)):
        proved_cover(made_up(), region, ranges, SearchEffort(1e-3, 100, ended), "tubes")
        claim, tubes = asked.pop()
        assert (tubes, claim.equations) == ("tubes", EQUATIONS)
        np.testing.assert_array_equal([claim.lower, claim.upper], [[1.0, 2.0], [3.0, 4.0]])
        np.testing.assert_array_equal(claim.middle, [0.0, 0.0, 2.0, 0.0])
        np.testing.assert_array_equal(claim.limits, limits)
        assert (claim.resolution.tolist(), claim.most.tolist()) == ([1e-3], [most])
