"""The URDF reader: loops in every dialect, couplings, marks and motors; the tree against Pinocchio and yourdfpy."""

import numpy as np
import pinocchio as pin
import pytest
import yourdfpy
from scipy.spatial.transform import Rotation

import ccpin
from ccpin.description import CLOSURE_KINDS
from ccpin.description.elements.meshes import find_mesh
from ccpin.description.urdf.loop_elements import SYNONYMS, closure_kind
from ccpin.errors import (
    AmbiguousFormatError,
    CcpinError,
    DescriptionError,
    DescriptionNotFoundError,
    InvalidXmlError,
    NoLoopError,
)
from ccpin.kinematics.tree import build_tree
from tests.support.places import MODELS
from tests.support.reading import read_urdf

every_model = pytest.mark.parametrize("path", sorted(MODELS.glob("*.urdf")), ids=lambda path: path.stem)

INERTIA = '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/>'


def link(name, mass="1"):
    return f'<link name="{name}"><inertial><origin xyz="0.1 0 0"/><mass value="{mass}"/>{INERTIA}</inertial></link>'


def joint(name, parent, child, xyz="0 0 0", kind="revolute", extra="", mark=""):
    return (
        f'<joint name="{name}" type="{kind}" {mark}><origin xyz="{xyz}"/><parent link="{parent}"/>'
        f'<child link="{child}"/><axis xyz="0 -1 0"/>{extra}</joint>'
    )


LIMIT = '<limit lower="-3" upper="3" effort="10" velocity="5"/>'
LINKS = '<link name="base"/>' + "".join(link(name) for name in ("crank", "rod", "rocker"))
JOINTS = (
    joint("a", "base", "crank", extra=LIMIT)
    + joint("b", "crank", "rod", "0.2 0 0", extra=LIMIT)
    + joint("c", "base", "rocker", "0.4 0 0", extra=LIMIT)
)
LOOP = (
    '<loop name="pin" type="revolute"><predecessor link="rod"><origin xyz="0.4 0 0"/></predecessor>'
    '<successor link="rocker"><origin xyz="0.3 0 0"/></successor><axis xyz="0 -1 0"/></loop>'
)


def robot(*parts, attributes=""):
    return f'<robot name="bars" {attributes}>{"".join(parts)}</robot>'.encode()


def read(*parts, attributes=""):
    return read_urdf(robot(*parts, attributes=attributes), None)


def terms(text, folder, near=None):
    """D, C and g of a four-bar given as text, at one state."""
    (folder / "bars.urdf").write_bytes(text)
    model = ccpin.ReducedModel(ccpin.load(folder / "bars.urdf", independent=["a"]))
    return model.terms([0.9], [1.3], near if near is not None else None)


def rotation(rpy):
    return Rotation.from_euler("xyz", rpy).as_matrix()


# --- dialects -------------------------------------------------------------------------------------------------------

DIALECTS = {
    "URDF+": LOOP,
    "Isaac": '<loop_joint name="pin" type="spherical"><link1 link="rod" xyz="0.4 0 0" rpy="0 0 0"/>'
    '<link2 link="rocker" xyz="0.3 0 0" rpy="0.1 0 0"/></loop_joint>',
    "Drake": '<drake:ball_constraint><drake:ball_constraint_body_A name="rod"/>'
    '<drake:ball_constraint_p_AP value="0.4 0 0"/><drake:ball_constraint_body_B name="rocker"/>'
    '<drake:ball_constraint_p_BQ value="0.3 0 0"/></drake:ball_constraint>',
    "Drake without prefix": '<ball_constraint><ball_constraint_body_A name="rod"/>'
    '<ball_constraint_p_AP value="0.4 0 0"/><ball_constraint_body_B name="rocker"/>'
    '<ball_constraint_p_BQ value="0.3 0 0"/></ball_constraint>',
}
DRAKE_DISTANCE = (
    '<drake:distance_constraint><drake:distance_constraint_body_A name="crank"/>'
    '<drake:distance_constraint_p_AP value="0.2 0 0"/><drake:distance_constraint_body_B name="rocker"/>'
    '<drake:distance_constraint_p_BQ value="0.3 0 0"/><drake:distance_constraint_distance value="0.4"/>'
    "</drake:distance_constraint>"
)


@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("declared", ["", 'xmlns:drake="http://drake.mit.edu"'])
def test_every_dialect_says_the_same_four_bar(dialect, declared, tmp_path):
    """D, C, g of the loop in each dialect equal the four-bar's, with the drake: prefix declared or not."""
    near = ccpin.ReducedModel(ccpin.load(read(LINKS, JOINTS, LOOP), independent=["a"])).sigma([0.9])
    found = terms(robot(LINKS, JOINTS, DIALECTS[dialect], attributes=declared), tmp_path, near)
    expected = terms(robot(LINKS, JOINTS, LOOP), tmp_path, near)
    for mine, theirs in zip(found, expected, strict=True):
        np.testing.assert_allclose(mine, theirs, atol=1e-10)


def test_drakes_distance_is_a_massless_rod(tmp_path):
    """A distance closure keeps crank tip and rocker tip 0.4 m apart."""
    (tmp_path / "bars.urdf").write_bytes(
        robot(
            LINKS.replace(link("rod"), ""),
            joint("a", "base", "crank"),
            joint("c", "base", "rocker", "0.4 0 0"),
            DRAKE_DISTANCE,
        )
    )
    mechanism = ccpin.load(tmp_path / "bars.urdf", independent=["a"])
    q_free = ccpin.ReducedModel(mechanism).sigma([1.0])
    theta, psi = (q_free[mechanism.pin_model.idx_qs[mechanism.pin_model.getJointId(n)]] for n in "ac")
    crank = 0.2 * np.array([np.cos(theta), np.sin(theta)])
    rocker = np.array([0.4, 0.0]) + 0.3 * np.array([np.cos(psi), np.sin(psi)])
    assert np.linalg.norm(crank - rocker) == pytest.approx(0.4, abs=1e-12)


def test_a_robot_without_a_name_is_called_after_its_file(tmp_path):
    """No name attribute: the file's stem; the four-bar loads all the same."""
    (tmp_path / "linkage.urdf").write_bytes(robot(LINKS, JOINTS, LOOP).replace(b' name="bars"', b""))
    assert ccpin.load(tmp_path / "linkage.urdf", independent=["a"]).name == "linkage"


def test_anonymous_constraints_are_numbered():
    """Two Drake constraints without names get names of their own."""
    names = [c.name for c in read(LINKS, JOINTS, DIALECTS["Drake"], DRAKE_DISTANCE).closures]
    assert names == ["ball_constraint_1", "distance_constraint_2"]


@pytest.mark.parametrize("word", [*CLOSURE_KINDS, *SYNONYMS])
def test_a_loops_frames_stand_where_its_origin_and_axis_say(word):
    """URDF+: origins as URDF's; z of both frames on <axis> (x of A and y of B on axis and axis2 if universal)."""
    rpy, axis, axis2 = (0.3, -0.5, 0.8), np.array([1.0, 2.0, -2.0]), np.array([0.0, 0.6, 0.8])
    loop = (
        f'<loop name="pin" type="{word}"><predecessor link="rod"><origin xyz="0.4 0.1 0" rpy="0.3 -0.5 0.8"/>'
        '</predecessor><successor link="rocker"/><axis xyz="1 2 -2"/><axis2 xyz="0 0.6 0.8"/>'
        '<length value="0.7"/></loop>'
    )
    closure = read(LINKS, JOINTS, loop).closures[0]
    assert closure.kind == SYNONYMS.get(word, word) == closure_kind(word)
    np.testing.assert_allclose(closure.placement_a[:3, 3], [0.4, 0.1, 0.0])
    np.testing.assert_array_equal(closure.placement_b[:3, 3], np.zeros(3))
    if closure.kind == "universal":
        np.testing.assert_allclose(closure.placement_a[:3, 0], rotation(rpy) @ axis / 3, atol=1e-12)
        np.testing.assert_allclose(closure.placement_b[:3, 1], axis2, atol=1e-12)
    else:
        np.testing.assert_allclose(closure.placement_a[:3, 2], rotation(rpy) @ axis / 3, atol=1e-12)
        np.testing.assert_allclose(closure.placement_b[:3, 2], axis / 3, atol=1e-12)
    assert closure.length == (0.7 if word == "distance" else None)


def test_isaacs_frames_carry_their_rotation():
    """<link1 xyz rpy/> and an <axis>: z of frame A is the axis turned by rpy."""
    closure = read(
        LINKS,
        JOINTS,
        '<loop_joint name="pin" type="hinge"><link1 link="rod" xyz="1 2 3" rpy="0.3 -0.5 0.8"/><link2 link="rocker"/>'
        '<axis xyz="0 3 4"/></loop_joint>',
    ).closures[0]
    assert closure.kind == "revolute"
    np.testing.assert_allclose(closure.placement_a[:3, 3], [1, 2, 3])
    np.testing.assert_allclose(closure.placement_a[:3, 2], rotation((0.3, -0.5, 0.8)) @ [0, 0.6, 0.8], atol=1e-12)


# --- motors, couplings, marks, pose ---------------------------------------------------------------------------------


@pytest.mark.parametrize("prefix", ["drake:", ""])
def test_a_rotor_adds_its_inertia_times_the_gear_ratio_squared(prefix):
    """D′ grows by ratio²·inertia on the motor's diagonal entry and nowhere else."""
    motor = (
        f'<transmission name="t"><joint name="b"/><actuator name="m"><{prefix}rotor_inertia value="0.02"/>'
        f'<{prefix}gear_ratio value="-5"/></actuator></transmission>'
    )
    with_motor, without = read(LINKS, JOINTS, LOOP, motor), read(LINKS, JOINTS, LOOP)
    assert (with_motor.actuated, without.actuated) == (("b",), None)
    masses = []
    for description in (with_motor, without):
        model = build_tree(description).model
        masses.append(pin.crba(model, model.createData(), np.array([0.3, 0.4, 0.5])))
    np.testing.assert_allclose(masses[0] - masses[1], np.diag([0.0, 0.5, 0.0]), atol=1e-15)


def geared(marks=("", "", ""), ratio=3.0):
    """A shaft with two wheels on an arm, their sums coupled: ratio·(first) = second."""
    return robot(
        '<link name="base"/>',
        *(link(name) for name in ("arm", "motor", "wheel")),
        joint("shoulder", "base", "arm", mark=marks[0]),
        joint("spin", "arm", "motor", mark=marks[1]),
        joint("turn", "arm", "wheel", mark=marks[2]),
        '<coupling name="gear"><predecessor link="motor"/><successor link="wheel"/>'
        f'<ratio value="{ratio}"/></coupling>',
    )


def test_a_coupling_counts_its_chains_from_the_nearest_common_ancestor(tmp_path):
    """ratio·spin − turn = 0; the shoulder, shared by both chains, stays out."""
    (tmp_path / "gear.urdf").write_bytes(geared())
    mechanism = ccpin.load(tmp_path / "gear.urdf", independent=["shoulder", "spin"])
    q_free = ccpin.ReducedModel(mechanism).sigma([0.4, 0.2])
    at = {name: q_free[mechanism.pin_model.getJointId(name) - 1] for name in ("shoulder", "spin", "turn")}
    assert at == pytest.approx({"shoulder": 0.4, "spin": 0.2, "turn": 0.6}, abs=1e-12)


def test_where_both_sides_are_independent_by_default_the_successor_gives_way(tmp_path):
    """Missing marks mean independent; the set is then too large, and the reduction is said."""
    (tmp_path / "gear.urdf").write_bytes(geared())
    mechanism = ccpin.load(tmp_path / "gear.urdf")
    assert mechanism.independent == ("shoulder", "spin")
    assert any("on both sides of couplings: turn taken as dependent" in note for note in mechanism.notes)


def test_marks_are_obeyed_and_nonsense_marks_refused(tmp_path):
    """independent="false" on the predecessor leaves the successor; a third word is an error."""
    (tmp_path / "gear.urdf").write_bytes(geared(("", 'independent="false"', 'independent="true"')))
    assert ccpin.load(tmp_path / "gear.urdf").independent == ("shoulder", "turn")
    with pytest.raises(DescriptionError, match="joint 'spin': independent='maybe' is neither true nor false"):
        read_urdf(geared(("", 'independent="maybe"', "")), None)


def test_marks_without_a_loop_are_explained(tmp_path):
    """Dependent joints and nothing they depend on: the error says what is missing."""
    text = robot(LINKS, JOINTS.replace('type="revolute" ', 'type="revolute" independent="false"', 1))
    (tmp_path / "bars.urdf").write_bytes(text)
    with pytest.raises(NoLoopError, match=r"bars\.urdf: .*marked dependent.*no <loop> or <coupling>"):
        ccpin.load(tmp_path / "bars.urdf")


def test_the_group_state_is_the_pose_near_which_the_loops_close(tmp_path):
    """Of the four-bar's two assemblies the reference chooses: the elbow's sign follows the stated pose."""
    signs = []
    for sign in (1, -1):
        state = (
            f'<group_state name="reference"><joint name="a" value="1"/><joint name="b" value="{-sign}"/>'
            f'<joint name="c" value="{1.5 * sign}"/></group_state>'
        )
        (tmp_path / "bars.urdf").write_bytes(robot(LINKS, JOINTS, LOOP, state))
        mechanism = ccpin.load(tmp_path / "bars.urdf", independent=["a"])
        a, b, c = (mechanism.q_reference[mechanism.pin_model.getJointId(n) - 1] for n in "abc")
        signs.append(np.sign(np.sin(a + b - c)))
    assert sorted(signs) == [-1, 1]


def test_a_mimic_joint_is_pinocchios(tmp_path):
    """D and g of the reduced model equal Pinocchio's own mimic model's (mimic=True)."""
    mimic = '<mimic joint="a" multiplier="-1.5" offset="0.2"/>'
    text = robot(LINKS, JOINTS.replace(LIMIT, LIMIT + mimic, 2).replace(mimic, "", 1))
    (tmp_path / "mimic.urdf").write_bytes(text)
    mechanism = ccpin.load(tmp_path / "mimic.urdf", independent=["a", "c"])
    theirs = pin.buildModelFromXML(text.decode(), True)
    q = np.array([0.7, -0.4])
    found = ccpin.ReducedModel(mechanism).terms(q, np.zeros(2))
    data = theirs.createData()
    np.testing.assert_allclose(found.D, pin.crba(theirs, data, q), atol=1e-13)
    np.testing.assert_allclose(found.g, pin.computeGeneralizedGravity(theirs, data, q), atol=1e-13)
    assert mechanism.pin_model.names[2] == "b"
    assert found.q_free[1] == pytest.approx(-1.5 * 0.7 + 0.2)


def test_missing_limits_and_meshes_cost_a_note_only(tmp_path):
    """No lower and upper: unlimited; a mesh that is not there: left out of pictures; both are noted."""
    visual = '<visual><geometry><mesh filename="package://arm/crank.stl"/></geometry></visual></link>'
    description = read(
        LINKS.replace("</link>", visual, 1), JOINTS.replace(LIMIT, '<limit effort="1" velocity="1"/>', 1), LOOP
    )
    assert (description.joints[0].lower, description.joints[0].upper) == (-np.inf, np.inf)
    notes = " ".join(description.notes)
    assert "joint 'a' states no lower and upper limit" in notes
    assert "link 'crank': mesh 'package://arm/crank.stl' is not there" in notes
    (tmp_path / "arm").mkdir()
    (tmp_path / "arm" / "crank.stl").touch()
    found = find_mesh("package://arm/crank.stl", str(tmp_path / "urdf" / "bars.urdf"))
    assert found == (tmp_path / "arm" / "crank.stl").resolve()


@pytest.mark.parametrize(
    ("shape", "trouble"),
    [
        ("<capsule radius='1' length='2'/>", "none of box, cylinder, sphere, mesh"),
        ("", "none of box, cylinder, sphere, mesh"),
        ("<sphere radius='0'/>", "sphere has no extent"),
        ("<box size='1 -1 1'/>", "box has no extent"),
        ("<mesh/>", "mesh has no file name"),
        ("<mesh filename='a.stl' scale='1 2'/>", "neither one nor three numbers"),
    ],
)
def test_what_cannot_be_drawn_costs_the_picture_only(shape, trouble):
    """Odd visuals are left out with a note; collision shapes, calibration and the like are not even looked at."""
    ignored = f"<collision><geometry>{shape}</geometry></collision><sensor/>"
    visual = f"<visual><geometry>{shape}</geometry></visual>{ignored}</link>"
    description = read(
        LINKS.replace("</link>", visual, 1), JOINTS.replace(LIMIT, LIMIT + '<calibration rising="x"/>', 1)
    )
    assert all(not each.visuals for each in description.links)
    (note,) = description.notes
    assert note.startswith("link 'crank': a ")
    assert trouble in note


# --- the tree -------------------------------------------------------------------------------------------------------


@every_model
def test_the_tree_is_the_one_pinocchio_reads(path):
    """D′ and g′ equal those of Pinocchio's own URDF parser by joint name, rotor inertia added as armature."""
    description = read_urdf(path.read_bytes(), str(path))
    ours, theirs = build_tree(description).model, pin.buildModelFromUrdf(str(path))
    assert set(theirs.names) == set(ours.names)
    armature = np.zeros(theirs.nv)
    for one in description.joints:
        if one.armature:
            armature[theirs.idx_vs[theirs.getJointId(one.name)]] = one.armature
    theirs.armature = armature
    order_q, order_v = [], []
    for name in list(ours.names)[1:]:
        j = theirs.getJointId(name)
        order_q += range(theirs.idx_qs[j], theirs.idx_qs[j] + theirs.nqs[j])
        order_v += range(theirs.idx_vs[j], theirs.idx_vs[j] + theirs.nvs[j])
    generator = np.random.default_rng(17)
    for _ in range(3):
        q = pin.integrate(theirs, pin.neutral(theirs), generator.standard_normal(theirs.nv))
        mass = pin.crba(theirs, theirs.createData(), q)[np.ix_(order_v, order_v)]
        gravity = pin.computeGeneralizedGravity(theirs, theirs.createData(), q)[order_v]
        np.testing.assert_allclose(pin.crba(ours, ours.createData(), q[order_q]), mass, atol=1e-12)
        np.testing.assert_allclose(
            pin.computeGeneralizedGravity(ours, ours.createData(), q[order_q]), gravity, atol=1e-12
        )


@every_model
def test_the_document_is_the_one_yourdfpy_reads(path):
    """Placements, axes, masses and inertias equal those of yourdfpy reading the same file, its loops and all."""
    description = read_urdf(path.read_bytes(), str(path))
    document = yourdfpy.URDF.load(str(path), load_meshes=False, build_scene_graph=False).robot
    for mine, theirs in zip(description.joints, document.joints, strict=True):
        assert (mine.name, mine.parent, mine.child) == (theirs.name, theirs.parent, theirs.child)
        np.testing.assert_allclose(mine.placement, np.eye(4) if theirs.origin is None else theirs.origin, atol=1e-15)
        if mine.kind in ("revolute", "prismatic", "continuous"):
            np.testing.assert_allclose(mine.axis, theirs.axis / np.linalg.norm(theirs.axis), atol=1e-15)
    for mine, theirs in zip(description.links, document.links, strict=True):
        assert (mine.inertia is None) == (theirs.inertial is None)
        if mine.inertia is not None:
            assert mine.inertia.mass == theirs.inertial.mass
            moments = np.linalg.eigvalsh(theirs.inertial.inertia)
            np.testing.assert_allclose(np.linalg.eigvalsh(mine.inertia.rotational), moments, rtol=1e-12)


# --- what is refused ------------------------------------------------------------------------------------------------

WHOLE = LINKS + JOINTS + LOOP
REFUSED = {
    "second root": (WHOLE + link("stray"), "link 'stray': a second root"),
    "own parent": (WHOLE + link("x") + joint("d", "x", "x"), "joint 'd': link 'x' is its own parent"),
    "cycle": (WHOLE + link("x") + link("y") + joint("d", "x", "y") + joint("e", "y", "x"), "the joints form a cycle"),
    "zero axis": (WHOLE.replace("0 -1 0", "0 0 0", 1), "joint 'a': the axis is the zero vector"),
    "short axis": (WHOLE.replace("0 -1 0", "0 1", 1), "axis of joint 'a': xyz='0 1' has 2 numbers where 3"),
    "negative mass": (WHOLE.replace(link("rod"), link("rod", -1)), "link 'rod': mass -1 kg is negative"),
    "infinite mass": (WHOLE.replace(link("rod"), link("rod", "inf")), "mass of link 'rod': value='inf' is not finite"),
    "no number": (WHOLE.replace(link("rod"), link("rod", "heavy")), "mass of link 'rod': value='heavy' is not numeric"),
    "huge mass": (
        WHOLE.replace(link("rod"), link("rod", "1e30")),
        "link 'rod': .*not a finite number of sensible size",
    ),
    "negative moment": (
        WHOLE.replace('ixx="0.01"', 'ixx="-0.01"', 1),
        "link 'crank': .*negative principal moment -0.01",
    ),
    "indefinite": (WHOLE.replace('ixy="0"', 'ixy="0.1"', 1), "link 'crank': .*negative principal moment"),
    "no mass": (WHOLE.replace('<mass value="1"/>', "", 1), "inertial of link 'crank': <mass> is missing"),
    "no inertia": (WHOLE.replace(INERTIA, "", 1), "inertial of link 'crank': <inertia> is missing"),
    "mimic of itself": (WHOLE.replace(LIMIT, LIMIT + '<mimic joint="a"/>', 1), "joint 'a': mimics itself"),
    "shape without size": (
        WHOLE.replace("</link>", "<visual><geometry><cylinder radius='1'/></geometry></visual></link>", 1),
        "cylinder of link 'crank': attribute 'length' is missing",
    ),
    "twin links": (WHOLE + link("rod"), "link 'rod': the name is used 2 times"),
    "twin joints": (WHOLE + link("x") + joint("a", "rod", "x"), "joint 'a': the name is used 2 times"),
    "twin loops": (WHOLE + LOOP, "loop 'pin': the name is used 2 times"),
    "unknown parent": (WHOLE + link("x") + joint("d", "ghost", "x"), "joint 'd': parent link 'ghost' does not exist"),
    "crossed limits": (WHOLE.replace('lower="-3"', 'lower="4"', 1), "joint 'a': lower limit 4 exceeds upper limit 3"),
    "negative rotor": (
        WHOLE
        + '<transmission name="t"><joint name="a"/><actuator><rotor_inertia value="-1"/></actuator></transmission>',
        "joint 'a': reflected rotor inertia -1 is negative",
    ),
    "pose of a stranger": (
        WHOLE + '<group_state name="reference"><joint name="ghost" value="1"/></group_state>',
        "joint 'ghost': has a reference value but does not exist",
    ),
    "pose far away": (
        WHOLE + '<group_state name="reference"><joint name="a" value="1e308"/></group_state>',
        r"joint 'a': the reference value is not finite or not below 1e\+09",
    ),
    "ratio out of reach": (
        WHOLE
        + '<coupling name="g"><predecessor link="rod"/><successor link="rocker"/><ratio value="1e300"/></coupling>',
        "coupling 'g': a coefficient of joint 'b' is not finite or not below",
    ),
    "coupling to a stranger": (
        WHOLE + '<coupling name="g"><predecessor link="ghost"/><successor link="rod"/><ratio value="1"/></coupling>',
        "coupling 'g': predecessor link 'ghost' does not exist",
    ),
    "coupling of nothing": (
        WHOLE + '<coupling name="g"><predecessor link="rod"/><successor link="rod"/><ratio value="1"/></coupling>',
        "coupling 'g': couples no joint",
    ),
    "nothing": ("", "declares no link"),
}
REFUSED |= {
    name: (WHOLE.replace(said, written), complaint)
    for name, said, written, complaint in (
        ("unknown loop link", 'successor link="rocker"', 'successor link="ghost"', "loop 'pin': link 'ghost'"),
        ("loop to itself", 'successor link="rocker"', 'successor link="rod"', "loop 'pin': joins link 'rod' to"),
        ("loop type", 'name="pin" type="revolute"', 'name="pin" type="glue"', "loop 'pin': type 'glue' is not"),
        ("joint type", 'name="a" type="revolute"', 'name="a" type="screw"', "joint 'a': type 'screw' is not"),
        ("loop without axis", '<axis xyz="0 -1 0"/></loop>', "</loop>", "loop 'pin': a revolute loop needs an"),
    )
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_is_refused_by_name(case, tmp_path):
    """The error names the file, the element, and what is wrong with it."""
    body, complaint = REFUSED[case]
    (tmp_path / "bad.urdf").write_bytes(robot(body))
    with pytest.raises(DescriptionError, match=rf"bad\.urdf: .*{complaint}"):
        ccpin.load(tmp_path / "bad.urdf")


def test_a_reference_of_the_wrong_size_is_refused(tmp_path):
    """Two numbers for a hinge: refused with the joint's name and what it needs."""
    state = '<group_state name="reference"><joint name="a" value="1 2"/></group_state>'
    (tmp_path / "bad.urdf").write_bytes(robot(WHOLE, state))
    with pytest.raises(
        DescriptionError, match="joint 'a': the reference value has 2 numbers; a revolute joint needs 1"
    ):
        ccpin.load(tmp_path / "bad.urdf")


def test_moments_that_no_body_has_are_noted_and_used():
    """Triangle inequality violated (common in published files): a note, not an error."""
    description = read(WHOLE.replace('ixx="0.01"', 'ixx="0.5"', 1))
    assert any("link 'crank': no body has the principal moments" in note for note in description.notes)


@pytest.mark.parametrize(
    ("text", "error", "complaint"),
    [
        (b'<!DOCTYPE r [<!ENTITY a "b">]><robot name="&a;"/>', InvalidXmlError, "document type declaration"),
        (b'<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]><robot>&a;</robot>', InvalidXmlError, "document type"),
        (b"<robot", InvalidXmlError, "not well-formed"),
        (b"<model/>", AmbiguousFormatError, "<model> is none of"),
        (b"<sdf/>", DescriptionError, "not exactly one model"),
        (b"hello", AmbiguousFormatError, "neither XML"),
        (b"", AmbiguousFormatError, "neither XML"),
    ],
)
def test_what_is_no_description_is_refused(text, error, complaint, tmp_path):
    """Entities, malformed XML and other formats are refused with the file's name."""
    (tmp_path / "bad.urdf").write_bytes(text)
    with pytest.raises(error, match=rf"bad\.urdf: .*{complaint}"):
        ccpin.load(tmp_path / "bad.urdf")
    assert issubclass(error, CcpinError)


def test_a_device_is_not_read():
    """A path that would never end is refused before it is read."""
    with pytest.raises(DescriptionNotFoundError, match="/dev/zero: neither a file nor a folder"):
        ccpin.load("/dev/zero")
