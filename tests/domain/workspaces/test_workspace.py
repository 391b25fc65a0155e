"""Task space certified: every certified point against closed-form inverse kinematics, limits and det included."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

import ccpin
from ccpin import domain
from ccpin.covering.proposals.krawczyk import certify_boxes
from ccpin.domain.atlas.atlas import Atlas
from ccpin.domain.workspaces.workspace import task_problem
from ccpin.errors import InvalidInputError, UnreachableError, UnsupportedMechanismError
from ccpin.proof.requirements import conditioning
from tests.oracles import delta as delta_oracle
from tests.oracles import rpdr as rpdr_oracle
from tests.oracles import stewart as stewart_oracle
from tests.oracles.geometry import rot_x, rot_y, rot_z, wrap
from tests.support.long_cases import later
from tests.support.places import MODELS

CENTRE = np.array([0.0, 0.0, 0.45])
POINTS = 800


@pytest.fixture
def rng():
    return np.random.default_rng(12)


@pytest.fixture(scope="module")
def stewart():
    mechanism = ccpin.load(MODELS / "stewart.urdf")
    joint = stewart_oracle.PLATFORM_RADIUS * np.array(
        [np.cos(stewart_oracle.PLATFORM_ANGLES[0]), np.sin(stewart_oracle.PLATFORM_ANGLES[0]), 0.0]
    )
    return ccpin.EndEffector(mechanism, "platform", -joint)


@pytest.fixture(scope="module")
def delta():
    return ccpin.EndEffector(ccpin.load(MODELS / "delta.urdf"), "platform")


@pytest.fixture(scope="module")
def cube(stewart):
    return domain.largest_cube(stewart, CENTRE, tolerance=0.05)


def stewart_jacobian(position, rotation):
    """∂legs/∂(position, turn) from the legs' directions: rows (u, r × u)."""
    legs = stewart_oracle.leg_vectors(position, rotation)
    units = legs / np.linalg.norm(legs, axis=1, keepdims=True)
    arms = stewart_oracle.PLATFORM_RADIUS * np.column_stack(
        [np.cos(stewart_oracle.PLATFORM_ANGLES), np.sin(stewart_oracle.PLATFORM_ANGLES), np.zeros(6)]
    )
    return np.hstack([units, np.cross(arms @ rotation.T, units)])


def limits_of(mechanism):
    low, high = mechanism.position_limits
    return {j.name: (low[j.q][0], high[j.q][0]) for j in mechanism.tree.joints}


def inside(limits, q_free):
    return all(limits[name][0] <= value <= limits[name][1] for name, value in q_free.items())


def stewart_at(x):
    return x[:3], rot_x(x[3]) @ rot_y(x[4]) @ rot_z(x[5])


def attack_stewart(end_effector, atlas, points):
    """Every point has legs within limits, det of the same sign, and the atlas's q′ is the closed form's."""
    mechanism, limits = end_effector.model.mechanism, limits_of(end_effector.model.mechanism)
    sign = np.sign(np.linalg.det(stewart_jacobian(*stewart_at(atlas.q0))))
    q_free = atlas.sigma(points)
    for x, found in zip(points, q_free, strict=True):
        exact = stewart_oracle.inverse(*stewart_at(x))
        assert inside(limits, exact)
        assert sign * np.linalg.det(stewart_jacobian(*stewart_at(x))) > 0.0
        for joint in mechanism.tree.joints:
            assert np.sin(found[joint.q][0] / 2 - exact[joint.name] / 2) == pytest.approx(0.0, abs=1e-8)


def attack_delta(end_effector, atlas, points):
    """The closed form leads every point's arms back to it, and det ψ_q′'s sign is the same at all."""
    joints = [end_effector.model.mechanism.tree.joint(name).q.start for name in delta_oracle.INDEPENDENT]
    signs = set()
    for x, angles in zip(points, atlas.sigma(points)[:, joints], strict=True):
        np.testing.assert_allclose(delta_oracle.forward(angles), x, atol=1e-9)
        centres = delta_oracle.sphere_centres(angles)
        swing = -delta_oracle.ARM * np.column_stack(
            [np.sin(angles) * np.cos(delta_oracle.YAW), np.sin(angles) * np.sin(delta_oracle.YAW), np.cos(angles)]
        )
        signs.add((np.sign(np.linalg.det(x - centres)), *np.sign(np.sum((x - centres) * swing, axis=1))))
    assert len(signs) == 1


def within(rng, atlas_or_cube, count):
    region = getattr(atlas_or_cube, "atlas", atlas_or_cube).region
    points = rng.uniform(region.lower, region.upper, (count, len(region.lower)))
    if not isinstance(atlas_or_cube, Atlas):
        slides = atlas_or_cube.shape.weights > 0.0
        low, high = atlas_or_cube.centre - atlas_or_cube.half, atlas_or_cube.centre + atlas_or_cube.half
        points[:, slides] = rng.uniform(low[slides], high[slides], (count, np.count_nonzero(slides)))
    return points[atlas_or_cube.contains(points)]


@pytest.mark.slow
def test_stewart_cube_holds_against_closed_forms(stewart, cube, rng):
    points = within(rng, cube, POINTS)
    assert len(points) > 0.9 * POINTS
    assert cube.half > 0.12
    assert cube.atlas.verify().all()
    assert cube.atlas.single_valued
    attack_stewart(stewart, cube.atlas, points)


@pytest.mark.slow
def test_stewart_cube_is_nearly_as_large_as_can_be(stewart, cube):
    """A corner of the cube of half width `upper` has a leg beyond its limit, and that is the obstacle's."""
    obstacle = cube.obstacle
    assert obstacle.kind == "limit"
    assert cube.half <= cube.upper <= 1.08 * cube.half
    exact = stewart_oracle.inverse(*stewart_at(obstacle.q))
    assert not inside(limits_of(stewart.model.mechanism), exact)
    grid = CENTRE + cube.upper * (1 + 1e-6) * np.array(np.meshgrid(*3 * [[-1, 0, 1]])).reshape(3, -1).T
    limits = limits_of(stewart.model.mechanism)
    assert not all(inside(limits, stewart_oracle.inverse(p, np.eye(3))) for p in grid)


def test_stewart_cube_with_tilt(stewart, rng):
    tilted = domain.largest_cube(stewart, CENTRE, tilt=[0.05, 0.05, 0.0], within=0.03, tolerance=0.5)
    assert tilted.half == pytest.approx(0.03, rel=1e-6)
    points = within(rng, tilted, 300)
    assert np.abs(points[:, 3:5]).max() > 0.04
    assert np.all(points[:, 5] == 0.0)
    attack_stewart(stewart, tilted.atlas, points)


def test_delta_workspace_against_inverse_kinematics(delta, rng):
    """At each x the atlas's arms lead the closed form back to x; nothing becomes singular."""
    middle = np.array([0.0, 0.0, -1.0])
    atlas = domain.certify_workspace(delta, (middle - 0.1, middle + 0.1))
    assert atlas.certified_fraction == 1.0
    assert atlas.names == ("x", "y", "z")
    assert atlas.verdict == "proven"
    attack_delta(delta, atlas, within(rng, atlas, POINTS))


@pytest.mark.slow
def test_joint_limits_bound_the_workspace(delta):
    """With the arms held near where they are, points that need other angles are not certified, and it says why."""
    middle = np.array([0.0, 0.0, -1.0])
    near = delta.solve(middle)
    start = near.q
    narrow = {name: (q - 0.1, q + 0.1) for name, q in zip(delta_oracle.INDEPENDENT, start, strict=True)}
    cube = domain.largest_cube(delta, middle, near.q_free, limits=narrow, tolerance=0.4)
    assert 0.0 < cube.half < 0.06
    assert cube.obstacle.kind == "limit"
    arms = [delta.solve(middle + cube.half * np.array(c)).q for c in np.ndindex(2, 2, 2)]
    assert np.abs(np.array(arms) - start).max() < 0.1


def conditioned(x, length):
    sizes = np.linalg.svd(stewart_jacobian(*stewart_at(x)) / np.repeat([1.0, length], 3), compute_uv=False)
    return sizes[-1] / sizes[0]


@pytest.mark.slow
def test_dexterity_is_kept(stewart, rng):
    """1/κ of the closed form's Jacobian is what was asked for at every certified point, and less at the obstacle."""
    length = 0.25
    least = 0.9 * conditioned(np.append(CENTRE, np.zeros(3)), length)
    cube = domain.largest_cube(stewart, CENTRE, dexterity=least, length=length, tolerance=0.5, within=0.04)
    assert 0.005 < cube.half < 0.04
    assert cube.obstacle.kind == "dexterity"
    assert all(conditioned(x, length) >= least for x in within(rng, cube, 500))
    assert conditioned(cube.obstacle.q, length) < least


def test_conditioning_encloses(stewart):
    start = task_problem(stewart, None, True, 0.1, 0.25, "auto")
    half = np.array([[0.002, 0.002, 0.002, 0.0, 0.0, 0.0]])
    box = certify_boxes(start.reading.problem, start.theta[None], half, np.eye(6))
    low, high = conditioning(start.reading.problem, start.reading.problem.requirements, box.boxes)
    exact = conditioned(np.append(CENTRE, np.zeros(3)), 0.25)
    assert low[0] <= exact <= high[0]
    assert high[0] - low[0] < 0.1


def test_planar_task_space(rng):
    mechanism = ccpin.load(MODELS / "planar_3rrr.urdf")
    end_effector = ccpin.EndEffector(mechanism, "platform")
    x = task_problem(end_effector, None, True, 0.0, None, "auto").x
    width = np.array([0.02, 0.02, 0.05])
    atlas = domain.certify_workspace(end_effector, (x - width, x + width))
    assert atlas.names == ("x", "z", "ry")
    assert atlas.certified_fraction == 1.0
    for point in within(rng, atlas, 20):
        pose = end_effector.point.pose(atlas.sigma(point))
        np.testing.assert_allclose(pose[[0, 2], 3], point[:2], atol=1e-10)


def test_saved_with_its_demands(stewart, tmp_path):
    atlas = domain.certify_workspace(stewart, (CENTRE - 0.02, CENTRE + 0.02), max_depth=4)
    atlas.save(tmp_path / "atlas.json")
    again = Atlas.load(tmp_path / "atlas.json")
    assert again.verify().all()
    assert again.problem.requirements is not None
    tight = again.problem.requirements._replace(upper=again.problem.requirements.upper - 10.0)
    tighter = again.reading._replace(problem=again.problem._replace(requirements=tight))
    assert not replace(again, reading=tighter).verify().any()


def test_wrong_arguments(stewart, delta):
    with pytest.raises(InvalidInputError, match="dexterity"):
        domain.certify_workspace(stewart, (CENTRE - 0.01, CENTRE + 0.01), dexterity=0.2)
    with pytest.raises(InvalidInputError, match="no joint"):
        domain.certify_workspace(delta, ([0, 0, -1.1], [0.1, 0.1, -1.0]), limits={"leg": (0.0, 1.0)})
    with pytest.raises(InvalidInputError, match="lower corner"):
        domain.certify_workspace(delta, ([0, 0, -1.0], [0.1, 0.1, -1.1]))
    with pytest.raises(UnreachableError, match="no certified way"):
        domain.largest_cube(delta, [0.0, 0.0, -5.0])
    with pytest.raises(UnreachableError, match="a limit"):
        domain.largest_cube(stewart, [0.0, 0.0, 0.75])
    four_bar = ccpin.load(MODELS / "four_bar.urdf")
    with pytest.raises(UnsupportedMechanismError, match="task space"):
        domain.certify_workspace(ccpin.EndEffector(four_bar, list(four_bar.tree.attachments)[-1]), ([0.0], [1.0]))


@pytest.mark.parametrize("depth", later(3, 5))
def test_a_region_beyond_limits_is_refuted(stewart, depth):
    """A region too wide for the legs is refuted by a pose at which the closed form has a leg beyond its limit."""
    atlas = domain.certify_workspace(stewart, ([0.0, 0.0, 0.2], [0.01, 0.01, 0.5]), max_depth=depth)
    assert atlas.verdict == "refuted"
    assert atlas.witness.kind == "limit"
    assert "beyond its limits" in atlas.reason
    assert not inside(limits_of(stewart.model.mechanism), stewart_oracle.inverse(*stewart_at(atlas.witness.q)))


def test_slices_of_joint_space(stewart, rng):
    """With four of six legs held the atlas is a slice; σ on it is the closed form's, and points off it are not in."""
    mechanism = stewart.model.mechanism
    q = np.array([mechanism.q_reference[mechanism.tree.joint(name).q.start] for name in stewart_oracle.INDEPENDENT])
    width = np.array([0.05, 0.05, 0.0, 0.0, 0.0, 0.0])
    atlas = domain.certify(mechanism, q, (q - width, q + width), fraction=0.9)
    assert atlas.certified_fraction >= 0.9
    assert atlas.verify().all()
    points = q + rng.uniform(-1.0, 1.0, (200, 6)) * width
    points = points[atlas.contains(points)]
    for point, q_free in zip(points[:20], atlas.sigma(points[:20]), strict=True):
        pose = stewart.point.pose(q_free)
        legs = stewart_oracle.leg_vectors(pose[:3, 3], pose[:3, :3])
        np.testing.assert_allclose(np.linalg.norm(legs, axis=1) - stewart_oracle.CYLINDER, point, atol=1e-9)
    assert not atlas.contains(q + 1e-3)
    with pytest.raises(InvalidInputError, match="in one coordinate at least"):
        domain.certify(mechanism, q, (q, q))


@pytest.mark.slow
def test_attack_with_many_points(stewart, delta, cube, rng):
    """A hundred thousand points each of the Stewart platform's cube and of a Delta's, none of them wrong."""
    for _ in range(20):
        attack_stewart(stewart, cube.atlas, within(rng, cube, 5000))
    ball = domain.largest_ball(delta, [0.0, 0.0, -1.0], tolerance=0.05)
    for _ in range(40):
        points = within(rng, ball, 5000)
        attack_delta(delta, ball.atlas, points)


@pytest.mark.slow
def test_the_roomiest_place_of_the_five_bar():
    """Without a centre: a square of joint angles as large as any is, by the closed form of the reach on a grid."""
    space, step = domain.JointSpace(ccpin.load("rpdr"), ("joint1", "joint2")), 0.02
    square = domain.largest_cube(space, limits=False, tolerance=0.05)
    start = domain.largest_cube(space, [-np.pi / 2, -np.pi / 2], limits=False, tolerance=0.5)
    assert square.half > start.half
    around = np.arange(-np.pi - 2.0, np.pi + 2.0, step)
    elbows = rpdr_oracle.elbow_offset(np.meshgrid(*(start.centre[k] + around for k in range(2)), indexing="ij"))
    closes = np.hypot(*elbows) < rpdr_oracle.A3 + rpdr_oracle.A4
    for singular in (rpdr_oracle.coincident_elbows(), -rpdr_oracle.coincident_elbows()):
        gap = [np.abs(wrap(start.centre[k] + around - singular[k])) for k in range(2)]
        closes &= (gap[0][:, None] > step) | (gap[1] > step)
    most = step * float(ndimage.distance_transform_cdt(np.pad(closes, 1), "chessboard").max())
    assert 0.9 * most < square.half < most + step
    assert square.atlas.verify().all()
    disc = domain.largest_ball(space, limits=False, tolerance=0.02)
    away = step * float(ndimage.distance_transform_edt(np.pad(closes, 1)).max())
    assert 0.9 * away < disc.half < away + step


@pytest.mark.slow
def test_the_roomiest_place_of_the_stewart_platform(stewart, cube):
    """It is no worse than about the middle, by the map's fineness, whatever turns are asked for besides."""
    free = domain.largest_cube(stewart, tilt=[0.02, 0.02, 0.0], tolerance=0.2, within=0.05)
    assert free.half == pytest.approx(0.05, rel=1e-6)
    assert np.abs(free.centre - np.append(CENTRE, np.zeros(3))).max() < cube.half
    assert domain.largest_cube(stewart, seconds=1e-3).atlas.complete is False
