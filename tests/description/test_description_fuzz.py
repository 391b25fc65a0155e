"""Two thousand damaged descriptions: each loads or is refused with its file and the element at fault, in good time."""

import random

import pytest

import ccpin
from tests.support.damage import VALUES, XML_DAMAGE, complaint, damage_bytes
from tests.support.places import MODELS

CASES = 400
CHUNKS = 8

TOOLBOX_URDF = """<robot name="bar">
<link name="base"/>
<link name="crank"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
  <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="rod"><inertial><origin xyz="0.2 0 0" rpy="0 0.1 0"/><mass value="1"/>
  <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="rocker"><inertial><mass value="1"/>
  <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="end_A"/><link name="end_B"/>
<joint name="motor" type="revolute"><parent link="base"/><child link="crank"/><axis xyz="0 0 1"/>
  <limit lower="-3" upper="3" effort="1" velocity="1"/><dynamics damping="0.1" friction="0.2"/></joint>
<joint name="ball" type="revolute"><origin xyz="0.2 0 0"/><parent link="crank"/><child link="rod"/><axis xyz="0 0 1"/>
  <limit effort="1" velocity="1"/></joint>
<joint name="pivot" type="continuous"><origin xyz="0.4 0 0"/><parent link="base"/><child link="rocker"/>
  <axis xyz="0 0 1"/></joint>
<joint name="end_A_frame" type="fixed"><origin xyz="0.4 0 0"/><parent link="rod"/><child link="end_A"/></joint>
<joint name="end_B_frame" type="fixed"><origin xyz="0.3 0 0.05" rpy="0 0 1"/><parent link="rocker"/>
  <child link="end_B"/></joint>
<transmission name="drive"><type>transmission_interface/SimpleTransmission</type><joint name="motor"/>
  <actuator name="m"><mechanicalReduction>20</mechanicalReduction><rotor_inertia value="1e-5"/></actuator>
</transmission>
<gazebo reference="motor"><springStiffness>2</springStiffness><springReference>0.1</springReference></gazebo>
</robot>"""
TOOLBOX_YAML = """closed_loop: [['end_A', 'end_B']]
type: ['3d']
name_mot: ['motor']
joint_name: ['ball']
joint_type: ['UJOINT_YZ']
"""
MJCF = """<mujoco model="bars">
  <compiler angle="radian" autolimits="true"/>
  <default><default class="bar"><geom type="capsule" size="0.02" density="800"/></default></default>
  <worldbody>
    <body name="crank" pos="0 0 1"><joint name="motor" type="hinge" axis="0 1 0" range="-3 3" armature="0.01"
        damping="0.1" stiffness="2" springref="0.3" frictionloss="0.2"/>
      <geom class="bar" fromto="0 0 0 0.2 0 0"/>
      <body name="rod" pos="0.2 0 0"><joint name="elbow" type="ball"/>
        <geom class="bar" fromto="0 0 0 0.3 0.1 0"/></body>
    </body>
    <body name="rocker" pos="0.5 0.1 1"><joint name="pivot" axis="0 1 0"/>
      <inertial pos="0 0 0.1" mass="0.4" diaginertia="0.01 0.01 0.002"/>
      <geom class="bar" fromto="0 0 0 0 0 0.3"/></body>
    <body name="wheel" pos="0 1 0"><joint name="gear" axis="0 1 0"/><geom type="cylinder" size="0.1 0.02"/></body>
  </worldbody>
  <equality>
    <connect name="tip" body1="rod" body2="rocker" anchor="0.3 0.1 0"/>
    <joint name="mesh" joint1="gear" joint2="motor" polycoef="0 2 0 0 0"/>
  </equality>
  <actuator><motor joint="motor" gear="20" ctrlrange="-2 2" forcerange="-3 3"/>
    <position name="servo" joint="pivot" kp="20" kv="1"/><general joint="gear" gainprm="3" biastype="affine"/>
  </actuator>
</mujoco>"""


def damage_yaml(text, rng):
    """Another word, list or construct in place of one of the YAML's."""
    words = ("end_A", "end_B", "3d", "motor", "ball", "UJOINT_YZ", "closed_loop", "type", "name_mot", "joint_name")
    new = rng.choice(
        (
            *VALUES[:40],
            "[]",
            "[[",
            "{a: b}",
            "&x [*x]",
            "*x",
            "!!python/object:os.system",
            "~",
            "2001-99-99",
            "[" * 5000,
        )
    )
    return text.replace(rng.choice(words).encode(), new.encode(), 1)


YAML_DAMAGE = (damage_yaml, damage_yaml, damage_bytes)
SOURCES = (
    "rpdr",
    "four_bar",
    "toolbox",
    "mjcf",
    "slider_crank",
    "toolbox_urdf",
    "mjcf",
    "bennett",
    "planar_3rrr",
    "rpdr",
)


def write_case(number, folder):
    """Write the damaged description of that number; returns the file to load."""
    rng = random.Random(number)
    name = SOURCES[number % len(SOURCES)]
    if name.startswith("toolbox"):
        yaml, urdf = TOOLBOX_YAML.encode(), TOOLBOX_URDF.encode()
        if name == "toolbox":
            yaml = rng.choice(YAML_DAMAGE)(yaml, rng)
        else:
            urdf = rng.choice(XML_DAMAGE)(urdf, rng)
        (folder / "robot.urdf").write_bytes(urdf)
        file = folder / "robot.yaml"
        file.write_bytes(yaml)
        return file
    text = MJCF.encode() if name == "mjcf" else (MODELS / f"{name}.urdf").read_bytes()
    file = folder / f"{name}.xml"
    file.write_bytes(rng.choice(XML_DAMAGE)(text, rng))
    return file


@pytest.mark.parametrize("chunk", range(CHUNKS))
def test_a_damaged_description_loads_or_is_refused_by_name(chunk, tmp_path, capfd):
    """No case crashes, hangs, leaks a foreign exception, or prints; a refusal names the file and more."""
    failures = []
    for number in range(chunk, CASES, CHUNKS):
        folder = tmp_path / str(number)
        folder.mkdir()
        found = complaint(write_case(number, folder))
        if found is not None:
            failures.append(f"case {number} ({SOURCES[number % len(SOURCES)]}): {found[:300]}")
    printed = capfd.readouterr()
    assert not failures, "\n".join(failures)
    assert (printed.out, printed.err) == ("", "")


@pytest.mark.parametrize("name", sorted(set(SOURCES)))
def test_the_undamaged_originals_load(name, tmp_path):
    """The damage is what is refused: every original loads."""
    (tmp_path / "robot.urdf").write_text(TOOLBOX_URDF)
    (tmp_path / "robot.yaml").write_text(TOOLBOX_YAML)
    (tmp_path / "mjcf.xml").write_text(MJCF)
    file = {"mjcf": tmp_path / "mjcf.xml"}.get(
        name, tmp_path if name.startswith("toolbox") else MODELS / f"{name}.urdf"
    )
    assert ccpin.load(file).n >= 1
