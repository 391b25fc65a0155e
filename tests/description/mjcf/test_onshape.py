"""onshape-to-robot's MJCF: pairs of connects as hinges, balls, welds, closing sites without equalities."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import ccpin
from tests.support.reading import read_mjcf
from tests.support.sdf_files import COUPLER, ROCKER, angle, four_bar_points

A, B, C, D = four_bar_points()
MASS = '<inertial pos="0.1 0 0.02" mass="0.7" fullinertia="0.002 0.004 0.005 0 0.0002 0"/>'


def turn(pitch):
    """The quaternion of a rotation about y as the tool writes it: six digits."""
    return f"{np.cos(pitch / 2):g} 0 {np.sin(pitch / 2):g} 0"


def site(name, x):
    """A closing site whose z axis is the hinge's (−y), and the site 0.1 m along it."""
    quat = "0.707107 0.707107 0 0"
    return (
        f'<site group="3" name="{name}" pos="{x:g} 0 0" quat="{quat}"/>'
        f'<site group="3" name="{name}_z" pos="{x:g} -0.1 0" quat="{quat}"/>'
    )


def export(equality):
    """The four-bar in the shape of an export: class defaults, sites, position actuators, an equality section."""
    crank, coupler, rocker = angle(A, B), angle(B, C), angle(D, C)
    return f"""<?xml version="1.0" ?><!-- Generated using onshape-to-robot -->
<mujoco model="bars"><compiler angle="radian" meshdir="assets" autolimits="true"/><option noslip_iterations="1"/>
<default><default class="bars"><position kp="50" dampratio="1"/>
<default class="visual"><geom type="mesh" contype="0" conaffinity="0" group="2"/></default></default></default>
<worldbody><body name="ground" pos="0 0 0" quat="1 0 0 0" childclass="bars">{MASS}
  <body name="crank" pos="{A[0]:g} 0 {A[1]:g}" quat="{turn(crank)}"><joint name="A" type="hinge" axis="0 1 0"/>{MASS}
    <body name="coupler" pos="0.2 0 0" quat="{turn(coupler - crank)}"><joint name="B" axis="0 1 0"/>{MASS}
    {site("closing_tip_1", COUPLER)}</body></body>
  <body name="rocker" pos="{D[0]:g} 0 {D[1]:g}" quat="{turn(rocker)}"><joint name="D" axis="0 1 0"/>{MASS}
  {site("closing_tip_2", ROCKER)}</body>
</body></worldbody>
<actuator><position class="bars" name="A" joint="A"/></actuator><equality>{equality}</equality></mujoco>"""


def read(equality):
    return read_mjcf(export(equality).encode(), None)


HINGE = (
    '<connect site1="closing_tip_1" site2="closing_tip_2"/><connect site1="closing_tip_1_z" site2="closing_tip_2_z"/>'
)
BALL = '<connect site1="closing_tip_1" site2="closing_tip_2"/>'


def state(description):
    return ccpin.ReducedModel(ccpin.load(description, independent=["A"])).at([0.1])


def test_two_connects_of_the_same_bodies_are_a_hinge():
    """With its axis along the sites' z, and a note; the sixth row, which rounding makes contradict, is gone."""
    description = read(HINGE)
    (closure,) = description.closures
    assert closure.kind == "revolute"
    assert np.allclose(closure.placement_a[:3, 2], [0, -1, 0], atol=1e-6)
    assert any("read as a hinge" in note for note in description.notes)


def test_the_hinge_moves_as_in_mujoco():
    """The crank's velocity moves the others as the null space of MuJoCo's own constraint Jacobian says."""
    ours = state(read(HINGE))
    model = mujoco.MjModel.from_xml_string(export(HINGE))
    data = mujoco.MjData(model)
    data.qpos[:] = ours.q_free
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    mujoco.mj_forward(model, data)
    jacobian = data.efc_J.reshape(-1, model.nv)[: data.ne]
    motion = np.linalg.svd(jacobian)[2][-1]
    assert np.allclose(ours.rho[:, 0], motion / motion[0], atol=1e-4)  # six digits in the file


@pytest.mark.parametrize("equality", ["", BALL])
def test_a_ball_or_nothing_stated_is_a_point(equality):
    """Closing sites without an equality, as in older exports, close by themselves."""
    description = read(equality)
    assert [c.kind for c in description.closures] == ["spherical"]
    assert any("onshape-to-robot" in note for note in description.notes) == (equality == "")
    assert np.allclose(state(description).D, state(read(HINGE)).D, rtol=1e-4)


def test_a_fastened_mate_is_a_weld():
    """One closure of six rows."""
    assert [c.kind for c in read('<weld site1="closing_tip_1" site2="closing_tip_2"/>').closures] == ["fixed"]


def test_connects_that_are_no_hinge_stay_two():
    """Points of other distances in the two bodies, or of other bodies."""
    apart = HINGE.replace('site2="closing_tip_2_z"', 'site2="closing_tip_2"')
    assert [c.kind for c in read(apart).closures] == ["spherical", "spherical"]


def test_a_ball_joint_may_state_an_empty_range():
    """limited="true" range="0 0" on a ball has no angle to limit: a note."""
    text = export(HINGE).replace(
        '<joint name="B" axis="0 1 0"/>', '<joint name="B" type="ball" limited="true" range="0 0"/>'
    )
    assert any("range of joint 'B'" in note for note in read_mjcf(text.encode(), None).notes)
