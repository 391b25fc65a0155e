"""What the MJCF reader refuses, and the includes it follows."""

from __future__ import annotations

from pathlib import Path

import pytest

import ccpin
from ccpin import cli
from ccpin.description import read_description
from ccpin.errors import DescriptionError, InvalidXmlError
from tests.support.mjcf_files import BALL, PAIR, model, read
from tests.support.reading import read_mjcf


def test_includes_are_read_from_the_models_folder(tmp_path: Path) -> None:
    """Nested includes are found relative to the main file, and the whole equals the assembled file."""
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "bodies.xml").write_text(f'<mujocoinclude>{PAIR}<include file="c.xml"/></mujocoinclude>')
    (tmp_path / "c.xml").write_text(f'<mujoco><body name="c"><joint name="jc"/>{BALL}</body></mujoco>')
    main = tmp_path / "main.xml"
    main.write_text(model('<include file="parts/bodies.xml"/>'))
    mujoco = pytest.importorskip("mujoco")
    compiled = mujoco.MjModel.from_xml_path(str(main))
    description = read_mjcf(main.read_bytes(), str(main))
    assert [link.name for link in description.links] == [compiled.body(k).name for k in range(compiled.nbody)]


@pytest.mark.parametrize(
    ("file", "reason"),
    [
        ("../secret.xml", "outside"),
        ("/etc/passwd", "outside"),
        ("absent.xml", "no file"),
        ("main.xml", "twice"),
        ("empty.xml", "nothing"),
        ("", "required"),
        ("x" * 300, "no "),
    ],
)
def test_bad_includes_are_refused(tmp_path: Path, file: str, reason: str) -> None:
    """An include that leaves the folder, is absent, circular or empty is refused with the reason."""
    folder = tmp_path / "model"
    folder.mkdir()
    (tmp_path / "secret.xml").write_text(f"<mujoco>{PAIR}</mujoco>")
    (folder / "empty.xml").write_text("<mujoco/>")
    main = folder / "main.xml"
    main.write_text(model(f'<include file="{file}"/>'))
    with pytest.raises(DescriptionError, match=reason):
        read_mjcf(main.read_bytes(), str(main))


def test_an_include_root_allows_what_lies_below_it(tmp_path: Path) -> None:
    """A library's files include each other by ../ where its folder is named, in Python and on the command line."""
    for folder in ("library/robot", "library/common"):
        (tmp_path / folder).mkdir(parents=True)
    pair = f'<mujoco>{PAIR}<include file="../common/more.xml"/></mujoco>'
    (tmp_path / "library" / "common" / "pair.xml").write_text(pair)
    (tmp_path / "library" / "common" / "more.xml").write_text(f'<mujoco><body name="c">{BALL}</body></mujoco>')
    (tmp_path / "secret.xml").write_text(pair)
    main = tmp_path / "library" / "robot" / "main.xml"
    main.write_text(model('<include file="../common/pair.xml"/>', equality='<joint joint1="ja" joint2="jb"/>'))
    mujoco = pytest.importorskip("mujoco")
    compiled = mujoco.MjModel.from_xml_path(str(main))
    with pytest.raises(DescriptionError, match="include_root"):
        read_description(main)
    description = read_description(main, include_root=tmp_path / "library")
    assert [link.name for link in description.links] == [compiled.body(k).name for k in range(compiled.nbody)]
    assert ccpin.load(main, include_root=tmp_path / "library").n == 1
    assert cli.main(["info", str(main), "--include-root", str(tmp_path / "library")]) == 0
    main.write_text(model('<include file="../../secret.xml"/>'))
    with pytest.raises(DescriptionError, match="outside library/"):
        read_description(main, include_root=tmp_path / "library")


def test_includes_need_a_file() -> None:
    """A model given as text cannot include anything."""
    with pytest.raises(DescriptionError, match="was not read from a file"):
        read(model('<include file="a.xml"/>'))


def body(inside: str, attributes: str = "") -> str:
    """Return a file with one body."""
    return model(f'<body name="a" {attributes}>{inside}</body>')


def constraint(equality: str) -> str:
    """Return a file with two bodies, a ball joint and one constraint."""
    third = f'<body name="c"><joint name="jc" type="ball"/>{BALL}<site name="s"/></body>'
    return model(PAIR + third, equality=equality)


MALFORMED = {
    "misspelt attribute": (body(BALL, 'posx="0"'), "posx"),
    "number": (body(BALL, 'pos="0 0 x"'), "not a list of numbers"),
    "nan": (body(BALL, 'pos="0 0 nan"'), "finite"),
    "infinity": (body(BALL, 'pos="0 inf 0"'), "finite"),
    "too few": (body(BALL, 'pos="0 0"'), "3 numbers"),
    "too many": (body(BALL, 'pos="0 0 0 0"'), "at most 3"),
    "zero quaternion": (body(BALL, 'quat="0 0 0 0"'), "quat"),
    "parallel axes": (body(BALL, 'xyaxes="1 0 0 2 0 0"'), "xyaxes"),
    "two orientations": (body(BALL, 'quat="1 0 0 0" euler="0 0 0"'), "only one"),
    "zero axis": (body(f'<joint axis="0 0 0"/>{BALL}'), "axis"),
    "joint type": (body(f'<joint type="screw"/>{BALL}'), "hinge"),
    "descending range": (body(f'<joint name="j" range="1 -1"/>{BALL}'), "joint 'j'"),
    "limited without range": (body(f'<joint limited="true"/>{BALL}'), "range"),
    "range without limited": (
        body(f'<joint range="0 1"/>{BALL}').replace("<worldbody>", '<compiler autolimits="false"/><worldbody>'),
        "limited",
    ),
    "flag": (body(BALL, 'mocap="yes"'), "true, false"),
    "free and hinge": (body(f"<freejoint/><joint/>{BALL}"), "only joint"),
    "seven freedoms": (body('<joint type="slide"/>' * 7 + BALL), "6 degrees"),
    "ball and hinge": (body(f'<joint type="ball"/><joint/>{BALL}'), "ball joint"),
    "nested free joint": (body(f"{BALL}<body><freejoint/>{BALL}</body>"), "top level"),
    "negative armature": (body(f'<joint armature="-1"/>{BALL}'), "armature"),
    "duplicate body": (model('<body name="a"/><body name="a"/>'), "twice"),
    "body called world": (model('<body name="world"/>'), "twice"),
    "duplicate joint": (body(f'<joint name="j"/><joint name="j"/>{BALL}'), "twice"),
    "duplicate site": (body('<site name="s"/><site name="s"/>'), "twice"),
    "unknown element": (body("<gem/>"), "gem"),
    "body inside a geom": (body(f'<geom size="1"><body name="b">{BALL}</body></geom>'), "<body>"),
    "misspelt option": (model("", head='<option gravitiy="0 0 0"/>'), "gravitiy"),
    "misspelt root attribute": ('<mujoco modle="a"/>', "modle"),
    "inactive but wrong": (constraint('<weld body1="z" active="false"/>'), "body 'z'"),
    "unknown section": (model("").replace("<equality>", "<equalities/><equality>"), "section"),
    "a joint repeated": (body('<replicate count="3"><joint/></replicate>' + BALL), "cannot be repeated"),
    "half a copy": (model(f'<replicate count="1.5">{BALL}</replicate>'), "whole number"),
    "less than none": (model(f'<replicate count="-1">{BALL}</replicate>'), "whole number"),
    "no count": (model(f'<replicate offset="0 0 1">{BALL}</replicate>'), "count"),
    "a million copies": (model(f'<replicate count="1000000">{BALL}</replicate>'), "more than 10000"),
    "copies of copies": (
        model(f'<replicate count="200"><replicate count="200">{BALL}</replicate></replicate>'),
        "more than 10000",
    ),
    "attach": (model('<attach model="arm" body="a" prefix="b"/>'), "to_xml"),
    "unknown class": (body(f'<joint class="nope"/>{BALL}'), "nope"),
    "unknown childclass": (body(BALL, 'childclass="nope"'), "nope"),
    "nameless class": (model("", head="<default><default/></default>"), "class name"),
    "duplicate class": (
        model("", head='<default><default class="c"/><default class="c"/></default>'),
        "twice",
    ),
    "world joint": (model("<joint/>"), "world"),
    "negative size": (body('<geom size="-1"/>'), "positive"),
    "no size": (body('<geom type="box" size="1 1"/>'), "3 positive"),
    "fromto of a sphere": (body('<geom size="1" fromto="0 0 0 1 1 1"/>'), "fromto"),
    "fromto of no length": (body('<geom type="capsule" size="1" fromto="0 0 0 0 0 0"/>'), "fromto"),
    "unknown mesh": (body('<geom type="mesh" mesh="m"/>'), "no mesh 'm'"),
    "mesh inertia": (
        model(
            '<body name="a"><joint/><geom type="mesh" mesh="m"/></body>',
            head='<asset><mesh name="m" file="m.stl"/></asset>',
        ),
        "no such file",
    ),
    "unknown material": (body('<geom size="1" material="m"/>'), "material 'm'"),
    "negative mass": (body('<inertial pos="0 0 0" mass="-1" diaginertia="1 1 1"/>'), "negative"),
    "no mass": (body('<inertial pos="0 0 0" diaginertia="1 1 1"/>'), "mass"),
    "indefinite inertia": (body('<inertial pos="0 0 0" mass="1" fullinertia="1 1 -1 0 0 0"/>'), "positive"),
    "triangle inequality": (body('<inertial pos="0 0 0" mass="1" diaginertia="1 1 3"/>'), "no solid"),
    "two inertias": (
        body('<inertial pos="0 0 0" mass="1" diaginertia="1 1 1" fullinertia="1 1 1 0 0 0"/>'),
        "excludes",
    ),
    "negative density": (body('<joint/><geom size="1" density="-1"/>'), "negative"),
    "global coordinates": (model("", head='<compiler coordinate="global"/>'), "global"),
    "euler sequence": (model("", head='<compiler eulerseq="xyw"/>'), "eulerseq"),
    "compiler angle": (model("", head='<compiler angle="turns"/>'), "degree, radian"),
    "gravity": (model("", head='<option gravity="0 0"/>'), "3 numbers"),
    "torquescale": (constraint('<weld body1="a" body2="b" torquescale="free"/>'), "torquescale"),
    "unread number": (body('<geom size="1" gap="wide"/>'), "gap"),
    "unknown body": (constraint('<connect name="k" body1="z" anchor="0 0 0"/>'), "connect 'k'.*body 'z'"),
    "unknown second body": (constraint('<weld body1="a" body2="z"/>'), "body 'z'"),
    "no anchor": (constraint('<connect body1="a" body2="b"/>'), "anchor"),
    "no body": (constraint('<connect anchor="0 0 0"/>'), "body1"),
    "body and site": (constraint('<weld body1="a" site1="s" site2="s"/>'), "either"),
    "one site": (constraint('<weld site1="s"/>'), "site2"),
    "unknown site": (constraint('<connect site1="s" site2="t"/>'), "site 't'"),
    "body with itself": (constraint('<weld body1="a" body2="a"/>'), "itself"),
    "relpose": (constraint('<weld body1="a" body2="b" relpose="1 2 3"/>'), "7 numbers"),
    "unknown joint": (constraint('<joint joint1="ja" joint2="z"/>'), "joint 'z'"),
    "no joint": (constraint("<joint/>"), "joint1"),
    "coupled ball": (constraint('<joint joint1="ja" joint2="jc"/>'), "neither"),
    "coupled to itself": (constraint('<joint joint1="ja" joint2="ja"/>'), "itself"),
    "long polynomial": (constraint('<joint joint1="ja" joint2="jb" polycoef="1 2 3 4 5 6"/>'), "at most 5"),
    "duplicate constraint": (constraint('<weld name="w" body1="a"/><weld name="w" body1="b"/>'), "twice"),
    "unknown constraint": (constraint('<glue body1="a"/>'), "glue"),
    "unknown actuated joint": (model(PAIR, tail='<actuator><motor joint="z"/></actuator>'), "joint 'z'"),
    "another root": ("<robot/>", "mujoco"),
}


@pytest.mark.parametrize("case", MALFORMED)
def test_malformed_files_are_refused_by_name(case: str) -> None:
    """Each mistake raises a DescriptionError that names the file, an element and the matter."""
    text, matter = MALFORMED[case]
    with pytest.raises(DescriptionError, match=matter) as refused:
        read_mjcf(text.encode(), "sample.xml")
    assert refused.value.source == "sample.xml"
    assert refused.value.element


def test_ill_formed_and_entity_laden_files_are_refused() -> None:
    """What is not well-formed, or declares entities, is an InvalidXmlError."""
    entity = '<!DOCTYPE mujoco [<!ENTITY e SYSTEM "file:///etc/passwd">]><mujoco model="&e;"/>'
    for text in ("<mujoco>", entity):
        with pytest.raises(InvalidXmlError):
            read(text)
