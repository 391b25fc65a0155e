"""Distance closures in joint space: the lemma of their rods, and certificates against closed forms and other roots."""

import numpy as np
import pytest

import ccpin
from ccpin import domain
from ccpin.control import certify_set_point
from ccpin.covering.proposals.solving import newton
from ccpin.domain import scalar_coordinates_at, theorem2
from ccpin.domain.closures.system import reading_of
from ccpin.errors import UnsupportedMechanismError
from ccpin.proof.equations import closure_values
from tests.support.rods import rocker_angle, rod_ankle, rod_four_bar, rod_stewart
from tests.support.walkthrough import file


@pytest.fixture(params=["native", "numpy"])
def backend(request, monkeypatch):
    monkeypatch.setenv("CCPIN_BACKEND", request.param)


@pytest.mark.parametrize(
    "description", [rod_four_bar(), rod_four_bar(0.15), rod_stewart(), rod_stewart("cranks")], ids=lambda d: d.name
)
def test_the_lemma(description):
    """At closed configurations det φ_y with rods is ± Π L² cos b (Π L in the plane) times det φ_y without."""
    mechanism = ccpin.load(description)
    rng, parametrization = np.random.default_rng(0), mechanism.parametrization()
    reading = reading_of(mechanism, mechanism.q_reference)
    system, problem = reading.system, reading.bounded("reach").problem
    for _ in range(6):
        q = parametrization.coordinates.alpha(mechanism.q_reference) + rng.uniform(-0.03, 0.03, mechanism.n)
        q_free = parametrization.sigma(q).q_free
        theta = reading.theta(q_free)
        phi, jacobian = closure_values(problem, theta[None])
        assert np.abs(phi).max() < 1e-9
        with_rods = np.linalg.det(jacobian[0][:, system.dependent])
        free = [k for k in system.dependent if k < mechanism.n_free]
        plain = np.linalg.det(_chart_slope(mechanism, reading, theta)[:, free])
        factor = 1.0
        for rod in reading.rods:
            factor *= rod.length if rod.planar else rod.length**2 * np.cos(theta[rod.place][1])
        assert abs(with_rods) == pytest.approx(abs(factor * plain), rel=1e-5)


def _chart_slope(mechanism, reading, theta, step=1e-6):
    """φ's Jacobian by the chart's coordinates, by central differences of the reference's residual."""
    columns = []
    for k in range(mechanism.n_free):
        ends = []
        for side in (1.0, -1.0):
            moved = theta.copy()
            moved[k] += side * step
            ends.append(mechanism.constraints().residual(reading.configuration(moved)))
        columns.append((ends[0] - ends[1]) / (2.0 * step))
    return np.column_stack(columns)


@pytest.mark.usefixtures("backend")
@pytest.mark.parametrize("skew", [0.0, 0.15])
def test_a_full_turn_is_the_closed_form(skew, tmp_path):
    """The crank's whole circle is certified and closes on itself; σ is where circles meet, after saving too."""
    mechanism = ccpin.load(rod_four_bar(skew))
    atlas = domain.certify(mechanism, [-1.0], ([-np.pi], [np.pi]))
    assert (atlas.verdict, atlas.certified_fraction) == ("proven", 1.0)
    assert np.all(atlas.verify())
    atlas.save(tmp_path / "atlas.npz")
    q = np.random.default_rng(1).uniform(-np.pi, np.pi, 500)
    expected = np.array([rocker_angle(one) for one in q])
    for kept in (atlas, domain.Atlas.load(tmp_path / "atlas.npz")):
        gap = kept.sigma(q[:, None])[:, 1] - expected
        assert np.abs(np.remainder(gap + np.pi, 2 * np.pi) - np.pi).max() < 1e-9


def test_rods_cost_what_links_cost():
    """A rod given as a distance is certified as far as one given as a link, on Theorem 2's and the one box's terms."""
    mechanism = ccpin.load(rod_four_bar())
    link = ccpin.load("four_bar")
    for m in (mechanism, link):
        assert domain.kantorovich_radius(m, m.q_reference, "planar") > theorem2(m, m.q_reference).radius > 0.1


@pytest.mark.usefixtures("backend")
@pytest.mark.parametrize("kind", ["slides", "cranks"])
def test_a_stewart_platform_on_rods(kind):
    """Over the certified cube one root lies in the tube: Newton finds σ's from anywhere near, and no other there."""
    mechanism = ccpin.load(rod_stewart(kind))
    q0 = scalar_coordinates_at(mechanism, mechanism.q_reference)
    radius = domain.kantorovich_radius(mechanism, mechanism.q_reference)
    assert radius > (0.005 if kind == "slides" else 0.03)
    path = domain.certify_path(mechanism, [q0, q0 + 3.0 * radius], 1e-4)
    assert path.verdict == "proven"
    for t in np.linspace(0.0, 1.0, 9):
        q_free = path.sigma(t)
        assert np.abs(mechanism.constraints().residual(q_free)).max() < 1e-10
    rng, boxes, system = np.random.default_rng(2), path.boxes, path.problem.system
    for k in range(len(boxes.kappa)):
        delta = rng.uniform(-1.0, 1.0, (40, boxes.half.shape[1])) * boxes.half[k]
        zeta = rng.uniform(-1.0, 1.0, (40, system.m)) * boxes.radius[k]
        start = boxes.centre[k] + delta @ boxes.directions[k].T
        start[:, system.dependent] += zeta @ boxes.modes[k].T
        found = newton(path.problem, start, 20)
        inside = (
            found.theta[:, system.dependent] - (boxes.centre[k] + delta @ boxes.directions[k].T)[:, system.dependent]
        )
        inside = np.abs(np.linalg.solve(boxes.modes[k], inside.T).T) <= boxes.radius[k]
        assert found.settled.all()
        assert inside.all()


def test_a_set_point_of_a_platform_on_rods():
    """Theorem 3 holds around a pose of the platform on cranks, and U ≥ c on the box's faces by the reference."""
    model = ccpin.ReducedModel(ccpin.load(rod_stewart("cranks")))
    certificate = certify_set_point(model, model.alpha(model.mechanism.q_reference), 80.0, 5.0)
    assert certificate.verdict == "proven"
    assert np.linalg.norm(model.gravity_derivative(certificate.law.q_d), 2) <= certificate.beta
    lower, upper = (corner[0] for corner in certificate.cells)
    rng = np.random.default_rng(4)
    for _ in range(40):
        q = rng.uniform(lower, upper)
        k = rng.integers(len(q))
        q[k] = (lower, upper)[rng.integers(2)][k]
        assert certificate.law.lyapunov(q, np.zeros(len(q))) >= certificate.level - 1e-12


def test_the_ankle_with_rods_as_distances_is_the_ankle_with_links():
    """The two-rod ankle with links for rods, one of them spinning, and with distances: the same σ."""
    links, distances = ccpin.load(file("ankle")), ccpin.load(rod_ankle())
    names = ("pitch", "roll", "left_motor", "right_motor")
    region = np.full(2, -0.5), np.full(2, 0.5)
    atlases = [domain.certify(m, np.zeros(2), region, max_depth=5) for m in (links, distances)]
    q = np.random.default_rng(5).uniform(-0.5, 0.5, (200, 2))
    q = q[atlases[0].contains(q) & atlases[1].contains(q)]
    assert len(q) > 180
    poses = [
        np.array([[row[m.tree.joint(name).q.start] for name in names] for row in atlas.sigma(q)])
        for m, atlas in zip((links, distances), atlases, strict=True)
    ]
    assert np.abs(poses[0] - poses[1]).max() < 1e-7


def _tubes(atlas, q):
    """For points q (K, n) the boxes that hold them, the parameters there and θ of the predictor."""
    numbers = atlas._box_numbers(q)
    boxes = atlas.boxes.take(numbers)
    delta = atlas.region.reduce(q) - boxes.centre[:, atlas.problem.system.independent]
    return boxes, boxes.centre + np.einsum("bij,bj->bi", boxes.directions, delta)


def _in_tube(system, boxes, predicted, theta):
    """Whether configurations θ lie in the boxes' tubes, angles modulo 2π."""
    gap = (theta - predicted)[:, system.dependent]
    turned = np.where(system.periodic[system.dependent], np.remainder(gap + np.pi, 2 * np.pi) - np.pi, gap)
    return np.all(np.abs(np.linalg.solve(boxes.modes, turned[..., None])[..., 0]) <= boxes.radius, axis=1)


def _planar_theta(system, crank, side):
    """θ of four-bars in closed form, crank angles (K,): rocker on one side, and where the rod then points."""
    q_free = np.column_stack([crank, [rocker_angle(one, side) for one in crank]])
    return np.array([system.theta(row) for row in q_free])


@pytest.mark.slow
@pytest.mark.parametrize("skew", [0.0, 0.15])
def test_attack_on_four_bars(skew, capsys):
    """At 100,000 certified crank angles the closed form's root lies in the tube and its other root does not."""
    mechanism = ccpin.load(rod_four_bar(skew))
    atlas = domain.certify(mechanism, [-1.0], ([-np.pi], [np.pi]), bounds="reach")
    system, crank = atlas.problem.system, np.random.default_rng(6).uniform(-np.pi, np.pi, 100_000)
    boxes, predicted = _tubes(atlas, crank[:, None])
    ours, other = (_in_tube(system, boxes, predicted, _planar_theta(system, crank, side)) for side in (-1.0, 1.0))
    with capsys.disabled():
        told = f"{len(crank)} points, {(~ours).sum()} outside, {other.sum()} second roots"
        print(f"\nrod four-bar, skew {skew:g} m: {told}")  # noqa: T201
    assert ours.all()
    assert not other.any()


@pytest.mark.slow
@pytest.mark.parametrize("make", [rod_ankle, rod_stewart], ids=["ankle", "stewart"])
def test_attack_on_rods_in_space(make, capsys):
    """Newton from 8 random starts in each of 20,000 certified points' tubes and beyond finds one root in each tube."""
    mechanism = ccpin.load(make())
    q0 = scalar_coordinates_at(mechanism, mechanism.q_reference)
    half = 0.4 if mechanism.n == 2 else 2.0 * domain.kantorovich_radius(mechanism, mechanism.q_reference)
    atlas = domain.certify(mechanism, q0, (q0 - half, q0 + half))
    problem, system, rng = atlas.problem, atlas.problem.system, np.random.default_rng(7)
    q = rng.uniform(q0 - half, q0 + half, (20_000, mechanism.n))
    q = q[atlas.contains(q)]
    boxes, predicted = _tubes(atlas, q)
    expected, hits = None, np.zeros(len(q), dtype=int)
    for spread in (0.5, 1.0, 1.0, 2.0, 4.0, 10.0, 30.0, 100.0):
        start = predicted.copy()
        zeta = spread * rng.uniform(-1.0, 1.0, boxes.radius.shape) * boxes.radius
        start[:, system.dependent] += np.einsum("bij,bj->bi", boxes.modes, zeta)
        found = newton(problem, start, 30)
        inside = found.settled & _in_tube(system, boxes, predicted, found.theta)
        hits += inside
        expected = found.theta.copy() if expected is None else expected
        turns = (found.theta - expected)[inside] / (2 * np.pi)
        assert np.abs(turns - np.where(system.periodic, np.round(turns), 0.0)).max() < 1e-9
        if spread <= 1.0:
            assert inside.all()
    with capsys.disabled():
        print(f"\n{mechanism.name}: {len(q)} points, {hits.sum()} roots found in their tubes, none a second one")  # noqa: T201


def test_a_map_in_six_coordinates():
    """Beyond three coordinates a region is asked for, and a cube of two one-box radii is certified whole."""
    mechanism = ccpin.load(rod_stewart())
    q0 = scalar_coordinates_at(mechanism, mechanism.q_reference)
    half = 2.0 * domain.kantorovich_radius(mechanism, mechanism.q_reference)
    atlas = domain.certify(mechanism, q0, (q0 - half, q0 + half))
    assert (atlas.verdict, atlas.certified_fraction) == ("proven", 1.0)
    with pytest.raises(UnsupportedMechanismError, match="region="):
        domain.certify(mechanism, q0)
