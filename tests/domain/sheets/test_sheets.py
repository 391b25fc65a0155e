"""Sheets against closed forms: how many configurations there are, that they are, how they hang together."""

import numpy as np
import pytest
from scipy.optimize import brentq

import ccpin
from ccpin import domain, plotting
from ccpin.domain.sheets.counting import all_solutions
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.proof.solution_counts import own_solutions
from tests.oracles import cusped_3rpr as cusped
from tests.oracles import planar_3rpr as oracle
from tests.oracles import planar_3rrr as three_legs
from tests.oracles import rpdr as five_bar
from tests.oracles import slider_crank as sliding
from tests.support.legs import LEG1, WHOLE, load_slice, with_first_leg
from tests.support.long_cases import later

REGION = np.array([[0.168, 0.247], [0.192, 0.271]])


def wrong_counts(atlas, q):
    """How many of the points counted have another number of assembly modes, those left out where rounding decides."""
    counted = atlas.number_of_solutions(q)
    known = counted >= 0
    expected, doubtful = oracle.modes(with_first_leg(q[known]))
    return int(np.count_nonzero((expected != counted[known]) & ~doubtful)), known


@pytest.fixture(scope="module")
def slice_():
    """The slice."""
    return load_slice()


@pytest.fixture(scope="module")
def atlas(slice_):
    """Its sheets about a cusp."""
    return domain.certify_sheets(slice_, REGION, max_depth=5)


@pytest.mark.parametrize("points", later(400, 1500))
def test_counts_are_those_of_the_sextic(atlas, points):
    """The number proved is the number of real roots of the polynomial of degree six."""
    q = np.random.default_rng(1).uniform(*REGION, (points, 2))
    wrong, known = wrong_counts(atlas, q)
    assert wrong == 0
    assert known.mean() > 0.5
    assert set(atlas.number_of_solutions(q)[known]) == {4, 6}


@pytest.mark.slow
def test_counts_of_the_whole_slice(slice_):
    """All leg lengths from 3 to 40 cm: 100,000 points, and two sheets (the signs of det) of three layers each."""
    whole = domain.certify_sheets(slice_, WHOLE, max_depth=8)
    wrong, known = wrong_counts(whole, np.random.default_rng(2).uniform(*WHOLE, (100_000, 2)))
    assert wrong == 0
    assert known.mean() > 0.9
    assert [sheet.layers for sheet in whole.sheets] == [3, 3]
    assert sorted(sheet.sign for sheet in whole.sheets) == [-1, 1]


@pytest.mark.parametrize("points", later(3, 6))
def test_all_solutions_at_single_points(atlas, points):
    """The exhaustive search over one q finds as many as the sextic has real roots, and proves that they are all."""
    q = np.random.default_rng(3).uniform(*WHOLE, (points, 2))
    expected, doubtful = oracle.modes(with_first_leg(q))
    for point, number, unsure in zip(q, expected, doubtful, strict=True):
        found = all_solutions(atlas.problem, atlas.ranges, point)
        assert unsure or own_solutions(atlas.problem, atlas.ranges, point, found).sum() == number


def test_solutions_close_and_differ(atlas, slice_):
    """What is listed over a q closes the legs, and no two are the same."""
    names = list(slice_.pin_model.names)[1:]
    swing, turn = names.index("swing1"), names.index("turn")
    q = np.random.default_rng(4).uniform(*REGION, (400, 2))
    certified = q[np.asarray(atlas.number_of_solutions(q)) > 0][:60]
    for point in certified:
        try:
            found, sheets = atlas.solutions(point)
        except InvalidInputError:
            continue  # counted, but a box is missing
        assert len(found) == len(sheets) == atlas.number_of_solutions(point)
        alpha, phi = found[:, swing], found[:, swing] + found[:, turn]
        for a, p in zip(alpha, phi, strict=True):
            assert oracle.closing_error(np.r_[LEG1, point], LEG1 * np.exp(1j * a), p) < 1e-12
        poses = np.exp(1j * np.column_stack([alpha, phi]))
        assert np.abs(poses[:, None] - poses[None]).max(axis=2)[~np.eye(len(found), dtype=bool)].min() > 1e-4


def test_shares_add_up(atlas):
    """Counted, singular and undecided are all of the region; certified and empty lie within counted."""
    assert atlas.counted_fraction + atlas.singular_fraction + atlas.undecided_fraction == pytest.approx(1.0, abs=1e-12)
    assert atlas.certified_fraction + atlas.empty_fraction <= atlas.counted_fraction + 1e-12
    assert atlas.singular_fraction > 0.0


@pytest.mark.parametrize("turns", later(80, 200))
def test_singular_configurations_are_all_enclosed(atlas, slice_, turns):
    """Singular configurations by the closed form lie in the boxes that are left, whatever their assembly mode."""
    system, names = atlas.problem.system, list(slice_.pin_model.names)[1:]
    seen = 0
    for pose in singular_poses(turns):
        moved = cusped.displacements(pose)
        values = {"swing1": moved["leg"], "turn": moved["turn"], "leg2": moved["rho2"] / 10, "leg3": moved["rho3"] / 10}
        values |= {"swing2": moved["swing2"], "swing3": moved["swing3"]}
        theta = np.array([values[name] for name in names])
        q = theta[system.independent]
        if np.all((q > REGION[0]) & (q < REGION[1])):
            gap = theta - atlas.left.centre
            gap -= 2 * np.pi * np.round(gap / (2 * np.pi)) * system.periodic
            leaning = np.einsum("kmn,kn->km", atlas.left.slopes, gap[:, system.independent])
            gap[:, system.dependent] -= leaning
            assert np.any(np.all(np.abs(gap) <= atlas.left.half + 1e-9, axis=1))
            seen += 1
    assert seen > 10


def singular_poses(turns):
    """(leg, turn) with det = 0 in closed form, on a grid of turns."""
    angles = np.linspace(-np.pi, np.pi, 73)
    for turn in np.linspace(-np.pi, np.pi, turns):
        det = np.linalg.det([cusped.jacobian((leg, turn)) for leg in angles])
        for k in np.flatnonzero(np.sign(det[:-1]) != np.sign(det[1:])):
            leg = brentq(lambda at, turn=turn: np.linalg.det(cusped.jacobian((at, turn))), *angles[k : k + 2])
            yield np.array([leg, turn])


def test_a_sheet_goes_round_the_cusp(atlas, slice_):
    """Its two layers are joined by a path that is proved to meet no singularity and ends in another assembly mode."""
    assert atlas.sheets[0].layers == 2
    change = atlas.mode_change()
    proof = domain.certify_path(slice_, change.path, tube=1e-6, near=change.start)
    assert proof.verdict == "proven"
    end = proof.sigma(proof.reached)
    turned = np.abs(np.exp(1j * end) - np.exp(1j * change.end))
    assert turned.max() < 1e-9
    assert np.abs(np.exp(1j * change.end) - np.exp(1j * change.start)).max() > 0.1
    assert np.allclose(change.path[0], change.path[-1])


def test_sheets_touch_at_folds(atlas, slice_):
    """Every fold is singular, and a step off it the sextic has two roots more on one side than on the other."""
    found = atlas.folds(60)
    assert len(found) > 10
    constraints, independent = slice_.constraints(), atlas.problem.system.independent
    for fold in found:
        value = constraints.value(fold.q_free)
        dependent = np.delete(value.jacobian, independent, axis=1)
        left, singular, _ = np.linalg.svd(dependent)
        assert np.abs(value.phi).max() < 1e-9
        assert singular[-1] < 1e-7 * singular[0]
        normal = left[:, -1] @ value.jacobian[:, independent]
        sides = fold.q + 2e-5 * np.outer([-1.0, 1.0], normal / np.linalg.norm(normal))
        modes = oracle.modes(with_first_leg(sides), near=1e-7)[0]
        assert abs(int(modes[0]) - int(modes[1])) == 2
        signs = {atlas.sheets[number].sign for number in fold.sheets}
        assert signs == {-1, 1}


def test_the_five_bar_has_two_modes_or_none(rpdr):
    """Over the whole torus: two where the elbows are near enough, none where they are too far, at 20,000 points."""
    atlas = domain.certify_sheets(rpdr, (np.full(2, -np.pi), np.full(2, np.pi)), max_depth=6)
    q = np.random.default_rng(5).uniform(-np.pi, np.pi, (20_000, 2))
    counted = atlas.number_of_solutions(q)
    reach = np.hypot(*five_bar.elbow_offset(q.T)) / (five_bar.A3 + five_bar.A4)
    known = counted >= 0
    assert np.array_equal(counted[known], np.where(reach[known] < 1.0, 2, 0))
    assert known.mean() > 0.85
    assert [sheet.layers for sheet in atlas.sheets] == [1, 1]
    assert [sheet.sign for sheet in atlas.sheets] in ([1, -1], [-1, 1])


@pytest.mark.slow
def test_the_five_bar_folds_where_it_is_stretched(rpdr):
    """Its two modes touch at the stretched loop, √(λ² + μ²) = a₃ + a₄."""
    atlas = domain.certify_sheets(rpdr, (np.full(2, -np.pi), np.full(2, np.pi)), max_depth=5)
    found = atlas.folds(15)
    assert {fold.sheets for fold in found} == {(0, 1)}
    q = np.array([fold.q for fold in found])
    assert np.abs(np.hypot(*five_bar.elbow_offset(q.T)) - five_bar.A3 - five_bar.A4).max() < 1e-7


@pytest.mark.parametrize("name", ["slider_crank", "four_bar"])
def test_cranks_have_two_sheets_all_the_way_round(name):
    """Both assembly modes of a crank that turns, all of the turn certified."""
    atlas = domain.certify_sheets(ccpin.load(name))
    assert (atlas.certified_fraction, atlas.undecided_fraction) == (1.0, 0.0)
    assert [sheet.layers for sheet in atlas.sheets] == [1, 1]
    assert np.allclose([sheet.area for sheet in atlas.sheets], 2 * np.pi)


@pytest.mark.slow
def test_the_3rrr_changes_its_mode_round_a_cusp():
    """With one motor held: counts at 100,000 points are those of the sextic, and a way round the cusp is proved."""
    mechanism = ccpin.load("planar_3rrr", locked=["motor3"])
    middle = np.array([-1.78, 1.0])
    atlas = domain.certify_sheets(mechanism, (middle - 0.2, middle + 0.2), max_depth=7)
    q = np.random.default_rng(9).uniform(middle - 0.2, middle + 0.2, (100_000, 2))
    counted = atlas.number_of_solutions(q)
    known = counted >= 0
    expected, doubtful = knees_modes(q[known])
    assert known.mean() > 0.9
    assert not np.any((expected != counted[known]) & ~doubtful)
    assert len(atlas.cusps()) == 1
    change = atlas.mode_change()
    assert domain.certify_path(mechanism, change.path, tube=1e-6, near=change.start).verdict == "proven"


def knees_modes(q):
    """Assembly modes of the 3-RRR for its first two motors' angles (K, 2): the knees are the base of a 3-RPR."""
    third = ccpin.ReducedModel(ccpin.load("planar_3rrr"))
    angles = np.column_stack([q, np.full(len(q), third.alpha(third.mechanism.q_reference)[2])])
    way = np.exp(1j * three_legs.DIRECTIONS)
    knees = three_legs.BASE_RADIUS * way + three_legs.PROXIMAL * np.exp(1j * angles)
    pins = three_legs.PLATFORM_RADIUS * way
    shape = knees[:, 1:2] - knees[:, :1], knees[:, 2:] - knees[:, :1], pins[1] - pins[0], pins[2] - pins[0]
    return oracle.modes(np.full((len(q), 3), three_legs.DISTAL), shape=shape)


def test_a_slide_counts_within_its_limits():
    """A slider-crank whose slide ends at 0.1 m: the mode right of it counts where it is in reach, and only there."""
    crank = ccpin.load("slider_crank", joints={"slider": {"lower": 0.1, "upper": 0.2}})
    atlas = domain.certify_sheets(crank, ([-np.pi], [np.pi]))
    q = np.random.default_rng(8).uniform(-np.pi, np.pi, (5000, 1))
    counted, stroke = atlas.number_of_solutions(q), np.array([sliding.sigma(a)["slider"] for a in q[:, 0]])
    known = counted >= 0
    assert np.array_equal(counted[known], (stroke[known] > 0.1).astype(int))
    assert 0.9 < known.mean() < 1.0
    assert set(counted) == {-1, 0, 1}


def test_the_cusp_is_found_from_the_cells_left(atlas):
    """The one of the slice's six that lies over the region."""
    expected = oracle.cusps(LEG1, grid=60)
    inside = expected[np.all((expected > REGION[0]) & (expected < REGION[1]), axis=1)]
    found = atlas.cusps()
    assert len(found) == len(inside) == 1
    assert np.abs(found[0].q - inside[0]).max() < 1e-7


def test_sigma_near(atlas):
    """σ near a configuration is the nearest one; over an empty place there is none."""
    change = atlas.mode_change()
    q = change.path[0]
    for wanted in (change.start, change.end):
        assert np.allclose(atlas.sigma(q, wanted), wanted)
    with pytest.raises(InvalidInputError, match="certified point"):
        atlas.sigma([0.9, 0.9], change.start)


def test_a_way_stays_on_its_sheet(atlas):
    """Between configurations on different sheets there is none."""
    q = atlas.mode_change().path[0]
    sheets = atlas.solutions(q)[1]
    one, other = 0, int(np.argmax(sheets != sheets[0]))
    with pytest.raises(InvalidInputError, match="different sheets"):
        atlas.way(q, one, other)


def test_a_map_is_drawn(atlas, slice_):
    """With cusps and a path; of three coordinates there is none."""
    figure = plotting.plot_sheets(slice_, atlas, atlas.cusps(), atlas.mode_change().path)
    assert len(figure.axes[0].collections) == 3


@pytest.mark.parametrize(
    ("name", "words"), [("stewart", "one to three"), ("bennett", "rows of rank"), ("delta", "18 of its coordinates")]
)
def test_what_cannot_be_searched_is_refused(name, words):
    """Too many coordinates or redundant rows, with the reason."""
    with pytest.raises(UnsupportedMechanismError, match=words):
        domain.certify_sheets(ccpin.load(name))


def test_a_budget_that_runs_out_leaves_cells_undecided(slice_):
    """What was not come to is not counted, the shares add up, and what is counted is right."""
    atlas = domain.certify_sheets(slice_, REGION, max_depth=4, budget=4_000)
    assert atlas.counted_fraction < 0.85
    assert atlas.counted_fraction + atlas.singular_fraction + atlas.undecided_fraction == pytest.approx(1.0, abs=1e-12)
    assert wrong_counts(atlas, np.random.default_rng(10).uniform(*REGION, (2000, 2)))[0] == 0


def test_wrong_arguments_are_named(slice_):
    """A region of the wrong shape and a depth that is none."""
    for region, depth in ((([0.1], [0.2]), 4), ((REGION[1], REGION[0]), 4), (REGION, 0), (REGION, 40)):
        with pytest.raises(InvalidInputError):
            domain.certify_sheets(slice_, region, max_depth=depth)
