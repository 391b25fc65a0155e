"""What files found in the wild hold, read or refused by name: smallest mechanisms, soft bodies, names with colons."""

import time

import numpy as np
import pytest

import ccpin
from ccpin.errors import DescriptionError, UnsupportedMechanismError

BODY = '<inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
ONE = f"""<robot name="one"><link name="a"/><link name="b">{BODY}</link>
<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/></joint>%s</robot>"""
GEOM = '<geom size="0.1" pos="0.3 0 0"/>'
SOFT = f"""<mujoco><worldbody><body name="b"><joint name="j" axis="0 1 0"/>{GEOM}
<body name="c" pos="1 0 0"><joint name="k" axis="0 1 0"/>{GEOM}</body></body>%s</worldbody>%s
<equality><joint joint1="j" joint2="k"/>%s</equality></mujoco>"""


def written(folder, text):
    """A file that holds a text."""
    file = folder / ("robot.urdf" if text.startswith("<robot") else "robot.xml")
    file.write_text(text)
    return file


def test_one_joint_that_its_loop_leaves_free(tmp_path):
    """n′ = n = 1: a ball on the joint's own axis ties nothing; the pendulum's equation is left."""
    end = '<link_ link="{}"><origin xyz="0 1 0"/></link_>'
    ends = end.replace("link_", "predecessor").format("a") + end.replace("link_", "successor").format("b")
    mechanism = ccpin.load(written(tmp_path, ONE % f'<loop name="l" type="spherical">{ends}</loop>'))
    assert (mechanism.n_free, mechanism.n) == (1, 1)
    state = ccpin.ReducedModel(mechanism).at([0.4])
    np.testing.assert_allclose(state.D, [[0.1]], atol=1e-15)
    np.testing.assert_allclose(state.forward_dynamics([0.3], [0.5]), [5.0])


HELD = {
    "urdf": ONE % '<loop name="l" type="revolute"><predecessor link="a"><origin xyz="1 0 0"/></predecessor>'
    '<successor link="b"><origin xyz="1 0 0"/></successor><axis xyz="0 1 0"/></loop>',
    "mjcf": f'<mujoco><worldbody><body name="b"><joint name="j"/>{GEOM}</body></worldbody>'
    '<equality><joint joint1="j"/></equality></mujoco>',
}


@pytest.mark.parametrize("text", HELD.values(), ids=HELD)
def test_one_joint_that_its_loop_holds(text, tmp_path):
    """n′ = 1, n = 0: it loads, stands where it is closed, and the note says that nothing moves."""
    mechanism = ccpin.load(written(tmp_path, text))
    assert (mechanism.n_free, mechanism.n, mechanism.independent) == (1, 0, ())
    assert any("no independent joints: none moves freely" in note for note in mechanism.notes)
    assert np.abs(mechanism.constraints().residual(mechanism.q_reference)).max() < 1e-12
    with pytest.raises(UnsupportedMechanismError, match="mobility 0"):
        ccpin.simulate(mechanism, None, [], duration=1.0)


def test_a_flexcomp_of_a_million_points_is_refused_at_once(tmp_path):
    """By its name, before anything of its size is made."""
    cloth = '<flexcomp name="cloth" type="grid" count="200 200 40" spacing="1 1 1" dim="3" radius="0.1" mass="1"/>'
    begin = time.process_time()
    with pytest.raises(DescriptionError, match=r"flexcomp 'cloth': <flexcomp> is MuJoCo's to expand"):
        ccpin.load(written(tmp_path, SOFT % (cloth, "", "")))
    assert time.process_time() - begin < 1.0


def test_a_compiled_flex_is_noted(tmp_path):
    """Its bodies are bodies; what holds its shape, and an equality of it, are left out with a note each."""
    flex = '<deformable><flex name="f" dim="1" body="b c" vertex="0 0 0 0 0 0" element="0 1"/></deformable>'
    mechanism = ccpin.load(written(tmp_path, SOFT % ("", flex, '<flex name="taut" flex="f"/>')))
    assert mechanism.n == 1
    assert any("flex equality 'taut' is left out" in note for note in mechanism.notes)
    assert any("deformable bodies are left out" in note for note in mechanism.notes)


def test_mjcf_names_with_a_colon(tmp_path):
    """Whole joints, though a colon also parts a joint from its component: as motor, independent and in a coupling."""
    text = (SOFT % ("", "", "")).replace('"j"', '"robot0:j"').replace('"k"', '"robot0:rx"')
    motor = '<actuator><motor name="robot0:A" joint="robot0:rx"/></actuator></mujoco>'
    mechanism = ccpin.load(written(tmp_path, text.replace("</mujoco>", motor)))
    assert mechanism.independent == mechanism.actuated == ("robot0:rx",)
