"""An arm and a four-bar as MJCF with room for springs, dampers and motors, and MuJoCo's state beside ccpin's."""

import mujoco
import numpy as np

from tests.support.reading import read_mjcf

ARM = """
<mujoco><compiler angle="radian"/><worldbody>
  <body name="a"><joint name="j1" axis="0 1 0" {j1}/><geom type="capsule" fromto="0 0 0 0.4 0 0.1" size="0.03"/>
    <body name="b" pos="0.4 0 0.1"><joint name="j2" type="slide" axis="1 0 1" {j2}/><geom size="0.06" pos="0.1 0.05 0"/>
      <body name="c" pos="0.2 0 0"><joint name="j3" type="ball" {j3}/>
        <geom type="box" size="0.05 0.1 0.2" pos="0 0.1 0.2"/>
      </body></body></body>
  <body name="p" pos="0 1 0"><joint name="k1" axis="1 0 0"/><geom size="0.1" pos="0 0 0.2"/></body>
  <body name="s" pos="0 2 0"><joint name="k2" axis="1 0 0"/><geom size="0.1" pos="0 0 0.2"/></body>
</worldbody><equality><joint joint1="k1" joint2="k2"/></equality>
<actuator>{actuator}</actuator></mujoco>
"""
"""An open arm beside a coupled pair, which makes it a mechanism with a loop."""

FOUR_BAR = """
<mujoco><compiler angle="radian"/><option gravity="1 0.5 -9"/><worldbody>
  <body name="crank"><joint name="a" axis="0 1 0" damping="0.3" armature="0.02"/>
    <geom type="capsule" fromto="0 0 0 0 0 0.3" size="0.02"/>
    <body name="coupler" pos="0 0 0.3"><joint name="b" axis="0 1 0" stiffness="6" springref="0.4" damping="0.05"/>
      <geom type="capsule" fromto="0 0 0 0.7 0 0.1" size="0.02"/></body></body>
  <body name="rocker" pos="0.7 0 0"><joint name="c" axis="0 1 0" damping="0.2" stiffness="3"/>
    <geom type="capsule" fromto="0 0 0 0 0 0.4" size="0.02"/></body>
</worldbody><equality><connect body1="coupler" body2="rocker" anchor="0.7 0 0.1"/></equality>
<actuator><motor name="m" joint="a" gear="20" ctrlrange="-2 3"/></actuator></mujoco>
"""


def read(text):
    return read_mjcf(text.encode(), None)


def arm(actuator="", **joints):
    """The arm's text; joints' attributes as keywords."""
    return ARM.format(**{"j1": "", "j2": "", "j3": "", **joints}, actuator=actuator)


def mujoco_state(text, mechanism, q_free, v_free, ctrl=()):
    """MuJoCo's model and data at ccpin's q′ and q̇′, joint by joint of the same name.

    MuJoCo's quaternions begin with w, and linear velocities of free joints are in world axes.
    """
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    for joint in mechanism.tree.joints:
        q, v = model.joint(joint.name).qposadr[0], model.joint(joint.name).dofadr[0]
        value, rate = q_free[joint.q].copy(), v_free[joint.v].copy()
        if joint.kind.unit == 4:
            value[-4:] = np.roll(value[-4:], 1)
        if joint.kind.name == "floating":
            rate[:3] = joint.kind.rotation(q_free[joint.q]) @ rate[:3]
        data.qpos[q : q + joint.kind.nq], data.qvel[v : v + joint.kind.nv] = value, rate
    data.ctrl[:] = ctrl
    mujoco.mj_forward(model, data)
    return model, data


def by_joint(mechanism, model, values):
    """MuJoCo's array over its dofs in the order of q̇′."""
    out = np.zeros(mechanism.n_free)
    for joint in mechanism.tree.joints:
        start = model.joint(joint.name).dofadr[0]
        out[joint.v] = values[start : start + joint.kind.nv]
    return out
