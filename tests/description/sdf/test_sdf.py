"""SDFormat: the four-bar equals its URDF+ twin, every joint type its closed form, and nothing is lost in silence."""

from __future__ import annotations

from itertools import permutations
from typing import ClassVar

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import ccpin
from ccpin.errors import AmbiguousFormatError, DescriptionError
from tests.support.reading import read_urdf
from tests.support.sdf_files import (
    FOUR_BAR_JOINTS,
    ROCKER,
    four_bar,
    four_bar_links,
    four_bar_urdf,
    joint,
    link,
    model,
    read,
)


def reduced(description, q=0.15, v=0.7, u=0.3, **options):
    """D, C v, g and q̈ of the reduced model whose q is joint A."""
    mechanism = ccpin.load(description, independent=["A"], actuated=["A"], **options)
    state = ccpin.ReducedModel(mechanism).at([q])
    return np.concatenate([state.D.ravel(), (state.C([v]) @ [v]), state.g, state.forward_dynamics([v], [u])])


TWIN = reduced(read_urdf(four_bar_urdf().encode(), None))


class TestFourBar:
    """The reduced dynamics of the file equal those of its URDF+ twin, however the graph is written."""

    def test_reduced_dynamics_are_those_of_the_urdf_twin(self):
        """D, C v, g and q̈ to rounding."""
        assert np.allclose(reduced(read(four_bar())), TWIN, rtol=1e-10, atol=1e-12)

    @pytest.mark.parametrize("order", list(permutations(range(4))))
    def test_the_order_of_joints_does_not_change_the_mechanism(self, order):
        """Whichever joint closes the loop: the crank's angle, where it is a joint, obeys the same equation."""
        description = read(four_bar([FOUR_BAR_JOINTS[k] for k in order]))
        assert len(description.closures) == 1
        if description.closures[0].name != "A":
            assert np.allclose(reduced(description), TWIN, rtol=1e-9, atol=1e-11)

    def test_the_first_joint_in_file_order_that_reaches_a_link_is_in_the_tree(self):
        """The rule, on the order as written and on the reverse."""
        assert [closure.name for closure in read(four_bar()).closures] == ["C"]
        backwards = read(four_bar(FOUR_BAR_JOINTS[::-1]))
        assert [closure.name for closure in backwards.closures] == ["D"]

    def test_a_joint_marked_as_a_loop_joint_is_cut(self):
        """physics/simbody/must_be_loop_joint chooses the cut."""
        marked = joint(
            "B",
            "revolute",
            "crank",
            "coupler",
            more="<physics><simbody><must_be_loop_joint>1</must_be_loop_joint></simbody></physics>",
        )
        description = read(four_bar((FOUR_BAR_JOINTS[0], marked, *FOUR_BAR_JOINTS[2:])))
        assert [closure.name for closure in description.closures] == ["B"]
        assert np.allclose(reduced(description), TWIN, rtol=1e-9, atol=1e-11)

    def test_parent_and_child_exchanged_turn_the_angle_round(self):
        """Seen from the other side a hinge turns the other way: −θ."""
        swapped = joint("A", "revolute", "crank", "ground", pose='<pose relative_to="crank"/>')
        D, cv, g, a = TWIN
        text = four_bar((swapped, *FOUR_BAR_JOINTS[1:]), attributes='canonical_link="ground"')
        there = reduced(read(text), q=-0.15, v=-0.7, u=-0.3)
        assert np.allclose(there, (D, -cv, -g, -a), rtol=1e-9, atol=1e-11)

    def test_the_world_as_parent_and_as_child(self):
        """The ground is the world: crank and rocker hang on it, one of them the other way round."""
        a, d = (joint(n, "revolute", "world", c) for n, c in (("A", "crank"), ("D", "rocker")))
        links = four_bar_links().replace(link("ground"), "")
        for ground in ((a, d), (a, joint("D", "revolute", "rocker", "world", pose='<pose relative_to="rocker"/>'))):
            text = model(links, ground[0], FOUR_BAR_JOINTS[1], ground[1], FOUR_BAR_JOINTS[3])
            description = read(text)
            assert description.root == "world"
            assert np.allclose(reduced(description), TWIN, rtol=1e-9, atol=1e-11)

    @pytest.mark.parametrize("extra", ["<dynamics><damping>0.1</damping></dynamics>", ""])
    def test_a_closing_joint_with_a_force_of_its_own_stays_a_joint(self, extra):
        """The massless link welded to the child is exactly the same mechanism, and keeps the damping."""
        closing = joint("C", "revolute", "coupler", "rocker", pose=f"<pose>{ROCKER} 0 0 0 0 0</pose>", extra=extra)
        description = read(four_bar((*FOUR_BAR_JOINTS[:3], closing)))
        kept = {j.name: j for j in description.joints}
        assert ("C" in kept) == bool(extra)
        if extra:
            assert kept["C"].damping == 0.1
            assert description.closures[0].kind == "fixed"
        assert np.allclose(reduced(description)[:3], TWIN[:3], rtol=1e-9, atol=1e-11)

    def test_damping_and_spring_of_a_joint_act_alike_in_the_tree_and_closing_the_loop(self):
        """q̈ does not depend on which joint the order makes the closing one, and is not that of the free linkage."""
        forces = "<dynamics><damping>0.3</damping><spring_stiffness>2</spring_stiffness><spring_reference>0.4"
        forces += "</spring_reference></dynamics>"
        C = joint("C", "revolute", "coupler", "rocker", pose=f"<pose>{ROCKER} 0 0 0 0 0</pose>", extra=forces)
        a, b, d = FOUR_BAR_JOINTS[:3]
        closing, inside = read(four_bar((a, b, d, C))), read(four_bar((a, b, C, d)))
        assert [c.name for c in closing.closures] == ["C"]
        assert [c.name for c in inside.closures] == ["D"]
        assert np.allclose(reduced(closing), reduced(inside), rtol=1e-9, atol=1e-11)
        assert abs(reduced(inside)[3] - TWIN[3]) > 1

    def test_a_model_pose_turns_gravity(self):
        """A model laid on its side by its <pose> feels gravity across: the twin under turned gravity."""
        turned = four_bar().replace('<model name="four_bar" >', '<model name="four_bar"><pose>1 2 3 1.2 0.4 0</pose>')
        mechanism = ccpin.load(read(turned), independent=["A"])
        turn = Rotation.from_euler("xyz", [1.2, 0.4, 0.0]).as_matrix()
        twin = ccpin.load(read_urdf(four_bar_urdf().encode(), None), independent=["A"])
        there = ccpin.ReducedModel(twin, gravity=turn.T @ [0, 0, -9.81]).at([0.15])
        assert np.allclose(ccpin.ReducedModel(mechanism).at([0.15]).g, there.g, rtol=1e-10)


def gearbox(ratio=""):
    """Two bodies geared from a base, about upright axes."""
    more = f"<axis2><xyz>0 0 1</xyz></axis2>{ratio}<gearbox_reference_body>base</gearbox_reference_body>"
    return joint("gear", "gearbox", "one", "two", axis="0 0 1", more=more)


def single(kind, *, more="", axis="0 0 1", extra="", **body):
    """One body on the world by a joint at the origin."""
    return model(link("body", **body), joint("j", kind, "world", "body", axis=axis, extra=extra, more=more))


class TestJointTypes:
    """Every type against its closed form."""

    @pytest.mark.parametrize(
        ("said", "lead"),
        [
            ("<screw_thread_pitch>0.5</screw_thread_pitch>", 0.5 / (2 * np.pi)),
            ("<thread_pitch>-12.5</thread_pitch>", 1 / 12.5),
            ("", -1.0),
        ],
    )
    def test_a_screw_falls_as_its_lead_says(self, said, lead):
        """θ̈ = −m g p / (I + m p²) for a screw along the vertical, z = p θ."""
        description = read(single("screw", more=said, mass=2.0, moments=(0.1, 0.1, 0.3)))
        mechanism = ccpin.load(description, independent=["j"])
        state = ccpin.ReducedModel(mechanism).at([0.4])
        expected = -2.0 * 9.81 * lead / (0.3 + 2.0 * lead**2)
        assert np.allclose(state.forward_dynamics([0.7], [0.0]), expected)
        assert np.isclose(state.q_free[1], 0.4 * lead)

    def test_a_gearbox_couples_two_hinges(self):
        """θ₂ = −ratio θ₁, so (I₁ + ratio² I₂) θ̈₁ = u."""
        text = model(
            link("base"),
            link("one", moments=(0.1, 0.1, 0.4)),
            link("two", "<pose>1 0 0 0 0 0</pose>", moments=(0.1, 0.1, 0.05)),
            joint("j1", "revolute", "base", "one", axis="0 0 1"),
            joint("j2", "revolute", "base", "two", axis="0 0 -1"),
            gearbox("<gearbox_ratio>3</gearbox_ratio>"),
        )
        model_ = ccpin.ReducedModel(ccpin.load(read(text), independent=["j1"]))
        assert np.allclose(model_.at([0.2]).forward_dynamics([0.0], [1.0]), 1 / (0.4 + 9 * 0.05))
        assert np.allclose(model_.at([0.2]).q_free, [0.2, 0.6])  # j2's own axis points down: +3 θ₁
        short = read(text.replace("<axis2><xyz>0 0 1</xyz></axis2>", ""))
        assert short.couplings == read(text).couplings
        assert any("no <axis2>" in note for note in short.notes)

    def test_a_gearbox_without_hinges_is_refused_by_name(self):
        """Nothing turns one body in the other about the axis."""
        text = model(
            link("base"),
            link("one"),
            joint("j1", "prismatic", "base", "one", axis="0 0 1"),
            link("two"),
            joint("j2", "revolute", "base", "two", axis="0 0 1"),
            gearbox(),
        )
        with pytest.raises(DescriptionError, match=r"joint 'gear'.*cannot be expressed"):
            read(text)

    def test_a_universal_joint_is_two_hinges(self):
        """R = R(axis, θ₁) R(axis2, θ₂) in the joint's frame."""
        description = read(single("universal", axis="1 0 0", more="<axis2><xyz>0 1 0</xyz></axis2>"))
        movable = [j for j in description.joints if j.kind != "fixed"]
        assert [(j.name, j.kind, tuple(j.axis)) for j in movable] == [
            ("j.1", "revolute", (1.0, 0.0, 0.0)),
            ("j.2", "revolute", (0.0, 1.0, 0.0)),
        ]

    @pytest.mark.parametrize(
        ("kind", "more", "closure", "rows"),
        [
            ("ball", "", "spherical", 3),
            ("fixed", "", "fixed", 6),
            ("prismatic", "", "prismatic", 5),
            ("continuous", "", "revolute", 5),
            ("universal", "<axis2><xyz>1 0 0</xyz></axis2>", "universal", 4),
            ("revolute2", "<axis2><xyz>1 1 0</xyz></axis2>", "fixed", 6),
            ("screw", "<screw_thread_pitch>0.1</screw_thread_pitch>", "fixed", 6),
        ],
    )
    def test_a_closing_joint_leaves_free_what_its_type_does(self, kind, more, closure, rows):
        """A body that floats on six joints, tied to the world by one more: as mobile as that joint."""
        axes = [("prismatic", a) for a in ("1 0 0", "0 1 0", "0 0 1")] + [
            ("revolute", a) for a in ("1 0 0", "0 1 0", "0 0 1")
        ]
        parts, parent = [], "world"
        for k, (step, axis) in enumerate(axes):
            parts += [link(f"l{k}"), joint(f"j{k}", step, parent, f"l{k}", axis=axis)]
            parent = f"l{k}"
        closing = joint("tie", kind, "world", parent, axis="" if kind in ("ball", "fixed") else "0 1 0", more=more)
        description = read(model(*parts, closing))
        assert [c.kind for c in description.closures] == [closure]
        freedom = {"ball": 3, "fixed": 0, "universal": 2, "revolute2": 2}.get(kind, 1)
        if freedom:
            assert ccpin.load(description, free=["all"]).n == freedom

    def test_limits_forces_and_springs_are_read(self):
        """Every number of an axis; 1e16 and more is no limit, a negative effort neither."""
        extra = (
            "<limit><lower>-1.5</lower><upper>1e16</upper><effort>-1</effort><velocity>3</velocity></limit>"
            "<dynamics><damping>0.1</damping><friction>0.2</friction><spring_stiffness>4</spring_stiffness>"
            "<spring_reference>0.5</spring_reference></dynamics>"
        )
        j = read(single("revolute", extra=extra)).joints[0]
        assert (j.lower, j.upper, j.effort, j.velocity) == (-1.5, np.inf, np.inf, 3.0)
        assert (j.damping, j.friction, j.stiffness, j.spring_reference) == (0.1, 0.2, 4.0, 0.5)

    def test_a_mimic_axis_is_a_coupling(self):
        """θ = multiplier (θ_leader − reference) + offset, solved at θ_leader = 0.7."""
        mimic = '<mimic joint="a"><multiplier>2</multiplier><offset>0.1</offset><reference>0.3</reference></mimic>'
        text = model(
            link("one"),
            link("two"),
            joint("a", "revolute", "world", "one"),
            joint("b", "revolute", "one", "two", extra=mimic),
        )
        state = ccpin.ReducedModel(ccpin.load(read(text), independent=["a"])).at([0.7])
        assert np.allclose(state.q_free, [0.7, 2 * (0.7 - 0.3) + 0.1])


class TestFrames:
    """Poses relative to frames, joints and nested models; axes expressed elsewhere."""

    def test_poses_follow_the_frames_they_name(self):
        """base → frame f (turned) → link → joint → link, against transforms multiplied by hand."""
        text = model(
            link("base", "<pose>1 0 0 0 0 0.5</pose>"),
            '<frame name="f" attached_to="base"><pose>0 1 0 0.3 0 0</pose></frame>',
            link("arm", '<pose relative_to="f">0 0 1 0 0.2 0</pose>'),
            joint("j", "revolute", "f", "arm", pose='<pose relative_to="base">0 0 2 0 0 0</pose>', axis="0 0 1"),
            link("hand", '<pose relative_to="j">0.1 0 0 0 0 0</pose>'),
            joint("k", "fixed", "arm", "hand", axis=""),
            name="frames",
        )
        poses = zero_poses(read(text))

        def T(x, y, z, *rpy):
            frame = np.eye(4)
            frame[:3, :3], frame[:3, 3] = Rotation.from_euler("xyz", rpy).as_matrix(), (x, y, z)
            return frame

        base = T(1, 0, 0, 0, 0, 0.5)
        assert np.allclose(poses["base"], base)
        assert np.allclose(poses["arm"], base @ T(0, 1, 0, 0.3, 0, 0) @ T(0, 0, 1, 0, 0.2, 0))
        assert np.allclose(poses["hand"], base @ T(0, 0, 2, 0, 0, 0) @ T(0.1, 0, 0, 0, 0, 0))

    @pytest.mark.parametrize(
        ("version", "said", "expected"),
        [
            ("1.9", "<xyz>1 0 0</xyz>", (1, 0, 0)),
            ("1.4", "<xyz>1 0 0</xyz>", (0, -1, 0)),
            ("1.6", "<xyz>1 0 0</xyz><use_parent_model_frame>true</use_parent_model_frame>", (0, -1, 0)),
            ("1.4", "<xyz>1 0 0</xyz><use_parent_model_frame>0</use_parent_model_frame>", (1, 0, 0)),
            ("1.9", '<xyz expressed_in="__model__">1 0 0</xyz>', (0, -1, 0)),
        ],
    )
    def test_an_axis_is_stated_in_the_joints_frame_or_the_models(self, version, said, expected):
        """The link is turned by 90° about z: model x is −y of the joint's frame."""
        quarter = f"<pose>0 0 0 0 0 {np.pi / 2!r}</pose>"
        text = model(
            link("body", quarter),
            f'<joint name="j" type="revolute"><parent>world</parent><child>body</child><axis>{said}</axis></joint>',
            version=version,
        )
        assert np.allclose(read(text).joints[0].axis, expected)

    def test_quaternions_and_degrees(self):
        """The same pose in three spellings."""
        x, y, z, w = Rotation.from_euler("xyz", [10, 20, 30], degrees=True).as_quat()
        spellings = (
            f"<pose>1 2 3 {np.radians(10)} {np.radians(20)} {np.radians(30)}</pose>",
            '<pose degrees="true">1 2 3 10 20 30</pose>',
            f'<pose rotation_format="quat_xyzw">1 2 3 {x} {y} {z} {w}</pose>',
        )
        found = [
            zero_poses(read(model(link("l", said), joint("j", "ball", "world", "l", axis=""))))["l"]
            for said in spellings
        ]
        assert np.allclose(found[0], found[1])
        assert np.allclose(found[0], found[2])

    def test_nested_models_keep_their_names_and_places(self):
        """A nested model placed by one of its frames."""
        inner = (
            '<model name="arm" placement_frame="foot"><pose>5 0 0 0 0 0</pose>'
            + link("l", "<pose>1 0 0 0 0 0</pose>")
            + '<frame name="foot" attached_to="l"><pose>0 0 -1 0 0 0</pose></frame></model>'
        )
        text = model(link("base"), inner, joint("j", "revolute", "base", "arm::l"))
        description = read(text)
        assert [found.name for found in description.links] == ["base", "arm::l"]
        assert np.allclose(zero_poses(description)["arm::l"][:3, 3], [5, 0, 1])

    def test_models_nested_too_deep_and_poses_too_far_in_a_row_are_refused(self):
        """Never a RecursionError; a long chain in file order is none of them."""
        deep = "".join(f'<model name="m{k}">' for k in range(100)) + link("l") + 100 * "</model>"
        with pytest.raises(DescriptionError, match="nested more than 50"):
            read(model(deep))
        chain = [link(f"l{k}", f'<pose relative_to="l{k - 1}">0 0 1 0 0 0</pose>' if k else "") for k in range(400)]
        hinges = [joint(f"j{k}", "revolute", f"l{k}", f"l{k + 1}") for k in range(399)]
        assert np.allclose(zero_poses(read(model(*chain, *hinges)))["l399"][:3, 3], [0, 0, 399])
        with pytest.raises(DescriptionError, match="200 poses in a row"):
            read(model(*chain[::-1], *hinges))

    def test_a_joint_may_name_frames_joints_and_models(self):
        """Each stands for the link that carries it."""
        inner = '<model name="arm">' + link("l") + '<frame name="f" attached_to="l"/></model>'
        for child in ("arm", "arm::f", "arm::l"):
            assert (
                read(model(link("base"), inner, joint("j", "ball", "base", child, axis=""))).joints[0].child == "arm::l"
            )

    @pytest.mark.parametrize(
        ("parts", "message"),
        [
            (
                ['<frame name="a"><pose relative_to="b"/></frame><frame name="b"><pose relative_to="a"/></frame>'],
                "circle",
            ),
            (['<frame name="a" attached_to="a"/>', joint("j", "ball", "a", "l", axis="")], "circle"),
            ([link("l2", '<pose relative_to="nowhere"/>')], "no 'nowhere'"),
            ([joint("j", "ball", "nowhere", "l", axis="")], "no 'nowhere'"),
            ([joint("j", "ball", "l", "l", axis="")], "to itself"),
            ([link("l")], "used twice"),
            ([link("__x__")], "reserved"),
            ([joint("j", "hinge", "world", "l")], "'hinge' is not one of"),
            ([joint("j", "revolute", "world", "l", axis="0 0 0")], "zero vector"),
            ([joint("j", "universal", "world", "l")], "<axis2> is missing"),
            (
                [joint("j", "revolute", "world", "l", extra="<dynamics><dampng>1</dampng></dynamics>")],
                "did you mean 'damping'",
            ),
            ([joint("j", "revolute", "world", "l", extra="<limit><lower>x</lower></limit>")], "'x' is not numeric"),
            ([joint("j", "revolute", "world", "l", extra='<mimic joint="none"/>')], "no joint 'none'"),
        ],
    )
    def test_what_is_wrong_is_refused_by_name(self, parts, message):
        """The message says what."""
        with pytest.raises(DescriptionError, match=message):
            read(model(link("l"), *parts))


def zero_poses(description):
    """Every link's frame in the root's at zero displacement."""
    poses = {description.root: np.eye(4)}
    joints = list(description.joints)
    while joints:
        for j in [j for j in joints if j.parent in poses]:
            poses[j.child] = poses[j.parent] @ j.placement
            joints.remove(j)
    return poses


class TestFiles:
    """Worlds, includes, several models, folders."""

    def test_the_format_is_found_from_the_content(self, tmp_path):
        """A file of any name, and the folder of a model with its model.config."""
        (tmp_path / "robot.txt").write_text(four_bar())
        assert ccpin.load(tmp_path / "robot.txt").n == 1
        assert ccpin.load(tmp_path / "robot.txt", format="sdf").n == 1
        folder = tmp_path / "bars"
        folder.mkdir()
        (folder / "bars-1.sdf").write_text(four_bar())
        (folder / "model.config").write_text("<model><sdf version='1.9'>bars-1.sdf</sdf></model>")
        assert ccpin.load(folder).name == "four_bar"
        with pytest.raises(AmbiguousFormatError, match="<sdf>"):
            ccpin.load(_written(tmp_path / "x.xml", "<nothing/>"))

    def test_a_world_with_one_robot_and_a_ground(self, tmp_path):
        """The static model is passed over, gravity is the world's, the model stands where the world puts it."""
        body = four_bar().partition('version="1.9">')[2].removesuffix("</sdf>")
        ground = '<model name="floor"><static>true</static><link name="l"/></model>'
        world = f'<sdf version="1.9"><world name="w"><gravity>0 0 -1.6</gravity>{ground}{body}</world></sdf>'
        description = read(world)
        assert (description.name, description.gravity) == ("four_bar", (0.0, 0.0, -1.6))
        twice = world.replace("</world>", body.replace("four_bar", "other") + "</world>")
        with pytest.raises(DescriptionError, match="'four_bar', 'other'"):
            read(twice)
        assert read(twice, model="other").name == "other"
        with pytest.raises(DescriptionError, match="not exactly one 'none'"):
            read(twice, model="none")

    def test_what_stands_in_a_world_beside_its_models(self):
        """Joints between models are told, several worlds refused."""
        body = four_bar().partition('version="1.9">')[2].removesuffix("</sdf>")
        tie = joint("tie", "fixed", "four_bar::ground", "four_bar::crank", axis="")
        world = f'<sdf version="1.11"><world name="w">{body}{tie}</world></sdf>'
        assert any("between the world's models" in note for note in read(world).notes)
        with pytest.raises(DescriptionError, match="several worlds"):
            read(world.replace("</sdf>", '<world name="v"/></sdf>'))

    def test_includes_are_placed_named_and_merged(self, tmp_path):
        """An include beside the file, under another name and pose, and one merged into the model around it."""
        folder = tmp_path / "bar"
        folder.mkdir()
        (folder / "model.sdf").write_text(model(link("l", "<pose>0 0 1 0 0 0</pose>"), name="bar"))
        text = model(
            "<include><uri>model://bar</uri><name>left</name><pose>1 0 0 0 0 0</pose></include>",
            '<include merge="true"><uri>bar</uri><pose>2 0 0 0 0 0</pose></include>',
            joint("a", "revolute", "world", "left::l"),
            joint("b", "revolute", "world", "l"),
        )
        description = ccpin.description.read_description(_written(tmp_path / "robot.sdf", text))
        poses = zero_poses(description)
        assert np.allclose(poses["left::l"][:3, 3], [1, 0, 1])
        assert np.allclose(poses["l"][:3, 3], [2, 0, 1])

    def test_includes_stay_inside_the_folder_unless_one_is_allowed(self, tmp_path):
        """A file beside the folder is refused; include_root allows it, and nothing above it."""
        for name in ("bar", "robot"):
            (tmp_path / "models" / name).mkdir(parents=True)
        _written(tmp_path / "models" / "bar" / "model.sdf", model(link("l"), name="bar"))
        _written(tmp_path / "out.sdf", model(link("l"), name="out"))
        tie = joint("j", "revolute", "world", "bar::l")
        for uri in ("model://bar", "../bar", "file://../bar/model.sdf"):
            file = _written(
                tmp_path / "models" / "robot" / "model.sdf", model(f"<include><uri>{uri}</uri></include>", tie)
            )
            with pytest.raises(DescriptionError, match="include_root"):
                ccpin.description.read_description(file)
            assert ccpin.description.read_description(file, include_root=tmp_path / "models").links
        outside = model("<include><uri>../../out.sdf</uri></include>", tie)
        file = _written(tmp_path / "models" / "robot" / "model.sdf", outside)
        with pytest.raises(DescriptionError, match="outside models/"):
            ccpin.description.read_description(file, include_root=tmp_path / "models")

    @pytest.mark.parametrize("uri", ["https://fuel.gazebosim.org/1.0/x", "/etc/passwd", "", "..", "model://nothing"])
    def test_includes_that_are_not_files_here_are_refused(self, uri, tmp_path):
        """By name, and nothing is fetched."""
        file = _written(tmp_path / "robot.sdf", model(link("l"), f"<include><uri>{uri}</uri></include>"))
        with pytest.raises(DescriptionError, match=r"include|uri"):
            ccpin.description.read_description(file)

    def test_a_circle_of_includes_ends(self, tmp_path):
        """A file that includes itself."""
        file = _written(tmp_path / "robot.sdf", model(link("l"), "<include><uri>robot.sdf</uri></include>"))
        with pytest.raises(DescriptionError, match="circle"):
            ccpin.description.read_description(file)


def _written(path, text):
    path.write_text(text)
    return path


class TestNotes:
    """What is dropped or assumed is told."""

    def test_every_loss_has_its_note(self):
        """Sensors, plugins, contacts, missing inertials, limits of closing joints, gravity of single links."""
        closing = joint(
            "C",
            "revolute",
            "coupler",
            "rocker",
            pose=f"<pose>{ROCKER} 0 0 0 0 0</pose>",
            extra="<limit><lower>-1</lower><upper>1</upper></limit>",
        )
        text = four_bar((*FOUR_BAR_JOINTS[:3], closing)).replace(
            "</model>",
            '<plugin name="p" filename="f"><sensor/></plugin><link name="bare"><collision name="c"/>'
            "<gravity>0</gravity></link>" + joint("b", "fixed", "ground", "bare", axis="") + "</model>",
        )
        notes = "\n".join(read(text).notes)
        for part in ("1 plugins", "collision shapes", "'bare' states no <inertial>", "'C': its limits", "for bare"):
            assert part in notes

    def test_no_link_heavy_means_no_gravity(self):
        """Every <gravity> off is a mechanism without weight."""
        text = single("revolute").replace("<inertial>", "<gravity>false</gravity><inertial>")
        assert read(text).gravity == (0.0, 0.0, 0.0)

    def test_a_free_body_is_said_to_be_one(self):
        """What no joint holds floats."""
        description = read(model(link("l"), joint("j", "revolute", "world", "l"), link("stone")))
        assert next((j.name, j.kind) for j in description.joints) == ("stone.free", "floating")
        assert any("free body" in note for note in description.notes)

    def test_a_static_model_is_refused(self):
        """Nothing in it moves."""
        with pytest.raises(DescriptionError, match="static"):
            read(four_bar().replace("<link", "<static>1</static><link", 1))

    def test_inertia_is_turned_into_link_axes_and_has_the_formats_defaults(self):
        """R I Rᵀ about the centre of mass; where nothing is said 1 kg and 1 kg m²."""
        description = read(
            model(
                link("l", com=(1, 2, 3), rpy=(0.3, 0.2, 0.1)),
                '<link name="bare"/>',
                joint("j", "ball", "l", "bare", axis=""),
            )
        )
        said, bare = description.links[0].inertia, description.links[1].inertia
        turn = Rotation.from_euler("xyz", [0.3, 0.2, 0.1]).as_matrix()
        assert np.allclose(said.rotational, turn @ np.diag([0.01, 0.02, 0.03]) @ turn.T)
        assert np.allclose(said.com, [1, 2, 3])
        assert (bare.mass, bare.rotational.tolist()) == (1.0, np.eye(3).tolist())
        with pytest.raises(DescriptionError, match="auto inertia"):
            read(model(link("l").replace("<inertial>", '<inertial auto="true">')))


def test_visuals_are_read(tmp_path):
    """Every shape, its colour and a mesh beside the file by each scheme."""
    (tmp_path / "m.stl").write_text("solid")
    shapes = {
        "box": "<size>1 2 3</size>",
        "cylinder": "<radius>1</radius><length>2</length>",
        "sphere": "<radius>1</radius>",
        "capsule": "<radius>1</radius><length>2</length>",
        "ellipsoid": "<radii>1 2 3</radii>",
    }
    visuals = "".join(
        f'<visual name="{kind}"><pose>0 0 1 0 0 0</pose><geometry><{kind}>{size}</{kind}></geometry>'
        "<material><diffuse>1 0 0 0.5</diffuse></material></visual>"
        for kind, size in shapes.items()
    )
    meshes = "".join(
        f'<visual name="{k}"><geometry><mesh><uri>{uri}</uri><scale>2 2 2</scale></mesh></geometry></visual>'
        for k, uri in enumerate(
            (f"model://{tmp_path.name}/m.stl", "m.stl", "file://m.stl", f"package://{tmp_path.name}/m.stl")
        )
    )
    text = model(f'<link name="l">{visuals}{meshes}</link>', joint("j", "ball", "world", "l", axis=""))
    body = ccpin.description.read_description(_written(tmp_path / "r.sdf", text)).links[1]
    assert [v.shape.kind for v in body.visuals] == [*shapes, *4 * ["mesh"]]
    assert [v.shape.size for v in body.visuals[:2]] == [(1.0, 2.0, 3.0), (1.0, 2.0)]
    assert body.visuals[0].rgba == (1.0, 0.0, 0.0, 0.5)
    assert {v.shape.mesh for v in body.visuals[5:]} == {str(tmp_path / "m.stl")}


def test_onshape_frames_close_loops():
    """A pair of closing frames, attached or only placed relative to a link, is a closure at their origins."""
    coupler, rocker = (
        f'<frame name="closing_tip_{k}"><pose relative_to="{on}">{x} 0 0 0 0 0</pose></frame>'
        for k, on, x in ((1, "coupler", 0.35), (2, "rocker", ROCKER))
    )
    description = read(model(four_bar_links(), *FOUR_BAR_JOINTS[:3], coupler, rocker))
    assert [(c.kind, c.link_a, c.link_b) for c in description.closures] == [("spherical", "coupler", "rocker")]
    assert np.allclose(reduced(description), TWIN, rtol=1e-9, atol=1e-11)
    assert any("onshape-to-robot" in note for note in description.notes)


class TestDrake:
    """The constraints Drake puts into SDFormat files."""

    @pytest.mark.parametrize(
        ("constraint", "kind"),
        [
            ("<drake:weld_constraint><parent>c1</parent><child>c2</child></drake:weld_constraint>", "fixed"),
            (
                "<drake:ball_constraint><drake:ball_constraint_body_A>coupler</drake:ball_constraint_body_A>"
                "<drake:ball_constraint_body_B>rocker</drake:ball_constraint_body_B>"
                "<drake:ball_constraint_p_AP>0.35 0 0</drake:ball_constraint_p_AP>"
                f"<drake:ball_constraint_p_BQ>{ROCKER} 0 0</drake:ball_constraint_p_BQ></drake:ball_constraint>",
                "spherical",
            ),
        ],
    )
    def test_weld_and_ball(self, constraint, kind):
        """A ball at the tip is the twin's hinge; a weld fixes frames to each other."""
        frames = (
            '<frame name="c1" attached_to="coupler"><pose>0.35 0 0 0 0 0</pose></frame>'
            f'<frame name="c2" attached_to="rocker"><pose>{ROCKER} 0 0 0 0 0</pose></frame>'
        )
        description = read(model(four_bar_links(), frames, *FOUR_BAR_JOINTS[:3], constraint))
        assert [c.kind for c in description.closures] == [kind]
        assert np.allclose(description.closures[0].placement_a[:3, 3], [0.35, 0, 0])
        if kind == "spherical":
            assert np.allclose(reduced(description), TWIN, rtol=1e-9, atol=1e-11)

    def test_distance(self):
        """With its length; without one it is refused."""
        said = "".join(
            f"<drake:distance_constraint_{part}>{value}</drake:distance_constraint_{part}>"
            for part, value in (("body_A", "coupler"), ("body_B", "ground"), ("p_AP", "0.35 0 0"), ("distance", "0.4"))
        )
        text = f"<drake:distance_constraint>{said}</drake:distance_constraint>"
        (closure,) = read(model(four_bar_links(), *FOUR_BAR_JOINTS[:3], text)).closures
        assert (closure.kind, closure.length, closure.link_b) == ("distance", 0.4, "ground")
        with pytest.raises(DescriptionError, match="must be positive"):
            read(model(four_bar_links(), *FOUR_BAR_JOINTS[:3], text.replace("0.4<", "0<")))

    def test_rotor_inertia(self):
        """Times the gear ratio squared, of a joint with one axis; a negative one is refused."""
        said = "<drake:rotor_inertia>0.5</drake:rotor_inertia><drake:gear_ratio>3</drake:gear_ratio></joint>"
        text = model(four_bar_links(), FOUR_BAR_JOINTS[0].replace("</joint>", said), *FOUR_BAR_JOINTS[1:])
        description = read(text)
        assert [joint.armature for joint in description.joints if joint.armature] == [4.5]
        assert not any("drake" in note for note in description.notes)
        with pytest.raises(DescriptionError, match="must not be negative"):
            read(text.replace("0.5</drake", "-0.5</drake"))

    def test_elements_of_other_namespaces_are_not_sdformats(self):
        """drake:joint is no <joint>, and a joint unread would be another mechanism: it is refused."""
        text = model(four_bar_links(), *FOUR_BAR_JOINTS, '<drake:joint name="A" type="planar"/>')
        with pytest.raises(DescriptionError, match="<drake:joint> is not read"):
            read(text)

    def test_a_parent_frame_elsewhere_is_told(self):
        """SDFormat places a joint by its child; a parent frame only names a link."""
        frame = '<frame name="mount" attached_to="ground"><pose>-2 0 0 0 0 0</pose></frame>'
        text = four_bar((FOUR_BAR_JOINTS[0].replace(">ground<", ">mount<"), *FOUR_BAR_JOINTS[1:]))
        notes = read(text.replace("<joint", frame + "<joint", 1)).notes
        assert any("'mount' is 2 m from the joint" in note for note in notes)

    def test_xacro_in_an_sdf_is_refused(self, tmp_path):
        """Never read as if it were not there."""
        text = four_bar().replace("<link", '<xacro:include filename="x"/><link', 1)
        with pytest.raises(DescriptionError, match="expanded file"):
            ccpin.load(_written(tmp_path / "x.sdf", text))


class TestAgainstMujoco:
    """A spatial slider-crank: hinge, universal joint, ball in the rod's end, slide; MuJoCo has the same in MJCF."""

    BODIES: ClassVar = {
        "crank": (0.5, (0.05, 0.0, 0.02)),
        "rod": (0.4, (0.2, 0.01, 0.0)),
        "slider": (0.7, (0.0, 0.0, 0.03)),
    }

    def sdf(self):
        """Crank about z at the origin, rod hung at 0.1 m by a universal joint, slider along x at the rod's end."""
        crank, rod, slider = (link(name, mass=m, com=com) for name, (m, com) in self.BODIES.items())
        place = "<pose>0.1 0 0 0.1 0.2 0.3</pose>"
        return model(
            crank,
            rod.replace('name="rod">', f'name="rod">{place}'),
            slider.replace('name="slider">', 'name="slider"><pose relative_to="rod">0.4 0 0 -0.3 0.1 0.2</pose>'),
            joint("motor", "revolute", "world", "crank", axis="0 0 1"),
            joint("hang", "universal", "crank", "rod", axis="0 1 0", more="<axis2><xyz>0 0 1</xyz></axis2>"),
            joint("rail", "prismatic", "world", "slider", axis="1 0 0", extra="").replace(
                "<xyz>", '<xyz expressed_in="__model__">'
            ),
            joint("end", "ball", "rod", "slider", axis=""),
        )

    def mjcf(self):
        """The same tree; the ball is a connect at the slider's origin."""
        rod = "0.1 0 0"
        turn = Rotation.from_euler("xyz", [0.1, 0.2, 0.3])
        seat = np.array([0.1, 0, 0]) + turn.apply([0.4, 0, 0])
        slider = turn * Rotation.from_euler("xyz", [-0.3, 0.1, 0.2])
        rail = slider.inv().apply([1.0, 0.0, 0.0])

        def mass(name):
            m, com = self.BODIES[name]
            return f'<inertial mass="{m}" pos="{com[0]} {com[1]} {com[2]}" diaginertia="0.01 0.02 0.03"/>'

        def quat(rotation):
            x, y, z, w = rotation.as_quat()
            return f"{w!r} {x!r} {y!r} {z!r}".replace("np.float64(", "").replace(")", "")

        def row(values):
            return " ".join(repr(float(v)) for v in values)

        return (
            '<mujoco><option gravity="0 0 -9.81"/><worldbody>'
            f'<body name="crank"><joint name="motor" axis="0 0 1"/>{mass("crank")}'
            f'<body name="rod" pos="{rod}" quat="{quat(turn)}"><joint name="hang.1" axis="0 1 0"/>'
            f'<joint name="hang.2" axis="0 0 1"/>{mass("rod")}</body></body>'
            f'<body name="slider" pos="{row(seat)}" quat="{quat(slider)}">'
            f'<joint name="rail" type="slide" axis="{row(rail)}"/>'
            f"{mass('slider')}</body></worldbody>"
            '<equality><connect body1="slider" body2="rod" anchor="0 0 0"/></equality></mujoco>'
        )

    def test_forward_dynamics(self):
        """q̈ of the crank equals MuJoCo's M, bias and constraint Jacobian solved exactly (KKT), to 1e-8."""
        mujoco = pytest.importorskip("mujoco")
        mechanism = ccpin.load(read(self.sdf()), independent=["motor"])
        ours = ccpin.ReducedModel(mechanism).at([0.05])
        there = mujoco.MjModel.from_xml_string(self.mjcf())
        there.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        data = mujoco.MjData(there)
        order = [mechanism.tree.joint(there.joint(k).name).q.start for k in range(there.njnt)]
        v, step = 0.7, 1e-6

        def jacobian(q_free):
            data.qpos[:] = q_free[order]
            mujoco.mj_forward(there, data)
            return data.efc_J.reshape(-1, there.nv)[: data.ne].copy()

        rates = (ours.rho[:, 0] * v)[order]
        ahead, behind = (jacobian(ours.q_free + sign * step * ours.rho[:, 0] * v) for sign in (1.0, -1.0))
        J = jacobian(ours.q_free)
        data.qvel[:] = rates
        mujoco.mj_forward(there, data)
        M = np.zeros((there.nv, there.nv))
        for column, unit in zip(M, np.eye(there.nv), strict=True):
            mujoco.mj_mulM(there, data, column, unit)
        rhs = np.concatenate([-data.qfrc_bias, -(ahead - behind) / (2 * step) @ rates])
        K = np.block([[M, J.T], [J, np.zeros((len(J), len(J)))]])
        acceleration = np.linalg.lstsq(K, rhs, rcond=None)[0][0]
        assert np.isclose(ours.forward_dynamics([v], [0.0])[0], acceleration, rtol=1e-7)


def test_turns_count_under_springs_and_in_couplings():
    """A continuous joint with a spring, or geared 1:5, is a hinge without limits; one alone keeps its circle."""
    spring = "<dynamics><spring_stiffness>1</spring_stiffness></dynamics>"
    follows = '<mimic joint="c"><multiplier>5</multiplier></mimic>'
    parts = [link(name) for name in "wxyz"]
    extras = {"a": ("w", spring), "b": ("x", ""), "c": ("y", ""), "d": ("z", follows)}
    joints = [joint(name, "continuous", "world", body, extra=extra) for name, (body, extra) in extras.items()]
    kinds = {j.name: j.kind for j in read(model(*parts, *joints)).joints}
    assert kinds == {"a": "revolute", "b": "continuous", "c": "revolute", "d": "revolute"}
