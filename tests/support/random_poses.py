"""Sets of poses drawn at random, and how well they tell a robot's geometry."""

import numpy as np

from ccpin.identification.calibration.calibrating import sensors_at, unknown_geometry
from ccpin.identification.calibration.geometry_fit import GeometryFit
from tests.support.calibrated_robots import COARSEST


def random_observability(robot, sets, count=40, seed=5):
    """O₁ along the directions that its chosen poses know, of so many sets drawn in its box, of shape (sets,)."""
    rng, kinds = np.random.default_rng(seed), [each.kind for each in robot.sensors]
    numbers = unknown_geometry(robot.stated, kinds, ["origin", "turn"], robot.known)

    def rows(q):
        fit = GeometryFit(robot.stated, numbers, sensors_at(robot.stated, kinds), q, None, {}, COARSEST)
        return fit.reduced(fit.first).W.reshape(len(q), -1, len(fit.unknowns))

    directions = np.linalg.svd(rows(robot.poses.q).reshape(-1, rows(robot.poses.q[:1]).shape[2]))[2]
    pool = rows(rng.uniform(*robot.box, (1000, robot.stated.n))) @ directions[: robot.poses.rank].T
    found = []
    for _ in range(sets):
        s = np.linalg.svd(pool[rng.permutation(len(pool))[:count]].reshape(-1, robot.poses.rank), compute_uv=False)
        found.append(np.exp(np.log(s).mean()) / np.sqrt(count))
    return np.array(found)
