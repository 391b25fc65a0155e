"""The MJCF reader against MuJoCo itself: kinematics, closure residuals and inertias of the same file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ccpin.description.mjcf import read_mjcf
from ccpin.description.model import Array, Joint, MechanismDescription
from ccpin.errors import DescriptionError, InvalidXmlError

mujoco = pytest.importorskip("mujoco")

CASSIE = Path(__file__).resolve().parents[2] / "shared" / "models" / "cassie_closed_chain.xml"
BALL = '<geom size="0.1"/>'


def model(bodies: str, *, equality: str = "", head: str = "", tail: str = "") -> str:
    """Return an MJCF file around some bodies and constraints."""
    return f'<mujoco model="sample">{head}<worldbody>{bodies}</worldbody><equality>{equality}</equality>{tail}</mujoco>'


PAIR = (
    f'<body name="a" pos="0.1 0.2 0.3" euler="10 20 30"><joint name="ja" axis="1 2 3"/>{BALL}</body>'
    f'<body name="b" pos="1 0 0" quat="1 2 -1 0.5"><joint name="jb" axis="0 1 0"/>{BALL}</body>'
)
JOINTLESS = (
    f'<body name="base" pos="0.4 -0.1 0.2" euler="0 30 0">{BALL}<body name="arm" pos="0 0 1">'
    f'<joint name="j" axis="0 1 0"/>{BALL}<body name="tip" pos="0.3 0 0.1" euler="5 6 7">{BALL}</body></body></body>'
)
SAMPLES = {
    "connect with joint pos": model(
        f'<body name="a" pos="0 0 1"><joint name="j" pos="0.2 -0.1 0.3" axis="1 1 0"/>{BALL}'
        f'<body name="b" pos="0.5 0 0"><joint name="k" pos="0 0.4 0" axis="0 0 1" ref="25"/>{BALL}</body></body>',
        equality='<connect name="c" body1="b" anchor="0.3 0.1 -0.2"/>',
    ),
    "several top-level bodies": model(
        PAIR, equality='<connect body1="a" body2="b" anchor="0.5 0.1 0"/><connect body1="b" anchor="1 0 0"/>'
    ),
    "jointless first body": model(JOINTLESS, equality='<connect body1="arm" body2="base" anchor="0 0 0.5"/>'),
    "weld to a jointless body": model(
        JOINTLESS + f'<body name="c"><freejoint name="f"/>{BALL}</body>',
        equality='<weld body1="c" body2="tip" anchor="0.1 0.2 0.3"/><weld body1="tip"/>',
    ),
    "weld with relpose": model(
        PAIR,
        equality='<weld body1="a" body2="b" relpose="0.1 0.2 0.3 1 2 3 4" anchor="0.5 0.6 0.7" torquescale="2"/>'
        '<weld body1="b" body2="a" relpose="9 9 9 0 0 0 0" anchor="0.1 0 0"/>',
    ),
    "weld that leaves turning free": model(
        PAIR, equality='<weld body1="a" body2="b" anchor="0.5 0.6 0.7" torquescale="0"/>'
    ),
    "sites": model(
        f'<body name="a"><joint name="j"/>{BALL}<site name="s" pos="0.1 0.2 0.3" xyaxes="1 1 0 0 1 1"/>'
        f'<site name="line" fromto="0 0 0 0.1 0.5 -0.2" type="capsule" size="0.01"/></body>'
        f'<body name="b" pos="1 0 0"><joint name="k" axis="1 0 0"/>{BALL}'
        f'<frame pos="0 0 1" euler="0 90 0"><site name="t" pos="0.4 0 0" zaxis="1 2 3"/></frame></body>',
        equality='<connect site1="s" site2="t"/><weld site1="t" site2="line"/>',
    ),
    "defaults tree": model(
        f'<body name="a" childclass="slider"><joint name="j"/>{BALL}<body name="b" pos="0 0 1">'
        f'<joint name="k" class="tilted"/>{BALL}<body name="c" childclass="tilted" pos="0 1 0">'
        f'<joint name="l" ref="0"/>{BALL}<site name="s" quat="1 1 0 0"/></body></body></body>',
        equality='<connect name="on" body1="c" anchor="0 0 1" active="true"/>'
        '<connect name="off" body1="b" anchor="0 0 1"/><weld name="s" site1="s" site2="w" class="slider"/>',
        head='<compiler angle="radian" eulerseq="zYx"/><default><equality active="false"/>'
        '<site euler="1 0.5 0.2"/><default class="slider"><joint type="slide" axis="0 1 1" ref="0.3"/>'
        '<equality active="true"/><default class="tilted"><joint type="hinge" range="-1 2"/></default>'
        "</default></default>",
    ).replace("</worldbody>", '<site name="w" pos="1 2 3"/></worldbody>'),
    "several joints in a body": model(
        f'<body name="a" pos="1 2 3" axisangle="1 1 0 40"><joint name="x" type="slide" axis="1 0 0" ref="0.4"/>'
        f'<joint name="h" axis="0 1 1" pos="0.1 0.2 0.3" ref="30"/><joint name="y" type="slide" axis="0 1 2"/>'
        f'<joint name="s" type="ball" pos="0 0.5 0"/>{BALL}</body>'
        f'<body name="b"><joint name="p" type="ball" pos="0.3 0 0"/>{BALL}</body>',
        equality='<weld body1="a" body2="b"/><connect body1="a" body2="b" anchor="0 1 0"/>',
    ),
    "frames": model(
        f'<frame pos="1 0 0" euler="0 0 90"><frame zaxis="0 1 1"><body name="a" pos="0 1 0"><freejoint name="f"/>'
        f'{BALL}<frame pos="0 0 2"><body name="b" euler="1 2 3"><joint name="j"/>{BALL}</body></frame></body>'
        f"</frame></frame>",
        head='<compiler eulerseq="XzY"/>',
        equality='<connect body1="a" body2="b" anchor="0 0 0"/>',
    ),
}
SAMPLES["cassie"] = CASSIE.read_text() if CASSIE.is_file() else ""
HAS_CASSIE = pytest.mark.skipif(not CASSIE.is_file(), reason="the sample of Cassie is not here")
ALL = [pytest.param(name, marks=HAS_CASSIE) if name == "cassie" else name for name in SAMPLES]


def read(text: str) -> MechanismDescription:
    """Read a file given as text."""
    return read_mjcf(text.encode(), None)


class Pair:
    """MuJoCo's model of a file and ccpin's description of it, in the same random configuration."""

    def __init__(self, text: str, seed: int = 0) -> None:
        self.description = read(text)
        self.model = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(self.model)
        random = np.random.default_rng(seed)
        self.displacement: dict[str, Array] = {}
        movable = [joint for joint in self.description.joints if joint.kind != "fixed"]
        assert len(movable) == self.model.njnt
        for index, joint in enumerate(movable):
            assert joint.name == (self.model.joint(index).name or f"joint_{index}")
            value = {"floating": 7, "spherical": 4}.get(joint.kind, 1)
            self.displacement[joint.name] = self._place(index, joint, random.normal(size=value))
        mujoco.mj_forward(self.model, self.data)
        self.poses = poses(self.description, self.displacement)

    def _place(self, index: int, joint: Joint, value: Array) -> Array:
        """Write our displacement into qpos, whose quaternions begin with w."""
        qpos = value.copy()
        if len(value) > 1:
            value[-4:] /= np.linalg.norm(value[-4:])
            qpos = np.concatenate([value[:-4], value[-1:], value[-4:-1]])
        start = self.model.jnt_qposadr[index]
        self.data.qpos[start : start + len(qpos)] = qpos
        return value


def motion(joint: Joint, value: Array) -> Array:
    """Return the displacement transform of a joint."""
    frame = np.eye(4)
    if joint.kind == "revolute":
        frame[:3, :3] = Rotation.from_rotvec(joint.axis * value[0]).as_matrix()
    elif joint.kind == "prismatic":
        frame[:3, 3] = joint.axis * value[0]
    elif joint.kind in ("spherical", "floating"):
        frame[:3, :3] = Rotation.from_quat(value[-4:]).as_matrix()
        if joint.kind == "floating":
            frame[:3, 3] = value[:3]
    return frame


def poses(description: MechanismDescription, displacement: dict[str, Array]) -> dict[str, Array]:
    """Return the world frames of all links: parent frame · placement · motion, parents first."""
    found = {description.root: np.eye(4)}
    for joint in description.joints:
        moved = motion(joint, displacement.get(joint.name, np.zeros(1)))
        found[joint.child] = found[joint.parent] @ joint.placement @ moved
    return found


@pytest.fixture(autouse=True)
def _away(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run elsewhere, because MuJoCo writes its warnings to a file in the working folder."""
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("sample", ALL)
def test_bodies_are_where_mujoco_puts_them(sample: str) -> None:
    """Every body's frame at a random qpos equals MuJoCo's xpos and xmat."""
    pair = Pair(SAMPLES[sample])
    for body in range(pair.model.nbody):
        pose = pair.poses[pair.model.body(body).name]
        np.testing.assert_allclose(pose[:3, 3], pair.data.xpos[body], rtol=0, atol=1e-9)
        np.testing.assert_allclose(pose[:3, :3], pair.data.xmat[body].reshape(3, 3), rtol=0, atol=1e-9)


@pytest.mark.parametrize("sample", ALL)
def test_closures_open_as_mujoco_says(sample: str) -> None:
    """The gap of every closure at a random qpos is MuJoCo's efc_pos of the same constraint."""
    pair = Pair(SAMPLES[sample], seed=1)
    active = [eq for eq in range(pair.model.neq) if pair.model.eq_active0[eq]]
    assert len(active) == len(pair.description.closures) > 0
    for eq, closure in zip(active, pair.description.closures, strict=True):
        assert closure.name == (pair.model.equality(eq).name or closure.name)
        rows = pair.data.efc_pos[(pair.data.efc_id == eq) & (pair.data.efc_type == 0)]
        frame_a = pair.poses[closure.link_a] @ closure.placement_a
        frame_b = pair.poses[closure.link_b] @ closure.placement_b
        np.testing.assert_allclose(frame_a[:3, 3] - frame_b[:3, 3], rows[:3], rtol=0, atol=1e-9)
        turns = len(rows) == 3 or pair.model.eq_data[eq, 10] == 0.0
        assert closure.kind == ("spherical" if turns else "fixed")
        if not turns:
            turn = Rotation.from_matrix(frame_b[:3, :3].T @ frame_a[:3, :3]).as_quat()
            expected = rows[3:] / pair.model.eq_data[eq, 10]
            sign = np.sign(turn[:3] @ expected)
            np.testing.assert_allclose(sign * turn[:3], expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("sample", ALL)
def test_qpos0_is_the_reference(sample: str) -> None:
    """The reference displacements put every body where MuJoCo's qpos0 puts it."""
    pair = Pair(SAMPLES[sample])
    mujoco.mj_resetData(pair.model, pair.data)
    mujoco.mj_kinematics(pair.model, pair.data)
    at_reference = poses(
        pair.description, {name: np.array(value) for name, value in pair.description.reference.items()}
    )
    for body in range(pair.model.nbody):
        pose = at_reference[pair.model.body(body).name]
        np.testing.assert_allclose(pose[:3, 3], pair.data.xpos[body], rtol=0, atol=1e-9)
        np.testing.assert_allclose(pose[:3, :3], pair.data.xmat[body].reshape(3, 3), rtol=0, atol=1e-9)


def geom(attributes: str) -> str:
    """Return a one-body file whose inertia comes from geoms."""
    return model(f'<body name="a" pos="0 0 1"><joint name="j" pos="0.1 0 0"/>{attributes}</body>')


INERTIAS = {
    "sphere": geom('<geom size="0.3" pos="1 2 3"/>'),
    "capsule": geom('<geom type="capsule" size="0.1 0.4" euler="30 40 50"/>'),
    "short capsule by mass": geom('<geom type="capsule" size="0.4 0.05" mass="3"/>'),
    "cylinder": geom('<geom type="cylinder" size="0.1 0.4" density="500" xyaxes="1 1 0 0 1 1"/>'),
    "ellipsoid": geom('<geom type="ellipsoid" size="0.1 0.2 0.3" axisangle="1 0 1 33"/>'),
    "box": geom('<geom type="box" size="0.1 0.2 0.3" quat="1 2 3 4"/>'),
    "fromto": geom(
        '<geom type="box" size="0.1 9" fromto="0 0 0 0.3 0.4 -1"/>'
        '<geom type="ellipsoid" size="0.2" fromto="0 0 0 1 2 3"/>'
        '<geom type="cylinder" size="0.2" fromto="0 1 0 0 1 -1"/><geom type="capsule" size="0.2" fromto="1 1 0 0 1 1"/>'
    ),
    "several geoms": geom(
        '<geom size="0.3" pos="1 2 3"/><geom type="box" size="1 2 3" mass="7"/><geom size="5" mass="0"/>'
        '<geom size="1" group="4"/>'
    ).replace("<worldbody>", '<compiler inertiagrouprange="0 3"/><worldbody>'),
    "diaginertia": geom('<inertial pos="1 0 0" mass="2" diaginertia="1 2 2.5" euler="10 20 30"/><geom size="1"/>'),
    "fullinertia": geom('<inertial pos="0 1 0" mass="2" fullinertia="1 1.2 1.3 0.1 -0.2 0.3"/>'),
    "inertiafromgeom": geom('<inertial pos="1 0 0" mass="2" diaginertia="1 1 1"/><geom size="0.5"/>').replace(
        "<worldbody>", '<compiler inertiafromgeom="true"/><worldbody>'
    ),
    "inertiafromgeom without geoms": geom('<inertial pos="1 0 0" mass="2" diaginertia="1 1 1"/>').replace(
        "<worldbody>", '<compiler inertiafromgeom="true"/><worldbody>'
    ),
    "bounds": geom('<inertial pos="0 1 0" mass="0.2" diaginertia="0.1 0.1 0.15"/>').replace(
        "<worldbody>", '<compiler boundmass="0.5" boundinertia="0.12"/><worldbody>'
    ),
    "balanceinertia": geom('<inertial pos="0 1 0" mass="2" diaginertia="1 1 4"/>').replace(
        "<worldbody>", '<compiler balanceinertia="true"/><worldbody>'
    ),
    "settotalmass": SAMPLES["jointless first body"].replace("<worldbody>", '<compiler settotalmass="7"/><worldbody>'),
    "geom defaults": model(
        '<body name="a" childclass="c"><joint/><geom pos="1 0 0"/><geom quat="1 1 0 0" density="10"/></body>',
        head='<default><geom type="box" size="0.1 0.2 0.3"/><default class="c"><geom euler="0 0 45"/></default>'
        "</default>",
    ),
}
INERTIAS.update({name: SAMPLES[name] for name in ("cassie", "several joints in a body")})


@pytest.mark.parametrize(
    "sample", [pytest.param(name, marks=HAS_CASSIE) if name == "cassie" else name for name in INERTIAS]
)
def test_bodies_weigh_what_mujoco_says(sample: str) -> None:
    """Mass, centre of mass and inertia in body axes equal those of MuJoCo's compiled model."""
    compiled = mujoco.MjModel.from_xml_string(INERTIAS[sample])
    links = {link.name: link for link in read(INERTIAS[sample]).links}
    for body in range(1, compiled.nbody):
        inertia = links[compiled.body(body).name].inertia
        assert inertia is not None
        quat = compiled.body_iquat[body]
        turn = Rotation.from_quat([*quat[1:], quat[0]]).as_matrix()
        expected = turn @ np.diag(compiled.body_inertia[body]) @ turn.T
        assert inertia.mass == pytest.approx(compiled.body_mass[body], rel=1e-12)
        np.testing.assert_allclose(inertia.com, compiled.body_ipos[body], rtol=0, atol=1e-9)
        np.testing.assert_allclose(inertia.rotational, expected, rtol=0, atol=1e-9 * max(1.0, np.abs(expected).max()))


def test_couplings_are_mujocos_polynomials() -> None:
    """The sum of a coupling's terms at a random qpos is MuJoCo's efc_pos, also with refs and short polycoef."""
    text = model(
        f'<body name="a"><joint name="j" ref="20"/>{BALL}<body name="b"><joint name="k" ref="-30"/>{BALL}'
        f'<body name="c"><joint name="l" type="slide" ref="0.2"/>{BALL}</body></body></body>',
        equality='<joint name="quartic" joint1="j" joint2="k" polycoef="0.1 0.2 0.3 0.4 0.5"/>'
        '<joint joint1="l" joint2="k" polycoef="0.7"/><joint name="locked" joint1="k" polycoef="0.3 5"/>'
        '<joint joint1="l" joint2="j" active="false"/>',
    )
    pair = Pair(text)
    assert [coupling.name for coupling in pair.description.couplings] == ["quartic", "joint_2", "locked"]
    for row, coupling in enumerate(pair.description.couplings):
        value = sum(
            np.polynomial.polynomial.polyval(pair.displacement[term.joint][0] - term.reference, term.coefficients)
            for term in coupling.terms
        )
        assert value == pytest.approx(pair.data.efc_pos[row], abs=1e-9)
    assert pair.description.dependent_hint == ("j", "l", "k")


def test_joint_attributes_are_mujocos() -> None:
    """Limits, armature and actuator force range equal those of the compiled model."""
    text = model(
        f'<body name="a"><joint name="j" range="-10 20" armature="0.3" actuatorfrcrange="-5 4"/>{BALL}'
        f'<joint name="k" type="slide" range="-1 2"/></body><body name="b"><joint name="l"/>'
        f'<joint name="m" type="slide" range="0 1" limited="false"/>{BALL}</body>'
    )
    compiled = mujoco.MjModel.from_xml_string(text)
    for index, joint in enumerate(read(text).joints):
        limits = compiled.jnt_range[index] if compiled.jnt_limited[index] else (-np.inf, np.inf)
        np.testing.assert_allclose((joint.lower, joint.upper), limits, rtol=1e-12)
        assert joint.armature == compiled.dof_armature[index]
        limited = compiled.jnt_actfrclimited[index]
        assert joint.effort == (np.abs(compiled.jnt_actfrcrange[index]).max() if limited else np.inf)


def test_inactive_and_unsupported_constraints_become_notes() -> None:
    """An inactive constraint, a tendon, springs and damping are named in the notes and left out."""
    text = model(
        PAIR.replace('name="ja"', 'name="ja" damping="1" stiffness="2"'),
        equality='<connect name="open" body1="a" anchor="0 0 0" active="false"/><weld body1="a"/><tendon tendon1="t"/>',
        tail='<tendon><fixed name="t"><joint joint="ja" coef="1"/></fixed></tendon>',
    )
    mujoco.MjModel.from_xml_string(text)
    description = read(text)
    assert [closure.name for closure in description.closures] == ["weld_1"]
    notes = "\n".join(description.notes)
    for word in ("'open'", "'tendon_1'", "springs of ja", "damping of ja", "tendons"):
        assert word in notes


def test_unnamed_elements_are_named_by_mujocos_numbers() -> None:
    """Unnamed bodies and joints get MuJoCo's numbers, and keep out of the way of given names."""
    text = model(
        f"<body><joint/>{BALL}<body>{BALL}</body></body>"
        f'<body name="body_2"><joint name="joint_1"/><joint type="slide"/>{BALL}</body>'
    )
    description = read(text)
    assert [link.name for link in description.links if link.inertia] == ["body_1", "body_2_", "body_2"]
    movable = [joint.name for joint in description.joints if joint.kind != "fixed"]
    assert movable == ["joint_0", "joint_1", "joint_2"]
    assert len({joint.name for joint in description.joints}) == len(description.joints)


def test_actuated_joints_are_those_with_actuators() -> None:
    """Every kind of actuator on a joint counts once; a file without actuators says nothing."""
    tail = (
        '<actuator><motor joint="jb"/><position joint="ja" kp="1"/><general joint="jb"/>'
        '<adhesion body="a" ctrlrange="0 1"/></actuator>'
    )
    mujoco.MjModel.from_xml_string(model(PAIR, tail=tail))
    assert read(model(PAIR, tail=tail)).actuated == ("jb", "ja")
    assert read(model(PAIR)).actuated is None


def test_options_gravity_and_flags() -> None:
    """Gravity is MuJoCo's; disabling gravity or equality acts as in MuJoCo."""
    equality = '<connect body1="a" anchor="0 0 0"/>'
    said = read(model(PAIR, equality=equality, head='<option gravity="1 2 3"/>'))
    assert said.gravity == (1.0, 2.0, 3.0)
    flags = '<option gravity="1 2 3"><flag gravity="disable" equality="disable"/></option>'
    disabled = read(model(PAIR, equality=equality, head=flags))
    assert disabled.gravity == (0.0, 0.0, 0.0)
    assert disabled.closures == ()


def test_visuals_have_mujocos_poses_and_sizes(tmp_path: Path) -> None:
    """Drawn primitives have MuJoCo's geom frames and twice its half sizes; meshes name the file found."""
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "cube.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\n")
    shapes = (
        '<geom type="box" size="0.1 0.2 0.3" euler="1 2 3" material="red"/>'
        '<geom type="capsule" size="0.1" fromto="0 0 0 0.3 0.4 1" rgba="0 1 0 0.5"/>'
        '<geom type="cylinder" size="0.1 0.5" pos="1 2 3"/><geom type="box" size="0.1" fromto="1 0 0 0.3 0.4 1"/>'
    )
    head = (
        '<compiler meshdir="meshes"/><asset><material name="red" rgba="1 0 0 1"/>'
        '<mesh file="cube.obj" scale="2 2 2" refpos="1 0 0"/></asset>'
    )
    inertial = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    text = model(f'<body name="a">{inertial}{shapes}<geom type="mesh" mesh="cube"/></body>', head=head)
    visuals = read_mjcf(text.encode(), str(tmp_path / "model.xml")).links[1].visuals
    compiled = mujoco.MjModel.from_xml_string(model(f'<body name="a">{shapes}</body>'.replace('material="red"', "")))
    for index, visual in enumerate(visuals[:4]):
        quat = compiled.geom_quat[index]
        turn = Rotation.from_quat([*quat[1:], quat[0]]).as_matrix()
        np.testing.assert_allclose(visual.placement[:3, :3], turn, rtol=0, atol=1e-9)
        np.testing.assert_allclose(visual.placement[:3, 3], compiled.geom_pos[index], rtol=0, atol=1e-9)
        half = compiled.geom_size[index]
        expected = 2 * half if visual.shape.kind == "box" else (half[0], 2 * half[1])
        np.testing.assert_allclose(visual.shape.size, expected, rtol=1e-12)
    assert [visual.rgba for visual in visuals[:2]] == [(1.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 0.5)]
    assert visuals[4].shape.mesh == str(tmp_path / "meshes" / "cube.obj")


@pytest.mark.parametrize(
    "asset", ['scale="2 3 4" refpos="1 0 0.5"', 'scale="2 2 2" refpos="1 2 3" refquat="1 2 3 4"', 'scale="1 -2 1"']
)
def test_meshes_are_drawn_where_mujoco_draws_them(tmp_path: Path, asset: str) -> None:
    """The scaled vertices of a mesh file, placed as said, are MuJoCo's vertices in the body frame."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    lines = [f"v {x} {y} {z}\n" for x, y, z in vertices]
    (tmp_path / "m.obj").write_text("".join(lines) + "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    inertial = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    drawn = '<geom type="mesh" mesh="m" pos="0.1 0.2 0.3" euler="10 20 30"/>'
    main = tmp_path / "main.xml"
    main.write_text(
        model(f'<body name="a">{inertial}{drawn}</body>', head=f'<asset><mesh file="m.obj" {asset}/></asset>')
    )
    visual = read_mjcf(main.read_bytes(), str(main)).links[1].visuals[0]
    ours = (vertices * visual.shape.size) @ visual.placement[:3, :3].T + visual.placement[:3, 3]
    compiled = mujoco.MjModel.from_xml_path(str(main))
    quat = compiled.geom_quat[0]
    turn = Rotation.from_quat([*quat[1:], quat[0]])
    theirs = turn.apply(compiled.mesh_vert) + compiled.geom_pos[0]
    distance = np.linalg.norm(ours[:, None] - theirs[None], axis=2)
    assert distance.min(axis=1).max() < 1e-6  # mesh_vert is in single precision
    assert distance.min(axis=0).max() < 1e-6


def test_unequal_scales_with_a_reference_orientation_are_not_drawn(tmp_path: Path) -> None:
    """A scale along turned axes is no placement of a scaled file, so nothing wrong is drawn."""
    head = '<asset><mesh file="m.obj" scale="1 2 3" refquat="1 1 0 0"/></asset>'
    inertial = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    text = model(f'<body name="a">{inertial}<geom type="mesh" mesh="m"/></body>', head=head)
    assert read(text).links[1].visuals == ()


def test_includes_are_read_from_the_models_folder(tmp_path: Path) -> None:
    """Nested includes are found relative to the main file, and the whole equals the assembled file."""
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "bodies.xml").write_text(f'<mujocoinclude>{PAIR}<include file="c.xml"/></mujocoinclude>')
    (tmp_path / "c.xml").write_text(f'<mujoco><body name="c"><joint name="jc"/>{BALL}</body></mujoco>')
    main = tmp_path / "main.xml"
    main.write_text(model('<include file="parts/bodies.xml"/>'))
    compiled = mujoco.MjModel.from_xml_path(str(main))
    description = read_mjcf(main.read_bytes(), str(main))
    assert [link.name for link in description.links] == [compiled.body(k).name for k in range(compiled.nbody)]


@pytest.mark.parametrize(
    ("file", "reason"),
    [
        ("../secret.xml", "outside"),
        ("/etc/passwd", "outside"),
        ("absent.xml", "no file"),
        ("main.xml", "twice"),
        ("empty.xml", "nothing"),
        ("", "required"),
    ],
)
def test_bad_includes_are_refused(tmp_path: Path, file: str, reason: str) -> None:
    """An include that leaves the folder, is absent, circular or empty is refused with the reason."""
    folder = tmp_path / "model"
    folder.mkdir()
    (tmp_path / "secret.xml").write_text(f"<mujoco>{PAIR}</mujoco>")
    (folder / "empty.xml").write_text("<mujoco/>")
    main = folder / "main.xml"
    main.write_text(model(f'<include file="{file}"/>'))
    with pytest.raises(DescriptionError, match=reason):
        read_mjcf(main.read_bytes(), str(main))


def test_includes_need_a_file() -> None:
    """A model given as text cannot include anything."""
    with pytest.raises(DescriptionError, match="was not read from a file"):
        read(model('<include file="a.xml"/>'))


def body(inside: str, attributes: str = "") -> str:
    """Return a file with one body."""
    return model(f'<body name="a" {attributes}>{inside}</body>')


def constraint(equality: str) -> str:
    """Return a file with two bodies, a ball joint and one constraint."""
    third = f'<body name="c"><joint name="jc" type="ball"/>{BALL}<site name="s"/></body>'
    return model(PAIR + third, equality=equality)


MALFORMED = {
    "misspelt attribute": (body(BALL, 'posx="0"'), "posx"),
    "number": (body(BALL, 'pos="0 0 x"'), "not a list of numbers"),
    "nan": (body(BALL, 'pos="0 0 nan"'), "finite"),
    "infinity": (body(BALL, 'pos="0 inf 0"'), "finite"),
    "too few": (body(BALL, 'pos="0 0"'), "3 numbers"),
    "too many": (body(BALL, 'pos="0 0 0 0"'), "at most 3"),
    "zero quaternion": (body(BALL, 'quat="0 0 0 0"'), "quat"),
    "parallel axes": (body(BALL, 'xyaxes="1 0 0 2 0 0"'), "xyaxes"),
    "two orientations": (body(BALL, 'quat="1 0 0 0" euler="0 0 0"'), "only one"),
    "zero axis": (body(f'<joint axis="0 0 0"/>{BALL}'), "axis"),
    "joint type": (body(f'<joint type="screw"/>{BALL}'), "hinge"),
    "descending range": (body(f'<joint name="j" range="1 -1"/>{BALL}'), "joint 'j'"),
    "limited without range": (body(f'<joint limited="true"/>{BALL}'), "range"),
    "range without limited": (
        body(f'<joint range="0 1"/>{BALL}').replace("<worldbody>", '<compiler autolimits="false"/><worldbody>'),
        "limited",
    ),
    "flag": (body(BALL, 'mocap="yes"'), "true, false"),
    "free and hinge": (body(f"<freejoint/><joint/>{BALL}"), "only joint"),
    "seven freedoms": (body('<joint type="slide"/>' * 7 + BALL), "6 degrees"),
    "ball and hinge": (body(f'<joint type="ball"/><joint/>{BALL}'), "ball joint"),
    "nested free joint": (body(f"{BALL}<body><freejoint/>{BALL}</body>"), "top level"),
    "negative armature": (body(f'<joint armature="-1"/>{BALL}'), "armature"),
    "duplicate body": (model('<body name="a"/><body name="a"/>'), "twice"),
    "body called world": (model('<body name="world"/>'), "twice"),
    "duplicate joint": (body(f'<joint name="j"/><joint name="j"/>{BALL}'), "twice"),
    "duplicate site": (body('<site name="s"/><site name="s"/>'), "twice"),
    "unknown element": (body("<gem/>"), "gem"),
    "body inside a geom": (body(f'<geom size="1"><body name="b">{BALL}</body></geom>'), "<body>"),
    "misspelt option": (model("", head='<option gravitiy="0 0 0"/>'), "gravitiy"),
    "misspelt root attribute": ('<mujoco modle="a"/>', "modle"),
    "inactive but wrong": (constraint('<weld body1="z" active="false"/>'), "body 'z'"),
    "unknown section": (model("").replace("<equality>", "<equalities/><equality>"), "section"),
    "replicate": (model(f'<replicate count="3">{BALL}</replicate>'), "replicate"),
    "unknown class": (body(f'<joint class="nope"/>{BALL}'), "nope"),
    "unknown childclass": (body(BALL, 'childclass="nope"'), "nope"),
    "nameless class": (model("", head="<default><default/></default>"), "class name"),
    "duplicate class": (
        model("", head='<default><default class="c"/><default class="c"/></default>'),
        "twice",
    ),
    "world joint": (model("<joint/>"), "world"),
    "negative size": (body('<geom size="-1"/>'), "positive"),
    "no size": (body('<geom type="box" size="1 1"/>'), "3 positive"),
    "fromto of a sphere": (body('<geom size="1" fromto="0 0 0 1 1 1"/>'), "fromto"),
    "fromto of no length": (body('<geom type="capsule" size="1" fromto="0 0 0 0 0 0"/>'), "fromto"),
    "unknown mesh": (body('<geom type="mesh" mesh="m"/>'), "no mesh 'm'"),
    "mesh inertia": (
        model(
            '<body name="a"><joint/><geom type="mesh" mesh="m"/></body>',
            head='<asset><mesh name="m" file="m.stl"/></asset>',
        ),
        "body 'a'",
    ),
    "unknown material": (body('<geom size="1" material="m"/>'), "material 'm'"),
    "negative mass": (body('<inertial pos="0 0 0" mass="-1" diaginertia="1 1 1"/>'), "negative"),
    "no mass": (body('<inertial pos="0 0 0" diaginertia="1 1 1"/>'), "mass"),
    "no inertia": (body('<inertial pos="0 0 0" mass="1"/>'), "diaginertia"),
    "indefinite inertia": (body('<inertial pos="0 0 0" mass="1" fullinertia="1 1 -1 0 0 0"/>'), "positive"),
    "triangle inequality": (body('<inertial pos="0 0 0" mass="1" diaginertia="1 1 3"/>'), "no solid"),
    "two inertias": (
        body('<inertial pos="0 0 0" mass="1" diaginertia="1 1 1" fullinertia="1 1 1 0 0 0"/>'),
        "excludes",
    ),
    "negative density": (body('<joint/><geom size="1" density="-1"/>'), "negative"),
    "global coordinates": (model("", head='<compiler coordinate="global"/>'), "global"),
    "euler sequence": (model("", head='<compiler eulerseq="xyw"/>'), "eulerseq"),
    "compiler angle": (model("", head='<compiler angle="turns"/>'), "degree, radian"),
    "gravity": (model("", head='<option gravity="0 0"/>'), "3 numbers"),
    "torquescale": (constraint('<weld body1="a" body2="b" torquescale="free"/>'), "torquescale"),
    "unread number": (body('<geom size="1" gap="wide"/>'), "gap"),
    "unknown body": (constraint('<connect name="k" body1="z" anchor="0 0 0"/>'), "connect 'k'.*body 'z'"),
    "unknown second body": (constraint('<weld body1="a" body2="z"/>'), "body 'z'"),
    "no anchor": (constraint('<connect body1="a" body2="b"/>'), "anchor"),
    "no body": (constraint('<connect anchor="0 0 0"/>'), "body1"),
    "body and site": (constraint('<weld body1="a" site1="s" site2="s"/>'), "either"),
    "one site": (constraint('<weld site1="s"/>'), "site2"),
    "unknown site": (constraint('<connect site1="s" site2="t"/>'), "site 't'"),
    "body with itself": (constraint('<weld body1="a" body2="a"/>'), "itself"),
    "relpose": (constraint('<weld body1="a" body2="b" relpose="1 2 3"/>'), "7 numbers"),
    "unknown joint": (constraint('<joint joint1="ja" joint2="z"/>'), "joint 'z'"),
    "no joint": (constraint("<joint/>"), "joint1"),
    "coupled ball": (constraint('<joint joint1="ja" joint2="jc"/>'), "neither"),
    "coupled to itself": (constraint('<joint joint1="ja" joint2="ja"/>'), "itself"),
    "long polynomial": (constraint('<joint joint1="ja" joint2="jb" polycoef="1 2 3 4 5 6"/>'), "at most 5"),
    "duplicate constraint": (constraint('<weld name="w" body1="a"/><weld name="w" body1="b"/>'), "twice"),
    "unknown constraint": (constraint('<glue body1="a"/>'), "glue"),
    "unknown actuated joint": (model(PAIR, tail='<actuator><motor joint="z"/></actuator>'), "joint 'z'"),
    "another root": ("<robot/>", "mujoco"),
}


@pytest.mark.parametrize("case", MALFORMED)
def test_malformed_files_are_refused_by_name(case: str) -> None:
    """Each mistake raises a DescriptionError that names the file, an element and the matter."""
    text, matter = MALFORMED[case]
    with pytest.raises(DescriptionError, match=matter) as refused:
        read_mjcf(text.encode(), "sample.xml")
    assert refused.value.source == "sample.xml"
    assert refused.value.element


def test_ill_formed_and_entity_laden_files_are_refused() -> None:
    """What is not well-formed, or declares entities, is an InvalidXmlError."""
    entity = '<!DOCTYPE mujoco [<!ENTITY e SYSTEM "file:///etc/passwd">]><mujoco model="&e;"/>'
    for text in ("<mujoco>", entity):
        with pytest.raises(InvalidXmlError):
            read(text)
