"""Small files, each with something that others write: read as it is meant, or refused with what would be right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import ccpin
from ccpin.errors import DescriptionError
from tests.support.described import BARS, SDF_BARS, UNASSEMBLED


@pytest.fixture
def load(tmp_path):
    def at(text, **options):
        path = tmp_path / ("model.sdf" if "<sdf" in text else "model.urdf")
        path.write_text(text)
        return ccpin.load(path, **options)

    return at


def urdf(more="", old="", new=""):
    assert old in BARS
    return BARS.replace(old or "@", new or "@").replace("@", more)


def test_joints_with_two_frames_of_their_own(load):
    """Drake's unassembled four-bar: poses of links say nothing; the circles of crank and rocker decide, in closed form.

    It was read as if the poses drawn were those at zero displacement, which is another mechanism.
    """
    mechanism = load(UNASSEMBLED)
    model = ccpin.ReducedModel(mechanism)
    names = [joint.name for joint in mechanism.tree.joints]
    for turn in (0.0, 0.2, -0.15):
        state = model.at(model.alpha(mechanism.q_reference) + turn)
        angle = dict(zip(names, state.q_free, strict=True))
        wd, wr = angle["wd"], angle["wr"]  # about −y: z turns towards −x
        end, top = np.array([-2 - np.sin(wd), np.cos(wd)]), np.array([2 - 2 * np.sin(wr), 2 * np.cos(wr)])
        assert np.linalg.norm(top - end) == pytest.approx(4.8, abs=1e-9)
        along = (top - end) / 4.8
        assert np.array([np.cos(wd + angle["dc"]), np.sin(wd + angle["dc"])]) == pytest.approx(along, abs=1e-9)
    with pytest.raises(DescriptionError, match="go together"):
        load(UNASSEMBLED.replace("<drake:child_frame>Rc</drake:child_frame>", ""))
    with pytest.raises(DescriptionError, match="not fixed to link 'rocker'"):
        load(UNASSEMBLED.replace("<drake:child_frame>Rc<", "<drake:child_frame>Cr<"))


def test_a_stray_link_of_a_model_changes_nothing(load):
    """It floated by itself, and n was 7; links that a constraint holds stay."""
    mechanism = load(SDF_BARS.replace("@", '<link name="stray"/>'))
    assert mechanism.n == 1
    assert any("'stray' is left out" in note for note in mechanism.notes)
    ball = (
        "<drake:ball_constraint><ball_constraint_body_A>crank</ball_constraint_body_A>"
        "<ball_constraint_body_B>stray</ball_constraint_body_B></drake:ball_constraint>"
    )
    assert load(SDF_BARS.replace("@", f'<link name="stray"/>{ball}')).n == 4


@pytest.mark.parametrize("version", ["1.6", "1.7", "1.8"])
def test_names_with_colons(load, version):
    """Older converters flatten nested models into such names; a bare colon pair stays reserved."""
    flat = SDF_BARS.replace('"1.9"', f'"{version}"').replace(' relative_to="crank"', "").replace("@", "")
    flat = flat.replace('"crank"', '"arm::crank"').replace(">crank<", ">arm::crank<")
    assert load(flat).n == 1
    with pytest.raises(DescriptionError, match="reserved"):
        load(flat.replace("arm::crank", "::crank"))
    nested = '<model name="arm"><link name="crank"/></model>'
    with pytest.raises(DescriptionError, match="full name"):
        load(flat.replace("</model>", f"{nested}</model>"))


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("relative_to=", "relativ_to=", "relative_to"),
        ('<joint name="A"', '<joint nmae="A"', "name"),
        ("<drake:nothing/>", '<drake:joint name="P" type="planar"/>', "drake:joint"),
    ],
)
def test_misspelt_attributes_of_sdf_are_refused(load, old, new, word):
    with pytest.raises(DescriptionError, match=word):
        load(SDF_BARS.replace("@", "<drake:nothing/>").replace(old, new))


def test_unknown_attributes_of_sdf_are_noted(load):
    assert any(
        "colour of <link>" in note
        for note in load(SDF_BARS.replace("@", "").replace('"rocker">', '"rocker" colour="1">', 1)).notes
    )


@pytest.mark.parametrize(
    ("old", "new", "note"),
    [
        (
            '"revolute"><parent link="ground"/><child link="crank"/>',
            '"revolute"><dynamics damping="1e11"/>@@',
            None,
        ),
        (
            '"revolute"><parent link="ground"/><child link="crank"/>',
            '"revolute"><limit effort="" velocity=""/>@@',
            "empty",
        ),
        (
            '<link name="ground"/>',
            '<link name="ground"/><gazebo reference="crank"><turnGravityOff value="true"/></gazebo>',
            "gravity",
        ),
        ('<link name="ground"/>', '<link name="ground"/><material name="m"><color rgba="255 0 0 1"/></material>', None),
        ('<link name="ground"/>', '<link name="ground"/><material name="m"><color/></material>', "no colour"),
        (
            '<link name="ground"/>',
            '<link name="ground"/><material name="m"><color rgba="red"/></material>',
            "no colour",
        ),
        ('<link name="ground"/>', '<link name="ground"/><material name="m"><color rgba="1 0 0"/></material>', None),
    ],
)
def test_what_is_no_fault_of_the_mechanism_is_read(load, old, new, note):
    new = new.replace("@@", '<parent link="ground"/><child link="crank"/>')
    mechanism = load(urdf(old=old, new=new))
    assert mechanism.n == 1
    assert note is None or any(note in each for each in mechanism.notes)


def test_only_the_state_named_reference_is_the_reference(load):
    """Others are poses by their names; where the file's own pose closes, it is the reference."""
    state = '<group_state name="home" group="arm"><joint name="A" value="0.9"/></group_state>'
    mechanism = load(urdf(state))
    assert ccpin.ReducedModel(mechanism).alpha(mechanism.q_reference) == pytest.approx([0.0], abs=1e-9)
    assert mechanism.description.poses["home"] == {"A": (0.9,)}


@pytest.mark.parametrize("ratio", ["1e200", "-1e200"])
def test_a_gear_beyond_all_numbers_is_refused_by_name(load, ratio):
    """Its square was an OverflowError of Python's own."""
    gear = f'<drake:rotor_inertia xmlns:drake="d" value="1e-3"/><drake:gear_ratio xmlns:drake="d" value="{ratio}"/>'
    drive = f'<transmission name="t"><joint name="A"/><actuator name="m">{gear}</actuator></transmission>'
    with pytest.raises(DescriptionError, match="rotor inertia inf"):
        load(urdf(drive))
    with pytest.raises(DescriptionError, match="rotor inertia inf"):
        load(
            SDF_BARS.replace("@", "").replace(
                "<child>crank</child>",
                f"<child>crank</child><drake:rotor_inertia>1</drake:rotor_inertia><drake:gear_ratio>{ratio}</drake:gear_ratio>",
            )
        )


def test_bars_of_micrometres(load):
    """A gripper etched in silicon: closed and moved as the same one in metres."""
    small = urdf()
    for metres, micrometres in (("0 0 1", "0 0 1e-6"), ("1 0 0", "1e-6 0 0"), ("0 0 0.5", "0 0 5e-7")):
        small = small.replace(f'xyz="{metres}"', f'xyz="{micrometres}"')
    for text in (small, urdf()):
        mechanism = load(text)
        assert mechanism.n == 1
        q = ccpin.ReducedModel(mechanism).sigma([0.4])
        assert np.abs(mechanism.constraints().residual(q)).max() < 1e-12 * mechanism.constraints().extent


def test_an_asymmetric_inertia_is_refused_by_name(load):
    """Of Python's own descriptions; a file has no place for one."""
    description = load(urdf()).description
    skewed = np.diag([0.1, 0.1, 0.01]) + np.triu(np.full((3, 3), 1e-3), 1)
    links = tuple(
        replace(link, inertia=replace(link.inertia, rotational=skewed)) if link.name == "crank" else link
        for link in description.links
    )
    with pytest.raises(DescriptionError, match=r"link 'crank'.*symmetric"):
        ccpin.load(replace(description, links=links))
