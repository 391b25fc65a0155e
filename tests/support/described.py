"""Descriptions in files, small and of every kind, that tests alter or read."""

from tests.support.sdf_files import four_bar, joint, link, model

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
INERTIA = '<inertia ixx="0.1" iyy="0.1" izz="0.01" ixy="0" ixz="0" iyz="0"/>'
BARS = f"""<robot name="bars"><link name="ground"/>
<link name="crank"><inertial><origin xyz="0 0 0.5"/><mass value="1"/>{INERTIA}</inertial></link>
<link name="coupler"><inertial><origin xyz="0.5 0 0"/><mass value="1"/>{INERTIA}</inertial></link>
<link name="rocker"><inertial><origin xyz="0 0 0.5"/><mass value="1"/>{INERTIA}</inertial></link>
<joint name="A" type="revolute"><parent link="ground"/><child link="crank"/><axis xyz="0 1 0"/></joint>
<joint name="B" type="revolute"><origin xyz="0 0 1"/><parent link="crank"/><child link="coupler"/>
  <axis xyz="0 1 0"/></joint>
<joint name="D" type="revolute"><origin xyz="1 0 0"/><parent link="ground"/><child link="rocker"/>
  <axis xyz="0 1 0"/></joint>
<loop name="C" type="revolute"><predecessor link="coupler"><origin xyz="1 0 0"/></predecessor>
  <successor link="rocker"><origin xyz="0 0 1"/></successor><axis xyz="0 1 0"/></loop>@</robot>"""
SDF_BARS = """<sdf version="1.9" xmlns:drake="drake.mit.edu"><model name="bars">
<link name="crank"><inertial><pose>0 0 0.5 0 0 0</pose></inertial></link>
<link name="coupler"><pose relative_to="crank">0 0 1 0 0 0</pose></link>
<link name="rocker"><pose>1 0 0 0 0 0</pose></link>
<joint name="A" type="revolute"><parent>world</parent><child>crank</child><axis><xyz>0 1 0</xyz></axis></joint>
<joint name="B" type="revolute"><parent>crank</parent><child>coupler</child><axis><xyz>0 1 0</xyz></axis></joint>
<joint name="D" type="revolute"><parent>world</parent><child>rocker</child><axis><xyz>0 1 0</xyz></axis></joint>
<joint name="C" type="revolute"><pose>0 0 1 0 0 0</pose><parent>coupler</parent><child>rocker</child>
  <axis><xyz>0 1 0</xyz></axis></joint>@</model></sdf>"""
UNASSEMBLED = """<sdf version="1.9" xmlns:drake="drake.mit.edu"><model name="unassembled">
<link name="driver"><pose>7 0 3 0 1 0</pose><inertial><pose>0 0 0.5 0 0 0</pose><mass>1</mass></inertial></link>
<link name="coupler"><pose>0.4 0 1 0 0.3 0</pose><inertial><mass>1.5</mass></inertial></link>
<link name="rocker"><pose>2 0 0 0 0 0</pose><inertial><pose>0 0 1 0 0 0</pose><mass>2</mass></inertial></link>
<link name="ground"/><joint name="held" type="fixed"><parent>world</parent><child>ground</child></joint>
<frame name="Wd" attached_to="ground"><pose relative_to="ground">-2 0 0 0 0 0</pose></frame>
<frame name="Wr" attached_to="ground"><pose relative_to="ground">2 0 0 0 0 0</pose></frame>
<frame name="Dc" attached_to="driver"><pose relative_to="driver">0 0 1 0 0 0</pose></frame>
<frame name="Cd" attached_to="coupler"><pose relative_to="coupler">-2.4 0 0 0 0 0</pose></frame>
<frame name="Cr" attached_to="coupler"><pose relative_to="coupler">2.4 0 0 0 0 0</pose></frame>
<frame name="Rc" attached_to="rocker"><pose relative_to="rocker">0 0 2 0 0 0</pose></frame>
<joint name="wd" type="revolute"><parent>ground</parent><child>driver</child>
  <drake:parent_frame>Wd</drake:parent_frame>
  <drake:child_frame>driver</drake:child_frame><axis><xyz>0 -1 0</xyz></axis></joint>
<joint name="wr" type="revolute"><parent>ground</parent><child>rocker</child>
  <drake:parent_frame>Wr</drake:parent_frame>
  <drake:child_frame>rocker</drake:child_frame><axis><xyz>0 -1 0</xyz></axis></joint>
<joint name="dc" type="revolute"><parent>driver</parent><child>coupler</child>
  <drake:parent_frame>Dc</drake:parent_frame>
  <drake:child_frame>Cd</drake:child_frame><axis><xyz expressed_in="Cd">0 -1 0</xyz></axis></joint>
<joint name="cr" type="revolute"><parent>coupler</parent><child>rocker</child>
  <drake:parent_frame>Cr</drake:parent_frame>
  <drake:child_frame>Rc</drake:child_frame>
  <axis><xyz expressed_in="Rc">0 -1 0</xyz></axis></joint></model></sdf>"""
SDF_RICH = model(
    link("base"),
    '<frame name="f" attached_to="base"><pose degrees="true">0 0 0.1 10 0 0</pose></frame>',
    link("a", '<pose relative_to="f">0 0 0.2 0 0 0</pose>'),
    joint("j1", "universal", "f", "a", axis="1 0 0", more="<axis2><xyz>0 1 0</xyz></axis2>"),
    '<model name="arm"><pose>0.5 0 0 0 0 0</pose>'
    + link("b")
    + link("c", '<pose relative_to="b">0 0 0.3 0 0 0</pose>')
    + joint("j2", "screw", "b", "c", axis="0 0 1", more="<screw_thread_pitch>0.01</screw_thread_pitch>")
    + "</model>",
    joint(
        "j3",
        "revolute",
        "base",
        "arm::b",
        extra="<limit><lower>-1</lower><upper>1</upper></limit><dynamics><damping>0.1</damping></dynamics>",
    ),
    joint("j4", "ball", "arm::c", "a", axis="", pose='<pose relative_to="a">0 0 0.1 0 0 0</pose>'),
    '<link name="wheel"><visual name="v"><geometry><cylinder><radius>1</radius><length>1</length></cylinder></geometry>'
    "<material><diffuse>1 0 0 1</diffuse></material></visual></link>",
    joint("j5", "continuous", "base", "wheel"),
    joint(
        "gear",
        "gearbox",
        "wheel",
        "arm::b",
        more="<axis2><xyz>0 1 0</xyz></axis2><gearbox_reference_body>base</gearbox_reference_body>",
    ),
)
ROBOT = four_bar().partition('version="1.9">')[2].removesuffix("</sdf>")
FLOOR = '<model name="g"><static>1</static><link name="l"/></model>'
WORLD = f'<sdf version="1.7"><world name="w"><gravity>0 0 -9.8</gravity>{ROBOT}{FLOOR}</world></sdf>'
SDF_TEXTS = {"four_bar": four_bar(), "rich": SDF_RICH, "world": WORLD}
