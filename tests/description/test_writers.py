"""The URDF writer: what it writes reads back as the same mechanism, here and in Pinocchio's own parser."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import ccpin
from ccpin.description import Coupling, CouplingTerm, read_description
from ccpin.description.writers.urdf import write_urdf
from ccpin.errors import DescriptionError
from tests.support.places import MODELS

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


def test_a_linear_coupling_becomes_a_mimic(tmp_path):
    """ratio·spin − turn = 0 written as turn = ratio·spin holds for the mechanism read back."""
    (tmp_path / "gear.urdf").write_text(GEAR)
    write_urdf(read_description(tmp_path / "gear.urdf"), tmp_path / "back.urdf")
    ((own, master),) = (coupling.terms for coupling in read_description(tmp_path / "back.urdf").couplings)
    assert (own.joint, master.joint) == ("turn", "spin")
    assert (own.coefficients[1], master.coefficients[1]) == (1.0, -3.0)


def test_what_urdf_cannot_say_is_refused(tmp_path):
    """A polynomial coupling and a rotor without a motor are named; no file is left behind."""
    (tmp_path / "gear.urdf").write_text(GEAR)
    gear = read_description(tmp_path / "gear.urdf")
    curved = replace(
        gear,
        couplings=(Coupling("cam", (CouplingTerm("spin", (0, 1, 2)), CouplingTerm("turn", (0, 1)))),),
    )
    rotor = replace(gear, joints=(replace(gear.joints[0], armature=0.1), *gear.joints[1:]))
    for wrong, complaint in ((curved, "coupling 'cam': .*linearly"), (rotor, "joint 'shoulder': .*rotor inertia")):
        with pytest.raises(DescriptionError, match=complaint):
            write_urdf(wrong, tmp_path / "none.urdf")
        assert not (tmp_path / "none.urdf").exists()
