"""What the MJCF reader makes of bodies and geoms, against MuJoCo's compiled model of the same file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.support.mjcf_files import BALL, HAS_CASSIE, SAMPLES, model, read
from tests.support.reading import read_mjcf

mujoco = pytest.importorskip("mujoco")


@pytest.fixture(autouse=True)
def _away(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run elsewhere, because MuJoCo writes its warnings to a file in the working folder."""
    monkeypatch.chdir(tmp_path)


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
        '<body name="a" childclass="c"><joint/><geom pos="1 0 0"/><geom quat="1 1 0 0" density="10"/>'
        '<geom class="d" euler="20 0 0"/></body>',
        head='<default><geom type="box" size="0.1 0.2 0.3"/><default class="c"><geom euler="0 0 45"/>'
        '<default class="d"><geom quat="1 2 3 4"/></default></default>'
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
