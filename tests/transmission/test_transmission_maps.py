"""Motors and joints of linkages against their closed forms; power, stiffness, inertia and play against definitions."""

import pickle
import tempfile
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import ccpin
from ccpin.errors import IndependentSetError, UnreachableError
from ccpin.transmission import Transmission
from tests.oracles import rpdr as rpdr_forms
from tests.oracles.finite_differences import derivative
from tests.support.linkage_models import FORMS, MOTORS, ROTORS, loaded, places, transmission_of
from tests.support.places import MODELS, SHARED

each = pytest.mark.parametrize("name", FORMS)


@each
def test_sides_are_found(name):
    """Motors as the file has them; joints where no motor is."""
    found = transmission_of(name)
    assert found.motors == MOTORS[name]
    assert found.joints == (("knee",) if name == "knee" else ("pitch", "roll"))


@each
@pytest.mark.parametrize("count", [100, pytest.param(3000, marks=pytest.mark.slow)])
def test_positions_and_rates_are_the_closed_forms(name, count):
    """q_m(q_j), q_j(q_m) and J, over the range."""
    found, form = transmission_of(name), FORMS[name]
    for q in places(name, np.random.default_rng(1), count):
        posture = found.at(q)
        np.testing.assert_allclose(posture.q_motor, form.motors(q), rtol=0, atol=1e-10)
        np.testing.assert_allclose(posture.jacobian, form.jacobian(q), rtol=0, atol=1e-10)
        np.testing.assert_allclose(found.at_motor(form.motors(q)).q_joint, q, rtol=0, atol=1e-10)
        np.testing.assert_allclose(posture.motor_state.rho[found.joint_side.rows], posture.inverse, rtol=0, atol=1e-10)


@each
def test_second_derivatives_are_those_of_the_closed_form(name):
    """∂J/∂q and J̇ against differences of the closed form's J."""
    found, form, rng = transmission_of(name), FORMS[name], np.random.default_rng(2)
    for q in places(name, rng, 10):
        posture, v, a = found.at(q), rng.normal(size=found.n), rng.normal(size=found.n)
        ways = np.eye(found.n)
        expected = np.stack([derivative(lambda s, w=w, q=q: form.jacobian(q + s * w)) for w in ways], axis=2)
        np.testing.assert_allclose(posture.curvature, expected, rtol=0, atol=1e-9)
        np.testing.assert_allclose(posture.jacobian_rate(v), expected @ v, rtol=0, atol=1e-9)
        along = derivative(lambda s, q=q, v=v, a=a: form.jacobian(q + s * v) @ (v + s * a))
        np.testing.assert_allclose(posture.motor_acceleration(v, a), along, rtol=0, atol=1e-8)


@each
@pytest.mark.parametrize("count", [334, pytest.param(33400, marks=pytest.mark.slow)])
def test_power_goes_through(name, count):
    """τ_jᵀ q̇_j = τ_mᵀ q̇_m, both ways, to rounding."""
    found, rng = transmission_of(name), np.random.default_rng(3)
    worst, near = 0.0, None
    for q in places(name, rng, count):
        near = posture = found.at(q, near)
        effort, v = rng.normal(size=found.n), rng.normal(size=found.n)
        for joint, motor in ((posture.joint_effort(effort), effort), (effort, posture.motor_effort(effort))):
            size = np.abs(joint) @ np.abs(v) + np.abs(motor) @ np.abs(posture.motor_velocity(v))
            worst = max(worst, abs(joint @ v - motor @ posture.motor_velocity(v)) / size)
            back = posture.joint_velocity(posture.motor_velocity(v))
            assert np.abs(back - v).max() < 1e-12 * np.abs(v).max() / posture.rcond
    assert worst < 1e-12


def test_the_five_bars_passive_joints():
    """Joints that have to be named, against (39)–(40)."""
    mechanism = ccpin.load("rpdr")
    with pytest.raises(IndependentSetError, match="candidates: joint3, joint4"):
        Transmission(mechanism)
    found = Transmission(mechanism, joints=["joint3", "joint4"])
    for q in np.radians([[-100.0, -80.0], [-120.0, -110.0], [-90.0, -70.0]]):
        np.testing.assert_allclose(found.at_motor(q).q_joint, rpdr_forms.sigma(q, 1.0)[2:], rtol=0, atol=1e-10)
        np.testing.assert_allclose(found.motor_from_joint(rpdr_forms.sigma(q, 1.0)[2:]), q, rtol=0, atol=1e-10)


def foot_alone():
    """The ankle's foot on its two joints, in Pinocchio, as the file's numbers have it."""
    model = pin.Model()
    pitch = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "pitch")
    roll = model.addJoint(pitch, pin.JointModelRX(), pin.SE3.Identity(), "roll")
    inertia = pin.Inertia(1.1, np.array([0.05, 0, -0.05]), np.diag([0.002, 0.005, 0.0055]))
    model.appendBodyToJoint(roll, inertia, pin.SE3.Identity())
    return model


def test_the_serial_robot_is_the_foot():
    """Its efforts are those of the foot alone; the linkage takes the rest, and the dynamic maps are inverse."""
    found, foot, rng = transmission_of("ankle"), foot_alone(), np.random.default_rng(4)
    data = foot.createData()
    for q in places("ankle", rng, 20):
        posture, v, a, u = found.at(q), *rng.normal(size=(3, 2))
        np.testing.assert_allclose(posture.serial_effort(v, a), pin.rnea(foot, data, q, v, a), rtol=0, atol=1e-12)
        whole = posture.state.inverse_dynamics(v, a)
        np.testing.assert_allclose(
            posture.delivered_effort(whole, v, a), pin.rnea(foot, data, q, v, a), rtol=0, atol=1e-10
        )
        arrived = posture.delivered_effort(u, v, a)
        np.testing.assert_allclose(posture.required_effort(arrived, v, a), u, rtol=0, atol=1e-10)
        np.testing.assert_allclose(
            posture.linkage_inertia + pin.crba(foot, data, q), posture.state.D, rtol=0, atol=1e-12
        )


@each
def test_rotors_are_felt_as_their_energy_says(name):
    """½ vᵀ(JᵀIJ)v is the kinetic energy that rotors add, also where J is the closed form's."""
    found, bare, rng = transmission_of(name), ccpin.ReducedModel(loaded(name, joints=no_rotors(name))), None
    rng, form = np.random.default_rng(5), FORMS[name]
    light = Transmission(bare)
    for q in places(name, rng, 20):
        posture, without, v = found.at(q), light.at(q), rng.normal(size=found.n)
        added = posture.state.energy(v).kinetic - without.state.energy(v).kinetic
        assert 0.5 * v @ posture.rotor_inertia @ v == pytest.approx(added, rel=1e-10)
        J = form.jacobian(q)
        np.testing.assert_allclose(posture.rotor_inertia, ROTORS[name] * J.T @ J, rtol=0, atol=1e-10)
        np.testing.assert_allclose(posture.axis_ratios**2, np.diag(J.T @ J), rtol=0, atol=1e-10)
        np.testing.assert_allclose(posture.gear_ratios**2, np.linalg.eigvalsh(J.T @ J)[::-1], rtol=0, atol=1e-10)


def no_rotors(name):
    return {motor: {"armature": 0.0} for motor in MOTORS[name]}


@each
def test_stiffness_and_damping_are_felt_as_they_are_defined(name):
    """−∂τ/∂q of springs on the other side, under load, by differences of the closed form."""
    found, form, rng = transmission_of(name), FORMS[name], np.random.default_rng(6)
    n = found.n
    for q in places(name, rng, 5):
        posture, K, load = found.at(q), np.diag(rng.uniform(1, 5, n)), rng.normal(size=n)
        here = form.motors(q)

        def at_joints(x, K=K, load=load, here=here):
            return form.jacobian(x).T @ (load - K @ (form.motors(x) - here))

        expected = -np.stack([derivative(lambda s, w=w, q=q: at_joints(q + s * w)) for w in np.eye(n)], axis=1)
        np.testing.assert_allclose(posture.joint_stiffness(K, load), expected, rtol=0, atol=1e-8)
        np.testing.assert_allclose(posture.joint_stiffness(np.diag(K), load), expected, rtol=0, atol=1e-8)

        def at_motors(x, K=K, load=load, q=q, near=posture):
            there = found.at_motor(x, near)
            return np.linalg.solve(form.jacobian(there.q_joint).T, load - K @ (there.q_joint - q))

        expected = -np.stack([derivative(lambda s, w=w, h=here: at_motors(h + s * w)) for w in np.eye(n)], axis=1)
        np.testing.assert_allclose(posture.motor_stiffness(K, load), expected, rtol=0, atol=1e-8)
        v, J = rng.normal(size=n), form.jacobian(q)
        assert v @ posture.joint_damping(K) @ v == pytest.approx((J @ v) @ K @ (J @ v), rel=1e-10)
        assert (J @ v) @ posture.motor_damping(K) @ (J @ v) == pytest.approx(v @ K @ v, rel=1e-10)


def test_play_is_the_worst_that_small_moves_make():
    """|J⁻¹| δ over all corners of the motors' play, to second order; and the other way."""
    found, q = transmission_of("ankle"), np.array([0.2, 0.1])
    posture, play = found.at(q), np.array([1e-5, 3e-5])
    corners = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]]) * play
    moved = np.abs([found.joint_from_motor(posture.q_motor + c, posture) - q for c in corners]).max(axis=0)
    np.testing.assert_allclose(posture.joint_play(play), moved, rtol=1e-3)
    moved = np.abs([found.motor_from_joint(q + c, posture) - posture.q_motor for c in corners]).max(axis=0)
    np.testing.assert_allclose(posture.motor_play(play), moved, rtol=1e-3)


def test_singular_postures_are_told():
    """Where crank and coupler of the four-bar are in line the crank moves and the rocker need not.

    The triangle of 160, 100 and 80 mm has that crank angle; beyond the rocker's angle there nothing is reached.
    """
    found = Transmission(ccpin.load("four_bar"))
    line = np.arccos((0.16**2 + 0.1**2 - 0.08**2) / (2 * 0.16 * 0.1))
    postures = [found.at_motor([line + away]) for away in (0.2, 0.1, 1e-2, 1e-3)]
    margins = np.array([posture.margins for posture in postures])
    assert (np.diff(margins[:, 0]) < 0.0).all()
    assert margins[-1, 0] < 1e-2 * margins[0, 0]
    assert (margins[:, 1] > 1e-2).all()
    with pytest.raises(UnreachableError):
        found.at(postures[-1].q_joint - 0.01, postures[-1])


def test_angles_on_circles_are_angles():
    """The four-bar on continuous joints, whose q′ has cosines and sines: the same numbers."""
    text = (MODELS / "four_bar.urdf").read_text(encoding="utf-8").replace('type="revolute"', 'type="continuous"')
    text = text.replace('<loop name="pin" type="continuous">', '<loop name="pin" type="revolute">')
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "round.urdf"
        path.write_text(text, encoding="utf-8")
        circles, plain = Transmission(ccpin.load(path)), Transmission(ccpin.load("four_bar"))
    assert circles.joint_model.nq == 2
    for x in (0.6, 1.5, 2.5):
        one, other = circles.at_motor([x]), plain.at_motor([x])
        np.testing.assert_allclose(one.q_joint, other.q_joint, rtol=0, atol=1e-10)
        np.testing.assert_allclose(circles.at(other.q_joint, one).q_motor, [x], rtol=0, atol=1e-10)
        np.testing.assert_allclose(one.jacobian, other.jacobian, rtol=1e-9)
        np.testing.assert_allclose(one.curvature, other.curvature, rtol=1e-8)


def test_sides_that_are_none_are_refused():
    """Too few, of several freedoms, or blind to the motion; each time with candidates."""
    ankle = loaded("ankle")
    for wrong in (["pitch"], ["pitch", "left_ball"], ["pitch", "no_joint"]):
        with pytest.raises(IndependentSetError):
            Transmission(ankle, joints=wrong)
    with pytest.raises(IndependentSetError, match="name 3 by joints"):
        Transmission(ccpin.load("delta"))


def test_a_transmission_is_pickled_whole():
    found = transmission_of("ankle")
    again = pickle.loads(pickle.dumps(found))
    assert (again.joints, again.motors) == (found.joints, found.motors)
    np.testing.assert_array_equal(again.at([0.2, 0.1]).jacobian, found.at([0.2, 0.1]).jacobian)


@pytest.mark.skipif(not SHARED.is_dir(), reason="other people's files are not here")
def test_an_ankle_by_somebody_else():
    """Positions of its author's own closed form within its error, 3e-3 rad; rates by differences of our positions."""
    mechanism = ccpin.load(SHARED / "two_rod_ankle" / "ankle.xml")
    found = Transmission(mechanism)
    q = found.reference.q_joint + np.array([0.1, -0.05])
    posture = found.at(q)
    expected = np.stack([derivative(lambda s, w=w: found.motor_from_joint(q + s * w)) for w in np.eye(2)], axis=1)
    np.testing.assert_allclose(posture.jacobian, expected, rtol=0, atol=1e-9)


@each
def test_inertia_is_mujocos_projected(name, tmp_path):
    """D = ρᵀMρ, M MuJoCo's of the file that was written, rotors included; of rods on balls the spin at no momentum.

    Where a spin is locked, D is the Schur complement of that of the mechanism with the spin left free.
    """
    mujoco = pytest.importorskip("mujoco")
    still, whole = (ccpin.ReducedModel(loaded(name, **more)) for more in ({}, {"free": ["all"]}))
    still.mechanism.save(tmp_path / "robot.xml")
    engine = mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml"))
    rng, mass = np.random.default_rng(8), np.zeros((engine.nv, engine.nv))
    data, near = mujoco.MjData(engine), still.mechanism.q_reference
    places = {each.name: engine.joint(each.name) for each in still.mechanism.tree.joints}
    for _ in range(8):
        state = still.at(still.alpha(still.mechanism.q_reference) + rng.uniform(-0.1, 0.1, still.n), near)
        rows = []
        for joint in still.mechanism.tree.joints:
            told = np.array(joint.kind.told(state.q_free[joint.q]))
            data.qpos[places[joint.name].qposadr[0] :][: len(told)] = told[[3, 0, 1, 2]] if len(told) == 4 else told
            rows += [places[joint.name].dofadr[0] + k for k in range(joint.v.stop - joint.v.start)]
        mujoco.mj_forward(engine, data)
        mujoco.mj_fullM(engine, data, mass)
        free = whole.at(whole.alpha(state.q_free), state.q_free)
        D = free.rho.T @ mass[np.ix_(rows, rows)] @ free.rho
        np.testing.assert_allclose(free.D, D, rtol=0, atol=1e-12 * np.abs(D).max())
        n = still.n
        reduced = D[:n, :n] - D[:n, n:] @ np.linalg.solve(D[n:, n:], D[n:, :n])
        np.testing.assert_allclose(state.D, reduced, rtol=0, atol=1e-12 * np.abs(D).max())


@pytest.mark.parametrize("name", ["ankle", "knee"])
def test_either_side_is_certified_by_domain(name):
    """σ in the joints' coordinates and in the motors'."""
    found = transmission_of(name)
    for model, side in ((found.joint_model, found.joint_side), (found.motor_model, found.motor_side)):
        start = model.alpha(model.mechanism.q_reference)
        q = side.positions(start)
        assert ccpin.domain.certify(model, start, (q - 0.1, q + 0.1)).certified_fraction == 1.0


def test_motors_coordinates_end_where_the_motor_turns_back():
    """The knee's lever goes all round, its motor to and fro between the extremes of the closed form's q_m."""
    found, form = transmission_of("knee"), FORMS["knee"]
    reached = np.array([form.motors([q])[0] for q in np.linspace(-np.pi, np.pi, 4001)])
    least, most = reached.min(), reached.max()
    model = found.motor_model
    start = model.alpha(model.mechanism.q_reference)
    atlas = ccpin.domain.certify(model, start, ([least - 0.2], [most + 0.2]))
    assert atlas.contains([least + 1e-3])
    assert atlas.contains([most - 1e-3])
    assert not atlas.contains([least - 1e-6])
    assert not atlas.contains([most + 1e-6])
    joint = found.joint_model
    around = ccpin.domain.certify(joint, joint.alpha(joint.mechanism.q_reference), ([-3.0], [3.0]))
    assert around.certified_fraction == 1.0
