"""Damaged SDFormat files: each loads or is refused with its file and the element at fault, in good time."""

import pytest

import ccpin
from tests.support.damage import TEXT_XML_DAMAGE, complaints
from tests.support.sdf_files import four_bar, joint, link, model

RICH = model(
    link("base"),
    '<frame name="f" attached_to="base"><pose degrees="true">0 0 0.1 10 0 0</pose></frame>',
    link("a", '<pose relative_to="f">0 0 0.2 0 0 0</pose>'),
    joint("j1", "universal", "f", "a", axis="1 0 0", more="<axis2><xyz>0 1 0</xyz></axis2>"),
    '<model name="arm"><pose>0.5 0 0 0 0 0</pose>'
    + link("b")
    + link("c", '<pose relative_to="b">0 0 0.3 0 0 0</pose>')
    + joint("j2", "screw", "b", "c", axis="0 0 1", more="<screw_thread_pitch>0.01</screw_thread_pitch>")
    + "</model>",
    joint(
        "j3",
        "revolute",
        "base",
        "arm::b",
        extra="<limit><lower>-1</lower><upper>1</upper></limit><dynamics><damping>0.1</damping></dynamics>",
    ),
    joint("j4", "ball", "arm::c", "a", axis="", pose='<pose relative_to="a">0 0 0.1 0 0 0</pose>'),
    '<link name="wheel"><visual name="v"><geometry><cylinder><radius>1</radius><length>1</length></cylinder></geometry>'
    "<material><diffuse>1 0 0 1</diffuse></material></visual></link>",
    joint("j5", "continuous", "base", "wheel"),
    joint(
        "gear",
        "gearbox",
        "wheel",
        "arm::b",
        more="<axis2><xyz>0 1 0</xyz></axis2><gearbox_reference_body>base</gearbox_reference_body>",
    ),
)
ROBOT = four_bar().partition('version="1.9">')[2].removesuffix("</sdf>")
FLOOR = '<model name="g"><static>1</static><link name="l"/></model>'
WORLD = f'<sdf version="1.7"><world name="w"><gravity>0 0 -9.8</gravity>{ROBOT}{FLOOR}</world></sdf>'
TEXTS = {"four_bar": four_bar(), "rich": RICH, "world": WORLD}


@pytest.mark.parametrize("chunk", range(4))
def test_a_damaged_file_loads_or_is_refused_by_name(chunk, tmp_path, capfd):
    """A few hundred cases."""
    assert not complaints(TEXTS, range(chunk, 300, 4), tmp_path, TEXT_XML_DAMAGE, ".sdf")
    printed = capfd.readouterr()
    assert (printed.out, printed.err) == ("", "")


@pytest.mark.slow
def test_two_thousand_damaged_files(tmp_path):
    """The rest of two thousand."""
    assert not complaints(TEXTS, range(300, 2300), tmp_path, TEXT_XML_DAMAGE, ".sdf")


@pytest.mark.parametrize("name", sorted(TEXTS))
def test_the_undamaged_originals_load(name, tmp_path):
    """The damage is what is refused."""
    file = tmp_path / "m.sdf"
    file.write_text(TEXTS[name])
    assert ccpin.load(file).n >= 1
