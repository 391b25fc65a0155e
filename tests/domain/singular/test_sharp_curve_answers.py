"""What lists of singular curves answer, on curves that are straight lines and circles, and of boxes made by hand."""

from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest

import ccpin
from ccpin.domain import certify_singularities
from ccpin.domain.singular import curve as curve_module
from ccpin.domain.singular import curves as module
from ccpin.domain.singular.cover import Found
from ccpin.domain.singular.curve import as_curve, holds
from ccpin.domain.singular.curve_claims import ProvedCurves, SearchEffort
from ccpin.domain.singular.curves import SingularCover, UncoveredBoxes, _uncovered, _waiting, concluded
from ccpin.domain.singular.following import TubeChain
from ccpin.errors import InvalidInputError
from ccpin.proof.curves import tube_claims
from ccpin.proof.curves.tubes import Points
from ccpin.proof.narrowing import Candidates
from tests.support.long_cases import later
from tests.support.straight_curves import PROBLEM, straighten, tubes

SYSTEM = SimpleNamespace(
    **vars(PROBLEM.system), independent=np.array([0, 1]), dependent=np.array([], dtype=np.intp), n=2
)
READING = SimpleNamespace(
    problem=PROBLEM,
    system=SYSTEM,
    configuration=lambda theta: 2.0 * theta,
    chart=SimpleNamespace(nq=2, n_free=2, theta=lambda q_free: q_free),
)
NONE = UncoveredBoxes(np.zeros((0, 2)), np.zeros((0, 2)))


@pytest.fixture(autouse=True)
def _straight(request, monkeypatch):
    if "saved" not in request.fixturenames:
        straighten(monkeypatch, curve_module)


def cover(*chains, left=NONE):
    made = tuple(as_curve(READING, chain) for chain in chains)
    return SingularCover(("a", "b"), None, READING, made, left, 0, None, 1e-3, None)


def line(*middles, half=0.4, closed=False):
    return TubeChain(tubes(*((c, half) for c in middles)), closed)


# One curve.


def test_a_curve_tells_how_far_it_is():
    """A proved singular configuration from a middle, and the whole arc: of θ, not of the kernel."""
    chain = line(0.0, 0.25)
    off = chain.tubes._replace(theta=chain.tubes.theta + [0.0, 0.03], kernel=chain.tubes.kernel + 0.05)
    off = off._replace(gain=chain.tubes.gain, hull=np.array([[0.0, 0.04, 0.07], [0.0, 0.45, 0.07]]))
    found = as_curve(READING, TubeChain(off, True))
    assert found.closed
    np.testing.assert_allclose(found.error, 0.03, rtol=1e-9)
    np.testing.assert_allclose(found.radius, [0.4, 0.45], rtol=1e-12)
    np.testing.assert_array_equal(found.q_free, 2.0 * off.theta)
    np.testing.assert_array_equal(found.q, off.theta)
    assert found.kind == "fold"


def test_a_curves_error_has_that_of_its_zeros(monkeypatch):
    at = Points(np.array([[0.0, 0.02, 1.5]]), np.array([[0.005, 0.01, 0.9]]))
    monkeypatch.setattr(curve_module, "zeros_in", lambda *_: at)
    np.testing.assert_allclose(as_curve(READING, line(0.0)).error, [0.03], rtol=1e-14)


def test_a_curve_over_one_q_is_told_there():
    found = as_curve(READING, line(0.5 + 2 * np.pi))
    assert found.kind == "self-motion"
    np.testing.assert_allclose(found.q, [[0.5, 0.0]], atol=1e-14)
    assert len(found.points.q) == 1


def test_points_of_a_closed_curve_end_with_the_first():
    ring, open_one = (as_curve(READING, line(0.0, 0.25, 0.5, closed=closed)).points for closed in (True, False))
    np.testing.assert_array_equal(ring.q[:, 0], [0.0, 0.25, 0.5, 0.0])
    np.testing.assert_array_equal(ring.q_free[:, 0], [0.0, 0.5, 1.0, 0.0])
    assert len(ring.error) == 4
    np.testing.assert_array_equal(open_one.q[:, 0], [0.0, 0.25, 0.5])


def test_curves_that_hold():
    """Each tube proved, each glued to the next, the last to the first of a closed one, hull and κ as they follow."""
    made = as_curve(READING, line(0.0, 0.25, 0.5))
    assert holds(PROBLEM, made)
    assert not holds(PROBLEM, made._replace(closed=True))
    around = as_curve(READING, line(*np.arange(0.0, 2 * np.pi - 0.1, 0.25), closed=True))
    assert holds(PROBLEM, around)
    assert not holds(PROBLEM, as_curve(READING, line(0.0, 0.9)))
    assert not holds(PROBLEM, as_curve(READING, line(0.0, 0.25, 1.2)))
    off = made.tubes._replace(kernel=made.tubes.kernel + 0.2)
    assert not holds(PROBLEM, made._replace(tubes=off))


@pytest.mark.parametrize("name", ["hull", "kappa"])
@pytest.mark.parametrize(("share", "known"), [(1 + 0.97e-6, True), (1 + 1.03e-6, False), (1 - 1.03e-6, False)])
def test_what_follows_is_as_told(monkeypatch, name, share, known):
    """To a millionth, and 1e-15: bounds are formed again by the same steps."""
    made = as_curve(READING, line(0.0, 0.25))
    told = {"hull": np.full((2, 3), 0.5), "kappa": np.full(2, 0.5)}
    result = SimpleNamespace(tubes=SimpleNamespace(**told), proved=np.ones(2, dtype=bool))
    monkeypatch.setattr(curve_module, "certify_tubes", lambda *_: result)
    tubes = made.tubes._replace(**(told | {name: told[name] / share}))
    assert holds(PROBLEM, made._replace(tubes=tubes)) == known
    for extra, also in ((0.97e-15, True), (1.03e-15, False)):
        result.tubes = SimpleNamespace(**(told | {name: 0.0 * told[name] + extra}))
        assert holds(PROBLEM, made._replace(tubes=made.tubes._replace(**(told | {name: 0.0 * told[name]})))) == also


def test_every_tube_is_to_be_proved(monkeypatch):
    made = as_curve(READING, line(0.0, 0.25))
    result = SimpleNamespace(tubes=made.tubes, proved=np.array([True, False]))
    monkeypatch.setattr(curve_module, "certify_tubes", lambda *_: result)
    assert not holds(PROBLEM, made)


# All of them.


def test_a_list_holds_where_all_curves_do():
    good, bad = line(0.0, 0.25), line(0.0, 0.9)
    assert cover(good, good).verify()
    assert not cover(good, bad).verify()
    assert not cover(bad, good).verify()


def test_on_which_curve_a_configuration_is(monkeypatch):
    """The first of those whose arcs it is in, within 1e-9; none beside them, or beyond their ends."""
    monkeypatch.setattr(module, "closure_values", lambda problem, theta: (None, np.zeros((len(theta), 1, 2))))
    monkeypatch.setattr(SYSTEM, "dependent", np.array([0]))
    problem = SimpleNamespace(system=SYSTEM)
    reading = SimpleNamespace(**(vars(READING) | {"problem": problem}))
    chains = line(2.0), line(0.0), line(0.1)
    made = replace(cover(*chains), reading=reading)
    places = [[2.0, 0.0], [0.0, 0.0], [0.45, 0.0], [0.6, 0.0], [0.0, 0.97e-9], [0.0, 1.03e-9], [2 * np.pi, 0.0]]
    assert made.curve_of(places).tolist() == [0, 1, 2, -1, 1, -1, 1]
    assert made.curve_of(np.zeros((0, 2))).tolist() == []
    assert replace(made, curves=()).curve_of(places[:2]).tolist() == [-1, -1]
    ends = [[0.5 - 2e-12, 0.0], [0.5 + 1e-12, 0.0], [-0.4 + 0.5e-12, 0.0]]
    assert made.curve_of(ends).tolist() == [2, -1, -1]


def test_which_configurations_are_left_open():
    """Those in a box, or 1e-12 beside it, angles modulo 2π."""
    left = UncoveredBoxes(np.array([[0.0, 1.0], [3.0, 3.0]]), np.array([[1.0, 2.0], [4.0, 4.0]]))
    made = cover(line(0.0), left=left)
    inside = [[0.5, 1.5], [0.0, 1.0], [1.0 + 0.97e-12, 2.0], [2 * np.pi + 0.5, 1.5], [3.5, 3.5], [0.5, 1.0 - 0.97e-12]]
    outside = [[1.0 + 1.03e-12, 1.5], [0.5, 1.5 + 2 * np.pi], [0.5, 3.5], [2.0, 2.5], [0.5, 1.0 - 1.03e-12]]
    assert made.is_uncovered(inside).all()
    assert not made.is_uncovered(outside).any()


def test_boxes_left_hold_what_they_held():
    """Corners with all that slopes move the dependent coordinates by; and looked at again, all of the corners."""
    system = SimpleNamespace(dependent=np.array([1]), independent=np.array([0]), n=1, m=1)
    boxes = Candidates(
        np.zeros(1, dtype=np.intp), np.array([[1.0, 2.0]]), np.array([[0.5, 0.25]]), np.full((1, 1, 1), -3.0)
    )
    found = _uncovered(SimpleNamespace(system=system), Found((), boxes, 0, None))
    np.testing.assert_allclose(found.lower, [[0.5, 2.0 - 1.75]], rtol=1e-9)
    np.testing.assert_allclose(found.upper, [[1.5, 2.0 + 1.75]], rtol=1e-9)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 20.0, 1e3, 1e9])
@pytest.mark.parametrize("middle", [0.0, 1e-9, 1.0, 1000.0])
@pytest.mark.parametrize("boxes", later(300, 2000))
def test_boxes_looked_at_again_hold_their_corners(scale, middle, boxes):
    """In fractions: wide boxes about little had fallen short by a rounding of their width."""
    rng, system = np.random.default_rng(0), SimpleNamespace(m=1, n=1)
    lower = scale * (middle - rng.uniform(0.5, 1.0, (boxes, 2)))
    upper = scale * (middle + rng.uniform(0.5, 1.0, (boxes, 2)))
    found = _waiting(SimpleNamespace(system=system), UncoveredBoxes(lower, upper))
    assert not found.slopes.any()
    spare = 0.0
    for c, h, low, high in zip(*(a.ravel() for a in (found.centre, found.half, lower, upper)), strict=True):
        assert Fraction(c) - Fraction(h) <= Fraction(low)
        assert Fraction(c) + Fraction(h) >= Fraction(high)
        spare = max(spare, float(Fraction(h) - (Fraction(high) - Fraction(low)) / 2))
    assert spare < 3e-15 * (1.0 + scale * (middle + 1.0))


def test_cells_that_curves_cross(monkeypatch):
    """Undecided leaves that hold a point of an arc with its error, at s from one end of each tube to the other."""
    asked = []

    def zeros(problem, tubes, s):
        asked.append(s / tubes.half)
        return Points(np.column_stack([s, 0.0 * s, 1.0 + 0.0 * s]), np.full((len(s), 3), 1e-3))

    monkeypatch.setattr(module, "zeros_in", zeros)
    monkeypatch.setattr(module, "require_same", lambda *_: None)
    monkeypatch.setattr(module, "fingerprint_of", lambda problem: "")
    found = []

    def leaves(tree, region, q, error):
        found.append((q, error))
        return np.select([q[:, 0] > 0.3, q[:, 0] > 0.0, q[:, 0] > -0.2], [2, 1, 0], -1)

    monkeypatch.setattr(module, "leaves_holding", leaves)
    status = np.array([module.CellStatus.UNDECIDED, module.CellStatus.CERTIFIED, module.CellStatus.UNDECIDED])
    atlas = SimpleNamespace(
        region=SimpleNamespace(reduce=lambda q: q),
        tree=SimpleNamespace(status=status, share=lambda cells: 0.25 * len(cells)),
        fingerprint="",
    )
    problem = SimpleNamespace(system=SYSTEM)
    made = replace(cover(line(0.0, 0.25)), reading=SimpleNamespace(**(vars(READING) | {"problem": problem})))
    crossed = made.crossed(atlas)
    assert crossed.cells.tolist() == [0, 2]
    assert crossed.share == 0.5
    shares = np.array(asked)
    assert (shares.min(), shares.max()) == (-1.0, 1.0)
    assert all(np.all(error == 1e-3) for _, error in found)
    assert replace(made, curves=()).crossed(atlas).cells.tolist() == []


def test_more_work_is_added_to_what_was_done(monkeypatch):
    """What was tried counts, what was left is looked at again, curves go on, and where it was read is still said."""
    seen = {}

    class Search:
        plain = PROBLEM

        def __init__(self, runner, place, chains):
            seen["chains"] = chains

        def run(self, resolution, budget, report, waiting):
            seen["waiting"] = waiting
            boxes = Candidates(np.zeros(0, dtype=np.intp), *np.zeros((2, 0, 2)), np.zeros((0, 1, 1)))
            return Found(tuple(seen["chains"]), boxes, 5, "budget")

    monkeypatch.setattr(module, "CurveSearch", Search)
    monkeypatch.setattr(module, "Runner", lambda *_: None)
    monkeypatch.setattr(module, "concluded", lambda proposed, problem: proposed)
    monkeypatch.setattr(module, "extents", lambda problem, boxes: boxes.half)

    class Fake(SimpleNamespace):
        def _replace(self, **others):
            return Fake(**(vars(self) | others))

    reading = Fake(**(vars(READING) | {"problem": SimpleNamespace(system=SimpleNamespace(**vars(SYSTEM)))}))
    place, effort, work = (
        SimpleNamespace(region=None, ranges=None),
        module.effort_of(1e-3, 9, None, None),
        module.Work(),
    )
    fresh = module.searched(reading, ("a", "b"), place, effort, work)
    assert (fresh.tried, fresh.limit, fresh.source, seen["waiting"], seen["chains"]) == (5, "budget", None, None, [])
    left = UncoveredBoxes(np.zeros((1, 2)), np.ones((1, 2)))
    before = replace(cover(line(0.0, 0.25, closed=True), left=left), tried=7, source="file")
    after = module.searched(reading, ("a", "b"), place, effort, work, before)
    assert (after.tried, after.source) == (12, "file")
    assert [chain.closed for chain in seen["chains"]] == [True]
    np.testing.assert_array_equal(seen["waiting"].centre, [[0.5, 0.5]])


REGION = SimpleNamespace(lower=np.zeros(2), upper=np.ones(2))
RANGES = SimpleNamespace(limits=np.ones((1, 2)))
LEFT = UncoveredBoxes(np.zeros((1, 2)), np.ones((1, 2)))


def with_fact(monkeypatch, digest="ours", left=0, asked=True):
    """A list with a fact that says it is all there is, or not quite."""
    made = replace(cover(line(0.0, 0.25), line(1.0)), region=REGION, ranges=RANGES)

    def covers(fact, region, limits, tubes):
        assert region == (REGION.lower, REGION.upper)
        assert limits is RANGES.limits
        np.testing.assert_array_equal(tubes.theta[:, 0], [0.0, 0.25, 1.0])
        return asked

    monkeypatch.setattr(module, "closures_of", lambda problem: SimpleNamespace(digest="ours"))
    monkeypatch.setattr(module, "covers", covers)
    monkeypatch.setattr(module, "Fact", SimpleNamespace)
    monkeypatch.setattr(module, "no_tubes", lambda problem: line(0.0).tubes.take(slice(0)))
    fact = SimpleNamespace(digest=digest, found={"lower": np.zeros((left, 2))})
    return replace(made, proved=ProvedCurves(None, None, fact))


def test_a_verdict_is_that_of_the_fact(monkeypatch):
    """About the same closures, region, limits and curves, and without boxes; whatever else the list says."""
    assert with_fact(monkeypatch).verdict == "proven"
    for other in ({"digest": "theirs"}, {"left": 1}, {"asked": False}):
        made = with_fact(monkeypatch, **other)
        assert (made.verdict, replace(made, source="file").verdict) == ("undecided", "undecided")
    proven = replace(with_fact(monkeypatch), source="file")
    assert "file" not in proven.reason
    assert "file" in replace(proven, proved=None).reason
    assert "file" in replace(proven, uncovered=LEFT, proved=None, limit="budget").reason


def test_without_a_fact_it_is_a_files_word():
    """Of work that came to its end and left nothing."""
    told = replace(cover(line(0.0)), source="file")
    for proved in (None, ProvedCurves(None, None, None)):
        assert replace(told, proved=proved).verdict == "proven"
        for other in ({"source": None}, {"limit": "budget"}, {"limit": "interrupted"}, {"uncovered": LEFT}):
            assert replace(told, proved=proved, **other).verdict == "undecided"


@pytest.mark.parametrize(
    ("early", "tried", "limit"),
    [(False, 9, None), (False, 99, None), (True, 10, "interrupted"), (True, 11, "budget"), (True, 5, "interrupted")],
)
def test_what_is_proposed_is_proved(monkeypatch, early, tried, limit):
    """Curves are those that are, boxes those that are found, and what ended it is told."""
    asked, chain = [], line(0.5)
    found = {
        "lower": np.zeros((3, 2)),
        "upper": np.ones((3, 2)),
        "early": np.array([early]),
        "tried": np.array([tried]),
    }
    fact = SimpleNamespace(found=found, claim=SimpleNamespace(most=np.array([10])))
    monkeypatch.setattr(module, "proved_chains", lambda problem, chains: (ProvedCurves("tubes", "glue", None), [chain]))
    monkeypatch.setattr(module, "proved_cover", lambda *given: asked.append(given) or fact)
    proposed = replace(cover(line(0.0, 0.25), line(1.0), left=LEFT), tried=7, region=REGION, ranges=RANGES)
    made = concluded(proposed, "other bounds")
    assert asked[0] == ("other bounds", REGION, RANGES, SearchEffort(1e-3, 7, True), "tubes")
    assert (made.limit, made.tried, made.proved) == (limit, 7, ProvedCurves("tubes", "glue", fact))
    assert [curve.tubes.theta[0, 0] for curve in made.curves] == [0.5]
    assert made.uncovered.lower is found["lower"]
    assert made.uncovered.upper is found["upper"]
    concluded(replace(proposed, limit="budget"))
    assert asked[1] == (PROBLEM, REGION, RANGES, SearchEffort(1e-3, 7, False), "tubes")
    for other in (concluded(replace(proposed, limit="interrupted")), concluded(proposed, believed=True)):
        assert (len(asked), other.uncovered, other.proved) == (2, LEFT, ProvedCurves("tubes", "glue", None))
        assert len(other.curves) == 1


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """A real list in a file, and itself."""
    made = certify_singularities(ccpin.load("rpdr"), np.radians(((118.0, 52.0), (121.0, 55.0))))
    path = tmp_path_factory.mktemp("curves") / "curves.npz"
    made.save(path)
    return made, path


def test_a_file_with_a_tube_that_is_not_proved_is_refused(saved, monkeypatch):
    """Any of them; and with curves of more or fewer tubes than there are."""
    made, path = saved
    loaded = SingularCover.load(path)
    assert [len(curve.radius) for curve in loaded.curves] == [len(curve.radius) for curve in made.curves]
    real = tube_claims.proved_again

    def all_but_one(problem, given):
        found = real(problem, given)
        return found._replace(proved=np.arange(len(found.proved)) != 1)

    with monkeypatch.context() as other:
        other.setattr(tube_claims, "proved_again", all_but_one)
        with pytest.raises(InvalidInputError, match="tube 1 is not proved"):
            SingularCover.load(path)
    short = made.curves[0]._replace(radius=made.curves[0].radius[:-1])
    replace(made, curves=(short, *made.curves[1:])).save(path.with_name("short.npz"))
    with pytest.raises(InvalidInputError, match="as many"):
        SingularCover.load(path.with_name("short.npz"))
