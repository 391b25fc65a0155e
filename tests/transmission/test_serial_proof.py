"""What is proved of a serial robot: bounds beside independently computed differences, and what is not proved."""

import numpy as np
import pinocchio as pin
import pytest

from ccpin.transmission import Transmission, serial_robot
from ccpin.transmission.serial_proof import spectral_bound
from tests.support.linkage_models import FORMS, loaded, transmission_of

RANGES = {"knee": ([-0.6], [0.6]), "neck": ([-0.4, -0.3], [0.4, 0.3]), "ankle": ([-0.1, -0.08], [0.1, 0.08])}


@pytest.mark.parametrize("name", ["knee", "neck", pytest.param("ankle", marks=pytest.mark.slow)])
def test_proved_bounds_hold_and_are_near(name):
    """Differences of the description loaded anew and of the closed chain; motors' speeds by the closed form's J."""
    transmission, (lower, upper) = transmission_of(name), np.array(RANGES[name])
    robot = serial_robot(transmission, (lower, upper), max_cells=1024)
    sampled = serial_robot(transmission, (lower, upper))
    assert robot.compared.verdict == robot.held.verdict == "proven"
    assert not any("not proved" in line for line in robot.told() if "no limits" not in line)
    own = pinocchio_of(robot)
    rng, worst = np.random.default_rng(4), 0.0
    for q in rng.uniform(lower, upper, (200, len(lower))):
        state = transmission.at(q).state
        D, g = own(q)
        assert (np.abs(D - state.D) <= robot.errors.mass + 1e-12).all()
        assert (np.abs(g - state.g) <= robot.errors.gravity + 1e-12).all()
        root = np.linalg.inv(np.linalg.cholesky(state.D))
        share = np.linalg.norm(root @ (D - state.D) @ root.T, 2)
        assert share <= robot.errors.share + 1e-12
        worst = max(worst, share)
        J = FORMS[name].jacobian(q)
        if np.isfinite(robot.speed).all():
            fastest = np.array([joint.velocity for joint in motors_of(transmission)])
            assert (np.abs(J) @ robot.speed <= fastest).all()
    assert robot.errors.share <= 1.25 * worst + 1e-9
    assert robot.errors.velocity.max() <= 1.5 * sampled.errors.velocity.max() + 1e-9
    assert (sampled.errors.velocity <= 1.25 * robot.errors.velocity + 1e-9).all()


def pinocchio_of(robot):
    """D and g of the description's own numbers, by Pinocchio's algorithms on a tree made of it alone."""
    description = robot.description
    model = pin.Model()
    placed = {description.root: (0, pin.SE3.Identity())}
    links = {link.name: link.inertia for link in description.links}
    for joint in description.joints:
        number, at = placed[joint.parent]
        at = at * pin.SE3(joint.placement[:3, :3], joint.placement[:3, 3])
        if joint.kind == "fixed":
            placed[joint.child] = number, at
            continue
        made = model.addJoint(number, pin.JointModelRevoluteUnaligned(joint.axis), at, joint.name)
        placed[joint.child] = made, pin.SE3.Identity()
        inertia = links[joint.child]
        if inertia is not None:
            model.appendBodyToJoint(
                made, pin.Inertia(inertia.mass, inertia.com, inertia.rotational), pin.SE3.Identity()
            )
    stated = {joint.name: joint for joint in description.joints}
    model.armature[:] = [stated[name].armature for name in list(model.names)[1:]]
    data = model.createData()

    def terms(q):
        upper = np.triu(pin.crba(model, data, q))
        return upper + np.triu(upper, 1).T, pin.computeGeneralizedGravity(model, data, q).copy()

    return terms


def motors_of(transmission):
    stated = {joint.name: joint for joint in transmission.joint_model.mechanism.description.joints}
    return [stated[name] for name in transmission.motors]


def test_dampers_are_compared():
    """A damper on the knee's motor is J²b at the knee; the robot has the mean, and a bound of what is amiss."""
    found = Transmission(loaded("knee", joints={"motor": {"armature": 0.1, "damping": 0.5}}))
    robot = serial_robot(found, RANGES["knee"], max_cells=256)
    felt = [0.5 * FORMS["knee"].jacobian(q)[0, 0] ** 2 for q in np.linspace(-0.6, 0.6, 101)[:, None]]
    (knee,) = (joint for joint in robot.description.joints if joint.name == "knee")
    amiss = np.abs(np.array(felt) - knee.damping).max()
    assert amiss <= robot.errors.damping[0, 0] <= 1.1 * amiss
    assert min(felt) < knee.damping < max(felt)


def test_what_is_not_proved_is_said():
    """Without cells, and with too few, all is of samples."""
    for cells in (0, 1):
        robot = serial_robot(transmission_of("ankle"), RANGES["ankle"], max_cells=cells)
        assert (robot.compared is None) == (robot.held is None) == (cells == 0)
        lines = [line for line in robot.told() if line.startswith(("largest", "efforts", "speeds"))]
        assert len(lines) == 3
        assert all("sampled with a margin, not proved" in line for line in lines)
        told = robot.as_json()
        assert not told["effort_proved"]
        assert not told["errors_and_speed_proved"]


def test_perrons_bound():
    """No matrix within the bounds has a larger eigenvalue, and the bounds themselves come near."""
    rng = np.random.default_rng(7)
    for n in (1, 2, 3, 5):
        bounds = rng.uniform(0.0, 1.0, (n, n)) * (rng.uniform(size=(n, n)) < 0.7)
        most = spectral_bound(bounds)
        radius = np.abs(np.linalg.eigvals(bounds)).max()
        assert radius <= most <= radius * 1.05 + 1e-3
        for _ in range(20):
            matrix = bounds * rng.choice([-1.0, 1.0], (n, n)) * rng.uniform(0.5, 1.0, (n, n))
            assert np.abs(np.linalg.eigvals(matrix)).max() <= most
    assert spectral_bound(np.zeros((2, 2))) == 0.0
