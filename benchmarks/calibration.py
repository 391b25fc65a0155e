"""``python -m benchmarks.calibration [ROBOT …]``: do calibrations find robots as they were built, and know how well?

Of each installed robot many are built whose frames are off by 1 mm and 0.1° and whose encoders by 0.1° (1 mm); encoders
(1e-5 rad or m) and a tracker (0.05 mm) that stands anywhere measure 40 poses chosen for them, and the geometry is found
from the file's. A line a robot: how many of the 95 % intervals hold the true number, pooled over the numbers that the
poses determine (93 to 97 % are to); how far the tool is off at 50 other poses before (in the frame that fits best) and
after; O₁ of the poses beside the best of 1,000 random sets of as many; CPU time a run. A second line has all frames
off, of which only some directions can be known. The last is of closures alone: the Rice robot with passive encoders.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from ccpin.identification import Sensor, calibrate, calibration_poses
from tests.support.calibrated_robots import COARSEST, ENCODER, INSIDE, TOOLS, Robot, deviations, tool_errors
from tests.support.random_poses import random_observability


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="*", metavar="ROBOT", default=list(TOOLS), help=", ".join(TOOLS))
    parser.add_argument("--runs", type=int, default=200)
    asked = parser.parse_args()
    for name in asked.robots:
        robot, rng = Robot(name), np.random.default_rng(0)
        start, held, misfits, errors = time.process_time(), [], [], []
        for _ in range(asked.runs):
            built = robot.built(rng)
            found = robot.calibrated(built, robot.poses.q, rng)
            held.append(np.abs(deviations(found, built.truth)) < INSIDE)
            misfits.append(found.misfit)
            errors.append(tool_errors(robot, built, found, rng.uniform(*robot.box, (50, robot.stated.n))))
        spent, inside = (time.process_time() - start) / asked.runs, np.concatenate(held)
        before, after = 1e6 * np.sqrt(np.mean(np.square(errors), axis=(0, 2)))
        print(
            f"{name}: {100 * inside.mean():.2f} % of {inside.size} intervals hold the true number; "
            f"misfit {np.mean(misfits):.3f}; tool off by {before:.0f} µm before, {after:.1f} after; {spent:.2f} s a run"
        )
        best = random_observability(robot, 1000).max()
        print(f"  poses: O₁ {robot.poses.observability:.0f}, the best of 1,000 random sets {best:.0f}")
        every, errors = robot.everything, []
        for _ in range(max(1, asked.runs // 40)):
            built = robot.built(rng, every)
            found = robot.calibrated(built, robot.poses.q, rng, parameters=every)
            errors.append(tool_errors(robot, built, found, rng.uniform(*robot.box, (50, robot.stated.n))))
        before, after = 1e6 * np.sqrt(np.mean(np.square(errors), axis=(0, 2)))
        print(
            f"  all {len(every)} numbers off: {before:.0f} µm before, {after:.1f} after, {found.rank} directions known"
        )
    if "rpdr" in asked.robots:
        alone(asked.runs)


def alone(runs: int) -> None:
    """Closures alone: encoders of all four joints of the Rice robot, the base being known."""
    robot, rng = Robot("rpdr"), np.random.default_rng(1)
    joints = ("joint1", "joint2", "joint3", "joint4")
    sensor = Sensor.encoders(joints, ENCODER)
    names = ["origin:joint3/x", "origin:joint4/x", "origin:end_effector/A/x", "origin:end_effector/B/x"]
    poses = calibration_poses(
        robot.stated, 40, measure=[sensor], within=robot.box, parameters=names, coarsest=COARSEST
    ).q
    held, misfits = [], []
    for _ in range(runs):
        built = robot.built(rng, names)
        off = np.radians(0.1) * rng.normal(size=4)
        q_free = built.model.sigma_many(poses)
        tree = built.model.mechanism.tree
        q = np.stack([q_free[:, tree.joint(name).q.start] for name in joints], axis=1)
        found = calibrate(
            robot.stated, [(sensor, q + off + ENCODER * rng.normal(size=q.shape))], parameters=names, coarsest=COARSEST
        )
        truth = built.truth | {f"offset:{name}": o for name, o in zip(joints, off, strict=True)}
        held.append(np.abs(deviations(found, truth)) < INSIDE)
        misfits.append(found.misfit)
    inside = np.concatenate(held)
    print(
        f"rpdr by its encoders alone: {100 * inside.mean():.2f} % of {inside.size} intervals; "
        f"misfit {np.mean(misfits):.3f}; {len(found.parameters)} numbers, {found.rank} directions known; ± "
        + ", ".join(f"{1e6 * s:.1f} µ{unit}" for s, unit in zip(found.standard_deviations, found.units, strict=True))
    )


if __name__ == "__main__":
    main()
