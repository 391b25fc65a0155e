"""No fact comes of claims about singular curves that are misshapen, altered, borrowed or about other equations."""

from dataclasses import replace

import numpy as np
import pytest

import ccpin
from ccpin.domain import SingularCover, certify_path, certify_singularities
from ccpin.errors import InvalidInputError
from ccpin.proof.curves.singular_covers import SingularCovered, covers
from ccpin.proof.curves.tube_claims import GluedTubes, SingularTubes, tubes_of
from ccpin.proof.curves.tubes import stated
from ccpin.proof.equations import closures_of
from ccpin.proof.facts import NotProvedError, prove, prove_some
from tests.support.refusals import refused

REGION = np.radians(((118.0, 52.0), (121.0, 55.0)))  # of the RPDR: a piece of the fold


@pytest.fixture(scope="module")
def cover(rpdr):
    """All curves over the region: one, in some tubes."""
    found = certify_singularities(rpdr, REGION)
    assert found.verdict == "proven"
    assert len(found.proved.tubes.claim.half) > 3
    return found


@pytest.fixture(scope="module")
def others(rpdr):
    """Facts about other closures."""
    longer = ccpin.domain.scaled_links("rpdr", links={"arm": ("link1",)})({"arm": 1.01})
    return certify_singularities(longer, REGION, resolution=0.1).proved


def changed(claim, change):
    """The claim with some arrays altered."""
    return replace(claim, **{name: alter(getattr(claim, name).copy()) for name, alter in change.items()})


MISSHAPEN = {
    "a coordinate too few": {"theta": lambda x: x[:, :-1]},
    "a kernel of another size": {"kernel": lambda x: np.concatenate([x, x], axis=1)},
    "no l": {"pairing": lambda x: x[:, :0]},
    "a tube too few": {"half": lambda x: x[:-1]},
    "a tangent in q": {"tangent": lambda x: x[:, :2], "radius": lambda x: x[:, :2]},
    "a radius for all": {"radius": lambda x: x[:, 0]},
    "a parameter that is no coordinate": {"along": lambda x: x + 6},
    "a negative coordinate": {"along": lambda x: x - 6},
    "coordinates as floats": {"along": lambda x: x.astype(float)},
    "single precision": {"tangent": lambda x: x.astype(np.float32)},
    "words": {"theta": lambda x: x.astype(str)},
    "nothing": {"half": lambda x: None},
    "no number": {"theta": lambda x: x * np.nan},
    "no number for a kernel": {"kernel": lambda x: x * np.nan},
    "an endless radius": {"radius": lambda x: x + np.inf},
    "an endless tube": {"half": lambda x: x * np.inf},
    "no length": {"half": lambda x: 0.0 * x},
    "a negative length": {"half": lambda x: -x},
    "a negative radius": {"radius": lambda x: -x},
}
ALTERED = {
    "a narrower tube": {"radius": lambda x: 1e-5 * x},
    "a wider tube": {"radius": lambda x: 1e4 * x},
    "a longer tube": {"half": lambda x: 4.0 * x},
    "another centre": {"theta": lambda x: x + 0.01},
    "another kernel": {"kernel": lambda x: -x},
    "another l": {"pairing": lambda x: -x},
    "an l of zeros": {"pairing": lambda x: 0.0 * x},
    "another direction": {"tangent": lambda x: np.roll(x, 1, axis=1)},
    "another parameter": {"along": lambda x: (x + 1) % 6},
    "a parameter that runs twice as fast": {"tangent": lambda x: 2.0 * x, "half": lambda x: 0.5 * x},
    "a parameter that runs half as fast": {"tangent": lambda x: 0.5 * x, "half": lambda x: 2.0 * x},
    "a tube that is wide along its own parameter": {"radius": lambda x: np.maximum(x, 1e-12)},
}


@pytest.mark.parametrize("change", [*MISSHAPEN.values(), *ALTERED.values()], ids=[*MISSHAPEN, *ALTERED])
def test_no_fact_comes_of_other_tubes(cover, change):
    """Tubes that are misshapen, or whose numbers were altered."""
    refused(lambda: changed(cover.proved.tubes.claim, change))


@pytest.mark.parametrize("change", ALTERED.values(), ids=ALTERED)
def test_one_altered_tube_is_left_out(cover, change):
    """Of many, and only it."""
    claim = cover.proved.tubes.claim
    one = {
        name: (lambda x, alter=alter: np.concatenate([x[:1], alter(x[1:2]), x[2:]])) for name, alter in change.items()
    }
    fact, kept = prove_some(changed(claim, one))
    assert np.flatnonzero(~kept).tolist() == [1]
    assert len(fact.claim.half) == len(fact.found["kappa"]) == len(kept) - 1
    np.testing.assert_array_equal(fact.claim.theta, np.delete(claim.theta, 1, axis=0))


def test_tubes_follow_from_their_data(cover):
    """P, κ and the hull are found by the kernel: neither in the claim nor anybody's to give."""
    fact = cover.proved.tubes
    assert set(fact.found) == {"gain", "kappa", "hull"}
    assert np.all(fact.found["kappa"] < 1.0)
    assert np.all(fact.found["hull"] <= fact.claim.radius)
    refused(lambda: fact.claim, fact)
    for other in (fact.claim.theta, None, fact, "tubes"):
        refused(lambda other=other: other)


GLUED = {
    "a tube that is not there": {"first": lambda x: x + 1000},
    "another that is not there": {"second": lambda x: x + 1000},
    "a negative number": {"first": lambda x: x - 1},
    "one too few": {"second": lambda x: x[:-1]},
    "floats": {"first": lambda x: x.astype(float)},
    "small integers": {"second": lambda x: x.astype(np.int32)},
    "a mask": {"first": lambda x: x > 0},
    "the other way": {"first": lambda x: x + 1, "second": lambda x: x - 1},
    "tubes far apart": {"second": lambda x: x[::-1]},
    "to itself": {"second": lambda x: x - 1},
}


@pytest.mark.parametrize("change", GLUED.values(), ids=GLUED)
def test_no_tubes_are_glued_by_other_numbers(cover, change):
    """One runs on in the next, not back, nor in itself."""
    refused(lambda: changed(cover.proved.glue.claim, change), cover.proved.tubes)


def test_gluing_is_about_facts_of_the_same_equations(cover, others):
    """Neither other closures' tubes nor claims nor other facts."""
    claim, (tubes, glue, covered) = cover.proved.glue.claim, cover.proved
    assert prove(claim, tubes).claim.theorem == "tubes"
    for premises in ((others.tubes,), (), (glue,), (tubes, glue), (covered,), (tubes.claim,)):
        refused(lambda: claim, *premises)
    with pytest.raises(NotProvedError):
        tubes_of(tubes.claim.equations, [tubes, glue])


def test_tubes_of_several_facts_are_numbered_through(cover):
    """What is glued in one fact is glued between two."""
    (tubes, glue, _), k = cover.proved, 2
    count = len(tubes.claim.half)
    parts = [prove(tubes.claim.take(part)) for part in (slice(k), slice(k, None))]
    assert len(prove(glue.claim, *parts).claim.first) == count - 1
    swapped = prove_some(glue.claim, *parts[::-1])[1]
    assert np.flatnonzero(~swapped).tolist() == [count - k - 1]


COVERED = {
    "corners that are exchanged": {"lower": lambda x: x + 1.0},
    "a coordinate too many": {"lower": lambda x: np.append(x, 0.0)},
    "no corner": {"upper": lambda x: x * np.nan},
    "an endless region": {"upper": lambda x: x * np.inf},
    "limits that are exchanged": {"limits": lambda x: -x},
    "limits of all coordinates": {"limits": lambda x: np.concatenate([x, x])},
    "lower limits alone": {"limits": lambda x: x[:, :1]},
    "endless limits": {"limits": lambda x: 1e9 * x},
    "a middle of y alone": {"middle": lambda x: x[2:]},
    "no middle": {"middle": lambda x: x * np.nan},
    "no resolution": {"resolution": lambda x: 0.0 * x},
    "a resolution each way": {"resolution": lambda x: np.append(x, x)},
    "a number of boxes that is none": {"most": lambda x: x.astype(float)},
    "a negative number of boxes": {"most": lambda x: -x},
}


@pytest.mark.parametrize("change", COVERED.values(), ids=COVERED)
def test_no_region_is_covered_by_other_numbers(cover, change):
    """Regions, limits and efforts that are none."""
    with np.errstate(over="ignore"):
        refused(lambda: changed(cover.proved.covered.claim, change), cover.proved.tubes)


def test_a_cover_is_of_tubes_of_the_same_equations(cover, others):
    """Other premises are refused; without tubes, or with too few, boxes are listed along the curve."""
    (tubes, glue, covered), rough = cover.proved, {"resolution": lambda x: x + 0.05}
    for premises in ((others.tubes,), (glue,), (tubes, glue), (covered,), (tubes.claim,)):
        refused(lambda: covered.claim, *premises)
    claim = changed(covered.claim, rough)
    for premises in ((), (prove(tubes.claim.take(slice(1))),)):
        left = prove(claim, *premises).found
        assert len(left["lower"]) > 0
        assert not left["early"][0]
    assert not len(prove(claim, tubes).found["lower"])


def test_coordinates_other_than_two(rpdr):
    """Singular configurations of one or three are no curves; what other rooms prove is no premise."""
    mechanism = ccpin.load("four_bar")
    path = certify_path(mechanism, np.array([[1.0], [1.1]]))
    equations = closures_of(path.problem)
    sizes = equations.sizes
    m, n = sizes["M"], sizes["N"]
    point, x = np.zeros((1, m)), np.zeros((1, n + m))
    along, tangent = np.zeros(1, dtype=np.int64), x + np.eye(1, n + m)
    refused(lambda: SingularTubes(equations, np.zeros((1, n)), point, point, along, tangent, np.ones(1), x))
    none = np.zeros((m, 2)) + [-1.0, 1.0]
    most = np.ones(1, dtype=np.int64)
    refused(lambda: SingularCovered(equations, np.zeros(1), np.ones(1), none, np.zeros(n), np.ones(1), most))


def test_covers_are_asked_of_facts_about_regions(cover):
    """Of its own region, limits and tubes a fact says so; other facts are refused."""
    claim, tubes = cover.proved.covered.claim, stated(tubes_of(cover.proved.covered.claim.equations, cover.proved[:1]))
    region = claim.lower, claim.upper
    assert covers(cover.proved.covered, region, claim.limits, tubes)
    assert not covers(cover.proved.covered, region, claim.limits, tubes._replace(radius=0.5 * tubes.radius))
    for fact in (cover.proved.tubes, claim, None):
        with pytest.raises(NotProvedError):
            covers(fact, region, claim.limits, tubes)


def test_a_file_with_tubes_that_run_at_another_pace_is_refused(cover, tmp_path):
    """Theorem R holds for the same segment: but where points are in the tube is told by |t_j| = 1."""
    curve = cover.curves[0]
    slower = curve._replace(tubes=curve.tubes._replace(tangent=0.5 * curve.tubes.tangent, half=2.0 * curve.tubes.half))
    replace(cover, curves=(slower,)).save(tmp_path / "curves.npz")
    with pytest.raises(InvalidInputError, match="tube 0 is not proved"):
        SingularCover.load(tmp_path / "curves.npz")


def test_facts_are_replayed(cover):
    """From their data alone, with what follows."""
    again = cover.proved.covered.replay()
    assert again.digest == cover.proved.covered.digest
    assert not len(again.found["lower"])
    assert type(cover.proved.glue.replay().claim) is GluedTubes
