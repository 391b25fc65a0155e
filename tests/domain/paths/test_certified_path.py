"""Certified paths: σ along them against closed forms, and refusal at singularities where closed forms put them."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, PPoly, make_interp_spline
from scipy.optimize import brentq

import ccpin
from ccpin.domain import certify_path, scalar_coordinates_at
from ccpin.domain.paths.pieces import pieces_of
from ccpin.errors import InvalidInputError, SingularConfigurationError, UnreachableError
from ccpin.proof.chords import chord_of
from ccpin.proof.equations import closures_of
from ccpin.proof.newton import check
from tests.oracles import delta as delta_oracle
from tests.oracles import rpdr as oracle
from tests.oracles import stewart as stewart_oracle
from tests.oracles.geometry import rot_x, rot_y, rot_z, wrap
from tests.support.paper import GOAL, START
from tests.support.singular import least_singular_value

WAYPOINTS = np.array([START, *np.radians([(-120.0, -100.0), (-100.0, -140.0)]), GOAL])


@pytest.fixture(scope="module")
def stewart():
    return ccpin.load("stewart")


def legs(mechanism, position, rotation):
    """Leg extensions for a pose, in the order of q."""
    found = stewart_oracle.inverse(np.asarray(position), rotation)
    return np.array([found[name] for name in mechanism.independent])


def rpdr_closed(q_free):
    q1, q3, q2, q4 = q_free
    gap = np.array([q1, q2, q3, q4]) - oracle.sigma((q1, q2), 1.0)
    return np.abs(wrap(gap)).max()


@pytest.mark.parametrize("bounds", ["planar", "reach"])
def test_straight_move_of_the_case_study(rpdr, bounds):
    """The paper's move from (−150°, −160°) to (−90°, −100°) is certified with a tube of two degrees."""
    path = certify_path(rpdr, WAYPOINTS[[0, -1]], tube=np.radians(2.0), bounds=bounds)
    assert path.verdict == "proven"
    assert path.reason.startswith("σ stays on its branch")
    assert path.reached == 1.0
    assert np.all(check(closures_of(path.problem), path.boxes).proved)
    for t in np.linspace(0.0, 1.0, 23):
        found = path.sigma(t)
        assert np.abs(found[[0, 2]] - (1 - t) * WAYPOINTS[0] - t * WAYPOINTS[-1]).max() < 1e-14
        assert rpdr_closed(found) < 1e-9


@pytest.mark.parametrize("make", [CubicSpline, make_interp_spline], ids=["PPoly", "BSpline"])
def test_splines(rpdr, make):
    """σ along a spline is the closed form's, on the spline exactly and at its knots too."""
    spline = make(np.array([0.0, 1.0, 2.5, 3.0]), WAYPOINTS)
    path = certify_path(rpdr, spline)
    assert path.verdict == "proven"
    t = np.linspace(0.0, 3.0, 101)
    found = path.sigma(t)
    assert np.abs(found[:, [0, 2]] - spline(t)).max() < 1e-14
    assert max(rpdr_closed(row) for row in found) < 1e-9


def test_boxes_cover_the_tube(rpdr):
    """Every point of the tube about a spline lies in a box at its parameter, and each box's σ there closes."""
    spline, tube = CubicSpline([0.0, 1.0, 2.5, 3.0], WAYPOINTS), np.array([0.02, 0.01])
    path = certify_path(rpdr, spline, tube)
    assert path.verdict == "proven"
    rng, independent = np.random.default_rng(0), path.problem.system.independent
    for t in rng.uniform(0.0, 3.0, 300):
        q = spline(t) + tube * rng.choice([-1.0, 1.0], 2)
        k = min(int(np.searchsorted(path.times, t, side="right")) - 1, len(path.boxes.kappa) - 1)
        s = 2.0 * (t - path.times[k]) / (path.times[k + 1] - path.times[k]) - 1.0
        across = q - path.boxes.centre[k, independent] - s * path.boxes.directions[k, independent, 0]
        assert np.all(np.abs(across) <= path.boxes.half[k, 1:] + 1e-14)
        assert np.all(path.boxes.half[k, 0] == 1.0)


def test_deviation_from_the_chord_is_bounded():
    """Bernstein coefficients bound how far a spline's stretch strays from its chord."""
    spline = CubicSpline([0.0, 1.0, 2.5, 3.0], WAYPOINTS)
    pieces, rng = pieces_of(spline, 2), np.random.default_rng(1)
    for _ in range(100):
        piece = rng.integers(3)
        start, end = np.sort(rng.uniform(pieces.x[piece], pieces.x[piece + 1], 2))
        chord, s = chord_of(pieces, start, end), np.linspace(0.0, 1.0, 50)[:, None]
        gap = spline(start + s[:, 0] * (end - start)) - (1 - s) * chord.start - s * chord.end
        assert np.all(np.abs(gap) <= chord.deviation)
        assert np.all(chord.deviation <= 4.0 * np.abs(gap).max(axis=0) + 1e-12)


@pytest.mark.parametrize("tube", [0.0, 1e-6, 1e-3])
def test_stops_where_the_rpdr_stretches(rpdr, tube):
    """A line through the stretched loop is certified up to it, short of it by no more than the tube asks for."""
    ends = np.radians([(-108.0, -72.0), (-108.0, 0.0)])
    path = certify_path(rpdr, ends, tube)
    exact = brentq(lambda s: oracle.elongation(ends[0] + s * (ends[1] - ends[0])) - 1.0, 0.0, 1.0)
    assert path.verdict != "proven"
    assert exact - 4.0 * tube - 1e-5 < path.reached < exact
    assert path.verdict == "refuted"
    assert path.witness.kind == "singular"
    assert "the branch is singular in the tube" in path.reason
    assert abs(oracle.elongation(path.witness.q) - 1.0) < 10.0 * path.witness.error
    assert path.rcond < 0.1
    with pytest.raises(InvalidInputError, match="certified for parameters"):
        path.sigma(exact)
    assert rpdr_closed(path.sigma(path.reached)) < 1e-4


def test_stops_at_the_coincident_elbows(rpdr):
    """The isolated singularity blocks a line through it, but not one that passes by."""
    elbows, aside = -oracle.coincident_elbows(), np.array([0.0, np.radians(1.0)])
    ends = np.array([elbows - [0.2, 0.2], elbows + [0.2, 0.2]])
    q1, q2, q3, q4 = oracle.sigma(ends[0], 1.0)
    near = np.array([q1, q3, q2, q4])
    blocked = certify_path(rpdr, ends, 0.0, near)
    assert blocked.verdict != "proven"
    assert 0.5 - 1e-3 < blocked.reached < 0.5
    assert blocked.verdict == "undecided"
    assert blocked.witness is None
    assert "boxes of" in blocked.reason
    assert certify_path(rpdr, ends + [aside, aside], 1e-3, near).verdict == "proven"


def test_gough_stewart_translation_and_rotation(stewart):
    """A 0.2 m translation and a turn of the platform are certified with a 1 mm tube of leg lengths; poses agree."""
    names = list(stewart.pin_model.names)[1:]
    moves = {
        "translation": [((x, 0.0, 0.45), np.eye(3)) for x in np.linspace(-0.1, 0.1, 21)],
        "rotation": [
            ((0.0, 0.02, 0.45), rot_z(0.3 * a) @ rot_y(0.2 * a) @ rot_x(-0.2 * a)) for a in np.linspace(-1, 1, 21)
        ],
    }
    for poses in moves.values():
        knots = np.linspace(0.0, 1.0, len(poses))
        path = certify_path(stewart, CubicSpline(knots, [legs(stewart, *pose) for pose in poses]), 1e-3)
        assert path.verdict == "proven"
        for t, pose in zip(knots, poses, strict=True):
            expected = stewart_oracle.inverse(np.asarray(pose[0]), pose[1])
            assert np.abs(wrap(path.sigma(t) - [expected[name] for name in names])).max() < 1e-9


def test_gough_stewart_singularity(stewart):
    """Turning the platform level about its axis is refused at a right angle, its known singularity, not before."""
    yaw = np.linspace(0.0, 0.75 * np.pi, 30)
    spline = CubicSpline(yaw, [legs(stewart, (0.0, 0.0, 0.45), rot_z(angle)) for angle in yaw])
    path = certify_path(stewart, spline, 0.0)

    def determinant(angle):
        """The six legs' Plücker coordinates are dependent where it vanishes."""
        vectors = stewart_oracle.leg_vectors(np.array([0.0, 0.0, 0.45]), rot_z(angle))
        base = np.zeros((6, 3))
        base[:, 0], base[:, 1] = np.cos(stewart_oracle.BASE_ANGLES), np.sin(stewart_oracle.BASE_ANGLES)
        return np.linalg.det(np.hstack([vectors, np.cross(0.4 * base, vectors)]))

    exact = brentq(determinant, 1.2, 2.0, xtol=1e-14)
    assert path.verdict != "proven"
    assert exact - 2e-3 < path.reached < exact + 1e-9
    assert "singularity" in path.reason


def test_delta_path():
    """A circle of the Delta's arms about their reference is certified; positions are those of the three spheres."""
    mechanism = ccpin.load("delta")
    turns = np.linspace(0.0, 2.0 * np.pi, 25)
    arms = 0.2 * np.cos(turns[:, None] + np.array([0.0, 2.0, 4.0]) * np.pi / 3.0)
    path = certify_path(mechanism, arms, 1e-3)
    assert path.verdict == "proven"
    assert np.abs(path.sigma(24.0) - path.sigma(0.0)).max() < 1e-12
    for k in range(0, 25, 6):
        assert np.abs(path.sigma(float(k))[:3] - delta_oracle.forward(arms[k])).max() < 1e-9


def test_bad_input(rpdr):
    """Paths and tubes of the wrong shape, jumps and impossible starts are refused in words."""
    jump = PPoly(np.zeros((1, 2, 2)) + np.array([[[0.0, 0.0], [1.0, 1.0]]]), np.array([0.0, 1.0, 2.0]))
    for bad, message in (
        (np.zeros((1, 2)), "two waypoints"),
        (np.zeros((3, 3)), "waypoints of shape"),
        (np.full((2, 2), np.nan), "not finite"),
        (CubicSpline([0.0, 1.0], [0.0, 1.0]), "spline"),
        (jump, "jumps"),
    ):
        with pytest.raises(InvalidInputError, match=message):
            certify_path(rpdr, bad)
    for tube in (-1.0, (1.0, 2.0, 3.0), np.nan):
        with pytest.raises(InvalidInputError, match="tube"):
            certify_path(rpdr, WAYPOINTS, tube)
    with pytest.raises(UnreachableError):
        certify_path(rpdr, np.radians([(180.0, 0.0), (170.0, 0.0)]))
    with pytest.raises((SingularConfigurationError, UnreachableError)):
        certify_path(rpdr, np.array([oracle.coincident_elbows(), np.zeros(2)]))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["planar_3rrr", "stewart"])
def test_a_fold_refutes_a_straight_path(name):
    """Paths far beyond the workspace meet a fold: the witness is singular, lies on the path and before its end."""
    mechanism = ccpin.load(name)
    start = np.array(scalar_coordinates_at(mechanism, mechanism.q_reference))
    way = np.random.default_rng(4).uniform(-3.0, 3.0, mechanism.n)
    path = certify_path(mechanism, [start, start + way], 1e-4)
    assert (path.verdict, path.witness.kind) == ("refuted", "singular")
    assert np.abs(mechanism.constraints().residual(path.witness.q_free)).max() < 1e-9
    assert least_singular_value(mechanism, path.witness.q_free) < 1e-7
    along = (path.witness.q - start) @ way / (way @ way)
    assert np.abs(path.witness.q - start - along * way).max() < 1e-4 + 1e-9
    assert path.reached - 1e-3 < along < 1.0
