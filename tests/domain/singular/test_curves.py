"""All singular curves, against closed forms: every singular configuration is on a curve or in a box that is listed."""

import numpy as np
import pytest

import ccpin
from ccpin import domain, plotting
from ccpin.covering.cells import CellStatus, place
from ccpin.domain.singular import cover as search
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from tests.oracles import five_bar as oracle
from tests.oracles import rpdr as paper
from tests.support.five_bars import in_tree_order, load_five_bar, random_five_bar
from tests.support.legs import WHOLE, load_slice
from tests.support.long_cases import later
from tests.support.paper import CURVED as REGION
from tests.support.singular_samples import CROSSING, RPDR, SLICE, missed, of_five_bar, of_slice

CUSP = np.array([[0.176, 0.26], [0.184, 0.268]])  # nearer about the slice's
PIECE = np.array([[2.0, 0.85], [2.2, 1.05]])  # of the RPDR, with a piece of its fold


@pytest.fixture
def cover(rpdr_curves):
    """All singular curves of the RPDR over REGION."""
    return rpdr_curves


def test_no_singular_configuration_is_missed(rpdr, cover):
    """Over a region with an isolated point and a piece of the fold: 3,000 of the closed form, all on its two curves."""
    assert cover.verdict == "proven"
    assert not len(cover.uncovered.lower)
    q_free = of_five_bar(rpdr, RPDR, 40_000, 1, REGION)
    assert len(q_free) > 3000
    numbers = cover.curve_of(q_free)
    stretched = np.cos(q_free @ [1.0, 1.0, -1.0, -1.0]) < 0.0
    kinds = np.array([curve.kind for curve in cover.curves])
    assert set(kinds[numbers[stretched]]) == {"fold"}
    assert set(kinds[numbers[~stretched]]) == {"self-motion"}


def test_middles_of_tubes_are_singular(cover):
    """Folds are stretched and self-motions have their elbows on one another, within the error that is stated."""
    for curve in cover.curves:
        elbows = np.hypot(*np.array([paper.elbow_offset(q) for q in curve.q]).T)
        wanted = RPDR.a3 + RPDR.a4 if curve.kind == "fold" else 0.0
        assert np.all(np.abs(elbows - wanted) <= (RPDR.a1 + RPDR.a2) * curve.error[: len(elbows)] + 1e-15)
        assert curve.error.max() < 1e-6
    (isolated,) = (curve for curve in cover.curves if curve.kind == "self-motion")
    assert isolated.closed
    assert np.ptp(isolated.q_free, axis=0).max() > 6.0
    assert np.allclose(isolated.q, [paper.coincident_elbows()], atol=1e-9)


def test_what_is_not_singular_is_on_no_curve(rpdr, cover):
    """Configurations of both assembly modes, and singular ones that are moved by a hundredth."""
    q = np.random.default_rng(2).uniform(*REGION, (300, 2))
    regular = np.array([paper.sigma(point, mode) for point in q for mode in (1, -1)])
    regular = regular[np.isfinite(regular).all(axis=1)]
    regular = regular[np.abs(np.sin([paper.fold(q_free) for q_free in regular])) > 0.05]
    assert np.all(cover.curve_of(in_tree_order(rpdr, regular)) < 0)
    curve = cover.curves[0]
    beside = curve.q_free + curve.radius.max() * np.array([1.0, 0.3, -0.7, 0.9])
    assert np.all(cover.curve_of(beside) < 0)
    assert missed(cover, beside) == len(beside)


def test_tubes_are_checked_anew(cover):
    """Every tube and all gluing hold again; a tube made longer, moved or taken out does not."""
    assert cover.verify()
    curve = next(curve for curve in cover.curves if curve.closed)
    tubes, k = curve.tubes, len(curve.tubes.half) // 2
    half, theta = tubes.half.copy(), tubes.theta.copy()
    half[k] *= 3.0
    theta[k] += 1e-3
    gone = np.delete(np.arange(len(half)), [k, k + 1, k + 2])
    for wrong in (tubes._replace(half=half), tubes._replace(theta=theta), tubes.take(gone)):
        assert not domain.SingularCover(**{**vars(cover), "curves": (curve._replace(tubes=wrong),)}).verify()


def test_a_missing_tube_leaves_boxes_uncovered(rpdr, cover, monkeypatch):
    """With three tubes of the isolated point's curve left out, exactly what they held is listed."""
    chain = next(search.TubeChain(curve.tubes, True) for curve in cover.curves if curve.closed)
    kept = np.delete(np.arange(len(chain.tubes.half)), [10, 11, 12])
    given = iter([search.TubeChain(chain.tubes.take(kept), False)])
    monkeypatch.setattr(search, "follow", lambda *_: next(given, None))
    region = np.array([chain.tubes.theta[0, [0, 2]] - 0.02, chain.tubes.theta[0, [0, 2]] + 0.02])
    found = domain.certify_singularities(rpdr, region, resolution=0.01)
    assert found.verdict == "undecided"
    assert "resolution = 0.01" in found.reason
    q_free = of_five_bar(rpdr, RPDR, 40_000, 3, region)
    assert len(q_free) > 3000
    off = found.curve_of(q_free) < 0
    assert 0.001 < off.mean() < 0.05
    assert missed(found, q_free) == 0


@pytest.mark.parametrize(
    ("region", "poses"), [(CUSP, 5_000), pytest.param(SLICE, 10_000, marks=pytest.mark.slow)], ids=["near", "wide"]
)
def test_curves_through_cusps(region, poses):
    """The 3-RPR over a cusp: one curve, and of the poses with det = 0 none beside it."""
    found = domain.certify_singularities(load_slice(), region)
    assert found.verdict == "proven"
    assert [(curve.kind, curve.closed) for curve in found.curves] == [("fold", False)]
    q_free = of_slice(poses, 4, region)
    assert len(q_free) > 300
    assert missed(found, q_free) == 0
    assert len(domain.cusps(load_slice(), region, curves=[curve.points for curve in found.curves])) == 1


@pytest.mark.parametrize("samples", later(15_000, 40_000))
def test_a_place_where_curves_cross_is_listed(samples):
    """A fold that crosses itself at q = 0, all bars in line: boxes about it are left, and hold it."""
    mechanism = load_five_bar(CROSSING)
    region = np.array([[-0.2, -0.2], [0.2, 0.2]])
    found = domain.certify_singularities(mechanism, region, resolution=0.02)
    assert found.verdict == "undecided"
    in_line = in_tree_order(mechanism, [[0.0, 0.0, 0.0, np.pi]])
    assert found.is_uncovered(in_line)[0]
    assert np.abs(found.uncovered.lower - found.uncovered.upper).max() < 0.05
    q_free = of_five_bar(mechanism, CROSSING, samples, 5, region)
    assert len(q_free) > 500
    assert missed(found, q_free) == 0


@pytest.mark.parametrize("ended", later({"seconds": 0.4}, {"budget": 2000}))
def test_work_that_ends_early_lists_what_waits(rpdr, ended):
    """After a small budget or a short time the verdict is undecided, with the reason; nothing is missed."""
    found = domain.certify_singularities(rpdr, REGION, **ended)
    assert found.verdict == "undecided"
    assert f"{next(iter(ended))}=" in found.reason
    assert found.complete == ("seconds" not in ended)
    assert missed(found, of_five_bar(rpdr, RPDR, 5000, 6, REGION)) == 0


@pytest.mark.parametrize(
    ("region", "kinds", "ended", "suffix"),
    [
        (PIECE, ["fold"], {"budget": 60}, "json"),
        pytest.param(REGION, ["fold", "self-motion"], {"budget": 2000}, "json", marks=pytest.mark.slow),
        pytest.param(REGION, ["fold", "self-motion"], {"seconds": 0.3}, "npz", marks=pytest.mark.slow),
    ],
    ids=["piece", "budget", "seconds"],
)
def test_saved_work_goes_on(rpdr, cover, tmp_path, region, kinds, ended, suffix):
    """Broken off, saved, loaded and continued: the curves that one search finds, and nothing is left."""
    path = tmp_path / f"cover.{suffix}"
    early = domain.certify_singularities(rpdr, region, **ended)
    early.save(path)
    loaded = domain.SingularCover.load(path)
    assert loaded.is_about(rpdr)
    assert loaded.fingerprint == cover.fingerprint
    assert repr(loaded) == f"{repr(early)[:-1]}, loaded)"
    assert loaded.reason.startswith(early.reason)
    assert np.array_equal(loaded.uncovered.lower, early.uncovered.lower)
    whole = loaded.continued()
    assert whole.verdict == "proven"
    assert whole.tried > early.tried
    assert [(curve.kind, curve.closed) for curve in whole.curves] == [(kind, kind == "self-motion") for kind in kinds]
    assert whole.verify()
    assert missed(whole, of_five_bar(rpdr, RPDR, 5000, 9, region)) == 0


def test_loaded_curves_are_the_same(cover, tmp_path):
    """Every number of every curve, bit for bit."""
    cover.save(tmp_path / "cover.npz")
    loaded = domain.SingularCover.load(tmp_path / "cover.npz")
    assert loaded.verify()
    for one, other in zip(cover.curves, loaded.curves, strict=True):
        assert (one.kind, one.closed) == (other.kind, other.closed)
        for a, b in zip((*one.tubes, one.q_free, one.error), (*other.tubes, other.q_free, other.error), strict=True):
            assert np.array_equal(a, b)


def test_a_region_without_singularities(rpdr, tmp_path):
    """Nothing is singular over the paper's region 𝒟, and that is proved."""
    found = domain.certify_singularities(rpdr, np.deg2rad([[-150.0, -160.0], [-90.0, -100.0]]))
    assert (found.verdict, found.curves) == ("proven", ())
    assert found.verify()
    found.save(tmp_path / "none.json")
    assert domain.SingularCover.load(tmp_path / "none.json").verdict == "proven"
    assert list(found.curve_of(rpdr.q_reference)) == [-1]


def test_cells_of_an_atlas_that_curves_cross(rpdr, cover):
    """Undecided cells said to be crossed hold a stretched loop, by its sign at a grid of each cell's points."""
    q0 = np.array([1.5, 1.9])
    grid = np.stack(np.meshgrid(*2 * [np.linspace(-1.0, 1.0, 41)]), axis=-1).reshape(-1, 2)
    sheets = domain.certify_sheets(rpdr, REGION, max_depth=6)
    for atlas in (domain.certify(rpdr, q0, REGION, max_depth=6), sheets):
        found = cover.crossed(atlas)
        assert 0.0 < found.share <= atlas.tree.share(atlas.tree.leaves(CellStatus.UNDECIDED))
        assert set(found.cells) <= set(atlas.tree.leaves(CellStatus.UNDECIDED).tolist())
        middle, half = place(atlas.tree, atlas.region, found.cells)
        for centre, width in zip(middle, half, strict=True):
            reach = np.abs(oracle.elbows(RPDR, *(centre + width * grid).T))
            assert reach.min() <= RPDR.a3 + RPDR.a4 <= reach.max() or reach.min() < 0.06 * width.max()
    with pytest.raises(InvalidInputError, match="atlas"):
        cover.crossed(cover)


def test_curves_are_drawn(rpdr, cover):
    """`plot_singularities` takes their points."""
    assert plotting.plot_singularities(rpdr, [curve.points for curve in cover.curves]) is not None
    closed = next(curve for curve in cover.curves if curve.closed)
    assert np.array_equal(closed.points.q_free[0], closed.points.q_free[-1])
    assert closed.points.verdict == "proven"


@pytest.mark.parametrize("name", ["four_bar", "delta", "stewart"])
def test_other_numbers_of_coordinates_are_refused(name):
    """n = 1, 3 and 6, with what n is."""
    with pytest.raises(UnsupportedMechanismError, match="two independent coordinates"):
        domain.certify_singularities(ccpin.load(name))


@pytest.mark.parametrize("wrong", [{"region": [[0.0, 0.0], [0.0, 1.0]]}, {"resolution": 0.0}, {"seconds": -1.0}])
def test_wrong_arguments_are_named(rpdr, wrong):
    """A region without an inside, a resolution or a time that is not positive."""
    with pytest.raises(InvalidInputError, match=next(iter(wrong))):
        domain.certify_singularities(rpdr, **wrong)


@pytest.mark.slow
def test_the_whole_torus_of_the_rpdr(rpdr):
    """One fold and two self-motions, all closed; none of 100,000 singular configurations is beside them."""
    found = domain.certify_singularities(rpdr)
    assert found.verdict == "proven"
    assert [(curve.kind, curve.closed) for curve in found.curves] == [("fold", True)] + 2 * [("self-motion", True)]
    assert missed(found, of_five_bar(rpdr, RPDR, 100_000, 7)) == 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_random_five_bars(seed):
    """Over the whole torus of five-bars of random lengths: none of 20,000 singular configurations is missed."""
    bar = random_five_bar(np.random.default_rng(seed))
    mechanism = load_five_bar(bar)
    found = domain.certify_singularities(mechanism)
    assert found.verdict == "proven"
    assert all(curve.closed for curve in found.curves)
    q_free = of_five_bar(mechanism, bar, 20_000, 100 + seed)
    assert len(q_free) > 10_000
    assert missed(found, q_free) == 0


@pytest.mark.slow
def test_the_whole_slice_of_the_3rpr():
    """All leg lengths from 3 to 40 cm: none of the singular poses is missed."""
    found = domain.certify_singularities(load_slice(), WHOLE)
    assert found.verdict == "proven"
    q_free = of_slice(100_000, 8, WHOLE)
    assert len(q_free) > 10_000
    assert missed(found, q_free) == 0
