"""What each format says of springs, dampers, friction, limits and motors, read or named in the notes."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import ccpin
from ccpin.description import Motor, Part, combine, read_description
from ccpin.description.checks import check
from ccpin.description.urdf.writer import write_urdf
from ccpin.errors import DescriptionError, InvalidInputError
from tests.support.reading import read_mjcf, read_urdf

BODY = '<body name="{0}" pos="0 {1} 0"><joint name="{0}" axis="1 0 0" {2}/><geom size="0.1" pos="0 0 0.2"/></body>'


def mjcf(joint="", *, actuator="", head="", kind=""):
    """A body on joint ``a`` coupled to one on ``b``."""
    bodies = BODY.format("a", 0, joint) + BODY.format("b", 1, "")
    return (
        f"<mujoco>{head}<worldbody>{bodies}{kind}</worldbody>"
        f'<equality><joint joint1="b" joint2="a"/></equality><actuator>{actuator}</actuator></mujoco>'
    )


def read(text):
    return read_mjcf(text.encode(), None)


def urdf(inside="", extra="", name="crank"):
    """The installed four-bar with something inside of a joint, and something more."""
    text = read_file("four_bar")
    start = text.index(f'<joint name="{name}"')
    text = text[:start] + text[start:].replace("</joint>", f"{inside}</joint>", 1)
    return text.replace("</robot>", f"{extra}</robot>")


def read_file(name):
    from ccpin.description.finding import installed_models

    return installed_models()[name].read_text()


def joint_of(description, name):
    return next(joint for joint in description.joints if joint.name == name)


# --- MJCF -----------------------------------------------------------------------------------------------------------


def test_mjcf_joints_are_mujocos():
    """Damping, friction, stiffness, springref, armature are what MuJoCo's compiler makes of them, degrees turned."""
    text = mjcf('damping="0.3" frictionloss="0.7" stiffness="5" springref="30" armature="0.1" actuatorfrcrange="-4 9"')
    joint, model = joint_of(read(text), "a"), mujoco.MjModel.from_xml_string(text)
    assert (joint.damping, joint.friction, joint.stiffness, joint.armature, joint.effort) == (0.3, 0.7, 5, 0.1, 9)
    assert joint.spring_reference == pytest.approx(model.qpos_spring[0], rel=1e-15)
    assert (model.dof_damping[0], model.dof_frictionloss[0], model.jnt_stiffness[0]) == (0.3, 0.7, 5)


@pytest.mark.parametrize(
    ("joint", "word"),
    [
        ('stiffness="2 1"', "nonlinear part of the stiffness of joint 'a'"),
        ('damping="2 0 3"', "nonlinear part of the damping of joint 'a'"),
        ('springyield="1"', "springyield of joint 'a'"),
    ],
)
def test_what_mjcf_says_and_ccpin_lacks_is_noted(joint, word):
    """Nonlinear springs and dampers and springs stated by their period are in the notes."""
    text = mjcf(joint)
    mujoco.MjModel.from_xml_string(text)
    assert word in " ".join(read(text).notes)


@pytest.mark.parametrize(
    ("flag", "field"), [("spring", "stiffness"), ("damper", "damping"), ("frictionloss", "friction")]
)
def test_mjcf_flags_switch_physics_off(flag, field):
    """A file that disables springs, dampers or friction has none, and the notes say so."""
    text = mjcf('damping="0.3" frictionloss="0.7" stiffness="5"', head=f'<option><flag {flag}="disable"/></option>')
    mujoco.MjModel.from_xml_string(text)
    description = read(text)
    joint = joint_of(description, "a")
    assert {name for name in ("stiffness", "damping", "friction") if not getattr(joint, name)} == {field}
    assert any(field in note for note in description.notes)


ACTUATORS = {
    "motor": '<motor joint="a" gear="3" ctrlrange="-2 4" forcerange="-1 9"/>',
    "general": '<general joint="a" gear="3" gainprm="5" ctrlrange="-2 4" forcerange="-1 9"/>',
    "negative gain": '<general joint="a" gear="3" gainprm="-5" forcerange="-1 9"/>',
    "position": '<position joint="a" gear="3" kp="20" kv="2" forcerange="-1 9"/>',
    "velocity": '<velocity joint="a" kv="2"/>',
    "general affine": '<general joint="a" gainprm="4" biastype="affine" biasprm="1 -2 -3"/>',
    "default position": '<general class="servo" joint="a"/>',
    "default gear": '<motor class="geared" joint="a"/>',
    "motor of a servo's class": '<motor class="servo" joint="a"/>',
    "own kv": '<position class="servo" joint="a" kv="7"/>',
}
CLASSES = (
    '<default><default class="servo"><position kp="30" kv="4" gear="2"/></default>'
    '<default class="geared"><position gear="-6"/></default></default>'
)


@pytest.mark.parametrize("name", ACTUATORS)
def test_mjcf_actuators_are_mujocos(name):
    """What one unit of u does on the joint, or a loop's gains and bias: MuJoCo's joint effort at random states."""
    text = mjcf(actuator=ACTUATORS[name], head=CLASSES)
    (motor,) = read(text).motors
    model = mujoco.MjModel.from_xml_string(text)
    model.actuator_ctrllimited[:] = model.actuator_forcelimited[:] = 0
    data = mujoco.MjData(model)
    data.qpos[0], data.qvel[0], data.ctrl[0] = 0.3, -0.4, 0.7
    mujoco.mj_forward(model, data)
    force = 0.7
    if motor.kind != "motor":
        bias, length, rate = motor.gains["bias"], motor.gear * 0.3, motor.gear * -0.4
        force = motor.gains["gain"][0] * 0.7 + bias[0] + bias[1] * length + bias[2] * rate
        assert any("not simulated" in note for note in read(text).notes)
    assert motor.gear * force == pytest.approx(data.qfrc_actuator[0], rel=1e-12)


def test_mjcf_bounds_of_u():
    """u is bounded by ctrlrange and, through the gain, by forcerange; the joint's limit counts through the gear."""
    assert [(m.lower, m.upper) for m in read(mjcf(actuator=ACTUATORS["motor"])).motors] == [(-1, 4)]
    assert [(m.lower, m.upper) for m in read(mjcf(actuator=ACTUATORS["general"])).motors] == [(-0.2, 1.8)]
    assert [(m.lower, m.upper) for m in read(mjcf(actuator=ACTUATORS["negative gain"])).motors] == [(-1.8, 0.2)]
    mechanism = ccpin.load(read(mjcf('actuatorfrcrange="-6 6"', actuator='<motor joint="a" gear="-4"/>')))
    np.testing.assert_array_equal(mechanism.motors.limits, [[-1.5, 1.5]])


def test_a_second_actuator_and_a_gear_of_zero_are_noted():
    """u has one entry a joint; motors that add nothing to it are named."""
    text = mjcf(
        actuator='<position name="p" joint="a"/><velocity name="v" joint="a"/><motor name="z" joint="b" gear="0"/>'
    )
    mujoco.MjModel.from_xml_string(text)
    description = read(text)
    assert description.actuated == ("a",)
    notes = " ".join(description.notes)
    assert "velocity 'v' is left out" in notes
    assert "motor 'z' has a gear or a gain of 0" in notes


def test_a_balls_actuator_is_noted():
    """A motor along one axis of a ball joint: u has an entry for each velocity, and the notes say so."""
    ball = '<body name="c" pos="0 2 0"><joint name="c" type="ball"/><geom size="0.1" pos="0 0 0.2"/></body>'
    description = read(mjcf(actuator='<motor joint="c" gear="0 2 0"/>', kind=ball))
    assert ccpin.load(description).motors.gears.tolist() == [1, 1, 1]
    assert "gear 0 2 0" in " ".join(description.notes)


def test_misspelt_actuator_attributes_are_refused():
    """MuJoCo refuses them too."""
    with pytest.raises(DescriptionError, match="gaer"):
        read(mjcf(actuator='<motor joint="a" gaer="3"/>'))


# --- URDF -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("tag", ["dynamics", "joint_properties"])
def test_urdf_dynamics(tag):
    """<dynamics>, or <joint_properties> as it was called once, gives damping and friction."""
    description = read_urdf(urdf(f'<{tag} damping="0.25" friction="1.5"/>').encode(), None)
    joint = joint_of(description, "crank")
    assert (joint.damping, joint.friction) == (0.25, 1.5)
    assert ccpin.load(description).joints.damping.tolist() == [0.25, 0, 0]


def test_urdf_dynamics_misspelt_or_unknown():
    """A misspelt attribute is an error with the nearest name; one of another tool is noted."""
    with pytest.raises(DescriptionError, match="did you mean 'damping'"):
        read_urdf(urdf('<dynamics dampin="0.25"/>').encode(), None)
    description = read_urdf(urdf('<dynamics xyz_of_tool="0.25"/>').encode(), None)
    assert "xyz_of_tool" in " ".join(description.notes)


@pytest.mark.parametrize("place", ["actuator", "transmission", "joint"])
def test_urdf_mechanical_reduction(place):
    """A transmission's reduction is its motor's gear, wherever the dialect puts it."""
    text = read_file("four_bar").replace('value="10"/>', 'value="1"/>')
    reduction = "<mechanicalReduction>-30</mechanicalReduction>"
    start = text.index("<transmission")
    text = text[:start] + text[start:].replace(f"</{place}>", f"{reduction}</{place}>", 1)
    description = read_urdf(text.encode(), None)
    assert description.motors == (Motor("crank_motor", "crank", -30.0),)
    plain, geared = (ccpin.ReducedModel(ccpin.load(d)) for d in (read_description("four_bar"), description))
    q = plain.alpha(plain.mechanism.q_reference)
    assert geared.inverse_dynamics(q, [0.4], [0.0]) * -30 == pytest.approx(plain.inverse_dynamics(q, [0.4], [0.0]))


def test_ros2_control_transmissions():
    """ros2_control states the reduction of a joint inside its own element."""
    inside = '<plugin>transmission_interface/SimpleTransmission</plugin><actuator name="m" role="a"/>'
    driven = '<joint name="crank" role="j"><mechanical_reduction>7</mechanical_reduction></joint>'
    text = read_file("four_bar")
    text = text[: text.index("<transmission")] + text[text.index("</transmission>") + len("</transmission>") :]
    control = (
        f'<ros2_control name="c" type="system"><transmission name="t">{inside}{driven}</transmission></ros2_control>'
    )
    description = read_urdf(text.replace("</robot>", f"{control}</robot>").encode(), None)
    assert description.motors == (Motor("m", "crank", 7.0),)


def test_parts_keep_their_motors():
    """A combined mechanism's motors drive the joints by their new names."""
    one = replace(read_description("four_bar"), motors=(Motor("m", "crank", 5.0),))
    whole = combine("two", {"left_": Part(one), "right_": Part(one)})
    assert whole.motors == (Motor("left_m", "left_crank", 5.0), Motor("right_m", "right_crank", 5.0))


def test_urdf_transmissions_that_are_not_simple_are_noted():
    """A differential couples motors: its joints are driven themselves, and the notes say so."""
    text = read_file("four_bar").replace("SimpleTransmission", "DifferentialTransmission")
    description = read_urdf(text.encode(), None)
    assert description.motors[0].gear == 1.0
    assert "DifferentialTransmission" in " ".join(description.notes)


@pytest.mark.parametrize("text", ["0", "nan", "ten", ""])
def test_urdf_bad_reduction(text):
    """A reduction that is zero or no number is an error that names the transmission."""
    bad = f"<mechanicalReduction>{text}</mechanicalReduction></actuator>"
    with pytest.raises(DescriptionError, match="crank_"):
        read_urdf(read_file("four_bar").replace("</actuator>", bad).encode(), None)


def test_urdf_gazebo_spring():
    """Gazebo's spring on a joint is read."""
    spring = "<springStiffness>4.5</springStiffness><springReference>0.3</springReference>"
    extra = f'<gazebo reference="rocker">{spring}</gazebo>'
    joint = joint_of(read_urdf(urdf(extra=extra).encode(), None), "rocker")
    assert (joint.stiffness, joint.spring_reference) == (4.5, 0.3)


def test_urdf_unread_elements_are_noted():
    """What may be a force and is not read is named: Drake's bushings, safety controllers, limits below zero."""
    extra = '<drake:linear_bushing_rpy name="x"/>'
    inside = '<safety_controller k_velocity="10"/>'
    text = urdf(inside, extra).replace('effort="', 'effort="-', 1)
    notes = " ".join(read_urdf(text.encode(), None).notes)
    for word in ("linear_bushing_rpy", "safety_controller of crank", "taken as unlimited"):
        assert word in notes


def test_urdf_write_and_read(tmp_path):
    """Springs, dampers, friction and gears survive a file."""
    description = read_description("four_bar")
    joints = tuple(
        replace(j, damping=0.1, friction=0.2, stiffness=3.0, spring_reference=0.4) if j.name == "rocker" else j
        for j in description.joints
    )
    motors = (replace(description.motors[0], gear=-12.5),)
    write_urdf(replace(description, joints=joints, motors=motors), tmp_path / "x.urdf")
    again = read_description(tmp_path / "x.urdf")
    one, two = joint_of(again, "rocker"), joints[[j.name for j in joints].index("rocker")]
    for field in ("damping", "friction", "stiffness", "spring_reference"):
        assert getattr(one, field) == getattr(two, field)
    assert again.motors[0].gear == -12.5


def test_a_file_without_any_inertia_is_noted():
    """Nothing has mass: the notes say that there is no dynamics."""
    description = read_description("four_bar")
    bare = replace(description, links=tuple(replace(link, inertia=None) for link in description.links))
    assert "nothing has mass" in " ".join(check(bare).notes)


# --- what is sound, and what a user states ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("field", "value", "word"),
    [
        ("damping", -1.0, "damping -1 is negative"),
        ("friction", np.inf, "friction inf"),
        ("stiffness", np.nan, "stiffness nan"),
        ("effort", -2.0, "limit of effort"),
        ("spring_reference", np.inf, "spring's reference"),
    ],
)
def test_unsound_numbers_are_refused(field, value, word):
    """Each error names the joint and the number."""
    description = read_description("four_bar")
    joints = (replace(description.joints[0], **{field: value}), *description.joints[1:])
    with pytest.raises(DescriptionError, match=word) as caught:
        check(replace(description, joints=joints))
    assert f"joint '{description.joints[0].name}'" in str(caught.value)


@pytest.mark.parametrize("kind", ["continuous", "planar", "floating", "fixed"])
def test_springs_need_a_displacement(kind):
    """An angle on the circle is known up to whole turns only; joints of several displacements need several springs."""
    description = read_description("four_bar")
    joints = (replace(description.joints[0], kind=kind, stiffness=1.0), *description.joints[1:])
    with pytest.raises(DescriptionError, match="a spring needs a joint of kind revolute, prismatic, spherical"):
        check(replace(description, joints=joints))


def test_motors_are_checked():
    """A motor drives a joint that exists, with a gear, one a joint."""
    description = read_description("four_bar")
    for motors, word in (
        ((Motor("m", "ghost"),), "'ghost', which does not exist"),
        ((Motor("m", "crank", 0.0),), "gear 0 is zero"),
        ((Motor("m", "crank", lower=2.0, upper=1.0),), "lower bound 2 exceeds"),
        ((Motor("m", "crank"), Motor("n", "crank")), "has 2 motors"),
    ):
        with pytest.raises(DescriptionError, match=word):
            check(replace(description, motors=motors))


def test_load_states_what_the_file_lacks():
    """`joints` and `motors` of load end in the mechanism's fields."""
    mechanism = ccpin.load(
        "four_bar",
        joints={"rocker": {"damping": 0.1, "stiffness": 5.0, "friction": 0.2}, "crank": {"effort": 30}},
        motors={"crank": {"gear": 10, "upper": 2}},
    )
    joints = mechanism.joints
    assert joints.names == ("crank", "coupler", "rocker")
    assert joints.damping.tolist() == [0, 0, 0.1]
    assert joints.friction.tolist() == [0, 0, 0.2]
    assert joints.stiffness.tolist() == [0, 0, 5]
    assert mechanism.motors.gears.tolist() == [10]
    assert mechanism.motors.limits.tolist() == [[-3, 2]]
    assert mechanism.motors.each[0].name == "crank_motor"
    assert not mechanism.direct
    notes = " ".join(mechanism.notes)
    assert "dry friction of rocker" in notes
    assert "one unit is 10 on crank" in notes
    for array in joints[1:]:
        with pytest.raises(ValueError, match="read-only"):
            array[:] = 0


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"joints": {"roker": {"damping": 1.0}}}, "did you mean 'rocker'"),
        ({"joints": {"rocker": {"dampin": 1.0}}}, "did you mean 'damping'"),
        ({"joints": {"rocker": {"kind": "x"}}}, "cannot be stated"),
        ({"joints": {"rocker": {"damping": "a lot"}}}, "must be a number"),
        ({"joints": {"rocker": 3}}, "must be a mapping"),
        ({"joints": 3}, "must be a mapping"),
        ({"motors": {"rocker": {"gear": 2}}}, "'rocker' is not actuated"),
        ({"motors": {"crank": {"damping": 2}}}, "there are gear, lower, upper"),
    ],
)
def test_load_refuses_what_is_stated_wrongly(arguments, word):
    """Errors say what was meant, or what there is."""
    with pytest.raises(InvalidInputError, match=word):
        ccpin.load("four_bar", **arguments)
