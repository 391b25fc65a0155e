"""No word of a URDF is dropped in silence: a misspelt one that bears on the mechanism is refused, others are noted."""

from __future__ import annotations

import pytest

from ccpin.description.urdf.words import BELOW_ROOT, WITHIN
from ccpin.errors import DescriptionError
from tests.support.reading import read_urdf
from tests.support.sdf_files import four_bar_urdf

URDF = four_bar_urdf()
FULL = (
    '<joint name="own" type="revolute"><origin xyz="0 0 0"/><parent link="ground"/><child link="extra"/>'
    '<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/><dynamics damping="1" friction="0"/>'
    "</joint>"
    '<link name="extra"><inertial><origin xyz="0 0 0"/><mass value="1"/>'
    '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    '<visual><geometry><sphere radius="1"/></geometry></visual></link>'
)


def read(extra):
    """The four-bar with more links and joints."""
    return read_urdf(URDF.replace("</robot>", f"{extra}</robot>").encode(), None)


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("<origin xyz", "<orign xyz"),
        ("<axis", "<axes"),
        ("<axis", "<Axis"),
        ("<limit", "<limits"),
        ("<dynamics", "<dynamic"),
        ("inertial>", "inertail>"),
        ("<mass", "<mas"),
        ("<joint", "<jiont"),
        ("<link", "<lnik"),
        ("xyz=", "xzy="),
        ("effort=", "efort="),
        ("lower=", "lowr="),
        ("damping=", "dampin="),
        ("ixy=", "iyx="),
    ],
)
def test_a_misspelt_word_that_bears_on_the_mechanism_is_refused(right, wrong):
    """<orign>, <axes>, <limits> and inertail were dropped without a word."""
    text = FULL.replace(right, wrong)
    assert text != FULL
    name = wrong.strip("<>= ").split()[0]
    with pytest.raises(DescriptionError, match=f"'{name}'.* did you mean"):
        read(text.replace(f"</{right.strip('<')}>", f"</{wrong.strip('<')}>"))


def test_the_words_are_read_right():
    """Without a mistake nothing is said."""
    assert not [note for note in read(FULL).notes if "is not read" in note]


@pytest.mark.parametrize(
    ("right", "wrong", "note"),
    [
        ("visual>", "visaul>", r"<visaul> in <link> is not read"),
        ("<visual>", '<visual colour="1">', r"colour of <visual> is not read"),
        ("</link>", "<gizmo/><gizmo/></link>", r"<gizmo> in <link> is not read (2 of it)"),
        ("</joint>", "<friction_cone/></joint>", r"<friction_cone> in <joint> is not read"),
        ("</link>", '<x:thing xmlns:x="urn:x"/></link>', r"<x:thing> in <link> is not read"),
    ],
)
def test_what_is_unknown_and_harmless_is_noted(right, wrong, note):
    """Once for each place it stands in."""
    notes = read(FULL.replace(right, wrong)).notes
    assert any(note in said for said in notes)


def test_the_words_of_the_table_are_distinct():
    """No known word is near enough to another of its place to be taken for its misspelling when it is right."""
    for words in (BELOW_ROOT, *WITHIN.values()):
        every = (*words.bearing, *words.idle)
        assert len(set(every)) == len(every)
        assert len(set(words.attributes)) == len(words.attributes)
