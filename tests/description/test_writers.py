"""The writers: what they write reads back as the same mechanism, here, in Pinocchio and in MuJoCo."""

import json
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import ccpin
from ccpin.cli import main
from ccpin.description import Coupling, CouplingTerm, Shape, Visual, read_description
from ccpin.description.elements.graph import zero_poses
from ccpin.description.formats import write_description
from ccpin.description.mjcf.writer import write_mjcf
from ccpin.description.model import IDENTITY, LoopClosure, Motor, frame, inverse
from ccpin.description.sdf.writer import write_sdf
from ccpin.description.toolbox.writer import write_toolbox
from ccpin.description.urdf.writer import write_urdf
from ccpin.errors import DescriptionError, InvalidInputError, UnsupportedMechanismError
from tests.support.places import MODELS
from tests.support.reading import read_urdf

BODY = '<inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01"/></inertial>'
GEAR = f"""<robot name="gear"><link name="base"/>
<link name="arm">{BODY}</link><link name="motor">{BODY}</link><link name="wheel">{BODY}</link>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="arm"/></joint>
<joint name="spin" type="continuous"><parent link="arm"/><child link="motor"/></joint>
<joint name="turn" type="continuous"><parent link="arm"/><child link="wheel"/></joint>
<coupling name="gear"><predecessor link="motor"/><successor link="wheel"/><ratio value="3"/></coupling></robot>"""


def same_fields(mine, theirs, names):
    """Whether two lists of records agree in the fields named, numbers and frames to rounding."""
    for one, other in zip(mine, theirs, strict=True):
        for name in names:
            a, b = getattr(one, name), getattr(other, name)
            if isinstance(a, np.ndarray):
                np.testing.assert_allclose(a, b, atol=1e-15, rtol=1e-14)
            else:
                assert a == b, (one.name, name)


@pytest.mark.parametrize("name", sorted(path.stem for path in MODELS.glob("*.urdf")))
def test_what_is_written_reads_back(name, tmp_path):
    """Joints, closures, motors, marks, reference, inertias and shapes survive; so do D, C and g."""
    file = tmp_path / "written.urdf"
    before = read_description(name)
    write_urdf(before, file)
    after = read_description(file)
    joint = ("name", "kind", "parent", "child", "placement", "axis", "lower", "upper", "effort", "velocity", "armature")
    same_fields(before.joints, after.joints, joint)
    same_fields(before.closures, after.closures, ("name", "kind", "link_a", "placement_a", "placement_b", "length"))
    for a, b in zip(before.links, after.links, strict=True):
        assert (a.name, len(a.visuals)) == (b.name, len(b.visuals))
        for one, other in zip(a.visuals, b.visuals, strict=True):
            assert (one.shape.kind, one.shape.size, one.rgba) == (other.shape.kind, other.shape.size, other.rgba)
            np.testing.assert_allclose(one.placement, other.placement, atol=1e-15)
    for field in ("name", "root", "independent", "actuated", "reference", "couplings"):
        assert getattr(before, field) == getattr(after, field)
    models = [ccpin.ReducedModel(ccpin.load(path)) for path in (name, file)]
    q = models[0].alpha(models[0].mechanism.q_reference)
    v = np.linspace(0.3, 1.1, models[0].n)
    for mine, theirs in zip(*(model.terms(q, v) for model in models), strict=True):
        np.testing.assert_allclose(mine, theirs, atol=1e-10)
    names = set(pin.buildModelFromUrdf(str(file)).names)
    assert names == set(models[0].mechanism.pin_model.names)


@pytest.mark.parametrize("name", sorted(path.stem for path in MODELS.glob("*.urdf")))
def test_what_is_written_as_sdf_reads_back(name, tmp_path):
    """Joints, closures by kind and points, inertias and shapes survive; links may have other names."""
    before = read_description(name)
    write_sdf(before, tmp_path / "written.sdf")
    after = read_description(tmp_path / "written.sdf")
    held, *joints = after.joints
    assert (held.kind, held.parent, after.root) == ("fixed", "world", "world")
    fields = ("name", "kind", "lower", "upper", "effort", "velocity", "armature", "damping", "friction", "stiffness")
    same_fields(before.joints, joints, fields)
    for one, other in zip(before.joints, joints, strict=True):
        np.testing.assert_allclose(other.placement, one.placement, atol=1e-14)
        np.testing.assert_allclose(other.axis, one.axis, atol=1e-14)
    same_fields(before.closures, after.closures, ("name", "kind"))
    for one, other in zip(before.closures, after.closures, strict=True):
        part = np.s_[:3, 2:] if one.kind == "revolute" else np.s_[:3, 3]
        np.testing.assert_allclose(other.placement_a[part], one.placement_a[part], atol=1e-12)
        np.testing.assert_allclose(other.placement_b[part], one.placement_b[part], atol=1e-12)
    for a, b in zip(before.links, after.links[1:], strict=True):
        assert b.name in (a.name, f"{a.name}_link")
        mass = b.inertia.mass
        assert mass == (a.inertia.mass if a.inertia else 0.0)
        if mass:
            np.testing.assert_allclose(b.inertia.com, a.inertia.com, atol=1e-15)
            np.testing.assert_allclose(b.inertia.rotational, a.inertia.rotational, atol=1e-15)
        for one, other in zip(a.visuals, b.visuals, strict=True):
            assert (one.shape.kind, one.shape.size, one.rgba) == (other.shape.kind, other.shape.size, other.rgba)
            np.testing.assert_allclose(other.placement, one.placement, atol=1e-15)


def test_a_linear_coupling_becomes_a_mimic(tmp_path):
    """ratio·spin − turn = 0 written as turn = ratio·spin holds for the mechanism read back."""
    (tmp_path / "gear.urdf").write_text(GEAR)
    write_urdf(read_description(tmp_path / "gear.urdf"), tmp_path / "back.urdf")
    ((own, master),) = (coupling.terms for coupling in read_description(tmp_path / "back.urdf").couplings)
    assert (own.joint, master.joint) == ("turn", "spin")
    assert (own.coefficients[1], master.coefficients[1]) == (1.0, -3.0)


def test_what_urdf_cannot_say_is_refused(tmp_path):
    """A polynomial coupling is named; no file is left behind."""
    (tmp_path / "gear.urdf").write_text(GEAR)
    gear = read_description(tmp_path / "gear.urdf")
    curved = replace(
        gear,
        couplings=(Coupling("cam", (CouplingTerm("spin", (0, 1, 2)), CouplingTerm("turn", (0, 1)))),),
    )
    with pytest.raises(DescriptionError, match=r"coupling 'cam': .*linearly"):
        write_urdf(curved, tmp_path / "none.urdf")
    assert not (tmp_path / "none.urdf").exists()


def test_couplings_that_share_a_joint(tmp_path):
    """Each joint mimics one other at most: the free one of two is written as dependent, or none."""
    (tmp_path / "gear.urdf").write_text(GEAR)
    gear = read_description(tmp_path / "gear.urdf")

    def tie(name, first, second):
        return Coupling(name, (CouplingTerm(first, (0.0, 1.0)), CouplingTerm(second, (0.0, -2.0))))

    both = replace(
        gear, couplings=(tie("one", "turn", "spin"), tie("two", "turn", "shoulder")), dependent_hint=("turn",)
    )
    write_urdf(both, tmp_path / "both.urdf")
    back = read_description(tmp_path / "both.urdf")
    assert [coupling.terms[0].joint for coupling in back.couplings] == ["shoulder", "turn"]
    held = replace(gear, couplings=(Coupling("held", (CouplingTerm("spin", (0.0,)), CouplingTerm("turn", (0.0,)))),))
    with pytest.raises(DescriptionError, match=r"coupling 'held': .*mimic"):
        write_urdf(held, tmp_path / "held.urdf")


def everything():
    """A four-bar with each physical element on some joint, a geared motor and a rotor where there is none."""
    before = read_description("four_bar")
    crank, *others = before.joints
    crank = replace(crank, damping=0.3, friction=0.2, armature=0.05, stiffness=2.0, spring_reference=0.4, effort=9.0)
    others[0] = replace(others[0], armature=0.01, damping=0.1)
    motor = Motor("drive", crank.name, gear=6.0)
    return replace(before, joints=(crank, *others), actuated=(crank.name,), motors=(motor,))


def moved(mechanism, q_of):
    """D, C, g and q̈ at a pose given by all joints' displacements, with v and u fixed."""
    model = ccpin.ReducedModel(mechanism)
    q = model.alpha(q_of)
    v, u = np.linspace(0.3, 1.1, model.n), np.linspace(-1.0, 2.0, model.n_actuated)
    terms = model.terms(q, v, q_of)
    return terms.D, terms.C, terms.g, model.forward_dynamics(q, v, u, q_of)


def round_trip(mechanism, suffix, folder):
    """The mechanism saved and loaded again, with the same independent joints."""
    file = folder / f"saved{suffix}"
    mechanism.save(file)
    pose = mechanism.settled().reference if suffix == ".sdf" else None  # it has no place for poses
    return ccpin.load(file, independent=mechanism.independent, actuated=mechanism.actuated, reference=pose)


def assert_same_motion(before, after):
    """Equal reduced dynamics at the reference, which both have."""
    np.testing.assert_allclose(after.q_reference, before.q_reference, rtol=0, atol=1e-9)
    for mine, theirs in zip(moved(before, before.q_reference), moved(after, after.q_reference), strict=True):
        np.testing.assert_allclose(theirs, mine, rtol=1e-8, atol=1e-8 * max(1.0, np.abs(mine).max()))


SUFFIXES = (".urdf", ".sdf", ".xml", ".yaml")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_springs_friction_rotors_and_gears_are_kept(suffix, tmp_path):
    """Field by field, and in the motion."""
    before = ccpin.load(everything())
    after = round_trip(before, suffix, tmp_path)
    fields = ("name", "damping", "friction", "armature", "stiffness", "spring_reference", "lower", "upper")
    read = [joint for joint in after.description.joints if joint.kind != "fixed"]
    same_fields(before.description.joints, read, fields)
    assert read[0].effort == 9.0
    if suffix == ".sdf":  # it has no motors
        after = ccpin.load(after.description, independent=after.independent, motors={"crank": {"gear": 6.0}})
    assert [motor.gear for motor in after.description.motors] == [6.0]
    assert_same_motion(before, after)


def test_mujoco_moves_alike(tmp_path):
    """MuJoCo's own D′, forces and Jacobian give the reduced model's acceleration, springs and gear included."""
    mujoco = pytest.importorskip("mujoco")
    before = ccpin.load(everything())
    before.save(tmp_path / "saved.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "saved.xml"))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    np.testing.assert_allclose(data.qpos, before.q_reference, atol=1e-12)
    data.ctrl[:] = 0.7
    mujoco.mj_forward(model, data)
    reduced = ccpin.ReducedModel(before)
    q = reduced.alpha(before.q_reference)
    state = reduced.at(q)
    # At rest: D′a = τ + Jᵀf with J a = 0, and MuJoCo's own D′, τ and J.
    mass, jacobian = np.zeros((model.nv, model.nv)), data.efc_J.reshape(-1, model.nv)
    mujoco.mj_fullM(model, data, mass)
    force = data.qfrc_actuator + data.qfrc_passive - data.qfrc_bias
    system = np.block([[mass, -jacobian.T], [jacobian, np.zeros((len(jacobian), len(jacobian)))]])
    found = np.linalg.lstsq(system, np.concatenate([force, np.zeros(len(jacobian))]), rcond=None)[0][: model.nv]
    np.testing.assert_allclose(found, state.rho @ state.forward_dynamics([0.0], [0.7]), rtol=1e-8)


def test_massless_links_go_into_the_next_body(tmp_path):
    """Two hinges with no mass between them are one MuJoCo body's; a moving body without mass is refused by name."""
    before = ccpin.load("stewart")
    before.save(tmp_path / "saved.xml")
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "saved.xml"))
    assert model.nbody < len(before.description.links) + 1
    assert model.nv == before.n_free
    bare = replace(before.description, links=tuple(replace(link, inertia=None) for link in before.description.links))
    with pytest.raises(DescriptionError, match="MJCF wants a mass in every moving body"):
        write_mjcf(bare, tmp_path / "none.xml")
    assert not (tmp_path / "none.xml").exists()


@pytest.mark.parametrize("kind", ["prismatic", "universal", "planar", "cylindrical"])
@pytest.mark.parametrize("writer", [write_mjcf, write_toolbox])
def test_closures_a_format_has_not_are_refused(writer, kind, tmp_path):
    """By the closure's name."""
    before = read_description("four_bar")
    other = replace(before, closures=(replace(before.closures[0], kind=kind),))
    with pytest.raises(DescriptionError, match=f"closure '{before.closures[0].name}': .* no {kind} closure"):
        writer(other, tmp_path / "robot.yaml")


def test_a_polynomial_coupling_in_mjcf(tmp_path):
    """θ₂ = p(θ₁) about references that are not zero comes back as the same curve."""
    (tmp_path / "gear.urdf").write_text(GEAR.replace("continuous", "revolute"))
    gear = read_description(tmp_path / "gear.urdf")
    curve = Coupling("cam", (CouplingTerm("spin", (0.1, 1.0, 0.5, -0.2), 0.3), CouplingTerm("turn", (0.2, -2.0), -0.1)))
    write_mjcf(replace(gear, couplings=(curve,)), tmp_path / "cam.xml")
    (back,) = read_description(tmp_path / "cam.xml").couplings

    def residual(coupling, angles):
        return sum(
            np.polynomial.polynomial.polyval(angles[term.joint] - term.reference, term.coefficients)
            for term in coupling.terms
        )

    for spin in (-0.7, 0.0, 0.9):
        turn = (0.2 + 0.1 + (spin - 0.3) + 0.5 * (spin - 0.3) ** 2 - 0.2 * (spin - 0.3) ** 3) / 2.0 - 0.1
        angles = {"spin": spin, "turn": turn}
        assert abs(residual(curve, angles)) < 1e-14
        assert abs(residual(back, angles)) < 1e-14


THREE = (
    CouplingTerm("turn", (0.1, -2.0), 0.3),
    CouplingTerm("spin", (0.2, 0.7), -0.1),
    CouplingTerm("shoulder", (0.0, 1.5, 0.4, -0.3), 0.2),
)


@pytest.mark.parametrize("terms", [THREE, THREE[:2] + (CouplingTerm("shoulder", (0.3, 1.5), 0.2),)])
def test_a_coupling_of_three_joints_in_mjcf(terms, tmp_path):
    """Σ pᵢ(θᵢ) = 0 as an equality of tendons: MuJoCo's residual and the coupling read back are the same function."""
    mujoco = pytest.importorskip("mujoco")
    gear = read_description_of(GEAR.replace("continuous", "revolute"))
    write_mjcf(replace(gear, couplings=(Coupling("sum", terms),)), tmp_path / "sum.xml")
    (back,) = read_description(tmp_path / "sum.xml").couplings
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "sum.xml"))
    data, generator = mujoco.MjData(model), np.random.default_rng(3)

    def residual(coupling, angles):
        return sum(
            np.polynomial.polynomial.polyval(angles[term.joint] - term.reference, term.coefficients)
            for term in coupling.terms
        )

    for _ in range(5):
        data.qpos[:] = generator.uniform(-1.0, 1.0, model.nq)
        mujoco.mj_forward(model, data)
        angles = {model.joint(k).name: float(data.qpos[k]) for k in range(model.nq)}
        stated = residual(Coupling("sum", terms), angles)
        assert abs(residual(back, angles) - stated) < 1e-14
        assert abs(data.efc_pos[0] - stated) < 1e-14
    two_curved = (*THREE, replace(THREE[2], joint="turn"))
    with pytest.raises(DescriptionError, match="coupling 'sum': MJCF wants a sum of joints"):
        write_mjcf(replace(gear, couplings=(Coupling("sum", two_curved),)), tmp_path / "none.xml")


def test_what_has_no_place_is_told(tmp_path):
    """Each format's losses in sentences that name the joints; what a format keeps is not among them."""
    before = everything()
    crank, *others = before.joints
    joints = (replace(crank, velocity=3.0, lower=-1.0, upper=np.inf), *others)
    motor = replace(before.motors[0], kind="position", lower=-2.0, upper=2.0)
    capsule = Visual(Shape("capsule", (0.1, 0.2)))
    links = (before.links[0], replace(before.links[1], visuals=(capsule,)), *before.links[2:])
    full = replace(
        before, links=links, joints=joints, motors=(motor,), gravity=(0.0, 0.0, -1.6), poses={"park": {"crank": (0.5,)}}
    )
    told = {suffix: "\n".join(write_description(full, tmp_path / f"robot{suffix}")) for suffix in SUFFIXES}
    for words, formats in {
        "the reference pose (load(reference=…) states it again): crank": {".sdf"},
        "further poses: park": {".sdf"},
        "motors (load(actuated=…, motors=…) states them again): crank": {".sdf"},
        "bounds of motors: crank": {".urdf", ".yaml"},
        "the loops closed around motors: crank (position)": {".urdf", ".yaml", ".xml"},
        "limits of velocity: crank": {".xml"},
        "limits of position on one side: crank": {".urdf", ".yaml", ".xml"},
        "capsules and ellipsoids": {".urdf", ".yaml"},
        "of the links: crank is crank_link": {".sdf"},
    }.items():
        assert {suffix for suffix, text in told.items() if words in text} == formats, words


@pytest.mark.parametrize("suffix", [".urdf", ".xml", ".yaml"])
def test_poses_are_kept(suffix, tmp_path):
    """Every pose of the file, by name, joints it leaves out at zero at most."""
    poses = {"park": {"crank": (0.5,)}, "up": {"crank": (1.0,), "rocker": (-0.25,)}}
    write_description(replace(everything(), poses=poses), tmp_path / f"robot{suffix}")
    back = read_description(tmp_path / f"robot{suffix}").poses
    assert list(back) == ["park", "up"]
    for name, pose in poses.items():
        assert {joint: value for joint, value in back[name].items() if value != (0.0,)} == pose


def test_the_command_line_tells_what_has_no_place(tmp_path, capsys):
    """In words and in JSON."""
    assert main(["convert", "rpdr", "--out", str(tmp_path / "robot.sdf")]) == 0
    assert "note: SDFormat has no place for motors" in capsys.readouterr().out
    assert main(["convert", "rpdr", "--out", str(tmp_path / "robot.sdf"), "--json"]) == 0
    assert any("motors" in note for note in json.loads(capsys.readouterr().out)["notes"])


def test_pinocchio_solves_with_our_constraint_models():
    """constraintDynamics with them gives q̈′ of the reduced model, loops of points and of axes."""
    for name in ("delta", "bennett"):
        mechanism = ccpin.load(name)
        model, pinocchio = ccpin.ReducedModel(mechanism), mechanism.pin_model
        contacts, memory = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        for contact in mechanism.pinocchio_constraints():
            contacts.append(contact)
            memory.append(contact.createData())
        data = pinocchio.createData()
        pin.initConstraintDynamics(pinocchio, data, contacts, memory)
        state, u = model.at(model.alpha(mechanism.q_reference)), np.ones(model.n_actuated)
        v = np.linspace(0.2, 0.4, model.n)
        tau, settings = state.joint_efforts(u), pin.ProximalSettings(1e-14, 1e-10, 200)
        found = pin.constraintDynamics(pinocchio, data, state.q_free, state.v_free(v), tau, contacts, memory, settings)
        expected = state.a_free(v, state.forward_dynamics(v, u))
        np.testing.assert_allclose(found, expected, atol=1e-7 * np.abs(expected).max())


def test_a_coupling_has_no_constraint_model(tmp_path):
    """Told by name."""
    (tmp_path / "gear.urdf").write_text(GEAR)
    with pytest.raises(UnsupportedMechanismError, match=r"coupling \(gear\)"):
        ccpin.load(tmp_path / "gear.urdf").pinocchio_constraints()


def test_the_suffix_tells_the_format(tmp_path):
    """Or `format` does; another one is refused."""
    mechanism = ccpin.load("rpdr")
    with pytest.raises(InvalidInputError, match=r"the suffix of .* names none of urdf, sdf, mjcf, toolbox"):
        mechanism.save(tmp_path / "robot.step")
    mechanism.save(tmp_path / "robot.model", "mjcf")
    assert ccpin.load(tmp_path / "robot.model").n == 2


def closed_as_drawn(kind, swapped=False):
    """Two bars on the ground and a closure between them (or the ground) that holds at zero displacement."""
    text = GEAR.replace('<parent link="arm"/>', '<origin xyz="0.4 -0.2 0.1" rpy="0.3 0.5 1.1"/><parent link="arm"/>')
    before = read_description_of(text)
    poses = zero_poses(before.root, before.joints)
    a = frame([0.1, 0.2, -0.3], np.linalg.qr(np.array([[1.0, 2, 0], [0, 1, 3], [2, 0, -1]]))[0])
    a[:3, 2] *= np.linalg.det(a[:3, :3])
    turn = {"revolute": turned_about_z(0.7), "prismatic": frame([0, 0, 0.6]), "universal": turned_about_z(0.0)}
    ends = ("motor", "base") if swapped else ("motor", "wheel")
    b = inverse(poses[ends[1]]) @ poses[ends[0]] @ a @ turn.get(kind, IDENTITY)
    return replace(before, couplings=(), closures=(LoopClosure("loop", kind, *ends, a, b),))


def read_description_of(text):
    """A URDF's description, without a file."""
    return read_urdf(text.encode(), None)


def turned_about_z(angle):
    """A turn about z."""
    return frame(np.zeros(3), [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])


@pytest.mark.parametrize("kind", ["spherical", "revolute", "prismatic", "fixed", "universal"])
def test_a_loop_that_is_closed_as_drawn_is_a_joint(kind, tmp_path):
    """Between the two links, with no word of Drake's; points and axes come back."""
    before = closed_as_drawn(kind)
    write_sdf(before, tmp_path / "robot.sdf")
    assert "drake" not in (tmp_path / "robot.sdf").read_text()
    ((one,), (other,)) = before.closures, read_description(tmp_path / "robot.sdf").closures
    assert [one.name, one.kind, one.link_a, one.link_b] == [other.name, other.kind, other.link_a, other.link_b]
    columns = {"revolute": ([2, 3], [2, 3]), "prismatic": ([2], [2]), "universal": ([0, 3], [1, 3])}
    for column, mine, theirs in zip(
        columns.get(kind, ([3], [3])),
        (one.placement_a, one.placement_b),
        (other.placement_a, other.placement_b),
        strict=True,
    ):
        np.testing.assert_allclose(mine[:3, column], theirs[:3, column], atol=1e-12)


def test_the_world_is_nobodys_child(tmp_path):
    """A closure that ends at the world is written from it."""
    before = closed_as_drawn("universal", swapped=True)
    links = tuple(replace(link, name="world") if link.name == "base" else link for link in before.links)
    joints = tuple(replace(j, parent="world") if j.parent == "base" else j for j in before.joints)
    (loop,) = (replace(closure, link_b="world") for closure in before.closures)
    write_sdf(replace(before, root="world", links=links, joints=joints, closures=(loop,)), tmp_path / "robot.sdf")
    assert "<child>world</child>" not in (tmp_path / "robot.sdf").read_text()
    (back,) = read_description(tmp_path / "robot.sdf").closures
    assert (back.kind, back.link_a, back.link_b) == ("universal", "world", "motor")
    np.testing.assert_allclose(back.placement_b[:3, 1], loop.placement_a[:3, 0], atol=1e-12)
    np.testing.assert_allclose(back.placement_a[:3, 0], loop.placement_b[:3, 1], atol=1e-12)


@pytest.mark.parametrize("kind", ["prismatic", "universal", "planar", "cylindrical"])
def test_open_loops_sdformat_has_no_words_for(kind, tmp_path):
    """Told by the closure's name; the four-bar is open at zero."""
    before = read_description("four_bar")
    other = replace(before, closures=(replace(before.closures[0], kind=kind),))
    with pytest.raises(DescriptionError, match=f"closure '{before.closures[0].name}': .* no {kind} closure"):
        write_sdf(other, tmp_path / "robot.sdf")
    assert not (tmp_path / "robot.sdf").exists()


@pytest.mark.parametrize(("kind", "length"), [("fixed", None), ("spherical", None), ("distance", 0.3)])
def test_open_loops_are_drakes(kind, length, tmp_path):
    """Ends come back exactly."""
    before = read_description("four_bar")
    (loop,) = (replace(closure, kind=kind, length=length) for closure in before.closures)
    write_sdf(replace(before, closures=(loop,)), tmp_path / "robot.sdf")
    (back,) = read_description(tmp_path / "robot.sdf").closures
    assert (back.name, back.kind, back.length) == (loop.name, kind, length)
    # joints of the four-bar have their links' names
    assert (back.link_a, back.link_b) == (f"{loop.link_a}_link", f"{loop.link_b}_link")
    part = np.s_[:, :] if kind == "fixed" else np.s_[:3, 3]
    np.testing.assert_allclose(back.placement_a[part], loop.placement_a[part], atol=1e-14)
    np.testing.assert_allclose(back.placement_b[part], loop.placement_b[part], atol=1e-14)


def test_couplings_gravity_and_names_in_sdf(tmp_path):
    """A linear coupling is a mimic, gravity a world's; a link named as a joint gives way; a curve is refused."""
    (tmp_path / "gear.urdf").write_text(GEAR.replace("continuous", "revolute").replace('"motor"', '"spin"'))
    gear = read_description(tmp_path / "gear.urdf")
    line = Coupling("belt", (CouplingTerm("spin", (0.1, 2.0), 0.3), CouplingTerm("turn", (0.2, -4.0), -0.1)))
    write_sdf(replace(gear, couplings=(line,), gravity=(1.0, 0.0, 2.0)), tmp_path / "gear.sdf")
    back = read_description(tmp_path / "gear.sdf")
    assert back.gravity == (1.0, 0.0, 2.0)
    assert {link.name for link in back.links} == {"world", "base", "arm", "spin_link", "wheel"}
    angles = {"spin": 0.8}
    angles["turn"] = (0.2 + 0.1 + 2.0 * (0.8 - 0.3)) / 4.0 - 0.1
    residual = sum(
        np.polynomial.polynomial.polyval(angles[term.joint] - term.reference, term.coefficients)
        for coupling in back.couplings
        for term in coupling.terms
    )
    assert len(back.couplings) == 1
    assert abs(residual) < 1e-14
    curve = replace(line, terms=(CouplingTerm("spin", (0.0, 1.0, 0.5)), line.terms[1]))
    with pytest.raises(DescriptionError, match="coupling 'belt': SDFormat couples two joints, linearly"):
        write_sdf(replace(gear, couplings=(curve,)), tmp_path / "none.sdf")


def test_a_free_body_in_sdf_stays_free(tmp_path):
    """Though nothing else hangs on the world; a free body with a damper is refused."""
    gear = read_description_of(GEAR)
    first, *others = gear.joints
    free = replace(gear, joints=(replace(first, kind="floating"), *others), couplings=())
    write_sdf(free, tmp_path / "free.sdf")
    back = read_description(tmp_path / "free.sdf")
    assert [joint.name for joint in back.joints if joint.kind == "floating"] == ["arm.free"]
    assert back.joints[0].parent == back.root == "world"
    damped = replace(free, joints=(replace(free.joints[0], damping=1.0), *others))
    with pytest.raises(DescriptionError, match="joint 'shoulder': SDFormat gives a floating joint no"):
        write_sdf(damped, tmp_path / "none.sdf")


def test_names_in_sdf_are_unique(tmp_path):
    """A link gives way to a joint, but takes no other link's name; a joint "world" and "::" are refused."""
    text = GEAR.replace('"motor"', '"spin"').replace('"wheel"', '"spin_link"')
    gear = read_description_of(text)
    write_sdf(gear, tmp_path / "gear.sdf")
    back = read_description(tmp_path / "gear.sdf")
    assert [link.name for link in back.links] == ["world", "base", "arm", "spin_2", "spin_link"]
    for name in ("world", "a::b", "__model__"):
        other = replace(gear, joints=(replace(gear.joints[0], name=name), *gear.joints[1:]))
        with pytest.raises(DescriptionError, match=f"'{name}'.*SDFormat keeps"):
            write_sdf(other, tmp_path / "none.sdf")


def test_a_rotor_on_a_joint_without_a_motor_is_a_urdf_that_others_read(tmp_path):
    """urdfdom, which Pinocchio reads with, refuses <dynamics> that says neither damping nor friction."""
    gear = read_description_of(GEAR)
    turned = tuple(replace(joint, armature=0.5) for joint in gear.joints)
    write_urdf(replace(gear, joints=turned), tmp_path / "gear.urdf")
    assert set(pin.buildModelFromUrdf(str(tmp_path / "gear.urdf")).names) >= {"shoulder", "spin", "turn"}
    assert [joint.armature for joint in read_description(tmp_path / "gear.urdf").joints] == [0.5, 0.5, 0.5]
