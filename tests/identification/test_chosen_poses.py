"""Poses for calibrations: the best set of few candidates, and better than a thousand at random."""

from itertools import combinations

import numpy as np
import pytest

import ccpin
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.identification import Sensor, calibrate, calibration_poses
from ccpin.identification.calibration.chosen_poses import best_set, information
from ccpin.transmission import identify_geometry
from tests.support.calibrated_robots import COARSEST, Robot, tool
from tests.support.measured_pairs import NOISE, knee
from tests.support.random_poses import random_observability


def test_the_best_of_all_sets():
    """Of twelve candidates of two rows each the best five by trial of all 792; one exchange gains nothing."""
    rng = np.random.default_rng(0)
    for _ in range(3):
        Z = rng.normal(size=(12, 2, 4)) * rng.uniform(0.1, 2.0, (12, 1, 1))
        best = max(information(Z[list(each)]) for each in combinations(range(12), 5))
        chosen = best_set(Z, 5, rng)
        assert len(set(chosen.tolist())) == 5
        assert abs(information(Z[chosen]) - best) < 1e-9
    rows = Z[chosen].reshape(-1, 4)
    assert abs(information(Z[chosen]) - np.log(np.linalg.det(rows.T @ rows))) < 1e-9
    assert information(Z[:1]) == -np.inf


@pytest.fixture(scope="module")
def chosen():
    robot = Robot("rpdr")
    return robot, calibration_poses(
        robot.stated, 12, measure=robot.sensors, within=robot.box, parameters=["origin", "turn"], candidates=200,
        coarsest=COARSEST,
    )  # fmt: skip


def test_better_than_a_thousand_at_random(chosen):
    """O₁ as calibrations from these poses have it; det of their covariance, of a tracker's 1,000 random sets."""
    robot, poses = chosen
    assert poses.joints == robot.joints
    assert (poses.q >= robot.box[0]).all()
    assert (poses.q <= robot.box[1]).all()
    said = [(robot.sensors[0], poses.q), (robot.sensors[1], tool(robot.stated, robot.link, robot.point, poses.q))]
    found = calibrate(robot.stated, said, parameters=["origin", "turn"], coarsest=COARSEST)
    assert found.rank == poses.rank
    np.testing.assert_allclose(poses.observability, found.observability, rtol=1e-6)
    np.testing.assert_allclose(poses.condition, found.condition, rtol=1e-6)
    robot.poses = poses
    assert random_observability(robot, 1000, count=12).max() < poses.observability


def test_numbers_that_poses_determine(chosen):
    """`base`: calibrated alone each has an interval; as many as there are directions with the sensors' own."""
    robot, poses = chosen
    assert 4 <= len(poses.base) <= 8
    said = [(robot.sensors[0], poses.q), (robot.sensors[1], tool(robot.stated, robot.link, robot.point, poses.q))]
    found = calibrate(robot.stated, said, parameters=poses.base, coarsest=COARSEST)
    places = [found.parameters.index(name) for name in poses.base]
    assert found.determined[places].all()


def test_poses_for_pairs_of_angles():
    """Of a linkage's motors and joints: `identify_geometry` knows lengths better than of 50 random sets of pairs."""
    linkage = knee()
    sides = linkage.transmission
    sensors = [Sensor.encoders(names, NOISE, offsets=()) for names in (sides.motors, sides.joints)]
    q = calibration_poses(
        sides.joint_model, 12, measure=sensors, within=([-1.0], [1.0]), parameters=linkage.numbers, coarsest=0.05
    ).q

    def volume(joints):
        motors = linkage.motors(linkage.stated, joints)
        return np.linalg.det(identify_geometry(sides, motors, joints, parameters=linkage.numbers).covariance)

    rng = np.random.default_rng(1)
    assert volume(q) < 0.5 * min(volume(rng.uniform(-1.0, 1.0, (12, 1))) for _ in range(20))


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"count": 0}, "count"),
        ({"count": 2}, "too few"),
        ({"count": 500}, "are wanted"),
        ({"within": ([0.0, 0.0], [0.0, 1.0])}, "below"),
        ({"within": ([0.0, 0.0],)}, "within"),
        ({"within": 3}, "within"),
        ({"measure": ["tracker"]}, "measure"),
        ({"measure": [Sensor.tracker("link3")]}, "encoders must measure"),
        ({"measure": [Sensor.encoders(["joint1", "joint2"])]}, "nothing is observable"),
        ({"parameters": ["rods"]}, "no 'rods'"),
        ({"coarsest": -1.0}, "coarsest"),
        ({"candidates": 0}, "candidates"),
    ],
)
def test_poses_that_are_refused(chosen, options, word):
    robot = chosen[0]
    asked = {"count": 12, "measure": robot.sensors, "within": robot.box, "candidates": 30} | options
    with pytest.raises(InvalidInputError, match=word):
        calibration_poses(robot.stated, asked.pop("count"), **asked)


def test_rows_that_are_redundant():
    """Other lengths would not close."""
    with pytest.raises(UnsupportedMechanismError, match="redundant"):
        calibration_poses(
            ccpin.load("bennett"), 5, measure=[Sensor.encoders(ccpin.load("bennett").independent)],
            within=([0.1], [0.2]), candidates=10,
        )  # fmt: skip
