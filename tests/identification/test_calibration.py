"""Geometry from poses: slopes, true robots, SciPy's least squares of closed forms, what is not observable."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

import ccpin
from ccpin.errors import ConvergenceError, InvalidInputError, UnsupportedMechanismError
from ccpin.identification import Sensor, calibrate
from ccpin.identification.calibration.calibrating import sensors_at
from ccpin.identification.calibration.geometry_fit import GeometryFit
from ccpin.identification.calibration.geometry_numbers import named_numbers, numbers_that_count
from ccpin.kinematics.points import LinkPoint
from tests.oracles.finite_differences import derivative
from tests.support.calibrated_robots import INSIDE, Robot, deviations, moved, tool, tool_errors
from tests.support.long_cases import later

C = 0.3048
ARMS = "origin:joint3/x", "origin:joint4/x", "origin:end_effector/A/x", "origin:end_effector/B/x"
NUMBERS = {
    "rpdr": ("origin:joint2/x", *ARMS, "origin:end_effector/A/z"),
    "delta": ("origin:rod1a_pitch/x", "origin:rod1b_pitch/x", "origin:rod2a_pitch/x", "origin:rod3b_pitch/x"),
    "stewart": (
        *(f"origin:ball{k}/B/{axis}" for k in range(3, 7) for axis in "xy"),
        "origin:ball2/B/y",
        "origin:leg2_roll/z",
    ),
}


def five_bar(lengths, q):
    """All joints' angles, of shape (N, 4), and the tip (N, 2): where circles about the elbows meet, the lower one."""
    a1, a2, a3, a4 = lengths
    left = a1 * np.stack([np.cos(q[:, 0]), np.sin(q[:, 0])], axis=1)
    right = a2 * np.stack([np.cos(q[:, 1]), np.sin(q[:, 1])], axis=1) + [C, 0.0]
    away = right - left
    gap = np.linalg.norm(away, axis=1)
    along = (a3**2 - a4**2 + gap**2) / (2.0 * gap)
    way = away / gap[:, None]
    down = np.stack([way[:, 1], -way[:, 0]], axis=1)
    tip = left + along[:, None] * way + np.sqrt(a3**2 - along**2)[:, None] * down
    q3, q4 = (np.arctan2(*(tip - elbow).T[::-1]) for elbow in (left, right))
    turns = np.stack([q[:, 0], q[:, 1], q3 - q[:, 0], q4 - q[:, 1]], axis=1)
    return np.remainder(turns + np.pi, 2.0 * np.pi) - np.pi, tip


@pytest.fixture(scope="module")
def robots():
    return {name: Robot(name) for name in NUMBERS}


def drawn(robot, count, seed=0):
    return np.random.default_rng(seed).uniform(*robot.box, (count, robot.stated.n))


@pytest.mark.parametrize("name", later(*NUMBERS))
def test_slopes_of_what_is_seen(robots, name):
    """Along one direction of all numbers and coordinates, against robots that are loaded anew."""
    robot, rng = robots[name], np.random.default_rng(4)
    there = numbers_that_count(robot.stated, [robot.link])
    every = [each for each in there if each.of.split("/")[0] not in robot.known]
    camera = Sensor.tracker(robot.link, point=robot.point, turn_noise=1e-3).kind
    kinds = sensors_at(robot.stated, [robot.sensors[0].kind, camera])
    q, along = drawn(robot, 3), 0.1 * rng.normal(size=(3, robot.stated.n))
    fit = GeometryFit(robot.stated, every, kinds, q, None, {}, 1e-3)
    way = 0.1 * rng.normal(size=len(every))

    def seen(step):
        told = {each.name: each.value + step * w for each, w in zip(every, way, strict=True)}
        model = ccpin.ReducedModel(ccpin.load(moved(robot.stated.mechanism.description, told)))
        at = LinkPoint(model.mechanism.tree, robot.link, robot.point)
        poses = np.array([at.pose(each) for each in model.sigma_many(q + step * along)])
        return np.concatenate([poses[:, :3, 3], poses[:, :3, :3].reshape(-1, 9)], axis=1)

    poses, n = fit.first.poses, robot.stated.n
    found = poses.by_numbers[:, n:] @ way + np.einsum("Nij,Nj->Ni", poses.by_q[:, n:], along)
    np.testing.assert_allclose(poses.seen[:, n:], seen(0.0), rtol=0, atol=1e-11)
    np.testing.assert_allclose(found, derivative(seen, 1e-2), rtol=0, atol=3e-7)


@pytest.mark.parametrize(
    "sensor",
    [
        Sensor.encoders(["joint1", "joint2"], offsets=["joint2"]),
        Sensor.tracker("link3", point=(0.1, 0.2, 0.3)),
        Sensor.tracker("link3", point=(0.1, 0.2, 0.3), turn_noise=1e-3, target=True),
        Sensor.touch("link3"),
        Sensor.plane("link3", (1.0, 2.0, 2.0), 0.1),
        Sensor.bar("link3", (1.0, 2.0, 3.0)),
    ],
    ids=lambda sensor: type(sensor.kind).__name__,
)
def test_slopes_of_sensors(robots, sensor):
    """What is left, by what is seen and by the sensor's own numbers, against differences."""
    (kind,), rng = sensors_at(robots["rpdr"].stated, [sensor.kind]), np.random.default_rng(2)
    seen = {"Encoders": rng.normal(size=(2, 2)), "Tracker": rng.normal(size=(2, 12))}.get(
        type(kind).__name__, rng.normal(size=(2, 3))
    )
    if not getattr(kind, "target", False) and type(kind).__name__ == "Tracker":
        seen = seen[:, :3]
    values = rng.normal(size=(2, 12 if len(kind.noise) == 6 else len(kind.noise)))
    own = 0.3 * rng.normal(size=len(kind.unknowns(robots["rpdr"].stated)))
    found = kind.compared(values, seen, own)
    way, turn = rng.normal(size=seen.shape), rng.normal(size=own.shape)
    by_seen = derivative(lambda s: kind.compared(values, seen + s * way, own).left)
    by_own = derivative(lambda s: kind.compared(values, seen, own + s * turn).left)
    np.testing.assert_allclose(-np.einsum("Nij,Nj->Ni", found.by_seen, way), by_seen, rtol=0, atol=1e-9)
    np.testing.assert_allclose(-found.by_own @ turn, by_own, rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", NUMBERS)
def test_robots_are_found_as_they_were_built(robots, name):
    """Without errors of sensors: numbers, offsets, where the tracker stands, and the file that is written."""
    robot, rng = robots[name], np.random.default_rng(3)
    built, q = robot.built(rng, NUMBERS[name]), drawn(robot, 30)
    found = robot.calibrated(built, q, rng, 0.0, parameters=NUMBERS[name], coarsest=0.5)
    values = dict(zip(found.parameters, found.values, strict=True))
    assert found.determined.all()
    for number, value in built.truth.items():
        assert abs(values[number] - value) < 1e-9, number
    np.testing.assert_allclose(found.frames["tracker"], built.base, rtol=0, atol=1e-9)
    assert tool_errors(robot, built, found, drawn(robot, 5, 9))[1].max() < 1e-9


def test_closures_alone():
    """Self-calibration: encoders of all four joints of a five-bar of other lengths, each mounted off, base known."""
    robot, rng = Robot("rpdr"), np.random.default_rng(6)
    lengths, off = np.array([0.2794, 0.2794, 0.3048, 0.3048]) + 1e-3 * rng.normal(size=4), 2e-3 * rng.normal(size=4)
    joints = "joint1", "joint2", "joint3", "joint4"
    said = five_bar(lengths, drawn(robot, 25))[0] + off
    found = calibrate(robot.stated, [(Sensor.encoders(joints, 1e-5), said)], parameters=ARMS)
    assert found.parameters == (*ARMS, *(f"offset:{joint}" for joint in joints))
    np.testing.assert_allclose(found.values, [*lengths, *off], rtol=0, atol=1e-9)
    again = ccpin.ReducedModel(ccpin.load(found.description))
    np.testing.assert_allclose(
        tool(again, "link3", (lengths[2], 0, 0), drawn(robot, 3))[:, [0, 2]],
        five_bar(lengths, drawn(robot, 3))[1], rtol=0, atol=1e-9,
    )  # fmt: skip


def test_it_is_the_most_likely_robot(robots):
    """SciPy's least squares over lengths, offsets and every true angle, of circles that meet; its covariance."""
    robot, rng = robots["rpdr"], np.random.default_rng(8)
    noise, q = (1e-4, 2e-4), drawn(robot, 10)

    def touched(lengths, q):
        turn = (joints := five_bar(lengths, q)[0])[:, 0] + joints[:, 2]
        at = [lengths[0] * np.cos(q[:, 0]) + C * np.cos(turn), lengths[0] * np.sin(q[:, 0]) + C * np.sin(turn)]
        return np.stack([at[0], np.zeros(len(q)), at[1]], axis=1)

    def left(z):
        true = z[6:].reshape(q.shape)
        pair = (said - true - z[4:6]) / noise[0], (points - touched(z[:4], true)) / noise[1]
        return np.concatenate([each.ravel() for each in pair])

    lengths = np.array([0.28, 0.2785, 0.3058, 0.3041])
    said = q + noise[0] * rng.normal(size=q.shape) + [1e-3, -2e-3]
    points = touched(lengths, q) + noise[1] * rng.normal(size=(10, 3))
    start = [*lengths, 0.0, 0.0, *said.ravel()]
    best = least_squares(left, start, jac="3-point", x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-12)
    spread = np.linalg.inv(best.jac.T @ best.jac)[:6, :6]
    scaled = np.sqrt(np.outer(np.diag(spread), np.diag(spread)))
    touch = Sensor.touch("link3", noise[1], point=(C, 0.0, 0.0))
    found = calibrate(robot.stated, [(Sensor.encoders(robot.joints, noise[0]), said), (touch, points)], parameters=ARMS)
    np.testing.assert_allclose((found.values - best.x[:6]) / np.sqrt(np.diag(spread)), 0.0, atol=1e-2)
    np.testing.assert_allclose(found.covariance / scaled, spread / scaled, rtol=0, atol=2e-2)
    assert abs(found.misfit**2 * (50 - 20 - 6) - 2.0 * best.cost) < 1e-4 * best.cost
    low, high = found.intervals(0.95)
    np.testing.assert_allclose((high - low) / (2.0 * found.standard_deviations), INSIDE, rtol=1e-6)
    sizes = found.singular_values
    np.testing.assert_allclose(found.observability**6 * 10**3, np.prod(sizes), rtol=1e-9)


def test_other_sensors(robots):
    """Heights above a plane and distances from a ball, or poses and a target anywhere, without errors."""
    robot, rng = robots["rpdr"], np.random.default_rng(1)
    built, q = robot.built(rng, ARMS), drawn(robot, 30)
    points, normal, centre = tool(built.model, robot.link, robot.point, q), np.array([1.0, 0.0, 2.0]), [0.3, 0.4, 0.2]
    said = Sensor.encoders(robot.joints, 1e-5, offsets=()), q
    plane = Sensor.plane(robot.link, normal, 0.05, point=robot.point)
    bar = Sensor.bar(robot.link, (0.31, 0.38, 0.2), point=robot.point)
    heights, sizes = points @ normal / np.linalg.norm(normal) - 0.05, np.linalg.norm(points - centre, axis=1)
    found = calibrate(robot.stated, [said, (plane, heights), (bar, sizes)], parameters=ARMS)
    values = dict(zip(found.parameters, found.values, strict=True))
    np.testing.assert_allclose([values[f"origin:bar/{axis}"] for axis in "xyz"], centre, rtol=0, atol=1e-8)
    np.testing.assert_allclose([values[name] for name in ARMS], [built.truth[name] for name in ARMS], rtol=0, atol=1e-9)
    at = LinkPoint(built.model.mechanism.tree, robot.link, (0.2, 0.03, 0.01))
    poses = np.array([built.base @ at.pose(each) for each in built.model.sigma_many(q)])
    camera = Sensor.tracker(robot.link, 5e-5, point=(0.2, 0.02, 0.0), turn_noise=1e-4, target=True, name="eye")
    seen = calibrate(robot.stated, [said, (camera, poses)], parameters=ARMS)
    values = dict(zip(seen.parameters, seen.values, strict=True))
    np.testing.assert_allclose([values[name] for name in ARMS], [built.truth[name] for name in ARMS], rtol=0, atol=1e-9)
    np.testing.assert_allclose(values["origin:eye/target/x"], 0.2, rtol=0, atol=1e-9)
    np.testing.assert_allclose(values["origin:eye/target/z"], 0.01, rtol=0, atol=1e-9)
    np.testing.assert_allclose(seen.frames["eye"][:3, :3], built.base[:3, :3], rtol=0, atol=1e-9)
    assert any("origin:eye/target/y" in each and "origin:eye/z" in each for each in seen.unobservable)  # all in a plane


def test_poses_that_a_sensor_missed(robots):
    """Rows of NaN say nothing: poses that only the motors' encoders measured change nothing."""
    robot, rng = robots["rpdr"], np.random.default_rng(2)
    built, q = robot.built(rng, ARMS), drawn(robot, 30)
    (encoders, said), (tracker, points) = robot.measured(built, q, rng)
    some = calibrate(robot.stated, [(encoders, said[:20]), (tracker, points[:20])], parameters=ARMS)
    points[20:] = np.nan
    every = calibrate(robot.stated, [(encoders, said), (tracker, points)], parameters=ARMS)
    np.testing.assert_allclose(every.values, some.values, rtol=0, atol=1e-10)
    assert abs(every.misfit - some.misfit) < 1e-9
    assert np.isnan(every.residuals[20:, 2:]).all()


def test_what_is_not_observable(robots):
    """The robot moved as a whole and the tracker with it; a crank's frame and its encoder; said in words."""
    robot, rng = robots["rpdr"], np.random.default_rng(5)
    bases = ("origin:joint1/x", "origin:joint1/z", "origin:joint2/x", "origin:joint2/z")
    built, q = robot.built(rng, ()), drawn(robot, 30)
    numbers = (*bases, *ARMS, "turn:joint1/y")
    found = robot.calibrated(built, q, rng, 0.0, parameters=numbers)
    assert found.rank == len(found.parameters) - 4
    assert "offset:joint1 and turn:joint1/y together" in " ".join(found.unobservable).replace(
        "turn:joint1/y and offset:joint1", "offset:joint1 and turn:joint1/y"
    )
    assert all("nothing measured changes" in each for each in found.unobservable)
    lost = {name for name, known in zip(found.parameters, found.determined, strict=True) if not known}
    assert lost >= {*bases, "turn:joint1/y", "offset:joint1", "origin:tracker/x", "origin:tracker/z", "turn:tracker/y"}
    assert not lost & {*ARMS}
    moved_on = {**dict.fromkeys(bases[:4:2], 0.0), "origin:joint1/x": 0.004, "origin:joint2/x": C + 0.004}
    model = ccpin.ReducedModel(ccpin.load(moved(robot.stated.mechanism.description, moved_on)))
    other = built._replace(model=model)
    again = robot.calibrated(other, q, rng, 0.0, parameters=numbers)
    assert again.misfit < 1e-6
    assert tool_errors(robot, other, again, drawn(robot, 4, 1))[1].max() < 1e-9


def test_names(robots):
    """A short name stands for origins, a kind for all of it; in a plane nothing that would open the loop counts."""
    every = numbers_that_count(robots["rpdr"].stated, ["link3"])
    assert {each.of.rpartition("/")[2] for each in every if each.kind == "origin"} == {"x", "z"}
    assert {each.of.rpartition("/")[2] for each in every if each.kind == "turn"} == {"y"}
    assert "turn:end_effector/A/y" not in {each.name for each in every}  # a pin that turns on itself
    assert [each.name for each in named_numbers(every, ["joint3"], "n")] == ["origin:joint3/x", "origin:joint3/z"]
    assert [each.name for each in named_numbers(every, ["turn:joint3"], "n")] == ["turn:joint3/y"]
    assert {each.kind for each in named_numbers(every, ["turn"], "n")} == {"turn"}
    assert "turn:ball2/A/x" not in {each.name for each in numbers_that_count(robots["stewart"].stated, ["platform"])}


ENCODERS = Sensor.encoders(["joint1", "joint2"])
TRACKER = Sensor.tracker("link3")


@pytest.mark.parametrize(
    ("pairs", "options", "word"),
    [
        ([(TRACKER, np.zeros((5, 3)))], {}, "encoders must measure joint1, joint2"),
        ([(ENCODERS, np.zeros((5, 2)))], {}, "observable"),
        ([(ENCODERS, np.zeros((5, 2))), (TRACKER, np.zeros((4, 3)))], {}, "same poses"),
        ([(ENCODERS, np.zeros((0, 2))), (TRACKER, np.zeros((0, 3)))], {}, "same poses"),
        ([(ENCODERS, np.zeros((5, 3)))], {}, "shape"),
        ([(ENCODERS, np.full((5, 2), np.nan)), (TRACKER, np.zeros((5, 3)))], {}, "throughout"),
        ([(ENCODERS, np.zeros((5, 2))), (TRACKER, np.full((5, 3), np.inf))], {}, "finite"),
        ([(ENCODERS, np.zeros((5, 2))), (TRACKER, np.zeros((5, 3))), (TRACKER, np.zeros((5, 3)))], {}, "one name"),
        ([(ENCODERS, np.zeros((5, 2))), (ENCODERS, np.zeros((5, 2)))], {}, "twice"),
        ([(ENCODERS, np.zeros((5, 2))), (Sensor.tracker("table"), np.zeros((5, 3)))], {}, "'table' is no link"),
        ([(Sensor.encoders(["joint1", "joint2", "elbow"]), np.zeros((5, 3)))], {}, "'elbow' is no joint"),
        ([(Sensor.tracker("link3", turn_noise=1e-3), np.zeros((5, 3))), (ENCODERS, np.zeros((5, 2)))], {}, "4, 4"),
        *(
            (
                [(Sensor.tracker("link3", turn_noise=1e-3), [np.eye(4), np.diag(axes)]), (ENCODERS, np.zeros((2, 2)))],
                {},
                "block of pose 1 is no rotation",
            )
            for axes in ((1.0, 1.0, -1.0, 1.0), (2.0, 2.0, 2.0, 1.0), (0.0, 0.0, 0.0, 1.0))
        ),
        (["rpdr"], {}, "a Sensor"),
        (None, {"parameters": ["rods"]}, "no 'rods'"),
        (None, {"known": ["rods"]}, "no 'rods'"),
        (None, {"priors": {"joint3": -1.0}}, "priors"),
        (None, {"coarsest": 0.0}, "coarsest"),
        (None, {"count": 2}, "measure more poses"),
    ],
)
def test_what_is_refused(robots, pairs, options, word):
    robot, rng = robots["rpdr"], np.random.default_rng(0)
    if pairs is None:
        pairs = robot.measured(robot.built(rng, ()), drawn(robot, options.pop("count", 20)), rng)
    with pytest.raises(InvalidInputError, match=word):
        calibrate(robot.stated, pairs, **options)


def test_sensors_that_are_none():
    """Names, deviations, points and normals."""
    for make, word in (
        (lambda: Sensor.encoders([]), "joints"),
        (lambda: Sensor.encoders(["a", "a"]), "joints"),
        (lambda: Sensor.encoders(["a"], offsets=["b"]), "none of a"),
        (lambda: Sensor.encoders(["a"], -1.0), "noise"),
        (lambda: Sensor.tracker("a", [1.0, 2.0]), "noise"),
        (lambda: Sensor.tracker("a", turn_noise=0.0), "turn_noise"),
        (lambda: Sensor.tracker("a", point=(1.0, 2.0)), "point"),
        (lambda: Sensor.plane("a", (0.0, 0.0, 0.0)), "normal"),
        (lambda: Sensor.bar("a", (np.nan, 0.0, 0.0)), "centre"),
    ):
        with pytest.raises(InvalidInputError, match=word):
            make()


def test_a_pose_that_was_misread_is_named(robots):
    """By the result where its residual is twenty deviations, by the refusal where it is two hundred."""
    robot, rng = robots["rpdr"], np.random.default_rng(0)
    encoders, (tracker, points) = robot.measured(robot.built(rng, ARMS), drawn(robot, 20), rng)
    points[7, 0] += 1e-3
    found = calibrate(robot.stated, [encoders, (tracker, points)], parameters=ARMS)
    assert found.off.shape == (20,)
    assert np.argmax(found.off) == 7
    assert found.off[7] > 5.0 > np.delete(found.off, 7).max()
    assert str(found).endswith(f"of the noise stated, most at pose 7 ({found.off[7]:.1f})")
    points[7, 0] += 1e-2
    with pytest.raises(ConvergenceError, match="largest residual is that of pose 7"):
        calibrate(robot.stated, [encoders, (tracker, points)], parameters=ARMS)


def test_measurements_of_something_else(robots):
    """Degrees, another robot's points; rows that are redundant."""
    robot, rng = robots["rpdr"], np.random.default_rng(0)
    (encoders, said), (tracker, points) = robot.measured(robot.built(rng, ()), drawn(robot, 20), rng)
    for pairs in ([(encoders, np.degrees(said)), (tracker, points)], [(encoders, said), (tracker, points[::-1])]):
        with pytest.raises(ConvergenceError, match=r"same order, units and signs|cannot be moved"):
            calibrate(robot.stated, pairs, parameters=ARMS)
    with pytest.raises(UnsupportedMechanismError, match="redundant"):
        calibrate(ccpin.load("bennett"), [(Sensor.encoders(ccpin.load("bennett").independent), np.zeros((9, 1)))])


def test_motors_that_are_not_the_coordinates():
    """Encoders of the motors where other joints are independent; continuous joints up to whole turns."""
    description = ccpin.load("rpdr").description
    joints = tuple(replace(each, kind="continuous") if each.name == "joint1" else each for each in description.joints)
    whole = replace(description, joints=joints, independent=("joint3", "joint4"), actuated=("joint1", "joint2"))
    robot, rng = Robot("rpdr"), np.random.default_rng(3)
    built, q = robot.built(rng, ARMS), drawn(robot, 25)
    pairs = robot.measured(built, q, rng, 0.0)
    said = pairs[0][1] + np.array([2.0 * np.pi, 0.0])
    found = calibrate(ccpin.load(whole), [(pairs[0][0], said), pairs[1]], parameters=ARMS)
    np.testing.assert_allclose(found.values[:4], [built.truth[name] for name in ARMS], rtol=0, atol=1e-9)


@pytest.mark.slow
def test_intervals_of_robots_hold_what_they_say():
    """95 % of 95 % intervals, pooled over 100 robots, within three deviations were a robot's numbers all one."""
    robot, rng = Robot("rpdr"), np.random.default_rng(7)
    held, misfits = [], []
    for _ in range(100):
        built = robot.built(rng)
        found = robot.calibrated(built, robot.poses.q, rng)
        held.append(np.abs(deviations(found, built.truth)) < INSIDE)
        misfits.append(found.misfit)
    assert abs(np.concatenate(held).mean() - 0.95) < 3.0 * np.sqrt(0.95 * 0.05 / 100)
    assert abs(np.mean(misfits) - 1.0) < 0.05
