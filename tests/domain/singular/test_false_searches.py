"""Searches, files and merged parts that go wrong: whatever they lose or make up, nothing false is called proven."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from ccpin import domain
from ccpin.arrays import rows_of
from ccpin.domain.closures.system import reading_of
from ccpin.domain.singular import certifying, cover, curves
from ccpin.domain.singular.cover import CurveSearch
from ccpin.domain.singular.following import TubeChain
from ccpin.errors import InvalidInputError
from tests.support.long_cases import later
from tests.support.paper import CURVED as REGION

COARSE = {"resolution": 0.1, "budget": 5000}
TRUE = ["fold", "self-motion"]


def found_in(rpdr, **effort):
    """What is found over the region: enough of it, so that a search that goes wrong is told soon."""
    return domain.certify_singularities(rpdr, REGION, **(COARSE | effort))


@pytest.fixture(scope="module")
def chains():
    """Curves that were followed: by the start, the region and the ranges they were followed over."""
    return {}


@pytest.fixture(autouse=True)
def followed_once(chains, monkeypatch):
    """Whatever goes wrong about it, of one start comes one curve: each is followed once for all searches here."""
    real = cover.follow

    def follow(problem, theta, kernel, going):
        region, ranges = going.__self__.place
        about = tuple(a.tobytes() for a in (theta, kernel, region.lower, region.upper, *ranges))
        if about not in chains:
            chains[about] = real(problem, theta, kernel, going)
        return chains[about]

    monkeypatch.setattr(cover, "follow", follow)


@pytest.fixture(scope="module")
def honest(rpdr_curves):
    """The two curves, proven to be all."""
    assert (rpdr_curves.verdict, [curve.kind for curve in rpdr_curves.curves]) == ("proven", TRUE)
    return rpdr_curves


def is_open(result):
    """Whether a list that lacks a curve is not called proven, and says what it lacks."""
    lacking = [curve.kind for curve in result.curves] != TRUE
    return lacking and result.verdict == "undecided" and len(result.uncovered.lower) > 0


def test_boxes_that_are_lost(rpdr, monkeypatch):
    """Boxes about stretched loops, all of them or all from some wave on, or everything."""
    real = CurveSearch._kept

    def without_fold(search, waiting):
        kept = real(search, waiting)
        about = np.abs(kept.half).max(axis=1) < 0.4
        stretched = np.cos(kept.centre[:, 0] + kept.centre[:, 1] - kept.centre[:, 2] - kept.centre[:, 3]) < 0.0
        return rows_of(kept, ~(about & stretched))

    for wrong in (without_fold, lambda search, waiting: rows_of(waiting, slice(0))):
        monkeypatch.setattr(CurveSearch, "_kept", wrong)
        assert is_open(found_in(rpdr))


def test_halves_that_are_lost(rpdr, monkeypatch):
    """Of each box one half only."""
    real = cover.halved_steepest
    monkeypatch.setattr(
        cover, "halved_steepest", lambda problem, boxes: rows_of(real(problem, boxes), slice(len(boxes.cell)))
    )
    result = found_in(rpdr)
    assert result.verdict == "undecided"


def test_ranges_that_are_too_short(rpdr, monkeypatch):
    """Half a turn of a joint is searched for a whole one: ranges are derived where they are proved."""
    real = certifying.searched_ranges

    def shorter(*given):
        ranges = real(*given)
        return ranges._replace(lower=ranges.upper - 1e-3)

    monkeypatch.setattr(certifying, "searched_ranges", shorter)
    assert is_open(found_in(rpdr))


def test_boxes_that_are_settled_by_word(rpdr, monkeypatch):
    """As soon as there is a tube every box is."""
    monkeypatch.setattr(cover, "settle_boxes", lambda runner, nearby, boxes: rows_of(boxes, slice(0)))
    assert found_in(rpdr).verdict == "undecided"


def test_curves_that_are_not_handed_on(rpdr, monkeypatch):
    """The first or the last one."""
    real = CurveSearch.run
    for kept in (slice(1, None), slice(0, -1)):
        monkeypatch.setattr(
            CurveSearch,
            "run",
            lambda *given, kept=kept: (lambda found: found._replace(chains=found.chains[kept]))(real(*given)),
        )
        assert is_open(found_in(rpdr))


def test_starts_that_lead_nowhere(rpdr, monkeypatch):
    """Newton's method ends beside the curves."""
    real = cover.onto_curves
    monkeypatch.setattr(cover, "onto_curves", lambda *given: (lambda theta, *rest: (theta + 0.1, *rest))(*real(*given)))
    result = found_in(rpdr)
    assert (result.curves, result.verdict) == ((), "undecided")


ALTERED = {
    "narrower": lambda tubes: tubes._replace(radius=1e-4 * tubes.radius),
    "longer": lambda tubes: tubes._replace(half=4.0 * tubes.half),
    "elsewhere": lambda tubes: tubes._replace(theta=tubes.theta + 0.05),
    "of another kernel": lambda tubes: tubes._replace(kernel=-0.5 * tubes.kernel),
    "no numbers": lambda tubes: tubes._replace(radius=np.nan * tubes.radius),
}


@pytest.mark.parametrize("change", [*later("longer", "elsewhere", "no numbers"), "narrower", "of another kernel"])
def test_tubes_that_are_none(rpdr, monkeypatch, change):
    """A search that believes in them: no curve of theirs is listed, and what they held is open."""
    real = cover.follow

    def altered(*given):
        chain = real(*given)
        return chain and TubeChain(ALTERED[change](chain.tubes), chain.closed)

    monkeypatch.setattr(cover, "follow", altered)
    monkeypatch.setattr(cover, "_MOST_STARTS", 2)
    monkeypatch.setattr(cover, "settle_boxes", lambda runner, nearby, boxes: rows_of(boxes, slice(0)))
    result = found_in(rpdr)
    assert result.verdict == "undecided"
    assert result.verify()


@pytest.mark.slow
def test_chains_that_are_not_glued(rpdr, honest, monkeypatch):
    """Without three tubes of a closed curve it is open, in whatever order tubes are handed on; the gap is told."""
    closed = next(curve for curve in honest.curves if curve.closed)
    gone, mixed = np.delete(np.arange(len(closed.radius)), [10, 11, 12]), np.arange(len(closed.radius))
    mixed[[5, 20]] = mixed[[20, 5]]
    for kept in (gone, mixed):
        chain = TubeChain(closed.tubes.take(kept), True)
        monkeypatch.setattr(CurveSearch, "run", lambda *_, chain=chain: cover.Found((chain,), rows(), 5000, None))
        result = found_in(rpdr)
        assert result.verdict == "undecided"
        assert not any(curve.closed for curve in result.curves)
        assert len(result.curves) > 1
        assert result.verify()


def rows():
    """No boxes."""
    return cover.Candidates(np.zeros(0, dtype=np.intp), *np.zeros((2, 0, 4)), np.zeros((0, 2, 2)))


def test_work_that_is_said_to_be_over(rpdr, monkeypatch):
    """Whatever waits is let go."""
    real = CurveSearch.run
    monkeypatch.setattr(
        CurveSearch, "run", lambda *given: (lambda found: found._replace(left=rows(), limit=None))(real(*given))
    )
    result = found_in(rpdr, budget=1)
    assert result.verdict == "undecided"
    assert len(result.uncovered.lower)


@pytest.mark.slow
def test_a_file_is_believed_until_it_is_replayed(rpdr, honest, tmp_path):
    """What it says is its word; replayed it is proved, or is not: without a curve, over more, with an odd chain."""
    path = tmp_path / "curves.npz"
    honest.save(path)
    told, known = domain.SingularCover.load(path), domain.SingularCover.load(path, replay=True)
    assert (told.verdict, known.verdict) == ("proven", "proven")
    assert str(path) in told.reason
    assert str(path) not in known.reason
    replace(honest, curves=honest.curves[:1], resolution=0.1, tried=2000).save(path)
    assert domain.SingularCover.load(path).verdict == "proven"
    again = domain.SingularCover.load(path, replay=True)
    assert is_open(again)
    wider = replace(honest.region, lower=honest.region.lower - 1.0)
    replace(honest, region=wider, resolution=0.1, tried=2000).save(path)
    assert domain.SingularCover.load(path, replay=True).verdict == "undecided"
    cut = honest.curves[1]._replace(
        tubes=honest.curves[1].tubes.take(slice(3, None)), radius=honest.curves[1].radius[3:]
    )
    replace(honest, curves=(honest.curves[0], cut)).save(path)
    with pytest.raises(InvalidInputError, match="altered"):
        domain.SingularCover.load(path, replay=True)


def test_facts_are_those_of_the_list(rpdr, honest):
    """Of other curves, another region or other limits they say nothing; without them nothing is proven."""
    limits = 0.5 * honest.ranges.limits
    for other in (
        {"curves": honest.curves[:1]},
        {"curves": honest.curves[::-1]},
        {"region": replace(honest.region, upper=honest.region.upper + 1e-3)},
        {"ranges": honest.ranges._replace(limits=limits)},
        {"reading": reading_of(rpdr, rpdr.q_reference + 0.0)._replace(problem=shifted(honest.problem))},
        {"proved": None},
    ):
        assert replace(honest, **other).verdict == "undecided"
    assert curves.SingularCover(**vars(honest)).verdict == "proven"


def test_from_another_process_it_is_believed_once_it_is_replayed(honest):
    """A pickled fact is a claim."""
    sent = pickle.loads(pickle.dumps(honest))
    assert (honest.verdict, sent.verdict, sent.replayed().verdict) == ("proven", "undecided", "proven")


def shifted(problem):
    """Other closures."""
    return problem._replace(system=replace(problem.system, offset=problem.system.offset + 0.01))


@pytest.mark.slow
def test_parts_that_lack_a_curve(rpdr, honest):
    """Merged, they are looked at once more: what the one claims falsely is found."""
    middle = 1.6
    halves = [REGION.copy(), REGION.copy()]
    halves[0][1, 0] = halves[1][0, 0] = middle
    parts = [domain.certify_singularities(rpdr, half) for half in halves]
    assert domain.merge(parts).verdict == "proven"
    less = {"resolution": 0.1, "tried": 500}
    lacking = [replace(part, curves=tuple(c for c in part.curves if c.kind == "fold"), **less) for part in parts]
    assert domain.merge(lacking).verdict == "undecided"
    unproved = domain.merge([replace(part, proved=None) for part in parts])
    assert (unproved.verdict, unproved.proved.covered) == ("undecided", None)
