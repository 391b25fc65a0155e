"""The MJCF reader against MuJoCo itself: kinematics, closure residuals and couplings of the same file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ccpin import MechanismDescription
from ccpin.arrays import Array
from ccpin.description import Joint
from ccpin.errors import DescriptionError
from tests.support.mjcf_files import ALL, BALL, PAIR, SAMPLES, model, read

mujoco = pytest.importorskip("mujoco")


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


def test_tendon_equalities_are_mujocos_residuals() -> None:
    """Fixed tendons' equalities at a random qpos are MuJoCo's efc_pos: sums, one alone, shared joints, a quartic."""
    bodies = "".join(
        f'<body name="b{name}"><joint name="{name}" ref="{ref}" type="{kind}"/>{BALL}</body>'
        for name, ref, kind in (("i", 20, "hinge"), ("j", -30, "hinge"), ("k", 0.2, "slide"), ("l", 0, "hinge"))
    )
    tendons = (
        '<fixed name="s"><joint joint="i" coef="2"/><joint joint="k" coef="-0.5"/></fixed>'
        '<fixed name="t"><joint joint="j" coef="0.7"/><joint joint="i" coef="0.4"/></fixed>'
        '<fixed name="u"><joint joint="l" coef="-3"/></fixed>'
    )
    text = model(
        bodies,
        equality='<tendon name="sums" tendon1="s" tendon2="t" polycoef="0.1 0.2"/><tendon tendon1="s"/>'
        '<tendon name="held" tendon1="t" polycoef="0.3 5"/>'
        '<tendon tendon1="t" tendon2="u" polycoef="0.1 0.2 0.3 0.4 0.5"/><tendon tendon1="u" tendon2="t"/>',
        tail=f"<tendon>{tendons}</tendon>",
    )
    pair = Pair(text)
    couplings = pair.description.couplings
    assert [coupling.name for coupling in couplings] == ["sums", "tendon_2", "held", "tendon_4", "tendon_5"]
    for row, coupling in enumerate(couplings):
        value = sum(
            np.polynomial.polynomial.polyval(pair.displacement[term.joint][0] - term.reference, term.coefficients)
            for term in coupling.terms
        )
        assert value == pytest.approx(pair.data.efc_pos[row], abs=1e-9)
    assert not any("tendon" in note for note in pair.description.notes)


def test_what_no_coupling_can_say_of_tendons_becomes_a_note() -> None:
    """A square of a sum of joints is left out by name; a tendon's spring is told where its equality is read."""
    parts = '<joint joint="ja" coef="1"/><joint joint="jb" coef="2"/>'
    tail = f'<tendon><fixed name="s">{parts}</fixed><fixed name="t"><joint joint="ja" coef="1"/></fixed></tendon>'
    square = '<tendon name="e" tendon1="t" tendon2="s" polycoef="0 1 0.5"/>'
    description = read(model(PAIR, equality=square, tail=tail))
    assert description.couplings == ()
    assert any("'e'" in note and "degree" in note for note in description.notes)
    line = '<tendon name="e" tendon1="t" tendon2="s"/>'
    assert not read(model(PAIR, equality=line, tail=tail)).notes
    head = '<default><tendon stiffness="3"/></default>'
    assert any("tendons are left out" in note for note in read(model(PAIR, equality=line, tail=tail, head=head)).notes)


SIDE = '<joint joint="ja" coef="1"/>'


@pytest.mark.parametrize(
    ("tendon", "equality", "matter"),
    [
        (f'<fixed name="t">{SIDE}</fixed>', 'tendon1="u"', "no tendon 'u'"),
        ('<fixed name="t"><joint joint="jx" coef="1"/></fixed>', 'tendon1="t"', "no joint 'jx'"),
        ('<fixed name="t"><joint joint="ja" coeff="1"/></fixed>', 'tendon1="t"', "coeff"),
        ('<fixed name="t"><joint joint="ja" coef="x"/></fixed>', 'tendon1="t"', "coef"),
        ('<fixed name="t"><joint joint="ja"/></fixed>', 'tendon1="t"', "coef"),
        ('<fixed name="t"/>', 'tendon1="t"', "coef"),
        (f'<fixed name="t">{2 * SIDE}</fixed>', 'tendon1="t"', "comes twice"),
        (f'<fixed name="t">{SIDE}</fixed>', 'tendon1="t" tendon2="t"', "to itself"),
        (f'<fixed name="t">{SIDE}</fixed>', 'tendon1="t" polycoeff="1"', "polycoeff"),
        (f'<fixed name="t">{SIDE}</fixed>' * 2, 'tendon1="t"', "used twice"),
    ],
)
def test_wrong_tendons_are_refused_by_name(tendon: str, equality: str, matter: str) -> None:
    """Names that do not exist, misspelt attributes and empty sums are errors."""
    with pytest.raises(DescriptionError, match=matter):
        read(model(PAIR, equality=f"<tendon {equality}/>", tail=f"<tendon>{tendon}</tendon>"))


def test_inactive_and_unsupported_constraints_become_notes() -> None:
    """An inactive constraint, a tendon and a yielding spring are named in the notes and left out."""
    text = model(
        PAIR.replace('name="ja"', 'name="ja" springyield="1"').replace("</body>", '<site name="s"/></body>', 1)
        + '<site name="w" pos="1 2 3"/><site name="v" pos="0 2 3"/>',
        equality='<connect name="open" body1="a" anchor="0 0 0" active="false"/><weld body1="a"/><tendon tendon1="t"/>',
        tail='<tendon><spatial name="t"><site site="s"/><site site="v"/><site site="w"/></spatial></tendon>',
    )
    mujoco.MjModel.from_xml_string(text)
    description = read(text)
    assert [closure.name for closure in description.closures] == ["weld_1"]
    notes = "\n".join(description.notes)
    for word in ("'open'", "'tendon_1'", "springyield of joint 'ja'", "tendons"):
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
