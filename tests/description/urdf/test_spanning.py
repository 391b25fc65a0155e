"""URDFs whose joints form a graph: second parents, <gazebo> joints, onshape-to-robot's frames, against URDF+ twins."""

from __future__ import annotations

import numpy as np
import pytest

import ccpin
from ccpin.errors import DescriptionError
from tests.support.damage import TEXT_XML_DAMAGE, complaints
from tests.support.long_cases import later
from tests.support.reading import read_urdf
from tests.support.sdf_files import COUPLER, ROCKER, four_bar_urdf

URDF = four_bar_urdf()
LOOP = URDF[URDF.index("<loop") : URDF.index("</loop>") + len("</loop>")]
OPEN = URDF.replace(LOOP, "")
AXIS = '<axis xyz="0 1 0"/>'
# The coupler's frame at the tip is not the rocker's, so as a second parent the rocker gets a massless link at its tip.
TIP = (
    '<link name="tip"/><joint name="tip_mount" type="fixed"><parent link="rocker"/><child link="tip"/>'
    f'<origin xyz="{ROCKER} 0 0"/></joint>'
)
SECOND_PARENT = (
    f'<joint name="C" type="continuous"><parent link="coupler"/><child link="tip"/><origin xyz="{COUPLER} 0 0"/>{AXIS}'
    "</joint>"
)
GAZEBO = (
    '<gazebo><joint name="C" type="revolute"><parent>coupler</parent><child>rocker</child>'
    f"<pose>{ROCKER} 0 0 0 0 0</pose><axis><xyz>0 1 0</xyz></axis></joint></gazebo>"
)


def added(*parts, text=OPEN):
    """The open four-bar with more in it."""
    return text.replace("</robot>", "".join(parts) + "</robot>")


def read(text):
    return read_urdf(text.encode(), None)


def reduced(description, q=0.15, v=0.7, u=0.3):
    """D, C v, g and q̈ of the reduced model whose q is joint A."""
    state = ccpin.ReducedModel(ccpin.load(description, independent=["A"], actuated=["A"])).at([q])
    return np.concatenate([state.D.ravel(), (state.C([v]) @ [v]), state.g, state.forward_dynamics([v], [u])])


TWIN = reduced(read(URDF))


class TestSecondParent:
    """The second joint that reaches a link closes a loop."""

    def test_is_the_loop_of_its_kind(self):
        """Equal reduced dynamics, and a note."""
        description = read(added(TIP, SECOND_PARENT))
        assert [(c.name, c.kind, c.link_a, c.link_b) for c in description.closures] == [
            ("C", "revolute", "coupler", "tip")
        ]
        assert "joint 'C' closes a loop" in description.notes
        assert np.allclose(reduced(description), TWIN, rtol=1e-9, atol=1e-11)

    @pytest.mark.parametrize(
        "keeper",
        [
            '<transmission name="t"><joint name="C"/></transmission>',
            '<gazebo reference="none"/>',
        ],
    )
    def test_with_a_motor_stays_a_joint(self, keeper):
        """Of a massless link that is welded to the child: the same mechanism, with the motor where the file has it."""
        motor = "transmission" in keeper
        description = read(added(TIP, SECOND_PARENT, keeper))
        assert description.actuated == (("C",) if motor else None)
        assert [c.kind for c in description.closures] == ["fixed" if motor else "revolute"]
        assert np.allclose(reduced(description), TWIN, rtol=1e-9, atol=1e-11)

    def test_with_a_mimic_stays_a_joint(self):
        """The coupling holds between joints of the tree: mobility falls to zero here."""
        mimicking = SECOND_PARENT.replace(AXIS, AXIS + '<mimic joint="A"/>')
        description = read(added(TIP, mimicking))
        assert {j.name for j in description.joints} >= {"A", "B", "C", "D"}
        assert [c.name for c in description.couplings] == ["mimic_C"]

    def test_a_cycle_and_a_second_root_stay_errors(self):
        """What no first joint holds is no tree."""
        ring = (
            '<link name="x"/><link name="y"/>'
            '<joint name="p" type="fixed"><parent link="x"/><child link="y"/></joint>'
            '<joint name="r" type="fixed"><parent link="y"/><child link="x"/></joint>'
        )
        with pytest.raises(DescriptionError, match="cycle"):
            read(added(TIP, SECOND_PARENT, ring))
        with pytest.raises(DescriptionError, match="second root"):
            read(added(TIP, SECOND_PARENT, '<link name="stray"/>'))


class TestGazeboJoint:
    """An SDFormat joint in <gazebo> closes the loop."""

    def test_equals_the_loop(self):
        """Equal reduced dynamics."""
        description = read(added(GAZEBO))
        assert [c.kind for c in description.closures] == ["revolute"]
        assert np.allclose(reduced(description), TWIN, rtol=1e-9, atol=1e-11)

    @pytest.mark.parametrize(
        ("before", "after"),
        [
            (f"<pose>{ROCKER} 0 0 0 0 0</pose>", f'<pose relative_to="coupler">{COUPLER} 0 0 0 0 0</pose>'),
            ("<parent>coupler</parent>", '<parent link="coupler"/>'),
            ("<xyz>0 1 0</xyz>", '<xyz expressed_in="coupler">0 1 0</xyz>'),
            ("<xyz>0 1 0</xyz>", "<xyz>0 1 0</xyz><use_parent_model_frame>1</use_parent_model_frame>"),
        ],
    )
    def test_its_frames_may_be_stated_otherwise(self, before, after):
        """Relative to other links, in other frames: the same loop (the drawn pose is closed)."""
        assert np.allclose(reduced(read(added(GAZEBO.replace(before, after)))), TWIN, rtol=1e-9, atol=1e-11)

    def test_other_types_are_other_closures(self):
        """A ball joint is a spherical closure; in this planar loop the same mechanism."""
        ball = GAZEBO.replace('"revolute"', '"ball"').replace("<axis><xyz>0 1 0</xyz></axis>", "")
        description = read(added(ball))
        assert [c.kind for c in description.closures] == ["spherical"]
        assert np.allclose(reduced(description), TWIN, rtol=1e-9, atol=1e-11)

    def test_a_damped_one_keeps_its_damping(self):
        """It stays a joint."""
        damped = GAZEBO.replace("</axis>", "<dynamics><damping>0.2</damping></dynamics></axis>")
        joints = {j.name: j for j in read(added(damped)).joints}
        assert joints["C"].damping == 0.2

    def test_a_tie_to_the_world_is_the_root_or_a_loop(self):
        """Of the base it says nothing new; of another link it closes a loop with the ground."""
        tie = '<gazebo><joint name="w" type="{}"><parent>world</parent><child>{}</child></joint></gazebo>'
        still = read(added(GAZEBO, tie.format("fixed", "ground")))
        assert len(still.closures) == 1
        assert any("left out" in note and "'w'" in note for note in still.notes)
        tied = read(added(tie.format("ball", "coupler")))
        assert (tied.closures[0].link_a, tied.closures[0].kind) == ("ground", "spherical")

    def test_springs_are_read_and_losses_told(self):
        """springStiffness of a joint; plugins, turned-off gravity and dampingFactor in the notes."""
        extras = (
            '<gazebo reference="A"><springStiffness>3</springStiffness><springReference>0.5</springReference></gazebo>'
            '<gazebo reference="crank"><turnGravityOff>true</turnGravityOff><dampingFactor>0.1</dampingFactor></gazebo>'
            '<gazebo><plugin name="p" filename="f"/></gazebo>'
        )
        description = read(added(GAZEBO, extras))
        crank = {j.name: j for j in description.joints}["A"]
        assert (crank.stiffness, crank.spring_reference) == (3.0, 0.5)
        notes = " ".join(description.notes)
        for part in ("gravity is switched off for crank", "dampingFactor of crank", "1 Gazebo plugins"):
            assert part in notes

    @pytest.mark.parametrize(
        ("before", "after", "message"),
        [
            (">rocker<", ">nobody<", "link 'nobody' does not exist"),
            ('"revolute"', '"hinge"', "'hinge' is not one of"),
            ("<child>rocker</child>", "", "<child> is missing"),
            ("<xyz>0 1 0</xyz>", "<xyz>0 1</xyz>", "2 numbers where 3"),
        ],
    )
    def test_what_is_wrong_is_refused_by_name(self, before, after, message):
        """The joint's name is in the message."""
        with pytest.raises(DescriptionError, match=message):
            read(added(GAZEBO.replace(before, after)))


def closing_frames(first=1, second=2):
    """The massless links onshape-to-robot fixes at both ends of a closing mate."""
    return "".join(
        f'<link name="closing_tip_{k}"/><joint name="closing_tip_{k}_frame" type="fixed"><origin xyz="{x} 0 0"/>'
        f'<parent link="{link}"/><child link="closing_tip_{k}"/></joint>'
        for k, link, x in ((first, "coupler", COUPLER), (second, "rocker", ROCKER))
    )


def test_onshape_frames_close_loops():
    """A pair is a spherical closure, with a note; a frame without its twin a note; stated closures go first."""
    description = read(added(closing_frames()))
    assert [(c.kind, c.link_a, c.link_b) for c in description.closures] == [("spherical", "coupler", "rocker")]
    assert np.allclose(reduced(description), TWIN, rtol=1e-9, atol=1e-11)
    lonely = read(added(closing_frames(second=3), LOOP))
    assert len(lonely.closures) == 1
    assert any("closing_tip_1 has no twin" in note for note in lonely.notes)
    stated = (
        '<loop_joint name="t" type="spherical"><link1 link="closing_tip_1"/><link2 link="closing_tip_2"/></loop_joint>'
    )
    assert [c.name for c in read(added(closing_frames(), stated)).closures] == ["t"]


class TestSpellings:
    """What real files write otherwise."""

    @pytest.mark.parametrize("value", ["True", "TRUE", "1", "true"])
    def test_truth_in_any_case(self, value):
        """independent="True" and "False"."""
        marked = URDF.replace('name="A"', f'name="A" independent="{value}"')
        for other in "BD":
            marked = marked.replace(f'name="{other}"', f'name="{other}" independent="False"')
        assert read(marked).independent == ("A",)

    @pytest.mark.parametrize("loop", [LOOP, ""])
    def test_a_default_namespace_changes_nothing(self, loop):
        """xmlns on the root."""
        text = added(loop or closing_frames(), text=OPEN).replace(
            "<robot ",
            '<robot xmlns="http://drake.mit.edu" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" '
            'xsi:schemaLocation="http://drake.mit.edu ../doc/robot.xsd" ',
        )
        assert np.allclose(reduced(read(text)), TWIN, rtol=1e-9, atol=1e-11)

    @pytest.mark.parametrize(
        "loop",
        [
            f'<loop_joint name="C" type="revolute"><link1 link="coupler" xyz="{COUPLER} 0 0" rpy="0 0 0"/>'
            f'<link1 link="rocker" xyz="{ROCKER} 0 0" rpy="0 0 0"/><axis xyz="0 1 0"/></loop_joint>',
            f'<loop_joint name="C" type="revolute"><parent link="coupler"/><child link="rocker"/>'
            f'<parent_origin xyz="{COUPLER} 0 0"/><child_origin xyz="{ROCKER} 0 0"/>'
            '<axis xyz="0 1 0" frame="parent"/></loop_joint>',
            f'<constraint name="C" type="revolute"><parent link="coupler"/><parent_origin xyz="{COUPLER} 0 0"/>'
            f'<parent_axis xyz="0 1 0"/><child link="rocker"/><child_origin xyz="{ROCKER} 0 0" rpy="0 0 0"/>'
            '<child_axis xyz="0 1 0"/></constraint>',
        ],
        ids=["link1 twice", "parent and child", "constraint"],
    )
    def test_other_elements_for_the_same_loop(self, loop):
        """The same reduced dynamics, and the same alignment of the axes."""
        description = read(added(loop))
        assert [c.kind for c in description.closures] == ["revolute"]
        assert np.allclose(reduced(description), TWIN, rtol=1e-9, atol=1e-11)

    def test_the_axes_of_a_universal_constraint(self):
        """x of the parent's frame along its axis, y of the child's along its own."""
        text = (
            '<constraint name="u" type="universal"><parent link="coupler"/><parent_axis xyz="0 1 0"/>'
            '<child link="rocker"/><child_axis xyz="1 0 0"/></constraint>'
        )
        (closure,) = read(added(text)).closures
        assert np.allclose(closure.placement_a[:3, 0], [0, 1, 0])
        assert np.allclose(closure.placement_b[:3, 1], [1, 0, 0])

    @pytest.mark.parametrize(
        ("text", "meant"),
        [
            (
                '<drake:ball_constraint name="b"><drake:ball_constraint_p_B value="0 0 0"/></drake:ball_constraint>',
                "p_BQ",
            ),
            (LOOP.replace("predecessor", "predecesor"), "predecessor"),
            (LOOP.replace("<origin xyz", "<origin xzy"), "xyz"),
            (LOOP.replace("<axis", "<axes"), "axis"),
            (LOOP.replace("<loop ", "<loops ").replace("</loop>", "</loops>"), "loop"),
        ],
    )
    def test_a_misspelling_is_refused_with_the_nearest_name(self, text, meant):
        """The message names what is meant."""
        with pytest.raises(DescriptionError, match=rf"did you mean '\w*{meant}'"):
            read(added(text).replace("<robot ", '<robot xmlns:drake="urn:d" '))

    @pytest.mark.parametrize("target", ["ghost", "tip_mount"])
    def test_mimic_and_transmission_on_fixed_or_absent_joints_are_noted(self, target):
        """Neither couples nor drives anything."""
        mimic = OPEN.replace('<axis xyz="0 1 0"/>', f'<axis xyz="0 1 0"/><mimic joint="{target}"/>', 1)
        motor = f'<transmission name="t"><joint name="{target}"/></transmission>'
        description = read(added(TIP, LOOP, motor, text=mimic))
        assert (description.couplings, description.actuated) == ((), None)
        assert sum(f"joint '{target}'" in note for note in description.notes) == 2

    def test_a_file_without_any_inertial_gets_a_note(self):
        """Masses are all zero."""
        bare = "".join(part.partition("<inertial>")[0] for part in URDF.split("</inertial>"))
        assert any("no link states an inertia" in note for note in read(bare).notes)
        assert not any("no link states an inertia" in note for note in read(URDF).notes)

    def test_joint_names_may_hold_colons(self):
        """robot0:A as independent and actuated joint, and a component of a joint whose name has one."""
        text = URDF.replace('name="A"', 'name="robot0:A"').replace('name="D"', 'name="robot0:A:rx"')
        mechanism = ccpin.load(read(text), independent=["robot0:A"], actuated=["robot0:A"])
        assert mechanism.independent == ("robot0:A",)
        state = ccpin.ReducedModel(mechanism).at([0.15])
        assert np.isclose(state.D[0, 0], TWIN[0])


TEXTS = {
    "gazebo": added(GAZEBO),
    "second_parent": added(TIP, SECOND_PARENT, '<transmission name="t"><joint name="A"/></transmission>'),
    "frames": added(closing_frames()),
    "constraint": added(
        f'<constraint name="C" type="revolute"><parent link="coupler"/><parent_origin xyz="{COUPLER} 0 0"/>'
        f'<parent_axis xyz="0 1 0"/><child link="rocker"/><child_origin xyz="{ROCKER} 0 0"/>'
        '<child_axis xyz="0 1 0"/></constraint>'
    ),
}


@pytest.mark.parametrize("chunk", later(*range(4)))
def test_a_damaged_file_loads_or_is_refused_by_name(chunk, tmp_path, capfd):
    """A few hundred cases."""
    assert not complaints(TEXTS, range(chunk, 300, 4), tmp_path, TEXT_XML_DAMAGE, ".urdf")
    printed = capfd.readouterr()
    assert (printed.out, printed.err) == ("", "")


@pytest.mark.slow
def test_two_thousand_damaged_files(tmp_path):
    """The rest of two thousand."""
    assert not complaints(TEXTS, range(300, 2300), tmp_path, TEXT_XML_DAMAGE, ".urdf")
