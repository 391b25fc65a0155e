"""Serial robots in the place of linkages: as Pinocchio and MuJoCo read them, beside the closed chain."""

from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import ccpin
from ccpin.errors import IndependentSetError, InvalidInputError
from ccpin.transmission import Transmission, serial_robot
from tests.support.linkage_models import FORMS, MOTORS, ROTORS, loaded, transmission_of
from tests.support.places import SHARED

RANGES = {"ankle": ([-0.2, -0.15], [0.2, 0.15]), "knee": ([-0.6], [0.6]), "neck": ([-0.4, -0.3], [0.4, 0.3])}
AT = {"ankle": [0.1, 0.05], "knee": [0.3], "neck": [0.1, -0.2]}
each = pytest.mark.parametrize("name", RANGES)
either = pytest.mark.parametrize("met", [False, True])


@cache
def robot_of(name, met):
    return serial_robot(transmission_of(name), RANGES[name], at=AT[name] if met else None)


@cache
def read(name, met, folder):
    """Pinocchio's own reading of the URDF; rotor inertias, which it does not read, as the description has them."""
    robot, path = robot_of(name, met), folder / f"{name}_{met}.urdf"
    robot.save(path)
    model = pin.buildModelFromUrdf(str(path))
    stated = {joint.name: joint for joint in robot.description.joints}
    model.armature[:] = [stated[joint].armature for joint in list(model.names)[1:]]
    assert tuple(model.names)[1:] == robot.transmission.joints
    return model


def mass(model, q):
    upper = np.triu(pin.crba(model, model.createData(), q))
    return upper + np.triu(upper, 1).T


def postures(name, count):
    rng = np.random.default_rng(5)
    lower, upper = np.array(RANGES[name])
    return [transmission_of(name).at(q) for q in rng.uniform(lower, upper, (count, len(lower)))]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("serial")


@each
def test_mass_matrix_is_met_at_the_posture(name, folder):
    """D of the written file, loaded by Pinocchio, is the reduced model's."""
    state = transmission_of(name).at(AT[name]).state
    np.testing.assert_allclose(mass(read(name, True, folder), np.array(AT[name])), state.D, rtol=0, atol=1e-10)


@each
def test_energies(name, folder):
    """Kinetic energy at the posture is the reduced model's; potential energy differs by what errors of g may do."""
    model, errors, home = read(name, True, folder), robot_of(name, True).errors, transmission_of(name).at(AT[name])
    data, v = model.createData(), np.linspace(1.0, -0.5, model.nv)
    kinetic = pin.computeKineticEnergy(model, data, home.q_joint, v)
    assert kinetic == pytest.approx(0.5 * v @ home.state.D @ v, abs=1e-10)
    start = pin.computePotentialEnergy(model, data, home.q_joint)
    for posture in postures(name, 20):
        gained = pin.computePotentialEnergy(model, data, posture.q_joint) - start
        off = gained - (posture.state.energy(v).potential - home.state.energy(v).potential)
        assert abs(off) <= np.abs(posture.q_joint - home.q_joint) @ errors.gravity + 1e-10


@each
@either
@pytest.mark.parametrize("count", [60, pytest.param(3000, marks=pytest.mark.slow)])
def test_stated_errors_are_not_exceeded(name, met, count, folder):
    """D, g and C q̇ of the written file against the closed chain's, and they are not stated ten times too large."""
    model, errors = read(name, met, folder), robot_of(name, met).errors
    data, rng, share = model.createData(), np.random.default_rng(6), 0.0
    for posture in postures(name, count):
        whole, q = posture.state, posture.q_joint
        off = mass(model, q) - whole.D
        assert (np.abs(off) <= errors.mass + 1e-9).all()
        root = np.linalg.inv(np.linalg.cholesky(whole.D))
        share = max(share, np.linalg.norm(root @ off @ root.T, 2))
        gravity = pin.computeGeneralizedGravity(model, data, q)
        assert (np.abs(gravity - whole.g) <= errors.gravity + 1e-9).all()
        v = rng.normal(size=len(q))
        v /= np.linalg.norm(v)
        own = pin.nonLinearEffects(model, data, q, v) - gravity
        assert (np.abs(own - whole.C(v) @ v) <= errors.velocity + 1e-9).all()
    assert share <= errors.share + 1e-9
    assert share > 0.1 * errors.share - 1e-9


@each
def test_a_fit_is_nearer_than_bare_links_and_the_usual_armature(name, folder):
    """Over the range, D of the fit beside that of the links with 2 I on every joint."""
    model, robot = read(name, False, folder), robot_of(name, False)
    bare = {link.name: link for link in transmission_of(name).joint_model.mechanism.description.links}
    off = usual = 0.0
    plain = model.copy()
    for link in robot.description.links:
        if any(joint.child == link.name for joint in robot.description.joints if joint.kind == "revolute"):
            number = model.frames[model.getBodyId(link.name)].parentJoint
            own = bare[link.name].inertia
            plain.inertias[number] = (
                pin.Inertia(0.0, np.zeros(3), np.zeros((3, 3)))
                if own is None
                else pin.Inertia(own.mass, own.com, own.rotational)
            )
    plain.armature[:] = 2.0 * ROTORS[name]
    for posture in postures(name, 40):
        D = posture.state.D
        off += np.linalg.norm(mass(model, posture.q_joint) - D)
        usual += np.linalg.norm(mass(plain, posture.q_joint) - D)
    assert off < usual


@each
def test_links_are_bodies_and_mass_is_kept(name):
    """Second moments of mass are positive; the whole mass is the mechanism's where no world takes it."""
    robot = robot_of(name, False)
    for link in robot.description.links:
        if link.inertia is not None:
            second = 0.5 * np.trace(link.inertia.rotational) * np.eye(3) - link.inertia.rotational
            assert np.linalg.eigvalsh(second).min() > -1e-12
    before = transmission_of(name).joint_model.mechanism.description.links
    masses = [sum(link.inertia.mass for link in links if link.inertia) for links in (before, robot.description.links)]
    assert masses[1] == pytest.approx(masses[0], rel=1e-9)


@each
def test_limits_are_inside_the_polytopes(name):
    """Corners of the boxes at random postures, by the closed form's Jacobian."""
    robot = robot_of(name, False)
    stated = {joint.name: joint for joint in transmission_of(name).joint_model.mechanism.description.joints}
    room = np.array([stated[motor].effort for motor in MOTORS[name]])
    fastest = np.array([stated[motor].velocity for motor in MOTORS[name]])
    assert np.isfinite(room).all()
    tightest = 0.0
    for posture in postures(name, 300):
        J = FORMS[name].jacobian(posture.q_joint)
        asked = np.abs(np.linalg.inv(J).T) @ robot.effort
        assert (asked <= room * (1 + 1e-9)).all()
        tightest = max(tightest, (asked / room).max())
        if np.isfinite(robot.speed).all():
            assert (np.abs(J) @ robot.speed <= fastest * (1 + 1e-9)).all()
    assert tightest > 0.9


def mass_matrix(mujoco, path, q):
    """MuJoCo's model of a file, and its mass matrix at q."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    found = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, found)
    return model, found


def test_mujoco_reads_it_and_moves_alike(folder):
    """MuJoCo's own mass matrix of the written MJCF is Pinocchio's of the URDF, armature included."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    for name in RANGES:
        path = folder / f"{name}.xml"
        robot_of(name, True).save(path)
        model, found = mass_matrix(mujoco, path, AT[name])
        np.testing.assert_allclose(found, transmission_of(name).at(AT[name]).state.D, rtol=0, atol=1e-10)
        np.testing.assert_allclose(model.jnt_range.T, RANGES[name], rtol=0, atol=1e-9)


def test_mujoco_reads_the_urdf(folder):
    """The same of the URDF, whose rotors MuJoCo does not read: a note says them."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    name = "knee"
    path, robot = folder / f"{name}_mujoco.urdf", robot_of(name, True)
    notes = robot.save(path)
    _, found = mass_matrix(mujoco, path, AT[name])
    armatures = {joint.name: joint.armature for joint in robot.description.joints}
    rotors = [armatures[joint] for joint in robot.transmission.joints]
    whole = transmission_of(name).at(AT[name]).state.D
    np.testing.assert_allclose(found + np.diag(rotors), whole, rtol=0, atol=1e-10)
    told = ", ".join(
        f"{joint} {armature:.4g}" for joint, armature in zip(robot.transmission.joints, rotors, strict=True)
    )
    assert any(note.endswith(f"state armature to the simulator: {told}") for note in notes)
    for name in ("ankle", "neck"):  # a cross without mass: MuJoCo says no, and so did we
        path = folder / f"{name}_mujoco.urdf"
        assert any("no mass; MuJoCo refuses" in note for note in robot_of(name, True).save(path))
        with pytest.raises(ValueError, match="mass and inertia of moving bodies"):
            mujoco.MjModel.from_xml_path(str(path))


def test_apparent_inertia_is_mujocos_mass_matrix_projected(tmp_path):
    """mj_fullM of the open tree with the rotors, less that without, projected by ρ: Jᵀ I J."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    found, plain = transmission_of("knee"), Transmission(loaded("knee", joints={}))
    posture = found.reference
    matrices = []
    for transmission in (found, plain):
        path = tmp_path / "tree.xml"
        transmission.joint_model.mechanism.save(path)
        model = mujoco.MjModel.from_xml_path(str(path))
        data = mujoco.MjData(model)
        names = transmission.joint_model.mechanism.tree.names
        rows = [model.joint(name).dofadr[0] for name in names]
        state = transmission.reference.state
        for joint in transmission.joint_model.mechanism.tree.joints:
            value = state.q_free[joint.q]
            data.qpos[model.joint(joint.name).qposadr[0]] = value[0] if len(value) == 1 else np.arctan2(*value[::-1])
        mujoco.mj_forward(model, data)
        full = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full)
        full = full[np.ix_(rows, rows)]
        matrices.append(state.rho.T @ full @ state.rho)
        np.testing.assert_allclose(matrices[-1], state.D, rtol=0, atol=1e-9)
    np.testing.assert_allclose(matrices[0] - matrices[1], posture.rotor_inertia, rtol=0, atol=1e-9)


@each
def test_it_says_what_it_is(name, folder):
    """The file's comment is what the robot tells."""
    path = folder / f"said_{name}.urdf"
    robot_of(name, False).save(path)
    text = path.read_text(encoding="utf-8")
    assert all(line.strip() in text for line in robot_of(name, False).told())
    assert f"D by {100 * robot_of(name, False).errors.share:.3g} %" in text


def test_what_is_no_serial_robot():
    """Joints that motors carry, ranges that are not reached, formats without words for it."""
    mechanism = ccpin.load("rpdr")
    with pytest.raises(
        InvalidInputError, match=r"'joint3' is carried by 'joint1', .* without loop end_effector nothing"
    ):
        serial_robot(Transmission(mechanism, joints=["joint3", "joint4"]))
    with pytest.raises(IndependentSetError, match=r"'root_joint' is a motion of 6 freedoms: .* a fixed base"):
        Transmission(loaded("ankle", floating_base=True))
    with pytest.raises(InvalidInputError, match="region"):
        serial_robot(transmission_of("ankle"), ([-0.9, -0.5], [0.9, 0.5]))
    with pytest.raises(InvalidInputError, match="one of urdf, sdf, mjcf"):
        robot_of("knee", False).save("x.yaml")


@pytest.mark.slow
@pytest.mark.skipif(not SHARED.is_dir(), reason="other people's files are not here")
def test_an_ankle_of_others(tmp_path):
    """MuJoCo's mass matrix of the serial robot is D at the posture; stated errors hold over the range."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    found = Transmission(ccpin.load(SHARED / "two_rod_ankle" / "ankle.xml"))
    lower, upper, at = np.array([-0.3, -0.15]), np.array([0.15, 0.15]), np.array([-0.1, 0.05])
    robot = serial_robot(found, (lower, upper), at=at)
    robot.save(tmp_path / "serial.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "serial.xml"))
    data, full = mujoco.MjData(model), np.zeros((2, 2))
    for q in (at, *np.random.default_rng(8).uniform(lower, upper, (40, 2))):
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, full)
        off = np.abs(full - found.at(q).state.D)
        assert (off <= (1e-10 if q is at else robot.errors.mass + 1e-10)).all()
