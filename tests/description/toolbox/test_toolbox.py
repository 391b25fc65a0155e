"""toolbox-parallel-robots: robot.yaml beside robot.urdf, against Pinocchio models built by hand."""

import numpy as np
import pinocchio as pin
import pytest

import ccpin
from ccpin.description import read_description
from ccpin.description.toolbox.reader import JOINT_TYPES
from ccpin.errors import DescriptionError, DescriptionNotFoundError, InvalidXmlError
from ccpin.kinematics.tree import build_tree


def link(name, mass=None):
    """A link, rod-like along x where it has mass."""
    if mass is None:
        return f'<link name="{name}"/>'
    return (
        f'<link name="{name}"><inertial><origin xyz="0.1 0.02 -0.03" rpy="0.3 0.1 0"/><mass value="{mass}"/>'
        f'<inertia ixx="0.01" ixy="0.001" ixz="0" iyy="0.02" iyz="0.002" izz="0.025"/></inertial></link>'
    )


def joint(name, kind, parent, child, xyz, rpy="0 0 0"):
    return (
        f'<joint name="{name}" type="{kind}"><origin xyz="{xyz}" rpy="{rpy}"/><parent link="{parent}"/>'
        f'<child link="{child}"/><axis xyz="0 0 1"/><limit lower="-4" upper="4" effort="1" velocity="1"/></joint>'
    )


# A spatial four-bar: crank 0.1, rod 0.35 long (its joint turned), rocker 0.3.
URDF = (
    '<robot name="bar">'
    + link("base")
    + link("crank", 0.5)
    + link("rod", 0.7)
    + link("rocker", 0.9)
    + link("end_A")
    + link("end_B")
    + joint("motor", "revolute", "base", "crank", "0 0 0", "0.2 0 0")
    + joint("ball", "revolute", "crank", "rod", "0.1 0 0", "0.4 -0.3 0.9")
    + joint("pivot", "revolute", "base", "rocker", "0.3 0 0", "0 0.1 1.2")
    + joint("end_A_frame", "fixed", "rod", "end_A", "0.35 0 0", "0 0 3.14159")
    + joint("end_B_frame", "fixed", "rocker", "end_B", "0.3 0 0.02")
    + "</robot>"
)
YAML = "closed_loop: [['end_A', 'end_B']]\ntype: ['3d']\nname_mot: ['motor']\n"
SPHERICAL = YAML + "joint_name: ['ball']\njoint_type: ['SPHERICAL']\n"


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "robot.urdf").write_text(URDF)
    (tmp_path / "robot.yaml").write_text(YAML)
    return tmp_path


def overridden(kind):
    """The URDF's tree in Pinocchio with the joint 'ball' of another type in the same place, built joint by joint."""
    original, model = pin.buildModelFromXML(URDF), pin.Model()
    axis_models = {"X": pin.JointModelRX, "Y": pin.JointModelRY, "Z": pin.JointModelRZ}
    for j in range(1, original.njoints):
        name, place = original.names[j], original.jointPlacements[j]
        parent = model.getJointId(original.names[original.parents[j]]) if original.parents[j] else 0
        if name != "ball":
            new = model.addJoint(parent, original.joints[j], place, name)
        elif kind == "SPHERICAL":
            new = model.addJoint(parent, pin.JointModelSpherical(), place, name)
        elif kind == "FIXED":
            model.appendBodyToJoint(parent, original.inertias[j], place)
            continue
        else:
            first = model.addJoint(parent, axis_models[kind[-2]](), place, f"{name}_{kind[-2]}")
            new = model.addJoint(first, axis_models[kind[-1]](), pin.SE3.Identity(), f"{name}_{kind[-1]}")
        model.appendBodyToJoint(new, original.inertias[j], pin.SE3.Identity())
    return model


@pytest.mark.parametrize("kind", JOINT_TYPES)
def test_an_override_gives_the_mass_matrix_and_gravity_of_the_joint_put_in_by_hand(folder, kind):
    """Same joint names, D′ and g′ as the Pinocchio tree with the joint exchanged."""
    (folder / "robot.yaml").write_text(YAML + f"joint_name: [ball]\njoint_type: [{kind}]\n")
    ours, theirs = build_tree(read_description(folder)).model, overridden(kind)
    assert list(ours.names) == list(theirs.names)
    generator = np.random.default_rng(3)
    for _ in range(5):
        q = pin.integrate(theirs, pin.neutral(theirs), generator.standard_normal(theirs.nv))
        np.testing.assert_allclose(
            pin.crba(ours, ours.createData(), q), pin.crba(theirs, theirs.createData(), q), atol=1e-14
        )
        np.testing.assert_allclose(
            pin.computeGeneralizedGravity(ours, ours.createData(), q),
            pin.computeGeneralizedGravity(theirs, theirs.createData(), q),
            atol=1e-13,
        )


@pytest.mark.parametrize("name", ["rod", "end_A", "motor", "ball", "end_A_frame", "pivot"])
def test_a_frame_named_by_link_or_joint_is_where_pinocchio_has_the_frame_of_that_name(folder, name):
    """Placement of either end of the closure = Pinocchio's own frame of that name."""
    other = "end_B" if name != "pivot" else "end_A"
    (folder / "robot.yaml").write_text(f"closed_loop: [[{name}, {other}]]\ntype: [6D]\nname_mot: [motor]\n")
    description = read_description(folder)
    closure, tree, model = description.closures[0], build_tree(description), pin.buildModelFromXML(URDF)
    q = np.array([0.3, -0.8, 1.1])
    data, ours = model.createData(), tree.model.createData()
    pin.framesForwardKinematics(model, data, q)
    pin.forwardKinematics(tree.model, ours, q)
    for frame, carrier, placement in (
        (name, closure.link_a, closure.placement_a),
        (other, closure.link_b, closure.placement_b),
    ):
        joint_id, local = tree.attachments[carrier].joint, tree.attachments[carrier].placement
        np.testing.assert_allclose(
            ours.oMi[joint_id].homogeneous @ local @ placement,
            data.oMf[model.getFrameId(frame)].homogeneous,
            atol=1e-14,
        )


@pytest.mark.parametrize(
    ("kind", "closure"),
    [("3d", "spherical"), ("3D", "spherical"), ("6d", "fixed"), ("6D", "fixed"), ("whatever", "fixed")],
)
def test_anything_but_3d_makes_the_frames_coincide(folder, kind, closure):
    """'3d' or '3D' is spherical, any other type fixed."""
    (folder / "robot.yaml").write_text(YAML.replace("3d", kind))
    assert [c.kind for c in read_description(folder).closures] == [closure]


@pytest.mark.parametrize(("kind", "idle"), [("SPHERICAL", 1), ("UJOINT_YZ", 0), ("UJOINT_ZY", 0)])
def test_the_mobility_is_that_of_the_rssr_and_rusr_linkages(folder, kind, idle):
    """RSSR: 5 − 3 = 2 with a rod that spins idly, and 1 with the spin locked; RUSR: 4 − 3 = 1."""
    (folder / "robot.yaml").write_text(YAML + f"joint_name: [ball]\njoint_type: [{kind}]\n")
    mechanism, free = ccpin.load(folder), ccpin.load(folder, free=["all"])
    assert (mechanism.n, len(mechanism.locked), len(mechanism.mobility.idle)) == (1, idle, 0)
    assert (free.n, len(free.locked), len(free.mobility.idle)) == (1 + idle, 0, idle)
    assert mechanism.actuated == ("motor",)
    assert "motor" in mechanism.independent


def test_the_folder_the_yaml_and_the_bare_urdf_with_closures_give_one_reduced_model(folder):
    """Three ways to say the same mechanism: equal D, C and g."""
    (folder / "robot.yaml").write_text(YAML + "joint_name: [ball]\njoint_type: [UJOINT_YZ]\n")
    closure = ccpin.LoopClosure("end_A_end_B", "spherical", "end_A", "end_B")
    bare = URDF.replace('<joint name="ball" type="revolute">', '<joint name="ball_Y" type="revolute">')
    bare = bare.replace('<child link="rod"/><axis xyz="0 0 1"/>', '<child link="mid"/><axis xyz="0 1 0"/>')
    bare = bare.replace("</robot>", link("mid") + joint("ball_Z", "revolute", "mid", "rod", "0 0 0") + "</robot>")
    (folder / "bare").mkdir()
    (folder / "bare" / "robot.urdf").write_text(bare)
    models = [
        ccpin.ReducedModel(mechanism)
        for mechanism in (
            ccpin.load(folder),
            ccpin.load(folder / "robot.yaml"),
            ccpin.load(folder / "bare" / "robot.urdf", closures=[closure], independent=["motor"]),
        )
    ]
    q = models[0].alpha(models[0].mechanism.q_reference)
    first = models[0].terms(q + 0.05, [0.7])
    for model in models[1:]:
        terms = model.terms(q + 0.05, [0.7], near=models[0].mechanism.q_reference)
        for mine, theirs in zip(terms, first, strict=True):
            np.testing.assert_allclose(mine, theirs, rtol=1e-9, atol=1e-12)


def test_the_yaml_names_what_it_leaves_out(folder):
    """Unread keys and an absent list of types end up in the notes."""
    (folder / "robot.yaml").write_text("closed_loop: [[end_A, end_B]]\nname_mot: [motor]\nfreeflyer: false\n")
    notes = " ".join(read_description(folder).notes)
    assert "'freeflyer' is not read" in notes
    assert "taken as 6d" in notes


def test_a_lone_urdf_of_another_name_is_taken_and_two_are_refused(folder):
    """robot.urdf, or the only *.urdf there; otherwise an error that lists them."""
    (folder / "robot.urdf").rename(folder / "bar.urdf")
    assert read_description(folder).name == "bar"
    (folder / "other.urdf").write_text(URDF)
    with pytest.raises(DescriptionNotFoundError, match=r"bar\.urdf, other\.urdf"):
        read_description(folder)
    for name in ("bar", "other"):
        (folder / f"{name}.urdf").unlink()
    with pytest.raises(DescriptionNotFoundError, match=r"robot\.yaml: needs its robot\.urdf"):
        read_description(folder)


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("'end_B'", "'nowhere'", "frame 'nowhere'.*neither a link nor a joint"),
        ("'end_B'", "", "closed_loop: not a list of pairs"),
        ("'end_B'", "'end_B', 'rod'", "closed_loop: not a list of pairs"),
        ("'end_B'", "['end_B']", "closed_loop: not a list of names"),
        ("'end_B'", "'end_A'", "to itself"),
        ("['3d']", "['3d', '6d']", "type: has 2 entries where closed_loop has 1"),
        ("['3d']", "3d", "type: not a list of names"),
        ("['motor']", "['motor', 'ghost']", "name_mot: ghost: not among the movable joints, which are motor, ball"),
        ("['motor']", "['end_A_frame']", "name_mot: end_A_frame: not among the movable joints"),
        ("['motor']", "['motor', 'motor']", "name_mot: motor named more than once"),
        ("'ball'", "'ghost'", "'ghost': is not a joint"),
        ("'ball'", "'end_A_frame'", "'end_A_frame': is fixed in the URDF"),
        ("'SPHERICAL'", "'BALL'", "'BALL' is not one of SPHERICAL, FIXED, UJOINT_XY"),
        ("'SPHERICAL'", "'UJOINT_XX'", "'UJOINT_XX' is not one of"),
        ("'SPHERICAL'", "'FIXED', 'FIXED'", "joint_type: has 2 entries where joint_name has 1"),
        ("joint_type", "joint_kind", "joint_type: has 0 entries where joint_name has 1"),
        ("closed_loop", "loops", "closed_loop"),
    ],
)
def test_a_contradiction_is_refused_with_its_file_and_key(folder, old, new, complaint):
    """Each mistake raises a DescriptionError naming robot.yaml, the key or name, and what would be right."""
    assert old in SPHERICAL
    (folder / "robot.yaml").write_text(SPHERICAL.replace(old, new))
    with pytest.raises(DescriptionError, match=rf"robot\.yaml: (?s:.*){complaint}"):
        read_description(folder, format="toolbox")


def test_a_name_that_is_a_link_and_another_links_joint_is_ambiguous(folder):
    """A joint called like a link it does not carry: refused rather than guessed."""
    (folder / "robot.urdf").write_text(URDF.replace('joint name="pivot"', 'joint name="rod"'))
    (folder / "robot.yaml").write_text("closed_loop: [[rod, end_B]]\ntype: [3d]\nname_mot: []\n")
    with pytest.raises(DescriptionError, match=r"'rod': is a link and a joint with another child \('rocker'\)"):
        read_description(folder)


BOMB = "closed_loop: &a0 [x, x]\n" + "".join(f"k{i}: &a{i} [*a{i - 1}, *a{i - 1}]\n" for i in range(1, 30))


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (BOMB, "line 1: anchors and aliases are refused"),
        ("closed_loop: " + "[" * 60000, "nested more than 8 deep"),
        ("closed_loop: " + "a" * 200_000, "larger than 131072 bytes"),
        ("closed_loop: !!python/object/apply:os.system ['true']\n", "tag .*os.system.* is refused"),
        ("closed_loop: [[a, b]\ntype: {", "not well-formed YAML"),
        ("closed_loop: {[a, b]: c}\n", "not well-formed YAML"),
        ("closed_loop: \x07\n", "not well-formed YAML"),
    ],
)
def test_hostile_yaml_is_refused(folder, text, complaint):
    """Alias bombs, depth, size, object construction and malformed text raise InvalidXmlError."""
    (folder / "robot.yaml").write_text(text)
    with pytest.raises(InvalidXmlError, match=rf"robot\.yaml: .*{complaint}"):
        read_description(folder)


def test_what_the_urdf_says_of_an_overridden_joint_no_longer_applies(folder):
    """Rotor inertia (noted), marks and the reference value of an overridden joint are given up."""
    extra = (
        '<transmission name="t"><joint name="ball"/><actuator name="m"><rotor_inertia value="0.1"/></actuator>'
        '</transmission><group_state name="reference"><joint name="ball" value="0.2"/><joint name="motor" value="0.1"/>'
        "</group_state></robot>"
    )
    (folder / "robot.urdf").write_text(URDF.replace("</robot>", extra))
    (folder / "robot.yaml").write_text(SPHERICAL)
    description = read_description(folder)
    assert description.reference == {"motor": (0.1,)}
    assert all(j.armature == 0 for j in description.joints)
    assert any("'ball' becomes SPHERICAL and loses its rotor inertia" in note for note in description.notes)
