"""A closed chain nobody drew as one: two UR5 arms holding a rigid bar.

The arms are read from the URDFs of example-robot-data (the extra [robots]), set facing each other, and
joined in Python by a bar: fixed to the left tool, closed with a fixed closure on the right one. The twelve joints
then have six independent motions; all twelve motors push, so the inverse dynamics are those of least norm.
Writes out/two_arms/animation.html and prints a summary.
"""

import sys
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import ccpin
from ccpin import visualization
from ccpin.description import Inertia, Joint, Link, Part, Shape, Visual, combine, read_description

OUT = Path("out/two_arms")
ARM = "ur_description/urdf/ur5_robot.urdf"
APART, BAR_LENGTH, BAR_MASS = (1.0243, 0.2183, 0.0), 0.35, 1.5  # m, m, kg
ELBOW_UP = {
    "shoulder_pan_joint": 0.0,
    "shoulder_lift_joint": -1.9,
    "elbow_joint": 1.9,
    "wrist_1_joint": 0.0,
    "wrist_2_joint": np.pi / 2,
    "wrist_3_joint": 0.0,
}
DURATION, LIFT = 1.0, np.array([0.15, 0.10, -0.10, 0.0, 0.0, 0.0])
STIFFNESS, DAMPING = 400.0, 40.0  # of every motor: N m/rad, N m s/rad


def robot_data() -> Path:
    """The folder of example-robot-data's robots in this environment."""
    found = list(Path(sys.prefix).glob("lib/python*/site-packages/cmeel.prefix/share/example-robot-data/robots"))
    if not found:
        raise SystemExit("example-robot-data is not installed: pip install 'ccpin[robots]'")
    return found[0]


def transform(translation: tuple[float, float, float], yaw: float = 0.0) -> np.ndarray:
    """A 4×4 frame turned about z."""
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = Rotation.from_euler("z", yaw).as_matrix(), translation
    return frame


def two_arms() -> ccpin.MechanismDescription:
    """The two arms, the bar and the closure."""
    arm = read_description(robot_data() / ARM)
    posed = ccpin.MechanismDescription(
        arm.name,
        arm.root,
        arm.links,
        arm.joints,
        actuated=tuple(ELBOW_UP),
        reference={name: (value,) for name, value in ELBOW_UP.items()},
    )
    slender = BAR_MASS * BAR_LENGTH**2 / 12
    bar = Link(
        "bar",
        Inertia(BAR_MASS, np.array([BAR_LENGTH / 2, 0, 0]), np.diag([2e-4, slender, slender])),
        (Visual(Shape("box", (BAR_LENGTH, 0.03, 0.03)), transform((BAR_LENGTH / 2, 0, 0)), (0.9, 0.5, 0.1, 1)),),
    )
    grip = Joint("grip", "fixed", "left_ee_link", "bar")
    hold = ccpin.LoopClosure("hold", "fixed", "bar", "right_ee_link", placement_a=transform((BAR_LENGTH, 0, 0), np.pi))
    parts = {"left_": Part(posed), "right_": Part(posed, transform(APART, np.pi))}
    return combine("two_arms", parts, links=[bar], joints=[grip], closures=[hold])


def main(out: Path = OUT) -> None:
    """Load, analyse, move the bar under PD and animate."""
    mechanism = ccpin.load(two_arms(), independent=[f"left_{name}" for name in ELBOW_UP])
    model = ccpin.ReducedModel(mechanism)
    q = model.alpha(mechanism.q_reference)
    goal = q + LIFT
    law = ccpin.control.PDFullGravity(model, goal, np.full(6, STIFFNESS), np.full(6, DAMPING))
    motion = ccpin.simulate(model, law, q, duration=DURATION, rtol=1e-7, atol=1e-9, sample_period=0.01)
    visualization.animate(mechanism, motion.t, motion.q_free, out / "animation.html", title="Two UR5 and a bar")
    print(f"two arms and a bar: n′ = {mechanism.n_free}, rank {mechanism.mobility.rank}, n = {mechanism.n}")
    print(f"  independent: {', '.join(mechanism.independent)}")
    print(f"  {motion.message}, closure error {motion.closure_error.max():.1e}")
    print(f"  distance to the goal {np.abs(motion.q[-1] - goal).max():.1e} rad, animation in {out}/")


if __name__ == "__main__":
    from arguments import run

    run(main, __doc__)
