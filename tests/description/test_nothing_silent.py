"""Files with one alteration each: no error but ours, nothing that waits, and no silence where the reader would use it.

``CCPIN_FUZZ=20000 pytest -m slow -s tests/description/test_nothing_silent.py`` tries so many a format.
"""

from __future__ import annotations

import os
import random
import re
import sys
from collections import Counter

import pytest

from tests.support.altering import altered, taken
from tests.support.described import BARS, INERTIA, MJCF, SDF_TEXTS, TOOLBOX_URDF, TOOLBOX_YAML, UNASSEMBLED
from tests.support.long_cases import later
from tests.support.places import MODELS

RICH = BARS.replace(
    "@",
    f"""<transmission name="t"><type>transmission_interface/SimpleTransmission</type><joint name="A"/>
<actuator name="m"><mechanicalReduction>20</mechanicalReduction></actuator></transmission>
<gazebo reference="B"><springStiffness>2</springStiffness><springReference>0.1</springReference></gazebo>
<group_state name="reference"><joint name="A" value="0.1"/></group_state>
<link name="follower"><inertial><mass value="1"/>{INERTIA}</inertial></link>
<joint name="F" type="prismatic"><origin xyz="0 1 0" rpy="0.1 0.2 0.3"/><parent link="ground"/><child link="follower"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="2" effort="3" velocity="4"/><dynamics damping="0.1" friction="0.2"/>
<mimic joint="A" multiplier="0.5" offset="0.1"/></joint>""",
)
NUMBER = re.compile(r'(?<=[ ">])-?\d+\.?\d*(e-?\d+)?(?=[ "<])')
REPLACED = '<axis xyz="0 0 1"/>\n  <limit effort="1" velocity="1"/>'
"""Of the hinge in whose place the YAML puts a universal joint."""
TEXTS = {
    "urdf": {"rich": RICH} | {name: (MODELS / f"{name}.urdf").read_text() for name in ("rpdr", "four_bar")},
    "sdf": {**SDF_TEXTS, "unassembled": UNASSEMBLED},
    "mjcf": {"bars": MJCF.replace('forcerange="-3 3"', 'forcerange="-1 3"')},
    "toolbox": {"robot": TOOLBOX_URDF.replace(REPLACED, REPLACED.replace('"0 0 1"', '"0 0 5"').replace('"1"', '"5"'))},
}
SUFFIX = {"urdf": ".urdf", "sdf": ".sdf", "mjcf": ".xml", "toolbox": ".urdf"}

PICTURES = {"visual", "collision", "material", "geometry"}
NAMES = {("transmission", "name"), ("actuator", "name"), ("world", "name"), ("group_state", "group"), ("robot", "name")}
OTHERS = {"hardwareInterface"}
MERGED = {
    ("compiler", ""),
    ("default", ""),
    ("geom", "default"),
    ("group_state", ""),
    ("joint", "group_state"),
    ("gazebo", ""),
}
"""What may stand twice and is put together: twice the same is once the same, by element and what it stands in."""
DEFAULTS = {
    ("joint", "type", "hinge"),
    ("compiler", "autolimits", "true"),
    ("compiler", "angle", "radian"),
    ("general", "biastype", "affine"),  # all of whose numbers are zero
    ("mass", "", "1.0"),
    ("xyz", "", "0 0 1"),
    ("mass", "", "1"),
    ("gear_ratio", "", "1"),
    ("gear_ratio", "value", "1"),
    ("frame", "attached_to", "driver"),  # the model's first link
    ("type", "", "transmission_interface/SimpleTransmission"),
}
"""Words and numbers that hold too where they are not said."""
DIRECTIONS = {("axis", "xyz"), ("joint", "axis"), ("xyz", "")}
"""Vectors whose length is no matter."""


def exempt(name, change):
    """Whether nothing that the reader would use was altered, or the same is said in another way."""
    around = (change.tag, *change.within)
    zero = _numeric(change.before) and not any(map(float, change.before.split()))
    return (
        PICTURES & {*around}
        or (change.tag, change.attribute) in NAMES
        or change.tag in OTHERS
        or (change.what == "double" and {(change.tag, ""), (change.tag, change.within[0])} & MERGED)
        or (("removed" in change.what or change.what in ("remove", "text", "value")) and zero)
        or (change.tag, change.attribute, change.before) in DEFAULTS
        or (change.what in ("value", "text") and (change.tag, change.attribute) in DIRECTIONS)
        or (name == "robot" and change.before in ("5", "0 0 5"))
        or (name == "rich" and (change.attribute == "relative_to" and change.before in ("a", "b")))
        or (name == "rich" and change.what == "remove" and change.tag == "axis" and change.within.count("model") == 2)
        or (change.attribute == "polycoef" and change.before.endswith(" 0"))  # fewer coefficients are zeros
        or (change.attribute in ("ctrlrange", "forcerange") and change.what == "value")  # the other's may be narrower
        or (name == "unassembled" and (change.tag == "pose" or change.attribute == "expressed_in"))
        or (name == "world" and change.tag in ("model", "link", "static"))
        or (change.tag == "origin" and change.what in ("remove", "attribute removed") and zero)
    )


def _numeric(text):
    try:
        return bool(list(map(float, text.split())))
    except ValueError:
        return False


def campaign(kind, numbers, folder):
    """Faults and silences among the altered files of a format, and how all of them were taken."""
    folder.mkdir()
    (folder / "robot.yaml").write_text(TOOLBOX_YAML)
    files = {name: folder / f"{name}{SUFFIX[kind]}" for name in sorted(TEXTS[kind])}
    asked = {name: folder if kind == "toolbox" else file for name, file in files.items()}
    whole = {}
    for name, file in files.items():
        file.write_text(TEXTS[kind][name])
        whole[name] = taken(asked[name])
        assert not whole[name].fault, name
        assert not whole[name].refused, name
    found, counts = [], Counter()
    for number in numbers:
        name = list(files)[number % len(files)]
        change = altered(TEXTS[kind][name].encode(), random.Random(number))
        files[name].write_bytes(change.text)
        how = taken(asked[name])
        silent = not how.refused and (how.content, how.notes) == (whole[name].content, whole[name].notes)
        if how.fault:
            found.append(f"{number} ({name}): {change[1:]}: {how.fault}")
        elif silent and not exempt(name, change):
            found.append(f"{number} ({name}): {change[1:]}: silent")
        counts["faults" if how.fault else "refused" if how.refused else "the same" if silent else "told"] += 1
    return found, counts


@pytest.mark.parametrize("numbers", later(range(9), range(9, 25)))
@pytest.mark.parametrize("kind", sorted(TEXTS))
def test_what_is_altered_is_told(kind, numbers, tmp_path):
    """Elements and attributes renamed, removed, doubled; values swapped for 1e±300, NaN, nothing."""
    assert not campaign(kind, numbers, tmp_path / kind)[0]


@pytest.mark.parametrize("every", later(25, 1))
@pytest.mark.parametrize("kind", sorted(TEXTS))
def test_any_number_may_be_beyond_measure(kind, every, tmp_path):
    """Each number of each file, or each twenty-fifth, as 1e300 or −1e300: an error of ours or none, and no warning."""
    (tmp_path / "robot.yaml").write_text(TOOLBOX_YAML)
    for name, text in TEXTS[kind].items():
        file = tmp_path / f"{name}{SUFFIX[kind]}"
        spots = [] if name in ("rpdr", "four_bar") else list(NUMBER.finditer(text))[::every]
        for k, spot in enumerate(spots):
            file.write_text(text[: spot.start()] + ("1e300", "-1e300")[k % 2] + text[spot.end() :])
            how = taken(tmp_path if kind == "toolbox" else file)
            assert not how.fault, (text[spot.start() - 60 : spot.end() + 5], how.fault)
        file.unlink(missing_ok=True)


@pytest.mark.slow
@pytest.mark.parametrize("kind", sorted(TEXTS))
def test_thousands_of_alterations(kind, tmp_path):
    most = int(os.environ.get("CCPIN_FUZZ", "2000"))
    found, counts = campaign(kind, range(25, most), tmp_path / kind)
    sys.stdout.write(f"\n{kind}: {dict(counts)}\n")
    assert not found, "\n".join(found[:40])
