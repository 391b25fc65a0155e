"""What MuJoCo's compiler resolves by itself, and ccpin as it does: springs by their times, servos, states, meshes."""

from __future__ import annotations

import numpy as np
import pytest

from ccpin.errors import DescriptionError
from tests.support.mjcf_files import BALL, model, read

mujoco = pytest.importorskip("mujoco")

CHAIN = (
    '<body name="a" pos="0.1 0.2 0.3" euler="10 20 30">{a}<geom type="box" size="0.1 0.2 0.3" pos="0.1 0 0.2"/>'
    '<body name="b" pos="0.4 0 0.1" euler="30 0 50">{b}<geom type="capsule" size="0.1 0.3" pos="0 0.3 0"/>'
    '<body name="c" pos="0 0.2 0.4">{c}<geom size="0.15" pos="0.1 0.1 0"/></body></body></body>'
)
JOINTS = {
    "a": '<joint name="ja" axis="1 2 3" pos="0.1 0 0" ref="20" range="-30 40" armature="0.2" {}/>',
    "b": '<joint name="jb" type="slide" axis="0 1 1" ref="0.3" range="-0.2 0.7" {}/>',
    "c": '<joint name="jc" type="ball" pos="0 0.1 0" {}/>',
}


def chain(actuators="", springs="", default=""):
    bodies = CHAIN.format(**{name: text.format(springs) for name, text in JOINTS.items()})
    return model(bodies, head=f"<default>{default}</default>", tail=f"<actuator>{actuators}</actuator>")


def test_springs_stated_by_their_times():
    """springdamper = (t, r): stiffness M/(t r)² and damping 2 M/t with M = 1/(M⁻¹)ᵢᵢ at qpos0, of every joint."""
    text = chain(springs='springdamper="0.5 0.7"', actuators='<motor joint="jb" gear="2" armature="0.3"/>')
    compiled, joints = mujoco.MjModel.from_xml_string(text), {joint.name: joint for joint in read(text).joints}
    for k in range(3):
        joint = joints[compiled.joint(k).name]
        assert joint.stiffness == pytest.approx(compiled.jnt_stiffness[k], rel=1e-12)
        assert joint.damping == pytest.approx(compiled.dof_damping[compiled.jnt_dofadr[k]], rel=1e-12)
    with pytest.raises(DescriptionError, match="two positive numbers"):
        read(chain(springs='springdamper="0 0.7"'))


@pytest.mark.parametrize("gear", [1.0, -2.5])
@pytest.mark.parametrize("joint", ["ja", "jb"])
def test_ratios_of_damping_are_resolved(joint, gear):
    """kᵥ of a servo with a damping ratio is MuJoCo's, so that the servo can be played."""
    text = chain(f'<position name="s" joint="{joint}" kp="30" dampratio="0.8" gear="{gear}"/>')
    compiled, (motor,) = mujoco.MjModel.from_xml_string(text), read(text).motors
    assert motor.gains["bias"] == pytest.approx(compiled.actuator_biasprm[0, :3], rel=1e-12)
    assert "dampratio" not in motor.gains


@pytest.mark.parametrize(
    "actuator",
    [
        '<position name="s" joint="ja" kp="3" inheritrange="0.5"/>',
        '<position name="s" joint="jb" kp="3" inheritrange="1.5" gear="2"/>',
        '<general name="s" joint="ja" gainprm="3" biastype="affine" biasprm="0 -3 -1" inheritrange="0.7"/>',
        '<muscle name="s" joint="ja" lengthrange="0.1 0.5"/>',
        '<muscle name="s" joint="ja" lengthrange="0.1 0.5" timeconst="0.02 0.05" tausmooth="0.1"/>',
        '<dcmotor name="s" joint="ja" resistance="2" motorconst="0.05" inductance="0.01"/>',
        '<dcmotor name="s" joint="ja" resistance="2" motorconst="0.05" inductance="0 0.3" lugre="1 2 3 4 5"/>',
        '<dcmotor name="s" joint="ja" resistance="2" motorconst="0.05" thermal="1 2 3 4 5"/>',
        '<cylinder name="s" joint="jb" timeconst="0.3"/>',
        '<cylinder name="s" joint="jb" area="0.2" bias="1 2 3"/>',
        '<cylinder name="s" joint="jb" diameter="0.3"/>',
    ],
)
def test_states_and_bounds_are_mujocos(actuator):
    text = chain(actuator)
    compiled, (motor,) = mujoco.MjModel.from_xml_string(text), read(text).motors
    state = motor.gains.get("dynprm", ())
    assert state == pytest.approx(compiled.actuator_dynprm[0, : len(state)], rel=1e-12)
    if "gain" in motor.gains:
        assert motor.gains["gain"][0] == pytest.approx(compiled.actuator_gainprm[0, 0], rel=1e-12)
        assert motor.gains["bias"] == pytest.approx(compiled.actuator_biasprm[0, :3], rel=1e-12)
    inputs = motor.gains.get("inputs", (0.0, 0.0))
    assert inputs == pytest.approx(compiled.actuator_ctrlrange[0], rel=1e-12)


def test_a_default_bound_of_forces_is_not_a_free_joints():
    text = model(
        f'<body name="a"><freejoint name="f"/>{BALL}</body><body name="b"><joint name="j"/>{BALL}</body>',
        head='<default><joint actuatorfrcrange="-3 3"/></default>',
    )
    mujoco.MjModel.from_xml_string(text)
    assert [joint.effort for joint in read(text).joints] == [np.inf, 3.0]


def test_an_actuator_of_what_is_copied_is_copied():
    """As MuJoCo does: a motor for each copy of its joint; one of a single copy stays alone."""
    body = f'<body name="a"><joint name="j" axis="0 1 0"/>{BALL}</body>'
    bodies = f'<replicate count="3" offset="1 0 0" sep="-">{body}</replicate>'
    motors = '<motor name="m" joint="j" gear="2"/><position name="p" joint="j-1" kp="2"/><motor joint="j"/>'
    text = model(bodies, tail=f"<actuator>{motors}</actuator>")
    compiled = mujoco.MjModel.from_xml_string(text)
    names = [compiled.actuator(k).name for k in range(compiled.nu)]
    assert sorted(names) == ["", "", "", "m-0", "m-1", "m-2", "p"]
    description = read(text)
    assert [motor.name for motor in description.motors] == ["m-0", "m-1", "m-2"]
    assert sum("one entry for joint" in note for note in description.notes) == compiled.nu - 3


def test_a_point_mass_says_so():
    """An inertia may be left unsaid: mass alone, noted."""
    text = model('<body name="a"><joint name="j" axis="0 1 0"/><inertial pos="0 0 0.5" mass="2"/></body>')
    description = read(text)
    assert np.all(description.links[1].inertia.rotational == 0.0)
    assert any("point mass" in note for note in description.notes)


def test_an_obj_without_faces_is_its_hull(tmp_path):
    """As a MSH file of bare vertices is: MuJoCo hulls both."""
    from tests.support.reading import read_mjcf

    corners = np.array([[x, y, z] for x in (0, 0.3) for y in (0, 0.5) for z in (0, 0.7)])
    (tmp_path / "box.obj").write_text("".join(f"v {x} {y} {z}\n" for x, y, z in corners))
    text = model(
        '<body name="a"><joint name="j"/><geom type="mesh" mesh="box"/></body>',
        head='<asset><mesh name="box" file="box.obj"/></asset>',
    )
    (tmp_path / "m.xml").write_text(text)
    compiled = mujoco.MjModel.from_xml_path(str(tmp_path / "m.xml"))
    inertia = read_mjcf(text.encode(), str(tmp_path / "m.xml")).links[1].inertia
    assert inertia.mass == pytest.approx(compiled.body_mass[1], rel=1e-6)
    assert inertia.mass == pytest.approx(1000 * 0.3 * 0.5 * 0.7)
    assert inertia.com == pytest.approx([0.15, 0.25, 0.35])


def test_colours_out_of_range_are_read():
    text = model('<body name="a"><joint name="j"/><geom size="0.1" rgba="255 0 0 2"/></body>')
    assert read(text).links[1].visuals[0].rgba == (1.0, 0.0, 0.0, 1.0)
